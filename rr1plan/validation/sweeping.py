"""Where the bodies are at one time of a motion, and how far they can get around it, compiled.

Two bounds of how much nearer two bodies can come. The first counts for each joint between them how far it
can carry a body, in whatever direction. The second asks only for the motion along the direction d that
parts them. With the joints at q + s t + r (s their speeds, |r| <= R, |q' - q| <= D), a point x of a body
is carried along d by

    t d . v(x) + e,   |e| <= sum_j rho_j (R_j + D_j² / 2 + D_j sum_(i<j) D_i)

where v is the velocity field of the body under s, rho_j the largest distance of its points from axis j,
and i runs over the turning joints before j. (A turn by D moves a point by D times the velocity and at most
D² rho / 2 beside it; the turns before it tilt that by at most their sum.) The largest d . (x + t v(x))
over a body is a value of its support function in a direction linear in t, so it is convex in t, and its two
ends bound it on the whole interval. The error is of second order: along a motion that slides past
an obstacle, few intervals do.
"""

from __future__ import annotations

from math import cos, sin, sqrt
from typing import Any

from rr1plan.validation.apart import BOUND, CENTER, CHAIN, DEPTH, LINK, LOCAL, MIDDLE, ORIGIN, RADIUS, reach
from rr1plan.validation.compiled import part

# Columns of `steps` (s, 4): link, its parent, what the joint between them does, its number or -1 at rest.
CHILD, PARENT, MOVE, NUMBER = range(4)
FIXED, TURNS, SLIDES = 0, 1, 2
# Columns of `frames` (s, 17): R_parent_joint by rows, position, axis, gain and offset of the joint's value.
SHIFT, AXIS, GAIN, OFFSET = 9, 12, 15, 16
# Columns of `joints` (j, 3): column of q, number of the joint before it or -1, TURNS or SLIDES.
COLUMN, BEFORE, KIND_OF_JOINT = range(3)
# Columns of `state` (j + 1, 18): axis, point on it, largest change, largest deviation from a steady speed, speed;
# then the velocity of what it carries (angular, and of the point at the world's origin) under all joints up to it.
PIVOT, CHANGE, REST, SPEED, ANGULAR, LINEAR = 3, 6, 7, 8, 9, 12
# Rounding of the distances between axes and bodies [m].
_ROUNDING = 1e-7


@part
def expand(coefficients: Any, piece: int, at: float, half: float, degree: int, columns: Any, scratch: Any) -> None:
    """Write value, largest change, deviation from steady speed and speed within `half` of a local time, by column."""
    for c in range(len(columns)):
        for k in range(degree + 1):
            scratch[k] = coefficients[piece, k, c]
        for i in range(degree):
            for k in range(degree - 1, i - 1, -1):
                scratch[k] += at * scratch[k + 1]
        rest, power = 0.0, half
        for k in range(2, degree + 1):
            power *= half
            rest += abs(scratch[k]) * power
        columns[c, 0], columns[c, 2] = scratch[0], rest
        columns[c, 3] = scratch[1] if degree > 0 else 0.0
        columns[c, 1] = abs(columns[c, 3]) * half + rest


@part
def widen(lower: Any, upper: Any, first: int, stop: int, columns: Any) -> None:
    """Over several pieces: the largest change from the value that is there, which is no steady speed at all."""
    for c in range(len(columns)):
        low, high = lower[first, c], upper[first, c]
        for i in range(first + 1, stop):
            low, high = min(low, lower[i, c]), max(high, upper[i, c])
        columns[c, 1] = max(high - columns[c, 0], columns[c, 0] - low)
        columns[c, 2], columns[c, 3] = columns[c, 1], 0.0


