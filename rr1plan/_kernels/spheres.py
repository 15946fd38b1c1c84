# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""Spheres against obstacles, for many configurations of an edge side by side.

Solids that move are covered by spheres. Around a configuration, a sphere's centre with velocity v along
the edge and an acceleration of at most a stays, for the time h before and after, within |n.v| h + a h^2 / 2
of where it is, measured along any direction n. With n the direction from an obstacle's nearest point (or from the
other sphere), that is a bound of how far the gap can close, because the obstacle is convex. The bound of the
acceleration is the sum over pairs of joints of their speeds times how far the sphere can be from the farther
one's axis.

Eight intervals of the edge are looked at together. What is proven is dropped, the rest is halved; what no
sphere can decide is listed for the exact kernel. A ball inside a solid that touches proves a contact.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import types

from rr1plan._kernels.jit import F64, FLOATS1, FLOATS2, I64, INT1, INT2, OUT1, OUT2, jit
from rr1plan._kernels.lanes import (
    LANES,
    WIDTH,
    below,
    fill,
    floor,
    greater,
    least,
    lesser,
    load,
    most,
    root,
    size_of,
    store,
)

PROVEN, TOUCHES, OPEN = range(3)
ROUNDED_BOX, CYLINDER, HALF_SPACE = range(3)

# Angles beyond this are not reduced precisely enough [rad].
FARTHEST = 1e5
_SLACK = 1.0 + 1e-9
# Two over pi, and pi over two in two parts of which the first has 33 bits.
_TURNS = 0.6366197723675814
_QUARTER = 1.5707963267341256
_REST = 6.077100506506192e-11
# Numbers kept of each frame (rotation row by row, origin, angular and linear velocity) and of each sphere.
_FRAME = 18 * WIDTH
_SPHERE = 7 * WIDTH
_BITS = 62
# Cells of a map along each of its sides.
CELLS = 128
_DEEPEST = 1.0 / 1024.0


class Cover(NamedTuple):
    """What the kernel knows of a scene; made by `rr1plan.collision.sphere_tables`.

    Args:
        joints: Parent (0: the world), 1 for prismatic, column; row 0 is the world, shape (j, 3).
        joint_values: T_parent_joint with z along the axis (12) and gain, shape (j, 13).
        bodies: Joint, first and last sphere (the first is the ball around all), first and last entry of
            its chain; shape (b, 5).
        spheres: Centre in the joint's frame, radius, radius of the ball inside [m], shape (s, 5).
        chain: Joints above each body, root first.
        chain_reach: For each, how far any sphere's centre can be from its axis, prismatic joints at zero [m].
        obstacles: Kind, and 1 if its gap is exact, not only a bound from below; shape (o, 2).
        obstacle_values: Rotation row by row, centre, half sizes (a cylinder's radius and half length; a
            half-space's normal), radius around it (a half-space's offset); shape (o, 16).
        boxes: Box around each obstacle, low and high, shape (6, o), o a multiple of `WIDTH`.
        pair_of: Index of the pair of a body and an obstacle, -1 for none, shape (b, o).
        meetings: Body, body, joints that move both, index of the pair, and if it has a map where that begins in
            `maps` (else -1), the number of its columns of cells, and its two columns of q; shape (m, 8).
        maps: For each map how many cells before a corner are not free; see `neighbours.py`.
        map_ranges: Low end and cells per rad or m, of both columns of q; shape (m, 4).
        padding: Distance to keep of each pair [m].
        margins: What must be left of a gap beyond everything else, and the greatest padding [m], shape (2,).
    """

    joints: np.ndarray
    joint_values: np.ndarray
    bodies: np.ndarray
    spheres: np.ndarray
    chain: np.ndarray
    chain_reach: np.ndarray
    obstacles: np.ndarray
    obstacle_values: np.ndarray
    boxes: np.ndarray
    pair_of: np.ndarray
    meetings: np.ndarray
    maps: np.ndarray
    map_ranges: np.ndarray
    padding: np.ndarray
    margins: np.ndarray


