"""The arms of scenes as one Pinocchio model, which scenes with the same arms share."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from types import MappingProxyType
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from rr1plan.checks import Array, read_only
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


def hang(element: str, body: Body, geometries: Iterable[Geometry]) -> tuple[ElementGeometry, ...]:
    """Shapes in the frame of a body, hung in the model."""
    return tuple(ElementGeometry(element, g, body.joint, read_only(body.placement @ g.pose)) for g in geometries)


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
        InputError: a joint that is neither planned, locked nor mimics one that is.
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
            for geometry in hang(f"{name}/{link.name}", builder.bodies[f"{name}/{link.name}"], link.collisions)
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


def joint_twist(joint: Any) -> Array:
    """The velocity of a joint of one number in its own frame, linear and angular, shape (6,)."""
    state = joint.createData()
    joint.calc(state, np.zeros(1))
    return np.asarray(state.S).ravel()


def _drive(robot: Robot, joint: Joint, first: int | None, rest: Array) -> tuple[int, float, float]:
    """What drives a joint: (column, gain, offset). `first` is the arm's first column, None for a resting arm."""
    gain, offset, seen = 1.0, 0.0, {joint.name}
    leader = joint
    while leader.name not in robot.joint_names and leader.name not in robot.locked_joints:
        if leader.mimic is None or leader.mimic.joint in seen:
            raise InputError(
                f"joint {joint.name!r} of robot {robot.name!r} is neither planned nor locked, and mimics no such joint"
            )
        gain, offset = gain * leader.mimic.multiplier, gain * leader.mimic.offset + offset
        leader = robot.joint(leader.mimic.joint)
        seen.add(leader.name)
    if leader.name not in robot.joint_names:
        return -1, 0.0, gain * robot.locked_joints[leader.name] + offset
    column = robot.joint_names.index(leader.name)
    if first is None:
        return -1, 0.0, gain * float(rest[column]) + offset
    return first + column, gain, offset
