"""All planners behind one function: `plan(problem, planner="rrt_connect")`.

A planner is derived from `Planner` and gets its name from rows in `_ROWS` and `_OWN`; `register_planner` does this for
planners from other packages.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache, partial
from types import MappingProxyType
from typing import NamedTuple

from rr1plan.checks import Seed, check_text, known_name, shown, true_or_false
from rr1plan.errors import InputError, PlannerError
from rr1plan.planners.anytime import AnytimePlanner
from rr1plan.planners.cartesian import CartesianPlanner
from rr1plan.planners.ompl_planners import KINDS, OmplPlanner
from rr1plan.planners.planner_contract import checked_result
from rr1plan.planners.roadmap import Roadmap, RoadmapPlanner
from rr1plan.planners.rrt_connect import PausingRrtConnect, RrtConnect
from rr1plan.planners.timeout_hints import split_budget, with_hint
from rr1plan.planning import (
    Budget,
    Planner,
    PlannerInfo,
    PlanResult,
    PlanStatus,
    ProgressCallback,
    check_plan_arguments,
)
from rr1plan.scene.problem import Problem

__all__ = [
    "MANY_ARMS_PLANNERS",
    "AnytimePlanner",
    "CartesianPlanner",
    "OmplPlanner",
    "Roadmap",
    "RoadmapPlanner",
    "RrtConnect",
    "chosen_planner",
    "find_path",
    "is_own",
    "make_planner",
    "plan",
    "planner_names",
    "planner_table",
    "register_planner",
]

MANY_ARMS_PLANNERS = ("many_arms", "many_arms_anytime")
"""Planners of `plan_motion` that plan a path for each arm and schedule them; they make trajectories, not paths."""
_ROWS = (
    PlannerInfo(RrtConnect.name, "RRT-Connect as one compiled loop (Kuffner, LaValle 2000; Yershova et al. 2005)"),
    PlannerInfo(
        AnytimePlanner.name, "RRT-Connect restarted under decreasing cost bounds, with shortcuts, compiled", True
    ),
    PlannerInfo(RoadmapPlanner.name, "a roadmap cached with the scene, for many queries, compiled"),
    *(PlannerInfo(name, kind.description, kind.optimizing) for name, kind in KINDS.items()),
    PlannerInfo("cartesian", "the tool moves on a straight line to a pose, the joints follow"),
)
# Our own planners by name: factories with default settings.
_OWN: Mapping[str, Callable[[], Planner]] = MappingProxyType(
    {
        RrtConnect.name: RrtConnect,
        AnytimePlanner.name: AnytimePlanner,
        RoadmapPlanner.name: RoadmapPlanner,
        **{name: partial(OmplPlanner, name) for name in KINDS},
        CartesianPlanner.name: CartesianPlanner,
    }
)
# Planners whose results need no check.
_TRUSTED = frozenset(
    {RrtConnect, PausingRrtConnect, AnytimePlanner, RoadmapPlanner, Roadmap, CartesianPlanner, OmplPlanner}
)


class _Registered(NamedTuple):
    """A planner that a caller registered."""

    info: PlannerInfo
    factory: Callable[[], object]


_registered: dict[str, _Registered] = {}


def planner_names() -> tuple[str, ...]:
    """Names of all planners of one path, registered ones last.

    `plan_motion` also takes "many_arms" and "many_arms_anytime", which make a motion of many arms.
    """
    return (*_OWN, *_registered)


def is_own(name: str) -> bool:
    """Whether a planner of this name comes with rr1plan."""
    return name in _OWN


def planner_table() -> tuple[PlannerInfo, ...]:
    """All planners: name, one line of description, whether it improves its path until the budget ends."""
    return (*_ROWS, *(row.info for row in _registered.values()))


def register_planner(
    name: str, factory: Callable[[], Planner], *, description: str = "", optimizing: bool = False
) -> None:
    """Register a name for a planner, for `plan`, `plan_motion`, `plan_many` and `planner_names`.

    Args:
        name: The name, one that no planner has yet.
        factory: A class derived from `Planner`, or a function without arguments; called each time a planner is needed.
        description: One line about it.
        optimizing: Whether it improves its path until the budget ends.

    Raises:
        InputError: a name that is taken or has white space or control characters, or a factory that cannot be called.
    """
    check_text("name", name)
    check_text("description", description)
    if name in (*planner_names(), *MANY_ARMS_PLANNERS) or not name:
        reason = "the name is taken; choose another one, or pass an instance instead of a name" if name else "no name"
        raise InputError(f"a planner cannot be registered as {name!r}: {reason}")
    if any(character.isspace() or not character.isprintable() for character in name):
        raise InputError(f"a planner cannot be registered as {name!r}: names have no white space or control characters")
    if not callable(factory):
        raise InputError(f"factory is {shown(factory)}, expected a class derived from Planner, or a function")
    info = PlannerInfo(name, description, true_or_false("optimizing", optimizing))
    _registered[name] = _Registered(info, factory)


def make_planner(name: str) -> Planner:
    """A new planner by name, with default settings.

    Raises:
        UnknownNameError: no such planner; the message lists them.
        PlannerError: the factory of a registered planner raised an exception, or did not return a planner.
    """
    advice = f"plan_motion takes {name!r}, which makes a motion, not a path." if name in MANY_ARMS_PLANNERS else ""
    if known_name("planner", name, planner_names(), advice) in _OWN:
        return _OWN[name]()
    try:
        planner = _registered[name].factory()
    except Exception as error:
        raise PlannerError(f"the factory of planner {name!r} raised {type(error).__name__}: {error}") from error
    if not isinstance(planner, Planner):
        raise PlannerError(f"the factory of planner {name!r} returned {shown(planner)}, expected a Planner")
    return planner


# One of our own planners with default settings serves all problems.
_own_planner = lru_cache(maxsize=None)(make_planner)


def chosen_planner(planner: str | Planner) -> Planner:
    """The planner for a name or an instance.

    Raises:
        UnknownNameError: no such name.
        InputError: neither a name nor an instance.
    """
    if isinstance(planner, str):
        return _own_planner(planner) if planner in _OWN else make_planner(planner)
    if isinstance(planner, Planner):
        if not isinstance(getattr(planner, "name", None), str):
            raise InputError(f"planner is a {type(planner).__name__} without a name, expected text as its name")
        return planner
    raise InputError(
        f"planner is {shown(planner)}, expected a name of planner_names() or an instance of Planner, not a class"
    )


def plan(
    problem: Problem,
    *,
    planner: str | Planner = "rrt_connect",
    budget: Budget | None = None,
    rng: Seed = None,
    progress: ProgressCallback | None = None,
) -> PlanResult:
    """Find a path from the start to a goal, every edge certified free.

    Args:
        problem: The planning problem. Planners to goal configurations (all but "cartesian") search for eight of each
            pose or region goal; if many reach it, the nearest one may not be among them. Our own planners search for
            more if they make no progress, those of OMPL at once.
        planner: A name of `planner_names()`, or an instance of `Planner`: one of ours with other settings, such as
            `RrtConnect(range=0.5)`, or your own.
        budget: When to stop (default: 10 s). Under a budget of iterations alone the same seed gives the
            same path to the byte. A tenth of the seconds (at most 1 s) and a twentieth of the iterations are reserved
            for a hint why the search failed; a budget below a second or a thousand iterations gets no hint.
        rng: Generator or seed of all random numbers.
        progress: Called about ten times a second; it may return False to cancel.

    Returns:
        The path, or why there is none. The status is then INVALID_START or INVALID_GOAL (which elements collide and how
        deep, which joint exceeds its limit by how much), INFEASIBLE (no configuration reaches the goal, or a joint
        provably cannot pass an obstacle, which RRT-Connect detects), TIMEOUT or CANCELLED.

    Raises:
        UnknownNameError: no such planner.
        MissingPackageError: a planner of OMPL, which is not installed.
        InputError: a problem that this planner does not support.
        PlannerError: a planner of your own raised an exception, or returned a path that does not solve the problem.
        KeyboardInterrupt: Ctrl-C, after cleaning up.
    """
    check_plan_arguments(problem, budget, progress)
    chosen = chosen_planner(planner)
    search, rest = split_budget(budget or Budget())
    result = find_path(problem, chosen, search, rng, progress)
    if result.status is not PlanStatus.TIMEOUT or rest is None or chosen.keeps_shape:
        return result
    return with_hint(problem, result, rest, progress)


def find_path(
    problem: Problem, planner: Planner, budget: Budget, rng: Seed, progress: ProgressCallback | None
) -> PlanResult:
    """Like `plan` with arguments that are known to be valid, without a hint why a search failed."""
    if type(planner) in _TRUSTED:
        return planner.plan(problem, budget=budget, rng=rng, progress=progress)
    return checked_result(planner, problem, budget, rng, progress)
