"""Planning in pages: the answers of `plan_motion`, the collision checker and inverse kinematics, to the last bit."""

from __future__ import annotations

import base64
import html
import json
import math
import shutil
import subprocess
import zlib
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser.conftest import Tab

import rr1plan as rp
from rr1plan.collision import CollisionChecker
from rr1plan.errors import CancelledError, InstallationError
from rr1plan.planning import Budget
from rr1plan.playback.viewer import page_planner as pages
from rr1plan.playback.viewer.html_page import page_html, planner_script
from rr1plan.playback.viewer.page_capture import wait_until
from rr1plan.playback.viewer.page_document import view_document
from rr1plan.playback.viewer.page_planner import page_modules, page_planner
from rr1plan.sequences.sequence_page import page_parts
from rr1plan.sequences.stage_planners import planning_scenes
from rr1plan.transforms import pose

ANSWERS = Path(__file__).with_name("page_planner_answers.js").read_text(encoding="utf-8")
NODE = """
let text = "";
for await (const part of process.stdin) text += part;
const { data, name, given } = JSON.parse(text);
let answer;
try {
  answer = answers[name](await loadPlanner(data), ...given);
} catch (error) {
  answer = { rejected: error.message };
}
process.stdout.write(JSON.stringify(answer));
"""
SEARCH = 400  # iterations of each search
SCENES = ("rr1_shelf", "rr1_cluttered", "rr1_pair", "planar2r_path")
ROUNDS, QUESTIONS = 5, 50  # 1,000 questions in all scenes
MANY = "rr1_shared_bin"  # of four arms