class Work(NamedTuple):
    """Memory the kernel writes.

    Args:
        frames: Of every joint, `WIDTH` configurations side by side.
        centres: Of every sphere: place, velocity, travel.
        placed: The batch each body was placed for last.
        speeds: Greatest speed of a body's spheres, by the joints that count; shape (b, longest chain + 1).
        pushes: Greatest acceleration, the same.
        near: Spheres of a body that are near another's ball, and in which lanes; shape (n, 2).
        turns: Of each joint: rate and greatest value on the edge, shape (j, 2).
        items: Body, obstacle or other body, 1 if the latter, pair, index in `meetings`; shape (k, 5).
        spans: Middle and half width of each interval, shape (n, 2).
        span_items: Bits of the items it is open for.
        lanes: `WIDTH` middles, then as many half widths.
        open_spans: Middle and half width of what is left to the exact kernel, shape (n, 2).
        open_pairs: The pair of each.
        counts: How many of those there are, batches looked at, the pair of a contact; from 8 on the bits of the
            items that each lane is open for.
        curve: The edge as the exact kernel takes it, shape (2, nq).
    """

    frames: np.ndarray
    centres: np.ndarray
    placed: np.ndarray
    speeds: np.ndarray
    pushes: np.ndarray
    near: np.ndarray
    turns: np.ndarray
    items: np.ndarray
    spans: np.ndarray
    span_items: np.ndarray
    lanes: np.ndarray
    open_spans: np.ndarray
    open_pairs: np.ndarray
    counts: np.ndarray
    curve: np.ndarray


COVER = types.NamedTuple(
    [INT2, OUT2, INT2, OUT2, INT1, OUT1, INT2, OUT2, OUT2, INT2, INT2, INT1, OUT2, OUT1, OUT1], Cover
)
WORK = types.NamedTuple(
    [OUT1, OUT1, INT1, OUT2, OUT2, INT2, OUT2, INT2, OUT2, INT1, OUT1, OUT2, INT1, INT1, OUT2], Work
)


@jit(types.UniTuple(LANES, 2)(LANES), inline=True, allocates=False)
def sine_cosine(angle):
    """Sine and cosine, each within 1e-13, of angles up to `FARTHEST`."""
    k = floor(angle * _TURNS + 0.5)
    x = angle - k * _QUARTER - k * _REST
    y = x * x
    # Taylor's series; the terms left out are below 3e-14 within an eighth of a turn.
    s = y * (1.0 / 6227020800.0) - 1.0 / 39916800.0
    s = s * y + 1.0 / 362880.0
    s = s * y - 1.0 / 5040.0
    s = s * y + 1.0 / 120.0
    s = s * y - 1.0 / 6.0
    s = x + x * (s * y)
    c = y * (-1.0 / 87178291200.0) + 1.0 / 479001600.0
    c = c * y - 1.0 / 3628800.0
    c = c * y + 1.0 / 40320.0
    c = c * y - 1.0 / 720.0
    c = c * y + 1.0 / 24.0
    c = c * y - 0.5
    c = c * y + 1.0
    half = floor(k * 0.5)
    other = floor(k * 0.5 + 0.5)
    odd = k - half * 2.0
    sign_s = 1.0 - (half - floor(half * 0.5) * 2.0) * 2.0
    sign_c = 1.0 - (other - floor(other * 0.5) * 2.0) * 2.0
    return sign_s * (s + odd * (c - s)), sign_c * (c + odd * (s - c))


@jit(LANES(FLOATS2, INT2, I64, LANES, LANES, LANES), inline=True, allocates=False)
def square_to(values, kinds, o, x, y, z):
    """Square of the distance from points to an obstacle's core, or a bound from below [m^2]; not for a half-space."""
    dx, dy, dz = x - values[o, 9], y - values[o, 10], z - values[o, 11]
    a = size_of(dx * values[o, 0] + dy * values[o, 3] + dz * values[o, 6])
    b = size_of(dx * values[o, 1] + dy * values[o, 4] + dz * values[o, 7])
    c = greater(size_of(dx * values[o, 2] + dy * values[o, 5] + dz * values[o, 8]) - values[o, 14], 0.0)
    if kinds[o, 0] == CYLINDER:
        a = greater(root(a * a + b * b) - values[o, 12], 0.0)
        return a * a + c * c
    a = greater(a - values[o, 12], 0.0)
    b = greater(b - values[o, 13], 0.0)
    return a * a + b * b + c * c


