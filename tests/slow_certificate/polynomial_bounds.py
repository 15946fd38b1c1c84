"""Exact bounds of many polynomials at once, by their Bernstein coefficients.

On an interval a polynomial lies between the smallest and the largest of its Bernstein
coefficients, and the first and last of them are its values at the ends.
"""

from __future__ import annotations

from math import comb

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array

Index = NDArray[np.intp]
Mask = NDArray[np.bool_]


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


class RangeTable:
    """Ranges of all columns over any run of whole pieces, in constant time per query.

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
