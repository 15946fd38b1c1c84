"""The temporal plan graph of many arms: who has to wait for whom, so that a plan stays safe whatever is delayed.

    graph = plan_graph(plan_many_arms(problem))

A node is the instant at which an agent enters a step of its route. It has two kinds of predecessors: the step before it
on the same route, and, where a cell of the coordination diagram of two agents is not proven free, the instant at which
the other agent has left its part of it (Hönig et al., Multi-agent path finding with kinematic constraints, 2016).
Cells are certified at any speed within them, so that agents that enter their steps in an order that the graph allows
never touch, in continuous time, however long each takes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, Value, known_name, of_kind
from rr1plan.collision.arm_groups import arms_in_reach
from rr1plan.errors import FormatError, InputError
from rr1plan.multi.execution.route import Route, RouteSteps, route_of
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.paths.projected_path import path_of_arm
from rr1plan.multi.preflight import MARGINS
from rr1plan.multi.timing.coordination import Blocked, coordination_diagram
from rr1plan.multi.timing.schedule import Occupancy, Schedule, extended
from rr1plan.retiming.path_blends import Curve
from rr1plan.retiming.path_speed import Grid

if TYPE_CHECKING:
    from rr1plan.multi.portfolio import ManyArmsResult

# Distances that agents keep beyond the padding [m]: the largest with which a plan agrees.
_MARGINS = (*MARGINS, 0.0)
# Rounding of times, subtracted from tolerances [s].
_ROUNDING = 1e-9


class Node(NamedTuple):
    """An agent enters a step of its route.

    Args:
        agent: Its index.
        step: The step.
        arms: The agent's arms.
        time: When the plan enters it [s].
    """

    agent: int
    step: int
    arms: tuple[str, ...]
    time: float


class Dependency(NamedTuple):
    """One agent waits for another.

    Args:
        node: What has to wait.
        after: What has to happen first: the other agent leaves what is in the way.
    """

    node: Node
    after: Node

    def __str__(self) -> str:
        waits, first = " and ".join(self.node.arms), " and ".join(self.after.arms)
        return (
            f"{waits} does not go beyond where the plan has it at {self.node.time:.3f} s "
            f"before {first} is where it is at {self.after.time:.3f} s"
        )


@dataclass(frozen=True, eq=False)
class PlanGraph(Value):
    """Routes of all agents, and the order in which they have to pass each other.

    Args:
        routes: The route of each agent: an arm, or a few arms that move as one.
        dependencies: Who waits for whom, without those that follow from others.
        together: The same between the arms of one agent, as dependencies of the agent on itself. They move as one, so
            that nobody waits, but they count if the arms start one by one.

    Raises:
        InputError: an arm of two agents, or dependencies on steps that are not there or on each other in a circle.
    """

    routes: tuple[Route, ...]
    dependencies: tuple[Dependency, ...]
    together: tuple[Dependency, ...] = ()

    def __post_init__(self) -> None:
        arms = [arm for route in self.routes for arm in route.arms]
        if len(set(arms)) < len(arms):
            raise InputError("an arm is part of two agents of a plan graph")
        for node, after in self.dependencies:
            if node.agent == after.agent:
                raise InputError(f"{' and '.join(node.arms)} waits for itself")
            if self.routes[node.agent].steps.is_rest[node.step]:
                raise InputError("a dependency keeps an agent from resting where it is; expected one on a segment")
        if any(node.agent != after.agent for node, after in self.together):
            raise InputError("expected two arms of one agent in 'together'")
        _check_acyclic(self.routes, self.dependencies)

    def __repr__(self) -> str:
        arms = sum(len(route.arms) for route in self.routes)
        steps = sum(len(route.steps) for route in self.routes)
        tolerance = f"skew_tolerance={self.skew_tolerance:.3g} s"
        return f"PlanGraph({arms} arms, {steps} steps, {len(self.dependencies)} dependencies, {tolerance})"

    @property
    def arms(self) -> tuple[str, ...]:
        """All arms."""
        return tuple(arm for route in self.routes for arm in route.arms)

    @cached_property
    def nodes(self) -> tuple[Node, ...]:
        """All nodes: each agent enters each step of its route but the first, at which it begins."""
        return tuple(
            Node(i, k, route.arms, float(route.steps.times[k]))
            for i, route in enumerate(self.routes)
            for k in range(1, len(route.steps))
        )

    @property
    def skew_tolerance(self) -> float:
        """Each arm may start late by up to this time, without any waiting, and no two arms touch [s].

        A certified lower bound; inf where no two arms come near each other.
        """
        gaps = (node.time - after.time for node, after in (*self.dependencies, *self.together))
        return max(0.0, min(gaps, default=np.inf) - _ROUNDING)

    def with_times(self, times: Sequence[Array]) -> PlanGraph:
        """The same graph for another execution of the plan.

        Args:
            times: When each agent enters each step of its route [s], shape (n,) each; the first is ignored.
        """
        routes = tuple(
            replace(route, steps=replace(route.steps, times=t)) for route, t in zip(self.routes, times, strict=True)
        )

        def moved(dependencies: tuple[Dependency, ...]) -> tuple[Dependency, ...]:
            return tuple(
                Dependency(_node(routes, node.agent, node.step), _node(routes, after.agent, after.step))
                for node, after in dependencies
            )

        return PlanGraph(routes, moved(self.dependencies), moved(self.together))

    def waits_for(self, arm: str) -> tuple[Dependency, ...]:
        """The dependencies for which an arm waits, in order.

        Raises:
            UnknownNameError: the plan has no such arm.
        """
        known_name("arm", arm, self.arms)
        found = [d for d in self.dependencies if arm in d.node.arms]
        return tuple(sorted(found, key=lambda d: d.node.step))

    def to_dict(self) -> dict[str, Any]:
        """The graph as numbers, texts and lists; `from_dict` reads it back."""
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
            "together": [
                {"agent": node.agent, "step": node.step, "after_step": after.step} for node, after in self.together
            ],
        }

    @staticmethod
    def from_dict(entries: Mapping[str, Any]) -> PlanGraph:
        """The graph that `to_dict` wrote; motion files check types and keys before (`export/motion_schema.py`).

        Raises:
            FormatError: content that is no plan graph.
        """
        try:
            routes = tuple(
                Route(
                    tuple(r["joint_names"]),
                    np.array(r["start"]),
                    Curve(np.array(r["curve"]["lengths"]), np.array(r["curve"]["coefficients"]), (0, 0)),
                    Grid(
                        np.array(r["grid"]["piece"], np.int64),
                        np.array(r["grid"]["offset"]),
                        np.array(r["grid"]["delta"]),
                    ),
                    tuple(r["stops"]),
                    RouteSteps(
                        np.array(r["steps"]["begins"], np.int64),
                        np.array(r["steps"]["ends"], np.int64),
                        np.array([0.0, *r["steps"]["times"]]),
                    ),
                )
                for r in entries["routes"]
            )
            return PlanGraph(
                routes,
                tuple(
                    Dependency(_node(routes, d["agent"], d["step"]), _node(routes, d["after_agent"], d["after_step"]))
                    for d in entries["dependencies"]
                ),
                tuple(
                    Dependency(_node(routes, d["agent"], d["step"]), _node(routes, d["agent"], d["after_step"]))
                    for d in entries["together"]
                ),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise FormatError(f"holds no plan graph: {error}") from error


def _node(routes: tuple[Route, ...], agent: int, step: int) -> Node:
    if not (0 <= agent < len(routes) and 0 < step < len(routes[agent].steps)):
        raise InputError(f"a dependency names step {step} of agent {agent}, which is not there")
    return Node(agent, step, routes[agent].arms, float(routes[agent].steps.times[step]))


def plan_graph(result: ManyArmsResult) -> PlanGraph:
    """The temporal plan graph of a plan.

    Args:
        result: What `plan_many_arms` found.

    Raises:
        InputError: no plan, or one whose agents are not proven free of contact.
    """
    from rr1plan.multi.portfolio import ManyArmsResult

    of_kind("result", result, ManyArmsResult)
    if not result.found:
        raise InputError(f"there is no plan to make a graph of: {result.reason}")
    schedules = result.schedules
    routes = tuple(route_of(schedule) for schedule in schedules)
    found: list[tuple[tuple[int, int], tuple[int, int]]] = []
    for i, j in pairs_in_reach(schedules):
        blocked = agreeing_diagram(schedules[i], schedules[j])
        if blocked is None:
            continue
        one, two = schedules[i].occupancy, schedules[j].occupancy
        hit = blocked[np.ix_(one.rows, two.rows)].astype(bool)
        for first, second, cells, a, b in ((i, j, hit, one, two), (j, i, hit.T, two, one)):
            found += [((second, step), (first, after)) for step, after in _frontier(cells, a, b)]
    own = [((i, step), (i, after)) for i, schedule in enumerate(schedules) for step, after in _own_order(schedule)]
    kept, together = (
        tuple(Dependency(_node(routes, *node), _node(routes, *after)) for node, after in pairs)
        for pairs in (_reduced(routes, found), own)
    )
    return PlanGraph(routes, kept, together)


# ---- which cells two agents share -----------------------------------------------------------


def pairs_in_reach(schedules: tuple[Schedule, ...]) -> list[tuple[int, int]]:
    """Indices of agents that can meet."""
    if not schedules:
        return []
    problem = schedules[0].path.agent.problem
    near = arms_in_reach(problem.scene, problem.arms, _MARGINS[0])
    reach = [frozenset().union(*(near[arm] for arm in s.path.agent.arms)) for s in schedules]
    return [
        (i, j)
        for i, j in combinations(range(len(schedules)), 2)
        if not reach[i].isdisjoint(schedules[j].path.agent.arms)
    ]


def agreeing_diagram(one: Schedule, two: Schedule) -> Blocked | None:
    """The extended diagram of two schedules with the largest margin that they keep; None where all of it is free.

    Raises:
        InputError: they keep none: the schedules are in a cell that is not proven free.
    """
    for margin in _MARGINS:
        blocked = closed_diagram(one.path, two.path, margin)
        if blocked is None:
            return None
        hit = blocked[np.ix_(one.occupancy.rows, two.occupancy.rows)].astype(bool)
        if least_gap(hit, one.occupancy, two.occupancy) >= 0.0:
            return blocked
    arms = " and ".join((*one.path.agent.arms, *two.path.agent.arms))
    raise InputError(f"the plan is not proven to keep {arms} apart")


def closed_diagram(one: AgentPath, two: AgentPath, margin: float) -> Blocked | None:
    """The extended diagram of two paths, in which rest at an end is free where the segment next to it is.

    An end is a part of that segment, so that what is proven of the segment holds at the end.
    """
    blocked = coordination_diagram(one, two, margin)
    if blocked is None:
        return None
    for cells, segments in ((blocked, one.segments), (blocked.T, two.segments)):
        if segments:
            cells[0] &= cells[1]
            cells[-1] &= cells[-2]
    return extended(blocked)


def _gaps(one: Occupancy, two: Occupancy) -> Array:
    """How long one agent has left each of its steps when the other enters its own, shape (steps, steps)."""
    return np.asarray(two.enter[None, :] - one.leave[:, None])


def least_gap(hit: NDArray[np.bool_], one: Occupancy, two: Occupancy) -> float:
    """The shortest time between two agents' stays in cells that are not free [s]; below zero where they overlap.

    Args:
        hit: Steps that must not be occupied at once, shape (steps of one, steps of two).
        one: What the one occupies.
        two: What the other does.
    """
    gaps = np.maximum(_gaps(one, two), _gaps(two, one).T)
    return float(gaps[hit].min(initial=np.inf))


def _own_order(schedule: Schedule) -> list[tuple[int, int]]:
    """The same among the arms of one agent: a step of one arm, and the step that another has to enter before."""
    arms, occupied = schedule.path.agent.arms, schedule.occupancy
    if len(arms) == 1 or not schedule.legs:
        return []
    found = np.zeros((len(occupied.rows),) * 2, bool)
    for one, two in combinations([path_of_arm(schedule.path, arm) for arm in arms], 2):
        blocked = closed_diagram(one, two, 0.0)
        if blocked is not None:
            hit = blocked[np.ix_(occupied.rows, occupied.rows)].astype(bool)
            found |= hit | hit.T
    # Of two steps the earlier one comes first; a step that both must not be on at once is its own predecessor.
    pairs = []
    latest = -1
    for step in range(len(found)):
        before = np.flatnonzero(found[: step + 1, step])
        if len(before) and before[-1] > latest:
            latest = int(before[-1])
            pairs.append((max(step, 1), min(latest + 1, len(found) - 1)))
    return pairs


# ---- the smallest graph ----------------------------------------------------------------------


def _frontier(hit: NDArray[np.bool_], first: Occupancy, second: Occupancy) -> list[tuple[int, int]]:
    """The dependencies of one agent on another that do not follow from each other.

    Args:
        hit: Steps that must not be occupied at once, shape (steps of the first, steps of the second).
        first: Who may be first there.
        second: Who may have to wait.

    Returns:
        Pairs: a step of the second, and the step that the first has to enter before.
    """
    before = hit & (_gaps(first, second) >= 0.0)
    latest = np.where(before.any(axis=0), len(before) - 1 - np.argmax(before[::-1], axis=0), -1)
    earlier = np.maximum.accumulate(np.concatenate([[-1], latest[:-1]]))
    return [(int(step), int(latest[step]) + 1) for step in np.flatnonzero(latest > earlier)]


def _reduced(
    routes: tuple[Route, ...], found: list[tuple[tuple[int, int], tuple[int, int]]]
) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """The dependencies that do not follow from others: the transitive reduction of an acyclic graph.

    Of each node the clock is known: how far all agents are at least, when it happens.
    """
    order = sorted(found, key=lambda both: (routes[both[0][0]].steps.times[both[0][1]], both))
    incoming: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for node, after in order:
        incoming.setdefault(node, []).append(after)
    clocks: list[list[tuple[int, NDArray[np.int64]]]] = [[(0, np.zeros(len(routes), np.int64))] for _ in routes]

    def clock(agent: int, step: int) -> NDArray[np.int64]:
        known = next(values for at, values in reversed(clocks[agent]) if at <= step).copy()
        known[agent] = step
        return known

    kept = []
    for node, afters in incoming.items():
        own = clock(*node)
        others = {after: clock(*after) for after in afters}
        for after in afters:
            agent, step = after
            elsewhere = (values for other, values in others.items() if other != after)
            if own[agent] < step and all(values[agent] < step for values in elsewhere):
                kept.append((node, after))
        clocks[node[0]].append((node[1], np.maximum.reduce([own, *others.values()])))
    return kept


def _check_acyclic(routes: tuple[Route, ...], dependencies: tuple[Dependency, ...]) -> None:
    """Enter steps for as long as something can be entered.

    Raises:
        InputError: agents wait for each other in a circle.
    """
    waiting: list[dict[int, list[tuple[int, int]]]] = [{} for _ in routes]
    for node, after in dependencies:
        waiting[node.agent].setdefault(node.step, []).append((after.agent, after.step))
    now = [0] * len(routes)
    goes_on = True
    while goes_on:
        goes_on = False
        for agent, route in enumerate(routes):
            last = len(route.steps) - 1
            while now[agent] < last and all(
                now[other] >= step for other, step in waiting[agent].get(now[agent] + 1, ())
            ):
                now[agent] += 1
                goes_on = True
    stuck = [route for agent, route in enumerate(routes) if now[agent] < len(route.steps) - 1]
    if stuck:
        names = ", ".join(arm for route in stuck for arm in route.arms)
        raise InputError(f"{names} wait for each other in a circle")
