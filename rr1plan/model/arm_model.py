"""The arms of a scene as one Pinocchio model, shared by scenes with the same arms."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from types import MappingProxyType

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from rr1plan.checks import Array, read_only
from rr1plan.robot import Geometry, Joint, Robot
from rr1plan.robot.joint_limits import Limits
from rr1plan.robot.robot import affine_value
from rr1plan.scene import Arm, Scene
from rr1plan.transforms import identity

_AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_REVOLUTE = (pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ)
_PRISMATIC = (pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ)


@dataclass(frozen=True, eq=False)
class Body:
    """Placement of a rigid body in the model.

    Args:
        joint: Index of the parent joint in Pinocchio; 0 is the world.
        placement: T_joint_body, shape (4, 4).
    """

    joint: int
    placement: Array


@dataclass(frozen=True, eq=False)
class ElementGeometry:
    """A shape of an element of the scene, placed in the model.

    Args:
        element: "arm/link", an obstacle or an attached object.
        geometry: The shape.
        joint: Index of the parent joint in Pinocchio; 0 is the world.
        placement: T_joint_geometry, shape (4, 4).
    """

    element: str
    geometry: Geometry
    joint: int
    placement: Array


def hang(element: str, body: Body, geometries: Iterable[Geometry]) -> tuple[ElementGeometry, ...]:
    """Shapes of a body, placed in the frame of its joint."""
    return tuple(ElementGeometry(element, g, body.joint, read_only(body.placement @ g.pose)) for g in geometries)


@dataclass(frozen=True, eq=False)
class ArmModel:
    """The part of a `SceneModel` that depends only on the arms, which of them move, and the other configurations.

    It is shared by scenes that agree in these, so its `model` must not be modified.

    Args:
        joint_names, limits, model, columns, gains, offsets: See `SceneModel`.
        bodies: Joint and placement of each link.
        frames: Pinocchio's index of each link's frame.
        link_geometries: Every collision shape of the links.
    """

    joint_names: tuple[str, ...]
    limits: Limits
    model: pin.Model
    columns: NDArray[np.intp]
    gains: Array
    offsets: Array
    bodies: Mapping[str, Body]
    frames: Mapping[str, int]
    link_geometries: tuple[ElementGeometry, ...]


@dataclass(frozen=True)
class _Content:
    """Cache key of an `ArmModel`, and the data to build it."""

    key: tuple[tuple[str, str, bytes, bytes | None], ...]
    arms: Mapping[str, Arm] = field(compare=False)


def arm_model_of(scene: Scene, arms: tuple[str, ...]) -> ArmModel:
    """The `ArmModel` of a scene with the given moving arms; cached for scenes with equal arms.

    Raises:
        InputError: a joint that is neither planned, locked nor mimics one that is.
    """
    key = tuple(
        (name, arm.robot.content_hash, arm.base.tobytes(), None if name in arms else arm.q.tobytes())
        for name, arm in scene.arms.items()
    )
    return _arm_model(_Content(key, scene.arms))


@lru_cache(maxsize=64)
def _arm_model(content: _Content) -> ArmModel:
    builder = _Builder()
    moving = [name for name, *_, configuration in content.key if configuration is None]
    drives: list[tuple[int, float, float]] = []
    names: list[str] = []
    for name, arm in content.arms.items():
        first = len(names) if name in moving else None
        drives += [_drive(arm.robot, joint, first, arm.q) for joint in builder.add_arm(name, arm)]
        names += [f"{name}/{joint}" for joint in arm.robot.joint_names] if name in moving else []
    columns, gains, offsets = zip(*drives, strict=True) if drives else ((), (), ())
    return ArmModel(
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
    """Builds a Pinocchio model arm by arm."""

    def __init__(self) -> None:
        self.model = pin.Model()
        self.bodies: dict[str, Body] = {}
        self.frames: dict[str, int] = {}

    def add_arm(self, name: str, arm: Arm) -> list[Joint]:
        """Add an arm; return its movable joints in the order of the model."""
        self._add_link(name, arm.robot, arm.robot.base, Body(0, arm.base))
        added = []
        for joint in _depth_first(arm.robot):
            parent = self.bodies[f"{name}/{joint.parent}"]
            placement = read_only(parent.placement @ joint.origin)
            if joint.kind == "fixed":
                body = Body(parent.joint, placement)
            else:
                body = Body(self._add_joint(name, joint, Body(parent.joint, placement)), identity())
                added.append(joint)
            self._add_link(name, arm.robot, joint.child, body)
        return added

    def _add_joint(self, arm: str, joint: Joint, at: Body) -> int:
        bounds = [joint.effort, joint.velocity, joint.lower, joint.upper]
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
    """The joints in depth-first order, as Pinocchio's dynamics requires."""
    children: dict[str, list[Joint]] = {}
    for joint in robot.limited_joints:
        children.setdefault(joint.parent, []).append(joint)
    ordered: list[Joint] = []
    stack = children.get(robot.base, [])[::-1]
    while stack:
        joint = stack.pop()
        ordered.append(joint)
        stack += children.get(joint.child, [])[::-1]
    return ordered


def _joint_model(joint: Joint) -> pin.JointModel:
    """Pinocchio's joint model with one position; axis-aligned ones are faster."""
    aligned, unaligned = (
        (_PRISMATIC, pin.JointModelPrismaticUnaligned)
        if joint.kind == "prismatic"
        else (_REVOLUTE, pin.JointModelRevoluteUnaligned)
    )
    axis = tuple(float(x) for x in joint.axis)
    return aligned[_AXES.index(axis)]() if axis in _AXES else unaligned(np.array(axis))


def joint_axis(joint: pin.JointModel) -> tuple[bool, Array]:
    """Whether a joint with one degree of freedom slides, and the unit axis in its frame, shape (3,)."""
    # Constant, so the data need not be computed; `joint.calc` would read the whole configuration of its model.
    linear, angular = np.array(joint.createData().S).reshape(2, 3)
    slides = not angular.any()
    return slides, linear if slides else angular


def _drive(robot: Robot, joint: Joint, first: int | None, rest: Array) -> tuple[int, float, float]:
    """Affine map of a joint: (column, gain, offset). `first` is the arm's first column, None for a fixed arm."""
    column, gain, offset = affine_value(robot, joint)
    if column < 0:
        return column, gain, offset
    return (-1, 0.0, gain * float(rest[column]) + offset) if first is None else (first + column, gain, offset)