@part
def move_links(steps: Any, frames: Any, columns: Any, joints: Any, links: Any, state: Any) -> None:
    """Poses of all links that move, and the axes of the joints that move them."""
    for s in range(len(steps)):
        child, parent, number = steps[s, CHILD], steps[s, PARENT], steps[s, NUMBER]
        for i in range(3):
            x, y, z = links[parent, 3 * i], links[parent, 3 * i + 1], links[parent, 3 * i + 2]
            for j in range(3):
                links[child, 3 * i + j] = x * frames[s, j] + y * frames[s, 3 + j] + z * frames[s, 6 + j]
            shift = x * frames[s, SHIFT] + y * frames[s, SHIFT + 1] + z * frames[s, SHIFT + 2]
            links[child, 9 + i] = links[parent, 9 + i] + shift
        if number < 0:
            continue
        ax, ay, az = frames[s, AXIS], frames[s, AXIS + 1], frames[s, AXIS + 2]
        for i in range(3):
            x, y, z = links[child, 3 * i], links[child, 3 * i + 1], links[child, 3 * i + 2]
            state[number, i] = x * ax + y * ay + z * az
            state[number, PIVOT + i] = links[child, 9 + i]
        column = joints[number, COLUMN]
        value = frames[s, OFFSET] + frames[s, GAIN] * columns[column, 0]
        if steps[s, MOVE] == SLIDES:
            for i in range(3):
                links[child, 9 + i] += value * state[number, i]
        else:
            _turn(links, child, ax, ay, az, value)
        size = abs(frames[s, GAIN])
        state[number, CHANGE], state[number, REST] = size * columns[column, 1], size * columns[column, 2]
        state[number, SPEED] = frames[s, GAIN] * columns[column, 3]


@part
def _turn(links: Any, child: int, ax: float, ay: float, az: float, angle: float) -> None:
    """Turn a frame about an axis given in it (Rodrigues)."""
    c, s = cos(angle), sin(angle)
    v = 1.0 - c
    xx, yy, zz = c + v * ax * ax, c + v * ay * ay, c + v * az * az
    xy, xz, yz = v * ax * ay, v * ax * az, v * ay * az
    sx, sy, sz = s * ax, s * ay, s * az
    for i in range(3):
        x, y, z = links[child, 3 * i], links[child, 3 * i + 1], links[child, 3 * i + 2]
        links[child, 3 * i] = x * xx + y * (xy + sz) + z * (xz - sy)
        links[child, 3 * i + 1] = x * (xy - sz) + y * yy + z * (yz + sx)
        links[child, 3 * i + 2] = x * (xz + sy) + y * (yz - sx) + z * zz


@part
def add_speeds(joints: Any, state: Any) -> None:
    """Velocity of what each joint carries, under it and all joints before it; the row after the last stays zero."""
    for j in range(len(joints)):
        before, speed = joints[j, BEFORE], state[j, SPEED]
        for i in range(6):
            state[j, ANGULAR + i] = state[before, ANGULAR + i]
        x, y, z = state[j, 0], state[j, 1], state[j, 2]
        if joints[j, KIND_OF_JOINT] == SLIDES:
            state[j, LINEAR] += speed * x
            state[j, LINEAR + 1] += speed * y
            state[j, LINEAR + 2] += speed * z
        else:
            px, py, pz = state[j, PIVOT], state[j, PIVOT + 1], state[j, PIVOT + 2]
            state[j, ANGULAR] += speed * x
            state[j, ANGULAR + 1] += speed * y
            state[j, ANGULAR + 2] += speed * z
            state[j, LINEAR] += speed * (py * z - pz * y)
            state[j, LINEAR + 1] += speed * (pz * x - px * z)
            state[j, LINEAR + 2] += speed * (px * y - py * x)


@part
def place(kinds: Any, sizes: Any, links: Any, b: int, placed: Any) -> None:
    """Pose of body b, and the centre of its bounding ball."""
    link = kinds[b, LINK]
    for i in range(3):
        x, y, z = links[link, 3 * i], links[link, 3 * i + 1], links[link, 3 * i + 2]
        for j in range(3):
            local = LOCAL + j
            placed[b, 3 * i + j] = x * sizes[b, local] + y * sizes[b, local + 3] + z * sizes[b, local + 6]
        at = LOCAL + 9
        placed[b, ORIGIN + i] = links[link, 9 + i] + x * sizes[b, at] + y * sizes[b, at + 1] + z * sizes[b, at + 2]
        placed[b, MIDDLE + i] = (
            links[link, 9 + i] + x * sizes[b, CENTER] + y * sizes[b, CENTER + 1] + z * sizes[b, CENTER + 2]
        )


