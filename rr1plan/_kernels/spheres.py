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
from rr1plan._kernels.lanes import LANES, WIDTH, below, greater, lesser, load, root, size_of
from rr1plan._kernels.obstacles import approach_to, gap_to, within
from rr1plan._kernels.placing import place_ball, place_spheres, velocity_of
from rr1plan._kernels.tables import NUMBERS

_FOUND = types.UniTuple(I64, 4)


@jit(types.void(I64, I64, LANES, COVER, WORK), inline=True, allocates=False)
def _ready_ball(b, batch, h, cover, work):
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


@jit(LANES(I64, I64, I64, LANES, LANES, COVER, WORK), inline=True, allocates=False)
def _gap_left(b, i, o, gap, h, cover, work):
    """What is left at least, on whole intervals, of the gap of a sphere's centre and an obstacle [m]."""
    g, at = cover.bodies[b, 3], i * SPHERE
    centres, values, kinds = work.centres, cover.obstacle_values, cover.obstacles
    x, y, z = load(centres, at), load(centres, at + WIDTH), load(centres, at + 2 * WIDTH)
    u, v, w = velocity_of(cover.bodies[b, 0], i, work)
    speed = approach_to(values, kinds, o, x, y, z, u, v, w)
    return gap - lesser(speed * h + h * h * (0.5 * work.pushes[g, 0]), h * work.speeds[g, 0])


@jit(_FOUND(I64, I64, I64, I64, I64, LANES, COVER, WORK), inline=True, allocates=False)
def meet_obstacle(b, o, pair, asked, batch, h, cover, work):
    """A body against an obstacle in the lanes asked for.

    Returns:
        Bits of the lanes that stay open, of those with a proven contact, and the last sphere that was too near (twice).
    """
    centres, spheres = work.centres, cover.spheres
    values, kinds = cover.obstacle_values, cover.obstacles
    first, last = cover.bodies[b, 1], cover.bodies[b, 2]
    _ready_ball(b, batch, h, cover, work)
    left, beside, padding = 0, first, cover.padding[pair]
    for i in range(first, last):
        at, needed = i * SPHERE, spheres[i, 3] + padding + cover.margins[0]
        x, y, z = load(centres, at), load(centres, at + WIDTH), load(centres, at + 2 * WIDTH)
        lanes = within(values, kinds, o, x, y, z, load(centres, at + 3 * WIDTH) + needed) & asked
        if lanes:
            gap = gap_to(values, kinds, o, x, y, z)
            if kinds[o, 1]:
                touching = below(gap, spheres[i, 4] + padding - cover.margins[0]) & lanes
                if touching:
                    return lanes, touching, i, i
            # Where it is too near at once, no speed has to be known.
            if lanes & ~below(gap, needed):
                lanes &= below(_gap_left(b, i, o, gap, h, cover, work), needed)
        if i == first:
            # The ball around all: what it clears, all spheres clear.
            asked = lanes
            if lanes == 0:
                return 0, 0, first, first
            _ready_spheres(b, batch, h, cover, work)
        elif lanes:
            left |= lanes
            beside = i
    return left, 0, beside, beside


@jit(LANES(I64, I64, NUMBERS), inline=True, allocates=False)
def _square_between(i, k, centres):
    """Square of the distance of the centres of two spheres [m^2]."""
    at, to = i * SPHERE, k * SPHERE
    dx = load(centres, at) - load(centres, to)
    dy = load(centres, at + WIDTH) - load(centres, to + WIDTH)
    dz = load(centres, at + 2 * WIDTH) - load(centres, to + 2 * WIDTH)
    return dx * dx + dy * dy + dz * dz


@jit(I64(I64, I64, I64, I64, I64, I64, F64, LANES, COVER, WORK), inline=True, allocates=False)
def approaching(g, i, other, k, shared, asked, padding, h, cover, work):
    """In which of the lanes asked for a sphere of one group and one of another may come too near each other."""
    centres, at, to = work.centres, i * SPHERE, k * SPHERE
    needed = cover.spheres[i, 3] + cover.spheres[k, 3] + padding + cover.margins[0]
    far = h * (work.speeds[g, shared] + work.speeds[other, shared])
    square = _square_between(i, k, centres)
    limit = lesser(load(centres, at + 3 * WIDTH) + load(centres, to + 3 * WIDTH), far) + needed
    lanes = below(square, limit * limit) & asked
    if lanes:
        gap = root(square)
        u, v, w = velocity_of(cover.groups[g, 0], i, work)
        du, dv, dw = velocity_of(cover.groups[other, 0], k, work)
        dx = load(centres, at) - load(centres, to)
        dy = load(centres, at + WIDTH) - load(centres, to + WIDTH)
        dz = load(centres, at + 2 * WIDTH) - load(centres, to + 2 * WIDTH)
        along = dx * (u - du) + dy * (v - dv) + dz * (w - dw)
        push = h * h * (0.5 * (work.pushes[g, shared] + work.pushes[other, shared]))
        speed = size_of(along) / greater(gap, 1e-12) * SLACK
        lanes &= below(gap - lesser(speed * h + push, far), needed)
    return lanes


@jit(_FOUND(I64, I64, I64, I64, I64, I64, LANES, COVER, WORK), inline=True, allocates=False)
def meet_body(a, b, shared, pair, asked, batch, h, cover, work):
    """A body against another, see `meet_obstacle`; the last are a sphere of either."""
    centres, spheres, padding = work.centres, cover.spheres, cover.padding[pair]
    g, other = cover.bodies[a, 3], cover.bodies[b, 3]
    first_a, last_a = cover.bodies[a, 1], cover.bodies[a, 2]
    first_b, last_b = cover.bodies[b, 1], cover.bodies[b, 2]
    for body in (a, b):
        _ready_ball(body, batch, h, cover, work)
    asked = approaching(g, first_a, other, first_b, shared, asked, padding, h, cover, work)
    if asked == 0:
        return 0, 0, first_a, first_b
    for body in (a, b):
        _ready_spheres(body, batch, h, cover, work)
    # Only the spheres of either that are near the other's ball.
    count = 0
    for k in range(first_b + 1, last_b):
        lanes = approaching(g, first_a, other, k, shared, asked, padding, h, cover, work)
        if lanes:
            work.near[count, 0], work.near[count, 1] = k, lanes
            count += 1
    left, one, two = 0, first_a, first_b
    for i in range(first_a + 1, last_a if count else 0):
        beside = approaching(g, i, other, first_b, shared, asked, padding, h, cover, work)
        for n in range(count if beside else 0):
            k = work.near[n, 0]
            lanes = work.near[n, 1] & beside
            if lanes:
                lanes = approaching(g, i, other, k, shared, lanes, padding, h, cover, work)
            if lanes:
                gap = root(_square_between(i, k, centres))
                touching = below(gap, spheres[i, 4] + spheres[k, 4] + padding - cover.margins[0]) & lanes
                if touching:
                    return lanes, touching, i, k
                left |= lanes
                one, two = i, k
    return left, 0, one, two
