"""The lowest corner of a body along a direction, by the few that are known ahead: that of all its corners."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rr1plan.collision import CollisionChecker
from rr1plan.collision.convex.convex_cores import DIRECTION_CELLS, WORD, corners_per_bit, support_cells
from rr1plan.collision.tables.edge_tables import build_edge_tables, scene_struct
from rr1plan.kernels.planner_kernels import constants, load_library
from rr1plan.scene import Scene
from rr1plan.shapes.convex_hulls import convex_hull
from rr1plan.transforms import pose

LANES = constants()["LANES"]


def hull(count, seed):
    """A mesh of many corners."""
    points = np.random.default_rng(seed).normal(size=(count, 3))
    return convex_hull(points / np.linalg.norm(points, axis=1)[:, None] * [0.1, 0.2, 0.05])


def words_of(directions, words):
    """The words of the cells of directions, which may lie on their borders; shape (n,)."""
    scaled = directions / np.abs(directions).sum(axis=1)[:, None]
    row, column = np.minimum(((scaled[:, :2] + 1.0) * 0.5 * DIRECTION_CELLS).astype(int), DIRECTION_CELLS - 1).T
    return words.reshape(2, DIRECTION_CELLS, DIRECTION_CELLS)[(scaled[:, 2] < 0.0).astype(int), row, column]


@pytest.mark.parametrize("turned", [False, True])
def test_the_lowest_corner_is_that_of_all_corners(six, turned):
    T = pose([0.9, 0.4, 0.0], rpy=[0.4, -0.5, 2.0]) if turned else pose()
    rocks = [hull(count, count) for count in (9, 64, 200)]
    scene = Scene().with_arm("a", six)
    for i, rock in enumerate(rocks):
        scene = scene.with_obstacle(f"rock {i}", rock, T)
    checker = CollisionChecker(scene)
    tables = build_edge_tables(checker.geometry, checker.fixed, checker.solid_padding, 1e-6)
    struct = scene_struct(tables, checker.exact_kernel.struct, checker.nq)
    rng = np.random.default_rng(3)
    assert (tables.cores.rows[:, 2] - tables.cores.rows[:, 1]).max() == 200
    for core, (_, first, last, kind, *_) in enumerate(tables.cores.rows.tolist()):
        if kind != 0:
            continue
        points = tables.cores.points[first:last]
        for asked in rng.integers(1, 2**LANES, 50).tolist():
            # Among them those along axes and within planes, on the borders of cells.
            n = rng.normal(size=(3, LANES)) * rng.integers(0, 2, (3, LANES))
            n[:, ~n.any(axis=0)] = 1.0
            n /= np.linalg.norm(n, axis=0)
            out = np.zeros(4 * LANES)
            load_library().rr1_lowest_corner(struct, core, asked, n, out)
            low, *point = out.reshape(4, LANES)
            lanes = [i for i in range(LANES) if asked >> i & 1]
            assert np.allclose(low[lanes], (points @ n).min(axis=0)[lanes], rtol=0, atol=1e-14)
            assert np.allclose(np.sum(n * point, axis=0)[lanes], low[lanes], rtol=0, atol=1e-14)


@settings(max_examples=30, deadline=None)
@given(
    st.integers(9, 300),
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.0, 1e-9, 1e-3, 1.0]),
    st.sampled_from([1e-3, 1.0, 1e3]),
)
def test_the_lowest_of_any_points_is_in_the_word_of_its_cell(count, seed, flat, size):
    rng = np.random.default_rng(seed)
    points = size * (rng.normal(size=(count, 3)) * [1.0, 1.0, flat] + rng.normal(size=3))
    words, step = support_cells(points), corners_per_bit(count)
    assert words.min() >= 0
    assert step * WORD >= count
    directions = rng.normal(size=(200, 3)) * rng.integers(0, 2, (200, 3))
    directions = directions[directions.any(axis=1)]
    kept = words_of(directions, words)[:, None] >> np.arange(count) // step & 1
    heights = directions @ (points - points.mean(axis=0)).T
    above = np.where(kept, heights, np.inf).min(axis=1) - heights.min(axis=1)
    assert (above <= 1e-12 * size * np.abs(directions).sum(axis=1)).all()


def test_few_corners_are_left_of_many():
    points = hull(200, 1).vertices
    bits = [int(word).bit_count() for word in support_cells(points)]
    assert np.median(bits) < 12


def test_equal_points_are_all_as_low():
    assert (support_cells(np.ones((20, 3))) == (1 << 20) - 1).all()
