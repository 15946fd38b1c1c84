"""The motion of one agent along its route during execution: move up to a gridpoint, brake, wait, continue.

Speeds come from time-optimal parameterization that begins at the agent's current position and speed, so that it can
always stop at the gridpoint up to which it may go.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from rr1plan.checks import Array
from rr1plan.multi.execution.route import Route
from rr1plan.retiming.path_speed import NO_INTERVALS, Grid, fastest_speeds, timed
from rr1plan.retiming.timed_pieces import SHORTEST, Pieces, concatenate
from rr1plan.robot.joint_limits import Limits
from rr1plan.trajectory import Trajectory

# Speeds are limited only at some points of each segment of a blend, so this share of the limit is not used.
_SPARE = 5e-3
# Relative tolerance for equal squared speeds: rounding of two passes.
_SAME_SPEED = 1e-9
# A part of a segment shorter than this share of it is not a separate segment.
_SLIVER = 1e-6


def slower(limits: Limits, factor: float) -> Limits:
    """Limits under which every motion takes `factor` times as long, with a small reserve of speed."""
    return Limits(
        limits.lower,
        limits.upper,
        limits.velocity * ((1.0 - _SPARE) / factor),
        limits.acceleration * ((1.0 - _SPARE) / factor**2),
        limits.jerk,
        limits.effort,
    )


def gentler(limits: Limits) -> Limits:
    """The same limits with a small reserve of acceleration, for an agent that may already have its full speed."""
    return replace(limits, acceleration=limits.acceleration * (1.0 - _SPARE))


class _Moved(NamedTuple):
    """A traversed part of a segment: its start and length, squared path speeds at both ends, and times."""

    piece: int
    offset: float
    span: float
    begin: float
    end: float
    time: float


@dataclass
class _Profile:
    """The plan from now on: segments with their squared speeds and the times of their ends.

    Args:
        grid: The segments, the first one from the agent's current position.
        x: Squared path speeds at their ends, shape (k + 1,).
        times: Times at the ends [s], shape (k + 1,).
        gridpoint: Gridpoint of the route at the end of each segment; -1 inside a segment, shape (k,).
    """

    grid: Grid
    x: Array
    times: Array
    gridpoint: list[int]


class RouteMotion:
    """An agent on its route.

    Args:
        route: The route.
        limits: Velocity and acceleration limits of its joints.
        now: Time at which it is at rest at the beginning [s].

    Attributes:
        now: The time up to which its motion is decided [s].
        segment: The segment on which it is, or at whose beginning.
        limit: The gridpoint up to which it may go.
    """

    def __init__(self, route: Route, limits: Limits, now: float = 0.0) -> None:
        self.route, self.limits, self.now = route, limits, now
        self._began = now
        self.segment, self.limit = 0, 0
        self._share, self._x = 0.0, 0.0  # distance along the segment [rad], and squared speed
        self._hold = -math.inf
        self._profile = _Profile(NO_INTERVALS, np.zeros(1), np.array([now]), [])
        self._done: list[_Moved] = []
        self._passed = np.full(route.segments + 1, np.inf)
        self._left = np.full(route.segments + 1, np.inf)
        self._passed[0] = now

    @classmethod
    def moving(cls, route: Route, limits: Limits, now: float, segment: int, share: float, x: float) -> RouteMotion:
        """An agent that is on a segment and moves.

        Args:
            route: The route.
            limits: Velocity and acceleration limits of its joints.
            now: The time [s].
            segment: The segment.
            share: Distance of the agent along it [rad].
            x: Squared path speed there.
        """
        motion = cls(route, limits, now)
        motion._passed[0] = np.inf
        motion.segment, motion._share, motion._x = segment, share, x
        motion.limit = next(stop for stop in route.stops if stop > segment)
        motion._plan()
        return motion

    # ---- future --------------------------------------------------------------------------

    def pass_time(self, gridpoint: int) -> float:
        """Time at which it reaches a gridpoint [s]; inf if not decided yet."""
        if gridpoint <= self.segment and math.isfinite(self._passed[gridpoint]):
            return float(self._passed[gridpoint])
        try:
            return float(self._profile.times[self._profile.gridpoint.index(gridpoint) + 1])
        except ValueError:
            return math.inf

    def leave_time(self, gridpoint: int) -> float:
        """Time at which it continues from a gridpoint [s]; inf if not decided yet."""
        if math.isfinite(self._left[gridpoint]):
            return float(self._left[gridpoint])
        if gridpoint == self.segment and self._share == 0.0:
            return float(self._profile.times[0]) if len(self._profile.gridpoint) else math.inf
        if gridpoint < self.limit:
            return self.pass_time(gridpoint)
        return math.inf

    @property
    def stop_time(self) -> float:
        """Time at which it will be at rest [s]."""
        return float(self._profile.times[-1])

    # ---- decisions -------------------------------------------------------------------------

    def go_to(self, gridpoint: int, now: float) -> None:
        """Allow motion up to a gridpoint, which is not before the first one at which it can stop.

        Args:
            gridpoint: The gridpoint.
            now: The time [s].
        """
        self._advance(now)
        self.limit = gridpoint
        self._plan()

    def pause(self, now: float, until: float) -> None:
        """Stop at the first gridpoint at which it can, and rest there.

        Args:
            now: Time of the request [s].
            until: Time before which it does not continue [s].
        """
        self._advance(now)
        self._hold = max(self._hold, until)
        self.limit = self.first_stop()
        self._plan()

    def first_stop(self) -> int:
        """The first gridpoint at which it can stop."""
        if self._x == 0.0:
            return self.segment
        for gridpoint in range(self.segment + 1, self.limit):
            grid = self._grid(self.segment, self._share, gridpoint)
            if fastest_speeds(self.route.curve, grid, self.limits, self._x)[0] >= self._x * (1.0 - _SAME_SPEED):
                return gridpoint
        return self.limit

    def _plan(self) -> None:
        begin = max(self.now, self._hold) if self._x == 0.0 else self.now
        grids, speeds, gridpoints, first = [], [], [], self._x
        station, share = self.segment, self._share
        ends = [*(k for k in self.route.stops if self.segment < k < self.limit), self.limit]
        while ends:
            end = ends.pop(0)
            if end <= station:
                continue
            grid, marks = self._span(station, share, end, first)
            x = fastest_speeds(self.route.curve, grid, self.limits, first)
            x[0] = first
            stop = next((k for k, speed in zip(marks[:-1], x[1:-1], strict=True) if speed == 0.0 and k >= 0), end)
            if stop < end:
                # Where it has to rest, a new motion begins, which a single segment cannot represent otherwise.
                ends = [stop, end, *ends]
                continue
            grids.append(grid)
            speeds.append(x[:-1])
            gridpoints += marks
            station, share, first = end, 0.0, 0.0
        if not grids:
            self._profile = _Profile(NO_INTERVALS, np.zeros(1), np.array([begin]), [])
            return
        grid = Grid(*map(np.concatenate, zip(*grids, strict=True)))
        x = np.append(np.concatenate(speeds), 0.0)
        durations = 2.0 * grid.delta / (np.sqrt(x[1:]) + np.sqrt(x[:-1]))
        self._profile = _Profile(grid, x, begin + np.concatenate([[0.0], np.cumsum(durations)]), gridpoints)

    def _grid(self, begin: int, share: float, end: int) -> Grid:
        """Segments up to a gridpoint, the first without a share of it."""
        piece, offset, delta = self.route.grid.part(begin, end)
        cut = np.zeros(len(piece))
        cut[0] = share
        return Grid(piece, offset + cut, delta - cut)

    def _span(self, begin: int, share: float, end: int, first: float) -> tuple[Grid, list[int]]:
        """Like `_grid`, with one segment from rest to rest divided into halves; and the gridpoints at all ends."""
        grid, marks = self._grid(begin, share, end), list(range(begin + 1, end + 1))
        if len(marks) > 1 or first > 0.0:
            return grid, marks
        half = 0.5 * float(grid.delta[0])
        offset = grid.offset[0] + np.array([0.0, half])
        return Grid(grid.piece.repeat(2), offset, np.array([half, half])), [-1, *marks]

    def _advance(self, now: float) -> None:
        """Record the part of the profile before now as executed."""
        plan = self._profile
        over = int(np.searchsorted(plan.times[1:], now, side="right"))
        if over < len(plan.gridpoint) and now > plan.times[over]:
            length, passed = float(plan.grid.delta[over]), now - float(plan.times[over])
            slope = float(plan.x[over + 1] - plan.x[over]) / length
            distance = passed * (math.sqrt(plan.x[over]) + 0.25 * slope * passed)
            if distance > (1.0 - _SLIVER) * length:
                over += 1  # treat it as at the end, so that no sliver remains
            elif distance > _SLIVER * length:
                for k in range(over):
                    self._pass(k)
                self._record(over, distance, float(plan.x[over]) + slope * distance)
                self.now = now
                return
        for k in range(over):
            self._pass(k)
        # A sliver treated as passed ends after `now`, and rest does not begin before its end.
        self.now = max(now, float(plan.times[over])) if self._x == 0.0 else float(plan.times[over])

    def _pass(self, k: int) -> None:
        """Record a whole segment of the profile as executed."""
        plan = self._profile
        self._record(k, float(plan.grid.delta[k]), float(plan.x[k + 1]))
        if plan.gridpoint[k] >= 0:
            self.segment, self._share = plan.gridpoint[k], 0.0
            self._passed[self.segment] = plan.times[k + 1]

    def _record(self, k: int, distance: float, x: float) -> None:
        """Record the first part of a segment of the profile as executed."""
        plan = self._profile
        if self._share == 0.0:
            self._left[self.segment] = plan.times[k]
        piece, offset, begin = int(plan.grid.piece[k]), float(plan.grid.offset[k]), float(plan.x[k])
        self._done.append(_Moved(piece, offset, distance, begin, x, float(plan.times[k])))
        self._share += distance
        self._x = x

    # ---- past --------------------------------------------------------------------------------

    def trajectory(self) -> Trajectory:
        """The motion from the beginning to the end of the current profile."""
        self._advance(self.stop_time)
        route, now, q = self.route, self._began, self.route.start
        parts: list[Pieces] = []
        stops = [k + 1 for k, moved in enumerate(self._done) if moved.end == 0.0]
        for first, last in pairwise([0, *stops]):
            rows = self._done[first:last]
            if rows[0].time - now > SHORTEST:
                parts.append(Pieces(np.array([rows[0].time - now]), q[None, None]))
            grid = Grid(
                np.array([moved.piece for moved in rows]),
                np.array([moved.offset for moved in rows]),
                np.array([moved.span for moved in rows]),
            )
            parts.append(timed(route.curve, grid, np.array([rows[0].begin, *(moved.end for moved in rows)])))
            now = max(now, rows[0].time) + parts[-1].duration
            q = grid.position(route.curve, 1.0)[-1]
        if not parts:
            return Trajectory.rest(route.joint_names, q, start=self._began)
        whole = concatenate(parts)
        kept = whole.durations > SHORTEST
        breaks = self._began + np.concatenate([[0.0], np.cumsum(whole.durations[kept])])
        return Trajectory(route.joint_names, breaks, whole.coefficients[kept])

    def rests(self) -> list[tuple[int, float, float]]:
        """Gridpoints at which it rested before the end of its route, with start and end of each rest [s]."""
        self._advance(self.stop_time)
        at = np.flatnonzero(np.isfinite(self._left) & (self._left - self._passed > SHORTEST))
        return [(int(k), float(self._passed[k]), float(self._left[k])) for k in at]

    def steps_entered(self) -> Array:
        """Times at which it entered each step of its route [s], shape (n,); the first is -inf."""
        self._advance(self.stop_time)
        steps = self.route.steps
        found = np.where(steps.is_rest, self._passed[steps.begins], self._left[steps.begins])
        found[0] = -np.inf
        return np.asarray(found)
