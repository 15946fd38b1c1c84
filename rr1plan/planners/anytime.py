"""Shorter and shorter paths until the budget ends: RRT-Connect under a bound, shortened, again and again.

The first path is that of RRT-Connect, shortened. Then round follows round, each with fresh trees, a bound of its own
for the length of its path and a number of samples after which it is given up
(`rr1plan._kernels.bounded_trees`). What a round finds is shortened, and kept when it is the shortest so far.

The length goes to that of the shortest path (of those that leave some clearance) with probability one: bounds
are drawn, so that infinitely many rounds have one between the shortest length and any longer one, and
the numbers of samples are Luby's sequence, so that infinitely many of these rounds are longer than any number;
and a round that is long enough finds a path below its bound with a probability near to one.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rr1plan._kernels import bounded_trees as kernel
from rr1plan._kernels.generator import draw
from rr1plan._kernels.rrt_connect import trace
from rr1plan.checks import Array, Seed, finite_number, of_kind
from rr1plan.collision.shelf import borrowed_checker
from rr1plan.errors import InputError
from rr1plan.path import Path
from rr1plan.planners.query import NO_LIMIT, Query
from rr1plan.planners.seeds import as_seed, generator_state
from rr1plan.planners.shortcut import shorten
from rr1plan.planners.space import Space
from rr1plan.planning import Budget, PlanResult, PlanStatus, ProgressCallback
from rr1plan.problem import Problem

# The kernels are not typed.
_grow: Callable[..., int] = kernel.grow_bounded
_trace: Callable[..., Array] = trace
_draw: Callable[..., float] = draw

_STEP = 0.08  # longest edge of a tree, as a part of the space's diagonal
_SHORTEST = 1e-4  # the least that may be set, the same way
_DOMAIN = 0.2  # how near to a vertex that has met an obstacle samples have to be, the same way
_CAPACITY = 1024  # vertices of each tree to begin with
_ROUND = 256  # samples of the shortest round
_SHORTCUTS = 300  # tried on each path
_STRAIGHT = 1.0 + 1e-9  # a path this near to the straight line cannot be improved
# The bound lies between these shares of the best path's detour. Above one: what shortcuts gain is not known before.
_LEAST_SHARE, _MOST_SHARE = 0.75, 2.5


class AnytimePlanner:
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
            raise InputError(f"range is {range}, expected a length >= 0")

    def __repr__(self) -> str:
        return f"AnytimePlanner(range={self.range})"

    def plan(
        self,
        problem: Problem,
        budget: Budget | None = None,
        rng: Seed = None,
        progress: ProgressCallback | None = None,
    ) -> PlanResult:
        """Plan; see `rr1plan.plan`."""
        of_kind("problem", problem, Problem)
        began = time.perf_counter()
        with borrowed_checker(problem.scene, problem.arms) as motion:
            query = Query(self.name, problem, motion, budget, as_seed(rng), progress, began)
            return query.refusal() or _Rounds(query, self.range).run()


class _Rounds:
    """Rounds of one query, and the best path so far."""

    def __init__(self, query: Query, step: float) -> None:
        self.query = query
        self.space = Space.around(query.problem, query.goals)
        diagonal = self.space.diagonal
        self.step, self.domain = step or _STEP * diagonal, _DOMAIN * diagonal
        if self.step < _SHORTEST * diagonal:
            raise InputError(f"range is {step:g}, expected at least {_SHORTEST * diagonal:.3g} for these joints")
        self.state = generator_state(query.seed)
        self.best: Array | None = None
        self.length = math.inf
        # No path is shorter than the straight line to the nearest goal.
        self.straight = float(np.linalg.norm(query.goals[0] - query.problem.start))

    def run(self) -> PlanResult:
        """The best path when the budget ends."""
        query = self.query
        if not self.space.movable.any():
            return query.result(PlanStatus.INFEASIBLE, reason="no joint can move, and the start is not a goal")
        query.edges += 1
        if query.motion.edge_is_free(query.problem.start, query.goals[0]):
            return query.result(PlanStatus.SOLVED, np.array([query.problem.start, query.goals[0]]))
        trees = _Trees(query.problem.start, query.goals)
        number = 0
        while not query.over and self.length > self.straight * _STRAIGHT:
            number += 1
            bound, samples = self.plan_round(number)
            status = self.grow(trees, bound, samples)
            if status is PlanStatus.CANCELLED:
                return query.result(status, reason="the progress callback returned False")
            if status is PlanStatus.SOLVED:
                self.improve(trees.path())
        if self.best is None:
            of_start, of_goal = trees.counts[:2].tolist()
            return query.out_of_budget(
                f"{of_start} configurations were reached from the start, {of_goal} from the goal"
            )
        return query.result(PlanStatus.SOLVED, self.best)

    def plan_round(self, number: int) -> tuple[float, int]:
        """Bound of a round's path and how many samples it may take; no limit before there is a path."""
        if self.best is None:
            return math.inf, NO_LIMIT
        share = _LEAST_SHARE + (_MOST_SHARE - _LEAST_SHARE) * _draw(self.state)
        return self.straight + share * (self.length - self.straight), _ROUND * luby(number)

    def grow(self, trees: _Trees, bound: float, samples: int) -> PlanStatus:
        """Grow fresh trees until they meet, the round or the budget ends, or the caller cancels."""
        query = self.query
        trees.reset()
        lower, extent = self.space.lower, self.space.upper - self.space.lower
        settings = (self.state, lower, extent, self.step, self.domain, bound)
        begin = query.iterations
        last = begin + min(samples, query.most - begin)
        code = kernel.GOING
        while code != kernel.SOLVED and query.iterations < last and query.seconds_left > 0.0:
            if query.cancelled():
                return PlanStatus.CANCELLED
            stop = min(query.begin_chunk(), last - query.iterations) + query.iterations - begin
            code = trees.grow(*settings, stop, query.motion.context)
            query.iterations = begin + int(trees.counts[kernel.SAMPLES])
            query.end_chunk()
            if code == kernel.FULL:
                trees.enlarge()
        query.edges += int(trees.counts[kernel.EDGES])
        return PlanStatus.SOLVED if code == kernel.SOLVED else PlanStatus.TIMEOUT

    def improve(self, waypoints: Array) -> None:
        """Shorten a path, and keep it when it is the best."""
        query, motion = self.query, self.query.motion
        checked = motion.edges_checked
        path = Path(query.problem.joint_names, waypoints)
        seconds = max(query.seconds_left, 1e-6)
        path = shorten(path, motion, rng=int(_draw(self.state) * 2**53), iterations=_SHORTCUTS, seconds=seconds)
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


