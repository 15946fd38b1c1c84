"""Anytime improvement of schedules: neighborhoods, shortcuts of one arm, and shortcuts of a few arms as one.

Several kinds of moves are tried alternately (as by Huang et al., Benchmarking shortcutting techniques for
multi-robot-arm motion planning, 2025). A move changes a few schedules and is kept if it reduces the makespan, or the
sum of arrivals without increasing the makespan; otherwise it is undone. Coordination diagrams certify all schedules at
every time, so the search may stop after any move.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from itertools import pairwise

import numpy as np

from rr1plan.checks import Array
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.errors import RetimingError
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.paths.composite_waypoints import composite_waypoints
from rr1plan.multi.paths.path_pool import PathPool
from rr1plan.multi.paths.path_refinement import PathRefiner
from rr1plan.multi.plan_quality import PlanQuality, plan_quality
from rr1plan.multi.preflight import affordable_margin
from rr1plan.multi.search.agent_schedules import AgentSchedules
from rr1plan.multi.search.nearer_goals import NearerGoals
from rr1plan.multi.search.retreats import RetreatSearch
from rr1plan.multi.search.sequential_moves import SequentialMoves
from rr1plan.multi.timing.schedule import Schedule
from rr1plan.path import Path
from rr1plan.planners.shortcut import shorten
from rr1plan.retiming.path_blends import clean

# Largest number of agents rescheduled together, and of arms merged into one agent.
_NEIGHBORHOOD, _MOST_TOGETHER = 5, 4
# Number of paths kept per agent: the fastest, and those found last.
_PATHS = 6
# Random shortcuts of a path that is composed from schedules.
_SHORTCUTS = 120
# New paths slower than the plan by more than this ratio are not refined, because refinement saves less.
_WORTH_REFINING = 1.5
# Probabilities of choosing the agent that arrives last, of adding a new path to a neighborhood, and of ending it at
# another goal configuration of an arm.
_LAST_FIRST, _NEW_PATH, _NEW_GOAL = 0.7, 0.5, 0.5
# Moves between two removals of unused diagrams.
_FORGET_EVERY = 32
# Smaller improvements are considered rounding errors [ratio].
_LEAST_GAIN = 1e-6


class PlanImprover:
    """Improves the schedules of a plan.

    Args:
        plan: Schedules of all agents, certified against each other, which it changes.
        bounds: Duration of the fastest known motion of each arm alone [s].
        rng: Source of random numbers.
        goals: Other goal configurations of each arm that may have some.

    Attributes:
        plan: Like the argument; improved by each accepted move.
        bounds: Like the argument; updated when faster paths of single arms are found.
        iterations: Number of moves tried.
        history: Time of the plan's stopwatch and makespan [s] at each reduction of the makespan.
    """

    def __init__(
        self,
        plan: AgentSchedules,
        bounds: Mapping[str, float],
        rng: np.random.Generator,
        goals: Mapping[str, NearerGoals] | None = None,
    ) -> None:
        self.plan, self.bounds, self._rng, self._goals = plan, dict(bounds), rng, goals or {}
        self.iterations = 0
        self.history: list[tuple[float, float]] = []
        self._paths: dict[Agent, list[AgentPath]] = {}
        self._until = math.inf
        for schedule in plan.schedules.values():
            self._remember(schedule.path)
            self._bound_arms(schedule)

    @property
    def quality(self) -> PlanQuality:
        """Quality measures of the present schedules."""
        return plan_quality(self.plan.schedules.values(), self.bounds)

    def run(self, seconds: float = math.inf, iterations: int | None = None) -> None:
        """Try moves until the time or number of moves is used up, or no improvement is possible.

        Args:
            seconds: Wall time [s].
            iterations: Largest number of moves; None: no limit.
        """
        self._until = self.plan.watch.seconds + seconds
        crowded = any(len(agent.arms) > _MOST_TOGETHER for agent in self.plan.schedules)
        cheap = (self._replan_neighborhood, self._change_path, self._move_in_turn if crowded else self._change_path)
        moves = (*cheap, *cheap, self._move_as_one, *cheap, *cheap, self._move_apart)
        last = len(self.plan.schedules) if iterations is None else self.iterations + iterations
        while (iterations is None or self.iterations < last) and self._goes_on() and not self._is_best():
            move = moves[self.iterations % len(moves)]
            self.iterations += 1
            if self.iterations % _FORGET_EVERY == 0:
                self._forget_paths()
            before, cost = dict(self.plan.schedules), self._cost()
            if not move() or not _is_better(self._cost(), cost):
                self.plan.schedules = before
                continue
            for agent, schedule in self.plan.schedules.items():
                if before.get(agent) is not schedule:
                    self._bound_arms(schedule)
                    if schedule.path not in self._paths.setdefault(agent, []):
                        self._remember(schedule.path)
            if self._cost()[0] < cost[0]:
                self.history.append((self.plan.watch.seconds, self._cost()[0]))

    def _forget_paths(self) -> None:
        """Delete the diagrams of paths that are no longer kept, which are the majority."""
        known = [path for paths in self._paths.values() for path in paths]
        self.plan.diagrams.keep_only([*known, *(schedule.path for schedule in self.plan.schedules.values())])

    def _goes_on(self) -> bool:
        return self.plan.watch.goes_on() and self.plan.watch.seconds < self._until

    def _cost(self) -> tuple[float, float]:
        """Makespan [s], and sum of the arrivals of all arms [s]."""
        arrivals = [schedule.arrival for schedule in self.plan.schedules.values()]
        per_arm = math.fsum(s.arrival * len(agent.arms) for agent, s in self.plan.schedules.items())
        return max(arrivals, default=0.0), per_arm

    def _is_best(self) -> bool:
        """Whether each arm moves by itself, straight and at once to its only goal configuration, or rests at a goal."""
        return all(
            len(agent.arms) == 1
            and s.arrival == s.path.fastest
            and len(clean(s.path.path.waypoints)) <= 2
            and (s.arrival == 0.0 or agent.arms[0] not in self._goals)
            for agent, s in self.plan.schedules.items()
        )

    def _bound_arms(self, schedule: Schedule) -> None:
        """Lower the bounds of the arms alone to their arrivals in the plan."""
        for arm in schedule.path.agent.arms:
            self.bounds[arm] = min(self.bounds.get(arm, math.inf), schedule.arrival)

    # ---- agents and paths --------------------------------------------------------------------

    def _remember(self, path: AgentPath) -> None:
        """Add a path to those kept for its agent: the latest ones and the fastest."""
        paths = self._paths.setdefault(path.agent, [])
        paths.append(path)
        if len(paths) > _PATHS:
            fastest = min(paths, key=lambda known: known.fastest)
            oldest = next(known for known in paths if known is not fastest)
            oldest.release()
            paths.remove(oldest)
        if len(path.agent.arms) == 1:
            arm = path.agent.arms[0]
            self.bounds[arm] = min(self.bounds.get(arm, math.inf), path.fastest)

    def _certified(self, agent: Agent, waypoints: Array, shortcuts: int, margin: float) -> AgentPath | None:
        """A path of an agent, after random shortcuts; None if an edge of the waypoints is not free."""
        query = agent.query({}, margin)
        with checker_from_pool(query.scene, query.arms, margin) as checker:
            if not all(checker.edge_is_free(a, b) for a, b in pairwise(waypoints)):
                return None
            path = Path(agent.joint_names, waypoints)
            if shortcuts:
                path = shorten(path, query.scene, checker=checker, iterations=shortcuts, rng=self._rng)
            try:
                return AgentPath(agent, path, checker)
            except RetimingError:
                return None

    def _margin_at(self, agent: Agent, goal: Array) -> float:
        """The margin of an agent, or less if a nearer goal configuration (nq,) affords less [m]."""
        return affordable_margin(agent, goal, self.plan.margin_of(agent))

    @contextmanager
    def _refiner(self, path: AgentPath) -> Iterator[PathRefiner]:
        """A refiner of a path."""
        margin = self._margin_at(path.agent, path.goal)
        query = path.agent.query({}, margin)
        with checker_from_pool(query.scene, query.arms, margin) as checker:
            yield PathRefiner(checker, self._rng)

    # ---- neighborhoods -----------------------------------------------------------------------

    def _in_the_way(self, agent: Agent) -> list[Agent]:
        """Agents whose scheduled paths conflict with that of an agent."""
        plan = self.plan
        return plan.in_the_way(plan.schedules[agent].path, plan.neighbors(agent, plan.schedules))

    def _chosen_agent(self) -> Agent:
        """The agent that arrives last, or a random one."""
        agents = list(self.plan.schedules)
        if self._rng.random() < _LAST_FIRST:
            return max(agents, key=lambda agent: self.plan.schedules[agent].arrival)
        return agents[int(self._rng.integers(len(agents)))]

    def _neighborhood(self, first: Agent, count: int) -> list[Agent]:
        """An agent, some agents in its way, and some in the way of these."""
        chosen = [first]
        open_ = self._in_the_way(first)
        while open_ and len(chosen) < count:
            other = open_.pop(int(self._rng.integers(len(open_))))
            if other not in chosen:
                chosen.append(other)
                open_ += [agent for agent in self._in_the_way(other) if agent not in chosen]
        return chosen

    # ---- timing ------------------------------------------------------------------------------

    def _schedule(self, agent: Agent, paths: Iterable[AgentPath]) -> bool:
        """Schedule an agent on the path with the earliest arrival; returns whether one can be timed."""
        best: Schedule | None = None
        for path in sorted(paths, key=lambda path: path.fastest):
            if best is not None and best.arrival <= path.fastest:
                break
            found = self.plan.timed(path, self.plan.neighbors(agent, self.plan.schedules))
            if found is not None and (best is None or found.arrival < best.arrival):
                best = found
        if best is None:
            return False
        self.plan.schedules[agent] = best
        return True

    def _schedule_in_turn(self, agents: Iterable[Agent], makespan: float) -> bool:
        """Schedule agents one after the other; returns whether all arrive within the makespan."""
        for agent in agents:
            if not self._schedule(agent, self._paths[agent]) or self.plan.schedules[agent].arrival > makespan:
                return False
        return True

    # ---- moves: each returns whether all agents have a schedule -----------------------------------

    def _replan_neighborhood(self) -> bool:
        """Reschedule an agent, then some agents of its neighborhood in random order."""
        first, makespan = self._chosen_agent(), self._cost()[0]
        again = self._neighborhood(first, 1 + int(self._rng.integers(_NEIGHBORHOOD)))
        others = [again[1:][i] for i in self._rng.permutation(len(again) - 1).tolist()]
        if self._rng.random() < _NEW_PATH:
            self._find_path(again[int(self._rng.integers(len(again)))])
        for agent in again:
            del self.plan.schedules[agent]
        return self._schedule_in_turn([first, *others], makespan)

    def _find_path(self, agent: Agent) -> None:
        """One more path of an agent of few arms: around goals or starts of those in its way, or at random.

        It may end at another goal configuration.
        """
        if len(agent.arms) > _MOST_TOGETHER:
            return
        standing: dict[str, Array | None] = {}
        kind = int(self._rng.integers(4))
        if kind < 2:
            for other in self._in_the_way(agent):
                path = self.plan.schedules[other].path
                standing.update(other.split((path.goal, path.start)[kind]))
        goal = self._drawn_goal(agent)
        aimed = agent if self._goals.keys().isdisjoint(agent.arms) else agent.to(goal)
        margin = self._margin_at(agent, goal)
        path_found, _ = PathPool(aimed, margin, self._rng, self.plan.watch).add(standing, detour=kind == 2)
        if path_found is not None:
            self._remember(path_found.of(agent))

    def _drawn_goal(self, agent: Agent) -> Array:
        """The goal configuration of an agent's schedule, with random nearer ones of some of its arms, shape (nq,)."""
        schedule = self.plan.schedules[agent]
        goal: Array = schedule.path.goal.copy()
        for arm, columns in agent.columns.items():
            if arm in self._goals and self._rng.random() < _NEW_GOAL:
                nearer = self._goals[arm].before(schedule.arrival)
                if len(nearer):
                    goal[columns] = self._rng.choice(nearer)
        return goal

    def _change_path(self) -> bool:
        """Change the path of an agent at random and reschedule it, then the agents that may arrive earlier."""
        agent, makespan = self._chosen_agent(), self._cost()[0]
        path = self.plan.schedules[agent].path
        if len(agent.arms) > 1:
            made: AgentPath | None = self._refined(path)
        else:
            with self._refiner(path) as refiner:
                made = refiner.change(path, makespan)
        if made is None or not self._schedule(agent, [made]) or self.plan.schedules[agent].arrival > makespan:
            return False
        return self._schedule_in_turn(self._in_the_way(agent), makespan)

    def _move_as_one(self) -> bool:
        """Replace the motions of a few agents in each other's way by one path of all their arms, with shortcuts."""
        first = self._chosen_agent()
        chosen = self._neighborhood(first, 2 + int(self._rng.integers(2)))
        while sum(len(agent.arms) for agent in chosen) > _MOST_TOGETHER:
            chosen.pop()
        if len(chosen) < 2:
            return False
        together = self.plan.agent_of(arm for agent in chosen for arm in agent.arms)
        waypoints = composite_waypoints([self.plan.schedules[agent] for agent in chosen], together)
        made = self._certified(together, waypoints, _SHORTCUTS, self._margin_at(together, waypoints[-1]))
        if made is None:
            return False
        self._remember(made)
        for agent in chosen:
            del self.plan.schedules[agent]
        return self._schedule(together, self._paths[together])

    def _move_in_turn(self) -> bool:
        """Replan an agent of many arms: one arm at a time via new retreats, then with overlapping motions."""
        large = [agent for agent in self.plan.schedules if len(agent.arms) > _MOST_TOGETHER]
        if not large:
            return self._change_path()
        whole = large[int(self._rng.integers(len(large)))]
        watch = self.plan.watch.with_deadline(self._until - self.plan.watch.seconds)
        single = {arm: self.plan.agent_of([arm]) for arm in whole.arms}
        goal = self.plan.schedules[whole].path.goal
        margin = self._margin_at(whole, goal)
        retreats = RetreatSearch(whole, goal, single, self.plan.near, margin, self._rng, watch)
        points = next(SequentialMoves(whole, goal, retreats, margin, self._rng, watch).paths(), None)
        if points is None:
            return False
        pool = PathPool(whole, margin, self._rng, watch)
        try:
            path = pool.add_shortened(Path(whole.joint_names, points))
        except RetimingError:
            return False
        if path.fastest > _WORTH_REFINING * self.plan.schedules[whole].arrival:
            return False
        return self._schedule(whole, [self._refined(path)])

    def _refined(self, path: AgentPath) -> AgentPath:
        """A path of several arms after changes that save time."""
        with self._refiner(path) as refiner:
            return refiner.refine(path, self._goes_on)

    def _move_apart(self) -> bool:
        """Schedule the arms of an agent separately on their parts of its path, as they are or with shortcuts."""
        together = [agent for agent in self.plan.schedules if len(agent.arms) > 1]
        if not together:
            return self._change_path()
        whole, makespan = together[int(self._rng.integers(len(together)))], self._cost()[0]
        path = self.plan.schedules[whole].path
        margin, points = self._margin_at(whole, path.goal), path.path.waypoints
        parts = []
        for arm, columns in whole.columns.items():
            part, waypoints = self.plan.agent_of([arm]), points[:, columns]
            for shortcuts in (0, _SHORTCUTS):
                made = self._certified(part, waypoints, shortcuts, min(margin, self.plan.margin_of(part)))
                if made is not None:
                    self._remember(made)
            parts.append(part)
        del self.plan.schedules[whole]
        order = [parts[i] for i in self._rng.permutation(len(parts)).tolist()]
        return self._schedule_in_turn(order, makespan)


def _is_better(new: tuple[float, float], old: tuple[float, float]) -> bool:
    """Whether the makespan is shorter, or no longer with earlier arrivals."""
    if new[0] > old[0]:
        return False
    return new[0] < old[0] * (1.0 - _LEAST_GAIN) or new[1] < old[1] * (1.0 - _LEAST_GAIN)
