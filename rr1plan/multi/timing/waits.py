"""Waits of arms for each other, and the timing of two arms in their coordination diagram."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.multi.timing.coordination import Blocked
from rr1plan.multi.timing.passing_order import agreed_diagram
from rr1plan.multi.timing.schedule import Leg, Occupancy, Schedule, gridpoints_of, rest_row, segments_of
from rr1plan.planning import Wait

# Advances by which an earlier leg is tested for conflicts: at least this [s], or shares of the wait.
_SOONEST, _SHARES = 1e-3, (0.02, 0.1, 0.3, 1.0)
_SHORTEST = 1e-6  # [s]


@dataclass(frozen=True, eq=False)
class PairTiming:
    """Two agents on their paths: blocked cells of their diagram, and their positions over time.

    Args:
        blocked: Cells that are not proven free, shape (m + 2, n + 2): start, segments and goal of both paths.
        lengths: Path length at each gridpoint of both paths [rad], shapes (m + 1,) and (n + 1,).
        undelayed: Times at which each of them would be at its gridpoints without waiting [s].
        times: Times of the plan [s], shape (k,).
        places: Positions of both at these times, as fractional gridpoint indices, shape (k, 2).
    """

    blocked: Blocked
    lengths: tuple[Array, Array]
    undelayed: tuple[Array, Array]
    times: Array
    places: Array


def pair_timing(one: Schedule, two: Schedule) -> PairTiming:
    """The timing of two agents in their coordination diagram.

    Args:
        one: Schedule of an agent.
        two: Schedule of another one of the same plan.
    """
    agreed = agreed_diagram(one, two)
    cells = one.path.cells, two.path.cells
    blocked = np.zeros(cells, np.uint8) if agreed is None else agreed[: cells[0], : cells[1]]
    tracks = [_track(schedule) for schedule in (one, two)]
    times = np.unique(np.concatenate([track[0] for track in tracks]))
    places = np.column_stack([np.interp(times, *track) for track in tracks])
    return PairTiming(
        blocked,
        (one.path.lengths, two.path.lengths),
        (one.path.hop_times(0, one.path.segments), two.path.hop_times(0, two.path.segments)),
        times,
        places,
    )


def undelayed(schedules: Sequence[Schedule]) -> dict[str, float]:
    """Duration of the path of each arm without waiting [s]."""
    return {arm: schedule.path.fastest for schedule in schedules for arm in schedule.arms}


def waits_of(schedules: Sequence[Schedule]) -> tuple[Wait, ...]:
    """All rests of arms before they arrive, and the arms for which they wait.

    An arm waits for another if it could not have continued a little earlier without entering a blocked cell of their
    coordination diagram. A rest without such a reason lists no arms.

    Args:
        schedules: The schedules of a plan, one for each agent.
    """
    diagrams: dict[tuple[Schedule, Schedule], Blocked | None] = {}
    waits = []
    for schedule in schedules:
        for began, leg, following in _rests(schedule):
            others = _in_the_way(schedule, began, leg, following, schedules, diagrams)
            waits += [Wait(arm, began, leg.departure, others) for arm in schedule.arms]
    return tuple(waits)


def _rests(schedule: Schedule) -> list[tuple[float, Leg, Leg | None]]:
    """Start of each rest before the arrival, the leg after it, and the one after that."""
    rests, now = [], 0.0
    for leg, following in pairwise((*schedule.legs, None)):
        assert leg is not None
        if leg.departure - now > _SHORTEST:
            rests.append((now, leg, following))
        now = leg.departure + schedule.leg_duration(leg)
    return rests


def _in_the_way(
    schedule: Schedule,
    began: float,
    leg: Leg,
    following: Leg | None,
    schedules: Sequence[Schedule],
    diagrams: dict[tuple[Schedule, Schedule], Blocked | None],
) -> tuple[str, ...]:
    """The arms with which an agent would conflict if it began a leg a little earlier, ordered by time of conflict."""
    wait = leg.departure - began
    for share in _SHARES:
        advance = min(wait, max(_SOONEST, share * wait))
        moved = _occupancy(schedule, leg, leg.departure - advance, following)
        found = []
        for other in schedules:
            if other is schedule:
                continue
            key = schedule, other
            if key not in diagrams:
                diagrams[key] = agreed_diagram(*key)
            table = diagrams[key]
            first = None if table is None else _first_conflict(table, moved, other.occupancy)
            if first is not None:
                found.append((first, other.arms))
        if found:
            return tuple(arm for _, arms in sorted(found, key=lambda entry: entry[0]) for arm in arms)
    return ()


def _occupancy(schedule: Schedule, leg: Leg, departure: float, following: Leg | None) -> Occupancy:
    """The rows that an agent occupies from a departure until it would leave the stop after that leg."""
    times = schedule.instants(leg) + (departure - leg.departure)
    rows = np.append(segments_of(leg) + 1, rest_row(schedule.path, leg.end))
    return Occupancy(rows, times, np.append(times[1:], np.inf if following is None else following.departure))


def _first_conflict(blocked: Blocked, one: Occupancy, two: Occupancy) -> float | None:
    """Time at which two agents are first in a blocked cell; None if they never are."""
    begin = np.maximum(one.enter[:, None], two.enter[None, :])
    end = np.minimum(one.leave[:, None], two.leave[None, :])
    met: NDArray[np.bool_] = (end - begin > 0.0) & (blocked[np.ix_(one.rows, two.rows)] != 0)
    return float(begin[met].min()) if met.any() else None


def _track(schedule: Schedule) -> tuple[Array, Array]:
    """Times and gridpoints of an agent."""
    times, places, now = [np.zeros(1)], [np.zeros(1)], 0.0
    for leg in schedule.legs:
        gridpoints = gridpoints_of(leg).astype(np.float64)
        if leg.departure > now:
            times.append(np.array([leg.departure]))
            places.append(gridpoints[:1])
        when = schedule.instants(leg)
        times.append(when[1:])
        places.append(gridpoints[1:])
        now = float(when[-1])
    return np.concatenate(times), np.concatenate(places)
