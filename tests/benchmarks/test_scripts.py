"""Every benchmark runs on two problems and writes its results."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

import rr1plan as rp
from rr1plan.scene.model_library import robot_folder


@pytest.fixture
def problem_file(tmp_path):
    """Two problems for RR1 in the format of the problem sets: a box and a can on a table."""
    robot = rp.load_robot("rr1")
    starts, goals = (
        [[-0.6, 0.1, 0.2, 0.0, 0.5, 0.0], [0.4, 0.0, 0.3, 0.2, 0.6, 0.1]],
        [[0.6, 0.1, 0.2, 0.0, 0.5, 0.0]] * 2,
    )
    common = {
        "other": {},
        "boxes": [["table", [1.0, 1.0, 0.02], [-0.3, 0.0, -0.05], [0, 0, 0, 1]]],
        "cylinders": [["can", 0.04, 0.2, [-0.33, 0.0, 0.3], [0, 0, 0, 1]]],
        "spheres": [["ball", 0.03, [-0.3, 0.4, 0.1]]],
    }
    entries = [{"i": i, "start": s, "goals": [g], **common} for i, (s, g) in enumerate(zip(starts, goals, strict=True))]
    file = tmp_path / "problems.json"
    file.write_text(json.dumps({"robot": "rr1", "joints": list(robot.joint_names), "problems": {"can": entries}}))
    return file


def test_problems_of_a_file_are_solved_and_judged(script, problem_file, tmp_path):
    folder = robot_folder("rr1")
    arguments = [problem_file, "--robot", folder / "rr1.urdf", "--srdf", folder / "rr1.srdf", "--out", tmp_path]
    assert script("panda_problems").main([*map(str, arguments), "--seeds", "2"]) == 0
    results = json.loads((tmp_path / "panda_problems.json").read_text())
    assert [p["status"] for p in results["problems"]] == ["found"] * 4
    for answer, again in zip(results["problems"][::2], results["problems"][1::2], strict=True):
        assert again["name"] == f"{answer['name']}, again 1"
        assert answer["certified"]
        assert again["certified"]
        assert set(answer["opinions"]) == {"raw", "path", "timed"}
        assert again["opinions"] == {}
        assert "set up" in answer["cpu"]
        assert "set up" not in again["cpu"]
        assert all(o["samples"] > 100 for o in answer["opinions"].values())
    (run,) = results["runs"]
    assert run["touching"] == {"raw": [0, 2], "path": [0, 2], "timed": [0, 2]}
    assert all(set(t) == {"Coal", "FCL"} for answer in run["answers"] for t in answer["touches"].values())
    assert results["machine"]["processor"]
    assert "| validate" in (tmp_path / "panda_problems.md").read_text()
    assert (tmp_path / "panda_problems.png").stat().st_size > 0


def test_simulated_arms_are_measured(script, tmp_path):
    arguments = ["--arms", "1", "2", "--spacings", "3", "--threads", "1", "--seconds", "0.1"]
    assert script("simulated_arms_speed").main([*arguments, "--out", str(tmp_path)]) == 0
    results = json.loads((tmp_path / "simulated_arms_speed.json").read_text())["results"]
    assert [(r["arms"], r["models"], r["contacts"]) for r in results] == [(1, 1, 0), (2, 1, 0)]
    assert all(r["tracking_error_rad"] < 1e-3 for r in results)


def test_calibrations_are_measured(script, tmp_path):
    assert script("calibration").main(["--count", "1", "--out", str(tmp_path)]) == 0
    results = json.loads((tmp_path / "calibration.json").read_text())["results"]
    assert [r["outliers"] for r in results] == [0, 0, 2]
    assert all(r["signs"] and r["named"] and r["significance"] > 4.0 for r in results)
    assert max(abs(zero) for r in results for zero in r["zeros"]) < 1.0


def test_a_falling_tower_is_measured(script, tmp_path):
    arguments = ["--boats", "6", "--seconds", "2", "--out", str(tmp_path)]
    assert script("falling_tower_speed").main(arguments) == 0
    results = json.loads((tmp_path / "falling_tower_speed.json").read_text())["results"]
    assert [r["solver"] for r in results] == ["newton", "cg"]
    (windows,) = zip(*(r["windows"] for r in results), strict=True)
    assert all(0.0 <= w["penetration_at_end_mm"] <= w["penetration_mm"] < 100.0 and w["contacts"] for w in windows)
    assert all(w["lowest_point_mm"] > -10.0 for w in windows)


def test_peers_answer_the_same_problems_or_tell_why_not(script, tmp_path, monkeypatch):
    peers = script("peers")
    straight = tmp_path / "straight_worker.py"
    straight.write_text(
        f"""
