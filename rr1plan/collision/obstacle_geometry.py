"""Objects that do not move, and their convex solids: obstacles, arms that stand still."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from rr1plan.checks import Array, read_only
from rr1plan.collision.arm_geometry import ArmGeometry, Solid, pieces_of
from rr1plan.collision.convex.convex_bodies import obstacle_pieces
from rr1plan.collision.tables.arm_tables import arm_tables
from rr1plan.collision.tables.solid_rows import SolidRows, solid_rows
from rr1plan.object_cache import kept_in
from rr1plan.scene import Obstacle
from rr1plan.shapes import Mesh, PointCloud, Shape


@dataclass(eq=False)
class ObstacleGeometry:
    """An object that does not move, as solids.

    Args:
        elements: The element that each solid is a part of.
        rows: What tables say of the solids, wherever they are.
        frames: T_object_solid of each, (4, 4) after (4, 4).
        pose: T_world_object, shape (4, 4).
    """

    elements: Sequence[str]
    rows: SolidRows
    frames: bytes
    pose: Array

    @cached_property
    def solids(self) -> tuple[Solid, ...]:
        """The solids; their joint is the world."""
        frames = np.frombuffer(self.frames).reshape(-1, 4, 4)
        parts = zip(self.elements, self.rows.shapes, frames, strict=True)
        return tuple(Solid(element, shape, 0, read_only(self.pose @ T)) for element, shape, T in parts)


def obstacle_geometry(name: str, obstacle: Obstacle) -> ObstacleGeometry:
    """An obstacle as solids.

    Raises:
        InputError: a shape that cannot be made solid.
    """
    shapes: list[Shape] = []
    frames: list[bytes] = []
    for geometry in obstacle.geometries:
        shape, frame = geometry.shape, geometry.pose.tobytes()
        pieces = pieces_of(name, shape, obstacle_pieces) if isinstance(shape, Mesh | PointCloud) else (shape,)
        shapes += pieces
        frames += [frame] * len(pieces)
    return ObstacleGeometry([name] * len(shapes), solid_rows(tuple(shapes)), b"".join(frames), obstacle.pose)


def stationary_arm_geometry(name: str, geometry: ArmGeometry, base: Array, q: Array) -> ObstacleGeometry:
    """An arm that stands still as solids.

    Args:
        name: The arm.
        geometry: Its geometry.
        base: T_world_base, shape (4, 4).
        q: Its configuration [rad or m].
    """
    rows = kept_in(geometry.kept, "rows", lambda: solid_rows(tuple(solid.shape for solid in geometry.solids)))
    return ObstacleGeometry(geometry.elements(name), rows, placed_arm(geometry, q.tobytes()).frames, base)


@dataclass(frozen=True, eq=False)
class PlacedArm:
    """Where an arm's solids are at a configuration, in the frame of its base.

    Args:
        frames: T_base_solid of each, (4, 4) after (4, 4).
        bodies: Center and radius of a ball around each of them [m], shape (n, 4).
        elements: The same of each link and held object with a shape, shape (m, 4).
        ball: The same of all of them, shape (4,).
    """

    frames: bytes
    bodies: Array
    elements: Array
    ball: Array


# Most configurations of an arm whose solids are cached.
_MOST_PLACED = 1024
_RELATIVE, _ROUNDING = 1.0 + 1e-9, 1e-9


def placed_arm(geometry: ArmGeometry, q: bytes) -> PlacedArm:
    """Where an arm's solids are at a configuration, given as bytes; arms with equal geometries share it."""
    kept: dict[bytes, PlacedArm] = geometry.kept.setdefault("configurations", {})
    return kept_in(kept, q, lambda: _new_placed_arm(geometry, np.frombuffer(q)), _MOST_PLACED)


def _new_placed_arm(geometry: ArmGeometry, q: Array) -> PlacedArm:
    arm_model, tables = geometry.arm_model, arm_tables(geometry).bodies
    data = arm_model.model.createData()
    # An arm may have no planning joint at all.
    driven = q[np.maximum(arm_model.columns, 0)] if len(q) else 0.0
    pin.forwardKinematics(arm_model.model, data, np.array(arm_model.offsets + arm_model.gains * driven))
    poses = np.array([data.oMi[solid.joint].homogeneous @ solid.placement for solid in geometry.solids])
    poses = poses.reshape(-1, 4, 4)
    # Centers of the balls around bodies, in their own frames and where they are.
    R, t = tables.values[:, :9].reshape(-1, 3, 3), tables.values[:, 9:12]
    local = np.einsum("nji,nj->ni", R, tables.values[:, 12:15] - t)
    centers = np.einsum("nij,nj->ni", poses[:, :3, :3], local) + poses[:, :3, 3]
    bodies = np.column_stack([centers, tables.values[:, 15] * _RELATIVE + _ROUNDING])
    names = [solid.element for solid in geometry.solids]
    begins = [i for i, name in enumerate(names) if i == 0 or name != names[i - 1]]
    elements = _balls_around(bodies, begins)
    ball = _balls_around(bodies, [0])[0] if names else np.zeros(4)
    return PlacedArm(poses.tobytes(), read_only(bodies), read_only(elements), read_only(ball))


def _balls_around(balls: Array, begins: Sequence[int]) -> Array:
    """A ball around each part of balls (n, 4), of which no part is empty, shape (len(begins), 4).

    Args:
        balls: The balls.
        begins: Where each part begins, which ends where the next one begins.
    """
    if not begins:
        return np.zeros((0, 4))
    centers, radii = balls[:, :3], balls[:, 3]
    low = np.minimum.reduceat(centers - radii[:, None], begins)
    middle = 0.5 * (low + np.maximum.reduceat(centers + radii[:, None], begins))
    apart = centers - np.repeat(middle, np.diff([*begins, len(balls)]), axis=0)
    radius = np.maximum.reduceat(np.linalg.norm(apart, axis=1) + radii, begins)
    return np.concatenate([middle, (radius * _RELATIVE + _ROUNDING)[:, None]], axis=1)
