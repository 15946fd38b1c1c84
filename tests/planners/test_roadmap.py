"""Persistent, growing roadmaps: properties beyond the contract of all planners."""

from __future__ import annotations

import copy
import heapq
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rr1plan as rp
from rr1plan.collision import CollisionChecker
from rr1plan.errors import InputError, UnknownNameError
from rr1plan.kernels.planner_kernels import CStruct, load_library
from rr1plan.planners import Roadmap, RoadmapPlanner, RrtConnect
from rr1plan.planning import Budget, PlanStatus
from rr1plan.scene.model_library import load_problems

COUNTED = Budget(seconds=float("inf"), iterations=30_000)


@pytest.fixture(scope="module")
def shelf():
    """Around a board, to one configuration."""
    problem = load_problems("rr1_shelf")["left_to_right"]
    end = RrtConnect().plan(problem, budget=COUNTED, rng=0).path.waypoints[-1]
    return rp.Problem(problem.scene, problem.start, end)


@pytest.fixture(scope="module")
def seam():
    """Both joints turn without end, and the short way leads over half a turn."""
    return load_problems("planar2r_path")["over_the_seam"]


def short_way(problem, difference):
    """Differences of configurations; continuous joints go the short way."""
    endless = problem.scene.arm(problem.arms[0]).robot.continuous > 0.0
    return np.where(endless, difference - 2 * np.pi * np.round(difference / (2 * np.pi)), difference)


def shortest_length(problem, graph, goal):
    """Dijkstra's algorithm along all free edges of a graph that start and goal are joined to."""
    count, nq = graph.vertices.shape
    points = np.vstack([graph.vertices, problem.start, goal])
    most = int(np.ceil(np.e * (1.0 + 1.0 / nq) * np.log(count + 1.0)))
    edges = [*graph.edges.tolist(), (count, count + 1)]
    for end in (count, count + 1):
        distances = np.linalg.norm(short_way(problem, points[:count] - points[end]), axis=1)
        edges += [(end, int(near)) for near in np.argsort(distances, kind="stable")[:most]]
    motion, ways = CollisionChecker(problem.scene, problem.arms), {}
    for a, b in edges:
        step = short_way(problem, points[b] - points[a])
        if motion.edge_is_free_slowly(points[a], points[a] + step):
            ways.setdefault(a, []).append((b, np.linalg.norm(step)))
            ways.setdefault(b, []).append((a, np.linalg.norm(step)))
    heap, done = [(0.0, count)], set()
    while heap:
        length, at = heapq.heappop(heap)
        if at == count + 1:
            return length
        if at not in done:
            done.add(at)
            for to, step in ways.get(at, []):
                heapq.heappush(heap, (length + step, to))
    return None


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32), st.integers(0, 120), st.integers(1, 8), st.integers(1, 20))
def test_the_nearest_few_are_those_of_all_distances_sorted(seed, count, nq, most):
    rng = np.random.default_rng(seed)
    vertices, q = rng.uniform(-np.pi, np.pi, (nq, count + 3)), rng.uniform(-np.pi, np.pi, nq)
    wraps = rng.random(nq) < 0.5
    nearest, distances = np.empty(most, np.int64), np.empty(most)
    graph = CStruct("RoadmapGraph", vertices=vertices, wraps=wraps.view(np.uint8), column_count=nq, capacity=count + 3)
    found = load_library().rr1_find_neighbors(graph, count, q, most, np.empty(count), nearest, distances)
    away = np.abs(vertices[:, :count] - q[:, None])
    away[wraps] = np.minimum(away[wraps], 2 * np.pi - away[wraps])
    expected = np.linalg.norm(away, axis=0)
    order = np.argsort(expected, kind="stable")[:most]
    assert nearest[:found].tolist() == order.tolist()
    np.testing.assert_allclose(distances[:found], expected[order], atol=1e-12)


@pytest.mark.parametrize(("name", "samples"), [("shelf", 150), ("shelf", 400), ("seam", 250)])
def test_the_answer_is_the_shortest_way_along_the_free_edges(name, samples, request):
    problem = request.getfixturevalue(name)
    roadmap = Roadmap(problem.scene, samples=samples)
    expected = shortest_length(problem, roadmap.graph, problem.goal[problem.arms[0]][0].q)
    result = roadmap.plan(problem, rng=0)
    assert result.status is PlanStatus.FOUND
    assert result.iterations == 0
    assert result.path.length == pytest.approx(expected, rel=1e-9)
    # Results cached from the first time do not change it.
    again = roadmap.plan(problem, rng=1)
    assert again.path.waypoints.tobytes() == result.path.waypoints.tobytes()
    assert again.edges_checked < result.edges_checked


@pytest.mark.parametrize("name", ["shelf", "seam"])
@pytest.mark.parametrize("samples", [2, 300])
def test_all_edges_of_a_path_are_free_and_its_ends_are_start_and_goal(name, samples, is_certified, request):
    problem = request.getfixturevalue(name)
    points = Roadmap(problem.scene, samples=samples).plan(problem, budget=COUNTED, rng=2).path.waypoints
    assert points[0].tobytes() == problem.start.tobytes()
    off = short_way(problem, points[-1] - problem.goal[problem.arms[0]][0].q)
    np.testing.assert_allclose(off, 0.0, atol=1e-12)
    assert is_certified(problem.scene, points, problem.arms)


def test_a_path_of_endless_joints_goes_over_half_a_turn_without_a_jump(seam):
    points = Roadmap(seam.scene, samples=300).plan(seam, budget=COUNTED, rng=0).path.waypoints
    steps = np.diff(points, axis=0)
    assert np.abs(points).max() > np.pi
    np.testing.assert_allclose(steps, short_way(seam, steps), atol=1e-12)