@jit(LANES(FLOATS2, I64, LANES, LANES, LANES), inline=True, allocates=False)
def height_over(values, o, x, y, z):
    """Signed distance from points to a half-space [m]."""
    return x * values[o, 12] + y * values[o, 13] + z * values[o, 14] - values[o, 15]


@jit(LANES(FLOATS2, INT2, I64, LANES, LANES, LANES), inline=True, allocates=False)
def gap_to(values, kinds, o, x, y, z):
    """Distance from points to an obstacle, or a bound from below [m]."""
    if kinds[o, 0] == HALF_SPACE:
        return height_over(values, o, x, y, z)
    return root(square_to(values, kinds, o, x, y, z)) - values[o, 15]


@jit(I64(FLOATS2, INT2, I64, LANES, LANES, LANES, LANES), inline=True, allocates=False)
def within(values, kinds, o, x, y, z, limit):
    """In which lanes points may be nearer to an obstacle than a limit > 0; without a root where that is possible."""
    if kinds[o, 0] == HALF_SPACE:
        return below(height_over(values, o, x, y, z), limit)
    reach = limit + values[o, 15]
    return below(square_to(values, kinds, o, x, y, z), reach * reach)


@jit(LANES(FLOATS2, INT2, I64, LANES, LANES, LANES, LANES, LANES, LANES), inline=True, allocates=False)
def approach_to(values, kinds, o, x, y, z, u, v, w):
    """Speed, without sign, of points along the direction from an obstacle's nearest point to them [m]."""
    if kinds[o, 0] == HALF_SPACE:
        return size_of(u * values[o, 12] + v * values[o, 13] + w * values[o, 14]) * _SLACK
    dx, dy, dz = x - values[o, 9], y - values[o, 10], z - values[o, 11]
    a = dx * values[o, 0] + dy * values[o, 3] + dz * values[o, 6]
    b = dx * values[o, 1] + dy * values[o, 4] + dz * values[o, 7]
    c = dx * values[o, 2] + dy * values[o, 5] + dz * values[o, 8]
    c = c - greater(lesser(c, values[o, 14]), -values[o, 14])
    if kinds[o, 0] == CYLINDER:
        across = root(a * a + b * b)
        part = greater(across - values[o, 12], 0.0) / greater(across, 1e-12)
        a, b = a * part, b * part
    else:
        a = a - greater(lesser(a, values[o, 12]), -values[o, 12])
        b = b - greater(lesser(b, values[o, 13]), -values[o, 13])
    p = u * values[o, 0] + v * values[o, 3] + w * values[o, 6]
    q = u * values[o, 1] + v * values[o, 4] + w * values[o, 7]
    r = u * values[o, 2] + v * values[o, 5] + w * values[o, 8]
    return size_of(a * p + b * q + c * r) / greater(root(a * a + b * b + c * c), 1e-12) * _SLACK


@jit(types.void(FLOATS1, FLOATS1, COVER, WORK), inline=True, allocates=False)
def bound_motion(q0, q1, cover, work):
    """Greatest speeds and accelerations on an edge, by body and by the joints that count."""
    for j in range(1, cover.joints.shape[0]):
        column, gain = cover.joints[j, 2], cover.joint_values[j, 12]
        work.turns[j, 0] = gain * (q1[column] - q0[column])
        work.turns[j, 1] = abs(gain) * max(abs(q0[column]), abs(q1[column]))
    for b in range(cover.bodies.shape[0]):
        first, last = cover.bodies[b, 3], cover.bodies[b, 4]
        speed, push, beyond = 0.0, 0.0, 0.0
        work.speeds[b, last - first] = 0.0
        work.pushes[b, last - first] = 0.0
        for k in range(last - 1, first - 1, -1):
            j = cover.chain[k]
            rate = abs(work.turns[j, 0]) * _SLACK
            if cover.joints[j, 1] == 1:
                # It pushes all alike: what hangs on it accelerates by the joints before it only.
                speed += rate
                beyond += work.turns[j, 1]
            else:
                swing = rate * (cover.chain_reach[k] + beyond)
                push += rate * (swing + 2.0 * speed)
                speed += swing
            work.speeds[b, k - first] = speed
            work.pushes[b, k - first] = push


