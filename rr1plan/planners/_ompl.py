"""The only door to OMPL: plain arrays in, plain arrays out, nothing of OMPL's survives the call.

OMPL trusts its caller, so everything is checked before it is asked: numbers it would read as memory,
NaN it would call solved. No exception crosses its C++ code: callbacks keep what was raised, ask the
search to stop, and it is raised again outside. Budgets are counted in the termination condition, which
makes a search repeatable; the clock is looked at there and in every check of an edge.

PRM's own search runs a second thread, which dies with the process on any exception and makes its roadmap
differ from run to run. Here OMPL only grows the roadmap, in this thread, and the question is answered by
Dijkstra's algorithm on it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
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
from rr1plan.planners._ompl_question import Answer, Question, Watch, interrupts_kept
from rr1plan.planning import SearchTree

# A path this near to the straight line's length counts as optimal. Without it informed samplers
# search an ellipsoid of no volume for ever.
_OPTIMAL = 1e-3
_FIRST_ROADMAP, _ROADMAP_GROWTH = 100, 1.3  # termination checks between two queries of a roadmap
_EXPANSION = 4  # one check spent on narrow places for so many spent everywhere
_NOT_SETTINGS = {"setProblemDefinition", "setName", "setProjectionEvaluator", "setDefaultConnectionStrategy"}


def setting_names(planner: str) -> tuple[str, ...]:
    """What can be set of a planner, by OMPL's names."""
    setters = [n for n in dir(getattr(og, planner)) if n.startswith("set") and n[3:4].isupper()]
    without = _NOT_SETTINGS | ({"setExtendedFMT"} if planner == "BFMT" else set())
    return tuple(sorted(_snake(name[3:]) for name in setters if name not in without))


def solve(
    planner: str, question: Question, watch: Watch, seed: int, settings: Mapping[str, Any], *, tree: bool = False
) -> Answer:
    """Search.

    Args:
        planner: OMPL's name of the planner.
        question: The question.
        watch: Budget and counts; has the counts afterwards.
        seed: Seed of OMPL's generators, 1 .. 2^32 - 1.
        settings: Values by OMPL's names; `range` 0 leaves the length of an edge to OMPL.
        tree: Whether to copy what was explored.

    Raises:
        InputError, UnknownNameError: a question or setting OMPL would misread.
        KeyboardInterrupt: Ctrl-C, after everything is cleaned up.
        BackendError: OMPL failed.
    """
    if not 1 <= seed < 2**32:
        raise InputError(f"seed is {seed}, expected 1 .. 2^32 - 1")
    question = question.checked()
    with interrupts_kept(watch):
        try:
            answer = _search(planner, question, watch, seed, settings, tree)
            before = 0
            while planner == "BFMT" and answer.waypoints is None and not watch.over and watch.checks > before:
                before = watch.checks
                settings = {**settings, "num_samples": 2 * settings.get("num_samples", 1000)}
                answer = _search(planner, question, watch, seed, settings, tree)
        except (RuntimeError, TypeError) as error:
            if watch.error is None:
                raise BackendError(f"OMPL's {planner} failed: {error}") from error
            answer = Answer(None)
    kept, watch.error = watch.error, None
    try:
        if kept is not None:
            raise kept
    finally:
        del kept  # its traceback holds this frame: a cycle would keep OMPL's objects until some later collection
    return answer


def _search(
    planner: str, question: Question, watch: Watch, seed: int, settings: Mapping[str, Any], tree: bool
) -> Answer:
    ou.setLogLevel(ou.LOG_NONE)
    ou.RNG.setSeed(seed)
    space = _space(question)
    # Asked for its tree, OMPL's BIT* never lets go of its states, so its certified edges are written down.
    edges: list[tuple[tuple[float, ...], ...]] | None = [] if tree and planner == "BITstar" else None
    information = _information(space, question, watch, edges)
    definition = _definition(information, question)
    search = getattr(og, planner)(information)
    search.setProblemDefinition(definition)
    for name, value in settings.items():
        _set(search, planner, name, value)
    if planner == "BFMT":
        search.setExtendedFMT(False)  # it dies when its samples do not suffice; `solve` begins again with more
    search.setup()
    if isinstance(search, og.PRM):
        answer = _search_roadmap(search, information, question, watch)
    else:
        if hasattr(search, "bestCost"):
            watch.best_cost = lambda: float(search.bestCost().value())
        try:
            search.solve(ob.PlannerTerminationCondition(watch.guarded(watch.is_over, failed=True)))
        finally:
            watch.best_cost = None  # holds the planner, and the watch outlives it
        answer = _solution(definition, len(question.lower))
    if not tree:
        return answer
    return replace(answer, tree=_tree_of(edges) if edges is not None else _explored(search, information, question)[0])


