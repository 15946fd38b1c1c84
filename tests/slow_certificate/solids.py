"""Shapes for the slow certificate: their bounds, support functions and Coal geometries.

A concave mesh consists of its triangles and the inside of its closed parts, a point cloud of the cells of its grid (an
octree's leaves).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from rr1plan.checks import Array
from rr1plan.errors import BackendError, InputError
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, PointCloud, Shape, Sphere
from rr1plan.shapes.convex_hulls import convex_hull
from slow_certificate.cell_blocks import CellBlocks
from slow_certificate.insides import Inside

CONVEX, CONCAVE, HALF_SPACE = 1, 2, 3


@dataclass(frozen=True, eq=False)
class Solid:
    """A shape and its bounds in its own frame.

    Args:
        shape: The shape.
        center: Middle of its bounding box [m], shape (3,).
        half: Half the edges of that box [m], shape (3,); infinite for a half-space.
        radius: Largest distance of its points from the center [m].
        points: Corners of a hull, of a mesh, or centers of a cloud's cells, shape (n, 3).
        convex: Whether its support function can prove Coal's normal for it.
        inside: The inside of a concave mesh.
        cells: The cells of a cloud.
    """

    shape: Shape
    center: Array
    half: Array
    radius: float
    points: Array
    convex: bool = True
    inside: Inside | None = None
    cells: CellBlocks | None = None

    @property
    def form(self) -> int:
        """`CONVEX`, `CONCAVE` (a cloud too) or `HALF_SPACE`."""
        return CONVEX if self.convex else CONCAVE if np.isfinite(self.radius) else HALF_SPACE

    @cached_property
    def geometry(self) -> Any:
        """Its Coal geometry; a half-space and a point cloud have none.

        Raises:
            BackendError: Coal cannot build it.
        """
        return _coal_geometry(self)


def solid(shape: Shape) -> Solid:
    """The solid of a shape."""
    if isinstance(shape, Mesh):
        return _mesh_solid(shape)
    return _cloud_solid(shape) if isinstance(shape, PointCloud) else _primitive_solid(shape)


@lru_cache(maxsize=4096)
def _primitive_solid(shape: Box | Sphere | Cylinder | Capsule | HalfSpace) -> Solid:
    zero, none = np.zeros(3), np.zeros((0, 3))
    if isinstance(shape, HalfSpace):
        return Solid(shape, zero, np.full(3, np.inf), np.inf, none, convex=False)
    if isinstance(shape, Box):
        half = 0.5 * np.array(shape.size)
        return Solid(shape, zero, half, float(np.linalg.norm(half)), none)
    if isinstance(shape, Sphere):
        return Solid(shape, zero, np.full(3, shape.radius), shape.radius, none)
    r, h = shape.radius, 0.5 * shape.length
    if isinstance(shape, Capsule):
        return Solid(shape, zero, np.array([r, r, h + r]), h + r, none)
    return Solid(shape, zero, np.array([r, r, h]), float(np.hypot(r, h)), none)


def _bounded(shape: Shape, points: Array, thickness: float, convex: bool) -> Solid:
    """A solid of points, each a cube of half edge `thickness`."""
    lower, upper = points.min(axis=0) - thickness, points.max(axis=0) + thickness
    center = 0.5 * (lower + upper)
    radius = float(np.linalg.norm(points - center, axis=1).max()) + np.sqrt(3.0) * thickness
    return Solid(shape, center, 0.5 * (upper - lower), radius, points, convex)


@lru_cache(maxsize=512)
def _mesh_solid(mesh: Mesh) -> Solid:
    if mesh.convex and not _is_flat(mesh.vertices):
        # The hull of the corners contains the mesh even if its `convex` flag is wrong.
        return _bounded(mesh, mesh.vertices, 0.0, convex=True)
    corners = mesh.vertices if mesh.convex else mesh.vertices[np.unique(mesh.faces)]
    return replace(_bounded(mesh, corners, 0.0, convex=False), inside=Inside(mesh))


def _coal_geometry(body: Solid) -> Any:
    import coal

    shape = body.shape
    if isinstance(shape, Box):
        return coal.Box(*shape.size)
    if isinstance(shape, Sphere):
        return coal.Sphere(shape.radius)
    if isinstance(shape, Capsule):
        return coal.Capsule(shape.radius, shape.length)
    if isinstance(shape, Cylinder):
        return coal.Cylinder(shape.radius, shape.length)
    return _coal_mesh(shape, body.convex) if isinstance(shape, Mesh) else None


def _coal_mesh(mesh: Mesh, convex: bool) -> Any:
    import coal

    if convex:
        # The hull computed here contains the mesh even if its `convex` flag is wrong.
        mesh = convex_hull(mesh.vertices)
    points = coal.StdVec_Vec3s()
    points.extend(list(np.array(mesh.vertices)))
    try:
        triangles = coal.StdVec_Triangle()
        triangles.extend([coal.Triangle(int(a), int(b), int(c)) for a, b, c in mesh.faces])
        if convex:
            return coal.Convex(points, triangles)
        surface = coal.BVHModelOBBRSS()
        surface.beginModel(len(mesh.faces), len(mesh.vertices))
        surface.addSubModel(points, triangles)
        surface.endModel()
    except Exception as error:
        raise BackendError(f"Coal cannot build a mesh of {len(mesh.faces)} faces: {error}") from error
    return surface


def _is_flat(points: Array) -> bool:
    """Whether points lie in a plane: Coal's hull of such points crashes the process."""
    thickness = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(thickness[-1] <= 1e-6 * thickness[0])


@lru_cache(maxsize=16)
def _cloud_solid(cloud: PointCloud) -> Solid:
    cells = CellBlocks(cloud)
    return replace(_bounded(cloud, cells.centers, cells.half, convex=False), cells=cells)


def support(body: Solid, directions: Array) -> Array:
    """Largest n . p over the points p of a bounded solid, for directions (k, 3) in its frame, shape (k,)."""
    shape = body.shape
    if isinstance(shape, Box):
        return np.asarray(np.abs(directions) @ body.half)
    if isinstance(shape, Sphere):
        return np.asarray(shape.radius * np.linalg.norm(directions, axis=1))
    if isinstance(shape, Capsule):
        return np.asarray(
            shape.radius * np.linalg.norm(directions, axis=1) + 0.5 * shape.length * np.abs(directions[:, 2])
        )
    if isinstance(shape, Cylinder):
        across = np.hypot(directions[:, 0], directions[:, 1])
        return np.asarray(shape.radius * across + 0.5 * shape.length * np.abs(directions[:, 2]))
    if isinstance(shape, HalfSpace):
        raise InputError("a half-space has no support function")
    reach = (directions @ body.points.T).max(axis=1)
    if isinstance(shape, PointCloud):
        reach = reach + 0.5 * shape.resolution * np.abs(directions).sum(axis=1)
    return np.asarray(reach)
