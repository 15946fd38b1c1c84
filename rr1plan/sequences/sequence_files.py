"""Planned sequences from files; their stages are validated again when they are read."""

from __future__ import annotations

import gzip
import pathlib
import zlib
from collections.abc import Mapping
from dataclasses import replace

from rr1plan.checks import check_callback, file_path, of_kind
from rr1plan.errors import FormatError, InputError
from rr1plan.export.motion_files import fit_trajectory
from rr1plan.export.motion_schema import SequenceStage as StageEntry
from rr1plan.export.plan_files import read_plan_file
from rr1plan.files.file_access import content_suffix
from rr1plan.progress import ProgressCallback
from rr1plan.scene import Scene, pair, scene_differences
from rr1plan.scene.unlocked_joints import unlocked_scene
from rr1plan.sequences.segments import Attach, Detach
from rr1plan.sequences.sequence_plan import SequencePlan
from rr1plan.sequences.stage_validation import validate_stages
from rr1plan.sequences.stages import SequenceStage, check_stages

# The kind of a file is in its first bytes.
_HEAD = 200


def holds_sequence(file: str | pathlib.Path) -> bool:
    """Whether a file declares itself a sequence; `load_sequence` reports its errors."""
    path = file_path(file)
    if content_suffix(path) != ".json" or not path.is_file():
        return False
    try:
        with gzip.open(path) if path.suffix.lower() == ".gz" else path.open("rb") as stream:
            return b'"kind": "sequence"' in stream.read(_HEAD)
    except (OSError, EOFError, zlib.error):  # as `load_sequence` and `load_motion` report
        return False


def load_sequence(
    file: str | pathlib.Path,
    scene: Scene | None = None,
    *,
    torque_limits: bool = False,
    jerk_limits: bool = False,
    progress: ProgressCallback | None = None,
) -> SequencePlan:
    """Read a planned sequence from a file and validate all its stages, in its scene or in another.

    A report in the file is ignored.

    Args:
        file: A file that `SequencePlan.save` wrote.
        scene: The scene at the beginning (default: that in the file), with grippers locked or not; `changes` of the
            result lists the differences from the scene in which the sequence was planned.
        torque_limits: Check torques too.
        jerk_limits: Check jerk limits too.
        progress: Called during the collision proof.

    Raises:
        FormatError: a truncated, modified or unsupported file, one without a sequence, or one that does not fit the
            scene.
    """
    of_kind("scene", scene, Scene, optional=True)
    check_callback("progress", progress)
    saved = read_plan_file(file, scene)
    if saved.sequence is None or saved.trajectory is None or saved.scene is None:
        raise FormatError("holds no sequence; read it with load_motion", file)
    try:
        grippers = {arm: tuple(joints) for arm, joints in saved.sequence.gripper_joints.items()}
        where = saved.scene if scene is None else with_planned_grippers(scene, grippers)
        trajectory = fit_trajectory(saved.trajectory, where)
        stages = tuple(_stage(entry) for entry in saved.sequence.stages)
        check_stages(trajectory, stages)
        report = validate_stages(
            trajectory, where, stages, torque_limits=torque_limits, jerk_limits=jerk_limits, progress=progress
        )
    except InputError as error:
        name = (scene or saved.scene).name
        raise FormatError(f"cannot be a sequence of the scene {name!r}: {error}", file) from error
    changes = () if scene is None else scene_differences(saved.scene, where)
    plan = SequencePlan(where, stages=stages, gripper_joints=grippers, changes=changes)
    return replace(plan, _trajectory=trajectory, _report=report)


def with_planned_grippers(scene: Scene, grippers: Mapping[str, tuple[str, ...]]) -> Scene:
    """The scene with some gripper joints as planning joints, if they are locked in it."""
    locked = {
        arm: tuple(name for name in joints if name in scene.arm(arm).robot.locked_joints)
        for arm, joints in grippers.items()
    }
    return unlocked_scene(scene, locked)


def _stage(entry: StageEntry) -> SequenceStage:
    change: Attach | Detach | None = None
    if entry.attach is not None and entry.detach is not None:
        raise InputError(f"stage {entry.label!r} attaches and detaches, expected one of them")
    if entry.attach is not None:
        held = entry.attach
        change = Attach(held.obstacle, arm=held.arm, link=held.link, touch=held.touch)
    elif entry.detach is not None:
        change = Detach(entry.detach)
    allowed = frozenset(pair(a, b) for a, b in entry.allowed)
    return SequenceStage(entry.label, entry.begin, entry.end, allowed, change)
