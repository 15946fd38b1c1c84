"""A scene as one Pinocchio model: all arms together, every actuated joint one number.

Built from our own description, never from a file, so every back end sees the same robot. The
planning configuration q (the moving arms' planning joints, in the order of the scene) maps to the
configuration of the whole model by an affine map: planning joints take their column, mimic joints
follow through their chain of multipliers, held joints and resting arms are constants. Obstacles and
attached objects weigh nothing here: they are geometry only.

Each instance is cheap to make and holds no scratch memory; it may be shared between threads.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from types import MappingProxyType
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from rr1plan.checks import Array, known_name, read_only
from rr1plan.errors import InputError
from rr1plan.limits import Limits
from rr1plan.robot import Geometry, Joint, Robot
from rr1plan.scene import Arm, Scene
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
        skeleton: What it shares with other scenes that have the same arms.
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
        # A second time, as a scene may have no arms at all.
        self.arms = scene.arm_names(scene.arm_names([arms] if isinstance(arms, str) else arms))
        self.skeleton = skeleton_of(scene, self.arms)
        self.joint_names: tuple[str, ...] = self.skeleton.joint_names
        self.limits: Limits = self.skeleton.limits
        self.model: Any = self.skeleton.model
        self.columns: NDArray[np.intp] = self.skeleton.columns
        self.gains: Array = self.skeleton.gains
        self.offsets: Array = self.skeleton.offsets
        self._bodies, self._frames = self.skeleton.bodies, self.skeleton.frames
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

    def geometries_of(self, element: str, geometries: Iterable[Geometry]) -> tuple[ElementGeometry, ...]:
        """Shapes in an element's frame, hung in the model.

        Raises:
            UnknownNameError: there is nothing of that name.
        """
        return _hung(element, self.body(element), geometries)


def _hung(element: str, body: Body, geometries: Iterable[Geometry]) -> tuple[ElementGeometry, ...]:
    return tuple(ElementGeometry(element, g, body.joint, read_only(body.placement @ g.pose)) for g in geometries)


# ---- what scenes with the same arms share ----------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Skeleton:
    """What of a `SceneModel` depends on nothing but the arms, which of them move, and the posture of the rest.

    Scenes that agree in these share one, so nobody may change its `model`.

    Args:
        joint_names, limits, model, columns, gains, offsets: See `SceneModel`.
        bodies: Which joint carries each link, and where.
        frames: Pinocchio's index of each link's frame.
        link_geometries: Every collision shape of the links.
    """

    joint_names: tuple[str, ...]
    limits: Limits
    model: Any
    columns: NDArray[np.intp]
    gains: Array
    offsets: Array
    bodies: Mapping[str, Body]
    frames: Mapping[str, int]
    link_geometries: tuple[ElementGeometry, ...]


@dataclass(frozen=True)
class _Content:
    """All that a skeleton depends on, to compare; and what to make it from."""

    key: tuple[tuple[str, str, bytes, bytes | None], ...]
    arms: Mapping[str, Arm] = field(compare=False)


def skeleton_of(scene: Scene, arms: tuple[str, ...]) -> Skeleton:
    """The skeleton of a scene of which those arms move; scenes with equal arms get the same.

    Raises:
        InputError: a joint that is neither planned, held nor mimics one that is.
    """
    key = tuple(
        (name, arm.robot.content_hash, arm.base.tobytes(), None if name in arms else arm.q.tobytes())
        for name, arm in scene.arms.items()
    )
    return _skeleton(_Content(key, scene.arms))


@lru_cache(maxsize=64)
def _skeleton(content: _Content) -> Skeleton:
    builder = _Builder()
    moving = [name for name, *_, posture in content.key if posture is None]
    drives: list[tuple[int, float, float]] = []
    names: list[str] = []
    for name, arm in content.arms.items():
        first = len(names) if name in moving else None
        drives += [_drive(arm.robot, joint, first, arm.q) for joint in builder.add_arm(name, arm)]
        names += [f"{name}/{joint}" for joint in arm.robot.joint_names] if name in moving else []
    columns, gains, offsets = zip(*drives, strict=True) if drives else ((), (), ())
    return Skeleton(
        tuple(names),
        Limits.stack([content.arms[name].robot.limits for name in moving]),
        builder.model,
        read_only(np.array(columns, dtype=np.intp)),
        read_only(np.array(gains, dtype=np.float64)),
        read_only(np.array(offsets, dtype=np.float64)),
        MappingProxyType(builder.bodies),
        MappingProxyType(builder.frames),
        tuple(
            geometry
            for name, arm in content.arms.items()
            for link in arm.robot.links
            for geometry in _hung(f"{name}/{link.name}", builder.bodies[f"{name}/{link.name}"], link.collisions)
        ),
    )


class _Builder:
    """A Pinocchio model to which arms are added."""

    def __init__(self) -> None:
        self.model = pin.Model()
        self.bodies: dict[str, Body] = {}
        self.frames: dict[str, int] = {}

    def add_arm(self, name: str, arm: Arm) -> list[Joint]:
        """Add one arm; its movable joints in the order of the model."""
        self._add_link(name, arm.robot, arm.robot.base, Body(0, arm.base))
        added = []
        for joint in _depth_first(arm.robot):
            parent = self.bodies[f"{name}/{joint.parent}"]
            placement = read_only(parent.placement @ joint.origin)
            if joint.kind == "fixed":
                body = Body(parent.joint, placement)
            else:
                body = Body(self._add_joint(name, arm.robot, joint, Body(parent.joint, placement)), identity())
                added.append(joint)
            self._add_link(name, arm.robot, joint.child, body)
        return added

    def _add_joint(self, arm: str, robot: Robot, joint: Joint, at: Body) -> int:
        bounds = [joint.effort, joint.velocity, joint.lower, joint.upper]
        if joint.name in robot.joint_names:
            j, limits = robot.joint_names.index(joint.name), robot.limits
            bounds = [float(a[j]) for a in (limits.effort, limits.velocity, limits.lower, limits.upper)]
        name, placement = f"{arm}/{joint.name}", pin.SE3(np.array(at.placement))
        return int(self.model.addJoint(at.joint, _joint_model(joint), placement, name, *np.array(bounds)[:, None]))

    def _add_link(self, arm: str, robot: Robot, link: str, body: Body) -> None:
        name = f"{arm}/{link}"
        inertial = robot.link(link).inertial
        placement = pin.SE3(np.array(body.placement))
        if inertial is not None:
            inertia = pin.Inertia(inertial.mass, np.array(inertial.com), np.array(inertial.inertia))
            self.model.appendBodyToJoint(body.joint, inertia, placement)
        frame = pin.Frame(name, body.joint, 0, placement, pin.FrameType.BODY)
        self.frames[name] = int(self.model.addFrame(frame, False))
        self.bodies[name] = body


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
