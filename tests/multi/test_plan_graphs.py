"""Temporal plan graphs: complete, minimal, acyclic; safe under all delays; unchanged by saving and loading."""

from __future__ import annotations

import hashlib
import json
import pickle
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.multi.execution import route_motion
from rr1plan.multi.execution.route import RouteSteps
from rr1plan.multi.execution.running_plan import LATEST
from rr1plan.multi.execution.temporal_plan_graph import Dependency, Node, pairs_in_reach
from rr1plan.multi.timing.coordination import coordination_diagram
from rr1plan.multi.timing.passing_order import agreed_diagram
from rr1plan.planning import Budget
from rr1plan.retiming.path_blends import Curve
from rr1plan.retiming.path_speed import Grid, fastest_speeds

_BUDGET = Budget(seconds=60.0)
Plan = tuple[rp.Problem, rp.ManyArmsResult, rp.PlanGraph]
Step = tuple[int, int]


def _problem(name: str, rr1: rp.Robot) -> rp.Problem:
    if name == "ring-3":
        return rp.ring_swap(rr1, 3, 0.5, rng=2)
    if name == "ring-8":
        return rp.ring_swap(rr1, 8, 0.6, rng=1)
    if name == "grid-9":
        return rp.random_grid(rr1, 9, 0.5, 1)
    return rp.dual_arm_shelf(rr1, 0.5, 1)


@pytest.fixture(scope="module", params=["ring-3", "ring-8", "grid-9", "shelf-2"])
def plan(request: pytest.FixtureRequest, rr1: rp.Robot) -> Plan:
    problem = _problem(request.param, rr1)
    result = rp.plan_many_arms(problem, rng=0, budget=_BUDGET)
    assert result.found, result.reason
    return problem, result, rp.plan_graph(result)


@pytest.fixture(scope="module")
def ring(rr1: rp.Robot) -> Plan:
    problem = _problem("ring-3", rr1)
    result = rp.plan_many_arms(problem, rng=0, budget=_BUDGET)
    return problem, result, rp.plan_graph(result)


def _before(graph: rp.PlanGraph, without: rp.Dependency | None = None) -> dict[Step, list[Step]]:
    """The direct predecessors of each node."""
    before: dict[Step, list[Step]] = {}
    for agent, route in enumerate(graph.routes):
        for step in range(1, len(route.steps)):
            before[agent, step] = [(agent, step - 1)]
    for dependency in graph.dependencies:
        if dependency is not without:
            node, after = dependency
            before[node.agent, node.step].append((after.agent, after.step))
    return before


def _predecessors(before: dict[Step, list[Step]], node: Step) -> set[Step]:
    """All predecessors of a node, by plain backward search."""
    seen: set[Step] = set()
    open_ = [node]
    while open_:
        for other in before.get(open_.pop(), ()):
            if other not in seen:
                seen.add(other)
                open_.append(other)
    return seen


def test_every_blocked_cell_is_in_an_order_that_cannot_change(plan: Plan) -> None:
    problem, result, graph = plan
    before = _before(graph)
    known = {node: _predecessors(before, node) for node in before}
    pairs = 0
    schedules = result.separated.schedules
    for i, j in pairs_in_reach(problem.scene, [schedule.arms for schedule in schedules]):
        blocked = agreed_diagram(schedules[i], schedules[j])
        if blocked is None:
            continue
        one, two = schedules[i].occupancy.rows, schedules[j].occupancy.rows
        for a, b in product(range(len(one)), range(len(two))):
            if not blocked[one[a], two[b]]:
                continue
            pairs += 1
            i_first = a + 1 < len(one) and b > 0 and (i, a + 1) in known[j, b]
            j_first = b + 1 < len(two) and a > 0 and (j, b + 1) in known[i, a]
            assert i_first != j_first, (i, a, j, b)
    assert pairs or not graph.dependencies


