"""Hints why there may be no path: the pair of links that separates start and goal is named, for every planner."""

from __future__ import annotations

import math
import re
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths import path_pool
from rr1plan.multi.paths.path_pool import PathPool
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.planners import timeout_hints
from rr1plan.planners.timeout_hints import split_budget, with_hint
from rr1plan.planning import ProgressCallback
from rr1plan.robot import Geometry, Joint, Link
from rr1plan.transforms import pose

ITERATIONS = rp.Budget(math.inf, 4000)


@pytest.fixture(scope="module")
def gate() -> rp.Robot:
    """A forearm whose tip has to pass a disk around the base: at one band of the elbow's angle, wherever it turns."""
    ez, ey = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
    ones = np.ones(2)
    return rp.Robot(
        name="gate",
        links=(
            Link("base", collisions=(Geometry("disk", rp.Cylinder(1.0, 0.02)),)),
            Link("column", collisions=(Geometry("post", rp.Cylinder(0.01, 0.1)),)),
            Link("forearm", collisions=(Geometry("ball", rp.Sphere(0.03), pose([0.3, 0.0, 0.0])),)),
        ),
        joints=(
            Joint("turn", "revolute", "base", "column", pose([0.0, 0.0, 0.1]), ez, -2.0, 2.0, 1.0, 1.0),
            Joint("elbow", "revolute", "column", "forearm", pose([0.2, 0.0, 0.0]), ey, -1.5, 1.5, 1.0, 1.0),
        ),
        joint_names=("turn", "elbow"),
        limits=rp.Limits(np.array([-2.0, -1.5]), np.array([2.0, 1.5]), ones, ones, ones, ones),
        configurations={"home": np.zeros(2)},
        locked_joints={},
        disabled_collisions=frozenset({frozenset({"base", "column"}), frozenset({"column", "forearm"})}),
        tool="forearm",
    )


@pytest.fixture(scope="module")
def separated(gate: rp.Robot) -> rp.Problem:
    return rp.Problem(rp.Scene().with_arm("a", gate), [0.0, -0.5], [0.5, 1.2])


@pytest.mark.parametrize("planner", ["rrt_connect", "anytime", "roadmap", "rrt", "bit_star"])
def test_the_pair_that_separates_start_and_goal_is_named_with_its_band(separated: rp.Problem, planner: str) -> None:
    result = rp.plan(separated, planner=planner, budget=ITERATIONS, rng=0)
    assert result.status is rp.PlanStatus.TIMEOUT
    assert "no path found" in result.reason
    assert "separated by 'base' and 'forearm'" in result.reason
    low, high = map(float, re.findall(r"whenever elbow is in \[([\d.-]+), ([\d.-]+)\]", result.reason)[0])
    # The ball of 3 cm, 30 cm from the elbow and 10 cm above the disk's middle, over a disk of 2 cm.
    assert low == pytest.approx(math.asin((0.1 - 0.04) / 0.3), abs=5e-3)
    assert high == pytest.approx(math.asin((0.1 + 0.04) / 0.3), abs=5e-3)
    for remedy in ("allowed = [", "SRDF", "convex='pieces'"):
        assert remedy in result.reason


def test_two_pairs_that_separate_start_and_goal_are_both_named(gate: rp.Robot) -> None:
    """A second forearm on the other side has to pass the disk as well: neither pair alone makes the difference."""
    ones = np.ones(3)
    ball = Link("forearm2", collisions=(Geometry("ball", rp.Sphere(0.03), pose([-0.3, 0.0, 0.0])),))
    elbow = replace(gate.joint("elbow"), name="elbow2", child="forearm2", origin=pose([-0.2, 0.0, 0.0]))
    robot = replace(
        gate,
        links=(*gate.links, ball),
        joints=(*gate.joints, elbow),
        joint_names=("turn", "elbow", "elbow2"),
        limits=rp.Limits(np.array([-2.0, -1.5, -1.5]), np.array([2.0, 1.5, 1.5]), ones, ones, ones, ones),
        configurations={"home": np.zeros(3)},
        disabled_collisions=gate.disabled_collisions | {frozenset({"column", "forearm2"})},
    )
    # Elbows turn about y: the second forearm is above the disk where the angle is positive.
    problem = rp.Problem(rp.Scene().with_arm("a", robot), [0.0, -0.5, 0.5], [0.5, 1.2, -1.2])
    reason = rp.plan(problem, planner="rrt_connect", budget=rp.Budget(math.inf, 20000), rng=0).reason
    assert "separated by 'base' and 'forearm': they touch whenever elbow is in [0.2" in reason
    assert " and by 'base' and 'forearm2': they touch whenever elbow2 is in [-0.485" in reason
    (remedy,) = re.findall(r"allow the pairs \(scene((?:\.allow\('[^']*', '[^']*'\))+)", reason)
    scene = eval(f"problem.scene{remedy}")
    assert rp.plan(rp.Problem(scene, problem.start, problem.goal), rng=0).found


