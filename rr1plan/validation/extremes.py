"""Exact extremes of piecewise polynomials and of their rates, by their Bernstein coefficients (`extremes.c`)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rr1plan.checks import Array
from rr1plan.validation.native import SOURCES, load_library

ORDERS = 4
"""Position, velocity, acceleration, jerk."""


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
    breaks, coefficients = np.ascontiguousarray(breaks), np.ascontiguousarray(coefficients)
    terms, nq = coefficients.shape[1:]
    peaks, jumps, end = np.zeros((ORDERS * nq, 4)), np.zeros(((ORDERS - 1) * nq, 2)), np.zeros((ORDERS, nq))
    scratch = np.empty(terms * (SOURCES.constants["EXTREMES_DEPTH"] + 2))
    load_library().rr1_find_extremes(breaks, len(breaks), coefficients, *coefficients.shape, peaks, jumps, end, scratch)
    high, high_time, low, low_time = peaks.T.reshape(4, ORDERS, nq)
    jump, jump_time = jumps.T.reshape(2, ORDERS - 1, nq)
    return Extremes(high, high_time, low, low_time, jump, jump_time, end)
