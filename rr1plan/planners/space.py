"""Where a planner searches: the joints' limits, without a seam where a joint turns without end.

The compiled planners know that a continuous joint wraps (`rrt_connect.c`). For others such joints are
unrolled: plain numbers two turns and a half wide around the start, with every copy of a goal that lies within a turn.
Either way a path may leave over half a turn, does not go the long way round unless it has to, and its waypoints are
joined by the very lines that were certified.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, read_only
from rr1plan.errors import InputError
from rr1plan.kinematics.turns import rotary
from rr1plan.limits import Limits
from rr1plan.problem import Problem
from rr1plan.robot import Robot

_WINDOW = 2.5 * np.pi  # how far from its start an unrolled joint is searched [rad]
_MOST_GOALS = 64  # copies of goals in all


@dataclass(frozen=True, eq=False)
class Space:
    """Bounds of all columns, and which of them can move at all.

    Args:
        lower, upper: Where to search [rad or m], infinite where a column wraps, shape (nq,).
        wraps: Which columns wrap around: whole turns lead to the same place, and there are no limits; shape (nq,).
        continuous: Which columns have no limits, shape (nq,). A joint that a mimic joint follows by half turns is one
            that does not wrap.
    """

    lower: Array
    upper: Array
    wraps: NDArray[np.bool_]
    continuous: NDArray[np.bool_]

    @staticmethod
    def around(problem: Problem, goals: Array) -> Space:
        """The joints' limits.

        Raises:
            InputError: a joint without limits that is not continuous.
        """
        space = joint_space(problem)
        return space._widened(problem, goals, unrolled=space.continuous & ~space.wraps)

    @staticmethod
    def unrolled(problem: Problem, goals: Array) -> Space:
        """The joints' limits, continuous joints as plain numbers around the start.

        Raises:
            InputError: a joint without limits that is not continuous.
        """
        space = joint_space(problem)
        return space._widened(problem, goals, unrolled=space.continuous)

    def _widened(self, problem: Problem, goals: Array, unrolled: NDArray[np.bool_]) -> Space:
        start, wraps = problem.start, self.wraps & ~unrolled
        lower = np.where(unrolled, start - _WINDOW, self.lower)
        upper = np.where(unrolled, start + _WINDOW, self.upper)
        endless = ~np.isfinite(upper - lower) & ~wraps
        if endless.any():
            name = problem.joint_names[int(np.argmax(endless))]
            raise InputError(f"joint {name!r} has no position limits, expected finite ones")
        # The start and goals are within limits up to rounding; a search has no such mercy.
        lower = np.minimum(lower, np.minimum(start, goals.min(axis=0)))
        upper = np.maximum(upper, np.maximum(start, goals.max(axis=0)))
        return Space(lower, upper, wraps, self.continuous)

    @cached_property
    def extent(self) -> Array:
        """How much there is of each column [rad or m], infinite where it wraps, shape (nq,)."""
        return self.upper - self.lower

    @cached_property
    def movable(self) -> NDArray[np.bool_]:
        """Which columns can move, shape (nq,)."""
        return self.lower < self.upper

    @cached_property
    def can_move(self) -> bool:
        """Some column can."""
        return bool(self.movable.any())

    @cached_property
    def is_shared(self) -> bool:
        """All columns have limits or wrap: nothing depends on the start."""
        return bool((np.isfinite(self.extent) | self.wraps).all())

    @cached_property
    def diagonal(self) -> float:
        """Length of the space's diagonal [rad], a continuous joint counted as one turn."""
        extents = np.where(self.continuous, 2.0 * np.pi, self.extent)
        return float(np.sqrt(extents.dot(extents)))

    def reduce(self, q: Array) -> Array:
        """The movable columns."""
        return np.asarray(q[..., self.movable])

    def whole(self, q: Array, still: Array) -> Array:
        """All columns from the movable ones; the others as in `still`, shape (nq,)."""
        if len(still) == q.shape[-1]:
            return q
        full = np.broadcast_to(still, (*q.shape[:-1], len(still))).copy()
        full[..., self.movable] = q
        return full


def joint_space(problem: Problem) -> Space:
    """The limits of a problem's columns as they are; all scenes with the same robots share it."""
    arms = problem.scene.arms
    return _joint_space(tuple([arms[name].robot for name in problem.arms]))


@lru_cache(maxsize=64)
def _joint_space(robots: tuple[Robot, ...]) -> Space:
    limits = Limits.stack([robot.limits for robot in robots])
    continuous = np.concatenate([robot.continuous for robot in robots]) > 0.0
    wraps = continuous & np.concatenate([rotary(robot) for robot in robots])
    return Space(limits.lower, limits.upper, wraps, continuous)


def with_copies(problem: Problem, goals: Array) -> Array:
    """Goals and their copies one turn away where a joint wraps around, nearest to the start first, shape (k, nq)."""
    space = joint_space(problem)
    turns = np.where(goals > problem.start, -2.0 * np.pi, 2.0 * np.pi)
    chosen = _choices(tuple(np.flatnonzero(space.wraps).tolist()), len(problem.start))
    copies = (goals + chosen[:, None] * turns).reshape(-1, len(problem.start))[: 16 * _MOST_GOALS]
    far = np.linalg.norm(copies - problem.start, axis=1)
    return copies[np.argsort(far, kind="stable")[:_MOST_GOALS]]


@lru_cache(maxsize=64)
def _choices(joints: tuple[int, ...], nq: int) -> Array:
    """Ones for the joints that go the other way round: none, each, each two..., shape (k, nq)."""
    sets = (chosen for count in range(len(joints) + 1) for chosen in itertools.combinations(joints, count))
    some = list(itertools.islice(sets, 16 * _MOST_GOALS))
    choices = np.zeros((len(some), nq))
    for row, chosen in zip(choices, some, strict=True):
        row[list(chosen)] = 1.0
    return read_only(choices)
