"""One schedule for each arm of a plan, also for arms that a planner moved as one.

A composite path of several arms with one timing is a path and a timing for each arm: its columns, without the pieces on
which it rests, traversed at the same times, so that the motion does not change. Coordination diagrams then determine
the order in which the arms pass each other. Segments are initially as long as those of single arms and are cut where
arms pass each other too closely. Arms that still have no order remain together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.multi.agents import Agent
from rr1plan.multi.execution.route import Route, RouteSteps, route_of
from rr1plan.multi.paths.agent_path import segments_up_to
from rr1plan.multi.paths.projected_path import ProjectedPath
from rr1plan.multi.timing.coordination import Blocked
from rr1plan.multi.timing.passing_order import (
    SIMULTANEOUS,
    Precedence,
    agreed_diagram,
    cell_gaps,
    first_order,
    order_between,
    passage,
    shared_cells,
    simultaneous_cells,
)
from rr1plan.multi.timing.schedule import Leg, Schedule
from rr1plan.object_cache import kept_in
from rr1plan.retiming.path_blends import Curve
from rr1plan.retiming.path_speed import Grid
from rr1plan.trajectory import Trajectory, of_joints

# An arm that moves no farther than this on a piece of a path rests there, in the norm of its joints [rad].
_STILL = 1e-9
# Number of rounds of cutting, parts per cut, and largest number of segments: finer cells would take too long.
_CUTS, _PARTS, _MOST_SEGMENTS = 5, 4, 800
_NEWTON_STEPS = 8


@dataclass(frozen=True, eq=False)
class ProjectedSchedule(Schedule):
    """The motion of some arms of an agent that moves more arms as one.

    Args:
        path: Their path, unrolled: if the agent goes back, the same segments follow again in reverse.
        legs: The motions in order.
        times: Times of each leg at its gridpoints [s].
        motion: The motion.
    """

    times: tuple[Array, ...]
    motion: Trajectory

    def instants(self, leg: Leg) -> Array:
        """Times of a leg at its gridpoints [s]."""
        return self.times[self.legs.index(leg)]

    def leg_duration(self, leg: Leg) -> float:
        """Duration of a leg [s]."""
        return float(self.instants(leg)[-1] - leg.departure)

    def trajectory(self) -> Trajectory:
        """The motion on the clock of the schedule."""
        return self.motion


@dataclass(frozen=True)
class SeparatedSchedules:
    """The schedules of a plan, of one arm each if diagrams certify an order of the arms.

    Args:
        schedules: The schedules.
    """

    schedules: tuple[Schedule, ...]
    _diagrams: dict[tuple[int, int], Blocked | None] = field(default_factory=dict, repr=False, compare=False)

    def diagram(self, one: int, two: int) -> Blocked | None:
        """The diagram of two schedules, see `agreed_diagram`; computed on first use.

        Args:
            one: Index of a schedule.
            two: Index of a later one.
        """
        pair = self.schedules[one], self.schedules[two]
        return kept_in(self._diagrams, (one, two), lambda: agreed_diagram(*pair))


def separate(schedules: Sequence[Schedule]) -> SeparatedSchedules:
    """Give each arm of a plan its own schedule if an order of the arms is certified, without changing any motion.

    Args:
        schedules: The schedules of a plan, one for each agent.
    """
    found: list[Schedule] = []
    agents: list[range] = []
    for schedule in schedules:
        first = len(found)
        found += _separated(schedule)
        agents.append(range(first, len(found)))
    for k, cut in _ordered(found, agents).items():
        found[k] = cut
    return SeparatedSchedules(tuple(found))


def _ordered(schedules: Sequence[Schedule], agents: Sequence[range]) -> dict[int, Schedule]:
    """Schedules with shorter segments, for those without an order with a schedule of another agent.

    The segments of single arms are longer than those of the composite path, which has been certified.

    Args:
        schedules: Schedules of arms, or of arms that remain together.
        agents: Ranges of indices of schedules from the same agent.
    """
    unordered: dict[int, None] = {}
    for one, two in combinations(agents, 2):
        # Two agents with one schedule each were scheduled against each other, so they have an order.
        for i, j in product(one, two) if max(len(one), len(two)) > 1 else ():
            blocked = simultaneous_cells(schedules[i], schedules[j], 0.0)
            if blocked is not None and order_between(blocked, schedules[i], schedules[j]) is None:
                unordered.update({i: None, j: None})
    wholes = [_JointMotion(schedules[k], route_of(schedules[k]), schedules[k].trajectory()) for k in unordered]
    parts = _cut_where_simultaneous([whole.projected(whole.schedule.arms) for whole in wholes])
    return {k: part.schedule for k, part in zip(unordered, parts, strict=True)}


def schedules_of_arms(schedule: Schedule) -> dict[str, Schedule]:
    """The motion of each arm of an agent separately, whether or not there is an order among them.

    Args:
        schedule: The agent's schedule.
    """
    if len(schedule.arms) == 1:
        return {schedule.arms[0]: schedule}
    whole = _JointMotion(schedule, route_of(schedule), schedule.trajectory())
    return {arm: whole.merged((arm,)).projected((arm,)).schedule for arm in schedule.arms}


def _separated(schedule: Schedule) -> list[Schedule]:
    """The schedules of an agent's arms, or of arms that have to remain together."""
    if len(schedule.arms) == 1:
        return [schedule]
    whole = _JointMotion(schedule, route_of(schedule), schedule.trajectory())
    parts = _cut_where_simultaneous([whole.merged((arm,)).projected((arm,)) for arm in schedule.arms])
    while len(parts) > 1:
        circle = _circle(parts)
        if not circle:
            return [part.schedule for part in parts]
        arms = {arm for k in circle for arm in parts[k].schedule.arms}
        parts = [part for k, part in enumerate(parts) if k not in circle]
        parts.append(whole.projected(tuple(arm for arm in schedule.arms if arm in arms)))
    return [schedule]


