# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""A certificate for a whole curve in joint space (Schwarzer, Saha, Latombe 2005).

Around a configuration, a pair of bodies with a gap c stays apart as long as they move against each
other by less than c. How far that can be on an interval is bounded by the sum, over the joints that
move one but not the other, of how much the joint turns times how far from its axis the body reaches.
Intervals whose gap does not suffice are halved, all of one width before any narrower one, so that
contacts show early.

Curves are polynomials in t; a straight edge is one of degree 1. Bodies and their bounding volumes:
see `separation.py`. All tables are built by `rr1plan.collision.tables`.
"""

from __future__ import annotations

import numpy as np
from numba import types

from rr1plan._kernels.jit import F64, FLOATS1, FLOATS2, I64, INT1, INTS1, INTS2, OUT1, OUT2, jit
from rr1plan._kernels.separation import BOX, CELLS, HALF_SPACE, POINT, separation, support

FREE, CONTACT, GRAZING = range(3)

# Rounding of positions is far below this [m]; every bound of a displacement is made larger by it.
_ROUNDING = 1e-9
_RELATIVE = 1.0 + 1e-9
_EPSILON = 2.3e-16
# Where bodies move farther than this, only contacts are looked for [m].
_COARSE = 0.07
# Numbers so large that their rounding alone exceeds the tolerance would halve for ever.
_MOST_CONFIGURATIONS = 2_000_000


@jit(types.void(FLOATS2, F64, F64, F64, OUT2, OUT1, OUT1), allocates=False)
def take_interval(curve, duration, middle, half, work, q, reach):
    """Position at the middle of an interval, and how far each column gets from it on the interval at most.

    Args:
        curve: Coefficients of q(t) = sum_k curve[k] t^k, shape (k, nq).
        duration: End of the curve.
        middle: Middle of the interval.
        half: Half its width.
        work: Scratch memory, shape (k, nq).
        q: Out, shape (nq,).
        reach: Out, shape (nq,).
    """
    terms, nq = curve.shape
    for j in range(nq):
        size, power = 0.0, 1.0
        for k in range(terms):
            work[k, j] = curve[k, j]
            size += abs(curve[k, j]) * power
            power *= duration
        # Taylor's coefficients at the middle, by repeated division.
        for first in range(terms - 1):
            for k in range(terms - 2, first - 1, -1):
                work[k, j] += middle * work[k + 1, j]
        q[j] = work[0, j]
        bound = 0.0
        for k in range(terms - 1, 0, -1):
            bound = (bound + abs(work[k, j])) * half
        reach[j] = bound * _RELATIVE + 8.0 * terms * terms * _EPSILON * size


@jit(types.void(INTS2, FLOATS2, FLOATS1, OUT2, OUT1), allocates=False)
def place_joints(joints, joint_values, q, poses, angles):
    """World poses of all driven joints.

    Args:
        joints: Parent, 1 for prismatic, column (or -1), 1 if anything drives it or a joint above it, shape (n, 4).
        joint_values: T_parent_joint (12), axis (3), gain, offset; shape (n, 17).
        q: Configuration, shape (nq,).
        poses: In: poses of the joints that rest; out: of all, shape (n, 12).
        angles: Scratch memory, shape (12,).
    """
    for j in range(1, joints.shape[0]):
        if joints[j, 3] == 0:
            continue
        p = joints[j, 0]
        column = joints[j, 2]
        value = joint_values[j, 16]
        if column >= 0:
            value += joint_values[j, 15] * q[column]
        x, y, z = joint_values[j, 12], joint_values[j, 13], joint_values[j, 14]
        for r in range(3):
            for c in range(3):
                angles[3 * r + c] = (
                    poses[p, 3 * r] * joint_values[j, c]
                    + poses[p, 3 * r + 1] * joint_values[j, 3 + c]
                    + poses[p, 3 * r + 2] * joint_values[j, 6 + c]
                )
            poses[j, 9 + r] = (
                poses[p, 3 * r] * joint_values[j, 9]
                + poses[p, 3 * r + 1] * joint_values[j, 10]
                + poses[p, 3 * r + 2] * joint_values[j, 11]
                + poses[p, 9 + r]
            )
        if joints[j, 1] == 1:
            for r in range(3):
                for c in range(3):
                    poses[j, 3 * r + c] = angles[3 * r + c]
                along = angles[3 * r] * x + angles[3 * r + 1] * y + angles[3 * r + 2] * z
                poses[j, 9 + r] += value * along
            continue
        s, co = np.sin(value), np.cos(value)
        v = 1.0 - co
        m00, m01, m02 = co + v * x * x, v * x * y - s * z, v * x * z + s * y
        m10, m11, m12 = v * x * y + s * z, co + v * y * y, v * y * z - s * x
        m20, m21, m22 = v * x * z - s * y, v * y * z + s * x, co + v * z * z
        for r in range(3):
            a, b, c = angles[3 * r], angles[3 * r + 1], angles[3 * r + 2]
            poses[j, 3 * r] = a * m00 + b * m10 + c * m20
            poses[j, 3 * r + 1] = a * m01 + b * m11 + c * m21
            poses[j, 3 * r + 2] = a * m02 + b * m12 + c * m22


@jit(types.void(I64, INTS2, FLOATS2, OUT2, OUT2, OUT2), allocates=False)
def place_body(body, bodies, body_values, joint_poses, poses, centres):
    """World pose of a body and of the centre of its ball; columns as in `certify`."""
    j = bodies[body, 1]
    for r in range(3):
        a, b, c = joint_poses[j, 3 * r], joint_poses[j, 3 * r + 1], joint_poses[j, 3 * r + 2]
        for k in range(3):
            poses[body, 3 * r + k] = (
                a * body_values[body, k] + b * body_values[body, 3 + k] + c * body_values[body, 6 + k]
            )
        shift = joint_poses[j, 9 + r]
        poses[body, 9 + r] = a * body_values[body, 9] + b * body_values[body, 10] + c * body_values[body, 11] + shift
        centres[body, r] = a * body_values[body, 12] + b * body_values[body, 13] + c * body_values[body, 14] + shift


@jit(types.void(I64, INTS2, FLOATS2, INTS1, FLOATS1, INTS2, FLOATS2, OUT2, FLOATS1, OUT2, OUT2), allocates=False)
def bound_travel(
    body, bodies, body_values, chain, chain_reach, joints, joint_values, joint_poses, reach, centres, travel
):
    """How far any point of a body can get from where it is, per joint of its chain and all below it.

    Args:
        body: The body.
        bodies: See `certify`.
        body_values: See `certify`.
        chain: See `certify`.
        chain_reach: See `certify`.
        joints: See `certify`.
        joint_values: See `certify`.
        joint_poses: World poses of the joints, shape (n, 12).
        reach: How far each column of q gets from its value, shape (nq,).
        centres: Centre of each body's ball in the world.
        travel: Out, row `body`: entry k is the bound from the chain's joints k and on.
    """
    first, last = bodies[body, 4], bodies[body, 5]
    radius = body_values[body, 15]
    # `centre` bounds the travel of the ball's centre, `surface` that of any point of the body.
    centre, surface = 0.0, 0.0
    travel[body, last - first] = 0.0
    for k in range(last - 1, first - 1, -1):
        j = chain[k]
        amount = abs(joint_values[j, 15]) * reach[joints[j, 2]]
        if joints[j, 1] == 1:
            centre += amount
            surface += amount
        else:
            x = joint_poses[j, 0] * joint_values[j, 12] + joint_poses[j, 1] * joint_values[j, 13]
            y = joint_poses[j, 3] * joint_values[j, 12] + joint_poses[j, 4] * joint_values[j, 13]
            z = joint_poses[j, 6] * joint_values[j, 12] + joint_poses[j, 7] * joint_values[j, 13]
            x += joint_poses[j, 2] * joint_values[j, 14]
            y += joint_poses[j, 5] * joint_values[j, 14]
            z += joint_poses[j, 8] * joint_values[j, 14]
            dx = centres[body, 0] - joint_poses[j, 9]
            dy = centres[body, 1] - joint_poses[j, 10]
            dz = centres[body, 2] - joint_poses[j, 11]
            cx, cy, cz = y * dz - z * dy, z * dx - x * dz, x * dy - y * dx
            arm = min(chain_reach[k], np.sqrt(cx * cx + cy * cy + cz * cz) + centre)
            centre += amount * arm
            surface += amount * (arm + radius)
        travel[body, k - first] = surface


@jit(F64(I64, OUT2, FLOATS2, F64, F64, F64), allocates=False)
def _ball_gap_to_box(body, poses, body_values, x, y, z):
    """Distance from a point of the world to the bounding box of a body [m]."""
    dx, dy, dz = x - poses[body, 9], y - poses[body, 10], z - poses[body, 11]
    square = 0.0
    for c in range(3):
        along = poses[body, c] * dx + poses[body, 3 + c] * dy + poses[body, 6 + c] * dz
        out = abs(along - body_values[body, 17 + c]) - body_values[body, 20 + c]
        if out > 0.0:
            square += out * out
    return np.sqrt(square)


@jit(F64(I64, I64, INTS2, FLOATS2, OUT2, OUT2, F64), allocates=False)
def quick_gap(a, b, bodies, body_values, poses, centres, enough):
    """A lower bound of the distance of two bodies from their balls and boxes [m]; it stops at enough."""
    if bodies[b, 0] == HALF_SPACE:
        return -np.inf
    dx, dy, dz = centres[a, 0] - centres[b, 0], centres[a, 1] - centres[b, 1], centres[a, 2] - centres[b, 2]
    ra, rb = body_values[a, 15], body_values[b, 15]
    gap = np.sqrt(dx * dx + dy * dy + dz * dz) - ra - rb
    if gap < enough and bodies[b, 0] != POINT:
        gap = max(gap, _ball_gap_to_box(b, poses, body_values, centres[a, 0], centres[a, 1], centres[a, 2]) - ra)
    if gap < enough and bodies[a, 0] != POINT:
        gap = max(gap, _ball_gap_to_box(a, poses, body_values, centres[b, 0], centres[b, 1], centres[b, 2]) - rb)
    return gap


@jit(F64(I64, I64, INTS2, FLOATS2, FLOATS2, INTS1, OUT2, F64), allocates=False)
def _gap_to_half_space(a, b, bodies, body_values, corners, links, poses, radius):
    """Exact distance of a body to the plane of half-space b [m]."""
    nx = poses[b, 0] * body_values[b, 23] + poses[b, 1] * body_values[b, 24] + poses[b, 2] * body_values[b, 25]
    ny = poses[b, 3] * body_values[b, 23] + poses[b, 4] * body_values[b, 24] + poses[b, 5] * body_values[b, 25]
    nz = poses[b, 6] * body_values[b, 23] + poses[b, 7] * body_values[b, 24] + poses[b, 8] * body_values[b, 25]
    x, y, z, _ = support(bodies[a, 0], body_values[a, 23:26], poses[a], corners, links, bodies[a, 2], -nx, -ny, -nz)
    height = nx * (x - poses[b, 9]) + ny * (y - poses[b, 10]) + nz * (z - poses[b, 11])
    return height - body_values[b, 26] - radius


@jit(
    types.UniTuple(F64, 2)(I64, I64, INTS2, FLOATS2, FLOATS2, INTS1, OUT2, OUT2, F64, F64, OUT1, OUT2, OUT1),
    allocates=False,
)
def _gap_to_cells(a, b, bodies, body_values, corners, links, poses, centres, least, enough, n, scratch, cell):
    """Bounds of the distance of a body to the occupied cells of cloud b [m]."""
    half = body_values[b, 23]
    radius = body_values[a, 16]
    lower, upper = np.inf, np.inf
    dx, dy, dz = centres[a, 0] - poses[b, 9], centres[a, 1] - poses[b, 10], centres[a, 2] - poses[b, 11]
    lx = poses[b, 0] * dx + poses[b, 3] * dy + poses[b, 6] * dz
    ly = poses[b, 1] * dx + poses[b, 4] * dy + poses[b, 7] * dz
    lz = poses[b, 2] * dx + poses[b, 5] * dy + poses[b, 8] * dz
    near = enough + body_values[a, 15]
    for k in range(9):
        cell[k] = poses[b, k]
    for i in range(bodies[b, 2], bodies[b, 3]):
        ox = max(0.0, abs(lx - corners[i, 0]) - half)
        oy = max(0.0, abs(ly - corners[i, 1]) - half)
        oz = max(0.0, abs(lz - corners[i, 2]) - half)
        square = ox * ox + oy * oy + oz * oz
        if near < 0.0 or square < near * near:
            for r in range(3):
                cell[9 + r] = poses[b, 9 + r]
                for c in range(3):
                    cell[9 + r] += poses[b, 3 * r + c] * corners[i, c]
            n[0], n[1], n[2] = centres[a, 0] - cell[9], centres[a, 1] - cell[10], centres[a, 2] - cell[11]
            low, high = separation(
                bodies[a, 0], body_values[a, 23:26], poses[a], corners, links, bodies[a, 2],
                BOX, body_values[b, 23:26], cell, corners, links, 0, least + radius, enough + radius, n, scratch,
            )  # fmt: skip
            lower = min(lower, low - radius)
            upper = min(upper, high - radius)
            if upper <= least:
                return lower, upper
    return lower, upper


@jit(
    types.UniTuple(F64, 2)(I64, I64, INTS2, FLOATS2, FLOATS2, INTS1, OUT2, OUT2, F64, F64, OUT1, OUT2, OUT1),
    allocates=False,
)
def fine_gap(a, b, bodies, body_values, corners, links, poses, centres, least, enough, n, scratch, cell):
    """Bounds of the distance of two bodies [m]: proven lower, upper; stops at `enough`."""
    radius = body_values[a, 16] + body_values[b, 16]
    if bodies[b, 0] == HALF_SPACE:
        gap = _gap_to_half_space(a, b, bodies, body_values, corners, links, poses, radius)
        return gap, gap
    if bodies[b, 0] == CELLS:
        return _gap_to_cells(a, b, bodies, body_values, corners, links, poses, centres, least, enough, n, scratch, cell)
    if n[0] == 0.0 and n[1] == 0.0 and n[2] == 0.0:
        for c in range(3):
            n[c] = centres[a, c] - centres[b, c]
        if n[0] == 0.0 and n[1] == 0.0 and n[2] == 0.0:
            n[2] = 1.0
    lower, upper = separation(
        bodies[a, 0], body_values[a, 23:26], poses[a], corners, links, bodies[a, 2],
        bodies[b, 0], body_values[b, 23:26], poses[b], corners, links, bodies[b, 2],
        least + radius, enough + radius, n, scratch,
    )  # fmt: skip
    return lower - radius, upper - radius


@jit(
    types.Tuple((I64, F64, I64, I64, I64))(
        *(FLOATS2, F64, F64, OUT1, OUT1, INT1, INT1),
        *(INTS2, FLOATS2, INTS2, FLOATS2, FLOATS2, INTS1, INTS1, FLOATS1, INTS2, FLOATS1),
        *(OUT2, OUT2, OUT2, OUT2),
    )
)
def _halve(
    curve,
    duration,
    tolerance,
    middles,
    halves,
    begins,
    open_pairs,
    joints,
    joint_values,
    bodies,
    body_values,
    corners,
    links,
    chain,
    chain_reach,
    pairs,
    padding,
    joint_poses,
    poses,
    centres,
    directions,
):
    """Halve intervals until every pair open on them is proven apart, or one is not; see `certify`.

    Interval i is halves[i] to both sides of middles[i], its pairs are open_pairs[begins[i] : begins[i + 1]].
    """
    terms, nq = curve.shape
    work, q, reach = np.empty((terms, nq)), np.empty(nq), np.empty(nq)
    small, scratch = np.empty(12), np.empty((4, 3))
    travel = np.empty((bodies.shape[0], joints.shape[0] + 1))
    placed = np.full(bodies.shape[0], -1, np.int64)
    seen, fine = 0, 0
    # From one interval to the next a pair keeps its direction; from call to call it does not: same edge, same answer.
    directions[:, :] = 0.0
    while len(middles) > 0:
        if seen > _MOST_CONFIGURATIONS:
            return GRAZING, middles[0], open_pairs[0], seen, fine
        next_middles = np.empty(2 * len(middles))
        next_halves = np.empty(2 * len(middles))
        next_begins = np.empty(2 * len(middles) + 1, np.int64)
        next_pairs = np.empty(2 * len(open_pairs), np.int64)
        intervals, stored = 0, 0
        next_begins[0] = 0
        for i in range(len(middles)):
            take_interval(curve, duration, middles[i], halves[i], work, q, reach)
            place_joints(joints, joint_values, q, joint_poses, small)
            seen += 1
            before = stored
            for k in range(begins[i], begins[i + 1]):
                p = open_pairs[k]
                a, b = pairs[p, 0], pairs[p, 1]
                for body in (a, b):
                    if placed[body] != seen and bodies[body, 5] > bodies[body, 4]:
                        placed[body] = seen
                        place_body(body, bodies, body_values, joint_poses, poses, centres)
                        bound_travel(
                            body, bodies, body_values, chain, chain_reach, joints, joint_values, joint_poses, reach,
                            centres, travel,
                        )  # fmt: skip
                shared = pairs[p, 2]
                moved = 0.0
                if bodies[a, 5] > bodies[a, 4]:
                    moved += travel[a, shared]
                if bodies[b, 5] > bodies[b, 4]:
                    moved += travel[b, shared]
                enough = padding[p] + moved * _RELATIVE + _ROUNDING
                quick = quick_gap(a, b, bodies, body_values, poses, centres, enough)
                if quick >= enough:
                    continue
                if moved > _COARSE and quick > padding[p]:
                    # Too wide an interval to prove anything on, and no contact to be seen: halve it.
                    next_pairs[stored] = p
                    stored += 1
                    continue
                fine += 1
                lower, upper = fine_gap(
                    a,
                    b,
                    bodies,
                    body_values,
                    corners,
                    links,
                    poses,
                    centres,
                    padding[p],
                    enough,
                    directions[p],
                    scratch,
                    small,
                )
                if lower >= enough:
                    continue
                if upper <= padding[p]:
                    return CONTACT, middles[i], p, seen, fine
                if moved < tolerance:
                    return GRAZING, middles[i], p, seen, fine
                next_pairs[stored] = p
                stored += 1
            if stored > before:
                opened = stored - before
                for side in range(2):
                    next_middles[intervals] = middles[i] + (side - 0.5) * halves[i]
                    next_halves[intervals] = 0.5 * halves[i]
                    intervals += 1
                    next_begins[intervals] = before + (side + 1) * opened
                for k in range(opened):
                    next_pairs[stored + k] = next_pairs[before + k]
                stored += opened
        middles, halves = next_middles[:intervals], next_halves[:intervals]
        begins, open_pairs = next_begins[: intervals + 1], next_pairs[:stored]
    return FREE, 0.0, -1, seen, fine


@jit(
    types.Tuple((I64, F64, I64, I64, I64))(
        *(FLOATS2, F64, F64),
        *(INTS2, FLOATS2, INTS2, FLOATS2, FLOATS2, INTS1, INTS1, FLOATS1, INTS2, FLOATS1),
        *(OUT2, OUT2, OUT2, OUT2),
    )
)
def certify(
    curve,
    duration,
    tolerance,
    joints,
    joint_values,
    bodies,
    body_values,
    corners,
    links,
    chain,
    chain_reach,
    pairs,
    padding,
    joint_poses,
    poses,
    centres,
    directions,
):
    """Certify a curve free of contact, or find a place where it is not.

    Args:
        curve: Coefficients of q(t) = sum_k curve[k] t^k, shape (k, nq).
        duration: End of the curve; it begins at 0.
        tolerance: Gaps beyond the padding smaller than this are given up [m].
        joints: See `place_joints`; row 0 is the world.
        joint_values: The same.
        bodies: Kind, joint, first and last corner, first and last entry of its chain; shape (b, 6).
        body_values: T_joint_body (12), centre of its ball in the joint's frame (3), radius of the ball,
            radius around the core, centre (3) and half sizes (3) of its box in its own frame, size (3;
            a half-space's normal), a half-space's offset; shape (b, 27).
        corners: Corner points of all bodies of kind CORNERS, centres of the cells of CELLS, shape (c, 3).
        links: Neighbours of corner i are links[links[i] : links[i + 1]].
        chain: Driven joints above each body, root first.
        chain_reach: For each, how far the centre of the body's ball can ever be from the joint's axis [m].
        pairs: Body, body (the half-space or cloud, if there is one), how many joints their chains share;
            shape (p, 3).
        padding: Distance to keep, shape (p,).
        joint_poses: World poses of joints, shape (n, 12): in, of those that rest; the others are scratch.
        poses: The same of bodies, shape (b, 12).
        centres: The same of the centres of their balls, shape (b, 3).
        directions: Scratch memory, shape (p, 3).

    Returns:
        FREE, CONTACT or GRAZING; where; which pair; configurations looked at; gaps computed finely.
    """
    middles, halves = np.full(1, 0.5 * duration), np.full(1, 0.5 * duration)
    begins, open_pairs = np.zeros(2, np.int64), np.arange(pairs.shape[0])
    begins[1] = pairs.shape[0]
    return _halve(
        curve, duration, tolerance, middles, halves, begins, open_pairs,
        joints, joint_values, bodies, body_values, corners, links, chain, chain_reach, pairs, padding,
        joint_poses, poses, centres, directions,
    )  # fmt: skip


@jit(
    types.Tuple((I64, F64, I64, I64, I64))(
        *(FLOATS2, F64, F64, FLOATS2, INTS1, I64),
        *(INTS2, FLOATS2, INTS2, FLOATS2, FLOATS2, INTS1, INTS1, FLOATS1, INTS2, FLOATS1),
        *(OUT2, OUT2, OUT2, OUT2),
    )
)
def certify_open(
    curve,
    duration,
    tolerance,
    spans,
    span_pairs,
    count,
    joints,
    joint_values,
    bodies,
    body_values,
    corners,
    links,
    chain,
    chain_reach,
    pairs,
    padding,
    joint_poses,
    poses,
    centres,
    directions,
):
    """Certify what is left of a curve: some pairs on some intervals. All else as in `certify`.

    Args:
        curve: See `certify`.
        duration: The same.
        tolerance: The same.
        spans: Middle and half width of an interval, shape (n, 2); those of one interval need not be neighbours.
        span_pairs: The pair open on each, shape (n,).
        count: How many of them count.
        joints: From here on see `certify`.
        joint_values: The same.
        bodies: The same.
        body_values: The same.
        corners: The same.
        links: The same.
        chain: The same.
        chain_reach: The same.
        pairs: The same.
        padding: The same.
        joint_poses: The same.
        poses: The same.
        centres: The same.
        directions: The same.
    """
    middles, halves = np.empty(count), np.empty(count)
    begins, open_pairs = np.empty(count + 1, np.int64), np.empty(count, np.int64)
    done = np.zeros(count, np.bool_)
    intervals, stored = 0, 0
    begins[0] = 0
    for i in range(count):
        if done[i]:
            continue
        middles[intervals], halves[intervals] = spans[i, 0], spans[i, 1]
        for k in range(i, count):
            if spans[k, 0] == spans[i, 0] and spans[k, 1] == spans[i, 1]:
                done[k] = True
                open_pairs[stored] = span_pairs[k]
                stored += 1
        intervals += 1
        begins[intervals] = stored
    return _halve(
        curve, duration, tolerance, middles[:intervals], halves[:intervals], begins[: intervals + 1], open_pairs,
        joints, joint_values, bodies, body_values, corners, links, chain, chain_reach, pairs, padding,
        joint_poses, poses, centres, directions,
    )  # fmt: skip
