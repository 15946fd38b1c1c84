"""Other motions of one arm among all others: free, within limits, no slower, and the others unchanged."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.collision.arm_groups import arms_in_reach
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.paths.arm_replanning import ArmReplanner
from rr1plan.multi.paths.path_refinement import PathRefiner
from rr1plan.multi.search.retreats import RetreatSearch
from rr1plan.multi.search.sequential_moves import SequentialMoves
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.path import Path
from rr1plan.retiming.path_blends import clean


def _apart(planar2r: rp.Robot) -> rp.Problem:
    """Three arms that cannot meet."""
    scene = rp.Scene()
    for k in range(3):
        scene = scene.with_arm(f"arm{k}", planar2r, (5.0 * k, 0.0, 0.0))
    start, goal = np.zeros(2), np.array([1.0, 0.5])
    return rp.Problem(scene, dict.fromkeys(scene.arms, start), dict.fromkeys(scene.arms, goal))


def _in_turn(problem: rp.Problem) -> Array:
    """Waypoints on which one arm after the other moves straight to its goal."""
    goal = _goal(problem)
    rows = [problem.start]
    for columns in Agent(problem, problem.arms).columns.values():
        rows.append(rows[-1].copy())
        rows[-1][columns] = goal[columns]
    return np.stack(rows)


def _goal(problem: rp.Problem) -> Array:
    goals = [goal.q for arm in problem.arms for goal in problem.goal[arm] if isinstance(goal, rp.JointGoal)]
    return np.concatenate(goals)


def _slow_path(problem: rp.Problem, seed: int) -> Array:
    """Waypoints of a certified path of arms that block each other."""
    single = {arm: Agent(problem, [arm]) for arm in problem.arms}
    agent, goal, watch = Agent(problem, problem.arms), _goal(problem), Stopwatch(math.inf)
    rng, near = np.random.default_rng(seed), arms_in_reach(problem.scene, problem.arms, 0.0)
    retreats = RetreatSearch(agent, goal, single, near, 0.0, rng, watch)
    return clean(next(SequentialMoves(agent, goal, retreats, 0.0, rng, watch).paths()))


def _edge_times(points: Array, agent: Agent) -> Array:
    """Time that each arm needs for each edge at its velocity limits, shape (edges, arms)."""
    steps = np.abs(np.diff(points, axis=0)) / agent.limits.velocity
    return np.column_stack([steps[:, columns].max(axis=1) for columns in agent.columns.values()])


def _ring(planar2r: rp.Robot, count: int) -> rp.Problem:
    """Arms in a ring that turn past each other."""
    scene, start, goal = rp.Scene(), {}, {}
    for k in range(count):
        angle = 2.0 * np.pi * k / count
        scene = scene.with_arm(f"arm{k}", planar2r, (1.7 * np.cos(angle), 1.7 * np.sin(angle), 0.0))
        start[f"arm{k}"], goal[f"arm{k}"] = [angle + np.pi + 0.35, 0.0], [angle + np.pi - 0.35, 0.0]
    return rp.Problem(scene, start, goal)


def _unchanged_arms(before: Array, after: Array, agent: Agent) -> int:
    """Number of arms that pass through all of their waypoints before, in the same order, along straight lines."""
    count = 0
    for columns in agent.columns.values():
        old, new = clean(before[:, columns]), clean(after[:, columns])
        count += old.shape == new.shape and bool(np.allclose(old, new, atol=1e-9))
    return count


@pytest.mark.parametrize("robot", ["planar2r", "rr1"])
def test_replanned_paths_are_free_and_no_slower(request: pytest.FixtureRequest, robot: str) -> None:
    given: rp.Robot = request.getfixturevalue(robot)
    problem = _ring(given, 4) if robot == "planar2r" else rp.ring_swap(given, 4, 0.5015, rng=3)
    points, agent = _slow_path(problem, 0), Agent(problem, problem.arms)
    checker, rng = CollisionChecker(problem.scene, problem.arms), np.random.default_rng(1)
    replanner, before, found = ArmReplanner(agent, checker), _edge_times(points, agent).max(axis=1).sum(), 0
    for _ in range(60):
        made = replanner.replanned(points, rng)
        if made is None:
            continue
        found += 1
        np.testing.assert_array_equal(made[[0, -1]], points[[0, -1]])
        assert (made >= agent.limits.lower).all()
        assert (made <= agent.limits.upper).all()
        assert _edge_times(made, agent).max(axis=1).sum() <= before * (1.0 + 1e-9)
        assert _unchanged_arms(points, made, agent) >= len(problem.arms) - 1
        # By Coal's distances, for all pairs.
        assert all(checker.edge_is_free_slowly(a, b) for a, b in pairwise(clean(made)))
    assert found >= 5


def test_an_arm_moves_while_the_others_do(planar2r: rp.Robot) -> None:
    problem = _apart(planar2r)
    agent, points = Agent(problem, problem.arms), _in_turn(problem)
    replanner = ArmReplanner(agent, CollisionChecker(problem.scene, problem.arms))
    made = replanner.replanned(points, np.random.default_rng(0))
    assert made is not None
    times = _edge_times(points, agent)
    # The arm that was taken out needs no time of its own; up to the random duration, below 0.9.
    assert _edge_times(made, agent).max(axis=1).sum() <= 0.9 * times.sum()
    assert _unchanged_arms(points, made, agent) == 3


def test_an_arm_waits_until_another_one_has_passed(planar2r: rp.Robot, assert_free: Callable[..., None]) -> None:
    # Each sweeps the start of the other: "left" first turns away, then "right" goes through where it was.
    scene = rp.Scene().with_arm("left", planar2r, (-1.2, 0.0, 0.0)).with_arm("right", planar2r, (1.2, 0.0, 0.0))
    problem = rp.Problem(
        scene, {"left": [0.0, 0.0], "right": [np.pi - 1.2, 0.0]}, {"left": [1.4, 0.0], "right": [np.pi + 0.6, 0.0]}
    )
    agent, points = Agent(problem, problem.arms), _in_turn(problem)
    checker, rng = CollisionChecker(scene, problem.arms), np.random.default_rng(0)
    assert_free(checker, points)
    assert not checker.edge_is_free(points[0], points[-1])
    faster = [made for _ in range(40) if (made := ArmReplanner(agent, checker).replanned(points, rng)) is not None]
    assert faster
    for made in faster:
        assert_free(checker, clean(made))
    durations = [_edge_times(made, agent).max(axis=1).sum() for made in faster]
    assert min(durations) < 0.95 * _edge_times(points, agent).sum()


@pytest.fixture
def assert_free() -> Callable[[CollisionChecker, Array], None]:
    def check(checker: CollisionChecker, points: Array) -> None:
        assert all(checker.edge_is_free_slowly(a, b) for a, b in pairwise(points))

    return check


def test_an_arm_that_moves_alone_is_not_replanned(planar2r: rp.Robot) -> None:
    problem = _apart(planar2r)
    goals = {arm: [1.0, 0.5] if arm == "arm1" else [0.0, 0.0] for arm in problem.arms}
    problem = rp.Problem(problem.scene, problem.scene.split(problem.start, problem.arms), goals)
    agent = Agent(problem, problem.arms)
    replanner = ArmReplanner(agent, CollisionChecker(problem.scene, problem.arms))
    points = np.stack([problem.start, _goal(problem)])
    found = [replanner.replanned(points, np.random.default_rng(seed)) for seed in range(20)]
    # Without it nothing moves, and all others stand still.
    assert all(made is None or _unchanged_arms(points, made, agent) == 3 for made in found)


def test_the_same_random_numbers_give_the_same_motion(planar2r: rp.Robot) -> None:
    problem = _ring(planar2r, 4)
    points, agent = _slow_path(problem, 1), Agent(problem, problem.arms)
    answers = []
    for _ in range(2):
        replanner = ArmReplanner(agent, CollisionChecker(problem.scene, problem.arms))
        rng = np.random.default_rng(7)
        made = [replanner.replanned(points, rng) for _ in range(10)]
        answers.append(b"".join(b"none" if one is None else one.tobytes() for one in made))
    assert answers[0] == answers[1]
    assert set(answers[0]) != set(b"none")


def test_refined_motions_overlap_where_arms_moved_in_turn(planar2r: rp.Robot) -> None:
    problem = _apart(planar2r)
    agent = Agent(problem, problem.arms)
    checker = CollisionChecker(problem.scene, problem.arms)
    path = AgentPath(agent, Path(agent.joint_names, _in_turn(problem)), checker)
    refined = PathRefiner(checker, np.random.default_rng(0)).refine(path, lambda: True)
    alone = AgentPath(agent, Path(agent.joint_names, np.stack([problem.start, _goal(problem)])), checker)
    assert path.fastest > 2.0 * alone.fastest
    assert refined.fastest < 1.1 * alone.fastest
