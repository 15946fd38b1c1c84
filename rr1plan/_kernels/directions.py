# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""Two convex bodies that spheres cannot tell apart: a separating direction for several configurations at once.

Along a direction n the gap of two bodies is the least of n.a over points a of one, less the greatest of n.b over
the other's: a bound from below of their distance. Better directions are those to the point nearest to the origin of
a growing simplex in the difference of the bodies (Gilbert, Johnson and Keerthi, A fast procedure for computing the
distance between complex objects in three-dimensional space, 1988); a triangle of it is kept. In the time h before
and after, a point with velocity v and an acceleration of at most c gets no nearer along n than by |n.v| h + c h^2 / 2,
so a whole interval is proven by corners as well.

The points found lie in the bodies. Where they are nearer than the padding, so are the bodies.
"""

from __future__ import annotations

from numba import types

from rr1plan._kernels.cover import ALL, BLOCK, COVER, FRAME, HALF_SPACE, RECORD, ROUND, SLACK, SPHERE, WORK, tables_of
from rr1plan._kernels.jit import F64, I64, OUT1, jit
from rr1plan._kernels.lanes import (
    LANES,
    WIDTH,
    below,
    choose,
    fill,
    greater,
    lesser,
    load,
    root,
    size_of,
    store,
)
from rr1plan._kernels.obstacles import farthest_in, nearest_in

# Searches longer than this are rare.
_STEPS = 24
# A gap along a direction that is this part of the distance found is good enough.
_GOOD = 0.9
_LANES3 = types.UniTuple(LANES, 3)
_NEAR = types.UniTuple(I64, 3)


@jit(_LANES3(OUT1, I64, LANES, LANES, LANES), inline=True, allocates=False)
def _to_local(frames, at, x, y, z):
    """Directions of the world in a frame."""
    return (
        load(frames, at) * x + load(frames, at + 3 * WIDTH) * y + load(frames, at + 6 * WIDTH) * z,
        load(frames, at + WIDTH) * x + load(frames, at + 4 * WIDTH) * y + load(frames, at + 7 * WIDTH) * z,
        load(frames, at + 2 * WIDTH) * x + load(frames, at + 5 * WIDTH) * y + load(frames, at + 8 * WIDTH) * z,
    )


@jit(_LANES3(OUT1, I64, LANES, LANES, LANES), inline=True, allocates=False)
def _to_axes(frames, at, x, y, z):
    """Directions of a frame in the world."""
    return (
        load(frames, at) * x + load(frames, at + WIDTH) * y + load(frames, at + 2 * WIDTH) * z,
        load(frames, at + 3 * WIDTH) * x + load(frames, at + 4 * WIDTH) * y + load(frames, at + 5 * WIDTH) * z,
        load(frames, at + 6 * WIDTH) * x + load(frames, at + 7 * WIDTH) * y + load(frames, at + 8 * WIDTH) * z,
    )


@jit(_LANES3(OUT1, I64, LANES, LANES, LANES), inline=True, allocates=False)
def _to_world(frames, at, x, y, z):
    """Points of a frame in the world."""
    u, v, w = _to_axes(frames, at, x, y, z)
    return u + load(frames, at + 9 * WIDTH), v + load(frames, at + 10 * WIDTH), w + load(frames, at + 11 * WIDTH)


@jit(LANES(OUT1, I64, LANES, LANES, LANES), inline=True, allocates=False)
def _along_origin(frames, at, x, y, z):
    """Where a frame's origin is along directions of the world."""
    return x * load(frames, at + 9 * WIDTH) + y * load(frames, at + 10 * WIDTH) + z * load(frames, at + 11 * WIDTH)


@jit(LANES(I64, LANES, LANES, LANES, COVER), inline=True, allocates=False)
def _lowest_of_blocks(k, x, y, z, cover):
    """The least n.p over the first corner of each block of a core: no less than over all."""
    points, best = cover.points, fill(1e300)
    for i in range(cover.cores[k, 1], cover.cores[k, 2], BLOCK):
        best = lesser(x * points[i, 0] + y * points[i, 1] + z * points[i, 2], best)
    return best


