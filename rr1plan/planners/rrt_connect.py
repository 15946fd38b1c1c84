"""RRT-Connect as a compiled loop.

Sampling, nearest neighbors and edge checks are one compiled loop (`rrt_connect.c`). It returns to Python every few
milliseconds, for the clock, Ctrl-C and progress.
"""

from __future__ import annotations

from rr1plan.checks import Seed, number_from_zero, true_or_false
from rr1plan.planners.planning_query import STRAIGHT_LINES, Query
from rr1plan.planners.tree_search import SearchPause, TreeSearch
from rr1plan.planning import Budget, Planner, PlanResult, PlanStatus, ProgressCallback
from rr1plan.scene.problem import Problem


class RrtConnect(Planner):
    """Two trees that grow toward each other (Kuffner, LaValle 2000), compiled.

    Under a budget of iterations alone the same seed gives the same path. An iteration is a sample.

    Args:
        range: Longest edge of a tree [rad or m]; 0: a share of the diagonal of the joint space.
        tree: Whether the result contains the explored trees.

    Raises:
        InputError: a negative range.
    """

    name = "rrt_connect"
    _pause: SearchPause | None = None

    def __init__(self, *, range: float = 0.0, tree: bool = False) -> None:
        self.range = number_from_zero("range", range)
        self.tree = true_or_false("tree", tree)

    def __repr__(self) -> str:
        return f"RrtConnect(range={self.range}, tree={self.tree})"

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
            if refused is not None:
                return refused
            return query.straight_line(STRAIGHT_LINES, tree=self.tree) or self._search(query)

    def _search(self, query: Query) -> PlanResult:
        """The result of growing both trees."""
        search = TreeSearch(query, self.range)
        met = search.connect(pause=self._pause)
        tree = search.trees.explored(joined=met) if self.tree else None
        if met:
            return query.result(PlanStatus.FOUND, search.trees.path(), tree=tree)
        return query.unsolved(search.describe(), tree=tree)


class PausingRrtConnect(RrtConnect):
    """An RRT-Connect that calls a function when it has used many samples."""

    def __init__(self, planner: RrtConnect, pause: SearchPause) -> None:
        super().__init__(range=planner.range, tree=planner.tree)
        self._pause = pause
