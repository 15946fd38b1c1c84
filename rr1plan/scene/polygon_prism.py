"""Upright prisms over polygons, as obstacles of planar arms."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from rr1plan.checks import Array, near_array, positive_length
from rr1plan.errors import InputError
from rr1plan.robot import Geometry
from rr1plan.shapes import Mesh
from rr1plan.shapes.convex_hulls import convex_hull

_FLAT = 1e-9  # twice the area of collinear corners, relative to the square of the polygon's size
_MOST = 1000


def polygon_prism(
    corners: ArrayLike, height: float = 0.2, *, color: str | ArrayLike | None = None
) -> tuple[Geometry, ...]:
    """A prism over any simple polygon, as convex pieces for `Scene.with_obstacle`.

    A convex polygon is one piece; others are divided into triangles by ear clipping.

    Args:
        corners: The corners in order, clockwise or counter-clockwise [m], shape (n, 2), 3 to 1000 of them. Equal
            neighbors, such as a first corner repeated at the end, count as one.
        height: Height; the prism reaches from -height / 2 to height / 2 [m].
        color: Its color: "#rrggbb", "#rrggbbaa", rgb or rgba (0..1).

    Raises:
        InputError: invalid corners, a polygon that crosses itself or has no area, or a height that is not positive.
    """
    points = near_array("corners", corners, (None, 2))
    points = points[(points != np.roll(points, -1, axis=0)).any(axis=1)]
    if not 3 <= len(points) <= _MOST:
        raise InputError(f"corners has {len(points)} points, expected 3 to {_MOST}")
    height = positive_length("height", height)
    flat = _FLAT * float(np.ptp(points, axis=0).max()) ** 2
    area = float(_cross(points, np.roll(points, -1, axis=0)).sum())
    if abs(area) <= flat:
        raise InputError("corners enclose no area, expected a polygon")
    if area < 0.0:
        points = points[::-1]
    if _crosses_itself(points):
        raise InputError("corners make a polygon that crosses or touches itself, expected a simple one")
    bends = _cross(np.roll(points, -1, axis=0) - points, np.roll(points, -2, axis=0) - np.roll(points, -1, axis=0))
    pieces = [points] if (bends >= -flat).all() else _triangles(points, flat)
    return tuple(Geometry(f"piece{k}", _prism(piece, height), color=color) for k, piece in enumerate(pieces))


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _crosses_itself(points: Array) -> bool:
    """Whether two edges that are not neighbors meet, or two neighbors fold back onto each other."""
    n = len(points)
    a, b = points, np.roll(points, -1, axis=0)
    turn = [[_cross(b - a, p[k] - a) for k in range(n)] for p in (a, b)]
    for i in range(n):
        for j in range(i + 1, n):
            if j - i in (1, n - 1):
                continue
            separate = turn[0][j][i] * turn[1][j][i] > 0.0 or turn[0][i][j] * turn[1][i][j] > 0.0
            low, high = (
                np.maximum(np.minimum(a[i], b[i]), np.minimum(a[j], b[j])),
                np.minimum(np.maximum(a[i], b[i]), np.maximum(a[j], b[j])),
            )
            if not separate and (low <= high).all():
                return True
    fore, back = b - a, a - np.roll(a, 1, axis=0)
    return bool(((_cross(back, fore) == 0.0) & ((back * fore).sum(axis=1) < 0.0)).any())


def _triangles(points: Array, flat: float) -> list[Array]:
    """Ear clipping (Meisters 1975) of a counter-clockwise simple polygon; slivers without area are omitted."""
    left, found = list(range(len(points))), []
    while len(left) > 2:
        for k in range(len(left)):
            before, corner, after = left[k - 1], left[k], left[(k + 1) % len(left)]
            a, b, c = points[[before, corner, after]]
            area = float(_cross(b - a, c - b))
            others = points[[i for i in left if i not in (before, corner, after)]]
            inside = (
                (_cross(b - a, others - a) >= 0.0)
                & (_cross(c - b, others - b) >= 0.0)
                & (_cross(a - c, others - c) >= 0.0)
            )
            if (area > flat and not inside.any()) or abs(area) <= flat:
                if area > flat:
                    found.append(points[[before, corner, after]])
                del left[k]
                break
        else:
            raise InputError("corners make a polygon that touches itself, expected a simple one")
    return found


def _prism(corners: Array, height: float) -> Mesh:
    """A convex prism."""
    return convex_hull(
        np.concatenate([np.column_stack([corners, np.full(len(corners), z)]) for z in (-height / 2, height / 2)])
    )
