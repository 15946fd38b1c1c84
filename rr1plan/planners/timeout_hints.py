"""Hints why a search found no path: start or goal too close to contact, or pairs of links that separate the free space.

A pair of links separates start and goal if a path exists only when the pair is ignored. Such a pair is in contact
somewhere on every line from the start to a goal, so few pairs are candidates: each of them is ignored in turn and
the search repeated briefly, then all of them together, minus those that make no difference. A path found this way
is a hint, not a proof.

The time is taken from the budget of the search: a tenth of it and at most a second, and a twentieth of its
iterations. The limit of processor time is half of that, which leaves room for delays on a busy machine. A budget of
less than a second or a thousand iterations gets no hint.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from rr1plan.checks import Array
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.planners.goal_configurations import GoalSearch
from rr1plan.planners.planning_query import NO_LIMIT
from rr1plan.planners.rrt_connect import RrtConnect
from rr1plan.planning import CANCELLED, Budget, PlanResult, PlanStatus, Progress, ProgressCallback
from rr1plan.progress import REPORTS
from rr1plan.robot.contact_bands import ContactBand, contact_bands
from rr1plan.robot.link_contacts import LinkBodies, Pair
from rr1plan.scene import pair as unordered
from rr1plan.scene.held_contacts import allowed_entry
from rr1plan.scene.problem import Problem

_SHARE, _MOST_SECONDS = 0.1, 1.0
_ITERATIONS_SHARE = 0.05
# Limit of processor time, as a share of the wall time of a hint.
_PROCESSOR_SHARE = 0.5
_LEAST_SECONDS, _LEAST_ITERATIONS = 1.0, 1000
# Share of the time for searches; the rest is for describing their results.
_SEARCHES = 0.6
# Samples of each line per round: pairs in contact on much of a line are tried before those in narrow bands.
_ROUNDS = (20, 80, 320)
# Most goals to which lines are sampled.
_LINES = 4
# An arm and two of its links.
_LinksOfArm = tuple[str, Pair]


def split_budget(budget: Budget) -> tuple[Budget, Budget | None]:
    """Split a budget into one for the search and one for the hint; None if it is too small for a hint."""
    seconds, iterations = budget.seconds, budget.iterations
    if seconds < _LEAST_SECONDS or (iterations is not None and iterations < _LEAST_ITERATIONS):
        return budget, None
    reserve = min(_SHARE * seconds, _MOST_SECONDS) if math.isfinite(seconds) else math.inf
    extra = None if iterations is None else int(_ITERATIONS_SHARE * iterations)
    rest = seconds - reserve if math.isfinite(seconds) else math.inf
    return Budget(rest, iterations), Budget(reserve, extra)


def with_hint(problem: Problem, result: PlanResult, budget: Budget, progress: ProgressCallback | None) -> PlanResult:
    """The result with a hint why there may be no path added to its reason, if one is found within the budget.

    Args:
        problem: The planning problem.
        result: A result without a path.
        budget: Budget of the hint.
        progress: Called about ten times a second; False cancels, and the status is then `CANCELLED`.
    """
    search = _HintSearch(problem, result, budget, progress)
    hint = next(search.hints(), "")
    if search.cancelled:
        return replace(result, status=PlanStatus.CANCELLED, reason=CANCELLED)
    return replace(result, reason=f"{result.reason}; {hint}") if hint else result


class _HintSearch:
    """The search for hints under a time limit."""

    def __init__(self, problem: Problem, result: PlanResult, budget: Budget, progress: ProgressCallback | None) -> None:
        self._problem, self._budget, self._progress = problem, budget, progress
        self._seed, self._planner, self._before = result.seed, result.planner, result.seconds
        self._began, self._processor_began = time.perf_counter(), time.thread_time()
        self._reported = -math.inf
        self._iterations_left = NO_LIMIT if budget.iterations is None else budget.iterations
        self._bodies: dict[str, LinkBodies] = {}
        self.cancelled = False

    def hints(self) -> Iterator[str]:
        """Hints, the most certain first."""
        with checker_from_pool(self._problem.scene, self._problem.arms, self._problem.margin) as motions:
            goals = GoalSearch(self._problem, motions, self._seed).find().configurations
        tried: dict[_LinksOfArm, None] = {}
        for count in _ROUNDS:
            candidates = [key for key in self._pairs_on_the_way(goals[:_LINES], count) if key not in tried]
            for k, key in enumerate(candidates):
                if not self._goes_on():
                    return
                if self._solves_without([key], len(candidates) - k + 1):
                    yield self._describe([key])
            tried.update(dict.fromkeys(candidates))
        yield from self._several(list(tried))

    def _several(self, pairs: list[_LinksOfArm]) -> Iterator[str]:
        """Pairs that separate start and goal together but not alone."""
        if len(pairs) < 2 or not self._goes_on() or not self._solves_without(pairs, len(pairs) + 1):
            return
        for k, key in enumerate(list(pairs)):
            rest = [other for other in pairs if other != key]
            if not self._goes_on():
                return
            if self._solves_without(rest, len(pairs) - k + 1):
                pairs = rest
        yield self._describe(pairs)

    def _pairs_on_the_way(self, goals: Array, count: int) -> list[_LinksOfArm]:
        """Pairs of one arm's links in contact on the lines to all goals, by descending number of samples in contact.

        Args:
            goals: Goal configurations, shape (k, nq).
            count: Samples of each line.
        """
        start, shares = self._problem.start, np.linspace(0.0, 1.0, count + 2)[1:-1, None]
        lines = [start + shares * (goal - start) for goal in goals]
        counts = {(arm, links): n for arm in self._problem.arms for links, n in self._touching(arm, lines).items()}
        return sorted(counts, key=lambda key: (-counts[key], key[0], sorted(key[1])))

    def _touching(self, arm: str, lines: list[Array]) -> dict[Pair, int]:
        """Pairs of an arm's links in contact on all `lines`, with their numbers of samples in contact."""
        scene = self._problem.scene
        robot = scene.arms[arm].robot
        if arm not in self._bodies:
            self._bodies[arm] = LinkBodies(robot)
        bodies = self._bodies[arm]
        links = [pair for pair in bodies.pairs if not scene.may_touch(*(f"{arm}/{link}" for link in pair))]
        total: Counter[Pair] = Counter()
        for line in lines:
            found: Counter[Pair] = Counter()
            for q in line:
                if not self._goes_on():
                    return {}
                values = robot.joint_values(q[self._problem.columns[arm]])
                found.update(bodies.touching(values, links))
            # A pair without contact on one of the lines does not separate.
            links = [pair for pair in links if pair in found]
            total.update(found)
        return {pair: total[pair] for pair in links}

    def _solves_without(self, pairs: Sequence[_LinksOfArm], shares: int) -> bool:
        """Whether a brief search finds a path when `pairs` of links are ignored."""
        allowed = {unordered(*_elements(arm, links)) for arm, links in pairs}
        scene = self._problem.scene
        relaxed = self._problem.in_scene(replace(scene, allowed=scene.allowed | allowed))
        budget = Budget(max(1e-3, self._seconds_left / shares), max(1, self._iterations_left // shares))
        result = RrtConnect().plan(relaxed, budget=budget, rng=self._seed, progress=self._report)
        self._iterations_left -= result.iterations
        return result.found

    def _describe(self, pairs: Sequence[_LinksOfArm]) -> str:
        arms = ", ".join(dict.fromkeys(repr(arm) for arm, _ in pairs))
        several = len(pairs) > 1
        elements = [_elements(*key) for key in pairs]
        calls = "".join(f".allow({a!r}, {b!r})" for a, b in elements)
        return (
            f"start and goal of {arms} seem to be separated by {' and by '.join(map(self._described, pairs))}; "
            f"if that is an artifact of their shapes, allow the {'pairs' if several else 'pair'} (scene{calls}, in a "
            f"scene file {allowed_entry(elements)}), give an SRDF, or load the robot with convex='pieces'"
        )

    def _described(self, key: _LinksOfArm) -> str:
        arm, links = key
        robot, (a, b) = self._problem.scene.arms[arm].robot, sorted(links)
        bands = contact_bands(robot, [links], np.random.default_rng(self._seed), self._bodies[arm])
        where = " or ".join(
            f"{joint} is in {_intervals(bands, joint)}" for joint in dict.fromkeys(x.joint for x in bands)
        )
        when = f"they touch whenever {where}" if bands else "with this pair allowed there is a path"
        return f"{a!r} and {b!r}: {when}"

    # ---- the clock ------------------------------------------------------------------------

    @property
    def _seconds_left(self) -> float:
        """Wall time left [s]: the remaining processor time at its rate so far, within the budget."""
        budget = _SEARCHES * self._budget.seconds
        wall, processor = time.perf_counter() - self._began, time.thread_time() - self._processor_began
        pace = max(1.0, wall / processor) if processor > 0.0 else math.inf
        return min(budget - wall, pace * (_PROCESSOR_SHARE * budget - processor))

    def _goes_on(self) -> bool:
        """Whether time is left; reports progress about ten times a second."""
        now = time.perf_counter()
        if self._progress is not None and not self.cancelled and now - self._reported >= REPORTS:
            self._reported = now
            self._report()
        return not self.cancelled and self._seconds_left > 0.0 and self._iterations_left > 0

    def _report(self, _: Progress | None = None) -> bool:
        """Report a nearly used budget; whether to continue."""
        if self._progress is not None:
            seconds = self._before + time.perf_counter() - self._began
            self.cancelled = self._progress(Progress(self._planner, seconds, 1.0)) is False
        return not self.cancelled


def _elements(arm: str, links: Pair) -> tuple[str, str]:
    """The names of two links of an arm in the scene."""
    a, b = sorted(links)
    return f"{arm}/{a}", f"{arm}/{b}"


def _intervals(bands: Sequence[ContactBand], joint: str) -> str:
    return " or ".join(f"[{band.lower:.3g}, {band.upper:.3g}]" for band in bands if band.joint == joint)
