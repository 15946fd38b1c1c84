"""A point cloud as few boxes, whose union is exactly the cells that contain a point."""

from __future__ import annotations

import numpy as np

from rr1plan.checks import Array
from rr1plan.shapes import PointCloud


def cloud_boxes(cloud: PointCloud) -> tuple[Array, Array]:
    """Boxes whose union is the union of a cloud's cells.

    Consecutive cells become a bar, adjacent bars of equal length a plate, adjacent equal plates a block.

    Returns:
        Centers and half edges [m], each of shape (n, 3).
    """
    lower = np.unique(np.floor(cloud.points / cloud.resolution), axis=0)
    upper = lower + 1.0
    for axis in range(3):
        lower, upper = _join(lower, upper, axis)
    side = 0.5 * cloud.resolution
    return side * (lower + upper), side * (upper - lower)


def _join(lower: Array, upper: Array, axis: int) -> tuple[Array, Array]:
    """Merge boxes (n, 3) that are adjacent along an axis and have the same extent across it."""
    across = [i for i in range(3) if i != axis]
    section = np.column_stack([lower[:, across], upper[:, across]])
    order = np.lexsort([lower[:, axis], *section.T])
    lower, upper, section = lower[order], upper[order], section[order]
    follows = (section[1:] == section[:-1]).all(axis=1) & (lower[1:, axis] == upper[:-1, axis])
    first = np.flatnonzero(np.append(True, ~follows))
    last = np.append(first[1:], len(lower)) - 1
    ends = upper[first]
    ends[:, axis] = upper[last, axis]
    return lower[first], ends
