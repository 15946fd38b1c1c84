"""Objects that do not move, and their convex solids: obstacles and stationary arms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from rr1plan.checks import Array, read_only
from rr1plan.collision.arm_geometry import ArmGeometry, Solid, pieces_of
from rr1plan.collision.convex.convex_bodies import obstacle_pieces
from rr1plan.collision.tables.arm_tables import arm_tables
from rr1plan.collision.tables.body_tables import shape_size
from rr1plan.kernels.planner_kernels import SOURCES, constants
from rr1plan.object_cache import kept_in
from rr1plan.scene import Obstacle
from rr1plan.shapes import Mesh, PointCloud, Shape
from rr1plan.transforms import identity

_SIZE_NUMBERS = SOURCES.item_sizes["ShapeSize"] // 8
# Shapes that are replaced for checking; see `obstacle_pieces`.
_MADE_SOLID = (Mesh, PointCloud)


class ObstacleGeometry:
    """Objects that do not move, as solids, one object after the other.

    Args:
        elements: The element that each solid is a part of.
        shapes: The shape of each solid.
        sizes: A `ShapeSize` for each solid.
        frames: T_object_solid of each solid, (4, 4) after (4, 4).
        counts: Number of solids of each object.
        poses: T_world_object of each object, (4, 4) after (4, 4).
    """

    __slots__ = ("counts", "elements", "frames", "poses", "shapes", "sizes")

    def __init__(
        self,
        elements: Sequence[str],
        shapes: Sequence[Shape],
        sizes: bytes,
        frames: bytes,
        counts: Sequence[int],
        poses: bytes,
    ) -> None:
        self.elements, self.shapes, self.sizes, self.frames = elements, shapes, sizes, frames
        self.counts, self.poses = counts, poses

    @staticmethod
    def joined(parts: Sequence[ObstacleGeometry]) -> ObstacleGeometry:
        """The objects of all parts."""
        return ObstacleGeometry(
            [element for part in parts for element in part.elements],
            [shape for part in parts for shape in part.shapes],
            b"".join([part.sizes for part in parts]),
            b"".join([part.frames for part in parts]),
            [count for part in parts for count in part.counts],
            b"".join([part.poses for part in parts]),
        )

    def at(self, pose: Array, elements: Sequence[str] | None = None) -> ObstacleGeometry:
        """The single object at another pose T_world_object, shape (4, 4), by default with the same elements."""
        elements = self.elements if elements is None else elements
        return ObstacleGeometry(elements, self.shapes, self.sizes, self.frames, self.counts, pose.tobytes())

    @property
    def kinds(self) -> NDArray[np.int64]:
        """The kind of each solid (`exact_tables.h`), shape (n,)."""
        return np.frombuffer(self.sizes, np.int64)[::_SIZE_NUMBERS]

    @property
    def surfaceless(self) -> NDArray[np.bool_]:
        """Which of the solids are half-spaces, point clouds or concave meshes, the last kinds, shape (n,)."""
        return np.asarray(self.kinds >= constants()["BODY_HALF_SPACE"])

    @property
    def solids(self) -> tuple[Solid, ...]:
        """The solids; their joint is the world."""
        frames = np.frombuffer(self.frames).reshape(-1, 4, 4)
        poses = np.repeat(np.frombuffer(self.poses).reshape(-1, 4, 4), self.counts, axis=0)
        parts = zip(self.elements, self.shapes, poses, frames, strict=True)
        return tuple(Solid(element, shape, 0, read_only(pose @ T)) for element, shape, pose, T in parts)


def one_object(elements: Sequence[str], shapes: Sequence[Shape], frames: bytes) -> ObstacleGeometry:
    """An object at the world's origin; see `ObstacleGeometry`."""
    sizes = b"".join(map(shape_size, shapes))
    return ObstacleGeometry(elements, shapes, sizes, frames, [len(shapes)], identity().tobytes())


def obstacle_geometry(obstacles: Mapping[str, Obstacle]) -> ObstacleGeometry:
    """Obstacles as solids.

    Args:
        obstacles: The obstacles by name.

    Raises:
        InputError: a shape that cannot be made solid.
    """
    elements: list[str] = []
    shapes: list[Shape] = []
    frames: list[bytes] = []
    counts, poses = [], []
    for name, obstacle in obstacles.items():
        first = len(shapes)
        for geometry in obstacle.geometries:
            shape, frame = geometry.shape, geometry.pose.tobytes()
            for piece in pieces_of(name, shape, obstacle_pieces) if isinstance(shape, _MADE_SOLID) else (shape,):
                elements.append(name)
                shapes.append(piece)
                frames.append(frame)
        counts.append(len(shapes) - first)
        poses.append(obstacle.pose.tobytes())
    sizes = b"".join(map(shape_size, shapes))
    return ObstacleGeometry(elements, shapes, sizes, b"".join(frames), counts, b"".join(poses))


