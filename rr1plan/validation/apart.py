"""Two convex bodies and a direction along which they lie apart, compiled.

Whatever direction is tried, the gap between the bodies along it is a lower bound of their distance: that is
all a proof rests on, so the search below may err without harm. Every point of the difference of the bodies is
an upper bound. The search is over when the two meet.

Gilbert, Johnson, Keerthi (1988), A fast procedure for computing the distance between complex objects in
three-dimensional space, IEEE J. Robotics and Automation 4.
"""

from __future__ import annotations

from math import sqrt
from typing import Any

from rr1plan.validation.compiled import largest, part

# Kinds of bodies, each with a rounding: a ball is a box without edges, a capsule one with a single edge. The corners of
# a hull are looked at one by one, those of a table by direction.
HULL, BOX, CYLINDER, PLANE, TABLE = 0, 1, 2, 3, 4
# Columns of `kinds` (b, 6): kind, first and number of corners, link, first and number of the joints that carry it.
KIND, FIRST, COUNT, LINK, CHAIN, DEPTH = range(6)
# Columns of `sizes` (b, 23): a box's half edges or a cylinder's radius, radius and half length; rounding;
# radius of all; half edges of the bounding box; its centre in the link's frame; the shape's pose there.
HALF, ROUND, RADIUS, BOUND, CENTER, LOCAL = 0, 3, 4, 5, 8, 11
# Rows of `corners` (4, n): the point, and for a table where the corners of each cell begin, from its first column.
STARTS = 3
# Cells of directions: on each face of a cube SIDE by SIDE.
SIDE = 4
CELLS = 6 * SIDE * SIDE
# A row of `placed` (b, 15): R_world_shape by rows, position of its frame, centre of its bounding ball.
ORIGIN, MIDDLE = 9, 12
# Bodies nearer than this touch [m].
CONTACT = 1e-8
_ROUNDS = 64


@largest
def _reach_of_corners(corners: Any, first: int, stop: int, x: float, y: float, z: float) -> float:
    best = -1e300
    for i in range(first, stop):
        best = max(best, x * corners[0, i] + y * corners[1, i] + z * corners[2, i])
    return best


@part
def _cell(u: float, v: float, w: float) -> int:
    """The cell of a direction of any length."""
    a, b, c = abs(u), abs(v), abs(w)
    if a >= b and a >= c:
        face, size, x, y = 0 if u >= 0.0 else 1, a, v, w
    elif b >= c:
        face, size, x, y = 2 if v >= 0.0 else 3, b, u, w
    else:
        face, size, x, y = 4 if w >= 0.0 else 5, c, u, v
    if not size > 0.0:
        return 0
    i = min(int((x / size + 1.0) * (0.5 * SIDE)), SIDE - 1)
    j = min(int((y / size + 1.0) * (0.5 * SIDE)), SIDE - 1)
    return (face * SIDE + i) * SIDE + j


@part
def _columns(kinds: Any, corners: Any, b: int, u: float, v: float, w: float) -> tuple[int, int]:
    """The columns of `corners` among which the farthest of body b along a direction in its frame is."""
    first = kinds[b, FIRST]
    if kinds[b, KIND] == TABLE:
        cell = first + _cell(u, v, w)
        return first + int(corners[STARTS, cell]), first + int(corners[STARTS, cell + 1])
    return first, first + kinds[b, COUNT]


@part
def reach(kinds: Any, sizes: Any, corners: Any, placed: Any, b: int, x: float, y: float, z: float) -> float:
    """Largest d . p over the points p of body b, from its frame's origin, for a world direction d of any length."""
    u = placed[b, 0] * x + placed[b, 3] * y + placed[b, 6] * z
    v = placed[b, 1] * x + placed[b, 4] * y + placed[b, 7] * z
    w = placed[b, 2] * x + placed[b, 5] * y + placed[b, 8] * z
    kind = kinds[b, KIND]
    if kind == BOX:
        best = abs(u) * sizes[b, 0] + abs(v) * sizes[b, 1] + abs(w) * sizes[b, 2]
    elif kind == CYLINDER:
        best = sizes[b, 0] * sqrt(u * u + v * v) + sizes[b, 2] * abs(w)
    else:
        first, stop = _columns(kinds, corners, b, u, v, w)
        best = _reach_of_corners(corners, first, stop, u, v, w)
    if sizes[b, ROUND] > 0.0:
        best += sizes[b, ROUND] * sqrt(u * u + v * v + w * w)
    return float(best)


