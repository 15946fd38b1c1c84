"""Conflicts of two arms on roadmaps as intervals of relative departure times, from certified coordination diagrams."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rr1plan.checks import Array
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.multi.timing.coordination import Blocked, coordination_diagram

# Extension of intervals at both ends, far above the rounding of times, and longest conflict that is ignored [s].
_ROUNDING, _SHORTEST = 1e-7, 1e-8


class Action(NamedTuple):
    """A motion along a whole path from rest to rest, or rest at the configuration of a path of zero length.

    Args:
        path: The path.
        begin: Start time [s].
        end: End time [s]; inf for rest at the goal.
    """

    path: AgentPath
    begin: float
    end: float

    @property
    def moves(self) -> bool:
        """Whether it is a motion, not a rest."""
        return self.path.segments > 0


class Conflict(NamedTuple):
    """A conflict of two actions.

    Args:
        begin: Earliest time of the conflict [s].
        end: Latest time of the conflict [s].
        low: Lower end of its interval of relative times, see `RelativeConflicts.intervals` [s].
        high: Upper end of this interval [s].
    """

    begin: float
    end: float
    low: float
    high: float


class RelativeConflicts:
    """Conflicts between the paths of agents, each pair computed once.

    Args:
        margin: Distance that agents keep from each other, in addition to the padding [m].
        watch: Deadline, after which unknown pairs conflict at all relative times (default: none).
    """

    def __init__(self, margin: float, watch: Stopwatch | None = None) -> None:
        self._margin, self._stop = margin, (watch or Stopwatch(np.inf)).stop
        self._known: dict[tuple[AgentPath, AgentPath], list[tuple[float, float]]] = {}

    def intervals(self, one: AgentPath, two: AgentPath) -> list[tuple[float, float]]:
        """Disjoint intervals of relative times (departure of `one` minus departure of `two`) with a conflict [s].

        For an arm that rests, the time of rest takes the place of its departure. If both rest, they conflict always or
        never.
        """
        if (one, two) not in self._known:
            blocked = None if self._stop[0] else coordination_diagram(one, two, self._margin, self._stop)
            if self._stop[0]:
                return [(-np.inf, np.inf)]
            self._known[one, two] = [] if blocked is None else _intervals(one, two, blocked)
            self._known[two, one] = [(-high, -low) for low, high in reversed(self._known[one, two])]
        return self._known[one, two]

    def between(self, one: Action, two: Action) -> Conflict | None:
        """The first conflict of two actions, or None."""
        begin, end = max(one.begin, two.begin), min(one.end, two.end)
        if end - begin <= _SHORTEST:
            return None
        for low, high in self.intervals(one.path, two.path):
            if one.moves and two.moves:
                if low + _SHORTEST < one.begin - two.begin < high - _SHORTEST:
                    return Conflict(begin, end, low, high)
                continue
            first, last = begin, end
            if one.moves:
                first, last = max(begin, one.begin - high), min(end, one.begin - low)
            elif two.moves:
                first, last = max(begin, two.begin + low), min(end, two.begin + high)
            if last - first > _SHORTEST:
                return Conflict(first, last, low, high)
        return None


def _intervals(one: AgentPath, two: AgentPath, blocked: Blocked) -> list[tuple[float, float]]:
    enter_one, leave_one = _cell_times(one)
    enter_two, leave_two = _cell_times(two)
    k, m = np.nonzero(blocked)
    low, high = enter_two[m] - leave_one[k] - _ROUNDING, leave_two[m] - enter_one[k] + _ROUNDING
    merged: list[tuple[float, float]] = []
    for i in np.argsort(low, kind="stable").tolist():
        if merged and low[i] <= merged[-1][1]:
            merged[-1] = merged[-1][0], max(merged[-1][1], float(high[i]))
        else:
            merged.append((float(low[i]), float(high[i])))
    return merged


def _cell_times(path: AgentPath) -> tuple[Array, Array]:
    """Times since departure at which each row of its diagrams is entered and left [s], shape (cells,) each.

    Zero for a path of zero length: times of rest are relative to the instant of rest itself.
    """
    if path.segments == 0:
        return np.zeros(path.cells), np.zeros(path.cells)
    times = path.hop_times(0, path.segments)
    enter = np.concatenate([times[:1], times])
    return enter, np.concatenate([times, times[-1:]])