def test_allowing_the_pair_as_it_is_said_solves_the_problem(separated: rp.Problem) -> None:
    reason = rp.plan(separated, planner="rrt_connect", budget=ITERATIONS, rng=0).reason
    (remedy,) = re.findall(r"scene(\.allow\('a/base', 'a/forearm'\))", reason)
    scene = eval(f"separated.scene{remedy}")
    assert rp.plan(rp.Problem(scene, separated.start, separated.goal), rng=0).found


def test_the_same_seed_gives_the_same_hint(separated: rp.Problem) -> None:
    reasons = {re.sub(r"after [\d.e-]+ s", "", rp.plan(separated, budget=ITERATIONS, rng=7).reason) for _ in range(2)}
    assert len(reasons) == 1


def test_a_motion_comes_with_the_hint_too(separated: rp.Problem) -> None:
    motion = rp.plan_motion(separated, budget=ITERATIONS, rng=0)
    assert not motion.valid
    assert "separated by 'base' and 'forearm'" in motion.result.reason


def test_the_arm_whose_links_they_are_is_named(gate: rp.Robot) -> None:
    scene = rp.Scene().with_arm("left", gate).with_arm("right", gate, [3.0, 0.0, 0.0])
    goal = {"left": [0.5, -0.4], "right": [0.5, 1.2]}
    problem = rp.Problem(scene, {"left": [0.0, -0.5], "right": [0.0, -0.5]}, goal)
    assert "start and goal of 'right' seem to be separated" in rp.plan(problem, budget=ITERATIONS, rng=0).reason