@part
def reckon_sweeps(
    kinds: Any, sizes: Any, chains: Any, joints: Any, state: Any, b: int, placed: Any, sweeps: Any
) -> None:
    """How far body b reaches from each joint of its chain, and how far that joint and those after it carry it.

    Written to `sweeps[b, 0]` (1 for a sliding joint) and `sweeps[b, 1]`.
    """
    depth = kinds[b, DEPTH]
    sweeps[b, 1, depth] = 0.0
    for i in range(depth - 1, -1, -1):
        j = chains[kinds[b, CHAIN] + i]
        change = state[j, CHANGE]
        if joints[j, KIND_OF_JOINT] == SLIDES:
            sweeps[b, 0, i] = 1.0
            sweeps[b, 1, i] = sweeps[b, 1, i + 1] + change
            continue
        x = placed[b, MIDDLE] - state[j, PIVOT]
        y = placed[b, MIDDLE + 1] - state[j, PIVOT + 1]
        z = placed[b, MIDDLE + 2] - state[j, PIVOT + 2]
        along = x * state[j, 0] + y * state[j, 1] + z * state[j, 2]
        across = sqrt(max(0.0, x * x + y * y + z * z - along * along)) + sizes[b, RADIUS] + _ROUNDING
        sweeps[b, 0, i] = across
        # A chord is never longer than the arc, nor than the diameter.
        sweeps[b, 1, i] = sweeps[b, 1, i + 1] + min(change, 2.0) * across


@part
def unsteadiness(kinds: Any, chains: Any, joints: Any, state: Any, sweeps: Any, b: int, shared: int) -> float:
    """What body b can move beside its steady velocity, by the joints of its chain from `shared` on [m]."""
    total, tilt = 0.0, 0.0
    for i in range(shared, kinds[b, DEPTH]):
        j = chains[kinds[b, CHAIN] + i]
        change, rest = state[j, CHANGE], state[j, REST]
        if joints[j, KIND_OF_JOINT] == SLIDES:
            total += rest + tilt * change
        else:
            total += sweeps[b, 0, i] * (rest + change * (0.5 * change + tilt))
            tilt += change
    return total


@part
def steady_reach(
    kinds: Any,
    sizes: Any,
    corners: Any,
    placed: Any,
    state: Any,
    b: int,
    last: int,
    shared: int,
    time: float,
    x: float,
    y: float,
    z: float,
) -> float:
    """Support of body b along d, from its frame's origin, after `time` at its steady velocity.

    That is the velocity under the joints up to the last that carries it, less that under those up to `shared`.
    """
    wx, wy, wz = (
        state[last, ANGULAR] - state[shared, ANGULAR],
        state[last, ANGULAR + 1] - state[shared, ANGULAR + 1],
        state[last, ANGULAR + 2] - state[shared, ANGULAR + 2],
    )
    px, py, pz = placed[b, ORIGIN], placed[b, ORIGIN + 1], placed[b, ORIGIN + 2]
    vx = state[last, LINEAR] - state[shared, LINEAR] + wy * pz - wz * py
    vy = state[last, LINEAR + 1] - state[shared, LINEAR + 1] + wz * px - wx * pz
    vz = state[last, LINEAR + 2] - state[shared, LINEAR + 2] + wx * py - wy * px
    moved = time * (x * vx + y * vy + z * vz)
    # d . (w x r) = (d x w) . r
    u, v, w = x + time * (y * wz - z * wy), y + time * (z * wx - x * wz), z + time * (x * wy - y * wx)
    return float(moved) + reach(kinds, sizes, corners, placed, b, u, v, w)


@part
def box_gap(sizes: Any, placed: Any, a: int, b: int) -> float:
    """Distance of the centre of body b from the bounding box of body a [m]; 0 inside."""
    x = placed[b, MIDDLE] - placed[a, MIDDLE]
    y = placed[b, MIDDLE + 1] - placed[a, MIDDLE + 1]
    z = placed[b, MIDDLE + 2] - placed[a, MIDDLE + 2]
    total = 0.0
    for j in range(3):
        along = placed[a, j] * x + placed[a, 3 + j] * y + placed[a, 6 + j] * z
        outside = abs(along) - sizes[a, BOUND + j]
        if outside > 0.0:
            total += outside * outside
    return sqrt(total)
