"""Planners of OMPL: their names, the conversion of a problem to a query, and the check of its result."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib import import_module
from importlib.util import find_spec
from types import MappingProxyType

from rr1plan.checks import Seed, as_generator, counted, finite_number, known_name, of_kind, true_or_false
from rr1plan.errors import MissingPackageError
from rr1plan.model.joint_space import Space, with_copies
from rr1plan.path import edge_lengths
from rr1plan.planners.ompl_query import OmplQuery, OmplResult, Watch
from rr1plan.planners.planning_query import STRAIGHT_LINES, Query
from rr1plan.planning import Budget, Planner, PlanResult, PlanStatus, ProgressCallback
from rr1plan.scene.joint_units import length_unit
from rr1plan.scene.problem import Problem


@dataclass(frozen=True)
class OmplKind:
    """OMPL's name and a one-line description of a planner, and whether it improves its path until the budget ends."""

    ompl: str
    description: str
    optimizing: bool = False


KINDS: Mapping[str, OmplKind] = MappingProxyType(
    {
        "ompl_rrt_connect": OmplKind("RRTConnect", "two trees that grow toward each other (Kuffner, LaValle 2000)"),
        "rrt": OmplKind("RRT", "one tree that grows toward random samples (LaValle 1998)"),
        "rrt_star": OmplKind("RRTstar", "a tree that rewires itself to shorter paths (Karaman, Frazzoli 2011)", True),
        "informed_rrt_star": OmplKind(
            "InformedRRTstar", "RRT* that samples the ellipsoid of shorter paths (Gammell et al. 2014)", True
        ),
        "sorrt_star": OmplKind("SORRTstar", "informed RRT* that takes its samples best first (Gammell 2017)", True),
        "aorrtc": OmplKind("AORRTC", "RRT-Connect restarted under a decreasing cost bound (Wilson 2025)", True),
        "prm": OmplKind("PRM", "a roadmap of the whole space (Kavraki et al. 1996)"),
        "prm_star": OmplKind("PRMstar", "a roadmap dense enough for shortest paths (Karaman, Frazzoli 2011)", True),
        "bit_star": OmplKind("BITstar", "batches of samples, searched best first (Gammell et al. 2015)", True),
        "fmt": OmplKind("FMT", "one wave front through a set of samples (Janson et al. 2015)"),
        "bfmt": OmplKind("BFMT", "two wave fronts through a set of samples (Starek et al. 2015)"),
        "kpiece1": OmplKind("KPIECE1", "a tree that expands sparsely covered cells first (Sucan, Kavraki 2009)"),
        "bkpiece1": OmplKind("BKPIECE1", "KPIECE with two trees (Sucan, Kavraki 2009)"),
        "lbkpiece1": OmplKind("LBKPIECE1", "BKPIECE with lazy edge checks (Sucan, Kavraki 2009)"),
    }
)

WITHOUT_RELEASE = sys.version_info >= (3, 14)
"""Whether OMPL has no release for this version of Python, so that rr1plan is installed without it."""

_ADVICE = "it has no release for Python 3.14 yet: use planner 'rrt_connect', 'anytime' or 'roadmap', or Python 3.13"
_RANGE = 0.06  # longest edge of a tree, as a part of the space's diagonal


class OmplPlanner(Planner):
    """One of OMPL's planners.

    Args:
        name: A name of `planner_names()`, e.g. "ompl_rrt_connect".
        tree: Whether the result keeps what was explored.
        settings: The planner's own settings by OMPL's names, e.g. {"range": 0.5, "goal_bias": 0.1}; lengths in
            rad (or m).

    Raises:
        UnknownNameError: no such planner or setting; the message lists them.
        InputError: a setting that is not a finite number.
        MissingPackageError: settings, but OMPL is not installed.
    """

    def __init__(
        self, name: str = "ompl_rrt_connect", *, tree: bool = False, settings: Mapping[str, float] | None = None
    ) -> None:
        self.name = known_name("planner", name, KINDS)
        self.tree = true_or_false("tree", tree)
        of_kind("settings", settings, Mapping, optional=True)
        settings = dict(settings or {})
        if settings:
            self._check_installation()
            from rr1plan.planners.ompl_adapter import setting_names

            known = setting_names(KINDS[name].ompl)
            for setting, value in settings.items():
                known_name(f"{name} setting", setting, known)
                finite_number(setting, value)
        self.settings: Mapping[str, float] = MappingProxyType(settings)

    def __repr__(self) -> str:
        settings = f", settings={dict(self.settings)!r}" if self.settings else ""
        return f"OmplPlanner({self.name!r}{settings})"

    def __getstate__(self) -> dict[str, object]:
        """The attributes, with settings that can be pickled."""
        return {**self.__dict__, "settings": dict(self.settings)}

    @property
    def optimizing(self) -> bool:
        """Whether it improves its path until the budget ends."""
        return KINDS[self.name].optimizing

    def plan(
        self,
        problem: Problem,
        *,
        budget: Budget | None = None,
        rng: Seed = None,
        progress: ProgressCallback | None = None,
    ) -> PlanResult:
        """Plan; see `rr1plan.plan`."""
        self._check_installation()
        import_module("rr1plan.planners.ompl_adapter")  # takes half a second, before the time budget starts
        with Query(self.name, problem, budget, rng, progress) as query:
            refused = query.early_exit()
            return _Search(self, query).run() if refused is None else refused

    def _check_installation(self) -> None:
        if find_spec("ompl") is None:
            raise MissingPackageError("ompl", f"planner {self.name!r}", advice=_ADVICE if WITHOUT_RELEASE else None)