@jit(types.UniTuple(LANES, 4)(I64, LANES, LANES, LANES, COVER), inline=True, allocates=False)
def lowest(k, x, y, z, cover):
    """The least n.p over the core of a body, n a direction of its frame, and the point p where that is."""
    points = cover.points
    first, last = cover.cores[k, 1], cover.cores[k, 2]
    if cover.cores[k, 3] == ROUND:
        # Centre, axis, half length and radius.
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
    bound, best = _lowest_of_blocks(k, x, y, z, cover), fill(1e300)
    px, py, pz = fill(0.0), fill(0.0), fill(0.0)
    for i in range(first, last, BLOCK):
        ball = cover.blocks[(i - first) // BLOCK + cover.cores[k, 4]]
        # What is no lower than a corner at hand is left out, but for equals: all take part, in one order.
        if below(x * ball[0] + y * ball[1] + z * ball[2] - ball[3], bound) == 0:
            continue
        for p in range(i, min(i + BLOCK, last)):
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
    mx, my, mz = _to_local(frames, at, y * wz - z * wy, z * wx - x * wz, x * wy - y * wx)
    return x * u + y * v + z * w, mx, my, mz


@jit(LANES(I64, LANES, LANES, LANES, I64, COVER, WORK), inline=True, allocates=False)
def _fastest(k, x, y, z, base, cover, work):
    """A bound of the speed, without sign, of any point of a core along directions, seen from frame `base`."""
    middle = cover.core_values[k]
    speed, mx, my, mz = _speeds_along(k, x, y, z, base, cover, work)
    centre = size_of(speed + mx * middle[0] + my * middle[1] + mz * middle[2])
    return (centre + root(mx * mx + my * my + mz * mz) * middle[4]) * SLACK


@jit(LANES(I64, LANES, LANES, LANES, I64, LANES, COVER, WORK), inline=True, allocates=False)
def lowest_within(k, x, y, z, base, h, cover, work):
    """The least n.p - h |n.v| over the core of a body, n a direction of the world, v seen from frame `base`."""
    frames, points = work.frames, cover.points
    at = cover.cores[k, 0] * FRAME
    speed, mx, my, mz = _speeds_along(k, x, y, z, base, cover, work)
    lx, ly, lz = _to_local(frames, at, x, y, z)
    first, last = cover.cores[k, 1], cover.cores[k, 2]
    offset = _along_origin(frames, at, x, y, z)
    if cover.cores[k, 3] == ROUND:
        best, _, _, _ = lowest(k, lx, ly, lz, cover)
        return offset + best - h * _fastest(k, x, y, z, base, cover, work)
    best, turn = fill(1e300), root(mx * mx + my * my + mz * mz) * h
    for i in range(first, last, BLOCK):
        ball = cover.blocks[(i - first) // BLOCK + cover.cores[k, 4]]
        value = lx * ball[0] + ly * ball[1] + lz * ball[2] - ball[3]
        value = value - h * size_of(speed + mx * ball[0] + my * ball[1] + mz * ball[2]) - turn * ball[3]
        if below(value, best) == 0:
            continue
        for p in range(i, min(i + BLOCK, last)):
            px, py, pz = points[p, 0], points[p, 1], points[p, 2]
            value = lx * px + ly * py + lz * pz
            best = lesser(value - h * size_of(speed + mx * px + my * py + mz * pz), best)
    return offset + best


@jit(types.UniTuple(I64, 3)(I64, I64, F64, F64, I64, LANES, COVER, WORK), inline=True, allocates=False)
def _over_half_space(a, o, padding, push, asked, h, cover, work):
    """See `separate`; there is but one direction."""
    values, at = cover.obstacle_values, cover.cores[a, 0] * FRAME
    beyond = values[o, 15] + cover.core_values[a, 3]
    needed = padding + cover.margins[0]
    x, y, z = fill(values[o, 12]), fill(values[o, 13]), fill(values[o, 14])
    gap = lowest_within(a, x, y, z, 0, h, cover, work) - beyond - h * h * (0.5 * push)
    left = below(gap, needed) & asked
    if left == 0:
        return 0, 0, 0
    lx, ly, lz = _to_local(work.frames, at, x, y, z)
    low, _, _, _ = lowest(a, lx, ly, lz, cover)
    low = low + _along_origin(work.frames, at, x, y, z) - beyond
    return left, below(low, needed) & left, below(low, padding - cover.margins[0]) & left


@jit(types.UniTuple(LANES, 4)(I64, I64, LANES, LANES, LANES, COVER, WORK), inline=True, allocates=False)
def _highest_of_other(b, o, x, y, z, cover, work):
    """The greatest n.p over the other's core, n a direction of the world, and that point p in the world."""
    if b < 0:
        return farthest_in(cover.obstacle_values, cover.obstacles, o, x, y, z)
    at = cover.cores[b, 0] * FRAME
    lx, ly, lz = _to_local(work.frames, at, x, y, z)
    low, u, v, w = lowest(b, -lx, -ly, -lz, cover)
    u, v, w = _to_world(work.frames, at, u, v, w)
    return _along_origin(work.frames, at, x, y, z) - low, u, v, w


@jit(_LANES3(LANES, LANES, LANES, LANES, LANES, LANES), inline=True, allocates=False)
def _nearest_in_triangle(ww, wa, wb, aa, ab, bb):
    """Weights of both edges at a point w that lead to where their triangle is nearest to the origin, and the square.

    All products of w and the edges are given. Where that is on the edge across from w, another point.
    """
    det = aa * bb - ab * ab
    inside = choose(aa * bb * 1e-10, det, 1.0, 0.0)
    scale = 1.0 / greater(det, 1e-300)
    s = (ab * wb - bb * wa) * scale
    t = (ab * wa - aa * wb) * scale
    inside = choose(s, 0.0, 0.0, choose(t, 0.0, 0.0, choose(1.0, s + t, 0.0, inside)))
    along_a = greater(lesser(-wa / greater(aa, 1e-300), 1.0), 0.0)
    along_b = greater(lesser(-wb / greater(bb, 1e-300), 1.0), 0.0)
    on_a = ww + along_a * (2.0 * wa + along_a * aa)
    on_b = ww + along_b * (2.0 * wb + along_b * bb)
    square = ww + s * (2.0 * wa + s * aa) + t * (2.0 * wb + t * bb) + 2.0 * s * t * ab
    edge_s, edge_t = choose(on_a, on_b, along_a, 0.0), choose(on_a, on_b, 0.0, along_b)
    s, t = choose(0.0, inside, s, edge_s), choose(0.0, inside, t, edge_t)
    return s, t, choose(0.0, inside, square, lesser(on_a, on_b))


@jit(LANES(_LANES3, _LANES3), inline=True, allocates=False)
def _product(a, b):
    """The product a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@jit(_LANES3(LANES, LANES, _LANES3, _LANES3), inline=True, allocates=False)
def _either(one, other, a, b):
    """The point a in lanes where `one` is less than `other`, else b."""
    return choose(one, other, a[0], b[0]), choose(one, other, a[1], b[1]), choose(one, other, a[2], b[2])


@jit(_LANES3(_LANES3, LANES, _LANES3, LANES, _LANES3), inline=True, allocates=False)
def _sum(w, s, e, t, f):
    """The point w + s e + t f."""
    return w[0] + s * e[0] + t * f[0], w[1] + s * e[1] + t * f[1], w[2] + s * e[2] + t * f[2]


@jit(types.UniTuple(_LANES3, 3)(_LANES3, _LANES3, _LANES3, _LANES3), inline=True, allocates=False)
def _take_in(w, a, b, c):
    """Of the triangles of a new corner w with two of three others: the point nearest to the origin, and the two."""
    e, f, g = (
        (a[0] - w[0], a[1] - w[1], a[2] - w[2]),
        (b[0] - w[0], b[1] - w[1], b[2] - w[2]),
        (c[0] - w[0], c[1] - w[1], c[2] - w[2]),
    )
    ww, we, wf, wg = _product(w, w), _product(w, e), _product(w, f), _product(w, g)
    ee, ff, gg = _product(e, e), _product(f, f), _product(g, g)
    ef, eg, fg = _product(e, f), _product(e, g), _product(f, g)
    s, t, least = _nearest_in_triangle(ww, we, wf, ee, ef, ff)
    q, one, two = _sum(w, s, e, t, f), a, b
    s, t, square = _nearest_in_triangle(ww, we, wg, ee, eg, gg)
    q, two, least = _either(square, least, _sum(w, s, e, t, g), q), _either(square, least, c, b), lesser(square, least)
    s, t, square = _nearest_in_triangle(ww, wf, wg, ff, fg, gg)
    one, two = _either(square, least, b, one), _either(square, least, c, two)
    return _either(square, least, _sum(w, s, f, t, g), q), one, two


@jit(LANES(LANES, LANES, LANES, LANES, LANES, LANES, LANES, LANES, LANES), inline=True, allocates=False)
def _volume(ax, ay, az, bx, by, bz, cx, cy, cz):
    """The product a . (b x c)."""
    return ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)


@jit(LANES(_LANES3, _LANES3, _LANES3, _LANES3), inline=True, allocates=False)
def _surrounds(w, a, b, c):
    """Above zero where the origin is well inside the tetrahedron of four points."""
    one = _volume(a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2])
    two = -_volume(w[0], w[1], w[2], b[0], b[1], b[2], c[0], c[1], c[2])
    three = _volume(w[0], w[1], w[2], a[0], a[1], a[2], c[0], c[1], c[2])
    four = -_volume(w[0], w[1], w[2], a[0], a[1], a[2], b[0], b[1], b[2])
    low, high = lesser(lesser(one, two), lesser(three, four)), greater(greater(one, two), greater(three, four))
    # All of one sign, and none of them of the size of rounding.
    return greater(low, -high) - 1e-9 * greater(high, -low) - 1e-18


@jit(types.void(I64, I64, _NEAR, COVER, WORK), inline=True, allocates=False)
def _begin(b, o, near, cover, work):
    """Directions to begin with: the last one on this edge, or from the other to the sphere that is too near."""
    walk, centres, slot = work.walk, work.centres, near[0]
    if work.begun[slot] == work.counts[3]:
        for c in range(3):
            store(walk, c * WIDTH, fill(work.starts[slot, c]))
        return
    work.begun[slot] = work.counts[3]
    at, to = near[1] * SPHERE, near[2] * SPHERE
    x, y, z = load(centres, at), load(centres, at + WIDTH), load(centres, at + 2 * WIDTH)
    if b < 0:
        u, v, w = nearest_in(cover.obstacle_values, cover.obstacles, o, x, y, z)
    elif near[1] == near[2]:
        middle = cover.core_values[b]
        u, v, w = _to_world(work.frames, cover.cores[b, 0] * FRAME, fill(middle[0]), fill(middle[1]), fill(middle[2]))
    else:
        u, v, w = load(centres, to), load(centres, to + WIDTH), load(centres, to + 2 * WIDTH)
    x, y, z = x - u, y - v, z - w
    part = 1.0 / greater(root(x * x + y * y + z * z), 1e-12)
    store(walk, 0, x * part)
    store(walk, WIDTH, y * part)
    store(walk, 2 * WIDTH, z * part)


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


@jit(LANES(I64, I64, I64, I64, LANES, LANES, LANES, LANES, COVER, WORK), inline=True, allocates=False)
def _gap_within(a, b, o, base, x, y, z, h, cover, work):
    """The least gap of two cores along directions while they move at their present velocities [m]."""
    gap = lowest_within(a, x, y, z, base, h, cover, work)
    if b < 0:
        high, _, _, _ = farthest_in(cover.obstacle_values, cover.obstacles, o, x, y, z)
        return gap - high
    return gap + lowest_within(b, -x, -y, -z, base, h, cover, work)


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
    _begin(b, o, near, cover, work)
    x, y, z = load(work.walk, 0), load(work.walk, WIDTH), load(work.walk, 2 * WIDTH)
    best, nx, ny, nz = fill(-1e300), x, y, z
    # The point nearest to the origin so far, and three corners of the difference of the bodies around it.
    px, py, pz, square = fill(0.0), fill(0.0), fill(0.0), fill(1e300)
    ax, ay, az = fill(0.0), fill(0.0), fill(0.0)
    bx, by, bz = fill(0.0), fill(0.0), fill(0.0)
    cx, cy, cz = fill(0.0), fill(0.0), fill(0.0)
    for step in range(_STEPS):
        lx, ly, lz = _to_local(frames, at, x, y, z)
        low, u, v, w = lowest(a, lx, ly, lz, cover)
        wx, wy, wz = _to_world(frames, at, u, v, w)
        high, u, v, w = _highest_of_other(b, o, x, y, z, cover, work)
        gap = low + _along_origin(frames, at, x, y, z) - high - radius
        nx, ny, nz = choose(best, gap, x, nx), choose(best, gap, y, ny), choose(best, gap, z, nz)
        best = greater(best, gap)
        wx, wy, wz = wx - u, wy - v, wz - w
        if step == 0:
            px, py, pz = wx, wy, wz
            square = wx * wx + wy * wy + wz * wz
            ax, ay, az, bx, by, bz, cx, cy, cz = wx, wy, wz, wx, wy, wz, wx, wy, wz
        else:
            surrounded = _surrounds((wx, wy, wz), (ax, ay, az), (bx, by, bz), (cx, cy, cz))
            touching = (ALL ^ below(surrounded, 0.0)) & asked
            if touching:
                return asked, asked, touching
            (qx, qy, qz), (ax, ay, az), (bx, by, bz) = _take_in((wx, wy, wz), (ax, ay, az), (bx, by, bz), (cx, cy, cz))
            cx, cy, cz = wx, wy, wz
            least = qx * qx + qy * qy + qz * qz
            px, py, pz = choose(least, square, qx, px), choose(least, square, qy, py), choose(least, square, qz, pz)
            square = lesser(least, square)
        distance = root(square)
        touching = below(distance - radius, padding - cover.margins[0]) & asked
        if touching:
            return asked, asked, touching
        if below(best, needed) & asked == 0:
            travel = h * _fastest(a, nx, ny, nz, base, cover, work)
            if b >= 0:
                travel = travel + h * _fastest(b, nx, ny, nz, base, cover, work)
            if below(best - travel - lost, needed) & asked == 0:
                return 0, 0, 0
        if below(best - padding, _GOOD * (distance - radius - padding)) & asked == 0:
            break
        part = 1.0 / greater(distance, 1e-9)
        x, y, z = px * part, py * part, pz * part
    stuck = below(best, needed) & asked
    left = asked
    if stuck != asked:
        left = below(_gap_within(a, b, o, base, nx, ny, nz, h, cover, work) - radius - lost, needed)
        left = left & asked | stuck
    if left:
        _end(near[0], left, nx, ny, nz, work)
    return left, stuck, 0
