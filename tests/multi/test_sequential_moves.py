"""Groups whose arms move one at a time by way of retreats."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from blocked_arms import goal_configuration, planar_ring, sequential_moves

import rr1plan as rp
from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.hop_timing import joint_times
from rr1plan.multi.search.sequential_moves import SequentialMoves
from rr1plan.multi.search.space_time import SpaceTimeSearch

Check = Callable[..., None]


def _check_path(problem: rp.Problem, points: Array) -> None:
    """From the start to the goal, up to whole turns, and free between by the certificate on Coal's distances."""
    np.testing.assert_array_equal(points[0], problem.start)
    turns = (points[-1] - goal_configuration(problem)) / (2.0 * np.pi)
    np.testing.assert_allclose(turns, turns.round(), atol=1e-12)
    checker = CollisionChecker(problem.scene, problem.arms)
    assert all(checker.edge_is_free_slowly(a, b) for a, b in pairwise(points))


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("count", [3, 5])
def test_arms_that_block_each_other_in_a_cycle_go_by_way_of_retreats(planar2r: rp.Robot, count: int, seed: int) -> None:
    problem = planar_ring(planar2r, count)
    found = list(sequential_moves(problem, seed).paths())
    assert found
    for points in found:
        _check_path(problem, points)
        steps = joint_times(np.diff(points, axis=0), Agent(problem, problem.arms).limits)
        in_turn = steps.reshape(len(steps), count, 2).max(axis=2).sum()
        # Moves overlap, though no two arms can go to their goals at the same time.
        assert steps.max(axis=1).sum() < 0.9 * in_turn


@pytest.mark.parametrize("back", [False, True])
def test_an_arm_withdraws_only_where_none_can_move_to_its_goal(planar2r: rp.Robot, back: bool) -> None:
    scene = rp.Scene()
    for k in range(4):
        scene = scene.with_arm(f"arm{k}", planar2r, (5.0 * k, 0.0, 0.0))
    problem = rp.Problem(scene, {arm: [0.0, 0.0] for arm in scene.arms}, {arm: [1.0, 0.5] for arm in scene.arms})
    begin, end = (goal_configuration(problem), problem.start) if back else (problem.start, goal_configuration(problem))
    moves = sequential_moves(problem, 0)
    checker = CollisionChecker(scene, problem.arms)
    for _ in range(10):
        made = moves._moves_to(checker, begin, end, begin + 0.1)
        assert made is not None
        straight = [points for points in made if len(points) == 2]
        # One move of each arm, and those that withdraw first.
        assert len(straight) == len(made) < 8
        np.testing.assert_array_equal(made[-1][-1], end)


def test_where_some_retreats_are_not_enough_all_arms_withdraw(
    planar2r: rp.Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = planar_ring(planar2r, 4)
    monkeypatch.setattr(SequentialMoves, "_by_some_retreats", lambda *_, **__: None)
    found = list(sequential_moves(problem, 0).paths())
    assert len(found) == 3
    for points in found:
        _check_path(problem, points)


def test_the_same_seed_gives_the_same_moves(planar2r: rp.Robot) -> None:
    first, second = (list(sequential_moves(planar_ring(planar2r, 4), 7).paths()) for _ in range(2))
    assert len(first) == len(second) > 1
    for one, two in zip(first, second, strict=True):
        np.testing.assert_array_equal(one, two)


def test_a_goal_in_contact_is_not_reached(planar2r: rp.Robot) -> None:
    problem = planar_ring(planar2r, 3)
    crossed = dict(zip(problem.arms, np.split(goal_configuration(problem), 3), strict=True))
    crossed["arm0"] = problem.scene.split(problem.start, problem.arms)["arm0"]
    scene = problem.scene.with_obstacle("ball", rp.Sphere(0.1), (0.7, 0.25, 0.0))
    starts = problem.scene.split(problem.start, problem.arms)
    blocked = rp.Problem(scene, starts, crossed)
    assert not CollisionChecker(scene, blocked.arms).is_free(goal_configuration(blocked))
    assert not list(sequential_moves(blocked, 0).paths())


def test_a_deadline_ends_the_search(planar2r: rp.Robot) -> None:
    assert not list(sequential_moves(planar_ring(planar2r, 5), 0, seconds=0.0).paths())


def test_a_ring_that_all_else_leaves_open_is_solved_the_same_way_twice(
    rr1: rp.Robot, assert_safe: Check, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(SpaceTimeSearch, "solve", lambda _: None)
    problem = rp.ring_swap(rr1, 6, 0.5015, 1, 2)
    one, two = (rp.plan_many_arms(problem, rng=2, budget=rp.Budget(seconds=60.0)) for _ in range(2))
    assert_safe(problem, one)
    assert [group.stage for group in one.groups] == ["sequential"]
    assert one.trajectory is not None
    assert two.trajectory is not None
    assert one.trajectory.coefficients.tobytes() == two.trajectory.coefficients.tobytes()
