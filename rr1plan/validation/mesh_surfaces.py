"""Bodies of many convex parts for the kernels: triangles of meshes that are not convex, and cells of point clouds.

Triangles belong to one part of a mesh if they are connected by edges that no third triangle shares. A part is closed if
each of its edges belongs to an even number of its triangles. Only closed parts have an inside.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.shapes import Mesh, PointCloud
from rr1plan.validation.referee_kernels import CLOSED, FIRST, MIXED, STARTS, load_library

Mask = NDArray[np.bool_]
# Triangles and cells of a leaf: a cell is rejected faster than a triangle.
_TRIANGLES, _CELLS = 4, 8


class PartTree(NamedTuple):
    """A tree of boxes around the parts of a body.

    Args:
        order: The parts in the order of the leaves, shape (n,).
        boxes: Centers and half sizes of the boxes of all nodes in depth-first order [m], shape (m, 6).
        nodes: For each node the next node outside its subtree, and the first and last part of a leaf, shape (m, 3).
    """

    order: NDArray[np.int64]
    boxes: Array
    nodes: NDArray[np.int64]

    @staticmethod
    def of(low: Array, high: Array, most: int) -> PartTree:
        """The tree of parts with boxes from `low` (n, 3) to `high` (n, 3) [m], at most `most` in a leaf."""
        low, high = np.ascontiguousarray(low), np.ascontiguousarray(high)
        count = len(low)
        order, boxes, nodes = np.empty(count, np.int64), np.empty((2 * count, 6)), np.empty((2 * count, 3), np.int64)
        made = load_library().rr1_build_tree(low, high, count, most, order, boxes, nodes)
        return PartTree(order, boxes[:made].copy(), nodes[:made].copy())


class Parts(NamedTuple):
    """A body of many convex parts.

    Args:
        columns: Its columns of `corners` in the order of the leaves, shape (4, n).
        tree: The tree of its parts.
    """

    columns: Array
    tree: PartTree


def surface_parts(mesh: Mesh) -> Parts:
    """The triangles of a mesh, with bits for those of closed parts."""
    corners = mesh.vertices[mesh.faces]
    tree = PartTree.of(corners.min(axis=1), corners.max(axis=1), _TRIANGLES)
    columns = np.zeros((STARTS + 1, 3 * len(corners)))
    columns[:STARTS] = corners[tree.order].reshape(-1, 3).T
    columns[STARTS] = np.repeat(_face_bits(mesh)[tree.order], 3)
    return Parts(columns, tree)


def cell_parts(cloud: PointCloud) -> Parts:
    """The occupied cells of a cloud's grid."""
    centers = (np.unique(np.floor(cloud.points / cloud.resolution), axis=0) + 0.5) * cloud.resolution
    half = 0.5 * cloud.resolution
    tree = PartTree.of(centers - half, centers + half, _CELLS)
    columns = np.zeros((STARTS + 1, len(centers)))
    columns[:STARTS] = centers[tree.order].T
    return Parts(columns, tree)


def _face_bits(mesh: Mesh) -> NDArray[np.int64]:
    """The rows of the triangles for the kernels, shape (n,); see `referee_tables.h`."""
    _, welded = np.unique(mesh.vertices, axis=0, return_inverse=True)
    faces = welded.ravel()[mesh.faces].astype(np.int64)
    part, closed = _parts_of(faces)
    bits = np.where(closed, CLOSED | (0 if _winds(faces[closed]) else MIXED), 0)
    bits[np.unique(part, return_index=True)[1]] |= FIRST
    return bits


def _parts_of(faces: NDArray[np.int64]) -> tuple[NDArray[np.int64], Mask]:
    """The part of each triangle, and whether the part is closed, shape (n,) each."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    count = len(faces)
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    triangle = np.repeat(np.arange(count), 3)
    _, edge, sharing = np.unique(ends[:, 0] * (1 + faces.max()) + ends[:, 1], return_inverse=True, return_counts=True)
    pairs = triangle[np.argsort(edge, kind="stable")][np.repeat(sharing == 2, sharing)].reshape(-1, 2)
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    number, part = connected_components(graph, directed=False)
    # Count each edge of each part, without edges of zero length.
    long = ends[:, 0] != ends[:, 1]
    own, times = np.unique((part[triangle] * len(sharing) + edge)[long], return_counts=True)
    is_open = np.bincount(own[times % 2 == 1] // len(sharing), minlength=number) > 0
    return part.astype(np.int64), np.asarray(~is_open[part])


def _winds(faces: NDArray[np.int64]) -> bool:
    """Whether faces of closed parts are consistently oriented: each edge is used equally often in both directions."""
    begin, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    size = 1 + int(faces.max(initial=0))
    _, edge = np.unique(np.minimum(begin, end) * size + np.maximum(begin, end), return_inverse=True)
    return bool((np.bincount(edge, weights=np.sign(end - begin)) == 0).all())
