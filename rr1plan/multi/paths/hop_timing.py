"""Timing of motions from stop to stop, and jerk-limited motions on straight lines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rr1plan.checks import Array, known_name, true_or_false
from rr1plan.errors import InputError
from rr1plan.retiming import retiming_names
from rr1plan.retiming.path_blends import Curve
from rr1plan.retiming.polynomial_extrema import evaluate
from rr1plan.retiming.timed_pieces import Pieces
from rr1plan.robot.joint_limits import Limits

# Retiming methods that stay on the path.
_METHODS = ("blend", "stop", "ruckig")
_BISECTIONS = 60  # of a time between two breaks, down to rounding errors


@dataclass(frozen=True)
class HopTiming:
    """The retiming of the arms' motions from stop to stop.

    Args:
        method: "blend" rounds corners, "stop" stops at them, "ruckig" stops at them and limits jerk.
        torque_limits: Whether motions also keep the joints' effort limits; each is stretched until it does.

    Raises:
        UnknownNameError: no such retiming.
        InputError: a retiming that leaves the path, off which nothing is certified between the arms.
    """

    method: str = "blend"
    torque_limits: bool = False

    def __post_init__(self) -> None:
        true_or_false("torque_limits", self.torque_limits)
        if isinstance(self.method, str) and self.method in set(retiming_names()).difference(_METHODS):
            raise InputError(
                f"retiming {self.method!r} leaves the paths that are certified between the arms; "
                f"expected one of {', '.join(_METHODS)}, or a planner of all arms as one, e.g. 'rrt_connect'"
            )
        known_name("retiming", self.method, _METHODS)


BLENDED = HopTiming()
"""Rounded corners, without torque limits: the default."""


def joint_times(steps: Array, limits: Limits) -> Array:
    """Duration of each joint's motion from rest to rest over some differences [s], shape (n, nq).

    Args:
        steps: Differences, shape (n, nq).
        limits: Limits of the joints; a missing limit counts as 1.
    """
    velocity, acceleration = (np.where(np.isfinite(most), most, 1.0) for most in (limits.velocity, limits.acceleration))
    far = np.abs(steps)
    ramps = 2.0 * np.sqrt(far / acceleration)
    cruises = far / velocity + velocity / acceleration
    return np.asarray(np.where(far * acceleration > velocity**2, cruises, ramps))


def jerk_limited_line(start: Array, direction: Array, length: float, limits: Limits) -> Pieces:
    """The fastest jerk-limited motion on a straight line, from rest to rest.

    Args:
        start: First configuration, shape (nq,).
        direction: Unit vector, shape (nq,).
        length: Length of the line [rad].
        limits: Velocity, acceleration and jerk limits, finite for moving joints.

    Raises:
        RetimingError: Ruckig fails.
    """
    from rr1plan.retiming.ruckig_retiming import time_line_smoothly  # loads Ruckig

    line = Curve(np.array([length]), np.stack([start, direction, np.zeros_like(start)])[None], (0, 1))
    return time_line_smoothly(line, limits).within(limits, jerk=True)


def times_along(line: Pieces, direction: Array, distances: Array) -> Array:
    """Times at which a motion along a straight line has covered some distances [s].

    Args:
        line: The motion; it never goes back.
        direction: Unit vector, shape (nq,).
        distances: Ascending, from 0 to the length of the line [rad], shape (n,).
    """
    along = line.coefficients @ direction
    along[:, 0] -= along[0, 0]
    breaks = np.concatenate([[0.0], np.cumsum(line.durations)])
    piece = np.clip(np.searchsorted(along[:, 0], distances, side="right") - 1, 0, len(along) - 1)
    low, high = np.zeros(len(distances)), line.durations[piece].copy()
    cubics = along[piece][:, :, None]
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        before = evaluate(cubics, middle[:, None])[:, 0] < distances
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    times = breaks[piece] + high
    times[0], times[-1] = 0.0, breaks[-1]
    return np.asarray(np.maximum.accumulate(times))
