"""Every example runs in an empty folder, headless, with warnings as errors, and shows what it claims."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from script_runs import run_script

import rr1plan as rp

EXAMPLES = sorted((Path(__file__).parent.parent / "examples").glob("*.py"))
FREE = "VALID, certified free of collision in continuous time"


def number(pattern: str, said: str) -> float:
    """The number in the only group of a pattern that occurs in the output."""
    found = re.search(pattern, said)
    assert found, f"{pattern!r} is not in:\n{said}"
    return float(found[1])


def numbers(pattern: str, said: str) -> list[float]:
    return [float(value) for value in re.findall(pattern, said)]


def the_first_motion_is_proven_and_replayed(said: str, folder: Path) -> None:
    assert FREE in said
    assert "contacts: none" in said
    assert number(r"tracking error: (\S+) rad", said) < 1e-3
    saved = rp.load_motion(folder / "01_first_motion.json")
    ends = [rp.Kinematics(saved.scene).pose(q, "tool")[:3, 3] for q in saved.path.waypoints[[0, -1]]]
    np.testing.assert_allclose(ends[1], [-0.30, 0.25, 0.20], atol=1e-3)
    assert np.linalg.norm(ends[0] - ends[1]) > 0.2
    assert (folder / "01_first_motion.html").stat().st_size > 100_000


def robots_have_presets_and_grippers_and_bad_files_are_refused(said: str, _: Path) -> None:
    assert f"shipped: {', '.join(rp.robot_names())}" in said
    sim, hardware = (
        np.fromstring(re.search(rf"{p}: at most \[(.*)\] rad/s", said)[1], sep=" ") for p in ("sim", "hardware")
    )
    assert (hardware < 0.1 * sim).all()
    assert "fingers open at {'finger_joint': 0.9}" in said
    assert re.search(r"two_links: 2 joints, tool at \[0.6 +0. +0. \] m when straight", said)
    assert "refused: broken.urdf:7: <box> size='nan'" in said


def scenes_are_values(said: str, folder: Path) -> None:
    assert "obstacles: ground, crate, ball, post, scan | before: none" in said
    assert "home is free: True" in said
    # Closer than the padding of 20 mm.
    assert number(r"nearest: .*, (\d+) mm apart", said) < 20
    assert "with padding, home is free: False" in said
    assert "held: ball | put down again: True" in said
    assert (folder / "03_scenes.html").exists()


def poses_have_several_solutions_and_some_are_rejected(said: str, _: Path) -> None:
    overhead, low = numbers(r": (\d+) solutions", said)
    assert overhead >= 3
    assert low >= 2
    kept, rejected = (numbers(pattern, said) for pattern in (r"free of collision: (\d+)", r"rejected: (\d+)"))
    assert kept[0] == overhead
    assert kept[1] >= 1
    assert rejected[1] >= 1
    assert said.count(" touches ") == sum(rejected)
    assert said.count("] free\n") == sum(kept)
    assert number(r"(\d+) free configurations reach", said) > 10
    assert "two meters away: the goal is out of reach" in said


def samples_are_free_and_the_certificate_finds_the_contact(said: str, _: Path) -> None:
    assert "20 samples along the edge are all free: True" in said
    assert re.search(r"certificate says the edge is free: +False", said)
    assert re.search(r"first contact: arm/link2 and needle, between samples (\d+) and (\d+)", said)
    assert re.search(r"with the needle lifted: +True", said)
    assert number(r"looked at (\d+) configurations", said) < 20


def planners_differ_in_cost_and_optimizing_ones_improve(said: str, _: Path) -> None:
    lengths = {name: float(length) for name, length in re.findall(r"^(\w+) +found .* length (\S+) rad$", said, re.M)}
    assert set(lengths) == {"rrt_connect", "lbkpiece1", "prm", "bit_star", "anytime"}
    assert len(set(lengths.values())) == len(lengths)
    assert max(lengths["bit_star"], lengths["anytime"]) < min(lengths["rrt_connect"], lengths["prm"])
    assert lengths["anytime"] < 3.0
    improvements = [numbers(r"(\S+) at \S+ s", line) for line in said.splitlines() if "improved:" in line]
    assert len(improvements) == 2
    assert all(costs == sorted(costs, reverse=True) and costs[-1] < costs[0] for costs in improvements)
    assert "repeats to the byte: True" in said
    assert "infeasible - the goal is out of reach" in said


def retimings_keep_the_limits_and_stops_cost_time(said: str, _: Path) -> None:
    seconds = {name: float(time) for name, time in re.findall(r"^(\w+) +(\S+) s, uses", said, re.M)}
    assert seconds["blend"] < seconds["stop"] < seconds["ruckig"]
    assert said.count("valid: True") == 3
    assert max(numbers(r"(\d+) % of the", said)) <= 100
    assert number(r"on the real arm: (\S+) s", said) > seconds["blend"]


def the_referee_names_what_is_wrong_and_what_it_did_not_check(said: str, _: Path) -> None:
    good, fast, blocked = said.split(" \n\n")
    assert FREE in good
    assert "violation" not in good
    assert "not checked  jerk" in good
    assert "INVALID" in fast
    assert set(re.findall(r"violation +(\w+):", fast)) == {"acceleration"}
    # Twice the speed needs four times the acceleration, which was at its limit.
    assert number(r"acceleration +(\S+) % of the limit", fast) == pytest.approx(400, rel=0.01)
    assert "INVALID" in blocked
    assert set(re.findall(r"violation +collision: \S+ and (\w+)", blocked)) == {"late_ball"}


def servos_follow_under_both_presets(said: str, _: Path) -> None:
    sim, hardware = numbers(r"limits, (\S+) s", said)
    assert hardware > 3 * sim
    assert said.count("contacts: none") == 3
    errors = numbers(r"tracking error: (\S+) rad", said)
    assert len(errors) == 2
    assert max(errors) < 1e-3
    assert max(numbers(r"effort: (\d+) % of the limit", said)) < 100
    assert "kinematic replay" in said


def two_arms_move_on_one_clock(said: str, folder: Path) -> None:
    assert "left, right move: 12 joints" in said
    assert FREE in said
    assert "contacts: none" in said
    left, right = (number(rf"{arm}: (\S+) s, 6 joints", said) for arm in ("left", "right"))
    assert left == right
    saved = rp.load_motion(folder / "10_two_arms.json")
    assert saved.trajectory.duration == pytest.approx(left, abs=0.01)
    assert saved.path.waypoints.shape[1] == 12
    assert (folder / "10_two_arms.html").exists()


def six_of_twelve_arms_move_together(said: str, folder: Path) -> None:
    assert "ring: arm01, arm02, arm03, arm04\n" in said
    assert "12 arms; 6 move, 36 joints" in said
    assert FREE in said
    assert "contacts: none" in said
    saved = rp.load_motion(folder / "11_many_arms.json")
    moving = np.ptp(saved.trajectory(np.linspace(0.0, saved.trajectory.duration, 5)), axis=0) > 0.05
    assert moving.sum() == 36
    assert (folder / "11_many_arms.html").exists()


def one_lesson_has_a_path_and_the_other_has_none(said: str, folder: Path) -> None:
    path, no_path = said.split("planar2r_no_path:")
    assert "planar2r_path: the planner says found" in path
    assert "No path exists" not in path
    assert "the planner says timeout" in no_path
    assert "No path exists: start and goal are free, but in different components" in no_path
    for name in ("planar2r_path", "planar2r_no_path"):
        assert all((folder / f"12_{name}.{suffix}").stat().st_size > 10_000 for suffix in ("png", "svg", "html"))


def the_tool_stays_on_its_line(said: str, _: Path) -> None:
    assert FREE in said
    assert number(r"leaves the line by (\S+) mm at most", said) < 1.0
    assert re.search(r"^infeasible - the line to the goal ends after \d", said, re.M)


def files_read_back_exactly_and_altered_ones_are_refused(said: str, folder: Path) -> None:
    assert "read back exactly: True" in said
    header = "t,q:rr1/shoulder_joint,"
    assert header in said
    assert (folder / "14_trajectory.csv").read_text().startswith(header)
    assert "proven again: True" in said
    assert "there: Report(not valid: collision" in said
    assert "what differs: obstacle 'late_ball' is new" in said
    assert "from samples: 1.177 s" in said
    assert FREE in said
    assert "refused: 14_altered.json: was altered" in said


def many_problems_are_answered_in_order(said: str, _: Path) -> None:
    fractions = numbers(r"(\d+) % after", said)
    assert fractions == sorted(fractions)
    assert fractions[-1] == 100
    answers = re.findall(r"^\[ *(\S+) +(\S+) +0.2 *\] (.*)$", said, re.M)
    np.testing.assert_allclose([float(y) for _, y, _ in answers], [*np.linspace(-0.3, 0.3, 6), 0.0], atol=0.005)
    assert answers[-1][2].startswith("infeasible - the goal is out of reach")
    assert sum(answer.endswith(" s") for *_, answer in answers) >= 5


def spheres_contain_the_corners(said: str, folder: Path) -> None:
    levels = re.findall(r"^rr1/\w+: (\d+) around the link, (\d+) around its bodies, (\d+) that fill them$", said, re.M)
    assert all(one == "1" and int(one) <= int(some) <= int(many) for one, some, many in levels)
    assert len(levels) == 9
    assert [f"level {level}: 8 of 8 corners are inside" in said for level in range(3)] == [True] * 3
    assert '"spheres":{"links"' in (folder / "16_spheres.html").read_text()


def eight_arms_swap_places_on_one_clock(said: str, folder: Path) -> None:
    assert FREE in said
    assert sum(int(n) for n in re.findall(r"(\d+) arms that can meet", said)) == 8
    together, alone = number(r"all arrive after (\S+) s", said), number(r"the slowest arm alone after (\S+) s", said)
    assert 0.0 < alone <= together + 1e-9
    assert "contacts: none" in said
    assert (folder / "17_swap_places.html").exists()


def arms_wait_for_each_other_whatever_is_late(said: str, folder: Path) -> None:
    assert "PlanGraph(4 arms" in said
    assert said.count("does not go beyond its planned position") == 3
    planned, delayed = (float(t) for t in re.search(r"planned (\S+) s, with delays (\S+) s", said).groups())
    assert planned < delayed
    assert FREE in said
    assert "contacts: none" in said
    assert "with a skew tolerance of 0.20 s" in said
    assert "AddedMotion(by " in said
    assert number(r"at 0.7 s it has (\S+) rad/s", said) > 0.0
    assert rp.load_plan_graph(folder / "18_delays.json").dependencies
    assert (folder / "18_delays.html").exists()


def two_arms_are_timed_past_each_other(said: str, folder: Path) -> None:
    assert FREE in said
    assert number(r"(\S+) times the slowest arm alone", said) > 0.0
    assert (folder / "19_two_arms_swap.html").exists()
    if "of the diagram is blocked" in said:
        assert (folder / "19_diagram.png").stat().st_size > 10_000
        assert "</svg>" in (folder / "19_diagram.svg").read_text()


def tools_meet_in_windows_of_four_widths(said: str, folder: Path) -> None:
    assert len(re.findall(r"^\d+ cm: Report\(certified", said, re.M)) == 4
    assert numbers(r"meet (\S+) cm apart", said) == [4.0] * 4
    problem = rp.load_problems(folder / "20_hand_over.toml")["meet"]
    assert rp.CollisionChecker(problem.scene, problem.arms).is_free(problem.start)


def ten_arms_wait_and_touch_if_they_do_not(said: str, folder: Path) -> None:
    assert FREE in said
    together, careless = number(r"10 arms, makespan (\S+) s", said), number(r"nobody waits: (\S+) s", said)
    assert careless < 1.5 * together
    assert "Report(not valid: collision" in said
    for name in ("21_time_line.png", "21_nobody_waits.png", "21_time_line.svg"):
        assert (folder / name).stat().st_size > 10_000
    assert "arm01" in (folder / "21_nobody_waits.html").read_text()


def a_hundred_arms_move_at_once(said: str, folder: Path) -> None:
    assert "100 arms, 600 joints" in said
    assert FREE in said
    assert sum(int(n) for n in re.findall(r"groups with (\d+) arms", said)) == 100
    assert (folder / "22_time_line.png").stat().st_size > 10_000
    assert (folder / "22_hundred_on_a_grid.html").exists()


def what_has_no_schedule_says_why(said: str, _: Path) -> None:
    assert re.search(r"invalid_goal\): the goals exclude each other.*'arm02/\w+' and 'arm03/\w+' overlap by", said)
    assert re.search(r"invalid_start\): arm03: the start is in collision: 'arm03/\w+' and 'box' overlap", said)
    assert re.search(r"infeasible\): arm02: no path exists: joint '.*' cannot pass .*'wall' touch", said)
    assert re.search(r"^ManyArmsResult\(3 arms", said, re.M)


def a_simulation_is_commanded_while_it_runs(said: str, folder: Path) -> None:
    assert "Execution(succeeded), code 0" in said
    assert "contacts: 0" in said
    assert number(r"at most (\S+) rad off", said) < 1e-3
    assert "the way back: Execution(canceled" in said
    assert "again at 0 s, 0 rad from the start" in said
    assert len((folder / "24_states.jsonl").read_text().splitlines()) == 200


def a_tower_falls_and_a_page_shows_it(said: str, folder: Path) -> None:
    heights = ("top block at", "drawn at", "bodies, the top one at")
    standing, drawn, again = (number(rf"{words} (\S+) m", said) for words in heights)
    assert standing == pytest.approx(drawn, abs=0.002)
    assert again == drawn
    assert number(r"(\d) of 8 blocks lie", said) >= 6
    assert number(r"deepest penetration (\S+) mm", said) < 20
    assert "forbidden contacts: []" in said
    assert '"poses"' in (folder / "25_loose_bodies.html").read_text()


def an_arm_is_calibrated_and_its_slipped_belt_is_named(said: str, folder: Path) -> None:
    assert "20 poses to measure in" in said
    assert "left out: row 5" in said
    assert number(r"zeros are off by at most (\S+) deg", said) < 0.5
    assert number(r"moved: elbow_joint: \+(\S+) rad \(", said) == pytest.approx(np.radians(2.0), abs=np.radians(0.5))
    assert number(r"all others by less than (\S+) standard", said) < 4.0
    assert "not determined: {'hand_joint': ('zero', 'scale', 'sign')}" in said
    assert rp.load_calibration(folder / "31_rr1.toml").unit == "steps"


def an_arm_that_is_pushed_leaves_the_corridor_and_comes_back(said: str, folder: Path) -> None:
    assert said.index("outside: left the certified corridor") < said.index("inside the certified corridor again")
    assert number(r"(\d+) messages, ", said) > 100
    assert number(r"at most (\S+) rad or m off the plan", said) > 0.01
    assert "MuJoCo has 0 contacts" in said
    assert len((folder / "32_run.jsonl").read_text().splitlines()) == number(r"from the file: (\d+) messages", said)
    assert 0.0 < number(r"5 mrad off: (\d+) % of the corridor", said) < 300.0


def a_block_is_carried_by_friction(said: str, folder: Path) -> None:
    assert FREE in said
    assert number(r"(\d+) grasps from above", said) >= 4
    attached, detached = (number(rf"at (\S+) s: {change} 'block'", said) for change in ("attach", "detach"))
    assert 0.0 < attached < detached
    assert number(r"block: at most (\S+) mm from its planned position", said) < 10.0
    assert "contacts: none that no stage allows" in said
    assert "read again: SequencePlan(13 stages, Report(certified" in said
    assert re.search(r"with a ball: stage 7 .*late_ball and block overlap", said)
    assert re.search(r"too far: no plan \(infeasible\): segment 7 .*out of reach", said)
    assert (folder / "26_pick_and_place.html").stat().st_size > 100_000


def three_blocks_end_in_a_row(said: str, folder: Path) -> None:
    assert re.search(r"34 stages, \S+ s: Report\(certified", said)
    for name, y in (("red", -0.06), ("green", -0.14), ("blue", -0.22)):
        assert f"{name} at [-0.28, {y}], " in said
    assert max(numbers(r"(\S+) mm off in the simulation", said)) < 5.0
    assert (folder / "27_blocks.html").exists()


def a_bar_goes_from_one_arm_to_the_other(said: str, folder: Path) -> None:
    assert FREE in said
    assert re.findall(r"at \S+ s: (\w+) 'bar'", said) == ["attach", "detach", "attach", "detach"]
    assert number(r"bar: at most (\S+) mm from its planned position", said) < 10.0
    assert rp.load_sequence(folder / "28_hand_over.json").valid


def assertions_say_what_is_wrong(said: str, _: Path) -> None:
    assert said.count(": passed") == 3
    assert "11 replays passed; the worst:" in said
    assert "FCL, Coal, MuJoCo at" in said
    assert "free of contacts, they agree" in said
    assert re.search(r"in_the_way: failed\n  the motion is not valid: collision: .*and ball overlap by", said)


def a_motion_goes_to_an_emulated_control_box(said: str, folder: Path) -> None:
    assert "certified free of collision, steps and ramps" in said
    assert number(r"planned (\S+) s", said) < number(r"the arm takes (\S+) s", said)
    assert "executed: idle, counters" in said
    assert "refused: W1 is at 0 steps" in said
    assert "objections of a controller: []" in said
    assert rp.load_joint_trajectory(folder / "30_motion.yaml").degree == 3  # its accelerations jump


def a_sequence_is_written_by_hand(said: str, _: Path) -> None:
    assert FREE in said
    assert number(r"block: at most (\S+) mm from its planned position", said) < 10.0
    assert "contacts: none that no stage allows" in said
    assert re.search(r"33_typo.toml:\d+: segments\[4\].move_gripper: .*Did you mean 'around'", said)


CLAIMS: dict[str, Callable[[str, Path], None]] = {
    "01_first_motion": the_first_motion_is_proven_and_replayed,
    "02_robots": robots_have_presets_and_grippers_and_bad_files_are_refused,
    "03_scenes": scenes_are_values,
    "04_inverse_kinematics": poses_have_several_solutions_and_some_are_rejected,
    "05_certified_edges": samples_are_free_and_the_certificate_finds_the_contact,
    "06_planners": planners_differ_in_cost_and_optimizing_ones_improve,
    "07_retiming": retimings_keep_the_limits_and_stops_cost_time,
    "08_referee": the_referee_names_what_is_wrong_and_what_it_did_not_check,
    "09_replay": servos_follow_under_both_presets,
    "10_two_arms": two_arms_move_on_one_clock,
    "11_many_arms": six_of_twelve_arms_move_together,
    "12_configuration_space": one_lesson_has_a_path_and_the_other_has_none,
    "13_straight_line": the_tool_stays_on_its_line,
    "14_files": files_read_back_exactly_and_altered_ones_are_refused,
    "15_many_problems": many_problems_are_answered_in_order,
    "16_spheres": spheres_contain_the_corners,
    "17_swap_places": eight_arms_swap_places_on_one_clock,
    "18_delays": arms_wait_for_each_other_whatever_is_late,
    "19_two_arms_swap": two_arms_are_timed_past_each_other,
    "20_hand_over": tools_meet_in_windows_of_four_widths,
    "21_ten_in_a_ring": ten_arms_wait_and_touch_if_they_do_not,
    "22_hundred_on_a_grid": a_hundred_arms_move_at_once,
    "23_no_schedule": what_has_no_schedule_says_why,
    "24_simulation": a_simulation_is_commanded_while_it_runs,
    "25_loose_bodies": a_tower_falls_and_a_page_shows_it,
    "26_pick_and_place": a_block_is_carried_by_friction,
    "27_blocks": three_blocks_end_in_a_row,
    "28_hand_over": a_bar_goes_from_one_arm_to_the_other,
    "29_assert_replays": assertions_say_what_is_wrong,
    "30_real_arm": a_motion_goes_to_an_emulated_control_box,
    "31_calibration": an_arm_is_calibrated_and_its_slipped_belt_is_named,
    "32_mirror": an_arm_that_is_pushed_leaves_the_corridor_and_comes_back,
    "33_sequence_file": a_sequence_is_written_by_hand,
}


# The first one, and one whose spawned processes import it.
_IN_A_PROCESS = ("01_first_motion", "15_many_problems")


@pytest.mark.parametrize("example", [p for p in EXAMPLES if p.stem not in _IN_A_PROCESS], ids=lambda p: p.stem)
def test_an_example_runs_and_shows_what_it_claims(
    example: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    CLAIMS[example.stem](run_script(example, tmp_path, monkeypatch, capfd), tmp_path)


@pytest.mark.parametrize("name", _IN_A_PROCESS)
def test_an_example_runs_in_a_fresh_process(name: str, tmp_path: Path) -> None:
    command = [sys.executable, "-W", "error", str(EXAMPLES[0].with_name(f"{name}.py"))]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    # Messages about the first compilation depend on earlier runs.
    assert [line for line in done.stderr.splitlines() if not line.startswith("compiling for this machine")] == []
    CLAIMS[name](done.stdout, tmp_path)


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda p: p.stem)
def test_an_example_is_numbered_short_and_says_what_it_shows(example: Path) -> None:
    text = example.read_text()
    assert re.match(r"\d\d_[a-z0-9_]+$", example.stem)
    assert len(text.splitlines()) <= 80
    assert ast.get_docstring(ast.parse(text))


def test_numbers_are_consecutive() -> None:
    assert [int(p.stem[:2]) for p in EXAMPLES] == list(range(1, len(EXAMPLES) + 1))
