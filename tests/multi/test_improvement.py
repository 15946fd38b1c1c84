"""Anytime improvement of plans of many arms: never worse, certified after every move, reproducible, in time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import lru_cache
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from blocked_arms import planar_ring, sequential_moves

import rr1plan as rp
from rr1plan import dual_arm_shelf, plan_many_arms, random_grid, ring_swap
from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.collision.arm_groups import arms_in_reach
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.errors import InputError
from rr1plan.multi import portfolio, stopwatch
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.paths.arm_replanning import replanned
from rr1plan.multi.paths.hop_timing import HopTiming
from rr1plan.multi.paths.paced_polyline import PacedPolyline
from rr1plan.multi.paths.path_changes import changed_waypoints
from rr1plan.multi.paths.path_refinement import PathRefiner, estimated_duration
from rr1plan.multi.portfolio import merged_trajectory
from rr1plan.multi.search.agent_schedules import AgentSchedules
from rr1plan.multi.search.improvement import PlanImprover
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.multi.timing.diagram_cache import DiagramCache
from rr1plan.multi.timing.safe_intervals import blocked_times, earliest_schedule
from rr1plan.multi.timing.schedule import Leg, Schedule
from rr1plan.planning import Budget, PlanStatus
from rr1plan.retiming.path_blends import Curve, blend_sizes, clean, round_corners
from rr1plan.retiming.path_speed import Grid, fastest_speeds, timed
from rr1plan.testing.collision_checkers import ElementChecker

_BUDGET = Budget(seconds=120.0)


def _moves(count: int) -> Budget:
    return Budget(seconds=math.inf, iterations=count)


def _goals_in_the_way(planar2r: rp.Robot) -> rp.Problem:
    """Two arms in a plane, face to face; each sweeps the other's goal."""
    scene = rp.Scene().with_arm("left", planar2r, (-1.2, 0.0, 0.0)).with_arm("right", planar2r, (1.2, 0.0, 0.0))
    start = {"left": [-0.6, 0.0], "right": [np.pi - 0.9, 0.0]}
    return rp.Problem(scene, start, {"left": [0.25, 0.0], "right": [np.pi, 0.0]})


def _improver(problem: rp.Problem, watch: Stopwatch | None = None, rng: int = 0) -> PlanImprover:
    result = plan_many_arms(problem, rng=rng, budget=_BUDGET)
    assert result.found, result.reason
    return _improver_of(problem, result.schedules, 1e-4, np.random.default_rng(rng), watch or Stopwatch(math.inf))


def _improver_of(
    problem: rp.Problem, schedules: Iterable[Schedule], margin: float, rng: np.random.Generator, watch: Stopwatch
) -> PlanImprover:
    near, margins = arms_in_reach(problem.scene, problem.arms, 2e-3), dict.fromkeys(problem.arms, margin)
    agents = [*(Agent(problem, [arm]) for arm in problem.arms), *(schedule.path.agent for schedule in schedules)]
    plan = AgentSchedules(agents, margins, near, DiagramCache(), watch)
    plan.schedules = {schedule.path.agent: schedule for schedule in schedules}
    return PlanImprover(plan, {}, rng)


@lru_cache
def _problem(name: str) -> rp.Problem:
    rr1 = rp.load_robot("rr1")
    problems = {
        "ring-2": lambda: ring_swap(rr1, 2, 0.38, rng=0),
        "ring-4": lambda: ring_swap(rr1, 4, 0.5, rng=2),
        "shelf-2": lambda: dual_arm_shelf(rr1, 0.6, 3),
        "grid-8": lambda: random_grid(rr1, 8, 0.6, 1),
    }
    return problems[name]()


@pytest.mark.parametrize("name", ["ring-2", "ring-4", "shelf-2", "grid-8"])
def test_improved_plans_are_certified_and_never_worse(name: str, rr1: rp.Robot) -> None:
    problem = _problem(name)
    result = plan_many_arms(problem, rng=0, budget=_BUDGET, improvement=_moves(60))
    assert result.trajectory is not None
    assert rp.validate(result.trajectory, problem.scene, problem).certified
    checker = CollisionChecker(problem.scene, problem.arms)
    assert all(checker.is_free_slowly(q) for q in result.trajectory(np.linspace(0.0, result.makespan, 40)))
    assert result.first is not None
    assert result.makespan <= result.first.makespan
    assert result.quality.slowest_alone <= result.first.slowest_alone
    assert result.ratio >= 1.0
    assert result.first.ratio >= 1.0
    assert result.trajectory.duration == pytest.approx(result.makespan)
    makespans = [makespan for _, makespan in result.history]
    assert makespans[0] == result.first.makespan
    assert makespans[-1] == pytest.approx(result.makespan)
    assert makespans == sorted(makespans, reverse=True)


