"""The compiled RRT-Connect: properties beyond the contract of all planners."""

from __future__ import annotations

import pickle
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.collision import CollisionChecker
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.errors import InputError
from rr1plan.planners import RrtConnect, tree_search
from rr1plan.planners.goal_configurations import GoalSearch
from rr1plan.planners.planning_query import Query
from rr1plan.planning import Budget, PlanStatus
from rr1plan.scene.model_library import load_problems
from rr1plan.shapes import Sphere

COUNTED = Budget(seconds=float("inf"), iterations=100_000)


@pytest.fixture(scope="module")
def cage():
    """Into the cage, to one configuration."""
    problem = next(iter(load_problems("rr1_cage").values()))
    end = RrtConnect().plan(problem, budget=COUNTED, rng=0).path.waypoints[-1]
    return rp.Problem(problem.scene, problem.start, end)


def test_neither_chunks_nor_room_change_the_path(cage, monkeypatch):
    first = RrtConnect().plan(cage, budget=COUNTED, rng=4)
    monkeypatch.setattr("rr1plan.planners.planning_query._CHUNK", 1)
    monkeypatch.setattr("rr1plan.planners.planning_query._LEAST", 0.0)
    monkeypatch.setattr("rr1plan.planners.tree_search._CAPACITY", 2)
    again = RrtConnect().plan(cage, budget=COUNTED, rng=4)
    assert len(first.path) > 2
    assert first.path.waypoints.tobytes() == again.path.waypoints.tobytes()
    assert (first.iterations, first.edges_checked) == (again.iterations, again.edges_checked)


def test_ranges_of_a_thousand_turns_are_searched_near_the_start_and_the_goal():
    named = load_problems("rr1_bin")["right_to_left"]
    robot = named.scene.arms["rr1"].robot
    turns = np.array([1000.0, 0.0, 0.0, 1000.0, 0.0, 1000.0]) * 2.0 * np.pi
    limits = robot.limits
    wide = replace(limits, lower=np.minimum(limits.lower, -turns), upper=np.maximum(limits.upper, turns))
    problem = rp.Problem(named.scene.with_robot("rr1", robot.with_limits(wide)), named.start, named.goal)
    # In boxes of a thousand turns these searches take 500 to 2,500 samples.
    samples = [RrtConnect().plan(problem, budget=COUNTED, rng=seed).iterations for seed in range(5)]
    assert max(samples) < 200


def test_a_detour_far_beyond_the_start_and_the_goal_is_found(monkeypatch):
    gantry = rp.planar_arm("PP", limits=[(-40.0, 40.0), (-3.0, 3.0)])
    scene = rp.Scene().with_arm("gantry", gantry).with_obstacle("wall", rp.Box((60.0, 0.2, 0.2)))
    problem = rp.Problem(scene, [0.0, -1.0], [0.0, 1.0])
    result = RrtConnect().plan(problem, budget=COUNTED, rng=0)
    assert abs(result.path.waypoints[:, 0]).max() > 30.0
    # What is searched depends on the samples drawn, not on the clock.
    monkeypatch.setattr("rr1plan.planners.planning_query._CHUNK", 1)
    monkeypatch.setattr("rr1plan.planners.planning_query._LEAST", 0.0)
    again = RrtConnect().plan(problem, budget=COUNTED, rng=0)
    assert again.path.waypoints.tobytes() == result.path.waypoints.tobytes()


def test_every_edge_of_both_trees_is_free_and_short(cage):
    result = RrtConnect(tree=True, range=0.4).plan(cage, budget=COUNTED, rng=2)
    is_free = CollisionChecker(cage.scene).edge_is_free_slowly
    vertices, edges = result.tree.vertices, result.tree.edges
    # Two trees and the edge that joins them are one tree.
    assert len(edges) == len(vertices) - 1
    assert np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1).max() <= 0.4 + 1e-12
    for a, b in edges:
        assert is_free(vertices[a], vertices[b]) or is_free(vertices[b], vertices[a])
    on_path = {row.tobytes() for row in vertices}
    assert all(q.tobytes() in on_path for q in result.path.waypoints)
    assert all(is_free(a, b) for a, b in pairwise(result.path.waypoints))


def test_any_of_several_goals_will_do(cage):
    far = cage.goal[cage.arms[0]][0]
    unreachable = rp.PoseGoal("tool", [9.0, 0.0, 0.0])
    problem = rp.Problem(cage.scene, cage.start, [unreachable, far])
    result = RrtConnect().plan(problem, budget=COUNTED, rng=0)
    assert result.path.waypoints[-1].tobytes() == np.asarray(far.q).tobytes()


def test_the_clock_ends_a_search_without_a_way():
    problem = load_problems("planar2r_no_path")["no_way"]
    began = time.perf_counter()
    result = RrtConnect().plan(problem, budget=Budget(seconds=0.2), rng=0)
    assert result.status is PlanStatus.TIMEOUT
    assert 0.2 <= time.perf_counter() - began < 5.0
    assert "from the start" in result.reason


@pytest.mark.parametrize("wrong", [-1.0, float("nan"), 1e-9])
def test_a_senseless_range_is_refused(cage, wrong):
    with pytest.raises(InputError, match="range"):
        RrtConnect(range=wrong).plan(cage, budget=COUNTED, rng=0)


def test_a_seed_of_any_size_will_do(cage):
    assert RrtConnect().plan(cage, budget=COUNTED, rng=2**70 + 1).seed == 2**70 + 1


def test_checkers_are_lent_to_one_at_a_time_and_used_again(cage):
    scene = cage.scene.with_padding(0.001)
    with checker_from_pool(scene) as one, checker_from_pool(scene) as other:
        assert one is not other
    with checker_from_pool(scene) as again:
        assert again in (one, other)


