"""Timing on a fixed path among agents whose schedules are known: safe-interval path planning.

An agent may wait at some gridpoints of its path, continue, or go back. A state is a gridpoint and an interval of time
in which resting there is safe; among all schedules that reach a state only the earliest counts (Phillips and Likhachev,
SIPP: Safe interval path planning for dynamic environments, 2011). Motions between stops have the dynamics of the arms,
and whether one is safe is decided for all departures at once, in continuous time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from heapq import heappop, heappush
from itertools import count
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.timing.coordination import Blocked
from rr1plan.multi.timing.schedule import Leg, Occupancy, Schedule, rest_row

# Blocked times are extended by this at both ends, far above the rounding of times [s].
_ROUNDING = 1e-7


class BlockedTimes(NamedTuple):
    """Intervals in which rows of extended diagrams are blocked by others.

    Args:
        rows: Rows, ascending, shape (n,).
        begin: Start of each interval [s].
        end: End of each interval [s].
    """

    rows: NDArray[np.int64]
    begin: Array
    end: Array

    def of(self, row: int) -> tuple[Array, Array]:
        """Starts and ends of the intervals in which a row is blocked."""
        first, last = np.searchsorted(self.rows, [row, row + 1])
        return self.begin[first:last], self.end[first:last]


def blocked_times(others: Iterable[tuple[Blocked, Occupancy]]) -> BlockedTimes:
    """The intervals in which parts of a path are blocked for an agent.

    Args:
        others: For each other agent the extended diagram (rows: of the path) and its occupancy.
    """
    rows, begins, ends = [np.zeros(0, np.int64)], [np.zeros(0)], [np.zeros(0)]
    for blocked, occupied in others:
        hit = blocked[:, occupied.rows]
        which = np.flatnonzero(hit.any(axis=1))
        if len(which) == 0:
            continue
        # Consecutive blocked cells form one interval of time.
        edges = np.diff(np.pad(hit[which].astype(np.int8), ((0, 0), (1, 1))), axis=1)
        row, first = np.nonzero(edges == 1)
        _, behind = np.nonzero(edges == -1)
        rows.append(which[row])
        begins.append(occupied.enter[first] - _ROUNDING)
        ends.append(occupied.leave[behind - 1] + _ROUNDING)
    row, begin, end = np.concatenate(rows), np.concatenate(begins), np.concatenate(ends)
    order = np.argsort(row, kind="stable")
    return BlockedTimes(row[order], begin[order], end[order])


def safe_intervals(begins: Array, ends: Array) -> list[tuple[float, float]]:
    """The times between some intervals."""
    safe, now = [], -math.inf
    for i in np.argsort(begins, kind="stable").tolist():
        if begins[i] > now:
            safe.append((now, float(begins[i])))
        now = max(now, float(ends[i]))
    if now < math.inf:
        safe.append((now, math.inf))
    return safe


def earliest_schedule(
    path: AgentPath, blocked: BlockedTimes, goes_on: Callable[[], bool] = lambda: True
) -> Schedule | None:
    """The earliest of all schedules that wait only at the path's stops; None if there is none.

    Args:
        path: The path.
        blocked: Blocked times of the path.
        goes_on: Called before each motion between stops is timed, which takes milliseconds with limits of jerk or
            torque; False ends the search without a schedule.
    """
    if path.segments == 0:
        # Intervals that are over at time zero do not matter, as elsewhere.
        is_free = not any((blocked.of(row)[1] > 0.0).any() for row in (0, 1))
        return Schedule(path, ()) if is_free else None
    if len(blocked.rows) == 0:
        return Schedule(path, (Leg(0.0, 0, path.segments),))
    return _Search(path, blocked).run(goes_on)


class _State(NamedTuple):
    time: float
    stop: int
    interval: int
    before: _State | None
    departure: float


class _Search:
    def __init__(self, path: AgentPath, blocked: BlockedTimes) -> None:
        self.path, self.blocked = path, blocked
        self.stops = path.stops
        self.goal = path.segments
        self.safe = {k: safe_intervals(*blocked.of(rest_row(path, k))) for k in self.stops}
        inner = blocked.rows <= path.segments + 1
        self.rows, self.begin, self.end = (part[inner] for part in blocked)

    def run(self, goes_on: Callable[[], bool]) -> Schedule | None:
        """Search best first, by the time at which the goal could be reached without further waiting."""
        at_start = [i for i, (a, b) in enumerate(self.safe[0]) if a <= 0.0 < b]
        if not at_start or not self.safe[self.goal] or self.safe[self.goal][-1][1] < math.inf:
            return None
        numbers = count()
        queue = [(self.path.fastest, next(numbers), _State(0.0, 0, at_start[0], None, 0.0))]
        done: set[tuple[int, int]] = set()
        while queue:
            _, _, state = heappop(queue)
            if (state.stop, state.interval) in done:
                continue
            done.add((state.stop, state.interval))
            last = len(self.safe[self.goal]) - 1
            if state.stop == self.goal and state.interval == last:
                return Schedule(self.path, tuple(self._legs(state)))
            for target in self._targets(state.stop):
                if not goes_on():
                    return None
                times = self.path.hop_times(state.stop, target)
                direct = False
                for arrival, interval, departure in self._arrivals(state, target, times):
                    if (target, interval) in done:
                        continue
                    left = self.path.hop_duration(target, self.goal)
                    new = _State(arrival, target, interval, state, departure)
                    heappush(queue, (arrival + left, next(numbers), new))
                    direct = direct or (target == self.goal and interval == last and departure <= state.time)
                if direct:
                    break  # no schedule is faster than an immediate departure
        return None

    def _targets(self, stop: int) -> Sequence[int]:
        """Target stops, the goal first."""
        return [k for k in reversed(self.stops) if k != stop]

    def _arrivals(self, state: _State, target: int, times: Array) -> list[tuple[float, int, float]]:
        """For each reachable safe interval of a target: arrival [s], interval, departure [s]."""
        departures = self._safe_departures(state.stop, target, times)
        duration = float(times[-1])
        leave_by = self.safe[state.stop][state.interval][1]
        found = []
        for i, (begin, end) in enumerate(self.safe[target]):
            low, high = max(state.time, begin - duration), min(leave_by, end - duration)
            for a, b in departures:
                departure = max(low, a)
                if departure < min(high, b):
                    found.append((departure + duration, i, departure))
                    break
        return found

    def _safe_departures(self, begin: int, end: int, times: Array) -> list[tuple[float, float]]:
        """Intervals of departure for which no segment on the way is blocked while the agent is on it."""
        if end > begin:
            first, last = np.searchsorted(self.rows, [begin + 1, end + 1])
            number = self.rows[first:last] - begin - 1
        else:
            first, last = np.searchsorted(self.rows, [end + 1, begin + 1])
            number = begin - self.rows[first:last]
        return safe_intervals(self.begin[first:last] - times[number + 1], self.end[first:last] - times[number])

    def _legs(self, state: _State) -> list[Leg]:
        legs: list[Leg] = []
        while state.before is not None:
            legs.append(Leg(state.departure, state.before.stop, state.stop))
            state = state.before
        return legs[::-1]
