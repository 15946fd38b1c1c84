"""Problems of many arms without a solution: proofs where possible, and never an invalid motion."""

from __future__ import annotations

import math
import os
import signal
import threading
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import rr1plan as rp
from rr1plan import place_grid, plan_many_arms
from rr1plan.collision.arm_groups import arms_in_reach
from rr1plan.errors import RetimingError
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.path_pool import PathPool
from rr1plan.multi.preflight import MARGINS, affordable_margin, preflight
from rr1plan.multi.search.coupled_windows import CoupledWindows
from rr1plan.multi.search.group_schedules import GroupSchedules
from rr1plan.multi.search.prioritized import PrioritizedPlanner
from rr1plan.multi.search.retreats import RetreatSearch
from rr1plan.multi.search.space_time import SpaceTimeSearch
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.planning import Budget, PlanStatus, Progress
from rr1plan.robot.joint_limits import Limits
from rr1plan.robot.robot_parts import Geometry, Joint, Link
from rr1plan.transforms import pose
from rr1plan.validation.compiled_search import TOUCH

Check = Callable[..., None]
# Iterations limit only the effort of searches that do not succeed.
_UNTIMED = Budget(seconds=math.inf, iterations=1)


def _facing(planar2r: rp.Robot) -> rp.Scene:
    scene = rp.Scene().with_arm("left", planar2r, (-1.2, 0.0, 0.0))
    return scene.with_arm("right", planar2r, (1.2, 0.0, 0.0))


def _rail(starts: list[float], goals: list[float]) -> rp.Problem:
    """Balls of 0.1 m on one rail, which can never pass each other."""
    along = Joint("slide", "prismatic", "base", "ball", axis=np.array([1.0, 0.0, 0.0]), lower=-10.0, upper=10.0)
    one = np.ones(1)
    robot = rp.Robot(
        name="slider",
        links=(Link("base"), Link("ball", collisions=(Geometry("ball", rp.Sphere(0.1)),))),
        joints=(along,),
        joint_names=("slide",),
        limits=Limits(-10.0 * one, 10.0 * one, one, 2.0 * one, 9.0 * one, 9.0 * one),
        configurations={"home": np.zeros(1)},
        locked_joints={},
        disabled_collisions=frozenset(),
        tool="ball",
    )
    names = [f"arm{k}" for k in range(len(starts))]
    scene = rp.Scene()
    for name in names:
        scene = scene.with_arm(name, robot)
    return rp.Problem(
        scene,
        {name: [q] for name, q in zip(names, starts, strict=True)},
        {name: [q] for name, q in zip(names, goals, strict=True)},
    )


def test_starts_in_contact_are_named(planar2r: rp.Robot) -> None:
    scene = _facing(planar2r)
    problem = rp.Problem(scene, {"left": [0.0, 0.0], "right": [np.pi, 0.0]}, {"left": [1.0, 0.0], "right": [2.0, 0.0]})
    result = plan_many_arms(problem)
    assert result.status is PlanStatus.INVALID_START
    assert "'left/link2' and 'right/link2'" in result.reason
    assert "overlap by 80 mm" in result.reason


def test_held_arms_in_contact_are_named(planar2r: rp.Robot) -> None:
    scene = _facing(planar2r).with_configuration("left", [0.0, 0.0]).with_configuration("right", [np.pi, 0.0])
    scene = scene.with_arm("far", planar2r, (0.0, 5.0, 0.0))
    result = plan_many_arms(rp.Problem(scene, None, {"far": [1.0, 0.0]}))
    assert result.status is PlanStatus.INVALID_START
    assert "'left/link2' and 'right/link2'" in result.reason


def test_an_arm_that_does_not_move_and_is_in_contact_is_not_called_another_arm(planar2r: rp.Robot) -> None:
    scene = _facing(planar2r).with_arm("third", planar2r, (0.0, 5.0, 0.0))
    scene = scene.with_obstacle("post", rp.Box((0.2, 0.2, 0.2)), (0.9, 6.2, 0.0))
    problem = rp.Problem(scene, None, {"left": [1.0, 0.5], "right": [1.0, 0.5]})
    result = plan_many_arms(problem, rng=0)
    assert result.status is PlanStatus.INVALID_START
    assert result.reason.startswith("the start is in collision: 'third/")


