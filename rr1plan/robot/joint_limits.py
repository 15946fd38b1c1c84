"""Joint limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rr1plan.checks import Array, Value, counted, items_of, number_array, of_kind, positive_number, read_only, shown
from rr1plan.errors import InputError

WIDEST = 8.0 * np.pi
"""Farthest limit of a revolute joint that is taken as an angle without a warning [rad]."""
_POSITIVE = ("velocity", "acceleration", "jerk", "effort")
LIMIT_NAMES = ("lower", "upper", *_POSITIVE)


@dataclass(frozen=True, eq=False, repr=False)
class Limits(Value):
    """Limits of n joints; infinite if unknown.

    Args:
        lower: Lowest position [rad or m], shape (n,).
        upper: Highest position [rad or m], shape (n,).
        velocity: Highest speed [rad/s or m/s], shape (n,).
        acceleration: Highest acceleration [rad/s² or m/s²], shape (n,).
        jerk: Highest jerk [rad/s³ or m/s³], shape (n,).
        effort: Highest torque or force [Nm or N], shape (n,).

    Raises:
        InputError: NaN, different lengths, lower above upper, or another limit that is not positive.
    """

    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    effort: Array

    if TYPE_CHECKING:  # accepted types; the fields above have the stored ones

        def __init__(
            self,
            lower: ArrayLike,
            upper: ArrayLike,
            velocity: ArrayLike,
            acceleration: ArrayLike,
            jerk: ArrayLike,
            effort: ArrayLike,
        ) -> None: ...

    def __post_init__(self) -> None:
        n = None
        for name in LIMIT_NAMES:
            array = number_array(f"limits: {name}", getattr(self, name))
            if array.ndim != 1 or np.isnan(array).any():
                raise InputError(f"limits: {name} is {shown(array.tolist())}, expected a list of numbers without NaN")
            n = len(array) if n is None else n
            if len(array) != n:
                raise InputError(f"limits: {name} has {counted(len(array), 'number')}, expected {n}, as lower has")
            object.__setattr__(self, name, read_only(array))
        if (self.lower > self.upper).any():
            j = int(np.argmax(self.lower > self.upper))
            raise InputError(f"limits: joint {j} has lower {self.lower[j]} above upper {self.upper[j]}")
        for name in _POSITIVE:
            array = getattr(self, name)
            if (array <= 0).any():
                j = int(np.argmax(array <= 0))
                raise InputError(f"limits: {name} of joint {j} is {array[j]}, expected a number above zero")

    def __len__(self) -> int:
        return len(self.lower)

    @property
    def travel(self) -> Array:
        """Largest absolute value of each joint [rad or m], shape (n,)."""
        return np.maximum(np.abs(self.lower), np.abs(self.upper))

    def scaled(self, *, velocity: float = 1.0, acceleration: float = 1.0, jerk: float = 1.0) -> Limits:
        """The same limits with velocity, acceleration and jerk multiplied by positive factors.

        Raises:
            InputError: a factor that is not a positive number.
        """
        velocity, acceleration = positive_number("velocity", velocity), positive_number("acceleration", acceleration)
        jerk = positive_number("jerk", jerk)
        if velocity == acceleration == jerk == 1.0:
            return self
        return replace(
            self,
            velocity=self.velocity * velocity,
            acceleration=self.acceleration * acceleration,
            jerk=self.jerk * jerk,
        )

    @staticmethod
    def stack(parts: list[Limits]) -> Limits:
        """The concatenated limits of several arms.

        Args:
            parts: The limits of each arm; without any, the result has no joints.

        Raises:
            InputError: something other than limits.
        """
        parts = list(items_of("parts", parts, "Limits"))
        for part in parts:
            of_kind("one of the parts", part, Limits)
        if len(parts) == 1:
            return parts[0]
        return Limits(*(np.concatenate([np.empty(0), *(getattr(p, name) for p in parts)]) for name in LIMIT_NAMES))


def selected_limits(limits: Limits, columns: Sequence[int] | NDArray[np.int64]) -> Limits:
    """The limits of some joints, in the order of their columns."""
    return Limits(*(getattr(limits, name)[columns] for name in LIMIT_NAMES))
