"""The plain arrays that the motion kernel reads, made from a collision checker's scene."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from rr1plan._kernels.separation import BOX, CELLS, CORNERS, CYLINDER, HALF_SPACE, POINT, SEGMENT
from rr1plan.checks import Array
from rr1plan.collision.exact import CollisionChecker, Solid
from rr1plan.collision.solids import occupied_cells
from rr1plan.errors import InputError
from rr1plan.model import SceneModel
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, PointCloud, Shape, Sphere

# Stands for infinity where infinity times zero would be NaN.
_FAR = 1e12
_INTS = NDArray[np.int64]


class Tables(NamedTuple):
    """Arguments of `rr1plan._kernels.motion.certify` after the curve and the tolerance, in its order."""

    joints: _INTS
    joint_values: Array
    bodies: _INTS
    body_values: Array
    corners: Array
    links: _INTS
    chain: _INTS
    chain_reach: Array
    pairs: _INTS
    padding: Array
    joint_poses: Array
    poses: Array
    centres: Array
    directions: Array


@dataclass(frozen=True, eq=False)
class _Core:
    """A shape as a core and a radius around it; `points` in the shape's frame."""

    kind: int
    size: Array
    radius: float
    ball: tuple[Array, float]
    box: tuple[Array, Array]
    points: Array
    offset: float = 0.0


def build_tables(checker: CollisionChecker) -> Tables:
    """Tables of the moving pairs of a checker, in the order of its `solid_pairs`.

    Raises:
        InputError: a half-space or a point cloud that would be checked against another one.
    """
    model = checker.model
    joints, joint_values, joint_poses = _joint_tables(model)
    chains = [_driven_chain(joints, s.joint) for s in checker.solids]
    reaches = [
        _chain_reach(joints, joint_values, joint_poses, c, s, _core(s.shape))
        for c, s in zip(chains, checker.solids, strict=True)
    ]
    bodies, body_values, corners = _body_tables(checker.solids, chains)
    poses, centres = _rest_poses(bodies, body_values, joint_poses)
    return Tables(
        joints,
        joint_values,
        bodies,
        body_values,
        corners,
        _link_table(checker.solids, len(corners)),
        np.array([j for c in chains for j in c], dtype=np.int64),
        np.array([r for reach in reaches for r in reach], dtype=np.float64),
        _pair_table(checker, chains),
        np.array(checker.solid_padding),
        joint_poses,
        poses,
        centres,
        np.zeros((len(checker.solid_pairs), 3)),
    )


def _joint_tables(model: SceneModel) -> tuple[_INTS, Array, Array]:
    """Joints, their values, and their world poses at q = 0; see the kernel's `place_joints`."""
    data = model.model.createData()
    at_zero = model.full(np.zeros(model.nq))
    pin.computeJointJacobians(model.model, data, at_zero)
    count = model.model.njoints
    joints, values, poses = np.zeros((count, 4), np.int64), np.zeros((count, 17)), np.zeros((count, 12))
    poses[0] = _flat(np.eye(4))
    for j in range(1, count):
        # Of a model with one joint Pinocchio gives a vector, not a matrix of one column.
        jacobian = pin.getJointJacobian(model.model, data, j, pin.ReferenceFrame.LOCAL).reshape(6, -1)
        twist = jacobian[:, j - 1]
        prismatic = float(np.abs(twist[:3]).max()) > 0.5
        gain = float(model.gains[j - 1])
        column = int(model.columns[j - 1]) if gain != 0.0 else -1
        parent = int(model.model.parents[j])
        joints[j] = parent, prismatic, column, column >= 0 or joints[parent, 3]
        values[j, :12] = _flat(model.model.jointPlacements[j].homogeneous)
        values[j, 12:15] = twist[:3] if prismatic else twist[3:]
        values[j, 15:] = gain, model.offsets[j - 1]
        poses[j] = _flat(data.oMi[j].homogeneous)
    return joints, values, poses


def _flat(T: Array) -> Array:
    """A transform as its rotation row by row and its translation, shape (12,)."""
    return np.concatenate([T[:3, :3].ravel(), T[:3, 3]])


def _driven_chain(joints: _INTS, joint: int) -> list[int]:
    """The joints above a body that a column of q drives, root first."""
    chain = []
    while joint:
        if joints[joint, 2] >= 0:
            chain.append(joint)
        joint = int(joints[joint, 0])
    return chain[::-1]


def _chain_reach(
    joints: _INTS, values: Array, poses: Array, chain: list[int], solid: Solid, core: _Core
) -> list[float]:
    """For each joint of a chain how far the centre of a body's ball can ever be from its axis [m]."""
    T = poses[solid.joint]
    centre = (solid.placement @ [*core.ball[0], 1.0])[:3]
    point = T[:9].reshape(3, 3) @ centre + T[9:]
    reach, beyond = [], 0.0
    for joint in chain[::-1]:
        axis = poses[joint, :9].reshape(3, 3) @ values[joint, 12:15]
        arm = point - poses[joint, 9:]
        reach.append(float(np.linalg.norm(_cross(axis, arm)) + beyond))
        # A prismatic joint carries what hangs on it to any distance.
        beyond += _FAR if joints[joint, 1] else float(np.linalg.norm(arm))
        point = poses[joint, 9:]
    return reach[::-1]


