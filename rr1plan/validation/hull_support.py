"""The corners of a hull, listed by direction: a support function that looks at few of them.

Directions are sorted into the cells of the six faces of a cube. A cell does not list a corner if another corner lies
farther along all four directions at the cell's own corners. It then lies farther along every direction within the cell,
since these are sums of the four with positive weights. So the farthest corner along a direction is always listed in the
cell of the direction, whatever the points are.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.validation.referee_kernels import CELLS, HULL, SIDE, STARTS, TABLE

# With fewer corners, all are tested.
_LEAST = 32
# Cells are enlarged by this fraction, for directions that rounding puts on the wrong side of a border.
_WIDER = 1e-9
# A corner counts as farther by more than this fraction of the size of the hull.
_ROUNDING = 1e-12


class Core(NamedTuple):
    """A convex body for the compiled search, without its rounding radius.

    Args:
        kind: Its kind, a `SHAPE_` of `referee_tables.h`.
        single: Number of corners to test one by one.
        corners: Its columns of `corners`, shape (4, n).
    """

    kind: int
    single: int = 0
    corners: Array = np.zeros((4, 0))

    @property
    def row(self) -> tuple[int, int, int]:
        """Its kind, the number of corners to test one by one, and the number of its columns."""
        return self.kind, self.single, self.corners.shape[1]


def hull_core(points: Array) -> Core:
    """The core of a hull of points (n, 3), with a support table if there are many."""
    if len(points) < _LEAST:
        corners = np.zeros((4, len(points)))
        corners[:STARTS] = points.T
        return Core(HULL, len(points), corners)
    lists = [np.flatnonzero(row) for row in _listed(points)]
    counts = np.array([len(row) for row in lists])
    corners = np.zeros((4, int(counts.sum()) + 1))
    corners[:STARTS, :-1] = points[np.concatenate(lists)].T
    corners[STARTS, 1 : CELLS + 1] = np.cumsum(counts)
    return Core(TABLE, 0, corners)


def _listed(points: Array) -> NDArray[np.bool_]:
    """Mask of the vertices in each cell, shape (cells, n)."""
    directions = _cells() @ points.T
    rounding = _ROUNDING * float(np.abs(points).max(initial=0.0))
    listed = np.ones((CELLS, len(points)), dtype=np.bool_)
    cell = np.arange(CELLS)[:, None]
    # Corners that are farthest in the middle of a cell or at one of its corners exclude nearly all that can be
    # excluded.
    for winner in (directions.sum(axis=1).argmax(axis=1), *directions.argmax(axis=2).T):
        farther = directions[cell, np.arange(4), winner[:, None]] - rounding
        listed &= ~(directions < farther[:, :, None]).all(axis=1)
    return listed


@cache
def _cells() -> Array:
    """The four directions at the corners of each cell, in the order of the kernels, shape (cells, 4, 3)."""
    edges = np.linspace(-1.0, 1.0, SIDE + 1)
    low, high = edges[:-1] - _WIDER, edges[1:] + _WIDER
    faces = []
    for axis in range(3):
        for sign in (1.0, -1.0):
            for i in range(SIDE):
                for j in range(SIDE):
                    square = [(x, y) for x in (low[i], high[i]) for y in (low[j], high[j])]
                    faces.append([np.insert(pair, axis, sign) for pair in square])
    return np.array(faces)
