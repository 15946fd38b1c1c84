from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rr1plan.retiming.polynomial_extrema import peaks

# hundredths: companion matrices lose roots next to leading coefficients like 1e-131
numbers = st.integers(-500, 500).map(lambda n: n / 100.0)


@settings(deadline=None, max_examples=200)
@given(st.lists(numbers, min_size=5, max_size=5), st.floats(1e-3, 3.0), st.integers(1, 3))
def test_peaks_agree_with_dense_samples_and_with_companion_matrices(row, duration, derivative):
    rate = np.polynomial.Polynomial(row).deriv(derivative)
    found = peaks(np.array(row)[None, :, None], np.array([duration]), derivative)[0, 0]
    sampled = np.abs(rate(np.linspace(0.0, duration, 2001))).max()
    roots = [r.real for r in np.atleast_1d(rate.deriv().roots()) if abs(r.imag) < 1e-7 and 0.0 <= r.real <= duration]
    exact = max(abs(rate(t)) for t in [0.0, duration, *roots])
    assert found >= sampled - 1e-9
    assert found == pytest.approx(exact, rel=1e-6, abs=1e-6)


def test_a_peak_inside_a_piece_is_found_between_samples():
    # q = t - t³ / 3 has velocity 1 - t², acceleration -2 t; on [-] of 2 s the velocity ends at -3
    coefficients = np.array([0.0, 1.0, 0.0, -1.0 / 3.0])[None, :, None]
    assert peaks(coefficients, np.array([2.0]), 1)[0, 0] == pytest.approx(3.0)
    # velocity t - t² peaks at t = 1/2 with 1/4
    coefficients = np.array([0.0, 0.0, 0.5, -1.0 / 3.0])[None, :, None]
    assert peaks(coefficients, np.array([1.0]), 1)[0, 0] == pytest.approx(0.25, abs=1e-15)


@pytest.mark.parametrize("columns", [1, 2, 3, 4, 5])
def test_any_degree_up_to_four_is_taken(columns):
    coefficients = np.ones((2, columns, 3))
    for derivative in (1, 2, 3):
        rate = np.polynomial.Polynomial(np.ones(columns)).deriv(derivative)
        np.testing.assert_allclose(peaks(coefficients, np.array([1.0, 2.0]), derivative)[:, 0], [rate(1.0), rate(2.0)])
