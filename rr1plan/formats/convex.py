"""Convex collision shapes from meshes of any kind.

"hull" is the convex hull: exact for a convex mesh, too much for others. "pieces" is a convex
decomposition (Wei et al., Approximate convex decomposition for 3D meshes with collision-aware
concavity and tree search, 2022: the package coacd). Its pieces alone leave parts of the surface
outside, so each triangle, cut to small size, is given to the piece it fits best, and the piece
becomes the hull of both: every point of the surface is then in a piece.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, known_name
from rr1plan.errors import BackendError, InputError
from rr1plan.formats.cache import Arrays, cache_key, load_cached, store_cached
from rr1plan.shapes import Mesh

log = logging.getLogger(__name__)

Faces = NDArray[np.int32]
Convexity = Literal["hull", "pieces"]
CONVEXITIES: tuple[Convexity, ...] = ("hull", "pieces")

CONCAVITY = 0.05
CUTS_PER_SIZE = 16
_EFFORT = {"resolution": 1000, "mcts_nodes": 10, "mcts_iterations": 60}
_VERSION = "pieces-3"
# More would take many minutes.
MAX_TRIANGLES = 100_000
# Points times planes that are held in memory at once.
_MOST_PRODUCTS = 20_000_000
# Coal counts the neighbours of a corner in a byte.
_MOST_NEIGHBOURS = 255


def convex_shapes(meshes: Sequence[Mesh], convex: Convexity = "hull") -> list[Mesh]:
    """Convex meshes whose union contains the surfaces of the given ones.

    Args:
        meshes: The parts of one mesh file.
        convex: "hull" for one hull around all, "pieces" for a decomposition of each that is not
            convex (slow the first time, then kept on disk).

    Raises:
        UnknownNameError: an unknown `convex`.
        InputError: a mesh without volume.
        BackendError: the decomposition failed.
    """
    known_name("convex", convex, CONVEXITIES)
    if convex == "hull":
        return [convex_hull(np.concatenate([mesh.vertices for mesh in meshes]))]
    return [piece for mesh in meshes for piece in convex_pieces(mesh)]


def convex_hull(points: Array) -> Mesh:
    """The convex hull of points, as a closed mesh that knows it is convex.

    Args:
        points: Points [m], shape (n, 3).

    Raises:
        InputError: the points lie in a plane, or a corner has more neighbours than Coal can count.
    """
    hull = _qhull(points)
    faces, normals = hull.simplices, hull.equations[:, :3]
    if _most_neighbours(faces) > _MOST_NEIGHBOURS:
        faces, normals = _without_fans(points, faces, normals)
    if (most := _most_neighbours(faces)) > _MOST_NEIGHBOURS:
        raise InputError(
            f"a convex mesh has a corner with {most} neighbours, expected at most {_MOST_NEIGHBOURS}; try a coarser one"
        )
    return _oriented(points, hull.vertices, faces, normals)


def _most_neighbours(faces: Faces) -> int:
    """Of a closed mesh: as many as triangles meet at the corner."""
    return int(np.bincount(faces.ravel()).max())


def _without_fans(points: Array, faces: Faces, normals: Array) -> tuple[Faces, Array]:
    """The hull's flat faces cut zigzag into triangles, and the normal of each: Qhull cuts a disc into a fan."""
    planes, group = np.unique(normals, axis=0, return_inverse=True)
    cut = [_zigzag(points, np.unique(faces[group.ravel() == i]), normal) for i, normal in enumerate(planes)]
    return np.concatenate(cut), np.repeat(planes, [len(triangles) for triangles in cut], axis=0)


