"""The earliest motion of one arm on its roadmap under constraints: safe-interval path planning.

A state is a vertex and a time interval in which the arm may be there; among all motions that reach a state, only the
earliest is kept (Phillips and Likhachev 2011). The dynamics of the arm determine the duration of motions on edges.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from heapq import heappop, heappush
from itertools import count
from typing import NamedTuple

import numpy as np

from rr1plan.multi.search.arm_roadmap import ArmRoadmap
from rr1plan.multi.timing.safe_intervals import safe_intervals

_ALWAYS = [(-math.inf, math.inf)]


class Departure(NamedTuple):
    """A time interval in which no motion may start on an edge.

    Args:
        edge: The vertices of the edge.
        begin: Start of the interval [s].
        end: End of the interval [s].
    """

    edge: tuple[int, int]
    begin: float
    end: float


class Presence(NamedTuple):
    """A time interval in which the arm may not be at a vertex, not even for an instant.

    Args:
        vertex: The vertex.
        begin: Start of the interval [s].
        end: End of the interval [s].
    """

    vertex: int
    begin: float
    end: float


class Settling(NamedTuple):
    """The arm may not arrive for good at a goal before a time.

    Args:
        vertex: The vertex of the goal.
        time: Earliest final arrival there [s]; inf if it may not stay there.
    """

    vertex: int
    time: float


Constraint = Departure | Presence | Settling


class Move(NamedTuple):
    """A motion on an edge.

    Args:
        begin: First vertex.
        end: Last vertex.
        departure: Start time [s].
        arrival: End time [s].
    """

    begin: int
    end: int
    departure: float
    arrival: float


class _State(NamedTuple):
    time: float
    vertex: int
    interval: int
    settled: bool
    before: _State | None
    departure: float


def earliest_moves(
    roadmap: ArmRoadmap, constraints: Iterable[Constraint], goes_on: Callable[[], bool] = lambda: True
) -> list[Move] | None:
    """The motion with the earliest final arrival at a goal under some constraints; None if there is none.

    Args:
        roadmap: The roadmap.
        constraints: The constraints.
        goes_on: Called for each state, because the motions of edges are timed on first use; False ends the search
            without a motion.
    """
    return _Search(roadmap, constraints).run(goes_on)


class _Search:
    def __init__(self, roadmap: ArmRoadmap, constraints: Iterable[Constraint]) -> None:
        self.roadmap = roadmap
        departures: dict[tuple[int, int], list[tuple[float, float]]] = {}
        presence: dict[int, list[tuple[float, float]]] = {}
        self._settled_from: dict[int, float] = {}
        for constraint in constraints:
            if isinstance(constraint, Departure):
                departures.setdefault(constraint.edge, []).append((constraint.begin, constraint.end))
            elif isinstance(constraint, Presence):
                presence.setdefault(constraint.vertex, []).append((constraint.begin, constraint.end))
            else:
                self._settled_from[constraint.vertex] = max(self._earliest_arrival(constraint.vertex), constraint.time)
        self._departures = {edge: _gaps(spans) for edge, spans in departures.items()}
        self._safe = {vertex: _gaps(spans) for vertex, spans in presence.items()}

    def safe(self, vertex: int) -> list[tuple[float, float]]:
        """Time intervals in which the arm may be at a vertex."""
        return self._safe.get(vertex, _ALWAYS)

    def _earliest_arrival(self, goal: int) -> float:
        """Earliest final arrival at a goal [s]."""
        return self._settled_from.get(goal, 0.0)

    def run(self, goes_on: Callable[[], bool]) -> list[Move] | None:
        """A*: best first, by a lower bound of the time of arrival at a goal."""
        first = self._first_state()
        if first is None:
            return None
        numbers = count()
        queue = [(self._bound(first), next(numbers), first)]
        done: set[tuple[int, int, bool]] = set()
        while queue and goes_on():
            _, _, state = heappop(queue)
            key = state.vertex, state.interval, state.settled
            if key in done:
                continue
            done.add(key)
            if state.settled:
                return _moves(state)
            for new in self._successors(state):
                if (new.vertex, new.interval, new.settled) not in done:
                    heappush(queue, (self._bound(new), next(numbers), new))
        return None

    def _first_state(self) -> _State | None:
        roadmap = self.roadmap
        intervals = self.safe(roadmap.start)
        at_start = [i for i, (low, high) in enumerate(intervals) if low <= 0.0 < high]
        if not at_start:
            return None
        start = roadmap.start
        may_stay = start in roadmap.goals and math.isinf(intervals[at_start[0]][1])
        return _State(0.0, start, at_start[0], may_stay and self._earliest_arrival(start) <= 0.0, None, 0.0)

    def _bound(self, state: _State) -> float:
        return state.time + (0.0 if state.settled else float(self.roadmap.to_goal[state.vertex]))

    def _successors(self, state: _State) -> Iterator[_State]:
        """The earliest arrival in each interval of each neighbor; at a goal, one to stay and one to leave again."""
        roadmap = self.roadmap
        leave_by = self.safe(state.vertex)[state.interval][1]
        for other in roadmap.neighbors[state.vertex]:
            duration = roadmap.duration(state.vertex, other)
            if math.isinf(duration) or math.isinf(roadmap.to_goal[other]):
                continue
            allowed = self._departures.get((state.vertex, other), _ALWAYS)
            for interval, (low, high) in enumerate(self.safe(other)):
                may_stay = other in roadmap.goals and math.isinf(high)
                for stays in (False, True) if may_stay else (False,):
                    earliest = max(state.time, low - duration)
                    if stays:
                        earliest = max(earliest, self._earliest_arrival(other) - duration)
                    departure = _first(allowed, earliest, min(leave_by, high - duration))
                    if departure is not None:
                        yield _State(departure + duration, other, interval, stays, state, departure)


def _gaps(spans: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """The intervals between some spans."""
    begins, ends = np.array(spans).T
    return safe_intervals(begins, ends)


def _first(allowed: list[tuple[float, float]], earliest: float, before: float) -> float | None:
    """The first allowed time at or after `earliest`; None if it is not before `before`."""
    for low, high in allowed:
        time = max(low, earliest)
        if time < high:
            return time if time < before else None
    return None


def _moves(state: _State) -> list[Move]:
    moves: list[Move] = []
    while state.before is not None:
        moves.append(Move(state.before.vertex, state.vertex, state.departure, state.time))
        state = state.before
    return moves[::-1]
