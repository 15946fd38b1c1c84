"""From a problem to a proven motion: behavior of the pipeline beyond that of its stages."""

from __future__ import annotations

import json
import math
import pickle
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import rr1plan as rp
from rr1plan import pipeline
from rr1plan.collision import checker as checkers
from rr1plan.multi import agents
from rr1plan.planners.margin_search import halved_margin
from rr1plan.transforms import pose
from rr1plan.validation import referee_scene as referee_scenes
from rr1plan.validation.compiled_search import TOUCH


@pytest.fixture(scope="module")
def problem() -> rp.Problem:
    return next(iter(rp.load_problems("rr1_table").values()))


def test_a_motion_is_certified_and_every_stage_has_its_time(problem: rp.Problem) -> None:
    found = rp.plan_motion(problem, rng=0)
    assert found.found
    assert found.valid
    assert found.report.certified
    # The first query of a process includes imports.
    assert [name for name in found.seconds if name != "imports"] == ["set up", "plan", "shorten", "retime", "validate"]
    assert all(seconds > 0.0 for seconds in found.seconds.values())
    np.testing.assert_array_equal(found.trajectory(0.0), problem.start)


@pytest.mark.parametrize("planner", ["rrt_connect", "many_arms"])
def test_flags_are_checked_for_each_planner(problem: rp.Problem, planner: str) -> None:
    for flag in ("shorten", "torque_limits"):
        with pytest.raises(rp.InputError, match=f"{flag} is 1, expected True or False"):
            rp.plan_motion(problem, planner=planner, **{flag: 1})


def test_a_status_is_the_text_of_its_value_in_comparisons_prints_and_json(problem: rp.Problem) -> None:
    motion = rp.plan_motion(problem, rng=1)

    assert motion.status == "found"
    assert f"{motion.status}" == "found"
    assert json.loads(json.dumps({"status": motion.status})) == {"status": "found"}
    assert rp.PlanStatus("timeout") is rp.PlanStatus.TIMEOUT


