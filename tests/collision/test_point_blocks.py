"""Corners in blocks: the same points, within their balls."""

from __future__ import annotations

import numpy as np
import pytest

from rr1plan.collision.convex.convex_cores import BLOCK, in_vertex_blocks


@pytest.mark.parametrize("count", [1, 2, 7, 8, 9, 16, 17, 41, 260])
def test_blocks_hold_each_point_once_and_their_balls_contain_them(count):
    points = np.random.default_rng(count).normal(size=(count, 3))
    ordered, balls = in_vertex_blocks(points)
    assert sorted(map(tuple, ordered)) == sorted(map(tuple, points))
    assert len(balls) == -(-count // BLOCK)
    for i, ball in enumerate(balls):
        block = ordered[i * BLOCK : (i + 1) * BLOCK]
        assert (np.linalg.norm(block - ball[:3], axis=1) < ball[3]).all()


def test_equal_points_make_blocks_too():
    ordered, balls = in_vertex_blocks(np.ones((20, 3)))
    assert ordered.shape == (20, 3)
    assert (balls[:, 3] < 1e-11).all()
