"""Exact extremes of piecewise polynomials and of their rates, compiled: by their Bernstein coefficients.

On an interval a polynomial lies between the smallest and the largest of its Bernstein coefficients, and the first
and last of them are its values at the ends. Halving the interval (de Casteljau) closes the gap quadratically, so the
largest value between two samples is found as exactly as floating point allows, without root finding.

Lane, Riesenfeld (1981), Bounds on a polynomial, BIT 21.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rr1plan.checks import Array
from rr1plan.validation.compiled import FLOATS1, FLOATS3, OUT2, OUT3, entry, part

ORDERS = 4
"""Position, velocity, acceleration, jerk."""

# What is not higher by this share of the highest value, or of a piece's largest coefficient, is not looked for.
_RELATIVE_GAP = 1e-13
_ROUNDING = 1e-15
_DEEPEST = 80
# Last axis of `peaks`: highest value, its time, lowest value, its time; of `jumps`: size, time.
_HIGH, _HIGH_TIME, _LOW, _LOW_TIME = range(4)


class Extremes(NamedTuple):
    """What the columns of a motion reach; the first axis is position, velocity, acceleration, jerk.

    Args:
        high: Highest value of each column, shape (4, nq).
        high_time: When [s].
        low: Lowest value, shape (4, nq).
        low_time: When [s].
        jump: Largest jump at a break, of position, velocity and acceleration, shape (3, nq).
        jump_time: When [s]; 0 where nothing jumps.
        end: Value at the last instant, shape (4, nq).
    """

    high: Array
    high_time: Array
    low: Array
    low_time: Array
    jump: Array
    jump_time: Array
    end: Array


def extremes(breaks: Array, coefficients: Array) -> Extremes:
    """Highest and lowest values of every column and its rates, and jumps between pieces.

    Args:
        breaks: Times of the breaks [s], shape (m + 1,), or (1,) for a duration of zero.
        coefficients: Local coefficients, lowest power first, shape (m, d + 1, nq).

    Returns:
        Values to 1e-13 relative, and the first time at which each is reached.
    """
    nq = coefficients.shape[2]
    peaks, jumps, end = np.zeros((ORDERS, nq, 4)), np.zeros((ORDERS - 1, nq, 2)), np.zeros((ORDERS, nq))
    _measure(np.ascontiguousarray(breaks), np.ascontiguousarray(coefficients), peaks, jumps, end)
    high, high_time, low, low_time = np.moveaxis(peaks, 2, 0)
    return Extremes(high, high_time, low, low_time, jumps[:, :, 0], jumps[:, :, 1], end)


@part
def _take(coefficients: Any, piece: int, column: int, order: int, out: Any) -> int:
    """Write the coefficients of a derivative; its degree."""
    degree = coefficients.shape[1] - 1
    if order > degree:
        out[0] = 0.0
        return 0
    for k in range(order, degree + 1):
        factor = 1.0
        for i in range(order):
            factor *= k - i
        out[k - order] = factor * coefficients[piece, k, column]
    return int(degree - order)


@part
def _to_bernstein(terms: Any, degree: int, width: float, control: Any) -> float:
    """Bernstein coefficients on [0, width]; the largest of their sizes."""
    power = 1.0
    for k in range(degree + 1):
        terms[k] *= power
        power *= width
    largest = 0.0
    for i in range(degree + 1):
        # The binomials i over k, by those of the degree.
        share, value = 1.0, 0.0
        for k in range(i + 1):
            value += share * terms[k]
            if k < i:
                share *= (i - k) / (degree - k)
        control[i] = value
        largest = max(largest, abs(value))
    return largest


@part
def _climb(
    begin: float, width: float, degree: int, rounding: float, best: float, when: float, stack: Any, spans: Any
) -> tuple[float, float]:
    """The highest value on an interval and its time, if above `best`; its Bernstein coefficients are stack[0]."""
    spans[0, 0], spans[0, 1] = begin, width
    if stack[0, 0] > best:
        best, when = stack[0, 0], begin
    if stack[0, degree] > best:
        best, when = stack[0, degree], begin + width
    top = 0
    while top >= 0:
        start, width = spans[top, 0], spans[top, 1]
        hull = stack[top, 0]
        for i in range(1, degree + 1):
            hull = max(hull, stack[top, i])
        too_short = width <= 1e-15 * max(1.0, abs(start)) or top + 1 >= _DEEPEST
        if hull <= best + _RELATIVE_GAP * abs(best) + rounding or too_short:
            top -= 1
            continue
        # The later half takes the place of both, the earlier one goes on top of it.
        half = 0.5 * width
        for k in range(degree + 1):
            stack[top + 1, k] = stack[top, 0]
            for i in range(degree - k):
                stack[top, i] = 0.5 * (stack[top, i] + stack[top, i + 1])
        spans[top, 0], spans[top, 1] = start + half, half
        spans[top + 1, 0], spans[top + 1, 1] = start, half
        if stack[top, 0] > best:
            best, when = stack[top, 0], start + half
        top += 1
    return best, when


@part
def _measure_piece(
    breaks: Any, i: int, j: int, degree: int, order: int, control: Any, rounding: float, peaks: Any, stack: Any,
    spans: Any,
) -> None:  # fmt: skip
    """Raise and lower the peaks of a column by one of its pieces."""
    width = breaks[i + 1] - breaks[i] if len(breaks) > 1 else 0.0
    for k in range(degree + 1):
        stack[0, k] = control[k]
    best, when = _climb(
        breaks[i], width, degree, rounding, peaks[order, j, _HIGH], peaks[order, j, _HIGH_TIME], stack, spans
    )
    peaks[order, j, _HIGH], peaks[order, j, _HIGH_TIME] = best, when
    for k in range(degree + 1):
        stack[0, k] = -control[k]
    best, when = _climb(
        breaks[i], width, degree, rounding, -peaks[order, j, _LOW], peaks[order, j, _LOW_TIME], stack, spans
    )
    peaks[order, j, _LOW], peaks[order, j, _LOW_TIME] = -best, when


@entry((FLOATS1, FLOATS3, OUT3, OUT3, OUT2))
def _measure(breaks: Any, coefficients: Any, peaks: Any, jumps: Any, end: Any) -> None:
    pieces, count, columns = coefficients.shape
    terms, control = np.empty(count), np.empty(count)
    stack, spans = np.empty((_DEEPEST, count)), np.empty((_DEEPEST, 2))
    for order in range(ORDERS):
        for j in range(columns):
            peaks[order, j, _HIGH], peaks[order, j, _LOW] = -np.inf, np.inf
            before = 0.0
            for i in range(pieces):
                degree = _take(coefficients, i, j, order, terms)
                width = breaks[i + 1] - breaks[i] if len(breaks) > 1 else 0.0
                largest = _to_bernstein(terms, degree, width, control)
                if i > 0 and order < ORDERS - 1 and abs(control[0] - before) > jumps[order, j, 0]:
                    jumps[order, j, 0], jumps[order, j, 1] = abs(control[0] - before), breaks[i]
                before = control[degree]
                _measure_piece(breaks, i, j, degree, order, control, _ROUNDING * largest, peaks, stack, spans)
            end[order, j] = before
