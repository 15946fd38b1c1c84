"""A sequence: a scene, and the actions of arms in it, segment by segment."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, get_args

from rr1plan.checks import Value, counted, items_of, known_name, of_kind, shown
from rr1plan.errors import InputError
from rr1plan.scene import Scene
from rr1plan.scene.problem import PoseGoal, Problem, goal_alternatives
from rr1plan.sequences.grippers import gripper_joints, gripper_values, only_gripper_joint
from rr1plan.sequences.segments import (
    Attach,
    Detach,
    FreeMotion,
    MoveGripper,
    Segment,
    StraightLine,
)
from rr1plan.transforms import inverse, pose

_MOST_SEGMENTS = 1000
_KINDS = get_args(Segment)


@dataclass(frozen=True, eq=False, repr=False)
class Sequence(Value):
    """Actions of arms in a scene, segment by segment; `plan_sequence` plans them.

    Arms, grippers and held objects begin in their states in the scene.

    Args:
        scene: The scene.
        segments: `FreeMotion`, `StraightLine`, `MoveGripper`, `Attach`, `Detach` and `Pause`, in order.

    Raises:
        UnknownNameError: a segment names an arm, link, object or gripper state that does not exist at that point.
        InputError: no segments, or one that does not fit the scene; the message names it.
    """

    scene: Scene
    segments: tuple[Segment, ...]

    if TYPE_CHECKING:  # accepted types; the fields above have the stored types

        def __init__(self, scene: Scene, segments: Iterable[Segment]) -> None: ...

    def __post_init__(self) -> None:
        of_kind("scene", self.scene, Scene)
        segments = items_of("segments", self.segments, "segments")
        if not 0 < len(segments) <= _MOST_SEGMENTS:
            raise InputError(f"a sequence of {counted(len(segments), 'segment')}, expected 1 to {_MOST_SEGMENTS}")
        object.__setattr__(self, "segments", segments)
        check = SegmentCheck(self.scene)
        for k, segment in enumerate(segments):
            if not isinstance(segment, _KINDS):
                raise InputError(
                    f"segment {k + 1} is {shown(segment)}, expected one of {', '.join(c.__name__ for c in _KINDS)}"
                )
            try:
                check(segment)
            except InputError as error:
                error.args = (f"segment {k + 1} ({segment.label}): {error}",)
                raise

    def __repr__(self) -> str:
        return f"Sequence({self.scene.name!r}, {counted(len(self.segments), 'segment')})"

    @property
    def moving_grippers(self) -> Mapping[str, tuple[str, ...]]:
        """The gripper joints of each arm whose gripper is opened or closed by a segment."""
        arms = dict.fromkeys(self.scene.only_arm(s.arm) for s in self.segments if isinstance(s, MoveGripper))
        return {name: gripper_joints(arm.robot) for name, arm in self.scene.arms.items() if name in arms}


class SegmentCheck:
    """Checks segments of a sequence one after the other; held objects follow from the previous segments.

    Args:
        scene: The scene at the beginning.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        # The arm that holds each object.
        self._holders = {name: held.arm for name, held in scene.attachments.items()}

    def __call__(self, segment: Segment) -> None:
        """Check the next segment.

        Raises:
            UnknownNameError: an arm, link, object or gripper state that does not exist at that point.
            InputError: a segment that does not fit the scene.
        """
        scene = self._scene
        if isinstance(segment, FreeMotion | StraightLine | MoveGripper):
            for name in frozenset[str]().union(*segment.allow):
                known_name("element", name, (*scene.element_names, *scene.arms))
        if isinstance(segment, FreeMotion):
            for arm, goals in goals_by_arm(segment, scene).items():
                _check_goals(scene, arm, goals, self._holders)
        elif isinstance(segment, StraightLine):
            arm = scene.only_arm(segment.arm)
            if segment.goal:
                _check_goals(scene, arm, segment.goal, self._holders)
        elif isinstance(segment, MoveGripper):
            _check_gripper(scene, segment)
        elif isinstance(segment, Attach):
            _check_attach(scene, segment, self._holders)
        elif isinstance(segment, Detach):
            self._holders.pop(known_name("held object", segment.name, self._holders))


def label_in(scene: Scene, segment: Segment) -> str:
    """The label of a segment of a sequence, with the unit of the gripper's joint."""
    if not isinstance(segment, MoveGripper) or segment.position is None or isinstance(segment.position, str):
        return segment.label
    robot = scene.arms[scene.only_arm(segment.arm)].robot
    return f"{segment.label} {robot.joint(only_gripper_joint(robot)).unit}"


def _check_gripper(scene: Scene, segment: MoveGripper) -> None:
    """Reject gripper motions that are impossible, or around an object that does not exist."""
    robot = scene.arms[scene.only_arm(segment.arm)].robot
    if segment.around is not None:
        known_name("object", segment.around, (*scene.obstacles, *scene.attachments))
    if segment.position is None:
        only_gripper_joint(robot)
    else:
        robot.with_locked_joints(gripper_values(robot, segment.position))


def _check_attach(scene: Scene, segment: Attach, holders: dict[str, str]) -> None:
    """Reject objects that are already held and unknown links, and record the arm that holds the object from here on."""
    if segment.obstacle in holders:
        raise InputError(f"{holders[segment.obstacle]!r} already holds {segment.obstacle!r}; detach it first")
    loose = [name for name in (*scene.obstacles, *scene.attachments) if name not in holders]
    known_name("obstacle", segment.obstacle, loose)
    arm = scene.only_arm(segment.arm)
    for link in (segment.link, *(segment.touch or ())):
        if link is not None:
            scene.arms[arm].robot.link(link)
    holders[segment.obstacle] = arm


def goals_by_arm(segment: FreeMotion, scene: Scene) -> dict[str, tuple[Any, ...]]:
    """The alternatives of each arm that a free motion moves.

    Raises:
        UnknownNameError: an unknown arm.
        InputError: no goals, or no arm if there are several.
    """
    if isinstance(segment.goal, Mapping):
        if not segment.goal:
            raise InputError("no goals are given, expected one for each arm that moves")
        return {name: goal_alternatives(segment.goal[name]) for name in scene.arm_names(list(segment.goal))}
    return {scene.only_arm(segment.arm): goal_alternatives(segment.goal)}


def _check_goals(scene: Scene, arm: str, goals: tuple[Any, ...], holders: Mapping[str, str]) -> None:
    """Reject goals that are invalid in this scene; goals of held objects cannot be checked yet."""
    plain = []
    for goal in goals:
        if isinstance(goal, PoseGoal) and holders.get(goal.frame) == arm:
            if goal.quaternion is None:
                raise InputError(f"the goal of the held object {goal.frame!r} has no quaternion, expected a full pose")
        else:
            plain.append(goal)
    if plain or not goals:
        Problem(scene, None, {arm: plain}, arms=[arm])


def goals_of_links(scene: Scene, arm: str, goals: Iterable[Any]) -> list[Any]:
    """Goals of an arm as goals of its links; goals of an object become goals of the link that holds it."""
    found = []
    for goal in goals:
        held = scene.attachments.get(goal.frame) if isinstance(goal, PoseGoal) else None
        if held is None or held.arm != arm:
            found.append(goal)
            continue
        T = pose(goal.position, quaternion=goal.quaternion) @ inverse(held.pose)
        tolerances = {name: getattr(goal, name) for name in ("position_tolerance", "orientation_tolerance")}
        found.append(PoseGoal(held.link, T, **tolerances))
    return found
