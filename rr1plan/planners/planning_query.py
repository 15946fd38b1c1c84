"""State of one planning query: checker, start and goals, clock, counters, result."""

from __future__ import annotations

import time

import numpy as np

from rr1plan.checks import Array, Seed, as_seed, counted
from rr1plan.collision import CollisionChecker
from rr1plan.collision.checker_pool import acquire_checker, checker_from_pool, release_checker
from rr1plan.kernels.planner_kernels import constants, load_library
from rr1plan.model.joint_space import Space, joint_space
from rr1plan.path import Path
from rr1plan.planners.goal_configurations import GoalSearch, check_start, joint_goals
from rr1plan.planners.joint_barriers import find_joint_barrier
from rr1plan.planners.shortcut import shorten
from rr1plan.planning import (
    CANCELLED,
    Budget,
    PlanResult,
    PlanStatus,
    Progress,
    ProgressCallback,
    SearchTree,
    check_plan_arguments,
)
from rr1plan.progress import REPORTS
from rr1plan.scene import Scene
from rr1plan.scene.problem import JointGoal, Problem

STRAIGHT_LINES = constants()["STRAIGHT_LINES"]
"""Number of nearest goals to which the straight line is checked before planning."""

_DEFAULT_BUDGET = Budget()
_LEAST, _MOST = 0.002, 0.01  # time between two clock readings [s]
_CHUNK = 128  # steps before the first clock reading
# Contact tests of two bodies for a proof that a goal cannot be reached, about a second; counted, so that slow machines
# prove the same.
_PROOF_TESTS = 150_000
# The largest number of iterations.
NO_LIMIT = int(np.iinfo(np.int64).max)