@pytest.mark.parametrize("depth", [0.001, 0.005, 0.05])
def test_goals_that_exclude_each_other_are_named(planar2r: rp.Robot, depth: float) -> None:
    scene = rp.Scene().with_arm("left", planar2r, (-1.7 - 0.04 + depth / 2, 0.0, 0.0))
    scene = scene.with_arm("right", planar2r, (1.7 + 0.04 - depth / 2, 0.0, 0.0))
    problem = rp.Problem(scene, {"left": [1.0, 0.0], "right": [2.0, 0.0]}, {"left": [0.0, 0.0], "right": [np.pi, 0.0]})
    result = plan_many_arms(problem)
    assert result.status is PlanStatus.INVALID_GOAL
    assert "exclude each other" in result.reason
    assert "'left/link2' and 'right/link2'" in result.reason


@pytest.mark.parametrize("method", ["portfolio", "conflict_based_search"])
def test_alternatives_that_only_fit_together_are_found(method: str, assert_safe: Check) -> None:
    """Of two goals of each arm, all combinations but the last are in contact, and each repair leads to another one."""
    robot = rp.planar_arm("RR", (0.7, 0.6))
    scene = rp.Scene().with_arm("left", robot, (-0.6, 0.0, 0.0)).with_arm("right", robot, (0.6, 0.0, 0.0))
    up, down = [np.pi / 2, 0.1], [-np.pi / 2, 0.1]
    goals = {"left": [[0.0, 0.0], up], "right": [[np.pi, 0.0], up]}
    problem = rp.Problem(scene, {"left": down, "right": down}, goals)
    result = plan_many_arms(problem, method=method, rng=0, budget=_UNTIMED)
    assert result.found
    assert_safe(problem, result)


def test_alternatives_that_all_exclude_each_other_are_a_proof(planar2r: rp.Robot) -> None:
    near = {"left": [[0.0, 0.0], [0.0, 0.01], [0.01, 0.0]], "right": [[np.pi, 0.0], [np.pi, 0.01]]}
    problem = rp.Problem(_facing(planar2r), {"left": [1.0, 0.0], "right": [2.0, 0.0]}, near)
    result = plan_many_arms(problem, rng=0)
    assert result.status is PlanStatus.INVALID_GOAL
    assert "in all combinations tried" in result.reason


@pytest.mark.parametrize("seed", [0, 1])
def test_tools_meet_if_any_of_their_orientations_leave_room(seed: int, rr1: rp.Robot, assert_safe: Check) -> None:
    """Of the first few configurations of each arm, no two leave room for each other."""
    scene = rp.Scene().with_arm("left", rr1, pose([-0.3, 0.0, 0.0], rpy=[0.0, 0.0, np.pi]))
    scene = scene.with_arm("right", rr1, (0.3, 0.0, 0.0))
    aside = rr1.home + np.array([1.4, 0.0, 0.0, 0.0, 0.0, 0.0])
    goals = {"left": rp.PoseGoal("tool", [-0.015, 0.0, 0.2]), "right": rp.PoseGoal("tool", [0.015, 0.0, 0.2])}
    problem = rp.Problem(scene, {"left": aside, "right": aside}, goals)
    result = plan_many_arms(problem, rng=seed, budget=_UNTIMED)
    assert result.found
    assert_safe(problem, result)


@pytest.mark.parametrize("cancels", [False, True])
def test_a_search_for_goals_that_is_cut_short_proves_nothing(cancels: bool, rr1: rp.Robot) -> None:
    """However early it ends, the goals of two tools that can meet do not "exclude each other"."""
    scene = rp.Scene().with_arm("left", rr1, pose([-0.3, 0.0, 0.0], rpy=[0.0, 0.0, np.pi]))
    scene = scene.with_arm("right", rr1, (0.3, 0.0, 0.0))
    goals = {"left": rp.PoseGoal("tool", [-0.015, 0.0, 0.2]), "right": rp.PoseGoal("tool", [0.015, 0.0, 0.2])}
    aside = rr1.home + np.array([1.4, 0.0, 0.0, 0.0, 0.0, 0.0])
    problem = rp.Problem(scene, {"left": aside, "right": aside}, goals)
    near = arms_in_reach(scene, problem.arms, 0.0)

    class Ending(Stopwatch):
        left_to_ask = 0

        def goes_on(self) -> bool:
            self.left_to_ask -= 1
            if self.left_to_ask < 0 and cancels:
                self.cancel()
            return self.left_to_ask >= 0

    found = []
    for count in range(24):
        watch = Ending(60.0)
        watch.left_to_ask = count
        found.append(preflight(problem, near, rng=0, watch=watch).status)
    assert set(found) <= {PlanStatus.CANCELLED if cancels else PlanStatus.TIMEOUT, None}
    assert found[0] is not None


