"""Support tables: the few vertices of a body that can be the lowest along the directions of a cell.

Directions are cells of two squares, one for each side of the third axis, as in an octahedron unfolded: n / (|n_1| +
|n_2| + |n_3|) without its third number. Within a cell that is linear, so a corner that is higher than another one along
the directions at the cell's ends is so along all of its directions, and cannot be the lowest.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.files.disk_cache import cache_key, load_cached, store_cached
from rr1plan.kernels.planner_kernels import constants

# Cells of directions along each side of the two squares (`support_table.h`).
DIRECTION_CELLS = constants()["DIRECTION_CELLS"]
# Bits of a word that are used.
WORD = 63
_VERSION = "lowest-corners-1"
# Corners count as equally low within this part of the body's size: beyond all rounding.
_EQUAL = 1e-9


def corners_per_bit(count: int) -> int:
    """Number of consecutive vertices that share a bit of a word."""
    return -(-count // WORD)


def support_cells(points: Array) -> NDArray[np.int64]:
    """Vertices that can be the lowest along the directions of each cell: a bit for each `corners_per_bit` of them.

    Args:
        points: Corners [m], shape (n, 3).

    Returns:
        A word for each cell, shape (2 * DIRECTION_CELLS**2,).
    """
    key = cache_key(_VERSION, f"{DIRECTION_CELLS} {WORD} {_EQUAL}", points)
    kept = load_cached(key)
    if kept is None or sorted(kept) != ["words"]:
        kept = {"words": _words(points)}
        store_cached(key, kept)
    return kept["words"]


def _words(points: Array) -> NDArray[np.int64]:
    ends, counts = _ends()
    step = corners_per_bit(len(points))
    bits = np.left_shift(np.int64(1), np.arange(len(points)) // step)
    middle = points.mean(axis=0)
    slack = _EQUAL * float(np.abs(points - middle).max())
    words = np.empty(ends.shape[:2], np.int64)
    for row, (directions, beyond) in enumerate(zip(ends, counts, strict=True)):
        # Ends that are not directions of the cell tell nothing: there all corners are the same.
        heights = np.where(beyond, 0.0, directions @ (points - middle).T)
        kept = np.ones((heights.shape[0], heights.shape[2]), np.bool_)
        for rival in (*heights.argmin(axis=2).T, heights.sum(axis=1).argmin(axis=1)):
            below = np.take_along_axis(heights, rival[:, None, None], axis=2)
            kept &= ~((heights > below + slack) | beyond).all(axis=1)
        kept |= beyond.all(axis=(1, 2))[:, None]
        words[row] = np.bitwise_or.reduce(np.where(kept, bits, 0), axis=1)
    return words.ravel()


@cache
def _ends() -> tuple[Array, NDArray[np.bool_]]:
    """Directions at the four ends of the cells of each row, and which of them are beyond the octahedron."""
    at = np.linspace(-1.0, 1.0, DIRECTION_CELLS + 1)
    u, v = np.meshgrid(at, at, indexing="ij")
    height = 1.0 - np.abs(u) - np.abs(v)
    nodes = np.stack([u, v, height], axis=2)
    rows = np.stack([nodes[:-1, :-1], nodes[:-1, 1:], nodes[1:, :-1], nodes[1:, 1:]], axis=2)
    rows = np.concatenate([rows, rows * (1.0, 1.0, -1.0)])
    return rows, np.abs(rows[..., :2]).sum(axis=3, keepdims=True) > 1.0 + 1e-9
