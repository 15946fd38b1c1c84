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

from rr1plan._kernels.jit import F64, FLOATS1, FLOATS2, FLOATS3, I64, INTS1, OUT1, OUT2, OUT3, jit

# Below this ratio of its coefficients a row bounds one of x and y alone.
_NONE = 1e-9
_ROUNDS = 100
_SLOWEST = 1e-12
_MOST_TURN = 8.0


@jit(F64(FLOATS2, F64, FLOATS1))
def _turn(piece, length, limit):
    """How far the derivative of a piece turns and changes, in units of the limits and of its smaller end."""
    change, begin, end = 0.0, 0.0, 0.0
    for j in range(len(limit)):
        first, more = piece[1, j] / limit[j], 2.0 * length * piece[2, j] / limit[j]
        change += more * more
        begin += first * first
        end += (first + more) ** 2
    smaller = min(begin, end)
    return _MOST_TURN if change >= _MOST_TURN**2 * smaller else np.sqrt(change / smaller)


@jit(types.int64[::1](FLOATS1, FLOATS3, FLOATS1, FLOATS1, F64), entry=True)
def count_intervals(lengths, coefficients, velocity, acceleration, density):
    """How many intervals each piece takes: one where it is straight, which is exact there.

    Args:
        lengths: Of each piece, shape (m,).
        coefficients: q(s) = sum_k coefficients[i, k] s^k, shape (m, 3, nq).
        velocity: Limits, shape (nq,).
        acceleration: Limits, shape (nq,).
        density: Intervals per radian that the derivative turns, where the limits are all alike.
    """
    counts = np.ones(len(lengths), np.int64)
    for i in range(len(lengths)):
        if np.any(coefficients[i, 2] != 0.0):
            turn = max(_turn(coefficients[i], lengths[i], velocity), _turn(coefficients[i], lengths[i], acceleration))
            counts[i] = max(2, int(np.ceil(density * turn)))
    return counts


@jit(types.Tuple((types.int64[::1], OUT1, OUT1))(FLOATS1, INTS1), entry=True)
def make_grid(lengths, counts):
    """Equal intervals on every piece: which piece, where each begins on it, how long it is, shape (n,) each."""
    n = counts.sum()
    piece, offset, delta = np.empty(n, np.int64), np.empty(n), np.empty(n)
    at = 0
    for i in range(len(lengths)):
        for k in range(counts[i]):
            piece[at], delta[at] = i, lengths[i] / counts[i]
            offset[at] = k * delta[at]
            at += 1
    return piece, offset, delta


@jit(F64(FLOATS2, F64, FLOATS1))
def _top_speed(piece, s, velocity):
    """Highest squared path speed under the velocity limits at s of a piece (3, nq)."""
    slowest = _SLOWEST
    for j in range(len(velocity)):
        slowest = max(slowest, abs(piece[1, j] + 2.0 * s * piece[2, j]) / velocity[j])
    return 1.0 / (slowest * slowest)


@jit(types.void(FLOATS2, F64, F64, FLOATS1, FLOATS1, OUT1, OUT1))
def fill_rows(piece, offset, delta, velocity, acceleration, alpha, beta):
    """Rows |alpha x + beta y| <= 1 of an interval, alpha >= 0.

    Acceleration is linear in s, so holding it at both ends holds it between them. Velocity is
    held at three places between them.

    Args:
        piece: q(s) = sum_k piece[k] s^k, shape (3, nq).
        offset: Where the interval begins on it.
        delta: Its length.
        velocity: Limits, shape (nq,).
        acceleration: Limits, shape (nq,).
        alpha: Out, shape (2 nq + 4,); the last row is the caller's.
        beta: Out, the same shape.
    """
    nq = len(velocity)
    for j in range(nq):
        second = 2.0 * piece[2, j]
        begin = (piece[1, j] + offset * second) / (2.0 * delta)
        end = (piece[1, j] + (offset + delta) * second) / (2.0 * delta)
        a, b = (second - begin) / acceleration[j], begin / acceleration[j]
        alpha[j], beta[j] = abs(a), b if a >= 0.0 else -b
        a, b = -end / acceleration[j], (second + end) / acceleration[j]
        alpha[nq + j], beta[nq + j] = abs(a), b if a >= 0.0 else -b
    for k in range(3):
        at = 0.25 * (k + 1)
        slow = 1.0 / _top_speed(piece, offset + at * delta, velocity)
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
            size[r], slope[r] = 1.0 / alpha[r], beta[r] / alpha[r]
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
        if abs(beta[r]) > _NONE * alpha[r]:
            way = alpha[r] * x if beta[r] > 0.0 else -alpha[r] * x
            y = min(y, (1.0 - way) / abs(beta[r]))
    return max(0.0, y)


