"""Grids along lines and parabolas: whole, fine where the derivative is small, and halved."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from rr1plan._kernels.blended import largest_blends, round_corners
from rr1plan._kernels.path_grid import halve_intervals, make_grid

STEP = 0.2


def random_curve(seed, nq):
    """A rounded polyline, some of its corners all but reversals, and limits of velocity and acceleration."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(size=(5, nq))
    steps[2] = -steps[1] + 10.0 ** rng.uniform(-2.0, 0.0) * rng.normal(size=nq)
    points = np.cumsum(np.vstack([np.zeros(nq), steps]), axis=0)
    lengths, coefficients, _ = round_corners(points, largest_blends(points, 0.3, 1e-3, 1e-8), 1e-9)
    return lengths, coefficients, *(10.0 ** rng.uniform(-1.5, 1.5, (2, nq)))


curves = given(seed=st.integers(0, 2**32 - 1), nq=st.integers(2, 14))


@curves
@settings(deadline=None, max_examples=50)
def test_intervals_follow_one_another_over_every_piece(seed, nq):
    lengths, coefficients, velocity, acceleration = random_curve(seed, nq)
    piece, offset, delta = make_grid(lengths, coefficients, velocity, acceleration, STEP, lengths)
    for i, length in enumerate(lengths):
        own = piece == i
        np.testing.assert_allclose(offset[own], np.cumsum(delta[own]) - delta[own], atol=1e-12 * length)
        assert np.isclose(delta[own].sum(), length, rtol=1e-12)
        assert (delta[own] > 0.0).all()
        if not coefficients[i, 2].any():
            assert own.sum() == 1


@curves
@settings(deadline=None, max_examples=50)
def test_the_derivative_changes_little_within_an_interval(seed, nq):
    lengths, coefficients, velocity, acceleration = random_curve(seed, nq)
    piece, offset, delta = make_grid(lengths, coefficients, velocity, acceleration, STEP, lengths)
    for limit in (velocity, acceleration):
        middle = coefficients[piece, 1] + 2.0 * (offset + 0.5 * delta)[:, None] * coefficients[piece, 2]
        change = 2.0 * (np.abs(coefficients[piece, 2]) / limit).max(axis=1) * delta
        size = (np.abs(middle) / limit).max(axis=1)
        ends = [
            (np.abs(coefficients[:, 1] + 2.0 * s * coefficients[:, 2]) / limit).max(axis=1)
            for s in (0.0, lengths[:, None])
        ]
        most = np.maximum(*ends)[piece]
        # half as much again for where the middle is not the place that was looked at
        shortest = (delta * 250.0 <= lengths[piece]) | (change == 0.0)
        assert (shortest | (change <= 1.5 * STEP * np.sqrt(np.maximum(size, 0.02 * most) * most))).all()


def test_no_interval_is_longer_than_it_may_be():
    lengths, coefficients, velocity, acceleration = random_curve(0, 6)
    piece, _, delta = make_grid(lengths, coefficients, velocity, acceleration, STEP, lengths / 7.0)
    assert (delta <= lengths[piece] / 7.0 * (1.0 + 1e-9)).all()


def test_joints_without_limits_ask_for_no_more_than_the_middle_of_a_parabola():
    lengths, coefficients, _, _ = random_curve(0, 3)
    free = np.full(3, np.inf)
    piece, _, _ = make_grid(lengths, coefficients, free, free, STEP, lengths)
    np.testing.assert_array_equal(np.bincount(piece), np.where(coefficients[:, 2].any(axis=1), 2, 1))


def test_halving_cuts_bent_pieces_alone():
    lengths, coefficients, velocity, acceleration = random_curve(1, 4)
    grid = make_grid(lengths, coefficients, velocity, acceleration, STEP, lengths)
    piece, offset, delta = halve_intervals(coefficients, *grid)
    bent = coefficients[:, 2].any(axis=1)
    counts = np.bincount(grid[0])
    np.testing.assert_array_equal(np.bincount(piece), np.where(bent, 2 * counts, counts))
    assert np.isin(grid[1][bent[grid[0]]], offset).all()
    np.testing.assert_allclose(np.bincount(piece, delta), lengths)