def test_a_hint_for_one_of_many_arms_may_end_after_their_deadline(
    separated: rp.Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    watch = Stopwatch(0.5)

    def late(leg: rp.Problem, result: rp.PlanResult, budget: rp.Budget, progress: ProgressCallback) -> rp.PlanResult:
        time.sleep(max(0.0, watch.left))
        return with_hint(leg, result, budget, progress)

    monkeypatch.setattr(path_pool, "with_hint", late)
    monkeypatch.setattr(path_pool, "split_budget", lambda _: (rp.Budget(0.05), rp.Budget(20.0)))
    pool = PathPool(Agent(separated, separated.arms), 0.0, np.random.default_rng(0), watch)
    path, reason = pool.add({}, patient=True)
    assert path is None
    assert "configurations were reached from the start" in reason
    assert "separated by 'base' and 'forearm'" in reason


def test_an_obstacle_in_the_way_is_not_blamed_on_links(gate: rp.Robot) -> None:
    wall = rp.Box((0.8, 0.02, 2.0))
    scene = rp.Scene().with_arm("a", gate).with_obstacle("wall", wall, [0.5, 0.0, 0.0])
    problem = rp.Problem(scene, [-0.7, -0.5], [0.7, -0.5])
    result = rp.plan(problem, budget=ITERATIONS, rng=0)
    assert result.status is rp.PlanStatus.TIMEOUT
    assert "separated" not in result.reason
    lesson = rp.load_problems("planar2r_no_path")["no_way"]
    assert "separated" not in rp.plan(lesson, budget=ITERATIONS, rng=0).reason


@pytest.mark.parametrize("budget", [rp.Budget(0.05), rp.Budget(math.inf, 900), rp.Budget(5.0, 900)])
def test_a_small_budget_gets_no_hint(separated: rp.Problem, budget: rp.Budget) -> None:
    result = rp.plan(separated, planner="rrt_connect", budget=budget, rng=0)
    assert result.status is rp.PlanStatus.TIMEOUT
    assert "separated" not in result.reason


def test_a_hint_takes_a_tenth_of_the_time_and_a_second_at_most_and_a_twentieth_of_the_iterations() -> None:
    for budget in (rp.Budget(1.0), rp.Budget(10.0), rp.Budget(600.0, 10**6), rp.Budget(math.inf, 10**6)):
        search, hint = split_budget(budget)
        assert hint is not None
        assert search.seconds + hint.seconds == budget.seconds
        assert search.iterations == budget.iterations
        if math.isfinite(budget.seconds):
            assert hint.seconds <= min(1.0, 0.1 * budget.seconds)
        if budget.iterations is not None:
            assert hint.iterations == budget.iterations // 20
    assert split_budget(rp.Budget(0.9)) == (rp.Budget(0.9), None)


@pytest.mark.parametrize(("share", "reports"), [(1.0, 3), (0.5, 6), (0.1, 6), (0.0, 6)])
def test_a_hint_takes_longer_where_it_gets_only_a_share_of_the_processor_but_never_more_than_its_budget(
    gate: rp.Robot, monkeypatch: pytest.MonkeyPatch, share: float, reports: int
) -> None:
    """Every look at the clock takes a millisecond, of which the thread has only a share; reports come each 0.1 s."""
    scene = rp.Scene().with_arm("a", gate).with_obstacle("wall", rp.Box((0.8, 0.02, 2.0)), [0.5, 0.0, 0.0])
    problem = rp.Problem(scene, [-0.7, -0.5], [0.7, -0.5])
    result = rp.PlanResult(rp.PlanStatus.TIMEOUT, None, "no path found")
    seconds = [0.0]

    def wall() -> float:
        seconds[0] += 1e-3
        return seconds[0]

    clock = SimpleNamespace(perf_counter=wall, thread_time=lambda: share * seconds[0])
    monkeypatch.setattr(timeout_hints, "time", clock)
    told: list[float] = []
    with_hint(problem, result, rp.Budget(1.0, 10**6), lambda p: told.append(p.seconds))
    assert len(told) == pytest.approx(reports, abs=1)
    assert max(told) < 1.0


def test_the_progress_may_cancel_while_a_hint_is_looked_for(separated: rp.Problem) -> None:
    told: list[float] = []

    def progress(p: rp.Progress) -> bool:
        told.append(p.fraction)
        return p.fraction < 1.0

    result = rp.plan(separated, planner="rrt_connect", budget=ITERATIONS, rng=0, progress=progress)
    assert result.status is rp.PlanStatus.CANCELLED
    assert told[0] < 1.0
    assert told.count(1.0) == 1


def test_a_start_too_near_to_contact_to_leave_is_named(gate: rp.Robot) -> None:
    tip = rp.Scene().with_arm("a", gate).link_poses({"a": np.array([0.0, -0.5])})["a/forearm"] @ [0.3, 0.0, 0.0, 1.0]
    roof = rp.Box((4.0, 4.0, 0.02))
    scene = rp.Scene().with_arm("a", gate).with_obstacle("roof", roof, [0.0, 0.0, tip[2] + 0.04 + 1e-7])
    result = rp.plan(rp.Problem(scene, [0.0, -0.5], [0.5, -0.4]), budget=ITERATIONS, rng=0)
    assert result.status is rp.PlanStatus.INVALID_START
    assert "'a/forearm' and 'roof' are less than a micrometer from contact" in result.reason
    higher = scene.with_obstacle("roof", roof, [0.0, 0.0, tip[2] + 0.04 + 0.01 + 1e-7])
    padded = rp.Problem(higher.with_padding(0.01, "a", "roof"), [0.0, -0.5], [0.5, -0.4])
    result = rp.plan(padded, budget=ITERATIONS, rng=0)
    assert "'a/forearm' and 'roof' are less than a micrometer beyond the padding of 10 mm" in result.reason


def test_a_proposal_names_pairs_that_touch_in_a_band(gate: rp.Robot, rr1: rp.Robot) -> None:
    proposal = rp.propose_disabled_collisions(gate, samples=200, rng=0)
    (band,) = proposal.bands
    assert {band.a, band.b} == {"base", "forearm"}
    assert band.joint == "elbow"
    assert (band.lower, band.upper) == (pytest.approx(0.2, abs=0.01), pytest.approx(0.485, abs=0.01))
    assert str(band) in str(proposal)
    assert "Adjacent: base - column" in str(proposal)
    assert proposal == dict(proposal)
    assert rp.propose_disabled_collisions(rr1, samples=100, rng=0).bands == ()
