"""New goals while a plan runs: the past stays, the rest is certified, and arms in the way are named."""

from __future__ import annotations

import gc
import math
import pickle
from dataclasses import replace
from itertools import combinations, product
from time import sleep
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.collision import CollisionChecker
from rr1plan.multi import stopwatch
from rr1plan.multi.execution import added_motions, present_motions
from rr1plan.multi.execution.running_plan import stops_of
from rr1plan.multi.execution.running_routes import running_route
from rr1plan.multi.paths import path_memory
from rr1plan.multi.timing.passing_order import closed_diagram
from rr1plan.planning import Budget
from rr1plan.robot.joint_limits import Limits
from rr1plan.robot.robot_parts import Geometry, Joint, Link
from rr1plan.scene.subscene import subscene
from rr1plan.transforms import pose

_BUDGET = Budget(seconds=20.0)


def _assert_same_before(one: rp.RunningPlan, two: rp.RunningPlan, time: float) -> None:
    at = np.linspace(one.trajectory.start_time, time, 400)
    np.testing.assert_allclose(two.trajectory(at), one.trajectory(at), atol=1e-11)
    np.testing.assert_allclose(two.trajectory(at[:-1], 1), one.trajectory(at[:-1], 1), atol=1e-9)


def _free_goal(plan: rp.RunningPlan, arm: str, rng: np.random.Generator) -> np.ndarray:
    """A random configuration without contact with the others at their goals."""
    scene = plan.scene
    for other in plan.arms:
        scene = scene.with_configuration(other, plan.goal(other))
    checker, limits = CollisionChecker(scene, [arm]), scene.arms[arm].robot.limits
    while True:
        q = rng.uniform(limits.lower, limits.upper)
        if checker.is_free(q):
            return q


def test_a_running_plan_goes_on_in_another_process(rr1: rp.Robot) -> None:
    result = rp.plan_many_arms(rp.ring_swap(rr1, 4, 0.5, rng=1), rng=0, budget=_BUDGET)
    goal = result.paths["arm04"].waypoints[-1]
    added = rp.add_motion(result, "arm04", "home", at=0.3, budget=_BUDGET, rng=0)
    assert added, added.reason
    sent = pickle.loads(pickle.dumps(added))
    here, there = (
        rp.add_motion(plan, "arm04", goal, at=0.8, budget=_BUDGET, rng=0) for plan in (added.plan, sent.plan)
    )
    assert here, here.reason
    np.testing.assert_array_equal(here.plan.trajectory.coefficients, there.plan.trajectory.coefficients)


@pytest.mark.parametrize(("count", "spacing"), [(4, 0.6), (8, 0.65)])
def test_goals_keep_coming(count: int, spacing: float, rr1: rp.Robot) -> None:
    problem = rp.random_grid(rr1, count, spacing, 1)
    plan = rp.RunningPlan.of(rp.plan_many_arms(problem, rng=0, budget=_BUDGET))
    rng = np.random.default_rng(1)
    time, moving, found = 0.0, 0, 0
    for k in range(16):
        time += rng.uniform(0.1, 0.6)
        arm = plan.arms[rng.integers(count)]
        goal = _free_goal(plan, arm, rng)
        added = rp.add_motion(plan, arm, goal, at=time, budget=_BUDGET, rng=k)
        moving += bool(np.abs(plan.velocity(arm, time + 0.3)).max() > 1e-3)
        if not added:
            assert added.plan is plan
            assert added.reason
            assert added.blocked_by
            continue
        found += 1
        assert added.report is not None
        assert added.report.certified
        assert added.stage in ("wait", "detour", "yield")
        _assert_same_before(plan, added.plan, time + 0.3)
        np.testing.assert_allclose(added.plan.goal(arm), goal, atol=1e-9)
        np.testing.assert_allclose(added.plan.configuration(arm, added.arrival), goal, atol=1e-9)
        for other in set(plan.arms) - {arm, *added.blocked_by}:
            later = np.linspace(time, added.plan.trajectory.end_time, 50)
            same = added.plan.trajectory.select(other)(later) - plan.trajectory.select(other)(later)
            assert np.abs(same).max() < 1e-11
        plan = added.plan
    assert moving >= 2
    assert found >= 14
    report = rp.validate(plan.trajectory, plan.scene)
    assert report.certified, report
    assert not rp.simulate(plan.trajectory, plan.scene, mode="kinematic").contacts
    _assert_late_executions_are_safe(plan, rng)


