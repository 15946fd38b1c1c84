"""The compiled extremes of polynomials and of their rates, against numpy's root finder."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial import Polynomial

from rr1plan.validation.bernstein_extremes import ORDERS, extremes

SEEDS = st.integers(0, 2**32 - 1)


def random_pieces(seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    m, degree, nq = rng.integers(1, 6), rng.integers(0, 7), rng.integers(1, 4)
    return np.cumsum(rng.uniform(0.01, 2.0, m + 1)), rng.normal(size=(m, degree + 1, nq))


def rate_of(coefficients: np.ndarray, order: int) -> Polynomial:
    return Polynomial(coefficients).deriv(order)


def extremes_by_roots(p: Polynomial, width: float) -> tuple[float, float]:
    at = [0.0, width]
    if p.degree() > 1:
        at += [z.real for z in p.deriv().roots() if abs(z.imag) < 1e-6 and 0.0 <= z.real <= width]
    values = [float(p(t)) for t in at]
    return min(values), max(values)


def value_at(breaks: np.ndarray, coefficients: np.ndarray, order: int, time: float) -> list[float]:
    """The value of one column at a time: of both pieces at a break."""
    pieces = [i for i in range(len(coefficients)) if breaks[i] - 1e-12 <= time <= breaks[i + 1] + 1e-12]
    return [float(rate_of(coefficients[i], order)(time - breaks[i])) for i in pieces]


@given(SEEDS)
@settings(deadline=None, max_examples=80)
def test_extremes_are_those_that_the_roots_of_the_derivative_give(seed: int) -> None:
    breaks, coefficients = random_pieces(seed)
    found = extremes(breaks, coefficients)
    for order in range(ORDERS):
        for j in range(coefficients.shape[2]):
            rates = [rate_of(c[:, j], order) for c in coefficients]
            ends = [extremes_by_roots(p, w) for p, w in zip(rates, np.diff(breaks), strict=True)]
            scale = max(1.0, *(abs(v) for pair in ends for v in pair))
            for value, time, want in (
                (found.high[order, j], found.high_time[order, j], max(high for _, high in ends)),
                (found.low[order, j], found.low_time[order, j], min(low for low, _ in ends)),
            ):
                assert value == pytest.approx(want, rel=1e-11, abs=1e-11 * scale)
                assert min(abs(v - want) for v in value_at(breaks, coefficients[:, :, j], order, time)) < 1e-7 * scale


@given(SEEDS)
@settings(deadline=None, max_examples=40)
def test_jumps_and_ends_are_those_of_the_pieces(seed: int) -> None:
    breaks, coefficients = random_pieces(seed)
    found = extremes(breaks, coefficients)
    for order in range(ORDERS):
        for j in range(coefficients.shape[2]):
            rates = [rate_of(c[:, j], order) for c in coefficients]
            after = [float(p(w)) for p, w in zip(rates, np.diff(breaks), strict=True)]
            assert found.end[order, j] == pytest.approx(after[-1], rel=1e-10, abs=1e-8)
            jumps = [abs(float(p(0.0)) - end) for p, end in zip(rates[1:], after[:-1], strict=True)]
            if order < ORDERS - 1 and max(jumps, default=0.0) > 1e-6:
                assert found.jumps[order, j, 0] == pytest.approx(max(jumps), rel=1e-9, abs=1e-8)
                assert found.jumps[order, j, 1] == breaks[1 + int(np.argmax(jumps))]


def test_a_plateau_of_many_equal_pieces_has_its_value_as_peak() -> None:
    coefficients = np.tile(np.array([[[0.7]], [[0.7]]]), (500, 1, 1))
    assert extremes(np.arange(1001.0), coefficients).high[0] == pytest.approx([0.7], rel=1e-15)


def test_a_peak_that_is_flat_to_rounding_does_not_keep_the_search_busy() -> None:
    flat = -(Polynomial([-1.0, 1.0]) ** 8) + Polynomial([1e-9])
    found = extremes(np.array([0.0, 2.0]), flat.coef[None, :, None])
    assert found.high[0, 0] == pytest.approx(0.0, abs=1e-8)
    assert found.low[0, 0] == pytest.approx(-1.0, abs=1e-8)


def test_the_first_of_several_equal_peaks_is_told() -> None:
    hump = np.array([[0.0, 4.0, -4.0]])
    found = extremes(np.array([1.0, 2.0, 3.0]), np.repeat(hump, 2, axis=0)[:, :, None])
    assert (found.high[0, 0], found.high_time[0, 0]) == (1.0, pytest.approx(1.5))
    assert (found.low[0, 0], found.low_time[0, 0]) == (0.0, 1.0)


def test_a_duration_of_zero_has_its_only_value_as_both_extremes() -> None:
    found = extremes(np.array([3.0]), np.array([[[0.25], [9.0]]]))
    assert (found.high[0, 0], found.low[0, 0], found.high_time[0, 0]) == (0.25, 0.25, 3.0)


def test_columns_may_be_none() -> None:
    assert extremes(np.array([0.0, 1.0]), np.zeros((1, 1, 0))).high.shape == (ORDERS, 0)
