# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""Spheres against obstacles and each other, for many configurations of an edge side by side.

Solids that move are covered by spheres. Around a configuration, a sphere's centre with velocity v along
the edge and an acceleration of at most a stays, for the time h before and after, within |n.v| h + a h^2 / 2
of where it is, measured along any direction n. With n the direction from an obstacle's nearest point (or from the
other sphere), that is a bound of how far the gap can close, because the obstacle is convex. A ball inside a solid
that touches proves a contact. What spheres cannot tell apart, a separating direction may: see `directions.py`.
"""

from __future__ import annotations

from numba import types

from rr1plan._kernels.cover import COVER, SLACK, SPHERE, WORK
from rr1plan._kernels.jit import F64, I64, jit
from rr1plan._kernels.lanes import LANES, WIDTH, below, lesser, load, root, size_of
from rr1plan._kernels.obstacles import approach_to, square_to
from rr1plan._kernels.placing import place_ball, place_spheres, velocity_of
from rr1plan._kernels.tables import NUMBERS

_FOUND = types.UniTuple(I64, 4)
_PLACE = types.UniTuple(LANES, 3)


@jit(types.void(I64, I64, LANES, COVER, WORK), inline=True, allocates=False)
def ready_ball(b, batch, h, cover, work):
    """Place the ball around a body, once in a batch."""
    if work.placed[b] != batch and work.placed[b] != -batch:
        work.placed[b] = -batch
        place_ball(cover.bodies[b, 3], cover.bodies[b, 1], h, cover, work)


@jit(types.void(I64, I64, LANES, COVER, WORK), inline=True, allocates=False)
def _ready_spheres(b, batch, h, cover, work):
    """Place the spheres of a body whose ball is placed, once in a batch."""
    if work.placed[b] != batch:
        work.placed[b] = batch
        place_spheres(b, h, cover, work)


@jit(_PLACE(I64, NUMBERS), inline=True, allocates=False)
def _centre(i, centres):
    """Where the centre of a sphere is."""
    at = i * SPHERE
    return load(centres, at), load(centres, at + WIDTH), load(centres, at + 2 * WIDTH)


# ---- against obstacles -----------------------------------------------------------------------------


@jit(I64(I64, I64, I64, F64, I64, LANES, COVER, WORK), inline=True, allocates=False)
def nearing(g, i, o, padding, asked, h, cover, work):
    """In which of the lanes asked for a sphere of a group may come too near an obstacle.

    With d the distance of the centre from the obstacle's core, r the least that it has to be and s the speed along it,
    that is d - r < s h + a h^2 / 2, or with all of it times d, (d - r) d < s d h + d a h^2 / 2: nothing is divided.
    """
    values, kinds = cover.obstacle_values, cover.obstacles
    needed = cover.spheres[i, 3] + padding + cover.margins[0] + values[o, 15]
    x, y, z = _centre(i, work.centres)
    square = square_to(values, kinds, o, x, y, z)
    limit = load(work.centres, i * SPHERE + 3 * WIDTH) + needed
    lanes = below(square, limit * limit) & asked
    # Where it is too near at once, no speed has to be known.
    others = lanes & ~below(square, needed * needed)
    if others == 0:
        return lanes
    u, v, w = velocity_of(cover.groups[g, 0], i, work)
    distance = root(square)
    lost = approach_to(values, kinds, o, x, y, z, u, v, w) * h + distance * (h * h * (0.5 * work.pushes[g, 0]))
    return lanes & ~others | others & below((distance - needed) * distance, lost)


@jit(_FOUND(I64, I64, I64, I64, I64, LANES, COVER, WORK), inline=True, allocates=False)
def meet_obstacle(b, o, pair, asked, batch, h, cover, work):
    """A body, the ball around which is placed and may be too near, against an obstacle in the lanes asked for.

    Returns:
        Bits of the lanes that stay open, of those with a proven contact, and the last sphere that was too near (twice).
    """
    spheres, values, kinds = cover.spheres, cover.obstacle_values, cover.obstacles
    ball, padding, count = cover.bodies[b, 1], cover.padding[pair], 0
    kept = padding + values[o, 15]
    _ready_spheres(b, batch, h, cover, work)
    # Contacts first: whoever finds one needs no speeds.
    for i in range(ball + 1, cover.bodies[b, 2]):
        x, y, z = _centre(i, work.centres)
        square = square_to(values, kinds, o, x, y, z)
        limit = load(work.centres, i * SPHERE + 3 * WIDTH) + (spheres[i, 3] + kept + cover.margins[0])
        lanes = below(square, limit * limit) & asked
        if lanes:
            inner = spheres[i, 4] + kept - cover.margins[0]
            if inner > 0.0 and kinds[o, 1]:
                touching = below(square, inner * inner) & lanes
                if touching:
                    return lanes, touching, i, i
            work.near[count, 0], work.near[count, 1] = i, lanes
            count += 1
    left, beside = 0, ball
    for n in range(count):
        i, lanes = work.near[n, 0], work.near[n, 1] & ~left
        if lanes:
            lanes = nearing(cover.bodies[b, 3], i, o, padding, lanes, h, cover, work)
            if lanes:
                left |= lanes
                beside = i
    return left, 0, beside, beside


# ---- against each other ----------------------------------------------------------------------------


@jit(LANES(I64, I64, NUMBERS), inline=True, allocates=False)
def _square_between(i, k, centres):
    """Square of the distance of the centres of two spheres [m^2]."""
    x, y, z = _centre(i, centres)
    u, v, w = _centre(k, centres)
    x, y, z = x - u, y - v, z - w
    return x * x + y * y + z * z


@jit(I64(I64, I64, I64, I64, I64, I64, F64, LANES, COVER, WORK), inline=True, allocates=False)
def approaching(g, i, other, k, shared, asked, padding, h, cover, work):
    """In which of the lanes asked for a sphere of one group and one of another may come too near, as in `nearing`."""
    centres = work.centres
    needed = cover.spheres[i, 3] + cover.spheres[k, 3] + padding + cover.margins[0]
    far = h * (work.speeds[g, shared] + work.speeds[other, shared])
    square = _square_between(i, k, centres)
    travel = load(centres, i * SPHERE + 3 * WIDTH) + load(centres, k * SPHERE + 3 * WIDTH)
    limit = lesser(travel, far) + needed
    lanes = below(square, limit * limit) & asked
    others = lanes & ~below(square, needed * needed)
    if others == 0:
        return lanes
    x, y, z = _centre(i, centres)
    dx, dy, dz = _centre(k, centres)
    u, v, w = velocity_of(cover.groups[g, 0], i, work)
    du, dv, dw = velocity_of(cover.groups[other, 0], k, work)
    along = size_of((x - dx) * (u - du) + (y - dy) * (v - dv) + (z - dz) * (w - dw)) * SLACK
    distance, push = root(square), work.pushes[g, shared] + work.pushes[other, shared]
    lost = along * h + distance * (h * h * (0.5 * push))
    return lanes & ~others | others & below((distance - needed) * distance, lost)


@jit(_FOUND(I64, I64, I64, I64, I64, I64, LANES, COVER, WORK), inline=True, allocates=False)
def meet_body(a, b, shared, pair, asked, batch, h, cover, work):
    """A body against another, both balls being placed, see `meet_obstacle`; the last are a sphere of either."""
    centres, spheres, padding = work.centres, cover.spheres, cover.padding[pair]
    g, other = cover.bodies[a, 3], cover.bodies[b, 3]
    ball_a, ball_b = cover.bodies[a, 1], cover.bodies[b, 1]
    for body in (a, b):
        _ready_spheres(body, batch, h, cover, work)
    # Only the spheres of either that are near the other's ball.
    count = 0
    for k in range(ball_b + 1, cover.bodies[b, 2]):
        lanes = approaching(g, ball_a, other, k, shared, asked, padding, h, cover, work)
        if lanes:
            work.near[count, 0], work.near[count, 1] = k, lanes
            count += 1
    left, one, two = 0, ball_a, ball_b
    for i in range(ball_a + 1, cover.bodies[a, 2] if count else 0):
        beside = approaching(g, i, other, ball_b, shared, asked, padding, h, cover, work)
        for n in range(count if beside else 0):
            k = work.near[n, 0]
            lanes = work.near[n, 1] & beside & ~left
            if lanes:
                lanes = approaching(g, i, other, k, shared, lanes, padding, h, cover, work)
            if lanes:
                inner = spheres[i, 4] + spheres[k, 4] + padding - cover.margins[0]
                if inner > 0.0:
                    touching = below(_square_between(i, k, centres), inner * inner) & lanes
                    if touching:
                        return lanes, touching, i, k
                left |= lanes
                one, two = i, k
    return left, 0, one, two
