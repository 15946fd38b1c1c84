# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""Curves with squared path speeds as polynomials in time, and the peaks of those."""

from __future__ import annotations

import numpy as np
from numba import types

from rr1plan._kernels.jit import F64, FLOATS1, FLOATS2, FLOATS3, I64, INTS1, OUT1, OUT2, OUT3, jit
from rr1plan._kernels.parameterize import ride
from rr1plan._kernels.path_grid import inverse, is_bent


@jit(types.void(FLOATS2, F64, F64, F64, F64, OUT2))
def _place(piece, offset, delta, x, y, timed):
    """Polynomial in time of an interval, lowest power first, shape (5, nq)."""
    speed, half = np.sqrt(x), 0.25 * (y - x) / delta
    for j in range(piece.shape[1]):
        c0, c1, c2 = piece[0, j], piece[1, j], piece[2, j]
        first = c1 + 2.0 * offset * c2
        timed[0, j] = c0 + offset * (c1 + offset * c2)
        timed[1, j] = first * speed
        timed[2, j] = first * half + c2 * x
        timed[3, j] = 2.0 * c2 * speed * half
        timed[4, j] = c2 * half * half


@jit(types.void(FLOATS3, INTS1, FLOATS1, FLOATS1, FLOATS1, OUT1, OUT3), entry=True)
def put_on_clock(coefficients, piece, offset, delta, x, durations, timed):
    """Exact polynomials in time of intervals with squared path speed x (n + 1,), linear on each.

    Args:
        coefficients: As in `fastest_speeds`.
        piece: The same.
        offset: The same.
        delta: The same.
        x: Squared path speeds at the gridpoints.
        durations: Out, shape (n,).
        timed: Out, shape (n, 5, nq).
    """
    for i in range(len(piece)):
        durations[i] = 2.0 * delta[i] / (np.sqrt(x[i]) + np.sqrt(x[i + 1]))
        _place(coefficients[piece[i]], offset[i], delta[i], x[i], x[i + 1], timed[i])


@jit(types.Tuple((OUT1, OUT3))(FLOATS3, INTS1, FLOATS1, FLOATS1, FLOATS1, FLOATS1, FLOATS1))
def time_curve(coefficients, piece, offset, delta, velocity, acceleration, speeds):
    """The motion along a curve with squared speeds at the gridpoints: durations (k,), polynomials (k, 5, nq) in time.

    A straight interval becomes up to three: full acceleration, top speed, full deceleration.
    Arguments as in `fastest_speeds`, and what it returns.
    """
    n = len(piece)
    pace, pull = inverse(velocity), inverse(acceleration)
    pieces, offsets, deltas = np.empty(3 * n, np.int64), np.empty(3 * n), np.empty(3 * n)
    x = np.zeros(3 * n + 1)
    count = 0
    for i in range(n):
        c = coefficients[piece[i]]
        rise, fall, peak = delta[i], delta[i], speeds[i + 1]
        if not is_bent(c):
            rise, fall, peak = ride(c, delta[i], pace, pull, speeds[i], speeds[i + 1])
        start = 0.0
        for cut, top in ((rise, peak), (fall, peak), (delta[i], speeds[i + 1])):
            if cut - start > 1e-12 * delta[i]:
                pieces[count], offsets[count], deltas[count] = piece[i], offset[i] + start, cut - start
                count += 1
                x[count] = top
                start = cut
    durations, timed = np.empty(count), np.empty((count, 5, coefficients.shape[2]))
    put_on_clock(coefficients, pieces[:count], offsets[:count], deltas[:count], x[: count + 1], durations, timed)
    return durations, timed


@jit(F64(F64, F64, F64, F64, F64))
def _highest(c0, c1, c2, c3, end):
    """Largest |c0 + c1 t + c2 t² + c3 t³| on [0, end]: at an end or where the derivative is zero."""
    best = max(abs(c0), abs(c0 + end * (c1 + end * (c2 + end * c3))))
    a, b, c = 3.0 * c3, 2.0 * c2, c1
    square = b * b - 4.0 * a * c
    if square >= 0.0:
        # the form without cancellation; a = 0 gives the linear root through c / q
        q = -0.5 * (b + np.copysign(np.sqrt(square), b))
        for root in (q / a, c / q):
            if 0.0 < root < end:
                best = max(best, abs(c0 + root * (c1 + root * (c2 + root * c3))))
    return best


@jit(types.UniTuple(F64, 4)(FLOATS3, I64, I64, I64))
def _rate(coefficients, i, j, derivative):
    """Coefficients of a derivative of one joint on one piece."""
    terms = coefficients.shape[1]
    c0, c1, c2, c3 = 0.0, 0.0, 0.0, 0.0
    for k in range(derivative, terms):
        value = coefficients[i, k, j]
        for p in range(derivative):
            value *= k - p
        at = k - derivative
        if at == 0:
            c0 = value
        elif at == 1:
            c1 = value
        elif at == 2:
            c2 = value
        else:
            c3 = value
    return c0, c1, c2, c3


@jit(OUT2(FLOATS3, FLOATS1, I64), entry=True)
def peaks(coefficients, durations, derivative):
    """Largest absolute value of a derivative on each piece; see `rr1plan.retiming.extrema`."""
    m, _, nq = coefficients.shape
    out = np.empty((m, nq))
    for i in range(m):
        for j in range(nq):
            c0, c1, c2, c3 = _rate(coefficients, i, j, derivative)
            out[i, j] = _highest(c0, c1, c2, c3, durations[i])
    return out


@jit(F64(FLOATS3, FLOATS1, FLOATS1, FLOATS1))
def overrun(timed, durations, pace, pull):
    """How much longer a motion must take to keep its limits: the factor by which it is slower, 1 where it keeps them.

    Args:
        timed: Polynomials in time, shape (n, 5, nq).
        durations: Their durations, shape (n,).
        pace: One over the velocity limits, shape (nq,).
        pull: One over the acceleration limits, shape (nq,).
    """
    fast, strong = 1.0, 1.0
    for i in range(len(durations)):
        end = durations[i]
        third, half = end / 3.0, 0.5 * end
        for j in range(len(pace)):
            c1, c2, c3, c4 = timed[i, 1, j], 2.0 * timed[i, 2, j], 3.0 * timed[i, 3, j], 4.0 * timed[i, 4, j]
            # The control points of a polynomial bound it: only where they are above the most is its peak asked for.
            most = max(abs(c1), abs(c1 + third * c2), abs(c1 + third * (2.0 * c2 + end * c3)))
            most = max(most, abs(c1 + end * (c2 + end * (c3 + end * c4))))
            if most * pace[j] > fast:
                fast = max(fast, _highest(c1, c2, c3, c4, end) * pace[j])
            c3, c4 = 2.0 * c3, 3.0 * c4
            most = max(abs(c2), abs(c2 + half * c3), abs(c2 + end * (c3 + end * c4)))
            if most * pull[j] > strong:
                strong = max(strong, _highest(c2, c3, c4, 0.0, end) * pull[j])
    return max(fast, np.sqrt(strong))
