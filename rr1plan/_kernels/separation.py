# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""A proven gap between two convex bodies.

Any direction n proves a gap: the least of n over one body less the greatest over the other is never
more than the distance. The iteration of Gilbert, Johnson and Keerthi (1988) looks for the best n;
because the gap is measured, not inferred, its rounding or its early end can only make the bound lower.

A body is a core (point, segment, box, cylinder, corner points) and a radius around it. `kind` is one
of the constants below, `size` its measures in its own frame, `pose` its rotation (row by row) and
translation in the world.
"""

from __future__ import annotations

import numpy as np
from numba import types

from rr1plan._kernels.jit import F64, FLOATS1, FLOATS2, I64, INTS1, OUT1, OUT2, jit

POINT, SEGMENT, BOX, CYLINDER, CORNERS, HALF_SPACE, CELLS = range(7)

_ITERATIONS = 48
_BODY = (I64, FLOATS1, FLOATS1, FLOATS2, INTS1, I64)


@jit(types.Tuple((F64, F64, F64, I64))(*_BODY, F64, F64, F64), allocates=False)
def support(kind, size, pose, corners, links, start, x, y, z):
    """The point of a body's core that lies farthest in a direction of the world.

    Args:
        kind: One of the constants of this file.
        size: The measures of the core in its own frame [m], shape (3,).
        pose: Rotation row by row and translation, shape (12,).
        corners: Corner points of all bodies, shape (c, 3).
        links: Neighbours of corner i are links[links[i] : links[i + 1]].
        start: The corner of this body to begin the climb at.
        x: Direction.
        y: Direction.
        z: Direction.

    Returns:
        The point [m] and the corner it is.
    """
    lx = pose[0] * x + pose[3] * y + pose[6] * z
    ly = pose[1] * x + pose[4] * y + pose[7] * z
    lz = pose[2] * x + pose[5] * y + pose[8] * z
    px, py, pz = 0.0, 0.0, 0.0
    if kind == BOX:
        px = size[0] if lx >= 0.0 else -size[0]
        py = size[1] if ly >= 0.0 else -size[1]
        pz = size[2] if lz >= 0.0 else -size[2]
    elif kind == CORNERS:
        # On a convex body a corner that beats its neighbours beats all.
        best = corners[start, 0] * lx + corners[start, 1] * ly + corners[start, 2] * lz
        climbs = True
        while climbs:
            climbs = False
            for k in range(links[start], links[start + 1]):
                i = links[k]
                along = corners[i, 0] * lx + corners[i, 1] * ly + corners[i, 2] * lz
                if along > best:
                    best = along
                    start = i
                    climbs = True
        px, py, pz = corners[start, 0], corners[start, 1], corners[start, 2]
    elif kind == SEGMENT:
        pz = size[2] if lz >= 0.0 else -size[2]
    elif kind == CYLINDER:
        across = np.sqrt(lx * lx + ly * ly)
        if across > 0.0:
            px, py = size[0] * lx / across, size[0] * ly / across
        pz = size[2] if lz >= 0.0 else -size[2]
    wx = pose[0] * px + pose[1] * py + pose[2] * pz + pose[9]
    wy = pose[3] * px + pose[4] * py + pose[5] * pz + pose[10]
    wz = pose[6] * px + pose[7] * py + pose[8] * pz + pose[11]
    return wx, wy, wz, start


@jit(types.Tuple((I64, F64, F64, F64))(OUT2, I64, I64), allocates=False)
def _nearest_on_segment(s, i, j):
    """Which corners of a segment carry its point nearest to the origin (bits), and that point."""
    ax, ay, az = s[i, 0], s[i, 1], s[i, 2]
    dx, dy, dz = s[j, 0] - ax, s[j, 1] - ay, s[j, 2] - az
    along = -(ax * dx + ay * dy + az * dz)
    square = dx * dx + dy * dy + dz * dz
    if along <= 0.0:
        return 1 << i, ax, ay, az
    if along >= square:
        return 1 << j, s[j, 0], s[j, 1], s[j, 2]
    u = along / square
    return (1 << i) | (1 << j), ax + u * dx, ay + u * dy, az + u * dz


@jit(types.Tuple((I64, F64, F64, F64))(OUT2, I64, I64, I64), allocates=False)
def _nearest_on_triangle(s, i, j, k):
    """Which corners of a triangle carry its point nearest to the origin (bits), and that point."""
    ax, ay, az = s[i, 0], s[i, 1], s[i, 2]
    ux, uy, uz = s[j, 0] - ax, s[j, 1] - ay, s[j, 2] - az
    vx, vy, vz = s[k, 0] - ax, s[k, 1] - ay, s[k, 2] - az
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    square = nx * nx + ny * ny + nz * nz
    if square > 0.0:
        # Barycentric coordinates of the origin's projection, times square.
        bj = -((ay * vz - az * vy) * nx + (az * vx - ax * vz) * ny + (ax * vy - ay * vx) * nz)
        bk = -((uy * az - uz * ay) * nx + (uz * ax - ux * az) * ny + (ux * ay - uy * ax) * nz)
        if bj >= 0.0 and bk >= 0.0 and bj + bk <= square:
            height = (ax * nx + ay * ny + az * nz) / square
            return (1 << i) | (1 << j) | (1 << k), height * nx, height * ny, height * nz
    mask, px, py, pz = _nearest_on_segment(s, i, j)
    best = px * px + py * py + pz * pz
    for a, b in ((i, k), (j, k)):
        m, x, y, z = _nearest_on_segment(s, a, b)
        if x * x + y * y + z * z < best:
            best = x * x + y * y + z * z
            mask, px, py, pz = m, x, y, z
    return mask, px, py, pz


@jit(types.Tuple((I64, F64, F64, F64))(OUT2), allocates=False)
def _nearest_on_tetrahedron(s):
    """The same for four corners; all bits set when the origin lies inside."""
    mask, px, py, pz = 15, 0.0, 0.0, 0.0
    best = np.inf
    for i, j, k, other in ((0, 1, 2, 3), (0, 1, 3, 2), (0, 2, 3, 1), (1, 2, 3, 0)):
        ux, uy, uz = s[j, 0] - s[i, 0], s[j, 1] - s[i, 1], s[j, 2] - s[i, 2]
        vx, vy, vz = s[k, 0] - s[i, 0], s[k, 1] - s[i, 1], s[k, 2] - s[i, 2]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        origin = -(s[i, 0] * nx + s[i, 1] * ny + s[i, 2] * nz)
        corner = (s[other, 0] - s[i, 0]) * nx + (s[other, 1] - s[i, 1]) * ny + (s[other, 2] - s[i, 2]) * nz
        if origin * corner <= 0.0:
            m, x, y, z = _nearest_on_triangle(s, i, j, k)
            if x * x + y * y + z * z < best:
                best = x * x + y * y + z * z
                mask, px, py, pz = m, x, y, z
    return mask, px, py, pz


@jit(types.Tuple((I64, F64, F64, F64))(OUT2, I64), allocates=False)
def _reduce(s, count):
    """Keep only the corners that carry the point nearest to the origin: their number (0: origin inside), the point."""
    if count == 1:
        return 1, s[0, 0], s[0, 1], s[0, 2]
    if count == 2:
        mask, x, y, z = _nearest_on_segment(s, 0, 1)
    elif count == 3:
        mask, x, y, z = _nearest_on_triangle(s, 0, 1, 2)
    else:
        mask, x, y, z = _nearest_on_tetrahedron(s)
        if mask == 15:
            return 0, 0.0, 0.0, 0.0
    kept = 0
    for i in range(count):
        if mask >> i & 1:
            for c in range(3):
                s[kept, c] = s[i, c]
            kept += 1
    return kept, x, y, z


@jit(types.UniTuple(F64, 2)(*_BODY, *_BODY, F64, F64, OUT1, OUT2), entry=True, allocates=False)
def separation(
    kind_a,
    size_a,
    pose_a,
    corners_a,
    links_a,
    start_a,
    kind_b,
    size_b,
    pose_b,
    corners_b,
    links_b,
    start_b,
    least,
    enough,
    n,
    s,
):
    """Bounds of the distance between two cores [m].

    It ends as soon as the gap is proven to be `enough`, or to lie between `least` and `enough`.

    Args:
        kind_a: A body, see `support`.
        size_a: The same.
        pose_a: The same.
        corners_a: The same.
        links_a: The same.
        start_a: The same.
        kind_b: Another body.
        size_b: The same.
        pose_b: The same.
        corners_b: The same.
        links_b: The same.
        start_b: The same.
        least: A gap below this is a contact [m].
        enough: A gap above this is all that is asked for [m].
        n: Direction to try first, shape (3,), not zero; on return the best one found.
        s: Scratch memory, shape (4, 3).

    Returns:
        A proven lower bound (-inf: none found), and an upper bound (0: the cores overlap).
    """
    x, y, z = n[0], n[1], n[2]
    lower, upper = -np.inf, np.inf
    count, corner_a, corner_b = 0, start_a, start_b
    for _ in range(_ITERATIONS):
        length = np.sqrt(x * x + y * y + z * z)
        if length < 1e-12:
            return lower, max(lower, 0.0)
        ax, ay, az, corner_a = support(kind_a, size_a, pose_a, corners_a, links_a, corner_a, -x, -y, -z)
        bx, by, bz, corner_b = support(kind_b, size_b, pose_b, corners_b, links_b, corner_b, x, y, z)
        wx, wy, wz = ax - bx, ay - by, az - bz
        gap = (wx * x + wy * y + wz * z) / length
        if gap > lower:
            lower = gap
            n[0], n[1], n[2] = x / length, y / length, z / length
            if lower >= enough or (lower > least and upper < enough):
                return lower, upper
        if count > 0 and length - gap <= 1e-10 * length + 1e-13:
            return lower, upper
        for i in range(count):
            if s[i, 0] == wx and s[i, 1] == wy and s[i, 2] == wz:
                return lower, upper
        s[count, 0], s[count, 1], s[count, 2] = wx, wy, wz
        count, x, y, z = _reduce(s, count + 1)
        if count == 0:
            # A tetrahedron so flat that rounding puts the origin inside does not refute a proven gap.
            return lower, upper if lower > 0.0 else 0.0
        nearer = np.sqrt(x * x + y * y + z * z)
        if nearer >= upper:
            return lower, upper
        upper = nearer
        if lower > least and upper < enough:
            return lower, upper
    return lower, upper
