"""`retime` and its methods.

`blend` and `stop` do not limit jerk: acceleration jumps where lines meet parabolas and where the
path acceleration switches. To add a method, write a function from `Work` to pieces that are `within` the limits
and add a row to `_METHODS`.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rr1plan.checks import Array, finite_number, known_name, of_kind, positive_number, true_or_false
from rr1plan.errors import InputError, RetimingError
from rr1plan.model import Kinematics
from rr1plan.path import Path
from rr1plan.planning_constants import BLENDS
from rr1plan.retiming.check_limits import check_limits
from rr1plan.retiming.path_blends import Curve, CurveChecker, blend_sizes, clean, curves
from rr1plan.retiming.path_speed import time_polyline
from rr1plan.retiming.timed_pieces import Pieces, as_trajectory, as_trajectory_within, concatenate
from rr1plan.retiming.torque_limits import InverseDynamics, check_gravity, within_torque
from rr1plan.robot.joint_limits import Limits
from rr1plan.scene import Scene
from rr1plan.trajectory import Trajectory

logger = logging.getLogger(__name__)

# Shortest time of a ramp to the velocity limit [s], and as a share of the motion: higher accelerations make no
# measurable difference, and pieces that the breaks cannot resolve.
_SHORTEST_RAMP = 1e-6


class Work(NamedTuple):
    """Arguments of a method: cleaned waypoints (n >= 2), limits, checker, inverse dynamics for torque limits."""

    points: Array
    limits: Limits
    max_blend: float
    checker: Callable[[], CurveChecker]
    inverse_dynamics: InverseDynamics | None


def retime(
    path: Path,
    scene: Scene,
    *,
    method: str = "blend",
    checker: CurveChecker | None = None,
    torque_limits: bool = False,
    velocity_scale: float = 1.0,
    acceleration_scale: float = 1.0,
    max_blend: float = BLENDS.largest,
) -> Trajectory:
    """Time a path under the limits of its arms, from rest to rest.

    Velocity and acceleration (and jerk, for the `ruckig` methods) satisfy their limits between
    samples too: their exact extrema are computed, and time is stretched if they exceed a limit.
    Straight lines of the path are not checked again; blends and other deviations from them are certified.

    Args:
        path: A path of arms of the scene.
        scene: The scene; gives joint limits and obstacles.
        method: "blend" rounds corners where that is certified, "stop" stops at every waypoint, "ruckig" does so with
            limited jerk, "ruckig_direct" also leaves the straight lines where a faster motion is certified.
        checker: Certifies blends (default: a `CollisionChecker` of the scene with its other arms fixed).
        torque_limits: Whether to satisfy the effort limits too, by inverse dynamics with the masses of held objects.
        velocity_scale: Share of the velocity limits to use, above 0, at most 1.
        acceleration_scale: Share of the acceleration limits to use, above 0, at most 1.
        max_blend: Largest distance from a corner to the beginning of its blend [rad or m, Euclidean], >= 0; the
            deviation from the polyline is at most half of it.

    Returns:
        The trajectory, starting at time zero; of duration zero if nothing moves.

    Raises:
        UnknownNameError: no such method, or a joint's arm is not in the scene.
        InputError: the path's joints are not those of the scene's arms, a checker of other joints or another scene, a
            scale or size out of range.
        RetimingError: a moving joint without a limit, gravity torque above an effort limit, or a
            failure of the solver; the message names the joint or the waypoints.
    """
    of_kind("path", path, Path)
    of_kind("scene", scene, Scene)
    known_name("retiming method", method, _METHODS)
    arms = _arms(path, scene)
    _check_certifier(checker, path, scene)
    velocity, acceleration = (
        _share("velocity_scale", velocity_scale),
        _share("acceleration_scale", acceleration_scale),
    )
    torque_limits = true_or_false("torque_limits", torque_limits)
    max_blend = finite_number("max_blend", max_blend)
    if max_blend < 0.0:
        raise InputError(f"max_blend is {max_blend}, expected a size >= 0")
    limits = scene.limits(arms).scaled(velocity=velocity, acceleration=acceleration)
    points = clean(path.waypoints)
    if len(points) == 1:
        return Trajectory.rest(path.joint_names, points[0])
    check_limits(path.joint_names, points, limits, jerk=method in _JERK_LIMITED)
    limits = _without_steep_ramps(points, limits)
    dynamics = Kinematics(scene, arms).inverse_dynamics if torque_limits else None
    work = Work(points, limits, max_blend, lambda: checker or _certifier(scene, arms), dynamics)
    _, time_pieces = _METHODS[method]
    if dynamics is None:
        return _joined(path.joint_names, time_pieces(work), limits, method)
    with _naming_estimates(scene, arms):
        check_gravity(points, path.joint_names, limits.effort, dynamics)
        parts = [within_torque(part, path.joint_names, limits.effort, dynamics) for part in time_pieces(work)]
    return _joined(path.joint_names, parts, limits, method)


def _without_steep_ramps(points: Array, limits: Limits) -> Limits:
    """The limits with accelerations at which no ramp to the velocity limit is too short for the breaks."""
    fastest = float((np.abs(np.diff(points, axis=0)) / limits.velocity).max(axis=1).sum())
    shortest_ramp = _SHORTEST_RAMP * max(1.0, fastest)
    steepest = np.maximum(limits.velocity / shortest_ramp, np.finfo(float).tiny)
    is_steep = limits.acceleration > steepest
    return replace(limits, acceleration=np.where(is_steep, steepest, limits.acceleration)) if is_steep.any() else limits


def _joined(joint_names: tuple[str, ...], parts: list[Pieces], limits: Limits, method: str) -> Trajectory:
    pieces = concatenate(parts)
    if method in _JERK_LIMITED:
        return as_trajectory_within(joint_names, pieces, limits)
    return as_trajectory(joint_names, pieces)


def retiming_names() -> tuple[str, ...]:
    """Names of all retiming methods: "blend", "stop", "ruckig", "ruckig_direct"; see `retime`."""
    return tuple(_METHODS)


def retiming_table() -> Mapping[str, str]:
    """One-line descriptions of all retiming methods by name."""
    return {name: description for name, (description, _) in _METHODS.items()}


def _arms(path: Path, scene: Scene) -> tuple[str, ...]:
    arms = scene.arm_names(path.arms)
    expected = scene.joint_names(arms)
    if path.joint_names != expected:
        raise InputError(f"the path's joints are {path.joint_names}, expected those of the arms in order: {expected}")
    return arms


@contextmanager
def _naming_estimates(scene: Scene, arms: tuple[str, ...]) -> Iterator[None]:
    """Add the links with estimated masses to errors about torques."""
    try:
        yield
    except RetimingError as error:
        links = [f"{arm}/{link}" for arm in arms for link in scene.arms[arm].robot.links_of_assumed_mass]
        if not links:
            raise
        raise RetimingError(f"{error}; the masses of {', '.join(links)} are estimates") from error


def _check_certifier(checker: CurveChecker | None, path: Path, scene: Scene) -> None:
    if checker is None:
        return
    if not callable(getattr(checker, "polynomial_is_free", None)):
        raise InputError(f"checker is of type {type(checker).__name__}, expected a CollisionChecker")
    from rr1plan.collision.checker import CollisionChecker, check_fits

    if isinstance(checker, CollisionChecker):
        check_fits(checker, path, scene)


def _certifier(scene: Scene, arms: tuple[str, ...]) -> CurveChecker:
    from rr1plan.collision import CollisionChecker

    return CollisionChecker(scene, arms)


def _share(name: str, value: float) -> float:
    if positive_number(name, value) > 1.0:
        raise InputError(f"{name} is {value}, expected at most 1 (set higher limits in the robot)")
    return float(value)


# ---- methods -------------------------------------------------------------------------------


def _blend(work: Work) -> list[Pieces]:
    """Blend corners where certified; stop at corners where blends cannot be timed or are slower."""
    checker = work.checker() if len(work.points) > 2 and work.max_blend > 0.0 else None
    return _time(work, blend_sizes(work.points, work.max_blend, checker))


def _stop(work: Work) -> list[Pieces]:
    return _time(work, np.zeros(len(work.points)))


def _time(work: Work, sizes: Array) -> list[Pieces]:
    if work.inverse_dynamics is None:
        return [time_polyline(work.points, sizes, work.limits)]
    return [part for curve in curves(work.points, sizes) for part in _time_with_torque(work, sizes, curve)]


def _time_with_torque(work: Work, sizes: Array, curve: Curve) -> list[Pieces]:
    """Time a curve; if TOPPRA fails, with a stop at its middle waypoint."""
    from rr1plan.retiming.toppra_retiming import time_curve_with_torque

    assert work.inverse_dynamics is not None
    begin, end = curve.corners
    try:
        return [time_curve_with_torque(curve, work.limits, work.inverse_dynamics).within(work.limits)]
    except RetimingError as error:
        logger.info("one more stop from waypoint %d to %d: %s", begin, end, error)
    points = work.points[begin : end + 1]
    if end - begin == 1:
        # Stretched to the torque limits by `within_torque`.
        return [time_polyline(points, np.zeros(2), work.limits)]
    sizes = sizes.copy()
    sizes[(begin + end) // 2] = 0.0
    parts: list[Pieces] = []
    for half in curves(points, sizes[begin : end + 1]):
        first, last = half.corners
        parts += _time_with_torque(work, sizes, replace(half, corners=(begin + first, begin + last)))
    return parts


def _ruckig(work: Work) -> list[Pieces]:
    from rr1plan.retiming.ruckig_retiming import time_line_smoothly

    lines = curves(work.points, np.zeros(len(work.points)))
    return [time_line_smoothly(line, work.limits).within(work.limits, jerk=True) for line in lines]


def _ruckig_direct(work: Work) -> list[Pieces]:
    from rr1plan.retiming.ruckig_retiming import time_line_smoothly, time_state_to_state

    checker, parts = work.checker(), []
    for i, line in enumerate(curves(work.points, np.zeros(len(work.points)))):
        straight = time_line_smoothly(line, work.limits).within(work.limits, jerk=True)
        place = f"between waypoints {i} and {i + 1}"
        direct = time_state_to_state(work.points[i], work.points[i + 1], work.limits, place)
        direct = direct.within(work.limits, jerk=True)
        faster = direct.duration < straight.duration * (1.0 - 1e-9)
        parts.append(direct if faster and _is_free(direct, checker) else straight)
    return parts


def _is_free(pieces: Pieces, checker: CurveChecker) -> bool:
    return all(
        checker.polynomial_is_free(coefficients, float(duration))
        for duration, coefficients in zip(pieces.durations, pieces.coefficients, strict=True)
    )


_METHODS: dict[str, tuple[str, Callable[[Work], list[Pieces]]]] = {
    "blend": ("straight lines, corners rounded by parabolas within certified clearance, time-optimal", _blend),
    "stop": ("straight lines, stop at every waypoint, time-optimal", _stop),
    "ruckig": ("straight lines, stop at every waypoint, with jerk limits", _ruckig),
    "ruckig_direct": ("as ruckig, but leaves the line where a faster motion is certified free", _ruckig_direct),
}

_JERK_LIMITED = ("ruckig", "ruckig_direct")
