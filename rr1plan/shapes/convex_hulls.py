"""Convex hulls of points and meshes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.errors import InputError
from rr1plan.shapes import Mesh

Faces = NDArray[np.int32]

# Most points times planes in memory.
_MOST_PRODUCTS = 500_000
# Tolerance for vertices outside the plane of a face, as a share of the mesh's size.
_FLAT_TOLERANCE = 1e-7
# Tolerance for triangles below the hull of a mesh that counts as convex, as a share of its size.
_CONVEX_TOLERANCE = 2e-3
# Relative tolerance of volume and area for a mesh that is its own hull.
_WHOLE = 1e-6
# Coal stores the number of neighbors of a vertex in a byte.
_MOST_NEIGHBORS = 255


def bounds_its_hull(mesh: Mesh) -> bool:
    """Whether no vertex lies outside the plane of a face, so that the faces bound the hull of the vertices."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    if (lengths == 0.0).any():
        return False
    normals = normals / lengths
    offsets = np.einsum("ij,ij->i", normals, a)
    size = float(np.ptp(mesh.vertices, axis=0).max())
    return bool((normals @ mesh.vertices.T <= offsets[:, None] + _FLAT_TOLERANCE * size).all())


def convex_hull(points: Array) -> Mesh:
    """The convex hull of points, as a closed mesh marked as convex.

    Args:
        points: Points [m], shape (n, 3).

    Raises:
        InputError: the points lie in a plane, or a vertex has more neighbors than Coal supports.
    """
    hull = _qhull(points)
    faces, normals = hull.simplices, hull.equations[:, :3]
    if _most_neighbors(faces) > _MOST_NEIGHBORS:
        faces, normals = _without_fans(points, faces, normals)
    if (most := _most_neighbors(faces)) > _MOST_NEIGHBORS:
        raise InputError(
            f"a convex mesh has a corner with {most} neighbors, expected at most {_MOST_NEIGHBORS}; try a coarser one"
        )
    return _oriented(points, hull.vertices, faces, normals)


def _most_neighbors(faces: Faces) -> int:
    """Largest number of neighbors of a vertex of a closed mesh, equal to its number of triangles."""
    return int(np.bincount(faces.ravel()).max())


def _without_fans(points: Array, faces: Faces, normals: Array) -> tuple[Faces, Array]:
    """Triangles and normals of the hull with flat faces cut in a zigzag, because Qhull cuts a disc into a fan."""
    planes, group = np.unique(normals, axis=0, return_inverse=True)
    cut = [_zigzag(points, np.unique(faces[group.ravel() == i]), normal) for i, normal in enumerate(planes)]
    return np.concatenate(cut), np.repeat(planes, [len(triangles) for triangles in cut], axis=0)


def _zigzag(points: Array, corners: NDArray[np.int32], normal: Array) -> Faces:
    """A convex polygon as triangles, with at most three at a vertex."""
    around = points[corners] - points[corners].mean(axis=0)
    across = np.cross(normal, around[0])
    corners = corners[np.argsort(np.arctan2(around @ across, around @ np.cross(across, normal)))]
    count = len(corners)
    order = corners[[k // 2 if k % 2 == 0 else count - 1 - k // 2 for k in range(count)]]
    return np.stack([order[:-2], order[1:-1], order[2:]], axis=1)


def is_convex(mesh: Mesh) -> bool:
    """Whether every triangle of a mesh lies on the hull of the mesh, within two thousandths of its size."""
    centers = mesh.vertices[mesh.faces].mean(axis=1)
    tolerance = _CONVEX_TOLERANCE * float(np.ptp(mesh.vertices, axis=0).max())
    return all((some >= -tolerance).all() for some in _distances_outside(mesh.vertices, centers))


def is_own_hull(mesh: Mesh) -> bool:
    """Whether a mesh is the whole surface of its hull, up to rounding; False for a flat mesh.

    Each triangle makes a tetrahedron with the middle of the mesh: if a triangle is missing, doubled or below the hull's
    surface, either the sum of the volumes or that of the areas differs from the hull's.
    """
    try:
        hull = _qhull(mesh.vertices)
    except InputError:
        return False
    a, b, c = (mesh.vertices[mesh.faces[:, k]] - mesh.vertices[hull.vertices].mean(axis=0) for k in range(3))
    volume = np.abs(np.einsum("ij,ij->i", a, np.cross(b, c))).sum() / 6.0
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0
    whole = abs(volume - hull.volume) <= _WHOLE * hull.volume and abs(area - hull.area) <= _WHOLE * hull.area
    return bool(whole) and _lies_on(hull, mesh, _FLAT_TOLERANCE * float(np.ptp(mesh.vertices, axis=0).max()))


def _lies_on(hull: Any, mesh: Mesh, tolerance: float) -> bool:
    """Whether each triangle of a mesh lies in the plane of a face of the hull of its vertices, within `tolerance` [m].

    For a hull of many faces, only faces at one of the triangle's corners are compared; if there are none, it is False.
    """
    corners, planes = mesh.vertices[mesh.faces], np.unique(hull.equations.round(12), axis=0)
    if len(corners) * len(planes) <= _MOST_PRODUCTS:
        heights = np.abs(corners @ planes[:, :3].T + planes[:, 3]).max(axis=1)
        return bool((heights.min(axis=1) <= tolerance).all())
    counts = np.bincount(hull.simplices.ravel(), minlength=len(mesh.vertices))
    at = counts[mesh.faces]
    fewest = np.where(at > 0, at, np.iinfo(at.dtype).max).argmin(axis=1)
    corner = mesh.faces[np.arange(len(corners)), fewest]
    many = counts[corner]
    if not many.all():
        return False
    faces = np.argsort(hull.simplices.ravel(), kind="stable") // 3
    first = (np.cumsum(counts) - counts)[corner]
    begins = np.cumsum(many) - many
    triangle = np.repeat(np.arange(len(corners)), many)
    plane = hull.equations[faces[np.arange(len(triangle)) + np.repeat(first - begins, many)]]
    heights = np.abs(np.einsum("nij,nj->ni", corners[triangle], plane[:, :3]) + plane[:, 3:]).max(axis=1)
    return bool((np.minimum.reduceat(heights, begins) <= tolerance).all())


def distance_outside(corners: Array, points: Array) -> Array:
    """Signed distance of points (n, 3) from the hull of `corners` [m], negative inside, shape (n,)."""
    return np.concatenate(list(_distances_outside(corners, points)))


def _distances_outside(corners: Array, points: Array) -> Iterator[Array]:
    """What `distance_outside` returns, in parts of bounded memory."""
    planes = _qhull(corners).equations
    for part in np.array_split(points, 1 + len(points) * len(planes) // _MOST_PRODUCTS):
        yield (part @ planes[:, :3].T + planes[:, 3]).max(axis=1, initial=-np.inf)


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
