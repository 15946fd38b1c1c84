"""Continuous joints: the space that planners search, the nearest goal, and trees that meet across a seam."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rr1plan as rp
from rr1plan.collision import CollisionChecker
from rr1plan.kernels.planner_kernels import CStruct, address_of, load_library
from rr1plan.kernels.random_state import random_state
from rr1plan.model import nearest_copy
from rr1plan.model.joint_space import Space, joint_space, with_copies
from rr1plan.planners import RrtConnect
from rr1plan.planners.planning_query import Query
from rr1plan.planning import Budget, PlanStatus

COUNTED = Budget(seconds=float("inf"), iterations=20_000)
TURN = 2.0 * np.pi

HALF_FOLLOWED = """<robot name="r"><link name="a"/>
<link name="b"><collision><origin xyz="0.5 0 0"/><geometry><box size="1 0.1 0.1"/></geometry></collision></link>
<link name="c"><collision><origin xyz="0.2 0 0.3"/><geometry><box size="0.4 0.1 0.1"/></geometry></collision></link>
<joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
<limit effort="1" velocity="1"/></joint>
<joint name="k" type="continuous"><parent link="b"/><child link="c"/><origin xyz="1 0 0"/><axis xyz="0 0 1"/>
<limit effort="1" velocity="1"/>{mimic}</joint></robot>"""


def fenced(posts):
    """The plane arm, whose joints turn without end, among posts at these angles."""
    scene = rp.Scene().with_arm("arm", rp.load_robot("planar2r"))
    for name, angle in posts.items():
        scene = scene.with_obstacle(name, rp.Sphere(0.05), [0.6 * np.cos(angle), 0.6 * np.sin(angle), 0.0])
    return scene


def two_links(tmp_path, mimic=""):
    file = tmp_path / "r.urdf"
    file.write_text(HALF_FOLLOWED.format(mimic=mimic))
    return rp.load_robot(file)


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32))
def test_a_plain_goal_is_taken_where_it_is_nearest_to_the_start(seed):
    rng = np.random.default_rng(seed)
    scene = fenced({})
    start, goal = rng.uniform(-20.0, 20.0, (2, 2))
    problem = rp.Problem(scene, start, goal)
    with Query("rrt_connect", problem, None, 0, None) as query:
        refusal = query.early_exit()
        if refusal is not None:
            assert refusal.status in (PlanStatus.INVALID_START, PlanStatus.INVALID_GOAL)
            return
        expected = nearest_copy(scene.arm("arm").robot, goal, start)
        np.testing.assert_allclose(query.goals, [expected], atol=1e-14)
        np.testing.assert_allclose(with_copies(problem, query.goals)[0], expected, atol=1e-14)


@pytest.mark.parametrize("planner", ["rrt_connect", "anytime", "roadmap", "ompl_rrt_connect"])
def test_the_way_round_is_found_where_the_short_one_is_shut(planner, is_certified):
    shut = fenced({"only": 0.6})
    for start, goal in (([0.1, 0.1], [1.1, 0.1]), ([1.1, 0.1 + 3 * TURN], [0.1 - TURN, 0.1])):
        problem = rp.Problem(shut, start, goal)
        result = rp.plan(
            problem, planner=planner, budget=COUNTED if planner == "rrt_connect" else Budget(3.0, 3000), rng=1
        )
        assert result.found, result.reason
        points = result.path.waypoints
        np.testing.assert_array_equal(points[0], start)
        np.testing.assert_allclose(np.exp(1j * points[-1]), np.exp(1j * np.array(goal)), atol=1e-12)
        assert abs(np.ptp(points[:, 0])) > 4.0
        assert is_certified(shut, points)


def test_trees_that_meet_across_a_seam_are_joined_by_certified_edges(is_certified):
    scene = fenced({"one": 0.6}).with_obstacle("far", rp.Sphere(0.1), [-1.2, 0.3, 0.0])
    rng, motion, moved = np.random.default_rng(0), CollisionChecker(scene), 0
    for seed in range(60):
        start, goal = rng.uniform(-9.0, 9.0, (2, 2))
        if not (motion.is_free(start) and motion.is_free(goal)):
            continue
        result = RrtConnect(tree=True).plan(rp.Problem(scene, start, goal), budget=Budget(np.inf, 2000), rng=seed)
        if not result.found:
            continue
        points, tree = result.path.waypoints, result.tree
        near = nearest_copy(scene.arm("arm").robot, goal, start)
        moved += int(np.abs(points[-1] - near).max() > 1.0)
        assert np.abs(np.diff(points, axis=0)).max() < np.pi + 1e-9
        assert is_certified(scene, points)
        for a, b in tree.edges:
            assert motion.edge_is_free_slowly(tree.vertices[a], tree.vertices[b])
    assert moved > 2


def test_a_long_range_does_not_lead_the_wrong_way_round(is_certified):
    scene = fenced({"one": 0.6})
    for seed in range(8):
        problem = rp.Problem(scene, [0.1, 0.1], [1.1, 0.1])
        result = RrtConnect(range=50.0).plan(problem, budget=COUNTED, rng=seed)
        assert result.found
        assert is_certified(scene, result.path.waypoints)


def test_a_joint_that_another_follows_by_half_turns_does_not_wrap(tmp_path, is_certified):
    robot = two_links(tmp_path, '<mimic joint="j" multiplier="0.5"/>')
    scene = rp.Scene().with_arm("arm", robot).with_obstacle("post", rp.Sphere(0.05), [0.0, 0.8, 0.3])
    problem = rp.Problem(scene, [0.0], [4.0])
    space = joint_space(problem.scene, problem.arms)
    assert (space.wraps.tolist(), space.continuous.tolist(), space.is_shared) == ([False], [False], True)
    around = Space.around(problem, np.array([[4.0]]))
    assert np.isfinite(around.extent).all()
    result = rp.plan(problem, budget=COUNTED, rng=0)
    np.testing.assert_array_equal(result.path.waypoints[-1], [4.0])
    assert is_certified(scene, result.path.waypoints)


def test_the_space_of_endless_joints_has_no_seam_and_can_be_unrolled(tmp_path):
    scene = rp.Scene().with_arm("arm", two_links(tmp_path))
    problem = rp.Problem(scene, [1.0, 2.0], [3.0, 2.5])
    space = Space.around(problem, np.array([[3.0, 2.5]]))
    assert np.isinf(space.extent).all()
    assert space.movable.all()
    assert space.diagonal == pytest.approx(TURN * np.sqrt(2.0))
    unrolled = Space.unrolled(problem, np.array([[3.0, 2.5]]))
    np.testing.assert_allclose(unrolled.extent, [2.5 * TURN, 2.5 * TURN])
    assert not unrolled.wraps.any()
    copies = with_copies(problem, np.array([[3.0, 2.5]]))
    np.testing.assert_array_equal(copies, [[3.0, 2.5], [3.0 - TURN, 2.5], [3.0, 2.5 - TURN], [3.0 - TURN, 2.5 - TURN]])


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**32), st.integers(1, 9), st.floats(0.01, 2.0))
def test_an_escape_sample_is_no_longer_than_a_step_within_limits_and_may_go_any_way(seed, nq, step):
    rng = np.random.default_rng(seed)
    lower, extent = -rng.uniform(0.0, 1.0, nq), rng.uniform(1.0, 3.0, nq)
    turns = np.where(rng.random(nq) < 0.3, TURN, 0.0)
    still = rng.random(nq) < 0.2
    still[0] = False
    extent[still] = lower[still] = 0.0
    vertices, state, found = np.zeros((nq, 3)), random_state(seed), []
    trees = CStruct("Trees", column_count=nq, capacity=3)
    trees.value.sides[1].vertices = address_of(vertices, "double")
    escape = load_library().rr1_escape_sample
    for _ in range(60):
        q = np.empty(nq)
        distance = escape(trees, 1, 2, step, state, lower, extent, turns, q)
        assert distance == pytest.approx(np.linalg.norm(q))
        assert distance <= step * (1.0 + 1e-12)
        inside = (turns > 0.0) | ((lower <= q) & (q <= lower + extent))
        assert inside.all()
        assert not q[still].any()
        found.append(q)
    moved = np.array(found)[:, ~still]
    assert (moved.max(axis=0) > 0.0).all()
    assert (moved.min(axis=0) < 0.0).all()


def test_planners_without_wrapping_search_wide_turning_joints_near_the_start_and_the_goals():
    wide = 1000.0 * TURN
    arm = rp.planar_arm("RR", limits=[(-wide, wide), (-2.0 * TURN, 2.0 * TURN)])
    problem = rp.Problem(rp.Scene().with_arm("arm", arm), [wide - 1.0, 0.0], [3.0, 1.0])
    space = Space.unrolled(problem, np.array([[3.0, 1.0]]))
    assert -TURN * 1.5 < space.lower[0] < 3.0 - TURN
    assert space.upper[0] == wide  # not beyond the limit
    assert (space.lower[1], space.upper[1]) == (-2.0 * TURN, 2.0 * TURN)
    # A gantry does not come to the same place again.
    gantry = rp.planar_arm("PP", limits=[(-40.0, 40.0), (-3.0, 3.0)])
    sliding = rp.Problem(rp.Scene().with_arm("arm", gantry), [0.0, 0.0], [1.0, 1.0])
    assert Space.unrolled(sliding, np.array([[1.0, 1.0]])).upper.tolist() == [40.0, 3.0]


@pytest.mark.parametrize("planner", ["ompl_rrt_connect", "roadmap"])
def test_other_planners_find_paths_of_wide_turning_joints_early(planner):
    arm = rp.planar_arm("RR", limits=[(-1000.0 * TURN, 1000.0 * TURN), (-2.5, 2.5)])
    scene = rp.Scene().with_arm("arm", arm).with_obstacle("post", rp.Sphere(0.1), [1.2, 0.0, 0.0])
    problem = rp.Problem(scene, [-1.0, 0.0], [1.0, 0.0])
    for seed in range(3):
        assert rp.plan(problem, planner=planner, budget=COUNTED, rng=seed).iterations < 1000


@pytest.mark.parametrize("planner", ["rrt_connect", "anytime", "roadmap", "ompl_rrt_connect", "rrt", "prm", "fmt"])
def test_a_pose_is_reached_a_turn_away_where_limits_allow_it(planner, is_certified):
    """The nearest solutions of inverse kinematics are behind the post."""
    arm = rp.planar_arm("RR", limits=[(-0.99 * TURN, 0.99 * TURN)] * 2)
    scene = rp.Scene().with_arm("arm", arm).with_obstacle("post", rp.Sphere(0.05), [0.3, 0.3, 0.0])
    tip = arm.link_poses([2.0, 0.4])[arm.tool][:3, 3]
    problem = rp.Problem(scene, [0.1, 0.1], rp.PoseGoal("tool", tip))
    result = rp.plan(problem, planner=planner, budget=Budget(5.0, 3000), rng=0)
    assert result.found, result.reason
    assert result.path.waypoints[-1, 0] < -np.pi
    assert is_certified(scene, result.path.waypoints)
    # A configuration is reached as it is.
    there = rp.Problem(scene, [0.1, 0.1], [2.0, 0.4])
    assert rp.plan(there, planner=planner, budget=Budget(5.0, 1000), rng=0).status is PlanStatus.TIMEOUT


@pytest.mark.parametrize("planner", ["rrt_connect", "anytime", "roadmap", "ompl_rrt_connect"])
def test_continuous_joints_keep_limits_that_they_are_given(planner):
    arm = rp.load_robot("planar2r")
    limited = arm.with_limits(replace(arm.limits, lower=[-3.0, -3.0], upper=[3.0, np.inf]))
    assert (arm.continuous.tolist(), limited.continuous.tolist()) == ([1.0, 1.0], [0.0, 0.0])
    with pytest.raises(rp.InputError, match="'arm/joint2' has the limits -3 to inf, expected finite ones"):
        rp.plan(rp.Problem(rp.Scene().with_arm("arm", limited), [0.0, 0.0], [1.0, 0.0]), planner=planner)
    limited = arm.with_limits(replace(arm.limits, lower=[-3.0, -np.inf], upper=[3.0, np.inf]))
    assert limited.continuous.tolist() == [0.0, 1.0]
    motion = rp.plan_motion(
        rp.Problem(rp.Scene().with_arm("arm", limited), [2.8, 0.0], [-2.8, 6.0]), planner=planner, rng=0
    )
    assert motion.valid, motion.report
    np.testing.assert_allclose(motion.path.waypoints[-1], [-2.8, 6.0 - TURN], atol=1e-12)