def _circle(parts: Sequence[_Projection]) -> list[int]:
    """Parts without an order among them; none if all are ordered."""
    precedences: list[Precedence] = []
    for i, j in combinations(range(len(parts)), 2):
        # Simultaneous events decide whether parts wait for each other in a cycle.
        found = first_order(parts[i].schedule, parts[j].schedule, (i, j))
        if found is None:
            return [i, j]
        precedences += found
    return passage({k: len(part.segments) for k, part in enumerate(parts)}, precedences).circle


def _cut_where_simultaneous(parts: list[_Projection]) -> list[_Projection]:
    """Cut segments on which two arms pass each other without an order."""
    pairs = list(combinations(range(len(parts)), 2))
    for _ in range(_CUTS):
        without_order, tight = [], [[np.zeros(0, np.int64)] for _ in parts]
        for i, j in pairs:
            one, two = parts[i].schedule, parts[j].schedule
            blocked = simultaneous_cells(one, two, 0.0)
            if blocked is None or order_between(blocked, one, two) is not None:
                continue
            without_order.append((i, j))
            steps = np.nonzero(
                shared_cells(blocked, one, two) & (cell_gaps(one.occupancy, two.occupancy) <= SIMULTANEOUS)
            )
            for k, segments in zip((i, j), steps, strict=True):
                tight[k].append(parts[k].segments[segments])
        pairs = without_order
        cut = [part.cut(np.unique(np.concatenate(found))) for part, found in zip(parts, tight, strict=True)]
        if all(new is part for new, part in zip(cut, parts, strict=True)):
            break
        parts = cut
    return parts


@dataclass(frozen=True)
class _Projection:
    """The motion of some arms of an agent.

    Args:
        schedule: The motion.
        segments: Segment of the composite route for each step; -1 for rest.
        whole: The composite motion with these segments.
    """

    schedule: Schedule
    segments: NDArray[np.int64]
    whole: _JointMotion

    def cut(self, segments: NDArray[np.int64]) -> _Projection:
        """The same motion with some segments of the composite route subdivided; -1 is ignored."""
        segments = segments[segments >= 0]
        count = self.whole.route.segments + (_PARTS - 1) * len(segments)
        if len(segments) == 0 or count > _MOST_SEGMENTS:
            return self
        return self.whole.cut(segments).projected(self.schedule.arms)


