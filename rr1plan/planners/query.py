"""What one question to a compiled planner goes through: its ends, its clock, its answer."""

from __future__ import annotations

import time

import numpy as np

from rr1plan.checks import Array, Seed, as_seed, counted
from rr1plan.collision import CollisionChecker
from rr1plan.collision.checker_pool import acquire_checker, release_checker
from rr1plan.kernels.library import constants, load_library
from rr1plan.path import Path
from rr1plan.planners.goals import GoalSearch, check_start, joint_goals
from rr1plan.planners.space import Space, joint_space
from rr1plan.planning import Budget, PlanResult, PlanStatus, Progress, ProgressCallback, SearchTree, check_question
from rr1plan.problem import Problem
from rr1plan.scene import Scene

STRAIGHT_LINES = constants()["STRAIGHT_LINES"]
"""Goals to which the straight line is tried before anything else."""

_NO_WISHES = Budget()
_REPORTS = 0.1  # time between two reports of progress [s]
_LEAST, _MOST = 0.002, 0.01  # time between two looks at the clock [s]
_CHUNK = 128  # steps before the first look at the clock
# As many iterations as there are numbers.
NO_LIMIT = int(np.iinfo(np.int64).max)


class Pace:
    """How many steps of a compiled loop to do between two looks at the clock."""

    def __init__(self) -> None:
        self._steps = _CHUNK
        self._began: float | None = None

    def next(self) -> int:
        """How many to do now: more where those before took little time, fewer where they took much."""
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
    """One question under way: its tools, its clock, what was counted so far. To be used in a `with` block.

    Before it a checker is borrowed and its tables are built; inside it the clock runs.

    Args:
        planner: Name of the planner.
        problem: The question.
        budget: When to stop; None: the default.
        rng: Generator or seed of everything random.
        progress: Called about ten times a second, or None.
        scene: Whose checker is borrowed: the problem's (default), or one that differs in the moving arms' postures.

    Attributes:
        motion: Certifies edges; of the problem's arms.
        began: When the block began (`time.perf_counter`).
        goals: Goal configurations, of all copies a turn away those nearest to the start; nearest first, shape (k, nq).
        iterations: Iterations so far.
        edges: Edges checked so far.
        history: (seconds, path length) whenever the best path improved.
        cancelled: The progress wanted to end the search.

    Raises:
        InputError: what is no question, or a scene that cannot be checked (in the `with` statement).
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
        check_question(problem, budget, progress)
        self.planner, self.problem, self.budget, self.progress = planner, problem, budget or _NO_WISHES, progress
        self.seed = as_seed(rng)
        self.most = NO_LIMIT if self.budget.iterations is None else int(self.budget.iterations)
        self.goals: Array = problem.start[None][:0]
        self.iterations, self.edges = 0, 0
        self.began, self._reported = 0.0, -_REPORTS
        self._scene = scene or problem.scene
        self._space: Space | None = None
        # The first of the goals in sight of the start, -1 for none; None: not known yet.
        self._in_sight: int | None = None
        self._goal_search: GoalSearch | None = None
        self.history: list[tuple[float, float]] = []
        self.cancelled = False

    def __enter__(self) -> Query:
        self._wanted = joint_goals(self.problem)
        self.motion = acquire_checker(self._scene, self.problem.arms, self.problem.margin)
        self.motion.warm_up()
        self.began = time.perf_counter()
        return self

    def __exit__(self, *_: object) -> None:
        release_checker(self.motion)

    def refusal(self) -> PlanResult | None:
        """The answer to a problem without a usable start or goal, or whose start is a goal."""
        if not self._has_plain_ends():
            blocked = check_start(self.problem, self.motion)
            if blocked:
                return self.result(PlanStatus.INVALID_START, reason=blocked)
            self._goal_search = GoalSearch(self.problem, self.motion, self.seed)
            found = self._goal_search.find()
            if found.status is not None:
                return self.result(found.status, reason=found.reason)
            self.goals = found.configurations
        if self._in_sight in (None, 0) and (self.goals[0] == self.problem.start).all():
            return self.result(PlanStatus.FOUND, self.goals[:1].copy())
        if not self.space.can_move:
            return self.result(PlanStatus.INFEASIBLE, reason="no joint can move, and the start is not a goal")
        return None

    def _has_plain_ends(self) -> bool:
        """Whether goals are configurations and both ends can be had; else it takes a closer look, and words."""
        space, goals = joint_space(self.problem), self._wanted
        # The kernel does not look at pairs that do not move against each other; where one collides, no edge is free.
        if goals is None or not space.is_shared or not self.motion.static_is_free:
            return False
        near, visible = np.empty_like(goals), np.empty(1, np.int64)
        count = load_library().rr1_check_endpoints(
            *(self.problem.start, goals, len(goals), space.lower, space.upper, near, visible), *self.motion.context
        )
        if count == 0:
            return False
        self.goals = near[:count]
        self._space, self._in_sight = space, int(visible[0])
        return True

    def more_goals(self) -> Array:
        """Goals that were not known before, where there are others; shape (k, nq)."""
        if self._goal_search is None:
            return self.goals[:0]
        new = self._goal_search.more()
        goals = np.concatenate([self.goals, new])
        self.goals = goals[np.argsort(np.linalg.norm(goals - self.problem.start, axis=1), kind="stable")]
        return new

    @property
    def space(self) -> Space:
        """Where to search.

        Raises:
            InputError: a joint without limits that is not continuous.
        """
        if self._space is None:
            self._space = Space.around(self.problem, self.goals)
        return self._space

    def straight_line(self, most: int = 1, *, tree: bool = False) -> PlanResult | None:
        """The answer where the straight line to one of so many nearest goals is free; a tree of it when asked for."""
        for k in range(min(most, len(self.goals))):
            self.edges += 1
            if self._is_in_sight(k):
                waypoints = np.array([self.problem.start, self.goals[k]])
                explored = SearchTree(waypoints, np.array([[0, 1]])) if tree else None
                return self.result(PlanStatus.FOUND, waypoints, tree=explored)
        return None

    def _is_in_sight(self, k: int) -> bool:
        if self._in_sight is None or k >= STRAIGHT_LINES:
            return self.motion.edge_is_free(self.problem.start, self.goals[k])
        return k == self._in_sight

    @property
    def seconds(self) -> float:
        """Wall time so far [s]."""
        return time.perf_counter() - self.began

    @property
    def seconds_left(self) -> float:
        """Wall time left of the budget [s]; below zero when it is used up."""
        return self.budget.seconds - self.seconds

    def goes_on(self) -> bool:
        """Whether there are iterations left, and `in_time`."""
        return self.iterations < self.most and self.in_time()

    def in_time(self) -> bool:
        """Tell the progress about ten times a second; whether it lets the search go on, and there is time left."""
        seconds = time.perf_counter() - self.began
        if self.progress is not None and not self.cancelled and seconds - self._reported >= _REPORTS:
            self._report(self.progress, seconds)
        return not self.cancelled and seconds < self.budget.seconds

    def _report(self, progress: ProgressCallback, seconds: float) -> None:
        """Tell the progress, which may cancel."""
        self._reported = seconds
        used = min(1.0, max(seconds / self.budget.seconds, self.iterations / self.most))
        cost = self.history[-1][1] if self.history else None
        self.cancelled = progress(Progress(self.planner, seconds, used, cost)) is False

    def unsolved(self, found: str, tree: SearchTree | None = None) -> PlanResult:
        """The answer without a path: cancelled, or out of budget, with what was found instead in words."""
        if self.cancelled:
            return self.result(PlanStatus.CANCELLED, reason="the progress callback returned False", tree=tree)
        used = f"{self.seconds:.3g} s and {counted(self.iterations, 'iteration')}"
        reason = f"no path found: budget used up after {used}; {found}"
        return self.result(PlanStatus.TIMEOUT, reason=reason, tree=tree)

    def result(
        self, status: PlanStatus, waypoints: Array | None = None, *, reason: str = "", tree: SearchTree | None = None
    ) -> PlanResult:
        """The answer with the counts so far; waypoints are new ones that nobody else writes."""
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