def test_a_motion_that_waits_gets_shorter() -> None:
    result = plan_many_arms(_problem("shelf-2"), rng=3, budget=_BUDGET, improvement=_moves(150))
    assert result.first is not None
    assert result.first.ratio > 1.1
    assert result.ratio < 1.05


@pytest.mark.parametrize("gap", [0.8, 3.0])
def test_nearer_configurations_of_positions_are_found(gap: float) -> None:
    alone = rp.load_problems("rr1_cluttered")["into_the_rack"]
    (aim,) = alone.goal["rr1"]
    assert isinstance(aim, rp.PoseGoal)
    scene, goals = rp.Scene(), {}
    for k in range(2):
        aside = rp.transforms.pose([gap * k, 0.0, 0.0])
        scene = scene.with_arm(f"arm{k}", alone.scene.arms["rr1"].robot, aside @ alone.scene.arms["rr1"].base)
        for name, obstacle in alone.scene.obstacles.items():
            scene = scene.with_obstacle(f"{name}{k}", obstacle.geometries, aside @ obstacle.pose)
        goals[f"arm{k}"] = rp.PoseGoal(aim.frame, aim.position + np.array([gap * k, 0.0, 0.0]))
    problem = rp.Problem(scene, dict.fromkeys(goals, alone.start), goals)
    result = plan_many_arms(problem, rng=0, budget=_BUDGET, improvement=_moves(200))
    assert result.trajectory is not None
    assert result.first is not None
    assert result.makespan < 0.85 * result.first.makespan
    report = rp.validate(result.trajectory, problem.scene, problem)
    assert report.certified
    assert "goal" in report.checked
    again = plan_many_arms(problem, rng=0, budget=_BUDGET, improvement=_moves(200)).trajectory
    assert again is not None
    np.testing.assert_array_equal(again.coefficients, result.trajectory.coefficients)


def test_arms_at_one_of_their_goals_are_not_improved(rr1: rp.Robot) -> None:
    scene = rp.Scene().with_arm("arm", rr1)
    problem = rp.Problem(scene, "home", ["home", rp.PoseGoal("tool", rp.Kinematics(scene).pose(rr1.home)[:3, 3])])
    result = plan_many_arms(problem, rng=0, budget=_BUDGET, improvement=Budget(seconds=60.0))
    assert (result.makespan, result.improvements) == (0.0, 0)


def test_arms_move_apart_from_a_nearer_goal_that_affords_less_than_the_margin(planar2r: rp.Robot) -> None:
    scene = rp.Scene().with_arm("left", planar2r).with_arm("right", planar2r, (5.0, 0.0, 0.0))
    nearer, ahead = [0.5, 0.0], np.array([np.cos(0.5), np.sin(0.5), 0.0])
    ball = scene.with_obstacle("ball", rp.Sphere(0.05), 2.0 * ahead)
    gap = CollisionChecker(ball, ["left"]).clearance(np.array(nearer), 1.0)
    problem = rp.Problem(
        scene.with_obstacle("ball", rp.Sphere(0.05), (2.0 - gap + 0.001) * ahead),
        {"left": [0.0, 0.0], "right": [0.0, 0.0]},
        {"left": [-0.6, 0.0], "right": [0.4, 0.0]},
    )
    whole = Agent(problem, problem.arms)
    with checker_from_pool(problem.scene, problem.arms, 1e-4) as checker:
        points = np.array([whole.start, [*nearer, 0.4, 0.0]])
        path = AgentPath(whole, rp.Path(whole.joint_names, points), checker)
    schedule = Schedule(path, (Leg(0.0, 0, path.segments),))
    improver = _improver_of(problem, [schedule], 0.01, np.random.default_rng(0), Stopwatch(math.inf))
    assert improver._move_apart()
    assert sorted(agent.arms for agent in improver.plan.schedules) == [("left",), ("right",)]