@dataclass(frozen=True)
class _JointMotion:
    """The motion of an agent of several arms.

    Args:
        schedule: Its schedule.
        route: Its route.
        motion: Its trajectory.
    """

    schedule: Schedule
    route: Route
    motion: Trajectory

    def merged(self, arms: tuple[str, ...]) -> _JointMotion:
        """The same motion with fewer segments, about as many as a path of some of its arms would have."""
        route, steps, agent = self.route, self.route.steps, self._agent(arms)
        slopes = np.abs(route.grid.first(route.curve, 0.5)[:, self._columns(agent)])
        moved = np.concatenate([[0.0], np.cumsum(slopes @ agent.reach * route.grid.delta)])
        if moved[-1] == 0.0:
            return self
        number = np.floor(segments_up_to(moved))
        kept = np.ones(len(moved), bool)
        kept[1:-1] = (number[2:] > number[1:-1]) | (np.diff(route.grid.piece) > 0)
        kept[steps.begins[steps.is_rest]] = True
        first, gridpoint = np.flatnonzero(kept[:-1]), np.cumsum(kept) - 1
        chosen = steps.is_rest | kept[steps.begins]
        begins, is_rest = gridpoint[steps.begins[chosen]], steps.is_rest[chosen]
        made = replace(
            route,
            grid=Grid(route.grid.piece[first], route.grid.offset[first], np.add.reduceat(route.grid.delta, first)),
            stops=tuple(gridpoint[list(route.stops)].tolist()),
            steps=RouteSteps(begins, begins + ~is_rest, steps.times[chosen]),
        )
        return replace(self, route=made)

    def cut(self, segments: NDArray[np.int64]) -> _JointMotion:
        """The same motion with some segments subdivided into parts of equal duration."""
        route, steps = self.route, self.route.steps
        piece, offset, delta = route.grid
        step = np.flatnonzero(np.isin(steps.begins, segments) & ~steps.is_rest).repeat(_PARTS - 1)
        number = np.tile(np.arange(1, _PARTS), len(segments))
        at = steps.begins[step]
        times = steps.times[step] + number / _PARTS * (steps.leave_times[step] - steps.times[step])
        names = self.motion.joint_names
        q = self.motion(times)[:, [names.index(name) for name in route.joint_names]]
        ends = offset[at] + _distances(route, at, q)
        # Start and end of the parts on their pieces; new gridpoints come after the start of a segment.
        begin, end = np.insert(offset, at + 1, ends), np.insert(offset + delta, at, ends)
        moved = np.arange(len(piece) + 1) + np.bincount(at + 1, minlength=len(piece) + 1).cumsum()
        begins = np.insert(moved[steps.begins], step + 1, moved[at] + number)
        is_rest = np.insert(steps.is_rest, step + 1, False)
        made = replace(
            route,
            grid=Grid(np.insert(piece, at, piece[at]), begin, end - begin),
            stops=tuple(moved[list(route.stops)].tolist()),
            steps=RouteSteps(begins, begins + ~is_rest, np.insert(steps.times, step + 1, times)),
        )
        return replace(self, route=made)

    def projected(self, arms: tuple[str, ...]) -> _Projection:
        """The motion of some of its arms."""
        route, steps, whole, agent = self.route, self.route.steps, self.schedule.path, self._agent(arms)
        columns = self._columns(agent)
        coefficients = route.curve.coefficients[:, :, columns]
        moves = _lengths(route.curve.lengths, coefficients) > _STILL
        kept = moves[route.grid.piece]
        gridpoint = np.concatenate([[0], np.cumsum(kept)])
        legs: list[Leg] = []
        times: list[Array] = []
        segments = [np.array([-1])]
        is_motion = np.append(kept, False)[steps.begins] & ~steps.is_rest
        edges = np.flatnonzero(np.diff(np.pad(is_motion.astype(np.int8), 1)))
        for first, behind in edges.reshape(-1, 2).tolist():
            enter = steps.times[first : behind + 1]
            begin, end = steps.begins[first], steps.ends[behind - 1]
            legs.append(Leg(float(enter[0]), int(gridpoint[begin]), int(gridpoint[end])))
            times.append(enter)
            segments += [np.arange(begin, end), np.array([-1])]
        inner = {int(gridpoint[k]) for k in route.stops} | {leg.begin for leg in legs}
        halts = tuple(sorted(inner - {0, int(gridpoint[-1])}))
        ends = np.stack([whole.at(0), whole.at(whole.segments if self.schedule.legs else 0)])[:, columns]
        path = ProjectedPath(agent, *_curve(route, coefficients, moves, halts), halts, ends)
        motion = of_joints(self.motion, agent.joint_names)
        schedule = ProjectedSchedule(path, tuple(legs), tuple(times), motion)
        return _Projection(schedule, np.concatenate(segments).astype(np.int64), self)

    def _agent(self, arms: tuple[str, ...]) -> Agent:
        whole = self.schedule.path.agent
        return Agent(whole.problem, arms, whole.timing)

    def _columns(self, agent: Agent) -> list[int]:
        return [self.route.joint_names.index(name) for name in agent.joint_names]


