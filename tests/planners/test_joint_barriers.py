"""Values that a joint cannot pass: proofs hold at random samples, and passable values are not reported."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.collision.contact_cells import ContactCells
from rr1plan.planners import planning_query
from rr1plan.planners.joint_barriers import find_joint_barrier
from rr1plan.planning import Budget, PlanStatus

BUDGET = Budget(seconds=60.0, iterations=40_000)
# A base that turns, an arm that swings on it to both sides and through below, and a wrist.
SWING = """<robot name="swing">
  <link name="base"/>
  <link name="tower"><collision><origin xyz="0 0 0.15"/><geometry><cylinder radius="0.05" length="0.2"/></geometry>
  </collision></link>
  <link name="beam"><collision><origin xyz="0 0 0.35"/><geometry><box size="0.06 0.06 0.6"/></geometry>
  </collision></link>
  <link name="hand"><collision><geometry><sphere radius="0.03"/></geometry></collision></link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="tower"/><axis xyz="0 0 1"/>
    <limit lower="-3.1" upper="3.1" velocity="1" effort="1"/></joint>
  <joint name="swing" type="revolute"><parent link="tower"/><child link="beam"/><origin xyz="0.12 0 0.3"/>
    <axis xyz="1 0 0"/><limit lower="-6" upper="6" velocity="1" effort="1"/></joint>
  <joint name="wrist" type="revolute"><parent link="beam"/><child link="hand"/><origin xyz="0 0 0.75"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
