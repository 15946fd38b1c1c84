"""A polyline of several arms timed at the velocity limits, and random changes that may save time.

The slowest arms on an edge determine its duration, so mostly these are changed. A waypoint of one arm, or of all, moves
toward one of its neighbors or toward the line between them. Alternatively one arm moves between two waypoints via a
random configuration, e.g. past another arm on its other side, which small changes cannot reach.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rr1plan.checks import Array
from rr1plan.multi.paths.nominal_clock import Track, nominal_velocity
from rr1plan.robot.joint_limits import Limits

# Probabilities that a waypoint of one arm moves, and of all arms; otherwise one arm goes via a random configuration.
_ONE, _ALL = 0.5, 0.25
# Weight of an arm in the choice: its share of the edge's time to this power, and the least weight.
_POWER, _LEAST = 3, 1e-3
_AWAY = 0.5  # largest standard deviation of a random configuration, as a share of the arm's displacement


class PacedPolyline:
    """A timed polyline, on which the duration of each edge is that of its slowest joint at the velocity limit.

    Args:
        points: Waypoints, no two consecutive ones equal, shape (n, nq).
        limits: Limits of the joints; a missing velocity limit counts as 1.
        columns: Joints of each arm.

    Attributes:
        velocity: Velocity limits, shape (nq,).
        arm_times: Time that each arm needs for each edge at its velocity limits [s], shape (n - 1, arms).
    """

    def __init__(self, points: Array, limits: Limits, columns: Sequence[slice]) -> None:
        self.points, self.limits, self.columns = points, limits, columns
        self.velocity = nominal_velocity(limits)
        steps = np.abs(np.diff(points, axis=0)) / self.velocity
        self.arm_times = np.column_stack([steps[:, own].max(axis=1) for own in columns])
        durations = self.arm_times.max(axis=1, initial=0.0)
        self._times = np.concatenate([[0.0], np.cumsum(durations)])
        shares = self.arm_times / durations[:, None]
        # Weights of the arms at each inner waypoint, from the adjacent edge on which they are slower.
        weights = np.maximum(shares[:-1], shares[1:]) ** _POWER + _LEAST
        # Cumulative up to each arm except the last, so that a number below 1 always selects an arm.
        self._chances = (np.cumsum(weights, axis=1) / weights.sum(axis=1, keepdims=True))[:, :-1]

    def replaced(self, points: Array) -> PacedPolyline:
        """The polyline with other waypoints."""
        return PacedPolyline(points, self.limits, self.columns)

    def changed(self, rng: np.random.Generator) -> Array:
        """Waypoints with the same ends and one random change, within position limits; shape (n, nq), n >= 3."""
        row = 1 + int(rng.integers(len(self.points) - 2))
        kind = rng.random()
        arm = self.columns[int(np.searchsorted(self._chances[row - 1], rng.random(), side="right"))]
        if kind >= _ONE + _ALL:
            return self._led_away(rng, row, arm)
        return self._pulled(rng, row, arm if kind < _ONE else slice(None))

    def _pulled(self, rng: np.random.Generator, row: int, columns: slice) -> Array:
        """Move a waypoint toward the previous one, the next one, or the line between them."""
        before, here, after = self.points[row - 1 : row + 2, columns]
        toward = int(rng.integers(4))
        if toward < 2:
            step = 0.5 * rng.random() * ((before, after)[toward] - here)
        else:
            begin, now, end = self._times[row - 1 : row + 2]
            step = min(1.0, 1.5 * rng.random()) * (before + (now - begin) / (end - begin) * (after - before) - here)
        made = self.points.copy()
        made[row, columns] += step
        return made

    def _led_away(self, rng: np.random.Generator, row: int, columns: slice) -> Array:
        """Lead one arm between two waypoints via a random configuration."""
        first, last = int(rng.integers(row)), int(rng.integers(row + 1, len(self.points)))
        begin, end = self.points[first, columns], self.points[last, columns]
        times = self._times[first : last + 1]
        middle = begin + (self._times[row] - times[0]) / (times[-1] - times[0]) * (end - begin)
        size = _AWAY * rng.random() ** 2 * float(np.linalg.norm(end - begin))
        low, high = self.limits.lower[columns], self.limits.upper[columns]
        via = np.clip(middle + size * rng.standard_normal(middle.shape), low, high)
        made = self.points.copy()
        made[first : last + 1, columns] = Track(self._times[[first, row, last]], np.stack([begin, via, end])).at(times)
        return made
