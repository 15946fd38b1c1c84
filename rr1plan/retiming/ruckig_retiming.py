"""Jerk-limited motion from rest to rest, by Ruckig: seven phases of constant jerk, exact cubic pieces.

Ruckig connects states and does not follow paths, so the motion stops at every waypoint. On a straight line it
solves for one coordinate, the distance along the line, and every joint stays on the line exactly.
Problems are scaled to distances of one and durations near one, because Ruckig's tolerances are absolute
(1e-8) and its limits end at 1e9. Its intermediate waypoints are never used: they need a web service.
Berscheid, Kröger, "Jerk-limited Real-time Trajectory Generation with Arbitrary Target States",
RSS 2021.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import ruckig
from numpy.typing import ArrayLike

from rr1plan.checks import Array, finite_array, of_kind
from rr1plan.errors import InputError, RetimingError
from rr1plan.path import check_joint_names
from rr1plan.retiming.check_limits import check_limits
from rr1plan.retiming.path_blends import Curve
from rr1plan.retiming.path_speed import line_rates
from rr1plan.retiming.timed_pieces import SHORTEST, Pieces, as_trajectory_within
from rr1plan.robot.joint_limits import Limits
from rr1plan.trajectory import Trajectory

# Caps of scaled limits: higher limits make no measurable difference and exceed Ruckig's range.
_CAPS = np.array([1e1, 1e4, 1e8])


def time_line_smoothly(curve: Curve, limits: Limits) -> Pieces:
    """A straight line from rest to rest under velocity, acceleration and jerk limits, exactly on the line.

    Raises:
        RetimingError: Ruckig fails.
    """
    length = float(curve.lengths[0])
    start, direction = curve.coefficients[0, 0], curve.coefficients[0, 1]
    rates = np.array(line_rates(direction, limits))[:, None]
    durations, distance = _solve(
        np.array([length]), rates, f"between waypoints {curve.corners[0]} and {curve.corners[1]}"
    )
    coefficients = distance * direction
    coefficients[:, 0] += start
    return Pieces(durations, coefficients)


def time_state_to_state(start: Array, end: Array, limits: Limits, place: str = "") -> Pieces:
    """Move all joints from rest to rest in the same time, each within its limits; not on a straight line.

    Raises:
        RetimingError: Ruckig fails.
    """
    moving = start != end
    delta = (end - start)[moving]
    rates = np.array([limits.velocity[moving], limits.acceleration[moving], limits.jerk[moving]])
    durations, displacement = _solve(delta, rates, place)
    coefficients = np.zeros((len(durations), 4, len(start)))
    coefficients[:, :, moving] = displacement
    coefficients[:, 0] += start
    return Pieces(durations, coefficients)


def point_to_point(joint_names: Sequence[str], start: ArrayLike, end: ArrayLike, limits: Limits) -> Trajectory:
    """The fastest jerk-limited motion between two configurations, all joints arriving together.

    The motion leaves the straight line (each joint moves monotonically, so it stays in the bounding box
    of both) and is not checked for collision. Certify each polynomial of the result with
    `CollisionChecker.polynomial_is_free`, or use `retime(..., method="ruckig_direct")`.

        robot, checker = scene.arms["arm"].robot, CollisionChecker(scene)
        motion = point_to_point(scene.joint_names(), robot.home, [0.5, 0.4, -0.9], robot.limits)
        pieces = zip(motion.coefficients, np.diff(motion.breaks))
        free = all(checker.polynomial_is_free(piece, duration) for piece, duration in pieces)

    Args:
        joint_names: Name of each joint, length nq.
        start: Configuration [rad or m], shape (nq,).
        end: Configuration [rad or m], shape (nq,).
        limits: Velocity, acceleration and jerk limits of the same joints.

    Raises:
        InputError: inconsistent shapes, NaN.
        RetimingError: a moving joint has an infinite limit, or Ruckig fails.
    """
    names = check_joint_names(joint_names)
    of_kind("limits", limits, Limits)
    q0, q1 = (finite_array(name, q, (len(names),)) for name, q in (("start", start), ("end", end)))
    if len(limits) != len(names):
        raise InputError(f"limits are of {len(limits)} joints, expected {len(names)}")
    check_limits(names, np.array([q0, q1]), limits, jerk=True)
    if (q0 == q1).all():
        return Trajectory.rest(names, q0)
    return as_trajectory_within(names, time_state_to_state(q0, q1, limits).within(limits, jerk=True), limits)


def _solve(delta: Array, rates: Array, place: str) -> tuple[Array, Array]:
    """Cubic pieces of n synchronized motions by delta (n,) from rest to rest.

    Args:
        delta: Displacements [rad or m], not zero, shape (n,).
        rates: Limits of velocity, acceleration and jerk, shape (3, n).
        place: Location of the motion on the path, for the message.

    Returns:
        Durations (m,) [s] and coefficients (m, 4, n) from zero to delta.
    """
    size = np.abs(delta)
    unit = float(np.max([size / rates[0], 2.0 * np.sqrt(size / rates[1]), np.cbrt(32.0 * size / rates[2])]))
    scaled = rates * unit ** np.array([[1], [2], [3]]) / size
    profiles = _call_ruckig(np.minimum(scaled, _CAPS[:, None]), place)
    ends = np.concatenate([np.cumsum(profile.t) for profile in profiles])
    breaks = _distinct(np.sort(np.concatenate([[0.0], ends])))
    shares = np.stack([_on(profile, breaks) for profile in profiles], axis=2)
    powers = unit ** -np.arange(4.0)
    return np.diff(breaks) * unit, shares * powers[None, :, None] * delta


def _call_ruckig(rates: Array, place: str) -> list[Any]:
    """Ruckig's profile of each motion from zero to one."""
    n = rates.shape[1]
    given = ruckig.InputParameter(n)
    given.current_position, given.target_position = [0.0] * n, [1.0] * n
    given.max_velocity, given.max_acceleration, given.max_jerk = (row.tolist() for row in rates)
    trajectory = ruckig.Trajectory(n)
    try:
        result = ruckig.Ruckig(n).calculate(given, trajectory)
    except (ruckig.RuckigError, ValueError) as error:
        raise RetimingError(f"Ruckig fails {place}: {error}") from error
    if result not in (ruckig.Result.Working, ruckig.Result.Finished):
        raise RetimingError(f"Ruckig fails {place}: {result.name}")
    profiles = list(trajectory.profiles[0])
    if any(profile.brake.duration != 0.0 or not np.isfinite(profile.t).all() for profile in profiles):
        raise RetimingError(f"Ruckig fails {place}: its motion does not start at rest")
    return profiles


def _distinct(times: Array) -> Array:
    """Sorted times without near-duplicates; the last one is kept."""
    kept = np.asarray(times[np.concatenate([[True], np.diff(times) > SHORTEST])])
    kept[-1] = times[-1]
    return kept


def _on(profile: Any, breaks: Array) -> Array:
    """Coefficients (m, 4) of a profile on `breaks`, which contain its switching times."""
    t, j, a, v, p = (np.asarray(getattr(profile, name)) for name in "tjavp")
    starts = np.concatenate([[0.0], np.cumsum(t)])
    middle = 0.5 * (breaks[:-1] + breaks[1:])
    phase = np.clip(np.searchsorted(starts, middle, side="right") - 1, 0, len(t))
    done = phase == len(t)
    phase = np.minimum(phase, len(t) - 1)
    h, j, a, v, p = breaks[:-1] - starts[phase], j[phase], a[phase], v[phase], p[phase]
    rows = np.stack(
        [
            p + h * (v + h * (a / 2.0 + h * j / 6.0)),
            v + h * (a + h * j / 2.0),
            (a + h * j) / 2.0,
            j / 6.0,
        ],
        axis=1,
    )
    rows[done] = [1.0, 0.0, 0.0, 0.0]
    return np.asarray(rows)
