"""All planners behind one function: `plan(problem, planner="rrt_connect")`.

A planner is a class with a `name` and a method `plan`; `_ROWS` lists all planners by name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from types import MappingProxyType

from rr1plan.checks import Seed, known_name
from rr1plan.errors import InputError
from rr1plan.planners.anytime import AnytimePlanner
from rr1plan.planners.cartesian import CartesianPlanner
from rr1plan.planners.ompl import KINDS, OmplPlanner
from rr1plan.planners.roadmap import Roadmap, RoadmapPlanner
from rr1plan.planners.rrt_connect import RrtConnect
from rr1plan.planners.timeout_hints import split_budget, with_hint
from rr1plan.planning import Budget, Planner, PlannerInfo, PlanResult, PlanStatus, ProgressCallback, check_question
from rr1plan.problem import Problem

__all__ = [
    "AnytimePlanner",
    "CartesianPlanner",
    "OmplPlanner",
    "Roadmap",
    "RoadmapPlanner",
    "RrtConnect",
    "make_planner",
    "plan",
    "planner_names",
    "planner_table",
]

_ROWS = (
    PlannerInfo(RrtConnect.name, "RRT-Connect as one compiled loop (Kuffner, LaValle 2000; Yershova et al. 2005)"),
    PlannerInfo(
        AnytimePlanner.name, "RRT-Connect restarted under decreasing cost bounds, with shortcuts, compiled", True
    ),
    PlannerInfo(RoadmapPlanner.name, "a roadmap cached with the scene, for many queries, compiled"),
    *(PlannerInfo(name, kind.description, kind.optimizing) for name, kind in KINDS.items()),
    PlannerInfo("cartesian", "the tool moves on a straight line to a pose, the joints follow"),
)
_NAMES = tuple(row.name for row in _ROWS)
# Planners of this package, and their settings.
_OWN: Mapping[str, tuple[Callable[..., Planner], tuple[str, ...]]] = MappingProxyType(
    {
        RrtConnect.name: (RrtConnect, ("range", "tree")),
        AnytimePlanner.name: (AnytimePlanner, ("range",)),
        RoadmapPlanner.name: (RoadmapPlanner, ("samples",)),
        CartesianPlanner.name: (CartesianPlanner, ("tolerance", "orientation_tolerance")),
    }
)


def planner_names() -> tuple[str, ...]:
    """Names of all planners."""
    return _NAMES


def planner_table() -> tuple[PlannerInfo, ...]:
    """All planners: name, one line of description, whether it improves its path until the budget ends."""
    return _ROWS


def make_planner(name: str, **settings: float) -> Planner:
    """A planner by name.

    Args:
        name: A name of `planner_names()`.
        **settings: Arguments of the planner's constructor, e.g. range=0.5 [rad] or tree=True.

    Raises:
        UnknownNameError: no such planner or setting; the message lists them.
        InputError: a setting of the wrong kind.
    """
    if known_name("planner", name, _NAMES) in KINDS:
        return OmplPlanner(name, **settings)  # type: ignore[arg-type]  # `tree` is among the settings
    kind, known = _OWN[name]
    for setting in settings:
        known_name(f"setting of planner {name!r}", setting, known)
    return kind(**settings)


# A planner with default settings is shared by all queries.
_usual_planner = lru_cache(maxsize=None)(make_planner)


def plan(
    problem: Problem,
    planner: str | Planner = "rrt_connect",
    budget: Budget | None = None,
    rng: Seed = None,
    progress: ProgressCallback | None = None,
) -> PlanResult:
    """Find a path from the start to a goal, every edge certified free.

    Args:
        problem: The planning problem. All planners except "cartesian" sample up to eight configurations of each pose
            or region goal by inverse kinematics, not necessarily the nearest ones; the compiled planners
            sample more of them if the search makes no progress.
        planner: A name of `planner_names()`, or a planner with other settings.
        budget: When to stop (default: 10 s). Under a budget of iterations alone the same seed gives the
            same path to the byte. A tenth of the seconds (at most 1 s) and a twentieth of the iterations are reserved
            for a hint why the search failed; a budget below a second or a thousand iterations gets no hint.
        rng: Generator or seed of all random numbers.
        progress: Called about ten times a second; it may return False to cancel.

    Returns:
        The path, or why there is none: INVALID_START, INVALID_GOAL (which elements collide and how deep, which
        joint exceeds its limit by how much), INFEASIBLE (no configuration reaches the goal), TIMEOUT, CANCELLED.

    Raises:
        UnknownNameError: no such planner.
        InputError: a problem this planner does not support.
        KeyboardInterrupt: Ctrl-C, after cleaning up.
    """
    check_question(problem, budget, progress)
    if not hasattr(planner, "plan"):
        planner = _usual_planner(planner) if isinstance(planner, str) else make_planner(planner)
    elif isinstance(planner, type):
        raise InputError(f"planner is the class {planner.__name__}, expected one of its instances, or a name")
    search, rest = split_budget(budget or Budget())
    result = planner.plan(problem, search, rng, progress)
    if result.status is not PlanStatus.TIMEOUT or rest is None or isinstance(planner, CartesianPlanner):
        return result
    return with_hint(problem, result, rest, progress)