def test_what_is_kept_with_a_scene_is_not_pickled(cage):
    scene = cage.scene.with_padding(0.001)
    before = len(pickle.dumps(scene))
    with checker_from_pool(scene):
        pass
    assert len(pickle.dumps(scene)) == before
    assert pickle.loads(pickle.dumps(scene)).kept == {}


def shut_in():
    """An arm between two posts, and a region that it hardly reaches from there, though easily from elsewhere."""
    scene = rp.Scene({"arm": rp.Arm(rp.load_robot("planar2r"))})
    for name, angle in (("left", 0.8), ("right", -0.8)):
        scene = scene.with_obstacle(name, Sphere(0.05), [0.6 * np.cos(angle), 0.6 * np.sin(angle), 0.0])
    return rp.Problem(scene, [0.0, 0.0], rp.RegionGoal("tool", [-1.6, -1.6, 0.0], [0.3, -0.9, 0.0]))


@pytest.mark.parametrize("planner", ["rrt_connect", "anytime", "roadmap"])
def test_goals_that_cannot_be_got_to_are_followed_by_others(planner):
    problem = shut_in()
    budget = Budget(seconds=np.inf, iterations=20_000 if planner == "rrt_connect" else 8_000)
    for seed in (0, 1, 3):
        with checker_from_pool(problem.scene) as motion:
            first = GoalSearch(problem, motion, seed).find().configurations
        assert len(first) > 0
        assert (np.abs(np.angle(np.exp(1j * first[:, 0]))) > 0.8).all()
        results = [rp.plan(problem, planner=planner, budget=budget, rng=seed) for _ in range(2)]
        assert results[0].status is PlanStatus.FOUND
        assert abs(results[0].path.waypoints[-1, 0]) < 0.8
        np.testing.assert_array_equal(results[0].path.waypoints, results[1].path.waypoints)
        with checker_from_pool(problem.scene) as motion:
            assert motion.path_is_free(results[0].path.waypoints)


def test_no_end_of_more_goals_has_room(monkeypatch):
    monkeypatch.setattr(tree_search, "_CAPACITY", 4)
    problem = shut_in()
    with Query("rrt_connect", problem, Budget(iterations=100), 0, None) as query:
        assert query.early_exit() is None
        search = tree_search.TreeSearch(query)
        assert not search.connect(samples=5)
        known = {q.tobytes() for q in query.goals}
        for _ in range(5):
            new = query.more_goals()
            assert not known & {q.tobytes() for q in new}
            known |= {q.tobytes() for q in new}
            search.trees.add_goals(new)
            assert (np.diff(np.linalg.norm(query.goals - problem.start, axis=1)) >= 0.0).all()
        assert len(query.goals) == len(known)
        assert roots_of_goals(search.trees) == known
        # Reinitialized trees have them all.
        assert not search.connect(samples=5)
        assert roots_of_goals(search.trees) == known


def roots_of_goals(trees):
    size = trees.sizes[1]
    vertices = np.ascontiguousarray(trees.memory.vertices[1, :, :size].T)
    return {q.tobytes() for q in vertices[trees.memory.parents[1, :size] < 0]}


def test_a_question_within_a_question_spoils_neither(cage):
    """Searches reuse the memory of earlier searches, but never of a running one."""
    alone = rp.plan(cage, budget=COUNTED, rng=3).path.waypoints
    inner = []

    def ask(_):
        inner.append(rp.plan(cage, budget=COUNTED, rng=3).path.waypoints)

    outer = rp.plan(cage, budget=COUNTED, rng=3, progress=ask).path.waypoints
    np.testing.assert_array_equal(outer, alone)
    assert inner
    for found in inner:
        np.testing.assert_array_equal(found, alone)


def test_trees_take_the_memory_of_those_that_are_no_more(cage):
    goals = np.array([cage.goal[cage.arms[0]][0].q])
    one, other = (tree_search.Trees(cage.start, goals) for _ in range(2))
    assert not np.shares_memory(one.memory.vertices, other.memory.vertices)
    before = one.memory.vertices
    del one
    assert np.shares_memory(tree_search.Trees(cage.start, goals).memory.vertices, before)


@pytest.mark.parametrize("planner", ["rrt_connect", "anytime"])
def test_a_search_without_time_has_no_trees_of_an_earlier_one(cage, planner):
    assert rp.plan(cage, budget=COUNTED, rng=0).found
    result = rp.plan(cage, planner=planner, budget=Budget(seconds=1e-9), rng=0)
    assert result.status is PlanStatus.TIMEOUT
    assert "0 configurations were reached from the start, 0 from the goal" in result.reason
    assert result.tree is None or len(result.tree.vertices) == 0


def test_a_tree_of_one_configuration_is_counted_in_the_singular():
    problem = load_problems("rr1_table")["behind_bottle"]
    reason = rp.plan(problem, budget=Budget(seconds=float("inf"), iterations=1), rng=0).reason
    assert "1 configuration was reached from the start, 1 from the goal" in reason


def test_threads_that_plan_at_once_in_one_scene_have_the_answers_of_one(cage):
    """The kernels let other threads run, and share the scene's tables."""

    def answer(seed):
        path = RrtConnect().plan(cage, budget=COUNTED, rng=seed).path_or_raise()
        shorter = rp.shorten(path, cage.scene, rng=seed)
        return path.waypoints.tobytes(), shorter.waypoints.tobytes(), rp.retime(shorter, cage.scene).duration

    expected = [answer(seed) for seed in range(8)]
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(answer, range(8))) == expected