@part
def _farthest(kinds: Any, sizes: Any, corners: Any, b: int, u: float, v: float, w: float) -> tuple[float, float, float]:
    """The point of a body, without its rounding, that lies farthest along a direction; both in its frame."""
    kind = kinds[b, KIND]
    if kind in (BOX, CYLINDER):
        z = sizes[b, 2] if w >= 0.0 else -sizes[b, 2]
        if kind == BOX:
            return (sizes[b, 0] if u >= 0.0 else -sizes[b, 0]), (sizes[b, 1] if v >= 0.0 else -sizes[b, 1]), z
        across = sqrt(u * u + v * v)
        if across <= 1e-300:
            return sizes[b, 0], 0.0, z
        return sizes[b, 0] * u / across, sizes[b, 0] * v / across, z
    first, stop = _columns(kinds, corners, b, u, v, w)
    best, at = -1e300, first
    for i in range(first, stop):
        value = u * corners[0, i] + v * corners[1, i] + w * corners[2, i]
        if value > best:
            best, at = value, i
    return corners[0, at], corners[1, at], corners[2, at]


@part
def _add(
    kinds: Any, sizes: Any, corners: Any, placed: Any, a: int, b: int, known: Any, n: int, x: float, y: float, z: float
) -> None:
    """Write the pair of points of a and b that are farthest along d and -d to place n of the known ones."""
    known[n, 0], known[n, 1], known[n, 2] = _farthest(
        kinds,
        sizes,
        corners,
        a,
        placed[a, 0] * x + placed[a, 3] * y + placed[a, 6] * z,
        placed[a, 1] * x + placed[a, 4] * y + placed[a, 7] * z,
        placed[a, 2] * x + placed[a, 5] * y + placed[a, 8] * z,
    )
    known[n, 3], known[n, 4], known[n, 5] = _farthest(
        kinds,
        sizes,
        corners,
        b,
        -placed[b, 0] * x - placed[b, 3] * y - placed[b, 6] * z,
        -placed[b, 1] * x - placed[b, 4] * y - placed[b, 7] * z,
        -placed[b, 2] * x - placed[b, 5] * y - placed[b, 8] * z,
    )
    _difference(placed, a, b, known, n)


@part
def _difference(placed: Any, a: int, b: int, known: Any, n: int) -> None:
    """Point of a minus point of b in the world, for the known pair of points n."""
    for i in range(3):
        known[n, 6 + i] = (
            (placed[a, ORIGIN + i] - placed[b, ORIGIN + i])
            + placed[a, 3 * i] * known[n, 0]
            + placed[a, 3 * i + 1] * known[n, 1]
            + placed[a, 3 * i + 2] * known[n, 2]
            - placed[b, 3 * i] * known[n, 3]
            - placed[b, 3 * i + 1] * known[n, 4]
            - placed[b, 3 * i + 2] * known[n, 5]
        )


@part
def _dot(known: Any, i: int, j: int) -> float:
    return float(known[i, 6] * known[j, 6] + known[i, 7] * known[j, 7] + known[i, 8] * known[j, 8])


@part
def _on_segment(known: Any, i: int, j: int, share: Any) -> float:
    """Shares of two points in the point between them nearest to the origin; its squared distance."""
    ii, ij, jj = _dot(known, i, i), _dot(known, i, j), _dot(known, j, j)
    length = ii - 2.0 * ij + jj
    t = (ii - ij) / length if length > 0.0 else 0.0
    t = min(max(t, 0.0), 1.0)
    share[0], share[1], share[2], share[3] = 0.0, 0.0, 0.0, 0.0
    share[i], share[j] = 1.0 - t, t
    return max(0.0, ii + 2.0 * t * (ij - ii) + t * t * length)


@part
def _on_triangle(known: Any, i: int, j: int, k: int, share: Any, best: Any) -> float:
    """The same for a triangle: inside of it, or on the nearest of its sides."""
    ii, ij, ik = _dot(known, i, i), _dot(known, i, j), _dot(known, i, k)
    jj, jk, kk = _dot(known, j, j), _dot(known, j, k), _dot(known, k, k)
    # Cramer's rule for the stationary point of |p_i + s (p_j - p_i) + t (p_k - p_i)|².
    a, b, c = ii - 2.0 * ij + jj, ii - ij - ik + jk, ii - 2.0 * ik + kk
    d, e = ii - ij, ii - ik
    area = a * c - b * b
    s, t = c * d - b * e, a * e - b * d
    if area > 1e-14 * a * c and s >= 0.0 and t >= 0.0 and s + t <= area:
        s, t = s / area, t / area
        share[0], share[1], share[2], share[3] = 0.0, 0.0, 0.0, 0.0
        share[i], share[j], share[k] = 1.0 - s - t, s, t
        return max(0.0, ii - s * d - t * e)
    least = _on_segment(known, i, j, share)
    for u, v in ((i, k), (j, k)):
        distance = _on_segment(known, u, v, best)
        if distance < least:
            least = distance
            for m in range(4):
                share[m] = best[m]
    return least


