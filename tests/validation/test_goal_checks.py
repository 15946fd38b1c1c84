"""Starts and goals of a problem: satisfied, missed, and by how much."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.validation import validate

Make = Callable[..., Any]
GOAL = np.array([0.4, 0.2])


def judged(quintic: Make, scene: rp.Scene, goal: Any, end: Any = GOAL, start: Any = (0.0, 0.0)) -> rp.Report:
    problem = rp.Problem(scene, start=[0.0, 0.0], goal=goal)
    return validate(quintic(scene.joint_names(), start, end, 3.0), scene, problem)


@pytest.fixture
def scene(planar2r: rp.Robot) -> rp.Scene:
    return rp.Scene().with_arm("arm", planar2r)


def tool_at(scene: rp.Scene, q: Any) -> np.ndarray:
    return scene.link_poses({"arm": np.asarray(q)})[f"arm/{scene.arms['arm'].robot.tool}"]


def test_a_joint_goal_is_met_to_a_nanoradian(quintic: Make, scene: rp.Scene) -> None:
    report = judged(quintic, scene, GOAL)
    assert report.valid, str(report)
    assert {"start", "goal"} <= set(report.checked)
    miss = judged(quintic, scene, GOAL + np.array([0.0, 1e-6])).violations
    assert [(v.kind, v.subject) for v in miss] == [("goal", ("arm",))]
    assert miss[0].value == pytest.approx(1e-6, rel=1e-3)
    assert miss[0].time == pytest.approx(3.0)
    assert "joint2" in miss[0].message


def test_a_start_elsewhere_names_the_joint(quintic: Make, scene: rp.Scene) -> None:
    missed = judged(quintic, scene, GOAL, start=(1e-6, 0.0)).violations
    assert [(v.kind, v.subject, v.time) for v in missed] == [("start", ("arm/joint1",), 0.0)]


def test_a_continuous_joint_may_end_whole_turns_away(quintic: Make, scene: rp.Scene) -> None:
    assert judged(quintic, scene, GOAL + np.array([0.0, 2.0 * np.pi])).valid
    assert judged(quintic, scene, GOAL - [4.0 * np.pi, 0.0]).valid


def test_a_limited_joint_may_not(quintic: Make) -> None:
    scene = rp.Scene().with_arm("arm", rp.load_robot("planar2r_limited"))
    assert scene.limits().lower[0] == -3.0
    missed = judged(quintic, scene, [2.9, 0.2], end=[2.9 - 2.0 * np.pi, 0.2]).violations
    assert {"goal", "position"} <= {v.kind for v in missed}


def test_any_of_several_goals_will_do_and_the_nearest_is_named(quintic: Make, scene: rp.Scene) -> None:
    assert judged(quintic, scene, [rp.JointGoal([1.0, 1.0]), rp.JointGoal(GOAL)]).valid
    miss = judged(quintic, scene, [rp.JointGoal([1.0, 1.0]), rp.JointGoal(GOAL + 0.01)]).violations
    assert miss[0].value == pytest.approx(0.01)
    assert "nearest of 2 goals" in miss[0].message


def test_a_pose_goal_is_met_within_its_tolerances(quintic: Make, scene: rp.Scene) -> None:
    T = tool_at(scene, GOAL)
    assert judged(quintic, scene, rp.PoseGoal("tool", T)).valid
    assert judged(quintic, scene, rp.PoseGoal("tool", T[:3, 3] + [0.0, 0.0, 0.9e-4])).valid
    off = judged(quintic, scene, rp.PoseGoal("tool", T[:3, 3] + [0.0, 0.0, 2e-4])).violations
    assert (off[0].kind, off[0].value, off[0].limit) == ("goal", pytest.approx(2e-4), 1e-4)
    turned = T @ rp.transforms.pose(rpy=[0.0, 0.0, 0.01])
    off = judged(quintic, scene, rp.PoseGoal("tool", turned)).violations
    assert off[0].value == pytest.approx(0.01)
    assert "turned by 0.01 rad" in off[0].message
    assert judged(quintic, scene, rp.PoseGoal("tool", turned, orientation_tolerance=0.011)).valid


def test_a_region_goal_is_met_inside_its_box(quintic: Make, scene: rp.Scene) -> None:
    at = tool_at(scene, GOAL)[:3, 3]
    assert judged(quintic, scene, rp.RegionGoal("tool", at - 0.01, at + 0.01)).valid
    assert judged(quintic, scene, rp.RegionGoal("tool", at, at)).valid
    off = judged(quintic, scene, rp.RegionGoal("tool", at + np.array([0.003, -1.0, -1.0]), at + 1.0)).violations
    assert off[0].value == pytest.approx(0.003)
    assert not judged(quintic, scene, rp.RegionGoal("tool", at - 1.0, at + 1.0, quaternion=[0, 1, 0, 0])).valid


def test_a_tiny_tolerance_hides_no_other_condition_and_no_other_goal(quintic: Make, scene: rp.Scene) -> None:
    T = tool_at(scene, GOAL)
    turned = T @ rp.transforms.pose(rpy=[0.0, 0.0, 0.005])
    turned[2, 3] += 9e-10  # within the rounding that is allowed beyond the tolerance of 1e-10 m
    off = judged(quintic, scene, rp.PoseGoal("tool", turned, position_tolerance=1e-10)).violations
    assert "turned by 0.005 rad" in off[0].message
    nearly, missed = T.copy(), T.copy()
    nearly[2, 3], missed[2, 3] = 5e-10, 2e-4
    met = rp.PoseGoal("tool", nearly, position_tolerance=1e-11)
    assert judged(quintic, scene, [met, rp.PoseGoal("tool", missed, position_tolerance=1e-4)]).valid


def test_the_base_of_the_arm_counts(quintic: Make, planar2r: rp.Robot) -> None:
    base = rp.transforms.pose([0.3, 0.1, 0.0], rpy=[0.0, 0.0, 1.0])
    here, there = rp.Scene().with_arm("arm", planar2r), rp.Scene().with_arm("arm", planar2r, base)
    goal = rp.PoseGoal("tool", base @ tool_at(here, GOAL))
    assert judged(quintic, there, goal).valid
    assert not judged(quintic, here, goal).valid


def test_each_moving_arm_has_its_goal_and_an_arm_without_one_comes_back(quintic: Make, planar2r: rp.Robot) -> None:
    scene = rp.Scene().with_arm("a", planar2r).with_arm("b", planar2r, [9.0, 0.0, 0.0])
    problem = rp.Problem(scene, start=None, goal={"a": GOAL}, arms=["a", "b"])
    home = planar2r.home
    good = quintic(scene.joint_names(), [*home, *home], [*GOAL, *home], 5.0)
    assert validate(good, scene, problem).valid
    bad = validate(quintic(scene.joint_names(), [*home, *home], [*GOAL, *(home + 0.1)], 5.0), scene, problem)
    assert [(v.kind, v.subject) for v in bad.violations] == [("goal", ("b",))]
    # An arm of the problem that the trajectory leaves out rests where the scene has it: at its start.
    assert validate(quintic(scene.joint_names(["a"]), home, GOAL, 5.0), scene, problem).valid


def test_without_a_problem_start_and_goal_are_named_as_not_checked(quintic: Make, scene: rp.Scene) -> None:
    report = validate(quintic(scene.joint_names(), [0.0, 0.0], GOAL, 3.0), scene)
    assert report.not_checked["start"] == report.not_checked["goal"] == "no problem was given"


def test_a_motion_of_no_duration_meets_a_goal_at_its_start(planar2r: rp.Robot, scene: rp.Scene) -> None:
    problem = rp.Problem(scene, start=GOAL, goal=GOAL)
    assert validate(rp.Trajectory.rest(scene.joint_names(), GOAL), scene, problem).valid
