# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""What may meet on an edge, from coarse to fine: groups of bodies, bodies, maps of neighbours, spheres.

What is left open is a list of items: a body and an obstacle or another body, and in which lanes.
"""

from __future__ import annotations

import numpy as np
from numba import types

from rr1plan._kernels.cover import ALL, CELLS, COVER, RECORD, SPHERE, WORK, tables_of
from rr1plan._kernels.jit import F64, I64, jit
from rr1plan._kernels.lanes import LANES, WIDTH, below, least, load, most
from rr1plan._kernels.placing import place_ball
from rr1plan._kernels.spheres import approaching, meet_body, meet_obstacle, nearing, ready_ball

# Items from this one on share a bit.
LAST_BIT = 62


@jit(I64(I64, I64, F64, F64, COVER, WORK), inline=True, allocates=False)
def _mapped(begin, m, t0, t1, cover, work):
    """1 if a map over the columns of a meeting proves free what it is of, between two times of the edge."""
    curve = work.curve
    width = cover.meetings[m, 5]
    x0, x1, y0, y1 = np.int64(0), np.int64(0), np.int64(0), np.int64(0)
    for side in range(2):
        c = cover.meetings[m, 6 + side]
        a = curve[0, c] + t0 * (curve[1, c] + t0 * curve[2, c])
        b = curve[0, c] + t1 * (curve[1, c] + t1 * curve[2, c])
        # So far a parabola gets away from the straight line between its ends.
        aside = 0.25 * (t1 - t0) * (t1 - t0) * abs(curve[2, c])
        first = np.floor((min(a, b) - aside - cover.map_ranges[m, 2 * side]) * cover.map_ranges[m, 2 * side + 1])
        last = np.floor((max(a, b) + aside - cover.map_ranges[m, 2 * side]) * cover.map_ranges[m, 2 * side + 1])
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


@jit(I64(I64, I64, COVER, WORK), inline=True, allocates=False)
def _unmapped(m, asked, cover, work):
    """The lanes of those asked for in which no map proves a meeting free."""
    if cover.meetings[m, 4] < 0:
        return asked
    left = asked
    for i in range(WIDTH):
        if asked >> i & 1:
            t, h = work.lanes[i], work.lanes[WIDTH + i]
            if _mapped(cover.meetings[m, 4], m, t - h, t + h, cover, work):
                left &= ~(1 << i)
    return left


@jit(types.UniTuple(F64, 6)(I64, COVER, WORK), inline=True, allocates=False)
def _box_around(i, cover, work):
    """The box around a ball on the whole edge: low and high."""
    at, reach = i * SPHERE, cover.spheres[i, 3] + cover.margins[0] + cover.margins[1]
    x, y, z = load(work.centres, at), load(work.centres, at + WIDTH), load(work.centres, at + 2 * WIDTH)
    travel = load(work.centres, at + 3 * WIDTH) + reach
    low = least(x - travel), least(y - travel), least(z - travel)
    return low[0], low[1], low[2], most(x + travel), most(y + travel), most(z + travel)


@jit(I64(types.UniTuple(F64, 6), I64, COVER), inline=True, allocates=False)
def _boxes_near(box, o, cover):
    """Bits of the `WIDTH` obstacles from one on whose boxes meet a box."""
    boxes = cover.boxes
    near = below(load(boxes[0], o), box[3]) & below(load(boxes[1], o), box[4]) & below(load(boxes[2], o), box[5])
    near &= below(-load(boxes[3], o), -box[0]) & below(-load(boxes[4], o), -box[1])
    return near & below(-load(boxes[5], o), -box[2])


@jit(types.void(I64, I64, WORK), inline=True, allocates=False)
def touch(pair, lanes, work):
    """Remember a contact, in the first of the lanes."""
    lane = 0
    while not lanes >> lane & 1:
        lane += 1
    work.counts[2] = pair
    work.open_spans[0, 0] = work.lanes[lane]


@jit(I64(I64, I64, LANES, RECORD), allocates=False)
def _meet(k, batch, h, record):
    """An item whose balls are placed and near in the lanes in which it is open, which become fewer; contacts."""
    cover, work, _, _ = tables_of(record)
    items = work.items
    asked, pair, m = items[k, 4], items[k, 3], items[k, 2]
    if m >= 0:
        asked = _unmapped(m, asked, cover, work)
        if asked == 0:
            items[k, 4] = 0
            return 0
        shared = cover.meetings[m, 2]
        found = meet_body(items[k, 0], items[k, 1], shared, pair, asked, batch, h, cover, work)
    else:
        found = meet_obstacle(items[k, 0], items[k, 1], pair, asked, batch, h, cover, work)
    if found[1]:
        touch(pair, found[1], work)
    items[k, 4], items[k, 5], items[k, 6] = found[0], found[2], found[3]
    return found[1]


@jit(I64(I64, I64, I64, I64, I64, I64, LANES, RECORD), inline=True, allocates=False)
def _add(count, a, other, m, pair, near, h, record):
    """Add an item to so many if spheres do not clear it; their number, or -1 for a contact."""
    _, work, _, _ = tables_of(record)
    items = work.items
    items[count, 0], items[count, 1], items[count, 2], items[count, 3], items[count, 4] = a, other, m, pair, near
    if _meet(count, 1, h, record):
        return -1
    return count + 1 if items[count, 4] else count


@jit(I64(I64, LANES, COVER, WORK), inline=True, allocates=False)
def _list_obstacles(g, h, cover, work):
    """List the obstacles that the ball around a group may come too near, and in which lanes; how many."""
    ball, count = cover.groups[g, 1], 0
    place_ball(g, ball, h, cover, work)
    box = _box_around(ball, cover, work)
    for block in range(0, cover.boxes.shape[1], WIDTH):
        near, o = _boxes_near(box, block, cover), block
        while near:
            if near & 1:
                lanes = nearing(g, ball, o, cover.margins[1], ALL, h, cover, work)
                if lanes:
                    work.listed[count, 0], work.listed[count, 1] = o, lanes
                    count += 1
            near >>= 1
            o += 1
    return count


@jit(I64(LANES, RECORD), inline=True, allocates=False)
def meet_obstacles(h, record):
    """List the obstacles that spheres do not clear on the whole edge, the bodies farthest from the base first.

    The number of items, or -1 for a contact.
    """
    cover, work, _, _ = tables_of(record)
    count = 0
    for g in range(cover.groups.shape[0] - 1, -1, -1):
        listed, first, last = _list_obstacles(g, h, cover, work), cover.groups[g, 2], cover.groups[g, 3]
        alone = last - first == 1
        if alone:
            work.placed[first] = -1
        for b in range(first, last if listed else first):
            ready_ball(b, 1, h, cover, work)
            for n in range(listed):
                o, lanes = work.listed[n, 0], work.listed[n, 1]
                pair = cover.pair_of[b, o]
                if pair >= 0 and not alone:
                    lanes = nearing(g, cover.bodies[b, 1], o, cover.padding[pair], lanes, h, cover, work)
                if pair >= 0 and lanes:
                    count = _add(count, b, o, -1, pair, lanes, h, record)
                    if count < 0:
                        return -1
    return count


@jit(types.void(I64, I64, I64, I64, LANES, COVER, WORK), inline=True, allocates=False)
def _ask_each(g, other, shared, asked, h, cover, work):
    """In which of the lanes asked for each body of a group may come too near the ball around another group."""
    for b in range(cover.groups[g, 2], cover.groups[g, 3]):
        ready_ball(b, 1, h, cover, work)
        one, two = cover.bodies[b, 1], cover.groups[other, 1]
        work.beside[b] = approaching(g, one, other, two, shared, asked, cover.margins[1], h, cover, work)


@jit(I64(I64, LANES, RECORD), inline=True, allocates=False)
def meet_families(count, h, record):
    """Add to so many items the bodies that neither maps nor spheres tell apart on the whole edge; -1 for a contact."""
    cover, work, _, _ = tables_of(record)
    families, groups = cover.families, cover.groups
    for f in range(families.shape[0]):
        g, other, shared, first, last = families[f, 0], families[f, 1], families[f, 2], families[f, 3], families[f, 4]
        if families[f, 5] >= 0 and _mapped(families[f, 5], first, 0.0, 1.0, cover, work):
            continue
        near = ALL
        if last - first > 1:
            one, two = groups[g, 1], groups[other, 1]
            near = approaching(g, one, other, two, shared, ALL, cover.margins[1], h, cover, work)
            if near == 0:
                continue
        many = last - first > groups[g, 3] - groups[g, 2] + groups[other, 3] - groups[other, 2]
        if many:
            for these, those in ((g, other), (other, g)):
                _ask_each(these, those, shared, near, h, cover, work)
        for m in range(first, last):
            a, b = cover.meetings[m, 0], cover.meetings[m, 1]
            lanes = near & work.beside[a] & work.beside[b] if many else near
            begin = cover.meetings[m, 4]
            if lanes == 0 or (begin >= 0 and _mapped(begin, m, 0.0, 1.0, cover, work)):
                continue
            for body in (a, b):
                ready_ball(body, 1, h, cover, work)
            pair, one, two = cover.meetings[m, 3], cover.bodies[a, 1], cover.bodies[b, 1]
            lanes = approaching(g, one, other, two, shared, lanes, cover.padding[pair], h, cover, work)
            if lanes:
                count = _add(count, a, b, m, pair, lanes, h, record)
                if count < 0:
                    return -1
    return count


@jit(I64(I64, I64, I64, LANES, COVER, WORK), inline=True, allocates=False)
def _near(k, asked, batch, h, cover, work):
    """In which of the lanes asked for the balls of an item may be too near."""
    a, other, m, pair = work.items[k, 0], work.items[k, 1], work.items[k, 2], work.items[k, 3]
    g, ball, padding = cover.bodies[a, 3], cover.bodies[a, 1], cover.padding[pair]
    ready_ball(a, batch, h, cover, work)
    if m < 0:
        return nearing(g, ball, other, padding, asked, h, cover, work)
    ready_ball(other, batch, h, cover, work)
    shared, two = cover.meetings[m, 2], cover.bodies[other, 1]
    return approaching(g, ball, cover.bodies[other, 3], two, shared, asked, padding, h, cover, work)


@jit(I64(I64, I64, I64, I64, LANES, RECORD), inline=True, allocates=False)
def meet_again(count, head, taken, batch, h, record):
    """The items in the lanes of a later batch in which they are open; their number, or -1 for a contact."""
    cover, work, _, _ = tables_of(record)
    for k in range(count):
        asked = 0
        for i in range(taken):
            asked |= (work.span_items[head + i] >> min(k, LAST_BIT) & 1) << i
        if asked:
            asked = _near(k, asked, batch, h, cover, work)
        work.items[k, 4] = asked
        if asked and _meet(k, batch, h, record):
            return -1
    return count
