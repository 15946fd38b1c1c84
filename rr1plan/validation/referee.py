"""The referee: every requirement on a motion, checked again from the scene alone.

No code of planners, retiming or the collision checker is used here, so a mistake in them cannot hide itself.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable

import numpy as np

from rr1plan.checks import Array, check_callback, millimeters, of_kind, positive_number, true_or_false
from rr1plan.errors import InputError
from rr1plan.path import Path
from rr1plan.planning import Progress, ProgressCallback
from rr1plan.report import NO_PAIR, NO_SHAPE, Margin, Report, Violation
from rr1plan.scene import Scene
from rr1plan.scene.held_contacts import contact_advice
from rr1plan.scene.problem import Problem
from rr1plan.trajectory import Trajectory
from rr1plan.validation.bernstein_extremes import extremes
from rr1plan.validation.collision_proof import CollisionProof, PairFinding, prove
from rr1plan.validation.compiled_search import TOUCH, ProofOptions
from rr1plan.validation.goal_checks import check_endpoints
from rr1plan.validation.limit_checks import Findings, Judgment
from rr1plan.validation.link_motion import TimedColumns
from rr1plan.validation.moving_scene import MovingScene, moving_scene
from rr1plan.validation.referee_kernels import load_library
from rr1plan.validation.torque_checks import check_torques

MOST_SEARCHES = 400_000
# The smallest clearance is found to this distance [m], or to this fraction of it.
_TOLERANCE, _SHARE = 2e-4, 0.05
# Larger positions [rad or m] are no motion of an arm, and lose precision.
FARTHEST = 1e6
# A speed above 100 times its limit, or 100 times 10 rad/s (or m/s) without a limit, is no motion of an arm.
_ABSURD, _FAST = 100.0, 10.0


def validate(
    trajectory: Trajectory,
    scene: Scene,
    problem: Problem | None = None,
    *,
    torque_limits: bool = False,
    jerk_limits: bool = False,
    clearance: bool = True,
    clearance_tolerance: float | None = None,
    progress: ProgressCallback | None = None,
) -> Report:
    """Check a trajectory against a scene: collisions in continuous time, limits between samples.

    Arms that are not in the trajectory keep their configuration of the scene; an arm whose part of the motion ends
    early stays where it ended.

    Args:
        trajectory: The motion, with all joints of each of its arms.
        scene: The scene.
        problem: Check start and goals of this problem too; an arm that the problem does not move has to start in the
            configuration of the scene.
        torque_limits: Check torques (sampled every millisecond) too.
        jerk_limits: Check jerk limits too; a jump of acceleration is then an infinite jerk.
        clearance: Find the smallest clearances too; without them the verdict is the same and takes about half the time.
        clearance_tolerance: The smallest clearance is found to this distance [m], by default to 0.2 mm or 5 % of it;
            the largest depth to this distance or 5 % of it.
        progress: Called during the collision proof; if it returns False, collisions are reported as not checked.

    Returns:
        The report; `report.valid` and `report.certified` are the verdict, `print(report)` explains it.

    Raises:
        UnknownNameError: a joint that the scene does not have.
        InputError: an arm with only some of its joints, a problem with other joints, or a scene whose shapes cannot be
            compared.
    """
    of_kind("trajectory", trajectory, Trajectory)
    of_kind("scene", scene, Scene)
    of_kind("problem", problem, Problem, optional=True)
    tolerance, share = _clearance_options(clearance_tolerance)
    check_callback("progress", progress)
    torque_limits, jerk_limits = (
        true_or_false("torque_limits", torque_limits),
        true_or_false("jerk_limits", jerk_limits),
    )
    clearance = true_or_false("clearance", clearance)
    _check_columns(trajectory, scene)
    findings = Findings()
    if not _check_values(findings, trajectory):
        return _no_motion(findings)
    moving, motion = moving_scene(scene, trajectory.joint_names), _motion_of(trajectory)
    columns, found = moving.columns, extremes(motion.breaks, motion.coefficients)
    judgment = Judgment(columns, found, motion.breaks, motion.coefficients)
    # Few searches for a motion that is far too fast, which is rejected whatever it collides with.
    most_searches = MOST_SEARCHES // 50 if judgment.is_absurd(_ABSURD, _FAST) else MOST_SEARCHES
    options = ProofOptions(tolerance, most_searches, clearance, share)
    _check_collisions(findings, moving, motion, options, progress)
    _name_unchecked_links(findings, scene)
    judgment.check_positions(findings)
    judgment.check_continuity(findings)
    judgment.check_rest(findings)
    judgment.check_rates(findings, jerk_limits)
    if torque_limits:
        check_torques(findings, trajectory, scene)
    else:
        findings.not_checked["torque"] = "not asked for (option torque_limits)"
    check_endpoints(findings, motion, found.end[0], moving, problem)
    return _report(findings, trajectory.duration)


def certify_path(
    path: Path,
    scene: Scene,
    *,
    clearance: bool = True,
    clearance_tolerance: float | None = None,
    progress: ProgressCallback | None = None,
) -> Report:
    """Check the straight lines of a path: collisions in between, position limits.

    A path has no times: those in the report are at a speed of 1 rad/s (or m/s) of the fastest joint.

    Args:
        path: The path, with all joints of each of its arms.
        scene: The scene.
        clearance: Find the smallest clearances too.
        clearance_tolerance: The smallest clearance is found to this distance [m], by default to 0.2 mm or 5 % of it.
        progress: Called during the collision proof; if it returns False, collisions are reported as not checked.

    Raises:
        UnknownNameError: a joint that the scene does not have.
        InputError: an arm with only some of its joints, or a scene whose shapes cannot be compared.
    """
    of_kind("path", path, Path)
    of_kind("scene", scene, Scene)
    clearance = true_or_false("clearance", clearance)
    tolerance, share = _clearance_options(clearance_tolerance)
    check_callback("progress", progress)
    trajectory = _unit_speed(path)
    _check_columns(trajectory, scene)
    findings = Findings()
    if not _check_values(findings, trajectory):
        return _no_motion(findings)
    moving, motion = moving_scene(scene, trajectory.joint_names), _motion_of(trajectory)
    options = ProofOptions(tolerance, MOST_SEARCHES, clearance, share)
    _check_collisions(findings, moving, motion, options, progress)
    _name_unchecked_links(findings, scene)
    found = extremes(motion.breaks, motion.coefficients)
    Judgment(moving.columns, found, motion.breaks, motion.coefficients).check_positions(findings)
    for rule in ("velocity", "acceleration", "jerk", "torque", "rest", "start", "goal"):
        findings.not_checked[rule] = "a path has no times, those given are at 1 rad/s"
    return _report(findings, trajectory.duration)


def _clearance_options(tolerance: float | None) -> tuple[float, float]:
    """Distance [m] and fraction to which the smallest clearance is found."""
    if tolerance is None:
        return _TOLERANCE, _SHARE
    return positive_number("clearance_tolerance", tolerance), 0.0


def _unit_speed(path: Path) -> Trajectory:
    """The path with its fastest joint at 1 rad/s; repeated waypoints take no time."""
    steps = np.diff(path.waypoints, axis=0)
    lengths = np.abs(steps).max(axis=1, initial=0.0)
    moves = lengths > 0.0
    if not moves.any():
        return Trajectory.rest(path.joint_names, path.waypoints[0])
    breaks = np.concatenate([[0.0], np.cumsum(lengths[moves])])
    widths = np.diff(breaks)
    if not (widths > 0.0).all():
        raise InputError("the path has steps that are too short beside its length to be told apart")
    coefficients = np.stack([path.waypoints[:-1][moves], steps[moves] / widths[:, None]], axis=1)
    return Trajectory(path.joint_names, breaks, coefficients)


def _motion_of(trajectory: Trajectory) -> TimedColumns:
    return TimedColumns(trajectory.joint_names, trajectory.breaks, trajectory.coefficients)


def _check_columns(trajectory: Trajectory, scene: Scene) -> None:
    """Check that the columns are joints of the scene's arms, all joints of each arm."""
    arms = trajectory.arms
    for arm in arms:
        scene.arm(arm)
    wanted = tuple(f"{arm}/{joint}" for arm in arms for joint in scene.arms[arm].robot.joint_names)
    if trajectory.joint_names == wanted:
        return
    wanted = scene.joint_names(arms) if arms else ()
    given, known = set(trajectory.joint_names), set(wanted)
    missing = [name for name in wanted if name not in given]
    extra = [name for name in trajectory.joint_names if name not in known]
    if extra or len(given) != len(trajectory.joint_names):
        raise InputError(f"the trajectory has columns {', '.join(extra or trajectory.joint_names)}, "
                         f"expected each once of {', '.join(wanted)}")  # fmt: skip
    if missing:
        raise InputError(f"the trajectory has no column for {', '.join(missing)}; it must hold all joints of an arm")


