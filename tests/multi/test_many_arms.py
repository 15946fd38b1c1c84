"""Many arms on one clock: what every plan has to hold, deadlocks, and problems without an answer."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.collision import CollisionChecker
from rr1plan.errors import InputError
from rr1plan.multi import ManyArmsResult, dual_arm_shelf, place_grid, plan_many_arms, random_grid, ring_swap
from rr1plan.multi.agents import Agent
from rr1plan.multi.coordination import coordination_diagram
from rr1plan.multi.interaction import arms_in_reach, interaction_groups
from rr1plan.multi.path_pool import PathPool
from rr1plan.multi.safe_intervals import blocked_times, earliest_schedule
from rr1plan.multi.schedule import extended
from rr1plan.planning import Budget, PlanStatus

_BUDGET = Budget(seconds=60.0)


def _problem(name: str, rr1: rp.Robot) -> rp.Problem:
    kind, count = name.split("-")
    if kind == "grid":
        return random_grid(rr1, int(count), 0.55, 2)
    if kind == "ring":
        return ring_swap(rr1, int(count), 0.5, rng=1)
    return dual_arm_shelf(rr1, 0.5, 1)


def _assert_safe(problem: rp.Problem, result: ManyArmsResult, samples: int = 150) -> None:
    """The referee certifies the motion, and Coal sees no contact at many instants."""
    assert result.found, result.reason
    assert result.trajectory is not None
    report = rp.validate(result.trajectory, problem.scene, problem)
    assert report.certified, report
    checker = CollisionChecker(problem.scene, problem.arms)
    times = np.linspace(result.trajectory.start_time, result.trajectory.end_time, samples)
    assert all(checker.is_free_slowly(q) for q in result.trajectory(times))


@pytest.mark.parametrize("name", ["grid-2", "grid-4", "grid-8", "ring-3", "ring-4", "shelf-2"])
def test_plans_are_safe_and_start_and_end_where_they_have_to(name: str, rr1: rp.Robot) -> None:
    problem = _problem(name, rr1)
    before = problem.start.tobytes()
    result = plan_many_arms(problem, rng=0, budget=_BUDGET)
    _assert_safe(problem, result, 60)
    motion = result.trajectory
    assert motion is not None
    assert motion.joint_names == problem.joint_names
    assert motion(np.array(0.0)).tobytes() == problem.start.tobytes() == before
    goal = np.concatenate([problem.goal[arm][0].q for arm in problem.arms])
    np.testing.assert_allclose(motion(np.array(motion.end_time)), goal, atol=1e-9)
    assert set(result.paths) == set(problem.arms)
    assert result.makespan == pytest.approx(motion.duration)
    assert result.ratio >= 1.0 - 1e-9
    assert result.waiting >= 0.0
    assert result.path_length > 0.0
    assert {arm for group in result.groups for arm in group.arms} == set(problem.arms)
    assert all(group.stage for group in result.groups)


def test_the_same_seed_gives_the_same_motion(rr1: rp.Robot) -> None:
    one, two = (plan_many_arms(_problem("ring-3", rr1), rng=7, budget=_BUDGET) for _ in range(2))
    assert one.trajectory is not None
    assert two.trajectory is not None
    assert one.trajectory.coefficients.tobytes() == two.trajectory.coefficients.tobytes()


def test_plan_motion_answers_problems_of_many_arms_with_proof(rr1: rp.Robot, tmp_path: Path) -> None:
    problem = _problem("grid-4", rr1)
    motion = rp.plan_motion(problem, rng=0, budget=_BUDGET)
    assert motion
    assert motion.many_arms is not None
    assert motion.trajectory.arms == problem.arms
    assert motion.result.planner == "many_arms"
    again = rp.load_motion(motion.save(tmp_path / "motion.json"))
    assert again.valid
    assert again.trajectory.allclose(motion.trajectory)
    with pytest.raises(rp.NoPlanError, match="its own path"):
        _ = motion.path
    with pytest.raises(InputError, match="leaves the paths"):
        rp.plan_motion(problem, planner="many_arms", retiming="ruckig_direct")


def test_arms_that_cannot_meet_are_planned_apart(rr1: rp.Robot) -> None:
    scene = place_grid(
        rr1, 1, 2, spacing=0.6, scene=place_grid(rr1, 1, 3, spacing=0.6, pose=(9.0, 0.0, 0.0)), prefix="left"
    )
    near = arms_in_reach(scene, scene.arms, 0.002)
    assert interaction_groups(near) == [("arm01", "arm02", "arm03"), ("left01", "left02")]
    goal = {arm: np.array([0.4, 0.1, 0.3, 0.2, 1.2, 0.3]) for arm in scene.arms}
    result = plan_many_arms(rp.Problem(scene, None, goal), rng=0, budget=_BUDGET)
    assert [len(group.arms) for group in result.groups] == [3, 2]
    _assert_safe(rp.Problem(scene, None, goal), result, 30)


def test_arms_that_do_not_move_are_obstacles(rr1: rp.Robot) -> None:
    problem = _problem("grid-4", rr1)
    moving = problem.arms[:3]
    starts = problem.scene.split(problem.start, problem.arms)
    scene = problem.scene.with_configuration(problem.arms[3], starts[problem.arms[3]])
    goal = {arm: problem.goal[arm] for arm in moving}
    part = rp.Problem(scene, {arm: starts[arm] for arm in moving}, goal)
    result = plan_many_arms(part, rng=0, budget=_BUDGET)
    if result.found:
        _assert_safe(part, result, 30)
    else:
        assert result.status is PlanStatus.INVALID_GOAL


def test_goals_in_space_are_reached_by_configurations_that_go_together(rr1: rp.Robot) -> None:
    scene = place_grid(rr1, 2, 1, spacing=0.5)
    aims = {"arm01": rp.PoseGoal("tool", (-0.35, 0.25, 0.4)), "arm02": rp.PoseGoal("tool", (0.1, 0.3, 0.45))}
    problem = rp.Problem(scene, None, aims)
    _assert_safe(problem, plan_many_arms(problem, rng=0, budget=_BUDGET), 60)


def test_progress_may_cancel(rr1: rp.Robot) -> None:
    result = plan_many_arms(_problem("grid-4", rr1), rng=0, progress=lambda _: False)
    assert result.status is PlanStatus.CANCELLED


# ---- deadlocks: arms in a plane, so that they can only pass in turn ------------------------------------------------


def _facing(planar2r: rp.Robot) -> rp.Scene:
    scene = rp.Scene().with_arm("left", planar2r, (-1.2, 0.0, 0.0))
    return scene.with_arm("right", planar2r, (1.2, 0.0, 0.0))


def _swap(planar2r: rp.Robot) -> rp.Problem:
    """Each goal crosses the other's start."""
    start = {"left": [0.5, 0.0], "right": [np.pi + 0.5, 0.0]}
    return rp.Problem(_facing(planar2r), start, {"left": [-0.5, 0.0], "right": [np.pi - 0.5, 0.0]})


