"""Exact bounds of polynomials, against dense samples."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from slow_certificate.polynomial_bounds import RangeTable, bernstein, evaluate

SEEDS = st.integers(0, 2**32 - 1)


def random_pieces(seed: int) -> tuple[np.ndarray, np.ndarray, np.random.Generator]:
    rng = np.random.default_rng(seed)
    m, degree, nq = rng.integers(1, 6), rng.integers(0, 6), rng.integers(1, 4)
    breaks = np.cumsum(rng.uniform(0.01, 2.0, m + 1))
    return breaks, rng.normal(size=(m, degree + 1, nq)), rng


@given(SEEDS)
@settings(deadline=None, max_examples=40)
def test_a_polynomial_stays_between_its_bernstein_coefficients(seed: int) -> None:
    _, coefficients, rng = random_pieces(seed)
    a, b = np.sort(rng.uniform(0.0, 2.0, (2, len(coefficients))), axis=0)
    control = bernstein(coefficients, a, b)
    for s in np.linspace(0.0, 1.0, 21):
        value = evaluate(coefficients, a + s * (b - a))
        assert (value <= control.max(axis=1) + 1e-12).all()
        assert (value >= control.min(axis=1) - 1e-12).all()
    np.testing.assert_allclose(control[:, 0], evaluate(coefficients, a), atol=1e-12)
    np.testing.assert_allclose(control[:, -1], evaluate(coefficients, b), atol=1e-12)


@given(SEEDS)
@settings(deadline=None, max_examples=40)
def test_ranges_over_runs_of_pieces_are_those_of_all_their_pieces(seed: int) -> None:
    rng = np.random.default_rng(seed)
    m = int(rng.integers(1, 40))
    lower = rng.normal(size=(m, 2))
    upper = lower + rng.uniform(0.0, 1.0, (m, 2))
    first = rng.integers(0, m, 20)
    stop = np.array([rng.integers(f + 1, m + 1) for f in first])
    low, high = RangeTable(lower, upper).over(first, stop)
    for k in range(20):
        np.testing.assert_array_equal(low[k], lower[first[k] : stop[k]].min(axis=0))
        np.testing.assert_array_equal(high[k], upper[first[k] : stop[k]].max(axis=0))
