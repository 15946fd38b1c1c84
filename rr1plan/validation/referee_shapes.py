"""Shapes as the referee sees them: their bounds, their support functions and what Coal makes of them.

A mesh that is not convex is its triangles and what its closed parts enclose, a point cloud the union of the cells of
its grid (an octree's leaves).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np

from rr1plan.checks import Array
from rr1plan.errors import BackendError, InputError
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, PointCloud, Shape, Sphere
from rr1plan.shapes.convex_hulls import convex_hull
from rr1plan.validation.cloud_blocks import CellBlocks
from rr1plan.validation.hull_support import Core, hull_core
from rr1plan.validation.mesh_surfaces import Surface
from rr1plan.validation.referee_kernels import BOX, CYLINDER, PLANE, SHAPE_CONCAVE, SHAPE_SURFACE

CONVEX, CONCAVE, HALF_SPACE = 1, 2, 3
Triple = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Solid:
    """A shape and its bounds in its own frame.

    Args:
        shape: The shape.
        center: Middle of its bounding box [m], shape (3,).
        half: Half the edges of that box [m], shape (3,); infinite for a half-space.
        radius: All its points are within this of the center [m].
        points: Corners of a hull, of a mesh, or centers of a cloud's cells, shape (n, 3).
        convex: Coal's normal for it can be proven by its support function.
        surface: The triangles of a mesh that is not convex.
        cells: Those of a cloud.
    """

    shape: Shape
    center: Array
    half: Array
    radius: float
    points: Array
    convex: bool = True
    surface: Surface | None = None
    cells: CellBlocks | None = None

    @cached_property
    def core(self) -> Core:
        """What the compiled search knows of it, without its rounding."""
        if self.surface is not None and self.surface.can_be_searched:
            columns = self.surface.columns
            return Core(SHAPE_SURFACE, columns.shape[1], columns)
        if len(self.points):
            return hull_core(self.points) if self.convex else Core(SHAPE_CONCAVE)
        return Core(core_row(self.shape).kind)

    @property
    def sizes(self) -> Array:
        """What the compiled search reads of its size, in columns `HALF` to `BOUND`, shape (8,)."""
        row = core_row(self.shape)
        return np.array([*row.half, row.rounding, row.radius, *row.box])

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


class CoreRow(NamedTuple):
    """What the compiled search reads of a shape in its frame; see `BodySizes` in `referee_tables.h`.

    Args:
        kind: What it is to the kernels.
        single: Number of corners to look at one by one.
        columns: Its columns of `corners`.
        half: Half edges, or what stands for them.
        rounding: Radius around that [m].
        radius: Of the ball around all [m].
        box: Half edges of its bounding box [m].
        center: Middle of that box [m].
    """

    kind: int
    single: int
    columns: int
    half: Triple
    rounding: float
    radius: float
    box: Triple
    center: Triple = (0.0, 0.0, 0.0)


def core_row(shape: Shape) -> CoreRow:
    """What the compiled search reads of a shape."""
    if isinstance(shape, Box):
        x, y, z = shape.size
        half = 0.5 * x, 0.5 * y, 0.5 * z
        return CoreRow(BOX, 0, 0, half, 0.0, math.hypot(*half), half)
    if isinstance(shape, Cylinder):
        r, h = shape.radius, 0.5 * shape.length
        return CoreRow(CYLINDER, 0, 0, (r, r, h), 0.0, math.hypot(r, h), (r, r, h))
    if isinstance(shape, Sphere):
        r = shape.radius
        return CoreRow(BOX, 0, 0, (0.0, 0.0, 0.0), r, r, (r, r, r))
    if isinstance(shape, Capsule):
        r, h = shape.radius, 0.5 * shape.length
        return CoreRow(BOX, 0, 0, (0.0, 0.0, h), r, h + r, (r, r, h + r))
    if isinstance(shape, HalfSpace):
        return CoreRow(PLANE, 0, 0, shape.normal, shape.offset, math.inf, (math.inf, math.inf, math.inf))
    body = solid(shape)
    (x, y, z), (a, b, c) = body.half.tolist(), body.center.tolist()
    return CoreRow(*body.core.row, (0.0, 0.0, 0.0), 0.0, body.radius, (x, y, z), (a, b, c))


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
        # A hull of the corners again: it holds the mesh even where the flag is wrong.
        return _bounded(mesh, mesh.vertices, 0.0, convex=True)
    corners = mesh.vertices if mesh.convex else mesh.vertices[np.unique(mesh.faces)]
    return replace(_bounded(mesh, corners, 0.0, convex=False), surface=Surface(mesh))


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
        # A hull of its own: it holds the mesh even where the flag is wrong.
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
    """Whether points lie in a plane: Coal's hull of such points ends the process."""
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
