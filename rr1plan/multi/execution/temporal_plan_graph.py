"""The temporal plan graph of many arms: who has to wait for whom, so that a plan remains safe under any delays.

    graph = plan_graph(plan_many_arms(problem))

A node is the instant at which an agent enters a step of its route. It has two kinds of predecessors: the previous step
on the same route, and, if a cell of the coordination diagram of two agents is not proven free, the instant at which the
other agent has left its part of the cell (Hönig et al., Multi-agent path finding with kinematic constraints, 2016).
Cells are certified for any speed within them, so agents that enter their steps in an order allowed by the graph never
touch, in continuous time, however long each step takes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rr1plan.checks import Array, Value, check_callback, counted, known_name, listed, of_kind
from rr1plan.collision.arm_groups import arms_in_reach
from rr1plan.errors import FormatError, InputError
from rr1plan.multi.execution.route import Route, RouteSteps, route_of
from rr1plan.multi.execution.running_plan import RunningPlan
from rr1plan.multi.execution.running_routes import running_order, running_route
from rr1plan.multi.many_arms_result import ManyArmsResult
from rr1plan.multi.paths.hop_timing import HopTiming
from rr1plan.multi.paths.path_memory import PathMemory
from rr1plan.multi.preflight import MARGINS
from rr1plan.multi.timing.passing_order import Precedence, Step, order_between, passage
from rr1plan.progress import ProgressCallback, fraction_callback, step_callback
from rr1plan.progress_bar import library_bar
from rr1plan.retiming.path_blends import Curve
from rr1plan.retiming.path_speed import Grid
from rr1plan.scene import Scene

# Rounding error of times, subtracted from tolerances [s].
_ROUNDING = 1e-9


class Node(NamedTuple):
    """An agent enters a step of its route.

    Args:
        agent: Its index.
        step: The step.
        arms: The agent's arms.
        time: Time at which the plan enters it [s].
    """

    agent: int
    step: int
    arms: tuple[str, ...]
    time: float


class Dependency(NamedTuple):
    """One agent waits for another.

    Args:
        node: The waiting node.
        after: The node that has to happen first, at which the other agent has left the blocked cell.
    """

    node: Node
    after: Node

    def __str__(self) -> str:
        waits, first = listed(self.node.arms), listed(self.after.arms)
        do, its = ("does", "its") if len(self.node.arms) == 1 else ("do", "their")
        have, their = ("has", "its") if len(self.after.arms) == 1 else ("have", "their")
        return (
            f"{waits} {do} not go beyond {its} planned position at {self.node.time:.3f} s "
            f"before {first} {have} reached {their} planned position at {self.after.time:.3f} s"
        )


@dataclass(frozen=True, eq=False)
class PlanGraph(Value):
    """Routes of all agents, and the order in which they have to pass each other.

    Args:
        routes: The route of each agent: an arm, or a few arms that move as one.
        dependencies: Who waits for whom, without transitively implied dependencies.
        retiming: Retiming of the plan, as in `plan_many_arms`.
        torque_limits: Whether the plan keeps the joints' effort limits.

    Raises:
        InputError: an arm of two agents, dependencies on nonexistent steps or in a cycle, or a retiming that leaves the
            paths.
        UnknownNameError: no such retiming.
    """

    routes: tuple[Route, ...]
    dependencies: tuple[Dependency, ...]
    retiming: str = "blend"
    torque_limits: bool = False

    def __post_init__(self) -> None:
        HopTiming(self.retiming, self.torque_limits)
        arms = [arm for route in self.routes for arm in route.arms]
        if len(set(arms)) < len(arms):
            raise InputError("an arm is part of two agents of a plan graph")
        for node, after in self.dependencies:
            if node.agent == after.agent:
                raise InputError(f"{listed(node.arms)} waits for itself")
            if self.routes[node.agent].steps.is_rest[node.step]:
                raise InputError("a dependency keeps an agent from resting where it is; expected one on a segment")
        _check_acyclic(self.routes, self.dependencies)

    def __repr__(self) -> str:
        arms = sum(len(route.arms) for route in self.routes)
        steps = sum(len(route.steps) for route in self.routes)
        tolerance = f"skew_tolerance={self.skew_tolerance:.3g} s"
        needed = counted(len(self.dependencies), "dependency", "dependencies")
        return f"PlanGraph({counted(arms, 'arm')}, {counted(steps, 'step')}, {needed}, {tolerance})"

    @property
    def arms(self) -> tuple[str, ...]:
        """All arms."""
        return tuple(arm for route in self.routes for arm in route.arms)

    @cached_property
    def nodes(self) -> tuple[Node, ...]:
        """All nodes: each agent enters each step of its route except the first, at which it begins."""
        return tuple(
            Node(i, k, route.arms, float(route.steps.times[k]))
            for i, route in enumerate(self.routes)
            for k in range(1, len(route.steps))
        )

    @property
    def skew_tolerance(self) -> float:
        """Delay by which each arm may start late, without any waiting, such that no two arms touch [s].

        A certified lower bound; inf if no two arms come near each other, 0 if some move only as one.
        """
        if any(len(route.arms) > 1 and route.segments for route in self.routes):
            return 0.0
        gaps = (node.time - after.time for node, after in self.dependencies)
        return max(0.0, min(gaps, default=np.inf) - _ROUNDING)

    def with_times(self, times: Sequence[Array]) -> PlanGraph:
        """The same graph for another execution of the plan.

        Args:
            times: Times at which each agent enters each step of its route [s], shape (n,) each; the first is ignored.
        """
        routes = tuple(
            replace(route, steps=replace(route.steps, times=t)) for route, t in zip(self.routes, times, strict=True)
        )

        moved = (
            Dependency(_node(routes, node.agent, node.step), _node(routes, after.agent, after.step))
            for node, after in self.dependencies
        )
        return PlanGraph(routes, tuple(moved), self.retiming, self.torque_limits)

    def waits_for(self, arm: str) -> tuple[Dependency, ...]:
        """The dependencies for which an arm waits, in order.

        Raises:
            UnknownNameError: the plan has no such arm.
        """
        known_name("arm", arm, self.arms)
        found = [d for d in self.dependencies if arm in d.node.arms]
        return tuple(sorted(found, key=lambda d: d.node.step))

    def to_dict(self) -> dict[str, Any]:
        """The graph as plain values; `from_dict` reads it back."""
        return {
            "routes": [
                {
                    "joint_names": list(route.joint_names),
                    "start": route.start.tolist(),
                    "curve": {
                        "lengths": route.curve.lengths.tolist(),
                        "coefficients": route.curve.coefficients.tolist(),
                    },
                    "grid": {name: column.tolist() for name, column in route.grid._asdict().items()},
                    "stops": list(route.stops),
                    "steps": {
                        "begins": route.steps.begins.tolist(),
                        "ends": route.steps.ends.tolist(),
                        "times": route.steps.times[1:].tolist(),
                    },
                }
                for route in self.routes
            ],
            "dependencies": [
                {"agent": d.node.agent, "step": d.node.step, "after_agent": d.after.agent, "after_step": d.after.step}
                for d in self.dependencies
            ],
            "retiming": self.retiming,
            "torque_limits": self.torque_limits,
        }

    @staticmethod
    def from_dict(entries: Mapping[str, Any]) -> PlanGraph:
        """The graph from the result of `to_dict`; motion files check types and keys before (`export/motion_schema.py`).

        Args:
            entries: The entries, in lists and plain values.

        Raises:
            FormatError: content that is not a plan graph.
        """
        try:
            routes = tuple(
                Route(
                    tuple(r["joint_names"]),
                    _array(f"routes[{k}].start", r["start"]),
                    Curve(
                        _array(f"routes[{k}].curve.lengths", r["curve"]["lengths"]),
                        _array(f"routes[{k}].curve.coefficients", r["curve"]["coefficients"]),
                        (0, 0),
                    ),
                    Grid(
                        _array(f"routes[{k}].grid.piece", r["grid"]["piece"], np.int64),
                        _array(f"routes[{k}].grid.offset", r["grid"]["offset"]),
                        _array(f"routes[{k}].grid.delta", r["grid"]["delta"]),
                    ),
                    tuple(r["stops"]),
                    RouteSteps(
                        _array(f"routes[{k}].steps.begins", r["steps"]["begins"], np.int64),
                        _array(f"routes[{k}].steps.ends", r["steps"]["ends"], np.int64),
                        _array(f"routes[{k}].steps.times", [0.0, *r["steps"]["times"]]),
                    ),
                )
                for k, r in enumerate(entries["routes"])
            )
            return PlanGraph(
                routes,
                tuple(
                    Dependency(_node(routes, d["agent"], d["step"]), _node(routes, d["after_agent"], d["after_step"]))
                    for d in entries["dependencies"]
                ),
                entries.get("retiming", "blend"),
                entries.get("torque_limits", False),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise FormatError(f"holds no plan graph: {error}") from error


def _array(place: str, values: ArrayLike, kind: type = np.float64) -> NDArray[Any]:
    try:
        return np.array(values, kind)
    except OverflowError as error:
        raise FormatError(f"{place} has a number of more than 64 bits") from error


def _node(routes: tuple[Route, ...], agent: int, step: int) -> Node:
    if not (0 <= agent < len(routes) and 0 < step < len(routes[agent].steps)):
        raise InputError(f"a dependency names step {step} of agent {agent}, which is not there")
    return Node(agent, step, routes[agent].arms, float(routes[agent].steps.times[step]))


def plan_graph(plan: ManyArmsResult | RunningPlan, *, progress: ProgressCallback | None = None) -> PlanGraph:
    """The temporal plan graph of a plan, from its beginning.

    Args:
        plan: A result of `plan_many_arms`, or a plan with new goals from `add_motion`.
        progress: Called with the progress in the stage "plan_graph"; False cancels. Without it, a terminal shows a bar.

    Raises:
        InputError: no plan, one without its past, or one whose agents are not proven free of contact.
        CancelledError: `progress` returned False.
    """
    check_callback("progress", progress)
    with library_bar("plan graph") as advance:
        return _graph(plan, fraction_callback("plan_graph", progress) or advance)


def _graph(plan: ManyArmsResult | RunningPlan, advance: Callable[[float], None]) -> PlanGraph:
    advance(0.0)
    routes, timing, scene, order_of = _orders_of_running(plan) if isinstance(plan, RunningPlan) else _orders_of(plan)
    pairs = pairs_in_reach(scene, [route.arms for route in routes])
    found: list[Precedence] = []
    for done, (i, j) in enumerate(pairs):
        advance(done / len(pairs))
        order = order_of(i, j, step_callback(advance, done, len(pairs)))
        if order is None:
            names = listed((*routes[i].arms, *routes[j].arms))
            raise InputError(f"no order in which {names} pass each other is certified")
        found += order
    kept = (Dependency(_node(routes, *node), _node(routes, *after)) for node, after in _reduced(routes, found))
    return PlanGraph(routes, tuple(kept), timing.method, timing.torque_limits)


_Order = Callable[[int, int, Callable[[float], None]], list[Precedence] | None]


def _orders_of(plan: ManyArmsResult) -> tuple[tuple[Route, ...], HopTiming, Scene, _Order]:
    """The routes of a result, their timing and scene, and the order of two agents."""
    of_kind("plan", plan, ManyArmsResult)
    if not plan.found:
        raise InputError(f"there is no plan to make a graph of: {plan.reason}")
    schedules = plan.separated.schedules

    def order(i: int, j: int, _: Callable[[float], None]) -> list[Precedence] | None:
        blocked = plan.separated.diagram(i, j)
        return [] if blocked is None else order_between(blocked, schedules[i], schedules[j], (i, j))

    agent = schedules[0].path.agent
    return tuple(route_of(schedule) for schedule in schedules), agent.timing, agent.problem.scene, order


def _orders_of_running(plan: RunningPlan) -> tuple[tuple[Route, ...], HopTiming, Scene, _Order]:
    """The same for a running plan."""
    begin = plan.trajectory.start_time
    if begin > 0.0:
        raise InputError(
            f"plan has no motions before {begin:.3f} s (without_past), expected one from its beginning, where arms rest"
        )
    running, memory = [running_route(plan.parts[arm]) for arm in plan.arms], PathMemory()

    def order(i: int, j: int, advance: Callable[[float], None]) -> list[Precedence] | None:
        return running_order(running[i], running[j], (i, j), memory, advance)

    timing = HopTiming(plan.retiming, plan.torque_limits)
    return tuple(each.route for each in running), timing, plan.scene, order


def pairs_in_reach(scene: Scene, agents: Sequence[tuple[str, ...]]) -> list[tuple[int, int]]:
    """Indices of agents that can meet.

    Args:
        scene: The scene.
        agents: The arms of each agent.
    """
    near = arms_in_reach(scene, tuple(arm for arms in agents for arm in arms), MARGINS[0])
    reach = [frozenset().union(*(near[arm] for arm in arms)) for arms in agents]
    return [(i, j) for i, j in combinations(range(len(agents)), 2) if not reach[i].isdisjoint(agents[j])]


# ---- the smallest graph ----------------------------------------------------------------------


def _reduced(routes: tuple[Route, ...], found: list[Precedence]) -> list[Precedence]:
    """The transitive reduction of the dependencies, an acyclic graph.

    Each node has a vector clock: the least progress of all agents when it happens.
    """
    incoming: dict[Step, list[Step]] = {}
    for node, after in sorted(found):
        incoming.setdefault(node, []).append(after)
    order = passage({agent: len(route.steps) for agent, route in enumerate(routes)}, found).order
    clocks: list[list[tuple[int, NDArray[np.int64]]]] = [[(0, np.zeros(len(routes), np.int64))] for _ in routes]

    def clock(agent: int, step: int) -> NDArray[np.int64]:
        known = next(values for at, values in reversed(clocks[agent]) if at <= step).copy()
        known[agent] = step
        return known

    kept = []
    for node in order:
        if node not in incoming:
            continue
        afters = incoming[node]
        own = clock(*node)
        others = {after: clock(*after) for after in afters}
        for after in afters:
            agent, step = after
            elsewhere = (values for other, values in others.items() if other != after)
            if own[agent] < step and all(values[agent] < step for values in elsewhere):
                kept.append(Precedence(node, after))
        clocks[node[0]].append((node[1], np.maximum.reduce([own, *others.values()])))
    return sorted(kept, key=lambda both: (routes[both.node.agent].steps.times[both.node.step], both))


def _check_acyclic(routes: tuple[Route, ...], dependencies: tuple[Dependency, ...]) -> None:
    """Enter steps as long as any step can be entered.

    Raises:
        InputError: agents wait for each other in a cycle.
    """
    steps = {agent: len(route.steps) for agent, route in enumerate(routes)}
    circle = passage(steps, (Precedence(Step(*d.node[:2]), Step(*d.after[:2])) for d in dependencies)).circle
    if circle:
        raise InputError(f"{', '.join(arm for k in circle for arm in routes[k].arms)} wait for each other in a circle")
