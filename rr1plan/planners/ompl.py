"""OMPL's planners behind one verb: what they are, how a problem becomes a search, how its answer is checked."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from rr1plan.checks import Array, Seed, as_generator, finite_number, known_name
from rr1plan.collision import MotionChecker
from rr1plan.collision.shelf import borrowed_checker
from rr1plan.path import Path
from rr1plan.planners.goals import check_start, goal_configurations
from rr1plan.planners.query import prepare
from rr1plan.planners.space import Space, with_copies
from rr1plan.planning import Budget, PlanResult, PlanStatus, Progress, ProgressCallback, SearchTree, check_question
from rr1plan.problem import Problem


@dataclass(frozen=True)
class OmplKind:
    """A planner of OMPL: its name there, one line about it, whether it improves its path until the budget ends."""

    ompl: str
    description: str
    optimizing: bool = False


KINDS: Mapping[str, OmplKind] = MappingProxyType(
    {
        "ompl_rrt_connect": OmplKind("RRTConnect", "two trees grow towards each other (Kuffner, LaValle 2000)"),
        "rrt": OmplKind("RRT", "one tree grows to random samples (LaValle 1998)"),
        "rrt_star": OmplKind("RRTstar", "a tree that rewires itself to shorter paths (Karaman, Frazzoli 2011)", True),
        "informed_rrt_star": OmplKind(
            "InformedRRTstar", "RRT* that samples only where a shorter path can be (Gammell et al. 2014)", True
        ),
        "sorrt_star": OmplKind("SORRTstar", "informed RRT* that takes its samples best first (Gammell 2017)", True),
        "aorrtc": OmplKind("AORRTC", "RRT-Connect again and again under a falling cost bound (Wilson 2025)", True),
        "prm": OmplKind("PRM", "a roadmap of the whole space (Kavraki et al. 1996)"),
        "prm_star": OmplKind("PRMstar", "a roadmap dense enough for shortest paths (Karaman, Frazzoli 2011)", True),
        "bit_star": OmplKind("BITstar", "batches of samples, searched best first (Gammell et al. 2015)", True),
        "fmt": OmplKind("FMT", "one wave front through a set of samples (Janson et al. 2015)"),
        "bfmt": OmplKind("BFMT", "two wave fronts through a set of samples (Starek et al. 2015)"),
        "kpiece1": OmplKind("KPIECE1", "a tree led by how well its cells are covered (Sucan, Kavraki 2009)"),
        "bkpiece1": OmplKind("BKPIECE1", "KPIECE with two trees (Sucan, Kavraki 2009)"),
        "lbkpiece1": OmplKind("LBKPIECE1", "BKPIECE that checks edges late (Sucan, Kavraki 2009)"),
    }
)

_DIRECT = 8  # goals to which the straight line is tried first
_RANGE = 0.06  # longest edge of a tree, as a part of the space's diagonal
_REPORTS = 0.1  # time between two reports of progress [s]


class OmplPlanner:
    """One of OMPL's planners.

    Args:
        name: A name of `planner_names()`, e.g. "ompl_rrt_connect".
        tree: Whether the result keeps what was explored.
        **settings: The planner's own settings by OMPL's names, e.g. range=0.5 [rad], goal_bias=0.1.

    Raises:
        UnknownNameError: no such planner or setting; the message lists them.
        InputError: a setting that is no finite number.
    """

    def __init__(self, name: str = "ompl_rrt_connect", *, tree: bool = False, **settings: float) -> None:
        self.name = known_name("planner", name, KINDS)
        self.tree = bool(tree)
        if settings:
            from rr1plan.planners._ompl import setting_names

            known = ("tree", *setting_names(KINDS[name].ompl))
            for setting, value in settings.items():
                known_name(f"setting of planner {name!r}", setting, known)
                finite_number(setting, value)
        self.settings: Mapping[str, float] = MappingProxyType(dict(settings))

    def __repr__(self) -> str:
        settings = "".join(f", {name}={value!r}" for name, value in self.settings.items())
        return f"OmplPlanner({self.name!r}{settings})"

    @property
    def optimizing(self) -> bool:
        """Whether it goes on after the first path, until the budget ends."""
        return KINDS[self.name].optimizing

    def plan(
        self,
        problem: Problem,
        budget: Budget | None = None,
        rng: Seed = None,
        progress: ProgressCallback | None = None,
    ) -> PlanResult:
        """Plan; see `rr1plan.plan`."""
        check_question(problem, budget, progress)
        prepare()
        began = time.perf_counter()
        with borrowed_checker(problem.scene, problem.arms) as motion:
            query = _Query(self, problem, motion, began, budget or Budget(), rng, progress)
            return query.refusal() or query.direct() or query.search()


class _Query:
    """One call of `plan`: its tools, its clock, its answer so far."""

    def __init__(
        self,
        planner: OmplPlanner,
        problem: Problem,
        motion: MotionChecker,
        began: float,
        budget: Budget,
        rng: Seed,
        progress: ProgressCallback | None,
    ) -> None:
        from rr1plan.planners import _ompl

        self.motion, self.began = motion, began
        self.planner, self.problem, self.budget, self.progress = planner, problem, budget, progress
        # Everything random follows from this one number, so the result's seed repeats it.
        if isinstance(rng, int | np.integer) and not isinstance(rng, bool):
            self.seed = int(rng)
        else:
            self.seed = int(as_generator(rng).integers(2**32))
        self.rng = as_generator(self.seed)
        self.motion = motion
        self.edges_before = motion.edges_checked
        self.watch = _ompl.Watch(budget, self.began, None if progress is None else self.report)
        self.reported = self.began - _REPORTS
        self.goals = np.empty((0, problem.nq))

    # ---- the three stages ----------------------------------------------------------------------

    def refusal(self) -> PlanResult | None:
        """The answer to a problem without a usable start or goal."""
        blocked = check_start(self.problem, self.motion)
        if blocked:
            return self.result(PlanStatus.INVALID_START, reason=blocked)
        found = goal_configurations(self.problem, self.motion, self.rng)
        if found.status is not None:
            return self.result(found.status, reason=found.reason)
        self.goals = with_copies(self.problem, found.configurations)
        return None

    def direct(self) -> PlanResult | None:
        """The answer where the straight line to a near goal is free.

        To the nearest one it is a shortest path; to others it is good enough for planners that stop
        at the first path.
        """
        start = self.problem.start
        if np.array_equal(self.goals[0], start):
            return self.result(PlanStatus.SOLVED, start[None])
        for goal in self.goals[: 1 if self.planner.optimizing else _DIRECT]:
            if self.motion.edge_is_free(start, goal):
                waypoints = np.array([start, goal])
                tree = SearchTree(waypoints, np.array([[0, 1]])) if self.planner.tree else None
                return self.result(PlanStatus.SOLVED, waypoints, tree=tree)
        return None

    def search(self) -> PlanResult:
        """The answer of OMPL, certified once more."""
        from rr1plan.planners import _ompl

        start, space = self.problem.start, Space.around(self.problem, self.goals)
        if not space.can_move:
            return self.result(PlanStatus.INFEASIBLE, reason="no joint can move, and the start is not a goal")
        # A configuration that is no certified edge has none either, so Coal need not be asked about it.
        is_free = self.motion.edge_is_free
        query = _ompl.Query(
            space.lower[space.movable],
            space.upper[space.movable],
            space.reduce(start),
            space.reduce(self.goals),
            lambda q: is_free(space.whole(q, start), space.whole(q, start)),
            lambda a, b: is_free(space.whole(a, start), space.whole(b, start)),
        )
        kind = KINDS[self.planner.name].ompl
        seed = int(self.rng.integers(1, 2**32))
        settings = {**self.defaults(space), **self.planner.settings}
        answer = _ompl.solve(kind, query, self.watch, seed, settings, tree=self.planner.tree)
        tree = None if answer.tree is None else replace(answer.tree, vertices=space.whole(answer.tree.vertices, start))
        if self.watch.cancelled:
            return self.result(PlanStatus.CANCELLED, reason="the progress callback returned False", tree=tree)
        if answer.waypoints is None:
            return self.result(PlanStatus.TIMEOUT, reason=self.why(answer.difference), tree=tree)
        waypoints = space.whole(answer.waypoints, start)
        if not self.motion.path_is_free(waypoints):
            reason = "a path was found, but an edge of it passes too near to something to be certified again"
            return self.result(PlanStatus.TIMEOUT, reason=reason, tree=tree)
        return self.result(PlanStatus.SOLVED, waypoints, tree=tree)

    # ---- pieces ----------------------------------------------------------------------------------

    def defaults(self, space: Space) -> dict[str, float]:
        """Settings used where the caller gives none: edges short enough for narrow passages."""
        from rr1plan.planners._ompl import setting_names

        if "range" not in setting_names(KINDS[self.planner.name].ompl):
            return {}
        return {"range": _RANGE * space.diagonal}

    def why(self, difference: float | None) -> str:
        """Why there is no path, in words."""
        used = time.perf_counter() - self.began
        near = "" if difference is None else f"; the nearest it came to a goal is {difference:.3g} rad"
        done = "budget used up" if self.watch.over else "the planner gave up"
        return f"no path found: {done} after {used:.3g} s and {self.watch.checks} iterations{near}"

    def report(self, seconds: float, fraction: float, cost: float | None) -> bool:
        """Tell the progress about ten times a second; False when it wants to end the search."""
        now = time.perf_counter()
        if self.progress is None or now - self.reported < _REPORTS:
            return True
        self.reported = now
        return self.progress(Progress(self.planner.name, seconds, fraction, cost)) is not False

    def result(
        self, status: PlanStatus, waypoints: Array | None = None, *, reason: str = "", tree: SearchTree | None = None
    ) -> PlanResult:
        """The answer with the counts so far."""
        path = None if waypoints is None else Path(self.problem.joint_names, waypoints)
        seconds = time.perf_counter() - self.began
        history = list(self.watch.history) if path is not None else []
        if path is not None and (not history or path.length < history[-1][1]):
            history.append((seconds, path.length))
        return PlanResult(
            status,
            path,
            reason,
            planner=self.planner.name,
            seed=self.seed,
            seconds=seconds,
            iterations=self.watch.checks,
            edges_checked=self.motion.edges_checked - self.edges_before,
            cost_history=tuple(history),
            tree=tree,
        )
