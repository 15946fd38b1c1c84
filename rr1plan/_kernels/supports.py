# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""How far convex bodies reach along directions, where they are and while they move, for several configurations at once.

Along a direction n the gap of two bodies is the least of n.a over points a of one, less the greatest of n.b over
the other's: a bound from below of their distance. In the time h before and after, a point with velocity v and an
acceleration of at most c gets no nearer along n than by |n.v| h + c h^2 / 2, so a whole interval is proven by corners
as well.
"""

from __future__ import annotations

import numpy as np
from numba import types

from rr1plan._kernels.cover import BLOCK, COVER, DIRECTION_CELLS, FRAME, ROUND, SLACK, WORK
from rr1plan._kernels.jit import I64, jit
from rr1plan._kernels.lanes import (
    LANES,
    WIDTH,
    below,
    choose,
    fill,
    first_bit,
    floor,
    greater,
    lesser,
    load,
    root,
    size_of,
    store,
)
from rr1plan._kernels.obstacles import farthest_in
from rr1plan._kernels.tables import NUMBERS

_HALF = 0.5 * DIRECTION_CELLS
_LANES3 = types.UniTuple(LANES, 3)


@jit(_LANES3(NUMBERS, I64, LANES, LANES, LANES), inline=True, allocates=False)
def to_local(frames, at, x, y, z):
    """Directions of the world in a frame."""
    return (
        load(frames, at) * x + load(frames, at + 3 * WIDTH) * y + load(frames, at + 6 * WIDTH) * z,
        load(frames, at + WIDTH) * x + load(frames, at + 4 * WIDTH) * y + load(frames, at + 7 * WIDTH) * z,
        load(frames, at + 2 * WIDTH) * x + load(frames, at + 5 * WIDTH) * y + load(frames, at + 8 * WIDTH) * z,
    )


@jit(_LANES3(NUMBERS, I64, LANES, LANES, LANES), inline=True, allocates=False)
def _to_axes(frames, at, x, y, z):
    """Directions of a frame in the world."""
    return (
        load(frames, at) * x + load(frames, at + WIDTH) * y + load(frames, at + 2 * WIDTH) * z,
        load(frames, at + 3 * WIDTH) * x + load(frames, at + 4 * WIDTH) * y + load(frames, at + 5 * WIDTH) * z,
        load(frames, at + 6 * WIDTH) * x + load(frames, at + 7 * WIDTH) * y + load(frames, at + 8 * WIDTH) * z,
    )


@jit(_LANES3(NUMBERS, I64, LANES, LANES, LANES), inline=True, allocates=False)
def to_world(frames, at, x, y, z):
    """Points of a frame in the world."""
    u, v, w = _to_axes(frames, at, x, y, z)
    return u + load(frames, at + 9 * WIDTH), v + load(frames, at + 10 * WIDTH), w + load(frames, at + 11 * WIDTH)


@jit(LANES(NUMBERS, I64, LANES, LANES, LANES), inline=True, allocates=False)
def along_origin(frames, at, x, y, z):
    """Where a frame's origin is along directions of the world."""
    return x * load(frames, at + 9 * WIDTH) + y * load(frames, at + 10 * WIDTH) + z * load(frames, at + 11 * WIDTH)


@jit(I64(I64, LANES, LANES, LANES, I64, COVER, WORK), inline=True, allocates=False)
def _candidates(k, x, y, z, asked, cover, work):
    """Bits of the corners of a core that can be the lowest along directions of its frame, in lanes asked for."""
    values = cover.core_values
    u = x * values[k, 5] + y * values[k, 8] + z * values[k, 11]
    v = x * values[k, 6] + y * values[k, 9] + z * values[k, 12]
    w = x * values[k, 7] + y * values[k, 10] + z * values[k, 13]
    part = _HALF / greater(size_of(u) + size_of(v) + size_of(w), 1e-300)
    # Whatever is no number ends within the table too.
    row = greater(lesser(floor(u * part + _HALF), 2.0 * _HALF - 1.0), 0.0)
    column = greater(lesser(floor(v * part + _HALF), 2.0 * _HALF - 1.0), 0.0)
    store(work.walk, 0, choose(w, 0.0, 4.0 * _HALF * _HALF, 0.0) + row * (2.0 * _HALF) + column)
    found, first = 0, cover.cores[k, 5]
    for i in range(WIDTH):
        found |= cover.lowest[first + np.int64(work.walk[i])] & -(asked >> i & 1)
    return found


