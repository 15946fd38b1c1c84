"""Deadlocks: arms in a plane that can only pass in turn, so that no order of priorities solves them."""

from __future__ import annotations

from collections.abc import Callable
from itertools import permutations

import numpy as np
import pytest

import rr1plan as rp
from rr1plan import plan_many_arms
from rr1plan.collision import CollisionChecker
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.paths.path_pool import PathPool
from rr1plan.multi.search.coupled_windows import CoupledWindows
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.multi.timing.coordination import coordination_diagram
from rr1plan.multi.timing.safe_intervals import blocked_times, earliest_schedule
from rr1plan.multi.timing.schedule import Schedule, extended
from rr1plan.planning import Budget

_BUDGET = Budget(seconds=60.0)
Check = Callable[..., None]


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


def _cycle(planar2r: rp.Robot, count: int = 3, radius: float = 1.3) -> rp.Problem:
    """Arms in a ring, all tilted one way; each goal, tilted the other way, crosses the next one's start."""
    scene = rp.Scene()
    start, goal = {}, {}
    for k in range(count):
        angle = 2.0 * np.pi * k / count
        name = f"arm{k}"
        scene = scene.with_arm(name, planar2r, (radius * np.cos(angle), radius * np.sin(angle), 0.0))
        start[name], goal[name] = [angle + np.pi + 0.35, 0.0], [angle + np.pi - 0.35, 0.0]
    return rp.Problem(scene, start, goal)


def _idle(planar2r: rp.Robot) -> rp.Problem:
    """An arm without a goal blocks the path of another arm."""
    scene = rp.Scene().with_arm("left", planar2r, (-1.2, 0.0, 0.0)).with_arm("idle", planar2r, (-0.6, 1.5, 0.0))
    scene = scene.with_obstacle("wall", rp.Box((0.1, 3.0, 0.2)), (-1.5, 0.0, 0.0))
    start = {"left": [1.3, 0.3], "idle": [-np.pi / 2, 0.0]}
    return rp.Problem(scene, start, {"left": [-0.9, 0.5]}, arms=["left", "idle"])


def _retreat(planar2r: rp.Robot) -> rp.Problem:
    """One sweeps across start and goal of the other, which has to back up beyond its start before it can proceed."""
    scene = _facing(planar2r).with_obstacle("wall", rp.Box((0.1, 1.6, 0.2)), (1.7, 0.0, 0.0))
    start = {"left": [0.2, 0.0], "right": [np.pi - 0.9, 0.0]}
    return rp.Problem(scene, start, {"left": [-0.5, 0.0], "right": [np.pi + 0.9, 0.0]})


_DEADLOCKS = {"swap": _swap, "goals": _goals_in_the_way, "cycle": _cycle, "idle": _idle, "retreat": _retreat}


def _pools(problem: rp.Problem) -> dict[str, PathPool]:
    pools = {arm: PathPool(Agent(problem, [arm]), 0.0, np.random.default_rng(0)) for arm in problem.arms}
    for arm, pool in pools.items():
        path, reason = pool.add({})
        assert path is not None, f"{arm}: {reason}"
    return pools


def _prioritized(paths: dict[str, AgentPath], order: tuple[str, ...]) -> bool:
    """Plain prioritized planning: each arm on its path, given the schedules of the arms before it."""
    done: list[Schedule] = []
    for arm in order:
        diagrams = [(coordination_diagram(paths[arm], other.path), other) for other in done]
        others = [(extended(d), other.occupancy) for d, other in diagrams if d is not None]
        schedule = earliest_schedule(paths[arm], blocked_times(others))
        if schedule is None:
            return False
        done.append(schedule)
    return True


@pytest.mark.parametrize("name", list(_DEADLOCKS))
def test_no_order_of_priorities_solves_them(name: str, planar2r: rp.Robot) -> None:
    problem = _DEADLOCKS[name](planar2r)
    paths = {arm: pool.paths[0] for arm, pool in _pools(problem).items()}
    assert not any(_prioritized(paths, order) for order in permutations(problem.arms))


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("name", list(_DEADLOCKS))
def test_they_are_solved_and_the_stage_is_named(name: str, seed: int, planar2r: rp.Robot, assert_safe: Check) -> None:
    problem = _DEADLOCKS[name](planar2r)
    result = plan_many_arms(problem, rng=seed, budget=_BUDGET)
    assert_safe(problem, result)
    stages = {group.stage for group in result.groups if len(group.arms) > 1}
    assert stages
    assert stages <= {"detours", "eviction", "space-time", "composite", "windows"}


def test_a_cycle_of_many_arms_is_solved_by_windows(planar2r: rp.Robot, assert_safe: Check) -> None:
    problem = _cycle(planar2r, 5, 1.7)
    result = plan_many_arms(problem, rng=0, budget=_BUDGET)
    assert_safe(problem, result)
    assert [group.stage for group in result.groups] == ["windows"]
    assert result.groups[0].statistics.windows > 0


@pytest.mark.parametrize("name", list(_DEADLOCKS))
def test_windows_alone_resolve_every_conflict(name: str, planar2r: rp.Robot) -> None:
    problem = _DEADLOCKS[name](planar2r)
    alone = {arm: pool.paths[0].path.waypoints for arm, pool in _pools(problem).items()}
    windows = CoupledWindows(alone, lambda arms: Agent(problem, arms), 0.0, np.random.default_rng(0), Stopwatch(60.0))
    assert windows.solve(4)
    assert windows.windows > 0
    assert windows.coupled_sets() == [problem.arms]
    path = windows.path(problem.arms)
    np.testing.assert_array_equal(path.waypoints[0], problem.start)
    # Joints that wrap may end some turns farther.
    turns = (path.waypoints[-1] - np.concatenate([problem.goal[arm][0].q for arm in problem.arms])) / (2.0 * np.pi)
    np.testing.assert_allclose(turns, turns.round(), atol=1e-12)
    checker = CollisionChecker(problem.scene, problem.arms)
    assert all(checker.is_free_slowly(q) for q in path.sample(0.02))


def test_arms_without_conflicts_keep_their_paths_in_windows(planar2r: rp.Robot) -> None:
    scene = rp.Scene().with_arm("left", planar2r, (-4.0, 0.0, 0.0)).with_arm("right", planar2r, (4.0, 0.0, 0.0))
    problem = rp.Problem(scene, {"left": [0.0, 0.0], "right": [0.0, 0.0]}, {"left": [1.0, 0.5], "right": [2.0, 0.0]})
    alone = {arm: pool.paths[0].path.waypoints for arm, pool in _pools(problem).items()}
    windows = CoupledWindows(alone, lambda arms: Agent(problem, arms), 0.0, np.random.default_rng(0), Stopwatch(60.0))
    assert windows.solve(0)
    assert windows.windows == 0
    assert windows.coupled_sets() == [("left",), ("right",)]
    for arm, waypoints in alone.items():
        np.testing.assert_array_equal(windows.path([arm]).waypoints, waypoints)
