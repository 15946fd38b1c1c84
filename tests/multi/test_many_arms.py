"""Many arms on one clock: requirements on every plan, and groups of arms that meet."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rr1plan as rp
from rr1plan import dual_arm_shelf, place_grid, plan_many_arms, random_grid, ring_swap
from rr1plan.collision.arm_groups import arms_in_reach, interaction_groups
from rr1plan.errors import InputError
from rr1plan.planning import Budget, PlanStatus

_BUDGET = Budget(seconds=60.0)
Check = Callable[..., None]


def _problem(name: str, rr1: rp.Robot) -> rp.Problem:
    kind, count = name.split("-")
    if kind == "grid":
        return random_grid(rr1, int(count), 0.55, 2)
    if kind == "ring":
        return ring_swap(rr1, int(count), 0.5, rng=1)
    return dual_arm_shelf(rr1, 0.5, 1)


@pytest.mark.parametrize("name", ["grid-2", "grid-4", "grid-8", "ring-3", "ring-4", "shelf-2"])
def test_plans_are_safe_and_start_and_end_where_they_have_to(name: str, rr1: rp.Robot, assert_safe: Check) -> None:
    problem = _problem(name, rr1)
    before = problem.start.tobytes()
    result = plan_many_arms(problem, rng=0, budget=_BUDGET)
    assert_safe(problem, result, 60)
    motion = result.trajectory
    assert motion is not None
    assert motion.joint_names == problem.joint_names
    assert motion(np.array(0.0)).tobytes() == problem.start.tobytes() == before
    goal = np.concatenate([problem.goal[arm][0].q for arm in problem.arms])
    np.testing.assert_allclose(motion(np.array(motion.end_time)), goal, atol=1e-9)
    assert set(result.paths) == set(problem.arms)
    assert result.makespan == pytest.approx(motion.duration)
    assert result.ratio >= 1.0 - 1e-9
    assert result.quality.waiting >= 0.0
    samples = motion(np.linspace(0.0, motion.end_time, 20_001))
    of_arms = (np.diff(q, axis=0) for q in np.split(samples, len(problem.arms), axis=1))
    lengths = [np.linalg.norm(steps, axis=1).sum() for steps in of_arms]
    assert result.quality.path_length == pytest.approx(sum(lengths), rel=1e-4)
    assert {arm for group in result.groups for arm in group.arms} == set(problem.arms)
    assert all(group.stage for group in result.groups)


def test_an_arm_without_collision_shapes_is_in_nobodys_way(planar2r: rp.Robot, assert_safe: Check) -> None:
    bare = replace(planar2r, links=[replace(link, collisions=()) for link in planar2r.links])
    scene = rp.Scene().with_arm("bare", bare).with_arm("also_bare", bare).with_arm("solid", planar2r, [2.4, 0.0, 0.0])
    goal = {"bare": [0.5, 0.5], "also_bare": [-0.5, 0.5], "solid": [2.0, 0.5]}
    problem = rp.Problem(scene, {arm: [0.1, 0.2] for arm in goal}, goal)
    result = plan_many_arms(problem, rng=0, budget=_BUDGET)
    assert_safe(problem, result, 20)
    plan: rp.ManyArmsResult | rp.RunningPlan = result
    for arm in goal:
        added = rp.add_motion(plan, arm, [0.1, 0.2], at=0.2, budget=_BUDGET, rng=0)
        assert added.blocked_by == ()
        plan = added.plan
    assert not rp.plan_graph(result).dependencies
    assert not rp.plan_graph(plan).dependencies


@pytest.mark.parametrize("kinds", [("RP", "RP"), ("RR", "RP"), ("PR", "RP")])
def test_arms_slide_beyond_joints_that_turn(kinds: tuple[str, str], assert_safe: Check) -> None:
    scene = rp.Scene()
    facing = (rp.transforms.pose([-1.1, 0, 0]), rp.transforms.pose([1.1, 0.1, 0.0], rpy=[0.0, 0.0, np.pi]))
    for name, joints, base in zip(("one", "two"), kinds, facing, strict=True):
        limits = [(-2.8, 2.8) if kind == "R" else (0.0, 0.5) for kind in joints]
        scene = scene.with_arm(name, rp.planar_arm(joints, (1.0, 0.7), limits=limits), base=base)
    turns = {name: arm.robot.limits.upper[0] > 1.0 for name, arm in scene.arms.items()}
    starts = {name: [0.8 if turning else 0.4, 0.2] for name, turning in turns.items()}
    goals = {name: [-0.8 if turning else 0.0, 0.3] for name, turning in turns.items()}
    problem = rp.Problem(scene, starts, goals)
    assert_safe(problem, plan_many_arms(problem, rng=0, budget=_BUDGET), 60)


def test_a_plan_keeps_no_memory_that_is_quickly_recomputed(rr1: rp.Robot) -> None:
    tracemalloc.start()
    result = plan_many_arms(_problem("grid-8", rr1), rng=7, budget=_BUDGET)
    held = tracemalloc.get_traced_memory()[0]
    for schedule in result.schedules:
        schedule.path.release()
    released = held - tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert result.found
    assert released < 1e5


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
    assert motion.reason == ""
    again = rp.load_motion(motion.save(tmp_path / "motion.json"))
    assert again.valid
    assert again.trajectory.allclose(motion.trajectory)
    with pytest.raises(rp.NoPlanError, match="its own path"):
        _ = motion.path
    with pytest.raises(InputError, match="leaves the paths"):
        rp.plan_motion(problem, planner="many_arms", retiming="ruckig_direct")
    with pytest.raises(InputError, match=r"margin is -1\.0, expected a number >= 0"):
        rp.plan_many_arms(problem, margin=-1.0)


def test_arms_that_cannot_meet_are_planned_apart(rr1: rp.Robot, assert_safe: Check) -> None:
    scene = place_grid(
        rr1, 1, 2, spacing=0.6, scene=place_grid(rr1, 1, 3, spacing=0.6, pose=(9.0, 0.0, 0.0)), prefix="left"
    )
    near = arms_in_reach(scene, scene.arms, 0.002)
    assert interaction_groups(near) == [("arm01", "arm02", "arm03"), ("left01", "left02")]
    goal = {arm: np.array([0.4, 0.1, 0.3, 0.2, 1.2, 0.3]) for arm in scene.arms}
    result = plan_many_arms(rp.Problem(scene, None, goal), rng=0, budget=_BUDGET)
    # They could meet, but their swept volumes do not.
    assert [len(group.arms) for group in result.groups] == [1] * 5
    assert_safe(rp.Problem(scene, None, goal), result, 30)


def test_arms_that_do_not_move_are_obstacles(rr1: rp.Robot, assert_safe: Check) -> None:
    problem = _problem("grid-4", rr1)
    moving = problem.arms[:3]
    starts = problem.scene.split(problem.start, problem.arms)
    scene = problem.scene.with_configuration(problem.arms[3], starts[problem.arms[3]])
    goal = {arm: problem.goal[arm] for arm in moving}
    part = rp.Problem(scene, {arm: starts[arm] for arm in moving}, goal)
    result = plan_many_arms(part, rng=0, budget=_BUDGET)
    if result.found:
        assert_safe(part, result, 30)
    else:
        assert result.status is PlanStatus.INVALID_GOAL


def test_goals_in_space_are_reached_by_configurations_that_go_together(rr1: rp.Robot, assert_safe: Check) -> None:
    scene = place_grid(rr1, 2, 1, spacing=0.5)
    aims = {"arm01": rp.PoseGoal("tool", (-0.35, 0.25, 0.4)), "arm02": rp.PoseGoal("tool", (0.1, 0.3, 0.45))}
    problem = rp.Problem(scene, None, aims)
    assert_safe(problem, plan_many_arms(problem, rng=0, budget=_BUDGET), 60)


def test_progress_may_cancel(rr1: rp.Robot) -> None:
    result = plan_many_arms(_problem("grid-4", rr1), rng=0, progress=lambda _: False)
    assert result.status is PlanStatus.CANCELLED
