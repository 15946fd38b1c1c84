"""The exact kernel's tables of bodies: each has a core, a radius around it, and bounding volumes."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, read_only
from rr1plan.collision.arm_geometry import Solid
from rr1plan.collision.convex.convex_bodies import occupied_cells
from rr1plan.collision.convex.enclosing_ball import around_points
from rr1plan.collision.convex.mesh_trees import box_of_mesh
from rr1plan.kernels.planner_kernels import CStruct, constants, load_library
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, PointCloud, Shape, Sphere

# Represents infinity where infinity times zero would be NaN.
FAR = 1e12
_INTS = NDArray[np.int64]
_KIND = constants()
_BOX, _CYLINDER = _KIND["BODY_BOX"], _KIND["BODY_CYLINDER"]


class BodyTables(NamedTuple):
    """The tables of some bodies alone; columns as in `ExactTables`.

    Args:
        bodies, values, corners: As there, with corners and chains counted from the first of these bodies.
        degrees, neighbors: Number of edges at each corner, and their other ends, corner after corner.
        poses, centers: Poses of the bodies and centers of their balls at q = 0.
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
    cores = [body_core(solid.shape) for solid in solids]
    around = [neighbors(solid.shape) for solid in solids]
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
def neighbors(shape: Shape) -> tuple[_INTS, _INTS]:
    """Number of edges at each point of a shape's core, and their other ends, point after point."""
    count = len(body_core(shape).points)
    if not (isinstance(shape, Mesh) and shape.convex):
        return np.zeros(count, np.int64), np.zeros(0, np.int64)
    edges = np.concatenate([shape.faces[:, pair] for pair in ([0, 1], [1, 2], [2, 0], [1, 0], [2, 1], [0, 2])])
    edges = np.unique(edges, axis=0).astype(np.int64)
    return np.bincount(edges[:, 0], minlength=count), edges[:, 1].copy()


class BodyCore(NamedTuple):
    """A shape as a core and a radius around it.

    Args:
        kind: Its kind for the exact kernel.
        ball: Center of the ball around it, in its frame [m].
        values: The ball's radius, the radius around the core, center and half sizes of its box, its size and its
            offset: 12 numbers.
        points: Points of the core, in its frame [m], shape (n, 3).
    """

    kind: int
    ball: tuple[float, ...]
    values: tuple[float, ...]
    points: Array


_NONE = read_only(np.zeros((0, 3)))
_SIZE = struct.Struct("q4d")


def shape_size(shape: Shape) -> bytes:
    """A shape as a `ShapeSize` of the kernels."""
    match shape:
        case Box():
            return _SIZE.pack(_BOX, *shape.size, 0.0)
        case Cylinder():
            return _SIZE.pack(_CYLINDER, shape.radius, shape.length, 0.0, 0.0)
        case Sphere():
            return _SIZE.pack(_KIND["BODY_POINT"], shape.radius, 0.0, 0.0, 0.0)
        case Capsule():
            return _SIZE.pack(_KIND["BODY_SEGMENT"], shape.radius, shape.length, 0.0, 0.0)
        case HalfSpace():
            return _SIZE.pack(_KIND["BODY_HALF_SPACE"], *shape.normal, shape.offset)
        case PointCloud():
            return _SIZE.pack(_KIND["BODY_CELLS"], 0.0, 0.0, 0.0, 0.0)
        case _:
            return _SIZE.pack(_KIND["BODY_CORNERS" if shape.convex else "BODY_MESH"], 0.0, 0.0, 0.0, 0.0)


def describe_solids(
    sizes: bytes,
    frames: bytes,
    counts: Sequence[int],
    poses: bytes,
    first_body: int = 0,
    links: CStruct | None = None,
) -> tuple[CStruct, int]:
    """Solids of objects as the kernels describe them.

    Args:
        sizes: A `ShapeSize` for each solid.
        frames: T_object_solid of each solid, (4, 4) after (4, 4).
        counts: Number of solids of each object.
        poses: T_world_object of each object, (4, 4) after (4, 4).
        first_body: Row of the first solid in the exact kernel's tables.
        links: The `FixedSolids` of the moving arms' links, which come first (default: none).

    Returns:
        Their `FixedSolids`; and the number of meshes and point clouds, whose `SolidShape` is zero.
    """
    links = links or _NO_SOLIDS
    count, objects = links.value.count + sum(counts), links.value.object_count + len(counts)
    fixed = CStruct("FixedSolids", count=count, object_count=objects)
    fixed.give_room(unset=True, solids=count, shapes=count, frames=count, objects=objects)
    given = sizes, frames, np.array(counts, np.int64), poses
    return fixed, load_library().rr1_describe_solids(fixed, links, *given, first_body)


_NO_SOLIDS = CStruct("FixedSolids")
_AT_ORIGIN = np.eye(4).tobytes()


@lru_cache(maxsize=1024)
def body_core(shape: Shape) -> BodyCore:
    """The exact kernel's description of a shape."""
    if isinstance(shape, PointCloud):
        return _cells(shape)
    if isinstance(shape, Mesh):
        return _corners(shape) if shape.convex else _surface(shape)
    size = shape_size(shape)
    values = describe_solids(size, _AT_ORIGIN, [1], _AT_ORIGIN)[0].part("shapes").view(np.float64)[0].tolist()
    return BodyCore(_SIZE.unpack(size)[0], (0.0, 0.0, 0.0), tuple(values[3:15]), _NONE)


def _cells(cloud: PointCloud) -> BodyCore:
    cells, half = occupied_cells(cloud), 0.5 * cloud.resolution
    low, high = cells.min(axis=0) - half, cells.max(axis=0) + half
    ball = float(np.linalg.norm(0.5 * (high - low)))
    return _bounded(_KIND["BODY_CELLS"], 0.5 * (low + high), ball, low, high, (half, half, half), cells)


def _surface(mesh: Mesh) -> BodyCore:
    """The bounds of a non-convex mesh; its triangles are in its `MeshTree`."""
    center, half = box_of_mesh(mesh)
    ball = float(np.linalg.norm(mesh.vertices[mesh.faces.ravel()] - center, axis=1).max()) * (1.0 + 1e-12)
    values = (ball, 0.0, *center.tolist(), *half.tolist(), 0.0, 0.0, 0.0, 0.0)
    return BodyCore(_KIND["BODY_MESH"], tuple(center.tolist()), values, _NONE)


def _corners(mesh: Mesh) -> BodyCore:
    points = np.array(mesh.vertices)
    ball = around_points(points)
    low, high = points.min(axis=0), points.max(axis=0)
    return _bounded(_KIND["BODY_CORNERS"], ball[:3], float(ball[3]), low, high, (0.0, 0.0, 0.0), points)


def _bounded(
    kind: int, center: Array, radius: float, low: Array, high: Array, size: tuple[float, ...], points: Array
) -> BodyCore:
    """A body without a radius around its core, whose box extends from `low` to `high`."""
    box = *(0.5 * (low + high)).tolist(), *(0.5 * (high - low)).tolist()
    return BodyCore(kind, tuple(center.tolist()), (radius, 0.0, *box, *size, 0.0), points)
