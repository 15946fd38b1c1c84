"""The only module that imports OMPL: arrays in, arrays out; no OMPL object outlives the call.

OMPL does not validate its input (it reads invalid numbers as memory, and reports NaN as solved), so all
arguments are validated here. No exception crosses its C++ code: callbacks store the exception and stop
the search, and it is raised again outside. Budgets are counted in the termination condition, which
makes a search reproducible; the clock is read there and in every edge check.

OMPL's PRM searches in a second thread, in which any exception terminates the process, and its roadmap
differs from run to run. Here OMPL only grows the roadmap, in the calling thread, and Dijkstra's algorithm
finds the path on it.

All generators of a process take their seeds from one sequence. A search creates its generators before its first
termination check; until then other threads wait with theirs, so that searches in several threads are reproducible.
"""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from threading import RLock
from typing import Any

import numpy as np
import ompl.base as ob
import ompl.geometric as og
import ompl.util as ou
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from rr1plan.checks import Array, finite_number, known_name
from rr1plan.errors import BackendError, InputError
from rr1plan.path import edge_lengths
from rr1plan.planners.ompl_query import OmplQuery, OmplResult, Watch, interrupts_kept
from rr1plan.planning import SearchTree
from rr1plan.thread_locks import per_process

# A path longer than the straight line by at most this share counts as optimal. Without it informed
# samplers sample an ellipsoid of zero volume forever.
_OPTIMAL = 1e-3
_FIRST_ROADMAP, _ROADMAP_GROWTH = 100, 1.3  # termination checks between two queries of a roadmap
_EXPANSION = 4  # checks for growing the roadmap per check for expanding it in narrow passages
# Held by the thread whose search creates its generators.
_seeding = per_process(sys.modules[__name__], "_seeding", RLock)
_NOT_SETTINGS = {"setProblemDefinition", "setName", "setProjectionEvaluator", "setDefaultConnectionStrategy"}


def setting_names(planner: str) -> tuple[str, ...]:
    """Settings of a planner, by OMPL's names."""
    setters = [n for n in dir(getattr(og, planner)) if n.startswith("set") and n[3:4].isupper()]
    without = _NOT_SETTINGS | ({"setExtendedFMT"} if planner == "BFMT" else set())
    return tuple(sorted(_snake_case(name[3:]) for name in setters if name not in without))


def solve(
    planner: str, query: OmplQuery, watch: Watch, seed: int, settings: Mapping[str, Any], *, tree: bool = False
) -> OmplResult:
    """Run a planner of OMPL.

    Args:
        planner: OMPL's name of the planner.
        query: The query.
        watch: Budget and counters; the counters are updated.
        seed: Seed of OMPL's generators, 1 .. 2^32 - 1.
        settings: Values by OMPL's names; `range` 0 selects OMPL's default edge length.
        tree: Whether to copy the explored graph.

    Raises:
        InputError, UnknownNameError: an invalid query or setting.
        KeyboardInterrupt: Ctrl-C, after cleanup.
        BackendError: OMPL failed.
    """
    if not 1 <= seed < 2**32:
        raise InputError(f"seed is {seed}, expected 1 .. 2^32 - 1")
    query = query.checked()
    with interrupts_kept(watch):
        try:
            result = _search(planner, query, watch, seed, settings, tree)
            before = 0
            while planner == "BFMT" and result.waypoints is None and not watch.over and watch.checks > before:
                before = watch.checks
                settings = {**settings, "num_samples": 2 * settings.get("num_samples", 1000)}
                result = _search(planner, query, watch, seed, settings, tree)
        except (RuntimeError, TypeError) as error:
            if watch.error is None:
                raise BackendError(f"OMPL's {planner} failed: {error}") from error
            result = OmplResult(None)
    kept, watch.error = watch.error, None
    try:
        if kept is not None:
            raise kept
    finally:
        del kept  # its traceback refers to this frame: a cycle would keep OMPL's objects alive
    return result


def _search(
    planner: str, query: OmplQuery, watch: Watch, seed: int, settings: Mapping[str, Any], tree: bool
) -> OmplResult:
    ou.setLogLevel(ou.LOG_NONE)
    # OMPL's BIT* leaks its states when its planner data is read, so its certified edges are recorded here.
    edges: list[tuple[tuple[float, ...], ...]] | None = [] if tree and planner == "BITstar" else None
    with _seeded(seed) as seeds_used:
        information = _information(query, watch, edges)
        definition = _definition(information, query)
        search = getattr(og, planner)(information)
        search.setProblemDefinition(definition)
        for name, value in settings.items():
            _set(search, planner, name, value)
        if planner == "BFMT":
            search.setExtendedFMT(False)  # it crashes if its samples do not suffice; `solve` restarts it with more
        search.setup()
        if isinstance(search, og.PRM):
            result = _search_roadmap(search, information, query, watch, seeds_used)
        else:
            _solve_in_budget(search, watch, seeds_used)
            result = _solution(definition, query)
    if not tree:
        return result
    return replace(result, tree=_tree_of(edges) if edges is not None else _explored(search, information, query)[0])