def _moves_in_turn(problem: rp.Problem, rng: int) -> PlanImprover:
    """An improver of the plan in which all arms move one at a time, as they are found."""
    agent, watch, generator = Agent(problem, problem.arms), Stopwatch(math.inf), np.random.default_rng(rng)
    points = next(sequential_moves(problem, generator).paths(), None)
    assert points is not None
    with checker_from_pool(agent.query({}, 0.0).scene, agent.arms) as checker:
        path = AgentPath(agent, rp.Path(agent.joint_names, points), checker)
    schedule = earliest_schedule(path, blocked_times([]))
    assert schedule is not None
    return _improver_of(problem, [schedule], 0.0, generator, watch)


def test_many_arms_that_move_as_one_are_planned_anew(rr1: rp.Robot) -> None:
    problem = ring_swap(rr1, 6, 0.5015, 1, 2)
    improver = _moves_in_turn(problem, rng=0)
    before = improver.quality.makespan
    assert improver._move_in_turn()
    assert improver.quality.makespan < 0.9 * before
    motion = merged_trajectory(problem, list(improver.plan.schedules.values()))
    assert rp.validate(motion, problem.scene, problem).certified
    checker = CollisionChecker(problem.scene, problem.arms)
    assert all(checker.is_free_slowly(q) for q in motion(np.linspace(0.0, motion.end_time, 100)))


def test_without_improvement_the_first_plan_is_the_answer() -> None:
    result = plan_many_arms(_problem("ring-2"), rng=0, budget=_BUDGET)
    assert result.first is not None
    assert result.improvements == 0
    assert (result.first.makespan, result.first.waiting) == (result.makespan, result.quality.waiting)
    assert len(result.history) == 1


def test_the_same_seed_and_number_of_moves_give_the_same_motion() -> None:
    problem = _problem("ring-4")
    one, two = (plan_many_arms(problem, rng=5, budget=_BUDGET, improvement=_moves(40)) for _ in range(2))
    assert one.trajectory is not None
    assert two.trajectory is not None
    assert one.improvements == two.improvements
    assert one.trajectory.coefficients.tobytes() == two.trajectory.coefficients.tobytes()


def test_every_state_is_certified_and_cheaper_than_the_one_before(planar2r: rp.Robot) -> None:
    problem = _goals_in_the_way(planar2r)
    improver = _improver(problem)
    others = ElementChecker(problem.scene, problem.scene.joint_names(problem.arms))
    states = 0
    for _ in range(80):
        before, schedules = improver.quality, set(map(id, improver.plan.schedules.values()))
        improver.run(iterations=1)
        if set(map(id, improver.plan.schedules.values())) == schedules:
            continue
        states += 1
        assert improver.quality.makespan <= before.makespan
        motion = merged_trajectory(problem, list(improver.plan.schedules.values()))
        assert rp.validate(motion, problem.scene, problem).certified
        assert not any(others.contacts(motion(np.linspace(motion.start_time, motion.end_time, 60))))
    assert states > 0


class _Clock(Stopwatch):
    """A clock that advances by a second at each call of `goes_on`."""

    def __init__(self) -> None:
        super().__init__(math.inf)
        self.now = 0.0

    @property
    def seconds(self) -> float:
        return self.now

    @property
    def left(self) -> float:
        return 1e3

    def goes_on(self) -> bool:
        self.now += 1.0
        return True


def test_it_stops_when_its_time_is_used_up(planar2r: rp.Robot) -> None:
    clock = _Clock()
    improver = _improver(_goals_in_the_way(planar2r), clock)
    improver.run(seconds=7.0)
    assert 1 <= improver.iterations <= 6
    assert clock.now >= 7.0


def test_progress_may_cancel_an_improvement() -> None:
    calls = []

    def progress(report: rp.Progress) -> bool:
        calls.append(report.seconds)
        return len(calls) < 8

    result = plan_many_arms(_problem("ring-4"), rng=0, improvement=Budget(seconds=60.0), progress=progress)
    assert result.status is PlanStatus.CANCELLED
    assert result.trajectory is None