def _zigzag(points: Array, corners: NDArray[np.int32], normal: Array) -> Faces:
    """A convex polygon as triangles of which at most three meet at a corner."""
    around = points[corners] - points[corners].mean(axis=0)
    across = np.cross(normal, around[0])
    corners = corners[np.argsort(np.arctan2(around @ across, around @ np.cross(across, normal)))]
    count = len(corners)
    order = corners[[k // 2 if k % 2 == 0 else count - 1 - k // 2 for k in range(count)]]
    return np.stack([order[:-2], order[1:-1], order[2:]], axis=1)


def is_convex(mesh: Mesh, tolerance: float = 2e-3) -> bool:
    """Whether every triangle of a mesh lies on its own hull, within `tolerance` times its size."""
    depth = -_outside(mesh, mesh.vertices[mesh.faces].mean(axis=1))
    return bool(depth.max() <= tolerance * _size(mesh.vertices))


def convex_pieces(mesh: Mesh) -> list[Mesh]:
    """Convex meshes whose union contains the surface of a mesh; its hull alone if it is convex.

    Raises:
        InputError: a mesh without volume, or of too many triangles.
        BackendError: the decomposition failed.
    """
    if not mesh.convex and len(mesh.faces) > MAX_TRIANGLES:
        raise InputError(
            f"a mesh of {len(mesh.faces)} triangles is not cut into convex pieces, expected at most {MAX_TRIANGLES}; "
            "try a decimated mesh, or its hull"
        )
    if mesh.convex or is_convex(mesh):
        return [convex_hull(mesh.vertices)]
    import importlib.metadata

    key = cache_key(
        _VERSION,
        importlib.metadata.version("coacd"),
        f"{CONCAVITY} {CUTS_PER_SIZE} {_EFFORT}",
        mesh.vertices,
        mesh.faces,
    )
    kept = load_cached(key)
    if kept is not None:
        pieces = _unpack(kept)
        if pieces is not None:
            return pieces
        log.warning("the cache entry %s is damaged, it is made anew", key[:12])
    pieces = _covering(mesh, [convex_hull(points) for points in _decompose(mesh)])
    store_cached(key, _pack(pieces))
    return pieces


def _qhull(points: Array) -> Any:
    from scipy.spatial import ConvexHull, QhullError

    try:
        return ConvexHull(points)
    except QhullError as error:
        raise InputError("the mesh is flat or too small to have a volume; try giving it a thickness") from error


def _oriented(points: Array, used: NDArray[np.int32], faces: Faces, normals: Array) -> Mesh:
    """A hull's triangles over the vertices that are used, counter-clockwise from outside."""
    place = np.full(len(points), -1, dtype=np.int32)
    place[used] = np.arange(len(used))
    vertices, faces = points[used], place[faces]
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), normals) < 0.0
    faces[inward] = faces[inward][:, ::-1]
    return Mesh(vertices, faces, convex=True)


def _size(points: Array) -> float:
    return float(np.ptp(points, axis=0).max())


def _decompose(mesh: Mesh) -> list[Array]:
    """Corner points of coacd's pieces."""
    import coacd

    coacd.set_log_level("error")
    try:
        parts = coacd.run_coacd(coacd.Mesh(mesh.vertices, mesh.faces), threshold=CONCAVITY, seed=0, **_EFFORT)
    except Exception as error:  # coacd raises bare RuntimeErrors from its C++ part
        raise BackendError(f"coacd could not decompose a mesh of {len(mesh.faces)} triangles: {error}") from error
    return [np.asarray(vertices, dtype=np.float64) for vertices, _ in parts]


def _covering(mesh: Mesh, pieces: list[Mesh]) -> list[Mesh]:
    """The pieces, each grown to hold the small triangles of the surface that fit it best."""
    triangles = _cut(mesh.vertices[mesh.faces], _size(mesh.vertices) / CUTS_PER_SIZE)
    outside = np.empty((len(pieces), len(triangles)))
    for row, piece in zip(outside, pieces, strict=True):
        row[:] = _outside(piece, triangles.reshape(-1, 3)).reshape(-1, 3).max(axis=1)
    best = outside.argmin(axis=0)
    return [_grown(piece, triangles[best == i].reshape(-1, 3)) for i, piece in enumerate(pieces)]


def _grown(piece: Mesh, points: Array) -> Mesh:
    """The hull of a piece and those of the points that it does not hold."""
    return convex_hull(np.concatenate([piece.vertices, points[_outside(piece, points) > 0.0]]))


def _outside(piece: Mesh, points: Array) -> Array:
    """How far points (n, 3) are outside a convex mesh [m], (n,)."""
    equations = _qhull(piece.vertices).equations
    parts = np.array_split(points, 1 + len(points) * len(equations) // _MOST_PRODUCTS)
    heights = [(part @ equations[:, :3].T + equations[:, 3]).max(axis=1, initial=-np.inf) for part in parts]
    return np.concatenate(heights)


def _cut(triangles: Array, longest: float) -> Array:
    """Triangles (n, 3, 3) halved across their longest edge until none is longer than `longest`."""
    done: list[Array] = []
    while len(triangles):
        edges = np.linalg.norm(triangles - np.roll(triangles, -1, axis=1), axis=2)
        long = edges.max(axis=1) > longest
        done.append(triangles[~long])
        start = edges[long].argmax(axis=1)
        rows = np.arange(len(start))
        a, b, c = (triangles[long][rows, (start + k) % 3] for k in range(3))
        middle = 0.5 * (a + b)
        triangles = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    return np.concatenate(done)


def _pack(pieces: list[Mesh]) -> Arrays:
    return {f"{name}{i}": getattr(p, name) for i, p in enumerate(pieces) for name in ("vertices", "faces")}


def _unpack(kept: Arrays) -> list[Mesh] | None:
    """The pieces of a cache entry, or None where it does not hold what it should."""
    try:
        count = len(kept) // 2
        pieces = [Mesh(kept[f"vertices{i}"], kept[f"faces{i}"], convex=True) for i in range(count)]
    except (KeyError, InputError, ValueError, TypeError):
        return None
    return pieces or None