@jit(types.void(FLOATS1, LANES, COVER, WORK), inline=True, allocates=False)
def place_frames(q0, t, cover, work):
    """World poses and velocities of all joints at the times t of an edge that begins at q0."""
    frames = work.frames
    for j in range(1, cover.joints.shape[0]):
        parent = cover.joints[j, 0] * _FRAME
        at = j * _FRAME
        rate = work.turns[j, 0]
        value = t * rate + cover.joint_values[j, 12] * q0[cover.joints[j, 2]]
        turn, shift = fill(0.0), value
        s, c = fill(0.0), fill(1.0)
        if cover.joints[j, 1] == 0:
            s, c = sine_cosine(value)
            turn, shift = fill(rate), fill(0.0)
        for r in range(3):
            row = parent + 3 * r * WIDTH
            a, b, d = load(frames, row), load(frames, row + WIDTH), load(frames, row + 2 * WIDTH)
            x = a * cover.joint_values[j, 0] + b * cover.joint_values[j, 3] + d * cover.joint_values[j, 6]
            y = a * cover.joint_values[j, 1] + b * cover.joint_values[j, 4] + d * cover.joint_values[j, 7]
            z = a * cover.joint_values[j, 2] + b * cover.joint_values[j, 5] + d * cover.joint_values[j, 8]
            reach = a * cover.joint_values[j, 9] + b * cover.joint_values[j, 10] + d * cover.joint_values[j, 11]
            store(frames, at + 3 * r * WIDTH, x * c + y * s)
            store(frames, at + (3 * r + 1) * WIDTH, y * c - x * s)
            store(frames, at + (3 * r + 2) * WIDTH, z)
            reach = reach + z * shift
            store(frames, at + (9 + r) * WIDTH, load(frames, parent + (9 + r) * WIDTH) + reach)
            store(frames, at + (12 + r) * WIDTH, load(frames, parent + (12 + r) * WIDTH) + z * turn)
        dx = load(frames, at + 9 * WIDTH) - load(frames, parent + 9 * WIDTH)
        dy = load(frames, at + 10 * WIDTH) - load(frames, parent + 10 * WIDTH)
        dz = load(frames, at + 11 * WIDTH) - load(frames, parent + 11 * WIDTH)
        x, y, z = (
            load(frames, parent + 12 * WIDTH),
            load(frames, parent + 13 * WIDTH),
            load(frames, parent + 14 * WIDTH),
        )
        u = load(frames, parent + 15 * WIDTH) + y * dz - z * dy
        v = load(frames, parent + 16 * WIDTH) + z * dx - x * dz
        w = load(frames, parent + 17 * WIDTH) + x * dy - y * dx
        if cover.joints[j, 1] == 1:
            u = u + load(frames, at + 2 * WIDTH) * rate
            v = v + load(frames, at + 5 * WIDTH) * rate
            w = w + load(frames, at + 8 * WIDTH) * rate
        store(frames, at + 15 * WIDTH, u)
        store(frames, at + 16 * WIDTH, v)
        store(frames, at + 17 * WIDTH, w)


@jit(types.void(I64, I64, I64, I64, LANES, COVER, WORK), inline=True, allocates=False)
def place_spheres(b, batch, first, last, h, cover, work):
    """Places, velocities and travels of some spheres of a body."""
    frames, spheres = work.frames, cover.spheres
    j = cover.bodies[b, 0] * _FRAME
    push = h * h * (0.5 * work.pushes[b, 0])
    far = h * work.speeds[b, 0]
    wx, wy, wz = load(frames, j + 12 * WIDTH), load(frames, j + 13 * WIDTH), load(frames, j + 14 * WIDTH)
    vx, vy, vz = load(frames, j + 15 * WIDTH), load(frames, j + 16 * WIDTH), load(frames, j + 17 * WIDTH)
    for i in range(first, last):
        x, y, z = spheres[i, 0], spheres[i, 1], spheres[i, 2]
        dx = load(frames, j) * x + load(frames, j + WIDTH) * y + load(frames, j + 2 * WIDTH) * z
        dy = load(frames, j + 3 * WIDTH) * x + load(frames, j + 4 * WIDTH) * y + load(frames, j + 5 * WIDTH) * z
        dz = load(frames, j + 6 * WIDTH) * x + load(frames, j + 7 * WIDTH) * y + load(frames, j + 8 * WIDTH) * z
        u, v, w = vx + wy * dz - wz * dy, vy + wz * dx - wx * dz, vz + wx * dy - wy * dx
        at = i * _SPHERE
        store(work.centres, at, load(frames, j + 9 * WIDTH) + dx)
        store(work.centres, at + WIDTH, load(frames, j + 10 * WIDTH) + dy)
        store(work.centres, at + 2 * WIDTH, load(frames, j + 11 * WIDTH) + dz)
        store(work.centres, at + 3 * WIDTH, u)
        store(work.centres, at + 4 * WIDTH, v)
        store(work.centres, at + 5 * WIDTH, w)
        store(work.centres, at + 6 * WIDTH, lesser(root(u * u + v * v + w * w) * h * _SLACK + push, far))


