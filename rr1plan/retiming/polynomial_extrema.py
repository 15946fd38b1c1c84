"""Exact extrema of piecewise polynomials: roots of derivatives in closed form, no sampling.

A maximum of |p(t)| on [0, T] lies at an end or where p' is zero. All trajectories of the retiming methods
have at most degree four, so p' of a velocity is at most quadratic and its roots have a closed form.
"""

from __future__ import annotations

import numpy as np

from rr1plan.checks import Array
from rr1plan.kernels.planner_kernels import load_library

MAX_DEGREE = 4


def evaluate(coefficients: Array, t: Array) -> Array:
    """Values of m polynomials for n columns at local times t (m, n) or (m, 1), shape (m, n)."""
    value = np.zeros(np.broadcast_shapes(coefficients[:, 0].shape, t.shape))
    for k in range(coefficients.shape[1] - 1, -1, -1):
        value = value * t + coefficients[:, k]
    return value


def peaks(coefficients: Array, durations: Array, derivative: int) -> Array:
    """Largest absolute value of a derivative on each piece.

    Args:
        coefficients: Local polynomial coefficients of position, lowest power first, shape (m, k + 1, n), k <= 4.
        durations: Length of each piece [s], shape (m,).
        derivative: 1 velocity, 2 acceleration, 3 jerk.

    Returns:
        Shape (m, n) [rad/s^derivative].
    """
    assert coefficients.shape[1] - 1 <= MAX_DEGREE
    assert derivative >= 1
    coefficients, durations = np.ascontiguousarray(coefficients), np.ascontiguousarray(durations)
    out = np.empty((coefficients.shape[0], coefficients.shape[2]))
    load_library().rr1_find_peaks(coefficients, durations, *coefficients.shape, derivative, out)
    return out
