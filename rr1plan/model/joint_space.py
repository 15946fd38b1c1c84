"""Search spaces: joint limits, and the treatment of continuous joints.

The compiled planners wrap continuous joints (`rrt_connect.c`). For other planners these joints are unrolled: real
intervals of two and a half turns around the start, with all copies of a goal within one turn. In both cases
a path may cross half a turn, goes the shorter way round if that is free, and consists of the straight lines that
were certified. Revolute joints with a wide range are bounded likewise for other planners; the compiled ones widen their
search.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, read_only
from rr1plan.errors import InputError
from rr1plan.kernels.planner_kernels import constants
from rr1plan.model.joint_turns import TURN, rotary
from rr1plan.robot import Robot
from rr1plan.robot.joint_limits import Limits
from rr1plan.scene import Scene
from rr1plan.scene.problem import Problem

_WINDOW = 2.5 * np.pi  # half the width of the interval of an unrolled joint [rad]
_MOST_GOALS = 64  # most goals including copies, or copies of one goal


@dataclass(frozen=True, eq=False)
class Space:
    """Bounds and topology of all columns of q.

    Args:
        lower, upper: Bounds [rad or m], infinite for columns that wrap, shape (nq,).
        wraps: Columns without limits that are equivalent modulo 2 pi, shape (nq,).
        continuous: Columns without limits, shape (nq,). A continuous joint that a mimic joint follows by half turns
            does not wrap.
        rotary: Columns that are equivalent modulo 2 pi within their limits, shape (nq,).
    """

    lower: Array
    upper: Array
    wraps: NDArray[np.bool_]
    continuous: NDArray[np.bool_]
    rotary: NDArray[np.bool_]

    @staticmethod
    def around(problem: Problem, goals: Array) -> Space:
        """The joints' limits.

        Raises:
            InputError: a joint without limits that is not continuous.
        """
        space = joint_space(problem.scene, problem.arms)
        return space._widened(problem, goals, unrolled=space.continuous & ~space.wraps)

    @staticmethod
    def unrolled(problem: Problem, goals: Array) -> Space:
        """The joints' limits, continuous joints as plain numbers around the start, wide ranges around start and goals.

        Raises:
            InputError: a joint without limits that is not continuous.
        """
        space = joint_space(problem.scene, problem.arms)
        ends = np.vstack([problem.start, goals])
        return space.bounded_near(ends)._widened(problem, goals, unrolled=space.continuous)

    def bounded_near(self, configurations: Array) -> Space:
        """The space with wide ranges of turning joints bounded to one and a quarter turns of configurations.

        Args:
            configurations: Configurations [rad or m], shape (k, nq), k >= 1.
        """
        bounded = self.is_wide
        if not bounded.any():
            return self
        low, high = configurations.min(axis=0) - _WINDOW, configurations.max(axis=0) + _WINDOW
        lower = np.where(bounded, np.maximum(self.lower, low), self.lower)
        upper = np.where(bounded, np.minimum(self.upper, high), self.upper)
        return Space(lower, upper, self.wraps, self.continuous, self.rotary)

    def _widened(self, problem: Problem, goals: Array, unrolled: NDArray[np.bool_]) -> Space:
        start, wraps = problem.start, self.wraps & ~unrolled
        lower = np.where(unrolled, start - _WINDOW, self.lower)
        upper = np.where(unrolled, start + _WINDOW, self.upper)
        Space(lower, upper, wraps, self.continuous, self.rotary).check_bounded(problem.joint_names)
        # The start and goals satisfy the limits up to rounding; a planner requires them exactly.
        lower = np.minimum(lower, np.minimum(start, goals.min(axis=0)))
        upper = np.maximum(upper, np.maximum(start, goals.max(axis=0)))
        return Space(lower, upper, wraps, self.continuous, self.rotary)

    @cached_property
    def extent(self) -> Array:
        """Width of each column [rad or m], infinite for columns that wrap, shape (nq,)."""
        return self.upper - self.lower

    @cached_property
    def is_wide(self) -> NDArray[np.bool_]:
        """Mask of the turning columns with a range of many turns, of which paths need few, shape (nq,)."""
        return self.rotary & ~self.continuous & (self.extent > constants()["WIDE_TURNS"] * TURN)

    @cached_property
    def movable(self) -> NDArray[np.bool_]:
        """Mask of the columns that can move, shape (nq,)."""
        return self.lower < self.upper

    @cached_property
    def can_move(self) -> bool:
        """Whether any column can move."""
        return bool(self.movable.any())

    @cached_property
    def is_shared(self) -> bool:
        """Whether all columns have limits or wrap, so that the bounds do not depend on the start."""
        return bool((np.isfinite(self.extent) | self.wraps).all())

    def check_bounded(self, joint_names: Sequence[str]) -> None:
        """Raise if a column neither has limits nor wraps.

        Raises:
            InputError: such a column, by its name.
        """
        if not self.is_shared:
            j = int(np.argmin(np.isfinite(self.extent) | self.wraps))
            limits = f"{self.lower[j]:g} to {self.upper[j]:g}"
            raise InputError(f"joint {joint_names[j]!r} has the limits {limits}, expected finite ones")

    @cached_property
    def diagonal(self) -> float:
        """Length of the space's diagonal [rad or m], with 2 pi for a continuous joint and a wide range."""
        # The longest edge follows from the diagonal; it must not grow with turns that hardly any path makes.
        extents = np.where(self.continuous | self.is_wide, TURN, self.extent)
        return float(np.sqrt(extents.dot(extents)))

    def reduce(self, q: Array) -> Array:
        """The movable columns of q."""
        return np.asarray(q[..., self.movable])

    def whole(self, q: Array, still: Array) -> Array:
        """All columns from the movable ones; the others are taken from `still`, shape (nq,)."""
        if len(still) == q.shape[-1]:
            return q
        full = np.broadcast_to(still, (*q.shape[:-1], len(still))).copy()
        full[..., self.movable] = q
        return full


