from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from rr1plan.kernels.planner_kernels import load_library


def corners(points, tolerance):
    index = np.empty(len(points), np.int64)
    return index[: load_library().rr1_find_corners(points, *points.shape, tolerance, index)]


def straight(points):
    """All points lie on the line from first to last, in this order, in plain numpy."""
    chord = points[-1] - points[0]
    length = np.linalg.norm(chord)
    if length < 1e-9:
        return False
    along = (points - points[0]) @ (chord / length)
    off = points - points[0] - along[:, None] * (chord / length)
    return (np.diff(along) > 0.0).all() and (np.linalg.norm(off, axis=1) <= 1e-9).all()


@settings(deadline=None, max_examples=200)
@given(st.lists(st.tuples(st.integers(-2, 2), st.integers(-2, 2)), min_size=1, max_size=12))
def test_what_is_left_out_says_nothing(grid):
    points = np.array(grid, dtype=float)
    kept = corners(points, 1e-9)
    assert kept[0] == 0
    assert (np.diff(kept) > 0).all()
    if len(kept) == 1:
        assert (points == points[0]).all()
        return
    assert kept[-1] == len(points) - 1
    for a, b in pairwise(kept):
        between = points[a : b + 1]
        once = between[np.concatenate([[True], (np.diff(between, axis=0) != 0).any(axis=1)])]
        assert straight(once)
    # and no remaining corner is redundant: unless the next edge would be a straight one too
    for a, b, c in zip(kept[:-2], kept[1:-1], kept[2:], strict=True):
        assert not straight(points[[a, b, c]])