class _Trees:
    """The arrays that the kernel grows."""

    def __init__(self, start: Array, goals: Array) -> None:
        nq, capacity = len(start), max(_CAPACITY, 2 * len(goals))
        self.goals = len(goals)
        self.vertices = np.empty((2, nq, capacity))
        self.parents = np.empty((2, capacity), np.int64)
        self.lengths = np.empty((2, capacity))
        self.blocked = np.zeros((2, capacity), np.bool_)
        self.counts = np.zeros(kernel.ROOTS_GOAL + 1, np.int64)
        self.vertices[0, :, 0] = start
        self.vertices[1, :, : len(goals)] = goals.T
        self.parents[:, : len(goals)] = -1
        self.lengths[:, : len(goals)] = 0.0

    def reset(self) -> None:
        """Back to the roots."""
        self.counts[:] = 0
        self.counts[[kernel.SIZE_START, kernel.ROOTS_START]] = 1
        self.counts[[kernel.SIZE_GOAL, kernel.ROOTS_GOAL]] = self.goals
        self.parents[:, : self.goals] = -1
        self.lengths[:, : self.goals] = 0.0
        self.blocked[:] = False

    def grow(self, state: NDArray[np.uint64], *settings: object) -> int:
        """Let the kernel grow them; it says what the settings are."""
        return _grow(self.vertices, self.parents, self.lengths, self.blocked, self.counts, state, *settings)

    def enlarge(self) -> None:
        """Twice the room."""
        self.vertices = np.concatenate([self.vertices, np.empty_like(self.vertices)], axis=2)
        self.parents = np.concatenate([self.parents, np.empty_like(self.parents)], axis=1)
        self.lengths = np.concatenate([self.lengths, np.empty_like(self.lengths)], axis=1)
        self.blocked = np.concatenate([self.blocked, np.zeros_like(self.blocked)], axis=1)

    def path(self) -> Array:
        """The way from the start to a goal, shape (n, nq)."""
        return _trace(self.vertices, self.parents, self.counts)
