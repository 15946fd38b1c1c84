"""The cells of a point cloud in blocks, so that only cells near a body are measured.

A block is a box around neighboring cells. Boxes around the blocks, and around the cells of near
blocks, give lower bounds that leave few cells to measure. Every measured distance to a convex body
gives a separating plane, which bounds the distances of all other cells as well.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from rr1plan.checks import Array
from rr1plan.shapes import PointCloud
from slow_certificate.polynomial_bounds import Index

# Cells per block: fewer mean more blocks to search, more mean more cells.
_BLOCK = 64
# Cells that could reduce the distance by less than this are not measured [m].
_ROUNDING = 1e-9

# Distance [m] of a body to the cell at a center (3,) in the cloud's frame, and the normal from the body
# to the cell (3,) in the cloud's frame with the body's support along it from the cloud's origin [m];
# None if no plane separates them.
Ask = Callable[[Array], tuple[float, tuple[Array, float] | None]]


class BodyBox(NamedTuple):
    """A box around a body: axes as columns (3, 3), center [m] and half edges [m], in the cloud's frame."""

    axes: Array
    center: Array
    half: Array


class CellBlocks:
    """The occupied cells of a cloud.

    Attributes:
        centers: Their centers [m], shape (n, 3); cells of a block are neighbors.
        half: Half a cell's edge [m].
    """

    def __init__(self, cloud: PointCloud) -> None:
        cells = np.unique(np.floor(cloud.points / cloud.resolution), axis=0)
        centers = (cells + 0.5) * cloud.resolution
        parts = _halve(centers)
        self.half = 0.5 * cloud.resolution
        self.centers = centers[np.concatenate(parts)]
        self._count = np.array([len(part) for part in parts], dtype=np.int64)
        self._first = np.cumsum(self._count) - self._count
        lower = np.minimum.reduceat(self.centers, self._first) - self.half
        upper = np.maximum.reduceat(self.centers, self._first) + self.half
        self._middle, self._half = 0.5 * (lower + upper), 0.5 * (upper - lower)

    def distance(self, body: BodyBox, ask: Ask) -> float:
        """Distance [m] of a body to the nearest cell; in contact, minus the depth of some cell."""
        bound = _gaps(body, self._middle, self._half)
        order = np.argsort(bound)
        best = self._nearest(self._cells(order[:1]), body, ask, np.inf)
        return self._nearest(self._cells(order[1:][bound[order[1:]] < best - _ROUNDING]), body, ask, best)

    def _cells(self, blocks: Index) -> Array:
        """Centers of the cells of some blocks [m], shape (k, 3)."""
        count = self._count[blocks]
        offsets = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        return np.asarray(self.centers[np.repeat(self._first[blocks], count) + offsets])

    def _nearest(self, centers: Array, body: BodyBox, ask: Ask, best: float) -> float:
        """The smaller of `best` and the distance to the nearest of some cells [m]."""
        bound = _gaps(body, centers, np.full(3, self.half))
        while True:
            near = bound < best - _ROUNDING
            if not near.any():
                return best
            centers, bound = centers[near], bound[near]
            first = int(np.argmin(bound))
            distance, plane = ask(centers[first])
            best = min(best, distance)
            bound[first] = np.inf
            if plane is not None:
                normal, reach = plane
                beyond = centers @ normal - (reach + self.half * float(np.abs(normal).sum()))
                bound = np.maximum(bound, beyond)


def _gaps(body: BodyBox, centers: Array, halves: Array) -> Array:
    """A lower bound of the distance of a body to boxes (k,) [m]; if negative, minus their overlap."""
    apart = np.abs((centers - body.center) @ body.axes) - body.half - halves @ np.abs(body.axes)
    outside = np.linalg.norm(np.maximum(apart, 0.0), axis=1)
    return np.asarray(np.where(outside > 0.0, outside, apart.max(axis=1)))


def _halve(centers: Array) -> list[Index]:
    """Indices of points (n, 3) in groups of neighbors, each halved along its longest side until it is small."""
    done, waiting = [], [np.arange(len(centers))]
    while waiting:
        part = waiting.pop()
        if len(part) <= _BLOCK:
            done.append(part)
            continue
        axis = int(np.argmax(np.ptp(centers[part], axis=0)))
        order = part[np.argpartition(centers[part, axis], len(part) // 2)]
        waiting += [order[: len(part) // 2], order[len(part) // 2 :]]
    return done
