"""Assertions about motions for a user's tests: valid by the referee, and followed by simulated arms.

    def test_pick():
        motion = rp.load_motion("pick.json")
        rp.assert_valid(motion)
        rp.assert_replays(motion, variations=rp.ReplayVariations(payload=0.5))

Both take sequences, too, and raise `AssertionError` with the rule, the joint or elements, and the time.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import overload

import numpy as np

from rr1plan.checks import counted, millimeters, of_kind, positive_number
from rr1plan.errors import BackendError, InputError, NoPlanError
from rr1plan.motion_plan import MotionPlan
from rr1plan.playback.simulation.arm_variation import ArmVariation
from rr1plan.playback.simulation.replay import Replay, largest_errors
from rr1plan.playback.simulation.replay_trajectory import simulate
from rr1plan.report import Report
from rr1plan.scene import Scene
from rr1plan.scene.problem import Problem
from rr1plan.sequences.sequence_files import with_planned_grippers
from rr1plan.sequences.sequence_plan import SequencePlan
from rr1plan.sequences.sequence_replay import NEAR, SequenceReplay
from rr1plan.sequences.simulate_sequence import simulate_sequence
from rr1plan.sequences.stage_validation import validate_stages
from rr1plan.testing.replay_variations import ReplayVariations, VariedReplays
from rr1plan.trajectory import Trajectory
from rr1plan.validation import certify_path, validate

# Settling time of the arms after the end of a motion [s].
_SETTLE = 0.3
# Violations listed in a message before the number of further ones.
_MOST_NAMED = 3


def assert_valid(
    motion: MotionPlan | SequencePlan | Trajectory,
    scene: Scene | None = None,
    *,
    problem: Problem | None = None,
    torque_limits: bool = False,
    jerk_limits: bool = False,
) -> Report:
    """Assert that the referee certifies a motion; a report that the motion carries is ignored.

    Args:
        motion: The motion; for a motion without times the path, for a sequence all stages.
        scene: The scene (default: that of the `MotionPlan`, or that at the beginning of the `SequencePlan`).
        problem: The problem with the required start and goal (default: that of the `MotionPlan`, unless another scene
            is given).
        torque_limits: Check torques too.
        jerk_limits: Check jerk limits too.

    Returns:
        The report.

    Raises:
        AssertionError: the motion violates a rule; names rule, joint or elements, and time.
        InputError: a trajectory without a scene, or with joints that the scene does not have.
    """
    __tracebackhide__ = True  # pytest shows the line of the test instead
    of_kind("problem", problem, Problem, optional=True)
    where, trajectory = _motion_in(motion, scene)
    if isinstance(motion, MotionPlan) and problem is None and scene is None:
        problem = motion.problem
    if isinstance(motion, SequencePlan):
        if problem is not None:
            raise InputError("a sequence has no single start and goal; leave out option problem")
        where = with_planned_grippers(where, motion.gripper_joints)
        report = validate_stages(
            motion.trajectory, where, motion.stages, torque_limits=torque_limits, jerk_limits=jerk_limits
        )
    elif trajectory is not None:
        report = validate(trajectory, where, problem, torque_limits=torque_limits, jerk_limits=jerk_limits)
    else:
        assert isinstance(motion, MotionPlan), "a trajectory has times"
        report = certify_path(motion.path, where)
    if not report.certified:
        found = [f"{v.kind}: {v.message}" for v in report.violations[:_MOST_NAMED]]
        more = len(report.violations) - len(found)
        found += [f"and {counted(more, 'violation')} more"] * (more > 0)
        found += ["collisions were not checked"] * ("collision" not in report.checked)
        raise AssertionError(f"the motion is not valid: {'; '.join(found)}\n{report}")
    return report


@overload
def assert_replays(motion: SequencePlan, *, tolerance: float = 0.01, dt: float = 0.002) -> SequenceReplay: ...


@overload
def assert_replays(
    motion: MotionPlan | Trajectory,
    scene: Scene | None = None,
    *,
    tolerance: float = 0.01,
    goal_tolerance: float = 0.005,
    variations: ReplayVariations | None = None,
    dt: float = 0.002,
) -> VariedReplays: ...


def assert_replays(
    motion: MotionPlan | SequencePlan | Trajectory,
    scene: Scene | None = None,
    *,
    tolerance: float = 0.01,
    goal_tolerance: float = 0.005,
    variations: ReplayVariations | None = None,
    dt: float = 0.002,
) -> VariedReplays | SequenceReplay:
    """Assert that simulated arms follow a motion: without contact, within a tolerance, and to its end.

    Args:
        motion: The motion; in that of a sequence, objects are held by friction only and have to stay within 1 cm of
            their planned positions.
        scene: The scene (default: that of the `MotionPlan`); not for a sequence, see `load_sequence`.
        tolerance: Largest tracking error of any joint during the motion [rad or m].
        goal_tolerance: Largest distance of any joint from the end of the motion, 0.3 s after it [rad or m]; not for a
            sequence.
        variations: Also replay with arms that differ from their description: payload, masses and friction that the
            servos do not model; not for a sequence.
        dt: Time of a step of the simulation [s].

    Returns:
        The replays, first that of the arms as described, then those of varied arms; for a sequence its replay.

    Raises:
        AssertionError: a replay failed; names the worst one, its payload, masses and friction, and the joint or the
            elements and the time.
        InputError: a trajectory without a scene, a motion without times, numbers that are not above zero.
        BackendError: MuJoCo does not accept the scene, or its simulation became unstable.
    """
    __tracebackhide__ = True
    tolerance = positive_number("tolerance", tolerance)
    goal_tolerance = positive_number("goal_tolerance", goal_tolerance)
    of_kind("variations", variations, ReplayVariations, optional=True)
    where, trajectory = _motion_in(motion, scene)
    if isinstance(motion, SequencePlan):
        if scene is not None or variations is not None:
            left_out = "scene" if variations is None else "variations"
            raise InputError(
                f"got {left_out}, expected none: a sequence is replayed in its own scene with arms as described"
            )
        return _replayed_sequence(motion, tolerance, dt)
    if trajectory is None:
        raise InputError("the motion has no times, and cannot be replayed; time its path with rr1plan.retime")
    cases: list[ArmVariation | None] = [None, *(() if variations is None else variations.cases())]
    replays = []
    for number, case in enumerate(cases):
        try:
            replays.append(simulate(trajectory, where, dt=dt, hold=_SETTLE, variation=case))
        except BackendError as error:
            raise BackendError(f"{_arms(number, cases)}: {error}") from error
    found = VariedReplays(tuple(replays), tuple(cases), tolerance, goal_tolerance)
    if not found:
        raise AssertionError(f"the replay failed: {_failure(found)}\n{found}")
    return found


def _replayed_sequence(plan: SequencePlan, tolerance: float, dt: float) -> SequenceReplay:
    """The replay of a sequence, provided that arms and objects follow it."""
    __tracebackhide__ = True
    replay = simulate_sequence(plan, dt=dt, hold=_SETTLE)
    wrong = [f"{' and '.join(contact.pair)} touch at {contact.first:.3f} s" for contact in replay.contacts]
    for one in replay.objects.values():
        if one.max_offset > NEAR:
            lost = replay.replay.record.times[int(np.argmax(one.offsets > NEAR))]
            wrong.append(f"{one.name} is {millimeters(one.max_offset)} from its plan, lost at {lost:.2f} s")
    if replay.max_error > tolerance:
        wrong.append(_late(replay.replay, replay.arm_joints, tolerance))
    if wrong:
        raise AssertionError(f"the replay failed: {'; '.join(wrong)}\n{replay}")
    return replay


def _motion_in(motion: MotionPlan | SequencePlan | Trajectory, scene: Scene | None) -> tuple[Scene, Trajectory | None]:
    """The scene of a motion, and its trajectory; None for a path without times.

    Raises:
        AssertionError: there is no motion, because planning failed.
        InputError: neither a motion nor a trajectory, or no scene.
    """
    __tracebackhide__ = True
    of_kind("scene", scene, Scene, optional=True)
    if isinstance(motion, Trajectory):
        if scene is None:
            raise InputError("a trajectory does not hold its scene; give the scene too (option scene)")
        return scene, motion
    if not isinstance(motion, MotionPlan | SequencePlan):
        raise InputError(
            f"motion is of type {type(motion).__name__}, expected a MotionPlan, SequencePlan or Trajectory"
        )
    if not motion.found:
        raise AssertionError(f"there is no motion: {motion}")
    where = motion.scene if scene is None else scene
    try:
        return where, motion.trajectory
    except NoPlanError:
        return where, None


def _failure(found: VariedReplays) -> str:
    """The worst replay in a sentence."""
    number = found.worst_case
    replay = found.replays[number]
    failed = sum(not ok for ok in found.passed)
    several = f"; {failed} of {len(found.replays)} replays failed" if len(found.replays) > 1 else ""
    return f"{_what(found, replay)}, {_arms(number, found.cases)}{several}"


def _arms(number: int, cases: Sequence[ArmVariation | None]) -> str:
    """The arms of a replay."""
    case = cases[number]
    return "arms as described" if case is None else f"varied arms {number} of {len(cases) - 1} ({case})"


def _what(found: VariedReplays, replay: Replay) -> str:
    if replay.contacts:
        contact = replay.contacts[0]
        names, depth = " and ".join(contact.pair), 1e3 * contact.depth
        return f"{names} touch from {contact.first:.3f} s to {contact.last:.3f} s, {depth:.2f} mm deep"
    if replay.worst_error > found.tolerance:
        return _late(replay, replay.joint_names, found.tolerance)
    rest = np.abs(replay.record.actual[-1] - replay.record.desired[-1])
    joint = int(np.argmax(rest))
    off = f"{replay.joint_names[joint]} ends {rest[joint]:.3g} {replay.units[joint]} from the end of the motion"
    return f"{off}, tolerance {found.goal_tolerance:g}"


def _late(replay: Replay, joint_names: Sequence[str], tolerance: float) -> str:
    """The joint that was farthest from its set-point, in a sentence."""
    errors = largest_errors(replay, joint_names)
    unit = max(errors, key=lambda unit: errors[unit][1])
    name, error = errors[unit]
    late = np.abs(replay.record.actual - replay.record.desired)[:, replay.joint_names.index(name)]
    time = float(replay.record.times[int(np.argmax(late))])
    return f"{name} is {error:.3g} {unit} from its set-point at {time:.3f} s, tolerance {tolerance:g}"
