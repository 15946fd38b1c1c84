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

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rr1plan._kernels import polyline
from rr1plan.checks import Array

DUPLICATE = 1e-9
"""Waypoints closer than this [rad], and waypoints this close to a straight line, are one."""

HALVINGS = 8
"""A blend that is not free after so many halvings is given up: the motion stops there."""

_REVERSAL = 1e-3
_SMALLEST = 1e-8

_corners: Callable[[Array, float], NDArray[np.int64]] = polyline.corners


class CurveChecker(Protocol):
    """What certifies a blend; `rr1plan.collision.MotionChecker` does."""

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

    @property
    def is_line(self) -> bool:
        """One straight line."""
        return len(self.lengths) == 1


def clean(waypoints: Array) -> Array:
    """The same polyline without duplicates and without waypoints on a straight line, shape (m, nq).

    First and last waypoint stay exactly what they are, unless all of them are one.
    """
    return np.asarray(waypoints[_corners(waypoints, DUPLICATE)])


def directions(points: Array) -> tuple[Array, Array]:
    """Unit direction (m - 1, nq) and length (m - 1,) [rad] of every edge."""
    edges = np.diff(points, axis=0)
    lengths = np.linalg.norm(edges, axis=1)
    return edges / lengths[:, None], lengths


def blend_sizes(points: Array, max_blend: float, checker: CurveChecker | None) -> Array:
    """How far before and behind each waypoint its blend reaches [rad], shape (m,); zero means a stop.

    Args:
        points: Cleaned waypoints [rad], shape (m, nq).
        max_blend: Largest size [rad].
        checker: What certifies a blend; None for a curve that needs no certificate.
    """
    unit, lengths = directions(points)
    sizes = np.zeros(len(points))
    sizes[1:-1] = np.minimum(max_blend, 0.5 * np.minimum(lengths[:-1], lengths[1:]))
    sizes[1:-1][np.linalg.norm(unit[:-1] + unit[1:], axis=1) < _REVERSAL] = 0.0
    smallest = _SMALLEST * lengths.sum()
    sizes[sizes < smallest] = 0.0
    if checker is None:
        return sizes
    undecided = np.flatnonzero(sizes)
    for _ in range(HALVINGS):
        if not undecided.size:
            break
        blends = zip(undecided, _blends(points, unit, sizes, undecided), strict=True)
        refused = [i for i, blend in blends if not checker.polynomial_is_free(blend, 2.0 * float(sizes[i]))]
        sizes[refused] *= 0.5
        sizes[sizes < smallest] = 0.0
        undecided = np.array([i for i in refused if sizes[i] > 0.0], dtype=np.intp)
    sizes[undecided] = 0.0
    return sizes


def curves(points: Array, sizes: Array) -> list[Curve]:
    """The rounded polyline, cut where the motion stops."""
    unit, lengths = directions(points)
    # edge, blend at its end, next edge, ...: what has no extent is left out
    extents = np.zeros(2 * len(unit))
    coefficients = np.zeros((len(extents), 3, points.shape[1]))
    lines = lengths - sizes[:-1] - sizes[1:]
    extents[::2] = np.where(lines > DUPLICATE * lengths, lines, 0.0)
    coefficients[::2, 0] = points[:-1] + sizes[:-1, None] * unit
    coefficients[::2, 1] = unit
    blended = np.flatnonzero(sizes)
    extents[2 * blended - 1] = 2.0 * sizes[blended]
    coefficients[2 * blended - 1] = _blends(points, unit, sizes, blended)
    stops = [0, *(np.flatnonzero(sizes[1:] == 0.0) + 1).tolist()]
    done = []
    for first, last in pairwise(stops):
        kept = np.flatnonzero(extents[2 * first : 2 * last]) + 2 * first
        done.append(Curve(extents[kept], coefficients[kept], (first, last)))
    return done


def _blends(points: Array, unit: Array, sizes: Array, where: NDArray[np.intp]) -> Array:
    """The parabolas at some inner waypoints, shape (len(where), 3, nq)."""
    before, behind, size = unit[where - 1], unit[where], sizes[where, None]
    return np.stack([points[where] - size * before, before, (behind - before) / (4.0 * size)], axis=1)
