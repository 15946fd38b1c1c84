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
# Fingers reach at least this far below the top of an object, except at mid-height: less slips out of them [m].
_REACH = 2e-3
# Clearance on each side with which an object fits between the fingers [m].
_PLAY = 2e-4
# Fingers still meet sides squarely whose normals deviate from the horizontal by this angle [rad].
_LEVEL = 0.05
# Step between the angles at which widths are compared [degrees], and the share of the width that counts.
_TURN, _NARROWER = 5, 2e-3
# Rotation that shows where the sides of an object begin and end [rad].
_TILT = 0.01
# Sides that recede farther than this, beyond a tilt that is level, where fingers meet them, are not grasped [m].
_HOLLOW = 1e-3
# A cylinder lies if its axis is nearer to the horizontal than to the vertical (cosine of the angle to the vertical).
_LYING = 0.7


def top_grasps(scene: Scene, obstacle: str, *, arm: str | None = None, yaws: int = 8) -> list[PoseGoal]:
    """Poses of the tool from which a gripper with two fingers can grasp an object from above.

    Opposite faces of a box that are vertical within 3 degrees are grasped, and a cylinder or capsule that is tilted or
    lies is grasped across its axis, or at the ends of a lying cylinder; other objects at several angles around the
    vertical, or the nearest at which they are narrower than at all angles nearby, where their sides are opposite. Each
    is grasped at mid-height or higher up; a ball or a lying cylinder as near to its middle as possible. Sides too wide
    for the gripper are omitted. The tool's z axis has to point out of the hand.

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
        angles = _narrow_angles(thing, [2.0 * np.pi * k / yaws for k in range(yaws)])
    found: list[tuple[float, PoseGoal]] = []
    widths, why = [], ""
    rounded = _is_rounded_above(thing)
    for angle in angles:
        turn = _turned(angle)
        low, high = _turned_box(thing, angle)
        width = round(float(high[0] - low[0]), 9)
        widths.append(width)
        try:
            depth, fits = grip_depth(robot, width), _fit(robot, thing, width)
        except InputError as error:
            why = f": {error}"
            continue
        middle = _middle_of_sides(thing, angle)
        for share in _HEIGHTS:
            if share > _HEIGHTS[0] and (1.0 - share) * (high[2] - low[2]) < _REACH:
                break
            at = np.array([0.5 * (low[0] + high[0]), middle, low[2] + share * (high[2] - low[2])])
            # The z axis of the grip frame points down, its x axis along the width.
            R = turn @ np.diag([1.0, -1.0, -1.0])
            T = _posed(R, turn @ at - depth * R[:, 2]) @ inverse(grip_frame(robot))
            if fits(T):
                found.append((width, PoseGoal(robot.tool, T)))
                if rounded:
                    break  # fingers that close above the middle push it out of their grip
    if not found:
        why = why or ": there are no opposite sides for its fingers"
        raise InputError(
            f"the gripper cannot grasp {name!r} from above, which is {1e3 * min(widths):.4g} mm wide at least{why}"
        )
    return found


def _fit(robot: Robot, thing: Obstacle, width: float) -> Callable[[Array], bool]:
    """Whether an object fits between fingers opened for its width, with only its sides near the fingers, on both sides.

    Raises:
        InputError: the gripper does not open so wide.
    """
    opened = robot.with_locked_joints({only_gripper_joint(robot): opening_value(robot, width + 2.0 * _PLAY)})
    scene = Scene(obstacles={"thing": thing}).with_arm("arm", opened)
    checker, T_tool = CollisionChecker(scene), opened.link_poses(opened.home)[opened.tool]
    grip = grip_frame(robot)
    low, high = bounding_box(thing.geometries, thing.pose)
    recess = _HOLLOW + _LEVEL * (high[2] - low[2])

    def is_free(T_world_tool: Array, shift: float) -> bool:
        across = grip @ pose([shift, 0.0, 0.0]) @ inverse(grip)
        checker.move_obstacle("thing", T_tool @ across @ inverse(T_world_tool) @ thing.pose)
        return checker.is_free(opened.home)

    def fits(T_world_tool: Array) -> bool:
        return is_free(T_world_tool, 0.0) and not any(is_free(T_world_tool, shift) for shift in (-recess, recess))

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


def _narrow_angles(thing: Obstacle, angles: list[float]) -> list[float]:
    """Angles around the vertical, each changed to the nearest local minimum of the width of an object.

    Closing fingers turn an object toward such a minimum (K. Goldberg, "Orienting polygonal parts without sensors",
    Algorithmica 10, 1993). Where the width hardly changes, as that of an upright cylinder, angles stay.
    """
    count = 180 // _TURN
    step = np.pi / count

    def width(angle: float) -> float:
        low, high = _turned_box(thing, angle)
        return float(high[0] - low[0])

    widths = [width(k * step) for k in range(count)]
    found: dict[float, float] = {}
    minima: dict[int, float] = {}
    for angle in angles:
        k = round(angle / step)
        while True:
            before, own, after = (widths[(k + d) % count] for d in (-1, 0, 1))
            if min(before, after) >= own * (1.0 - _NARROWER):
                break
            k += 1 if after < before else -1
        if max(before, after) > own * (1.0 + _NARROWER):
            turns, rest = divmod(k, count)
            if rest not in minima:
                minima[rest] = _minimum(width, (rest - 1) * step, (rest + 1) * step)
            angle = minima[rest] + turns * np.pi
        found.setdefault(round(angle % (2.0 * np.pi), 4), angle)
    return list(found.values())


def _minimum(value: Callable[[float], float], low: float, high: float) -> float:
    """Where a function is least between two arguments, by ternary search."""
    while high - low > 1e-8:
        third = (high - low) / 3.0
        if value(low + third) <= value(high - third):
            high -= third
        else:
            low += third
    return 0.5 * (low + high)


def _middle_of_sides(thing: Obstacle, angle: float) -> float:
    """The y coordinate of the middle of the overlap of two opposite sides of an object, in axes turned by an angle.

    The sides are those with the least and the largest x. After a small rotation of the axes, one end of each is
    farthest out.
    """
    box = _turned_box(thing, angle)
    center = box.mean(axis=0)

    def ends(tilt: float) -> Array:
        tilted = _turned_box(thing, angle + tilt) - _turned(-tilt) @ center
        return np.asarray((tilted[:, 0] - np.cos(tilt) * (box[:, 0] - center[0])) / np.sin(tilt))

    (near_high, far_low), (near_low, far_high) = ends(-_TILT), ends(_TILT)
    return float(center[1] + 0.5 * (max(near_low, far_low) + min(near_high, far_high)))


def _turned_box(thing: Obstacle, angle: float) -> Array:
    """The bounding box of an object in axes turned by an angle about the vertical, shape (2, 3)."""
    return bounding_box(thing.geometries, _posed(_turned(-angle)) @ thing.pose)


def _turned(angle: float) -> Array:
    return rotation_about([0.0, 0.0, 1.0], angle)


def _posed(R: Array, position: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    return pose(position, quaternion=quaternion_from_rotation(R))
