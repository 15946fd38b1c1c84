"""Corners in blocks: the same points, within their balls, and the same support values."""

from __future__ import annotations

import numba
import numpy as np
import pytest

from rr1plan._kernels.cover import ALL, BLOCK, RECORD, tables_of
from rr1plan._kernels.jit import I64, OUT1
from rr1plan._kernels.lanes import WIDTH, load, store
from rr1plan._kernels.supports import lowest
from rr1plan.collision import CollisionChecker
from rr1plan.collision.point_blocks import in_blocks
from rr1plan.collision.swept import SweptEdges
from rr1plan.formats.convex import convex_hull
from rr1plan.scene import Scene


@numba.njit(numba.void(I64, OUT1, OUT1, RECORD))
def ask(core, directions, out, record):
    """The least value and its point for `WIDTH` directions."""
    cover, _, _, _ = tables_of(record)
    found = lowest(core, load(directions, 0), load(directions, WIDTH), load(directions, 2 * WIDTH), ALL, cover)
    for c, value in enumerate(found):
        store(out, c * WIDTH, value)


def hull(count, seed):
    """A mesh of many corners."""
    points = np.random.default_rng(seed).normal(size=(count, 3))
    return convex_hull(points / np.linalg.norm(points, axis=1)[:, None] * [0.1, 0.2, 0.05])


@pytest.mark.parametrize("count", [1, 2, 7, 8, 9, 16, 17, 41, 260])
def test_blocks_hold_each_point_once_and_their_balls_contain_them(count):
    points = np.random.default_rng(count).normal(size=(count, 3))
    ordered, balls = in_blocks(points)
    assert sorted(map(tuple, ordered)) == sorted(map(tuple, points))
    assert len(balls) == -(-count // BLOCK)
    for i, ball in enumerate(balls):
        block = ordered[i * BLOCK : (i + 1) * BLOCK]
        assert (np.linalg.norm(block - ball[:3], axis=1) < ball[3]).all()


def test_equal_points_make_blocks_too():
    ordered, balls = in_blocks(np.ones((20, 3)))
    assert ordered.shape == (20, 3)
    assert (balls[:, 3] < 1e-11).all()


def test_the_lowest_corner_is_that_of_all_corners(six):
    scene = Scene().with_arm("a", six).with_obstacle("rock", hull(200, 1)).with_obstacle("stone", hull(9, 2))
    edges = SweptEdges(CollisionChecker(scene), 1e-6)
    cover = edges.tables[0]
    rng = np.random.default_rng(3)
    assert (cover.cores[:, 2] - cover.cores[:, 1]).max() == 200
    for core, (_, first, last, kind, _) in enumerate(cover.cores.tolist()):
        if kind != 0:
            continue
        points = cover.points[first:last]
        for _ in range(50):
            n = rng.normal(size=(3, WIDTH))
            n /= np.linalg.norm(n, axis=0)
            out = np.zeros(4 * WIDTH)
            ask(core, n.ravel(), out, edges.record)
            low, *point = out.reshape(4, WIDTH)
            assert np.allclose(low, (points @ n).min(axis=0), rtol=0, atol=1e-14)
            assert np.allclose(np.sum(n * point, axis=0), low, rtol=0, atol=1e-14)
