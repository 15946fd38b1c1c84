"""Motions on a nominal clock, on which joints move linearly between waypoints at their velocity limits."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from rr1plan.checks import Array
from rr1plan.robot.joint_limits import Limits

SAME = 1e-9
"""Tolerance for equal instants."""
_SHORTEST = 1e-6  # shortest step


class Track(NamedTuple):
    """A polyline on the nominal clock; constant before its first and after its last waypoint.

    Args:
        times: Time of each waypoint, ascending, shape (n,).
        points: Waypoints, shape (n, nq).
    """

    times: Array
    points: Array

    def at(self, times: Array) -> Array:
        """Configurations at some instants, shape (k, nq)."""
        points = np.empty((len(times), self.points.shape[1]))
        for row, column in zip(points.T, self.points.T, strict=True):
            row[:] = np.interp(times, self.times, column)
        return points


def nominal_velocity(limits: Limits) -> Array:
    """Velocity limits of joints, shape (nq,); a missing one counts as 1."""
    return np.asarray(np.where(np.isfinite(limits.velocity), limits.velocity, 1.0))


def nominal_track(waypoints: Array, limits: Limits, unit: float = 1.0) -> Track:
    """Time a path at the velocity limits of its joints, with linear motion between waypoints.

    Args:
        waypoints: Waypoints, shape (n, nq).
        limits: Limits of its joints.
        unit: Unit of its times [s].
    """
    fastest = nominal_velocity(limits)
    steps = np.abs(np.diff(waypoints, axis=0))
    moves = steps.any(axis=1)
    # A lower bound on the durations keeps the ends of each step distinct.
    durations = np.maximum((steps[moves] / fastest).max(axis=1) / unit, _SHORTEST)
    return Track(np.concatenate([[0.0], np.cumsum(durations)]), waypoints[np.concatenate([[True], moves])])


def knots(tracks: Iterable[Track], begin: float = 0.0) -> Array:
    """Instants from `begin` on at which some track has a waypoint, shape (n,)."""
    times = np.unique(np.concatenate([[begin], *(track.times for track in tracks)]))
    times = times[times >= begin]
    # Keep the last of nearly equal instants, which preserves the end.
    kept: Array = times[np.append(np.diff(times) > SAME, True)]
    return kept
