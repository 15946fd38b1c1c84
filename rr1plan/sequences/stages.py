"""The stages of a planned sequence: the times of each segment, and its scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from rr1plan.checks import Array, Value, check_text, finite_number
from rr1plan.errors import InputError
from rr1plan.report import Report
from rr1plan.robot import Robot
from rr1plan.scene import Arm, Pair, Scene, pair
from rr1plan.sequences.grippers import gripper_links
from rr1plan.sequences.segments import Attach, Detach
from rr1plan.trajectory import Trajectory


@dataclass(frozen=True, eq=False, repr=False)
class SequenceStage(Value):
    """The times of a segment of a sequence, and its change of the scene.

    Args:
        label: Description in a few words.
        begin: Start [s].
        end: End [s]; equal to `begin` if an object is attached or detached.
        allowed: Pairs of elements that may touch during this stage, in addition to those of the scene.
        change: The object that is attached or detached.

    Raises:
        InputError: an end before the beginning, or a change that takes time.
    """

    label: str
    begin: float
    end: float
    allowed: frozenset[Pair] = frozenset()
    change: Attach | Detach | None = None

    def __post_init__(self) -> None:
        check_text("label", self.label)
        for name in ("begin", "end"):
            object.__setattr__(self, name, finite_number(name, getattr(self, name)))
        if self.end < self.begin:
            raise InputError(f"stage {self.label!r} ends at {self.end:g} s, before it begins at {self.begin:g} s")
        if self.change is not None and self.end > self.begin:
            raise InputError(f"stage {self.label!r} takes {self.end - self.begin:g} s, expected a change at an instant")

    def to_dict(self) -> dict[str, object]:
        """The stage as plain values, for JSON."""
        change, attach = self.change, None
        if isinstance(change, Attach):
            touch = list(change.touch or ())
            attach = {"obstacle": change.obstacle, "arm": change.arm, "link": change.link, "touch": touch}
        return {
            "label": self.label,
            "begin": self.begin,
            "end": self.end,
            "allowed": sorted(sorted(names) for names in self.allowed),
            "attach": attach,
            "detach": change.name if isinstance(change, Detach) else None,
        }


@dataclass(frozen=True, eq=False)
class StagedMotion:
    """A trajectory, its stages, and the verdict on them.

    Args:
        scene: The scene at the beginning; the columns of the trajectory are its joints.
        trajectory: The motion.
        stages: The stages.
        report: The referee's report.
        gripper_joints: The planning joints of the scene that belong to grippers, by arm.
    """

    scene: Scene
    trajectory: Trajectory
    stages: tuple[SequenceStage, ...]
    report: Report
    gripper_joints: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def object_poses(self, name: str, times: Array) -> Array:
        """Poses of an object, held or put down; see `SequencePlan.object_poses`."""
        scenes = stage_scenes(self.scene, self.trajectory, self.stages)
        begins = np.array([stage.begin for stage in self.stages])
        numbers = np.clip(np.searchsorted(begins, times, side="right") - 1, 0, len(scenes) - 1)
        poses = np.empty((len(times), 4, 4))
        columns = {arm: [n.split("/", 1)[0] == arm for n in self.trajectory.joint_names] for arm in self.scene.arms}
        for row, (k, q) in enumerate(zip(numbers.tolist(), self.trajectory(times), strict=True)):
            held = scenes[k].attachments.get(name)
            if held is None:
                poses[row] = scenes[k].obstacles[name].pose
            else:
                arm = scenes[k].arms[held.arm]
                own = q[columns[held.arm]] if any(columns[held.arm]) else arm.q
                poses[row] = arm.base @ arm.robot.link_poses(own)[held.link] @ held.pose
        return poses


def check_stages(trajectory: Trajectory, stages: Sequence[SequenceStage]) -> None:
    """Require that stages follow each other without a gap, from the beginning of the trajectory to its end.

    Raises:
        InputError: no stages, or stages with gaps; or a trajectory that does not begin at zero.
    """
    if trajectory.start_time != 0.0:
        raise InputError(f"the trajectory of a sequence begins at {trajectory.start_time:g} s, expected 0 s")
    if not stages:
        raise InputError("a sequence has at least one stage, got none")
    times = [trajectory.start_time, *(stage.end for stage in stages)]
    for k, (stage, before) in enumerate(zip(stages, times, strict=False)):
        if stage.begin != before:
            raise InputError(f"stage {k + 1} ({stage.label}) begins at {stage.begin:g} s, expected {before:g} s")
    if times[-1] != trajectory.end_time:
        raise InputError(f"the stages end at {times[-1]:g} s, the trajectory at {trajectory.end_time:g} s")


def carried_names(stages: Sequence[SequenceStage]) -> tuple[str, ...]:
    """The objects that are attached or detached, in the order of the first such event."""
    changes = (stage.change for stage in stages)
    return tuple(dict.fromkeys(c.obstacle if isinstance(c, Attach) else c.name for c in changes if c is not None))


def stage_scenes(scene: Scene, trajectory: Trajectory, stages: Sequence[SequenceStage]) -> list[Scene]:
    """The scene of each stage: arms at its beginning, objects held or put down, and its allowed pairs.

    Args:
        scene: The scene at the beginning; the columns of the trajectory are its joints.
        trajectory: The motion.
        stages: The stages.

    Raises:
        UnknownNameError: an object to attach or detach does not exist, or is already held.
        InputError: an object that cannot be held.
    """
    scenes = []
    for stage in stages:
        scene = scene_at(scene, trajectory, stage.begin)
        scene = changed_scene(scene, stage.change)
        scenes.append(replace(scene, allowed=scene.allowed | stage.allowed) if stage.allowed else scene)
    return scenes


def scene_at(scene: Scene, trajectory: Trajectory, time: float) -> Scene:
    """The scene with its arms at their configurations in a trajectory at a time."""
    q: Array = trajectory(time)
    values = dict(zip(trajectory.joint_names, q.tolist(), strict=True))
    moved = {
        name: Arm(arm.robot, arm.base, np.array([values[f"{name}/{joint}"] for joint in arm.robot.joint_names]))
        for name, arm in scene.arms.items()
        if name in trajectory.arms
    }
    return replace(scene, arms={**scene.arms, **moved})


def resolved_change(change: Attach | Detach, scene: Scene) -> Attach | Detach:
    """A change with arm, link and touching links filled in, for a scene with locked grippers."""
    if isinstance(change, Detach):
        return change
    arm = scene.only_arm(change.arm)
    robot = scene.arms[arm].robot
    touch = gripper_links(robot) if change.touch is None else change.touch
    return Attach(change.obstacle, arm=arm, link=change.link or robot.tool, touch=touch)


def changed_scene(scene: Scene, change: Attach | Detach | None) -> Scene:
    """The scene after an object was attached or detached, with the arms at their configurations."""
    if isinstance(change, Attach):
        return scene.attach(change.obstacle, change.arm, change.link, touch=change.touch or ())
    return scene if change is None else scene.detach(change.name)


def scene_of_changes(scene: Scene, names: Sequence[str]) -> Scene:
    """The scene after a sequence that only attaches and detaches objects, with the contacts that it may end with.

    Attached objects may touch what they stand on. `released_scene` decides on contacts of released objects.

    Args:
        scene: The scene after the sequence.
        names: The objects that were attached or detached.
    """
    allowed = set(scene.allowed)
    for name in names:
        others = scene.obstacles if name in scene.attachments else scene.element_names
        allowed |= {pair(name, other) for other in others if other != name}
    return replace(scene, allowed=frozenset(allowed))


def is_last_release(change: Detach, following: Sequence[object]) -> bool:
    """Whether a sequence ends with a release: only changes of other objects follow it."""
    return all(
        isinstance(later, Detach) or (isinstance(later, Attach) and later.obstacle != change.name)
        for later in following
    )


def released_scene(scene: Scene, change: Detach) -> Scene:
    """The scene after a release, reduced to contacts of the object with arms.

    Hands may touch the object: fingers still squeeze what they release. So may the body that held it.

    Args:
        scene: The scene before the release, with the arms at their configurations.
        change: The release.
    """
    held, after = scene.attachments[change.name], scene.detach(change.name)
    hands = {
        f"{name}/{link}"
        for name, arm in scene.arms.items()
        for link in (*gripper_links(arm.robot), *_rigid_with(arm.robot, arm.robot.tool))
    }
    hands |= {f"{held.arm}/{link}" for link in _rigid_with(scene.arms[held.arm].robot, held.link)}
    links = [name for name in after.element_names if name not in (*after.obstacles, *after.attachments)]
    allowed = {pair(name, change.name) for name in links if name in hands or after.may_touch(name, change.name)}
    allowed |= {pair(*both) for both in combinations(scene.arms, 2)}
    for arm in scene.arms:
        allowed |= {pair(*both) for both in combinations([name for name in links if name.startswith(f"{arm}/")], 2)}
    names = {*links, *scene.arms, change.name}
    return replace(
        after,
        obstacles={change.name: after.obstacles[change.name]},
        attachments={},
        allowed=frozenset(allowed),
        pair_padding={both: gap for both, gap in after.pair_padding.items() if both <= names},
    )


def _rigid_with(robot: Robot, link: str) -> tuple[str, ...]:
    """The links fixed to a link, and the link itself."""
    bodies = ([part.name for part in body] for body in robot.bodies)
    return next(tuple(names) for names in bodies if link in names)