def _check_values(findings: Findings, trajectory: Trajectory) -> bool:
    """Check that the numbers make a motion: values that were unpickled or forged have not passed a constructor."""
    findings.checked += ["clock", "finite"]
    breaks, coefficients = trajectory.breaks, trajectory.coefficients
    shape = (max(1, np.size(breaks) - 1), len(trajectory.joint_names))
    if np.ndim(breaks) != 1 or np.ndim(coefficients) != 3 or coefficients.shape[::2] != shape or not np.size(breaks):
        message = f"breaks of shape {np.shape(breaks)} do not fit coefficients of shape {np.shape(coefficients)}"
        findings.violations.append(Violation("clock", (), None, float(np.size(breaks)), float(shape[0] + 1), message))
        return False
    if _makes_motion(np.ascontiguousarray(breaks), np.ascontiguousarray(coefficients)):
        return True
    bad = np.flatnonzero(~np.isfinite(coefficients).all(axis=(0, 1))).tolist()
    for name in (trajectory.joint_names[j] for j in bad):
        message = f"{name} has a coefficient that is not a finite number"
        findings.violations.append(Violation("finite", (name,), None, 0.0, 0.0, message))
    if not np.isfinite(breaks).all():
        findings.violations.append(Violation("finite", (), None, 0.0, 0.0, "the clock has a time that is not finite"))
        return False
    steps = np.diff(breaks)
    if (steps <= 0.0).any():
        i = int(np.argmin(steps))
        message = (
            f"the clock goes from {breaks[i]:.9g} s to {breaks[i + 1]:.9g} s, expected times that strictly increase"
        )
        findings.violations.append(Violation("clock", (), float(breaks[i]), float(steps[i]), 0.0, message))
        return False
    return not bad and _check_reach(findings, trajectory)


