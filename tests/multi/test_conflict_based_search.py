"""Conflict-based search: the minimum sum of arrivals, compared with brute force in the joint space of tiny roadmaps."""

from __future__ import annotations

import heapq
import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

import rr1plan as rp
from rr1plan import dual_arm_shelf, place_grid, plan_many_arms, random_grid, ring_swap
from rr1plan.collision import CollisionChecker
from rr1plan.errors import InputError, UnknownNameError
from rr1plan.multi.agents import Agent
from rr1plan.multi.portfolio import merged_trajectory
from rr1plan.multi.search.arm_roadmap import ArmRoadmap, build_roadmap
from rr1plan.multi.search.conflict_based_search import ConflictBasedSearch, SearchResult, schedule_of
from rr1plan.multi.search.group_planner import GroupPlanner
from rr1plan.multi.search.relative_conflicts import RelativeConflicts
from rr1plan.multi.search.roadmap_search import Departure, Presence, Settling, earliest_moves
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.multi.timing.diagram_cache import DiagramCache
from rr1plan.multi.timing.safe_intervals import blocked_times, earliest_schedule
from rr1plan.planning import Budget, PlanStatus
from rr1plan.scene.problem import JointGoal

_BUDGET = Budget(seconds=120.0)
_STEP = 0.04  # of the brute force [s]


# ---- brute force: time in steps, both arms at once, contacts by Coal, durations in closed form --------------------


def _duration(one: np.ndarray, two: np.ndarray, limits: rp.Limits) -> float:
    """Duration of the fastest motion on a straight line from rest to rest [s]."""
    delta = np.abs(two - one)
    moving = delta > 0.0
    speed = (limits.velocity[moving] / delta[moving]).min()
    acceleration = (limits.acceleration[moving] / delta[moving]).min()
    return 2.0 / math.sqrt(acceleration) if speed**2 >= acceleration else 1.0 / speed + speed / acceleration


def _share(time: float, duration: float, one: np.ndarray, two: np.ndarray, limits: rp.Limits) -> float:
    """Fraction of the line traversed at a time."""
    delta = np.abs(two - one)
    moving = delta > 0.0
    speed = (limits.velocity[moving] / delta[moving]).min()
    acceleration = (limits.acceleration[moving] / delta[moving]).min()
    ramp = min(speed / acceleration, duration / 2.0)
    time = min(time, duration)
    if time > duration / 2.0:
        return 1.0 - _share(duration - time, duration, one, two, limits)
    return 0.5 * acceleration * min(time, ramp) ** 2 + acceleration * ramp * max(0.0, time - ramp)


class _Arm:
    """States of an arm: at a vertex, or some steps along an edge; and those that may follow."""

    def __init__(self, vertices: np.ndarray, edges: list[tuple[int, int]], limits: rp.Limits) -> None:
        self.q = {(v, v, 0): q for v, q in enumerate(vertices)}
        self.next = {(v, v, 0): [(v, v, 0)] for v in range(len(vertices))}
        for a, b in [*edges, *((b, a) for a, b in edges)]:
            duration = _duration(vertices[a], vertices[b], limits)
            steps = math.ceil(duration / _STEP)
            chain = [(a, a, 0), *((a, b, k) for k in range(1, steps)), (b, b, 0)]
            for k, state in enumerate(chain[1:-1], start=1):
                share = _share(k * _STEP, duration, vertices[a], vertices[b], limits)
                self.q[state] = vertices[a] + share * (vertices[b] - vertices[a])
            for state, after in itertools.pairwise(chain):
                self.next.setdefault(state, []).append(after)


