"""The compiled motion along a rounded polyline against its parts, one curve after the other."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

import rr1plan as rp
from rr1plan.retiming.path_blends import DUPLICATE, blend_at, blend_sizes, round_corners
from rr1plan.retiming.path_speed import line_rates, time_polyline

polylines = given(seed=st.integers(0, 2**32 - 1), nq=st.integers(1, 6), m=st.integers(2, 7))


def limits_of(nq, velocity=1.0, acceleration=2.0):
    rates = {"velocity": velocity, "acceleration": acceleration, "jerk": np.inf, "effort": np.inf}
    ends = {"lower": np.full(nq, -np.inf), "upper": np.full(nq, np.inf)}
    return rp.Limits(
        **ends, **{name: np.broadcast_to(np.asarray(value, float), (nq,)) for name, value in rates.items()}
    )


def random_polyline(seed, nq, m):
    """Waypoints, blends at some of them, limits of velocity and acceleration."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-2.0, 2.0, (m, nq))
    sizes = blend_sizes(points, 10.0 ** rng.uniform(-2.0, 0.5), None)
    sizes[rng.random(m) < 0.3] = 0.0
    return points, sizes, limits_of(nq, *(10.0 ** rng.uniform(-1.0, 1.0, (2, nq))))


def slow_pieces(points, sizes):
    """Lines and parabolas between the waypoints, by the formulas."""
    steps = np.diff(points, axis=0)
    edges = np.linalg.norm(steps, axis=1)
    unit = steps / edges[:, None]
    for i in range(len(unit)):
        line = edges[i] - sizes[i] - sizes[i + 1]
        if line > DUPLICATE * edges[i]:
            yield line, np.stack([points[i] + sizes[i] * unit[i], unit[i], 0.0 * unit[i]])
        if sizes[i + 1] > 0.0:
            r = sizes[i + 1]
            yield 2.0 * r, np.stack([points[i + 1] - r * unit[i], unit[i], (unit[i + 1] - unit[i]) / (4.0 * r)])


def stopping_duration(points, limits):
    """Time from one waypoint to the next with a stop at each: trapezoidal or triangular profiles."""
    steps = np.diff(points, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    speed, pull, _ = line_rates(steps / lengths[:, None], limits)
    peak = np.minimum(speed, np.sqrt(pull * lengths))
    return float((lengths / peak + peak / pull).sum())


@polylines
@settings(deadline=None, max_examples=40)
def test_rounded_corners_are_lines_and_parabolas_that_join(seed, nq, m):
    points, sizes, _ = random_polyline(seed, nq, m)
    lengths, coefficients, before = round_corners(points, sizes)
    expected = list(slow_pieces(points, sizes))
    np.testing.assert_allclose(lengths, [length for length, _ in expected], rtol=1e-12)
    np.testing.assert_allclose(coefficients, [c for _, c in expected], atol=1e-9)
    for i in np.flatnonzero(sizes):
        np.testing.assert_array_equal(blend_at(points, int(i), sizes[i]), coefficients[before[i]])


@polylines
@settings(deadline=None, max_examples=40)
def test_the_motion_is_that_of_its_parts_between_stops(seed, nq, m):
    points, sizes, limits = random_polyline(seed, nq, m)
    made = time_polyline(points, sizes, limits)
    total, bent = 0.0, False
    for first, last in pairwise(np.flatnonzero(sizes == 0.0)):
        some = slice(first, last + 1)
        part = time_polyline(points[some], sizes[some], limits)
        slowest = stopping_duration(points[some], limits)
        assert part.durations.sum() <= slowest * (1.0 + 1e-9)
        if last - first == 1:
            assert np.isclose(part.durations.sum(), slowest, rtol=1e-9)
        total += part.durations.sum()
        bent |= part.coefficients.shape[1] > 3
    assert np.isclose(made.durations.sum(), total, rtol=1e-9)
    assert (made.coefficients.shape[1] > 3) == bent
    np.testing.assert_allclose(made.coefficients[0, 0], points[0], atol=1e-12)


def test_more_pieces_than_there_is_room_for_at_first_are_no_matter():
    rng = np.random.default_rng(0)
    points = np.cumsum(rng.normal(size=(400, 7)), axis=0)
    sizes = blend_sizes(points, 0.3, None)
    made = time_polyline(points, sizes, limits_of(7))
    assert len(made.durations) > 1000
    np.testing.assert_allclose(made.coefficients[0, 0], points[0], atol=1e-12)
    powers = made.durations[-1] ** np.arange(made.coefficients.shape[1])
    np.testing.assert_allclose(powers @ made.coefficients[-1], points[-1], atol=1e-9)


def test_the_largest_blends_leave_out_ends_reversals_and_what_is_tiny():
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [1.0, 0.2], [1.0 + 1e-9, 0.2], [3.0, 3.0]])
    np.testing.assert_allclose(blend_sizes(points, 0.3, None), [0.0, 0.3, 0.0, 0.0, 0.0, 0.0])
