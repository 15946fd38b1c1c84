"""A running plan of many arms: the motion of each arm, in parts of one path each.

All data are stored by arm: the path of a meta-agent is projected to each of its arms, with the same times.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, Value, counted, finite_number, known_name, number_from_zero, of_kind
from rr1plan.errors import InputError
from rr1plan.multi.execution.route import Route, RouteSteps, passed_gridpoints, route_of
from rr1plan.multi.execution.route_motion import RouteMotion, gentler
from rr1plan.multi.execution.separated_schedules import schedules_of_arms
from rr1plan.multi.many_arms_result import ManyArmsResult
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.preflight import MARGINS
from rr1plan.multi.timing.schedule import Occupancy, Schedule, rest_row
from rr1plan.scene import Scene
from rr1plan.trajectory import Trajectory

# Far above the rounding of configurations [rad or m].
_ROUNDING = 1e-9
# Slower than this is rest [rad/s or m/s].
_REST = 1e-9
# Far above the rounding of times [s].
_SAME_TIME = 1e-9
_NEWTON_STEPS = 8
LATEST = 1e6
"""Largest time of a change or a delay; positions at later ones are rounded beyond the referee's tolerance [s]."""


@dataclass(frozen=True, eq=False)
class Part(Value):
    """An arm on one path for an interval of time.

    Args:
        path: The path.
        route: Its route, with the times of the steps.
        rows: The row of extended diagrams of each step, shape (n,).
        gridpoints: Gridpoint of the path at each gridpoint of the route, shape (m + 1,).
        begin: Start of the interval [s]; -inf for the first part.
        end: End of the interval [s]; inf for the last part.
    """

    path: AgentPath
    route: Route
    rows: NDArray[np.int64]
    gridpoints: NDArray[np.int64]
    begin: float
    end: float

    @property
    def occupancy(self) -> Occupancy:
        """The rows of extended diagrams that it occupies from `begin` to `end`."""
        enter, leave = self.route.steps.times.copy(), self.route.steps.leave_times
        enter[0], leave[-1] = -np.inf, np.inf
        enter, leave = np.maximum(enter, self.begin), np.minimum(leave, self.end)
        kept = leave > enter
        if not kept.any():  # the part is left as soon as it is reached
            kept = np.arange(len(enter)) == int(np.searchsorted(enter, self.end, side="right")) - 1
            leave = np.maximum(leave, enter)
        return Occupancy(self.rows[kept], enter[kept], leave[kept])

    @property
    def passed_steps(self) -> int:
        """Number of steps of its route that it passes; the last one is rest."""
        steps = self.route.steps
        return int(np.flatnonzero(steps.is_rest & (steps.times <= self.end + _SAME_TIME))[-1]) + 1

    def until(self, time: float) -> Part:
        """The part, left for another path at a time [s]."""
        return replace(self, end=min(self.end, time))

    def shifted(self, time: float) -> Part:
        """The part with its motion delayed by a time [s], on this path from that time on."""
        steps = self.route.steps
        later = replace(self.route, steps=RouteSteps(steps.begins, steps.ends, steps.times + time))
        return replace(self, route=later, begin=time)


def part_of(schedule: Schedule, begin: float) -> Part:
    """The part of an arm that follows a schedule from some time on, without end."""
    return Part(schedule.path, route_of(schedule), schedule.occupancy.rows, passed_gridpoints(schedule), begin, np.inf)


