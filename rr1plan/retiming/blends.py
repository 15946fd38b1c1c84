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
from typing import Protocol

import numpy as np

from rr1plan.checks import Array

DUPLICATE = 1e-9
"""Waypoints closer than this [rad], and waypoints this close to a straight line, are one."""

HALVINGS = 8
"""A blend that is not free after so many halvings is given up: the motion stops there."""

_REVERSAL = 1e-3
_SMALLEST = 1e-8


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
    kept = [waypoints[0]]
    for q in waypoints[1:]:
        if np.linalg.norm(q - kept[-1]) >= DUPLICATE:
            kept.append(q)
    if len(kept) > 1:
        kept[-1] = waypoints[-1]
    return _without_straight(np.array(kept))


def _without_straight(points: Array) -> Array:
    kept, i = [0], 0
    while i < len(points) - 1:
        k = i + 1
        while k + 1 < len(points) and _is_straight(points[i : k + 2]):
            k += 1
        kept.append(k)
        i = k
    return points[kept]


def _is_straight(points: Array) -> bool:
    """All points lie on the line from first to last, in this order."""
    chord = points[-1] - points[0]
    length = float(np.linalg.norm(chord))
    if length < DUPLICATE:
        return False
    along = (points - points[0]) @ (chord / length)
    off = points - points[0] - along[:, None] * (chord / length)
    return bool((np.diff(along) > 0.0).all() and (np.linalg.norm(off, axis=1) <= DUPLICATE).all())


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
    sizes = np.zeros(len(points))
    unit, lengths = directions(points)
    smallest = _SMALLEST * lengths.sum()
    for i in range(1, len(points) - 1):
        if np.linalg.norm(unit[i - 1] + unit[i]) < _REVERSAL:
            continue
        size = min(max_blend, 0.5 * float(min(lengths[i - 1], lengths[i])))
        for _ in range(HALVINGS):
            if size < smallest:
                break
            if checker is None or checker.polynomial_is_free(_blend(points[i], unit[i - 1], unit[i], size), 2.0 * size):
                sizes[i] = size
                break
            size *= 0.5
    return sizes


def curves(points: Array, sizes: Array) -> list[Curve]:
    """The rounded polyline, cut where the motion stops."""
    unit, lengths = directions(points)
    done: list[Curve] = []
    coefficients: list[Array] = []
    extents: list[float] = []
    first = 0
    for i in range(len(unit)):
        line = float(lengths[i] - sizes[i] - sizes[i + 1])
        if line > DUPLICATE * float(lengths[i]):
            coefficients.append(np.array([points[i] + sizes[i] * unit[i], unit[i], np.zeros_like(unit[i])]))
            extents.append(line)
        if sizes[i + 1] > 0.0:
            coefficients.append(_blend(points[i + 1], unit[i], unit[i + 1], float(sizes[i + 1])))
            extents.append(2.0 * float(sizes[i + 1]))
        else:
            done.append(Curve(np.array(extents), np.array(coefficients), (first, i + 1)))
            coefficients, extents, first = [], [], i + 1
    return done


def _blend(corner: Array, before: Array, behind: Array, size: float) -> Array:
    return np.array([corner - size * before, before, (behind - before) / (4.0 * size)])