@jit(types.UniTuple(I64, 3)(I64, I64, F64, I64, I64, LANES, COVER, WORK), inline=True, allocates=False)
def meet_obstacle(b, o, padding, asked, batch, h, cover, work):
    """A body against an obstacle in the lanes asked for.

    Returns:
        Bits of the lanes that stay open, of those that no halving of the interval can close, and of
        those with a proven contact.
    """
    centres, spheres = work.centres, cover.spheres
    values, kinds = cover.obstacle_values, cover.obstacles
    first, last = cover.bodies[b, 1], cover.bodies[b, 2]
    push = h * h * (0.5 * work.pushes[b, 0])
    far = h * work.speeds[b, 0]
    left, stuck = 0, 0
    for i in range(first, last):
        at = i * _SPHERE
        x, y, z = load(centres, at), load(centres, at + WIDTH), load(centres, at + 2 * WIDTH)
        needed = spheres[i, 3] + padding + cover.margins[0]
        lanes = within(values, kinds, o, x, y, z, load(centres, at + 6 * WIDTH) + needed) & asked
        gap = fill(0.0)
        if lanes:
            gap = gap_to(values, kinds, o, x, y, z)
            u, v, w = load(centres, at + 3 * WIDTH), load(centres, at + 4 * WIDTH), load(centres, at + 5 * WIDTH)
            speed = approach_to(values, kinds, o, x, y, z, u, v, w)
            lanes &= below(gap - lesser(speed * h + push, far), needed)
        if i == first:
            # The ball around all: what it clears, all spheres clear.
            asked = lanes
            if lanes == 0:
                return 0, 0, 0
            if work.placed[b] != batch:
                work.placed[b] = batch
                place_spheres(b, batch, first + 1, last, h, cover, work)
        elif lanes:
            if kinds[o, 1]:
                touching = below(gap, spheres[i, 4] + padding - cover.margins[0]) & lanes
                if touching:
                    return lanes, lanes, touching
            left |= lanes
            stuck |= below(gap, needed) & lanes
    return left, stuck, 0


@jit(LANES(I64, I64, OUT1), inline=True, allocates=False)
def _square_between(i, k, centres):
    """Square of the distance of the centres of two spheres [m^2]."""
    at, to = i * _SPHERE, k * _SPHERE
    dx = load(centres, at) - load(centres, to)
    dy = load(centres, at + WIDTH) - load(centres, to + WIDTH)
    dz = load(centres, at + 2 * WIDTH) - load(centres, to + 2 * WIDTH)
    return dx * dx + dy * dy + dz * dz


@jit(I64(I64, I64, I64, F64, LANES, LANES, LANES, COVER, WORK), inline=True, allocates=False)
def _approaching(i, k, asked, padding, push, far, h, cover, work):
    """In which of the lanes asked for two spheres may come too near each other."""
    centres = work.centres
    at, to = i * _SPHERE, k * _SPHERE
    needed = cover.spheres[i, 3] + cover.spheres[k, 3] + padding + cover.margins[0]
    dx = load(centres, at) - load(centres, to)
    dy = load(centres, at + WIDTH) - load(centres, to + WIDTH)
    dz = load(centres, at + 2 * WIDTH) - load(centres, to + 2 * WIDTH)
    square = dx * dx + dy * dy + dz * dz
    limit = lesser(load(centres, at + 6 * WIDTH) + load(centres, to + 6 * WIDTH), far) + needed
    lanes = below(square, limit * limit) & asked
    if lanes:
        gap = root(square)
        du = load(centres, at + 3 * WIDTH) - load(centres, to + 3 * WIDTH)
        dv = load(centres, at + 4 * WIDTH) - load(centres, to + 4 * WIDTH)
        dw = load(centres, at + 5 * WIDTH) - load(centres, to + 5 * WIDTH)
        speed = size_of(dx * du + dy * dv + dz * dw) / greater(gap, 1e-12) * _SLACK
        lanes &= below(gap - lesser(speed * h + push, far), needed)
    return lanes


