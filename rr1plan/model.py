"""A scene as one Pinocchio model: all arms together, every actuated joint one number.

Built from our own description, never from a file, so every back end sees the same robot. The
planning configuration q (the moving arms' planning joints, in the order of the scene) maps to the
configuration of the whole model by an affine map: planning joints take their column, mimic joints
follow through their chain of multipliers, held joints and resting arms are constants. Obstacles and
attached objects weigh nothing here: they are geometry only.

Each instance is cheap to make and holds no scratch memory; it may be shared between threads.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from rr1plan.checks import Array, known_name, read_only
from rr1plan.errors import InputError
from rr1plan.limits import Limits
from rr1plan.robot import Geometry, Joint, Robot
from rr1plan.scene import Scene
from rr1plan.transforms import identity

_AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_REVOLUTE = (pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ)
_PRISMATIC = (pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ)


@dataclass(frozen=True, eq=False)
class Body:
    """Where something rigid hangs in the model.

    Args:
        joint: Index of the Pinocchio joint that carries it; 0 is the world.
        placement: T_joint_body, shape (4, 4).
    """

    joint: int
    placement: Array


@dataclass(frozen=True, eq=False)
class ElementGeometry:
    """One shape of one element of the scene, hung in the model.

    Args:
        element: "arm/link", an obstacle or an attached object.
        geometry: The shape.
        joint: Index of the Pinocchio joint that carries it; 0 is the world.
        placement: T_joint_geometry, shape (4, 4).
    """

    element: str
    geometry: Geometry
    joint: int
    placement: Array


class SceneModel:
    """One Pinocchio model of all arms of a scene, and the affine map from q to its configuration.

    Args:
        scene: The scene.
        arms: The arms that move (default: all); the others rest in their posture of the scene.

    Attributes:
        scene, arms: As given; arms in the order of the scene.
        joint_names: Columns of q, "arm/joint".
        limits: Limits of those columns.
        model: The `pinocchio.Model`. Joints are named "arm/joint", frames "arm/link"; every joint has
            one position and one velocity, continuous joints included.
        columns: For each entry of the model's configuration the column of q that drives it, or -1.
        gains, offsets: entry = gain * q[column] + offset [rad or m].

    Raises:
        UnknownNameError: no such arm.
        InputError: an arm twice, or a joint that is neither planned, held nor mimics one that is.
    """

    def __init__(self, scene: Scene, arms: Sequence[str] | None = None) -> None:
        if not isinstance(scene, Scene):
            raise InputError(f"scene is a {type(scene).__name__}, expected a rr1plan Scene")
        self.scene = scene
        self.arms = scene.arm_names([arms] if isinstance(arms, str) else arms)
        self.joint_names = scene.joint_names(self.arms)
        self.limits: Limits = scene.limits(self.arms)
        self.model = pin.Model()
        self._bodies: dict[str, Body] = {}
        self._frames: dict[str, int] = {}
        drives: list[tuple[int, float, float]] = []
        first = 0
        for name, arm in scene.arms.items():
            moves = name in self.arms
            drives += [_drive(arm.robot, joint, first if moves else None, arm.q) for joint in self._add_arm(name)]
            first += arm.robot.nq if moves else 0
        columns, gains, offsets = zip(*drives, strict=True) if drives else ((), (), ())
        self.columns: NDArray[np.intp] = np.array(columns, dtype=np.intp)
        self.gains: Array = read_only(np.array(gains, dtype=np.float64))
        self.offsets: Array = read_only(np.array(offsets, dtype=np.float64))
        self.columns.setflags(write=False)
        self._taken = np.maximum(self.columns, 0)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickles as its scene; the model is built again."""
        return SceneModel, (self.scene, self.arms)

    @property
    def nq(self) -> int:
        """Number of columns of q."""
        return len(self.joint_names)

    # ---- the affine map ------------------------------------------------------------------

    def full(self, q: Array) -> Array:
        """The model's configuration at q, shape (nq,) or (n, nq) to (model.nq,) or (n, model.nq)."""
        if not self.nq:
            return np.broadcast_to(self.offsets, (*np.shape(q)[:-1], len(self.offsets))).copy()
        return np.asarray(self.offsets + self.gains * q[..., self._taken])

    def full_velocity(self, v: Array) -> Array:
        """The model's velocity (or acceleration) at that of q, shape (nq,) or (n, nq)."""
        if not self.nq:
            return np.zeros((*np.shape(v)[:-1], len(self.offsets)))
        return np.asarray(self.gains * v[..., self._taken])

    @cached_property
    def selection(self) -> Array:
        """Derivative of `full`, shape (model.nv, nq): takes Jacobians (J @ S) and torques (S.T @ tau) to q."""
        S = np.zeros((len(self.columns), self.nq))
        driven = np.flatnonzero(self.columns >= 0)
        S[driven, self.columns[driven]] = self.gains[driven]
        return read_only(S)

    # ---- where things are ----------------------------------------------------------------

    def frame_id(self, frame: str) -> int:
        """Pinocchio's index of the frame "arm/link".

        Raises:
            UnknownNameError: there is no such frame.
        """
        return self._frames[known_name("frame", frame, self._frames)]

    def body(self, name: str) -> Body:
        """Which joint carries a link "arm/link", an obstacle or an attached object, and where.

        Raises:
            UnknownNameError: there is nothing of that name.
        """
        if name in self._bodies:
            return self._bodies[name]
        if name in self.scene.obstacles:
            return Body(0, self.scene.obstacles[name].pose)
        known_name("element", name, (*self._bodies, *self.scene.obstacles, *self.scene.attachments))
        held = self.scene.attachments[name]
        link = self._bodies[f"{held.arm}/{held.link}"]
        return Body(link.joint, read_only(link.placement @ held.pose))

    @cached_property
    def element_geometries(self) -> tuple[ElementGeometry, ...]:
        """Every collision shape of the scene with the joint that carries it, in the order of `element_names`."""
        shapes: list[tuple[str, tuple[Geometry, ...]]] = [
            (f"{name}/{link.name}", link.collisions)
            for name, arm in self.scene.arms.items()
            for link in arm.robot.links
        ]
        shapes += [(name, thing.geometries) for name, thing in self.scene.obstacles.items()]
        shapes += [(name, held.geometries) for name, held in self.scene.attachments.items()]
        return tuple(
            ElementGeometry(element, g, body.joint, read_only(body.placement @ g.pose))
            for element, geometries in shapes
            for body in [self.body(element)]
            for g in geometries
        )

    @cached_property
    def moved_by(self) -> NDArray[np.bool_]:
        """Which columns of q move each joint's frame, shape (model.njoints, nq); row 0 is the world."""
        moved = np.zeros((self.model.njoints, self.nq), dtype=np.bool_)
        for joint in range(1, self.model.njoints):
            moved[joint] = moved[self.model.parents[joint]]
            column = self.columns[joint - 1]
            if column >= 0 and self.gains[joint - 1] != 0.0:
                moved[joint, column] = True
        moved.setflags(write=False)
        return moved

    # ---- building ------------------------------------------------------------------------

    def _add_arm(self, name: str) -> list[Joint]:
        """Add one arm; its movable joints in the order of the model."""
        arm = self.scene.arms[name]
        self._add_link(name, arm.robot.base, Body(0, arm.base))
        added = []
        for joint in _depth_first(arm.robot):
            parent = self._bodies[f"{name}/{joint.parent}"]
            placement = read_only(parent.placement @ joint.origin)
            if joint.kind == "fixed":
                body = Body(parent.joint, placement)
            else:
                body = Body(self._add_joint(name, joint, Body(parent.joint, placement)), identity())
                added.append(joint)
            self._add_link(name, joint.child, body)
        return added

    def _add_joint(self, arm: str, joint: Joint, at: Body) -> int:
        robot = self.scene.arms[arm].robot
        bounds = [joint.effort, joint.velocity, joint.lower, joint.upper]
        if joint.name in robot.joint_names:
            j, limits = robot.joint_names.index(joint.name), robot.limits
            bounds = [float(a[j]) for a in (limits.effort, limits.velocity, limits.lower, limits.upper)]
        name, placement = f"{arm}/{joint.name}", pin.SE3(np.array(at.placement))
        return int(self.model.addJoint(at.joint, _joint_model(joint), placement, name, *np.array(bounds)[:, None]))

    def _add_link(self, arm: str, link: str, body: Body) -> None:
        name = f"{arm}/{link}"
        inertial = self.scene.arms[arm].robot.link(link).inertial
        placement = pin.SE3(np.array(body.placement))
        if inertial is not None:
            inertia = pin.Inertia(inertial.mass, np.array(inertial.com), np.array(inertial.inertia))
            self.model.appendBodyToJoint(body.joint, inertia, placement)
        frame = pin.Frame(name, body.joint, 0, placement, pin.FrameType.BODY)
        self._frames[name] = int(self.model.addFrame(frame, False))
        self._bodies[name] = body


