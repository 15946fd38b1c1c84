"""The segments of a pick-and-place."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

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
    shown,
    true_or_false,
)
from rr1plan.collision import CollisionChecker
from rr1plan.errors import InputError
from rr1plan.robot import Robot
from rr1plan.scene import Obstacle, Scene
from rr1plan.scene.problem import PoseGoal
from rr1plan.sequences.grippers import (
    gripper_links,
    open_value,
    opening_value,
)
from rr1plan.sequences.segments import Attach, Detach, FreeMotion, MoveGripper, Segment, StraightLine
from rr1plan.sequences.top_grasps import grasps_of
from rr1plan.transforms import as_pose, pose, quaternion_from_rotation, rotation_about

# Clearance of the open fingers on each side of the object [m].
_ROOM = 0.015
# Objects support one that is nearer to them than this, or no deeper in them [m].
_SUPPORTS = 2e-3


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
            vertical; a pose T_world_object, shape (4, 4); or goals whose frame is the object. Whether something
            supports the object there is not checked; `simulate_sequence` shows whether it falls.
        arm: The arm (default: the only one).
        grasps: Poses of the tool at the object (default: `top_grasps`).
        supports: Objects on which the object stands before and after, and which it may touch while it is lifted and
            lowered (default: while it is lifted those less than 2 mm from it in the scene, while it is lowered those
            less than 2 mm from it at the place; places deeper than that in one of them are omitted).
        height: Length of the lift and of the approach [m].
        stop: Whether to come to rest above the object and the place, see `FreeMotion`.

    Raises:
        UnknownNameError: no such object or arm.
        InputError: as for `top_grasps`; or an arm holds the object; or an invalid place; or all places are inside of
            supports.
    """
    of_kind("scene", scene, Scene)
    check_text("obstacle", obstacle)
    if obstacle in scene.attachments:
        held = scene.attachments[obstacle]
        raise InputError(f"{obstacle!r} is held by {held.arm!r} at the start, so it cannot be picked: detach it first")
    thing = scene.obstacles[known_name("obstacle", obstacle, scene.obstacles)]
    arm = scene.only_arm(arm)
    robot = scene.arms[arm].robot
    height, stop = positive_number("height", height), true_or_false("stop", stop)
    if grasps is None:
        found = grasps_of(robot, thing, obstacle, 8)
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
    if supports is None:
        before = [name for name, gap in _near(scene, obstacle, arm, thing.pose).items() if gap >= -_SUPPORTS]
        after, places = _supported_places(scene, obstacle, arm, places)
    else:
        before = [known_name("support", n, scene.element_names) for n in items_of("supports", supports, "names")]
        after = before
    fingers = [(f"{arm}/{name}", obstacle) for name in gripper_links(robot) if robot.link(name).collisions]
    above = [_shifted(goal, -height * _pose_of(goal)[:3, 2]) for goal in goals]
    over = [_shifted(goal, np.array([0.0, 0.0, height])) for goal in places]
    return [
        _open(robot, arm, width),
        FreeMotion(above, arm=arm, stop=stop),
        StraightLine(offset=[0.0, 0.0, height], axes="tool", arm=arm),
        MoveGripper(around=obstacle, arm=arm),
        Attach(obstacle, arm=arm),
        StraightLine(offset=[0.0, 0.0, height], arm=arm, allow=[(obstacle, name) for name in before], stop=stop),
        FreeMotion(over, arm=arm, stop=stop),
        StraightLine(offset=[0.0, 0.0, -height], arm=arm, allow=[(obstacle, name) for name in after]),
        Detach(obstacle),
        _open(robot, arm, width, fingers),
        StraightLine(offset=[0.0, 0.0, -height], axes="tool", arm=arm, stop=stop),
    ]


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
            goals.append(PoseGoal(name, pose(at[:3, 3], quaternion=quaternion_from_rotation(R))))
    else:
        goals = list(items_of("place", place, "PoseGoal"))
    if not goals:
        raise InputError("place is an empty list, expected at least one PoseGoal")
    for goal in goals:
        if not isinstance(goal, PoseGoal):
            raise InputError(f"place is {shown(place)}, expected a position (3,), a pose (4, 4), or a list of PoseGoal")
        if goal.frame != name or goal.quaternion is None:
            raise InputError(f"a place is of the frame {goal.frame!r}, expected a pose of {name!r} with a quaternion")
    return goals


def _supported_places(scene: Scene, name: str, arm: str, places: list[PoseGoal]) -> tuple[list[str], list[PoseGoal]]:
    """The supports of an object at some places, and the places that are not inside of one of them.

    Other objects may have moved by then, so that planning decides whether they are in the way.
    """
    near = [_near(scene, name, arm, _pose_of(goal)) for goal in places]
    supports = list(dict.fromkeys(other for gaps in near for other, gap in gaps.items() if gap >= -_SUPPORTS))
    deep = [[other for other in supports if gaps.get(other, 0.0) < -_SUPPORTS] for gaps in near]
    free = [goal for goal, inside in zip(places, deep, strict=True) if not inside]
    if not free:
        raise InputError(f"{name!r} overlaps {deep[0][0]!r} at its place, which supports it at another one")
    return supports, free


def _near(scene: Scene, name: str, arm: str, T: Array) -> dict[str, float]:
    """The obstacles near an object at a pose, with their distances [m], negative if they overlap."""
    held = scene.with_obstacle_at(name, T).attach(name, arm)
    checker = CollisionChecker(held, [arm])
    found: dict[str, float] = {}
    for both, gap in zip(checker.pairs, checker.distances(held.arms[arm].q).tolist(), strict=True):
        other = both[0] if both[1] == name else both[1]
        if name in both and other in scene.obstacles and gap < _SUPPORTS:
            found[other] = min(gap, found.get(other, gap))
    return found


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


def _pose_of(goal: PoseGoal) -> Array:
    return pose(goal.position, quaternion=goal.quaternion)


def _shifted(goal: PoseGoal, by: Array) -> PoseGoal:
    return replace(goal, position=goal.position + by)