def test_the_diagrams_of_a_graph_hold_what_is_proven_without_a_margin(plan: Plan) -> None:
    problem, result, _ = plan
    schedules = result.separated.schedules
    for i, j in pairs_in_reach(problem.scene, [schedule.arms for schedule in schedules]):
        one, two = schedules[i].path, schedules[j].path
        least, taken = coordination_diagram(one, two), agreed_diagram(schedules[i], schedules[j])
        if least is not None:
            inner = least[1:-1, 1:-1]
            assert taken is not None
            assert (taken[1 : one.segments + 1, 1 : two.segments + 1] >= inner).all()


def test_no_node_comes_before_itself_and_no_dependency_follows_from_others(plan: Plan) -> None:
    _, _, graph = plan
    before = _before(graph)
    assert all(node not in _predecessors(before, node) for node in before)
    for dependency in graph.dependencies:
        node, after = dependency
        assert node.time >= after.time
        others = _before(graph, without=dependency)
        assert (after.agent, after.step) not in _predecessors(others, (node.agent, node.step))


def test_the_graph_says_who_waits_for_whom(ring: Plan) -> None:
    _, _, graph = ring
    assert set(graph.arms) == {"arm01", "arm02", "arm03"}
    assert graph.dependencies
    waiting = [d for arm in graph.arms for d in graph.waits_for(arm)]
    assert sorted(map(str, waiting)) == sorted(map(str, graph.dependencies))
    for node, after in waiting:
        assert node in graph.nodes
        assert after in graph.nodes
        assert node.arms != after.arms
    assert "does not go beyond its planned position at" in str(waiting[0])
    with pytest.raises(rp.UnknownNameError, match="arm07"):
        graph.waits_for("arm07")


def test_arms_of_one_agent_are_listed_as_in_a_sentence() -> None:
    one, three = ("d",), ("a", "b", "c")
    texts = [str(Dependency(Node(0, 1, a, 0.5), Node(1, 2, b, 1.5))) for a, b in ((one, three), (three, one))]
    assert texts == [
        "d does not go beyond its planned position at 0.500 s before a, b and c have reached their planned position at "
        "1.500 s",
        "a, b and c do not go beyond their planned position at 0.500 s before d has reached its planned position at "
        "1.500 s",
    ]


def test_arms_that_do_not_move_have_a_graph_too(rr1: rp.Robot) -> None:
    scene = rp.place_grid(rr1, 1, 3, spacing=0.8)
    result = rp.plan_many_arms(rp.Problem(scene, None, {arm: scene.arms[arm].q for arm in scene.arms}), rng=0)
    graph = rp.plan_graph(result)
    assert graph.dependencies == ()
    assert graph.skew_tolerance == np.inf
    assert rp.execute_plan(graph, scene).makespan == 0.0
    assert repr(rp.execute_plan(graph, scene)) == "PlanExecution(3 arms, 0.000 s)"


@pytest.mark.parametrize("kind", [rp.ManyArmsResult, rp.RunningPlan])
def test_a_graph_reports_its_progress_and_can_be_cancelled(kind: type, ring: Plan) -> None:
    _, result, _ = ring
    plan = result if kind is rp.ManyArmsResult else rp.RunningPlan.of(result)
    seen: list[float] = []
    assert rp.plan_graph(plan, progress=lambda p: seen.append(p.fraction)).dependencies
    assert seen == sorted(seen)
    assert 0.0 <= seen[0] < seen[-1] <= 1.0
    with pytest.raises(rp.CancelledError, match="'plan_graph'"):
        rp.plan_graph(plan, progress=lambda _: False)


def test_a_problem_without_a_plan_has_no_graph(planar2r: rp.Robot) -> None:
    scene = rp.Scene().with_arm("left", planar2r).with_arm("right", planar2r, (0.5, 0.0, 0.0))
    result = rp.plan_many_arms(rp.Problem(scene, None, {"left": [0.0, 0.0], "right": [0.1, 0.0]}))
    with pytest.raises(rp.InputError, match="no plan"):
        rp.plan_graph(result)
    with pytest.raises(rp.InputError, match="plan is"):
        rp.plan_graph("plan")