def _slot(width: float) -> rp.Scene:
    """A slot of some width more than the arm [m], a wall, and two arms far away."""
    robot, idle = rp.planar_arm("PP", (1.0, 1.0), width=0.05), rp.planar_arm("RR", (0.5, 0.3))
    scene = rp.Scene().with_arm("arm", robot).with_arm("idle", idle, (5.0, 0.0, 0.0)).with_arm("off", idle, (0, 5, 0))
    half = 0.025 + 0.5 * width
    boxes = {"far": (0.58, 0.62, -0.2, 1.2), "left": (-0.2, 0.35 - half, 0.4, 0.6)}
    for name, (x0, x1, y0, y1) in (boxes | {"right": (0.35 + half, 0.58, 0.4, 0.6)}).items():
        scene = scene.with_obstacle(name, rp.Box((x1 - x0, y1 - y0, 0.1)), (0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.0))
    return scene


@pytest.mark.parametrize("method", ["portfolio", "conflict_based_search"])
def test_a_slot_that_leaves_less_than_the_margin_is_passed(method: str, assert_safe: Check) -> None:
    start = {"arm": [0.2, 0.2], "idle": [0.0, 1.0], "off": [0.0, 1.0]}
    problem = rp.Problem(_slot(0.0025), start, {"arm": [0.2, 0.8], "idle": [1.0, 1.0], "off": [1.0, 1.0]})
    result = plan_many_arms(problem, rng=1, method=method, budget=Budget(seconds=60.0))
    assert_safe(problem, result)


@pytest.mark.parametrize("method", ["portfolio", "conflict_based_search"])
def test_that_one_of_several_goals_has_no_path_proves_nothing(method: str) -> None:
    """One goal lies behind a slot of 1 mm, which is hard to find; the other one behind a wall."""
    scene = _slot(0.001)
    behind_slot, behind_wall = [0.2, 0.8], [0.9, 0.2]
    start = {"arm": [0.2, 0.2], "idle": [0.0, 1.0], "off": [0.0, 1.0]}
    others = {"idle": [1.0, 1.0], "off": [1.0, 1.0]}
    for goals in ([behind_slot, behind_wall], [behind_wall, behind_slot]):
        several = rp.Problem(scene, start, {"arm": goals, **others})
        assert plan_many_arms(several, margin=0.0, rng=0, method=method, budget=Budget(seconds=60.0)).found
    # With this goal alone it is a proof.
    alone = rp.Problem(scene, start, {"arm": behind_wall, **others})
    assert plan_many_arms(alone, margin=0.0, rng=0, method=method).status is PlanStatus.INFEASIBLE


def test_an_arm_without_a_goal_that_stands_in_one_is_named(planar2r: rp.Robot) -> None:
    scene = _facing(planar2r)
    start = {"left": [1.5, 0.0], "right": [np.pi, 0.0]}
    result = plan_many_arms(rp.Problem(scene, start, {"left": [0.0, 0.0]}, arms=["left", "right"]))
    assert result.status is PlanStatus.INVALID_GOAL
    assert "'left/link2' and 'right/link2'" in result.reason
    assert result.reason.endswith("; right ends where it starts")