def _makes_motion(breaks: Array, coefficients: Array) -> bool:
    """Whether the numbers make a motion; a fast test that does not say why not."""
    if breaks.dtype != np.float64 or coefficients.dtype != np.float64:
        return False
    native = load_library()
    return bool(native.rr1_makes_motion(breaks, len(breaks), coefficients, *coefficients.shape, FARTHEST))


def _no_motion(findings: Findings) -> Report:
    for rule in ("collision", "limits", "start", "goal"):
        findings.not_checked[rule] = "the numbers make no motion"
    return _report(findings, 0.0)


def _check_reach(findings: Findings, trajectory: Trajectory) -> bool:
    """Check that no position is too large to compute with."""
    widths = np.diff(trajectory.breaks) if len(trajectory.breaks) > 1 else np.zeros(1)
    power, reach = np.ones(len(widths)), np.zeros(trajectory.coefficients.shape[::2])
    with np.errstate(over="ignore", invalid="ignore"):
        # One power at a time: the coefficients of many arms may fill most of the memory.
        for terms in trajectory.coefficients.swapaxes(0, 1):
            reach += np.abs(terms) * power[:, None]
            power = power * widths
        reach = reach.max(axis=0)
    for name, value in zip(trajectory.joint_names, reach.tolist(), strict=True):
        if not value <= FARTHEST:
            message = f"{name} has terms that add up to more than {FARTHEST:.0e}, which is no motion of an arm"
            findings.violations.append(Violation("finite", (name,), None, min(value, 1e308), FARTHEST, message))
    return bool((reach <= FARTHEST).all())