def test_smallest_clearances_are_found_when_the_report_is_read(
    problem: rp.Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []
    judge = pipeline.validate

    def validate(*args: object, clearance: bool = True, **options: bool) -> rp.Report:
        asked.append(clearance)
        return judge(*args, clearance=clearance, **options)

    monkeypatch.setattr(pipeline, "validate", validate)
    found = rp.plan_motion(problem, rng=0)
    assert found.valid
    assert found
    assert "certified" in repr(found)
    assert asked == [False]
    expected = rp.validate(found.trajectory, problem.scene, problem)
    assert {"clearance", "clearance_proven", "self_clearance", "clearance_start"} <= set(found.report.margins)
    assert found.report.margins == expected.margins
    assert found.report.checked == expected.checked
    assert found.report.not_checked == expected.not_checked
    assert str(found.report) in str(found)
    assert asked == [False, True]
    whole = rp.plan_motion(problem, rng=0).with_clearances()
    assert asked == [False, True, False, True]
    assert whole.report.margins == expected.margins
    assert asked == [False, True, False, True]


def test_a_motion_that_was_pickled_finds_the_same_clearances(problem: rp.Problem) -> None:
    found = rp.plan_motion(problem, rng=0)
    copied = pickle.loads(pickle.dumps(found))
    assert copied.valid
    assert copied.report.margins == found.report.margins
    assert pickle.loads(pickle.dumps(found)).report.margins == found.report.margins
    assert len(pickle.dumps(rp.plan_motion(problem, rng=0))) < len(pickle.dumps(found))


def test_a_scene_is_set_up_once(problem: rp.Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = rp.Scene(arms=problem.scene.arms, obstacles=problem.scene.obstacles)
    fresh = rp.Problem(scene, problem.start, dict(problem.goal))
    rp.warm_up(fresh)
    made = []
    monkeypatch.setattr(checkers, "build_edge_tables", lambda *_: made.append(None))
    assert rp.plan(fresh, rng=0).found
    assert made == []
    with pytest.raises(rp.InputError, match="problem is of type Scene"):
        rp.warm_up(scene)


def test_all_that_many_arms_and_the_referee_read_is_set_up_in_advance(
    rr1: rp.Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = rp.random_grid(rr1, 3, 0.6, rng=0)
    rp.warm_up(problem)
    made: list[str] = []
    bodies, referee = agents.AgentBodies.__init__, referee_scenes.RefereeScene.__init__

    def init_bodies(own: agents.AgentBodies, scene: rp.Scene, arms: tuple[str, ...]) -> None:
        if len(arms) == 1:
            made.extend(arms)
        bodies(own, scene, arms)

    def init_referee(own: referee_scenes.RefereeScene, scene: rp.Scene) -> None:
        made.append("referee")
        referee(own, scene)

    monkeypatch.setattr(agents.AgentBodies, "__init__", init_bodies)
    monkeypatch.setattr(referee_scenes.RefereeScene, "__init__", init_referee)
    assert rp.plan_motion(problem, rng=0).valid
    assert made == []


@pytest.mark.parametrize("retiming", rp.retiming_names())
def test_every_retiming_can_end_the_line_and_is_held_to_what_it_claims(problem: rp.Problem, retiming: str) -> None:
    report = rp.plan_motion(problem, retiming=retiming, rng=0).report
    assert report.certified
    assert ("jerk" in report.checked) is retiming.startswith("ruckig")


def test_the_same_question_with_a_margin_differs_in_the_margin_alone(problem: rp.Problem) -> None:
    roomy = problem.with_margin(0.01)
    assert roomy.margin == 0.01
    assert problem.margin == 0.0
    assert roomy.scene is problem.scene
    assert roomy.arms == problem.arms
    assert roomy.goal == problem.goal
    np.testing.assert_array_equal(roomy.start, problem.start)
    assert roomy.with_margin(0.02).margin == 0.02
    for wrong in (-0.01, np.nan, np.inf, "wide"):
        with pytest.raises(rp.InputError, match="margin"):
            problem.with_margin(wrong)


@pytest.mark.parametrize("planner", [name for name in rp.planner_names() if name != "cartesian"])
def test_every_planner_keeps_the_margin_of_a_question(planner: str) -> None:
    scene = rp.Scene().with_arm("arm", rp.load_robot("planar2r"))
    scene = scene.with_obstacle("post", rp.Sphere(0.05), [0.55, 0.0, 0.0]).with_padding(0.01)
    problem = rp.Problem(scene, [0.7, 0.9], [-0.7, -0.9]).with_margin(0.1)
    # Optimizing planners use the whole budget.
    path = rp.plan(problem, planner=planner, budget=rp.Budget(np.inf, iterations=2000), rng=0).path
    assert path is not None
    wide = rp.CollisionChecker(scene.with_margin(0.1))
    assert all(wide.edge_is_free(a, b) for a, b in pairwise(path.waypoints))
    # With a larger margin there is no such path.
    refused = rp.plan(problem.with_margin(0.5), planner=planner, budget=rp.Budget(seconds=0.3), rng=0)
    assert refused.status is rp.PlanStatus.INVALID_START


def test_a_page_plans_with_the_margin_of_its_motion(problem: rp.Problem, tmp_path: Path) -> None:
    motion = rp.plan_motion(problem, margin=0.005, rng=0)
    assert motion.problem.margin == 0.005
    saved = rp.load_motion(motion.save(tmp_path / "motion.json"))
    for each in (motion, saved):
        assert each.page_content()[0]["planner"]["margin"] == 0.005
    assert rp.plan_motion(problem, rng=0).problem is problem


def test_a_motion_keeps_the_margin_of_its_problem_unless_another_is_given(problem: rp.Problem) -> None:
    roomy = problem.with_margin(0.0005)
    assert rp.plan_motion(roomy, rng=0).margin == 0.0005
    assert rp.plan_motion(roomy, rng=0, margin=0.0).margin == 0.0
    assert rp.plan_motion(problem, rng=0).margin == 0.002


def test_a_margin_is_halved_until_the_start_has_twice_as_much() -> None:
    scene = rp.load_scene("rr1_table")
    problem = rp.Problem(scene, None, "home")
    clearance = rp.CollisionChecker(scene).clearance(problem.start, 1.0)
    margin = halved_margin(problem, clearance)
    assert margin == pytest.approx(0.5 * clearance)
    assert halved_margin(problem, 0.0) == 0.0
    with pytest.raises(rp.InputError, match="margin"):
        halved_margin(problem, -0.1)


@pytest.mark.parametrize("margin", [0.02, 1.0, 1e6])
def test_a_margin_far_too_large_keeps_more_than_half_of_what_fits(margin: float) -> None:
    problem = rp.Problem(ball_before_a_gap(0.01), [-0.5, 0.3], [0.5, -0.3])
    motion = rp.plan_motion(problem, margin=margin, rng=0)
    assert motion.valid
    assert 0.00125 < motion.margin < 0.005
    assert motion.report.margins["clearance"].value >= motion.margin


def test_a_start_near_contact_leaves_a_margin_that_the_referee_can_tell_from_contact() -> None:
    scene = rp.Scene().with_arm("arm", rp.load_robot("planar2r")).with_obstacle("ball", rp.Sphere(0.1), [0.5, 1.0, 0.0])
    gap = rp.CollisionChecker(scene).clearance([0.0, 0.0])
    scene = scene.with_obstacle_at("ball", pose([0.5, 1.0 - gap + 5e-5, 0.0]))
    problem = rp.Problem(scene, [0.0, 0.0], [-1.0, 0.0])
    assert halved_margin(problem, 0.002) == pytest.approx(0.002 / 2**7)
    motion = rp.plan_motion(problem, rng=0)
    assert motion.report.certified
    assert motion.margin > 10.0 * TOUCH


def test_a_margin_is_one_that_the_goal_has_too() -> None:
    scene = rp.load_scene("rr1_table")
    robot, checker = scene.arm(scene.only_arm()).robot, rp.CollisionChecker(scene)
    rng, margin = np.random.default_rng(0), 0.002
    near = None
    while near is None or not 0.0005 < checker.clearance(near, 1.0) < 2.0 * margin:
        near = rng.uniform(robot.limits.lower, robot.limits.upper)
    clearance = checker.clearance(near, 1.0)
    one = rp.Problem(scene, "home", near)
    assert 0.25 * clearance < halved_margin(one, margin) <= 0.5 * clearance
    assert halved_margin(rp.Problem(scene, "home", [rp.JointGoal(near), rp.JointGoal("home")]), margin) == margin
    motion = rp.plan_motion(one, margin=margin, rng=0)
    assert motion.valid
    assert motion.margin == halved_margin(one, margin)


def test_a_margin_counts_what_the_arm_can_never_reach() -> None:
    scene = rp.Scene().with_arm("arm", rp.load_robot("planar2r"))
    straight = rp.Problem(scene, [0.0, 0.0], [2.0, 0.0])
    tip = float(scene.link_poses({"arm": np.zeros(2)})["arm/tool"][0, 3])
    problem = straight.in_scene(scene.with_obstacle("ball", rp.Sphere(0.1), [tip + 0.5, 0.0, 0.0]))
    clearance = rp.CollisionChecker(problem.scene).clearance(problem.start)
    assert 0.2 < clearance < 0.41
    assert halved_margin(problem, 0.8 * clearance) == pytest.approx(0.4 * clearance)
    assert halved_margin(problem, 1.5 * clearance) == pytest.approx(0.375 * clearance)
    assert rp.plan_motion(problem, margin=1.5 * clearance, rng=0).valid


def test_a_search_that_ran_out_of_budget_says_which_margin_it_kept() -> None:
    closed = next(iter(rp.load_problems("planar2r_no_path").values()))
    for margin, kept in ((None, "kept 2 mm beyond the padding"), (0.001, "kept 1 mm"), (0.0, None)):
        motion = rp.plan_motion(closed, rng=0, margin=margin, budget=rp.Budget(iterations=300))
        assert motion.status is rp.PlanStatus.TIMEOUT
        assert kept in motion.result.reason if kept else "beyond the padding" not in motion.result.reason


def ball_before_a_gap(gap: float) -> rp.Scene:
    """A sliding ball, and a wall with a gap [m] in addition to the ball's diameter: half of it on each side."""
    links = (rp.Link("base"), rp.Link("cart"), rp.Link("ball", collisions=(rp.Geometry("ball", rp.Sphere(0.05)),)))
    slide = {"lower": -1.0, "upper": 1.0}
    joints = (
        rp.Joint("x", "prismatic", "base", "cart", axis=np.array([1.0, 0.0, 0.0]), **slide),
        rp.Joint("y", "prismatic", "cart", "ball", axis=np.array([0.0, 1.0, 0.0]), **slide),
    )
    limits = rp.Limits(np.full(2, -1.0), np.full(2, 1.0), *(np.ones(2) for _ in range(4)))
    robot = rp.Robot("ball", links, joints, ("x", "y"), limits, {"home": np.zeros(2)}, {}, frozenset(), "ball")
    scene = rp.Scene().with_arm("arm", robot)
    for name, side in (("left", -1.0), ("right", 1.0)):
        scene = scene.with_obstacle(name, rp.Box((0.1, 2.0, 0.2)), [0.0, side * (1.05 + 0.5 * gap), 0.0])
    return scene


def test_a_passage_narrower_than_the_margin_is_found_with_a_smaller_one() -> None:
    scene = ball_before_a_gap(0.001)
    problem = rp.Problem(scene, [-0.5, 0.0], [0.5, 0.0])
    motion = rp.plan_motion(problem, rng=0, budget=rp.Budget(iterations=1000))
    assert motion.valid
    assert 0.0 < motion.margin < 0.0005
    assert motion.report.margins["clearance"].value >= motion.margin
    closed = problem.in_scene(scene.with_obstacle_at("left", [0.0, -1.04, 0.0]))
    motion = rp.plan_motion(closed, rng=0, budget=rp.Budget(iterations=1000))
    assert motion.status is rp.PlanStatus.TIMEOUT
    assert motion.result.reason.endswith(
        "kept 2 mm beyond the padding (option margin), and a brief one without found no path"
    )


def test_a_margin_that_blocks_is_halved_long_before_the_budget_ends() -> None:
    problem = rp.Problem(ball_before_a_gap(0.02), [-0.5, 0.3], [0.5, -0.3])
    searches: list[float] = []

    def progress(part: rp.Progress) -> None:
        searches.extend([part.fraction] if part.stage == "rrt_connect" else [])

    long = rp.Budget(math.inf, 10_000_000)
    motion = rp.plan_motion(problem, rng=0, margin=0.02, budget=long, progress=progress)
    assert searches == sorted(searches)
    assert searches[-1] < 0.1
    assert motion.margin == 0.005
    assert motion.report.margins["clearance"].value >= 0.005
    again = rp.plan_motion(problem, rng=0, margin=0.02, budget=rp.Budget(600.0))
    assert (again.path.waypoints == motion.path.waypoints).all()
    # A search that needs no smaller margin is not affected.
    kept = rp.plan_motion(problem, rng=0, margin=0.005, budget=long)
    assert kept.margin == 0.005


def test_a_margin_that_no_goal_configuration_has_is_halved() -> None:
    scene = rp.Scene().with_arm("arm", rp.load_robot("planar2r"))
    tip = scene.link_poses({"arm": np.zeros(2)})["arm/tool"][:3, 3]
    scene = scene.with_obstacle("ball", rp.Sphere(0.05), tip + np.array([0.0, 0.0, 0.15]))
    near = rp.PoseGoal("tool", tip, position_tolerance=1e-3)
    clear = rp.CollisionChecker(scene).clearance([0.0, 0.0])
    assert 0.01 < clear < 0.15
    for problem in (rp.Problem(scene, [2.0, 0.5], near), rp.Problem(scene, [2.0, 0.5], near).with_margin(0.2)):
        motion = rp.plan_motion(problem, margin=0.2, rng=0)
        assert motion.valid
        assert 0.2 * clear < motion.margin <= 0.51 * clear
        assert motion.report.margins["clearance"].value >= motion.margin


def test_setting_up_is_not_at_the_expense_of_the_budget(problem: rp.Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    """Setup may take longer than a budget: tables of a new scene, code that is not compiled yet."""
    make = rp.CollisionChecker.warm_up

    def slowly(checker: rp.CollisionChecker) -> None:
        time.sleep(0.8)
        make(checker)

    monkeypatch.setattr(rp.CollisionChecker, "warm_up", slowly)
    result = rp.plan(problem, budget=rp.Budget(seconds=0.7), rng=0)
    assert result.found
    assert result.seconds < 0.7


def test_the_first_question_of_a_process_counts_imports_among_its_stages() -> None:
    program = """
import time
import rr1plan as rp
began = time.perf_counter()
problem = rp.load_problems("planar2r_path")["to_a_point"]
first = rp.plan_motion(problem, rng=0)
wall = time.perf_counter() - began
rp.simulate
second = rp.plan_motion(problem, rng=0)
print(*first.seconds, sep=",")
print(*second.seconds, sep=",")
print(sum(first.seconds.values()) / wall)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    first, second, share = done.stdout.splitlines()
    assert first == "imports,set up,plan,shorten,retime,validate"
    assert second == "set up,plan,shorten,retime,validate"
    # The rest is reading the scene.
    assert 0.7 < float(share) <= 1.0


def test_all_stages_are_reported_and_can_be_cancelled() -> None:
    problem = rp.Problem(rp.load_scene("rr1_table"), "home", "zero")
    for last in ("set up", "shorten", "retime", "validate"):
        heard: list[str] = []

        def progress(progress: rp.planning.Progress, heard: list[str] = heard, last: str = last) -> bool:
            heard.append(progress.stage)
            return progress.stage != last

        motion = rp.plan_motion(problem, rng=0, progress=progress)
        assert motion.status is rp.PlanStatus.CANCELLED
        assert not motion.valid
        assert motion.result.reason == f"cancelled before stage {last!r}"
        assert heard[-1] == last
    motion = rp.plan_motion(problem, rng=0, progress=lambda progress: heard.append(progress.stage))
    assert motion.valid
    assert [stage for stage in heard if stage in ("shorten", "retime", "validate")][-3:] == [
        "shorten",
        "retime",
        "validate",
    ]