def test_goals_that_touch_by_a_hair_less_are_reached(planar2r: rp.Robot, assert_safe: Check) -> None:
    scene = rp.Scene().with_arm("left", planar2r, (-1.7 - 0.04 - 1e-3, 0.0, 0.0))
    scene = scene.with_arm("right", planar2r, (1.7 + 0.04 + 1e-3, 0.0, 0.0))
    problem = rp.Problem(scene, {"left": [1.0, 0.0], "right": [2.0, 0.0]}, {"left": [0.0, 0.0], "right": [np.pi, 0.0]})
    assert_safe(problem, plan_many_arms(problem, rng=0))


def test_goals_out_of_limits_or_reach_are_named(rr1: rp.Robot) -> None:
    scene = place_grid(rr1, 2, 1, spacing=0.6)
    result = plan_many_arms(rp.Problem(scene, None, {"arm01": [3.0, 0, 0, 0, 1, 0], "arm02": "home"}))
    assert result.status is PlanStatus.INVALID_GOAL
    assert "arm01" in result.reason
    assert "shoulder_joint" in result.reason
    far = rp.PoseGoal("tool", (4.0, 0.0, 0.3))
    result = plan_many_arms(rp.Problem(scene, None, {"arm01": "home", "arm02": far}))
    assert result.status in (PlanStatus.INFEASIBLE, PlanStatus.INVALID_GOAL)
    assert result.reason.startswith("arm02")


@pytest.mark.usefixtures("processor_clock")
@pytest.mark.parametrize("method", ["portfolio", "conflict_based_search"])
def test_a_joint_that_has_to_move_and_has_no_limit_is_named(method: str, planar2r: rp.Robot) -> None:
    robot = planar2r.with_limits(replace(planar2r.limits, acceleration=np.array([10.0, np.inf])))
    scene = rp.Scene().with_arm("left", robot, (-1.5, 0.0, 0.0)).with_arm("right", robot, (1.5, 0.0, 0.0))
    problem = rp.Problem(scene, {"left": [1.0, 1.0], "right": [1.0, 1.0]}, {"left": [2.0, 1.0], "right": [1.0, 0.5]})
    with pytest.raises(RetimingError, match="'right/joint2' moves and has no acceleration limit"):
        plan_many_arms(problem, method=method)


@pytest.mark.parametrize("method", ["portfolio", "conflict_based_search"])
def test_a_joint_without_a_limit_that_moves_only_on_the_path_is_named(method: str) -> None:
    robot = rp.planar_arm("PP", (1.0, 1.0), width=0.05)
    robot = robot.with_limits(replace(robot.limits, velocity=np.array([np.inf, 1.0])))
    scene = rp.Scene()
    for k in range(3):
        scene = scene.with_arm(f"arm{k}", robot, (0.0, 0.0, float(k)))
    scene = scene.with_obstacle("post", rp.Box((0.1, 0.1, 0.1)), (0.5, 0.5, 0.0))
    goal = {"arm0": [0.5, 0.8], "arm1": [0.0, 1.0], "arm2": [0.0, 1.0]}
    problem = rp.Problem(scene, {"arm0": [0.5, 0.2], "arm1": [0.0, 0.0], "arm2": [0.0, 0.0]}, goal)
    with pytest.raises(RetimingError, match="'arm0/joint1' moves and has no velocity limit"):
        plan_many_arms(problem, method=method, rng=0)


@pytest.mark.usefixtures("processor_clock")
@pytest.mark.parametrize("method", ["portfolio", "conflict_based_search"])
def test_joints_without_limits_that_would_have_to_yield_are_named(method: str) -> None:
    robot = rp.planar_arm("RR", (0.6, 0.6), limits=[(-3.0, 3.0), (-0.1, 0.1)])
    still = robot.with_limits(replace(robot.limits, velocity=np.full(2, np.inf)))
    scene = rp.Scene().with_arm("left", still, (-1.0, 0.0, 0.0))
    scene = scene.with_arm("right", robot, pose((1.0, 0.0, 0.0), rpy=(0.0, 0.0, np.pi)))
    problem = rp.Problem(scene, {"left": [0.0, 0.0], "right": [1.0, 0.0]}, {"left": [0.0, 0.0], "right": [-1.0, 0.0]})
    result = plan_many_arms(problem, rng=0, method=method, budget=Budget(seconds=0.3))
    assert result.status is PlanStatus.TIMEOUT
    assert "left/joint1, left/joint2 did not move, because they have no limits" in result.reason


