"""Shortcuts of a path of several arms that save time rather than length.

A shortcut connects two random instants by straight lines, for one arm while the others keep their motions, or for all
(partial shortcuts: Geraerts and Overmars, Creating high-quality paths for motion planning, 2007; of arms: Huang et al.,
Benchmarking shortcutting techniques for multi-robot-arm motion planning, 2025). Arms that moved one after the other
then move at the same time. An edge takes as long as its slowest joint does from rest to rest; the motion gets faster
when corners are rounded later.
"""

from __future__ import annotations

import numpy as np

from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.multi.agents import Agent
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.robot.joint_limits import Limits

# A shortcut has to save this share of the duration. A share of the mean time of the joints counts, too, so that arms
# take shorter paths while others determine the duration of an edge.
_LEAST_GAIN, _WAY = 1e-3, 0.1
# Consecutive shortcuts without a gain after which the search stops, for each arm.
_PATIENCE = 40
_ALL = 0.15  # probability that a shortcut applies to all arms instead of one


def shorten_in_time(
    points: Array,
    agent: Agent,
    checker: CollisionChecker,
    rng: np.random.Generator,
    watch: Stopwatch,
    attempts: int,
) -> Array:
    """Make a certified path of several arms faster.

    Args:
        points: Waypoints, shape (n, nq).
        agent: The arms.
        checker: Certifies edges of their joints.
        rng: Where random numbers come from.
        watch: Deadline.
        attempts: Shortcuts to try, at most.

    Returns:
        Waypoints, shape (m, nq); each edge is certified, or a part of a given one.
    """
    path, columns = _TimedPolyline(points, agent.limits), list(agent.columns.values())
    idle = 0
    for _ in range(attempts):
        if idle >= _PATIENCE * len(columns) or len(path.points) <= 2 or not watch.goes_on():
            break
        begin, end = np.sort(rng.random(2)) * path.times[-1]
        together = len(columns) == 1 or rng.random() < _ALL
        first, behind = np.searchsorted(path.times, [begin, end], side="right").tolist()
        old = np.vstack([path.at(begin), path.points[first:behind], path.at(end)])
        if together:
            new = old[[0, -1]]
        else:
            arm = columns[int(rng.integers(len(columns)))]
            new = _straightened(old, path.times[first:behind], begin, end, arm)
        idle += 1
        if path.cost(old) - path.cost(new) > _LEAST_GAIN * path.times[-1] and checker.path_is_free(new):
            joined = np.concatenate([path.points[:first], new, path.points[behind:]])
            path, idle = _TimedPolyline(joined, agent.limits), 0
    return path.points


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


def _straightened(section: Array, times: Array, begin: float, end: float, columns: slice) -> Array:
    """A section on which one arm moves in a straight line, at constant speed."""
    new = section.copy()
    share = ((times - begin) / (end - begin))[:, None]
    new[1:-1, columns] = section[0, columns] + share * (section[-1, columns] - section[0, columns])
    return new


class _TimedPolyline:
    """A timed polyline.

    Args:
        points: Waypoints, shape (n, nq); repeated ones are dropped.
        limits: Of its joints.

    Attributes:
        points: Waypoints.
        times: Time at each [s].
    """

    def __init__(self, points: Array, limits: Limits) -> None:
        self._limits = limits
        durations = joint_times(np.diff(points, axis=0), limits).max(axis=1)
        moves = durations > 0.0
        self.points: Array = points[np.concatenate([[True], moves])]
        self.times = np.concatenate([[0.0], np.cumsum(durations[moves])])

    def cost(self, points: Array) -> float:
        """The duration of some waypoints, and a share of the mean time of their joints."""
        times = joint_times(np.diff(points, axis=0), self._limits)
        return float(times.max(axis=1).sum() + _WAY * times.mean(axis=1).sum())

    def at(self, time: float) -> Array:
        """Configuration of the arms at an instant, shape (nq,)."""
        row = min(int(np.searchsorted(self.times, time, side="right")), len(self.times) - 1)
        share = (time - self.times[row - 1]) / (self.times[row] - self.times[row - 1])
        return np.asarray(self.points[row - 1] + share * (self.points[row] - self.points[row - 1]))