def test_a_roadmap_in_pieces_is_the_one_drawn_at_once(shelf):
    pieces = Roadmap(shelf.scene, samples=30)
    few = len(pieces)
    pieces.grow(370)
    whole = Roadmap(shelf.scene, samples=400)
    assert 0 < few <= 30 < len(pieces) == len(whole) == len(whole.graph.vertices) <= 400
    assert pieces.graph.vertices.tobytes() == whole.graph.vertices.tobytes()
    assert pieces.graph.edges.tobytes() == whole.graph.edges.tobytes()
    assert f"{len(whole)} vertices" in repr(whole)


def test_the_same_questions_in_the_same_order_have_the_same_answers(shelf):
    back = rp.Problem(shelf.scene, shelf.goal[shelf.arms[0]][0].q, shelf.start)
    answers = []
    for _ in range(2):
        roadmap = Roadmap(shelf.scene, samples=5)
        answers.append([roadmap.plan(p, budget=COUNTED, rng=3).path.waypoints.tobytes() for p in (shelf, back, shelf)])
    assert answers[0] == answers[1]


def test_what_trees_found_is_learnt_by_a_roadmap_but_not_by_the_planner(seam):
    planner, roadmap = RoadmapPlanner(samples=2), Roadmap(seam.scene, samples=2)
    before, size = planner.plan(seam, budget=COUNTED, rng=4), len(roadmap)
    first, second = (roadmap.plan(seam, budget=COUNTED, rng=4) for _ in range(2))
    assert first.iterations > 0 == second.iterations
    assert len(roadmap) == size + len(first.path.waypoints)
    assert second.path.length <= first.path.length * (1.0 + 1e-9)
    planner.plan(rp.Problem(seam.scene, seam.goal["arm"][0].q, seam.start), budget=COUNTED, rng=5)
    after = planner.plan(seam, budget=COUNTED, rng=4)
    assert after.path.waypoints.tobytes() == before.path.waypoints.tobytes()
    assert after.iterations == before.iterations > 2


def test_a_question_for_another_scene_or_other_arms_is_refused(shelf, seam):
    roadmap = Roadmap(shelf.scene, samples=5)
    with pytest.raises(InputError, match="for rr1"):
        roadmap.plan(seam)
    stone = shelf.scene.with_obstacle("stone", rp.Sphere(0.01), [5.0, 5.0, 5.0])
    with pytest.raises(InputError, match="another scene"):
        roadmap.plan(rp.Problem(stone, shelf.start, shelf.goal))
    with pytest.raises(UnknownNameError, match="nobody"):
        Roadmap(shelf.scene, ["nobody"])
    # The configuration of the arm is not part of the roadmap.
    moved = shelf.scene.with_configuration(shelf.arms[0], shelf.start + 0.01)
    assert roadmap.plan(rp.Problem(moved, shelf.start, shelf.goal), budget=COUNTED, rng=0).status is PlanStatus.FOUND


def test_a_problem_with_a_margin_gets_edges_that_keep_it(shelf):
    roadmap = Roadmap(shelf.scene, samples=300)
    motion = rp.plan_motion(shelf, planner=roadmap, rng=0)
    assert motion.valid
    assert motion.margin > 0.0
    before, tight = len(roadmap), shelf.with_margin(motion.margin)
    checker = CollisionChecker(shelf.scene, shelf.arms, margin=motion.margin)
    assert checker.path_is_free(roadmap.plan(tight, budget=COUNTED, rng=0).path)
    # What queries with a margin learn is not part of the roadmap without.
    assert len(roadmap) == before
    roadmap.grow(50)
    assert roadmap.plan(tight, budget=COUNTED, rng=0).found


def test_a_copy_is_refused_with_the_planner_to_take_instead(seam):
    roadmap = Roadmap(seam.scene, samples=1)
    for use in (copy.copy, pickle.dumps, lambda one: rp.plan_many([seam], planner=one, workers=1)):
        with pytest.raises(InputError, match="use a RoadmapPlanner"):
            use(roadmap)


def test_a_blocked_start_or_goal_is_reported_by_name(seam):
    scene = rp.load_scene("planar2r_path").with_obstacle("stone", rp.Sphere(0.2), [0.9, 0.2, 0])
    roadmap, blocked = Roadmap(scene, samples=5), [0.2, 0.0]
    for start, goal, status in (
        (blocked, [2.55, -0.5], PlanStatus.INVALID_START),
        ([2.55, -0.5], blocked, PlanStatus.INVALID_GOAL),
    ):
        result = roadmap.plan(rp.Problem(scene, start, goal), budget=COUNTED, rng=0)
        assert result.status is status
        assert "stone" in result.reason


@pytest.mark.parametrize("wrong", [0, -3, 2.5, True, "many"])
def test_a_senseless_number_of_samples_is_refused(seam, wrong):
    roadmap = Roadmap(seam.scene, samples=1)
    for ask in (roadmap.grow, lambda n: Roadmap(seam.scene, samples=n), lambda n: RoadmapPlanner(samples=n)):
        with pytest.raises(InputError, match="samples"):
            ask(wrong)


def test_a_scene_without_arms_is_refused():
    with pytest.raises(InputError, match="scene has no arm"):
        Roadmap(rp.Scene())


def test_wide_ranges_of_turning_joints_are_sampled_near_home():
    turns = 1000.0 * 2.0 * np.pi
    arm = rp.planar_arm("RR", limits=[(-turns, turns), (-2.5, 2.5)])
    vertices = rp.Roadmap(rp.Scene().with_arm("arm", arm), samples=200).graph.vertices
    assert abs(vertices[:, 0] - arm.home[0]).max() <= 2.5 * np.pi
