"""Search trees as they are drawn: the root of each edge, its distance from it, and huge trees thinned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from rr1plan.checks import Array
from rr1plan.planning import SearchTree

_SAME = 1e-3  # configurations of a goal that differ by less are the same [rad or m]
_TURN = 2.0 * np.pi
MOST_EDGES = 4000  # drawn of one tree
_FINEST_RASTER = 256  # cells along each axis


@dataclass(frozen=True, eq=False)
class DrawnTree:
    """The edges of a search tree that are drawn, those nearer to a root first.

    Args:
        vertices: Their ends [rad or m], shape (n, nq).
        edges: Pairs of them, shape (m, 2).
        sides: The tree each edge belongs to, 0: the start's, 1: a goal's; shape (m,).
        explored: Number of edges before huge trees are thinned.
    """

    vertices: Array
    edges: NDArray[np.int64]
    sides: NDArray[np.int64]
    explored: int


def drawn_tree(tree: SearchTree, start: Array | None, goals: Sequence[Array], most: int = MOST_EDGES) -> DrawnTree:
    """A search tree to draw, thinned to at most `most` edges, or as far as the result remains connected.

    Thinning lays a raster over the configurations. Among the edges of one tree that end in the same cell it keeps the
    one nearest to the root, and all edges between the kept ones and their root, so the result is a connected part of
    the tree. The resolution of the raster is halved until few enough edges remain.

    An edge between two trees is the one found last on the path between their roots; it belongs to the tree of its first
    vertex.

    Args:
        tree: The explored tree, its edges in the order in which they were found.
        start: Where the search started, shape (n,), or None.
        goals: Configurations that reach the goal, each (n,); a whole turn more is the same.
        most: Number of edges.
    """
    edges, owner, reach = _explored(tree, start, goals)
    edges = edges[np.argsort(reach[edges].max(axis=1, initial=0.0), kind="stable")]
    kept = _thinned(tree.vertices, edges, owner[edges[:, 0]], reach, most)
    used, ends = np.unique(edges[kept], return_inverse=True)
    return DrawnTree(tree.vertices[used], ends.reshape(-1, 2), owner[edges[kept, 0]], len(edges))


def _thinned(
    vertices: Array, edges: NDArray[np.int64], sides: NDArray[np.int64], reach: Array, most: int
) -> NDArray[np.int64]:
    """Indices of the edges to draw; edges come in the order of their distance from the root."""
    kept, cells = np.arange(len(edges)), _FINEST_RASTER
    if len(kept) <= most:
        return kept
    # The end of each edge that is farther from the root, and the edge before it on the path from the root, or -1.
    far, near = (np.where((reach[edges[:, 0]] > reach[edges[:, 1]]) == flip, *edges.T) for flip in (True, False))
    into = np.full(len(vertices), -1)
    into[far[::-1]] = np.arange(len(edges))[::-1]
    before, span = into[near], np.ptp(vertices, axis=0)
    while len(kept) > most and cells >= 1:
        raster = np.floor((vertices[far] - vertices.min(axis=0)) / np.where(span > 0.0, span, 1.0) * cells)
        frontier = np.unique(np.column_stack([sides, raster]), axis=0, return_index=True)[1]
        chosen = np.zeros(len(edges), dtype=np.bool_)
        while len(frontier):
            chosen[frontier] = True
            frontier = np.unique(before[frontier])
            frontier = frontier[(frontier >= 0) & ~chosen[frontier]]
        kept, cells = np.flatnonzero(chosen), cells // 2
    return kept


def _explored(
    tree: SearchTree, start: Array | None, goals: Sequence[Array]
) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
    """The edges, and for each vertex its tree and its distance from the root along the tree."""
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
    return edges, owner, reach


def _joined(edges: NDArray[np.int64], sides: NDArray[np.int64]) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Which edges lie within one tree; and the side of each vertex, determined by the roots of its tree or a goal."""
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
