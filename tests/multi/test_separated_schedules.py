"""Arms that were planned as one get separate schedules: the motion stays, and their order is certified or rejected."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.collision import CollisionChecker
from rr1plan.multi.agents import Agent
from rr1plan.multi.execution.separated_schedules import separate
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.search.space_time import SpaceTimeSearch
from rr1plan.multi.timing.passing_order import (
    SIMULTANEOUS,
    agreed_diagram,
    cell_gaps,
    closed_diagram,
    first_order,
    order_between,
    shared_cells,
    simultaneous_cells,
)
from rr1plan.multi.timing.schedule import Leg, Schedule
from rr1plan.path import Path

_SLIDER = """
<robot name="{name}">
  <link name="base"/>
  <link name="carriage">{solids}</link>
  <joint name="slide" type="prismatic">
    <parent link="base"/><child link="carriage"/><axis xyz="1 0 0"/>
    <limit lower="-2" upper="2" velocity="1" effort="10"/>
  </joint>
</robot>
"""
_SOLID = '<collision><origin xyz="{x} 0 0"/><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'


def _slider(folder, name: str, *places: float) -> rp.Robot:
    file = folder / f"{name}.urdf"
    file.write_text(_SLIDER.format(name=name, solids="".join(_SOLID.format(x=x) for x in places)))
    limits = rp.Limits([-2.0], [2.0], [1.0], [2.0], [20.0], [10.0])
    return rp.load_robot(file).with_limits(limits)


def _pushed_along(folder, gap: float) -> Schedule:
    """A block that moves between the prongs of a fork, which moves along, by one timing; with a way back."""
    scene = rp.Scene().with_arm("block", _slider(folder, "block", 0.0))
    scene = scene.with_arm("fork", _slider(folder, "fork", -0.1 - gap, 0.1 + gap))
    problem = rp.Problem(scene, {"block": [0.0], "fork": [0.0]}, {"block": [1.0], "fork": [1.0]})
    agent = Agent(problem, problem.arms)
    waypoints = np.array([[0.0, 0.0], [1.0, 1.0]])
    path = AgentPath(agent, Path(agent.joint_names, waypoints), CollisionChecker(scene, problem.arms))
    middle = path.stops[6]
    there = path.hop_duration(0, middle)
    back = there + 0.5 + path.hop_duration(middle, path.stops[2])
    return Schedule(
        path, (Leg(0.0, 0, middle), Leg(there + 0.5, middle, path.stops[2]), Leg(back, path.stops[2], path.segments))
    )


@pytest.mark.parametrize("gap", [0.05, 0.02])
def test_arms_that_move_along_have_an_order_if_there_is_room(gap: float, tmp_path) -> None:
    whole = _pushed_along(tmp_path, gap)
    separated = separate([whole]).schedules
    assert [schedule.arms for schedule in separated] == [("block",), ("fork",)]
    joint = whole.trajectory()
    for schedule in separated:
        motion = schedule.trajectory()
        at = np.linspace(0.0, joint.end_time, 500)
        np.testing.assert_array_equal(motion(at), joint.select(schedule.arms[0])(at))
        for leg in schedule.legs:
            times, gridpoints = schedule.instants(leg), range(leg.begin, leg.end + 1)
            places = [schedule.path.at(k) for k in gridpoints]
            np.testing.assert_allclose(motion(times), places, atol=1e-9)
        assert schedule.arrival == pytest.approx(whole.arrival)
        assert schedule.waiting == pytest.approx(0.5)


def test_arms_without_room_between_them_stay_together(tmp_path) -> None:
    whole = _pushed_along(tmp_path, 2e-6)
    (schedule,) = separate([whole]).schedules
    assert schedule is whole


def test_separated_plans_keep_their_motion(rr1: rp.Robot) -> None:
    problem = rp.ring_swap(rr1, 8, 0.6, rng=0)
    result = rp.plan_many_arms(problem, rng=0, budget=rp.Budget(seconds=60.0))
    assert result.trajectory is not None
    assert any(len(schedule.arms) > 1 for schedule in result.schedules)
    assert result.inseparable == ()
    at = np.linspace(0.0, result.makespan, 300)
    for schedule in result.separated.schedules:
        (arm,) = schedule.arms
        np.testing.assert_allclose(schedule.trajectory()(at), result.trajectory.select(arm)(at), atol=1e-12)
        np.testing.assert_allclose(schedule.path.goal, result.trajectory.select(arm)(result.makespan), atol=1e-9)
        assert schedule.path.fastest <= schedule.arrival + 1e-9
    motion = rp.plan_motion(problem, rng=0, budget=rp.Budget(seconds=60.0))
    for one, two in (("arm01", "arm02"), ("arm03", "arm07")):
        assert motion.coordination_diagram(one, two).names == (one, two)


def test_an_execution_says_for_whom_arms_wait(rr1: rp.Robot) -> None:
    problem = rp.ring_swap(rr1, 4, 0.5, rng=1)
    graph = rp.plan_graph(rp.plan_many_arms(problem, rng=0, budget=rp.Budget(seconds=60.0)))
    late = rp.execute_plan(graph, problem.scene, {"arm02": rp.ArmDelay(start=2.0)})
    own = [wait for wait in late.waits if wait.arm == "arm02"]
    assert (own[0].begin, own[0].others) == (0.0, ())
    assert own[0].end >= 2.0
    others = [wait for wait in late.waits if "arm02" in wait.others]
    assert others
    for wait in late.waits:
        speeds = late.trajectory.select(wait.arm)(np.linspace(wait.begin, wait.end, 9)[1:-1], 1)
        assert np.abs(speeds).max() == 0.0
        assert all(graph.waits_for(wait.arm) for _ in wait.others)
    line = rp.timeline(late.trajectory, problem.scene, waits=late.waits)
    assert line.waits


def test_arms_of_different_agents_have_an_order_too(rr1: rp.Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(SpaceTimeSearch, "solve", lambda _: None)  # which makes one agent of all arms
    problem = rp.ring_swap(rr1, 8, 0.6, rng=2)
    result = rp.plan_many_arms(problem, rng=2, budget=rp.Budget(seconds=60.0))
    assert result.trajectory is not None
    assert sum(len(schedule.arms) > 1 for schedule in result.schedules) > 1
    at = np.linspace(0.0, result.makespan, 300)
    for schedule in result.separated.schedules:
        (arm,) = schedule.arms
        np.testing.assert_allclose(schedule.trajectory()(at), result.trajectory.select(arm)(at), atol=1e-12)
    graph = rp.plan_graph(result)
    late = rp.execute_plan(graph, problem.scene, {"arm04": rp.ArmDelay(start=0.5), "arm05": rp.ArmDelay(slowdown=0.3)})
    assert rp.validate(late.trajectory, problem.scene, problem).certified


def test_orders_at_one_instant_are_those_of_whole_diagrams(rr1: rp.Robot) -> None:
    decided = set()
    for seed in (1, 2):
        problem = rp.ring_swap(rr1, 4, 0.5, 2, seed)
        result = rp.plan_many_arms(problem, rng=seed, budget=rp.Budget(seconds=20.0))
        schedules = separate(result.schedules).schedules
        for one, two in combinations(schedules, 2):
            gaps = cell_gaps(one.occupancy, two.occupancy)
            for margin in (0.05, 0.0):
                whole = closed_diagram(one.path, two.path, margin)
                part = simultaneous_cells(one, two, margin)
                if whole is None:
                    assert part is None
                    continue
                part = np.zeros_like(whole) if part is None else part
                expected, found = (shared_cells(blocked, one, two) for blocked in (whole, part))
                np.testing.assert_array_equal(found[gaps <= SIMULTANEOUS], expected[gaps <= SIMULTANEOUS])
                orders = [order_between(blocked, one, two) for blocked in (whole, part)]
                assert (orders[0] is None) == (orders[1] is None)
                decided.add(orders[0] is None)
            agreed = agreed_diagram(one, two)
            assert (first_order(one, two) is None) == (agreed is not None and order_between(agreed, one, two) is None)
    assert decided == {True, False}