@part
def _outside(known: Any, i: int, j: int, k: int, m: int) -> bool:
    """Whether the origin and point m lie on different sides of the plane of i, j and k, or nearly in it."""
    ax, ay, az = known[j, 6] - known[i, 6], known[j, 7] - known[i, 7], known[j, 8] - known[i, 8]
    bx, by, bz = known[k, 6] - known[i, 6], known[k, 7] - known[i, 7], known[k, 8] - known[i, 8]
    x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    here = -(x * known[i, 6] + y * known[i, 7] + z * known[i, 8])
    there = x * (known[m, 6] - known[i, 6]) + y * (known[m, 7] - known[i, 7]) + z * (known[m, 8] - known[i, 8])
    return bool(here * there <= 1e-12 * there * there)


@part
def _nearest(known: Any, n: int, share: Any, best: Any) -> bool:
    """Shares of n points in the point of their hull nearest to the origin; whether the hull holds the origin."""
    share[0], share[1], share[2], share[3] = 1.0, 0.0, 0.0, 0.0
    if n == 2:
        _on_segment(known, 0, 1, share)
    elif n == 3:
        _on_triangle(known, 0, 1, 2, share, best[1])
    elif n == 4:
        least = 1e300
        for i, j, k, m in ((0, 1, 2, 3), (0, 1, 3, 2), (0, 2, 3, 1), (1, 2, 3, 0)):
            if _outside(known, i, j, k, m):
                distance = _on_triangle(known, i, j, k, best[0], best[1])
                if distance < least:
                    least = distance
                    for s in range(4):
                        share[s] = best[0, s]
        return least == 1e300
    return False


@part
def _drop(known: Any, n: int, share: Any) -> int:
    """Keep the points that have a share; their number."""
    count = 0
    for i in range(n):
        if share[i] > 0.0:
            share[count] = share[i]
            for m in range(9):
                known[count, m] = known[i, m]
            count += 1
    return count


@part
def _is_known(known: Any, n: int) -> bool:
    """Whether the point at place n is one of those before it."""
    for i in range(n):
        if known[i, 6] == known[n, 6] and known[i, 7] == known[n, 7] and known[i, 8] == known[n, 8]:
            return True
    return False


@part
def part_bodies(
    kinds: Any,
    sizes: Any,
    corners: Any,
    placed: Any,
    a: int,
    b: int,
    known: Any,
    share: Any,
    base: float,
    enough: float,
) -> tuple[float, float, float, float, float]:
    """Search for the direction from a to b along which the two are farthest apart, without their roundings.

    Args:
        kinds: Kinds of the bodies.
        sizes: Their sizes.
        corners: Corners of all hulls, shape (4, n).
        placed: Where the bodies are.
        a: The first body.
        b: The second body.
        known: Pairs of points, shape (5, 9), to start from and to leave for the next time; their number in [4, 0].
        share: Scratch, shape (3, 4).
        base: The bounds may differ by a quarter of the upper one's distance from this [m].
        enough: Stop when they are farther apart than this [m].

    Returns:
        An upper bound of the distance, a lower bound [m], and the direction that proves it; the lower is
        -1e300 where the two touch.
    """
    n = int(known[4, 0])
    for i in range(n):
        _difference(placed, a, b, known, i)
    if n == 0:
        x, y, z = placed[b, 12] - placed[a, 12], placed[b, 13] - placed[a, 13], placed[b, 14] - placed[a, 14]
        _add(kinds, sizes, corners, placed, a, b, known, 0, x, y, z)
        n = 1
    upper, lower, nx, ny, nz = 1e300, -1e300, 0.0, 0.0, 1.0
    for _ in range(_ROUNDS):
        inside = _nearest(known, n, share[0], share[1:])
        n = _drop(known, n, share[0])
        x, y, z = 0.0, 0.0, 0.0
        for i in range(n):
            x -= share[0, i] * known[i, 6]
            y -= share[0, i] * known[i, 7]
            z -= share[0, i] * known[i, 8]
        length = sqrt(x * x + y * y + z * z)
        if inside or not length > CONTACT:
            known[4, 0] = 0.0
            return 0.0, -1e300, nx, ny, nz
        upper = min(upper, length)
        x, y, z = x / length, y / length, z / length
        _add(kinds, sizes, corners, placed, a, b, known, n, x, y, z)
        gap = -(x * known[n, 6] + y * known[n, 7] + z * known[n, 8])
        if gap > lower:
            lower, nx, ny, nz = gap, x, y, z
        if upper - lower <= max(1e-10, 0.25 * (upper - base)) or lower >= enough or _is_known(known, n):
            break
        n += 1
    known[4, 0] = float(min(n, 3))
    return upper, lower, nx, ny, nz
