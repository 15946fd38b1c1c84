"""Schedules of agents, timed among each other; coordination diagrams certify that they have no conflicts."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.preflight import affordable_margin
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.multi.timing.coordination import Blocked
from rr1plan.multi.timing.diagram_cache import DiagramCache
from rr1plan.multi.timing.safe_intervals import blocked_times, earliest_schedule
from rr1plan.multi.timing.schedule import Schedule
from rr1plan.planners.goal_configurations import joint_goals


@dataclass
class Statistics:
    """Counters of a search for schedules."""

    paths: int = 0
    detours: int = 0
    diagrams: int = 0
    timings: int = 0
    evictions: int = 0
    merged: int = 0
    windows: int = 0
    seconds: dict[str, float] = field(default_factory=dict)

    def add_time(self, stage: str, began: float) -> None:
        """Add the wall time since `began` to a stage."""
        self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - began


class AgentSchedules:
    """The schedules of agents: single arms, and several arms that are planned in their joint space.

    Args:
        agents: Known agents, among them that of each single arm; the goal of each arm is one configuration.
        margins: Clearance of each arm from stationary objects, in addition to the padding [m].
        near: For each arm, the arms that can collide with it.
        diagrams: Coordination diagrams.
        watch: Stopwatch with the deadline.

    Attributes:
        schedules: Schedules of the agents that have one.
        statistics: Counters of the search.
    """

    def __init__(
        self,
        agents: Iterable[Agent],
        margins: Mapping[str, float],
        near: Mapping[str, frozenset[str]],
        diagrams: DiagramCache,
        watch: Stopwatch,
    ) -> None:
        self.near, self.diagrams, self.watch = near, diagrams, watch
        self.schedules: dict[Agent, Schedule] = {}
        self.statistics = Statistics()
        self._known = {frozenset(agent.arms): agent for agent in agents}
        self._margins: dict[tuple[str, ...], float] = {(arm,): margin for arm, margin in margins.items()}

    def agent_of(self, arms: Iterable[str]) -> Agent:
        """The agent of some arms, created once, because its scene caches derived data."""
        chosen = frozenset(arms)
        if chosen not in self._known:
            like = next(iter(self._known.values()))
            self._known[chosen] = Agent(like.problem, chosen, like.timing)
        return self._known[chosen]

    def margin_of(self, agent: Agent) -> float:
        """The largest clearance that an agent's start and goal allow, in addition to the padding [m].

        Its arms keep it from stationary objects and from each other.
        """
        if agent.arms not in self._margins:
            goals = joint_goals(agent.query({}, 0.0))
            assert goals is not None
            margin = min(self._margins[arm,] for arm in agent.arms)
            self._margins[agent.arms] = affordable_margin(agent, goals[0], margin)
        return self._margins[agent.arms]

    def neighbors(self, agent: Agent, among: Iterable[Agent]) -> list[Agent]:
        """Those of some agents that can collide with an agent."""
        near = frozenset().union(*(self.near[arm] for arm in agent.arms))
        return [other for other in among if other is not agent and not near.isdisjoint(other.arms)]

    def in_the_way(self, path: AgentPath, among: Iterable[Agent]) -> list[Agent]:
        """Those of some agents whose scheduled paths conflict with a path."""
        return [other for other in among if self.diagram(path, self.schedules[other].path) is not None]

    def timed(self, path: AgentPath, others: Iterable[Agent]) -> Schedule | None:
        """The earliest schedule of a path among those of others; None if there is none or time runs out."""
        found = []
        for other in others:
            # A diagram may take long.
            if not self.watch.goes_on():
                return None
            theirs = self.schedules[other]
            blocked = self.diagram(path, theirs.path)
            if blocked is not None:
                found.append((blocked, theirs.occupancy))
        began = time.perf_counter()
        schedule = earliest_schedule(path, blocked_times(found), self.watch.goes_on)
        self.statistics.add_time("timing", began)
        self.statistics.timings += 1
        return schedule

    def diagram(self, one: AgentPath, two: AgentPath) -> Blocked | None:
        """The extended diagram of two paths; None if all of it is free."""
        began, before = time.perf_counter(), len(self.diagrams)
        blocked = self.diagrams.diagram(one, two)
        if len(self.diagrams) > before:
            self.statistics.add_time("diagrams", began)
            self.statistics.diagrams += 1
        return blocked
