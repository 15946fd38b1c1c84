"""The earliest motion of one arm on its roadmap under constraints: safe-interval path planning.

A state is a vertex and an interval of time in which the arm may be there; of all motions that reach a state only the
earliest counts (Phillips and Likhachev 2011). Motions on edges last as long as the dynamics of the arm demand.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from heapq import heappop, heappush
from itertools import count
from typing import NamedTuple

import numpy as np

from rr1plan.multi.search.arm_roadmap import ArmRoadmap
from rr1plan.multi.timing.safe_intervals import safe_intervals

_ALWAYS = [(-math.inf, math.inf)]


class Departure(NamedTuple):
    """An edge on which a motion must not begin at some times.

    Args:
        edge: Its vertices.
        begin: From this time on [s].
        end: Until this time [s].
    """

    edge: tuple[int, int]
    begin: float
    end: float


class Presence(NamedTuple):
    """A vertex at which an arm must not be at some times, not for an instant.

    Args:
        vertex: The vertex.
        begin: From this time on [s].
        end: Until this time [s].
    """

    vertex: int
    begin: float
    end: float


class Settling(NamedTuple):
    """An arm must not have come to its goal for good before a time.

    Args:
        time: The time [s].
    """

    time: float


Constraint = Departure | Presence | Settling


class Move(NamedTuple):
    """A motion on an edge.

    Args:
        begin: Vertex.
        end: Vertex.
        departure: When it begins [s].
        arrival: When it ends [s].
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


def earliest_moves(roadmap: ArmRoadmap, constraints: Iterable[Constraint]) -> list[Move] | None:
    """The motion that comes to the goal for good first of all that keep some constraints; None if there is none.

    Args:
        roadmap: The roadmap.
        constraints: The constraints.
    """
    return _Search(roadmap, constraints).run()


class _Search:
    def __init__(self, roadmap: ArmRoadmap, constraints: Iterable[Constraint]) -> None:
        self.roadmap = roadmap
        departures: dict[tuple[int, int], list[tuple[float, float]]] = {}
        presence: dict[int, list[tuple[float, float]]] = {}
        self.settled_from = 0.0
        for constraint in constraints:
            if isinstance(constraint, Departure):
                departures.setdefault(constraint.edge, []).append((constraint.begin, constraint.end))
            elif isinstance(constraint, Presence):
                presence.setdefault(constraint.vertex, []).append((constraint.begin, constraint.end))
            else:
                self.settled_from = max(self.settled_from, constraint.time)
        self._departures = {edge: _gaps(spans) for edge, spans in departures.items()}
        self._safe = {vertex: _gaps(spans) for vertex, spans in presence.items()}

    def safe(self, vertex: int) -> list[tuple[float, float]]:
        """When the arm may be at a vertex."""
        return self._safe.get(vertex, _ALWAYS)

    def run(self) -> list[Move] | None:
        """Best first, by the time at which the arm may come to its goal."""
        first = self._first_state()
        if first is None:
            return None
        numbers = count()
        queue = [(self._bound(first), next(numbers), first)]
        done: set[tuple[int, int, bool]] = set()
        while queue:
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
        is_there = bool((roadmap.vertices[roadmap.start] == roadmap.vertices[roadmap.goal]).all())
        stays = is_there and self.settled_from <= 0.0 and math.isinf(intervals[at_start[0]][1])
        return _State(0.0, roadmap.start, at_start[0], stays, None, 0.0)

    def _bound(self, state: _State) -> float:
        return state.time + (0.0 if state.settled else float(self.roadmap.to_goal[state.vertex]))

    def _successors(self, state: _State) -> Iterator[_State]:
        """The earliest arrival in each interval of each neighbor; at the goal, to stay or to leave again."""
        roadmap = self.roadmap
        leave_by = self.safe(state.vertex)[state.interval][1]
        for other in roadmap.neighbors[state.vertex]:
            if math.isinf(roadmap.to_goal[other]):
                continue
            duration = roadmap.move(state.vertex, other).fastest
            allowed = self._departures.get((state.vertex, other), _ALWAYS)
            for interval, (low, high) in enumerate(self.safe(other)):
                may_stay = other == roadmap.goal and math.isinf(high)
                for stays in (False, True) if may_stay else (False,):
                    earliest = max(state.time, low - duration)
                    if stays:
                        earliest = max(earliest, self.settled_from - duration)
                    departure = _first(allowed, earliest, min(leave_by, high - duration))
                    if departure is not None:
                        yield _State(departure + duration, other, interval, stays, state, departure)


def _gaps(spans: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """The times between some spans."""
    begins, ends = np.array(spans).T
    return safe_intervals(begins, ends)


def _first(allowed: list[tuple[float, float]], earliest: float, before: float) -> float | None:
    """The first allowed time from `earliest` on, if it is before another."""
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
