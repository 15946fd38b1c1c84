# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""Where frames and spheres are at several times of an edge, how fast, and how much that can change.

An edge is q(t) = q0 + d t + c t^2, 0 <= t <= 1, with c = 0 where it is straight. Rates d + 2 c t are greatest at one
of its ends; the second derivative is 2 c.

Let y be a point in the frame that a joint carries. That joint turns by an angle a(t), or slides by s(t) along a unit
vector u, so in its parent's frame the point is x = R(a) y or x = y + s u. With r the distance from the axis,

    |x'| <= |a'| r + |y'|,    |x''| <= a'^2 r + 2 |a'| |y'| + |a''| r + |y''|    or
    |x'| <= |s'| + |y'|,      |x''| <= |s''| + |y''|,

because R's derivatives act on y as w x y, and as w x (w x y) + w' x y, and w is along the axis. From the last joint to
the first, with the greatest rates and the greatest r, this bounds speed and acceleration of every point of a group in
the frame of any joint above it: a term for each pair of joints, and one for each joint that is accelerated itself.
"""

from __future__ import annotations

from numba import types

from rr1plan._kernels.cover import COVER, FRAME, SLACK, SPHERE, WORK
from rr1plan._kernels.jit import F64, FLOATS1, FLOATS2, I64, jit
from rr1plan._kernels.lanes import LANES, WIDTH, fill, floor, lesser, load, root, store

# Angles beyond this are not reduced precisely enough [rad].
FARTHEST = 1e5
# Two over pi, and pi over two in two parts of which the first has 33 bits.
_TURNS = 0.6366197723675814
_QUARTER = 1.5707963267341256
_REST = 6.077100506506192e-11


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


@jit(types.void(FLOATS1, FLOATS1, WORK), inline=True, allocates=False)
def take_edge(q0, q1, work):
    """The edge is the straight line from q0 to q1."""
    for c in range(q0.shape[0]):
        work.curve[0, c], work.curve[1, c], work.curve[2, c] = q0[c], q1[c] - q0[c], 0.0


@jit(types.void(FLOATS2, F64, WORK), inline=True, allocates=False)
def take_parabola(curve, duration, work):
    """The edge is sum_k curve[k] t^k, 0 <= t <= duration, of degree 2 at most."""
    for c in range(curve.shape[1]):
        factor = 1.0
        for k in range(3):
            work.curve[k, c] = curve[k, c] * factor if k < curve.shape[0] else 0.0
            factor *= duration


@jit(I64(WORK), inline=True, allocates=False)
def is_near(work):
    """1 if all angles of the edge are below `FARTHEST`."""
    curve = work.curve
    for c in range(curve.shape[1]):
        begin, bend = curve[0, c], abs(curve[2, c])
        # Comparisons that NaN fails as well.
        if not (abs(begin) + bend < FARTHEST and abs(begin + curve[1, c] + curve[2, c]) + bend < FARTHEST):
            return 0
    return 1


@jit(types.void(COVER, WORK), inline=True, allocates=False)
def _bound_joints(cover, work):
    """How the edge moves each joint: `turns`."""
    for j in range(1, cover.joints.shape[0]):
        column, gain = cover.joints[j, 2], cover.joint_values[j, 12]
        begin, rate, bend = gain * work.curve[0, column], gain * work.curve[1, column], gain * work.curve[2, column]
        work.turns[j, 0], work.turns[j, 1], work.turns[j, 2] = begin, rate, bend
        work.turns[j, 3] = max(abs(rate), abs(rate + 2.0 * bend)) * SLACK
        # From the straight line between its ends a parabola gets away by a quarter of |c|.
        work.turns[j, 4] = max(abs(begin), abs(begin + rate + bend)) + 0.25 * abs(bend)


@jit(types.void(COVER, WORK), inline=True, allocates=False)
def bound_motion(cover, work):
    """Greatest speeds and accelerations on the edge, by group and by the joints that count."""
    _bound_joints(cover, work)
    for g in range(cover.groups.shape[0]):
        first, last = cover.groups[g, 4], cover.groups[g, 5]
        speed, push, beyond = 0.0, 0.0, 0.0
        work.speeds[g, last - first] = 0.0
        work.pushes[g, last - first] = 0.0
        for k in range(last - 1, first - 1, -1):
            j = cover.chain[k]
            rate, bend = work.turns[j, 3], 2.0 * SLACK * abs(work.turns[j, 2])
            if cover.joints[j, 1] == 1:
                push += bend
                speed += rate
                beyond += work.turns[j, 4]
            else:
                reach = cover.chain_reach[k] + beyond
                swing = rate * reach
                push += rate * (swing + 2.0 * speed) + bend * reach
                speed += swing
            work.speeds[g, k - first] = speed
            work.pushes[g, k - first] = push


@jit(types.void(LANES, COVER, WORK), inline=True, allocates=False)
def place_frames(t, cover, work):
    """World poses and velocities of all joints at the times t of the edge."""
    frames = work.frames
    for j in range(1, cover.joints.shape[0]):
        parent = cover.joints[j, 0] * FRAME
        at = j * FRAME
        rate = t * (2.0 * work.turns[j, 2]) + work.turns[j, 1]
        value = t * (t * work.turns[j, 2] + work.turns[j, 1]) + work.turns[j, 0]
        turn, shift = fill(0.0), value
        s, c = fill(0.0), fill(1.0)
        if cover.joints[j, 1] == 0:
            s, c = sine_cosine(value)
            turn, shift = rate, fill(0.0)
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


@jit(types.UniTuple(LANES, 3)(I64, I64, WORK), inline=True, allocates=False)
def velocity_of(j, i, work):
    """Velocity of the centre of a sphere that joint j carries."""
    frames, centres, at, to = work.frames, work.centres, j * FRAME, i * SPHERE
    wx, wy, wz = load(frames, at + 12 * WIDTH), load(frames, at + 13 * WIDTH), load(frames, at + 14 * WIDTH)
    dx = load(centres, to) - load(frames, at + 9 * WIDTH)
    dy = load(centres, to + WIDTH) - load(frames, at + 10 * WIDTH)
    dz = load(centres, to + 2 * WIDTH) - load(frames, at + 11 * WIDTH)
    return (
        load(frames, at + 15 * WIDTH) + wy * dz - wz * dy,
        load(frames, at + 16 * WIDTH) + wz * dx - wx * dz,
        load(frames, at + 17 * WIDTH) + wx * dy - wy * dx,
    )


@jit(types.void(I64, I64, I64, COVER, WORK), inline=True, allocates=False)
def _place_centres(j, first, last, cover, work):
    """Places of the centres of spheres that joint j carries."""
    frames, spheres, at = work.frames, cover.spheres, j * FRAME
    for i in range(first, last):
        x, y, z = spheres[i, 0], spheres[i, 1], spheres[i, 2]
        for r in range(3):
            row = at + 3 * r * WIDTH
            part = load(frames, row) * x + load(frames, row + WIDTH) * y + load(frames, row + 2 * WIDTH) * z
            store(work.centres, i * SPHERE + r * WIDTH, load(frames, at + (9 + r) * WIDTH) + part)


@jit(types.void(I64, I64, LANES, COVER, WORK), inline=True, allocates=False)
def place_ball(g, i, h, cover, work):
    """Place and travel of the ball around a group or a body of it."""
    j = cover.groups[g, 0]
    _place_centres(j, i, i + 1, cover, work)
    u, v, w = velocity_of(j, i, work)
    travel = root(u * u + v * v + w * w) * h * SLACK + h * h * (0.5 * work.pushes[g, 0])
    store(work.centres, i * SPHERE + 3 * WIDTH, lesser(travel, h * work.speeds[g, 0]))


@jit(types.void(I64, LANES, COVER, WORK), inline=True, allocates=False)
def place_spheres(b, h, cover, work):
    """Places and travels of the spheres of a body whose ball is placed."""
    centres, at, ball = work.centres, cover.bodies[b, 0] * FRAME, cover.bodies[b, 1]
    _place_centres(cover.bodies[b, 0], ball + 1, cover.bodies[b, 2], cover, work)
    frames = work.frames
    wx, wy, wz = load(frames, at + 12 * WIDTH), load(frames, at + 13 * WIDTH), load(frames, at + 14 * WIDTH)
    # None moves faster than the ball's centre and the turn about that.
    turn = root(wx * wx + wy * wy + wz * wz) * h * SLACK
    travel, far = load(centres, ball * SPHERE + 3 * WIDTH), h * work.speeds[cover.bodies[b, 3], 0]
    for i in range(ball + 1, cover.bodies[b, 2]):
        store(centres, i * SPHERE + 3 * WIDTH, lesser(travel + turn * cover.spheres[i, 5], far))
