"""Anytime RRT-Connect: restarts under random cost bounds, with shortcuts, until the budget ends.

The first path is that of RRT-Connect, shortened. Each later round starts new trees with a random bound
on the path length and a limit on the number of samples (`rrt_connect.c`). The path of a round is shortened and
kept if it is the shortest so far.

The path length converges almost surely to the infimum over paths with positive clearance: the bounds are
random, so infinitely many rounds have a bound between the infimum and any larger length; the sample limits follow
Luby's sequence, so infinitely many of these rounds exceed any number of samples; and the probability that a
round finds a path below its bound tends to one with its number of samples. Poses and regions are reached in many
configurations, so later rounds also search for nearer ones.
"""

from __future__ import annotations

import math

import numpy as np

from rr1plan.checks import Array, Seed, number_from_zero
from rr1plan.kernels.random_state import draw_uniform
from rr1plan.planners.planning_query import NO_LIMIT, Query
from rr1plan.planners.tree_search import TreeSearch
from rr1plan.planning import Budget, Planner, PlanResult, PlanStatus, ProgressCallback
from rr1plan.scene.problem import Problem

_ROUND = 256  # samples of the shortest round
_SHORTCUTS = 100  # tried on each path
_STRAIGHT = 1.0 + 1e-9  # a path shorter than this multiple of the straight line cannot be improved
# Range of the bound, as a share of the best path's detour. Above one, because shortcuts may shorten a longer path.
_LEAST_SHARE, _MOST_SHARE = 0.75, 2.5


class AnytimePlanner(Planner):
    """Anytime RRT-Connect: restarts under decreasing cost bounds, with shortcuts, compiled.

    It is asymptotically optimal and uses the whole budget, unless the straight line to the nearest of all goals is free
    (a pose or a region may always have nearer ones) or a proof shows that no path exists. Under a budget of iterations
    alone the same seed gives the same path. An iteration is a sample.

    Args:
        range: Longest edge of a tree [rad or m]; 0: a share of the diagonal of the joint space.

    Raises:
        InputError: a negative range.
    """

    name = "anytime"

    def __init__(self, *, range: float = 0.0) -> None:
        self.range = number_from_zero("range", range)

    def __repr__(self) -> str:
        return f"AnytimePlanner(range={self.range})"

    def plan(
        self,
        problem: Problem,
        *,
        budget: Budget | None = None,
        rng: Seed = None,
        progress: ProgressCallback | None = None,
    ) -> PlanResult:
        """Plan; see `rr1plan.plan`."""
        with Query(self.name, problem, budget, rng, progress) as query:
            refused = query.early_exit()
            return _Rounds(query, self.range).run() if refused is None else refused


class _Rounds:
    """The rounds of one query and the best path so far."""

    def __init__(self, query: Query, step: float) -> None:
        self.query = query
        self.search = TreeSearch(query, step)
        self.best: Array | None = None
        self.length = math.inf

    @property
    def straight(self) -> float:
        """Length of the straight line to the nearest goal; no path is shorter."""
        return float(np.linalg.norm(self.query.goals[0] - self.query.problem.start))

    def run(self) -> PlanResult:
        """The best path when the budget ends."""
        query = self.query
        straight = query.straight_line()
        if straight is not None and straight.path is not None:
            if query.has_all_goals:
                return straight
            self.best, self.length = straight.path.waypoints, straight.path.length
        number = 0
        while query.goes_on() and not query.separated and self.may_improve():
            number += 1
            if self.best is not None and self.looks_for_goals(number):
                self.add_nearer_goals()
            if self.search.connect(*self.plan_round(number)):
                self.improve(self.search.trees.path())
        if self.best is None or query.cancelled:
            return query.unsolved(self.search.describe())
        return query.result(PlanStatus.FOUND, self.best)

    def may_improve(self) -> bool:
        """Whether a path shorter than the best one may exist."""
        return not self.query.has_all_goals or self.length > self.straight * _STRAIGHT

    def looks_for_goals(self, number: int) -> bool:
        """Whether a round begins with a search for nearer goals.

        Rounds of one arm always do. Combinations of the goals of several arms take thousands of collision checks, so
        only the rounds 1, 2, 4, 8, ... do.
        """
        return len(self.query.problem.arms) == 1 or number & (number - 1) == 0

    def add_nearer_goals(self) -> None:
        """Add further configurations of poses and regions, if a path to them may be shorter than the best one."""
        goals = self.query.more_goals()
        near = np.linalg.norm(goals - self.query.problem.start, axis=1) < self.length
        self.search.trees.add_goals(goals[near])

    def plan_round(self, number: int) -> tuple[float, int]:
        """Cost bound and sample limit of a round; unlimited until the first path is found."""
        if self.best is None:
            return math.inf, NO_LIMIT
        share = _LEAST_SHARE + (_MOST_SHARE - _LEAST_SHARE) * draw_uniform(self.search.state)
        return self.straight + share * (self.length - self.straight), _ROUND * luby(number)

    def improve(self, waypoints: Array) -> None:
        """Shorten a path, and keep it if it is the best."""
        path = self.query.shorten(waypoints, _SHORTCUTS, int(draw_uniform(self.search.state) * 2**53))
        if path.length < self.length:
            self.best, self.length = path.waypoints, path.length
            self.query.history.append((self.query.seconds, path.length))


def luby(number: int) -> int:
    """Term of Luby's sequence 1 1 2 1 1 2 4 1 1 2 ...

    (Luby, Sinclair, Zuckerman, Optimal speedup of Las Vegas algorithms, 1993)

    Args:
        number: Index of the term, from 1.
    """
    while True:
        bits = number.bit_length()
        if number == (1 << bits) - 1:
            return 1 << (bits - 1)
        number -= (1 << (bits - 1)) - 1
