"""Shapes as the referee's kernels read them.

A mesh that is not convex is its triangles and what its closed parts enclose, a point cloud the union of the cells of
its grid (an octree's leaves).
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from rr1plan.checks import Array
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, PointCloud, Shape, Sphere
from rr1plan.validation.hull_support import Core, hull_core
from rr1plan.validation.mesh_surfaces import PartTree, cell_parts, surface_parts
from rr1plan.validation.referee_kernels import BOX, CYLINDER, GRID_CELLS, PLANE, SURFACE

Triple = tuple[float, float, float]


class CoreRow(NamedTuple):
    """What the kernels read of a shape in its frame; see `BodySizes` in `referee_tables.h`.

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


class PointBody(NamedTuple):
    """A mesh or a point cloud.

    Args:
        core: What the kernels read of it besides its sizes.
        row: Its sizes.
        tree: The tree of its parts; None for a convex one.
    """

    core: Core
    row: CoreRow
    tree: PartTree | None


def core_row(shape: Shape) -> CoreRow:
    """What the kernels read of a shape."""
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
    return point_body(shape).row


@lru_cache(maxsize=512)
def point_body(shape: Mesh | PointCloud) -> PointBody:
    """A mesh or a point cloud as the kernels read it, made once."""
    if isinstance(shape, PointCloud):
        columns, tree = cell_parts(shape)
        core, half = Core(GRID_CELLS, columns.shape[1], columns), 0.5 * shape.resolution
        return PointBody(core, _bounded(core, columns[:3].T, half), tree)
    if shape.convex and not _is_flat(shape.vertices):
        # A hull of the corners again: it holds the mesh even where the flag is wrong.
        core = hull_core(shape.vertices)
        return PointBody(core, _bounded(core, shape.vertices, 0.0), None)
    columns, tree = surface_parts(shape)
    core = Core(SURFACE, columns.shape[1], columns)
    return PointBody(core, _bounded(core, columns[:3].T, 0.0), tree)


def _bounded(core: Core, points: Array, thickness: float) -> CoreRow:
    """The sizes of points (n, 3), each a cube of half edge `thickness` [m]."""
    lower, upper = points.min(axis=0) - thickness, points.max(axis=0) + thickness
    center = 0.5 * (lower + upper)
    radius = float(np.linalg.norm(points - center, axis=1).max()) + math.sqrt(3.0) * thickness
    (x, y, z), (a, b, c) = (0.5 * (upper - lower)).tolist(), center.tolist()
    return CoreRow(*core.row, (thickness, thickness, thickness), 0.0, radius, (x, y, z), (a, b, c))


def _is_flat(points: Array) -> bool:
    """Whether points lie in a plane: a hull of such points has no inside."""
    thickness = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(thickness[-1] <= 1e-6 * thickness[0])