@jit(types.UniTuple(I64, 3)(I64, I64, I64, F64, I64, I64, LANES, COVER, WORK), inline=True, allocates=False)
def meet_body(a, b, shared, padding, asked, batch, h, cover, work):
    """A body against another, see `meet_obstacle`."""
    centres, spheres = work.centres, cover.spheres
    push = h * h * (0.5 * (work.pushes[a, shared] + work.pushes[b, shared]))
    far = h * (work.speeds[a, shared] + work.speeds[b, shared])
    first_a, last_a = cover.bodies[a, 1], cover.bodies[a, 2]
    first_b, last_b = cover.bodies[b, 1], cover.bodies[b, 2]
    near = _approaching(first_a, first_b, asked, padding, push, far, h, cover, work)
    if near == 0:
        return 0, 0, 0
    for body in (a, b):
        if work.placed[body] != batch:
            work.placed[body] = batch
            place_spheres(body, batch, cover.bodies[body, 1] + 1, cover.bodies[body, 2], h, cover, work)
    # Only the spheres of either that are near the other's ball.
    count = 0
    for k in range(first_b + 1, last_b):
        lanes = _approaching(first_a, k, near, padding, push, far, h, cover, work)
        if lanes:
            work.near[count, 0], work.near[count, 1] = k, lanes
            count += 1
    left, stuck = 0, 0
    for i in range(first_a + 1, last_a if count else 0):
        beside = _approaching(i, first_b, near, padding, push, far, h, cover, work)
        for n in range(count if beside else 0):
            k = work.near[n, 0]
            lanes = work.near[n, 1] & beside
            if lanes:
                lanes = _approaching(i, k, lanes, padding, push, far, h, cover, work)
            if lanes:
                gap = root(_square_between(i, k, centres))
                touching = below(gap, spheres[i, 4] + spheres[k, 4] + padding - cover.margins[0]) & lanes
                if touching:
                    return lanes, lanes, touching
                left |= lanes
                stuck |= below(gap, spheres[i, 3] + spheres[k, 3] + padding + cover.margins[0]) & lanes
    return left, stuck, 0


@jit(I64(I64, FLOATS1, FLOATS1, F64, F64, COVER), inline=True, allocates=False)
def _mapped(m, q0, q1, t0, t1, cover):
    """1 if the map of a meeting proves it free between two times of an edge."""
    begin, width = cover.meetings[m, 4], cover.meetings[m, 5]
    x0, x1, y0, y1 = np.int64(0), np.int64(0), np.int64(0), np.int64(0)
    for side in range(2):
        c = cover.meetings[m, 6 + side]
        a, b = q0[c] + t0 * (q1[c] - q0[c]), q0[c] + t1 * (q1[c] - q0[c])
        first = np.floor((min(a, b) - cover.map_ranges[m, 2 * side]) * cover.map_ranges[m, 2 * side + 1])
        last = np.floor((max(a, b) - cover.map_ranges[m, 2 * side]) * cover.map_ranges[m, 2 * side + 1])
        cells = CELLS if side == 0 or width > 1 else 1
        if side == 1 and width == 1:
            first, last = 0.0, 0.0
        if not (first >= 0.0 and last < cells):
            return 0
        if side == 0:
            x0, x1 = np.int64(first), np.int64(last) + 1
        else:
            y0, y1 = np.int64(first), np.int64(last) + 1
    row = width + 1
    a, b = begin + x0 * row, begin + x1 * row
    inside = cover.maps[b + y1] - cover.maps[b + y0] - cover.maps[a + y1] + cover.maps[a + y0]
    return 1 if inside == 0 else 0


@jit(I64(I64, I64, FLOATS1, FLOATS1, COVER, WORK), inline=True, allocates=False)
def _unmapped(m, asked, q0, q1, cover, work):
    """The lanes of those asked for in which no map proves a meeting free."""
    if cover.meetings[m, 4] < 0:
        return asked
    left = asked
    for i in range(WIDTH):
        if asked >> i & 1:
            t, h = work.lanes[i], work.lanes[WIDTH + i]
            if _mapped(m, q0, q1, t - h, t + h, cover):
                left &= ~(1 << i)
    return left


