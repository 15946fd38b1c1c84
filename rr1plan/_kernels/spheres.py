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
from rr1plan._kernels.jit import F64, I64, OUT1, jit
from rr1plan._kernels.lanes import LANES, WIDTH, below, fill, greater, lesser, load, root, size_of
from rr1plan._kernels.obstacles import approach_to, gap_to, within
from rr1plan._kernels.placing import place_spheres


@jit(types.UniTuple(I64, 4)(I64, I64, I64, I64, I64, LANES, COVER, WORK), inline=True, allocates=False)
def meet_obstacle(b, o, pair, asked, batch, h, cover, work):
    """A body against an obstacle in the lanes asked for.

    Returns:
        Bits of the lanes that stay open, of those with a proven contact, and the last sphere that was too near (twice).
    """
    centres, spheres = work.centres, cover.spheres
    values, kinds = cover.obstacle_values, cover.obstacles
    first, last = cover.bodies[b, 1], cover.bodies[b, 2]
    push = h * h * (0.5 * work.pushes[b, 0])
    far = h * work.speeds[b, 0]
    left, beside, padding = 0, first, cover.padding[pair]
    for i in range(first, last):
        at = i * SPHERE
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
                return 0, 0, 0, 0
            if work.placed[b] != batch:
                work.placed[b] = batch
                place_spheres(b, batch, first + 1, last, h, cover, work)
        elif lanes:
            if kinds[o, 1]:
                touching = below(gap, spheres[i, 4] + padding - cover.margins[0]) & lanes
                if touching:
                    return lanes, touching, i, i
            left |= lanes
            beside = i
    return left, 0, beside, beside


@jit(LANES(I64, I64, OUT1), inline=True, allocates=False)
def _square_between(i, k, centres):
    """Square of the distance of the centres of two spheres [m^2]."""
    at, to = i * SPHERE, k * SPHERE
    dx = load(centres, at) - load(centres, to)
    dy = load(centres, at + WIDTH) - load(centres, to + WIDTH)
    dz = load(centres, at + 2 * WIDTH) - load(centres, to + 2 * WIDTH)
    return dx * dx + dy * dy + dz * dz


@jit(I64(I64, I64, I64, F64, LANES, LANES, LANES, COVER, WORK), inline=True, allocates=False)
def _approaching(i, k, asked, padding, push, far, h, cover, work):
    """In which of the lanes asked for two spheres may come too near each other."""
    centres = work.centres
    at, to = i * SPHERE, k * SPHERE
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
        speed = size_of(dx * du + dy * dv + dz * dw) / greater(gap, 1e-12) * SLACK
        lanes &= below(gap - lesser(speed * h + push, far), needed)
    return lanes


@jit(types.UniTuple(I64, 4)(I64, I64, I64, I64, I64, I64, LANES, COVER, WORK), inline=True, allocates=False)
def meet_body(a, b, shared, pair, asked, batch, h, cover, work):
    """A body against another, see `meet_obstacle`; the last are a sphere of either."""
    centres, spheres, padding = work.centres, cover.spheres, cover.padding[pair]
    push = h * h * (0.5 * (work.pushes[a, shared] + work.pushes[b, shared]))
    far = h * (work.speeds[a, shared] + work.speeds[b, shared])
    first_a, last_a = cover.bodies[a, 1], cover.bodies[a, 2]
    first_b, last_b = cover.bodies[b, 1], cover.bodies[b, 2]
    near = _approaching(first_a, first_b, asked, padding, push, far, h, cover, work)
    if near == 0:
        return 0, 0, 0, 0
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
    left, one, other = 0, first_a, first_b
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
                    return lanes, touching, i, k
                left |= lanes
                one, other = i, k
    return left, 0, one, other
