"""Convex solids that do not move: of obstacles, and of arms that stand still. Cached by their pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
import pinocchio as pin

from rr1plan.checks import Array, read_only
from rr1plan.collision.arm_geometry import ArmGeometry, Solid, solids_of, surfaceless
from rr1plan.collision.arm_tables import arm_tables
from rr1plan.collision.body_tables import BodyTables, body_tables, flat
from rr1plan.collision.solids import obstacle_pieces
from rr1plan.kept import kept_in
from rr1plan.scene import Obstacle
from rr1plan.shapes import Shape
from rr1plan.skeleton import ElementGeometry


@dataclass(frozen=True, eq=False)
class ObstacleGeometry:
    """Solids that do not move.

    Args:
        solids: The solids; their joint is the world.
        surfaceless: Which of them are half-spaces, point clouds or concave meshes.
        kept: Tables that were made of them.
    """

    solids: tuple[Solid, ...]
    surfaceless: tuple[bool, ...]
    kept: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class _Content:
    """All that the solids of an obstacle depend on, to compare; and what to make them from."""

    name: str
    pose: bytes
    shapes: tuple[tuple[Shape, bytes], ...]
    obstacle: Obstacle = field(compare=False)


def obstacle_geometry(name: str, obstacle: Obstacle) -> ObstacleGeometry:
    """The solids of an obstacle; one that is equal gets the same.

    Raises:
        InputError: a shape that cannot be made solid.
    """
    shapes = tuple((g.shape, g.pose.tobytes()) for g in obstacle.geometries)
    return _obstacle(_Content(name, obstacle.pose.tobytes(), shapes, obstacle))


@lru_cache(maxsize=1024)
def _obstacle(content: _Content) -> ObstacleGeometry:
    pose = content.obstacle.pose
    placed = (ElementGeometry(content.name, g, 0, read_only(pose @ g.pose)) for g in content.obstacle.geometries)
    solids = tuple(solids_of(placed, obstacle_pieces))
    return ObstacleGeometry(solids, surfaceless(solids))


def obstacle_bodies(obstacles: Sequence[ObstacleGeometry]) -> list[BodyTables]:
    """The tables of obstacles, each made once; those that are new together, which takes hardly longer than one."""
    new = [thing for thing in obstacles if "bodies" not in thing.kept]
    if new:
        made = body_tables([solid for thing in new for solid in thing.solids], flat(np.eye(4))[None])
        bodies = corners = links = 0
        for thing in new:
            last = bodies + len(thing.solids)
            rows = made.bodies[bodies:last] - np.array([0, 0, corners, corners, 0, 0])
            corners_end = corners + int(rows[:, 3].max(initial=0))
            degrees = made.degrees[corners:corners_end]
            links_end = links + int(degrees.sum())
            thing.kept["bodies"] = BodyTables(
                rows,
                made.values[bodies:last],
                made.corners[corners:corners_end],
                degrees,
                made.neighbors[links:links_end] - corners,
                made.poses[bodies:last],
                made.centers[bodies:last],
            )
            bodies, corners, links = last, corners_end, links_end
    return [thing.kept["bodies"] for thing in obstacles]


@dataclass(frozen=True)
class _Standing:
    """An arm that stands still, to compare."""

    name: str
    geometry: ArmGeometry
    base: bytes
    q: bytes


def standing_geometry(name: str, geometry: ArmGeometry, base: Array, q: Array) -> ObstacleGeometry:
    """The solids of an arm that stands still.

    Args:
        name: The arm.
        geometry: Its geometry.
        base: T_world_base, shape (4, 4).
        q: Its configuration [rad or m].
    """
    return _standing(_Standing(name, geometry, base.tobytes(), q.tobytes()))


@lru_cache(maxsize=1024)
def _standing(content: _Standing) -> ObstacleGeometry:
    geometry, base = content.geometry, np.frombuffer(content.base).reshape(4, 4)
    placed = zip(geometry.solids, geometry.elements(content.name), arm_posture(geometry, content.q).poses, strict=True)
    solids = tuple(Solid(element, solid.shape, 0, read_only(base @ T)) for solid, element, T in placed)
    return ObstacleGeometry(solids, geometry.surfaceless)


@dataclass(frozen=True, eq=False)
class Posture:
    """Where an arm's solids are at a configuration, in the frame of its base.

    Args:
        poses: T_base_solid, shape (n, 4, 4).
        bodies: Center and radius of a ball around each of them [m], shape (n, 4).
        elements: The same of each link and held object with a shape, shape (m, 4).
        ball: The same of all of them, shape (4,).
    """

    poses: Array
    bodies: Array
    elements: Array
    ball: Array


# Most configurations of an arm whose solids are cached.
_MOST_POSTURES = 1024
_RELATIVE, _ROUNDING = 1.0 + 1e-9, 1e-9


def arm_posture(geometry: ArmGeometry, q: bytes) -> Posture:
    """Where an arm's solids are at a configuration, given as bytes; arms with equal geometries share it."""
    kept: dict[bytes, Posture] = geometry.kept.setdefault("postures", {})
    return kept_in(kept, q, lambda: _new_posture(geometry, np.frombuffer(q)), _MOST_POSTURES)


def _new_posture(geometry: ArmGeometry, q: Array) -> Posture:
    skeleton, tables = geometry.skeleton, arm_tables(geometry).bodies
    data = skeleton.model.createData()
    # An arm may have no planning joint at all.
    driven = q[np.maximum(skeleton.columns, 0)] if len(q) else 0.0
    pin.forwardKinematics(skeleton.model, data, np.array(skeleton.offsets + skeleton.gains * driven))
    poses = np.array([data.oMi[solid.joint].homogeneous @ solid.placement for solid in geometry.solids])
    poses = poses.reshape(-1, 4, 4)
    # Centers of the balls around bodies, in their own frames and where they are.
    R, t = tables.values[:, :9].reshape(-1, 3, 3), tables.values[:, 9:12]
    local = np.einsum("nji,nj->ni", R, tables.values[:, 12:15] - t)
    centers = np.einsum("nij,nj->ni", poses[:, :3, :3], local) + poses[:, :3, 3]
    bodies = np.column_stack([centers, tables.values[:, 15] * _RELATIVE + _ROUNDING])
    names = [solid.element for solid in geometry.solids]
    begins = [i for i, name in enumerate(names) if i == 0 or name != names[i - 1]]
    elements = [_ball_around(part) for part in np.split(bodies, begins[1:])] if names else []
    ball = _ball_around(bodies) if names else np.zeros(4)
    return Posture(read_only(poses), read_only(bodies), read_only(np.array(elements).reshape(-1, 4)), read_only(ball))


def _ball_around(balls: Array) -> Array:
    """A ball around balls (n, 4), shape (4,)."""
    centers, radii = balls[:, :3], balls[:, 3]
    middle = 0.5 * ((centers - radii[:, None]).min(axis=0) + (centers + radii[:, None]).max(axis=0))
    radius = float((np.linalg.norm(centers - middle, axis=1) + radii).max())
    return np.array([*middle, radius * _RELATIVE + _ROUNDING])