@dataclass(frozen=True, eq=False)
class RunningPlan(Value):
    """A plan that can be changed while it runs, see `rr1plan.add_motion`.

    Args:
        scene: The scene.
        trajectory: All arms of the plan on one clock.
        parts: The parts of each arm, one path after the other.
        retiming: Its retiming, as in `plan_many_arms`, which added motions have too.
        torque_limits: Whether its motions, and added ones, also keep the joints' effort limits.
        margin: Distance that added motions keep in addition to the padding [m], as far as starts and goals allow.

    Raises:
        InputError: a margin below zero.
    """

    scene: Scene
    trajectory: Trajectory
    parts: Mapping[str, tuple[Part, ...]]
    retiming: str = "blend"
    torque_limits: bool = False
    margin: float = MARGINS[0]

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", MappingProxyType(dict(self.parts)))
        object.__setattr__(self, "margin", number_from_zero("margin", self.margin))

    def __repr__(self) -> str:
        return f"RunningPlan({counted(len(self.parts), 'arm')}, {self.trajectory.end_time:.3f} s)"

    @staticmethod
    def of(result: ManyArmsResult) -> RunningPlan:
        """The plan that `plan_many_arms` found.

        Its margin is that of the problem, or 2 mm if the problem has none;
        `dataclasses.replace(plan, margin=...)` sets another one, such as that of `plan_many_arms(margin=...)`.

        Args:
            result: What `plan_many_arms` returned.

        Raises:
            InputError: it found none.
        """
        of_kind("result", result, ManyArmsResult)
        if result.trajectory is None:
            raise InputError(f"there is no plan to execute: {result.reason}")
        agent = result.schedules[0].path.agent
        schedules = result.separated.schedules
        parts = {arm: (part_of(own, -np.inf),) for s in schedules for arm, own in schedules_of_arms(s).items()}
        return RunningPlan(
            agent.problem.scene,
            result.trajectory,
            {arm: parts[arm] for arm in result.trajectory.arms},
            agent.timing.method,
            agent.timing.torque_limits,
            agent.problem.margin or MARGINS[0],
        )

    @property
    def arms(self) -> tuple[str, ...]:
        """All arms of the plan."""
        return tuple(self.parts)

    def configuration(self, arm: str, time: float) -> Array:
        """Configuration of an arm at a time [s], shape (nq,), clipped to its limits against rounding.

        Raises:
            UnknownNameError: the plan has no such arm.
        """
        return self._within_limits(arm, self._columns(arm, time, 0))

    def _within_limits(self, arm: str, q: Array) -> Array:
        limits = self.scene.arms[arm].robot.limits
        nearest = np.clip(q, limits.lower, limits.upper)
        return np.asarray(np.where(np.abs(nearest - q) < _ROUNDING, nearest, q))

    def velocity(self, arm: str, time: float) -> Array:
        """Joint velocities of an arm at a time [s], shape (nq,) [rad/s or m/s].

        Raises:
            UnknownNameError: the plan has no such arm.
        """
        return np.asarray(self._columns(arm, time, 1))

    def goal(self, arm: str) -> Array:
        """Final configuration of an arm, shape (nq,).

        Raises:
            UnknownNameError: the plan has no such arm.
        """
        known_name("arm", arm, self.parts)
        return np.asarray(self.parts[arm][-1].path.goal)

    def _columns(self, arm: str, time: float, derivative: int) -> Array:
        known_name("arm", arm, self.parts)
        names = self.trajectory.joint_names
        columns = [names.index(name) for name in self.scene.joint_names([arm])]
        return np.asarray(self.trajectory(finite_number("time", time), derivative)[columns])

    def part_at(self, arm: str, time: float) -> Part:
        """The part in which an arm is at a time [s]; where two meet, the later one."""
        return next(part for part in self.parts[arm] if time < part.end)

    def without_past(self, time: float) -> RunningPlan:
        """The plan from a time on, for plans that run without end: all before it is deleted.

        `add_motion` takes the result for times from there on, `plan_graph` does not take it, and `validate` reports
        that arms that move at that time do not begin at rest.

        Args:
            time: The time [s]; times before the beginning of the plan delete nothing.

        Raises:
            InputError: a time that is not a number, or later than 1e6 s.
        """
        time = max(finite_number("time", time), self.trajectory.start_time)
        if time > LATEST:
            raise InputError(f"time is {time:g}, expected up to {LATEST:g} s")
        trajectory = self.trajectory.cut(time, max(time, self.trajectory.end_time))
        parts = {arm: tuple(part for part in several if part.end > time) for arm, several in self.parts.items()}
        return replace(self, trajectory=trajectory, parts=parts)

    def with_parts(self, changed: Mapping[str, tuple[Part, ...]], trajectory: Trajectory, now: float) -> RunningPlan:
        """The plan with other motions of some arms.

        Args:
            changed: Their parts, from before `now` on.
            trajectory: The motion of all arms.
            now: Paths that are over by then are kept without their collision tables [s].
        """
        parts = {**self.parts, **changed}
        for part in (part for several in parts.values() for part in several if part.end <= now):
            part.path.release()
            part.path.agent.release()
        return replace(self, trajectory=trajectory, parts=parts)


@dataclass(frozen=True)
class Stop:
    """A rest from which an arm can begin a new motion.

    Args:
        time: Start of the rest [s].
        q: Its configuration, shape (nq,).
        before: Its part until that time.
        braking: Its motion from now until the stop; None if it rests already.
    """

    time: float
    q: Array
    before: Part
    braking: Trajectory | None