@jit(types.UniTuple(LANES, 4)(I64, LANES, LANES, LANES, COVER), inline=True, allocates=False)
def _lowest_of_round(k, x, y, z, cover):
    """See `lowest`, for a cylinder: centre, axis, half length and radius."""
    points, first = cover.points, cover.cores[k, 1]
    along = x * points[first + 1, 0] + y * points[first + 1, 1] + z * points[first + 1, 2]
    u, v, w = (
        x - along * points[first + 1, 0],
        y - along * points[first + 1, 1],
        z - along * points[first + 1, 2],
    )
    part = -points[first + 2, 1] / greater(root(u * u + v * v + w * w), 1e-12)
    end = choose(along, 0.0, points[first + 2, 0], -points[first + 2, 0])
    px = points[first, 0] + end * points[first + 1, 0] + u * part
    py = points[first, 1] + end * points[first + 1, 1] + v * part
    pz = points[first, 2] + end * points[first + 1, 2] + w * part
    return x * px + y * py + z * pz, px, py, pz


@jit(types.UniTuple(LANES, 4)(I64, LANES, LANES, LANES, I64, COVER, WORK), inline=True, allocates=False)
def lowest(k, x, y, z, asked, cover, work):
    """The least n.p over the core of a body, n a direction of its frame, and the point p where that is.

    In lanes that are not asked for it is n.p of some point.
    """
    points = cover.points
    first, last, shared = cover.cores[k, 1], cover.cores[k, 2], cover.cores[k, 6]
    if cover.cores[k, 3] == ROUND:
        return _lowest_of_round(k, x, y, z, cover)
    best, px, py, pz = fill(1e300), fill(0.0), fill(0.0), fill(0.0)
    left, begin, end = 1, first, last
    if shared:
        left = _candidates(k, x, y, z, asked, cover, work)
    while left:
        if shared:
            begin = first + first_bit(left) * shared
            end = min(begin + shared, last)
        left &= left - 1
        for p in range(begin, end):
            value = x * points[p, 0] + y * points[p, 1] + z * points[p, 2]
            px = choose(value, best, points[p, 0], px)
            py = choose(value, best, points[p, 1], py)
            pz = choose(value, best, points[p, 2], pz)
            best = lesser(value, best)
    return best, px, py, pz


@jit(types.UniTuple(LANES, 4)(I64, LANES, LANES, LANES, I64, COVER, WORK), inline=True, allocates=False)
def _speeds_along(k, x, y, z, base, cover, work):
    """Terms c and m of the speed c + m.p of a core's point p along directions of the world, seen from frame `base`."""
    frames = work.frames
    at, base_at = cover.cores[k, 0] * FRAME, base * FRAME
    bx, by, bz = (
        load(frames, base_at + 12 * WIDTH),
        load(frames, base_at + 13 * WIDTH),
        load(frames, base_at + 14 * WIDTH),
    )
    dx = load(frames, at + 9 * WIDTH) - load(frames, base_at + 9 * WIDTH)
    dy = load(frames, at + 10 * WIDTH) - load(frames, base_at + 10 * WIDTH)
    dz = load(frames, at + 11 * WIDTH) - load(frames, base_at + 11 * WIDTH)
    u = load(frames, at + 15 * WIDTH) - load(frames, base_at + 15 * WIDTH) - (by * dz - bz * dy)
    v = load(frames, at + 16 * WIDTH) - load(frames, base_at + 16 * WIDTH) - (bz * dx - bx * dz)
    w = load(frames, at + 17 * WIDTH) - load(frames, base_at + 17 * WIDTH) - (bx * dy - by * dx)
    wx = load(frames, at + 12 * WIDTH) - bx
    wy = load(frames, at + 13 * WIDTH) - by
    wz = load(frames, at + 14 * WIDTH) - bz
    # n.(w x p) = (n x w).p
    mx, my, mz = to_local(frames, at, y * wz - z * wy, z * wx - x * wz, x * wy - y * wx)
    return x * u + y * v + z * w, mx, my, mz


