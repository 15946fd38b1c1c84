"""Parabolic blends: a polyline with rounded corners, as a curve q(s) of straight lines and parabolas.

Around a corner p with unit directions d0 and d1 the polyline is replaced, from a distance r before p to r
behind it, by q(s) = p - r d0 + s d0 + s² (d1 - d0) / (4 r) for 0 <= s <= 2 r. The blend is C1-continuous
with the lines, stays in the triangle of its corner, hence inside the joint limits, and deviates from
the polyline by r |d1 - d0| / 4 <= r / 2 at most. A blend is used only if it is certified free of
collision; otherwise r is halved. The motion stops at corners that cannot be blended.
The second derivative jumps where lines and parabolas meet, and with it the acceleration.
Idea: Kunz, Stilman, "Time-Optimal Trajectory Generation for Path Following with Bounded
Acceleration and Velocity", RSS 2012 (with circular blends; parabolas keep trajectories polynomial).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, Value
from rr1plan.kernels.planner_kernels import load_library
from rr1plan.planning_constants import BLENDS

DUPLICATE = BLENDS.duplicate
"""Waypoints closer than this to another one or to the line between their neighbors are dropped [rad or m]."""

HALVINGS = BLENDS.halvings
"""Number of halvings of a blend after which the motion stops at its corner."""


class CurveChecker(Protocol):
    """Interface of a checker that certifies blends, e.g. `rr1plan.collision.CollisionChecker`."""

    def polynomial_is_free(self, coefficients: Array, duration: float) -> bool:
        """Whether q(s) = sum_k coefficients[k] s^k, 0 <= s <= duration, is certified free of collision.

        Args:
            coefficients: Lowest power first [rad or m], shape (k, nq).
            duration: End of the interval of s.
        """
        ...


@dataclass(frozen=True, eq=False, repr=False)
class Curve(Value):
    """A C1-continuous geometric curve: q = sum_k coefficients[i, k] s^k, 0 <= s <= lengths[i].

    Args:
        lengths: Parameter range of each piece [rad or m], shape (m,).
        coefficients: Lowest power first, shape (m, 3, nq).
        corners: Indices of the waypoints at its two ends in the cleaned polyline.
    """

    lengths: Array
    coefficients: Array
    corners: tuple[int, int]


def clean(waypoints: Array) -> Array:
    """The same polyline without duplicates and without waypoints on a straight line, shape (m, nq).

    The first and the last waypoint are unchanged, unless all waypoints coincide.
    """
    points = np.ascontiguousarray(waypoints)
    index = np.empty(len(points), np.int64)
    count = load_library().rr1_find_corners(points, *points.shape, DUPLICATE, index)
    return np.asarray(points[index[:count]])


def blend_sizes(points: Array, max_blend: float, checker: CurveChecker | None) -> Array:
    """Blend size of each waypoint, the distance r before and behind it [rad or m], shape (m,); zero means a stop.

    Args:
        points: Cleaned waypoints [rad or m], shape (m, nq).
        max_blend: Largest size [rad or m].
        checker: Certifies blends; None for a curve that needs no certificate.
    """
    sizes = np.empty(len(points))
    length = load_library().rr1_largest_blends(
        points, *points.shape, max_blend, BLENDS.reversal, BLENDS.smallest, sizes
    )
    if checker is not None:
        for i, size in enumerate(sizes.tolist()):
            if size > 0.0:
                sizes[i] = _certified_size(points, i, size, BLENDS.smallest * length, checker)
    return sizes


def _certified_size(points: Array, i: int, size: float, smallest: float, checker: CurveChecker) -> float:
    """The first certified size of repeated halving, or zero."""
    for _ in range(HALVINGS):
        if size < smallest:
            break
        if checker.polynomial_is_free(blend_at(points, i, size), 2.0 * size):
            return size
        size *= 0.5
    return 0.0


def blend_at(points: Array, i: int, size: float) -> Array:
    """The blend of a size at inner waypoint i, 0 <= s <= 2 size, lowest power first, shape (3, nq)."""
    out: Array = np.empty((3, points.shape[1]))
    load_library().rr1_blend(points[i - 1 : i + 2], points.shape[1], size, out)
    return out


def round_corners(points: Array, sizes: Array) -> tuple[Array, Array, NDArray[np.int64]]:
    """The pieces of a rounded polyline, alternating lines and parabolas; empty pieces are dropped.

    Args:
        points: Cleaned waypoints [rad or m], shape (m, nq).
        sizes: See `blend_sizes`.

    Returns:
        Lengths (k,), coefficients (k, 3, nq), and the number of pieces before the blend of each waypoint, shape (m,).
    """
    m, nq = points.shape
    points, sizes = np.ascontiguousarray(points), np.ascontiguousarray(sizes)
    lengths, coefficients, before = np.empty(2 * m), np.empty((2 * m, 3, nq)), np.empty(m, np.int64)
    count = load_library().rr1_round_corners(points, sizes, m, nq, DUPLICATE, lengths, coefficients, before)
    return lengths[:count], coefficients[:count], before


def curves(points: Array, sizes: Array) -> list[Curve]:
    """The rounded polyline, split where the motion stops."""
    lengths, coefficients, before = round_corners(points, sizes)
    stops = [0, *(np.flatnonzero(sizes[1:] == 0.0) + 1).tolist()]
    parts = [slice(int(before[first]), int(before[last])) for first, last in pairwise(stops)]
    return [Curve(lengths[at], coefficients[at], ends) for at, ends in zip(parts, pairwise(stops), strict=True)]
