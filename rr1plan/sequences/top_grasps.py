"""Grasps of objects from above, by grippers with two fingers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from rr1plan.checks import Array, check_text, known_name, of_kind, whole_number
from rr1plan.collision import CollisionChecker
from rr1plan.errors import InputError
from rr1plan.robot import Robot
from rr1plan.robot.bounding_boxes import bounding_box
from rr1plan.scene import Obstacle, Scene
from rr1plan.scene.problem import PoseGoal
from rr1plan.sequences.grippers import grip_depth, grip_frame, only_gripper_joint, opening_value
from rr1plan.shapes import Box, Capsule, Cylinder, Sphere
from rr1plan.transforms import inverse, pose, quaternion_from_rotation, rotation_about

# Heights at which fingers grasp an object, as shares of its height.
_HEIGHTS = (0.5, 0.65, 0.8, 0.9)
# Clearance on each side with which an object fits between the fingers [m].
_PLAY = 2e-4
# Fingers still meet sides squarely whose normals deviate from the horizontal by this angle [rad].
_LEVEL = 0.05
# A cylinder lies if its axis is nearer to the horizontal than to the vertical (cosine of the angle to the vertical).
_LYING = 0.7


def top_grasps(scene: Scene, obstacle: str, *, arm: str | None = None, yaws: int = 8) -> list[PoseGoal]:
    """Poses of the tool from which a gripper with two fingers can grasp an object from above.

    Opposite faces of a box that are vertical within 3 degrees are grasped, and a cylinder or capsule that is tilted or
    lies is grasped across its axis, or at the ends of a lying cylinder; other objects at several angles around the
    vertical. Each is grasped at mid-height or higher up; a ball or a lying cylinder as near to its middle as possible.
    Sides too wide for the gripper are omitted. The tool's z axis has to point out of the hand.

    Args:
        scene: The scene with the object at its pose.
        obstacle: The object.
        arm: The arm (default: the only one).
        yaws: Number of angles around the vertical for those other objects.

    Raises:
        UnknownNameError: no such object or arm.
        InputError: a gripper without exactly one joint, or one that opens for no side of the object.
    """
    of_kind("scene", scene, Scene)
    check_text("obstacle", obstacle)
    thing = scene.obstacles[known_name("obstacle", obstacle, scene.obstacles)]
    robot = scene.arms[scene.only_arm(arm)].robot
    whole_number("yaws", yaws, 1, 360)
    return [goal for _, goal in grasps_of(robot, thing, obstacle, yaws)]


def grasps_of(robot: Robot, thing: Obstacle, name: str, yaws: int) -> list[tuple[float, PoseGoal]]:
    """Grasps from above, each with the width of the object between the fingers [m]; see `top_grasps`."""
    only_gripper_joint(robot)
    angles = _square_angles(thing)
    if angles is None:
        angles = [2.0 * np.pi * k / yaws for k in range(yaws)]
    found: list[tuple[float, PoseGoal]] = []
    widths, why = [], ""
    rounded = _is_rounded_above(thing)
    for angle in angles:
        turn = rotation_about([0.0, 0.0, 1.0], angle)
        low, high = bounding_box(thing.geometries, _posed(turn.T) @ thing.pose)
        width = round(float(high[0] - low[0]), 9)
        widths.append(width)
        try:
            depth, fits = grip_depth(robot, width), _fit(robot, thing, width)
        except InputError as error:
            why = f": {error}"
            continue
        for share in _HEIGHTS:
            at = np.array([*(0.5 * (low + high))[:2], low[2] + share * (high[2] - low[2])])
            # The z axis of the grip frame points down, its x axis along the width.
            R = turn @ np.diag([1.0, -1.0, -1.0])
            T = _posed(R, turn @ at - depth * R[:, 2]) @ inverse(grip_frame(robot))
            if fits(T):
                found.append((width, PoseGoal(robot.tool, T)))
                if rounded:
                    break  # fingers that close above the middle push it out of their grip
    if not found:
        raise InputError(
            f"the gripper cannot grasp {name!r} from above, which is {1e3 * min(widths):.3g} mm wide at least{why}"
        )
    return found


def _fit(robot: Robot, thing: Obstacle, width: float) -> Callable[[Array], bool]:
    """Whether an object fits between fingers opened for its width, with only its sides near the fingers.

    Raises:
        InputError: the gripper does not open so wide.
    """
    opened = robot.with_locked_joints({only_gripper_joint(robot): opening_value(robot, width + 2.0 * _PLAY)})
    scene = Scene(obstacles={"thing": thing}).with_arm("arm", opened)
    checker, T_tool = CollisionChecker(scene), opened.link_poses(opened.home)[opened.tool]

    def fits(T_world_tool: Array) -> bool:
        checker.move_obstacle("thing", T_tool @ inverse(T_world_tool) @ thing.pose)
        return checker.is_free(opened.home)

    return fits


def _is_rounded_above(thing: Obstacle) -> bool:
    """Whether an object is a ball or a lying cylinder or capsule."""
    if len(thing.geometries) != 1:
        return False
    geometry = thing.geometries[0]
    lies = abs((thing.pose @ geometry.pose)[2, 2]) < _LYING
    return isinstance(geometry.shape, Sphere) or (lies and isinstance(geometry.shape, Cylinder | Capsule))


def _square_angles(thing: Obstacle) -> list[float] | None:
    """Angles around the vertical at which fingers meet opposite sides of an object squarely.

    None if there are none that differ from others: of upright cylinders, tilted boxes, other shapes.
    """
    if len(thing.geometries) != 1:
        return None
    geometry = thing.geometries[0]
    axes = (thing.pose @ geometry.pose)[:3, :3].T
    across = np.cross([0.0, 0.0, 1.0], axes[2])  # of the axis of a cylinder
    match geometry.shape:
        case Box():
            sides = list(axes)
        case Cylinder() if np.linalg.norm(across) > _LEVEL:
            sides = [across, axes[2]]
        case Capsule() if np.linalg.norm(across) > _LEVEL:
            sides = [across]
        case _:
            return None
    level = [float(np.arctan2(side[1], side[0])) for side in sides if abs(side[2]) < _LEVEL]
    turn = np.pi / 2 if len(level) > 1 else np.pi
    return [level[0] + angle for angle in np.arange(0.0, 2.0 * np.pi, turn)] if level else None


def _posed(R: Array, position: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    return pose(position, quaternion=quaternion_from_rotation(R))
