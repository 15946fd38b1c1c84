# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""Where to cut a curve of straight lines and parabolas, so that little changes between two gridpoints.

Under a velocity limit the squared path speed is the inverse square of the derivative in units of the limits.
Where a corner all but reverses the motion that derivative nearly vanishes, and the speed has a sharp peak:
gridpoints lie close together there and farther apart where the derivative is large.
"""

from __future__ import annotations

import numpy as np
from numba import types

from rr1plan._kernels.jit import F64, FLOATS1, FLOATS2, FLOATS3, I64, INTS1, OUT1, jit

# A derivative below this share of the piece's largest counts as this much: little time is spent there.
_FLOOR = 0.02
# Between two gridpoints it changes by this much of itself at most, above that floor.
_MOST_CHANGE = 0.4
_MOST = 256


@jit(OUT1(FLOATS1))
def inverse(limit):
    """One over each limit."""
    out = np.empty(len(limit))
    for j in range(len(limit)):
        out[j] = 1.0 / limit[j]
    return out


@jit(types.boolean(FLOATS2))
def is_bent(piece):
    """Whether a piece is a parabola."""
    bend = 0.0
    for j in range(piece.shape[1]):
        bend = max(bend, abs(piece[2, j]))
    return bend > 0.0


@jit(F64(FLOATS2, F64, FLOATS1))
def _size(piece, s, unit):
    """Largest derivative at s, in units of the limits, which are 1 / `unit`."""
    most = 0.0
    for j in range(len(unit)):
        most = max(most, abs(piece[1, j] + 2.0 * s * piece[2, j]) * unit[j])
    return most


@jit(F64(FLOATS2, FLOATS1))
def _bend(piece, unit):
    """How fast the derivative changes along a piece, in the same units."""
    most = 0.0
    for j in range(len(unit)):
        most = max(most, 2.0 * abs(piece[2, j]) * unit[j])
    return most


@jit(F64(FLOATS2, F64, F64, F64, F64, FLOATS1))
def _room(piece, s, step, bend, most, unit):
    """How long an interval at s may be under one kind of limits."""
    if bend == 0.0:
        return np.inf
    size = max(_size(piece, s, unit), _FLOOR * most)
    return min(step * np.sqrt(size * most), _MOST_CHANGE * size) / bend


@jit(I64(FLOATS2, F64, FLOATS1, FLOATS1, F64, F64, OUT1))
def _cut(piece, length, pace, pull, step, longest, cuts):
    """Write where the intervals of a piece begin, and the piece's length behind them; their number."""
    cuts[0] = 0.0
    count = 1
    bend, tug = _bend(piece, pace), _bend(piece, pull)
    bent = is_bent(piece)
    if bent:
        longest = min(longest, 0.5 * length)
    fast = max(_size(piece, 0.0, pace), _size(piece, length, pace))
    strong = max(_size(piece, 0.0, pull), _size(piece, length, pull))
    while count < _MOST:
        s = cuts[count - 1]
        delta = longest
        # A second look half an interval on: what lies ahead counts too.
        for _ in range(2 if bent else 0):
            at = min(s + 0.5 * delta, length)
            delta = min(delta, _room(piece, at, step, bend, fast, pace), _room(piece, at, step, tug, strong, pull))
        delta = max(delta, length / _MOST)
        if s + delta >= length * (1.0 - 1e-9):
            break
        # What is left is one interval, two equal ones, or more.
        cuts[count] = s + min(delta, max(0.5 * (length - s), 0.5 * delta))
        count += 1
    cuts[count] = length
    return count


@jit(
    types.Tuple((types.int64[::1], OUT1, OUT1))(FLOATS1, FLOATS3, FLOATS1, FLOATS1, F64, FLOATS1),
    entry=True,
)
def make_grid(lengths, coefficients, velocity, acceleration, step, longest):
    """The intervals of a curve: the piece of each, where it begins there and how long it is, shape (n,) each.

    Args:
        lengths: Of each piece, shape (m,).
        coefficients: q(s) = sum_k coefficients[i, k] s^k, shape (m, 3, nq).
        velocity: Limits, shape (nq,).
        acceleration: Limits, shape (nq,).
        step: How much the derivative may change in an interval, in units of the limits and of its largest value.
        longest: Longest interval on each piece, shape (m,); a parabola has two at least.
    """
    m = len(lengths)
    cuts = np.empty((m, _MOST + 1))
    counts = np.empty(m, np.int64)
    pace, pull = inverse(velocity), inverse(acceleration)
    for i in range(m):
        counts[i] = _cut(coefficients[i], lengths[i], pace, pull, step, longest[i], cuts[i])
    n = counts.sum()
    piece, offset, delta = np.empty(n, np.int64), np.empty(n), np.empty(n)
    at = 0
    for i in range(m):
        for k in range(counts[i]):
            piece[at], offset[at], delta[at] = i, cuts[i, k], cuts[i, k + 1] - cuts[i, k]
            at += 1
    return piece, offset, delta


@jit(types.Tuple((types.int64[::1], OUT1, OUT1))(FLOATS3, INTS1, FLOATS1, FLOATS1))
def halve_intervals(coefficients, piece, offset, delta):
    """The grid with every interval of a bent piece cut in two; on straight lines nothing is gained by that."""
    n = 0
    for i in range(len(piece)):
        n += 2 if is_bent(coefficients[piece[i]]) else 1
    pieces, offsets, deltas = np.empty(n, np.int64), np.empty(n), np.empty(n)
    at = 0
    for i in range(len(piece)):
        parts = 2 if is_bent(coefficients[piece[i]]) else 1
        for k in range(parts):
            pieces[at], deltas[at] = piece[i], delta[i] / parts
            offsets[at] = offset[i] + k * deltas[at]
            at += 1
    return pieces, offsets, deltas
