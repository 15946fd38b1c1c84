"""The exact kernel's tables of the bodies that arms carry: of one arm, and of all moving arms of a scene."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from rr1plan.checks import Array, read_only
from rr1plan.collision.arm_geometry import ArmGeometry, ArmInstances
from rr1plan.collision.tables.body_tables import FAR, BodyTables, body_tables, flat
from rr1plan.model.arm_model import ArmModel, joint_axis
from rr1plan.object_cache import kept_in
from rr1plan.transforms import rotation_about

_INTS = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ArmTables:
    """The tables of the bodies of arms; columns as in `ExactTables`."""

    joints: _INTS
    joint_values: Array
    joint_poses: Array
    bodies: BodyTables
    chain: _INTS
    chain_reach: Array


# ---- arms that move --------------------------------------------------------------------------------


def instance_tables(instances: ArmInstances) -> ArmTables:
    """The tables of all arms that move, made once."""
    return kept_in(instances.kept, "exact", lambda: _instance_tables(instances))


def _instance_tables(instances: ArmInstances) -> ArmTables:
    made = kept_in(instances.unplaced, "exact", lambda: _joined_tables(instances))
    joint_values, joint_poses = made.joint_values.copy(), made.joint_poses.copy()
    values, poses, centers = made.bodies.values.copy(), made.bodies.poses.copy(), made.bodies.centers.copy()
    joint, body = 1, 0
    for geometry, base in zip(instances.geometries, instances.bases, strict=True):
        own, R = arm_tables(geometry), base[:3, :3]
        parents, carriers = own.joints[1:, 0], own.bodies.bodies[:, 1]
        roots, fixed = joint + np.flatnonzero(parents == 0), body + np.flatnonzero(carriers == 0)
        joints, bodies = slice(joint, joint + len(parents)), slice(body, body + len(carriers))
        joint_values[roots, :12] = moved(base, joint_values[roots, :12])
        joint_poses[joints] = moved(base, joint_poses[joints])
        values[fixed, :12] = moved(base, values[fixed, :12])
        values[fixed, 12:15] = values[fixed, 12:15] @ R.T + base[:3, 3]
        poses[bodies] = moved(base, poses[bodies])
        centers[bodies] = centers[bodies] @ R.T + base[:3, 3]
        joint, body = joints.stop, bodies.stop
    return replace(
        made,
        joint_values=read_only(joint_values),
        joint_poses=read_only(joint_poses),
        bodies=made.bodies._replace(values=values, poses=poses, centers=centers),
    )


def _joined_tables(instances: ArmInstances) -> ArmTables:
    """The tables of all arms, their bases at the origin."""
    joints, values = [np.zeros((1, 4), np.int64)], [np.zeros((1, 17))]
    joint_poses, chains, reaches = [flat(np.eye(4))[None]], [np.zeros(0, np.int64)], [np.zeros(0)]
    bodies, body_values, poses, centers = (
        [np.zeros((0, 6), np.int64)],
        [np.zeros((0, 27))],
        [np.zeros((0, 12))],
        [np.zeros((0, 3))],
    )
    corners = _SharedCorners()
    links = 0
    for geometry, joint, column in zip(
        instances.geometries, instances.first_joint, instances.first_column, strict=True
    ):
        own = arm_tables(geometry)
        rows = own.joints[1:].copy()
        rows[rows[:, 0] != 0, 0] += joint
        rows[rows[:, 2] >= 0, 2] += column
        joints.append(rows)
        values.append(own.joint_values[1:])
        joint_poses.append(own.joint_poses[1:])
        mine, numbers = own.bodies, own.bodies.bodies.copy()
        numbers[numbers[:, 1] != 0, 1] += joint
        numbers[:, 2:4] += corners.first(geometry, mine)
        numbers[:, 4:] += links
        bodies.append(numbers)
        body_values.append(mine.values)
        poses.append(mine.poses)
        centers.append(mine.centers)
        chains.append(own.chain + joint)
        reaches.append(own.chain_reach)
        links += len(own.chain)
    return ArmTables(
        read_only(np.concatenate(joints)),
        read_only(np.concatenate(values)),
        read_only(np.concatenate(joint_poses)),
        BodyTables(
            np.concatenate(bodies),
            np.concatenate(body_values),
            *corners.joined(),
            np.concatenate(poses),
            np.concatenate(centers),
        ),
        read_only(np.concatenate(chains)),
        read_only(np.concatenate(reaches)),
    )


class _SharedCorners:
    """Corners of bodies, stored once for each geometry."""

    def __init__(self) -> None:
        self._first: dict[ArmGeometry, int] = {}
        self._parts: list[BodyTables] = []
        self._count = 0

    def first(self, geometry: ArmGeometry, bodies: BodyTables) -> int:
        """The first corner of a geometry's bodies."""
        if geometry not in self._first:
            self._first[geometry] = self._count
            self._parts.append(bodies)
            self._count += len(bodies.corners)
        return self._first[geometry]

    def joined(self) -> tuple[Array, _INTS, _INTS]:
        """Corners, and their `degrees` and `neighbors`."""
        corners, degrees, neighbors = [np.zeros((0, 3))], [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        for part, first in zip(self._parts, self._first.values(), strict=True):
            corners.append(part.corners)
            degrees.append(part.degrees)
            neighbors.append(part.neighbors + first)
        return np.concatenate(corners), np.concatenate(degrees), np.concatenate(neighbors)


def moved(T: Array, poses: Array) -> Array:
    """Poses as rows (n, 12), each a rotation row by row and an origin, moved by a transform (4, 4)."""
    R = T[:3, :3]
    rotations = (R @ poses[:, :9].reshape(-1, 3, 3)).reshape(-1, 9)
    return np.concatenate([rotations, poses[:, 9:] @ R.T + T[:3, 3]], axis=1)


# ---- one arm, in the frame of its base -------------------------------------------------------------


def arm_tables(geometry: ArmGeometry) -> ArmTables:
    """The tables of an arm's bodies, made once."""
    return kept_in(geometry.kept, "exact", lambda: _arm_tables(geometry))


def _arm_tables(geometry: ArmGeometry) -> ArmTables:
    joints, values, poses = _joint_tables(geometry.arm_model)
    bodies = body_tables(geometry.solids, poses)
    chains = [geometry.chains[group] for group in geometry.groups]
    ends = np.cumsum([len(chain) for chain in chains], dtype=np.int64)
    bodies.bodies[:, 4:] = np.column_stack([np.concatenate([[0], ends])[:-1], ends])
    reach = [
        chain_reach(joints, values, poses, chain, center) for chain, center in zip(chains, bodies.centers, strict=True)
    ]
    return ArmTables(
        read_only(joints),
        read_only(values),
        read_only(poses),
        bodies,
        read_only(np.array([j for chain in chains for j in chain], dtype=np.int64)),
        read_only(np.array([r for one in reach for r in one], dtype=np.float64)),
    )


def _joint_tables(arm_model: ArmModel) -> tuple[_INTS, Array, Array]:
    """Joints, their values, and their world poses at q = 0; see `ExactTables`."""
    model = arm_model.model
    data = model.createData()
    # At q = 0.
    pin.forwardKinematics(model, data, np.array(arm_model.offsets))
    count = model.njoints
    joints, values, poses = np.zeros((count, 4), np.int64), np.zeros((count, 17)), np.zeros((count, 12))
    poses[0] = flat(np.eye(4))
    for j in range(1, count):
        prismatic, axis = joint_axis(model.joints[j])
        gain = float(arm_model.gains[j - 1])
        column = int(arm_model.columns[j - 1]) if gain != 0.0 else -1
        parent = int(model.parents[j])
        joints[j] = parent, prismatic, column, column >= 0 or joints[parent, 3]
        values[j, :12] = flat(model.jointPlacements[j].homogeneous)
        values[j, 12:15] = axis
        values[j, 15:] = gain, arm_model.offsets[j - 1]
        poses[j] = flat(data.oMi[j].homogeneous)
    return joints, values, poses


def chain_reach(joints: _INTS, values: Array, poses: Array, chain: tuple[int, ...], center: Array) -> list[float]:
    """Bounds of the distance of a ball's center, given at q = 0, from the axis of each joint of a chain [m]."""
    point = center
    reach, beyond = [], 0.0
    for joint in chain[::-1]:
        axis = poses[joint, :9].reshape(3, 3) @ values[joint, 12:15]
        arm = point - poses[joint, 9:]
        reach.append(float(np.linalg.norm(_cross(axis, arm)) + beyond))
        # A prismatic joint may move later joints any distance.
        beyond += FAR if joints[joint, 1] else float(np.linalg.norm(arm))
        point = poses[joint, 9:]
    return reach[::-1]


def joint_motion(prismatic: bool, row: Array) -> Array:
    """T_parent_joint (4, 4) of a joint at q = 0, from its row of `joint_values`."""
    axis, rest = row[12:15], float(row[16])
    T, moved = np.eye(4), np.eye(4)
    T[:3, :3], T[:3, 3] = row[:9].reshape(3, 3), row[9:12]
    if prismatic:
        moved[:3, 3] = rest * axis
    else:
        moved[:3, :3] = rotation_about(axis, rest)
    return np.asarray(T @ moved)


def _cross(a: Array, b: Array) -> Array:
    """The cross product of two vectors; NumPy's takes twenty times as long for a single one."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