@jit(LANES(I64, LANES, LANES, LANES, I64, COVER, WORK), inline=True, allocates=False)
def fastest(k, x, y, z, base, cover, work):
    """A bound of the speed, without sign, of any point of a core along directions, seen from frame `base`."""
    values = cover.core_values
    speed, mx, my, mz = _speeds_along(k, x, y, z, base, cover, work)
    centre = size_of(speed + mx * values[k, 0] + my * values[k, 1] + mz * values[k, 2])
    return (centre + root(mx * mx + my * my + mz * mz) * values[k, 4]) * SLACK


@jit(LANES(I64, LANES, LANES, LANES, _LANES3, I64, I64, LANES, COVER, WORK), inline=True, allocates=False)
def lowest_within(k, x, y, z, low, base, asked, h, cover, work):
    """The least n.p - h |n.v| over the core of a body, n a direction of the world, v seen from frame `base`.

    In the lanes asked for; it is found sooner the lower the point `low` of the core is that it begins with.
    """
    frames, points, blocks = work.frames, cover.points, cover.blocks
    at = cover.cores[k, 0] * FRAME
    speed, mx, my, mz = _speeds_along(k, x, y, z, base, cover, work)
    lx, ly, lz = to_local(frames, at, x, y, z)
    first, last = cover.cores[k, 1], cover.cores[k, 2]
    offset = along_origin(frames, at, x, y, z)
    if cover.cores[k, 3] == ROUND:
        best, _, _, _ = lowest(k, lx, ly, lz, asked, cover, work)
        return offset + best - h * fastest(k, x, y, z, base, cover, work)
    turn = root(mx * mx + my * my + mz * mz) * h
    best = lx * low[0] + ly * low[1] + lz * low[2]
    best = best - h * size_of(speed + mx * low[0] + my * low[1] + mz * low[2])
    for i in range(first, last, BLOCK):
        n = (i - first) // BLOCK + cover.cores[k, 4]
        ball = blocks[n, 0], blocks[n, 1], blocks[n, 2], blocks[n, 3]
        value = lx * ball[0] + ly * ball[1] + lz * ball[2] - ball[3]
        value = value - h * size_of(speed + mx * ball[0] + my * ball[1] + mz * ball[2]) - turn * ball[3]
        if below(value, best) & asked == 0:
            continue
        for p in range(i, min(i + BLOCK, last)):
            px, py, pz = points[p, 0], points[p, 1], points[p, 2]
            value = lx * px + ly * py + lz * pz
            best = lesser(value - h * size_of(speed + mx * px + my * py + mz * pz), best)
    return offset + best


@jit(
    types.Tuple((LANES, _LANES3, _LANES3))(I64, I64, LANES, LANES, LANES, I64, COVER, WORK),
    inline=True,
    allocates=False,
)
def highest_of_other(b, o, x, y, z, asked, cover, work):
    """The greatest n.p over the other's core, n a direction of the world, p in the world and in its frame."""
    if b < 0:
        high, u, v, w = farthest_in(cover.obstacle_values, cover.obstacles, o, x, y, z)
        return high, (u, v, w), (u, v, w)
    at = cover.cores[b, 0] * FRAME
    lx, ly, lz = to_local(work.frames, at, x, y, z)
    low, u, v, w = lowest(b, -lx, -ly, -lz, asked, cover, work)
    return along_origin(work.frames, at, x, y, z) - low, to_world(work.frames, at, u, v, w), (u, v, w)


@jit(LANES(I64, I64, I64, I64, _LANES3, _LANES3, _LANES3, I64, LANES, COVER, WORK), inline=True, allocates=False)
def gap_within(a, b, o, base, direction, low, high, asked, h, cover, work):
    """The least gap of two cores along directions while they move at their present velocities [m].

    It is found sooner where `low` is far down in the one and `high` far up in the other, in their frames.
    """
    x, y, z = direction
    gap = lowest_within(a, x, y, z, low, base, asked, h, cover, work)
    if b < 0:
        farthest, _, _, _ = farthest_in(cover.obstacle_values, cover.obstacles, o, x, y, z)
        return gap - farthest
    return gap + lowest_within(b, -x, -y, -z, high, base, asked, h, cover, work)
