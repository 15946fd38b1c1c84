"""The linear programs of the compiled passes against scipy's, on any rows at all."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from rr1plan.kernels.planner_kernels import CStruct, load_library

rows = st.lists(
    st.tuples(st.floats(0.0, 10.0).map(lambda a: round(a, 3)), st.floats(-10.0, 10.0).map(lambda b: round(b, 3))),
    min_size=1,
    max_size=20,
)


def highest_speed(alpha, beta, high):
    return load_library().rr1_highest_speed(alpha, beta, len(alpha), high)


def next_speed(alpha, beta, x, high):
    return load_library().rr1_next_speed(alpha, beta, len(alpha), x, high)


def best_of_scipy(alpha, beta, high, objective, fixed=None):
    both = np.column_stack([alpha, beta])
    bounds = [(0.0, None) if fixed is None else (fixed, fixed), (0.0, high)]
    solved = linprog(objective, np.vstack([both, -both]), np.ones(2 * len(both)), bounds=bounds)
    assert solved.status == 0
    return solved.x


@settings(deadline=None, max_examples=300)
@given(rows, st.floats(0.01, 10.0), st.floats(0.001, 10.0))
def test_the_highest_speed_is_that_of_a_linear_program(pairs, top, high):
    alpha, beta = np.array([*pairs, (1.0 / top, 0.0)]).T.copy()
    found = highest_speed(alpha, beta, high)
    assert found == pytest.approx(best_of_scipy(alpha, beta, high, [-1.0, 0.0])[0], rel=1e-6, abs=1e-9)


@settings(deadline=None, max_examples=200)
@given(rows, st.floats(0.01, 10.0), st.floats(0.001, 10.0), st.floats(0.0, 1.0))
def test_the_next_speed_is_that_of_a_linear_program(pairs, top, high, share):
    alpha, beta = np.array([*pairs, (1.0 / top, 0.0)]).T.copy()
    x = share * highest_speed(alpha, beta, high)
    x *= 1.0 - 1e-7  # scipy's own tolerance
    expected = best_of_scipy(alpha, beta, high, [0.0, -1.0], fixed=x)[1]
    assert next_speed(alpha, beta, x, high) == pytest.approx(expected, rel=1e-5, abs=1e-6)


def test_rows_whose_terms_nearly_cancel_bound_one_speed_alone():
    # |1e-17 x + y| <= 1 is a bound of y; taken for one of x it would be lost in rounding
    alpha, beta = np.array([1e-17, 0.5]), np.array([1.0, -0.5])
    assert highest_speed(alpha, beta, 9.0) == pytest.approx(3.0)
    assert next_speed(alpha, beta, 3.0, 9.0) == pytest.approx(1.0)


def test_rows_are_the_limits_at_both_ends_and_between():
    rng = np.random.default_rng(0)
    piece, velocity, acceleration = rng.normal(size=(3, 4)), rng.uniform(1, 2, 4), rng.uniform(1, 2, 4)
    alpha, beta = np.zeros(13), np.zeros(13)
    offset, delta, x, y = 0.3, 0.2, 0.7, 1.1
    curve = CStruct("PathCurve", lengths=np.ones(1), coefficients=piece.ravel(), count=1, column_count=4)
    limits = CStruct(
        "RateLimits",
        velocity=velocity,
        acceleration=acceleration,
        inverse_velocity=1.0 / velocity,
        inverse_acceleration=1.0 / acceleration,
    )
    load_library().rr1_fill_rows(curve, offset, delta, limits, alpha, beta)
    u = (y - x) / (2.0 * delta)
    at = [offset, offset + delta]
    expected = [
        abs((piece[1] + 2 * s * piece[2]) * u + 2 * piece[2] * v) / acceleration
        for s, v in zip(at, (x, y), strict=True)
    ]
    np.testing.assert_allclose(np.abs(alpha * x + beta * y)[:8], np.concatenate(expected))
    assert (alpha >= 0.0).all()
    for k, share in enumerate((0.125, 0.375, 0.625, 0.875)):
        first = piece[1] + 2 * (offset + share * delta) * piece[2]
        fraction = (np.abs(first) / velocity).max() ** 2 * (x + share * (y - x))
        assert (alpha * x + beta * y)[8 + k] == pytest.approx(fraction)
