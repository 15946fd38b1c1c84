"""Schedules: motions and waits of an agent on its path, and the cells of diagrams that it occupies over time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.timing.coordination import Blocked
from rr1plan.retiming.timed_pieces import SHORTEST, Pieces, concatenate
from rr1plan.trajectory import Trajectory


class Leg(NamedTuple):
    """A motion of a schedule: from rest at one gridpoint of the path to rest at another.

    Args:
        departure: Time of departure [s].
        begin: Gridpoint.
        end: Gridpoint.
    """

    departure: float
    begin: int
    end: int


def gridpoints_of(leg: Leg) -> NDArray[np.int64]:
    """The gridpoints of a leg in order, from its begin to its end, shape (n,)."""
    step = 1 if leg.end > leg.begin else -1
    return np.arange(leg.begin, leg.end + step, step)


def segments_of(leg: Leg) -> NDArray[np.int64]:
    """The segments of a leg in order, each named by its lower gridpoint, shape (n - 1,)."""
    gridpoints = gridpoints_of(leg)
    return np.minimum(gridpoints[1:], gridpoints[:-1])


class Occupancy(NamedTuple):
    """Rows of extended diagrams that an agent occupies in order, each from the end of the previous one.

    Args:
        rows: Rows, see `extended`.
        enter: Time at which it enters each row [s]; the first at -inf.
        leave: Time at which it leaves each row [s]; the last at +inf.
    """

    rows: NDArray[np.int64]
    enter: Array
    leave: Array


def rest_row(path: AgentPath, gridpoint: int) -> int:
    """The row of extended diagrams that an agent occupies while it rests at a gridpoint."""
    if gridpoint == 0:
        return 0
    if gridpoint == path.segments:
        return path.segments + 1
    return path.segments + 1 + gridpoint


def extended(blocked: Blocked) -> Blocked:
    """A diagram with additional rows and columns, after all others, for rest at inner gridpoints.

    Rest between two segments is part of both: it is free if either segment is.
    """
    rows = np.concatenate([blocked, blocked[1:-2] & blocked[2:-1]])
    return np.concatenate([rows, rows[:, 1:-2] & rows[:, 2:-1]], axis=1)


@dataclass(frozen=True)
class Schedule:
    """An agent on its path in time; it rests before, between and after its legs.

    Args:
        path: The path.
        legs: The motions in order; none if it stays at its start, which is its goal.
    """

    path: AgentPath
    legs: tuple[Leg, ...]

    @property
    def arms(self) -> tuple[str, ...]:
        """The arms that follow the schedule."""
        return self.path.agent.arms

    @cached_property
    def arrival(self) -> float:
        """Time from which it remains at its goal [s]."""
        if not self.legs:
            return 0.0
        last = self.legs[-1]
        return last.departure + self.leg_duration(last)

    def instants(self, leg: Leg) -> Array:
        """Times of a leg at its gridpoints [s], shape (n,)."""
        return np.asarray(leg.departure + self.path.hop_times(leg.begin, leg.end))

    def leg_duration(self, leg: Leg) -> float:
        """Duration of a leg [s]."""
        return self.path.hop_duration(leg.begin, leg.end)

    @property
    def waiting(self) -> float:
        """Time that it rests before its final arrival [s]."""
        return max(0.0, self.arrival - sum(self.leg_duration(leg) for leg in self.legs))

    @property
    def length(self) -> float:
        """Sum of the lengths of its arms' motions [rad]."""
        lengths = self.path.lengths_of_arms.sum(axis=0)
        return float(sum(abs(lengths[leg.end] - lengths[leg.begin]) for leg in self.legs))

    @property
    def waiting_of_arms(self) -> float:
        """Sum of the times that its arms rest before they arrive, each at its own time [s]."""
        if len(self.arms) == 1:
            return self.waiting
        moving, arrival = np.zeros(len(self.arms)), np.zeros(len(self.arms))
        lengths = self.path.lengths_of_arms
        for leg in self.legs:
            moves, times = np.diff(lengths[:, gridpoints_of(leg)], axis=1) != 0.0, self.instants(leg)
            moving += moves @ np.diff(times)
            arrival = np.maximum(arrival, np.where(moves, times[1:], 0.0).max(axis=1))
        # The sum of the moves is rounded differently.
        return float(np.maximum(arrival - moving, 0.0).sum())

    @cached_property
    def occupancy(self) -> Occupancy:
        """The rows of extended diagrams that it occupies, with times."""
        rows, enter = [np.array([0])], [np.array([-np.inf])]
        for leg in self.legs:
            times = self.instants(leg)
            rows += [segments_of(leg) + 1, np.array([rest_row(self.path, leg.end)])]
            enter += [times[:-1], times[-1:]]
        # The end of a leg and the departure of the next one are rounded differently.
        all_enter = np.maximum.accumulate(np.concatenate(enter))
        return Occupancy(np.concatenate(rows), all_enter, np.append(all_enter[1:], np.inf))

    def trajectory(self) -> Trajectory:
        """The motion on the clock of the schedule."""
        names = self.path.agent.joint_names
        parts: list[Pieces] = []
        now = 0.0
        for leg in self.legs:
            if leg.departure - now > SHORTEST:
                parts.append(Pieces(np.array([leg.departure - now]), self.path.at(leg.begin)[None, None]))
            parts.append(self.path.hop(leg.begin, leg.end))
            now = leg.departure + parts[-1].duration
        if not parts:
            return Trajectory.rest(names, self.path.at(0))
        return _joined(names, concatenate(parts))


def _joined(names: tuple[str, ...], pieces: Pieces) -> Trajectory:
    kept = pieces.durations > SHORTEST
    if not kept.any():
        return Trajectory.rest(names, pieces.coefficients[0, 0])
    breaks = np.concatenate([[0.0], np.cumsum(pieces.durations[kept])])
    return Trajectory(names, breaks, pieces.coefficients[kept])