@jit(F64(FLOATS2, FLOATS1))
def _line_acceleration(piece, acceleration):
    """Highest path acceleration along a straight piece."""
    slowest = 0.0
    for j in range(len(acceleration)):
        slowest = max(slowest, abs(piece[1, j]) / acceleration[j])
    return 1.0 / slowest


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
    n, m = len(piece), 2 * len(velocity) + 4
    alpha, beta = np.zeros((n, m)), np.zeros((n, m))
    size, slope = np.empty(m), np.empty(m)
    x = np.zeros(n + 1)
    for i in range(n - 1, -1, -1):
        c = coefficients[piece[i]]
        top = _top_speed(c, offset[i], velocity)
        if np.any(c[2] != 0.0):
            fill_rows(c, offset[i], delta[i], velocity, acceleration, alpha[i], beta[i])
            alpha[i, m - 1] = 1.0 / top
            x[i] = highest_speed(alpha[i], beta[i], x[i + 1], size, slope)
        else:
            gain = 2.0 * delta[i] * _line_acceleration(c, acceleration)
            alpha[i, 0], beta[i, 0] = 1.0 / gain, -1.0 / gain
            x[i] = min(top, x[i + 1] + gain)
    x[0] = 0.0
    for i in range(n):
        x[i + 1] = next_speed(alpha[i], beta[i], x[i], x[i + 1])
    return x


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


@jit(types.Tuple((OUT1, OUT3))(FLOATS3, INTS1, FLOATS1, FLOATS1, FLOATS1, FLOATS1))
def time_curve(coefficients, piece, offset, delta, velocity, acceleration):
    """The fastest motion along a curve from rest to rest: durations (k,), polynomials in time (k, 5, nq).

    A straight interval becomes up to three: full acceleration, top speed, full deceleration.
    Arguments as in `fastest_speeds`.
    """
    n = len(piece)
    speeds = fastest_speeds(coefficients, piece, offset, delta, velocity, acceleration)
    pieces, offsets, deltas = np.empty(3 * n, np.int64), np.empty(3 * n), np.empty(3 * n)
    x = np.zeros(3 * n + 1)
    count = 0
    for i in range(n):
        c = coefficients[piece[i]]
        low, high = speeds[i], speeds[i + 1]
        rise, fall, peak = delta[i], delta[i], high
        if not np.any(c[2] != 0.0):
            gain = 2.0 * _line_acceleration(c, acceleration)
            peak = max(min(_top_speed(c, 0.0, velocity), 0.5 * (low + high + gain * delta[i])), low, high)
            rise = min((peak - low) / gain, delta[i])
            fall = max(delta[i] - (peak - high) / gain, rise)
        start = 0.0
        for cut, top in ((rise, peak), (fall, peak), (delta[i], high)):
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


@jit(OUT2(FLOATS3, FLOATS1, I64), entry=True)
def peaks(coefficients, durations, derivative):
    """Largest absolute value of a derivative on each piece; see `rr1plan.retiming.extrema`."""
    m, terms, nq = coefficients.shape
    out, c = np.empty((m, nq)), np.zeros(4)
    for i in range(m):
        for j in range(nq):
            for k in range(derivative, terms):
                factor = 1.0
                for p in range(derivative):
                    factor *= k - p
                c[k - derivative] = factor * coefficients[i, k, j]
            out[i, j] = _highest(c[0], c[1], c[2], c[3], durations[i])
    return out