def _brute_force(
    problem: rp.Problem, roadmaps: dict[str, tuple[np.ndarray, list[tuple[int, int]]]], goals: tuple[int, ...] = (1,)
) -> float:
    """The minimum sum of arrivals of two arms in steps of time [s], each at one of the goal vertices."""
    one, two = (_Arm(*roadmaps[arm], problem.scene.arms[arm].robot.limits) for arm in problem.arms)
    checker = CollisionChecker(problem.scene, problem.arms)
    free: dict[tuple, bool] = {}

    def is_free(a: tuple, b: tuple) -> bool:
        if (a, b) not in free:
            free[a, b] = checker.is_free_slowly(np.concatenate([one.q[a], two.q[b]]))
        return free[a, b]

    ends = [(goal, goal, 0) for goal in goals]
    start = ((0, 0, 0), (0, 0, 0), False, False)
    least = {start: 0}
    queue = [(0, start)]
    while queue:
        cost, state = heapq.heappop(queue)
        if cost > least[state]:
            continue
        a, b, a_stays, b_stays = state
        if a_stays and b_stays:
            return cost * _STEP
        for stays in itertools.product({a_stays, a in ends}, {b_stays, b in ends}):
            if stays[0] < a_stays or stays[1] < b_stays:
                continue
            rows = [[a]] if stays[0] else [one.next[a]], [[b]] if stays[1] else [two.next[b]]
            for c, d in itertools.product(rows[0][0], rows[1][0]):
                new = (c, d, *stays)
                price = cost + (not stays[0]) + (not stays[1])
                if price < least.get(new, math.inf) and is_free(c, d):
                    least[new] = price
                    heapq.heappush(queue, (price, new))
    return math.inf


# ---- tiny roadmaps ------------------------------------------------------------------------------------------------


def _facing(planar2r: rp.Robot) -> rp.Scene:
    scene = rp.Scene().with_arm("left", planar2r, (-1.2, 0.0, 0.0))
    return scene.with_arm("right", planar2r, (1.2, 0.0, 0.0))


def _case(name: str, planar2r: rp.Robot) -> tuple[rp.Problem, dict[str, tuple[np.ndarray, list[tuple[int, int]]]]]:
    pi = np.pi
    if name == "goals":
        # Each sweeps the other's goal, so one steps aside.
        ends = {"left": ([-0.6, 0.0], [0.25, 0.0]), "right": ([pi - 0.9, 0.0], [pi, 0.0])}
        inner = {"left": [[-1.2, 0.3], [0.9, 0.0]], "right": [[pi + 0.9, 0.2]]}
    elif name == "pass":
        # Both go through the middle, so one waits.
        ends = {"left": ([-0.9, 0.0], [0.9, 0.0]), "right": ([pi + 0.9, 0.0], [pi - 0.9, 0.0])}
        inner = {"left": [[-0.3, 2.4]], "right": [[pi + 1.3, 0.4]]}
    elif name == "either":
        # The goals are as far as the arms reach; the second ones are farther from the starts.
        ends = {"left": ([0.8, 0.0], [0.0, 0.0]), "right": ([pi - 1.0, 0.0], [pi, 0.0])}
        inner = {"left": [[-1.3, 0.3]], "right": [[pi + 1.2, 0.2]]}
    else:
        # One only has to let the other pass, and come back.
        ends = {"left": ([-0.8, 0.0], [1.1, 0.0]), "right": ([pi, 0.3], [pi, 0.3])}
        inner = {"left": [], "right": [[pi - 0.2, 1.9], [pi - 1.3, 0.1]]}
    roadmaps = {}
    for arm, (start, goal) in ends.items():
        vertices = np.array([start, goal, *inner[arm]])
        pairs = itertools.combinations(range(len(vertices)), 2)
        roadmaps[arm] = vertices, [(a, b) for a, b in pairs if (vertices[a] != vertices[b]).any()]
    start, goal = ({arm: both[k] for arm, both in ends.items()} for k in (0, 1))
    return rp.Problem(_facing(planar2r), start, goal), roadmaps


def _search(
    problem: rp.Problem,
    tiny: dict[str, tuple[np.ndarray, list[tuple[int, int]]]],
    suboptimality: float = 1.0,
    goals: tuple[int, ...] = (1,),
) -> tuple[SearchResult, dict[str, ArmRoadmap]]:
    roadmaps = {}
    for arm, (vertices, edges) in tiny.items():
        rests = [0] if (vertices[0] == vertices[1]).all() else []
        roadmaps[arm] = ArmRoadmap(Agent(problem, [arm]), vertices, edges, [*rests, *goals])
    near = {arm: frozenset(problem.arms) - {arm} for arm in problem.arms}
    search = ConflictBasedSearch(roadmaps, near, RelativeConflicts(0.0), Stopwatch(math.inf), suboptimality)
    return search.run(), roadmaps


