"""Executing a plan of many arms with delays: an agent that has to wait stops before the segment not yet released.

No agent relies on future events: it may go up to the first step for which it has to wait, and moves such that it can
stop there. When that step is released it continues, from its current speed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import count
from typing import TYPE_CHECKING, NamedTuple

from rr1plan.checks import Value, counted, items_of, known_name, number_from_zero, of_kind, shown
from rr1plan.errors import InputError
from rr1plan.multi.execution.route_motion import RouteMotion, slower
from rr1plan.multi.execution.running_plan import LATEST
from rr1plan.multi.execution.temporal_plan_graph import PlanGraph
from rr1plan.planning import Wait
from rr1plan.scene import Scene
from rr1plan.trajectory import Trajectory, of_joints

_SLOWEST = 1e6  # largest relative increase of durations


@dataclass(frozen=True, eq=False)
class ArmDelay(Value):
    """Delays of an arm. The arms of one agent move as one and are delayed together.

    Args:
        start: Delay of its start [s].
        slowdown: Relative increase of all durations: 0.3 is 30 %.
        pauses: Pairs of the time at which it begins to stop [s], and the time after that until it may continue [s].

    Raises:
        InputError: a number that is not finite or below zero, a time above 1e6 s, or a slowdown above 1e6.
    """

    start: float = 0.0
    slowdown: float = 0.0
    pauses: tuple[tuple[float, float], ...] = ()

    if TYPE_CHECKING:  # accepted types; the fields above have the stored ones

        def __init__(
            self, start: float = 0.0, slowdown: float = 0.0, pauses: Iterable[Iterable[float]] = ()
        ) -> None: ...

    def __post_init__(self) -> None:
        object.__setattr__(self, "start", _time("start", self.start))
        object.__setattr__(self, "slowdown", _up_to(_SLOWEST, "slowdown", self.slowdown))
        pairs = []
        for pair in items_of("pauses", self.pauses, "pairs of a time and a duration"):
            both = items_of("a pause", pair, "a time and a duration")
            if len(both) != 2:
                raise InputError(f"a pause has {counted(len(both), 'number')}, expected a time and a duration")
            pairs.append((_time("time of a pause", both[0]), _time("duration of a pause", both[1])))
        object.__setattr__(self, "pauses", tuple(sorted(pairs)))


def _time(name: str, value: object) -> float:
    """`value` as a time from 0 to `LATEST` [s]."""
    return _up_to(LATEST, name, value)


def _up_to(most: float, name: str, value: object) -> float:
    number = number_from_zero(name, value)
    if number > most:
        raise InputError(f"{name} is {number}, expected a number up to {most:g}")
    return number


@dataclass(frozen=True, eq=False)
class PlanExecution(Value):
    """The execution of a plan.

    Args:
        trajectory: All arms of the plan on one clock.
        graph: The plan graph with the times of this execution, whose `skew_tolerance` is that of this trajectory.
        waiting: Delay of each arm's arrival caused by others, without its own delays [s].
        waits: Rests of arms before they arrive, and the arms they let pass; for `rr1plan.timeline`.
    """

    trajectory: Trajectory
    graph: PlanGraph
    waiting: Mapping[str, float]
    waits: tuple[Wait, ...] = ()

    def __repr__(self) -> str:
        arm = max(self.waiting, key=self.waiting.__getitem__, default="")
        late = self.waiting.get(arm, 0.0)
        waiting = f", longest wait {late:.3f} s ({arm})" if late >= 0.0005 else ""
        return f"PlanExecution({counted(len(self.graph.arms), 'arm')}, {self.makespan:.3f} s{waiting})"

    @property
    def makespan(self) -> float:
        """Arrival time of the last arm [s]."""
        return self.trajectory.end_time


def execute_plan(
    graph: PlanGraph, scene: Scene, delays: Mapping[str, ArmDelay] | None = None, *, gap: float = 0.0
) -> PlanExecution:
    """The motion of all arms of a plan if some are delayed and all dependencies are kept.

    An agent moves as soon as its dependencies allow, so it may be earlier than planned if the plan contains a wait.
    It may also be later although no agent is delayed: it does not rely on the others being on time, so it brakes before
    a step that is not released yet, which the plan passes at full speed. Without dependencies an execution takes
    about 0.5 % longer than the plan at most, because of a reserve of speed.
    Executions keep velocity and acceleration limits only, so a plan that limits jerk or torques has none.

    Args:
        graph: The plan graph.
        scene: The scene of the plan; joint limits are those of its robots.
        delays: The delay of each arm that has one.
        gap: Time between a release and the continuation of the waiting agent [s]; without waiting for each other, arms
            may then start late by up to this (`graph.skew_tolerance` of the result).

    Raises:
        UnknownNameError: a delay of an arm that is not in the plan.
        InputError: joints that the scene does not have, a gap below zero or above 1e6 s, or a plan that limits jerk or
            torques.
    """
    of_kind("graph", graph, PlanGraph)
    if graph.torque_limits:
        raise InputError("the plan keeps torque limits, but executions do not; plan without torque_limits")
    if graph.retiming == "ruckig":
        raise InputError("the plan limits jerk, but executions do not; plan with retiming 'blend' or 'stop'")
    of_kind("scene", scene, Scene)
    gap = _time("gap", gap)
    given: dict[str, ArmDelay] = {}
    if delays is not None and not isinstance(delays, Mapping):
        raise InputError(f"delays is {shown(delays)}, expected a mapping from arm to ArmDelay")
    for name, delay in (delays or {}).items():
        of_kind(f"delay of {name!r}", delay, ArmDelay)
        given[known_name("arm", name, graph.arms)] = delay
    for route in graph.routes:
        if scene.joint_names(route.arms) != route.joint_names:
            raise InputError(f"the joints of {', '.join(route.arms)} are not those of the plan")
    agents = [_together([given[arm] for arm in route.arms if arm in given]) for route in graph.routes]
    return _Run(graph, scene, agents, gap).run()


def _together(delays: list[ArmDelay]) -> ArmDelay:
    """The delay of an agent: all delays of its arms."""
    return ArmDelay(
        max((d.start for d in delays), default=0.0),
        max((d.slowdown for d in delays), default=0.0),
        tuple(pause for d in delays for pause in d.pauses),
    )


class _Event(NamedTuple):
    """An event that changes the gridpoint up to which an agent may go.

    Args:
        time: Time [s].
        number: Order of events at the same time.
        agent: The agent.
        pause: Time before which it does not continue [s]; no pause if not after `time`.
        dependency: The released dependency; -1 for none.
    """

    time: float
    number: int
    agent: int
    pause: float
    dependency: int


class _Run:
    """One execution, event by event: an agent releases others, or begins or ends a pause."""

    def __init__(self, graph: PlanGraph, scene: Scene, delays: list[ArmDelay], gap: float) -> None:
        self.graph, self.scene, self.delays, self.gap = graph, scene, delays, gap
        self.motions = [
            RouteMotion(route, slower(scene.limits(route.arms), 1.0 + delay.slowdown))
            for route, delay in zip(graph.routes, delays, strict=True)
        ]
        dependencies = graph.dependencies
        # For each agent the dependencies for which it waits and those that it releases, each in the order of its route.
        self.waits = [
            sorted((d.node.step, k) for k, d in enumerate(dependencies) if d.node.agent == i)
            for i in range(len(graph.routes))
        ]
        self.causes = [
            sorted((d.after.step, k) for k, d in enumerate(dependencies) if d.after.agent == i)
            for i in range(len(graph.routes))
        ]
        self.released = [math.inf] * len(dependencies)
        self.paused_until = [0.0] * len(graph.routes)
        self.numbers = count()
        self.events: list[_Event] = []

    def run(self) -> PlanExecution:
        """All motions, event by event."""
        self._move()
        return self._execution()

    def _move(self) -> None:
        for i, delay in enumerate(self.delays):
            self.motions[i].pause(0.0, delay.start)
            self.motions[i].go_to(self._limit(i), 0.0)
            for at, seconds in delay.pauses:
                self._add(at, i, at + seconds)
                self._add(at + seconds, i)
        while True:
            time, agent, cause = self._next_cause()
            if self.events and self.events[0].time <= time:
                self._handle(heappop(self.events))
            elif cause >= 0:
                self.causes[agent].pop(0)
                self._add(time + self.gap, self.graph.dependencies[cause].node.agent, dependency=cause)
            else:
                break

    def _add(self, time: float, agent: int, pause: float = 0.0, dependency: int = -1) -> None:
        heappush(self.events, _Event(time, next(self.numbers), agent, pause, dependency))

    def _next_cause(self) -> tuple[float, int, int]:
        """The next event for which others wait: time, agent, and the released dependency; -1 if there is none."""
        first = (math.inf, -1, -1)
        for i, causes in enumerate(self.causes):
            if causes:
                step, k = causes[0]
                route, motion = self.graph.routes[i], self.motions[i]
                at = int(route.steps.begins[step])
                time = motion.pass_time(at) if route.steps.is_rest[step] else motion.leave_time(at)
                first = min(first, (time, i, k))
        return first if math.isfinite(first[0]) else (math.inf, -1, -1)

    def _limit(self, agent: int) -> int:
        """The gridpoint up to which an agent may go."""
        waits = self.waits[agent]
        while waits and math.isfinite(self.released[waits[0][1]]):
            waits.pop(0)
        route = self.graph.routes[agent]
        return int(route.steps.begins[waits[0][0]]) if waits else route.segments

    def _handle(self, event: _Event) -> None:
        motion = self.motions[event.agent]
        if event.dependency >= 0:
            self.released[event.dependency] = event.time
        if event.pause > event.time:
            self.paused_until[event.agent] = max(self.paused_until[event.agent], event.pause)
            motion.pause(event.time, self.paused_until[event.agent])
        elif event.time >= self.paused_until[event.agent]:
            limit = self._limit(event.agent)
            if limit > motion.limit:
                motion.go_to(limit, event.time)

    def _execution(self) -> PlanExecution:
        times, waiting = [], {}
        parts = [motion.trajectory() for motion in self.motions]
        for route, motion, delay in zip(self.graph.routes, self.motions, self.delays, strict=True):
            times.append(motion.steps_entered())
            # With its own delays: a pause costs more than its duration, because the arm brakes, or less near the end.
            alone = _Run(PlanGraph((route,), ()), self.scene, [delay], 0.0)
            alone._move()
            late = motion.pass_time(route.segments) - alone.motions[0].pass_time(route.segments)
            waiting.update(dict.fromkeys(route.arms, max(0.0, late) if route.segments > 0 else 0.0))
        trajectory = of_joints(Trajectory.merge(*parts), self.scene.joint_names(self.graph.arms))
        waits = tuple(wait for agent in range(len(parts)) for wait in self._waits(agent))
        return PlanExecution(trajectory, self.graph.with_times(times), waiting, waits)

    def _waits(self, agent: int) -> list[Wait]:
        """The rests of an agent's arms, with the arms whose dependencies were released meanwhile."""
        steps, found = self.graph.routes[agent].steps, []
        released = [
            (time, int(steps.begins[d.node.step]), d.after.arms)
            for d, time in zip(self.graph.dependencies, self.released, strict=True)
            if d.node.agent == agent
        ]
        for gridpoint, begin, end in self.motions[agent].rests():
            late = sorted((time, arms) for time, at, arms in released if at == gridpoint and time > begin)
            others = tuple(dict.fromkeys(arm for _, arms in late for arm in arms))
            found += [Wait(arm, begin, end, others) for arm in self.graph.routes[agent].arms]
        return found