def _goals_in_the_way(planar2r: rp.Robot) -> rp.Problem:
    """Each sweeps the other's goal."""
    start = {"left": [-0.6, 0.0], "right": [np.pi - 0.9, 0.0]}
    return rp.Problem(_facing(planar2r), start, {"left": [0.25, 0.0], "right": [np.pi, 0.0]})


def _cycle(planar2r: rp.Robot) -> rp.Problem:
    """Three arms in a ring, all tilted one way; each goal, tilted the other way, crosses the next one's start."""
    scene = rp.Scene()
    start, goal = {}, {}
    for k in range(3):
        angle = 2.0 * np.pi * k / 3.0
        name = f"arm{k}"
        scene = scene.with_arm(name, planar2r, (1.3 * np.cos(angle), 1.3 * np.sin(angle), 0.0))
        start[name], goal[name] = [angle + np.pi + 0.35, 0.0], [angle + np.pi - 0.35, 0.0]
    return rp.Problem(scene, start, goal)


def _idle(planar2r: rp.Robot) -> rp.Problem:
    """An arm without a goal hangs into the way of another one."""
    scene = rp.Scene().with_arm("left", planar2r, (-1.2, 0.0, 0.0)).with_arm("idle", planar2r, (-0.6, 1.5, 0.0))
    scene = scene.with_obstacle("wall", rp.Box((0.1, 3.0, 0.2)), (-1.5, 0.0, 0.0))
    start = {"left": [1.3, 0.3], "idle": [-np.pi / 2, 0.0]}
    return rp.Problem(scene, start, {"left": [-0.9, 0.5]}, arms=["left", "idle"])