# ---- execution -------------------------------------------------------------------------------


def _random_delays(graph: rp.PlanGraph, rng: np.random.Generator) -> dict[str, rp.ArmDelay]:
    return {
        arm: rp.ArmDelay(rng.uniform(0.0, 0.3), rng.uniform(0.0, 0.3), _random_pauses(rng))
        for arm in graph.arms
        if rng.random() < 0.8
    }


def _random_pauses(rng: np.random.Generator) -> list[tuple[float, float]]:
    return [(rng.uniform(0.0, 1.5), rng.uniform(0.0, 1.0)) for _ in range(rng.integers(3))]


def test_delayed_executions_are_certified_and_keep_the_order(plan: Plan) -> None:
    problem, result, graph = plan
    rng = np.random.default_rng(3)
    for _ in range(12):
        delays = _random_delays(graph, rng)
        done = rp.execute_plan(graph, problem.scene, delays)
        report = rp.validate(done.trajectory, problem.scene, problem)
        assert report.certified, report
        assert done.trajectory.joint_names == problem.joint_names
        for arm, delay in delays.items():
            alone = done.trajectory.select(arm)
            at = np.linspace(0.0, delay.start, 5)
            np.testing.assert_array_equal(alone(at), np.broadcast_to(alone(0.0), (5, alone.coefficients.shape[2])))
        for node, after in done.graph.dependencies:
            assert node.time >= after.time - 1e-9
    assert result.trajectory is not None


def test_a_graph_without_dependencies_is_not_safe(ring: Plan) -> None:
    problem, _, graph = ring
    blind = rp.PlanGraph(graph.routes, ())
    late = {d.after.arms[0] for d in graph.dependencies}
    reports = [
        rp.validate(rp.execute_plan(blind, problem.scene, {arm: rp.ArmDelay(0.3)}).trajectory, problem.scene)
        for arm in late
    ]
    assert any(not report.valid for report in reports)
    assert {v.kind for report in reports for v in report.violations} == {"collision"}


def test_an_execution_without_delays_is_about_as_fast_as_the_plan(plan: Plan) -> None:
    problem, result, graph = plan
    done = rp.execute_plan(graph, problem.scene)
    assert rp.validate(done.trajectory, problem.scene, problem).certified
    assert 0.8 * result.makespan < done.makespan < 1.5 * result.makespan
    assert all(waiting >= 0.0 for waiting in done.waiting.values())


def test_only_releases_that_are_not_known_in_advance_delay_an_execution_without_delays(plan: Plan) -> None:
    problem, result, graph = plan
    # With knowledge of the future the plan itself is an execution of its graph ...
    assert all(node.time >= after.time for node, after in graph.dependencies)
    # ... and arms that never wait are as fast as planned, up to the reserve of speed.
    free = rp.execute_plan(rp.PlanGraph(graph.routes, ()), problem.scene)
    assert free.makespan <= 1.006 * result.makespan


