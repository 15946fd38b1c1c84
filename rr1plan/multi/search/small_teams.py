"""Conflict-based search for a group of a few arms: roadmaps that grow until there is a plan on them.

A search that finds no plan is followed by a few rounds of the portfolio's methods, which need no roadmap; the effort of
both grows in turn. Once the portfolio has a plan, it is returned if the lower bound of one more search proves it good
enough, or if this search finds no better plan; its suboptimality is then the ratio proven by this search, which may
exceed the largest one intended.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from rr1plan.checks import Array
from rr1plan.errors import InputError
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.paths.path_pool import PathPool
from rr1plan.multi.preflight import TO_CHOSEN
from rr1plan.multi.search.agent_schedules import AgentSchedules
from rr1plan.multi.search.arm_roadmap import ArmRoadmap, build_roadmap
from rr1plan.multi.search.conflict_based_search import ConflictBasedSearch, schedule_of
from rr1plan.multi.search.group_planner import GroupPlanner
from rr1plan.multi.search.group_schedules import GroupSchedules
from rr1plan.multi.search.relative_conflicts import RelativeConflicts
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.multi.timing.diagram_cache import DiagramCache
from rr1plan.multi.timing.schedule import Schedule
from rr1plan.retiming.path_blends import clean

MOST_ARMS = 8
"""Largest number of arms of a group."""

# Largest ratio of the sum of arrivals to the minimum on the roadmaps, unless its proof takes too long.
_SUBOPTIMALITY = 1.1
# Samples of the first roadmaps, largest number of nodes of the first search on them, and rounds of the portfolio's
# methods after it; fewer rounds hardly ever prove that there is no path.
_SAMPLES, _NODES, _ROUNDS = 50, 500, 4
# Growth factor of samples, nodes and rounds, and largest number of samples.
_GROWTH, _MOST_SAMPLES = 4, 800
_SHORTEST_WAIT = 1e-6  # far above the rounding of times [s]


@dataclass(frozen=True)
class TeamPlan:
    """A plan of a group of arms.

    Args:
        schedules: One for each arm; none if no plan was found.
        alone: Duration of the fastest known motion of each arm alone [s].
        suboptimality: Proven bound: the sum of arrivals is at most this multiple of the minimum on the arms' roadmaps;
            None: unknown.
        reason: Why there is no plan, as text.
        impossible: Why some arms provably have no path to any of their goals; empty if that is not proven.
    """

    schedules: tuple[Schedule, ...] = ()
    alone: Mapping[str, float] = field(default_factory=dict)
    suboptimality: float | None = None
    reason: str = ""
    impossible: str = ""


def plan_small_team(
    agents: Sequence[Agent],
    goals: Mapping[str, Array],
    near: Mapping[str, frozenset[str]],
    margins: Mapping[str, float],
    largest_margin: float,
    rng: np.random.Generator,
    watch: Stopwatch,
    no_path: Callable[[Sequence[str], str], str],
) -> TeamPlan:
    """Plan the motions of a few arms by conflict-based search.

    Args:
        agents: The agent of each arm, in a problem whose goals are configurations.
        goals: Goal configurations of each arm, shape (k, nq), among them that of its agent.
        near: For each arm, the arms that it can touch.
        margins: Distance that each arm keeps from stationary objects in addition to the padding [m].
        largest_margin: Distance that arms keep from each other, as far as starts and goals allow [m].
        rng: Random generator.
        watch: Deadline.
        no_path: Function that returns why some arms have no path to any of their goals, given a proof that they have
            none to those of their agents; empty if that is not proven.

    Raises:
        InputError: too many arms.
    """
    arms = [agent.arms[0] for agent in agents]
    if len(arms) > MOST_ARMS:
        raise InputError(
            f"conflict-based search is for groups of up to {MOST_ARMS} arms that can meet, here are {len(arms)}; "
            "use method 'portfolio'"
        )
    pools = {agent.arms[0]: PathPool(agent, margins[agent.arms[0]], rng, watch) for agent in agents}
    for arm, pool in pools.items():
        path, reason = pool.add({}, patient=True)
        if path is None:
            impossible = no_path([arm], reason) if pool.impossible else ""
            chosen = TO_CHOSEN if pool.impossible else ""
            return TeamPlan(reason=impossible or f"{arm}: {chosen}{reason}", impossible=impossible)
    first = {arm: pool.paths[0] for arm, pool in pools.items()}
    margins = {arm: pool.margin for arm, pool in pools.items()}  # smaller where a first path needs it
    alone = {arm: path.fastest for arm, path in first.items()}
    diagrams = DiagramCache(largest_margin, watch)
    pairs = [(first[a], first[b]) for a, b in combinations(arms, 2) if b in near[a]]
    margin = min((diagrams.margin(*pair) for pair in pairs), default=largest_margin)
    conflicts = RelativeConflicts(margin, watch)
    known: tuple[Schedule, ...] = ()
    cost, bound, reason = math.inf, 0.0, "no time was left"
    for effort in _efforts(watch.rounds):
        samples = min(effort * _SAMPLES, _MOST_SAMPLES)
        roadmaps = _roadmaps(first, goals, margins, samples, watch)
        if roadmaps is None:
            break
        found = ConflictBasedSearch(roadmaps, near, conflicts, watch, _SUBOPTIMALITY).run(effort * _NODES, cost)
        if found.moves is not None and found.cost <= cost:
            plan = AgentSchedules(agents, margins, near, DiagramCache(margin, watch), watch)
            plan.schedules = {
                agent: schedule_of(roadmaps[arm], found.moves[arm]) for arm, agent in zip(arms, agents, strict=True)
            }
            _remove_needless_waits(plan)
            found.cost = math.fsum(schedule.arrival for schedule in plan.schedules.values())
            return TeamPlan(tuple(plan.schedules.values()), alone, found.suboptimality)
        reason = f"no plan after {found.nodes} nodes of a search on roadmaps of {samples} samples"
        bound = found.lower_bound if 0.0 < found.lower_bound < math.inf else bound
        if known:
            break
        group = GroupSchedules(pools.values(), near, diagrams, rng, watch)
        known = tuple(group.schedules.values()) if GroupPlanner(group).run(effort * _ROUNDS) else ()
        impossible = no_path(arms, group.reason) if group.impossible and not known else ""
        if impossible:
            return TeamPlan(reason=impossible, impossible=impossible)
        cost = math.fsum(s.arrival * len(s.arms) for s in known) if known else math.inf
    if known:
        return TeamPlan(known, alone, max(1.0, cost / bound) if bound > 0.0 else None)
    return TeamPlan(reason=f"{', '.join(arms)}: {reason}")


def _efforts(rounds: float) -> Iterator[int]:
    """Efforts that grow until their rounds reach a limit."""
    effort = 1
    yield effort
    while effort * _ROUNDS < rounds:
        effort *= _GROWTH
        yield effort


def _remove_needless_waits(plan: AgentSchedules) -> None:
    """Retime the arms that wait on their paths, the earliest first, because later arms wait for them.

    A wait that a constraint caused is needless if the other arm has different moves in the end.
    """
    for agent, schedule in sorted(plan.schedules.items(), key=lambda item: item[1].arrival):
        if schedule.waiting > _SHORTEST_WAIT:
            found = plan.timed(schedule.path, plan.neighbors(agent, plan.schedules))
            if found is not None and found.arrival < schedule.arrival:
                plan.schedules[agent] = found


def _roadmaps(
    first: Mapping[str, AgentPath],
    goals: Mapping[str, Array],
    margins: Mapping[str, float],
    samples: int,
    watch: Stopwatch,
) -> dict[str, ArmRoadmap] | None:
    """A roadmap for each arm, including its first path; None after the deadline.

    Args:
        first: First path of each arm.
        goals: All goal configurations of each arm, shape (k, nq).
        margins: Distance that each arm keeps from stationary objects in addition to the padding [m].
        samples: Number of samples of each roadmap.
        watch: Deadline.
    """
    roadmaps: dict[str, ArmRoadmap] = {}
    for arm, path in first.items():
        known = [clean(path.path.waypoints)]
        others = goals[arm][(goals[arm] != path.goal).any(axis=1)]
        ends = np.vstack([path.goal, others])
        made = build_roadmap(path.agent, ends, margins[arm], samples, known, watch.goes_on)
        if made is None:
            return None
        roadmaps[arm] = made
    return roadmaps
