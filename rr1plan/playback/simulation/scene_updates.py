"""The scene of a simulation at its present state, and what stays when another scene replaces it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from rr1plan.checks import Array, shown
from rr1plan.errors import InputError
from rr1plan.robot import Robot
from rr1plan.scene import Arm, Scene

# Largest distance of a locked joint from its value in the scene that `present_scene` ignores, so that arms keep sharing
# a robot and the tables computed for it [rad or m].
_STILL = 1e-6
# A planned joint no farther than this beyond a limit is at the limit in `present_scene` [rad or m]: with a load that
# its servo does not know it sags past the limit, and planners reject a start there. A controller accepts this
# distance between the arm and the start of a trajectory (`start_tolerance`).
_SAG = 0.01
# Rounding of poses.
_SAME_POSE = 1e-9


def present_scene(scene: Scene, positions: Mapping[str, float], poses: Mapping[str, Array]) -> Scene:
    """A scene with other positions of planned and locked joints, and other poses of obstacles.

    Locked joints beyond a limit are at the limit, and planned joints that are beyond it by at most 0.01 rad or m.

    Args:
        scene: The scene.
        positions: Position of every movable joint by "arm/joint" [rad or m].
        poses: T_world_body of the obstacles that moved.
    """
    moved = {name: replace(scene.obstacles[name], pose=pose) for name, pose in poses.items()}
    arms = {}
    for name, arm in scene.arms.items():
        q = np.array([positions[f"{name}/{joint}"] for joint in arm.robot.joint_names])
        limits = arm.robot.limits
        within = np.clip(q, limits.lower, limits.upper)
        q = np.where(np.abs(q - within) <= _SAG, within, q)
        arms[name] = Arm(_relocked(name, arm.robot, positions), arm.base, q)
    return replace(scene, arms=arms, obstacles={**scene.obstacles, **moved})


def _relocked(arm: str, robot: Robot, positions: Mapping[str, float]) -> Robot:
    """The robot of an arm, with its locked joints at their present positions, within their limits."""
    values = {}
    for name, value in robot.locked_joints.items():
        joint = robot.joint(name)
        present = float(np.clip(positions[f"{arm}/{name}"], joint.lower, joint.upper))
        if abs(present - value) > _STILL:
            values[name] = present
    return robot.with_locked_joints(values) if values else robot


def check_same_arms(scene: Scene, other: Scene) -> None:
    """Require that another scene has the same arms at the same places, locked joints aside.

    Raises:
        InputError: different arms, or arms at other poses.
    """
    before, after = list(scene.arms), list(other.arms)
    if before != after:
        raise InputError(f"the scene has the arms {shown(after)}, expected those of the simulation: {shown(before)}")
    for name in before:
        one, another = scene.arms[name], other.arms[name]
        # Positions of locked joints differ in a scene that is based on `present_scene`.
        same = another.robot
        if same.locked_joints != one.robot.locked_joints:
            same = replace(same, locked_joints=one.robot.locked_joints)
        if one.robot.content_hash != same.content_hash or not np.array_equal(one.base, another.base):
            raise InputError(f"arm {name!r} is another robot or elsewhere, expected the arms of the simulation")


def unmoved_bodies(scene: Scene, other: Scene, poses: Mapping[str, Array]) -> set[str]:
    """The loose bodies that another scene has where they were at first, or where they are now.

    Args:
        scene: The scene of the simulation.
        other: The other scene.
        poses: Present T_world_body of each loose body.
    """
    return {
        name
        for name, present in poses.items()
        if name in other.obstacles
        and (
            np.array_equal(scene.obstacles[name].pose, other.obstacles[name].pose)
            or np.abs(present - other.obstacles[name].pose).max() <= _SAME_POSE
        )
    }
