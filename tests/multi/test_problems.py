"""Seeded problems: their starts and goals are free and apart, and a seed gives the same problem again."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.collision import CollisionChecker
from rr1plan.errors import InputError
from rr1plan.multi import dual_arm_shelf, random_grid, ring_swap

_KINDS: dict[str, Callable[[rp.Robot, int], rp.Problem]] = {
    "grid": lambda robot, seed: random_grid(robot, 6, 0.55, seed),
    "ring": lambda robot, seed: ring_swap(robot, 4, 0.5, rng=seed),
    "shelf": lambda robot, seed: dual_arm_shelf(robot, 0.6, seed),
}


@pytest.mark.parametrize("kind", list(_KINDS))
def test_starts_and_goals_are_free_and_seeded(kind: str, rr1: rp.Robot) -> None:
    problem, again, other = _KINDS[kind](rr1, 3), _KINDS[kind](rr1, 3), _KINDS[kind](rr1, 4)
    checker = CollisionChecker(problem.scene, problem.arms)
    goal = np.concatenate([problem.goal[arm][0].q for arm in problem.arms])
    for q in (problem.start, goal):
        assert checker.is_free_slowly(q)
        assert checker.within_limits(q)
    assert again.start.tobytes() == problem.start.tobytes()
    assert other.start.tobytes() != problem.start.tobytes()


def test_in_a_ring_each_tool_gets_where_the_neighbor_was(rr1: rp.Robot) -> None:
    problem = ring_swap(rr1, 3, 0.5, rng=1)
    ends = []
    for q in (problem.start, np.concatenate([problem.goal[arm][0].q for arm in problem.arms])):
        poses = problem.scene.link_poses(problem.scene.split(q, problem.arms))
        ends.append(np.array([poses[f"{arm}/{rr1.tool}"][:3, 3] for arm in problem.arms]))
    np.testing.assert_allclose(ends[1], np.roll(ends[0], -1, axis=0), atol=1e-3)


def test_problems_that_cannot_be_made_are_refused(rr1: rp.Robot) -> None:
    with pytest.raises(InputError, match="count"):
        random_grid(rr1, 0, 0.8)
    with pytest.raises(InputError, match="radius"):
        ring_swap(rr1, 3, -1.0)
    with pytest.raises(InputError, match="no swap found"):
        ring_swap(rr1, 2, 3.0, rng=0)
    with pytest.raises(InputError, match="no query found"):
        dual_arm_shelf(rr1, 4.0, 0)
