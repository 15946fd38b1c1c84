"""Where a planner searches: the joints' limits, continuous joints unrolled.

Continuous joints are searched as plain numbers two turns and a half wide around the start, with every copy
of a goal that lies within a turn: a path may leave through any seam, does not go the long way round unless it
has to, and its waypoints are joined by the very lines that were certified.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.errors import InputError
from rr1plan.problem import Problem

_WINDOW = 2.5 * np.pi  # how far from its start a continuous joint is searched [rad]
_MOST_GOALS = 64  # copies of goals in all


@dataclass(frozen=True, eq=False)
class Space:
    """Bounds of all columns, and which of them can move at all.

    Args:
        lower, upper: Where to search [rad or m], shape (nq,).
        continuous: Which columns wrap around, shape (nq,).
        still: The start, whose columns that cannot move keep their value, shape (nq,).
    """

    lower: Array
    upper: Array
    continuous: NDArray[np.bool_]
    still: Array

    @staticmethod
    def around(problem: Problem, goals: Array) -> Space:
        """The joints' limits, continuous joints unrolled around the start.

        Raises:
            InputError: a joint without limits that is not continuous.
        """
        start = problem.start
        lower, upper, continuous = _limits(problem)
        if continuous.any():
            lower = np.where(continuous, start - _WINDOW, lower)
            upper = np.where(continuous, start + _WINDOW, upper)
        if not (np.isfinite(lower).all() and np.isfinite(upper).all()):
            j = int(np.flatnonzero(~np.isfinite(lower) | ~np.isfinite(upper))[0])
            raise InputError(f"joint {problem.joint_names[j]!r} has no position limits, expected finite ones")
        # The start and goals are within limits up to rounding; a search has no such mercy.
        lower = np.minimum(lower, np.minimum(start, goals.min(axis=0)))
        upper = np.maximum(upper, np.maximum(start, goals.max(axis=0)))
        return Space(lower, upper, continuous, start)

    @cached_property
    def movable(self) -> NDArray[np.bool_]:
        """Which columns can move, shape (nq,)."""
        return self.lower < self.upper

    @property
    def diagonal(self) -> float:
        """Length of the space's diagonal [rad], a continuous joint counted as one turn."""
        extents = np.where(self.continuous, 2.0 * np.pi, self.upper - self.lower)
        return float(np.sqrt(extents.dot(extents)))

    def reduce(self, q: Array) -> Array:
        """The movable columns."""
        return np.asarray(q[..., self.movable])

    def whole(self, q: Array) -> Array:
        """All columns from the movable ones."""
        if len(self.still) == q.shape[-1]:
            return q
        full = np.broadcast_to(self.still, (*q.shape[:-1], len(self.still))).copy()
        full[..., self.movable] = q
        return full


def _limits(problem: Problem) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Lower and upper limits of a problem's columns, and which of them wrap around."""
    robots = [problem.scene.arms[name].robot for name in problem.arms]
    if len(robots) == 1:
        return robots[0].limits.lower, robots[0].limits.upper, robots[0].continuous > 0.0
    return (
        np.concatenate([r.limits.lower for r in robots]),
        np.concatenate([r.limits.upper for r in robots]),
        np.concatenate([r.continuous for r in robots]) > 0.0,
    )


def continuous_joints(problem: Problem) -> NDArray[np.bool_]:
    """Which columns of a problem wrap around, shape (nq,) of bool."""
    return _limits(problem)[2]


def with_copies(problem: Problem, goals: Array) -> Array:
    """Goals and their copies one turn away where a joint is continuous, nearest to the start first, shape (k, nq)."""
    joints = np.flatnonzero(continuous_joints(problem)).astype(np.int64)
    if len(goals) == 1 and len(joints) == 0:
        return goals
    copies = np.array(list(itertools.islice(_copies(goals, problem.start, joints), 16 * _MOST_GOALS)))
    far = np.linalg.norm(copies - problem.start, axis=1)
    return copies[np.argsort(far, kind="stable")[:_MOST_GOALS]]


def _copies(goals: Array, start: Array, joints: NDArray[np.int64]) -> Iterator[Array]:
    """Each goal, then with ever more of its continuous joints taken the other way round."""
    turns = np.where(goals[:, joints] > start[joints], -2.0 * np.pi, 2.0 * np.pi)
    for count in range(len(joints) + 1):
        for chosen in itertools.combinations(range(len(joints)), count):
            for goal, turn in zip(goals, turns, strict=True):
                copy = goal.copy()
                copy[joints[list(chosen)]] += turn[list(chosen)]
                yield copy
