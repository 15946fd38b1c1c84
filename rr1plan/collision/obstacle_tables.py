"""The tables of solids that do not move, made once for an obstacle at its place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, read_only
from rr1plan.collision.arm_instances import ArmInstances
from rr1plan.collision.arm_tables import instance_tables
from rr1plan.collision.cores import NO_CORES, Cores, CoreTables, joined_cores
from rr1plan.collision.link_spheres import matrix
from rr1plan.collision.obstacle_geometry import ObstacleGeometry, obstacle_bodies
from rr1plan.collision.solids import is_concave
from rr1plan.kept import kept_in
from rr1plan.kernels.library import constants
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, PointCloud, Shape, Sphere

_INTS = NDArray[np.int64]
LANES = constants()["LANES"]
_KIND = constants()
# Meshes of more corners are left to the exact kernel, which walks along edges instead of looking at all.
_MOST_POINTS = 2000


@dataclass(frozen=True, eq=False)
class ObstacleTables:
    """Rows of solids that do not move; columns as in `EdgeTables`.

    Args:
        kinds, values: `obstacles` and `obstacle_values` there.
        boxes: Box around each, low and high [m], shape (n, 6).
        core_of: As there, counted from the first of `cores`.
        cores: Their cores.
    """

    kinds: _INTS
    values: Array
    boxes: Array
    core_of: _INTS
    cores: CoreTables


def obstacle_tables(obstacles: Sequence[ObstacleGeometry]) -> list[ObstacleTables]:
    """The rows of obstacles, each made once; those that are new together, which takes hardly longer than one."""
    new = [thing for thing in obstacles if "tables" not in thing.kept]
    if new:
        rows = obstacle_bodies(new)
        poses, bodies = (np.concatenate(parts) for parts in zip(*((r.poses, r.values) for r in rows), strict=True))
        kinds, values, boxes = _measured([solid.shape for thing in new for solid in thing.solids], poses, bodies)
        end = 0
        for thing, own in zip(new, rows, strict=True):
            begin, end = end, end + len(thing.solids)
            cores = _cores([solid.shape for solid in thing.solids], own.poses)
            thing.kept["tables"] = ObstacleTables(kinds[begin:end], values[begin:end], boxes[begin:end], *cores)
    return [thing.kept["tables"] for thing in obstacles]


def fixed_links(instances: ArmInstances) -> ObstacleTables:
    """Rows of the arms' bodies that no joint moves; cached."""
    return kept_in(instances.kept, "fixed links", lambda: _fixed_links(instances))


def _fixed_links(instances: ArmInstances) -> ObstacleTables:
    bodies, fixed = instance_tables(instances).bodies, np.flatnonzero(instances.groups == 0)
    shapes = [solid.shape for geometry in instances.geometries for solid in geometry.solids]
    own, poses = [shapes[i] for i in fixed], bodies.poses[fixed]
    return ObstacleTables(*_measured(own, poses, bodies.values[fixed]), *_cores(own, poses))


def _measured(shapes: list[Shape], poses: Array, bodies: Array) -> tuple[_INTS, Array, Array]:
    """Kinds, values and boxes of solids, by their world poses and their rows of the exact kernel's `body_values`."""
    measures = np.array([_measures(shape) for shape in shapes]).reshape(-1, 6)
    R, half = poses[:, :9].reshape(-1, 3, 3), bodies[:, 20:23]
    centers = np.einsum("nij,nj->ni", R, bodies[:, 17:20]) + poses[:, 9:]
    extents = np.einsum("nij,nj->ni", np.abs(R), half)
    values = np.concatenate([poses[:, :9], centers, measures[:, 2:], -measures[:, 4:5]], axis=1)
    around = measures[:, 1] == 0
    values[around, 12:15], values[around, 16] = half[around], -half[around, 2]
    boxes = np.concatenate([centers - extents, centers + extents], axis=1)
    for i, shape in enumerate(shapes):
        if isinstance(shape, HalfSpace):
            normal = R[i] @ np.array(shape.normal)
            values[i] = 0.0
            values[i, [2, 5, 8]], values[i, 16] = normal, -np.inf
            values[i, 9:12] = (shape.offset + float(normal @ poses[i, 9:])) * normal
            boxes[i] = _box_of_half_space(normal, float(values[i, 9:12] @ normal))
    return read_only(measures[:, :2].astype(np.int64)), read_only(values), read_only(boxes)


