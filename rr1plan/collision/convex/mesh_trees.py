"""Non-convex triangle meshes for the kernels: triangles in the leaves of a tree of boxes.

A node has eight children, whose boxes are tested at once. Triangles are sorted by halving across the longest side of
their centroids, at whole leaves and whole nodes, so that on every level eight consecutive items make a node.

The interior is determined for each part; triangles belong to one part if they are connected by edges that no third
triangle has. Faces whose orientation disagrees with their neighbors are reversed. Then a closed part uses each edge
equally often in both directions; any other part is open and has no interior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, read_only
from rr1plan.kernels.planner_kernels import constants
from rr1plan.shapes import Mesh

_INTS = NDArray[np.int64]
LANES = constants()["LANES"]
# The position of absent children (`MESH_NOWHERE`).
_NOWHERE = 1e30


@dataclass(frozen=True, eq=False)
class MeshTree:
    """Triangles in a tree of boxes, in the frame of the box around them; rows as in `mesh_tables.h`.

    Args:
        ranges: For each mesh its root, and 1 if some triangles enclose a volume, shape (m, 2).
        nodes: Boxes of the children of each node, shape (n, 48).
        children: First child of each node, shape (n,).
        triangles: Corners of the triangles [m], shape (t, 9).
        is_closed: 1 for each triangle of a closed surface, shape (t,).
    """

    ranges: _INTS
    nodes: Array
    children: _INTS
    triangles: Array
    is_closed: _INTS


NO_MESHES = MeshTree(
    np.zeros((0, 2), np.int64), np.zeros((0, 48)), np.zeros(0, np.int64), np.zeros((0, 9)), np.zeros(0, np.int64)
)


def box_of_mesh(mesh: Mesh) -> tuple[Array, Array]:
    """Center and half sizes of the box around a mesh's triangles in its own frame [m], shape (3,) each."""
    used = mesh.vertices[mesh.faces.ravel()]
    low, high = used.min(axis=0), used.max(axis=0)
    center = 0.5 * (low + high)
    return center, np.maximum(high - center, center - low)