# ---- building ---------------------------------------------------------------------------------


def _space(question: Question) -> Any:
    n = len(question.lower)
    bounds = ob.RealVectorBounds(n)
    for i in range(n):
        bounds.setLow(i, float(question.lower[i]))
        bounds.setHigh(i, float(question.upper[i]))
    space = ob.RealVectorStateSpace(n)
    space.setBounds(bounds)
    return space


class _EdgeValidator(ob.MotionValidator):  # type: ignore[misc]  # the stubs of OMPL are not followed
    """Gives whole edges to the callback. Keeps no reference to OMPL's objects: that would be a leak."""

    def __init__(self, information: Any, n: int, valid: Callable[[Array, Array], bool]) -> None:
        super().__init__(information)
        self.valid, self.n = valid, n
        self.a, self.b = np.zeros(n), np.zeros(n)

    def checkMotion(self, a: Any, b: Any) -> bool:
        """Whether the straight line between two states is free."""
        self.a[:] = a[0 : self.n]
        self.b[:] = b[0 : self.n]
        return self.valid(self.a, self.b)


def _information(
    space: Any, question: Question, watch: Watch, edges: list[tuple[tuple[float, ...], ...]] | None = None
) -> Any:
    n = len(question.lower)
    q = np.zeros(n)

    def state_valid(state: Any) -> bool:
        q[:] = state[0:n]
        return watch.in_time() and question.state_valid(q)

    def edge_valid(a: Array, b: Array) -> bool:
        if not (watch.in_time() and question.edge_valid(a, b)):
            return False
        if edges is not None:
            edges.append((tuple(a.tolist()), tuple(b.tolist())))
        return True

    information = ob.SpaceInformation(space)
    information.setStateValidityChecker(watch.guarded(state_valid, failed=False))
    information.setMotionValidator(_EdgeValidator(information, n, watch.guarded(edge_valid, failed=False)))
    information.setup()
    return information


def _definition(information: Any, question: Question) -> Any:
    definition = ob.ProblemDefinition(information)
    goals = ob.GoalStates(information)
    state = information.allocState()  # Python frees it; OMPL's freeState would be a second time
    state[0 : len(question.start)] = question.start.tolist()
    definition.addStartState(state)
    for goal in question.goals:
        state[0 : len(goal)] = goal.tolist()
        goals.addState(state)
    definition.setGoal(goals)
    objective = ob.PathLengthOptimizationObjective(information)
    nearest = float(np.linalg.norm(question.goals - question.start, axis=1).min())
    objective.setCostThreshold(ob.Cost((1.0 + _OPTIMAL) * nearest))
    definition.setOptimizationObjective(objective)
    return definition


def _set(search: Any, planner: str, name: str, value: Any) -> None:
    setters = {_snake(n[3:]): n for n in dir(search) if n.startswith("set")}
    setter = setters[known_name(f"setting of OMPL's {planner}", name, setting_names(planner))]
    if not isinstance(value, bool | np.bool_) and finite_number(name, value) < 0.0:
        raise InputError(f"setting {name!r} is {value}, expected a number of at least zero")
    try:
        getattr(search, setter)(value)
    except TypeError as error:
        kind = type(getattr(search, "get" + setter[3:])()).__name__
        raise InputError(f"setting {name!r} is {value!r}, expected one {kind}") from error


def _snake(name: str) -> str:
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()


# ---- reading ----------------------------------------------------------------------------------