@pytest.mark.parametrize("name", ["goals", "pass", "yield"])
def test_the_cost_is_that_of_brute_force(name: str, planar2r: rp.Robot) -> None:
    problem, tiny = _case(name, planar2r)
    found, roadmaps = _search(problem, tiny)
    assert found.moves is not None
    assert found.suboptimality == 1.0
    assert found.nodes > 0
    expected = _brute_force(problem, tiny)
    # Brute force rounds each motion and wait up to a step; certified diagrams block slightly more than contacts.
    assert found.cost == pytest.approx(expected, abs=8 * _STEP)
    schedules = [schedule_of(roadmaps[arm], found.moves[arm]) for arm in problem.arms]
    assert sum(schedule.arrival for schedule in schedules) == pytest.approx(found.cost, abs=1e-9)
    motion = merged_trajectory(problem, schedules)
    assert rp.validate(motion, problem.scene, problem).certified


@pytest.mark.parametrize("name", ["goals", "pass", "either"])
def test_of_several_goals_those_with_the_least_cost_are_chosen(name: str, planar2r: rp.Robot) -> None:
    problem, tiny = _case(name, planar2r)
    found, roadmaps = _search(problem, tiny, goals=(1, 2))
    assert found.moves is not None
    assert found.suboptimality == 1.0
    assert found.cost == pytest.approx(_brute_force(problem, tiny, (1, 2)), abs=8 * _STEP)
    if name == "either":
        # The nearer goals exclude each other.
        assert sorted(moves[-1].end for moves in found.moves.values()) == [1, 2]
    motion = merged_trajectory(problem, [schedule_of(roadmaps[arm], found.moves[arm]) for arm in problem.arms])
    assert rp.validate(motion, problem.scene).certified


@pytest.mark.parametrize("name", ["goals", "pass", "yield"])
def test_a_bound_is_kept_and_saves_nodes(name: str, planar2r: rp.Robot) -> None:
    problem, tiny = _case(name, planar2r)
    best, _ = _search(problem, tiny)
    for bound in (1.1, 1.5, 3.0):
        found, _ = _search(problem, tiny, bound)
        assert found.moves is not None
        assert best.cost <= found.cost + 1e-6
        assert found.cost <= bound * best.cost + 1e-6
        assert found.lower_bound <= best.cost + 1e-6
        assert found.suboptimality <= bound + 1e-9


@pytest.mark.parametrize("name", ["goals", "pass", "yield"])
def test_a_known_plan_is_enough_as_soon_as_it_is_within_the_bound(name: str, planar2r: rp.Robot) -> None:
    problem, tiny = _case(name, planar2r)
    best, roadmaps = _search(problem, tiny)
    near = {arm: frozenset(problem.arms) - {arm} for arm in problem.arms}
    search = ConflictBasedSearch(roadmaps, near, RelativeConflicts(0.0), Stopwatch(math.inf), 1.1)
    known = search.run(known_cost=1.09 * best.cost)
    assert known.lower_bound <= best.cost + 1e-6
    assert known.moves is not None or 1.09 * best.cost <= 1.1 * known.lower_bound + 1e-6
    poor = search.run(known_cost=3.0 * best.cost)
    assert poor.moves is not None
    assert poor.cost <= 1.1 * best.cost + 1e-6


