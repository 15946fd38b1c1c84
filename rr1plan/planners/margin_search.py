"""Searches that keep a margin, and a smaller one where no path is found with it.

A margin may block every path: a passage may be narrower, or a goal pose too near to an obstacle. Where RRT-Connect has
used many samples with a margin, a brief search without it gets a sixteenth of them. If that finds a path, the margin is
what blocks, and it is halved until a search as brief succeeds. These are numbers of samples, so results do not depend
on the clock. Other planners do the same once, when nine tenths of the budget are used.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace

from rr1plan.checks import Array, millimeters, number_from_zero
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.planners import find_path, plan
from rr1plan.planners.goal_configurations import GoalSearch, joint_goals
from rr1plan.planners.rrt_connect import PausingRrtConnect, RrtConnect
from rr1plan.planners.timeout_hints import split_budget, with_hint
from rr1plan.planning import Budget, Planner, PlanResult, PlanStatus, Progress, ProgressCallback
from rr1plan.planning_constants import MARGINS
from rr1plan.scene.problem import Problem

# Shortest time of a brief search [s].
_LEAST_SECONDS = 1e-3


def halved_margin(problem: Problem, margin: float) -> float:
    """The margin [m], halved until the clearance of start and goal is twice as large, at most seven times below 2 mm.

    Of several goal configurations the one with the largest clearance counts; goal poses are not considered, because
    their configurations are not known yet. Elements that do not move relative to each other do not count.

    Raises:
        InputError: negative or not finite.
    """
    return _affordable(problem, number_from_zero("margin", margin), joint_goals(problem))


def _affordable(problem: Problem, margin: float, goals: Array | None) -> float:
    """The margin [m], halved until the clearance of the start and of a goal configuration (k, nq) is twice as large."""
    # The checker that will plan with the margin computes the clearance beyond it.
    with checker_from_pool(problem.scene, problem.arms, margin) as checker:
        checker.warm_up()
        rest = checker.moving_clearance(problem.start, margin)
        if goals is not None:
            rest = min(rest, max(checker.moving_clearance(q, margin) for q in goals))
    clearance = margin + rest
    return next((part for part in (margin, *_halves(margin)) if 2.0 * part <= clearance), 0.0)


def _affordable_at_poses(problem: Problem, margin: float, seed: int) -> float:
    """The same, with the configurations of goal poses that are found without a margin; 0 if none is found."""
    bare = problem.with_margin(0.0)
    with checker_from_pool(problem.scene, problem.arms) as checker:
        goals = GoalSearch(bare, checker, seed).find().configurations
    return _affordable(problem, margin, goals) if len(goals) else 0.0


def plan_with_margin(
    problem: Problem, margin: float, planner: Planner, budget: Budget, seed: int, progress: ProgressCallback | None
) -> tuple[PlanResult, float]:
    """The result of a planner, and the margin that its search kept.

    Args:
        problem: The planning problem; its own margin is ignored.
        margin: Margin to keep [m], which is halved and at last zero where no path with it is found.
        planner: The planner.
        budget: When to stop.
        seed: Seed of all random numbers.
        progress: Called about ten times a second; False cancels.
    """
    search = _MarginSearch(problem, planner, budget, seed, progress)
    result, kept = search.run(margin)
    if result.status is PlanStatus.INVALID_GOAL and kept > 0.0:
        result, kept = search.run(_affordable_at_poses(problem, margin, seed))
    for part in _halves(margin) if planner.keeps_shape else ():
        if result.status is PlanStatus.INFEASIBLE and kept > 0.0:
            result, kept = search.run(part)
    if result.status in (PlanStatus.INVALID_GOAL, PlanStatus.INFEASIBLE) and kept > 0.0:
        return search.run(0.0)
    return result, kept


def _halves(margin: float) -> Iterator[float]:
    """The margin halved once, twice, ... [m]: seven times below the default, without the margin itself and zero."""
    left = MARGINS.halvings
    while left:
        left -= margin <= MARGINS.default
        margin *= 0.5
        yield margin


class _MarginSearch:
    """Searches of one planner for one problem with several margins, within one budget."""

    def __init__(
        self, problem: Problem, planner: Planner, budget: Budget, seed: int, progress: ProgressCallback | None
    ) -> None:
        self._problem, self._planner, self._budget = problem, planner, budget
        self._seed, self._progress, self._fraction = seed, progress, 0.0
        self._less: tuple[PlanResult, float] | None = None

    def run(self, margin: float) -> tuple[PlanResult, float]:
        """The result of a search with a margin and, if that blocks, with a smaller one; and the margin kept."""
        if margin == 0.0:
            problem, progress = self._problem.with_margin(0.0), self._progress
            return plan(problem, planner=self._planner, budget=self._budget, rng=self._seed, progress=progress), 0.0
        search, rest = split_budget(self._budget)
        search, hint = split_budget(search)
        planner, began = self._planner, time.perf_counter()

        def is_blocked(samples: int) -> bool:
            left = max(_LEAST_SECONDS, search.seconds - (time.perf_counter() - began))
            self._search_with_less(margin, Budget(left, samples // MARGINS.ratio))
            return self._less is not None

        if type(planner) is RrtConnect:
            planner = PausingRrtConnect(planner, is_blocked)
        result = find_path(self._problem.with_margin(margin), planner, search, self._seed, self._report)
        if result.status is PlanStatus.TIMEOUT and self._less is None and rest is not None:
            self._search_with_less(margin, rest)
        if self._less is not None:
            return self._less
        if result.status is not PlanStatus.TIMEOUT:
            return result, margin
        if hint is not None and not planner.keeps_shape:
            result = with_hint(self._problem.with_margin(margin), result, hint, self._progress)
        kept = f"the search kept {millimeters(margin)} beyond the padding (option margin)"
        without = "" if rest is None else ", and a brief one without found no path"
        return replace(result, reason=f"{result.reason}; {kept}{without}"), margin

    def _search_with_less(self, margin: float, budget: Budget) -> None:
        """Set the result of a brief search with the largest half of a margin that finds a path, if any does."""
        bare = self._brief_search(0.0, budget)
        if bare.status is PlanStatus.TIMEOUT:
            return
        self._less = bare, 0.0
        if bare.found:
            halves = tuple(_halves(margin))
            left = max(_LEAST_SECONDS, (budget.seconds - bare.seconds) / len(halves))
            for part in halves:
                result = self._brief_search(part, replace(budget, seconds=left))
                if result.status in (PlanStatus.FOUND, PlanStatus.CANCELLED):
                    self._less = result, part
                    return

    def _brief_search(self, margin: float, budget: Budget) -> PlanResult:
        problem = self._problem.with_margin(margin)
        return find_path(problem, self._planner, budget, self._seed, self._report_within)

    def _report(self, part: Progress) -> bool | None:
        """Report the progress of the search with the margin."""
        self._fraction = part.fraction
        return None if self._progress is None else self._progress(part)

    def _report_within(self, part: Progress) -> bool | None:
        """Report that a brief search goes on, whose budget is a small part of the whole."""
        return self._report(replace(part, fraction=self._fraction))