def test_what_is_not_found_in_time_is_said_with_who_is_blocked(planar2r: rp.Robot) -> None:
    # A post on either side of the first link at its goal: it cannot turn there from anywhere.
    scene = _facing(planar2r)
    goal = {"left": [-1.5, 0.0], "right": [np.pi, 0.0]}
    for k, side in enumerate((-1.0, 1.0)):
        scene = scene.with_obstacle(f"post{k}", rp.Cylinder(0.02, 0.2), (0.6, 0.1 * side, 0.0))
    start = {"left": [1.5, 0.0], "right": [np.pi - 1.0, 0.0]}
    result = plan_many_arms(rp.Problem(scene, start, goal), rng=0, budget=Budget(seconds=0.5))
    assert result.status is PlanStatus.TIMEOUT
    assert "right" in result.reason
    assert result.trajectory is None
    assert not math.isnan(result.seconds)


@pytest.mark.parametrize("method", ["portfolio", "conflict_based_search"])
def test_iterations_end_a_search_without_a_limit_of_time(method: str) -> None:
    result = plan_many_arms(_rail([0.0, 1.0], [1.0, 0.0]), rng=0, method=method, budget=_UNTIMED)
    assert result.status is PlanStatus.TIMEOUT
    assert "arm0, arm1" in result.reason


def test_iterations_end_the_search_for_the_path_of_an_arm(planar2r: rp.Robot) -> None:
    scene = _facing(planar2r)
    for k, side in enumerate((-1.0, 1.0)):
        scene = scene.with_obstacle(f"post{k}", rp.Cylinder(0.02, 0.2), (0.6, 0.1 * side, 0.0))
    start = {"left": [1.5, 0.0], "right": [np.pi - 1.0, 0.0]}
    problem = rp.Problem(scene, start, {"left": [-1.5, 0.0], "right": [np.pi, 0.0]})
    result = plan_many_arms(problem, rng=0, budget=_UNTIMED)
    assert result.status is PlanStatus.TIMEOUT
    assert "no path found: budget used up" in result.reason


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.usefixtures("processor_clock")
def test_on_a_rail_plans_are_found_exactly_where_the_order_stays(seed: int, assert_safe: Check) -> None:
    rng = np.random.default_rng(seed)
    count = 2 + seed % 3
    starts = np.sort(rng.permutation(12)[:count] * 0.5)
    goals = np.sort(rng.permutation(12)[:count] * 0.5)
    possible = _rail(starts.tolist(), goals.tolist())
    assert_safe(possible, plan_many_arms(possible, rng=seed), 60)
    swapped = _rail(starts.tolist(), [*goals[2:], *goals[1::-1]] if count > 2 else goals[::-1].tolist())
    result = plan_many_arms(swapped, rng=seed, budget=Budget(seconds=0.4))
    assert result.status is PlanStatus.TIMEOUT
    assert result.trajectory is None
    assert result.reason.startswith("not found in ")
    assert "arm0" in result.reason or "arm1" in result.reason


def _sealed(planar2r: rp.Robot) -> rp.Problem:
    """Walls around the hand of an arm at its goal."""
    scene = _facing(planar2r)
    for k, (x, y, sx, sy) in enumerate([(0.0, 0.1, 1.2, 0.02), (0.0, -0.1, 1.2, 0.02), (0.6, 0.0, 0.02, 0.22)]):
        scene = scene.with_obstacle(f"wall{k}", rp.Box((sx, sy, 0.2)), (x + 0.2, y, 0.0))
    return rp.Problem(
        scene, {"left": [1.5, 0.0], "right": [np.pi - 1.0, 0.0]}, {"left": [0.0, 0.0]}, arms=["left", "right"]
    )


def test_a_first_path_that_runs_out_of_time_was_not_cancelled(planar2r: rp.Robot) -> None:
    class Late(Stopwatch):
        """A clock whose end only the planner detects, by its progress callback."""

        def let_planner_go_on(self, _: Progress) -> bool:
            return False

    agent = Agent(_sealed(planar2r), ["left"])
    path, reason = PathPool(agent, 0.0, np.random.default_rng(0), Late(60.0)).add({}, patient=True)
    assert path is None
    assert reason.startswith("no path found in ")


