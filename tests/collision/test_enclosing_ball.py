"""Balls around balls and points."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from rr1plan.collision.convex.enclosing_ball import around_points, ball_reach, enclosing_ball


@settings(deadline=None, max_examples=60)
@given(arrays.arrays(np.float64, st.tuples(st.integers(1, 12), st.just(4)), elements=st.floats(0.0, 2.0)))
def test_it_holds_all_balls_and_its_center_is_among_theirs(balls):
    ball = enclosing_ball(balls)
    assert (ball_reach(balls, ball[:3]) <= ball[3]).all()
    assert (balls[:, :3].min(axis=0) - 1e-12 <= ball[:3]).all()
    assert (ball[:3] <= balls[:, :3].max(axis=0) + 1e-12).all()


def test_it_is_not_much_larger_than_it_has_to_be():
    balls = np.array([[0.0, 0, 0, 0.1], [1.0, 0, 0, 0.1], [0.5, 0, 0, 0.2]])
    assert 0.6 <= enclosing_ball(balls)[3] < 0.61
    cube = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, -1).T
    assert around_points(cube)[3] == pytest.approx(0.5 * np.sqrt(3.0), rel=0.02)
