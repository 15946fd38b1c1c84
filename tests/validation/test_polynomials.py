"""Exact bounds of polynomials, against numpy's root finder and dense samples."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rr1plan.validation.polynomials import RangeTable, bernstein, derivative, evaluate, peaks

SEEDS = st.integers(0, 2**32 - 1)


def random_pieces(seed: int) -> tuple[np.ndarray, np.ndarray, np.random.Generator]:
    rng = np.random.default_rng(seed)
    m, degree, nq = rng.integers(1, 6), rng.integers(0, 6), rng.integers(1, 4)
    breaks = np.cumsum(rng.uniform(0.01, 2.0, m + 1))
    return breaks, rng.normal(size=(m, degree + 1, nq)), rng


def peak_by_roots(coefficients: np.ndarray, width: float) -> float:
    p = np.polynomial.Polynomial(coefficients)
    at = [0.0, width]
    if len(coefficients) > 2:
        at += [z.real for z in p.deriv().roots() if abs(z.imag) < 1e-6 and 0.0 <= z.real <= width]
    return max(float(p(t)) for t in at)


@given(SEEDS)
@settings(deadline=None, max_examples=60)
def test_the_peak_is_the_one_that_the_roots_of_the_derivative_give(seed: int) -> None:
    breaks, coefficients, _ = random_pieces(seed)
    found = peaks(coefficients, breaks)
    for j in range(coefficients.shape[2]):
        want = max(peak_by_roots(c[:, j], w) for c, w in zip(coefficients, np.diff(breaks), strict=True))
        assert found.value[j] == pytest.approx(want, rel=1e-11, abs=1e-11)
        i = min(int(np.searchsorted(breaks, found.time[j], side="right")) - 1, len(coefficients) - 1)
        at_time = [
            float(np.polynomial.Polynomial(coefficients[k, :, j])(found.time[j] - breaks[k]))
            for k in {i, max(0, i - 1)}
        ]
        assert min(abs(v - want) for v in at_time) < 1e-7


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


def test_a_plateau_of_many_equal_pieces_has_its_value_as_peak() -> None:
    coefficients = np.tile(np.array([[[0.7]], [[0.7]]]), (500, 1, 1))
    assert peaks(coefficients, np.arange(1001.0)).value == pytest.approx([0.7], rel=1e-15)


def test_a_duration_of_zero_has_its_only_value_as_peak() -> None:
    assert peaks(np.array([[[0.25], [9.0]]]), np.array([3.0])).value == pytest.approx([0.25])


def test_the_derivative_of_a_cubic_is_its_quadratic() -> None:
    got = derivative(np.array([1.0, 2.0, 3.0, 4.0])[None, :, None])
    np.testing.assert_array_equal(got[0, :, 0], [2.0, 6.0, 12.0])
    np.testing.assert_array_equal(derivative(np.ones((2, 1, 3))), np.zeros((2, 1, 3)))


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