def _box_of_half_space(normal: Array, offset: float) -> Array:
    """The box around all points p with normal.p <= offset: finite at one end where the normal is along an axis."""
    box = np.array([-np.inf] * 3 + [np.inf] * 3)
    axis = int(np.argmax(np.abs(normal)))
    if np.count_nonzero(normal) == 1:
        box[axis + (3 if normal[axis] > 0.0 else 0)] = offset / normal[axis]
    return box


def _cores(shapes: list[Shape], poses: Array) -> tuple[_INTS, CoreTables]:
    """`core_of` of solids, counted from their first core, and their cores."""
    core_of, cores = np.full(len(shapes), _KIND["CORE_CLOSED_FORM"], np.int64), Cores()
    for i, shape in enumerate(shapes):
        if is_concave(shape):
            core_of[i] = _KIND["CORE_MESH"]
        elif isinstance(shape, Mesh) and len(shape.vertices) <= _MOST_POINTS:
            core_of[i] = cores.add(0, shape, matrix(poses[i]))
        elif isinstance(shape, Mesh | PointCloud):
            core_of[i] = _KIND["CORE_LEFT_OUT"]
    return core_of, cores.tables() if core_of.max(initial=_KIND["CORE_LEFT_OUT"]) >= 0 else NO_CORES


def _measures(shape: Shape) -> tuple[float, ...]:
    """Kind, whether that is the shape itself or a box around it, half sizes (of a shape itself) and radius."""
    match shape:
        case Sphere(radius):
            return _KIND["OBSTACLE_ROUNDED_BOX"], 1, 0.0, 0.0, 0.0, radius
        case Capsule(radius, length):
            return _KIND["OBSTACLE_ROUNDED_BOX"], 1, 0.0, 0.0, 0.5 * length, radius
        case Cylinder(radius, length):
            return _KIND["OBSTACLE_CYLINDER"], 1, radius, radius, 0.5 * length, 0.0
        case Box((x, y, z)):
            return _KIND["OBSTACLE_ROUNDED_BOX"], 1, 0.5 * x, 0.5 * y, 0.5 * z, 0.0
        case HalfSpace():
            return _KIND["OBSTACLE_HALF_SPACE"], 1, 0.0, 0.0, 0.0, 0.0
        case _:
            return _KIND["OBSTACLE_ROUNDED_BOX"], 0, 0.0, 0.0, 0.0, 0.0


# ---- several as one --------------------------------------------------------------------------------

# What is not there is nowhere near.
_NOWHERE = ObstacleTables(
    np.zeros((LANES, 2), np.int64),
    np.zeros((LANES, 17)),
    np.array([[np.inf] * 3 + [-np.inf] * 3] * LANES),
    np.full(LANES, _KIND["CORE_CLOSED_FORM"], np.int64),
    NO_CORES,
)


def joined_obstacles(bodies: CoreTables, parts: Sequence[ObstacleTables], chosen: _INTS) -> ObstacleTables:
    """Rows as one, their cores after those of what moves.

    Args:
        bodies: Cores of what moves.
        parts: The rows.
        chosen: Which of them to take [index]; after the last come a few that are nowhere near anything.
    """
    parts = [*parts, _NOWHERE]
    kinds, values, boxes = (
        np.concatenate([getattr(p, n) for p in parts])[chosen] for n in ("kinds", "values", "boxes")
    )
    cores, (_, *before) = joined_cores([bodies, *(part.cores for part in parts)])
    core_of = [np.where(p.core_of < 0, p.core_of, p.core_of + n) for p, n in zip(parts, before, strict=True)]
    return ObstacleTables(kinds, values, boxes, np.concatenate(core_of)[chosen], cores)