def test_a_slower_arm_takes_as_much_longer(rr1: rp.Robot) -> None:
    scene = rp.place_grid(rr1, 1, 1)
    problem = rp.Problem(scene, None, {"arm01": [0.4, 0.1, 0.3, 0.2, 1.2, 0.3]})
    graph = rp.plan_graph(rp.plan_many_arms(problem, rng=0))
    plain = rp.execute_plan(graph, scene)
    slow = rp.execute_plan(graph, scene, {"arm01": rp.ArmDelay(slowdown=0.3)})
    assert slow.makespan == pytest.approx(1.3 * plain.makespan)
    late = rp.execute_plan(graph, scene, {"arm01": rp.ArmDelay(start=0.25)})
    assert late.makespan == pytest.approx(0.25 + plain.makespan)
    at = 0.4 * plain.makespan
    paused = rp.execute_plan(graph, scene, {"arm01": rp.ArmDelay(pauses=[(at, 2.0)])})
    assert plain.makespan + 1.5 < paused.makespan < plain.makespan + 2.5
    assert rp.validate(paused.trajectory, scene, problem).certified
    before, rest = np.linspace(0.0, at, 50), np.linspace(at + 1.0, at + 2.0, 20)
    np.testing.assert_allclose(paused.trajectory(before), plain.trajectory(before), atol=1e-9)
    assert np.abs(paused.trajectory(rest, 1)).max() == 0.0
    # Pauses may cost more than their durations, because the arm brakes, and simultaneous ones cost less.
    early = rp.execute_plan(graph, scene, {"arm01": rp.ArmDelay(pauses=[(0.05, 0.3)])})
    assert early.makespan > plain.makespan + 0.3
    both = rp.execute_plan(graph, scene, {"arm01": rp.ArmDelay(pauses=[(at, 2.0), (at, 2.0)])})
    assert both.makespan == pytest.approx(paused.makespan)
    for execution in (plain, slow, late, paused, early, both):
        assert execution.waiting == {"arm01": 0.0}


def test_the_pauses_of_an_arm_do_not_hide_how_long_it_waits(ring: Plan) -> None:
    problem, _, graph = ring
    node, after = graph.dependencies[0]
    (first,), (second,) = after.arms, node.arms
    late = {first: rp.ArmDelay(start=3.0)}
    paused = {second: rp.ArmDelay(pauses=[(2.8, 0.1)] * 9)}
    waited = rp.execute_plan(graph, problem.scene, late).waiting[second]
    assert rp.execute_plan(graph, problem.scene, late | paused).waiting[second] > 0.8 * waited


def test_an_arm_that_waits_stops_before_what_is_not_free(ring: Plan) -> None:
    problem, _, graph = ring
    node, after = graph.dependencies[0]
    (first,), (second,) = after.arms, node.arms
    done = rp.execute_plan(graph, problem.scene, {first: rp.ArmDelay(start=3.0)})
    assert rp.validate(done.trajectory, problem.scene, problem).certified
    assert done.waiting[second] > 1.0
    longest = max(done.waiting, key=done.waiting.__getitem__)
    waits = f"longest wait {done.waiting[longest]:.3f} s ({longest})"
    assert repr(done) == f"PlanExecution({len(graph.arms)} arms, {done.makespan:.3f} s, {waits})"
    route = graph.routes[node.agent]
    where = route.gridpoints[route.steps.begins[node.step]]
    rest = done.trajectory.select(second)(2.9)
    assert np.abs(done.trajectory.select(second)(2.9, 1)).max() == 0.0
    np.testing.assert_allclose(rest, where, atol=1e-9)


def test_mujoco_sees_no_contact_in_a_delayed_execution(ring: Plan) -> None:
    problem, _, graph = ring
    rng = np.random.default_rng(5)
    for _ in range(3):
        done = rp.execute_plan(graph, problem.scene, _random_delays(graph, rng))
        assert not rp.simulate(done.trajectory, problem.scene).contacts


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"start": -0.1}, "start is -0.1"),
        ({"slowdown": float("nan")}, "slowdown"),
        ({"slowdown": 1e300}, "slowdown is 1e\\+300, expected a number up to 1e\\+06"),
        ({"start": 1e9}, "start is 1000000000.0, expected a number up to 1e\\+06"),
        ({"pauses": [(0.1, 1e9)]}, "duration of a pause is 1000000000.0"),
        ({"pauses": [(1.0,)]}, "a pause has 1 number, expected"),
        ({"pauses": 3.0}, "expected a list of pairs"),
    ],
)
def test_bad_delays_are_refused(wrong: dict[str, object], said: str) -> None:
    with pytest.raises(rp.InputError, match=said):
        rp.ArmDelay(**wrong)


def test_executions_after_the_longest_delay_are_certified(ring: Plan) -> None:
    problem, _, graph = ring
    for arm in graph.arms:
        late = rp.execute_plan(graph, problem.scene, {arm: rp.ArmDelay(start=LATEST)})
        report = rp.validate(late.trajectory, problem.scene, problem)
        assert report.certified, report


