# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""An edge cut into intervals until each is proven, eight looked at together.

What is proven is dropped, the rest is halved; what neither spheres nor directions can decide is listed for the exact
kernel.
"""

from __future__ import annotations

import numpy as np
from numba import types

from rr1plan._kernels.cover import ALL, CELLS, COVER, LEFT_OUT, RECORD, SPHERE, WORK, tables_of
from rr1plan._kernels.directions import separate
from rr1plan._kernels.jit import F64, FLOATS1, I64, jit
from rr1plan._kernels.lanes import LANES, WIDTH, below, least, load, most
from rr1plan._kernels.placing import FARTHEST, bound_motion, place_frames, place_spheres
from rr1plan._kernels.spheres import meet_body, meet_obstacle

PROVEN, TOUCHES, OPEN, FULL = range(4)

# Items from this one on share a bit.
_BITS = 62
_DEEPEST = 1.0 / 1024.0


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


@jit(I64(I64, I64, I64, I64, I64, WORK), inline=True, allocates=False)
def _keep(pair, lanes, stuck, bit, batch, work):
    """Remember the open lanes of a pair: to be halved, or for the exact kernel; 1 if there is no room."""
    count = work.counts[0]
    for i in range(WIDTH):
        if lanes >> i & 1:
            half = work.lanes[WIDTH + i]
            if half > _DEEPEST and (batch == 1 or not stuck >> i & 1):
                work.counts[8 + i] |= 1 << bit
            else:
                if count == work.open_pairs.shape[0]:
                    return 1
                work.open_spans[count, 0], work.open_spans[count, 1] = work.lanes[i], half
                work.open_pairs[count] = pair
                count += 1
    work.counts[0] = count
    return 0


@jit(I64(FLOATS1, FLOATS1, LANES, COVER, WORK), inline=True, allocates=False)
def _list_items(q0, q1, h, cover, work):
    """Everything that may meet on the whole edge, by the balls around bodies and by maps; how many those are."""
    count, items = 0, work.items
    for b in range(cover.bodies.shape[0]):
        ball = cover.bodies[b, 1]
        place_spheres(b, 1, ball, ball + 1, h, cover, work)
    for b in range(cover.bodies.shape[0]):
        at = cover.bodies[b, 1] * SPHERE
        reach = cover.spheres[cover.bodies[b, 1], 3] + cover.margins[0] + cover.margins[1]
        travel = load(work.centres, at + 6 * WIDTH)
        x, y, z = load(work.centres, at), load(work.centres, at + WIDTH), load(work.centres, at + 2 * WIDTH)
        x0, x1 = least(x - travel) - reach, most(x + travel) + reach
        y0, y1 = least(y - travel) - reach, most(y + travel) + reach
        z0, z1 = least(z - travel) - reach, most(z + travel) + reach
        for o in range(0, cover.boxes.shape[1], WIDTH):
            near = below(load(cover.boxes[0], o), x1) & below(load(cover.boxes[1], o), y1)
            near &= below(load(cover.boxes[2], o), z1)
            near &= below(-load(cover.boxes[3], o), -x0) & below(-load(cover.boxes[4], o), -y0)
            near &= below(-load(cover.boxes[5], o), -z0)
            i = o
            while near:
                if near & 1 and cover.pair_of[b, i] >= 0:
                    items[count, 0], items[count, 1], items[count, 2] = b, i, -1
                    items[count, 3], items[count, 4] = cover.pair_of[b, i], ALL
                    count += 1
                near >>= 1
                i += 1
    for m in range(cover.meetings.shape[0]):
        asked = ALL
        if cover.meetings[m, 4] >= 0:
            if _mapped(m, q0, q1, 0.0, 1.0, cover):
                continue
            asked = _unmapped(m, asked, q0, q1, cover, work)
        if asked:
            items[count, 0], items[count, 1], items[count, 2] = cover.meetings[m, 0], cover.meetings[m, 1], m
            items[count, 3], items[count, 4] = cover.meetings[m, 3], asked
            count += 1
    return count


@jit(types.void(I64, I64, I64, FLOATS1, FLOATS1, LANES, I64, COVER, WORK), inline=True, allocates=False)
def _take_up(count, head, taken, q0, q1, h, batch, cover, work):
    """For each item the lanes of a later batch in which it is open, and the balls of its bodies."""
    for k in range(count):
        asked = 0
        for i in range(taken):
            asked |= (work.span_items[head + i] >> min(k, _BITS) & 1) << i
        if asked and work.items[k, 2] >= 0:
            asked = _unmapped(work.items[k, 2], asked, q0, q1, cover, work)
        work.items[k, 4] = asked
        for side in range(0 if asked == 0 else 1 if work.items[k, 2] < 0 else 2):
            b = work.items[k, side]
            if work.placed[b] != batch and work.placed[b] != -batch:
                work.placed[b] = -batch
                place_spheres(b, batch, cover.bodies[b, 1], cover.bodies[b, 1] + 1, h, cover, work)


@jit(I64(I64, I64, WORK), inline=True, allocates=False)
def _touch(pair, lanes, work):
    """Remember a contact, in the first of the lanes."""
    lane = 0
    while not lanes >> lane & 1:
        lane += 1
    work.counts[2] = pair
    work.open_spans[0, 0] = work.lanes[lane]
    return TOUCHES


@jit(I64(I64, I64, LANES, COVER, WORK), inline=True, allocates=False)
def _meet_by_spheres(count, batch, h, cover, work):
    """All items in the lanes in which they are open, which become fewer; TOUCHES or OPEN."""
    items = work.items
    for k in range(count):
        asked = items[k, 4]
        if asked == 0:
            continue
        pair, m = items[k, 3], items[k, 2]
        if m >= 0:
            shared = cover.meetings[m, 2]
            found = meet_body(items[k, 0], items[k, 1], shared, pair, asked, batch, h, cover, work)
        else:
            found = meet_obstacle(items[k, 0], items[k, 1], pair, asked, batch, h, cover, work)
        if found[1]:
            return _touch(pair, found[1], work)
        items[k, 4], items[k, 5], items[k, 6] = found[0], found[2], found[3]
    return OPEN


@jit(types.UniTuple(I64, 3)(I64, LANES, RECORD), inline=True, allocates=False)
def _separate(k, h, record):
    """See `separate`, for an item."""
    cover, work, _, _ = tables_of(record)
    a, b, m, pair, asked = work.items[k, 0], work.items[k, 1], work.items[k, 2], work.items[k, 3], work.items[k, 4]
    near = (pair, work.items[k, 5], work.items[k, 6])
    if m < 0:
        core = cover.core_of[b]
        if core == LEFT_OUT:
            return asked, 0, 0
        return separate(a, core, b, 0, near, cover.padding[pair], work.pushes[a, 0], asked, h, record)
    shared = cover.meetings[m, 2]
    base = cover.chain[cover.bodies[a, 3] + shared - 1] if shared else 0
    push = work.pushes[a, shared] + work.pushes[b, shared]
    return separate(a, b, -1, base, near, cover.padding[pair], push, asked, h, record)


@jit(types.UniTuple(I64, 2)(I64, I64, LANES, RECORD), inline=True, allocates=False)
def _meet_by_directions(count, batch, h, record):
    """What spheres left; TOUCHES, OPEN or FULL, and after the first batch how many items are still open."""
    _, work, _, _ = tables_of(record)
    items, kept = work.items, 0
    for k in range(count):
        left, pair = items[k, 4], items[k, 3]
        if left:
            left, stuck, touching = _separate(k, h, record)
            if touching:
                return _touch(pair, touching, work), 0
            bit = min(kept if batch == 1 else k, _BITS)
            if left and _keep(pair, left, stuck, bit, batch, work):
                return FULL, 0
        if left and batch == 1:
            for c in range(4):
                items[kept, c] = items[k, c]
            kept += 1
    return OPEN, kept if batch == 1 else count


@jit(I64(I64, I64, WORK), inline=True, allocates=False)
def _halve(tail, taken, work):
    """Add both halves of each interval of a batch on which something is open; the new number of intervals."""
    for i in range(taken):
        if work.counts[8 + i]:
            half = 0.5 * work.lanes[WIDTH + i]
            for side in range(2):
                work.spans[tail, 0] = work.lanes[i] + (2.0 * side - 1.0) * half
                work.spans[tail, 1] = half
                work.span_items[tail] = work.counts[8 + i]
                tail += 1
    return tail


@jit(I64(I64, I64, WORK), inline=True, allocates=False)
def _whole(answer, batch, work):
    """The whole edge is decided, or left to the exact kernel."""
    work.counts[0], work.counts[1] = -1, batch
    return answer


@jit(I64(FLOATS1, FLOATS1, RECORD), allocates=False)
def sweep(q0, q1, record):
    """An edge against all obstacles and between its own bodies, by spheres and directions.

    Args:
        q0: Begin, shape (nq,).
        q1: End, shape (nq,).
        record: Of `cover.TABLES`.

    Returns:
        PROVEN free; TOUCHES at `open_spans[0, 0]`, the pair `counts[2]`; or OPEN: `counts[0]` intervals and pairs are
        left to the exact kernel (-1: the whole edge).
    """
    cover, work, _, _ = tables_of(record)
    work.counts[0], work.counts[1] = 0, 0
    work.counts[3] += 1
    for c in range(q0.shape[0]):
        # A comparison that NaN fails as well.
        if not (abs(q0[c]) < FARTHEST and abs(q1[c]) < FARTHEST):
            return _whole(OPEN, 0, work)
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
            work.lanes[i], work.lanes[WIDTH + i] = work.spans[k, 0], work.spans[k, 1]
            work.counts[8 + i] = 0
        t, h = load(work.lanes, 0), load(work.lanes, WIDTH)
        place_frames(q0, t, cover, work)
        if batch == 1:
            count = _list_items(q0, q1, h, cover, work)
        else:
            _take_up(count, head, taken, q0, q1, h, batch, cover, work)
        if _meet_by_spheres(count, batch, h, cover, work) == TOUCHES:
            return _whole(TOUCHES, batch, work)
        answer, count = _meet_by_directions(count, batch, h, record)
        if answer == TOUCHES:
            return _whole(TOUCHES, batch, work)
        # All that is open at present may not fit: the edge is left to the exact kernel.
        if answer == FULL or tail + 2 * WIDTH > work.spans.shape[0]:
            return _whole(OPEN, batch, work)
        tail = _halve(tail, taken, work)
        head += taken
    work.counts[1] = batch
    return PROVEN if work.counts[0] == 0 else OPEN
