"""Prioritized planning on path pools, with detours, local eviction and coupled windows.

Agents are scheduled one after the other, each among the schedules of those before it (Erdmann and Lozano-Pérez 1987).
An agent for which no path of its pool can be timed gets detours; if none helps, it evicts the agents in its way, which
are rescheduled (as in large neighborhood search: Li et al., MAPF-LNS2, 2022). All other schedules are kept. Agents that
repeatedly evict each other are merged into one (a meta-agent: Sharon et al., Meta-agent conflict-based search, 2012),
which is planned in the joint space of all its arms.

For up to four arms, their joint space is searched first, which takes milliseconds. Groups of up to sixteen are then
coupled in time windows (`coupled_windows.py`), or move one arm at a time (`sequential_moves.py`); larger groups do so
if eviction does not terminate. The effort of both grows over the rounds.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import combinations
from typing import NamedTuple

import numpy as np

from rr1plan.checks import Array
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.errors import RetimingError
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.paths.path_pool import PathPool
from rr1plan.multi.paths.placed_path import placed_configuration
from rr1plan.multi.preflight import affordable_margin
from rr1plan.multi.search.coupled_windows import CoupledWindows
from rr1plan.multi.search.retreats import RetreatSearch
from rr1plan.multi.search.sequential_moves import SequentialMoves
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.multi.timing.coordination import Blocked, are_apart
from rr1plan.multi.timing.diagram_cache import DiagramCache
from rr1plan.multi.timing.safe_intervals import blocked_times, earliest_schedule
from rr1plan.multi.timing.schedule import Schedule
from rr1plan.path import Path

# Detours that are tried before another agent is evicted, and largest number of paths in a pool.
_DETOURS, _MOST_PATHS = 3, 12
# Number of evictions between two agents after which they are merged.
_MOST_EVICTIONS = 2
PLANNED_AS_ONE = 4
"""Largest number of agents of a group whose joint space is searched first."""
_STATIONARY = 0.7  # fraction of the other arms that an arm's initial path avoids in later rounds of windows
_ROUNDS_OF_SAME_EFFORT = 4  # rounds of windows and sequential moves until their effort is doubled
_ROUNDS_FIRST = 8  # rounds of windows and sequential moves before coordination diagrams are computed

STAGES = ("timing", "detours", "eviction", "composite", "windows", "sequential")
"""Stages of a search, in order of cost."""
_ATTEMPTS = 3  # attempts at a path in the joint space of a few arms
# Another method is tried if a plan takes longer than the slowest arm alone by more than this [ratio].
_SLOW = 0.3
NO_TIME = "no time was left to schedule it"
"""Reason of a group whose search did not begin."""
COUPLED_FIRST = 16
"""Largest number of agents of a group for which windows are tried before coordination diagrams are computed."""
# Largest number of arms of a merged agent; larger joint spaces need windows.
_MOST_TOGETHER = 4
# Evictions per agent between two rounds of windows and sequential moves.
_EVICTIONS = 3
# A makespan this close to its lower bound is not improved; improvement of a path stops even closer to it; smallest
# reduction that counts [ratios].
_GOOD_ENOUGH, _CLOSE, _LEAST_GAIN = 0.15, 0.05, 0.005
_NEIGHBORHOOD = 3  # largest number of agents that are rescheduled together with the last one


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


class _Plan(NamedTuple):
    """A snapshot of agents, pools and schedules, to restore later."""

    agents: list[Agent]
    pools: dict[Agent, PathPool]
    schedules: dict[Agent, Schedule]
    stage: str


class PrioritizedPlanner:
    """Schedules for the agents of one interaction group.

    Args:
        pools: The path pool of each agent, with its first path.
        near: For each arm, the arms that can collide with it.
        diagrams: Coordination diagrams, shared by groups.
        rng: Source of random numbers.
        watch: Stopwatch with the deadline.

    Attributes:
        threads: Number of threads that compute diagrams.
        schedules: Schedules of the agents that have one.
        stage: The stage that scheduled all agents, one of `STAGES`; empty before.
        reason: Why not all agents have a schedule; empty if unknown.
        impossible: Whether it is proven that some agents together have no path to their goal configurations.
        statistics: Counters of the search.
    """

    def __init__(
        self,
        pools: Iterable[PathPool],
        near: Mapping[str, frozenset[str]],
        diagrams: DiagramCache,
        rng: np.random.Generator,
        watch: Stopwatch,
    ) -> None:
        self._near, self._diagrams, self._rng, self._watch = near, diagrams, rng, watch
        self.pools = {pool.agent: pool for pool in pools}
        self.agents = list(self.pools)
        self.threads = 1
        self.schedules: dict[Agent, Schedule] = {}
        self.statistics = Statistics(paths=len(self.pools))
        self.stage = ""
        self.reason = ""
        self.impossible = False
        # Pools of single arms, which bound the makespan and provide the initial paths of windows.
        self._alone = {agent.arms[0]: pool for agent, pool in self.pools.items() if len(agent.arms) == 1}
        self._made = {frozenset(agent.arms): agent for agent in self.agents}
        self._margins: dict[Agent, float] = {}
        self._evicted: Counter[Agent] = Counter()
        self._evictions_between: Counter[frozenset[Agent]] = Counter()
        self._detours: Counter[Agent] = Counter()

    @property
    def arms(self) -> tuple[str, ...]:
        """The arms of all agents, in the order of the problem."""
        own = {arm for agent in self.agents for arm in agent.arms}
        return tuple(arm for arm in self.agents[0].problem.arms if arm in own)

    def join(self, other: PrioritizedPlanner) -> None:
        """Take over the agents of another group and, while time is left, their schedules without conflicts with ours.

        Args:
            other: The planner of that group, not used afterwards.
        """
        for agent in other.agents:
            theirs = other.schedules.get(agent)
            if theirs is not None and all(
                self._watch.goes_on() and self._diagrams.diagram(theirs.path, ours.path) is None
                for ours in self.schedules.values()
            ):
                self.schedules[agent] = theirs
        self.agents += other.agents
        self.pools |= other.pools
        self._alone |= other._alone
        self._made |= other._made
        self.stage = _later(self.stage, other.stage)

    # ---- the search ------------------------------------------------------------------------

    def run(self, rounds: float = math.inf) -> bool:
        """Schedule all agents; returns whether this succeeded in time.

        Args:
            rounds: Largest number of rounds of windows and sequential moves.
        """
        if not self._watch.goes_on():
            self.reason = NO_TIME
            return False
        effort = 0
        if not self.schedules and 1 < len(self.agents) <= COUPLED_FIRST:
            effort = int(min(rounds, _ROUNDS_FIRST))
            if self._plan_together(effort):
                return True
        found = effort < rounds and self._watch.goes_on() and not self.impossible and self._schedule_all(effort, rounds)
        if not found and not self.reason:
            self.reason = self._blocked_by([agent for agent in self.agents if agent not in self.schedules])
        return found

    def _schedule_all(self, effort: int, rounds: float) -> bool:
        """Schedule agents one by one, with windows and sequential moves in between; returns whether this succeeded.

        Args:
            effort: Number of the first round.
            rounds: Number of the round before which the search ends.
        """
        self._prepare_diagrams()
        waiting = self._time_first_paths()
        if not waiting:
            self.stage = _later(self.stage, "timing")
            return True
        while effort < rounds and self._watch.goes_on():
            most = self.statistics.evictions + _EVICTIONS * len(self.agents)
            if self._repair(waiting, most):
                self.stage = _later(self.stage, self._repair_stage())
                return True
            if not self._watch.goes_on():
                break
            if self._couple(effort) or self._move_in_turn(effort):
                return True
            effort += 1
            waiting = [agent for agent in self._slowest_first() if agent not in self.schedules]
        return False

    def _plan_together(self, rounds: int) -> bool:
        """Search with windows, sequential moves and a few arms as one; returns whether all agents are scheduled."""
        few = len(self.agents) <= PLANNED_AS_ONE
        if few and self._plan_few():
            return True
        for effort in range(rounds):
            if self.impossible or not self._watch.goes_on():
                return False
            if self._couple(effort) or self._move_in_turn(effort) or (few and self._plan_as_one(effort + 1)):
                return True
        return False

    def _slowest_first(self) -> list[Agent]:
        return sorted(self.agents, key=lambda agent: -self.pools[agent].paths[0].fastest)

    def _time_first_paths(self) -> list[Agent]:
        """Time the paths of agents without a schedule; returns the agents for which this failed."""
        limit = self._time_limit() if self._watch.goes_on() else 0.0
        return [
            agent
            for agent in self._slowest_first()
            if agent not in self.schedules and not self._schedule(agent, limit, detours=0)
        ]

    def _repair(self, waiting: list[Agent], most: int) -> bool:
        """Schedule agents with detours and evictions, up to a total of `most`; returns whether this succeeded."""
        while waiting:
            if not self._watch.goes_on() or self.statistics.evictions >= most:
                return False
            agent = waiting.pop(0)
            if self._schedule(agent, self._time_limit()):
                continue
            evicted = self._evict(agent)
            if evicted is None:
                waiting.insert(0, agent)
                return False
            waiting[:] = [*self._merge_rivals(agent, evicted), *waiting]
            waiting[:] = [agent for agent in waiting if agent in self.pools]
        return True

    def _repair_stage(self) -> str:
        if self.statistics.merged:
            return "composite"
        return "eviction" if self.statistics.evictions else "detours"

    # ---- joint spaces ----------------------------------------------------------------------

    def _plan_few(self) -> bool:
        """Plan a few agents as one; returns whether a path was found."""
        limit, pool = self._time_limit(), self._pool_of(self.arms)
        for _ in range(_ATTEMPTS):
            if self._add_path(pool) is None or min(path.fastest for path in pool.paths) <= limit:
                break
        return self._adopt([pool], "composite")

    def _plan_as_one(self, effort: int) -> bool:
        """Search for a path in the joint space of all arms; returns whether one was found."""
        pool = self._pool_of(self.arms)
        return self._add_path(pool, effort) is not None and self._adopt([pool], "composite")

    def _move_in_turn(self, effort: int) -> bool:
        """Plan all arms as one agent that moves one arm at a time via retreats; returns whether this succeeded."""
        if not self._watch.goes_on():
            return False
        began = time.perf_counter()
        pool, single = self._pool_of(self.arms), {arm: self._agent_of([arm]) for arm in self.arms}
        goal = np.concatenate([self._alone[arm].paths[0].goal for arm in pool.agent.arms])
        retreats = RetreatSearch(pool.agent, goal, single, self._near, pool.margin, self._rng, self._watch)
        moves = SequentialMoves(pool.agent, goal, retreats, pool.margin, self._rng, self._watch)
        for points in moves.paths(effort // _ROUNDS_OF_SAME_EFFORT):
            with suppress(RetimingError):
                pool.add_shortened([Path(pool.agent.joint_names, points)])
            if min((path.fastest for path in pool.paths), default=math.inf) <= self._slow_from():
                break
        self.statistics.add_time("sequential", began)
        return self._adopt([pool], "sequential")

    def _couple(self, effort: int) -> bool:
        """Couple arms in time windows around their conflicts; returns whether all agents have a schedule."""
        began = time.perf_counter()
        margin = self._pool_of(self.arms).margin
        starts = {arm: self._first_guess(arm, effort).path.waypoints for arm in self._alone}
        windows = CoupledWindows(starts, self._agent_of, margin, self._rng, self._watch)
        solved = windows.solve(effort // _ROUNDS_OF_SAME_EFFORT)
        self.statistics.windows += windows.windows
        self.statistics.add_time("windows", began)
        if not solved:
            return False
        # Sets of arms that shared no window are timed separately, or all arms move as one agent as in the windows.
        arms, sets = self.arms, windows.coupled_sets()
        found = self._adopt_windows(windows, sets)
        if len(sets) == 1 or (found and self.makespan <= self._slow_from()):
            return found
        separate = self._plan()
        arrival = self.makespan if found else math.inf
        as_one = self._adopt_windows(windows, [arms])
        if as_one and self.makespan > arrival:
            self._return_to(separate)
        return found or as_one

    def _first_guess(self, arm: str, effort: int) -> AgentPath:
        """Initial path of an arm for windows: its first, or in later rounds one around starts or goals of others."""
        pool = self._alone[arm]
        if effort == 0:
            return pool.paths[0]
        stationary: dict[str, Array | None] = {}
        for other in sorted(self._near[arm] & self._alone.keys()):
            theirs = self._alone[other]
            q = theirs.paths[0].goal if effort % 2 else theirs.agent.start
            # A random subset of the others varies the paths between rounds.
            if self._rng.random() < _STATIONARY and self._leaves_ends_free(pool, theirs.agent, q):
                stationary[other] = q
        path, _ = pool.add(stationary) if stationary else (None, "")
        return path or pool.paths[0]

    def _adopt_windows(self, windows: CoupledWindows, sets: Sequence[tuple[str, ...]]) -> bool:
        pools = []
        for arms in sets:
            pool, path = self._pool_of(arms), windows.path(arms)
            question = pool.agent.question({}, pool.margin)
            with checker_from_pool(question.scene, question.arms, pool.margin) as checker:
                if not checker.path_is_free(path):
                    return False
            try:
                pool.add_shortened([path])
            except RetimingError:
                return False
            pools.append(pool)
        # Without windows, the first paths are free of conflicts as they are.
        return self._adopt(pools, "windows" if windows.windows else "timing")

    def _adopt(self, pools: Sequence[PathPool], stage: str) -> bool:
        """Replace all agents by those of some pools if all of them can be timed; returns whether they can."""
        if not all(pool.paths for pool in pools):
            return False
        before = self._plan()
        self.agents = [pool.agent for pool in pools]
        self.pools = {pool.agent: pool for pool in pools}
        self.schedules = {}
        if self._time_first_paths():
            self._return_to(before)
            return False
        self.stage = stage
        return True

    def _plan(self) -> _Plan:
        return _Plan(list(self.agents), dict(self.pools), dict(self.schedules), self.stage)

    def _return_to(self, plan: _Plan) -> None:
        self.agents, self.pools = list(plan.agents), dict(plan.pools)
        self.schedules, self.stage = dict(plan.schedules), plan.stage

    def _agent_of(self, arms: Iterable[str]) -> Agent:
        """The agent of some arms, created once, because its scene caches derived data."""
        chosen = frozenset(arms)
        if chosen not in self._made:
            self._made[chosen] = Agent(self.agents[0].problem, chosen, self.agents[0].timing)
        return self._made[chosen]

    def _pool_of(self, arms: Iterable[str]) -> PathPool:
        """An empty pool for some arms as one agent, with the largest margin that their starts and goals allow."""
        agent = self._agent_of(arms)
        pools = [self._alone[arm] for arm in agent.arms]
        margin = min(pool.margin for pool in pools)
        if len(pools) > 1:
            # The arms keep the margin from each other, too.
            if agent not in self._margins:
                goal = np.concatenate([pool.paths[0].goal for pool in pools])
                self._margins[agent] = affordable_margin(agent, goal, margin)
            margin = self._margins[agent]
        return PathPool(agent, margin, self._rng, self._watch)

    def _add_path(self, pool: PathPool, effort: int = 0) -> AgentPath | None:
        """One more path from the start to the goal, regardless of other agents; None if none is found."""
        began = time.perf_counter()
        path, reason = pool.add({}, effort=effort)
        self.statistics.add_time("paths", began)
        self.statistics.paths += 1
        if pool.impossible:
            self.impossible, self.reason = True, reason
        return path

    def improve(self, rounds: int) -> None:
        """Reduce the makespan: reschedule the last agent first, then some of those in its way.

        Args:
            rounds: How often to try.
        """
        self._hasten()
        for _ in range(rounds if len(self.agents) > 1 else 0):
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
            # No detours for several arms: the diagrams of another path would cost more than everything else.
            tries = {agent: _DETOURS if len(agent.arms) == 1 else 0 for agent in again}
            if not all(
                self._schedule(agent, target, detours=count) and self.schedules[agent].arrival <= target
                for agent, count in tries.items()
            ):
                self.schedules = before

    def _hasten(self) -> None:
        """Make the paths of meta-agents faster."""
        alone, began = self.slowest_alone(), time.perf_counter()
        for agent in [agent for agent in self.agents if len(agent.arms) > 1]:
            before = self.schedules[agent]
            if before.arrival <= alone * (1.0 + _GOOD_ENOUGH) or not self._watch.goes_on():
                continue
            with suppress(RetimingError):
                path = self.pools[agent].add_refined(before.path, alone * (1.0 + _CLOSE))
                found = self._timed(path, self._others(agent)) if path.fastest < before.arrival else None
                if found is not None and found.arrival < before.arrival:
                    self.schedules[agent] = found
        self.statistics.add_time("paths", began)

    @property
    def makespan(self) -> float:
        """When the last agent arrives [s]."""
        return max((schedule.arrival for schedule in self.schedules.values()), default=0.0)

    def slowest_alone(self) -> float:
        """Duration of the fastest known motion of the slowest agent alone [s]."""
        return max(self.fastest_alone().values(), default=0.0)

    def fastest_alone(self) -> dict[str, float]:
        """Duration of the fastest known motion of each arm alone [s]."""
        # The motion of an arm together with others is also feasible alone.
        arrivals = {arm: schedule.arrival for agent, schedule in self.schedules.items() for arm in agent.arms}
        return {
            arm: min(arrivals.get(arm, math.inf), *(path.fastest for path in pool.paths))
            for arm, pool in self._alone.items()
        }

    def _slow_from(self) -> float:
        """Arrival above which another method is tried [s]."""
        alone = (min(path.fastest for path in pool.paths) for pool in self._alone.values())
        return max(alone, default=0.0) * (1.0 + _SLOW)

    def _time_limit(self) -> float:
        """Arrival up to which no better path is needed [s]: others arrive later anyway, or it is good enough."""
        return max(self.makespan, self.slowest_alone() * (1.0 + _GOOD_ENOUGH))

    def _schedule(self, agent: Agent, limit: float, *, detours: int | None = None) -> bool:
        """Time the paths of an agent, and detours until one arrives within the limit; returns whether one was timed."""
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
        """One more path, around other agents at their goals or starts, or at random; None if none is found.

        The first one avoids all goals, the next one all starts, and the third one goals of scheduled and starts of
        other agents.
        """
        number = self._detours[agent]
        self._detours[agent] += 1
        others = self._in_the_way(agent)
        goals = {other: self._goal_of(other) for other in others}
        starts = {other: other.start for other in others}
        scheduled = {other: goals[other] if other in self.schedules else starts[other] for other in others}
        kinds = [goals, starts, scheduled, {}]
        stationary = kinds[number] if number < 3 else kinds[int(self._rng.integers(len(kinds)))]
        began = time.perf_counter()
        configurations: dict[str, Array | None] = {}
        for other, q in stationary.items():
            if self._leaves_ends_free(self.pools[agent], other, q):
                configurations.update(self._split(other, q))
        by_chance = number >= 3 or not configurations
        # Paths in joint spaces of several arms differ without a random detour.
        path, _ = self.pools[agent].add(configurations, detour=by_chance and len(agent.arms) == 1)
        self.statistics.add_time("paths", began)
        self.statistics.paths += 1
        self.statistics.detours += 1
        return path

    def _in_the_way(self, agent: Agent) -> list[Agent]:
        """Neighbors whose scheduled or first path conflicts with one of the agent's paths."""
        paths, found = self.pools[agent].paths, []
        for other in self._neighbors(agent):
            theirs = self.schedules[other].path if other in self.schedules else self.pools[other].paths[0]
            if any(self._diagram(path, theirs) is not None for path in paths):
                found.append(other)
        return found

    def _leaves_ends_free(self, pool: PathPool, other: Agent, q: Array) -> bool:
        """Whether start and goal of the agent of a pool are free while another agent is at configuration `q`."""
        agent, placed = pool.agent, placed_configuration(other.bodies, q)
        return all(
            are_apart(agent, placed_configuration(agent.bodies, end), other, placed, pool.margin)
            for end in (agent.start, pool.paths[0].goal)
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
        """Schedule an agent by evicting others, at the lowest cost; returns these, or None if nothing helps.

        The cost is the number of evicted agents and of their previous evictions.
        """
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
            self._evictions_between[frozenset((agent, victim))] += 1
        self.statistics.evictions += len(victims)
        return victims

    def _candidates(self, path: AgentPath, others: list[Agent]) -> list[list[Agent]]:
        """Sets of agents whose eviction may make room for a path: each agent in the way, then all of them."""
        in_the_way = [o for o in others if self._diagram(path, self.schedules[o].path) is not None]
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
        pool = self._pool_of(arm for agent in agents for arm in agent.arms)
        if self._add_path(pool) is None:
            return None
        for old in agents:
            del self.pools[old]
            self.schedules.pop(old, None)
            self.agents.remove(old)
        self.agents.append(pool.agent)
        self.pools[pool.agent] = pool
        self.statistics.merged += 1
        return pool.agent

    # ---- timing ------------------------------------------------------------------------------

    def _neighbors(self, agent: Agent) -> list[Agent]:
        near = frozenset().union(*(self._near[arm] for arm in agent.arms))
        return [other for other in self.agents if other is not agent and not near.isdisjoint(other.arms)]

    def _others(self, agent: Agent) -> list[Agent]:
        """Neighbors that have a schedule."""
        return [other for other in self._neighbors(agent) if other in self.schedules]

    def _timed(self, path: AgentPath, others: Iterable[Agent]) -> Schedule | None:
        """The earliest schedule of a path among those of others; None if there is none or time runs out."""
        found = []
        for other in others:
            # A diagram may take long.
            if not self._watch.goes_on():
                return None
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
        """The extended diagram of two paths; None if all of it is free."""
        began, before = time.perf_counter(), len(self._diagrams)
        blocked = self._diagrams.diagram(one, two)
        if len(self._diagrams) > before:
            self.statistics.add_time("diagrams", began)
            self.statistics.diagrams += 1
        return blocked

    def _prepare_diagrams(self) -> None:
        """Compute the diagrams of all first paths in parallel."""
        began = time.perf_counter()
        paths = {arm: pool.paths[0] for pool in self.pools.values() for arm in pool.agent.arms}
        pairs = [(paths[a], paths[b]) for a, b in combinations(paths, 2) if b in self._near[a]]
        self._diagrams.prepare(
            [both for both in dict.fromkeys(pairs) if both[0] is not both[1]], self.threads, self._watch
        )
        self.statistics.add_time("diagrams", began)

    def _blocked_by(self, waiting: list[Agent]) -> str:
        texts: list[str] = []
        together: list[str] = []
        for agent in waiting:
            others = [arm for other in self._others(agent) for arm in other.arms]
            if others:
                texts.append(f"{' and '.join(agent.arms)} (among {', '.join(others)})")
            else:
                together += agent.arms
        if together:
            texts.insert(0, ", ".join(together) + (" among each other" if len(together) > 1 else ""))
        return f"no schedule found for {'; '.join(texts)}"


def _later(one: str, two: str) -> str:
    """The later one of two stages."""
    return max(one, two, key=("", *STAGES).index)


def _earlier(one: Schedule | None, two: Schedule | None) -> Schedule | None:
    if one is None or two is None:
        return one or two
    return two if two.arrival < one.arrival else one
