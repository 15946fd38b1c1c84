# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""A certificate for a whole curve in joint space (Schwarzer, Saha, Latombe 2005).

Around a configuration, a pair of bodies with a gap c stays apart as long as they move against each
other by less than c. How far that can be on an interval is bounded by the sum, over the joints that
move one but not the other, of how much the joint turns times how far from its axis the body reaches.
Intervals whose gap does not suffice are halved, all of one width before any narrower one, so that
contacts show early.

Curves are polynomials in t; a straight edge is one of degree 1.
"""

from __future__ import annotations

import numpy as np
from numba import types

from rr1plan._kernels.exact import RECORD, exact_of
from rr1plan._kernels.gaps import fine_gap, quick_gap
from rr1plan._kernels.jit import F64, FLOATS1, FLOATS2, I64, INT1, INTS1, OUT1, OUT2, jit
from rr1plan._kernels.poses import bound_travel, place_body, place_joints

FREE, CONTACT, GRAZING = range(3)
# What a pair is besides, until its intervals are halved often enough.
_OPEN = 3

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


@jit(types.UniTuple(I64, 2)(I64, F64, FLOATS1, I64, INT1, RECORD), allocates=False)
def _judge(p, tolerance, reach, seen, placed, record):
    """What a pair is on an interval, FREE, CONTACT, GRAZING or _OPEN, and 1 if its gap was computed finely.

    Args:
        p: The pair.
        tolerance: See `certify`.
        reach: How far each column of q gets from the middle of the interval, where joints are placed; shape (nq,).
        seen: The number of the interval.
        placed: The interval each body was placed for last, shape (b,).
        record: Of `exact.EXACT`.
    """
    t = exact_of(record)
    a, b, shared = t.pairs[p, 0], t.pairs[p, 1], t.pairs[p, 2]
    moved = 0.0
    for body in (a, b):
        if t.bodies[body, 5] > t.bodies[body, 4]:
            if placed[body] != seen:
                placed[body] = seen
                place_body(body, record)
                bound_travel(body, reach, record)
            moved += t.travel[body, shared]
    padding = t.padding[p]
    enough = padding + moved * _RELATIVE + _ROUNDING
    quick = quick_gap(a, b, enough, record)
    if quick >= enough:
        return FREE, 0
    if moved > _COARSE and quick > padding:
        # Too wide an interval to prove anything on, and no contact to be seen: halve it.
        return _OPEN, 0
    lower, upper = fine_gap(a, b, padding, enough, t.directions[p], record)
    if lower >= enough:
        return FREE, 1
    if upper <= padding:
        return CONTACT, 1
    return GRAZING if moved < tolerance else _OPEN, 1


@jit(types.Tuple((I64, F64, I64, I64, I64))(FLOATS2, F64, F64, OUT1, OUT1, INT1, INT1, RECORD), entry=True)
def _halve(curve, duration, tolerance, middles, halves, begins, open_pairs, record):
    """Halve intervals until every pair open on them is proven apart, or one is not; see `certify`.

    Interval i is halves[i] to both sides of middles[i], its pairs are open_pairs[begins[i] : begins[i + 1]].
    """
    t = exact_of(record)
    terms, nq = curve.shape
    work, q, reach = np.empty((terms, nq)), np.empty(nq), np.empty(nq)
    placed = np.full(t.bodies.shape[0], -1, np.int64)
    seen, fine = 0, 0
    # From one interval to the next a pair keeps its direction; from call to call it does not: same edge, same answer.
    t.directions[:, :] = 0.0
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
            place_joints(q, record)
            seen += 1
            before = stored
            for k in range(begins[i], begins[i + 1]):
                status, finely = _judge(open_pairs[k], tolerance, reach, seen, placed, record)
                fine += finely
                if status == _OPEN:
                    next_pairs[stored] = open_pairs[k]
                    stored += 1
                elif status != FREE:
                    return status, middles[i], open_pairs[k], seen, fine
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


@jit(types.Tuple((I64, F64, I64, I64, I64))(FLOATS2, F64, F64, RECORD), entry=True)
def certify(curve, duration, tolerance, record):
    """Certify a curve free of contact, or find a place where it is not.

    Args:
        curve: Coefficients of q(t) = sum_k curve[k] t^k, shape (k, nq).
        duration: End of the curve; it begins at 0.
        tolerance: Gaps beyond the padding smaller than this are given up [m].
        record: Of `exact.EXACT`.

    Returns:
        FREE, CONTACT or GRAZING; where; which pair; configurations looked at; gaps computed finely.
    """
    middles, halves = np.full(1, 0.5 * duration), np.full(1, 0.5 * duration)
    count = exact_of(record).pairs.shape[0]
    begins, open_pairs = np.zeros(2, np.int64), np.arange(count)
    begins[1] = count
    return _halve(curve, duration, tolerance, middles, halves, begins, open_pairs, record)


@jit(types.Tuple((I64, F64, I64, I64, I64))(FLOATS2, F64, F64, FLOATS2, INTS1, I64, RECORD))
def certify_open(curve, duration, tolerance, spans, span_pairs, count, record):
    """Certify what is left of a curve: some pairs on some intervals. All else as in `certify`.

    Args:
        curve: See `certify`.
        duration: The same.
        tolerance: The same.
        spans: Middle and half width of an interval, shape (n, 2); those of one interval need not be neighbours.
        span_pairs: The pair open on each, shape (n,).
        count: How many of them count.
        record: See `certify`.
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
    middles, halves, begins = middles[:intervals], halves[:intervals], begins[: intervals + 1]
    return _halve(curve, duration, tolerance, middles, halves, begins, open_pairs, record)