@jit(I64(I64, I64, I64, I64, I64, COVER, WORK), inline=True, allocates=False)
def _keep(pair, lanes, stuck, bit, batch, cover, work):
    """Remember the open lanes of a pair: to be halved, or for the exact kernel; 1 if there is no room."""
    count = work.counts[0]
    for i in range(WIDTH):
        if lanes >> i & 1:
            half = work.lanes[WIDTH + i]
            if half > _DEEPEST and (batch == 1 or not stuck >> i & 1):
                work.lanes[2 * WIDTH + i] = 1.0
                work.counts[8 + i] |= 1 << bit
            else:
                if count == work.open_pairs.shape[0]:
                    return 1
                work.open_spans[count, 0], work.open_spans[count, 1] = work.lanes[i], half
                work.open_pairs[count] = pair
                count += 1
    work.counts[0] = count
    return 0


@jit(I64(I64, I64, I64, I64, I64, I64, I64, I64, LANES, COVER, WORK), inline=True, allocates=False)
def _meet(first, second, between, pair, meeting, asked, bit, batch, h, cover, work):
    """One item in the lanes asked for: PROVEN, TOUCHES, or OPEN and remembered (FULL: -1)."""
    if between:
        shared = cover.meetings[meeting, 2]
        lanes, stuck, touching = meet_body(first, second, shared, cover.padding[pair], asked, batch, h, cover, work)
    else:
        lanes, stuck, touching = meet_obstacle(first, second, cover.padding[pair], asked, batch, h, cover, work)
    if touching:
        work.counts[2] = pair
        for i in range(WIDTH):
            if touching >> i & 1:
                work.open_spans[0, 0] = work.lanes[i]
                break
        return TOUCHES
    if lanes == 0:
        return PROVEN
    return -1 if _keep(pair, lanes, stuck, bit, batch, cover, work) else OPEN


@jit(I64(FLOATS1, FLOATS1, I64, LANES, COVER, WORK), inline=True, allocates=False)
def _first_batch(q0, q1, batch, h, cover, work):
    """Everything that may meet, on the whole edge; the items still open are numbered. -1: no room, -2: contact."""
    count = 0
    for b in range(cover.bodies.shape[0]):
        ball = cover.bodies[b, 1]
        place_spheres(b, batch, ball, ball + 1, h, cover, work)
    for b in range(cover.bodies.shape[0]):
        at = cover.bodies[b, 1] * _SPHERE
        reach = cover.spheres[cover.bodies[b, 1], 3] + cover.margins[0] + cover.margins[1]
        travel = load(work.centres, at + 6 * WIDTH)
        x, y, z = load(work.centres, at), load(work.centres, at + WIDTH), load(work.centres, at + 2 * WIDTH)
        x0, x1 = least(x - travel) - reach, most(x + travel) + reach
        y0, y1 = least(y - travel) - reach, most(y + travel) + reach
        z0, z1 = least(z - travel) - reach, most(z + travel) + reach
        for o in range(0, cover.boxes.shape[1], WIDTH):
            near = below(load(cover.boxes[0], o), x1) & below(load(cover.boxes[1], o), y1)
            near &= below(load(cover.boxes[2], o), z1)
            near &= below(-1.0 * load(cover.boxes[3], o), -x0) & below(-1.0 * load(cover.boxes[4], o), -y0)
            near &= below(-1.0 * load(cover.boxes[5], o), -z0)
            i = o
            while near:
                if near & 1 and cover.pair_of[b, i] >= 0:
                    pair = cover.pair_of[b, i]
                    found = _meet(b, i, 0, pair, 0, (1 << WIDTH) - 1, min(count, _BITS), batch, h, cover, work)
                    if found == TOUCHES:
                        return -2
                    if found == -1:
                        return -1
                    if found == OPEN:
                        work.items[count, 0], work.items[count, 1], work.items[count, 2] = b, i, 0
                        work.items[count, 3], work.items[count, 4] = pair, 0
                        count += 1
                near >>= 1
                i += 1
    for m in range(cover.meetings.shape[0]):
        a, b, pair = cover.meetings[m, 0], cover.meetings[m, 1], cover.meetings[m, 3]
        asked = (1 << WIDTH) - 1
        if cover.meetings[m, 4] >= 0:
            if _mapped(m, q0, q1, 0.0, 1.0, cover):
                continue
            asked = _unmapped(m, asked, q0, q1, cover, work)
            if asked == 0:
                continue
        found = _meet(a, b, 1, pair, m, asked, min(count, _BITS), batch, h, cover, work)
        if found == TOUCHES:
            return -2
        if found == -1:
            return -1
        if found == OPEN:
            work.items[count, 0], work.items[count, 1], work.items[count, 2] = a, b, 1
            work.items[count, 3], work.items[count, 4] = pair, m
            count += 1
    return count


