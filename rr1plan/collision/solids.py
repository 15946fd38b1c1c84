"""Our shapes as Coal's: every one of them solid.

A triangle surface is hollow to Coal's mesh types: a body wholly inside one touches nothing. So a
mesh is never given to Coal as a surface, only as convex pieces.
"""

from __future__ import annotations

from typing import Any

import coal
import numpy as np
from scipy.spatial import ConvexHull, QhullError

from rr1plan.checks import Array
from rr1plan.errors import BackendError, InputError
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, PointCloud, Shape, Sphere

# Octomap's keys have 16 bits: cells farther out would be dropped in silence.
_OCTREE_REACH = 32_000
# A flat mesh has no hull; it gets this much thickness on either side [m].
_FLAT = 1e-6


def hull(points: Array) -> tuple[Array, Any]:
    """The convex hull of points (n, 3): its corners (m, 3) and its triangles, counter-clockwise from outside (k, 3)."""
    try:
        found = ConvexHull(points)
    except QhullError:
        found = _flat_hull(points)
    corners = found.points[found.vertices]
    index = np.full(len(found.points), -1)
    index[found.vertices] = np.arange(len(corners))
    triangles = index[found.simplices]
    a, b, c = (corners[triangles[:, i]] for i in range(3))
    inwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), found.equations[:, :3]) < 0.0
    triangles[inwards] = triangles[inwards][:, ::-1]
    return corners, triangles


def _flat_hull(points: Array) -> Any:
    """The hull of points in a plane, on a line or at a point, made a hair thick."""
    centre = points.mean(axis=0)
    directions = np.linalg.svd(points - centre, full_matrices=True)[2]
    thick = np.concatenate([points + s * _FLAT * d for d in directions for s in (-1.0, 1.0)])
    try:
        return ConvexHull(thick)
    except QhullError as error:
        raise InputError("a mesh has no convex hull: its vertices are degenerate; check its size and units") from error


def convex_pieces(shape: Shape) -> tuple[Shape, ...]:
    """The shape as shapes that Coal treats as solid: itself, or the convex pieces of a mesh."""
    if not isinstance(shape, Mesh):
        return (shape,)
    meshes = (shape,) if shape.convex else solid_pieces(shape)
    return tuple(Mesh(*hull(piece.vertices), convex=True) for piece in meshes)


def solid_pieces(mesh: Mesh) -> tuple[Mesh, ...]:
    """Convex meshes that together hold the matter of a mesh."""
    return (mesh,)


def occupied_cells(cloud: PointCloud) -> Array:
    """Centres of the occupied cells of the grid of side `resolution` [m], shape (n, 3)."""
    keys = np.unique(np.floor(cloud.points / cloud.resolution), axis=0)
    return np.asarray((keys + 0.5) * cloud.resolution)


def coal_geometry(shape: Shape) -> Any:
    """A convex shape or a point cloud as a `coal.CollisionGeometry`."""
    try:
        return _coal_geometry(shape)
    except InputError:
        raise
    except Exception as error:
        raise BackendError(f"Coal cannot take a {type(shape).__name__}: {error}") from error


def _coal_geometry(shape: Shape) -> Any:
    match shape:
        case Box(size):
            return coal.Box(*size)
        case Sphere(radius):
            return coal.Sphere(radius)
        case Cylinder(radius, length):
            return coal.Cylinder(radius, length)
        case Capsule(radius, length):
            return coal.Capsule(radius, length)
        case HalfSpace(normal, offset):
            return coal.Halfspace(np.array(normal), offset)
        case PointCloud():
            return _octree(shape)
        case _:
            return _convex(shape)


def _convex(mesh: Mesh) -> Any:
    vertices, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for vertex in mesh.vertices:
        vertices.append(vertex)
    for a, b, c in mesh.faces:
        triangles.append(coal.Triangle(int(a), int(b), int(c)))
    return coal.Convex(vertices, triangles)


def _octree(cloud: PointCloud) -> Any:
    reach = float(np.abs(cloud.points).max()) / cloud.resolution
    if reach > _OCTREE_REACH:
        raise InputError(
            f"point cloud reaches {reach:.0f} cells from its origin, expected at most {_OCTREE_REACH}; "
            "take a coarser resolution or fewer points"
        )
    # The cells' centres, not the points: a point on a cell's face then cannot fall on either side.
    return coal.makeOctree(occupied_cells(cloud), cloud.resolution)
