"""Path pools: several paths of one agent, found by the planner of single arms among stationary ones.

The first path of a pool ignores the others. Later ones are detours: around the goals or the starts of others, and
through random configurations, which lets idle agents step aside and return.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rr1plan.checks import Array
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.errors import RetimingError
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.paths.path_refinement import PathRefiner
from rr1plan.multi.paths.placed_path import placed_configuration
from rr1plan.multi.preflight import MARGINS, margins_up_to
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.multi.timing.coordination import are_apart
from rr1plan.path import Path
from rr1plan.planners import RrtConnect
from rr1plan.planners.shortcut import shorten
from rr1plan.planners.timeout_hints import split_budget, with_hint
from rr1plan.planning import Budget, PlanResult, PlanStatus, Progress
from rr1plan.scene.problem import JointGoal, Problem

_SHORTCUTS = 48
_ITERATIONS = 2000  # of the planner, per arm of an agent
_NO_LIMIT = 2**62
_SAMPLES = 20  # random configurations tried as intermediate point


class PathPool:
    """Paths of an agent.

    Args:
        agent: The agent.
        margin: Distance that they keep from stationary objects in addition to the padding [m].
        rng: Where random numbers come from.
        watch: Deadline (default: none).

    Attributes:
        margin: This distance, or a smaller one for which a patient search found a path.
        paths: The paths found so far.
        impossible: Whether the last search has proven that there is no path among stationary objects.
    """

    def __init__(self, agent: Agent, margin: float, rng: np.random.Generator, watch: Stopwatch | None = None) -> None:
        self.agent, self.margin, self._rng = agent, margin, rng
        self._watch = watch or Stopwatch(np.inf)
        self.paths: list[AgentPath] = []
        self.impossible = False
        self._searched: dict[float, None] = {}  # margins of all searches, in order

    def add(
        self, others: Mapping[str, Array | None], *, detour: bool = False, effort: int = 0, patient: bool = False
    ) -> tuple[AgentPath | None, str]:
        """Search for another path.

        Args:
            others: Moving arms of the problem that it has to avoid, each at a configuration (nq,).
            detour: Whether it has to go through a random configuration.
            effort: Number of doublings of the iterations after which a hard search is abandoned.
            patient: Whether to use all of the time, also with smaller margins, and then to search for a hint why
                there is no path; otherwise a hard search is abandoned early.

        Returns:
            The path, which has been added to the pool, or None and the reason.

        Raises:
            RetimingError: a patient search found a path on which a joint without a limit moves.
        """
        query = self.agent.query(others, self.margin)
        via = self._via(query) if detour else None
        if detour and via is None:
            return None, "no random configuration is free"
        parts: list[Path] = []
        for leg in [query] if via is None else _split(self.agent, query, via):
            result = self._plan(leg, effort, patient=patient)
            self.impossible = result.status is PlanStatus.INFEASIBLE
            if result.path is None:
                # The planner's callback also ends the search when the time is over.
                late = result.status is PlanStatus.CANCELLED and not self._watch.cancelled
                reason = f"no path found in {self._watch.seconds:.3g} s" if late else result.reason
                return None, f"{reason}{self._kept_margin()}" if late or result.status is PlanStatus.TIMEOUT else reason
            parts.append(result.path)
        query = query.with_margin(self.margin)
        points = self._shortened(parts, query)
        if patient:
            self.agent.check_limits(points)
        try:
            return self._add(points, query), ""
        except RetimingError as error:
            return None, str(error)

    def ends_are_apart_from(self, other: Agent, q: Array) -> bool:
        """Whether the agent keeps the margin from another one at its start and at the goal of its first path.

        Args:
            other: Another agent.
            q: Configuration of the other agent, shape (nq,).
        """
        placed = placed_configuration(other.bodies, q)
        return all(
            are_apart(self.agent, placed_configuration(self.agent.bodies, end), other, placed, self.margin)
            for end in (self.agent.start, self.paths[0].goal)
        )

    def _shortened(self, parts: Sequence[Path], query: Problem) -> Array:
        """Waypoints of a path in parts, each shortened separately, shape (n, nq)."""
        shorter: list[Array] = []
        with checker_from_pool(query.scene, query.arms, self.margin) as checker:
            for part in parts:
                points = shorten(
                    part,
                    query.scene,
                    checker=checker,
                    iterations=_SHORTCUTS,
                    seconds=self._watch.time_left,
                    rng=self._rng,
                ).waypoints
                # For joints that wrap, the planner may end some whole turns away.
                shorter.append(points + (shorter[-1][-1] - points[0]) if shorter else points)
        return np.concatenate(shorter)

    def add_shortened(self, path: Path) -> AgentPath:
        """Shorten a path that is certified among stationary objects, round its corners, and add it.

        Args:
            path: The path.

        Raises:
            RetimingError: it cannot be timed under the limits.
        """
        query = self.agent.query({}, self.margin)
        return self._add(self._shortened([path], query), query)

    def _add(self, points: Array, query: Problem) -> AgentPath:
        """Round the corners of a path with waypoints (n, nq), and add it."""
        with checker_from_pool(query.scene, query.arms, self.margin) as checker:
            path = AgentPath(self.agent, Path(self.agent.joint_names, points), checker)
        self.paths.append(path)
        return path

    def add_refined(self, path: AgentPath, enough: float) -> AgentPath:
        """Add a path made from another one by changes that save time, or the same path if none does.

        Args:
            path: A path of the agent, of several arms.
            enough: Duration that is not reduced further [s].
        """
        query = self.agent.query({}, self.margin)
        with checker_from_pool(query.scene, query.arms, self.margin) as checker:
            refiner = PathRefiner(checker, self._rng)
            made = refiner.refine(path, self._watch.goes_on, enough)
        self.paths.append(made)
        return made

    def _kept_margin(self) -> str:
        """The margins, which may have closed narrow passages, as the end of a reason; empty if there were none."""
        kept = " or ".join(f"{1000.0 * margin:.3g}" for margin in self._searched)
        return f"; the search kept {kept} mm beyond the padding (option margin)" if 0.0 not in self._searched else ""

    def _plan(self, leg: Problem, effort: int, *, patient: bool) -> PlanResult:
        if patient:
            return self._plan_patiently(leg)
        return self._search(leg, self._watch, _ITERATIONS * len(self.agent.arms) << effort)

    def _plan_patiently(self, leg: Problem) -> PlanResult:
        """Search with growing effort, in turn with the margin and with the least one, which a narrow passage may need.

        Effort is counted in iterations, so that the path does not depend on the speed of the machine.
        """
        seconds, most = self._watch.time_left, self._watch.iterations
        budget, rest = split_budget(Budget(seconds, _NO_LIMIT if most is None and math.isinf(seconds) else most))
        search = self._watch.with_deadline(budget.seconds)
        iterations, searches, used = _ITERATIONS * len(self.agent.arms), 0, 0
        while True:
            for margin in dict.fromkeys((self.margin, min(self.margin, MARGINS[-1]))):
                result, searches = self._search(leg.with_margin(margin), search, iterations), searches + 1
                used += result.iterations
                if result.found:
                    return result if margin == self.margin else self._with_most_margin(leg, result, search, iterations)
                if result.status is not PlanStatus.TIMEOUT:
                    return result
                if not search.goes_on() or (most is not None and used >= most):
                    if searches > 1:
                        result = replace(result, reason=f"{result.reason}; this was the last of {searches} searches")
                    return result if rest is None else with_hint(leg, result, rest, self._report)
            iterations *= 2

    def _report(self, progress: Progress) -> bool:
        """Progress callback for hints, which have a budget of their own: only cancelling ends them."""
        self._watch.let_planner_go_on(progress)
        return not self._watch.cancelled

    def _with_most_margin(self, leg: Problem, found: PlanResult, search: Stopwatch, iterations: int) -> PlanResult:
        """A path with the largest of the smaller margins for which one is found, or else the one with the least."""
        largest, self.margin = self.margin, MARGINS[-1]
        for margin in (m for m in margins_up_to(largest) if MARGINS[-1] < m < largest):
            result = self._search(leg.with_margin(margin), search, iterations)
            if result.found:
                self.margin = margin
                return result
        return found

    def _search(self, leg: Problem, watch: Stopwatch, iterations: int) -> PlanResult:
        self._searched[leg.margin] = None
        budget = Budget(watch.time_left, iterations)
        return RrtConnect().plan(leg, budget=budget, rng=self._rng, progress=self._watch.let_planner_go_on)

    def _via(self, query: Problem) -> Array | None:
        """A random free configuration, nearer ones more often."""
        limits = self.agent.limits
        goals = [self.agent.problem.goal[arm][0] for arm in self.agent.arms]
        ends = [g.q for g in goals if isinstance(g, JointGoal)]
        goal = np.concatenate(ends) if len(ends) == len(goals) else self.agent.start
        low = np.where(np.isfinite(limits.lower), limits.lower, -np.pi)
        high = np.where(np.isfinite(limits.upper), limits.upper, np.pi)
        with checker_from_pool(query.scene, query.arms, self.margin) as checker:
            for _ in range(_SAMPLES):
                middle = self.agent.start + self._rng.random() * (goal - self.agent.start)
                share = self._rng.random()
                q = np.clip(middle + share * (self._rng.uniform(low, high) - middle), low, high)
                if checker.is_free(q):
                    return np.asarray(q)
        return None


def _split(agent: Agent, query: Problem, via: Array) -> list[Problem]:
    """The problems from the start of an agent to a configuration, and from there to the goal."""
    begin, between = agent.split(agent.start), agent.split(via)
    return [
        Problem(query.scene, begin, between, arms=agent.arms).with_margin(query.margin),
        Problem(query.scene, between, dict(query.goal), arms=agent.arms).with_margin(query.margin),
    ]