def test_executions_of_what_is_not_there_are_refused(ring: Plan, rr1: rp.Robot) -> None:
    problem, _, graph = ring
    with pytest.raises(rp.UnknownNameError, match="arm09"):
        rp.execute_plan(graph, problem.scene, {"arm09": rp.ArmDelay(1.0)})
    with pytest.raises(rp.InputError, match="gap is -1"):
        rp.execute_plan(graph, problem.scene, gap=-1.0)
    with pytest.raises(rp.UnknownNameError, match="arm03"):
        rp.execute_plan(graph, rp.place_grid(rr1, 1, 2))


def test_an_arm_rests_where_no_speed_is_possible_and_goes_on(ring: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    _, _, graph = ring
    route = next(route for route in graph.routes if route.segments > 5)
    before = route.segments - 1

    def slow(curve: Curve, grid: Grid, limits: rp.Limits, first: float = 0.0) -> np.ndarray:
        x = fastest_speeds(curve, grid, limits, first)
        if len(grid.piece) == route.segments:
            x[before] = 0.0
        return x

    monkeypatch.setattr(route_motion, "fastest_speeds", slow)
    limits = ring[0].scene.limits(route.arms)
    motion = route_motion.RouteMotion(route, limits)
    motion.go_to(route.segments, 0.0)
    trajectory = motion.trajectory()
    assert np.isfinite(trajectory.end_time)
    np.testing.assert_allclose(trajectory(trajectory.end_time), route.gridpoints[-1], atol=1e-9)
    np.testing.assert_allclose(trajectory(motion.pass_time(before), 1), 0.0, atol=1e-6)


def test_a_release_in_the_last_instant_before_a_rest_comes_after_it(ring: Plan) -> None:
    problem, _, graph = ring
    route = next(route for route in graph.routes if route.segments > 5)
    middle = route.segments // 2
    for early in (1e-4, 1e-5, 1e-6):
        motion = route_motion.RouteMotion(route, problem.scene.limits(route.arms))
        motion.go_to(middle, 0.0)
        motion.go_to(route.segments, motion.stop_time - early)
        trajectory = motion.trajectory()
        assert motion.leave_time(middle) >= motion.pass_time(middle)
        for gridpoint in (middle, route.segments):
            np.testing.assert_allclose(trajectory(motion.pass_time(gridpoint)), route.gridpoints[gridpoint], atol=1e-9)


def test_plans_that_limit_jerk_or_torques_are_not_executed(ring: Plan) -> None:
    problem, _, graph = ring
    with pytest.raises(rp.InputError, match="limits jerk"):
        rp.execute_plan(replace(graph, retiming="ruckig"), problem.scene)
    with pytest.raises(rp.InputError, match="torque limits"):
        rp.execute_plan(replace(graph, torque_limits=True), problem.scene)


def test_a_profile_that_goes_on_from_a_gridpoint_is_the_rest_of_the_whole(ring: Plan) -> None:
    problem, _, graph = ring
    for route in graph.routes:
        limits, count = problem.scene.limits(route.arms), route.stops[0]
        grid = route.grid.part(0, count)
        whole = fastest_speeds(route.curve, grid, limits)
        for k in range(1, count - 1, 5):
            later = grid.part(k, count)
            np.testing.assert_allclose(fastest_speeds(route.curve, later, limits, whole[k]), whole[k:], rtol=1e-9)
            assert fastest_speeds(route.curve, later, limits, 1e6)[0] < 1e6


# ---- skew tolerance --------------------------------------------------------------------------


def _skewed(trajectory: rp.Trajectory, late: dict[str, float]) -> rp.Trajectory:
    return rp.Trajectory.merge(*(trajectory.select(arm).shifted(late[arm]) for arm in trajectory.arms))


def test_arms_may_start_late_by_the_skew_tolerance_one_by_one(plan: Plan) -> None:
    problem, _, graph = plan
    done = rp.execute_plan(graph, problem.scene, gap=0.2)
    tolerance = done.graph.skew_tolerance
    assert rp.validate(done.trajectory, problem.scene, problem).certified
    assert tolerance >= 0.2 - 1e-6
    limit = min(tolerance, 1.0)
    rng = np.random.default_rng(4)
    for k in range(12):
        shifts = rng.uniform(0.0, limit, len(graph.arms)) if k % 2 else rng.choice([0.0, limit], len(graph.arms))
        late = dict(zip(done.trajectory.arms, shifts.tolist(), strict=True))
        assert rp.validate(_skewed(done.trajectory, late), problem.scene).certified


def test_more_than_the_skew_tolerance_may_collide(ring: Plan) -> None:
    problem, _, graph = ring
    done = rp.execute_plan(graph, problem.scene, gap=0.02)
    tolerance = done.graph.skew_tolerance
    assert 0.02 - 1e-6 <= tolerance < 0.3
    blamed = False
    for arm in done.trajectory.arms:
        late = {name: 1.0 if name == arm else 0.0 for name in done.trajectory.arms}
        blamed = blamed or not rp.validate(_skewed(done.trajectory, late), problem.scene).valid
    assert blamed


# ---- files -----------------------------------------------------------------------------------


def _saved(plan: Plan, file: Path) -> Path:
    problem, result, graph = plan
    assert result.trajectory is not None
    return rp.save_plan_graph(file, graph, result.trajectory, problem.scene, problem)


def test_a_graph_comes_back_from_its_file(plan: Plan, tmp_path: Path) -> None:
    problem, _, graph = plan
    file = _saved(plan, tmp_path / "plan.json")
    again = rp.load_plan_graph(file)
    assert again.dependencies == graph.dependencies
    assert again.skew_tolerance == graph.skew_tolerance
    delays = _random_delays(graph, np.random.default_rng(0))
    one, two = (rp.execute_plan(g, problem.scene, delays).trajectory for g in (graph, again))
    assert one.coefficients.tobytes() == two.coefficients.tobytes()
    assert rp.load_motion(file).valid


def test_a_file_holds_the_limits_that_a_plan_keeps(ring: Plan, tmp_path: Path) -> None:
    problem, result, graph = ring
    limited = replace(graph, retiming="ruckig", torque_limits=True)
    again = rp.load_plan_graph(_saved((problem, result, limited), tmp_path / "plan.json"))
    assert (again.retiming, again.torque_limits) == ("ruckig", True)
    for entry in ({"retiming": "blends"}, {"retiming": "ruckig_direct"}, {"torque_limits": 1}):
        with pytest.raises(rp.FormatError, match=next(iter(entry))):
            rp.PlanGraph.from_dict({**graph.to_dict(), **entry})
    # Files of earlier versions do not name them.
    plain = {key: value for key, value in graph.to_dict().items() if key not in ("retiming", "torque_limits")}
    assert rp.PlanGraph.from_dict(plain).retiming == "blend"


def test_a_graph_is_saved_with_its_own_trajectory_only(ring: Plan, tmp_path: Path) -> None:
    problem, result, graph = ring
    assert result.trajectory is not None
    with pytest.raises(rp.InputError, match="with the trajectory"):
        rp.save_motion(tmp_path / "a.json", problem.scene, plan_graph=graph.to_dict())
    other = result.trajectory.stretched(2.0)
    with pytest.raises(rp.InputError, match="another trajectory"):
        rp.save_plan_graph(tmp_path / "b.json", graph, other, problem.scene)
    file = rp.save_motion(tmp_path / "b.json", problem.scene, trajectory=other, plan_graph=graph.to_dict())
    with pytest.raises(rp.FormatError, match="another trajectory"):
        rp.load_plan_graph(file)
    plain = rp.save_motion(tmp_path / "c.json", problem.scene, trajectory=other)
    with pytest.raises(rp.FormatError, match="no plan graph"):
        rp.load_plan_graph(plain)


_DAMAGE = {
    "a step that is not there": lambda graph: graph["dependencies"][0].update(step=9999),
    "an agent that is not there": lambda graph: graph["dependencies"][0].update(after_agent=7),
    "a circle": lambda graph: graph["dependencies"].append(
        {
            "agent": graph["dependencies"][0]["after_agent"],
            "step": 1,
            "after_agent": graph["dependencies"][0]["agent"],
            "after_step": graph["dependencies"][0]["step"],
        }
    ),
    "a missing segment": lambda graph: [column.pop(3) for column in graph["routes"][0]["grid"].values()],
    "a jump": lambda graph: graph["routes"][0]["start"].__setitem__(0, 0.1),
    "a piece that is not there": lambda graph: graph["routes"][0]["grid"]["piece"].__setitem__(0, 99),
    "no last stop": lambda graph: graph["routes"][0]["stops"].clear(),
    "another arm": lambda graph: graph["routes"][0].update(joint_names=graph["routes"][1]["joint_names"]),
    "a twin": lambda graph: graph["routes"].append(graph["routes"][0]),
    "an unknown key": lambda graph: graph["routes"][0].update(speed=1.0),
    "a text": lambda graph: graph["routes"][0]["steps"].update(times=["soon"]),
    "times that decrease": lambda graph: graph["routes"][0]["steps"]["times"].__setitem__(-1, 0.0),
}


@pytest.mark.parametrize("damage", list(_DAMAGE))
def test_damaged_graphs_are_refused_by_name(damage: str, ring: Plan, tmp_path: Path) -> None:
    file = _saved(ring, tmp_path / "plan.json")
    document = json.loads(file.read_text())
    _DAMAGE[damage](document["content"]["plan_graph"])
    file.write_text(json.dumps(document))
    with pytest.raises(rp.FormatError, match="altered"):
        rp.load_plan_graph(file)
    canonical = json.dumps(document["content"], sort_keys=True, separators=(",", ":"))
    document["sha256"] = hashlib.sha256(canonical.encode()).hexdigest()
    file.write_text(json.dumps(document))
    with pytest.raises(rp.FormatError):
        rp.load_plan_graph(file)


def test_numbers_of_more_than_64_bits_are_named(ring: Plan) -> None:
    for place, name, number in (("grid", "piece", 10**30), ("steps", "begins", 10**30), ("steps", "times", 10**400)):
        entries = ring[2].to_dict()
        entries["routes"][0][place][name][1] = number
        with pytest.raises(rp.FormatError, match=rf"routes\[0\]\.{place}\.{name} has a number"):
            rp.PlanGraph.from_dict(entries)


def test_routes_refuse_arrays_that_do_not_fit(ring: Plan) -> None:
    _, _, graph = ring
    route = graph.routes[0]
    for wrong in (
        {"curve": replace(route.curve, lengths=route.curve.lengths[:-1])},
        {"grid": route.grid._replace(piece=route.grid.piece - 1)},
        {"grid": route.grid._replace(delta=route.grid.delta[:-1])},
        {"start": route.start[:-1]},
        {"stops": route.stops[:-1]},
        {"steps": RouteSteps(*(getattr(route.steps, name)[:-2] for name in ("begins", "ends", "times")))},
    ):
        with pytest.raises(rp.InputError):
            replace(route, **wrong)
    steps = route.steps
    for wrong in ({"begins": steps.begins[1:]}, {"ends": steps.ends - 1}, {"times": steps.times[:-1]}):
        with pytest.raises(rp.InputError):
            replace(steps, **wrong)


def test_a_plan_graph_is_read_only_after_pickling(ring: Plan) -> None:
    route = pickle.loads(pickle.dumps(ring[2])).routes[0]
    for array in (route.start, route.curve.lengths, *route.grid, route.steps.times):
        assert not array.flags.writeable