def _cross(a: Array, b: Array) -> Array:
    """The cross product of two vectors; numpy's takes twenty times as long for one."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _body_tables(solids: tuple[Solid, ...], chains: list[list[int]]) -> tuple[_INTS, Array, Array]:
    bodies, values = np.zeros((len(solids), 6), np.int64), np.zeros((len(solids), 27))
    corners: list[Array] = [np.zeros((0, 3))]
    first_corner, first_link = 0, 0
    for i, (solid, chain) in enumerate(zip(solids, chains, strict=True)):
        core = _core(solid.shape)
        corners.append(core.points)
        last_corner, last_link = first_corner + len(core.points), first_link + len(chain)
        bodies[i] = core.kind, solid.joint, first_corner, last_corner, first_link, last_link
        values[i, :12] = _flat(solid.placement)
        values[i, 12:15] = (solid.placement @ [*core.ball[0], 1.0])[:3]
        values[i, 15:17] = core.ball[1], core.radius
        values[i, 17:20], values[i, 20:23] = core.box
        values[i, 23:26], values[i, 26] = core.size, core.offset
        first_corner, first_link = last_corner, last_link
    return bodies, values, np.ascontiguousarray(np.concatenate(corners))


def _link_table(solids: tuple[Solid, ...], count: int) -> _INTS:
    """Neighbours of every corner along the edges of its mesh; see the kernel's `support`."""
    degrees, neighbours = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    first = 0
    for solid in solids:
        degree, around = _neighbours(solid.shape)
        degrees.append(degree)
        neighbours.append(around + first)
        first += len(degree)
    begins = np.concatenate([[0], np.cumsum(np.concatenate(degrees))]) + count + 1
    return np.concatenate([begins, *neighbours])


@lru_cache(maxsize=256)
def _neighbours(shape: Shape) -> tuple[_INTS, _INTS]:
    """How many edges leave each point of a shape's core, and where they lead, point after point."""
    count = len(_core(shape).points)
    if not isinstance(shape, Mesh):
        return np.zeros(count, np.int64), np.zeros(0, np.int64)
    edges = np.concatenate([shape.faces[:, pair] for pair in ([0, 1], [1, 2], [2, 0], [1, 0], [2, 1], [0, 2])])
    edges = np.unique(edges, axis=0).astype(np.int64)
    return np.bincount(edges[:, 0], minlength=count), edges[:, 1].copy()


def _rest_poses(bodies: _INTS, values: Array, joint_poses: Array) -> tuple[Array, Array]:
    """World poses of the bodies and centres of their balls at q = 0; those that rest keep them."""
    poses, centres = np.zeros((len(bodies), 12)), np.zeros((len(bodies), 3))
    for i, body in enumerate(bodies):
        R, t = joint_poses[body[1], :9].reshape(3, 3), joint_poses[body[1], 9:]
        poses[i, :9] = (R @ values[i, :9].reshape(3, 3)).ravel()
        poses[i, 9:] = R @ values[i, 9:12] + t
        centres[i] = R @ values[i, 12:15] + t
    return poses, centres


def _pair_table(checker: CollisionChecker, chains: list[list[int]]) -> _INTS:
    """Body, body, and how many driven joints move both; the body without an inside surface comes second."""
    table = np.zeros((len(checker.solid_pairs), 3), np.int64)
    special = [isinstance(s.shape, HalfSpace | PointCloud) for s in checker.solids]
    for k, (a, b) in enumerate(checker.solid_pairs.tolist()):
        if special[a] and special[b]:
            one, two = checker.solids[a].element, checker.solids[b].element
            raise InputError(f"{one!r} and {two!r} are half-spaces or point clouds; they cannot be checked")
        shared = sum(x == y for x, y in zip(chains[a], chains[b], strict=False))
        table[k] = (b, a, shared) if special[a] else (a, b, shared)
    return table


@lru_cache(maxsize=256)
def _core(shape: Shape) -> _Core:
    zero, none = np.zeros(3), np.zeros((0, 3))
    match shape:
        case Sphere(radius):
            return _Core(POINT, zero, radius, (zero, radius), (zero, np.full(3, radius)), none)
        case Box(size):
            half = 0.5 * np.array(size)
            return _Core(BOX, half, 0.0, (zero, float(np.linalg.norm(half))), (zero, half), none)
        case Cylinder(radius, length):
            half = np.array([radius, radius, 0.5 * length])
            return _Core(CYLINDER, half, 0.0, (zero, float(np.hypot(radius, 0.5 * length))), (zero, half), none)
        case Capsule(radius, length):
            core, half = np.array([0, 0, 0.5 * length]), np.array([radius, radius, 0.5 * length + radius])
            return _Core(SEGMENT, core, radius, (zero, 0.5 * length + radius), (zero, half), none)
        case HalfSpace(normal, offset):
            return _Core(HALF_SPACE, np.array(normal), 0.0, (zero, _FAR), (zero, np.full(3, _FAR)), none, offset)
        case PointCloud():
            return _cells(shape)
        case _:
            return _corners(shape)


def _cells(cloud: PointCloud) -> _Core:
    cells, half = occupied_cells(cloud), 0.5 * cloud.resolution
    low, high = cells.min(axis=0) - half, cells.max(axis=0) + half
    ball = (0.5 * (low + high), float(np.linalg.norm(0.5 * (high - low))))
    return _Core(CELLS, np.full(3, half), 0.0, ball, (0.5 * (low + high), 0.5 * (high - low)), cells)


def _corners(mesh: Mesh) -> _Core:
    points = np.array(mesh.vertices)
    low, high = points.min(axis=0), points.max(axis=0)
    return _Core(CORNERS, np.zeros(3), 0.0, _ball(points), (0.5 * (low + high), 0.5 * (high - low)), points)


def _ball(points: Array) -> tuple[Array, float]:
    """A ball around points, a little larger than the least (Badoiu and Clarkson 2003)."""
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    for step in range(2, 100):
        farthest = points[np.argmax(np.linalg.norm(points - centre, axis=1))]
        centre = centre + (farthest - centre) / step
    return centre, float(np.linalg.norm(points - centre, axis=1).max()) * (1.0 + 1e-12)