def test_a_search_that_gives_up_states_the_bound_of_the_plan_that_it_began_with(
    rr1: rp.Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = ring_swap(rr1, 4, 0.5, rng=1)
    searched = plan_many_arms(problem, method="conflict_based_search", rng=0, budget=_BUDGET)
    monkeypatch.setattr("rr1plan.multi.search.small_teams._NODES", 1)
    monkeypatch.setattr("rr1plan.multi.search.small_teams._MOST_SAMPLES", 50)
    given_up = plan_many_arms(problem, method="conflict_based_search", rng=0, budget=_BUDGET)
    assert given_up.trajectory is not None
    assert rp.validate(given_up.trajectory, problem.scene, problem).certified
    arrivals = [sum(s.arrival * len(s.arms) for s in result.schedules) for result in (searched, given_up)]
    (one,), (two,) = searched.groups, given_up.groups
    assert one.suboptimality is not None
    assert two.suboptimality is not None
    assert 1.0 <= one.suboptimality <= 1.1
    # The minimum on the same roadmaps is between the proven bound and the cost of the first search.
    assert two.suboptimality * arrivals[0] >= arrivals[1] - 1e-9


def test_what_has_no_answer_on_the_roadmaps_is_found_out_or_given_up(planar2r: rp.Robot) -> None:
    problem, tiny = _case("goals", planar2r)
    only = {arm: (vertices[:2], [(0, 1)]) for arm, (vertices, _) in tiny.items()}
    roadmaps = {arm: ArmRoadmap(Agent(problem, [arm]), *only[arm]) for arm in problem.arms}
    near = {arm: frozenset(problem.arms) - {arm} for arm in problem.arms}
    search = ConflictBasedSearch(roadmaps, near, RelativeConflicts(0.0), Stopwatch(math.inf), 1.0)
    found = search.run(most_nodes=200)
    assert found.moves is None
    assert math.isinf(_brute_force(problem, only))


# ---- one arm among constraints ------------------------------------------------------------------------------------


def _line(rr1: rp.Robot) -> ArmRoadmap:
    """Start - middle - goal, and no other way."""
    vertices = np.array(
        [[-1.0, 0.0, 0.6, 0.2, 1.0, 0.1], [1.0, 0.0, 0.6, 0.2, 1.0, 0.1], [0.0, 0.1, 0.7, 0.2, 1.0, 0.1]]
    )
    problem = rp.Problem(place_grid(rr1, 1, 1), vertices[0], vertices[1])
    return ArmRoadmap(Agent(problem, problem.arms), vertices, [(0, 2), (2, 1)])


def test_constraints_put_off_what_they_have_to(rr1: rp.Robot) -> None:
    roadmap = _line(rr1)
    free = earliest_moves(roadmap, ())
    assert free is not None
    assert [(move.begin, move.end) for move in free] == [(0, 2), (2, 1)]
    half, whole = free[0].arrival, free[1].arrival
    assert roadmap.to_goal[0] <= whole + 1e-12
    later = earliest_moves(roadmap, (Departure((2, 1), 0.0, half + 0.3),))
    assert later is not None
    assert later[-1].departure == pytest.approx(half + 0.3)
    # Waiting in the middle is forbidden then: it waits at the start.
    waits = earliest_moves(roadmap, (Departure((2, 1), 0.0, half + 0.3), Presence(2, 0.0, half + 0.2)))
    assert waits is not None
    assert waits[0].departure == pytest.approx(0.2)
    settles = earliest_moves(roadmap, (Settling(1, whole + 2.0),))
    assert settles is not None
    assert settles[-1].arrival == pytest.approx(whole + 2.0)
    assert earliest_moves(roadmap, (Presence(0, 0.0, 1.0),)) is None
    assert earliest_moves(roadmap, (Departure((2, 1), 0.0, math.inf),)) is None


# ---- through plan_many_arms ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["ring", "shelf", "grid"])
def test_plans_are_certified_and_state_their_bound(kind: str, rr1: rp.Robot) -> None:
    problems = {
        "ring": lambda: ring_swap(rr1, 3, 0.5, rng=1),
        "shelf": lambda: dual_arm_shelf(rr1, 0.6, 3),
        "grid": lambda: random_grid(rr1, 8, 0.6, 1),
    }
    problem = problems[kind]()
    one, two = (plan_many_arms(problem, method="conflict_based_search", rng=0, budget=_BUDGET) for _ in range(2))
    assert one.trajectory is not None
    assert two.trajectory is not None
    assert one.trajectory.coefficients.tobytes() == two.trajectory.coefficients.tobytes()
    assert rp.validate(one.trajectory, problem.scene, problem).certified
    checker = CollisionChecker(problem.scene, problem.arms)
    assert all(checker.is_free_slowly(q) for q in one.trajectory(np.linspace(0.0, one.makespan, 40)))
    for group in one.groups:
        assert group.stage == "conflict_based_search"
        assert group.suboptimality is not None
        assert 1.0 <= group.suboptimality <= 1.1 + 1e-9


def test_no_arm_waits_without_need(rr1: rp.Robot) -> None:
    """In the solution, an arm waited for moves that another arm had at an earlier node of the search."""
    result = plan_many_arms(random_grid(rr1, 4, 0.5, 6), method="conflict_based_search", rng=0, budget=_BUDGET)
    diagrams = DiagramCache()
    for schedule in result.schedules:
        others = [other for other in result.schedules if other is not schedule]
        found = [(diagrams.diagram(schedule.path, other.path), other.occupancy) for other in others]
        times = blocked_times((blocked, occupied) for blocked, occupied in found if blocked is not None)
        earliest = earliest_schedule(schedule.path, times)
        assert earliest is not None
        assert earliest.arrival == pytest.approx(schedule.arrival, abs=1e-6)
    assert all(group.suboptimality is not None and group.suboptimality < 1.06 for group in result.groups)


def test_its_plans_can_be_improved(rr1: rp.Robot) -> None:
    problem = ring_swap(rr1, 3, 0.5, rng=1)
    moves = Budget(seconds=math.inf, iterations=60)
    result = plan_many_arms(problem, method="conflict_based_search", rng=0, budget=_BUDGET, improvement=moves)
    assert result.trajectory is not None
    assert rp.validate(result.trajectory, problem.scene, problem).certified
    assert result.first is not None
    assert result.makespan < result.first.makespan


def test_the_portfolio_leaves_time_for_searches_on_larger_roadmaps(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = rp.planar_arm("RR", (0.5, 0.4))
    scene = rp.Scene().with_arm("left", robot).with_arm("right", robot, (0.7, 0.0, 0.0))
    start = {"left": [-1.02, -0.57], "right": [0.45, 0.04]}
    problem = rp.Problem(scene, start, {"left": [1.45, 1.92], "right": [1.27, -0.54]})
    rounds: list[float] = []

    def run(_: GroupPlanner, most: float = math.inf) -> bool:
        rounds.append(most)
        return False

    monkeypatch.setattr(GroupPlanner, "run", run)
    plan_many_arms(problem, method="conflict_based_search", rng=0, budget=_BUDGET, progress=lambda _: len(rounds) == 0)
    assert rounds
    assert math.isfinite(rounds[0])


def test_improvements_aim_at_the_goals_that_were_chosen() -> None:
    """The preflight prefers the goal that is nearer in joint space, the search the one that is reached first."""
    robot = rp.planar_arm("RR", (0.5, 0.4))
    robot = robot.with_limits(replace(robot.limits, velocity=np.array([2.0, 0.1])))
    scene = rp.Scene().with_arm("left", robot, (-0.6, 0.0, 0.0)).with_arm("right", robot, (0.6, 0.0, 0.0))
    start = {"left": [2.0, 1.0], "right": [0.5, 1.0]}
    problem = rp.Problem(scene, start, {"left": [JointGoal([2.0, 1.5]), JointGoal([3.0, 1.0])], "right": [0.9, 1.0]})
    result = plan_many_arms(problem, method="conflict_based_search", rng=0, budget=_BUDGET)
    assert result.found
    ends = {schedule.arms[0]: schedule.path for schedule in result.schedules}
    np.testing.assert_array_equal(ends["left"].goal, [3.0, 1.0])
    for arm, path in ends.items():
        (goal,) = path.agent.problem.goal[arm]
        np.testing.assert_array_equal(goal.q, path.goal)


def test_too_many_arms_and_unknown_methods_are_refused(rr1: rp.Robot) -> None:
    with pytest.raises(InputError, match="up to 8 arms"):
        plan_many_arms(random_grid(rr1, 12, 0.7, 0), method="conflict_based_search", rng=0)
    with pytest.raises(UnknownNameError, match="method"):
        plan_many_arms(random_grid(rr1, 2, 0.8, 0), method="conflicts")


def test_the_margin_is_kept_between_arms() -> None:
    robot = rp.planar_arm("RR", (0.6, 0.5))
    scene = rp.Scene().with_arm("left", robot, (-0.7, 0.0, 0.0)).with_arm("right", robot, (0.7, 0.0, 0.0))
    begin, end = [1.2, 0.2], [-1.2, -0.2]
    turned = [np.pi, 0.0]
    start, goal = ({"left": q, "right": np.add(q, turned)} for q in (begin, end))
    problem = rp.Problem(scene, start, goal)
    result = plan_many_arms(problem, margin=0.1, method="conflict_based_search", rng=0, budget=_BUDGET)
    assert result.found
    assert rp.validate(result.trajectory, replace(scene, padding=0.1), clearance=False).certified


def test_edges_that_cannot_be_timed_are_left_out(rr1: rp.Robot) -> None:
    """A joint that the query does not move has no acceleration limit; samples of the roadmap move it."""
    acceleration = rr1.limits.acceleration.copy()
    acceleration[5] = np.inf
    robot = replace(rr1, limits=replace(rr1.limits, acceleration=acceleration))
    scene = rp.Scene().with_arm("left", robot, (-0.5, 0.0, 0.0)).with_arm("right", robot, (0.5, 0.0, 0.0))
    goal = robot.home + np.array([1.2, 0.0, 0.0, 0.0, 0.0, 0.0])
    problem = rp.Problem(scene, None, {"left": goal, "right": goal})
    result = plan_many_arms(problem, method="conflict_based_search", rng=0, budget=_BUDGET)
    assert result.found
    assert rp.validate(result.trajectory, scene, problem).certified


@pytest.mark.parametrize("distance", [1e-16, 1e-12, 3e-10, 1e-9])
def test_an_arm_whose_goal_is_as_good_as_its_start_rests(distance: float) -> None:
    robot = rp.planar_arm("RR", (0.5, 0.4))
    scene = rp.Scene().with_arm("left", robot, (-0.6, 0.0, 0.0)).with_arm("right", robot, (0.6, 0.0, 0.0))
    start = {"left": [distance, 2.0], "right": [3.0, 1.0]}
    problem = rp.Problem(scene, start, {"left": [0.0, 2.0], "right": [3.0, 2.0]})
    result = plan_many_arms(problem, method="conflict_based_search", rng=0, budget=_BUDGET)
    assert result.found
    assert rp.validate(result.trajectory, scene, problem).certified
    assert rp.execute_plan(rp.plan_graph(result), scene)


def test_progress_may_cancel_the_search(rr1: rp.Robot) -> None:
    result = plan_many_arms(
        random_grid(rr1, 4, 0.6, 0), method="conflict_based_search", rng=0, progress=lambda _: False
    )
    assert result.status is PlanStatus.CANCELLED


def test_roadmaps_hold_certified_edges_and_join_the_known_path(rr1: rp.Robot) -> None:
    problem = random_grid(rr1, 2, 0.8, 0)
    agent = Agent(problem, problem.arms[:1])
    goal = problem.goal[problem.arms[0]][0].q
    middle = 0.5 * (agent.start + goal) + 0.01
    roadmap = build_roadmap(agent, goal[None], 0.0, 60, [np.array([agent.start, middle, goal])])
    assert roadmap is not None
    np.testing.assert_array_equal(roadmap.vertices[[0, 1, 2]], [agent.start, goal, middle])
    query = agent.query({}, 0.0)
    checker = CollisionChecker(query.scene, query.arms)
    for vertex, others in enumerate(roadmap.neighbors):
        for other in others:
            assert checker.edge_is_free(roadmap.vertices[vertex], roadmap.vertices[other])
    again = build_roadmap(agent, goal[None], 0.0, 60)
    assert again is not None
    np.testing.assert_array_equal(again.vertices[2:], roadmap.vertices[3:])
    assert build_roadmap(agent, goal[None], 0.0, 70, goes_on=lambda: False) is None
