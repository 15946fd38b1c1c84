"""What the exact kernel knows of bodies by themselves: each a core, a radius around it, and volumes that bound it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.collision.arm_geometry import Solid
from rr1plan.collision.enclosing_ball import around_points
from rr1plan.collision.mesh_trees import box_of_mesh
from rr1plan.collision.solids import occupied_cells
from rr1plan.kernels.library import constants
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, PointCloud, Shape, Sphere

# Stands for infinity where infinity times zero would be NaN.
FAR = 1e12
_INTS = NDArray[np.int64]
_KIND = constants()


@dataclass(frozen=True, eq=False)
class BodyTables:
    """The tables of some bodies by themselves; columns as in `ExactTables`.

    Args:
        bodies, values, corners: As there, corners and chains counted from these bodies' first.
        degrees, neighbors: How many edges leave each corner, and where they lead, corner after corner.
        poses, centers: Where the bodies and the centers of their balls are at q = 0.
    """

    bodies: _INTS
    values: Array
    corners: Array
    degrees: _INTS
    neighbors: _INTS
    poses: Array
    centers: Array


def flat(T: Array) -> Array:
    """A transform as its rotation row by row and its translation, shape (12,)."""
    return np.concatenate([T[:3, :3].ravel(), T[:3, 3]])


def body_tables(solids: Sequence[Solid], joint_poses: Array) -> BodyTables:
    """The tables of solids, their chains left empty."""
    cores = [_core(solid.shape) for solid in solids]
    around = [_neighbors(solid.shape) for solid in solids]
    joints = np.array([solid.joint for solid in solids], dtype=np.int64)
    T = np.array([solid.placement for solid in solids]).reshape(-1, 4, 4)
    balls = np.array([core.ball for core in cores]).reshape(-1, 3)
    ends = np.cumsum([len(core.points) for core in cores], dtype=np.int64)
    begins = np.concatenate([[0], ends])[:-1]
    bodies, values = np.zeros((len(solids), 6), np.int64), np.empty((len(solids), 27))
    bodies[:, 0], bodies[:, 1] = [core.kind for core in cores], joints
    bodies[:, 2], bodies[:, 3] = begins, ends
    values[:, :9], values[:, 9:12] = T[:, :3, :3].reshape(-1, 9), T[:, :3, 3]
    values[:, 12:15] = np.einsum("nij,nj->ni", T[:, :3, :3], balls) + T[:, :3, 3]
    values[:, 15:] = np.array([core.values for core in cores]).reshape(-1, 12)
    R, t = joint_poses[joints, :9].reshape(-1, 3, 3), joint_poses[joints, 9:]
    poses = np.empty((len(solids), 12))
    poses[:, :9] = (R @ T[:, :3, :3]).reshape(-1, 9)
    poses[:, 9:] = np.einsum("nij,nj->ni", R, T[:, :3, 3]) + t
    centers = np.einsum("nij,nj->ni", R, values[:, 12:15]) + t
    return BodyTables(
        bodies,
        values,
        np.concatenate([np.zeros((0, 3)), *(core.points for core in cores)]),
        np.concatenate([np.zeros(0, np.int64), *(degrees for degrees, _ in around)]),
        np.concatenate([np.zeros(0, np.int64), *(to + begin for (_, to), begin in zip(around, begins, strict=True))]),
        poses,
        centers,
    )


@lru_cache(maxsize=256)
def _neighbors(shape: Shape) -> tuple[_INTS, _INTS]:
    """How many edges leave each point of a shape's core, and where they lead, point after point."""
    count = len(_core(shape).points)
    if not (isinstance(shape, Mesh) and shape.convex):
        return np.zeros(count, np.int64), np.zeros(0, np.int64)
    edges = np.concatenate([shape.faces[:, pair] for pair in ([0, 1], [1, 2], [2, 0], [1, 0], [2, 1], [0, 2])])
    edges = np.unique(edges, axis=0).astype(np.int64)
    return np.bincount(edges[:, 0], minlength=count), edges[:, 1].copy()


@dataclass(frozen=True, eq=False)
class _Core:
    """A shape as a core and a radius around it; `points` in the shape's frame.

    `values` are its ball's radius, the radius around the core, its box, its size and its offset, shape (12,).
    """

    kind: int
    ball: Array
    values: Array
    points: Array


@lru_cache(maxsize=512)
def _core(shape: Shape) -> _Core:
    zero, none = np.zeros(3), np.zeros((0, 3))
    match shape:
        case Sphere(radius):
            return _made(_KIND["BODY_POINT"], zero, radius, (zero, radius), (zero, np.full(3, radius)), none)
        case Box(size):
            half = 0.5 * np.array(size)
            return _made(_KIND["BODY_BOX"], half, 0.0, (zero, float(np.linalg.norm(half))), (zero, half), none)
        case Cylinder(radius, length):
            half = np.array([radius, radius, 0.5 * length])
            return _made(
                _KIND["BODY_CYLINDER"], half, 0.0, (zero, float(np.hypot(radius, 0.5 * length))), (zero, half), none
            )
        case Capsule(radius, length):
            core, half = np.array([0, 0, 0.5 * length]), np.array([radius, radius, 0.5 * length + radius])
            return _made(_KIND["BODY_SEGMENT"], core, radius, (zero, 0.5 * length + radius), (zero, half), none)
        case HalfSpace(normal, offset):
            return _made(
                _KIND["BODY_HALF_SPACE"], np.array(normal), 0.0, (zero, FAR), (zero, np.full(3, FAR)), none, offset
            )
        case PointCloud():
            return _cells(shape)
        case _:
            return _corners(shape) if shape.convex else _surface(shape)


def _made(
    kind: int,
    size: Array,
    radius: float,
    ball: tuple[Array, float],
    box: tuple[Array, Array],
    points: Array,
    offset: float = 0.0,
) -> _Core:
    return _Core(kind, ball[0], np.array([ball[1], radius, *box[0], *box[1], *size, offset]), points)


def _cells(cloud: PointCloud) -> _Core:
    cells, half = occupied_cells(cloud), 0.5 * cloud.resolution
    low, high = cells.min(axis=0) - half, cells.max(axis=0) + half
    ball = (0.5 * (low + high), float(np.linalg.norm(0.5 * (high - low))))
    return _made(_KIND["BODY_CELLS"], np.full(3, half), 0.0, ball, (0.5 * (low + high), 0.5 * (high - low)), cells)


def _surface(mesh: Mesh) -> _Core:
    """The bounds of a mesh that is not convex; its triangles are in its `MeshTree`."""
    (center, half), none = box_of_mesh(mesh), np.zeros((0, 3))
    ball = float(np.linalg.norm(mesh.vertices[mesh.faces.ravel()] - center, axis=1).max()) * (1.0 + 1e-12)
    return _made(_KIND["BODY_MESH"], np.zeros(3), 0.0, (center, ball), (center, half), none)


def _corners(mesh: Mesh) -> _Core:
    points = np.array(mesh.vertices)
    ball = around_points(points)
    low, high = points.min(axis=0), points.max(axis=0)
    return _made(
        _KIND["BODY_CORNERS"],
        np.zeros(3),
        0.0,
        (ball[:3], float(ball[3])),
        (0.5 * (low + high), 0.5 * (high - low)),
        points,
    )
