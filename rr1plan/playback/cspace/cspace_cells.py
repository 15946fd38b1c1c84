"""Cells of a grid with optional periodic axes: components of free cells, and shortest paths over them."""

from __future__ import annotations

import heapq

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

Mask = NDArray[np.bool_]


def label_components(free: Mask, periodic: tuple[bool, bool], diagonal: bool = False) -> NDArray[np.int32]:
    """Number the components of cells, connected across periodic seams; 0 marks cells outside the mask.

    Args:
        free: The cells, shape (n, m).
        periodic: Whether the ends of each axis are the same place.
        diagonal: Cells that share a corner are connected, too, not only those that share an edge.
    """
    n, m = free.shape
    # Repeat the first row and column after the last: cells connected across a seam are connected to these copies.
    around = np.pad(free, [(0, int(closes)) for closes in periodic], mode="wrap")
    labels, count = ndimage.label(around, np.ones((3, 3)) if diagonal else None)
    same = [
        pairs
        for closes, pairs in zip(periodic, ((labels[n:], labels[:1]), (labels[:, m:], labels[:, :1])), strict=True)
        if closes
    ]
    rows, columns = (np.concatenate([np.zeros(0, np.int32), *(p[k].ravel() for p in same)]) for k in (0, 1))
    graph = coo_array((np.ones(len(rows)), (rows, columns)), shape=(count + 1, count + 1))
    joined = connected_components(graph, directed=False)[1]
    return np.asarray(joined[labels[:n, :m]], dtype=np.int32)


def shortest_way(
    free: Mask, periodic: tuple[bool, bool], start: tuple[int, int], goal: tuple[int, int]
) -> list[tuple[int, int]]:
    """Cells of a shortest path (8 neighbors, Dijkstra 1959); start and goal are in the same component."""
    steps = [(di, dj) for di in (-1, 0, 1) for dj in (-1, 0, 1) if di or dj]
    cost = {start: 0.0}
    came: dict[tuple[int, int], tuple[int, int]] = {}
    queue = [(0.0, start)]
    while queue:
        spent, cell = heapq.heappop(queue)
        if cell == goal:
            break
        if spent > cost[cell]:
            continue
        for step in steps:
            following = _neighbor(free, periodic, cell, step)
            if following is not None:
                total = spent + float(np.hypot(*step))
                if total < cost.get(following, np.inf) - 1e-12:
                    cost[following] = total
                    came[following] = cell
                    heapq.heappush(queue, (total, following))
    cells = [goal]
    while cells[-1] != start:
        cells.append(came[cells[-1]])
    return cells[::-1]


def _neighbor(
    free: Mask, periodic: tuple[bool, bool], cell: tuple[int, int], step: tuple[int, int]
) -> tuple[int, int] | None:
    """The free cell one step ahead, or None; a diagonal step requires both side cells to be free."""
    moved = []
    for axis in (0, 1):
        index, size = cell[axis] + step[axis], free.shape[axis]
        if not 0 <= index < size and not periodic[axis]:
            return None
        moved.append(index % size)
    i, j = moved
    if not free[i, j] or (step[0] and step[1] and not (free[cell[0], j] and free[i, cell[1]])):
        return None
    return i, j


def widest_spot(mask: Mask, periodic: tuple[bool, bool], rim: tuple[int, int] = (0, 0)) -> tuple[int, int, float]:
    """The cell of a mask that is farthest from cells outside the mask, and that distance [cells]; 0 if there is none.

    Args:
        mask: The cells, shape (n, m).
        periodic: Whether the ends of each axis are the same place.
        rim: Number of cells at both ends of each axis that are excluded.
    """
    turns = [(3 if closes else 1) for closes in periodic]
    around = np.pad(np.tile(mask, turns), 1)
    n, m = mask.shape
    far = ndimage.distance_transform_edt(around)[1:-1, 1:-1]
    i0, j0 = (n if periodic[0] else 0), (m if periodic[1] else 0)
    own = far[i0 : i0 + n, j0 : j0 + m]
    inside = np.zeros_like(mask)
    inside[rim[0] : n - rim[0], rim[1] : m - rim[1]] = True
    own = np.where(inside, own, 0.0)
    i, j = np.unravel_index(int(np.argmax(own)), own.shape)
    return int(i), int(j), float(own[i, j])