def _assert_all_blocked_cells_are_ordered(plan: rp.RunningPlan, graph: rp.PlanGraph) -> None:
    """Steps on paths far apart in time have an order, too, which may follow from other dependencies."""
    clocks = _clocks(graph)
    far = 0
    for i, j in combinations(range(len(plan.arms)), 2):
        one, two = (running_route(plan.parts[plan.arms[k]]) for k in (i, j))
        for k, m in product(range(len(one.parts)), range(len(two.parts))):
            part, other = one.parts[k], two.parts[m]
            blocked = closed_diagram(part.path, other.path, 0.0)
            if blocked is None:
                continue
            rows, columns = one.steps_of(k), two.steps_of(m)
            for a, b in np.argwhere(blocked[np.ix_(part.rows[: len(rows)], other.rows[: len(columns)])]).tolist():
                if 0 < a < len(rows) - 1 and 0 < b < len(columns) - 1:  # rests between paths belong to both
                    step, against = rows[a], columns[b]
                    first = clocks[j][against][i] > step
                    assert first != (clocks[i][step][j] > against)
                    far += abs(k - m) > 1
    assert far


def _clocks(graph: rp.PlanGraph) -> list[np.ndarray]:
    """The least step of each agent when an agent enters each of its steps, shape (steps, agents) each."""
    clocks = [np.zeros((len(route.steps), len(graph.routes)), int) for route in graph.routes]
    for i, clock in enumerate(clocks):
        clock[:, i] = np.arange(len(clock))
    changed = True
    while changed:
        before = [clock.copy() for clock in clocks]
        for node, after in graph.dependencies:
            waiting = clocks[node.agent][node.step]
            np.maximum(waiting, clocks[after.agent][after.step], out=waiting)
        for clock in clocks:
            np.maximum.accumulate(clock, axis=0, out=clock)
        changed = any((a != b).any() for a, b in zip(before, clocks, strict=True))
    return clocks


