"""The agents of an interaction group, with their path pools and schedules."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain, combinations
from typing import NamedTuple

import numpy as np

from rr1plan.checks import listed
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.paths.path_pool import PathPool
from rr1plan.multi.search.agent_schedules import AgentSchedules
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.multi.timing.diagram_cache import DiagramCache
from rr1plan.multi.timing.schedule import Schedule
from rr1plan.planners.joint_barriers import find_joint_barrier

STAGES = ("timing", "detours", "eviction", "space-time", "composite", "windows", "sequential")
"""Stages of a search, in order of cost."""
# Ratios to the duration of the slowest arm alone: a makespan that is good enough, and one above which another method is
# tried.
_GOOD_ENOUGH, _SLOW = 1.15, 1.3


class Snapshot(NamedTuple):
    """Agents, pools and schedules of a group, to be restored later."""

    agents: list[Agent]
    pools: dict[Agent, PathPool]
    schedules: dict[Agent, Schedule]
    stage: str


class GroupSchedules(AgentSchedules):
    """The agents of one interaction group, their path pools, and the schedules of those that have one.

    Args:
        pools: The path pool of each arm, with its first path.
        near: For each arm, the arms that can collide with it.
        diagrams: Coordination diagrams, shared by groups.
        rng: Source of random numbers.
        watch: Stopwatch with the deadline.

    Attributes:
        agents: The agents; together they have all arms of the group.
        pools: The path pool of each agent.
        alone: Pools of single arms, which bound the makespan and provide the initial paths of other methods.
        stage: The stage that scheduled all agents, one of `STAGES`; empty before.
        reason: Why not all agents have a schedule; empty if unknown.
        impossible: Whether it is proven that some agents together have no path to their goal configurations.
    """

    def __init__(
        self,
        pools: Iterable[PathPool],
        near: Mapping[str, frozenset[str]],
        diagrams: DiagramCache,
        rng: np.random.Generator,
        watch: Stopwatch,
    ) -> None:
        self.rng = rng
        self.pools = {pool.agent: pool for pool in pools}
        self.agents = list(self.pools)
        margins = {agent.arms[0]: pool.margin for agent, pool in self.pools.items()}
        super().__init__(self.agents, margins, near, diagrams, watch)
        self.statistics.paths = len(self.pools)
        self.alone = {agent.arms[0]: pool for agent, pool in self.pools.items()}
        self.stage = ""
        self.reason = ""
        self.impossible = False

    @property
    def arms(self) -> tuple[str, ...]:
        """The arms of all agents, in the order of the problem."""
        own = {arm for agent in self.agents for arm in agent.arms}
        return tuple(arm for arm in self.agents[0].problem.arms if arm in own)

    def join(self, other: GroupSchedules) -> None:
        """Take over the agents of another group and, while time is left, their schedules without conflicts with ours.

        Args:
            other: The schedules of that group, not used afterwards.
        """
        for agent in other.agents:
            theirs = other.schedules.get(agent)
            if theirs is not None and all(
                self.watch.goes_on() and self.diagrams.diagram(theirs.path, ours.path) is None
                for ours in self.schedules.values()
            ):
                self.schedules[agent] = theirs
        self.agents += other.agents
        self.pools |= other.pools
        self.alone |= other.alone
        self._known |= other._known
        self._margins |= other._margins
        self.set_stage_at_least(other.stage)

    def set_stage_at_least(self, stage: str) -> None:
        """Note that a stage was needed, unless a later one already was."""
        self.stage = max(self.stage, stage, key=("", *STAGES).index)

    # ---- agents ----------------------------------------------------------------------------

    def pool_of(self, arms: Iterable[str]) -> PathPool:
        """An empty pool for some arms as one agent, with the largest margin that their starts and goals allow."""
        agent = self.agent_of(arms)
        return PathPool(agent, self.margin_of(agent), self.rng, self.watch)

    def add_path(self, pool: PathPool, effort: int = 0) -> AgentPath | None:
        """One more path from the start to the goal, regardless of other agents; None if none is found."""
        began = time.perf_counter()
        path, reason = pool.add({}, effort=effort)
        self.statistics.add_time("paths", began)
        self.statistics.paths += 1
        if pool.impossible:
            self.impossible, self.reason = True, reason
        return path

    def prove_separated(self) -> None:
        """Prove, if a joint cannot pass other arms or obstacles on its way to its goal, that there is no path."""
        agent = self.agent_of(self.arms)
        query, goal = agent.query({}, 0.0), np.concatenate([self.alone[arm].paths[0].goal for arm in agent.arms])
        with checker_from_pool(query.scene, query.arms) as checker:
            barrier = find_joint_barrier(checker, agent.start, goal, goes_on=self.watch.goes_on)
        if barrier is not None:
            self.impossible, self.reason = True, f"no path exists: {barrier}"

    def adopt(self, pools: Sequence[PathPool], stage: str) -> bool:
        """Replace all agents by those of some pools if all of them can be timed; returns whether they can."""
        if not all(pool.paths for pool in pools):
            return False
        before = self.snapshot()
        self.agents = [pool.agent for pool in pools]
        self.pools = {pool.agent: pool for pool in pools}
        self.schedules = {}
        if self.time_first_paths():
            self.restore(before)
            return False
        self.stage = stage
        return True

    def snapshot(self) -> Snapshot:
        """The present agents, pools and schedules."""
        return Snapshot(list(self.agents), dict(self.pools), dict(self.schedules), self.stage)

    def restore(self, before: Snapshot) -> None:
        """Return to the agents, pools and schedules of a snapshot."""
        self.agents, self.pools = list(before.agents), dict(before.pools)
        self.schedules, self.stage = dict(before.schedules), before.stage

    def scheduled_neighbors(self, agent: Agent) -> list[Agent]:
        """Agents that can collide with an agent and have a schedule."""
        return self.neighbors(agent, (other for other in self.agents if other in self.schedules))

    def slowest_first(self) -> list[Agent]:
        """All agents by the duration of their first path alone, descending."""
        return sorted(self.agents, key=lambda agent: -self.pools[agent].paths[0].fastest)

    # ---- durations -------------------------------------------------------------------------

    @property
    def makespan(self) -> float:
        """When the last agent arrives [s]."""
        return max((schedule.arrival for schedule in self.schedules.values()), default=0.0)

    def slowest_alone(self) -> float:
        """Duration of the fastest known motion of the slowest arm alone [s]."""
        return max(self.fastest_alone().values(), default=0.0)

    def fastest_alone(self) -> dict[str, float]:
        """Duration of the fastest known motion of each arm alone [s]."""
        # The motion of an arm together with others is also feasible alone.
        arrivals = {arm: schedule.arrival for agent, schedule in self.schedules.items() for arm in agent.arms}
        return {
            arm: min(arrivals.get(arm, math.inf), *(path.fastest for path in pool.paths))
            for arm, pool in self.alone.items()
        }

    def good_enough(self) -> float:
        """Makespan that is not reduced further [s]."""
        return self.slowest_alone() * _GOOD_ENOUGH

    def slow_from(self) -> float:
        """Makespan above which another method is tried [s]."""
        alone = (min(path.fastest for path in pool.paths) for pool in self.alone.values())
        return max(alone, default=0.0) * _SLOW

    def time_limit(self) -> float:
        """Arrival up to which no better path is needed [s]: others arrive later anyway, or it is good enough."""
        return max(self.makespan, self.good_enough())

    # ---- timing ----------------------------------------------------------------------------

    def time_first_paths(self) -> list[Agent]:
        """Time the paths of agents without a schedule; returns the agents for which this failed."""
        limit = self.time_limit() if self.watch.goes_on() else 0.0
        return [
            agent for agent in self.slowest_first() if agent not in self.schedules and not self.schedule(agent, limit)
        ]

    def schedule(self, agent: Agent, limit: float, detours: Iterable[AgentPath] = ()) -> bool:
        """Time the paths of an agent's pool, then detours, until one arrives within a limit.

        Args:
            agent: The agent.
            limit: Arrival up to which no better path is needed [s].
            detours: More paths, which are searched for only if they are needed.

        Returns:
            Whether any path could be timed; the agent then has the schedule that arrives first.
        """
        best: Schedule | None = None
        for path in chain(list(self.pools[agent].paths), detours):
            timed = self.timed(path, self.scheduled_neighbors(agent))
            if timed is not None and (best is None or timed.arrival < best.arrival):
                best = timed
            if best is not None and best.arrival <= limit:
                break
        for path in self.pools[agent].paths:
            if best is None or path is not best.path:
                path.release()
        if best is None:
            return False
        self.schedules[agent] = best
        return True

    def prepare_diagrams(self, threads: int) -> None:
        """Compute the diagrams of all first paths in parallel.

        Args:
            threads: Number of threads.
        """
        began = time.perf_counter()
        paths = {arm: pool.paths[0] for pool in self.pools.values() for arm in pool.agent.arms}
        pairs = [(paths[a], paths[b]) for a, b in combinations(paths, 2) if b in self.near[a]]
        self.diagrams.prepare([both for both in dict.fromkeys(pairs) if both[0] is not both[1]], threads)
        self.statistics.add_time("diagrams", began)

    def why_unscheduled(self) -> str:
        """The agents without a schedule, by the scheduled neighbors that may be in their way, as text."""
        among: dict[tuple[str, ...], list[str]] = {(): []}
        for agent in self.agents:
            if agent not in self.schedules:
                others = self._possible_blockers(agent)
                among.setdefault(others, []).extend([listed(agent.arms)] if others else agent.arms)
        texts = []
        for others, names in among.items():
            suffix = f" (among {', '.join(others)})" if others else " among each other" if len(names) > 1 else ""
            texts += [", ".join(names) + suffix] if names else []
        return f"no schedule found for {'; '.join(texts)}"

    def _possible_blockers(self, agent: Agent) -> tuple[str, ...]:
        """The arms of scheduled neighbors with which not all paths of an agent are known to be free of conflicts."""
        return tuple(
            arm
            for other in self.scheduled_neighbors(agent)
            if not all(
                self.diagrams.is_known_free(path, self.schedules[other].path) for path in self.pools[agent].paths
            )
            for arm in other.arms
        )