@jit(I64(FLOATS1, FLOATS1, COVER, WORK), allocates=False)
def sweep(q0, q1, cover, work):
    """An edge against all obstacles and between its own bodies, by spheres.

    Args:
        q0: Begin, shape (nq,).
        q1: End, shape (nq,).
        cover: See `Cover`.
        work: See `Work`.

    Returns:
        PROVEN free; TOUCHES at `open_spans[0, 0]`, the pair `counts[2]`; or OPEN: `counts[0]` intervals and pairs are
        left to the exact kernel (-1: the whole edge).
    """
    work.counts[0] = 0
    work.counts[1] = 0
    for c in range(q0.shape[0]):
        # A comparison that NaN fails as well.
        if not (abs(q0[c]) < FARTHEST and abs(q1[c]) < FARTHEST):
            work.counts[0] = -1
            return OPEN
    bound_motion(q0, q1, cover, work)
    work.placed[:] = 0
    head, tail, count, batch = 0, WIDTH, 0, 0
    for i in range(WIDTH):
        work.spans[i, 0], work.spans[i, 1] = (i + 0.5) / WIDTH, 0.5 / WIDTH
        work.span_items[i] = 0
    while head < tail:
        batch += 1
        taken = min(WIDTH, tail - head)
        for i in range(WIDTH):
            k = head + min(i, taken - 1)
            work.lanes[i], work.lanes[WIDTH + i], work.lanes[2 * WIDTH + i] = work.spans[k, 0], work.spans[k, 1], 0.0
            work.counts[8 + i] = 0
        t, h = load(work.lanes, 0), load(work.lanes, WIDTH)
        place_frames(q0, t, cover, work)
        if batch == 1:
            count = _first_batch(q0, q1, batch, h, cover, work)
            if count < 0:
                work.counts[0] = -1
                work.counts[1] = batch
                return TOUCHES if count == -2 else OPEN
        else:
            for k in range(count):
                bit, asked = min(k, _BITS), 0
                for i in range(taken):
                    asked |= (work.span_items[head + i] >> bit & 1) << i
                if asked and work.items[k, 2]:
                    asked = _unmapped(work.items[k, 4], asked, q0, q1, cover, work)
                if asked == 0:
                    continue
                for side in range(1 + work.items[k, 2]):
                    b = work.items[k, side]
                    if work.placed[b] != batch and work.placed[b] != -batch:
                        work.placed[b] = -batch
                        place_spheres(b, batch, cover.bodies[b, 1], cover.bodies[b, 1] + 1, h, cover, work)
                found = _meet(
                    work.items[k, 0], work.items[k, 1], work.items[k, 2], work.items[k, 3], work.items[k, 4],
                    asked, bit, batch, h, cover, work,
                )  # fmt: skip
                if found == TOUCHES or found == -1:
                    work.counts[0] = -1
                    work.counts[1] = batch
                    return TOUCHES if found == TOUCHES else OPEN
        if tail + 2 * WIDTH > work.spans.shape[0]:
            # All that is open at present would not fit: leave the edge to the exact kernel.
            work.counts[0] = -1
            work.counts[1] = batch
            return OPEN
        for i in range(taken):
            if work.counts[8 + i]:
                for side in range(2):
                    half = 0.5 * work.lanes[WIDTH + i]
                    work.spans[tail, 0] = work.lanes[i] + (2.0 * side - 1.0) * half
                    work.spans[tail, 1] = half
                    work.span_items[tail] = work.counts[8 + i]
                    tail += 1
        head += taken
    work.counts[1] = batch
    return PROVEN if work.counts[0] == 0 else OPEN
