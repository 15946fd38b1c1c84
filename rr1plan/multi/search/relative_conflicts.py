"""When two arms on roadmaps conflict: intervals of relative departure times, exact by certified diagrams."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rr1plan.checks import Array
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.timing.coordination import Blocked, coordination_diagram

# Intervals are extended by this at both ends, far above the rounding of times; conflicts that are shorter are none [s].
_ROUNDING, _SHORTEST = 1e-7, 1e-8


class Action(NamedTuple):
    """A motion along a whole path from rest to rest, or rest at the place of a path of no length.

    Args:
        path: The path.
        begin: When it begins [s].
        end: When it ends [s]; inf for rest at the goal.
    """

    path: AgentPath
    begin: float
    end: float

    @property
    def moves(self) -> bool:
        """Whether it is a motion rather than a rest."""
        return self.path.segments > 0


class Conflict(NamedTuple):
    """A conflict of two actions.

    Args:
        begin: When it begins, at the earliest [s].
        end: When it ends, at the latest [s].
        low: The interval of relative times in which it is, see `RelativeConflicts.intervals` [s].
        high: Its other end [s].
    """

    begin: float
    end: float
    low: float
    high: float


class RelativeConflicts:
    """Conflicts between the paths of agents, each pair computed once.

    Args:
        margin: Distance that agents keep from each other, beyond the padding [m].
    """

    def __init__(self, margin: float) -> None:
        self._margin = margin
        self._known: dict[tuple[AgentPath, AgentPath], list[tuple[float, float]]] = {}

    def intervals(self, one: AgentPath, two: AgentPath) -> list[tuple[float, float]]:
        """Disjoint intervals of departure times of `one` minus those of `two` with a conflict [s].

        Where one of them rests, the interval is that of times of rest minus departure of the motion (or of departure
        minus rest, if `two` rests); where both do, all times or none.
        """
        if (one, two) not in self._known:
            blocked = coordination_diagram(one, two, self._margin)
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
    """When each row of its diagrams is entered and left, from its departure on [s], shape (cells,) each.

    All times of rest are relative to the instant of rest itself, so they are zero.
    """
    if path.segments == 0:
        return np.zeros(path.cells), np.zeros(path.cells)
    times = path.hop_times(0, path.segments)
    enter = np.concatenate([times[:1], times])
    return enter, np.concatenate([times, times[-1:]])