import sys
sys.path.insert(0, {str(Path(peers.__file__).parent)!r})
from worker import serve

def solve(robot, problem, answer):
    line = [problem["start"], problem["goal"]]
    for stage, kind in (("set up", ""), ("plan", "raw"), ("shorten", "path"), ("retime", "timed")):
        with answer.stage(stage):
            pass
        if kind:
            answer.keep(kind, line)
    answer.data |= {{"duration": 1.0, "step": 0.002}}

serve(lambda robot, task: robot, solve)
"""
    )
    pair = (peers.Peer("straight", "straight", (), str(straight)), peers.Peer("absent", "absent", (), "none.py"))
    monkeypatch.setattr(peers, "PEERS", pair)
    monkeypatch.setattr(script("panda_problems"), "_REFERENCE", "straight")
    arguments = ["--scene", "rr1_table", "--every", "3", "--seeds", "1", "--python", f"straight={sys.executable}"]
    assert script("panda_problems").main([*arguments, "--out", str(tmp_path)]) == 0
    text = (tmp_path / "panda_problems.md").read_text()
    assert "**absent did not run**: no folder for its environment." in text
    assert "times faster than straight" in text
    ours, straight, absent = json.loads((tmp_path / "panda_problems.json").read_text())["runs"]
    assert [run["solved"] for run in (ours, straight, absent)] == [2, 2, 0]
    assert [a["name"] for a in ours["answers"]] == [a["name"] for a in straight["answers"]]
    assert ours["touching"]["timed"] == [0, 2]
    # Which configuration reaches a goal is the inverse kinematics' to choose; that lines touch is not.
    assert straight["touching"]["raw"] == straight["touching"]["timed"]
    assert straight["touching"]["raw"][0] > 0


@pytest.mark.parametrize("arguments", [[], ["--scene", "rr1_pair"], ["a.json"], ["a.json", "--scene", "rr1_table"]])
def test_problems_that_cannot_be_read_end_with_the_usage(script, arguments, capsys):
    with pytest.raises(SystemExit, match="2"):
        script("panda_problems").main(arguments)
    assert "error:" in capsys.readouterr().err


def test_random_queries_are_drawn_answered_and_replayed(script, tmp_path):
    arguments = ["--count", "2", "--scenes", "rr1_table", "--nodes", "40", "--out", str(tmp_path)]
    assert script("rr1_queries").main(arguments) == 0
    results = json.loads((tmp_path / "rr1_queries.json").read_text())["queries"]
    assert [q["limits"] for q in results] == ["sim", "hardware"]
    assert all(q["certified"] and q["contacts"] == [] and q["faults"] == [] for q in results)
    assert all(0.0 < q["tracking_error"] < 0.005 for q in results)


def test_queries_of_two_arms_move_both(script, tmp_path):
    assert script("two_arms").main(["--count", "2", "--nodes", "40", "--out", str(tmp_path)]) == 0
    results = json.loads((tmp_path / "two_arms.json").read_text())["queries"]
    assert all(q["certified"] and q["faults"] == [] for q in results)


def test_planners_are_timed_to_their_first_path(script, tmp_path):
    arguments = ["--planners", "rrt_connect", "rrt_star", "--scenes", "planar2r_path", "--seconds", "0.3"]
    assert script("planners").main([*arguments, "--every", "2", "--out", str(tmp_path)]) == 0
    runs = json.loads((tmp_path / "planners.json").read_text())["runs"]
    assert {r["planner"] for r in runs} == {"rrt_connect", "rrt_star"}
    assert all(r["solved"] and 0.0 < r["first"] <= 1.0 for r in runs if r["planner"] == "rrt_connect")


def test_paths_get_shorter_while_planners_have_time(script, tmp_path):
    arguments = ["--scenes", "planar2r_path", "--every", "2", "--milliseconds", "10", "40", "--out", str(tmp_path)]
    assert script("path_lengths").main([*arguments, "--planners", "anytime", "bit_star"]) == 0
    results = json.loads((tmp_path / "path_lengths.json").read_text())
    assert set(results["race"]) == {"rrt_connect + shorten", "anytime", "bit_star"}
    early, late = results["race"]["anytime"]
    assert late["solved"] == 1.0
    assert 1.0 <= late["median"] <= early["median"]
    assert "40 ms: solved" in (tmp_path / "path_lengths.md").read_text()
    assert (tmp_path / "path_lengths.png").stat().st_size > 0


def test_cells_of_the_picture_are_those_of_coal(script, tmp_path):
    assert script("cspace_against_coal").main(["--resolution", "24", "--out", str(tmp_path)]) == 0
    scenes = json.loads((tmp_path / "cspace_against_coal.json").read_text())["scenes"]
    assert [(s["cells"], s["wrong"]) for s in scenes] == [(576, 0)] * 2


def test_concave_obstacles_are_timed_as_triangles_and_as_pieces(script, tmp_path):
    arguments = ["--triangles", "200", "--edges", "20", "--samples", "60", "--seconds", "0", "--out", str(tmp_path)]
    assert script("triangle_meshes").main(arguments) == 0
    none, mug, terrain = json.loads((tmp_path / "triangle_meshes.json").read_text())["meshes"]
    assert (none["triangles"], mug["triangles"], terrain["triangles"]) == (0, 2592, 200)
    for result in (mug, terrain):
        assert result["warm_up"] > 0.0
        assert result["edge"] > 0.0
        assert result["different"] == 0
    assert 0 < terrain["contacts"] < 60
    assert "| terrain of 200" in (tmp_path / "triangle_meshes.md").read_text()


def test_inverse_kinematics_is_timed_beside_the_plain_method(script, tmp_path):
    arguments = ["--robot", "planar2r_limited", "--poses", "6", "--plain", "3", "--out", str(tmp_path)]
    assert script("ik_comparison").main(arguments) == 0
    robots = json.loads((tmp_path / "ik_comparison.json").read_text())["robots"]
    assert [r["robot"] for r in robots] == ["rr1", "planar2r_limited"]
    for robot in robots:
        assert robot["wrong"] == 0
        assert [len(robot[method]["counts"]) for method in ("ours", "plain", "goals")] == [6, 3, 6]
        assert all(min(robot[method]["counts"]) > 0 for method in ("ours", "plain", "goals"))
    assert "one solution: solved" in (tmp_path / "ik_comparison.md").read_text()


def test_the_same_seed_draws_the_same_feasible_queries(script):
    queries = script("queries")
    first, second = (queries.draw_queries(["rr1_bin"], 4, 3, 40) for _ in range(2))
    for a, b in zip(first, second, strict=True):
        assert a.name == b.name
        assert (a.problem.start == b.problem.start).all()
        assert rp.CollisionChecker(a.problem.scene).is_free(a.problem.start)


def test_fresh_processes_are_timed(script, tmp_path):
    assert script("cold_start").main(["--count", "1", "--warm-up", "0", "--out", str(tmp_path)]) == 0
    results = json.loads((tmp_path / "cold_start.json").read_text())
    assert all(run["cpu"] > 0.0 for runs in results["processes"].values() for run in runs)
    assert set(results["stages"][0]) >= {"import rr1plan", "first plan"}
    assert "| first plan, from Python" in (tmp_path / "cold_start.md").read_text()


def test_many_arms_are_measured_in_processes_of_their_own(script, tmp_path):
    arguments = ["--arms", "4", "2", "--out", str(tmp_path)]
    assert script("many_instances").main([*arguments, "--columns", "plan", "referee", "edge"]) == 0
    results = json.loads((tmp_path / "many_instances.json").read_text())
    by_column = {}
    for result in results["results"]:
        assert result["found"]
        assert result["seconds"] > 0.0
        assert result["memory"] > 10.0
        by_column.setdefault(result["column"], []).append((result["arms"], result.get("warm", result.get("layout"))))
    assert by_column == {
        "plan": [(2, True), (2, False), (4, True), (4, False)],
        "referee": [(2, None), (4, None)],
        "edge": [(2, "grid"), (2, "row"), (4, "grid"), (4, "row")],
    }
    # Four arms on a grid, each within reach of all others.
    near = {(r["arms"], r["layout"]): r["near"] for r in results["results"] if r["column"] == "edge"}
    assert near[2, "grid"] == near[2, "row"] == 1
    assert near[4, "row"] < near[4, "grid"] == 6
    assert results["fit"]["arm"] >= 0.0
    text = (tmp_path / "many_instances.md").read_text()
    assert "| plan " in text
    assert "| validate " not in text
    assert (tmp_path / "many_instances.png").stat().st_size > 0


def test_changes_of_scenes_are_timed(script, problem_file, tmp_path):
    arguments = [problem_file, "--robot", robot_folder("rr1") / "rr1.urdf", "--rounds", "3", "--out", tmp_path]
    assert script("scene_changes").main([*map(str, arguments)]) == 0
    results = json.loads((tmp_path / "scene_changes.json").read_text())["results"]
    assert {"moved", "boxes", "boxes, with a margin", "set up", "plan"} <= set(results)
    assert all(result["median"] > 0.0 for result in results.values())
    assert results["moved"]["n"] == results["boxes"]["n"] == 3
    assert "| set up" in (tmp_path / "scene_changes.md").read_text()


def test_problems_without_a_solution_are_refused_for_the_expected_reason(script, tmp_path):
    assert script("no_solution").main(["--arms", "2", "4", "--seeds", "2", "--out", str(tmp_path)]) == 0
    results = json.loads((tmp_path / "no_solution.json").read_text())["results"]
    assert len(results) == 10
    assert all(result["n"] == 2 and result["median"] > 0.0 for result in results.values())
    assert "| goals " in (tmp_path / "no_solution.md").read_text()


def test_delays_and_conveyors_are_measured_without_contacts(script, tmp_path):
    arguments = ["--sets", "ring", "--executions", "6", "--seeds", "1", "--conveyors", "4", "--goals", "6"]
    assert script("delays").main([*arguments, "--limit", "5", "--out", str(tmp_path)]) == 0
    results = json.loads((tmp_path / "delays.json").read_text())
    assert [(r["set"], r["arms"]) for r in results["executions"]] == [("ring", 3), ("ring", 4), ("ring", 8)]
    assert all(r["rejected"] == r["contacts"] == 0 for r in results["executions"])
    (belt,) = results["conveyors"]
    assert belt["certified"]
    assert belt["contacts"] == 0
    assert sum(belt["stages"].values()) == belt["goals"] == 6


def test_motions_of_many_arms_are_counted_by_what_the_referee_certifies(script, tmp_path):
    arguments = ["--sets", "grid", "shelf", "--arms", "2", "3", "--spacings", "0.7", "--seeds", "1", "--step", "0.1"]
    assert script("many_arms").main([*arguments, "--out", str(tmp_path)]) == 0
    results = json.loads((tmp_path / "many_arms.json").read_text())
    assert [(r["set"], r["arms"]) for r in results["results"]] == [("grid", 2), ("grid", 3), ("shelf", 2)]
    for cell in results["cells"]:
        assert cell["solved"] == cell["problems"] == 1
        assert cell["ratio"] >= 1.0 - 1e-9
        assert cell["contacts"] == 0
    assert all(r["looks"] > 3 for r in results["results"])
    assert "All solved." in (tmp_path / "many_arms.md").read_text()


def test_what_takes_too_long_with_many_arms_is_told(script, tmp_path):
    arguments = ["--arms", "2", "--columns", "motion", "--limit", "0.01", "--out", str(tmp_path)]
    assert script("many_instances").main(arguments) == 0
    assert "> 0.01 s" in (tmp_path / "many_instances.md").read_text()
    assert (tmp_path / "many_instances.png").stat().st_size > 0


@pytest.mark.browser
def test_planning_in_a_page_is_measured(script, tmp_path):
    arguments = ["--drags", "6", "--drops", "2", "--warm-up", "1", "--scene", "planar2r_path", "--out", str(tmp_path)]
    assert script("page_planning").main(arguments) == 0
    found = json.loads((tmp_path / "page_planning.json").read_text())
    results = found["results"]
    assert len(results) == 6
    assert found["drops"]
    assert all(0.0 < drop["began"] < drop["plays"] < drop["drawn"] for drop in found["drops"])
    assert all(r["equal"] for r in results)
    assert any(r["page"]["certified"] for r in results)
