"""Grasps from above, and the segments of a pick-and-place."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from rr1plan.checks import (
    Array,
    check_text,
    items_of,
    known_name,
    of_kind,
    positive_number,
    shape_of,
    true_or_false,
    whole_number,
)
from rr1plan.collision import CollisionChecker
from rr1plan.errors import InputError
from rr1plan.robot import Robot
from rr1plan.robot.bounding_boxes import bounding_box
from rr1plan.scene import Obstacle, Scene
from rr1plan.scene.problem import PoseGoal
from rr1plan.sequences.grippers import (
    grip_depth,
    grip_frame,
    gripper_links,
    only_gripper_joint,
    open_value,
    opening_value,
)
from rr1plan.sequences.segments import Attach, Detach, FreeMotion, MoveGripper, Segment, StraightLine
from rr1plan.shapes import Box, Capsule, Cylinder, Sphere
from rr1plan.transforms import as_pose, inverse, pose, quaternion_from_rotation, rotation_about

# Heights at which fingers grasp an object, as shares of its height.
_HEIGHTS = (0.5, 0.65, 0.8, 0.9)
# Clearance on each side with which an object fits between the fingers [m].
_PLAY = 2e-4
# Clearance of the open fingers on each side of the object [m].
_ROOM = 0.015
# Objects nearer than this below an object support it [m].
_SUPPORTS = 2e-3
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
    return [goal for _, goal in _grasps(robot, thing, obstacle, yaws)]


def pick_and_place(
    scene: Scene,
    obstacle: str,
    place: PoseGoal | ArrayLike | Sequence[PoseGoal],
    *,
    arm: str | None = None,
    grasps: Iterable[PoseGoal] | None = None,
    supports: Iterable[str] | None = None,
    height: float = 0.08,
    stop: bool = True,
) -> list[Segment]:
    """The segments that pick up an object and place it elsewhere, to be planned alone or with others as a `Sequence`.

    Open, move above the object, approach along the tool, close, lift, move above the place, lower, release, withdraw.

    Args:
        scene: The scene at the beginning, with the object at its pose at that time.
        obstacle: The object.
        place: Target: a position [m], shape (3,), in the current orientation rotated by any of eight angles about the
            vertical; a pose T_world_object, shape (4, 4); or goals whose frame is the object.
        arm: The arm (default: the only one).
        grasps: Poses of the tool at the object (default: `top_grasps`).
        supports: Objects on which the object stands before and after, and which it may touch while it is lifted and
            lowered (default: those less than 2 mm below it in the scene).
        height: Length of the lift and of the approach [m].
        stop: Whether to come to rest above the object and the place, see `FreeMotion`.

    Raises:
        UnknownNameError: no such object or arm.
        InputError: as for `top_grasps`; or an invalid place.
    """
    of_kind("scene", scene, Scene)
    check_text("obstacle", obstacle)
    thing = scene.obstacles[known_name("obstacle", obstacle, scene.obstacles)]
    arm = scene.only_arm(arm)
    robot = scene.arms[arm].robot
    height, stop = positive_number("height", height), true_or_false("stop", stop)
    if grasps is None:
        found = _grasps(robot, thing, obstacle, 8)
        width: float | None = max(own for own, _ in found)
        goals = [goal for _, goal in found]
    else:
        width, goals = None, list(items_of("grasps", grasps, "PoseGoal"))
        for goal in goals:
            of_kind("one of grasps", goal, PoseGoal)
            if goal.quaternion is None:
                raise InputError("one of grasps has no quaternion, expected full poses of the tool")
        if not goals:
            raise InputError("grasps is empty, expected at least one PoseGoal")
    places = _places(thing, obstacle, place)
    given = (
        None
        if supports is None
        else [known_name("support", n, scene.element_names) for n in items_of("supports", supports, "names")]
    )
    below = _supports(scene, obstacle, arm, [thing.pose, *map(_pose_of, places)]) if given is None else given
    rest = [(obstacle, name) for name in below]
    fingers = [(f"{arm}/{name}", obstacle) for name in gripper_links(robot) if robot.link(name).collisions]
    above = [_shifted(goal, -height * _pose_of(goal)[:3, 2]) for goal in goals]
    over = [_shifted(goal, np.array([0.0, 0.0, height])) for goal in places]
    return [
        _open(robot, arm, width),
        FreeMotion(above, arm=arm, stop=stop),
        StraightLine(offset=[0.0, 0.0, height], axes="tool", arm=arm),
        MoveGripper(around=obstacle, arm=arm),
        Attach(obstacle, arm=arm),
        StraightLine(offset=[0.0, 0.0, height], arm=arm, allow=rest, stop=stop),
        FreeMotion(over, arm=arm, stop=stop),
        StraightLine(offset=[0.0, 0.0, -height], arm=arm, allow=rest),
        Detach(obstacle),
        _open(robot, arm, width, fingers),
        StraightLine(offset=[0.0, 0.0, -height], axes="tool", arm=arm, stop=stop),
    ]


def _grasps(robot: Robot, thing: Obstacle, name: str, yaws: int) -> list[tuple[float, PoseGoal]]:
    """Grasps from above, each with the width of the object between the fingers [m]."""
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


def _places(thing: Obstacle, name: str, place: PoseGoal | ArrayLike | Sequence[PoseGoal]) -> list[PoseGoal]:
    """Goals for the pose of an object."""
    goals: list[PoseGoal]
    if isinstance(place, PoseGoal):
        goals = [place]
    elif shape_of(place) == (4, 4):
        goals = [PoseGoal(name, as_pose(np.asarray(place), "place"))]
    elif shape_of(place) == (3,):
        at, goals = as_pose(np.asarray(place), "place"), []
        for k in range(8):
            R = rotation_about([0.0, 0.0, 1.0], k * np.pi / 4) @ thing.pose[:3, :3]
            goals.append(PoseGoal(name, _posed(R, at[:3, 3])))
    else:
        goals = list(items_of("place", place, "PoseGoal"))
    if not goals:
        raise InputError("place is an empty list, expected at least one PoseGoal")
    for goal in goals:
        of_kind("one of the places", goal, PoseGoal)
        if goal.frame != name or goal.quaternion is None:
            raise InputError(f"a place is of the frame {goal.frame!r}, expected a pose of {name!r} with a quaternion")
    return goals


def _supports(scene: Scene, name: str, arm: str, poses: Iterable[Array]) -> list[str]:
    """The supports of an object at some poses."""
    found: dict[str, None] = {}
    for T in poses:
        held = scene.with_obstacle_at(name, T).attach(name, arm)
        checker = CollisionChecker(held, [arm])
        gaps = checker.distances(held.arms[arm].q)
        for both, gap in zip(checker.pairs, gaps.tolist(), strict=True):
            other = both[0] if both[1] == name else both[1]
            if name in both and other in scene.obstacles and gap < _SUPPORTS:
                found[other] = None
    return list(found)


def _open(robot: Robot, arm: str, width: float | None, allow: Iterable[tuple[str, str]] = ()) -> MoveGripper:
    """Open the fingers for a width [m] with clearance on both sides, or as far as possible."""
    if width is not None:
        wide = width + 2.0 * _ROOM
        try:
            opening_value(robot, wide)
        except InputError:
            pass
        else:
            return MoveGripper(width=wide, arm=arm, allow=allow)
    return MoveGripper(open_value(robot), arm=arm, allow=allow)


def _posed(R: Array, position: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    return pose(position, quaternion=quaternion_from_rotation(R))


def _pose_of(goal: PoseGoal) -> Array:
    return pose(goal.position, quaternion=goal.quaternion)


def _shifted(goal: PoseGoal, by: Array) -> PoseGoal:
    return PoseGoal(
        goal.frame,
        goal.position + by,
        goal.quaternion,
        position_tolerance=goal.position_tolerance,
        orientation_tolerance=goal.orientation_tolerance,
    )
