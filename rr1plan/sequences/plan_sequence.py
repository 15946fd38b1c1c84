"""Planning of sequences: search, one trajectory on one clock, and the referee's verdict on every stage."""

from __future__ import annotations

from collections.abc import Sequence as Rows
from dataclasses import replace

import numpy as np

from rr1plan.checks import Array, Seed, check_callback, known_name, of_kind
from rr1plan.errors import InputError
from rr1plan.planners import CartesianPlanner, chosen_planner
from rr1plan.planning import Budget, Planner, PlanStatus, ProgressCallback
from rr1plan.retiming import retiming_names
from rr1plan.scene import Pair, Scene
from rr1plan.scene.unlocked_joints import unlocked_scene
from rr1plan.sequences.grippers import finger_contacts
from rr1plan.sequences.passed_corners import pass_corners
from rr1plan.sequences.segment_options import PlannedSegment
from rr1plan.sequences.segments import Attach, Detach, FreeMotion, MoveGripper, StraightLine
from rr1plan.sequences.sequence import Sequence, label_in
from rr1plan.sequences.sequence_plan import SequencePlan
from rr1plan.sequences.sequence_search import SequenceSearch
from rr1plan.sequences.stage_validation import validate_stages
from rr1plan.sequences.stages import SequenceStage
from rr1plan.trajectory import Trajectory


def plan_sequence(
    sequence: Sequence,
    *,
    planner: str | Planner = "rrt_connect",
    retiming: str = "blend",
    budget: Budget | None = None,
    rng: Seed = None,
    progress: ProgressCallback | None = None,
) -> SequencePlan:
    """Plan all segments of a sequence such that each ends where the next ones can continue.

    If a segment has a choice (several goals, several configurations that reach one) and a later segment fails, the next
    candidate is tried; if no candidate of a free motion is reached, more configurations are, a turn away too. Each
    segment ends at rest unless it has `stop=False`, which requires the retiming "blend". The referee validates each
    segment in its scene; if it rejects a rounded corner between two, all end at rest.

    Args:
        sequence: The sequence.
        planner: Planner of free motions: a name of `planner_names()`, or an instance of `Planner`.
        retiming: A name of `retiming_names()`.
        budget: Budget (default: 10 s); iterations are those of the planner in all attempts together.
        rng: Seed; the same seed and a budget of iterations give the same motion.
        progress: Called about ten times a second and before each attempt; False cancels.

    Returns:
        A `SequencePlan`; `found` says whether there is a motion, `reason` names the failed segment and the cause.

    Raises:
        UnknownNameError: an unknown planner or retiming.
        PlannerError: a user's planner raised an exception, or returned an invalid path.
        InputError: a value other than a sequence, the planner "cartesian", or a scene that cannot be checked.
        RetimingError: a motion cannot be timed under the limits.
    """
    of_kind("sequence", sequence, Sequence)
    of_kind("budget", budget, Budget, optional=True)
    check_callback("progress", progress)
    known_name("retiming", retiming, retiming_names())
    if isinstance(chosen_planner(planner), CartesianPlanner):
        raise InputError("planner 'cartesian' is for straight lines: use StraightLine, and another planner")
    found = SequenceSearch(sequence, planner, retiming, budget or Budget(), rng, progress).run()
    grippers = sequence.moving_grippers
    scene = unlocked_scene(sequence.scene, grippers)
    plan = SequencePlan(scene, found.status, found.reason, found.failed, sequence, gripper_joints=grippers)
    if found.status is not PlanStatus.FOUND:
        return plan
    # Other retimings stop at all corners.
    for steps in dict.fromkeys((pass_corners(found.steps) if retiming == "blend" else found.steps, found.steps)):
        trajectory, stages = _on_one_clock(sequence.scene, scene, steps)
        report = validate_stages(
            trajectory, scene, stages, jerk_limits=retiming.startswith("ruckig"), progress=progress
        )
        if report.valid:
            break
    return replace(plan, stages=stages, _trajectory=trajectory, _report=report)


def _on_one_clock(
    before: Scene, scene: Scene, steps: Rows[PlannedSegment]
) -> tuple[Trajectory, tuple[SequenceStage, ...]]:
    """One trajectory of all moving joints, and its stages.

    Args:
        before: The scene at the beginning.
        scene: The same scene with all moving joints as planning joints.
        steps: The planned segments.
    """
    moving = {arm for step in steps if step.trajectory is not None for arm in step.trajectory.arms}
    names = scene.joint_names([arm for arm in scene.arms if arm in moving]) if moving else ()
    q: Array = scene.configuration([arm for arm in scene.arms if arm in moving]) if moving else np.zeros(0)
    breaks, pieces, stages, clock = [0.0], [], [], 0.0
    for step in steps:
        parts, begin = [], clock
        if step.trajectory is not None and step.trajectory.duration > 0.0:
            own = step.trajectory
            columns = [names.index(name) for name in own.joint_names]
            for start, end, coefficients in zip(own.breaks[:-1], own.breaks[1:], own.coefficients, strict=True):
                piece = np.zeros((len(coefficients), len(names)))
                piece[0] = q
                piece[:, columns] = coefficients
                parts.append((float(end - start), piece))
            q = q.copy()
            q[columns] = own(own.end_time)
        elif step.seconds > 0.0:
            parts.append((step.seconds, q[None]))
        for seconds, piece in parts:
            # Pauses may be too short for the clock to resolve.
            if clock + seconds > clock:
                clock += seconds
                breaks.append(clock)
                pieces.append(piece)
        segment = step.segment
        change = segment if isinstance(segment, Attach | Detach) else None
        stages.append(SequenceStage(label_in(before, segment), begin, clock, _allowed(before, step), change))
    degree = max((len(piece) for piece in pieces), default=1)
    rows = np.zeros((max(1, len(pieces)), degree, len(names)))
    rows[:, 0] = q
    for k, piece in enumerate(pieces):
        rows[k] = 0.0
        rows[k, : len(piece)] = piece
    return Trajectory(names, breaks, rows), tuple(stages)


def _allowed(scene: Scene, step: PlannedSegment) -> frozenset[Pair]:
    """The pairs that may touch during a planned segment."""
    segment = step.segment
    if not isinstance(segment, FreeMotion | StraightLine | MoveGripper):
        return frozenset()
    if not isinstance(segment, MoveGripper) or segment.around is None:
        return segment.allow
    arm = scene.only_arm(segment.arm)
    return segment.allow | finger_contacts(scene.arms[arm].robot, arm, segment.around)