def test_ends_near_contact_leave_a_margin_that_the_referee_can_tell_from_contact(planar2r: rp.Robot) -> None:
    scene = (
        rp.Scene().with_arm("left", planar2r, [0.0, 0.0, 0.0]).with_obstacle("ball", rp.Sphere(0.1), [0.5, 1.0, 0.0])
    )
    gap = rp.CollisionChecker(scene).clearance([0.0, 0.0])
    scene = scene.with_obstacle_at("ball", pose([0.5, 1.0 - gap + 5e-5, 0.0]))
    agent = Agent(rp.Problem(scene, {"left": [0.0, 0.0]}, {"left": [-1.0, 0.0]}), ["left"])
    assert rp.CollisionChecker(scene).clearance([0.0, 0.0]) == pytest.approx(5e-5, abs=1e-6)
    assert affordable_margin(agent, np.array([-1.0, 0.0]), 2e-3) == MARGINS[-1]
    assert MARGINS[-1] >= 10.0 * TOUCH


def test_a_margin_that_the_ends_do_not_allow_is_halved_and_not_abandoned(planar2r: rp.Robot) -> None:
    starts, goals = {"left": [1.0, 0.0], "right": [2.0, 0.5]}, {"left": [-1.0, 0.0], "right": [-2.0, 0.5]}
    problem = rp.Problem(_facing(planar2r), starts, goals)
    result = plan_many_arms(problem, margin=0.3, rng=0)
    assert result.trajectory is not None
    margins = rp.validate(result.trajectory, problem.scene, problem).margins
    assert margins["clearance_start"].value < 2.0 * 0.3
    assert margins["clearance"].value > 0.149


def test_of_several_goals_one_that_is_reached_is_taken(planar2r: rp.Robot, assert_safe: Check) -> None:
    sealed = _sealed(planar2r)
    starts = sealed.scene.split(sealed.start, sealed.arms)
    # The one in the box is nearer.
    goals = [rp.JointGoal(np.array([0.0, 0.0])), rp.JointGoal(np.array([3.1, 0.0]))]
    problem = rp.Problem(sealed.scene, starts, {"left": goals}, arms=sealed.arms)
    result = plan_many_arms(problem, rng=0)
    assert result.found
    np.testing.assert_allclose(result.trajectory.select("left")(result.trajectory.end_time), [3.1, 0.0], atol=1e-9)
    assert_safe(problem, result)


@pytest.mark.parametrize("method", ["portfolio", "conflict_based_search"])
@pytest.mark.parametrize("nearest_first", [True, False])
def test_a_goal_that_only_others_block_is_replaced_by_another(
    nearest_first: bool, method: str, assert_safe: Check
) -> None:
    """The nearest goal lies beyond the other arm on the rail, which both can reach alone."""
    rail = _rail([-0.3, 0.0], [-1.2, 0.3])
    goals = [rp.JointGoal([0.55]), rp.JointGoal([-1.2])]
    goal = {"arm0": goals if nearest_first else goals[::-1], "arm1": rail.goal["arm1"]}
    problem = rp.Problem(rail.scene, {"arm0": [-0.3], "arm1": [0.0]}, goal)
    result = plan_many_arms(problem, rng=0, budget=Budget(seconds=60.0), method=method)
    assert_safe(problem, result)
    assert result.trajectory is not None
    assert result.trajectory.select("arm0")(result.makespan) == pytest.approx(-1.2)


