"""Lazy PRM* for many queries in one scene.

Samples are drawn once. An edge is certified when it lies on the shortest candidate path, and never again.
RRT-Connect solves queries whose start and goal the roadmap does not connect.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import NoReturn

from rr1plan.checks import Seed, of_kind, whole_number
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.errors import InputError
from rr1plan.planners import tree_search
from rr1plan.planners.planning_query import Query
from rr1plan.planners.roadmap_graph import Graph
from rr1plan.planning import Budget, Planner, PlanResult, PlanStatus, ProgressCallback, SearchTree, check_plan_arguments
from rr1plan.scene import Scene
from rr1plan.scene.problem import Problem
from rr1plan.scene.scene_differences import check_same_scene
from rr1plan.thread_locks import per_process

_SAMPLES = 600
_MOST_SAMPLES = 1_000_000
_SHORTCUTS = 100  # tried on a path that is learned
_NAME = "roadmap"


class Roadmap(Planner):
    """A roadmap of a scene and its moving arms, built once for many queries.

    The result is the shortest path along the roadmap's free edges. If it does not connect start and goal,
    RRT-Connect does, and its path is added to the roadmap. Results therefore depend on earlier queries; the
    same queries in the same order have the same results. An iteration of a budget is a sample of RRT-Connect.

    Problems with a margin, such as those of `plan_motion`, have a roadmap of as many samples whose edges keep it; the
    first query with a margin builds it.

    Several threads may call `plan`; their queries are processed one at a time.

    Args:
        scene: The scene; the configurations of its moving arms do not matter.
        arms: The arms that move (default: all).
        samples: Number of samples to draw; those in collision are dropped.

    Raises:
        UnknownNameError: no such arm.
        InputError: a scene that cannot be checked or has no arm, a joint without limits, or no sample.
    """

    name = _NAME

    def __init__(self, scene: Scene, arms: Sequence[str] | None = None, *, samples: int = _SAMPLES) -> None:
        of_kind("scene", scene, Scene)
        # The outer call rejects scenes without arms.
        self.scene, self.arms = scene, scene.arm_names(scene.arm_names(arms))
        self._graphs = {0.0: Graph(scene, self.arms)}  # by margin [m]
        self._lock = per_process(self, "_lock", threading.Lock)
        self.grow(samples)

    def __repr__(self) -> str:
        return f"Roadmap({self.scene.name!r}, arms={list(self.arms)}, {len(self)} vertices)"

    def __reduce__(self) -> NoReturn:
        """Refuse to pickle or copy: the roadmap would not learn from the queries to its copy.

        Raises:
            InputError: always.
        """
        raise InputError(
            "a Roadmap cannot be pickled or copied, because it learns from its queries; use a RoadmapPlanner, which "
            "keeps a roadmap with each scene"
        )

    def __len__(self) -> int:
        """Number of vertices, of the roadmap without a margin."""
        return self._graphs[0.0].size

    @property
    def graph(self) -> SearchTree:
        """Vertices and the edges that are not known to be blocked, of the roadmap without a margin."""
        with self._lock:
            return self._graphs[0.0].picture()

    def grow(self, samples: int) -> None:
        """Draw more samples.

        Args:
            samples: Number of additional samples.

        Raises:
            InputError: less than one, or not an integer.
        """
        samples = checked_samples(samples)
        with self._lock, checker_from_pool(self.scene, self.arms) as motion:
            graph = self._graphs[0.0]
            graph.sample(graph.samples + samples, motion, lambda: True)

    def plan(
        self,
        problem: Problem,
        *,
        budget: Budget | None = None,
        rng: Seed = None,
        progress: ProgressCallback | None = None,
    ) -> PlanResult:
        """Solve a problem in this scene; see `rr1plan.plan`.

        Args:
            problem: The planning problem.
            budget: When to stop (default: 10 s).
            rng: Generator or seed of inverse kinematics and of RRT-Connect.
            progress: Called about ten times a second; it may return False to cancel.

        Raises:
            InputError: a problem in another scene or for other arms.
        """
        check_plan_arguments(problem, budget, progress)
        self._check_fits(problem)
        with self._lock, Query(_NAME, problem, budget, rng, progress, self.scene) as query:
            refused = query.early_exit()
            if refused is not None:
                return refused
            if problem.margin not in self._graphs:
                self._graphs[problem.margin] = Graph(self.scene, self.arms)
            graph = self._graphs[problem.margin]
            graph.sample(self._graphs[0.0].samples, query.motion, query.in_time)
            return _solve(query, graph, learn=True)

    def _check_fits(self, problem: Problem) -> None:
        if problem.arms != self.arms:
            raise InputError(
                f"the problem moves {', '.join(problem.arms)}, but the roadmap is for {', '.join(self.arms)}; "
                "build one for these arms"
            )
        check_same_scene("the roadmap", self.scene, problem.scene, self.arms, "build a roadmap for that of the problem")


class RoadmapPlanner(Planner):
    """A planner whose roadmap is kept with the scene.

    It pays off from the second query in a cluttered scene: among 120 boxes the median query took a third of the
    time of RRT-Connect, for a path that was a fifth shorter before shortcuts. RRT-Connect and `shorten` are better
    in scenes with few obstacles, for single queries, and where the shortest path matters.

    The first query builds the roadmap. Later ones add no paths to it, so results do not depend on earlier queries.
    An iteration is a sample, of the roadmap (even if drawn for an earlier query) or of RRT-Connect where the
    roadmap does not connect start and goal.

    Args:
        samples: Number of samples of the roadmap; more of them make paths shorter and queries slower.

    Raises:
        InputError: no sample.
    """

    name = _NAME

    def __init__(self, *, samples: int = _SAMPLES) -> None:
        self.samples = checked_samples(samples)

    def __repr__(self) -> str:
        return f"RoadmapPlanner(samples={self.samples})"

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
            # list.append and list.pop are atomic. Roadmaps with another number of samples have another key.
            samples = min(self.samples, query.most)
            idle: list[Graph] = problem.scene.kept.setdefault((_NAME, problem.arms, problem.margin, samples), [])
            graph = idle.pop() if idle else Graph(problem.scene, problem.arms)
            try:
                graph.sample(samples, query.motion, query.in_time)
                query.iterations += graph.samples
                return _solve(query, graph, learn=False)
            finally:
                if samples == self.samples:
                    idle.append(graph)


def checked_samples(samples: int) -> int:
    """A valid number of samples.

    Raises:
        InputError: less than one, more than a million, or not an integer.
    """
    return whole_number("samples", samples, 1, _MOST_SAMPLES)


def _solve(query: Query, graph: Graph, *, learn: bool) -> PlanResult:
    """The shortest path along the roadmap, or that of RRT-Connect if there is none."""
    before = graph.checks
    way = graph.find_path(query.problem.start, query.goals, query.motion, query.in_time)
    query.edges += graph.checks - before
    if way is not None:
        return query.result(PlanStatus.FOUND, way)
    search = tree_search.TreeSearch(query)
    if not search.connect():
        return query.unsolved(f"the roadmap of {graph.size} vertices does not connect them; {search.describe()}")
    waypoints = query.shorten(search.trees.path(), _SHORTCUTS, query.seed).waypoints
    if learn:
        graph.learn(waypoints)
    return query.result(PlanStatus.FOUND, waypoints)