def in_node(data: dict[str, Any], name: str, *given: Any, before: str = "") -> Any:
    """The answer of a function of `page_planner_answers.js` to a planner that is loaded from data."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("no Node on this machine")
    text = "\n".join([before, planner_script(), ANSWERS, NODE])
    message = json.dumps({"data": {**data, "modules": page_modules()}, "name": name, "given": given})
    command = [node, "--input-type=module", "--eval", text]
    done = subprocess.run(command, input=message, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads(done.stdout)


def planner_data(scene: rp.Scene) -> dict[str, Any]:
    data = page_planner(scene)
    assert "missing" not in data
    return data


def columns(T: np.ndarray) -> list[float]:
    """A transform in the format of pages, column by column."""
    return T.T.ravel().tolist()


def moved_scenes(scene: rp.Scene, rng: np.random.Generator) -> list[tuple[rp.Scene, list[Any]]]:
    """The scene, then again and again with two of its obstacles elsewhere, and the moves there."""
    made: list[tuple[rp.Scene, list[Any]]] = [(scene, [])]
    loose = [name for name in scene.obstacles if name not in ("ground", "table", "floor")]
    while len(made) < ROUNDS:
        moves = []
        for name in rng.permutation(loose)[:2].tolist():
            obstacle = scene.obstacles[name]
            there = obstacle.pose[:3, 3] + rng.normal(size=3) * [0.08, 0.08, 0.0]
            turn = rng.uniform(-0.5, 0.5)
            half_turn = [math.cos(turn / 2), 0.0, 0.0, math.sin(turn / 2)]
            T = pose(there, quaternion=half_turn) @ np.block([[obstacle.pose[:3, :3], np.zeros((3, 1))], [0, 0, 0, 1]])
            scene = scene.with_obstacle_at(name, T)
            moves.append([name, columns(T)])
        made.append((scene, moves))
    return made


def configurations(scene: rp.Scene, count: int, rng: np.random.Generator, free: float = 0.9) -> np.ndarray:
    """Random configurations, most of them free."""
    checker = CollisionChecker(scene)
    lower, upper = np.maximum(checker.limits.lower, -3.2), np.minimum(checker.limits.upper, 3.2)
    made: list[np.ndarray] = []
    for wanted in rng.uniform(size=count) < free:
        q = rng.uniform(lower, upper)
        for _ in range(200):
            if not wanted or checker.is_free(q):
                break
            q = rng.uniform(lower, upper)
        made.append(q)
    return np.array(made)


def packed(array: np.ndarray) -> list[int]:
    return [array.size, zlib.crc32(np.ascontiguousarray(array).tobytes())]


def packed_parts(motion: rp.MotionPlan) -> list[list[int]]:
    """Checksums of the path before and after shortening and of the trajectory."""
    assert motion.result.path is not None
    trajectory = motion.trajectory
    arrays = (motion.result.path.waypoints, motion.path.waypoints, trajectory.breaks, trajectory.coefficients)
    return [packed(array) for array in arrays]


def expected_motion(problem: rp.Problem, seed: int) -> dict[str, Any]:
    motion = rp.plan_motion(problem, planner="rrt_connect", budget=Budget(math.inf, SEARCH), rng=seed)
    answer: dict[str, Any] = {"status": motion.status.value, "margin": motion.margin}
    if not motion.found:
        return answer
    return answer | {"certified": motion.valid, "parts": packed_parts(motion)}


def questions(name: str, rounds: int = ROUNDS, count: int = QUESTIONS) -> tuple[rp.Scene, list[Any], list[Any]]:
    """A scene, rounds of questions for the page, and the answers of `plan_motion`."""
    scene = rp.load_scene(name)
    rng = np.random.default_rng([*SCENES, MANY].index(name))
    asked, expected, seed = [], [], 0
    for moved, moves in moved_scenes(scene, rng)[:rounds]:
        ends = configurations(moved, 2 * count, rng).reshape(count, 2, -1)
        answers = []
        for start, goal in ends:
            problem = rp.Problem(moved, start, moved.split(goal, tuple(moved.arms)))
            answers.append(expected_motion(problem, seed))
            seed += 1
        asked.append({"moves": moves, "questions": ends.tolist()})
        expected.append(answers)
    return scene, asked, expected


def check(found: list[Any], expected: list[Any]) -> None:
    flat = [answer for answers in found for answer in answers]
    wanted = [answer for answers in expected for answer in answers]
    assert len(flat) == len(wanted)
    for i, (got, want) in enumerate(zip(flat, wanted, strict=True)):
        reason = got.pop("reason")
        assert (reason == "") == (want["status"] == "found"), i
        assert got == want, (i, reason)
    # Results vary.
    solved = sum(answer["status"] == "found" for answer in wanted)
    assert 0.2 * len(wanted) < solved < len(wanted)
    assert any(answer["parts"][0][0] > answer["parts"][1][0] for answer in wanted if answer["status"] == "found")


@pytest.mark.browser
@pytest.mark.parametrize("name", SCENES)
def test_a_page_plans_the_motions_of_plan_motion_to_the_last_bit(name: str, tab: Tab, tmp_path: Path) -> None:
    scene, asked, expected = questions(name)
    # In Chromium, under the policy that the page has.
    tab.open(rp.save_html(tmp_path / f"{name}.html", scene))
    wait_until(tab.page, "Boolean(RR1.planner)")
    tab.ask(f"() => {{ {ANSWERS} window.answers = answers; }}")
    check(tab.ask("([asked, most]) => answers.motions(RR1.planner, asked, most)", [asked, SEARCH]), expected)
    assert not tab.complaints
    assert all(url.startswith(("file:", "data:", "blob:")) for url in tab.requests)


@pytest.mark.parametrize(("name", "count"), [("rr1_shelf", 50), (MANY, 15)])
def test_node_plans_the_same(name: str, count: int) -> None:
    scene, asked, expected = questions(name, 2, count)
    check(in_node(planner_data(scene), "motions", asked, SEARCH), expected)


def test_a_refusal_names_the_joints_that_are_out_of_limits(rr1_table: rp.Scene) -> None:
    start, goal = rr1_table.configuration(), rr1_table.configuration()
    goal[[3, 5]] = 10.0
    asked: list[Any] = [{"moves": [], "questions": [[start.tolist(), goal.tolist()]]}]
    [[found]] = in_node(planner_data(rr1_table), "motions", asked, 100)
    assert found["status"] == "invalid_goal"
    assert found["reason"] == "the goal is out of limits: rr1/forearm_joint, rr1/hand_joint"


def gap_scene(gap: float) -> rp.Scene:
    """A ball that slides through a gap [m] in addition to its diameter."""
    scene = rp.Scene().with_arm("arm", rp.planar_arm("PP", (1.0, 1.0), width=0.1))
    for name, side in (("left", -1.0), ("right", 1.0)):
        scene = scene.with_obstacle(name, rp.Box((0.1, 2.0, 0.2)), [0.5, 0.5 + side * (1.05 + 0.5 * gap), 0.0])
    return scene


def test_reported_iterations_never_decrease_while_smaller_margins_are_tried() -> None:
    reported = in_node(planner_data(gap_scene(-0.01)), "progress", [0.1, 0.8], [0.9, 0.2], 20_000)
    assert reported[-1] == 20_000
    assert reported == sorted(reported)


@pytest.mark.parametrize(
    ("gap", "wanted", "margin"),
    [(0.05, 0.02, 0.02), (0.03, 0.02, 0.01), (0.02, 0.02, 0.005), (-0.01, 0.02, None), (0.05, 100.0, 100.0 / 8192.0)],
)
def test_a_margin_that_blocks_is_halved_as_by_plan_motion(gap: float, wanted: float, margin: float | None) -> None:
    scene, start, goal, most = gap_scene(gap), [0.1, 0.8], [0.9, 0.2], 20_000
    asked: list[Any] = [{"moves": [], "questions": [[start, goal]]}]
    [[found]] = in_node(page_planner(scene, margin=wanted), "motions", asked, most)
    motion = rp.plan_motion(rp.Problem(scene, start, goal), margin=wanted, budget=Budget(math.inf, most), rng=0)
    if margin is None:
        assert not motion.found
        assert found["status"] == "timeout"
        return
    assert motion.margin == found["margin"] == margin
    assert found["certified"]
    assert found["parts"] == packed_parts(motion)


@pytest.mark.parametrize("name", SCENES)
def test_configurations_and_edges_are_judged_as_by_the_collision_checker(name: str) -> None:
    scene, rng = rp.load_scene(name), np.random.default_rng(7)
    moved, moves = moved_scenes(scene, rng)[1]
    checker = CollisionChecker(moved)
    rows = configurations(moved, 120, rng, free=0.5)
    found = in_node(planner_data(scene), "configurations", moves, rows.tolist())
    free = 0
    for q, (is_free, contacts, clearance, within) in zip(rows, found, strict=True):
        near = [contact for contact in checker.contacts(q) if contact.depth < 1e-6]
        expected = {frozenset((contact.a, contact.b)) for contact in checker.contacts(q)}
        assert is_free == checker.is_free(q) or near
        assert {frozenset(pair) for pair in contacts} == expected or near
        assert clearance == checker.moving_clearance(q)
        assert within == checker.within_limits(q)
        free += is_free
    assert 20 < free < 118
    edges = in_node(planner_data(scene), "edges", rows.tolist())
    native = CollisionChecker(scene)
    assert edges == [native.edge_is_free(a, b) for a, b in pairwise(rows)]


@pytest.mark.parametrize("name", ["rr1_shelf", "rr1_pair", "planar2r_path"])
def test_inverse_kinematics_finds_the_configuration_of_solve_ik(name: str) -> None:
    scene, rng = rp.load_scene(name), np.random.default_rng(3)
    targets, expected = [], []
    first = {arm: column for column, arm in enumerate(scene.arms)}
    for arm, placed in scene.arms.items():
        robot, kinematics = placed.robot, rp.Kinematics(scene, [arm])
        first[arm] = scene.joint_names().index(f"{arm}/{robot.joint_names[0]}")
        columns_of_arm = slice(first[arm], first[arm] + robot.nq)
        for seed in range(24):
            start = configurations(scene, 1, rng)[0]
            T = placed.base @ robot.link_poses(configurations(scene, 1, rng)[0][columns_of_arm])[robot.tool]
            # Full poses, positions, and some that are out of reach.
            far = seed % 4 == 3
            goal = rp.PoseGoal("tool", T if seed % 2 == 0 else T[:3, 3] + [3.0 * far, 0.0, 0.0])
            found = rp.solve_ik(
                *(kinematics, goal),
                seeds=start[columns_of_arm],
                attempts=20,
                max_solutions=1,
                rng=seed,
            )
            q = start.copy()
            if found.found:
                q[columns_of_arm] = found.solutions[0]
            target = goal.position.tolist()
            if goal.rotation is not None:
                target = columns(np.block([[goal.rotation, goal.position[:, None]], [0, 0, 0, 1]]))
            targets.append([arm if seed % 3 else f"{arm}/{robot.tool}", target, start.tolist(), seed])
            expected.append(q.tolist() if found.found else None)
    assert in_node(planner_data(scene), "solutions", targets) == expected
    assert 0 < expected.count(None) < 0.9 * len(expected)


# ---- many arms ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def crowd() -> rp.Scene:
    """Fourteen arms of three kinds, turned, near each other; one holds a rod, and one may touch a post."""
    rr1, planar = rp.load_robot("rr1"), rp.planar_arm(lengths=(0.3, 0.25))
    scene = rp.Scene(padding=0.001).with_obstacle("ball", rp.Sphere(0.1), [0.35, 0.35, 0.45])
    scene = scene.with_obstacle("post", rp.Box([0.05, 0.05, 0.6]), [1.1, -0.3, 0.3])
    for i in range(11):
        half = 0.35 * i
        base = pose([0.8 * (i % 4), 0.8 * (i // 4), 0.0], quaternion=[math.cos(half), 0.0, 0.0, math.sin(half)])
        scene = scene.with_arm(f"arm{i}", rr1, base)
    for i in range(3):
        scene = scene.with_arm(f"flat{i}", planar, [0.4 + 0.8 * i, 2.3, 0.1], q=[0.3, 0.4])
    tool = scene.link_poses()["arm5/" + rr1.tool]
    held = scene.with_obstacle("rod", rp.Cylinder(0.01, 0.2), tool @ pose([0.0, 0.0, 0.12]))
    return held.attach("rod", "arm5", touch=rr1.link_names).allow("arm2", "post")


def free_goals(scene: rp.Scene, arm: str, count: int, rng: np.random.Generator) -> list[np.ndarray]:
    """Configurations of the whole scene, an arm somewhere else in which it is free."""
    checker, places = CollisionChecker(scene, [arm]), scene.joint_names()
    own = [places.index(name) for name in scene.joint_names([arm])]
    made: list[np.ndarray] = []
    for _ in range(400):
        q = scene.configuration()
        q[own] = rng.uniform(np.maximum(checker.limits.lower, -3.1), np.minimum(checker.limits.upper, 3.1))
        if checker.is_free(q[own]):
            made.append(q)
        if len(made) == count:
            return made
    raise AssertionError(f"{arm} is hardly ever free")


def asked_of(scene: rp.Scene, goal: np.ndarray, seed: int) -> dict[str, Any]:
    start = scene.configuration().tolist()
    return {"start": start, "goal": goal.tolist(), "seed": seed, "iterations": SEARCH}


def test_one_arm_among_many_moves_as_plan_motion_says(crowd: rp.Scene) -> None:
    rng, data = np.random.default_rng(11), planner_data(crowd)
    assert len(data["templates"]) == 4  # an RR1, one that may touch the post, one with the rod, a planar arm
    moved = crowd.with_obstacle_at("ball", [0.5, 0.45, 0.5])
    assert CollisionChecker(moved).is_free(moved.configuration())
    asked, expected = [], []
    for arm in ("arm0", "arm2", "arm5", "arm6", "flat1"):
        for goal in free_goals(moved, arm, 5, rng):
            own, seed = moved.split(goal, tuple(moved.arms))[arm], len(asked)
            problem = rp.Problem(moved, {arm: moved.arms[arm].q}, {arm: own})
            found = expected_motion(problem, seed)
            asked.append(asked_of(moved, goal, seed))
            parts = [[list(moved.arms).index(arm), found["parts"]]] if found["status"] == "found" else []
            expected.append((found["status"], bool(parts), parts))
    moves = [["ball", columns(moved.obstacles["ball"].pose)]]
    answers = in_node(data, "inTurn", moves, asked)
    assert [(a["status"], a["certified"], a["parts"]) for a in answers] == expected
    solved = [answer for answer in answers if answer["status"] == "found"]
    assert len(solved) > 0.7 * len(asked)
    # Results for one arm hold in the whole scene.
    for answer in solved[::6]:
        assert rp.validate(joined(moved, answer["motion"]), moved).certified


def joined(scene: rp.Scene, motion: list[dict[str, Any]]) -> rp.Trajectory:
    """A motion of a page as a trajectory."""
    breaks, coefficients = (np.reshape(part["values"], part["shape"]) for part in motion)
    return rp.Trajectory(scene.joint_names(), breaks, coefficients)


def test_arms_move_one_after_the_other_and_give_way(crowd: rp.Scene) -> None:
    start = crowd.configuration()
    rng, names = np.random.default_rng(5), crowd.joint_names()
    # flat0 goes where flat1 reaches before it has left.
    flat = crowd.with_configuration("flat1", [math.pi, 0.0]).with_configuration("flat0", [math.pi / 2, 0.0])
    goal = flat.configuration()
    for arm, q in (("flat0", [0.0, 0.0]), ("flat1", [0.3, 0.4])):
        goal[[names.index(name) for name in crowd.joint_names([arm])]] = q
    questions = [{**asked_of(flat, goal, 0), "iterations": 1e9}]
    several = start.copy()
    for arm in ("arm0", "arm6", "arm9"):
        own = [names.index(name) for name in crowd.joint_names([arm])]
        several[own] = free_goals(crowd, arm, 1, rng)[0][own]
    questions += [{**asked_of(crowd, several, 3), "iterations": 1e9}, asked_of(crowd, start + 1e-6, 0)]
    blocked = flat.configuration()
    blocked[[names.index(name) for name in crowd.joint_names(["flat0"])]] = [0.0, 0.0]
    questions.append(asked_of(flat, blocked, 0))
    beyond = start.copy()
    beyond[names.index("arm0/hand_joint")] = 10.0
    questions.append(asked_of(crowd, beyond, 0))
    one, two, none, wrong, outside = in_node(planner_data(crowd), "inTurn", [], questions)
    arms = list(crowd.arms)
    assert [arms[arm] for arm, _ in one["parts"]] == ["flat1", "flat0"]
    assert [arms[arm] for arm, _ in two["parts"]] == ["arm0", "arm6", "arm9"]
    for scene, answer, end in ((flat, one, goal), (crowd, two, several)):
        assert answer["certified"]
        motion = joined(scene, answer["motion"])
        assert rp.validate(motion, scene).certified
        assert np.abs(motion(motion.end_time) - end).max() < 1e-9
    assert (none["status"], none["parts"], none["certified"]) == ("found", [], True)
    assert wrong["status"] == "invalid_goal"
    assert wrong["reason"].startswith("the goal is in collision: flat0/")
    assert outside["reason"] == "the goal is out of limits: arm0/hand_joint"


def test_many_arms_are_judged_as_by_the_collision_checker(crowd: rp.Scene) -> None:
    rng, whole = np.random.default_rng(2), CollisionChecker(crowd)
    rows = crowd.configuration() + rng.normal(size=(8, whole.nq)) * np.linspace(0.0, 0.5, 8)[:, None]
    found = in_node(planner_data(crowd), "amongOthers", rows.tolist())
    free = 0
    for q, (contacts, clearances) in zip(rows, found, strict=True):
        expected = {frozenset((contact.a, contact.b)) for contact in whole.contacts(q)}
        assert {frozenset(pair) for pair in contacts} == expected
        free += not expected
        posed = crowd
        for arm, own in crowd.split(q, tuple(crowd.arms)).items():
            posed = posed.with_configuration(arm, own)
        for arm in rng.permutation(list(crowd.arms))[:3].tolist():
            clearance = clearances[list(crowd.arms).index(arm)]
            checker = CollisionChecker(posed, [arm])
            want = checker.moving_clearance(posed.arms[arm].q)
            assert clearance == pytest.approx(min(want, 0.1), abs=1e-9) or min(want, clearance) == -math.inf
    assert 1 <= free <= 7


def test_the_referee_of_the_page_finds_faults() -> None:
    problem = rp.load_problems("rr1_shelf")["lower_level"]
    goal = rp.plan_motion(problem, rng=0).path.waypoints[-1]
    found = in_node(planner_data(problem.scene), "faults", problem.start.tolist(), goal.tolist())
    assert found == {
        "none": "",
        "numbers": "the numbers make no motion",
        "fast": found["fast"],
        "start": found["start"],
    }
    assert found["fast"]
    assert found["start"] in ("a joint jumps", "the motion does not begin at the start")


def test_wrong_questions_are_named() -> None:
    messages = in_node(planner_data(rp.load_scene("planar2r_path")), "errors")
    obstacles = ", ".join(rp.load_scene("planar2r_path").obstacles)
    first = next(iter(rp.load_scene("planar2r_path").obstacles))
    assert messages == {
        "short": "q is [0], expected 2 finite numbers",
        "finite": "q is [NaN,NaN], expected 2 finite numbers",
        "obstacle": f"no obstacle nothing can be moved, only {obstacles}",
        "pose": "a pose has 16 numbers, got 12",
        "nan": f"the pose of {first} is not finite",
        "frame": "no frame nothing, only arm/tool",
        "target": "a target has 3 or 16 numbers",
        "margin": "margin is 1, expected 0 to 0.002 m",
    }


def test_an_image_of_another_build_is_refused() -> None:
    data = planner_data(rp.load_scene("planar2r_path"))
    image = zlib.decompress(base64.b64decode(data["image"]))
    digest = json.loads(image[: image.index(b"\n")])["digest"].encode()
    other = base64.b64encode(zlib.compress(image.replace(digest, digest[::-1]))).decode()
    answer = in_node({**data, "image": other}, "errors")
    assert answer == {"rejected": "the memory image was made for another core.wasm"}


@pytest.mark.parametrize(
    ("before", "reason"),
    [
        ("WebAssembly.validate = () => false;", "this browser has no WebAssembly SIMD"),
        ("globalThis.WebAssembly = undefined;", "this browser has no WebAssembly"),
        ("globalThis.DecompressionStream = undefined;", "this browser cannot decompress the planner"),
    ],
)
def test_a_browser_that_cannot_run_the_kernels_is_told_so(before: str, reason: str) -> None:
    data = planner_data(rp.load_scene("planar2r_path"))
    assert in_node(data, "errors", before=before) == {"rejected": reason}


@pytest.mark.browser
def test_without_simd_a_page_plays_as_ever(browser: Any, tmp_path: Path) -> None:
    tab = Tab(browser.new_page())
    tab.page.add_init_script("WebAssembly.validate = () => false;")
    problem = rp.load_problems("planar2r_path")["over_the_seam"]
    tab.open(rp.plan_motion(problem, rng=0).save_html(tmp_path / "motion.html"), plays=True)
    tab.page.wait_for_function("() => RR1.noPlanner")
    assert tab.ask("[RR1.planner, RR1.noPlanner]") == [None, "this browser has no WebAssembly SIMD"]
    assert tab.ask("RR1.playing && RR1.duration > 0")
    assert not tab.complaints


# ---- sequences -----------------------------------------------------------------------------------


def test_pages_of_sequences_plan_with_what_is_held(picked: rp.SequencePlan) -> None:
    document, _ = page_parts(picked._motion, None, None)
    stages, planners = document["planner"]["stages"], document["planner"]["planners"]
    scenes = planning_scenes(picked._motion)
    assert len(stages) == len(scenes) == len(picked.stages)
    arm_joints = [name for name in picked.scene.joint_names() if not name.endswith("finger_joint")]
    seen: dict[int, rp.Scene] = {}
    for stage, row, scene in zip(picked.stages, stages, scenes, strict=True):
        data = planners[row["planner"]]
        if stage.label.startswith("gripper"):
            assert data == {"missing": "the gripper moves at this time"}
            assert scene is None
            continue
        assert scene is not None
        assert data["joints"] == [document["columns"][c] for c in data["columns"]] == arm_joints
        assert ("block" in data["obstacles"]) == (row["held"] == []) == ("block" in scene.obstacles)
        seen[row["planner"]] = scene
    holding = [number for number, scene in seen.items() if scene.attachments]
    assert len(seen) > len(holding) >= 1
    rng, found, expected = np.random.default_rng(6), [], []
    for number in (holding[0], next(iter(seen.keys() - holding))):
        scene, ends = seen[number], configurations(seen[number], 48, rng).reshape(24, 2, -1)
        problems = [rp.Problem(scene, start, scene.split(goal, ("rr1",))) for start, goal in ends]
        expected.append([expected_motion(problem, seed) for seed, problem in enumerate(problems)])
        questions = {"moves": [], "questions": ends.tolist()}
        found += in_node(planners[number], "motions", [questions], SEARCH)
    check(found, expected)


@pytest.fixture(scope="module")
def picked() -> rp.SequencePlan:
    """A block that a gripper picks up behind a wall and puts down."""
    scene = rp.Scene().with_arm("rr1", rp.load_robot("rr1"))
    scene = scene.with_obstacle("table", rp.Box((0.9, 0.9, 0.04)), [-0.2, 0.0, -0.02]).allow("rr1/base_link", "table")
    scene = scene.with_obstacle("wall", rp.Box((0.16, 0.02, 0.22)), [-0.32, 0.02, 0.11])
    scene = scene.with_obstacle("block", rp.Box((0.04, 0.04, 0.06)), [-0.28, 0.15, 0.03], mass=0.15)
    plan = rp.plan_sequence(rp.Sequence(scene, rp.pick_and_place(scene, "block", [-0.28, -0.15, 0.03])), rng=0)
    assert plan.valid
    return plan


# ---- what pages carry ------------------------------------------------------------------------------


def document_and_policy(scene: rp.Scene, **given: Any) -> tuple[dict[str, Any], str]:
    options = rp.ViewOptions(**given)
    document = view_document(scene, options=options)
    text = html.unescape(page_html(document, options))
    return document, text[text.index("script-src") :].partition(";")[0]


def test_only_pages_with_a_planner_may_compile_webassembly(planar2r: rp.Robot) -> None:
    scene = rp.load_scene("planar2r_path")
    document, policy = document_and_policy(scene)
    assert document["planner"]["joints"] == list(scene.joint_names())
    assert "'wasm-unsafe-eval'" in policy
    document, policy = document_and_policy(scene, planner=False)
    assert document["planner"] is None
    assert "wasm" not in policy


def test_a_page_names_why_it_cannot_plan(planar2r: rp.Robot) -> None:
    many = rp.Scene()
    for i in range(13):
        many = many.with_arm(f"arm{i}", planar2r, [5.0 * i, 0.0, 0.0])
    document, policy = document_and_policy(many.allow("arm3/link2", "arm4"))
    assert document["planner"] == {"missing": "more than 12 arms move, and a rule of contact concerns two of them"}
    assert "wasm" not in policy
    assert page_planner(many, ["arm0"])["joints"] == list(many.joint_names(["arm0"]))
    assert page_planner(rp.Scene()) == page_planner(many, []) == {"missing": "no arm moves"}
    stuck = many.with_arm("last", planar2r, [0.0, 0.1, 0.0])
    assert "are in contact, and neither moves" in page_planner(stuck, ["arm1"])["missing"]


def test_what_would_take_long_or_much_room_is_left_out(planar2r: rp.Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pages, "_MOST_BYTES", 100)
    assert page_planner(rp.Scene().with_arm("arm", planar2r))["missing"].startswith("the tables of the scene have 0.0")

    # Obstacles with too many triangles are not even examined.
    monkeypatch.setattr(pages, "_MOST_TRIANGLES", 3)
    mesh = rp.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    scene = rp.Scene().with_arm("arm", planar2r).with_obstacle("rock", mesh, [0.0, 0.0, 5.0])
    assert page_planner(scene) == {"missing": "the obstacles have 4 triangles"}

    def too_slow(scene: rp.Scene, progress: Any) -> None:
        raise CancelledError("too slow")

    monkeypatch.setattr(pages, "cut_meshes", too_slow)
    scene = rp.Scene().with_arm("arm", planar2r)
    assert page_planner(scene) == {"missing": "convex decomposition of the moving meshes takes longer than 1 s"}
    # Not permanently: the pieces are known after the first planned motion.
    monkeypatch.undo()
    assert "missing" not in page_planner(scene)


def test_without_modules_pages_name_that(planar2r: rp.Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    def not_built() -> dict[str, str]:
        raise InstallationError("no core.wasm")

    monkeypatch.setattr(pages, "page_modules", not_built)
    assert page_planner(rp.Scene().with_arm("arm", planar2r)) == {"missing": "no core.wasm"}


def test_both_modules_are_small() -> None:
    sizes = [len(zlib.decompress(base64.b64decode(text))) for text in page_modules().values()]
    assert max(sizes) < 400_000
    assert sum(sizes) < 450_000
