"""Motions on the nominal clock."""

from __future__ import annotations

import numpy as np

from rr1plan.multi.paths.nominal_clock import Track


def test_a_track_is_exact_at_its_waypoints_and_constant_after_the_last_one() -> None:
    rng = np.random.default_rng(0)
    for count in (1, 2, 6):
        times = np.append(0.0, np.cumsum(rng.uniform(0.1, 1.0, count - 1)))
        points = rng.normal(size=(count, 4))
        track = Track(times, points)
        np.testing.assert_array_equal(track.at(times), points)
        np.testing.assert_array_equal(track.at(times[-1] + np.array([0.0, 0.5, 1e9])), points[[-1, -1, -1]])
        middles = track.at(0.5 * (times[1:] + times[:-1]))
        np.testing.assert_allclose(middles, 0.5 * (points[1:] + points[:-1]), rtol=0.0, atol=1e-14)


def test_a_track_without_joints_has_empty_configurations() -> None:
    assert Track(np.zeros(1), np.zeros((1, 0))).at(np.arange(3.0)).shape == (3, 0)
