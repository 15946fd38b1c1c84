"""The compiled RRT-Connect behind the verb of all planners.

Searching, checking edges and drawing random numbers happen in one loop of machine code
(`rr1plan._kernels.rrt_connect`). It comes back here every few milliseconds, where the clock, Ctrl-C and
progress are looked after.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from rr1plan._kernels import rrt_connect as kernel
from rr1plan.checks import Array, Seed, finite_number
from rr1plan.collision import MotionChecker
from rr1plan.collision.shelf import borrowed_checker
from rr1plan.errors import InputError
from rr1plan.path import Path
from rr1plan.planners.goals import check_start, goal_configurations
from rr1plan.planners.query import prepare
from rr1plan.planners.seeds import as_seed, generator_state
from rr1plan.planners.space import Space, with_copies
from rr1plan.planning import Budget, PlanResult, PlanStatus, Progress, ProgressCallback, SearchTree, check_question
from rr1plan.problem import Problem

# The kernel is not typed.
_nearest_direct: Callable[..., int] = kernel.nearest_direct
_grow: Callable[..., int] = kernel.grow
_trace: Callable[..., Array] = kernel.trace

_DIRECT = 8  # goals to which the straight line is tried first
_STEP = 0.08  # longest edge of a tree, as a part of the space's diagonal
_SHORTEST = 1e-4  # the least that may be set, the same way
_DOMAIN = 0.2  # how near to a vertex that has met an obstacle samples have to be, the same way
_CAPACITY = 256  # vertices of each tree to begin with
_CHUNK = 128  # samples before the first look at the clock
_LEAST, _MOST = 0.002, 0.01  # time between two looks at the clock [s]
_REPORTS = 0.1  # time between two reports of progress [s]


class RrtConnect:
    """Two trees that grow towards each other (Kuffner, LaValle 2000), compiled.

    Under a budget of iterations alone the same seed gives the same path. An iteration is a sample.

    Args:
        range: Longest edge of a tree [rad]; 0: a part of the diagonal of the joints' ranges.
        tree: Whether the result keeps what was explored.

    Raises:
        InputError: a negative range.
    """

    name = "rrt_connect"
    optimizing = False

    def __init__(self, *, range: float = 0.0, tree: bool = False) -> None:
        self.range = finite_number("range", range)
        if self.range < 0.0:
            raise InputError(f"range is {range}, expected a length >= 0")
        self.tree = bool(tree)

    def __repr__(self) -> str:
        return f"RrtConnect(range={self.range}, tree={self.tree})"

    def plan(
        self,
        problem: Problem,
        budget: Budget | None = None,
        rng: Seed = None,
        progress: ProgressCallback | None = None,
    ) -> PlanResult:
        """Plan; see `rr1plan.plan`."""
        check_question(problem, budget, progress)
        prepare(kernel.nearest_direct, kernel.grow, kernel.trace)
        began = time.perf_counter()
        with borrowed_checker(problem.scene, problem.arms) as motion:
            query = _Query(self, problem, motion, began, budget or Budget(), as_seed(rng), progress)
            return query.refusal() or query.direct() or query.search()


class _Query:
    """One call of `plan`: its tools, its clock, its answer so far."""

    def __init__(
        self,
        planner: RrtConnect,
        problem: Problem,
        motion: MotionChecker,
        began: float,
        budget: Budget,
        seed: int,
        progress: ProgressCallback | None,
    ) -> None:
        self.planner, self.problem, self.motion, self.began = planner, problem, motion, began
        self.budget, self.seed, self.progress = budget, seed, progress
        self.goals = np.empty((0, problem.nq))
        self.reported = self.began - _REPORTS
        self.edges, self.samples = 0, 0

    # ---- the three stages ----------------------------------------------------------------------

    def refusal(self) -> PlanResult | None:
        """The answer to a problem without a usable start or goal."""
        blocked = check_start(self.problem, self.motion)
        if blocked:
            return self.result(PlanStatus.INVALID_START, reason=blocked)
        found = goal_configurations(self.problem, self.motion, self.seed)
        if found.status is not None:
            return self.result(found.status, reason=found.reason)
        self.goals = np.ascontiguousarray(with_copies(self.problem, found.configurations))
        return None

    def direct(self) -> PlanResult | None:
        """The answer where the straight line to a near goal is free."""
        start = self.problem.start
        if np.array_equal(self.goals[0], start):
            return self.result(PlanStatus.SOLVED, start[None])
        goal = _nearest_direct(start, self.goals, _DIRECT, self.motion.context)
        self.edges += min(_DIRECT, len(self.goals)) if goal < 0 else goal + 1
        if goal < 0:
            return None
        waypoints = np.array([start, self.goals[goal]])
        tree = SearchTree(waypoints, np.array([[0, 1]])) if self.planner.tree else None
        return self.result(PlanStatus.SOLVED, waypoints, tree=tree)

    def search(self) -> PlanResult:
        """The answer of the trees."""
        space = Space.around(self.problem, self.goals)
        if not space.movable.any():
            return self.result(PlanStatus.INFEASIBLE, reason="no joint can move, and the start is not a goal")
        trees = _Trees(self.problem.start, self.goals, self.seed)
        status = self.grow(trees, space)
        self.edges += int(trees.counts[kernel.EDGES])
        self.samples = int(trees.counts[kernel.SAMPLES])
        tree = trees.explored(joined=status is PlanStatus.SOLVED) if self.planner.tree else None
        if status is PlanStatus.SOLVED:
            return self.result(status, trees.path(), tree=tree)
        if status is PlanStatus.CANCELLED:
            return self.result(status, reason="the progress callback returned False", tree=tree)
        used, (of_start, of_goal) = time.perf_counter() - self.began, trees.counts[:2].tolist()
        reason = (
            f"no path found: budget used up after {used:.3g} s and {self.samples} iterations; "
            f"{of_start} configurations were reached from the start, {of_goal} from the goal"
        )
        return self.result(status, reason=reason, tree=tree)

    # ---- pieces ----------------------------------------------------------------------------------

    def grow(self, trees: _Trees, space: Space) -> PlanStatus:
        """Grow the trees until they meet, the budget ends or the caller cancels."""
        lower, extent = space.lower, space.upper - space.lower
        step, domain = self.planner.range or _STEP * space.diagonal, _DOMAIN * space.diagonal
        if step < _SHORTEST * space.diagonal:
            raise InputError(f"range is {step:g}, expected at least {_SHORTEST * space.diagonal:.3g} for these joints")
        most = np.iinfo(np.int64).max if self.budget.iterations is None else self.budget.iterations
        chunk, deadline = _CHUNK, self.began + self.budget.seconds
        while True:
            looked = time.perf_counter()
            if trees.counts[kernel.SAMPLES] >= most or looked >= deadline:
                return PlanStatus.TIMEOUT
            if not self.goes_on(looked, trees.counts[kernel.SAMPLES] / most):
                return PlanStatus.CANCELLED
            stop = min(most, int(trees.counts[kernel.SAMPLES]) + chunk)
            status = trees.grow(lower, extent, step, domain, stop, self.motion.context)
            if status == kernel.SOLVED:
                return PlanStatus.SOLVED
            if status == kernel.FULL:
                trees.enlarge()
            took = time.perf_counter() - looked
            chunk = 2 * chunk if took < _LEAST else max(1, chunk // 2) if took > _MOST else chunk

    def goes_on(self, now: float, counted: float) -> bool:
        """Tell the progress about ten times a second; False when it wants to end the search."""
        if self.progress is None or now - self.reported < _REPORTS:
            return True
        self.reported = now
        seconds = now - self.began
        used = min(1.0, max(seconds / self.budget.seconds, counted))
        return self.progress(Progress(self.planner.name, seconds, used)) is not False

    def result(
        self, status: PlanStatus, waypoints: Array | None = None, *, reason: str = "", tree: SearchTree | None = None
    ) -> PlanResult:
        """The answer with the counts so far."""
        path = None if waypoints is None else Path(self.problem.joint_names, waypoints)
        seconds = time.perf_counter() - self.began
        return PlanResult(
            status,
            path,
            reason,
            planner=self.planner.name,
            seed=self.seed,
            seconds=seconds,
            iterations=self.samples,
            edges_checked=self.edges,
            cost_history=() if path is None else ((seconds, path.length),),
            tree=tree,
        )


class _Trees:
    """The arrays that the kernel grows."""

    def __init__(self, start: Array, goals: Array, seed: int) -> None:
        nq, capacity = len(start), max(_CAPACITY, 2 * len(goals))
        self.vertices = np.empty((2, nq, capacity))
        self.parents = np.empty((2, capacity), np.int64)
        self.blocked = np.zeros((2, capacity), np.bool_)
        self.counts = np.zeros(kernel.PASSED + 1, np.int64)
        self.state = generator_state(seed)
        self.vertices[0, :, 0] = start
        self.vertices[1, :, : len(goals)] = goals.T
        self.parents[0, 0] = -1
        self.parents[1, : len(goals)] = -1
        self.counts[:2] = 1, len(goals)

    def grow(self, lower: Array, extent: Array, step: float, domain: float, samples: int, context: object) -> int:
        """Let the kernel grow them up to so many samples."""
        arrays = (self.vertices, self.parents, self.blocked, self.counts, self.state)
        return _grow(*arrays, lower, extent, step, domain, samples, context)

    def enlarge(self) -> None:
        """Twice the room."""
        self.vertices = np.concatenate([self.vertices, np.empty_like(self.vertices)], axis=2)
        self.parents = np.concatenate([self.parents, np.empty_like(self.parents)], axis=1)
        self.blocked = np.concatenate([self.blocked, np.zeros_like(self.blocked)], axis=1)

    def path(self) -> Array:
        """The way from the start to a goal, shape (n, nq)."""
        return _trace(self.vertices, self.parents, self.counts)

    def explored(self, *, joined: bool) -> SearchTree:
        """Both trees, and the edge between them when they have met."""
        sizes = self.counts[:2].tolist()
        vertices = np.concatenate([self.vertices[side, :, :size].T for side, size in enumerate(sizes)])
        edges = []
        for side, first in enumerate((0, sizes[0])):
            parents = self.parents[side, : sizes[side]]
            children = np.flatnonzero(parents >= 0)
            edges.append(np.stack([parents[children], children], axis=1) + first)
        if joined:
            join = self.counts[[kernel.JOIN_START, kernel.JOIN_GOAL]] + np.array([0, sizes[0]])
            edges.append(join[None])
        return SearchTree(vertices, np.concatenate(edges).astype(np.int64))
