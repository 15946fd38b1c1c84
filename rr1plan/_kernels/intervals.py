# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""An edge cut into intervals until each is proven, eight looked at together.

What is proven is dropped, the rest is halved; what neither spheres nor directions can decide is listed for the exact
kernel.
"""

from __future__ import annotations

from numba import types

from rr1plan._kernels.cover import LEFT_OUT, RECORD, WORK, tables_of
from rr1plan._kernels.directions import separate
from rr1plan._kernels.jit import I64, jit
from rr1plan._kernels.lanes import LANES, WIDTH, load
from rr1plan._kernels.meeting import LAST_BIT, meet_again, meet_families, meet_obstacles, touch
from rr1plan._kernels.placing import bound_motion, is_near, place_frames

PROVEN, TOUCHES, OPEN, FULL = range(4)

_DEEPEST = 1.0 / 1024.0


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


@jit(types.UniTuple(I64, 3)(I64, LANES, RECORD), inline=True, allocates=False)
def _separate(k, h, record):
    """See `separate`, for an item."""
    cover, work, _, _ = tables_of(record)
    a, b, m, pair, asked = work.items[k, 0], work.items[k, 1], work.items[k, 2], work.items[k, 3], work.items[k, 4]
    near, g = (pair, work.items[k, 5], work.items[k, 6]), cover.bodies[a, 3]
    if m < 0:
        core = cover.core_of[b]
        if core == LEFT_OUT:
            return asked, 0, 0
        return separate(a, core, b, 0, near, cover.padding[pair], work.pushes[g, 0], asked, h, record)
    shared = cover.meetings[m, 2]
    base = cover.chain[cover.groups[g, 4] + shared - 1] if shared else 0
    push = work.pushes[g, shared] + work.pushes[cover.bodies[b, 3], shared]
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
                touch(pair, touching, work)
                return TOUCHES, 0
            bit = min(kept if batch == 1 else k, LAST_BIT)
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


@jit(I64(RECORD), entry=True, allocates=False)
def sweep(record):
    """The edge in `Work.curve` against all obstacles and between its own bodies, by spheres and directions.

    Args:
        record: Of `cover.TABLES`.

    Returns:
        PROVEN free; TOUCHES at `open_spans[0, 0]`, the pair `counts[2]`; or OPEN: `counts[0]` intervals and pairs are
        left to the exact kernel (-1: the whole edge).
    """
    cover, work, _, _ = tables_of(record)
    work.counts[0], work.counts[1] = 0, 0
    work.counts[3] += 1
    if not is_near(work):
        return _whole(OPEN, 0, work)
    bound_motion(cover, work)
    for b in range(cover.bodies.shape[0]):
        work.placed[b] = 0
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
        place_frames(t, cover, work)
        if batch == 1:
            count = meet_obstacles(h, record)
            if count >= 0:
                count = meet_families(count, h, record)
        else:
            count = meet_again(count, head, taken, batch, h, record)
        if count < 0:
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
