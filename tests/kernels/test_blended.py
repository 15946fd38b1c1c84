"""The compiled motion along a rounded polyline against its parts, one curve after the other."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from rr1plan._kernels.blended import blend, directions, largest_blends, round_corners, time_polyline, time_within

NEAR = 1e-9
STEP = 0.2

polylines = given(seed=st.integers(0, 2**32 - 1), nq=st.integers(1, 6), m=st.integers(2, 7))


def random_polyline(seed, nq, m):
    """Waypoints, blends at some of them, limits of velocity and acceleration."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-2.0, 2.0, (m, nq))
    sizes = largest_blends(points, 10.0 ** rng.uniform(-2.0, 0.5), 1e-3, 1e-8)
    sizes[rng.random(m) < 0.3] = 0.0
    return points, sizes, *(10.0 ** rng.uniform(-1.0, 1.0, (2, nq)))


def slow_pieces(points, sizes):
    """Lines and parabolas between the waypoints, by the formulas."""
    steps = np.diff(points, axis=0)
    edges = np.linalg.norm(steps, axis=1)
    unit = steps / edges[:, None]
    for i in range(len(unit)):
        line = edges[i] - sizes[i] - sizes[i + 1]
        if line > NEAR * edges[i]:
            yield line, np.stack([points[i] + sizes[i] * unit[i], unit[i], 0.0 * unit[i]])
        if sizes[i + 1] > 0.0:
            r = sizes[i + 1]
            yield 2.0 * r, np.stack([points[i + 1] - r * unit[i], unit[i], (unit[i + 1] - unit[i]) / (4.0 * r)])


@polylines
@settings(deadline=None, max_examples=40)
def test_rounded_corners_are_lines_and_parabolas_that_join(seed, nq, m):
    points, sizes, _, _ = random_polyline(seed, nq, m)
    lengths, coefficients, before = round_corners(points, sizes, NEAR)
    expected = list(slow_pieces(points, sizes))
    np.testing.assert_allclose(lengths, [length for length, _ in expected], rtol=1e-12)
    np.testing.assert_allclose(coefficients, [c for _, c in expected], atol=1e-9)
    for i in np.flatnonzero(sizes):
        np.testing.assert_array_equal(blend(points, i, sizes[i]), coefficients[before[i]])


@polylines
@settings(deadline=None, max_examples=40)
def test_the_motion_is_that_of_its_curves_or_rests_where_that_is_faster(seed, nq, m):
    points, sizes, velocity, acceleration = random_polyline(seed, nq, m)
    durations, timed, bent, failed = time_polyline(points, sizes, velocity, acceleration, STEP, NEAR)
    assert failed == -1
    total, stops_everywhere = 0.0, True
    for first, last in pairwise(np.flatnonzero(sizes == 0.0)):
        some = slice(first, last + 1)
        curve = round_corners(points[some], np.where(np.arange(m)[some] < last, sizes[some], 0.0), NEAR)
        smooth = time_within(curve[0], curve[1], velocity, acceleration, STEP)[0].sum()
        lines = [round_corners(points[i : i + 2], np.zeros(2), NEAR) for i in range(first, last)]
        straight = sum(time_within(c[0], c[1], velocity, acceleration, STEP)[0].sum() for c in lines)
        total += min(smooth, straight)
        stops_everywhere &= last - first == 1 or straight < smooth
    assert np.isclose(durations.sum(), total, rtol=1e-9)
    assert bent is not stops_everywhere
    np.testing.assert_allclose(timed[0, 0], points[0], atol=1e-12)


def test_directions_are_unit_and_lengths_those_of_the_edges():
    unit, lengths = directions(np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 2.0]]))
    np.testing.assert_allclose(unit, [[0.6, 0.8], [0.0, -1.0]])
    np.testing.assert_allclose(lengths, [5.0, 2.0])


def test_the_largest_blends_leave_out_ends_reversals_and_what_is_tiny():
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [1.0, 0.2], [1.0 + 1e-9, 0.2], [3.0, 3.0]])
    sizes = largest_blends(points, 0.3, 1e-3, 1e-8)
    np.testing.assert_allclose(sizes, [0.0, 0.3, 0.0, 0.0, 0.0, 0.0])
