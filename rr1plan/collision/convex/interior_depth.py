"""Depths of points inside a solid, for arrays of points.

Each kind of solid has two functions of points in its own frame. `depths` is a lower bound, up to rounding, of the
signed depth: if it is positive, a ball of this radius around the point fits into the solid; if it is negative, the
solid is within this distance. `nearest` moves points to where the depth reaches a wanted value; it guides searches, and
no proof relies on it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np

from rr1plan.checks import Array, read_only
from rr1plan.collision.convex.convex_bodies import occupied_cells
from rr1plan.collision.convex.mesh_trees import box_of_mesh, mesh_tree
from rr1plan.kernels.planner_kernels import CStruct, load_library
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, PointCloud, Shape, Sphere

_TINY = 1e-300
_ORIGIN = read_only(np.zeros(3))
# Steps onto the most violated face of a polytope, for each call.
_STEPS = 4


class Interior(Protocol):
    """The interior of a solid."""

    @property
    def center(self) -> Array:
        """A point inside, shape (3,)."""
        ...

    @property
    def radius(self) -> float:
        """All points of the solid are within this distance of `center` [m]; inf for a half-space."""
        ...

    @property
    def convex(self) -> bool:
        """Whether a locally nearest point is the globally nearest one."""
        ...

    @property
    def faces(self) -> int:
        """Number of planes that are tested for each point; 1 for round solids and boxes."""
        ...

    def depths(self, points: Array, margin: float) -> Array:
        """Lower bound of the signed depth of points (n, 3) [m], positive inside, shape (n,).

        It may be coarse for points farther outside than `margin` [m].
        """
        ...

    def nearest(self, points: Array, depth: Array) -> Array:
        """Points (n, 3) moved to a wanted depth (n,) >= 0 [m], or as deep as the solid allows, shape (n, 3)."""
        ...


@lru_cache(maxsize=256)
def interior_of(shape: Shape) -> Interior:
    """The interior of a solid: one of the shapes that `solid_pieces` returns."""
    match shape:
        case Sphere(radius):
            return _Round(radius, 0.0)
        case Capsule(radius, length):
            return _Round(radius, 0.5 * length)
        case Cylinder(radius, length):
            return _CylinderInterior(radius, 0.5 * length)
        case Box(size):
            return _BoxInterior(0.5 * np.array(size))
        case HalfSpace(normal, offset):
            return _HalfSpaceInterior(np.array(normal), offset)
        case PointCloud():
            return _CloudInterior(shape)
        case Mesh():
            return _PolytopeInterior(shape) if shape.convex else _SurfaceInterior(shape)


@dataclass(frozen=True, eq=False)
class _Round:
    """A ball, or a capsule: everything within `radius` of a segment along z."""

    radius_of_ball: float
    half: float

    faces, convex, center = 1, True, _ORIGIN

    @property
    def radius(self) -> float:
        return self.radius_of_ball + self.half

    def _from_core(self, points: Array) -> Array:
        away = points.copy()
        away[:, 2] -= np.clip(points[:, 2], -self.half, self.half)
        return away

    def depths(self, points: Array, margin: float) -> Array:
        return np.asarray(self.radius_of_ball - np.linalg.norm(self._from_core(points), axis=1))

    def nearest(self, points: Array, depth: Array) -> Array:
        away = self._from_core(points)
        allowed = np.maximum(self.radius_of_ball - depth, 0.0)
        share = np.minimum(1.0, allowed / np.maximum(np.linalg.norm(away, axis=1), _TINY))
        return np.asarray(points - away * (1.0 - share)[:, None])


def _box_depths(beyond: Array) -> Array:
    """Depth below perpendicular faces, from the distances of points beyond each face (n, k), shape (n,)."""
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    return np.asarray(np.where(outside > 0.0, -outside, -beyond.max(axis=1)))


@dataclass(frozen=True, eq=False)
class _BoxInterior:
    half: Array

    faces, convex, center = 1, True, _ORIGIN

    @property
    def radius(self) -> float:
        return float(np.linalg.norm(self.half))

    def depths(self, points: Array, margin: float) -> Array:
        return _box_depths(np.abs(points) - self.half)

    def nearest(self, points: Array, depth: Array) -> Array:
        reach = np.maximum(self.half - depth[:, None], 0.0)
        return np.clip(points, -reach, reach)


@dataclass(frozen=True, eq=False)
class _CylinderInterior:
    radius_of_disc: float
    half: float

    faces, convex, center = 1, True, _ORIGIN

    @property
    def radius(self) -> float:
        return float(np.hypot(self.radius_of_disc, self.half))

    def depths(self, points: Array, margin: float) -> Array:
        off = np.hypot(points[:, 0], points[:, 1])
        return _box_depths(np.column_stack([off - self.radius_of_disc, np.abs(points[:, 2]) - self.half]))

    def nearest(self, points: Array, depth: Array) -> Array:
        off = np.maximum(np.hypot(points[:, 0], points[:, 1]), _TINY)
        share = np.minimum(1.0, np.maximum(self.radius_of_disc - depth, 0.0) / off)
        reach = np.maximum(self.half - depth, 0.0)
        return np.column_stack([points[:, :2] * share[:, None], np.clip(points[:, 2], -reach, reach)])


@dataclass(frozen=True, eq=False)
class _HalfSpaceInterior:
    normal: Array
    offset: float

    faces, convex = 1, True

    @property
    def center(self) -> Array:
        return self.offset * self.normal

    @property
    def radius(self) -> float:
        return np.inf

    def depths(self, points: Array, margin: float) -> Array:
        return self.offset - points @ self.normal

    def nearest(self, points: Array, depth: Array) -> Array:
        return points - np.maximum(depth - self.depths(points, 0.0), 0.0)[:, None] * self.normal


class _PolytopeInterior:
    """A convex mesh by the planes of its faces."""

    convex = True

    def __init__(self, mesh: Mesh) -> None:
        from scipy.spatial import ConvexHull  # a fifth of a second, which no first plan should wait for

        planes = np.unique(ConvexHull(mesh.vertices).equations.round(15), axis=0)
        self._normals, self._offsets = planes[:, :3].copy(), -planes[:, 3]
        self.faces = len(planes)
        self.center: Array = mesh.vertices.mean(axis=0)
        self.radius = float(np.linalg.norm(mesh.vertices - self.center, axis=1).max())

    def depths(self, points: Array, margin: float) -> Array:
        depth = (self._offsets - points @ self._normals.T).min(axis=1)
        outside = np.flatnonzero((depth < 0.0) & (depth >= -margin))
        depth[depth < -margin] = -np.inf
        if len(outside):
            far = points[outside]
            depth[outside] = -np.linalg.norm(far - self._inside(self.nearest(far, np.zeros(len(far)))), axis=1)
        return np.asarray(depth)

    def _inside(self, points: Array) -> Array:
        """Points pulled toward the center until they are inside."""
        room, rays = self._offsets - self._normals @ self.center, points - self.center
        reach = (rays @ self._normals.T / room).max(axis=1)
        return np.asarray(self.center + rays / np.maximum(reach, 1.0)[:, None])

    def nearest(self, points: Array, depth: Array) -> Array:
        moved, rows = points.copy(), np.arange(len(points))
        for _ in range(_STEPS):
            slack = self._offsets - moved @ self._normals.T
            tightest = slack.argmin(axis=1)
            moved -= np.maximum(depth - slack[rows, tightest], 0.0)[:, None] * self._normals[tightest]
        return moved


class _SurfaceInterior:
    """A non-convex mesh, by the nearest point of its surface."""

    convex = False

    def __init__(self, mesh: Mesh) -> None:
        self.faces = len(mesh.faces)
        self.center, half = box_of_mesh(mesh)
        self.radius = float(np.linalg.norm(half))
        self._tables = CStruct("MeshTables", **vars(mesh_tree(mesh)))

    def _measured(self, points: Array) -> tuple[Array, Array]:
        """Depths (n,) and vectors to the surface (n, 3) of points (n, 3) [m]."""
        depths, vectors = np.zeros(len(points)), np.zeros((len(points), 3))
        load_library().rr1_mesh_depths(self._tables, points - self.center, len(points), depths, vectors)
        return depths, vectors

    def depths(self, points: Array, margin: float) -> Array:
        return self._measured(points)[0]

    def nearest(self, points: Array, depth: Array) -> Array:
        found, vectors = self._measured(points)
        # Inward is toward the surface from outside, away from it from inside.
        share = (found - depth) / np.maximum(np.abs(found), _TINY)
        return np.asarray(
            points + np.where((found < depth) & (found != 0.0), share * np.sign(found), 0.0)[:, None] * vectors
        )


class _CloudInterior:
    """A point cloud, by the cell whose center is nearest to a point."""

    convex = False

    def __init__(self, cloud: PointCloud) -> None:
        from scipy.spatial import cKDTree

        self._centers, self._half = occupied_cells(cloud), 0.5 * cloud.resolution
        self._tree = cKDTree(self._centers)
        self.faces = 6
        self.center: Array = 0.5 * (self._centers.min(axis=0) + self._centers.max(axis=0))
        away = np.linalg.norm(self._centers - self.center, axis=1).max()
        self.radius = float(away + self._half * 3**0.5)

    def _cell(self, points: Array) -> Array:
        return np.asarray(self._centers[self._tree.query(points)[1]])

    def depths(self, points: Array, margin: float) -> Array:
        return _box_depths(np.abs(points - self._cell(points)) - self._half)

    def nearest(self, points: Array, depth: Array) -> Array:
        cell, reach = self._cell(points), np.maximum(self._half - depth, 0.0)[:, None]
        return np.asarray(cell + np.clip(points - cell, -reach, reach))
