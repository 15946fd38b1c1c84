"""Prioritized planning on path pools, with detours and local eviction.

Agents are scheduled one after the other, each among the schedules of those before it (Erdmann and Lozano-Pérez 1987).
An agent for which no path of its pool can be timed gets detours; if none helps, it evicts the agents that are in its
way, which are scheduled again (as in large neighborhood search: Li et al., MAPF-LNS2, 2022). All other schedules stay.
Agents that keep evicting each other become one (a meta-agent: Sharon et al., Meta-agent conflict-based search, 2012),
which is planned in the joint space of all its arms.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from rr1plan.checks import Array
from rr1plan.multi.agent_path import AgentPath
from rr1plan.multi.agents import Agent
from rr1plan.multi.coordination import Blocked, are_apart, coordination_diagram, ends_exclude
from rr1plan.multi.path_pool import PathPool
from rr1plan.multi.placed_path import placed_configuration
from rr1plan.multi.preflight import MARGINS, affordable_margin
from rr1plan.multi.safe_intervals import blocked_times, earliest_schedule
from rr1plan.multi.schedule import Schedule, extended
from rr1plan.multi.stopwatch import Stopwatch

# Distances to keep between agents beyond the padding [m]: the largest that their starts and their goals have.
_MARGINS = (*MARGINS, 0.0)
# Paths of a pool before another agent is evicted, and at most.
_DETOURS, _MOST_PATHS = 3, 12
# Two agents of which one has evicted the other so often become one.
_QUARRELS = 2
# Agents of a group that are planned as one as soon as their first paths cannot be timed.
_PLANNED_AS_ONE = 3
# Arms of an agent, at most: the joint space of more is hopeless.
_MOST_TOGETHER = 4


# A makespan nearer to its lower bound than this is not made shorter, nor by less than that [ratio].
_GOOD_ENOUGH, _LEAST_GAIN = 0.15, 0.005
_NEIGHBORHOOD = 3  # agents that are scheduled again with the last, at most


@dataclass
class Statistics:
    """What was done to find schedules."""

    paths: int = 0
    detours: int = 0
    diagrams: int = 0
    timings: int = 0
    evictions: int = 0
    merged: int = 0
    seconds: dict[str, float] = field(default_factory=dict)

    def add_time(self, stage: str, began: float) -> None:
        """Count the wall time of a stage since it began."""
        self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - began


class PrioritizedPlanner:
    """Schedules for the agents of one interaction group.

    Args:
        agents: The agents; each knows the problem.
        near: Arms that can meet each arm.
        margins: Distance that each arm keeps from what stands still, beyond the padding [m].
        rng: Where random numbers come from.
        watch: Says when to give up.

    Attributes:
        schedules: Of the agents that have one.
        stage: What it took to schedule all: "timing", "detours", "eviction" or "composite"; empty while they are not.
        reason: Why there is none for all of them; empty while that is not known.
        statistics: What was done.
    """

    def __init__(
        self,
        agents: Iterable[Agent],
        near: Mapping[str, frozenset[str]],
        margins: Mapping[str, float],
        rng: np.random.Generator,
        watch: Stopwatch,
    ) -> None:
        self._near, self._margins, self._rng, self._watch = near, margins, rng, watch
        self.agents = list(agents)
        self.pools: dict[Agent, PathPool] = {}
        self.schedules: dict[Agent, Schedule] = {}
        self.statistics = Statistics()
        self.stage = ""
        self.reason = ""
        # Pools of agents that are part of another one now; they bound its makespan.
        self._parts: dict[Agent, PathPool] = {}
        self._diagrams: dict[tuple[AgentPath, AgentPath], Blocked | None] = {}
        self._pair_margins: dict[frozenset[Agent], float] = {}
        self._evicted: Counter[Agent] = Counter()
        self._quarrels: Counter[frozenset[Agent]] = Counter()
        self._detours: Counter[Agent] = Counter()

    # ---- the search ------------------------------------------------------------------------

    def run(self) -> bool:
        """Schedule all agents; whether that was possible in time."""
        for agent in self.agents:
            if not self._make_pool(agent):
                return False
        waiting = sorted(self.agents, key=lambda agent: -self.pools[agent].paths[0].fastest)
        if 1 < len(waiting) <= _PLANNED_AS_ONE and self._solve_few(waiting):
            waiting = []
        while waiting:
            if not self._watch.goes_on():
                self.reason = self._blocked_by(waiting)
                return False
            agent = waiting.pop(0)
            if self._schedule(agent, self._time_limit()):
                continue
            evicted = self._evict(agent)
            if evicted is None:
                self.reason = self.reason or self._blocked_by([agent, *waiting])
                return False
            waiting = [*self._merge_quarrels(agent, evicted), *waiting]
            waiting = [agent for agent in waiting if agent in self.pools]
        self.stage = self._stage()
        return True

    def _solve_few(self, agents: list[Agent]) -> bool:
        """Time the first paths of a few agents, or else plan them as one; whether that was possible."""
        limit = self._time_limit()
        if all(self._schedule(agent, limit, detours=0) for agent in agents) and self.makespan <= limit:
            return True
        timed = dict(self.schedules) if len(self.schedules) == len(agents) else None
        merged = self._merge(agents)
        if merged is not None and self._schedule(merged, math.inf, detours=0):
            if timed is None or self.makespan <= max(schedule.arrival for schedule in timed.values()):
                return True
            # Those that wait are sooner there.
            self._split_up(merged, agents)
        self.schedules = {} if timed is None else timed
        return timed is not None

    def improve(self, rounds: int) -> None:
        """Make the makespan shorter: the last agent and some of those near it are scheduled again, it first.

        Args:
            rounds: How often to try.
        """
        for _ in range(rounds):
            last = max(self.agents, key=lambda agent: self.schedules[agent].arrival)
            limit = self.makespan
            if limit <= self.slowest_alone() * (1.0 + _GOOD_ENOUGH) or not self._watch.goes_on():
                break
            before = dict(self.schedules)
            path = self.schedules[last].path
            near = [o for o in self._others(last) if self._diagram(path, self.schedules[o].path) is not None]
            chosen = self._rng.permutation(len(near))[: 1 + int(self._rng.integers(_NEIGHBORHOOD))]
            again = [last, *(near[i] for i in chosen.tolist())]
            for agent in again:
                del self.schedules[agent]
            target = (1.0 - _LEAST_GAIN) * limit
            if not all(self._schedule(agent, target) and self.schedules[agent].arrival <= target for agent in again):
                self.schedules = before

    def _stage(self) -> str:
        if self.statistics.merged:
            return "composite"
        if self.statistics.evictions:
            return "eviction"
        return "detours" if self.statistics.detours else "timing"

    @property
    def makespan(self) -> float:
        """When the last agent arrives [s]."""
        return max((schedule.arrival for schedule in self.schedules.values()), default=0.0)

    def slowest_alone(self) -> float:
        """Duration of the fastest known motion of the slowest agent alone [s]."""
        return max(self.fastest_alone().values(), default=0.0)

    def fastest_alone(self) -> dict[str, float]:
        """Duration of the fastest known motion of each arm alone [s]."""
        alone = [pool for pool in (*self._parts.values(), *self.pools.values()) if len(pool.agent.arms) == 1]
        return {pool.agent.arms[0]: min(path.fastest for path in pool.paths) for pool in alone}

    def _time_limit(self) -> float:
        """Arrivals before this need no better path: others arrive later anyway, or it is good enough."""
        return max(self.makespan, self.slowest_alone() * (1.0 + _GOOD_ENOUGH))

    def _make_pool(self, agent: Agent) -> bool:
        margin = min(self._margins[arm] for arm in agent.arms)
        if len(agent.arms) > 1:
            # They keep it from each other, too.
            goals = {arm: q for part in self.pools for arm, q in self._split(part, self._goal_of(part)).items()}
            margin = affordable_margin(agent, np.concatenate([goals[arm] for arm in agent.arms]), margin)
        pool = PathPool(agent, margin, self._rng)
        began = time.perf_counter()
        path, reason = pool.add({}, self._watch.left, patient=len(agent.arms) == 1)
        self.statistics.add_time("paths", began)
        self.statistics.paths += 1
        if path is None:
            self.reason = f"{' and '.join(agent.arms)}: {reason}"
            return False
        self.pools[agent] = pool
        return True

    def _schedule(self, agent: Agent, limit: float, *, detours: int | None = None) -> bool:
        """Time the paths of an agent, and detours while none arrives before the limit; whether there is a schedule."""
        detours = _DETOURS if detours is None else detours
        best: Schedule | None = None
        for path in list(self.pools[agent].paths):
            best = _earlier(best, self._timed(path, self._others(agent)))
            if best is not None and best.arrival <= limit:
                break
        tries = 0
        while (best is None or best.arrival > limit) and tries < detours:
            if len(self.pools[agent].paths) >= _MOST_PATHS or not self._watch.goes_on():
                break
            tries += 1
            made = self._detour(agent)
            if made is not None:
                best = _earlier(best, self._timed(made, self._others(agent)))
        for path in self.pools[agent].paths:
            if best is None or path is not best.path:
                path.release()
        if best is None:
            return False
        self.schedules[agent] = best
        return True

    def _detour(self, agent: Agent) -> AgentPath | None:
        """One more path: around the goals of others, their starts, the ones or the others, or by chance."""
        number = self._detours[agent]
        self._detours[agent] += 1
        others = self._in_the_way(agent)
        goals = {other: self._goal_of(other) for other in others}
        starts = {other: other.start for other in others}
        scheduled = {other: goals[other] if other in self.schedules else starts[other] for other in others}
        kinds = [goals, starts, scheduled, {}]
        standing = kinds[number] if number < 3 else kinds[int(self._rng.integers(len(kinds)))]
        began = time.perf_counter()
        configurations: dict[str, Array | None] = {}
        for other, q in standing.items():
            if self._leaves_ends_free(agent, other, q):
                configurations.update(self._split(other, q))
        path, _ = self.pools[agent].add(configurations, self._watch.left, detour=number >= 3 or not configurations)
        self.statistics.add_time("paths", began)
        self.statistics.paths += 1
        self.statistics.detours += 1
        return path

    def _in_the_way(self, agent: Agent) -> list[Agent]:
        """Neighbors whose path, as far as it is known, meets one of the agent's."""
        paths, found = self.pools[agent].paths, []
        for other in self._neighbors(agent):
            theirs = self.schedules[other].path if other in self.schedules else self.pools[other].paths[0]
            if any(self._diagram(path, theirs) is not None for path in paths):
                found.append(other)
        return found

    def _leaves_ends_free(self, agent: Agent, other: Agent, q: Array) -> bool:
        """Whether an agent can be at its start and its goal while another one stands somewhere."""
        placed = placed_configuration(other.bodies, q)
        return all(
            are_apart(agent, placed_configuration(agent.bodies, end), other, placed, self.pools[agent].margin)
            for end in (agent.start, self._goal_of(agent))
        )

    def _goal_of(self, agent: Agent) -> Array:
        pool = self.pools.get(agent)
        if agent in self.schedules:
            return np.asarray(self.schedules[agent].path.goal)
        return agent.start if pool is None else np.asarray(pool.paths[0].goal)

    def _split(self, agent: Agent, q: Array) -> dict[str, Array]:
        configurations = agent.problem.scene.split(q, agent.arms)
        return {arm: configurations[arm] for arm in agent.arms}

    # ---- eviction ----------------------------------------------------------------------------

    def _evict(self, agent: Agent) -> list[Agent] | None:
        """Schedule an agent without those in its way, as few and as rarely evicted as can be; None if nothing helps."""
        others = self._others(agent)
        best: tuple[float, Schedule, list[Agent]] | None = None
        for path in self.pools[agent].paths:
            if not self._watch.goes_on():
                return None
            for victims in self._candidates(path, others):
                cost = sum(1.0 + self._evicted[v] for v in victims)
                if best is not None and cost >= best[0]:
                    continue
                kept = [o for o in others if o not in victims]
                schedule = self._timed(path, kept)
                if schedule is not None:
                    best = cost, schedule, victims
        if best is None:
            return None
        _, self.schedules[agent], victims = best
        for victim in victims:
            del self.schedules[victim]
            self._evicted[victim] += 1
            self._quarrels[frozenset((agent, victim))] += 1
        self.statistics.evictions += len(victims)
        return victims

    def _candidates(self, path: AgentPath, others: list[Agent]) -> list[list[Agent]]:
        """Sets of agents whose eviction may make room for a path: single ones, then all in the way."""
        in_the_way = [o for o in others if self._diagram(path, self.schedules[o].path) is not None]
        return [*([o] for o in in_the_way), in_the_way]

    def _merge_quarrels(self, agent: Agent, evicted: list[Agent]) -> list[Agent]:
        """Who has to be scheduled next: the evicted, or one agent of those that quarrel too often."""
        for victim in evicted:
            together = {*agent.arms, *victim.arms}
            if self._quarrels[frozenset((agent, victim))] < _QUARRELS or len(together) > _MOST_TOGETHER:
                continue
            merged = self._merge([agent, victim])
            if merged is None:
                self._quarrels[frozenset((agent, victim))] = -_QUARRELS
                continue
            return [merged, *(v for v in evicted if v is not victim)]
        return evicted

    def _merge(self, agents: list[Agent]) -> Agent | None:
        """One agent of several, with a path in the joint space of all their arms; None if none is found."""
        merged = Agent(agents[0].problem, [arm for agent in agents for arm in agent.arms], agents[0].timing)
        if not self._make_pool(merged):
            self.reason = ""
            return None
        for old in agents:
            self._parts[old] = self.pools.pop(old)
            self.schedules.pop(old, None)
            self.agents.remove(old)
        self.agents.append(merged)
        self.statistics.merged += 1
        return merged

    def _split_up(self, merged: Agent, agents: list[Agent]) -> None:
        """Undo a merger."""
        for agent in agents:
            self.pools[agent] = self._parts.pop(agent)
            self.agents.append(agent)
        del self.pools[merged]
        self.agents.remove(merged)
        self.statistics.merged -= 1

    # ---- timing ------------------------------------------------------------------------------

    def _neighbors(self, agent: Agent) -> list[Agent]:
        near = frozenset().union(*(self._near[arm] for arm in agent.arms))
        return [other for other in self.agents if other is not agent and not near.isdisjoint(other.arms)]

    def _others(self, agent: Agent) -> list[Agent]:
        """Neighbors that have a schedule."""
        return [other for other in self._neighbors(agent) if other in self.schedules]

    def _timed(self, path: AgentPath, others: Iterable[Agent]) -> Schedule | None:
        """The earliest schedule of a path among those of others."""
        found = []
        for other in others:
            theirs = self.schedules[other]
            blocked = self._diagram(path, theirs.path)
            if blocked is not None:
                found.append((blocked, theirs.occupancy))
        began = time.perf_counter()
        schedule = earliest_schedule(path, blocked_times(path, found))
        self.statistics.add_time("timing", began)
        self.statistics.timings += 1
        return schedule

    def _diagram(self, one: AgentPath, two: AgentPath) -> Blocked | None:
        """The extended diagram of two paths, kept for both orders; None where all of it is free."""
        try:
            return self._diagrams[one, two]
        except KeyError:
            began = time.perf_counter()
            key = frozenset((one.agent, two.agent))
            blocked = None
            for margin in _MARGINS:
                if margin > self._pair_margins.get(key, math.inf):
                    continue
                blocked = coordination_diagram(one, two, margin)
                if not ends_exclude(blocked):
                    break
            self._pair_margins[key] = margin
            self.statistics.add_time("diagrams", began)
            self.statistics.diagrams += 1
            both = None if blocked is None else extended(blocked)
            self._diagrams[one, two] = both
            self._diagrams[two, one] = None if both is None else np.ascontiguousarray(both.T)
            return both

    def _blocked_by(self, waiting: list[Agent]) -> str:
        texts = []
        for agent in waiting:
            others = [arm for other in self._others(agent) for arm in other.arms]
            texts.append(
                f"{' and '.join(agent.arms)} (among {', '.join(others)})" if others else " and ".join(agent.arms)
            )
        return f"no schedule found for {'; '.join(texts)}"


def _earlier(one: Schedule | None, two: Schedule | None) -> Schedule | None:
    if one is None or two is None:
        return one or two
    return two if two.arrival < one.arrival else one