def _retreat(planar2r: rp.Robot) -> rp.Problem:
    """One sweeps across the start and the goal of the other, which has to back up beyond its start before it may go."""
    scene = _facing(planar2r).with_obstacle("wall", rp.Box((0.1, 1.6, 0.2)), (1.7, 0.0, 0.0))
    start = {"left": [0.2, 0.0], "right": [np.pi - 0.9, 0.0]}
    return rp.Problem(scene, start, {"left": [-0.5, 0.0], "right": [np.pi + 0.9, 0.0]})


_DEADLOCKS = {"swap": _swap, "goals": _goals_in_the_way, "cycle": _cycle, "idle": _idle, "retreat": _retreat}


@pytest.mark.parametrize("name", list(_DEADLOCKS))
def test_deadlocks_are_solved_by_more_than_timing(name: str, planar2r: rp.Robot) -> None:
    problem = _DEADLOCKS[name](planar2r)
    result = plan_many_arms(problem, rng=1, budget=_BUDGET)
    _assert_safe(problem, result)
    assert {group.stage for group in result.groups} <= {"detours", "eviction", "composite"}


@pytest.mark.parametrize("name", ["swap", "idle", "retreat"])
def test_the_first_paths_cannot_be_timed_in_any_order(name: str, planar2r: rp.Robot) -> None:
    problem = _DEADLOCKS[name](planar2r)
    paths = []
    for arm in problem.arms:
        path, reason = PathPool(Agent(problem, [arm]), 0.0, np.random.default_rng(0)).add({}, 5.0)
        assert path is not None, reason
        paths.append(path)
    for one, two in (paths, paths[::-1]):
        first = earliest_schedule(one, blocked_times(one, []))
        blocked = coordination_diagram(two, one)
        assert first is not None
        assert blocked is not None
        assert earliest_schedule(two, blocked_times(two, [(extended(blocked), first.occupancy)])) is None


# ---- no answer ---------------------------------------------------------------------------------------------------


def test_starts_in_contact_are_named(planar2r: rp.Robot) -> None:
    scene = _facing(planar2r)
    problem = rp.Problem(scene, {"left": [0.0, 0.0], "right": [np.pi, 0.0]}, {"left": [1.0, 0.0], "right": [2.0, 0.0]})
    result = plan_many_arms(problem)
    assert result.status is PlanStatus.INVALID_START
    assert "'left/link2' and 'right/link2'" in result.reason
    assert "overlap by 80 mm" in result.reason


@pytest.mark.parametrize("depth", [0.001, 0.005, 0.05])
def test_goals_that_exclude_each_other_are_named(planar2r: rp.Robot, depth: float) -> None:
    scene = rp.Scene().with_arm("left", planar2r, (-1.7 - 0.04 + depth / 2, 0.0, 0.0))
    scene = scene.with_arm("right", planar2r, (1.7 + 0.04 - depth / 2, 0.0, 0.0))
    problem = rp.Problem(scene, {"left": [1.0, 0.0], "right": [2.0, 0.0]}, {"left": [0.0, 0.0], "right": [np.pi, 0.0]})
    result = plan_many_arms(problem)
    assert result.status is PlanStatus.INVALID_GOAL
    assert "exclude each other" in result.reason
    assert "'left/link2' and 'right/link2'" in result.reason


def test_goals_that_touch_by_a_hair_less_are_reached(planar2r: rp.Robot) -> None:
    scene = rp.Scene().with_arm("left", planar2r, (-1.7 - 0.04 - 1e-3, 0.0, 0.0))
    scene = scene.with_arm("right", planar2r, (1.7 + 0.04 + 1e-3, 0.0, 0.0))
    problem = rp.Problem(scene, {"left": [1.0, 0.0], "right": [2.0, 0.0]}, {"left": [0.0, 0.0], "right": [np.pi, 0.0]})
    _assert_safe(problem, plan_many_arms(problem, rng=0))


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
