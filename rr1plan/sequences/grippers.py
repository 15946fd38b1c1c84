"""The gripper of a robot: its joints and links, and the opening of its fingers around an object.

While an arm moves, its gripper is locked. If the gripper itself moves, its joints become planning joints of a copy of
the robot (`unlocked_robot`), so that checker, referee, simulator and pages treat them like any others.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from rr1plan.checks import Array, known_name
from rr1plan.collision import CollisionChecker
from rr1plan.errors import InputError
from rr1plan.robot import Robot
from rr1plan.robot.bounding_boxes import bounding_box
from rr1plan.robot.robot import independent_joint
from rr1plan.scene import Arm, Obstacle, Pair, Scene, pair
from rr1plan.scene.unlocked_joints import unlocked_robot
from rr1plan.shapes import Box
from rr1plan.transforms import inverse, pose

# A plate between the fingers, to measure their opening: its width and length [m].
_PLATE_WIDTH, _PLATE_LENGTH = 0.002, 0.5
# A contact this far from the side of a plate is one with its front [m].
_SIDE = 1e-4
# Fingers whose direction of travel is this near to the x axis travel along it [rad].
_STRAIGHT = 1e-3
# A finger on the opposite side travels by at least this share of the other one's travel.
_OPPOSITE = 0.1
# A change of the opening small enough to be linear [rad or m].
_STEP = 1e-3


@lru_cache(maxsize=64)
def gripper_joints(robot: Robot) -> tuple[str, ...]:
    """The independent joints of a robot's gripper: locked joints moved by the planning joints."""
    carried = _carried_by(robot, robot.joint_names)
    return tuple(name for name in robot.locked_joints if robot.joint(name).parent in carried)


@lru_cache(maxsize=64)
def gripper_links(robot: Robot) -> tuple[str, ...]:
    """The links that the gripper's joints move or, without such joints, the links fixed to the tool."""
    joints = set(gripper_joints(robot))
    movers = [j.name for j in robot.joints if independent_joint(robot, j)[0].name in joints]
    moved = _carried_by(robot, movers)
    if not moved:
        moved = next(
            {link.name for link in body} for body in robot.bodies if robot.tool in {part.name for part in body}
        )
    return tuple(link.name for link in robot.links if link.name in moved)


def _carried_by(robot: Robot, joints: Iterable[str]) -> set[str]:
    """The links that some joints move."""
    carried = {robot.joint(name).child for name in joints}
    for joint in robot.joints:  # a joint comes after the one that moves its parent
        if joint.parent in carried:
            carried.add(joint.child)
    return carried


def only_gripper_joint(robot: Robot) -> str:
    """The joint that opens and closes the gripper.

    Raises:
        InputError: there is none, or more than one.
    """
    joints = gripper_joints(robot)
    if len(joints) == 1:
        return joints[0]
    found = f"{len(joints)} locked joints ({', '.join(joints)})" if joints else "no locked joint"
    advice = (
        "let the others mimic one of them (<mimic> in URDF)"
        if joints
        else "if one of its planning joints does, load it with joints= or groups= that leave this joint out; a hand "
        "without fingers takes segments with Attach and Detach only"
    )
    raise InputError(f"robot {robot.name!r} has {found} in its hand, expected one that moves its fingers: {advice}")


def finger_contacts(robot: Robot, arm: str, thing: str) -> frozenset[Pair]:
    """The pairs of the fingers of an arm with an object."""
    return frozenset(pair(f"{arm}/{name}", thing) for name in gripper_links(robot) if robot.link(name).collisions)


def gripper_values(robot: Robot, position: str | float) -> dict[str, float]:
    """The gripper's joint values for a named state, or for a value of its only joint.

    Raises:
        UnknownNameError: no such state.
        InputError: a state without joints of the gripper, or a number for a gripper without exactly one joint.
    """
    if isinstance(position, str):
        states, joints = robot.locked_joint_states, gripper_joints(robot)
        if not joints:
            only_gripper_joint(robot)  # raises
        values = states[known_name("gripper state", position, states)]
        if not set(values) & set(joints):
            raise InputError(
                f"gripper state {position!r} of robot {robot.name!r} sets no joint of its gripper "
                f"({', '.join(joints)}); add one to the state, or use another state"
            )
        return {name: value for name, value in values.items() if name in joints}
    return {only_gripper_joint(robot): position}