def test_a_clock_with_an_earlier_deadline_cancels_the_clock_that_it_was_copied_from() -> None:
    watch = Stopwatch(60.0)
    earlier = watch.with_deadline(1.0)
    assert earlier.left < 1.0
    earlier.cancel()
    assert watch.cancelled
    assert not watch.goes_on()


def test_nothing_is_tried_where_each_arm_goes_straight(rr1: rp.Robot) -> None:
    problem = random_grid(rr1, 2, 2.0, 0)
    result = plan_many_arms(problem, rng=0, improvement=_moves(50))
    straight = all(len(path.waypoints) == 2 for path in result.paths.values())
    assert (result.improvements == 0) == straight


def test_where_the_preflight_takes_long_more_time_is_reserved_for_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 0.0

    def slow(function: Callable[..., Any], seconds: float) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            nonlocal now
            now += seconds
            return function(*arguments)

        return call

    monkeypatch.setattr(stopwatch, "time", SimpleNamespace(perf_counter=slow(lambda: now, 0.01)))
    monkeypatch.setattr(portfolio, "preflight", slow(portfolio.preflight, 0.15))
    monkeypatch.setattr(portfolio, "merged_trajectory", slow(portfolio.merged_trajectory, 0.3))
    budget = Budget(seconds=10.0)
    result = plan_many_arms(_problem("ring-2"), rng=0, budget=budget, improvement=budget)
    assert result.found
    assert 9.0 < result.seconds < 10.0


def test_plan_motion_improves_by_name_until_the_budget_ends() -> None:
    problem = _problem("ring-2")
    budget = Budget(seconds=math.inf, iterations=30)
    motion = rp.plan_motion(problem, planner="many_arms_anytime", rng=0, budget=budget)
    assert motion
    assert motion.result.planner == "many_arms_anytime"
    assert motion.result.iterations == 30
    assert motion.many_arms is not None
    assert motion.many_arms.first is not None
    assert motion.many_arms.makespan < motion.many_arms.first.makespan


def test_what_is_no_budget_is_refused() -> None:
    with pytest.raises(InputError, match="improvement is of type float, expected Budget"):
        plan_many_arms(_problem("shelf-2"), improvement=5.0)


def test_changed_polylines_keep_their_ends_and_the_limits(rr1: rp.Robot) -> None:
    rng = np.random.default_rng(0)
    limits = rr1.limits
    waypoints = np.array([limits.lower, 0.5 * (limits.lower + limits.upper), limits.upper])
    lengths = set()
    for _ in range(200):
        changed = changed_waypoints(waypoints, limits, rng)
        np.testing.assert_array_equal(changed[[0, -1]], waypoints[[0, -1]])
        assert (changed >= limits.lower - 1e-12).all()
        assert (changed <= limits.upper + 1e-12).all()
        lengths.add(len(changed))
    assert {3, 4} <= lengths


def test_random_changes_make_the_path_of_many_arms_faster(planar2r: rp.Robot) -> None:
    problem = planar_ring(planar2r, 5)
    improver = _moves_in_turn(problem, rng=2)
    (agent,) = improver.plan.schedules
    before = improver.plan.schedules[agent]
    assert improver._change_path()
    after = improver.plan.schedules[agent]
    assert after.arrival < 0.9 * before.arrival
    motion = merged_trajectory(problem, [after])
    assert rp.validate(motion, problem.scene, problem).certified
    checker = CollisionChecker(problem.scene, problem.arms)
    assert all(checker.is_free_slowly(q) for q in motion(np.linspace(0.0, motion.end_time, 100)))


def _slow_duration(points: Array, agent: Agent, checker: CollisionChecker) -> float:
    """What `estimated_duration` computes, from the trajectory on its grid of a rounded polyline."""
    sizes = blend_sizes(points, 1.0, checker)
    lengths, coefficients, _ = round_corners(points, sizes)
    offset = np.column_stack([np.zeros(len(lengths)), 0.5 * lengths]).ravel()
    grid = Grid(np.repeat(np.arange(len(lengths)), 2), offset, np.repeat(0.5 * lengths, 2))
    curve = Curve(lengths, coefficients, (0, len(points) - 1))
    return float(timed(curve, grid, fastest_speeds(curve, grid, agent.limits)).durations.sum())


