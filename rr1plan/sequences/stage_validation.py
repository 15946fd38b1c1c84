"""The referee's verdict on a sequence: every stage in its own scene, with the objects held in it.

A motion may continue from one stage to the next without a stop, but not through an instant at which an object is
attached or detached. The search is not used: the scenes follow from the first one, the trajectory and the stages, so
that an object stays where it was put down and moves with the link that holds it. At the end, a released object may
touch hands, but no other links.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rr1plan.checks import Array
from rr1plan.progress import ProgressCallback
from rr1plan.report import Margin, Report, Violation, ViolationKind
from rr1plan.scene import Scene
from rr1plan.sequences.segments import Detach
from rr1plan.sequences.stages import (
    SequenceStage,
    carried_names,
    check_stages,
    is_last_release,
    released_scene,
    scene_of_changes,
    stage_scenes,
)
from rr1plan.trajectory import Trajectory
from rr1plan.validation import validate

# Positions count as equal within this [rad or m].
_EQUAL = 1e-9
# Speeds count as equal within this [rad/s or m/s], as for the referee between pieces.
_STEADY = 1e-6


def validate_stages(
    trajectory: Trajectory,
    scene: Scene,
    stages: Sequence[SequenceStage],
    *,
    torque_limits: bool = False,
    jerk_limits: bool = False,
    progress: ProgressCallback | None = None,
) -> Report:
    """Check every stage of a sequence in its scene, and that each begins where the previous one ended.

    Args:
        trajectory: The whole motion, with the gripper joints that move.
        scene: The scene at the beginning; the gripper joints that move are planning joints.
        stages: The stages.
        torque_limits: Check torques too.
        jerk_limits: Check jerk limits too.
        progress: Called while collisions are checked; False leaves them unchecked.

    Raises:
        UnknownNameError: a joint or an object that the scene does not have.
        InputError: stages of another trajectory, or an arm with only some of its joints.
    """
    check_stages(trajectory, stages)
    first = trajectory(trajectory.start_time)
    expected = scene.configuration(trajectory.arms) if trajectory.arms else first
    violations = _jumps("start", trajectory, scene, trajectory.start_time, expected, first)
    reports: list[Report] = []
    last, scenes = first, stage_scenes(scene, trajectory, stages)
    for k, (stage, own) in enumerate(zip(stages, scenes, strict=True)):
        if stage.end == stage.begin:
            continue
        part = trajectory.cut(stage.begin, stage.end)
        violations += _jumps("continuity", trajectory, scene, stage.begin, last, part(stage.begin))
        last = part(stage.end)
        report = validate(
            part,
            own,
            torque_limits=torque_limits,
            jerk_limits=jerk_limits,
            progress=_in_stage(progress, k, len(stages)),
        )
        named = [
            replace(v, message=f"stage {k + 1} ({stage.label}): {v.message}")
            for v in report.violations
            if v.kind != "rest" or not _goes_through(trajectory, stages, k, v.time)
        ]
        reports.append(replace(report, violations=tuple(named)))
    if all(stage.end == stage.begin for stage in stages):
        reports.append(_at_rest(scene_of_changes(scenes[-1], carried_names(stages)), torque_limits))
    violations += [violation for report in reports for violation in report.violations]
    violations += _overlaps_at_the_end(trajectory.end_time, stages, [scene, *scenes])
    return _merged(reports, violations, trajectory.duration)


def _goes_through(trajectory: Trajectory, stages: Sequence[SequenceStage], k: int, time: float | None) -> bool:
    """Whether a motion continues smoothly between two stages at the end of stage k that is nearer to a time."""
    stage = stages[k]
    if time is None:
        return False
    first, second = (k - 1, k) if time - stage.begin < stage.end - time else (k, k + 1)
    if first < 0 or second == len(stages) or stages[first].end == stages[first].begin:
        return False
    before, after = stages[first], stages[second]
    if after.end == after.begin:
        return False
    speeds = [trajectory.cut(part.begin, part.end)(before.end, 1) for part in (before, after)]
    return bool(np.abs(speeds[0] - speeds[1]).max(initial=0.0) <= _STEADY)


def _overlaps_at_the_end(time: float, stages: Sequence[SequenceStage], scenes: Sequence[Scene]) -> list[Violation]:
    """Overlaps of arms with objects released at the end, after which no stage checks them.

    Args:
        time: The end of the motion [s].
        stages: The stages.
        scenes: The scene before the first stage, and that of each stage.
    """
    violations = []
    for k, (stage, before) in enumerate(zip(stages, scenes, strict=False)):
        following = [later.change for later in stages[k + 1 :] if later.change or later.end > later.begin]
        if not isinstance(stage.change, Detach) or not is_last_release(stage.change, following):
            continue
        # The stage before the release may begin elsewhere.
        before = replace(before, arms=scenes[k + 1].arms)
        own = released_scene(before, stage.change)
        still = Trajectory.rest(own.joint_names(), own.configuration())
        violations += [
            replace(v, time=time, message=f"stage {k + 1} ({stage.label}): {v.message}")
            for v in validate(still, own, clearance=False).violations
            if v.kind == "collision"
        ]
    return violations


def _at_rest(scene: Scene, torque_limits: bool) -> Report:
    """The verdict on a scene in which nothing moves."""
    still = Trajectory.rest(scene.joint_names(), scene.configuration())
    return validate(still, scene, torque_limits=torque_limits)


def _jumps(
    kind: ViolationKind, trajectory: Trajectory, scene: Scene, time: float, expected: Array, found: Array
) -> list[Violation]:
    """Violations for joints that differ from their expected values at a time."""
    where, violations = "starts" if kind == "start" else "goes on", []
    for name, got, want in zip(trajectory.joint_names, found.tolist(), expected.tolist(), strict=True):
        if not abs(got - want) <= _EQUAL:
            arm, joint = name.split("/", 1)
            unit = scene.arms[arm].robot.joint(joint).unit
            message = f"{name} {where} at {got:.9g} {unit}, expected {want:.9g} {unit}"
            violations.append(Violation(kind, (name,), time, got, want, message))
    return violations


def _merged(reports: Sequence[Report], violations: Sequence[Violation], duration: float) -> Report:
    """One report, merged from those of all stages with a duration."""
    margins: dict[str, Margin] = {}
    for report in reports:
        for name, margin in report.margins.items():
            if name.endswith(("_start", "_end")):
                continue
            # The smallest clearance counts, and the largest share of a limit.
            kept = margins.setdefault(name, margin)
            if (margin.value < kept.value) if margin.unit == "m" else (margin.value > kept.value):
                margins[name] = margin
    for name in ("clearance", "self_clearance"):
        if any(name in report.margins and f"{name}_proven" not in report.margins for report in reports):
            margins.pop(f"{name}_proven", None)
    not_checked = {rule: why for report in reports for rule, why in report.not_checked.items()}
    not_checked |= {"goal": "a sequence has no single goal"}
    not_checked.pop("start", None)
    if any(name in margins for name in ("clearance", "self_clearance")):
        not_checked.pop("clearance", None)
    checked = dict.fromkeys(rule for report in reports for rule in report.checked if rule not in not_checked)
    statistics: dict[str, float] = {}
    for report in reports:
        for name, value in report.statistics.items():
            statistics[name] = statistics.get(name, 0.0) + value
    return Report(tuple(violations), margins, (*checked, "start"), not_checked, duration, statistics)


def _in_stage(progress: ProgressCallback | None, k: int, count: int) -> ProgressCallback | None:
    """Progress of one stage as progress of the whole."""
    if progress is None:
        return None
    return lambda part: progress(replace(part, fraction=(k + part.fraction) / count))
