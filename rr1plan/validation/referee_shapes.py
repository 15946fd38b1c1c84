"""Shapes for the referee's kernels.

A non-convex mesh consists of its triangles and the volume that its closed parts enclose. A point cloud is the union of
the cells of its grid (an octree's leaves).
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


class PointBody(NamedTuple):
    """A mesh or a point cloud.

    Args:
        core: Its kind and corners.
        row: Its sizes; see `core_row`.
        tree: The tree of its parts; None for a convex body.
    """

    core: Core
    row: tuple[float, ...]
    tree: PartTree | None


def core_row(shape: Shape) -> tuple[float, ...]:
    """A shape in its own frame for the kernels, a `ShapeRow` of `referee_tables.h`.

    Returns:
        14 numbers: kind, number of corners to test one by one, number of columns of `corners`; half edges or the
        values that replace them (3), rounding radius, radius of the bounding ball, half edges (3) and center (3) of
        the bounding box [m].
    """
    if isinstance(shape, Box):
        x, y, z = shape.size
        x, y, z = 0.5 * x, 0.5 * y, 0.5 * z
        return BOX, 0, 0, x, y, z, 0.0, math.hypot(x, y, z), x, y, z, 0.0, 0.0, 0.0
    if isinstance(shape, Cylinder):
        r, h = shape.radius, 0.5 * shape.length
        return CYLINDER, 0, 0, r, r, h, 0.0, math.hypot(r, h), r, r, h, 0.0, 0.0, 0.0
    if isinstance(shape, Sphere):
        r = shape.radius
        return BOX, 0, 0, 0.0, 0.0, 0.0, r, r, r, r, r, 0.0, 0.0, 0.0
    if isinstance(shape, Capsule):
        r, h = shape.radius, 0.5 * shape.length
        return BOX, 0, 0, 0.0, 0.0, h, r, h + r, r, r, h + r, 0.0, 0.0, 0.0
    if isinstance(shape, HalfSpace):
        wide = math.inf
        return PLANE, 0, 0, *shape.normal, shape.offset, wide, wide, wide, wide, 0.0, 0.0, 0.0
    return point_body(shape).row


@lru_cache(maxsize=512)
def point_body(shape: Mesh | PointCloud) -> PointBody:
    """A mesh or a point cloud for the kernels, made once."""
    if isinstance(shape, PointCloud):
        columns, tree = cell_parts(shape)
        core, half = Core(GRID_CELLS, columns.shape[1], columns), 0.5 * shape.resolution
        return PointBody(core, _bounded(core, columns[:3].T, half), tree)
    if shape.convex and not _is_flat(shape.vertices):
        # Take the hull again: it contains the mesh even if the flag is wrong.
        core = hull_core(shape.vertices)
        return PointBody(core, _bounded(core, shape.vertices, 0.0), None)
    columns, tree = surface_parts(shape)
    core = Core(SURFACE, columns.shape[1], columns)
    return PointBody(core, _bounded(core, columns[:3].T, 0.0), tree)


def _bounded(core: Core, points: Array, thickness: float) -> tuple[float, ...]:
    """The row of points (n, 3), each a cube of half edge `thickness` [m]."""
    lower, upper = points.min(axis=0) - thickness, points.max(axis=0) + thickness
    center = 0.5 * (lower + upper)
    radius = float(np.linalg.norm(points - center, axis=1).max()) + math.sqrt(3.0) * thickness
    half = [thickness] * 3
    return (*core.row, *half, 0.0, radius, *(0.5 * (upper - lower)).tolist(), *center.tolist())


def _is_flat(points: Array) -> bool:
    """Whether points lie in a plane: the hull of such points has no interior."""
    thickness = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(thickness[-1] <= 1e-6 * thickness[0])