@lru_cache(maxsize=64)
def mesh_tree(mesh: Mesh) -> MeshTree:
    """The tree of a mesh, made once."""
    center, _ = box_of_mesh(mesh)
    turns = orientations_of(mesh)
    corners = (mesh.vertices - center)[np.where(turns[:, None] < 0, mesh.faces[:, ::-1], mesh.faces)]
    order = _in_order(corners.mean(axis=1))
    low, high = corners.min(axis=1)[order], corners.max(axis=1)[order]
    nodes: list[Array] = []
    children: list[_INTS] = []
    begin, count = -1, len(order)
    while not nodes or count > 1:
        step = -LANES if not nodes else LANES
        count = -(-count // LANES)
        low, high, boxes = _grouped(low, high, count)
        children.append(begin + step * np.arange(count, dtype=np.int64))
        begin = sum(map(len, nodes))
        nodes.append(boxes)
    return MeshTree(
        read_only(np.array([[begin, int(turns.any())]], np.int64)),
        read_only(np.concatenate(nodes)),
        read_only(np.concatenate(children)),
        read_only(corners[order].reshape(-1, 9)),
        read_only(np.abs(turns[order])),
    )


def joined_trees(parts: Sequence[MeshTree]) -> MeshTree:
    """The tables of several meshes as one."""
    if len(parts) <= 1:
        return parts[0] if parts else NO_MESHES
    ranges, children, nodes, triangles = [], [], 0, 0
    for part in parts:
        ranges.append(part.ranges + np.array([nodes, 0]))
        children.append(np.where(part.children < 0, part.children - triangles, part.children + nodes))
        nodes, triangles = nodes + len(part.nodes), triangles + len(part.triangles)
    return MeshTree(
        np.concatenate(ranges),
        np.concatenate([part.nodes for part in parts]),
        np.concatenate(children),
        np.concatenate([part.triangles for part in parts]),
        np.concatenate([part.is_closed for part in parts]),
    )


def _grouped(low: Array, high: Array, count: int) -> tuple[Array, Array, Array]:
    """Boxes (n, 3) in nodes of eight: the boxes of the nodes, and their rows, shape (count, 48)."""
    ends = np.full((2, count * LANES, 3), _NOWHERE)
    ends[0, : len(low)], ends[1, : len(high)] = low, high
    lows, highs = ends.reshape(2, count, LANES, 3)
    outer = np.where(lows < _NOWHERE, highs, -_NOWHERE)
    rows = np.concatenate([lows.transpose(0, 2, 1), highs.transpose(0, 2, 1)], axis=1).reshape(count, 48)
    return lows.min(axis=1), outer.max(axis=1), rows


def _in_order(points: Array) -> _INTS:
    """An order in which neighboring points are consecutive: groups of eight, groups of eight such groups, and so on."""
    done: list[_INTS] = []
    waiting = [np.arange(len(points))]
    while waiting:
        part = waiting.pop()
        if len(part) <= LANES:
            done.append(part)
            continue
        unit = LANES
        while unit * LANES < len(part):
            unit *= LANES
        first = max(1, -(-len(part) // unit) // 2) * unit
        own = points[part]
        axis = int((own.max(axis=0) - own.min(axis=0)).argmax())
        halved = part[np.argpartition(own[:, axis], first)]
        waiting += [halved[first:], halved[:first]]
    return np.concatenate(done)


# ---- interior --------------------------------------------------------------------------------------


def orientations_of(mesh: Mesh) -> _INTS:
    """Signs that orient closed parts: 1 as given, -1 reversed, 0 for an open surface, shape (t,)."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    count = len(mesh.faces)
    _, welded = np.unique(mesh.vertices, axis=0, return_inverse=True)
    faces = welded.ravel()[mesh.faces].astype(np.int64)
    begin, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    triangle, direction = np.repeat(np.arange(count), 3), np.sign(end - begin)
    key = np.minimum(begin, end) * (1 + welded.max()) + np.maximum(begin, end)
    _, edge, sharing = np.unique(key, return_inverse=True, return_counts=True)
    order = np.argsort(edge, kind="stable")
    shared = order[sharing[edge[order]] == 2].reshape(-1, 2)
    links = triangle[shared]
    graph = coo_matrix((np.ones(len(links)), (links[:, 0], links[:, 1])), shape=(count, count))
    number, part = connected_components(graph, directed=False)
    # Edges of each part, as several parts may share an edge.
    _, edge = np.unique(part[triangle] * len(sharing) + edge, return_inverse=True)
    part_of_edge = np.zeros(edge.max() + 1, np.int64)
    part_of_edge[edge] = part[triangle]

    def closed(turns: _INTS) -> NDArray[np.bool_]:
        """Parts that use each of their edges equally often in both directions."""
        balance = np.bincount(edge, weights=direction * turns[triangle])
        return np.asarray(np.bincount(part_of_edge, weights=balance != 0, minlength=number) == 0)

    turns = np.ones(count, np.int64)
    whole = closed(turns)
    if not whole.all():
        rest = ~whole[part[links[:, 0]]]
        turns = _turned_alike(count, links[rest], direction[shared[rest]].sum(axis=1) == 0)
        whole = closed(turns)
    return np.where(whole[part], turns, 0)


def _turned_alike(count: int, links: _INTS, alike: NDArray[np.bool_]) -> _INTS:
    """Signs that reverse triangles so that neighbors face the same side, if their part is orientable, shape (count,).

    Args:
        count: Number of triangles.
        links: Pairs of neighbors, shape (m, 2).
        alike: Whether the neighbors of a pair face the same side as given, shape (m,).
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    # The double cover of the surface has each triangle twice, as given and reversed. An orientable part appears as two
    # sheets, one for each orientation.
    a, b = links.T
    begin = np.concatenate([a, a + count])
    end = np.concatenate([np.where(alike, b, b + count), np.where(alike, b + count, b)])
    cover = coo_matrix((np.ones(len(begin)), (begin, end)), shape=(2 * count, 2 * count))
    _, sheet = connected_components(cover, directed=False)
    return np.where(sheet[:count] <= sheet[count:], 1, -1)
