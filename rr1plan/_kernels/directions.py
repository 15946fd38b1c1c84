# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""Two convex bodies that spheres cannot tell apart: a separating direction for several configurations at once.

Better directions than the one at hand are those to the point nearest to the origin of a growing simplex in the
difference of the bodies (Gilbert, Johnson and Keerthi, A fast procedure for computing the distance between complex
objects in three-dimensional space, 1988); a triangle of it is kept. What a direction proves, `supports.py` tells.

The points found lie in the bodies. Where they are nearer than the padding, so are the bodies.
"""

from __future__ import annotations

from numba import types

from rr1plan._kernels.cover import ALL, COVER, FRAME, HALF_SPACE, RECORD, SPHERE, WORK, tables_of
from rr1plan._kernels.jit import F64, I64, jit
from rr1plan._kernels.lanes import LANES, WIDTH, below, choose, fill, greater, lesser, load, root, store
from rr1plan._kernels.obstacles import nearest_in
from rr1plan._kernels.simplex import surrounds, take_in
from rr1plan._kernels.supports import (
    along_origin,
    fastest,
    gap_within,
    highest_of_other,
    lowest,
    lowest_within,
    to_local,
    to_world,
)

# Searches longer than this are rare.
_STEPS = 24
# A gap along a direction that is this part of the distance found is good enough.
_GOOD = 0.9
_NEAR = types.UniTuple(I64, 3)


@jit(types.UniTuple(I64, 3)(I64, I64, F64, F64, I64, LANES, COVER, WORK), inline=True, allocates=False)
def _over_half_space(a, o, padding, push, asked, h, cover, work):
    """See `separate`; there is but one direction."""
    values, at = cover.obstacle_values, cover.cores[a, 0] * FRAME
    offset = values[o, 2] * values[o, 9] + values[o, 5] * values[o, 10] + values[o, 8] * values[o, 11]
    beyond, needed = offset + cover.core_values[a, 3], padding + cover.margins[0]
    x, y, z = fill(values[o, 2]), fill(values[o, 5]), fill(values[o, 8])
    lx, ly, lz = to_local(work.frames, at, x, y, z)
    low, u, v, w = lowest(a, lx, ly, lz, asked, cover, work)
    low = low + along_origin(work.frames, at, x, y, z) - beyond
    stuck, touching = below(low, needed) & asked, below(low, padding - cover.margins[0]) & asked
    if touching:
        return asked, stuck, touching
    lost = beyond + h * h * (0.5 * push)
    gap = lowest_within(a, x, y, z, (u, v, w), 0, asked, h, cover, work) - lost
    return below(gap, needed) & asked, stuck, 0


@jit(types.Tuple((LANES, LANES, LANES, I64))(I64, I64, _NEAR, COVER, WORK), inline=True, allocates=False)
def _begin(b, o, near, cover, work):
    """Where to begin: from the other to the sphere that is too near, or the last direction on this edge.

    With it comes 1 where it is between points of the cores.
    """
    starts, spheres, centres, slot = work.starts, cover.spheres, work.centres, near[0]
    if work.begun[slot] == work.counts[3]:
        return fill(starts[slot, 0]), fill(starts[slot, 1]), fill(starts[slot, 2]), 0
    work.begun[slot] = work.counts[3]
    at, to = near[1] * SPHERE, near[2] * SPHERE
    x, y, z = load(centres, at), load(centres, at + WIDTH), load(centres, at + 2 * WIDTH)
    # A ball inside has its centre there.
    within = 1 if spheres[near[1], 4] > 0.0 else 0
    if b < 0:
        u, v, w = nearest_in(cover.obstacle_values, cover.obstacles, o, x, y, z)
    elif near[1] == near[2]:
        middle = fill(cover.core_values[b, 0]), fill(cover.core_values[b, 1]), fill(cover.core_values[b, 2])
        u, v, w = to_world(work.frames, cover.cores[b, 0] * FRAME, *middle)
    else:
        u, v, w = load(centres, to), load(centres, to + WIDTH), load(centres, to + 2 * WIDTH)
        within &= 1 if spheres[near[2], 4] > 0.0 else 0
    return x - u, y - v, z - w, within


@jit(types.void(I64, I64, LANES, LANES, LANES, WORK), inline=True, allocates=False)
def _end(slot, left, x, y, z, work):
    """The next search on this edge begins with the direction found in the first lane that is left."""
    lane = 0
    while not left >> lane & 1:
        lane += 1
    store(work.walk, 0, x)
    store(work.walk, WIDTH, y)
    store(work.walk, 2 * WIDTH, z)
    for c in range(3):
        work.starts[slot, c] = work.walk[c * WIDTH + lane]


@jit(types.UniTuple(I64, 3)(I64, I64, I64, I64, _NEAR, F64, F64, I64, LANES, RECORD), allocates=False)
def separate(a, b, o, base, near, padding, push, asked, h, record):
    """A body against another, or against an obstacle, in the lanes asked for.

    Args:
        a: Core of the body.
        b: Core of the other, -1 if it is an obstacle with a closed form.
        o: That obstacle.
        base: Frame that carries both (0: the world).
        near: The pair, a sphere of the body and one of the other (the same: an obstacle) that are too near each other.
        padding: Distance to keep [m].
        push: Greatest acceleration of one against the other.
        asked: Bits of the lanes.
        h: Half widths of the intervals.
        record: Of `cover.TABLES`.

    Returns:
        Bits of the lanes that stay open, of those in which even the middle of the interval is not proven, and of
        those with a contact in the middle.
    """
    cover, work, _, _ = tables_of(record)
    frames, values = work.frames, cover.obstacle_values
    if b < 0 and cover.obstacles[o, 0] == HALF_SPACE:
        return _over_half_space(a, o, padding, push, asked, h, cover, work)
    at, radius = cover.cores[a, 0] * FRAME, cover.core_values[a, 3]
    radius += values[o, 15] if b < 0 else cover.core_values[b, 3]
    needed, lost = padding + cover.margins[0], h * h * (0.5 * push)
    # The point nearest to the origin so far, and three points of the difference of the bodies around it.
    px, py, pz, within = _begin(b, o, near, cover, work)
    square = px * px + py * py + pz * pz
    part = 1.0 / greater(root(square), 1e-12)
    x, y, z = px * part, py * part, pz * part
    best, nx, ny, nz = fill(-1e300), x, y, z
    ax, ay, az, bx, by, bz, cx, cy, cz = px, py, pz, px, py, pz, px, py, pz
    lx, ly, lz, top = x, y, z, (x, y, z)
    for step in range(_STEPS):
        lx, ly, lz = to_local(frames, at, x, y, z)
        low, lx, ly, lz = lowest(a, lx, ly, lz, asked, cover, work)
        wx, wy, wz = to_world(frames, at, lx, ly, lz)
        high, (u, v, w), top = highest_of_other(b, o, x, y, z, asked, cover, work)
        gap = low + along_origin(frames, at, x, y, z) - high - radius
        nx, ny, nz = choose(best, gap, x, nx), choose(best, gap, y, ny), choose(best, gap, z, nz)
        best = greater(best, gap)
        if below(best, needed) & asked == 0:
            travel = h * fastest(a, nx, ny, nz, base, cover, work)
            if b >= 0:
                travel = travel + h * fastest(b, nx, ny, nz, base, cover, work)
            if below(best - travel - lost, needed) & asked == 0:
                return 0, 0, 0
        wx, wy, wz = wx - u, wy - v, wz - w
        if step == 0 and not within:
            px, py, pz = wx, wy, wz
            square = wx * wx + wy * wy + wz * wz
            ax, ay, az, bx, by, bz, cx, cy, cz = wx, wy, wz, wx, wy, wz, wx, wy, wz
        else:
            surrounded = surrounds((wx, wy, wz), (ax, ay, az), (bx, by, bz), (cx, cy, cz))
            touching = (ALL ^ below(surrounded, 0.0)) & asked
            if touching:
                return asked, asked, touching
            (qx, qy, qz), (ax, ay, az), (bx, by, bz) = take_in((wx, wy, wz), (ax, ay, az), (bx, by, bz), (cx, cy, cz))
            cx, cy, cz = wx, wy, wz
            least = qx * qx + qy * qy + qz * qz
            px, py, pz = choose(least, square, qx, px), choose(least, square, qy, py), choose(least, square, qz, pz)
            square = lesser(least, square)
        distance = root(square)
        touching = below(distance - radius, padding - cover.margins[0]) & asked
        if touching:
            return asked, asked, touching
        if below(best - padding, _GOOD * (distance - radius - padding)) & asked == 0:
            break
        part = 1.0 / greater(distance, 1e-9)
        x, y, z = px * part, py * part, pz * part
    stuck = below(best, needed) & asked
    left = asked
    if stuck != asked:
        bottom, direction = (lx, ly, lz), (nx, ny, nz)
        gap = gap_within(a, b, o, base, direction, bottom, top, asked, h, cover, work) - radius - lost
        left = below(gap, needed) & asked | stuck
    if left:
        _end(near[0], left, nx, ny, nz, work)
    return left, stuck, 0