def closing_value(arm: Arm, thing: Obstacle, squeeze: float) -> float:
    """The joint value at which the closing fingers touch an object and are commanded closer by `squeeze` [m].

    Args:
        arm: The arm at its configuration.
        thing: The object.
        squeeze: Distance by which the fingers are commanded closer [m].

    Raises:
        InputError: the fingers touch the object before they close, or do not reach it.
    """
    robot, q = arm.robot, arm.q
    joint = robot.joint(only_gripper_joint(robot))
    scene = Scene().with_arm("arm", unlocked_robot(robot, (joint.name,)), arm.base)
    scene = replace(scene, obstacles={"thing": thing})
    fingers = {f"arm/{name}" for name in gripper_links(robot)}
    rest = [name for name in scene.element_names if name.startswith("arm/") and name not in fingers]
    scene = replace(scene, allowed=frozenset(frozenset((name, "thing")) for name in rest))
    checker = CollisionChecker(scene)
    opened, closed = _open_and_closed(robot, joint.name)
    touch = checker.first_contact(np.append(q, opened), np.append(q, closed), precision=1e-5)
    if touch is None:
        raise InputError("the fingers close without touching it")
    if touch.fraction == 0.0:
        raise InputError("the open fingers already touch it")
    value = opened + touch.fraction * (closed - opened)
    toward_open = _STEP * np.sign(opened - closed)
    between = [i for i, both in enumerate(checker.pairs) if "thing" in both and fingers & set(both)]
    gaps = [checker.distances(np.append(q, at))[between].clip(0.0) for at in (value, value + toward_open)]
    # Both fingers move: the opening changes by the sum of their distances.
    rate = float((gaps[1] - gaps[0]).sum()) / _STEP
    command = value - np.sign(toward_open) * squeeze / max(rate, 1e-3)
    return float(np.clip(command, joint.lower, joint.upper))


def opening_value(robot: Robot, width: float) -> float:
    """The joint value at which a plate of a thickness [m] just fits between the fingers, beyond the tool frame.

    The tool's z axis points out of the hand.

    Raises:
        InputError: a gripper that does not open so wide.
    """
    return _plate_contact(robot, width).value


def grip_depth(robot: Robot, width: float) -> float:
    """Distance [m] beyond the tool frame, along its z axis, at which fingers touch a plate of a thickness [m].

    Raises:
        InputError: a gripper that does not open so wide.
    """
    return float(_plate_contact(robot, width).point[2])


class _PlateContact(NamedTuple):
    """Joint value at which fingers touch a plate, and position of the contact in the grip frame [m], shape (3,)."""

    value: float
    point: Array


@lru_cache(maxsize=256)
def _plate_contact(robot: Robot, width: float) -> _PlateContact:
    """Contact of closing fingers with a plate of a thickness [m] that begins at the tool frame.

    Raises:
        InputError: a gripper that does not open so wide.
    """
    joint, plate = robot.joint(only_gripper_joint(robot)), _plate(robot, width)
    try:
        value = closing_value(Arm(robot), plate, 0.0)
    except InputError as error:
        raise InputError(f"the fingers do not fit a plate of {1e3 * width:.4g} mm: {error}") from error
    scene = Scene(obstacles={"thing": plate}).with_arm("arm", unlocked_robot(robot, (joint.name,)))
    fingers = finger_contacts(robot, "arm", "thing")
    others = (pair(a, b) for a in scene.element_names for b in scene.element_names if a < b)
    checker = CollisionChecker(replace(scene, allowed=frozenset(others) - fingers))
    T = inverse(robot.link_poses(robot.home)[robot.tool] @ grip_frame(robot))
    point = (T @ np.append(checker.nearest(np.append(robot.home, value)).point_a, 1.0))[:3]
    if abs(point[0]) < width / 2 - _SIDE:
        raise InputError(f"the fingers do not open for {1e3 * width:.4g} mm")
    return _PlateContact(value, point)


