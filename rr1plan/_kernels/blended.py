# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""Polylines with rounded corners, and the fastest motion along all of one.

For the parabolas at the corners see `rr1plan.retiming.blends`, for the speeds `parameterize.py`.
"""

from __future__ import annotations

import numpy as np
from numba import types

from rr1plan._kernels.jit import F64, FLOATS1, FLOATS2, FLOATS3, I64, INT1, OUT1, OUT2, OUT3, jit
from rr1plan._kernels.parameterize import solve_grid
from rr1plan._kernels.path_grid import halve_intervals, inverse, make_grid
from rr1plan._kernels.timed import overrun, time_curve

# A grid is fine enough when one twice as coarse costs less than this share of the time, the mean share of
# acceleration lost on it is less than the second, velocity exceeds its limits by less than the third, and it has
# intervals enough for the first to tell.
_GAIN = 0.0015
_LOOSE = 0.004
_OVERRUN = 0.001
_FEWEST = 32
_ROUNDS = 6


@jit(types.Tuple((OUT2, OUT1))(FLOATS2), entry=True)
def directions(points):
    """Unit direction (m - 1, nq) and length (m - 1,) of every edge of a polyline (m, nq)."""
    edges, nq = points.shape[0] - 1, points.shape[1]
    unit, lengths = np.empty((edges, nq)), np.empty(edges)
    for i in range(edges):
        square = 0.0
        for j in range(nq):
            unit[i, j] = points[i + 1, j] - points[i, j]
            square += unit[i, j] * unit[i, j]
        lengths[i] = np.sqrt(square)
        for j in range(nq):
            unit[i, j] /= lengths[i]
    return unit, lengths


@jit(OUT1(FLOATS2, F64, F64, F64), entry=True)
def largest_blends(points, most, reversal, smallest):
    """How far before and behind each waypoint its blend may reach, shape (m,); 0 at both ends, and for a stop.

    Args:
        points: Waypoints, no two in a row equal, shape (m, nq).
        most: Largest size.
        reversal: Two directions whose sum is shorter reverse the motion, which stops there.
        smallest: Share of the whole length below which there is no blend.
    """
    unit, lengths = directions(points)
    sizes = np.zeros(points.shape[0])
    total = lengths.sum()
    for i in range(1, points.shape[0] - 1):
        square = 0.0
        for j in range(points.shape[1]):
            square += (unit[i - 1, j] + unit[i, j]) ** 2
        size = min(most, 0.5 * min(lengths[i - 1], lengths[i]))
        if np.sqrt(square) >= reversal and size >= smallest * total:
            sizes[i] = size
    return sizes


@jit(types.void(FLOATS1, FLOATS1, FLOATS1, F64, OUT2))
def _parabola(corner, before, behind, size, out):
    """The blend at a corner between two unit directions, lowest power first, shape (3, nq)."""
    for j in range(len(corner)):
        out[0, j] = corner[j] - size * before[j]
        out[1, j] = before[j]
        out[2, j] = (behind[j] - before[j]) / (4.0 * size)


@jit(OUT2(FLOATS2, I64, F64), entry=True)
def blend(points, i, size):
    """The blend of a size at inner waypoint i, 0 <= s <= 2 size, lowest power first, shape (3, nq)."""
    unit, _ = directions(points[i - 1 : i + 2])
    out = np.empty((3, points.shape[1]))
    _parabola(points[i], unit[0], unit[1], size, out)
    return out


@jit(types.Tuple((OUT1, OUT3, INT1))(FLOATS2, FLOATS1, F64), entry=True)
def round_corners(points, sizes, tolerance):
    """The pieces of a rounded polyline: lines and parabolas one after the other, none without extent.

    Args:
        points: Waypoints, shape (m, nq).
        sizes: How far before and behind each its blend reaches, 0 for a stop, shape (m,).
        tolerance: Share of an edge below which what is left of it is none.

    Returns:
        Lengths (k,), coefficients (k, 3, nq), and how many pieces come before each waypoint's blend, shape (m,).
    """
    m, nq = points.shape
    unit, edges = directions(points)
    lengths, coefficients = np.empty(2 * m), np.zeros((2 * m, 3, nq))
    before = np.zeros(m, np.int64)
    count = 0
    for i in range(m - 1):
        line = edges[i] - sizes[i] - sizes[i + 1]
        if line > tolerance * edges[i]:
            lengths[count] = line
            for j in range(nq):
                coefficients[count, 0, j] = points[i, j] + sizes[i] * unit[i, j]
                coefficients[count, 1, j] = unit[i, j]
            count += 1
        before[i + 1] = count
        if sizes[i + 1] > 0.0:
            lengths[count] = 2.0 * sizes[i + 1]
            _parabola(points[i + 1], unit[i], unit[i + 1], sizes[i + 1], coefficients[count])
            count += 1
    return lengths[:count].copy(), coefficients[:count].copy(), before


@jit(F64(FLOATS2, I64, I64, FLOATS1, FLOATS1))
def _stopping_duration(points, first, last, velocity, acceleration):
    """Time from one waypoint to another with rest at every one between them, in closed form."""
    unit, lengths = directions(points[first : last + 1])
    total = 0.0
    for i in range(last - first):
        speed, pull = np.inf, np.inf
        for j in range(points.shape[1]):
            if unit[i, j] != 0.0:
                speed = min(speed, velocity[j] / abs(unit[i, j]))
                pull = min(pull, acceleration[j] / abs(unit[i, j]))
        peak = min(speed, np.sqrt(pull * lengths[i]))
        total += lengths[i] / peak + peak / pull
    return total


@jit(types.Tuple((OUT1, OUT3, F64))(FLOATS1, FLOATS3, FLOATS1, FLOATS1, F64))
def _settle(lengths, coefficients, velocity, acceleration, step):
    """A motion hardly slower than on any finer grid, and the factor by which it exceeds the limits between gridpoints.

    The grid is halved until that gains next to nothing, some joint is close to a limit nearly always, and velocity
    keeps its limits well enough between the places where it is held.
    """
    pace, pull = inverse(velocity), inverse(acceleration)
    piece, offset, delta = make_grid(lengths, coefficients, velocity, acceleration, step, lengths)
    x, now, loose = solve_grid(coefficients, piece, offset, delta, velocity, acceleration)
    durations, timed, factor, before = np.empty(0), np.empty((0, 5, len(velocity))), np.inf, np.inf
    for left in range(_ROUNDS, 0, -1):
        count, before = len(piece), now
        piece, offset, delta = halve_intervals(coefficients, piece, offset, delta)
        straight = len(piece) == count
        if not straight:
            x, now, loose = solve_grid(coefficients, piece, offset, delta, velocity, acceleration)
        fine = before <= now * (1.0 + _GAIN) and loose <= _LOOSE and len(piece) >= _FEWEST
        if straight or left == 1 or fine:
            durations, timed = time_curve(coefficients, piece, offset, delta, velocity, acceleration, x)
            factor = overrun(timed, durations, pace, pull)
            if straight or factor <= 1.0 + _OVERRUN:
                break
    return durations, timed, factor


@jit(types.Tuple((OUT1, OUT3))(FLOATS1, FLOATS3, FLOATS1, FLOATS1, F64), entry=True)
def time_within(lengths, coefficients, velocity, acceleration, step):
    """The fastest motion along a curve from rest to rest, stretched by what rounding and the grid make it exceed.

    Args:
        lengths: Of each piece, shape (m,).
        coefficients: Of each piece, shape (m, 3, nq).
        velocity: Limits, shape (nq,).
        acceleration: Limits, shape (nq,).
        step: Of the first grid, see `path_grid.make_grid`.

    Returns:
        Durations (k,), polynomials in time (k, 5, nq).
    """
    durations, timed, factor = _settle(lengths, coefficients, velocity, acceleration, step)
    if factor > 1.0:
        power = 1.0
        for k in range(timed.shape[1]):
            # One number at a time: numba compiles an assignment's check of shapes for seconds.
            for i in range(len(timed)):
                for j in range(timed.shape[2]):
                    timed[i, k, j] *= power
            power /= factor
        for i in range(len(durations)):
            durations[i] *= factor
    return durations, timed


@jit(types.Tuple((OUT1, OUT3, I64))(OUT1, OUT3, I64, FLOATS1, FLOATS3))
def _append(durations, timed, count, new_durations, new_timed):
    """Timed pieces with some more behind the first `count` of them; their new number."""
    need, nq = count + len(new_durations), timed.shape[2]
    if need > len(durations):
        room = 2 * need
        longer, more = np.empty(room), np.empty((room, timed.shape[1], nq))
        for i in range(count):
            longer[i] = durations[i]
            for k in range(timed.shape[1]):
                for j in range(nq):
                    more[i, k, j] = timed[i, k, j]
        durations, timed = longer, more
    for i in range(len(new_durations)):
        durations[count] = new_durations[i]
        for k in range(timed.shape[1]):
            for j in range(nq):
                timed[count, k, j] = new_timed[i, k, j]
        count += 1
    return durations, timed, count


@jit(types.Tuple((OUT1, OUT3, types.boolean, I64))(FLOATS2, FLOATS1, FLOATS1, FLOATS1, F64, F64), entry=True)
def time_polyline(points, sizes, velocity, acceleration, step, tolerance):
    """The fastest motion along a rounded polyline, at rest where it is not rounded.

    Where the rounded corners are slower than rest at each of them, it rests there.

    Args:
        points: Waypoints, shape (m, nq).
        sizes: See `round_corners`.
        velocity: Limits, finite for joints that move, shape (nq,).
        acceleration: The same.
        step: Of the first grid, see `path_grid.make_grid`.
        tolerance: See `round_corners`.

    Returns:
        Durations (k,), polynomials in time (k, 5, nq), whether any of them is bent, and the waypoint before which
        no speed is left, or -1.
    """
    m = points.shape[0]
    lengths, coefficients, before = round_corners(points, sizes, tolerance)
    durations, timed = np.empty(64), np.empty((64, 5, points.shape[1]))
    count, bent, first = 0, False, 0
    for last in range(1, m):
        if sizes[last] > 0.0:
            continue
        if last - first > 1:
            some = slice(before[first], before[last])
            smooth, curve = time_within(lengths[some], coefficients[some], velocity, acceleration, step)
            if smooth.sum() <= _stopping_duration(points, first, last, velocity, acceleration):
                durations, timed, count = _append(durations, timed, count, smooth, curve)
                bent, first = True, last
        while first < last:
            line, line_coefficients, _ = round_corners(points[first : first + 2], np.zeros(2), tolerance)
            straight, curve = time_within(line, line_coefficients, velocity, acceleration, step)
            if not np.isfinite(straight.sum()):
                return durations[:0].copy(), timed[:0].copy(), False, first + 1
            durations, timed, count = _append(durations, timed, count, straight, curve)
            first += 1
    return durations[:count].copy(), timed[:count].copy(), bent, -1