def _check_collisions(
    findings: Findings,
    scene: MovingScene,
    motion: TimedColumns,
    options: ProofOptions,
    progress: ProgressCallback | None,
) -> None:
    began = clock.perf_counter()
    found = prove(scene, motion, options, _fraction_callback(progress))
    if found.cancelled:
        findings.not_checked["collision"] = "cancelled before all of the motion was decided"
    else:
        findings.checked.append("collision")
    findings.violations += [_contact(scene.tables.scene, contact) for contact in found.contacts]
    if options.clearance:
        _clearance_margins(findings, found)
    else:
        findings.not_checked["clearance"] = "not asked for (option clearance)"
    findings.statistics |= found.statistics | {"collision_seconds": clock.perf_counter() - began}


def _name_unchecked_links(findings: Findings, scene: Scene) -> None:
    for name, arm in scene.arms.items():
        for link in arm.robot.unchecked_links:
            findings.not_checked[f"{name}/{link}"] = NO_SHAPE


def _contact(scene: Scene, contact: PairFinding) -> Violation:
    """The violation for a contact, or for a pair that could not be distinguished from one."""
    value, time, first, (a, b) = contact.clearance, contact.time, contact.first, contact.pair
    padding = scene.padding_of(a, b)
    kept = f", of which {millimeters(padding)} is padding" if padding > 0.0 else ""
    advice = contact_advice(scene, a, b, value + padding)
    advice = f"; {advice}" if advice else ""
    if value <= 0.0:
        since = "" if time - first < 1e-5 else f"; first contact at {first:.5f} s"
        touch = padding == 0.0 and value > -TOUCH
        depth = "touch" if touch else f"overlap by {max(0.0, -1000.0 * value):.3f} mm"
        message = f"{a} and {b} {depth} at {time:.5f} s{kept}{since}{advice}"
        return Violation("collision", contact.pair, time, value, 0.0, message)
    if np.isfinite(first):
        nearest = f"come within {1e6 * value:.3g} µm at {time:.5f} s, too near to tell from contact"
        message = f"{a} and {b} {nearest}{kept}{advice}"
    else:
        message = f"{a} and {b} could not be decided; the smallest clearance seen is {value:.3g} m"
    return Violation("undecided", contact.pair, time, value if np.isfinite(value) else 0.0, TOUCH, message)


def _clearance_margins(findings: Findings, found: CollisionProof) -> None:
    """Margins of the clearance to obstacles and other arms, and of the clearance between one arm's own links."""
    hits = {contact.own for contact in found.contacts}
    for name, own in (("clearance", False), ("self_clearance", True)):
        nearest = found.nearest[own]
        if nearest is None:
            continue
        # Once there is a contact to report, the search is for contacts only, so other clearances miss their tolerance.
        if not hits or own in hits:
            findings.margins[name] = Margin(nearest.clearance, "m", nearest.pair, nearest.time)
        for when, end in () if own else zip(("start", "end"), found.ends, strict=True):
            if end is not None:
                findings.margins[f"{name}_{when}"] = Margin(end.clearance, "m", end.pair, end.time)
        if not hits and not found.cancelled:
            findings.margins[f"{name}_proven"] = Margin(found.proven[own], "m")
    if not found.contacts and found.nearest == [None, None]:
        findings.not_checked["clearance"] = NO_PAIR


def _fraction_callback(progress: ProgressCallback | None) -> Callable[[float], bool | None] | None:
    if progress is None:
        return None
    began = clock.perf_counter()
    return lambda fraction: progress(Progress("certify", clock.perf_counter() - began, fraction))


def _report(findings: Findings, duration: float) -> Report:
    return Report(
        tuple(findings.violations),
        findings.margins,
        tuple(dict.fromkeys(findings.checked)),
        findings.not_checked,
        duration,
        findings.statistics,
    )
