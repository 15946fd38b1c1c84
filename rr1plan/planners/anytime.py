"""Shorter and shorter paths until the budget ends: RRT-Connect under a bound, shortened, again and again.

The first path is that of RRT-Connect, shortened. Then round follows round, each with fresh trees, a bound of its own
for the length of its path and a number of samples after which it is given up
(`rrt_connect.c`). What a round finds is shortened, and kept when it is the shortest so far.

The length goes to that of the shortest path (of those that leave some clearance) with probability one: bounds
are drawn, so that infinitely many rounds have one between the shortest length and any longer one, and
the numbers of samples are Luby's sequence, so that infinitely many of these rounds are longer than any number;
and a round that is long enough finds a path below its bound with a probability near to one.
"""

from __future__ import annotations

import math

import numpy as np

from rr1plan.checks import Array, Seed, finite_number
from rr1plan.errors import InputError
from rr1plan.kernels.random_state import draw_uniform
from rr1plan.path import Path
from rr1plan.planners.query import NO_LIMIT, Query
from rr1plan.planners.shortcut import shorten
from rr1plan.planners.tree_search import TreeSearch
from rr1plan.planning import Budget, Planner, PlanResult, PlanStatus, ProgressCallback
from rr1plan.problem import Problem

_ROUND = 256  # samples of the shortest round
_SHORTCUTS = 100  # tried on each path
_STRAIGHT = 1.0 + 1e-9  # a path this near to the straight line cannot be improved
# The bound lies between these shares of the best path's detour. Above one: what shortcuts gain is not known before.
_LEAST_SHARE, _MOST_SHARE = 0.75, 2.5


class AnytimePlanner(Planner):
    """The shortest path a budget allows: RRT-Connect under falling bounds, with shortcuts, compiled.

    It is asymptotically optimal and uses the whole budget, unless the straight line is free. Under a budget of
    iterations alone the same seed gives the same path. An iteration is a sample.

    Args:
        range: Longest edge of a tree [rad]; 0: a part of the diagonal of the joints' ranges.

    Raises:
        InputError: a negative range.
    """

    name = "anytime"
    optimizing = True

    def __init__(self, *, range: float = 0.0) -> None:
        self.range = finite_number("range", range)
        if self.range < 0.0:
            raise InputError(f"range is {self.range}, expected a length >= 0")

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
            refused = query.refusal()
            return _Rounds(query, self.range).run() if refused is None else refused


class _Rounds:
    """Rounds of one query, and the best path so far."""

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
        if straight is not None:
            return straight
        number = 0
        while query.goes_on() and self.length > self.straight * _STRAIGHT:
            number += 1
            if self.search.meets(*self.plan_round(number)):
                self.improve(self.search.trees.path())
        if self.best is None or query.cancelled:
            return query.unsolved(self.search.describe())
        return query.result(PlanStatus.FOUND, self.best)

    def plan_round(self, number: int) -> tuple[float, int]:
        """Bound of a round's path and how many samples it may take; no limit before there is a path."""
        if self.best is None:
            return math.inf, NO_LIMIT
        share = _LEAST_SHARE + (_MOST_SHARE - _LEAST_SHARE) * draw_uniform(self.search.state)
        return self.straight + share * (self.length - self.straight), _ROUND * luby(number)

    def improve(self, waypoints: Array) -> None:
        """Shorten a path, and keep it when it is the best."""
        query, motion = self.query, self.query.motion
        checked = motion.edges_checked
        path = Path.trusted(motion.joint_names, waypoints)
        seed = int(draw_uniform(self.search.state) * 2**53)
        path = shorten(
            path,
            query.problem.scene,
            checker=motion,
            iterations=_SHORTCUTS,
            seconds=max(query.seconds_left, 1e-6),
            rng=seed,
        )
        query.edges += motion.edges_checked - checked
        if path.length < self.length:
            self.best, self.length = path.waypoints, path.length
            query.history.append((query.seconds, path.length))


def luby(number: int) -> int:
    """Term of the sequence 1 1 2 1 1 2 4 1 1 2 ...

    (Luby, Sinclair, Zuckerman, Optimal speedup of Las Vegas algorithms, 1993)

    Args:
        number: Which, from 1 on.
    """
    while True:
        bits = number.bit_length()
        if number == (1 << bits) - 1:
            return 1 << (bits - 1)
        number -= (1 << (bits - 1)) - 1
