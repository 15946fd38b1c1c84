"""Exact bounds of piecewise polynomials, by their Bernstein coefficients.

On an interval a polynomial lies between the smallest and the largest of its Bernstein
coefficients, and the first and last of them are its values at the ends. Halving the interval
(de Casteljau) closes the gap quadratically, so the largest value between two samples is found
as exactly as floating point allows, without root finding.

Lane, Riesenfeld (1981), Bounds on a polynomial, BIT 21.
"""

from __future__ import annotations

from math import comb
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array

Index = NDArray[np.intp]
Mask = NDArray[np.bool_]

_RELATIVE_GAP = 1e-13
_MOST_HALVINGS = 80


class Peak(NamedTuple):
    """The largest value of each column [unit of the column] and when it is reached [s]."""

    value: Array
    time: Array


def derivative(coefficients: Array) -> Array:
    """Coefficients of the derivative, lowest power first, shape (m, max(1, d), nq)."""
    degree = coefficients.shape[1] - 1
    if degree == 0:
        return np.zeros_like(coefficients)
    return np.asarray(coefficients[:, 1:] * np.arange(1.0, degree + 1.0)[None, :, None])


def evaluate(coefficients: Array, local: Array) -> Array:
    """Values (n, nq) of n polynomials (n, d + 1, nq) at one local time each (n,)."""
    value = coefficients[:, -1]
    for k in range(coefficients.shape[1] - 2, -1, -1):
        value = value * local[:, None] + coefficients[:, k]
    return np.asarray(value)


def bernstein(coefficients: Array, start: Array, stop: Array) -> Array:
    """Bernstein coefficients (n, d + 1, nq) of n polynomials on [start, stop], each (n,)."""
    degree = coefficients.shape[1] - 1
    width = stop - start
    scaled = np.zeros_like(coefficients)
    for k in range(degree + 1):
        for j in range(k, degree + 1):
            scaled[:, k] += comb(j, k) * coefficients[:, j] * (start ** (j - k))[:, None]
        scaled[:, k] *= (width**k)[:, None]
    weights = np.array([[comb(i, k) / comb(degree, k) for k in range(degree + 1)] for i in range(degree + 1)])
    return np.asarray(np.einsum("ik,nkq->niq", weights, scaled))


def peaks(coefficients: Array, breaks: Array) -> Peak:
    """The largest value of every column over all pieces, by branch and bound.

    Args:
        coefficients: Local coefficients, shape (m, d + 1, nq).
        breaks: Times of the breaks [s], shape (m + 1,), or (1,) for a duration of zero.

    Returns:
        Largest values (nq,) to 1e-13 relative, and their times (nq,) [s].
    """
    m, count, nq = coefficients.shape
    widths = np.diff(breaks) if len(breaks) > 1 else np.zeros(1)
    control = bernstein(coefficients, np.zeros(m), widths).transpose(0, 2, 1).reshape(m * nq, count)
    column = np.tile(np.arange(nq), m)
    start = np.repeat(breaks[:m], nq)
    width = np.repeat(widths, nq)
    best, when = np.full(nq, -np.inf), np.zeros(nq)
    if nq == 0:
        return Peak(best, when)
    for _ in range(_MOST_HALVINGS):
        for values, times in ((control[:, 0], start), (control[:, -1], start + width)):
            _keep_largest(best, when, column, values, times)
        gap = _RELATIVE_GAP * np.abs(best[column]) + 1e-300
        hull = control.max(axis=1)
        wider = width > 1e-15 * np.maximum(1.0, np.abs(start))
        open_ = (hull > best[column] + gap) & wider
        if not open_.any():
            break
        left, right = _halve(control[open_])
        control = np.concatenate([left, right])
        column = np.tile(column[open_], 2)
        width = np.tile(0.5 * width[open_], 2)
        start = np.concatenate([start[open_], start[open_] + width[: len(left)]])
    return Peak(best, when)


def _keep_largest(best: Array, when: Array, column: Index, values: Array, times: Array) -> None:
    """Raise `best` (nq,) to the largest of the values of its column, with its time."""
    order = np.lexsort((values, column))
    last = order[np.append(np.diff(column[order]) > 0, True)]
    better = last[values[last] > best[column[last]]]
    best[column[better]] = values[better]
    when[column[better]] = times[better]


def _halve(control: Array) -> tuple[Array, Array]:
    """Bernstein coefficients of the two halves (de Casteljau), each like control (n, d + 1)."""
    left, right = np.empty_like(control), np.empty_like(control)
    level = control
    count = control.shape[1]
    for k in range(count):
        left[:, k] = level[:, 0]
        right[:, count - 1 - k] = level[:, -1]
        level = 0.5 * (level[:, :-1] + level[:, 1:])
    return left, right


class RangeTable:
    """Ranges of all columns over any run of whole pieces, each answered in constant time.

    Args:
        lower, upper: Bounds of each piece, shape (m, nq).
    """

    def __init__(self, lower: Array, upper: Array) -> None:
        self._lower, self._upper = [lower], [upper]
        span = 1
        while 2 * span <= len(lower):
            self._lower.append(np.minimum(self._lower[-1][:-span], self._lower[-1][span:]))
            self._upper.append(np.maximum(self._upper[-1][:-span], self._upper[-1][span:]))
            span *= 2

    def over(self, first: Index, stop: Index) -> tuple[Array, Array]:
        """Bounds (n, nq), (n, nq) over the pieces first <= i < stop, each (n,)."""
        nq = self._lower[0].shape[1]
        lower, upper = np.empty((len(first), nq)), np.empty((len(first), nq))
        level = np.frexp((stop - first).astype(np.float64))[1] - 1
        for k in np.unique(level):
            at = level == k
            a, b = first[at], stop[at] - 2**k
            lower[at] = np.minimum(self._lower[k][a], self._lower[k][b])
            upper[at] = np.maximum(self._upper[k][a], self._upper[k][b])
        return lower, upper
