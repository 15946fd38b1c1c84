"""Conversion of joints, such as those of a gripper, between locked and planning joints of a robot or scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np

from rr1plan.robot import Robot
from rr1plan.robot.joint_limits import Limits, selected_limits
from rr1plan.robot.robot_builder import urdf_limits, warn_of_unknown_velocities
from rr1plan.scene import Arm, Scene


@lru_cache(maxsize=256)
def unlocked_robot(robot: Robot, joints: tuple[str, ...]) -> Robot:
    """The same robot with some locked joints as its last planning joints, at their current values."""
    warn_of_unknown_velocities(robot, joints)
    rows = [robot.joint(name) for name in joints]
    values = [robot.locked_joints[name] for name in joints]
    return replace(
        robot,
        joint_names=(*robot.joint_names, *joints),
        limits=Limits.stack([robot.limits, urdf_limits(rows)]),
        configurations={name: np.append(q, values) for name, q in robot.configurations.items()},
        locked_joints={name: value for name, value in robot.locked_joints.items() if name not in joints},
        presets={},
        locked_joint_states={},
    )


def unlocked_scene(scene: Scene, joints: Mapping[str, tuple[str, ...]]) -> Scene:
    """A scene in which some locked joints are planning joints, at their current values.

    Args:
        scene: The scene.
        joints: These joints by arm.
    """
    unlocked = {}
    for name, own in joints.items():
        if own:
            arm = scene.arms[name]
            q = np.append(arm.q, [arm.robot.locked_joints[joint] for joint in own])
            unlocked[name] = Arm(unlocked_robot(arm.robot, own), arm.base, q)
    return replace(scene, arms={**scene.arms, **unlocked}) if unlocked else scene


@lru_cache(maxsize=256)
def locked_robot(robot: Robot, joints: tuple[str, ...], values: tuple[float, ...]) -> Robot:
    """The same robot with some planning joints locked at values: the reverse of `unlocked_robot`."""
    kept = [j for j, name in enumerate(robot.joint_names) if name not in joints]
    return replace(
        robot,
        joint_names=tuple(robot.joint_names[j] for j in kept),
        limits=selected_limits(robot.limits, kept),
        configurations={name: q[kept] for name, q in robot.configurations.items()},
        locked_joints={**robot.locked_joints, **dict(zip(joints, values, strict=True))},
        presets={},
        locked_joint_states={},
    )


def locked_scene(scene: Scene, joints: Mapping[str, tuple[str, ...]]) -> Scene:
    """A scene in which some planning joints are locked at their current values.

    Args:
        scene: The scene.
        joints: These joints by arm.
    """
    locked = {}
    for name, own in joints.items():
        if own:
            arm = scene.arms[name]
            present = dict(zip(arm.robot.joint_names, arm.q.tolist(), strict=True))
            robot = locked_robot(arm.robot, tuple(own), tuple(present[joint] for joint in own))
            locked[name] = Arm(robot, arm.base, [present[joint] for joint in robot.joint_names])
    return replace(scene, arms={**scene.arms, **locked}) if locked else scene