class _Search:
    """The search for one query with a valid start and goals."""

    def __init__(self, planner: OmplPlanner, query: Query) -> None:
        self.planner, self.query = planner, query
        self.watch = Watch(query.budget, query.began, self.goes_on, history=query.history)

    def run(self) -> PlanResult:
        """A straight line if one is free, otherwise OMPL's path, certified again.

        The straight line to the nearest goal is a shortest path; lines to other goals suffice for planners that stop
        at the first path.
        """
        query = self.query
        straight = query.straight_line(1 if self.planner.optimizing else STRAIGHT_LINES, tree=self.planner.tree)
        if straight is not None:
            return straight
        before = query.motion.edges_checked
        result = self.run_ompl()
        found, tree = result.waypoints, result.tree
        certified = found is not None and query.motion.path_is_free(found)
        query.iterations, query.edges = self.watch.checks, query.edges + query.motion.edges_checked - before
        if self.watch.cancelled:
            return query.unsolved("", tree=tree)
        if found is None:
            return query.result(PlanStatus.TIMEOUT, reason=self.why(result.difference), tree=tree)
        if not certified:
            reason = "a path was found, but the certificate of an edge failed when it was repeated"
            return query.result(PlanStatus.TIMEOUT, reason=reason, tree=tree)
        self.watch.note(edge_lengths(found).sum())
        return query.result(PlanStatus.FOUND, found, tree=tree)

    def run_ompl(self) -> OmplResult:
        """OMPL's result, with all columns of q."""
        from rr1plan.planners import ompl_adapter as _ompl

        problem, is_free = self.query.problem, self.query.motion.edge_is_free
        # OMPL gets all goals at once, the copies a turn away too: few of its planners take more during a search.
        self.query.more_goals()
        goals, start = with_copies(problem, self.query.goals), problem.start
        space = Space.unrolled(problem, goals)
        # States are checked as edges of length zero by the kernel, because no other state has certified edges.
        query = OmplQuery(
            space.lower[space.movable],
            space.upper[space.movable],
            space.reduce(start),
            space.reduce(goals),
            lambda q: is_free(space.whole(q, start), space.whole(q, start)),
            lambda a, b: is_free(space.whole(a, start), space.whole(b, start)),
        )
        kind = KINDS[self.planner.name].ompl
        # Default edge length, short enough for narrow passages.
        known = _ompl.setting_names(kind)
        settings = {**({"range": _RANGE * space.diagonal} if "range" in known else {}), **self.planner.settings}
        seed = int(as_generator(self.query.seed).integers(1, 2**32))
        result = _ompl.solve(kind, query, self.watch, seed, settings, tree=self.planner.tree)
        tree, found = result.tree, result.waypoints
        return replace(
            result,
            waypoints=None if found is None else space.whole(found, start),
            tree=None if tree is None else replace(tree, vertices=space.whole(tree.vertices, start)),
        )

    def goes_on(self) -> bool:
        """Report progress; False if the callback cancels the search."""
        self.query.iterations = self.watch.checks
        self.query.in_time()
        return not self.query.cancelled

    def why(self, difference: float | None) -> str:
        """Why there is no path."""
        problem = self.query.problem
        unit = length_unit(problem.joint_names, problem.scene)
        near = "" if difference is None else f"; the nearest it came to a goal is {difference:.3g} {unit}"
        done = "budget used up" if self.watch.over else "the planner gave up"
        used = f"{self.query.seconds:.3g} s and {counted(self.watch.checks, 'iteration')}"
        return f"no path found: {done} after {used}{near}"
