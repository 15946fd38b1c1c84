"""Which root each edge of a search tree hangs on, and how far from it, to colour it and to let it grow."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from rr1plan.checks import Array
from rr1plan.planning import SearchTree

_SAME = 1e-3  # two ways to a goal's configuration agree within this [rad or m]
_TURN = 2.0 * np.pi


def trees_of(tree: SearchTree, start: Array | None, goals: Sequence[Array]) -> tuple[NDArray[np.int64], Array]:
    """The tree that holds each edge, 0: the start's, 1: a goal's; and how far along it its farther end is [rad or m].

    Of trees that have met, the edge that joined them counts as the start's; it is the last one of a path between
    them to have been found.

    Args:
        tree: What a planner explored, its edges in the order in which they were found.
        start: Where the search started, shape (n,), or None.
        goals: Configurations that reach the goal, each (n,); a whole turn more is the same.
    """
    edges = np.asarray(tree.edges, dtype=np.int64).reshape(-1, 2)
    sides = np.full(len(tree.vertices), -1)
    for side, ends in enumerate(([] if start is None else [start], goals)):
        for end in ends:
            away = tree.vertices - end
            near = np.abs(away - _TURN * np.round(away / _TURN)).max(axis=1) < _SAME
            sides[near & (sides < 0)] = side
    roots = np.flatnonzero(sides >= 0)
    within, owner = _joined(edges, sides)
    reach = _from_roots(tree.vertices, edges[within], roots)
    return np.asarray(owner[edges[:, 0]]), reach[edges].max(axis=1, initial=0.0)


def _joined(edges: NDArray[np.int64], sides: NDArray[np.int64]) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Which edges lie within one tree; and the side of each vertex: what its tree's roots say, or a goal's."""
    group = np.arange(len(sides))
    side, within = sides.copy(), np.ones(len(edges), dtype=np.bool_)

    def root(k: int) -> int:
        while group[k] != k:
            group[k] = group[group[k]]
            k = int(group[k])
        return k

    for number, (i, j) in enumerate(edges.tolist()):
        a, b = root(i), root(j)
        if side[a] >= 0 and side[b] >= 0 and side[a] != side[b]:
            within[number] = False
        elif a != b:
            side[a] = max(side[a], side[b])
            group[b] = a
    owner = np.array([side[root(k)] for k in range(len(sides))], dtype=np.int64)
    return within, np.where(owner < 0, 1, owner)


def _from_roots(vertices: Array, edges: NDArray[np.int64], roots: NDArray[np.int64]) -> Array:
    """Distance of every vertex along the edges from the roots of its tree, or from its first vertex."""
    lengths = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1) + 1e-12
    graph = coo_array((lengths, (edges[:, 0], edges[:, 1])), shape=(len(vertices), len(vertices))).tocsr()
    reach = np.full(len(vertices), np.inf)
    if len(roots):
        reach = dijkstra(graph, directed=False, indices=roots, min_only=True)
    for first in range(len(vertices)):
        if np.isinf(reach[first]):
            reach = np.minimum(reach, dijkstra(graph, directed=False, indices=[first], min_only=True))
    return reach
