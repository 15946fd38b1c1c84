"""Grids along lines and parabolas: whole, fine where the derivative is small, and halved."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

import rr1plan as rp
from rr1plan.retiming.path_blends import Curve, blend_sizes, round_corners
from rr1plan.retiming.path_speed import make_grid

STEP = 0.1  # how much the derivative may change in an interval, of `rr1plan.retiming.path_speed.make_grid`


def random_curve(seed, nq):
    """A rounded polyline with some corners that are almost reversals, and limits of velocity and acceleration."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(size=(5, nq))
    steps[2] = -steps[1] + 10.0 ** rng.uniform(-2.0, 0.0) * rng.normal(size=nq)
    points = np.cumsum(np.vstack([np.zeros(nq), steps]), axis=0)
    lengths, coefficients, _ = round_corners(points, blend_sizes(points, 0.3, None))
    return Curve(lengths, coefficients, (0, 5)), *(10.0 ** rng.uniform(-1.5, 1.5, (2, nq)))


def grid_of(curve, velocity, acceleration, longest=None):
    end, none = np.full(len(velocity), np.inf), np.full(len(velocity), np.inf)
    limits = rp.Limits(-end, end, velocity, acceleration, none, none)
    return make_grid(curve, limits, curve.lengths if longest is None else longest)


curves = given(seed=st.integers(0, 2**32 - 1), nq=st.integers(2, 14))


@curves
@settings(deadline=None, max_examples=50)
def test_intervals_follow_one_another_over_every_piece(seed, nq):
    curve, velocity, acceleration = random_curve(seed, nq)
    piece, offset, delta = grid_of(curve, velocity, acceleration)
    for i, length in enumerate(curve.lengths):
        own = piece == i
        np.testing.assert_allclose(offset[own], np.cumsum(delta[own]) - delta[own], atol=1e-12 * length)
        assert np.isclose(delta[own].sum(), length, rtol=1e-12)
        assert (delta[own] > 0.0).all()
        if not curve.coefficients[i, 2].any():
            assert own.sum() == 1


@curves
@settings(deadline=None, max_examples=50)
def test_the_derivative_changes_little_within_an_interval(seed, nq):
    curve, velocity, acceleration = random_curve(seed, nq)
    piece, offset, delta = grid_of(curve, velocity, acceleration)
    for limit in (velocity, acceleration):
        middle = curve.coefficients[piece, 1] + 2.0 * (offset + 0.5 * delta)[:, None] * curve.coefficients[piece, 2]
        change = 2.0 * (np.abs(curve.coefficients[piece, 2]) / limit).max(axis=1) * delta
        size = (np.abs(middle) / limit).max(axis=1)
        ends = [
            (np.abs(curve.coefficients[:, 1] + 2.0 * s * curve.coefficients[:, 2]) / limit).max(axis=1)
            for s in (0.0, curve.lengths[:, None])
        ]
        most = np.maximum(*ends)[piece]
        # half as much again for middles that differ from the tested place
        shortest = (delta * 250.0 <= curve.lengths[piece]) | (change == 0.0)
        assert (shortest | (change <= 1.5 * STEP * np.sqrt(np.maximum(size, 0.02 * most) * most))).all()


def test_no_interval_is_longer_than_it_may_be():
    curve, velocity, acceleration = random_curve(0, 6)
    piece, _, delta = grid_of(curve, velocity, acceleration, curve.lengths / 7.0)
    assert (delta <= curve.lengths[piece] / 7.0 * (1.0 + 1e-9)).all()


def test_joints_without_limits_ask_for_no_more_than_the_middle_of_a_parabola():
    curve, _, _ = random_curve(0, 3)
    free = np.full(3, np.inf)
    piece, _, _ = grid_of(curve, free, free)
    np.testing.assert_array_equal(np.bincount(piece), np.where(curve.coefficients[:, 2].any(axis=1), 2, 1))