def _solution(definition: Any, n: int) -> Answer:
    """The solution as an array: an approximate one is none."""
    if not definition.hasExactSolution():
        near = float(definition.getSolutionDifference()) if definition.hasApproximateSolution() else None
        return Answer(None, near)
    states = definition.getSolutionPath().getStates()
    return Answer(np.array([state[0:n] for state in states]))


def _tree_of(edges: list[tuple[tuple[float, ...], ...]]) -> SearchTree:
    """The graph of edges that are given by their ends."""
    index: dict[tuple[float, ...], int] = {}
    pairs = [(index.setdefault(a, len(index)), index.setdefault(b, len(index))) for a, b in edges]
    return SearchTree(np.array(list(index)), np.array(pairs, dtype=np.int64).reshape(-1, 2))


def _explored(search: Any, information: Any, question: Question) -> tuple[SearchTree, NDArray[np.int64]]:
    """What a planner explored, copied, and the indices of the goals in it."""
    n = len(question.lower)
    data = ob.PlannerData(information)
    search.getPlannerData(data)
    count = data.numVertices()
    vertices = np.array([data.getVertex(i).getState()[0:n] for i in range(count)]).reshape(count, n)
    edges = [(i, j) for i in range(count) for j in data.getEdges(i)]
    goals = [data.getGoalIndex(i) for i in range(data.numGoalVertices())]
    tree = SearchTree(vertices, np.array(edges, dtype=np.int64).reshape(-1, 2))
    return tree, np.array(goals, dtype=np.int64)


# ---- roadmaps ---------------------------------------------------------------------------------


def _search_roadmap(search: Any, information: Any, question: Question, watch: Watch) -> Answer:
    """Grow a roadmap in turns and ask it for a path after each; PRM* goes on until the budget ends."""
    goes_on = isinstance(search, og.PRMstar)
    for _ in question.goals:
        search.solve(ob.plannerAlwaysTerminatingCondition())  # takes in the start and one more goal, no more
    turn, answer = float(_FIRST_ROADMAP), Answer(None)
    nearest = float(np.linalg.norm(question.goals - question.start, axis=1).min())
    while not watch.over:
        search.growRoadmapPtc(_turn(watch, int(turn)))
        search.expandRoadmapPtc(_turn(watch, int(turn) // _EXPANSION))
        turn *= _ROADMAP_GROWTH
        answer = _ask_roadmap(search, information, question)
        if answer.waypoints is None:
            continue
        length = float(np.linalg.norm(np.diff(answer.waypoints, axis=0), axis=1).sum())
        watch.note(length)
        if not goes_on or length <= (1.0 + _OPTIMAL) * nearest:
            break
    return answer


def _turn(watch: Watch, checks: int) -> Any:
    """A termination condition that is true after so many checks of the watch."""
    last = watch.checks + checks

    def is_over() -> bool:
        return watch.is_over() or watch.checks >= last

    return ob.PlannerTerminationCondition(watch.guarded(is_over, failed=True))


def _ask_roadmap(search: Any, information: Any, question: Question) -> Answer:
    """The shortest path on the roadmap (Dijkstra 1959), or how near to a goal the start's part of it comes."""
    tree, ends = _explored(search, information, question)
    vertices = tree.vertices
    found = np.flatnonzero((vertices == question.start).all(axis=1))
    if len(found) == 0:  # OMPL found the start invalid
        return Answer(None)
    start = int(found[0])
    i, j = tree.edges.T
    lengths = np.linalg.norm(vertices[i] - vertices[j], axis=1)
    graph = coo_array((lengths, (i, j)), shape=(len(vertices), len(vertices))).tocsr()
    table, links = dijkstra(graph, directed=False, indices=np.array([start]), return_predecessors=True)
    far, before = table[0], links[0]
    if len(ends) == 0 or not np.isfinite(far[ends]).any():
        reached = vertices[np.isfinite(far)]
        gaps = [np.linalg.norm(reached - goal, axis=1).min() for goal in question.goals]
        return Answer(None, float(min(gaps)))
    chain = [int(ends[np.argmin(far[ends])])]
    while chain[-1] != start:
        chain.append(int(before[chain[-1]]))
    return Answer(vertices[chain[::-1]])