def stops_of(plan: RunningPlan, arm: str, now: float) -> list[Stop]:
    """The stops of an arm, earliest first: its rest, or the first gridpoint, a later one, and the planned stop.

    Braking keeps velocity and acceleration limits only, so with jerk or torque limits the planned stop is the only one.
    """
    part = plan.part_at(arm, now)
    q, rates = plan.configuration(arm, now), plan.velocity(arm, now)
    if np.abs(rates).max(initial=0.0) <= _REST:
        return [Stop(now, q, _left_at_rest(part, now), None)]
    route, steps = part.route, part.route.steps
    step = int(np.searchsorted(steps.times, now, side="right")) - 1
    while steps.is_rest[step] and step > 0:
        step -= 1  # rounding: a moving arm is on a segment
    segment = int(steps.begins[step])
    planned = min(stop for stop in (*route.stops, *steps.begins[steps.is_rest].tolist()) if stop > segment)
    found = []
    if not plan.torque_limits and plan.retiming != "ruckig":
        share, x = _state_on(route, segment, q, rates)
        limits = gentler(part.path.agent.limits)
        moving = RouteMotion.moving(route, limits, now, segment, share, x)
        moving.limit = planned
        first = moving.first_stop()
        for gridpoint in dict.fromkeys([first, (2 * first + planned) // 3]):
            if gridpoint < planned:
                motion = RouteMotion.moving(route, limits, now, segment, share, x)
                motion.go_to(gridpoint, now)
                found.append(_stopped(part, motion, step, gridpoint))
    end = float(steps.times[steps.begins == planned][0])
    braking = plan.trajectory.cut(now, max(now, end)).select(arm)
    before = _cut(part, planned, steps.times, braking.end_time)
    return [*found, Stop(braking.end_time, plan.configuration(arm, braking.end_time), before, braking)]


def _left_at_rest(part: Part, now: float) -> Part:
    """The part of an arm that rests now, left now."""
    steps = part.route.steps
    step = int(np.searchsorted(steps.times, now, side="right")) - 1
    if steps.is_rest[step]:
        return part.until(now)
    # At an end of a segment, up to rounding: the planned rest there, or a corner at which every motion stops.
    begin, end = float(steps.times[step]), float(steps.times[step + 1])
    if end - now < now - begin:
        return _cut(part, int(steps.ends[step]), steps.times, now)
    if steps.is_rest[step - 1]:
        return part.until(now)
    return replace(_cut(part, int(steps.begins[step]), steps.times, begin), end=now)


def _state_on(route: Route, segment: int, q: Array, rates: Array) -> tuple[float, float]:
    """Distance of an arm along a segment [rad], and its squared path speed."""
    c = route.curve.coefficients[route.grid.piece[segment]]
    offset, delta = float(route.grid.offset[segment]), float(route.grid.delta[segment])
    s = offset + 0.5 * delta
    for _ in range(_NEWTON_STEPS):
        slope = c[1] + 2.0 * s * c[2]
        s += float(slope @ (q - c[0] - s * (c[1] + s * c[2])) / (slope @ slope))
    slope = c[1] + 2.0 * s * c[2]
    share = min(max(s - offset, 0.0), delta * (1.0 - 1e-9))
    return share, float((slope @ rates / (slope @ slope)) ** 2)


def _stopped(part: Part, motion: RouteMotion, step: int, gridpoint: int) -> Stop:
    """The end of a motion, and the part up to there."""
    trajectory = motion.trajectory()
    steps = part.route.steps
    times = np.where(np.arange(len(steps)) <= step, steps.times, motion.steps_entered())
    before = _cut(part, gridpoint, times, trajectory.end_time)
    return Stop(trajectory.end_time, before.route.gridpoints[-1], before, trajectory)


def _cut(part: Part, gridpoint: int, times: Array, end: float) -> Part:
    """A part that ends with rest at a gridpoint.

    Args:
        part: The part.
        gridpoint: The gridpoint of its route, not the first one.
        times: Times at which the arm enters its steps up to there [s], shape (n,).
        end: Time at which it stops there [s].
    """
    route, steps = part.route, part.route.steps
    kept = (steps.begins < gridpoint) & (steps.ends <= gridpoint)
    cut = replace(
        route,
        grid=route.grid.part(0, gridpoint),
        stops=(*(k for k in route.stops if k < gridpoint), gridpoint),
        steps=RouteSteps(
            np.append(steps.begins[kept], gridpoint),
            np.append(steps.ends[kept], gridpoint),
            np.append(times[kept], end),
        ),
    )
    rows = np.append(part.rows[kept], rest_row(part.path, int(part.gridpoints[gridpoint])))
    return Part(part.path, cut, rows, part.gridpoints[: gridpoint + 1], part.begin, end)
