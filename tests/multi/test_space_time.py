"""Arms planned one after the other in space and time: free by Coal's distances, and as fast as their joints allow."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from blocked_arms import goal_configuration, planar_ring

import rr1plan as rp
from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.arm_replanning import search_in_time
from rr1plan.multi.paths.nominal_clock import Track
from rr1plan.multi.search.space_time import SpaceTimeSearch
from rr1plan.multi.stopwatch import Stopwatch


def _search(problem: rp.Problem, rng: int, seconds: float = math.inf) -> SpaceTimeSearch:
    agent, goal = Agent(problem, problem.arms), goal_configuration(problem)
    paths = {arm: np.stack([problem.start[own], goal[own]]) for arm, own in agent.columns.items()}
    return SpaceTimeSearch(agent, paths, 0.0, np.random.default_rng(rng), Stopwatch(seconds))


def _duration(points: Array, problem: rp.Problem) -> float:
    """Duration at the velocity limits, each edge as long as its slowest joint needs [s]."""
    return float((np.abs(np.diff(points, axis=0)) / Agent(problem, problem.arms).limits.velocity).max(axis=1).sum())


@pytest.mark.parametrize("robot", ["planar2r", "rr1"])
def test_arms_avoid_those_before_them(request: pytest.FixtureRequest, robot: str) -> None:
    given: rp.Robot = request.getfixturevalue(robot)
    problem = planar_ring(given, 2) if robot == "planar2r" else rp.ring_swap(given, 6, 0.5015, rng=3)
    checker, limits = CollisionChecker(problem.scene, problem.arms), Agent(problem, problem.arms).limits
    ends = np.stack([problem.start, goal_configuration(problem)])
    assert not checker.edge_is_free_slowly(*ends)
    found = 0
    for seed in range(3):
        points = _search(problem, seed).solve()
        if points is None:
            continue
        found += 1
        np.testing.assert_allclose(points[[0, -1]], ends, atol=1e-12)
        assert (points >= limits.lower).all()
        assert (points <= limits.upper).all()
        assert all(checker.edge_is_free_slowly(a, b) for a, b in pairwise(points))
        assert _duration(points, problem) < 2.5 * _duration(ends, problem)
    assert found


def test_arms_that_are_left_out_are_ignored(planar2r: rp.Robot) -> None:
    scene = rp.Scene().with_arm("left", planar2r, (-1.2, 0.0, 0.0)).with_arm("right", planar2r, (1.2, 0.0, 0.0))
    # The left arm sweeps through the right one, which points at it and does not move.
    problem = rp.Problem(
        scene, {"left": [-1.0, 0.0], "right": [np.pi, 0.0]}, {"left": [1.0, 0.0], "right": [np.pi, 0.0]}
    )
    agent = Agent(problem, problem.arms)
    track = Track(np.array([0.0, 2.0]), np.stack([problem.start, goal_configuration(problem)]))
    checker, own = CollisionChecker(scene, problem.arms), agent.columns["left"]
    left_out = np.zeros(4, np.uint8)
    left_out[agent.columns["right"]] = 1
    answers = [
        search_in_time(checker, track, own, agent.limits, np.random.default_rng(0), samples=0, left_out=flags)
        for flags in (None, left_out)
    ]
    assert answers[0] is None
    assert answers[1] is not None
    np.testing.assert_array_equal(answers[1].times, track.times)
    np.testing.assert_array_equal(answers[1].points, track.points[:, own])
    # Its own links and obstacles still count, and so do all pairs of later certificates.
    assert not checker.edge_is_free(*track.points)
    walled = scene.with_obstacle("wall", rp.Box((0.1, 0.1, 1.0)), (-0.5, 0.0, 0.0))
    checker = CollisionChecker(walled, problem.arms)
    given = checker, track, own, agent.limits, np.random.default_rng(0)
    assert search_in_time(*given, samples=0, left_out=left_out) is None


def test_the_same_seed_gives_the_same_motion(planar2r: rp.Robot) -> None:
    problem = planar_ring(planar2r, 2)
    one, two = (_search(problem, 5).solve() for _ in range(2))
    assert one is not None
    assert two is not None
    assert one.tobytes() == two.tobytes()


def test_a_long_search_looks_at_the_clock(planar2r: rp.Robot) -> None:
    scene = rp.Scene().with_arm("left", planar2r, (-1.2, 0.0, 0.0)).with_arm("right", planar2r, (1.2, 0.0, 0.0))
    # The right arm, which does not move, points at the left one's goal.
    problem = rp.Problem(
        scene, {"left": [-1.0, 0.0], "right": [np.pi, 0.0]}, {"left": [0.0, 0.0], "right": [np.pi, 0.0]}
    )
    agent, points = Agent(problem, problem.arms), np.stack([problem.start, goal_configuration(problem)])
    checker, looks = CollisionChecker(scene, problem.arms), []

    def goes_on() -> bool:
        looks.append(None)
        return len(looks) < 3

    given = checker, Track(np.array([0.0, 20.0]), points), agent.columns["left"], agent.limits, np.random.default_rng(0)
    assert search_in_time(*given, samples=10_000, goes_on=goes_on) is None
    assert len(looks) == 3


def test_nothing_is_searched_after_the_deadline(planar2r: rp.Robot) -> None:
    assert _search(planar_ring(planar2r, 2), 0, 0.0).solve() is None


def test_the_stage_of_a_ring_is_named(rr1: rp.Robot) -> None:
    problem = rp.ring_swap(rr1, 6, 0.5015, rng=3)
    result = rp.plan_many_arms(problem, rng=0)
    assert [group.stage for group in result.groups] == ["space-time"]
    assert result.trajectory is not None
    assert rp.validate(result.trajectory, problem.scene, problem).certified


def test_arms_that_already_are_at_their_goals_stay_there(planar2r: rp.Robot) -> None:
    problem = planar_ring(planar2r, 3)
    stationary = rp.Problem(problem.scene, problem.start, problem.scene.split(problem.start))
    assert _search(stationary, 0).solve() is None  # there is no motion to search for
    result = rp.plan_many_arms(stationary, rng=0)
    assert result.found
    assert result.makespan == 0.0
