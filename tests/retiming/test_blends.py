from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rr1plan.retiming.path_blends import HALVINGS, blend_sizes, clean, curves

CORNER = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 2.0]])


def along(curve):
    """Positions, derivatives and arc positions sampled on every piece."""
    for length, c in zip(curve.lengths, curve.coefficients, strict=True):
        s = np.linspace(0.0, length, 50)[:, None]
        yield c[0] + s * (c[1] + s * c[2]), c[1] + 2.0 * s * c[2]


def test_duplicates_are_dropped_and_ends_stay_exact():
    points = clean(np.array([[0.0, 0.0], [1e-10, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 1.0], [1.0, 1.0 + 1e-10]]))
    np.testing.assert_array_equal(points, [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0 + 1e-10]])


def test_waypoints_on_a_straight_line_are_dropped():
    points = clean(np.concatenate([np.linspace([0.0, 0.0], [1.0, 2.0], 300), [[0.0, 5.0]]]))
    np.testing.assert_allclose(points, [[0.0, 0.0], [1.0, 2.0], [0.0, 5.0]])


def test_a_slow_bend_is_not_taken_for_a_straight_line():
    angle = np.linspace(0.0, 1.0, 2000)
    arc = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = clean(arc)
    nearest = np.abs(np.linalg.norm(0.5 * (points[1:] + points[:-1]), axis=1) - 1.0).max()
    assert nearest < 1e-6


def test_a_reversal_on_the_same_line_keeps_its_turning_point():
    np.testing.assert_array_equal(clean(np.array([[0.0], [1.0], [0.5]])), [[0.0], [1.0], [0.5]])


def test_one_point_and_all_the_same_points_are_one():
    assert clean(np.zeros((1, 3))).shape == (1, 3)
    assert clean(np.zeros((5, 3))).shape == (1, 3)


def test_a_blend_is_at_most_half_its_neighbors_and_the_given_size():
    assert blend_sizes(CORNER, 10.0, None)[1] == pytest.approx(0.5)
    assert blend_sizes(CORNER, 0.1, None)[1] == pytest.approx(0.1)


def test_a_blend_is_halved_until_it_is_certified(tools):
    checker = tools.Certifier(lambda c, d: d <= 0.3)
    assert blend_sizes(CORNER, 0.5, checker)[1] == pytest.approx(0.125)
    assert [d for _, d in checker.asked] == pytest.approx([1.0, 0.5, 0.25])


def test_the_certifier_is_asked_about_exactly_the_blend_that_is_driven(tools):
    checker = tools.Certifier()
    (curve,) = curves(CORNER, blend_sizes(CORNER, 0.5, checker))
    asked, duration = checker.asked[-1]
    np.testing.assert_array_equal(asked, curve.coefficients[1 if len(curve.lengths) == 3 else 0])
    assert duration in curve.lengths


def test_what_is_never_certified_becomes_a_stop(tools):
    checker = tools.Certifier(lambda c, d: False)
    sizes = blend_sizes(CORNER, 0.5, checker)
    assert sizes[1] == 0.0
    assert len(checker.asked) == HALVINGS
    assert [c.corners for c in curves(CORNER, sizes)] == [(0, 1), (1, 2)]


def test_a_reversal_is_a_stop_and_needs_no_certificate(tools):
    checker = tools.Certifier()
    assert blend_sizes(np.array([[0.0, 0.0], [1.0, 0.0], [0.2, 0.0]]), 0.3, checker)[1] == 0.0
    assert not checker.asked


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 2**32 - 1), st.integers(2, 7), st.integers(3, 9), st.floats(0.01, 3.0))
def test_blends_are_smooth_and_stay_in_their_corridor(seed, nq, n, max_blend):
    points = np.random.default_rng(seed).uniform(-2.0, 2.0, (n, nq))
    sizes = blend_sizes(points, max_blend, None)
    last_q, last_d, end = points[0], None, None
    for curve in curves(points, sizes):
        for q, d in along(curve):
            np.testing.assert_allclose(q[0], last_q, atol=1e-12)
            if last_d is not None:
                np.testing.assert_allclose(d[0], last_d, atol=1e-9)
            last_q, last_d = q[-1], d[-1]
            assert q.min() >= points.min() - 1e-12
            assert q.max() <= points.max() + 1e-12
        last_d, end = None, curve.corners[1]
    np.testing.assert_allclose(last_q, points[-1], atol=1e-12)
    assert end == n - 1


def test_a_parabola_leaves_its_corner_by_what_the_formula_says(tools):
    (curve,) = curves(CORNER, np.array([0.0, 0.4, 0.0]))
    q = np.concatenate([q for q, _ in along(curve)])
    assert np.linalg.norm(q - CORNER[1], axis=1).min() == pytest.approx(0.4 * np.sqrt(2.0) / 4.0, rel=2e-3)
    assert tools.distance_to_polyline(q, CORNER).max() <= 0.2
