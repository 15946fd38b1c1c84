"""Paths: waypoints in joint space joined by straight lines, without time."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from rr1plan.checks import (
    Array,
    Value,
    counted,
    finite_number,
    items_of,
    near_array,
    of_kind,
    positive_number,
    read_only,
    shown,
)
from rr1plan.errors import InputError

# More samples do not fit into memory.
MOST_SAMPLES = 10_000_000


def check_joint_names(joint_names: Any, *, empty: bool = True) -> tuple[str, ...]:
    """Column names as a tuple of distinct strings.

    Args:
        joint_names: The names.
        empty: Whether the names may be empty.

    Raises:
        InputError: not strings, a duplicate, or no names although `empty` is False.
    """
    names = items_of("joint_names", joint_names, "names")
    if not names and not empty:
        raise InputError("joint_names is empty, expected at least one joint")
    if not all(isinstance(name, str) and name for name in names):
        raise InputError(f"joint_names is {shown(names)}, expected names")
    if len(set(names)) != len(names):
        (twice, _), *_ = Counter(names).most_common(1)
        raise InputError(f"joint_names has {shown(twice)} twice")
    return names


def arms_of(joint_names: Iterable[str]) -> tuple[str, ...]:
    """Names of the arms of columns "arm/joint", in the order of the columns."""
    return tuple(dict.fromkeys(name.split("/", 1)[0] for name in joint_names))


def edge_lengths(waypoints: Array) -> Array:
    """Length of each edge of a path (n, nq) [rad or m], shape (n - 1,)."""
    return np.asarray(np.linalg.norm(np.diff(waypoints, axis=0), axis=1))


@dataclass(frozen=True, eq=False)
class Path(Value):
    """Waypoints joined by straight lines in joint space.

    Args:
        joint_names: Name of each column, "arm/joint", length nq.
        waypoints: Configurations [rad or m], shape (n, nq), n >= 1.

    Raises:
        InputError: inconsistent shapes, NaN, no waypoint, a duplicate name.
    """

    joint_names: tuple[str, ...]
    waypoints: Array

    if TYPE_CHECKING:  # accepted types; the fields above have the stored ones

        def __init__(self, joint_names: Sequence[str], waypoints: ArrayLike) -> None: ...

    def __post_init__(self) -> None:
        names = check_joint_names(self.joint_names)
        waypoints = near_array("waypoints", self.waypoints, (None, len(names)))
        if len(waypoints) < 1:
            raise InputError("a path has at least one waypoint, got none")
        object.__setattr__(self, "joint_names", names)
        object.__setattr__(self, "waypoints", read_only(waypoints))

    @classmethod
    def trusted(cls, joint_names: tuple[str, ...], waypoints: Array) -> Path:
        """A path from validated arguments, without checks or copies; the caller must not keep `waypoints`.

        Args:
            joint_names: Names from a validated path, problem or checker.
            waypoints: New array of finite values, shape (n, nq), n >= 1.
        """
        path = object.__new__(cls)
        path.__dict__.update(joint_names=joint_names, waypoints=read_only(waypoints))
        return path

    @property
    def arms(self) -> tuple[str, ...]:
        """Names of the arms, in the order of their columns."""
        return arms_of(self.joint_names)

    def __len__(self) -> int:
        return len(self.waypoints)

    def __repr__(self) -> str:
        return (
            f"Path({counted(len(self), 'waypoint')}, length {self.length:.2f}, joints=[{', '.join(self.joint_names)}])"
        )

    @cached_property
    def length(self) -> float:
        """Euclidean length in joint space [rad, or m of prismatic joints]."""
        points = self.waypoints.tolist()
        return math.fsum(map(math.dist, points[1:], points))

    def allclose(self, other: Path, atol: float = 1e-12) -> bool:
        """Whether joints are the same and waypoints of `other` agree within `atol` [rad or m]."""
        of_kind("other", other, Path)
        atol = finite_number("atol", atol)
        return (
            self.joint_names == other.joint_names
            and self.waypoints.shape == other.waypoints.shape
            and bool(np.allclose(self.waypoints, other.waypoints, rtol=0.0, atol=atol))
        )

    def sample(self, step: float) -> Array:
        """Configurations along the path, at most `step` [rad or m] apart in any joint, shape (m, nq).

        Raises:
            InputError: not a number above zero, or more than ten million configurations.
        """
        step = positive_number("step", step)
        if np.abs(np.diff(self.waypoints, axis=0)).sum() > MOST_SAMPLES * step:
            raise InputError(f"a step of {step} makes more than {MOST_SAMPLES} configurations, take a longer one")
        pieces = [self.waypoints[:1]]
        for a, b in zip(self.waypoints[:-1], self.waypoints[1:], strict=True):
            count = max(1, int(np.ceil(np.abs(b - a).max(initial=0.0) / step)))
            pieces.append(a + (b - a) * (np.arange(1, count + 1) / count)[:, None])
        return np.concatenate(pieces)