</robot>"""


@pytest.fixture(scope="module")
def on_floor(tmp_path_factory: pytest.TempPathFactory) -> rp.Scene:
    """That arm on a floor, which is not level, so that where the beam meets it depends on the turn of the base."""
    file = tmp_path_factory.mktemp("robots") / "swing.urdf"
    Path(file).write_text(SWING)
    robot = rp.load_robot(file)
    return rp.Scene().with_arm("arm", robot).with_obstacle("floor", rp.HalfSpace((0.15, 0.0, 1.0), 0.0))


@pytest.fixture(scope="module")
def planar2r_limited() -> rp.Robot:
    return rp.load_robot("planar2r_limited")


def at_post(robot: rp.Robot, distance: float) -> rp.Scene:
    """A planar arm and a post in front of its base, at a distance."""
    return rp.Scene().with_arm("arm", robot).with_obstacle("post", rp.Box((0.1, 0.1, 0.5)), (0.0, distance, 0.0))


def test_a_beam_on_a_base_that_turns_cannot_swing_through_the_floor(on_floor: rp.Scene) -> None:
    start, goal = np.array([-1.0, 1.0, 0.5]), np.array([2.0, -1.0, -1.0])
    checker = rp.CollisionChecker(on_floor)
    assert checker.is_free(start)
    assert checker.is_free(goal)
    assert find_joint_barrier(checker, start, goal) is None  # over the top
    goal[1] += 2.0 * np.pi  # there from the other side
    found = find_joint_barrier(checker, start, goal)
    assert found is not None
    assert found.joint == "arm/swing"
    assert found.elements == (("arm/beam", "floor"),)
    rng = np.random.default_rng(0)
    for q in rng.uniform(checker.limits.lower, checker.limits.upper, (500, 3)):
        q[1] = found.value
        assert not checker.is_free_slowly(q)


def test_the_pairs_named_touch_wherever_the_other_joint_is(on_floor: rp.Scene) -> None:
    # Two floors that slope to either side, of which the beam meets the one or the other.
    scene = on_floor.with_obstacle("ramp", rp.HalfSpace((-0.3, 0.0, 1.0), 0.02))
    checker = rp.CollisionChecker(scene)
    found = find_joint_barrier(checker, np.array([-1.0, 1.0, 0.5]), np.array([2.0, 5.2, -1.0]))
    assert found is not None
    for turn in np.linspace(-3.1, 3.1, 40):
        touching = {frozenset((c.a, c.b)) for c in checker.contacts(np.array([turn, found.value, 0.0]))}
        assert any(frozenset(pair) in touching for pair in found.elements)


def test_a_search_without_time_ends(on_floor: rp.Scene) -> None:
    checker, ends = rp.CollisionChecker(on_floor), (np.array([-1.0, 1.0, 0.5]), np.array([2.0, 5.2, -1.0]))
    assert find_joint_barrier(checker, *ends) is not None
    assert find_joint_barrier(checker, *ends, goes_on=lambda: False) is None
    assert find_joint_barrier(checker, *ends, most_tests=100) is None


def test_a_slow_machine_proves_the_same(on_floor: rp.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    seconds = itertools.count(0.0, 2.0)
    monkeypatch.setattr(planning_query, "time", SimpleNamespace(perf_counter=lambda: next(seconds)))
    problem = rp.Problem(on_floor, [-1.0, 1.0, 0.5], [2.0, 5.2, -1.0])
    budget = Budget(seconds=math.inf, iterations=BUDGET.iterations)
    assert rp.plan(problem, budget=budget, rng=0).status is PlanStatus.INFEASIBLE


def test_cells_of_some_pairs_are_those_of_all_pairs(rr1: rp.Robot) -> None:
    scene = rp.place_grid(rr1, 1, 3, spacing=0.4).with_obstacle("floor", rp.HalfSpace((0.0, 0.0, 1.0), 0.0))
    checker = rp.CollisionChecker(scene)
    some = list(range(0, len(checker.solid_pairs), 7))
    centers, half = np.random.default_rng(0).uniform(-2.0, 2.0, (40, 2)), np.array([0.01, 0.02])
    whole = ContactCells(checker, scene.configuration(), (1, 7))
    chosen = ContactCells(checker, scene.configuration(), (1, 7), some)
    assert chosen.pairs == len(some)
    near = np.zeros((len(centers), whole.pairs), dtype=np.bool_)
    near[:, some] = True
    blocked, may = whole.classify(centers, half, near)
    again, touching = chosen.classify(centers, half, near[:, some])
    assert blocked.any()
    assert np.array_equal(blocked, again)
    assert np.array_equal(may[:, some], touching)


def test_what_is_barred_is_infeasible_before_the_budget_ends(on_floor: rp.Scene) -> None:
    problem = rp.Problem(on_floor, [-1.0, 1.0, 0.5], [2.0, 5.2, -1.0])
    for planner in ("rrt_connect", "anytime", "roadmap"):
        result = rp.plan(problem, planner=planner, budget=BUDGET, rng=0)
        assert result.status is PlanStatus.INFEASIBLE
        assert result.iterations < 0.5 * BUDGET.iterations
        assert "joint 'arm/swing' cannot pass" in result.reason
    many = rp.plan_many_arms(problem, budget=Budget(60.0), rng=0)
    assert many.status is PlanStatus.INFEASIBLE
    assert many.reason.startswith("arm: no path exists: joint 'arm/swing' cannot pass")
    # A goal on this side is reached, even if others are not.
    either = rp.Problem(on_floor, problem.start, {"arm": [rp.JointGoal([2.0, 5.2, -1.0]), rp.JointGoal([2.0, 0, 0])]})
    assert rp.plan(either, budget=BUDGET, rng=0).found


def test_a_post_bars_a_joint_with_limits_only_within_reach_of_its_own_link(
    planar2r: rp.Robot, planar2r_limited: rp.Robot
) -> None:
    start, goal = np.array([0.3, 0.1]), np.array([2.8, 0.1])
    barred = find_joint_barrier(rp.CollisionChecker(at_post(planar2r_limited, 0.6)), start, goal)
    assert barred is not None
    assert barred.joint == "arm/joint1"
    assert barred.elements == (("arm/link1", "post"),)
    assert barred.value == pytest.approx(0.5 * np.pi, abs=0.2)
    # The second link folds back to pass a post behind the first one.
    folds = rp.Problem(at_post(planar2r_limited, 1.3), start, goal)
    assert find_joint_barrier(rp.CollisionChecker(folds.scene), start, goal) is None
    assert rp.plan(folds, budget=BUDGET, rng=0).found
    # Without limits there is another way round.
    assert find_joint_barrier(rp.CollisionChecker(at_post(planar2r, 0.6)), start, goal) is None


def test_what_only_the_margin_bars_is_not_infeasible(planar2r_limited: rp.Robot) -> None:
    # 40 mm between the first link and the post; the search keeps 60.
    problem = rp.Problem(at_post(planar2r_limited, 1.13), [0.3, 2.0], [2.8, 2.0])
    assert rp.plan(problem, budget=BUDGET, rng=0).found
    result = rp.plan(problem.with_margin(0.06), budget=BUDGET, rng=0)
    assert result.status is PlanStatus.TIMEOUT


def test_a_slide_of_one_joint_does_not_pass_a_wall(tmp_path: Path) -> None:
    file = tmp_path / "slide.urdf"
    file.write_text("""<robot name="slide"><link name="rail"/>
      <link name="cart"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
      <joint name="drive" type="prismatic"><parent link="rail"/><child link="cart"/><axis xyz="1 0 0"/>
        <limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>""")
    scene = rp.Scene().with_arm("arm", rp.load_robot(file)).with_obstacle("wall", rp.Box((0.02, 1, 1)), (0.3, 0, 0))
    checker = rp.CollisionChecker(scene)
    found = find_joint_barrier(checker, np.array([-0.5]), np.array([0.8]))
    assert found is not None
    assert 0.24 <= found.value <= 0.36
    assert find_joint_barrier(checker, np.array([-0.5]), np.array([0.2])) is None