@contextmanager
def _seeded(seed: int) -> Iterator[Callable[[], None]]:
    """Seed the generators that a search creates, until it calls the function returned here or ends."""
    held, lock = True, _seeding  # in a forked process, another lock has that name

    def seeds_used() -> None:
        nonlocal held
        if held:
            held = False
            lock.release()

    lock.acquire()
    try:
        ou.RNG.setSeed(seed)
        yield seeds_used
    finally:
        seeds_used()


def _solve_in_budget(search: ob.Planner, watch: Watch, seeds_used: Callable[[], None]) -> None:
    """Run a planner until it finds a path or its budget is used up."""

    def is_over() -> bool:
        seeds_used()
        return watch.is_over()

    if hasattr(search, "bestCost"):
        watch.best_cost = lambda: float(search.bestCost().value())
    try:
        search.solve(ob.PlannerTerminationCondition(watch.guarded(is_over, failed=True)))
    finally:
        watch.best_cost = None  # refers to the planner, and `watch` outlives it


# ---- building ---------------------------------------------------------------------------------


def _space(query: OmplQuery) -> ob.StateSpace:
    n = len(query.lower)
    bounds = ob.RealVectorBounds(n)
    for i in range(n):
        bounds.setLow(i, float(query.lower[i]))
        bounds.setHigh(i, float(query.upper[i]))
    space = ob.RealVectorStateSpace(n)
    space.setBounds(bounds)
    return space


class _EdgeValidator(ob.MotionValidator):  # type: ignore[misc]  # the stubs of OMPL are not followed
    """Passes whole edges to the callback. Stores no reference to OMPL's objects: that would leak them."""

    def __init__(self, information: ob.SpaceInformation, n: int, valid: Callable[[Array, Array], bool]) -> None:
        super().__init__(information)
        self.valid, self.n = valid, n
        self.a, self.b = np.zeros(n), np.zeros(n)

    def checkMotion(self, a: ob.State, b: ob.State) -> bool:
        """Whether the straight line between two states is free."""
        self.a[:] = a[0 : self.n]
        self.b[:] = b[0 : self.n]
        return self.valid(self.a, self.b)


def _information(
    query: OmplQuery, watch: Watch, edges: list[tuple[tuple[float, ...], ...]] | None
) -> ob.SpaceInformation:
    n = len(query.lower)
    q = np.zeros(n)

    # Some samplers leave the bounds: SORRT* also takes the samples of an ellipsoid that OMPL's own test rejects.
    def in_bounds(q: Array) -> bool:
        return bool((query.lower <= q).all() and (q <= query.upper).all())

    def state_valid(state: ob.State) -> bool:
        q[:] = state[0:n]
        return watch.in_time() and in_bounds(q) and query.state_valid(q)

    def edge_valid(a: Array, b: Array) -> bool:
        if not (watch.in_time() and in_bounds(a) and in_bounds(b) and query.edge_valid(a, b)):
            return False
        if edges is not None:
            edges.append((tuple(a.tolist()), tuple(b.tolist())))
        return True

    information = ob.SpaceInformation(_space(query))
    information.setStateValidityChecker(watch.guarded(state_valid, failed=False))
    information.setMotionValidator(_EdgeValidator(information, n, watch.guarded(edge_valid, failed=False)))
    information.setup()
    return information


def _definition(information: ob.SpaceInformation, query: OmplQuery) -> ob.ProblemDefinition:
    definition = ob.ProblemDefinition(information)
    goals = ob.GoalStates(information)
    state = information.allocState()  # owned by Python; OMPL's freeState would free it twice
    state[0 : len(query.start)] = query.start.tolist()
    definition.addStartState(state)
    for goal in query.goals:
        state[0 : len(goal)] = goal.tolist()
        goals.addState(state)
    definition.setGoal(goals)
    objective = ob.PathLengthOptimizationObjective(information)
    objective.setCostThreshold(ob.Cost(_optimal_length(query)))
    definition.setOptimizationObjective(objective)
    return definition


def _optimal_length(query: OmplQuery) -> float:
    """Length of a path that counts as optimal [rad or m]."""
    return (1.0 + _OPTIMAL) * float(np.linalg.norm(query.goals - query.start, axis=1).min())


_SHARES = ("_bias", "_fraction")  # how OMPL's names of shares end


def _set(search: ob.Planner, planner: str, name: str, value: Any) -> None:
    setters = {_snake_case(n[3:]): n for n in dir(search) if n.startswith("set")}
    setter = setters[known_name(f"setting of OMPL's {planner}", name, setting_names(planner))]
    if not isinstance(value, bool | np.bool_) and finite_number(name, value) < 0.0:
        raise InputError(f"setting {name!r} is {value}, expected a number of at least zero")
    # With a larger bias every sample is the goal, and the search never ends.
    if name.endswith(_SHARES) and value > 1.0:
        raise InputError(f"setting {name!r} is {value}, expected a share from 0 to 1")
    try:
        getattr(search, setter)(value)
    except TypeError as error:
        kind = type(getattr(search, "get" + setter[3:])()).__name__
        raise InputError(f"setting {name!r} is {value!r}, expected one {kind}") from error