def _depth_first(robot: Robot) -> list[Joint]:
    """The joints with every subtree in one piece, as Pinocchio's dynamics needs them."""
    children: dict[str, list[Joint]] = {}
    for joint in robot.joints:
        children.setdefault(joint.parent, []).append(joint)
    ordered: list[Joint] = []
    stack = children.get(robot.base, [])[::-1]
    while stack:
        joint = stack.pop()
        ordered.append(joint)
        stack += children.get(joint.child, [])[::-1]
    return ordered


def _joint_model(joint: Joint) -> Any:
    """A one-number joint; the axis-aligned kinds are faster."""
    aligned, unaligned = (
        (_PRISMATIC, pin.JointModelPrismaticUnaligned)
        if joint.kind == "prismatic"
        else (_REVOLUTE, pin.JointModelRevoluteUnaligned)
    )
    axis = tuple(float(x) for x in joint.axis)
    return aligned[_AXES.index(axis)]() if axis in _AXES else unaligned(np.array(axis))


def _drive(robot: Robot, joint: Joint, first: int | None, rest: Array) -> tuple[int, float, float]:
    """What drives a joint: (column, gain, offset). `first` is the arm's first column, None for a resting arm."""
    gain, offset, seen = 1.0, 0.0, {joint.name}
    leader = joint
    while leader.name not in robot.joint_names and leader.name not in robot.held:
        if leader.mimic is None or leader.mimic.joint in seen:
            raise InputError(
                f"joint {joint.name!r} of robot {robot.name!r} is neither planned nor held and mimics no joint that is"
            )
        gain, offset = gain * leader.mimic.multiplier, gain * leader.mimic.offset + offset
        leader = robot.joint(leader.mimic.joint)
        seen.add(leader.name)
    if leader.name not in robot.joint_names:
        return -1, 0.0, gain * robot.held[leader.name] + offset
    column = robot.joint_names.index(leader.name)
    if first is None:
        return -1, 0.0, gain * float(rest[column]) + offset
    return first + column, gain, offset