def test_a_plan_without_its_past_stays_small_and_goes_on_the_same(
    planar2r: rp.Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = rp.Scene().with_arm("a", planar2r).with_arm("b", planar2r, (1.2, 0.0, 0.0))
    problem = rp.Problem(scene, None, {"a": [1.0, 0.5], "b": [1.2, 0.5]})
    whole = short = rp.RunningPlan.of(rp.plan_many_arms(problem, rng=0))
    np.testing.assert_array_equal(whole.without_past(-1.0).trajectory.breaks, whole.trajectory.breaks)
    for k in range(12):
        time, arm, goal = 0.3 * k, "ab"[k % 2], [1.2 + 0.3 * (-1) ** (k // 2), 0.5]
        added = [rp.add_motion(plan, arm, goal, at=time, freeze=0.0, budget=_BUDGET, rng=k) for plan in (whole, short)]
        assert added[0]
        assert added[1], added[1].reason
        whole, short = added[0].plan, added[1].plan.without_past(0.3 * (k + 1))
        later = np.linspace(0.3 * (k + 1), whole.trajectory.end_time, 100)
        np.testing.assert_allclose(short.trajectory(later), whole.trajectory(later), atol=1e-7)
        assert max(map(len, short.parts.values())) <= 3
        assert short.trajectory.start_time == 0.3 * (k + 1)
    assert min(map(len, whole.parts.values())) > 6
    assert rp.validate(whole.trajectory, scene).certified
    graph = rp.plan_graph(whole)
    monkeypatch.setattr(path_memory, "_MOST_BYTES", 0)
    assert rp.plan_graph(whole).to_dict() == graph.to_dict()
    assert sum("placed" in vars(part.path) for parts in whole.parts.values() for part in parts) <= 2
    with pytest.raises(rp.InputError, match=r"no motions before 3\.600 s"):
        rp.plan_graph(short)
    with pytest.raises(rp.InputError, match=r"at is 3\.5 .* from 3\.600 s on"):
        rp.add_motion(short, "a", [0.0, 0.0], at=3.5)
    with pytest.raises(rp.InputError, match="expected up to 1e"):
        short.without_past(1e8)


def _assert_late_executions_are_safe(plan: rp.RunningPlan, rng: np.random.Generator) -> None:
    """All goals are reached in the order of the plan, however late arms are."""
    graph = rp.plan_graph(plan)
    assert graph.arms == plan.arms
    assert graph.dependencies
    _assert_all_blocked_cells_are_ordered(plan, graph)
    for route in graph.routes:
        arm, times = plan.trajectory.select(route.arms[0]), route.steps.times[1:]
        np.testing.assert_allclose(arm(times), route.gridpoints[route.steps.begins[1:]], atol=1e-6)
    for _ in range(2):
        delays = {arm: rp.ArmDelay(rng.uniform(0.0, 0.5), rng.uniform(0.0, 0.5)) for arm in plan.arms}
        late = rp.execute_plan(graph, plan.scene, delays)
        assert rp.validate(late.trajectory, plan.scene).certified
        assert not rp.simulate(late.trajectory, plan.scene, mode="kinematic").contacts
        for arm in plan.arms:
            np.testing.assert_allclose(late.trajectory.select(arm)(late.makespan), plan.goal(arm), atol=1e-9)
    blind = rp.PlanGraph(graph.routes, ())
    collides = (
        not rp.validate(rp.execute_plan(blind, plan.scene, {arm: rp.ArmDelay(0.5)}).trajectory, plan.scene).valid
        for arm in plan.arms
    )
    assert any(collides)


def test_arms_that_were_planned_as_one_get_goals_of_their_own(rr1: rp.Robot) -> None:
    problem = rp.ring_swap(rr1, 8, 0.6, rng=1)
    result = rp.plan_many_arms(problem, rng=0, budget=_BUDGET)
    assert any(len(s.path.agent.arms) > 1 for s in result.schedules)
    plan = rp.RunningPlan.of(result)
    assert plan.arms == problem.arms
    together = next(s.path.agent.arms for s in result.schedules if len(s.path.agent.arms) > 1)
    start = problem.scene.split(problem.start, problem.arms)[together[0]]
    goals = [start, _free_goal(plan, together[0], np.random.default_rng(0))]
    added = rp.add_motion(result, together[0], goals, at=0.1, budget=_BUDGET, rng=0)
    if added:
        _assert_same_before(plan, added.plan, 0.4)
        assert rp.validate(added.plan.trajectory, plan.scene).certified
    else:
        assert added.blocked_by


def test_the_same_seed_gives_the_same_motion(rr1: rp.Robot) -> None:
    problem = rp.random_grid(rr1, 4, 0.6, 1)
    plan = rp.RunningPlan.of(rp.plan_many_arms(problem, rng=0, budget=_BUDGET))
    goal = _free_goal(plan, "arm02", np.random.default_rng(3))
    one, two = (rp.add_motion(plan, "arm02", goal, at=0.2, budget=_BUDGET, rng=5) for _ in range(2))
    assert one.plan.trajectory.coefficients.tobytes() == two.plan.trajectory.coefficients.tobytes()


# ---- arms in a plane -------------------------------------------------------------------------


def _facing(planar2r: rp.Robot) -> rp.Scene:
    scene = rp.Scene().with_arm("left", planar2r, (-1.2, 0.0, 0.0))
    return scene.with_arm("right", planar2r, (1.2, 0.0, 0.0))


def _at_rest(scene: rp.Scene, start: dict[str, list[float]]) -> rp.RunningPlan:
    return rp.RunningPlan.of(rp.plan_many_arms(rp.Problem(scene, start, dict(start)), rng=0))


def test_an_arm_waits_for_one_that_leaves(planar2r: rp.Robot) -> None:
    plan = _at_rest(_facing(planar2r), {"left": [1.2, 0.0], "right": [np.pi, 0.0]})
    leaving = rp.add_motion(plan, "right", [np.pi + 1.5, 0.0], at=0.0, budget=_BUDGET, rng=0)
    assert leaving.stage == "wait"
    alone = rp.add_motion(
        _at_rest(_facing(planar2r), {"left": [1.2, 0.0], "right": [np.pi + 1.5, 0.0]}), "left", [0.0, 0.0], at=0.0
    )
    coming = rp.add_motion(leaving.plan, "left", [0.0, 0.0], at=0.0, budget=_BUDGET, rng=0)
    assert coming.found, coming.reason
    assert coming.blocked_by == ()
    assert coming.arrival > alone.arrival - 1e-6
    assert rp.validate(coming.plan.trajectory, plan.scene).certified


def _blocks_in_a_plane() -> rp.Scene:
    """Two cubes of 0.1 m, each moved along x and y."""
    limits = Limits(-np.ones(2), np.ones(2), np.ones(2), 2.0 * np.ones(2), 9.0 * np.ones(2), 9.0 * np.ones(2))
    robot = rp.Robot(
        name="block",
        links=(Link("base"), Link("carriage"), Link("cube", collisions=(Geometry("cube", rp.Box((0.1, 0.1, 0.1))),))),
        joints=(
            Joint("x", "prismatic", "base", "carriage", axis=np.array([1.0, 0.0, 0.0]), lower=-1.0, upper=1.0),
            Joint("y", "prismatic", "carriage", "cube", axis=np.array([0.0, 1.0, 0.0]), lower=-1.0, upper=1.0),
        ),
        joint_names=("x", "y"),
        limits=limits,
        configurations={"home": np.zeros(2)},
        locked_joints={},
        disabled_collisions=frozenset(),
        tool="cube",
    )
    return rp.Scene().with_arm("one", robot).with_arm("two", robot)


@pytest.mark.parametrize("at", [0.0, 0.2, 1.0, 5.0])
def test_the_goal_that_an_arm_already_has_is_kept(at: float) -> None:
    """An arm that swaps places with another one gets the same goal again, before, while and after it moves."""
    scene, left, right = _blocks_in_a_plane(), [-0.5, 0.0], [0.5, 0.0]
    result = rp.plan_many_arms(rp.Problem(scene, {"one": left, "two": right}, {"one": right, "two": left}), rng=0)
    for goal in (right, rp.PoseGoal("cube", [0.5, 0.0, 0.0])):
        added = rp.add_motion(result, "one", goal, at=at, budget=Budget(seconds=1.0), rng=0)
        assert added.found, added.reason
        assert added.blocked_by == ()
        assert added.report is not None
        assert added.report.certified
        np.testing.assert_allclose(added.plan.configuration("one", added.arrival), right, atol=1e-9)
        if at > result.makespan:
            assert added.arrival == at + 0.3


def test_an_arm_that_never_moved_keeps_its_goal_also_without_time_for_a_search() -> None:
    plan = _at_rest(_blocks_in_a_plane(), {"one": [-0.5, 0.0], "two": [0.5, 0.0]})
    added = rp.add_motion(plan, "one", [-0.5, 0.0], at=1.0, freeze=0.3, budget=Budget(seconds=1e-9), rng=0)
    assert added.found, added.reason
    assert added.arrival == 1.3


def test_an_arm_that_rests_in_the_way_yields_and_comes_back(planar2r: rp.Robot) -> None:
    scene = rp.Scene().with_arm("left", planar2r, (-1.2, 0.0, 0.0)).with_arm("idle", planar2r, (-0.6, 1.5, 0.0))
    scene = scene.with_obstacle("wall", rp.Box((0.1, 3.0, 0.2)), (-1.5, 0.0, 0.0))
    plan = _at_rest(scene, {"left": [1.3, 0.3], "idle": [-np.pi / 2, 0.0]})
    added = rp.add_motion(plan, "left", [-0.9, 0.5], at=1.0, budget=_BUDGET, rng=1)
    assert added.stage == "yield", added.reason
    assert added.blocked_by == ("idle",)
    assert "idle yields, there after" in repr(added)
    np.testing.assert_allclose(added.plan.goal("idle"), [-np.pi / 2, 0.0])
    assert rp.validate(added.plan.trajectory, scene).certified
    _assert_same_before(plan, added.plan, 1.3)
    idle = added.plan.trajectory.select("idle")
    assert np.abs(idle(np.linspace(1.3, idle.end_time, 200)) - [-np.pi / 2, 0.0]).max() > 0.1


def test_two_arms_that_rest_in_the_way_both_yield(planar2r: rp.Robot) -> None:
    scene = rp.Scene().with_arm("left", planar2r, (-1.2, 0.0, 0.0)).with_arm("idle", planar2r, (-0.6, 1.5, 0.0))
    scene = scene.with_arm("other", planar2r, (-0.3, 1.5, 0.0))
    scene = scene.with_obstacle("wall", rp.Box((0.1, 3.0, 0.2)), (-1.5, 0.0, 0.0))
    ends = {"left": [1.3, 0.3], "idle": [-np.pi / 2, 0.0], "other": [-np.pi / 2, 0.0]}
    plan = _at_rest(scene, ends)
    there = rp.add_motion(plan, "other", [-np.pi / 2 + 0.1, 0.0], at=0.0, budget=_BUDGET, rng=1)
    added = rp.add_motion(there.plan, "left", [-0.9, 0.5], at=0.0, budget=_BUDGET, rng=1)
    assert added.stage == "yield", added.reason
    assert added.blocked_by == ("idle", "other")
    assert "idle, other yield, there after" in repr(added)
    assert rp.validate(added.plan.trajectory, scene).certified
    _assert_same_before(there.plan, added.plan, 0.3)
    for arm in added.blocked_by:
        np.testing.assert_allclose(added.plan.goal(arm), there.plan.goal(arm), atol=1e-9)
    again = rp.add_motion(added.plan, "left", [1.3, 0.3], at=0.5 * added.arrival, budget=_BUDGET, rng=2)
    plan = again.plan
    assert rp.validate(plan.trajectory, scene).certified
    late = rp.execute_plan(rp.plan_graph(plan), scene, {"idle": rp.ArmDelay(0.4, 0.3)})
    assert rp.validate(late.trajectory, scene).certified


def test_a_moving_arm_brakes_and_turns_back(planar2r: rp.Robot) -> None:
    plan = _at_rest(_facing(planar2r), {"left": [1.5, 0.0], "right": [np.pi + 1.5, 0.0]})
    there = rp.add_motion(plan, "left", [-1.2, 0.3], at=0.0, freeze=0.0, budget=_BUDGET, rng=0)
    middle = 0.5 * there.arrival
    assert np.abs(there.plan.velocity("left", middle)).max() > 0.1
    back = rp.add_motion(there.plan, "left", [1.5, 0.0], at=middle - 0.3, budget=_BUDGET, rng=0)
    assert back.found, back.reason
    assert back.arrival > middle
    _assert_same_before(there.plan, back.plan, middle)
    assert rp.validate(back.plan.trajectory, plan.scene).certified
    again = rp.add_motion(back.plan, "left", [-1.2, 0.3], at=middle - 0.25, freeze=0.3, budget=_BUDGET, rng=0)
    assert again.found, again.reason
    assert rp.validate(again.plan.trajectory, plan.scene).certified


def _assert_executable(plan: rp.RunningPlan) -> None:
    late = rp.execute_plan(rp.plan_graph(plan), plan.scene, {plan.arms[0]: rp.ArmDelay(0.3)})
    assert rp.validate(late.trajectory, plan.scene).certified


def test_of_two_goals_at_the_same_time_the_second_one_counts(planar2r: rp.Robot) -> None:
    plan = _at_rest(_facing(planar2r), {"left": [1.5, 0.0], "right": [np.pi + 1.5, 0.0]})
    there = rp.add_motion(plan, "left", [1.2, 0.0], at=0.0, budget=_BUDGET, rng=0)
    plan = there.plan
    for goal in ([1.0, 0.0], [0.5, 0.0]):
        plan = rp.add_motion(plan, "left", goal, at=there.arrival + 0.1, budget=_BUDGET, rng=0).plan
    np.testing.assert_allclose(plan.goal("left"), [0.5, 0.0])
    _assert_executable(plan)


def test_long_runs_keep_no_collision_checkers_of_the_past() -> None:
    robot, scene = rp.planar_arm("RR", (0.5, 0.4)), rp.Scene()
    for k in range(4):
        scene = scene.with_arm(f"arm{k}", robot, (3.0 * k, 0.0, 0.0))
    plan = _at_rest(scene, {arm: [0.0, 0.5] for arm in scene.arms})
    checkers, now = [], 0.0
    for k in range(24):
        goal = [1.0 - 0.5 * (k // 4 % 2), 0.5]
        added = rp.add_motion(plan, f"arm{k % 4}", goal, at=now, freeze=0.0, budget=_BUDGET, rng=k)
        assert added.found, added.reason
        plan, now = added.plan, added.arrival + 0.1
        if k % 12 == 11:
            gc.collect()
            checkers.append(sum(isinstance(thing, CollisionChecker) for thing in gc.get_objects()))
    assert checkers[1] <= checkers[0]
    _assert_executable(plan)


def test_without_time_for_a_path_no_arm_counts_as_in_the_way(planar2r: rp.Robot) -> None:
    plan = _at_rest(_facing(planar2r), {"left": [1.5, 0.0], "right": [np.pi + 1.5, 0.0]})
    added = rp.add_motion(plan, "left", [1.0, 0.0], at=0.0, budget=Budget(seconds=1e-6), rng=0)
    assert not added.found
    assert "no time was left for a path of left" in added.reason
    assert not added.blocked_by


def test_a_motion_begins_at_a_corner_or_at_an_arrival_up_to_rounding() -> None:
    robot = rp.planar_arm("RR", (0.5, 0.4), width=0.08)
    scene = rp.Scene().with_arm("a", robot, (-2.0, 0.0, 0.0)).with_arm("b", robot, (2.0, 0.0, 0.0))
    scene = scene.with_obstacle("post", rp.Cylinder(0.05, 0.3), (-1.25, 0.3, 0.0))
    problem = rp.Problem(scene, {"a": [-0.6, 0.5], "b": [0.0, 0.5]}, {"a": [1.6, 0.2], "b": [1.0, 0.5]})
    result = rp.plan_many_arms(problem, rng=0, retiming="stop")
    route = next(route for route in rp.plan_graph(result).routes if route.arms == ("a",))
    assert len(route.stops) > 1
    for stop in route.stops:
        time = float(route.steps.times[route.steps.begins == stop][0])
        for at in (time - 1e-12, time, time + 1e-12):
            added = rp.add_motion(result, "a", [0.0, 2.5], at=at, freeze=0.0, budget=_BUDGET, rng=0)
            assert added.found, added.reason
            np.testing.assert_allclose(added.plan.configuration("a", at), route.gridpoints[stop], atol=1e-9)
            _assert_executable(added.plan)


def test_added_motions_keep_the_margin_of_the_plan() -> None:
    robot = rp.planar_arm("RR", (0.6, 0.5))
    scene = rp.Scene().with_arm("a", robot, (-0.7, 0.0, 0.0)).with_arm("b", robot, (0.7, 2.0, 0.0))
    post = (-0.7 + 1.205 * np.cos(0.6), 1.205 * np.sin(0.6), 0.0)
    scene = scene.with_obstacle("post", rp.Cylinder(0.05, 0.3), post)
    start = {"a": [-0.9, 0.3], "b": [1.5, 0.2]}
    result = rp.plan_many_arms(rp.Problem(scene, start, start).with_margin(0.05), rng=0)
    plan = rp.RunningPlan.of(result)
    assert plan.margin == 0.05
    added = rp.add_motion(plan, "a", [1.8, 0.3], at=0.0, budget=_BUDGET, rng=0)
    assert rp.validate(added.plan.trajectory, replace(scene, padding=0.0499)).certified
    with pytest.raises(rp.InputError, match="margin is -1"):
        replace(plan, margin=-1.0)


@pytest.mark.parametrize(("retiming", "torque_limits"), [("ruckig", False), ("blend", True)])
def test_added_motions_keep_limits_of_jerk_and_torque(retiming: str, torque_limits: bool, rr1: rp.Robot) -> None:
    home, goal = rr1.home, rr1.home + np.array([1.5, 0.3, 0.3, 0.3, 0.3, 0.3])
    line = np.linspace(home, goal, 60)
    static = np.abs(rp.Kinematics(rr1).inverse_dynamics(line, 0.0 * line, 0.0 * line)).max(axis=0)
    weak = replace(rr1, limits=replace(rr1.limits, effort=1.06 * static + 0.25)) if torque_limits else rr1
    scene = rp.Scene().with_arm("a", weak, (-1.0, 0.0, 0.0)).with_arm("b", weak, (1.0, 0.0, 0.0))
    problem = rp.Problem(scene, {"a": home, "b": home}, {"a": goal, "b": home})
    result = rp.plan_many_arms(problem, rng=0, retiming=retiming, torque_limits=torque_limits)
    limits = {"torque_limits": torque_limits, "jerk_limits": retiming == "ruckig"}
    assert rp.validate(result.trajectory, scene, **limits).certified
    added = rp.add_motion(result, "a", home, at=0.1, budget=_BUDGET, rng=0)
    assert added.found, added.reason
    assert rp.validate(added.plan.trajectory, scene, **limits).certified
    graph = rp.plan_graph(added.plan)
    assert (graph.retiming, graph.torque_limits) == (retiming, torque_limits)


def test_more_time_is_reserved_where_the_referee_computes_torques(
    rr1: rp.Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    budgets: list[float] = []

    class Clock(stopwatch.Stopwatch):
        def with_deadline(self, seconds: float) -> stopwatch.Stopwatch:
            budgets.append(seconds)
            return stopwatch.Stopwatch(60.0)

    monkeypatch.setattr(added_motions, "Stopwatch", Clock)
    problem = rp.random_grid(rr1, 4, 0.8, 1)
    for torque_limits in (False, True):
        plan = rp.RunningPlan.of(rp.plan_many_arms(problem, torque_limits=torque_limits, rng=0, budget=_BUDGET))
        assert rp.add_motion(plan, "arm01", "home", at=0.1, budget=Budget(seconds=1.0), rng=0)
    assert 0.5 <= budgets[1] < budgets[0] < 1.0


def test_the_conversion_of_a_result_counts_toward_the_budget(rr1: rp.Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    result = rp.plan_many_arms(rp.random_grid(rr1, 4, 0.8, 1), rng=0, budget=_BUDGET)
    convert, now = rp.RunningPlan.of, [0.0]

    def slowly(found: rp.ManyArmsResult) -> rp.RunningPlan:
        now[0] += 2.0
        return convert(found)

    monkeypatch.setattr(stopwatch, "time", SimpleNamespace(perf_counter=lambda: now[0]))
    monkeypatch.setattr(rp.RunningPlan, "of", slowly)
    late = rp.add_motion(result, "arm01", "home", at=0.1, budget=Budget(seconds=1.0), rng=0)
    assert not late
    assert late.reason == "no time was left for a path of arm01, after 2 s (option budget)"
    assert rp.add_motion(late.plan, "arm01", "home", at=0.1, budget=_BUDGET, rng=0)


def test_diagrams_are_not_completed_after_the_deadline(rr1: rp.Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    plan = rp.RunningPlan.of(rp.plan_many_arms(rp.ring_swap(rr1, 4, 0.5, rng=1), rng=0, budget=_BUDGET))
    diagrams: list[np.ndarray | None] = []

    def late(*paths: Any, **options: Any) -> np.ndarray | None:
        while not options["stop"][0]:
            sleep(0.01)
        diagrams.append(closed_diagram(*paths, **options))
        return diagrams[-1]

    monkeypatch.setattr(present_motions, "closed_diagram", late)
    added = rp.add_motion(plan, "arm04", "home", at=0.4, budget=Budget(seconds=2.0), rng=0)
    assert not added
    assert added.plan is plan
    assert added.blocked_by == (), "no arm is known to be in the way"
    blocked = [diagram for diagram in diagrams if diagram is not None]
    assert blocked
    assert all(diagram.all() for diagram in blocked)


def test_after_a_rejected_motion_another_one_is_tried(planar2r: rp.Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    plan = _at_rest(_facing(planar2r), {"left": [1.5, 0.0], "right": [np.pi + 1.5, 0.0]})
    plan = rp.add_motion(plan, "left", [-1.2, 0.3], at=0.0, freeze=0.0, budget=_BUDGET, rng=0).plan
    rejected, report = [], added_motions._report

    def strict(motion: rp.Trajectory, *others: Any) -> rp.Report:
        if rejected:
            return report(motion, *others)
        rejected.append(motion)
        return report(motion.stretched(0.1), *others)

    monkeypatch.setattr(added_motions, "_report", strict)
    added = rp.add_motion(plan, "left", [1.5, 0.0], at=0.5, freeze=0.0, budget=_BUDGET, rng=0)
    assert rejected
    assert added.found, added.reason
    assert added.report is not None
    assert added.report.certified


def test_braking_keeps_the_acceleration_limits(rr1: rp.Robot) -> None:
    problem = rp.ring_swap(rr1, 6, 0.6, rng=1)
    plan = rp.RunningPlan.of(rp.plan_many_arms(problem, rng=0, budget=_BUDGET))
    for arm in plan.arms:
        alone = subscene(problem.scene, {arm: None}, obstacles=False)
        for time in np.linspace(0.05, plan.trajectory.end_time - 0.05, 20):
            if np.abs(plan.velocity(arm, time)).max() > 1e-3:
                for stop in stops_of(plan, arm, float(time)):
                    violations = rp.validate(stop.braking, alone, clearance=False).violations
                    assert not [v for v in violations if v.kind in ("velocity", "acceleration")]


def test_a_goal_where_another_arm_ends_names_it(planar2r: rp.Robot) -> None:
    plan = _at_rest(_facing(planar2r), {"left": [1.5, 0.0], "right": [np.pi, 0.0]})
    added = rp.add_motion(plan, "left", [0.0, 0.0], at=0.5)
    assert not added
    assert added.plan is plan
    assert added.blocked_by == ("right",)
    assert "not clear of the final configurations of others" in added.reason
    assert "right" in added.reason


def test_iterations_end_a_search_without_a_limit_of_time(planar2r: rp.Robot) -> None:
    """Posts on either side of a link at its goal, which cannot turn there from anywhere."""
    scene = _facing(planar2r)
    for k, side in enumerate((-1.0, 1.0)):
        scene = scene.with_obstacle(f"post{k}", rp.Cylinder(0.02, 0.2), (-0.6, 0.1 * side, 0.0))
    plan = _at_rest(scene, {"left": [1.5, 0.0], "right": [0.0, 0.0]})
    budget = rp.Budget(seconds=math.inf, iterations=1)
    added = rp.add_motion(plan, "left", [0.0, 0.0], at=0.5, budget=budget, rng=0)
    assert not added
    assert added.reason


def test_iterations_limit_how_often_others_step_aside(monkeypatch: pytest.MonkeyPatch) -> None:
    """An arm that can hardly move is in the way of one that cannot turn past it."""
    robot = rp.load_robot("planar2r_limited")
    pinned = robot.with_limits(replace(robot.limits, lower=np.full(2, -0.05), upper=np.full(2, 0.05)))
    scene = rp.Scene().with_arm("free", robot).with_arm("pinned", pinned, pose([2.4, 0, 0], rpy=[0, 0, np.pi]))
    plan = _at_rest(scene, {"free": [0.8, 0.3], "pinned": [0.0, 0.0]})
    budget, drawn = rp.Budget(seconds=math.inf, iterations=1), []
    for most in (added_motions._STEPS_ASIDE, 1):
        monkeypatch.setattr(added_motions, "_STEPS_ASIDE", most)
        rng = np.random.default_rng(0)
        added = rp.add_motion(plan, "free", [-0.8, 0.0], at=0.5, budget=budget, rng=rng)
        assert added.blocked_by == ("pinned",)
        drawn.append(rng.random())
    assert drawn[0] == drawn[1]


def test_a_tool_reaches_another_one_if_any_of_its_orientations_leaves_room(rr1: rp.Robot) -> None:
    """The first few configurations touch the other arm at its goal."""
    scene = rp.Scene().with_arm("left", rr1, pose([-0.3, 0.0, 0.0], rpy=[0.0, 0.0, np.pi]))
    scene = scene.with_arm("right", rr1, (0.3, 0.0, 0.0))
    aside = rr1.home + np.array([1.4, 0.0, 0.0, 0.0, 0.0, 0.0])
    start, goal = {"left": aside, "right": aside}, {"right": rp.PoseGoal("tool", [0.025, 0.0, 0.2])}
    result = rp.plan_many_arms(rp.Problem(scene, start, goal, arms=["left", "right"]), rng=0)
    there = rp.PoseGoal("tool", [-0.025, 0.0, 0.2])
    added = rp.add_motion(result, "left", there, at=result.makespan, budget=_BUDGET, rng=4)
    assert added.found, added.reason


def test_a_goal_that_cannot_be_is_said(planar2r: rp.Robot, rr1: rp.Robot) -> None:
    plan = _at_rest(_facing(planar2r), {"left": [1.5, 0.0], "right": [np.pi, 0.0]})
    blocked = rp.RunningPlan(
        plan.scene.with_obstacle("post", rp.Cylinder(0.05, 0.2), (-1.2, -0.5, 0.0)), plan.trajectory, plan.parts
    )
    added = rp.add_motion(blocked, "left", [-np.pi / 2, 0.0], at=0.0)
    assert not added
    assert "post" in added.reason
    scene = rp.place_grid(rr1, 1, 2, spacing=0.8)
    far = rp.add_motion(
        rp.plan_many_arms(rp.Problem(scene, None, {arm: scene.arms[arm].q for arm in scene.arms})),
        "arm01",
        rp.PoseGoal("tool", (4.0, 0.0, 0.3)),
        at=0.0,
    )
    assert not far
    assert far.reason.startswith("arm01")


def test_a_goal_behind_a_wall_is_no_proof_for_other_configurations_of_its_pose() -> None:
    robot = rp.load_robot("planar2r_limited")
    scene = rp.Scene().with_arm("arm", robot).with_arm("idle", robot, (5.0, 0.0, 0.0))
    scene = scene.with_obstacle("wall", rp.Box((0.1, 0.02, 0.4)), (0.35, 0.0, 0.0))
    problem = rp.Problem(scene, {"arm": [0.8, 0.0], "idle": [0.5, 0.0]}, {"arm": [1.0, 0.3], "idle": [1.0, 0.0]})
    plan = rp.plan_many_arms(problem, rng=0)
    behind = [-0.8, 0.0]
    tool = rp.PoseGoal("tool", rp.Kinematics(scene, ["arm"]).pose(behind, "arm/tool")[:3, 3])
    for goal, only in ((behind, ""), (tool, "to the goal configurations that were chosen, ")):
        added = rp.add_motion(plan, "arm", goal, at=0.1, budget=Budget(seconds=1.0), rng=0)
        assert not added
        assert added.reason.startswith(f"arm: {only}no path exists: joint 'arm/joint1' cannot pass")


def test_a_joint_without_a_limit_that_only_the_new_goal_moves_is_named(planar2r: rp.Robot) -> None:
    robot = planar2r.with_limits(replace(planar2r.limits, acceleration=np.array([10.0, np.inf])))
    scene = rp.Scene().with_arm("left", robot, (-1.5, 0.0, 0.0)).with_arm("right", planar2r, (1.5, 0.0, 0.0))
    problem = rp.Problem(scene, {"left": [1.0, 1.0], "right": [1.0, 1.0]}, {"left": [2.0, 1.0], "right": [0.0, 1.0]})
    added = rp.add_motion(rp.plan_many_arms(problem, rng=0), "left", [1.5, 0.5], at=0.2, budget=_BUDGET, rng=0)
    assert not added
    assert "'left/joint2' moves and has no acceleration limit" in added.reason


def test_bad_input_is_refused(planar2r: rp.Robot) -> None:
    plan = _at_rest(_facing(planar2r), {"left": [1.5, 0.0], "right": [np.pi, 0.0]})
    with pytest.raises(rp.UnknownNameError, match="middle"):
        rp.add_motion(plan, "middle", [0.0, 0.0], at=0.0)
    with pytest.raises(rp.InputError, match="at is -1"):
        rp.add_motion(plan, "left", [0.0, 0.0], at=-1.0)
    with pytest.raises(rp.InputError, match=r"freeze is -0\.3"):
        rp.add_motion(plan, "left", [0.0, 0.0], at=0.0, freeze=-0.3)
    with pytest.raises(rp.InputError, match="plan is"):
        rp.add_motion("plan", "left", [0.0, 0.0], at=0.0)
    start = {"left": [1.5, 0.0], "right": [np.pi, 0.0]}
    motion = rp.plan_motion(rp.Problem(_facing(planar2r), start, start), planner="many_arms", rng=0)
    with pytest.raises(rp.InputError, match="pass its attribute 'many_arms'"):
        rp.add_motion(motion, "left", [1.0, 0.0], at=0.0)
    with pytest.raises(rp.InputError, match="goal of 'left'"):
        rp.add_motion(plan, "left", [0.0, 0.0, 0.0], at=0.0)
    touching = {"left": [0.0, 0.0], "right": [np.pi, 0.0]}
    nothing = rp.plan_many_arms(rp.Problem(_facing(planar2r), touching, {"left": [1.0, 0.0], "right": [2.0, 0.0]}))
    with pytest.raises(rp.InputError, match="no plan to execute"):
        rp.add_motion(nothing, "left", [0.0, 0.0], at=0.0)