def _snake_case(name: str) -> str:
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()


# ---- reading ----------------------------------------------------------------------------------


def _solution(definition: ob.ProblemDefinition, query: OmplQuery) -> OmplResult:
    """The exact solution as an array; approximate ones do not count, nor AORRTC's paths from a goal to itself."""
    n = len(query.lower)
    if not definition.hasExactSolution():
        near = float(definition.getSolutionDifference()) if definition.hasApproximateSolution() else None
        return OmplResult(None, near)
    states = definition.getSolutionPath().getStates()
    path = np.array([state[0:n] for state in states])
    return OmplResult(path if np.allclose(path[0], query.start, rtol=0.0, atol=1e-9) else None)


def _tree_of(edges: list[tuple[tuple[float, ...], ...]]) -> SearchTree:
    """The graph of edges given by the coordinates of their vertices."""
    index: dict[tuple[float, ...], int] = {}
    pairs = [(index.setdefault(a, len(index)), index.setdefault(b, len(index))) for a, b in edges]
    return SearchTree(np.array(list(index)), np.array(pairs, dtype=np.int64).reshape(-1, 2))


def _explored(
    search: ob.Planner, information: ob.SpaceInformation, query: OmplQuery
) -> tuple[SearchTree, NDArray[np.int64]]:
    """A copy of the explored graph, and the indices of the goals in it."""
    n = len(query.lower)
    data = ob.PlannerData(information)
    search.getPlannerData(data)
    count = data.numVertices()
    vertices = np.array([data.getVertex(i).getState()[0:n] for i in range(count)]).reshape(count, n)
    edges = [(i, j) for i in range(count) for j in data.getEdges(i)]
    goals = [data.getGoalIndex(i) for i in range(data.numGoalVertices())]
    tree = SearchTree(vertices, np.array(edges, dtype=np.int64).reshape(-1, 2))
    return tree, np.array(goals, dtype=np.int64)


# ---- roadmaps ---------------------------------------------------------------------------------


def _search_roadmap(
    search: ob.Planner, information: ob.SpaceInformation, query: OmplQuery, watch: Watch, seeds_used: Callable[[], None]
) -> OmplResult:
    """Grow a roadmap in rounds and search it after each round; PRM* continues until the budget ends."""
    optimizing, at_once = isinstance(search, og.PRMstar), ob.plannerAlwaysTerminatingCondition()
    for _ in query.goals:
        search.solve(at_once)  # only adds the start and one more goal
    search.growRoadmapPtc(at_once)  # these two only create their generators
    search.expandRoadmapPtc(at_once)
    seeds_used()
    checks, result, deadline = float(_FIRST_ROADMAP), OmplResult(None), watch.deadline
    while not watch.over:
        search.growRoadmapPtc(_after(watch, int(checks)))
        search.expandRoadmapPtc(_after(watch, int(checks) // _EXPANSION))
        checks *= _ROADMAP_GROWTH
        began = time.perf_counter()
        result = _query_roadmap(search, information, query)
        now = time.perf_counter()
        # Growth ends in time for the last query, which takes less than twice as long as this one.
        watch.deadline = deadline - 2.0 * (now - began)
        watch.over = watch.over or now >= watch.deadline
        if result.waypoints is None:
            continue
        length = float(edge_lengths(result.waypoints).sum())
        watch.note(length)
        if not optimizing or length <= _optimal_length(query):
            break
    return result


def _after(watch: Watch, checks: int) -> ob.PlannerTerminationCondition:
    """A termination condition that is true after `checks` more termination checks."""
    last = watch.checks + checks

    def is_over() -> bool:
        return watch.is_over() or watch.checks >= last

    return ob.PlannerTerminationCondition(watch.guarded(is_over, failed=True))


def _query_roadmap(search: ob.Planner, information: ob.SpaceInformation, query: OmplQuery) -> OmplResult:
    """The shortest path on the roadmap (Dijkstra 1959), or the distance from the start's component to a goal."""
    tree, ends = _explored(search, information, query)
    vertices = tree.vertices
    found = np.flatnonzero((vertices == query.start).all(axis=1))
    if len(found) == 0:  # OMPL found the start invalid
        return OmplResult(None)
    start = int(found[0])
    i, j = tree.edges.T
    lengths = np.linalg.norm(vertices[i] - vertices[j], axis=1)
    graph = coo_array((lengths, (i, j)), shape=(len(vertices), len(vertices))).tocsr()
    table, links = dijkstra(graph, directed=False, indices=np.array([start]), return_predecessors=True)
    far, before = table[0], links[0]
    if len(ends) == 0 or not np.isfinite(far[ends]).any():
        reached = vertices[np.isfinite(far)]
        gaps = [np.linalg.norm(reached - goal, axis=1).min() for goal in query.goals]
        return OmplResult(None, float(min(gaps)))
    chain = [int(ends[np.argmin(far[ends])])]
    while chain[-1] != start:
        chain.append(int(before[chain[-1]]))
    return OmplResult(vertices[chain[::-1]])
