"""Exact peaks of piecewise polynomials: roots of derivatives in closed form, no sampling.

A peak of |p(t)| on [0, T] lies at an end or where p' is zero. Every trajectory here has degree
four at most in position, so p' of a velocity is a quadratic at most and its roots are a formula.
"""

from __future__ import annotations

import numpy as np

from rr1plan.checks import Array

MAX_DEGREE = 4


def differentiate(coefficients: Array, order: int = 1) -> Array:
    """Local coefficients of a derivative, lowest power first, shape (m, k + 1 - order or 1, n)."""
    for _ in range(order):
        powers = np.arange(1, coefficients.shape[1])[None, :, None]
        coefficients = coefficients[:, 1:] * powers if coefficients.shape[1] > 1 else np.zeros_like(coefficients)
    return coefficients


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
    rate = differentiate(coefficients, derivative)
    end = durations[:, None]
    best = np.maximum(np.abs(rate[:, 0]), np.abs(evaluate(rate, end)))
    for root in _roots(differentiate(rate)):
        inside = np.clip(np.nan_to_num(root, nan=0.0, posinf=0.0, neginf=0.0), 0.0, end)
        best = np.maximum(best, np.abs(evaluate(rate, inside)))
    return best


def _roots(coefficients: Array) -> list[Array]:
    """Real roots of polynomials of degree two at most, shape (m, n) each; NaN or infinity where there is none."""
    degree = coefficients.shape[1] - 1
    if degree == 0:
        return []
    c, b = coefficients[:, 0], coefficients[:, 1]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        if degree == 1:
            return [-c / b]
        a = coefficients[:, 2]
        # the form without cancellation; a = 0 gives the linear root through c / q
        q = -0.5 * (b + np.copysign(np.sqrt(b * b - 4.0 * a * c), b))
        return [q / a, c / q]
