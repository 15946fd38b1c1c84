# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""The fastest speed along straight lines and parabolas under velocity and acceleration limits.

On an interval of length d with constant path acceleration the squared path speed is linear, from x
to y, and every limit is |alpha x + beta y| <= 1: two numbers instead of (u, x), and symmetric ones, so
that rest is always allowed and the speeds from which the end can be reached are [0, high]. One pass
backward finds the highest of them, one forward takes the fastest.
Pham, Pham, "A New Approach to Time-Optimal Path Parameterization Based on Reachability Analysis",
IEEE T-RO 34(3), 2018. Their linear program is solved exactly: its bound of x is a concave function of y
made of lines, and its peak is closed in on by the crossing of a rising and a falling one.
"""

from __future__ import annotations

import numpy as np
from numba import types

from rr1plan._kernels.jit import F64, FLOATS1, FLOATS2, FLOATS3, I64, INTS1, OUT1, OUT2, jit
from rr1plan._kernels.path_grid import inverse, is_bent

# Below this ratio of its coefficients a row bounds one of x and y alone.
_NONE = 1e-9
_ROUNDS = 100
# Places within an interval at which velocity is held.
_BETWEEN = 4
_SLOWEST = 1e-12


@jit(F64(FLOATS2, F64, FLOATS1))
def _slowness(piece, s, pace):
    """One over the highest squared path speed at s of a piece (3, nq); `pace` is one over the velocity limits."""
    slowest = _SLOWEST
    for j in range(len(pace)):
        slowest = max(slowest, abs(piece[1, j] + 2.0 * s * piece[2, j]) * pace[j])
    return slowest * slowest


@jit(types.void(FLOATS2, F64, F64, FLOATS1, FLOATS1, OUT1, OUT1))
def fill_rows(piece, offset, delta, pace, pull, alpha, beta):
    """Rows |alpha x + beta y| <= 1 of an interval, alpha >= 0.

    Acceleration is linear in s, so holding it at both ends holds it between them. Velocity is
    held at `_BETWEEN` places between them.

    Args:
        piece: q(s) = sum_k piece[k] s^k, shape (3, nq).
        offset: Where the interval begins on it.
        delta: Its length.
        pace: One over the velocity limits, shape (nq,).
        pull: One over the acceleration limits, shape (nq,).
        alpha: Out, shape (2 nq + _BETWEEN + 1,); the last row is the caller's.
        beta: Out, the same shape.
    """
    nq, scale = len(pace), 0.5 / delta
    for j in range(nq):
        second = 2.0 * piece[2, j]
        begin = (piece[1, j] + offset * second) * scale
        end = (piece[1, j] + (offset + delta) * second) * scale
        a, b = (second - begin) * pull[j], begin * pull[j]
        alpha[j], beta[j] = abs(a), b if a >= 0.0 else -b
        a, b = -end * pull[j], (second + end) * pull[j]
        alpha[nq + j], beta[nq + j] = abs(a), b if a >= 0.0 else -b
    for k in range(_BETWEEN):
        at = (k + 0.5) / _BETWEEN
        slow = _slowness(piece, offset + at * delta, pace)
        alpha[2 * nq + k], beta[2 * nq + k] = (1.0 - at) * slow, at * slow


@jit(I64(FLOATS1, FLOATS1, F64, F64))
def _lowest(size, slope, sign, y):
    """Which of the lines sign size[r] - slope[r] y is the lowest (sign 1) or the highest (sign -1)."""
    best, value = 0, np.inf
    for r in range(len(size)):
        here = size[r] - sign * slope[r] * y
        if here < value:
            best, value = r, here
    return best


@jit(F64(FLOATS1, FLOATS1, F64, OUT1, OUT1))
def highest_speed(alpha, beta, high, size, slope):
    """The highest x for which some y in [0, high] has |alpha x + beta y| <= 1 in all rows.

    Args:
        alpha: Not negative, one of them above zero, shape (m,).
        beta: Shape (m,).
        high: Highest y.
        size: Scratch memory, shape (m,).
        slope: Scratch memory, shape (m,).
    """
    for r in range(len(alpha)):
        if alpha[r] > _NONE * abs(beta[r]):
            size[r] = 1.0 / alpha[r]
            slope[r] = beta[r] * size[r]
        else:
            size[r], slope[r] = np.inf, 0.0
            if beta[r] != 0.0:
                high = min(high, 1.0 / abs(beta[r]))
    y = high
    falling = _lowest(size, slope, 1.0, y)
    if slope[falling] > 0.0:
        y = 0.0
        rising = _lowest(size, slope, 1.0, y)
        if slope[rising] < 0.0:
            for _ in range(_ROUNDS):
                y = (size[falling] - size[rising]) / (slope[falling] - slope[rising])
                r = _lowest(size, slope, 1.0, y)
                if r in (rising, falling) or slope[r] == 0.0:
                    break
                if slope[r] > 0.0:
                    falling = r
                else:
                    rising = r
    # The other side of the rows bounds x from below: back to where there is room, which y = 0 has.
    for _ in range(_ROUNDS):
        upper = _lowest(size, slope, 1.0, y)
        lower = _lowest(size, slope, -1.0, y)
        room = size[upper] + size[lower] - (slope[upper] - slope[lower]) * y
        closing = slope[upper] - slope[lower]
        if room >= -1e-12 * size[upper] or closing <= 0.0:
            break
        y = (size[upper] + size[lower]) / closing
    r = _lowest(size, slope, 1.0, y)
    return max(0.0, size[r] - slope[r] * y)


@jit(F64(FLOATS1, FLOATS1, F64, F64))
def next_speed(alpha, beta, x, high):
    """The highest y in [0, high] with |alpha x + beta y| <= 1 in all rows; x has one."""
    y = high
    for r in range(len(alpha)):
        steep = abs(beta[r])
        if steep > _NONE * alpha[r]:
            way = alpha[r] * x if beta[r] > 0.0 else -alpha[r] * x
            if way + steep * y > 1.0:
                y = (1.0 - way) / steep
    return max(0.0, y)


@jit(F64(FLOATS2, FLOATS1))
def _gain(piece, pull):
    """Highest change of the squared path speed along a straight piece, per length."""
    slowest = 0.0
    for j in range(len(pull)):
        slowest = max(slowest, abs(piece[1, j]) * pull[j])
    return 2.0 / slowest


@jit(types.void(FLOATS3, INTS1, FLOATS1, FLOATS1, FLOATS1, FLOATS1, OUT2, OUT2, OUT1))
def _pass_both_ways(coefficients, piece, offset, delta, pace, pull, alpha, beta, x):
    """Write the rows of all intervals and the fastest squared speeds, first backward, then forward."""
    n, m = len(piece), alpha.shape[1]
    size, slope = np.empty(m), np.empty(m)
    x[n] = 0.0
    for i in range(n - 1, -1, -1):
        c = coefficients[piece[i]]
        slow = _slowness(c, offset[i], pace)
        if is_bent(c):
            fill_rows(c, offset[i], delta[i], pace, pull, alpha[i], beta[i])
            alpha[i, m - 1] = slow
            x[i] = highest_speed(alpha[i], beta[i], x[i + 1], size, slope)
        else:
            gain = delta[i] * _gain(c, pull)
            alpha[i, 0], beta[i, 0] = 1.0 / gain, -1.0 / gain
            x[i] = min(1.0 / slow, x[i + 1] + gain)
    x[0] = 0.0
    for i in range(n):
        x[i + 1] = next_speed(alpha[i], beta[i], x[i], x[i + 1])


@jit(OUT1(FLOATS3, INTS1, FLOATS1, FLOATS1, FLOATS1, FLOATS1))
def fastest_speeds(coefficients, piece, offset, delta, velocity, acceleration):
    """Squared path speeds at the gridpoints of a curve from rest to rest, shape (n + 1,).

    Args:
        coefficients: Of each piece, shape (m, 3, nq).
        piece: The piece of each interval, shape (n,).
        offset: Where it begins there, shape (n,).
        delta: How long it is, shape (n,).
        velocity: Limits, shape (nq,).
        acceleration: Limits, shape (nq,).
    """
    n, m = len(piece), 2 * len(velocity) + _BETWEEN + 1
    alpha, beta, x = np.zeros((n, m)), np.zeros((n, m)), np.zeros(n + 1)
    pace, pull = inverse(velocity), inverse(acceleration)
    _pass_both_ways(coefficients, piece, offset, delta, pace, pull, alpha, beta, x)
    return x


@jit(F64(FLOATS1, FLOATS1, F64, F64, I64, I64))
def _tightest(alpha, beta, x, y, first, stop):
    """How much of its limit the tightest of some rows takes."""
    most = 0.0
    for r in range(first, stop):
        most = max(most, abs(alpha[r] * x + beta[r] * y))
    return most


@jit(types.UniTuple(F64, 3)(FLOATS2, F64, FLOATS1, FLOATS1, F64, F64))
def ride(piece, delta, pace, pull, x, y):
    """Where on a straight interval acceleration ends and deceleration begins, and the squared speed between."""
    gain = _gain(piece, pull)
    peak = max(min(1.0 / _slowness(piece, 0.0, pace), 0.5 * (x + y + gain * delta)), x, y)
    rise = min((peak - x) / gain, delta)
    return rise, max(delta - (peak - y) / gain, rise), peak


@jit(types.Tuple((OUT1, F64, F64))(FLOATS3, INTS1, FLOATS1, FLOATS1, FLOATS1, FLOATS1))
def solve_grid(coefficients, piece, offset, delta, velocity, acceleration):
    """The fastest squared speeds on a grid, how long the motion takes, and how loose it is.

    In the fastest motion some joint is at a limit everywhere. On a grid one is at an end of each interval, and
    what is missing at the other end is lost: `loose` is the mean of that over time.
    """
    n, nq = len(piece), len(velocity)
    m = 2 * nq + _BETWEEN + 1
    alpha, beta, x = np.zeros((n, m)), np.zeros((n, m)), np.zeros(n + 1)
    pace, pull = inverse(velocity), inverse(acceleration)
    _pass_both_ways(coefficients, piece, offset, delta, pace, pull, alpha, beta, x)
    total, loose = 0.0, 0.0
    for i in range(n):
        c = coefficients[piece[i]]
        begin, end = np.sqrt(x[i]), np.sqrt(x[i + 1])
        if is_bent(c):
            duration = 2.0 * delta[i] / (begin + end)
            first = max(_tightest(alpha[i], beta[i], x[i], x[i + 1], 0, nq), x[i] * alpha[i, m - 1])
            last = _tightest(alpha[i], beta[i], x[i], x[i + 1], nq, 2 * nq)
            last = max(last, x[i + 1] * _slowness(c, offset[i] + delta[i], pace))
            loose += duration * max(0.0, 1.0 - min(first, last))
        else:
            rise, fall, peak = ride(c, delta[i], pace, pull, x[i], x[i + 1])
            top = np.sqrt(peak)
            duration = 2.0 * rise / (begin + top) + (fall - rise) / top + 2.0 * (delta[i] - fall) / (top + end)
        total += duration
    return x, total, loose / total
