"""Prioritized planning on path pools, with detours and local eviction.

Agents are scheduled one after the other, each among the schedules of those before it (Erdmann and Lozano-Pérez 1987).
An agent for which no path of its pool can be timed gets detours; if none helps, it evicts the agents in its way, which
are rescheduled (as in large neighborhood search: Li et al., MAPF-LNS2, 2022). All other schedules are kept. Agents that
repeatedly evict each other are merged into one (a meta-agent: Sharon et al., Meta-agent conflict-based search, 2012),
which is planned in the joint space of all its arms.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator

import numpy as np

from rr1plan.checks import Array
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.search.group_schedules import GroupSchedules
from rr1plan.multi.timing.schedule import Schedule

# Detours that are tried before another agent is evicted, and largest number of paths in a pool.
_DETOURS, _MOST_PATHS = 3, 12
# Number of evictions between two agents after which they are merged.
_MOST_EVICTIONS = 2
# Largest number of arms of a merged agent; larger joint spaces need windows.
_MOST_TOGETHER = 4
_NEIGHBORHOOD = 3  # largest number of agents that are rescheduled together with the last one
_LEAST_GAIN = 0.005  # smallest reduction of the makespan that counts [ratio]


class PrioritizedPlanner:
    """Schedules the agents of a group one after the other.

    Args:
        group: The agents and their schedules, which it changes.
    """

    def __init__(self, group: GroupSchedules) -> None:
        self._group = group
        self._evicted: Counter[Agent] = Counter()
        self._evictions_between: Counter[frozenset[Agent]] = Counter()
        self._detours: Counter[Agent] = Counter()

    def schedule_all(self, most: int) -> bool:
        """Schedule the agents without a schedule with detours and evictions; returns whether this succeeded.

        Args:
            most: Number of evictions of the whole search after which it ends.
        """
        group = self._group
        waiting = [agent for agent in group.slowest_first() if agent not in group.schedules]
        while waiting:
            if not group.watch.goes_on() or group.statistics.evictions >= most:
                return False
            agent = waiting.pop(0)
            if group.schedule(agent, group.time_limit(), self._detours_of(agent)):
                continue
            evicted = self._evict(agent)
            if evicted is None:
                return False
            waiting[:] = [*self._merge_rivals(agent, evicted), *waiting]
            waiting[:] = [agent for agent in waiting if agent in group.pools]
        evictions = "eviction" if group.statistics.evictions else "detours"
        group.set_stage_at_least("composite" if group.statistics.merged else evictions)
        return True

    def reschedule_last(self) -> None:
        """Reschedule the agent that arrives last, then some of those in its way, where this reduces the makespan."""
        group = self._group
        last = max(group.agents, key=lambda agent: group.schedules[agent].arrival)
        before, target = dict(group.schedules), (1.0 - _LEAST_GAIN) * group.makespan
        path = group.schedules[last].path
        near = group.in_the_way(path, group.scheduled_neighbors(last))
        chosen = group.rng.permutation(len(near))[: 1 + int(group.rng.integers(_NEIGHBORHOOD))]
        again = [last, *(near[i] for i in chosen.tolist())]
        for agent in again:
            del group.schedules[agent]
        for agent in again:
            # No detours for several arms: the diagrams of another path would cost more than everything else.
            detours = self._detours_of(agent) if len(agent.arms) == 1 else ()
            if not group.schedule(agent, target, detours) or group.schedules[agent].arrival > target:
                group.schedules = before
                return

    # ---- detours -----------------------------------------------------------------------------

    def _detours_of(self, agent: Agent) -> Iterator[AgentPath]:
        """A few more paths of an agent, searched for one at a time."""
        for _ in range(_DETOURS):
            if len(self._group.pools[agent].paths) >= _MOST_PATHS or not self._group.watch.goes_on():
                return
            made = self._detour(agent)
            if made is not None:
                yield made

    def _detour(self, agent: Agent) -> AgentPath | None:
        """One more path, around other agents at their goals or starts, or at random; None if none is found.

        The first one avoids all goals, the next one all starts, and the third one goals of scheduled and starts of
        other agents.
        """
        group, pool, number = self._group, self._group.pools[agent], self._detours[agent]
        self._detours[agent] += 1
        others = self._in_the_way(agent)
        goals = {other: self._goal_of(other) for other in others}
        starts = {other: other.start for other in others}
        scheduled = {other: goals[other] if other in group.schedules else starts[other] for other in others}
        kinds = [goals, starts, scheduled, {}]
        stationary = kinds[number] if number < 3 else kinds[int(group.rng.integers(len(kinds)))]
        began = time.perf_counter()
        configurations: dict[str, Array | None] = {}
        for other, q in stationary.items():
            if pool.ends_are_apart_from(other, q):
                configurations.update(other.split(q))
        by_chance = number >= 3 or not configurations
        # Paths in joint spaces of several arms differ without a random detour.
        path, _ = pool.add(configurations, detour=by_chance and len(agent.arms) == 1)
        group.statistics.add_time("paths", began)
        group.statistics.paths += 1
        group.statistics.detours += 1
        return path

    def _in_the_way(self, agent: Agent) -> list[Agent]:
        """Neighbors whose scheduled or first path conflicts with one of the agent's paths."""
        group, found = self._group, []
        for other in group.neighbors(agent, group.agents):
            theirs = group.schedules[other].path if other in group.schedules else group.pools[other].paths[0]
            if any(group.diagram(path, theirs) is not None for path in group.pools[agent].paths):
                found.append(other)
        return found

    def _goal_of(self, agent: Agent) -> Array:
        schedule = self._group.schedules.get(agent)
        return np.asarray(self._group.pools[agent].paths[0].goal if schedule is None else schedule.path.goal)

    # ---- eviction ----------------------------------------------------------------------------

    def _evict(self, agent: Agent) -> list[Agent] | None:
        """Schedule an agent by evicting others, at the lowest cost; returns these, or None if nothing helps.

        The cost is the number of evicted agents and of their previous evictions.
        """
        group = self._group
        others = group.scheduled_neighbors(agent)
        best: tuple[float, Schedule, list[Agent]] | None = None
        for path in group.pools[agent].paths:
            if not group.watch.goes_on():
                return None
            for victims in self._candidates(path, others):
                cost = sum(1.0 + self._evicted[v] for v in victims)
                if best is not None and cost >= best[0]:
                    continue
                kept = [o for o in others if o not in victims]
                schedule = group.timed(path, kept)
                if schedule is not None:
                    best = cost, schedule, victims
        if best is None:
            return None
        _, group.schedules[agent], victims = best
        for victim in victims:
            del group.schedules[victim]
            self._evicted[victim] += 1
            self._evictions_between[frozenset((agent, victim))] += 1
        group.statistics.evictions += len(victims)
        return victims

    def _candidates(self, path: AgentPath, others: list[Agent]) -> list[list[Agent]]:
        """Sets of agents whose eviction may make room for a path: each agent in the way, then all of them."""
        in_the_way = self._group.in_the_way(path, others)
        return [*([o] for o in in_the_way), in_the_way]

    def _merge_rivals(self, agent: Agent, evicted: list[Agent]) -> list[Agent]:
        """The agents to schedule next: the evicted ones; two that evict each other too often are merged."""
        for victim in evicted:
            together = {*agent.arms, *victim.arms}
            if self._evictions_between[frozenset((agent, victim))] < _MOST_EVICTIONS or len(together) > _MOST_TOGETHER:
                continue
            merged = self._merge([agent, victim])
            if merged is None:
                self._evictions_between[frozenset((agent, victim))] = -_MOST_EVICTIONS
                continue
            return [merged, *(v for v in evicted if v is not victim)]
        return evicted

    def _merge(self, agents: list[Agent]) -> Agent | None:
        """Merge agents into one with a path in the joint space of all their arms; None if none is found."""
        group = self._group
        pool = group.pool_of(arm for agent in agents for arm in agent.arms)
        if group.add_path(pool) is None:
            return None
        for old in agents:
            del group.pools[old]
            group.schedules.pop(old, None)
            group.agents.remove(old)
        group.agents.append(pool.agent)
        group.pools[pool.agent] = pool
        group.statistics.merged += 1
        return pool.agent