def test_a_group_that_takes_all_the_time_does_not_blame_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two arms that cannot pass each other, and one that moves apart from them."""

    def solve(windows: CoupledWindows, _: int) -> bool:
        windows._watch._budget = 0.0
        return False

    monkeypatch.setattr("rr1plan.multi.portfolio.processors", lambda: 1)
    monkeypatch.setattr(CoupledWindows, "solve", solve)
    problem = _rail([0.0, 1.0, 5.0], [1.0, 0.0, 6.0])
    result = plan_many_arms(problem, rng=0, budget=Budget(seconds=600.0))
    assert result.status is PlanStatus.TIMEOUT
    assert [(group.arms, group.found) for group in result.groups] == [(("arm0", "arm1"), False), (("arm2",), True)]
    assert result.reason.endswith("no schedule found for arm0, arm1 among each other")


@pytest.mark.parametrize("method", ["portfolio", "conflict_based_search"])
def test_a_base_of_another_arm_that_cannot_be_passed_is_a_proof(method: str) -> None:
    """An arm would have to turn through the base of another moving arm."""
    robot = rp.load_robot("planar2r_limited")
    scene = rp.Scene().with_arm("left", robot).with_arm("right", robot, (0.35, 0.0, 0.0))
    start, goal = {"left": [1.8, 0.0], "right": [0.3, 0.0]}, {"left": [-1.8, 0.0], "right": [-0.3, 0.0]}
    result = plan_many_arms(rp.Problem(scene, start, goal), rng=0, budget=Budget(seconds=60.0), method=method)
    assert result.status is PlanStatus.INFEASIBLE
    assert result.reason.startswith("left, right: no path exists: joint 'left/joint1' cannot pass")


def test_a_base_that_cannot_be_passed_is_a_proof_in_a_large_group_too() -> None:
    robot = rp.load_robot("planar2r_limited")
    scene = rp.Scene().with_arm("left", robot).with_arm("right", robot, (0.35, 0.0, 0.0))
    start, goal = {"left": [1.8, 0.0], "right": [0.3, 0.0]}, {"left": [-1.8, 0.0], "right": [-0.3, 0.0]}
    for k in range(3):
        scene = scene.with_arm(f"arm{k}", robot, (2.2 + 1.5 * k, 0.0, 0.0))
        start[f"arm{k}"], goal[f"arm{k}"] = [1.2, 0.0], [-1.2, 0.0]
    result = plan_many_arms(rp.Problem(scene, start, goal), rng=0, budget=Budget(seconds=60.0))
    assert result.status is PlanStatus.INFEASIBLE
    assert result.reason.startswith("left, right, arm0, arm1, arm2: no path exists: joint 'left/joint1' cannot pass")
    goal["left"] = [1.7, 0.1]
    assert plan_many_arms(rp.Problem(scene, start, goal), rng=0, budget=Budget(seconds=60.0)).found


@pytest.mark.parametrize("method", ["portfolio", "conflict_based_search"])
def test_bases_of_others_block_all_of_several_goals_provably(method: str) -> None:
    """Every goal of one arm lies beyond the base of the other one, which has several goals, too."""
    robot = rp.load_robot("planar2r_limited")
    scene = rp.Scene().with_arm("left", robot).with_arm("right", robot, (0.35, 0.0, 0.0))
    start = {"left": [1.8, 0.0], "right": [0.3, 0.0]}
    goals = {"left": [[-1.8, 0.0], [-1.7, 0.1]], "right": [[-0.3, 0.0], [-0.2, 0.0]]}
    result = plan_many_arms(rp.Problem(scene, start, goals), rng=0, budget=Budget(seconds=60.0), method=method)
    assert result.status is PlanStatus.INFEASIBLE
    assert result.reason.startswith("left, right: no path exists: joint 'left/joint1' cannot pass")
    reached = {**goals, "left": [[-1.8, 0.0], [1.7, 0.1]]}
    assert plan_many_arms(rp.Problem(scene, start, reached), rng=0, budget=Budget(seconds=60.0), method=method).found


@pytest.mark.parametrize("method", ["portfolio", "conflict_based_search"])
def test_a_wall_before_all_of_several_goals_is_a_proof_unless_one_is_a_pose(method: str) -> None:
    robot = rp.load_robot("planar2r_limited")
    scene = rp.Scene().with_arm("arm", robot).with_arm("idle", robot, (5.0, 0.0, 0.0))
    scene = scene.with_obstacle("wall", rp.Box((0.1, 0.02, 0.4)), (0.35, 0.0, 0.0))
    start, behind = {"arm": [0.8, 0.0], "idle": [0.5, 0.0]}, [[-0.8, 0.0], [-0.7, 0.1]]
    result = plan_many_arms(rp.Problem(scene, start, {"arm": behind, "idle": [1.0, 0.0]}), rng=0, method=method)
    assert result.status is PlanStatus.INFEASIBLE
    assert result.reason.startswith("arm: no path exists: joint 'arm/joint1' cannot pass")
    tool = rp.Kinematics(scene, ["arm"]).pose(behind[0], "arm/tool")[:3, 3]
    pose = rp.Problem(scene, start, {"arm": [behind[0], rp.PoseGoal("tool", tool)], "idle": [1.0, 0.0]})
    result = plan_many_arms(pose, rng=0, method=method, budget=Budget(seconds=1.5))
    assert result.status is PlanStatus.TIMEOUT
    assert "arm: to the goal configurations that were chosen, no path exists: " in result.reason


@pytest.mark.usefixtures("processor_clock")
def test_a_goal_in_a_sealed_box_is_not_reached(planar2r: rp.Robot) -> None:
    result = plan_many_arms(_sealed(planar2r), rng=0, budget=Budget(seconds=1.5))
    assert result.status is PlanStatus.TIMEOUT
    assert result.reason.startswith("not found in ")
    assert "left" in result.reason
    assert "the search kept 2 or 0.01 mm beyond the padding" in result.reason
    assert "this was the last of " in result.reason
    without = plan_many_arms(_sealed(planar2r), margin=0.0, rng=0, budget=Budget(seconds=0.3))
    assert "kept" not in without.reason


@pytest.mark.parametrize("seconds", [1e-6, 1e-3, 0.02])
def test_a_budget_may_end_at_any_stage(seconds: float, rr1: rp.Robot) -> None:
    result = plan_many_arms(rp.random_grid(rr1, 12, 0.8, 1), rng=0, budget=Budget(seconds=seconds))
    assert result.status in (PlanStatus.TIMEOUT, PlanStatus.FOUND)
    assert result.found == (result.trajectory is not None) == (not result.reason)


def test_no_stage_begins_after_the_deadline(rr1: rp.Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    begun = []

    def solve(windows: CoupledWindows, _: int) -> bool:
        windows._watch._budget = 0.0
        return False

    def begin(*_: object) -> None:
        begun.append(1)

    monkeypatch.setattr(SpaceTimeSearch, "solve", lambda _: None)
    monkeypatch.setattr(CoupledWindows, "solve", solve)
    for stage in ("prepare_diagrams", "time_first_paths", "fastest_alone"):
        monkeypatch.setattr(GroupSchedules, stage, begin)
    monkeypatch.setattr(PrioritizedPlanner, "schedule_all", begin)
    monkeypatch.setattr(RetreatSearch, "find", begin)
    result = plan_many_arms(rp.ring_swap(rr1, 6, 0.5015, 1, 2), rng=0, budget=Budget(seconds=600.0))
    assert result.status is PlanStatus.TIMEOUT
    assert "no schedule found for arm01, arm02" in result.reason
    assert begun == []


@pytest.mark.parametrize("count", [2, 6])
def test_progress_cancels_a_long_search(count: int) -> None:
    problem = _rail([float(k) for k in range(count)], [float(count - k) for k in range(count)])
    result = plan_many_arms(problem, rng=0, budget=Budget(seconds=60.0), progress=lambda p: p.seconds < 0.2)
    assert result.status is PlanStatus.CANCELLED
    assert result.seconds < 30.0


@pytest.mark.parametrize("groups", [1, 2])
def test_ctrl_c_ends_the_search_in_all_threads(groups: int) -> None:
    rail = _rail([0.0, 1.0], [1.0, 0.0])
    scene, start, goal = rp.Scene(), {}, {}
    for k in range(groups):
        for arm, part in rail.scene.arms.items():
            name = f"{arm}-{k}"
            scene = scene.with_arm(name, part.robot, (0.0, 5.0 * k, 0.0))
            start[name] = rail.scene.split(rail.start, rail.arms)[arm]
            goal[name] = rail.goal[arm]
    before = threading.active_count()
    timer = threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT))

    def search() -> None:
        timer.start()  # not before: on a busy machine Ctrl-C might come where nobody expects it
        plan_many_arms(rp.Problem(scene, start, goal), rng=0, budget=Budget(seconds=60.0))

    with pytest.raises(KeyboardInterrupt):
        search()
    timer.join()
    assert threading.active_count() == before