def stationary_arm_geometry(name: str, geometry: ArmGeometry, base: Array, q: Array) -> ObstacleGeometry:
    """A stationary arm as solids.

    Args:
        name: The arm.
        geometry: Its geometry.
        base: T_world_base, shape (4, 4).
        q: Its configuration [rad or m].
    """
    return placed_arm(geometry, q.tobytes()).solids.at(base, geometry.elements(name))


@dataclass(frozen=True, eq=False)
class PlacedArm:
    """An arm's solids at a configuration, in the frame of its base.

    Args:
        solids: Its solids; their elements are names of links and of held objects.
        bodies: Center and radius of a ball around each solid [m], shape (n, 4).
        elements: Likewise for each link and held object with a shape, shape (m, 4).
        ball: Likewise for all of them, shape (4,).
    """

    solids: ObstacleGeometry
    bodies: Array
    elements: Array
    ball: Array


# Configurations of an arm for which placed solids are cached.
_MOST_PLACED = 1024
_RELATIVE, _ROUNDING = 1.0 + 1e-9, 1e-9


def placed_arm(geometry: ArmGeometry, q: bytes) -> PlacedArm:
    """An arm's solids at a configuration, given as bytes; arms with equal geometries share them."""
    kept: dict[bytes, PlacedArm] = geometry.kept.setdefault("configurations", {})
    return kept_in(kept, q, lambda: _new_placed_arm(geometry, np.frombuffer(q)), _MOST_PLACED)


def _new_placed_arm(geometry: ArmGeometry, q: Array) -> PlacedArm:
    arm_model, tables = geometry.arm_model, arm_tables(geometry).bodies
    data = arm_model.model.createData()
    # An arm may have no planning joints.
    driven = q[np.maximum(arm_model.columns, 0)] if len(q) else 0.0
    pin.forwardKinematics(arm_model.model, data, np.array(arm_model.offsets + arm_model.gains * driven))
    joints = np.array([pose.homogeneous for pose in data.oMi])
    placements = np.array([solid.placement for solid in geometry.solids]).reshape(-1, 4, 4)
    poses = joints[[solid.joint for solid in geometry.solids]] @ placements
    # Centers of the balls around bodies, in their own frames and in the base frame.
    R, t = tables.values[:, :9].reshape(-1, 3, 3), tables.values[:, 9:12]
    local = np.einsum("nji,nj->ni", R, tables.values[:, 12:15] - t)
    centers = np.einsum("nij,nj->ni", poses[:, :3, :3], local) + poses[:, :3, 3]
    bodies = np.column_stack([centers, tables.values[:, 15] * _RELATIVE + _ROUNDING])
    names = [solid.element for solid in geometry.solids]
    begins = [i for i, name in enumerate(names) if i == 0 or name != names[i - 1]]
    elements = _balls_around(bodies, begins)
    ball = _balls_around(bodies, [0])[0] if names else np.zeros(4)
    solids = one_object(names, [solid.shape for solid in geometry.solids], poses.tobytes())
    return PlacedArm(solids, read_only(bodies), read_only(elements), read_only(ball))


def _balls_around(balls: Array, begins: Sequence[int]) -> Array:
    """A ball around each part of balls (n, 4), shape (len(begins), 4); parts are not empty.

    Args:
        balls: The balls.
        begins: Where each part begins; it ends where the next one begins.
    """
    if not begins:
        return np.zeros((0, 4))
    centers, radii = balls[:, :3], balls[:, 3]
    low = np.minimum.reduceat(centers - radii[:, None], begins)
    middle = 0.5 * (low + np.maximum.reduceat(centers + radii[:, None], begins))
    offsets = centers - np.repeat(middle, np.diff([*begins, len(balls)]), axis=0)
    radius = np.maximum.reduceat(np.linalg.norm(offsets, axis=1) + radii, begins)
    return np.concatenate([middle, (radius * _RELATIVE + _ROUNDING)[:, None]], axis=1)
