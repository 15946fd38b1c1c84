"""The search for the times at which two bodies come near, compiled: the certificate of `certificate.py` without Coal.

Intervals of time are halved, depth first, with the pairs of bodies that are still open on each. What touches, or
cannot be told from it, is left to Coal.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rr1plan.validation.compiled import (
    COUNT1,
    COUNT2,
    F64,
    FLOATS1,
    FLOATS2,
    FLOATS3,
    I64,
    INTS1,
    INTS2,
    OUT1,
    OUT2,
    OUT3,
    entry,
    part,
)
from rr1plan.validation.gaps import (
    CHECKS,
    DECIDED,
    DONE,
    GROUP,
    GROUPS,
    INTERVALS,
    LEFT,
    NEAREST,
    OPEN,
    PAIR,
    PROVEN,
    SEARCHES,
    SMALLEST,
    SPLIT,
    STAGE,
    START,
    UNDECIDED,
    WHEN,
    Book,
    Tables,
    ball_gap,
    bounds,
    boxes_gap,
    least_clearance,
    piece_at,
    pose,
    pose_at,
    see,
)
from rr1plan.validation.sweeping import add_speeds, expand, move_links, place, reckon_sweeps, widen

# Columns of `stack` (n, 4): first piece, the piece after the last, where its items begin and end.
# Of `spans` (n, 2): local start and end of a single piece [s].
DEEPEST = 160
_SAMPLES = 12
# A smallest clearance is sharp when another look changes it by less [m].
_SHARP = 1e-10


@part
def _nearest_at(
    t: Tables, book: Book, group: int, time: float, best: float, tolerance: float, touch: float
) -> tuple[float, int]:
    """The smallest clearance of a group below `best` [m] where all is posed, to about `tolerance`; its pair or -1.

    The pair that was nearest so far comes first: most others are then too far away for a search.
    """
    which, nearest = -1, book.counts[NEAREST + group]
    for i in range(-1 if nearest >= 0 else 0, len(t.pairs)):
        k = nearest if i < 0 else i
        pair = t.pairs[k, PAIR]
        if t.pairs[k, GROUP] != group or book.marks[pair] == LEFT or i == nearest:
            continue
        if ball_gap(t, k)[0] >= best or boxes_gap(t, k) >= best:
            continue
        value, _ = bounds(t, book, k, best - tolerance, best)
        if see(t, book, k, value, time, touch):
            continue
        if value < best:
            best, which = value, pair
    return best, which


@part
def _value_at(t: Tables, book: Book, k: int, time: float, touch: float) -> float:
    pose_at(t, time)
    value, _ = bounds(t, book, k, 1e300, 1e300)
    see(t, book, k, value, time, touch)
    return value


@part
def _refine(t: Tables, book: Book, k: int, precision: float, touch: float) -> None:
    """Find the smallest clearance of pair k around the time it was seen, by golden sections.

    They end when two of them in a row change the clearance by less than `precision` [m]: one may be symmetric.
    """
    begin, finish = t.breaks[0], t.breaks[-1]
    at, width = book.found[t.pairs[k, PAIR], WHEN], (finish - begin) / 64.0
    if not width > 0.0:
        _value_at(t, book, k, at, touch)
        return
    best = 1e300
    center = at
    for i in range(-4, 5):
        time = min(max(center + 0.25 * i * width, begin), finish)
        value = _value_at(t, book, k, time, touch)
        if value < best:
            best, at = value, time
    low, high = max(at - 0.25 * width, begin), min(at + 0.25 * width, finish)
    golden = 0.6180339887498949
    one, two = high - golden * (high - low), low + golden * (high - low)
    first, second = _value_at(t, book, k, one, touch), _value_at(t, book, k, two, touch)
    before = 1e300
    while high - low > 1e-7 * (finish - begin) and max(before, abs(first - second)) > precision:
        before = abs(first - second)
        if first <= second:
            high, two, second = two, one, first
            one = high - golden * (high - low)
            first = _value_at(t, book, k, one, touch)
        else:
            low, one, first = one, two, second
            two = low + golden * (high - low)
            second = _value_at(t, book, k, two, touch)


@part
def _look_ahead(t: Tables, book: Book, tolerance: float, touch: float) -> None:
    """Look at some times first: the nearer the smallest clearances are known, the less is left to prove."""
    begin, finish = t.breaks[0], t.breaks[-1]
    count = _SAMPLES if finish > begin else 1
    for i in range(count):
        time = begin + (finish - begin) * i / max(1, count - 1)
        pose_at(t, time)
        for group in range(GROUPS):
            _nearest_at(t, book, group, time, book.amounts[SMALLEST + group], tolerance, touch)
    for group in range(GROUPS):
        if book.counts[NEAREST + group] >= 0:
            _refine(t, book, book.counts[NEAREST + group], 0.1 * tolerance, touch)


@part
def _visit(
    t: Tables, book: Book, stack: Any, spans: Any, items: Any, tolerance: float, touch: float, most: int
) -> None:
    """Take the last open interval, settle what can be, and open its halves for what cannot."""
    top = book.counts[OPEN] - 1
    book.counts[OPEN] = top
    book.counts[INTERVALS] += 1
    first, stop, low, high = stack[top, 0], stack[top, 1], stack[top, 2], stack[top, 3]
    single = stop - first == 1
    if single:
        start, end = spans[top, 0], spans[top, 1]
        half, local = 0.5 * (end - start), 0.5 * (start + end)
        pose(t, first, local, half)
        width, time, finish = end - start, t.breaks[first] + local, t.breaks[first] + end
    else:
        width, finish = t.breaks[stop] - t.breaks[first], t.breaks[stop]
        half, time = 0.5 * width, 0.5 * (t.breaks[first] + t.breaks[stop])
        piece = piece_at(t, time)
        expand(t.coefficients, piece, time - t.breaks[piece], 0.0, t.coefficients.shape[1] - 1, t.columns, t.scratch)
        widen(t.lower, t.upper, first, stop, t.columns)
        move_links(t.steps, t.frames, t.columns, t.joints, t.links, t.state)
        for i in range(len(t.movers)):
            place(t.kinds, t.sizes, t.links, t.movers[i], t.placed)
    add_speeds(t.joints, t.state)
    for i in range(len(t.movers)):
        reckon_sweeps(t.kinds, t.sizes, t.chains, t.joints, t.state, t.movers[i], t.placed, t.sweeps)
    point = width <= 4e-16 * max(1.0, abs(finish))
    left = low
    for i in range(low, high):
        k = items[i]
        pair = t.pairs[k, PAIR]
        if book.marks[pair] == LEFT:
            continue
        book.counts[CHECKS] += 1
        least, settled = least_clearance(t, book, k, time, half, single, tolerance, touch)
        if settled:
            book.found[pair, PROVEN] = min(book.found[pair, PROVEN], least)
            book.amounts[DECIDED] += width
        elif point or top + 2 >= DEEPEST:
            book.marks[pair] = LEFT
        elif book.counts[SEARCHES] > most:
            book.marks[pair] = UNDECIDED
        else:
            items[left] = k
            left += 1
    if left > low:
        _halve(t, book, stack, spans, items, top, left)


@part
def _halve(t: Tables, book: Book, stack: Any, spans: Any, items: Any, top: int, left: int) -> None:
    """Put the later half of interval `top` in its place and the earlier one on top of it."""
    first, stop, low = stack[top, 0], stack[top, 1], stack[top, 2]
    for i in range(low, left):
        items[left + i - low] = items[i]
    stack[top, 3] = left
    stack[top + 1, 2], stack[top + 1, 3] = left, 2 * left - low
    if stop - first == 1:
        middle = 0.5 * (spans[top, 0] + spans[top, 1])
        stack[top + 1, 0], stack[top + 1, 1] = first, stop
        spans[top + 1, 0], spans[top + 1, 1] = spans[top, 0], middle
        spans[top, 0] = middle
    else:
        middle = 0.5 * (t.breaks[first] + t.breaks[stop])
        cut = piece_at(t, middle)
        if t.breaks[cut + 1] - middle < middle - t.breaks[cut]:
            cut += 1
        cut = min(max(cut, first + 1), stop - 1)
        stack[top + 1, 0], stack[top + 1, 1], stack[top, 0] = first, cut, cut
        spans[top + 1, 0], spans[top + 1, 1] = 0.0, t.breaks[first + 1] - t.breaks[first]
        spans[top, 0], spans[top, 1] = 0.0, t.breaks[cut + 1] - t.breaks[cut]
    book.counts[OPEN] = top + 2


@part
def _bound_pieces(t: Tables) -> None:
    """Ranges of all columns on each piece."""
    for i in range(len(t.coefficients)):
        half = 0.5 * (t.breaks[i + 1] - t.breaks[i]) if len(t.breaks) > 1 else 0.0
        expand(t.coefficients, i, half, half, t.coefficients.shape[1] - 1, t.columns, t.scratch)
        for c in range(len(t.columns)):
            t.lower[i, c], t.upper[i, c] = t.columns[c, 0] - t.columns[c, 1], t.columns[c, 0] + t.columns[c, 1]


@part
def _open_all(t: Tables, book: Book, stack: Any, spans: Any, items: Any) -> None:
    """Open the whole motion for all pairs."""
    pieces, count = len(t.coefficients), len(t.pairs)
    for k in range(count):
        items[k] = k
    stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3] = 0, pieces, 0, count
    spans[0, 0], spans[0, 1] = 0.0, t.breaks[1] - t.breaks[0] if len(t.breaks) > 1 else 0.0
    book.counts[OPEN] = 1
    book.counts[STAGE] = SPLIT


@part
def _finish(t: Tables, book: Book, ends: Any, touch: float) -> None:
    """Sharpen the smallest clearance of each group, and find the smallest at both ends."""
    for group in range(GROUPS):
        nearest = book.counts[NEAREST + group]
        if nearest >= 0 and book.marks[t.pairs[nearest, PAIR]] != LEFT:
            _refine(t, book, nearest, _SHARP, touch)
    for i, time in ((0, t.breaks[0]), (1, t.breaks[-1])):
        pose_at(t, time)
        for group in range(GROUPS):
            value, pair = _nearest_at(t, book, group, time, 1e300, 0.0, touch)
            if pair >= 0:
                ends[group, i, 0], ends[group, i, 1] = value, float(pair)
    book.counts[STAGE] = DONE


@entry(
    (
        *(FLOATS1, FLOATS3, INTS2, FLOATS2, INTS2, OUT2),
        *(INTS2, FLOATS2, FLOATS2, INTS1, INTS1, INTS2, FLOATS1),
        *(F64, F64, I64, I64),
        *(OUT2, COUNT1, COUNT1, OUT1, OUT2, COUNT2, OUT2, COUNT1, OUT3),
    )
)
def search(
    breaks: Any,
    coefficients: Any,
    steps: Any,
    frames: Any,
    joints: Any,
    links: Any,
    kinds: Any,
    sizes: Any,
    corners: Any,
    chains: Any,
    movers: Any,
    pairs: Any,
    padding: Any,
    tolerance: float,
    touch: float,
    most: int,
    budget: int,
    found: Any,
    marks: Any,
    counts: Any,
    amounts: Any,
    directions: Any,
    stack: Any,
    spans: Any,
    items: Any,
    ends: Any,
) -> None:
    """Decide all pairs on all of a motion, or on `budget` more of its intervals; `tables.py` says what goes in."""
    pieces, degree, width = coefficients.shape
    bodies, depth = len(kinds), 1
    for b in range(bodies):
        depth = max(depth, kinds[b, 5] + 1)
    lower, upper = np.empty((pieces, width)), np.empty((pieces, width))
    columns, scratch = np.zeros((width, 4)), np.empty(degree)
    state, placed = np.zeros((len(joints) + 1, 18)), np.zeros((bodies, 15))
    sweeps, share = np.zeros((bodies, 2, depth)), np.zeros((3, 4))
    known = np.zeros((len(pairs), 5, 9))
    t = Tables(
        breaks, coefficients, lower, upper, steps, frames, joints, links, kinds, sizes, corners, chains, movers,
        pairs, padding, columns, state, placed, sweeps, known, share, scratch,
    )  # fmt: skip
    book = Book(found, marks, counts, amounts, directions)
    _bound_pieces(t)
    for b in range(bodies):
        place(kinds, sizes, links, b, placed)
    if counts[STAGE] == START:
        _look_ahead(t, book, tolerance, touch)
        _open_all(t, book, stack, spans, items)
    for _ in range(budget):
        if counts[OPEN] == 0:
            break
        _visit(t, book, stack, spans, items, tolerance, touch, most)
    if counts[OPEN] == 0:
        _finish(t, book, ends, touch)