def open_value(robot: Robot) -> float:
    """The value of the gripper's joint at which its fingers are farthest apart.

    Raises:
        InputError: a gripper without exactly one joint.
    """
    return _open_and_closed(robot, only_gripper_joint(robot))[0]


@lru_cache(maxsize=64)
def finger_lever(robot: Robot, joint: str) -> float:
    """How far fingers travel for each unit of a planning joint that moves them [m/rad, or m/m]; 0 without limits.

    Args:
        robot: The robot whose gripper moves.
        joint: The joint that opens and closes it.
    """
    low, high = robot.joint(joint).lower, robot.joint(joint).upper
    if not np.isfinite(high - low):
        return 0.0
    ends = []
    for value in (low, high):
        q = robot.home.copy()
        q[robot.joint_names.index(joint)] = value
        ends.append(_shape_centers(robot, robot.link_poses(q), robot.link_names))
    travels = np.linalg.norm(ends[1] - ends[0], axis=1)
    return float(travels.max(initial=0.0)) / (high - low)


@lru_cache(maxsize=64)
def grip_frame(robot: Robot) -> Array:
    """T_tool_grip: the tool frame rotated about its z axis until x is along the travel of the fingers.

    Raises:
        InputError: a gripper without exactly one joint, or one that closes from one side only.
    """
    opened, closed = (_finger_centers(robot, v) for v in _open_and_closed(robot, only_gripper_joint(robot)))
    travels = (opened - closed) @ robot.link_poses(robot.home)[robot.tool][:3, :2]
    # In a linkage some shapes turn about their own centers.
    x, y = travels[np.linalg.norm(travels, axis=1).argmax()]
    if (travels @ [x, y]).min() > -_OPPOSITE * (x * x + y * y):
        raise InputError(
            f"the gripper of robot {robot.name!r} closes from one side only, expected fingers that close from opposite "
            "sides; use grasps of your own, position or around of MoveGripper, and allow the fixed jaw to touch the "
            "object"
        )
    # Both fingers travel, so the sign of the direction does not matter.
    angle = (float(np.arctan2(y, x)) + np.pi / 2 - _STRAIGHT) % np.pi - np.pi / 2 + _STRAIGHT
    return pose(rpy=[0.0, 0.0, 0.0 if abs(angle) < _STRAIGHT else angle])


def _plate(robot: Robot, width: float) -> Obstacle:
    """A plate of a thickness [m] in front of the tool frame, with the robot at home."""
    T = robot.link_poses(robot.home)[robot.tool] @ grip_frame(robot)
    box = Box((width, _PLATE_WIDTH, _PLATE_LENGTH))
    (geometry,) = Scene().with_obstacle("plate", box).obstacles["plate"].geometries
    return Obstacle((geometry,), T @ pose([0.0, 0.0, _PLATE_LENGTH / 2]))


def _open_and_closed(robot: Robot, joint: str) -> tuple[float, float]:
    """The limits of a gripper's joint, first the one at which the fingers are farther apart."""
    ends = []
    for value in (robot.joint(joint).lower, robot.joint(joint).upper):
        centers = _finger_centers(robot, value)
        spread = np.linalg.norm(centers[:, None] - centers, axis=-1).max(initial=0.0)
        ends.append((float(spread), value))
    (_, closed), (_, opened) = sorted(ends)
    return opened, closed


def _finger_centers(robot: Robot, value: float) -> Array:
    """The centers of the shapes of a gripper at a value of its joint, while the robot is at home, shape (n, 3)."""
    poses = robot.with_locked_joints({only_gripper_joint(robot): value}).link_poses(robot.home)
    return _shape_centers(robot, poses, gripper_links(robot))


def _shape_centers(robot: Robot, poses: Mapping[str, Array], links: Iterable[str]) -> Array:
    """The centers of the collision shapes of some links, shape (n, 3)."""
    centers = [
        poses[name] @ np.append(bounding_box((geometry,), np.eye(4)).mean(axis=0), 1.0)
        for name in links
        for geometry in robot.link(name).collisions
    ]
    return np.array(centers).reshape(-1, 4)[:, :3]