class Pace:
    """Adapts the number of steps of a compiled loop between two clock readings to the time they take."""

    def __init__(self) -> None:
        self._steps = _CHUNK
        self._began: float | None = None

    def next(self) -> int:
        """The next number of steps, from the time of the steps since the last call."""
        now = time.perf_counter()
        if self._began is not None:
            took = now - self._began
            if took < _LEAST:
                self._steps *= 2
            elif took > _MOST:
                self._steps = max(1, self._steps // 2)
        self._began = now
        return self._steps


class Query:
    """One planning query: checker, clock and counters. Use it in a `with` statement.

    Entering acquires a checker, builds its tables and then starts the clock.

    Args:
        planner: Name of the planner.
        problem: The planning problem.
        budget: When to stop; None: the default.
        rng: Generator or seed of all random numbers.
        progress: Called about ten times a second, or None.
        scene: Scene of the checker: the problem's (default), or one that differs only in where the moving arms are.

    Attributes:
        motion: Collision checker of the problem's arms.
        began: Start time of the `with` block (`time.perf_counter`).
        goals: Goal configurations, continuous joints unwrapped to the value nearest to the start; nearest first,
            shape (k, nq).
        iterations: Iterations so far.
        edges: Edges checked so far.
        history: (seconds, path length) whenever the best path improved.
        cancelled: Whether the progress callback cancelled the search.
        separated: Why no goal can be reached, once that is proven; else empty.

    Raises:
        InputError: invalid arguments, or a scene that cannot be checked (in the `with` statement).
    """

    motion: CollisionChecker

    def __init__(
        self,
        planner: str,
        problem: Problem,
        budget: Budget | None,
        rng: Seed,
        progress: ProgressCallback | None,
        scene: Scene | None = None,
    ) -> None:
        check_plan_arguments(problem, budget, progress)
        self.planner, self.problem, self.budget, self.progress = planner, problem, budget or _DEFAULT_BUDGET, progress
        self.seed = as_seed(rng)
        self.most = NO_LIMIT if self.budget.iterations is None else int(self.budget.iterations)
        self.goals: Array = problem.start[None][:0]
        self.iterations, self.edges = 0, 0
        self.began, self._reported = 0.0, -REPORTS
        self._scene = scene or problem.scene
        self._space: Space | None = None
        # Index of the first goal with a free straight line from the start, -1 for none; None: not checked yet.
        self._visible: int | None = None
        self._goal_search: GoalSearch | None = None
        self.history: list[tuple[float, float]] = []
        self.cancelled, self.separated = False, ""

    def __enter__(self) -> Query:
        self._joint_goals = joint_goals(self.problem)
        self.motion = acquire_checker(self._scene, self.problem.arms, self.problem.margin)
        self.motion.warm_up()
        self.began = time.perf_counter()
        return self

    def __exit__(self, *_: object) -> None:
        release_checker(self.motion)

    def early_exit(self) -> PlanResult | None:
        """The result if start or goal are invalid or the start is a goal; None if a search is needed."""
        if not self._has_plain_ends():
            blocked = check_start(self.problem, self.motion)
            if blocked:
                return self.result(PlanStatus.INVALID_START, reason=blocked)
            self._goal_search = GoalSearch(self.problem, self.motion, self.seed)
            found = self._goal_search.find()
            if found.status is not None:
                return self.result(found.status, reason=found.reason)
            self.goals = found.configurations
        if self._visible in (None, 0) and (self.goals[0] == self.problem.start).all():
            return self.result(PlanStatus.FOUND, self.goals[:1].copy())
        if not self.space.can_move:
            return self.result(PlanStatus.INFEASIBLE, reason="no joint can move, and the start is not a goal")
        return None

    def _has_plain_ends(self) -> bool:
        """Whether all goals are configurations, and the start and at least one goal are valid (one kernel call)."""
        space, goals = joint_space(self.problem.scene, self.problem.arms), self._joint_goals
        # The kernel skips pairs without relative motion; if one of them collides, no edge is free.
        if goals is None or not space.is_shared or not self.motion.static_is_free:
            return False
        near, visible = np.empty_like(goals), np.empty(1, np.int64)
        given = self.problem.start, goals, len(goals), space.lower, space.upper, near, visible
        count = self.motion.run_edge_kernel(load_library().rr1_check_endpoints, *given)
        if count == 0:
            return False
        self.goals = near[:count]
        self._space, self._visible = space, int(visible[0])
        return True

    @property
    def has_all_goals(self) -> bool:
        """Whether all goals are configurations, none a pose or a region that further configurations may reach."""
        return all(isinstance(goal, JointGoal) for goals in self.problem.goal.values() for goal in goals)

    def more_goals(self) -> Array:
        """Further goal configurations, also added to `goals`; shape (k, nq)."""
        if self._goal_search is None:
            return self.goals[:0]
        new = self._goal_search.more()
        goals = np.concatenate([self.goals, new])
        self.goals = goals[np.argsort(np.linalg.norm(goals - self.problem.start, axis=1), kind="stable")]
        return new

    def prove_separated(self) -> bool:
        """Whether no goal can be reached, proven by values that joints cannot pass; False proves nothing."""
        # Poses may be reached in other configurations too.
        if self._joint_goals is None:
            return False
        reasons: dict[str, None] = {}
        # Without the margin, which alone may block all paths, and without pairs of links of one arm, for which
        # `timeout_hints` has advice.
        with checker_from_pool(self._scene, self.problem.arms) as checker:
            for goal in self.goals:
                barrier = find_joint_barrier(
                    checker,
                    self.problem.start,
                    goal,
                    most_tests=_PROOF_TESTS,
                    goes_on=self.in_time,
                )
                if barrier is None:
                    return False
                reasons[str(barrier)] = None
        self.separated = f"no path exists: {'; '.join(reasons)}"
        return True

    @property
    def space(self) -> Space:
        """Bounds of the search space.

        Raises:
            InputError: a joint without limits that is not continuous.
        """
        if self._space is None:
            self._space = Space.around(self.problem, self.goals)
        return self._space

    def straight_line(self, most: int = 1, *, tree: bool = False) -> PlanResult | None:
        """The result if the straight line to one of the `most` nearest goals is free, with its graph if `tree`."""
        for k in range(min(most, len(self.goals))):
            self.edges += 1
            if self._is_visible(k):
                waypoints = np.array([self.problem.start, self.goals[k]])
                explored = SearchTree(waypoints, np.array([[0, 1]])) if tree else None
                return self.result(PlanStatus.FOUND, waypoints, tree=explored)
        return None

    def _is_visible(self, k: int) -> bool:
        if self._visible is None or k >= STRAIGHT_LINES:
            return self.motion.edge_is_free(self.problem.start, self.goals[k])
        return k == self._visible

    def shorten(self, waypoints: Array, iterations: int, seed: int) -> Path:
        """A free path shortened within the time left; the edges checked are counted.

        Args:
            waypoints: Its waypoints, shape (n, nq), which the caller must not keep.
            iterations: Shortcuts to try.
            seed: Seed of the shortcuts.
        """
        path, checked = Path.trusted(self.motion.joint_names, waypoints), self.motion.edges_checked
        seconds = max(self.budget.seconds - self.seconds, 1e-6)
        path = shorten(path, self.problem.scene, checker=self.motion, iterations=iterations, seconds=seconds, rng=seed)
        self.edges += self.motion.edges_checked - checked
        return path

    @property
    def seconds(self) -> float:
        """Wall time so far [s]."""
        return time.perf_counter() - self.began

    def goes_on(self) -> bool:
        """Whether iterations are left and `in_time()`."""
        return self.iterations < self.most and self.in_time()

    def in_time(self) -> bool:
        """Whether time is left and the search is not cancelled; reports progress about ten times a second."""
        seconds = time.perf_counter() - self.began
        if self.progress is not None and not self.cancelled and seconds - self._reported >= REPORTS:
            self._report(self.progress, seconds)
        return not self.cancelled and seconds < self.budget.seconds

    def _report(self, progress: ProgressCallback, seconds: float) -> None:
        """Call the progress callback, which may cancel."""
        self._reported = seconds
        used = min(1.0, max(seconds / self.budget.seconds, self.iterations / self.most))
        cost = self.history[-1][1] if self.history else None
        self.cancelled = progress(Progress(self.planner, seconds, used, cost)) is False

    def unsolved(self, found: str, tree: SearchTree | None = None) -> PlanResult:
        """The result without a path: cancelled, proven, or out of budget; `found` describes the state of the search."""
        if self.cancelled:
            return self.result(PlanStatus.CANCELLED, reason=CANCELLED, tree=tree)
        if self.separated:
            return self.result(PlanStatus.INFEASIBLE, reason=self.separated, tree=tree)
        used = f"{self.seconds:.3g} s and {counted(self.iterations, 'iteration')}"
        reason = f"no path found: budget used up after {used}; {found}"
        return self.result(PlanStatus.TIMEOUT, reason=reason, tree=tree)

    def result(
        self, status: PlanStatus, waypoints: Array | None = None, *, reason: str = "", tree: SearchTree | None = None
    ) -> PlanResult:
        """The result with the counters so far; the caller must not keep `waypoints`."""
        path = None if waypoints is None else Path.trusted(self.motion.joint_names, waypoints)
        seconds = self.seconds
        if path is not None and not self.history:
            self.history.append((seconds, path.length))
        return PlanResult(
            status,
            path,
            reason,
            planner=self.planner,
            seed=self.seed,
            seconds=seconds,
            iterations=self.iterations,
            edges_checked=self.edges,
            cost_history=tuple(self.history) if path is not None else (),
            tree=tree,
        )