def _distances(route: Route, segments: NDArray[np.int64], q: Array) -> Array:
    """Distances of configurations (n, nq) along segments of a route [rad], shape (n,)."""
    offset = route.grid.offset[segments]
    c, s = route.curve.coefficients[route.grid.piece[segments]], offset + 0.5 * route.grid.delta[segments]
    for _ in range(_NEWTON_STEPS):
        at = s[:, None]
        slope = c[:, 1] + 2.0 * at * c[:, 2]
        missing = q - (c[:, 0] + at * (c[:, 1] + at * c[:, 2]))
        s = s + (slope * missing).sum(axis=1) / (slope * slope).sum(axis=1)
    return np.asarray(s - offset)


def _curve(route: Route, coefficients: Array, moves: NDArray[np.bool_], halts: tuple[int, ...]) -> tuple[Curve, Grid]:
    """The pieces of a route on which some arms move, with a parameter close to the length of the arms' path.

    Between two halts the parameter is that of the route times a constant, so that the curve remains smooth.

    Args:
        route: The route.
        coefficients: The pieces in the columns of these arms, shape (k, 3, nq).
        moves: Pieces on which these arms move, shape (k,).
        halts: Gridpoints of the arms' path at which they stop.
    """
    kept = moves[route.grid.piece]
    piece = (np.cumsum(moves) - 1)[route.grid.piece[kept]]
    run = np.searchsorted(halts, np.searchsorted(piece, np.arange(moves.sum())), side="right")
    lengths, c = route.curve.lengths[moves], coefficients[moves]
    scale = (np.bincount(run, _lengths(lengths, c)) / np.maximum(np.bincount(run, lengths), 1e-300))[run]
    powers = np.stack([np.ones_like(scale), scale, scale * scale], axis=1)
    factor = scale[piece]
    grid = Grid(piece, route.grid.offset[kept] * factor, route.grid.delta[kept] * factor)
    return Curve(lengths * scale, c / powers[:, :, None], (0, 0)), grid


def _lengths(lengths: Array, coefficients: Array) -> Array:
    """Approximate lengths of pieces of a curve with any parameter, by Simpson's rule [rad], shape (k,)."""
    speeds = [
        np.linalg.norm(coefficients[:, 1] + 2.0 * share * lengths[:, None] * coefficients[:, 2], axis=1)
        for share in (0.0, 0.5, 1.0)
    ]
    return np.asarray(lengths * (speeds[0] + 4.0 * speeds[1] + speeds[2]) / 6.0)
