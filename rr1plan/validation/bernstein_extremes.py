"""Exact extremes of piecewise polynomials and their rates, by Bernstein coefficients (`referee_extremes.c`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rr1plan.checks import Array
from rr1plan.validation.referee_kernels import SOURCES, load_library

ORDERS = 4
"""Position, velocity, acceleration, jerk."""


@dataclass(frozen=True, eq=False)
class Extremes:
    """Extremes of the columns of a motion; the first axis is position, velocity, acceleration, jerk.

    Args:
        peaks: Highest value of each column, its time [s], lowest value, its time [s]; shape (4, nq, 4).
        jumps: Largest jumps of position, velocity and acceleration at breaks, and their times [s]; shape (3, nq, 2).
        end: Value at the last instant, shape (4, nq).
    """

    peaks: Array
    jumps: Array
    end: Array

    @property
    def high(self) -> Array:
        """Highest value of each column, shape (4, nq)."""
        return self.peaks[:, :, 0]

    @property
    def high_time(self) -> Array:
        """Time of the highest value [s], shape (4, nq)."""
        return self.peaks[:, :, 1]

    @property
    def low(self) -> Array:
        """Lowest value of each column, shape (4, nq)."""
        return self.peaks[:, :, 2]

    @property
    def low_time(self) -> Array:
        """Time of the lowest value [s], shape (4, nq)."""
        return self.peaks[:, :, 3]


def extremes(breaks: Array, coefficients: Array) -> Extremes:
    """Highest and lowest values of every column and its rates, and jumps between pieces.

    Args:
        breaks: Times of the breaks [s], shape (m + 1,), or (1,) for a duration of zero.
        coefficients: Local coefficients, lowest power first, shape (m, d + 1, nq).

    Returns:
        Values to 1e-13 relative, and the first time at which each is reached.
    """
    breaks, coefficients = np.ascontiguousarray(breaks), np.ascontiguousarray(coefficients)
    terms, nq = coefficients.shape[1:]
    peaks, jumps, end = np.empty((ORDERS, nq, 4)), np.empty((ORDERS - 1, nq, 2)), np.empty((ORDERS, nq))
    scratch = np.empty(terms * (SOURCES.constants["EXTREMES_DEPTH"] + 24 + ORDERS * terms))
    # As rows of structs.
    rows = peaks.reshape(-1, 4), jumps.reshape(-1, 2)
    load_library().rr1_find_extremes(breaks, len(breaks), coefficients, *coefficients.shape, *rows, end, scratch)
    return Extremes(peaks, jumps, end)