def test_refined_paths_are_those_that_certify_every_change_whole(planar2r: rp.Robot) -> None:
    ((agent, schedule),) = _moves_in_turn(planar_ring(planar2r, 4), 1).plan.schedules.items()
    path = schedule.path
    with checker_from_pool(agent.query({}, 0.0).scene, agent.arms) as checker:
        refined = PathRefiner(checker, np.random.default_rng(5)).refine(path, lambda: True)
        # Each change is certified first, and nothing is remembered.
        rng, best = np.random.default_rng(5), clean(path.path.waypoints)
        arms = list(agent.columns.values())
        durations = [math.inf, _slow_duration(best, agent, checker)]
        # Rounds that save something; for each of four arms, four searches and then seventeen random changes.
        while durations[-1] < 0.985 * durations[-2]:
            for search in [True] * 16 + [False] * 68:
                polyline = PacedPolyline(best, agent.limits, arms)
                changed = replanned(polyline, checker, rng) if search else polyline.changed(rng)
                points = best if changed is None else clean(changed)
                if not all(checker.edge_is_free(a, b) for a, b in pairwise(points)):
                    continue
                if _slow_duration(points, agent, checker) < _slow_duration(best, agent, checker):
                    best = points
            durations.append(_slow_duration(best, agent, checker))
        assert len(durations) > 3
        assert all(checker.edge_is_free_slowly(a, b) for a, b in pairwise(refined.path.waypoints))
    assert refined.fastest < path.fastest
    np.testing.assert_array_equal(refined.path.waypoints, best)


@pytest.mark.parametrize("method", ["blend", "stop"])
def test_estimated_durations_are_near_those_of_paths(rr1: rp.Robot, method: str) -> None:
    scene = rp.Scene().with_arm("one", rr1, (-2.0, 0.0, 0.0)).with_arm("two", rr1, (2.0, 0.0, 0.0))
    problem = rp.Problem(scene, dict.fromkeys(scene.arms, np.zeros(6)), dict.fromkeys(scene.arms, np.ones(6)))
    agent = Agent(problem, problem.arms, HopTiming(method))
    rng = np.random.default_rng(3)
    for corners in (0, 1, 5):
        points = np.cumsum(rng.normal(scale=0.3, size=(corners + 2, 12)), axis=0)
        estimate = estimated_duration(points, agent, None)
        exact = AgentPath(agent, rp.Path(agent.joint_names, points), None).fastest
        assert 0.99 * exact < estimate < 1.06 * exact
    assert estimated_duration(points[:1], agent, None) == 0.0


def test_changes_of_several_arms_keep_ends_limits_and_mostly_other_arms(rr1: rp.Robot) -> None:
    rng, arms = np.random.default_rng(1), [slice(0, 6), slice(6, 12)]
    scene = rp.Scene().with_arm("one", rr1).with_arm("two", rr1, (2.0, 0.0, 0.0))
    limits = scene.limits()
    points = rng.uniform(limits.lower, limits.upper, (5, 12))
    line = PacedPolyline(points, limits, arms)
    changed_arms = []
    for _ in range(300):
        made = line.changed(rng)
        assert made.shape == points.shape
        np.testing.assert_array_equal(made[[0, -1]], points[[0, -1]])
        assert (made >= limits.lower - 1e-12).all()
        assert (made <= limits.upper + 1e-12).all()
        changed_arms.append(sum((made[:, arm] != points[:, arm]).any() for arm in arms))
    assert set(changed_arms) == {1, 2}
    assert changed_arms.count(1) > changed_arms.count(2)


def test_the_slower_arm_changes_more_often(rr1: rp.Robot) -> None:
    rng, arms = np.random.default_rng(2), [slice(0, 6), slice(6, 12)]
    limits = rp.Scene().with_arm("one", rr1).with_arm("two", rr1, (2.0, 0.0, 0.0)).limits()
    points = np.cumsum(np.tile([1e-1] * 6 + [1e-2] * 6, (5, 1)) * rng.uniform(0.5, 1.0, (5, 12)), axis=0)
    line = PacedPolyline(points, limits, arms)
    made = [line.changed(rng) for _ in range(300)]
    fast, slow = (sum((q[:, arm] != points[:, arm]).any() for q in made) for arm in reversed(arms))
    assert slow > 2 * fast