def joint_space(scene: Scene, arms: Sequence[str]) -> Space:
    """Joint limits of the columns of some arms; cached for all scenes with the same robots."""
    return _joint_space(tuple([scene.arms[name].robot for name in arms]))


@lru_cache(maxsize=64)
def _joint_space(robots: tuple[Robot, ...]) -> Space:
    limits = Limits.stack([robot.limits for robot in robots])
    continuous = np.concatenate([robot.continuous for robot in robots]) > 0.0
    turning = np.concatenate([rotary(robot) for robot in robots])
    return Space(limits.lower, limits.upper, continuous & turning, continuous, turning)


def with_copies(problem: Problem, goals: Array) -> Array:
    """Goals and their copies one turn away in joints that wrap, nearest to the start first, shape (k, nq)."""
    space = joint_space(problem.scene, problem.arms)
    copies = _turned(goals, problem.start, space.wraps)
    far = np.linalg.norm(copies - problem.start, axis=1)
    return copies[np.argsort(far, kind="stable")[:_MOST_GOALS]]


def turned_copies(robot: Robot, q: Array, near: Array) -> Array:
    """Copies of a configuration a turn away in joints whose limits allow it, in few joints first, shape (k, nq).

    Args:
        robot: The robot.
        q: A configuration, the nearest to `near` modulo whole turns, shape (nq,).
        near: The configuration on whose other side the copies are, shape (nq,).
    """
    lower, upper = robot.limits.lower, robot.limits.upper
    other = q + _other_side(q, near)
    has_copy = rotary(robot) & (robot.continuous == 0.0) & (other >= lower) & (other <= upper)
    return _turned(q[None], near, has_copy)[1:_MOST_GOALS]


def _turned(configurations: Array, near: Array, turning: NDArray[np.bool_]) -> Array:
    """Configurations (n, nq), then their copies a turn away in some of the turning columns, shape (k, nq)."""
    chosen = _choices(tuple(np.flatnonzero(turning).tolist()), len(near))
    copies = configurations + chosen[:, None] * _other_side(configurations, near)
    return np.asarray(copies.reshape(-1, len(near))[: 16 * _MOST_GOALS])


def _other_side(q: Array, near: Array) -> Array:
    """The turn that takes each column of q to the other side of `near`, of the shape of q."""
    return np.where(q > near, -TURN, TURN)


@lru_cache(maxsize=64)
def _choices(joints: tuple[int, ...], nq: int) -> Array:
    """Indicator rows of subsets of joints, by ascending size, shape (k, nq)."""
    sets = (chosen for count in range(len(joints) + 1) for chosen in itertools.combinations(joints, count))
    some = list(itertools.islice(sets, 16 * _MOST_GOALS))
    choices = np.zeros((len(some), nq))
    for row, chosen in zip(choices, some, strict=True):
        row[list(chosen)] = 1.0
    return read_only(choices)
