"""A polyline with rounded corners, as a curve q(s) of straight lines and parabolas.

Around a corner p with unit directions d0 and d1 the polyline is replaced, from r before p to r
behind it, by q(s) = p - r d0 + s d0 + s² (d1 - d0) / (4 r) for 0 <= s <= 2 r. It joins the lines with
the same derivative, stays in the triangle of its corner, so inside the joint limits, and leaves
the polyline by r |d1 - d0| / 4 <= r / 2 at most. A blend counts only once it is certified free of
collision; it is halved until it is. What cannot be blended is a corner where the motion stops.
The second derivative jumps where lines and parabolas meet, and with it the acceleration.
Idea: Kunz, Stilman, "Time-Optimal Trajectory Generation for Path Following with Bounded
Acceleration and Velocity", RSS 2012 (with circles; parabolas keep time pieces polynomial).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.kernels.library import load_library

DUPLICATE = 1e-9
"""Waypoints closer than this [rad], and waypoints this close to a straight line, are one."""

HALVINGS = 8
"""A blend that is not free after so many halvings is given up: the motion stops there."""

_REVERSAL = 1e-3
_SMALLEST = 1e-8


class CurveChecker(Protocol):
    """What certifies a blend; `rr1plan.collision.CollisionChecker` does."""

    def polynomial_is_free(self, coefficients: Array, duration: float) -> bool:
        """The curve q(s) = sum_k coefficients[k] s^k, 0 <= s <= duration, is proven free of collision."""
        ...


@dataclass(frozen=True, eq=False)
class Curve:
    """A curve without time, smooth inside: q = sum_k coefficients[i, k] s^k, 0 <= s <= lengths[i].

    Args:
        lengths: Extent of each piece [rad], shape (m,).
        coefficients: Lowest power first, shape (m, 3, nq).
        corners: The waypoints at its two ends, counted in the cleaned polyline.
    """

    lengths: Array
    coefficients: Array
    corners: tuple[int, int]


def clean(waypoints: Array) -> Array:
    """The same polyline without duplicates and without waypoints on a straight line, shape (m, nq).

    First and last waypoint stay exactly what they are, unless all of them are one.
    """
    points = np.ascontiguousarray(waypoints)
    index = np.empty(len(points), np.int64)
    count = load_library().rr1_find_corners(points, *points.shape, DUPLICATE, index)
    return np.asarray(points[index[:count]])


def blend_sizes(points: Array, max_blend: float, checker: CurveChecker | None) -> Array:
    """How far before and behind each waypoint its blend reaches [rad], shape (m,); zero means a stop.

    Args:
        points: Cleaned waypoints [rad], shape (m, nq).
        max_blend: Largest size [rad].
        checker: What certifies a blend; None for a curve that needs no certificate.
    """
    sizes = np.empty(len(points))
    load_library().rr1_largest_blends(points, *points.shape, max_blend, _REVERSAL, _SMALLEST, sizes)
    if checker is not None and sizes.any():
        smallest = _SMALLEST * float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
        for i in np.flatnonzero(sizes).tolist():
            sizes[i] = _certified_size(points, i, float(sizes[i]), smallest, checker)
    return sizes


def _certified_size(points: Array, i: int, size: float, smallest: float, checker: CurveChecker) -> float:
    """The largest certified size of a blend that halving leads to, or zero."""
    for _ in range(HALVINGS):
        if size < smallest:
            break
        if checker.polynomial_is_free(blend_at(points, i, size), 2.0 * size):
            return size
        size *= 0.5
    return 0.0


def blend_at(points: Array, i: int, size: float) -> Array:
    """The blend of a size at inner waypoint i, 0 <= s <= 2 size, lowest power first, shape (3, nq)."""
    corner = np.ascontiguousarray(points[i - 1 : i + 2])
    out: Array = np.empty((3, points.shape[1]))
    load_library().rr1_blend(corner, points.shape[1], size, out)
    return out


def round_corners(points: Array, sizes: Array) -> tuple[Array, Array, NDArray[np.int64]]:
    """The pieces of a rounded polyline: lines and parabolas one after the other, none without extent.

    Args:
        points: Cleaned waypoints [rad], shape (m, nq).
        sizes: See `blend_sizes`.

    Returns:
        Lengths (k,), coefficients (k, 3, nq), and how many pieces come before the blend of each waypoint, shape (m,).
    """
    m, nq = points.shape
    points, sizes = np.ascontiguousarray(points), np.ascontiguousarray(sizes)
    lengths, coefficients, before = np.empty(2 * m), np.empty((2 * m, 3, nq)), np.empty(m, np.int64)
    count = load_library().rr1_round_corners(points, sizes, m, nq, DUPLICATE, lengths, coefficients, before)
    return lengths[:count], coefficients[:count], before


def curves(points: Array, sizes: Array) -> list[Curve]:
    """The rounded polyline, cut where the motion stops."""
    lengths, coefficients, before = round_corners(points, sizes)
    stops = [0, *(np.flatnonzero(sizes[1:] == 0.0) + 1).tolist()]
    parts = [slice(int(before[first]), int(before[last])) for first, last in pairwise(stops)]
    return [Curve(lengths[at], coefficients[at], ends) for at, ends in zip(parts, pairwise(stops), strict=True)]
