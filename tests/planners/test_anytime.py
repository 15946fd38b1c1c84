"""The anytime planner: properties beyond the contract of all planners."""

from __future__ import annotations

import time
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rr1plan as rp
from rr1plan.collision import CollisionChecker
from rr1plan.errors import InputError
from rr1plan.kernels.planner_kernels import CStruct, address_of, load_library
from rr1plan.kernels.random_state import random_state
from rr1plan.planners import AnytimePlanner, RrtConnect
from rr1plan.planners.anytime import luby
from rr1plan.planners.tree_search import Trees
from rr1plan.planning import Budget, PlanStatus
from rr1plan.scene.model_library import load_problems

COUNTED = Budget(seconds=float("inf"), iterations=3000)


@pytest.fixture(scope="module")
def shelf():
    """Around a board, to one configuration."""
    problem = load_problems("rr1_shelf")["upper_right"]
    end = RrtConnect().plan(problem, budget=COUNTED, rng=0).path.waypoints[-1]
    return rp.Problem(problem.scene, problem.start, end)


@pytest.fixture(scope="module")
def seam():
    return load_problems("planar2r_path")["over_the_seam"]


def trees_of(vertices):
    """A struct of two trees with these vertices, one a column, shape (2, nq, capacity); they have to be kept alive."""
    trees = CStruct("Trees", column_count=vertices.shape[1], capacity=vertices.shape[2])
    for side, tree in enumerate(trees.value.sides):
        tree.vertices = address_of(vertices[side], "double")
    return trees


def drawn(ends, bound, state, lower, extent, q):
    """Whether a sample of the ellipsoid between the first vertices of two trees, written to q, is in the box."""
    draw = load_library().rr1_draw_in_ellipsoid
    return bool(draw(trees_of(ends), 0, bound, state, lower, extent, np.zeros(len(q)), q))


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32), st.integers(1, 300), st.integers(1, 9), st.floats(0.0, 9.0))
def test_the_nearest_vertex_in_time_is_that_of_all_distances(seed, count, nq, most):
    rng = np.random.default_rng(seed)
    tree, lengths, q = 3 * rng.normal(size=(nq, count + 5)), rng.uniform(0.0, 5.0, count + 5), 3 * rng.normal(size=nq)
    turns = np.where(rng.random(nq) < 0.5, 2 * np.pi, 0.0)
    trees, near = trees_of(np.stack([tree, tree])), np.empty(1)
    side = trees.value.sides[0]
    side.vertices, side.lengths, side.size = address_of(tree, "double"), address_of(lengths, "double"), count
    index = load_library().rr1_nearest_vertex(trees, 0, q, most, turns, near)
    distance = near[0]
    away = tree[:, :count] - q[:, None]
    away = np.where(turns[:, None] > 0.0, np.angle(np.exp(1j * away)), away)
    distances = np.linalg.norm(away, axis=0)
    distances[lengths[:count] + distances > most] = np.inf
    assert distance == pytest.approx(distances.min(), rel=1e-12)
    assert index == (np.argmin(distances) if np.isfinite(distances.min()) else -1)


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**32), st.integers(1, 12), st.floats(1.001, 4.0))
def test_samples_lie_where_a_path_within_the_bound_may_pass_and_all_around(seed, nq, detour):
    rng = np.random.default_rng(seed)
    ends = np.zeros((2, nq, 4))
    ends[:, :, 0] = rng.normal(size=(2, nq))
    start, goal = ends[:, :, 0]
    bound = detour * np.linalg.norm(goal - start)
    lower, extent = np.minimum(start, goal) - 9.0 * bound, np.abs(goal - start) + 18.0 * bound
    state, q, found = random_state(seed), np.empty(nq), []
    for _ in range(300):
        assert drawn(ends, bound, state, lower, extent, q)
        found.append(q.copy())
    found = np.array(found)
    lengths = np.linalg.norm(found - start, axis=1) + np.linalg.norm(found - goal, axis=1)
    assert lengths.max() <= bound * (1.0 + 1e-12)
    # Both ends of the ellipsoid, beyond the foci or not, have some.
    axis = (goal - start) / np.linalg.norm(goal - start)
    along = (found - 0.5 * (start + goal)) @ axis
    assert along.min() < -0.2 * bound / nq
    assert along.max() > 0.2 * bound / nq


def test_samples_out_of_limits_or_without_a_way_are_none():
    ends = np.zeros((2, 2, 4))
    ends[1, 0, 0] = 1.0
    state, q = random_state(0), np.empty(2)
    narrow = np.array([-9.0, 5.0]), np.array([18.0, 1.0])
    assert not any(drawn(ends, 2.0, state, *narrow, q) for _ in range(50))
    wide = np.array([-9.0, -9.0]), np.array([18.0, 18.0])
    assert not drawn(ends, 1.0, state, *wide, q)


def test_a_joint_without_play_keeps_its_value_to_the_bit():
    ends = np.zeros((2, 3, 4))
    ends[1, 0, 0], ends[:, 1, 0] = 1.0, 0.1
    state, q = random_state(0), np.empty(3)
    lower, extent = np.array([-9.0, 0.1, -9.0]), np.array([18.0, 0.0, 18.0])
    for _ in range(50):
        assert drawn(ends, 2.0, state, lower, extent, q)
        assert q[1] == 0.1


def test_trees_under_a_bound_meet_within_it(shelf):
    trees = Trees(shelf.start, np.array([shelf.goal[shelf.arms[0]][0].q]))
    limits = shelf.scene.limits(shelf.arms)
    motion = CollisionChecker(shelf.scene, shelf.arms)
    bound = 1.15 * AnytimePlanner().plan(shelf, budget=COUNTED, rng=0).path.length
    box = limits.lower, limits.upper - limits.lower
    met = 0
    for seed in range(20):
        trees.restart(*box, 0.6, 2.0, bound)
        if not trees.grow(random_state(seed), 800, motion):
            continue
        met += 1
        path = trees.path()
        assert np.linalg.norm(np.diff(path, axis=0), axis=1).sum() <= bound * (1.0 + 1e-12)
        assert all(motion.edge_is_free_slowly(a, b) for a, b in pairwise(path))
    assert met >= 5


def test_each_vertex_has_the_length_of_its_path(shelf):
    trees = Trees(shelf.start, np.array([shelf.goal[shelf.arms[0]][0].q]))
    limits = shelf.scene.limits(shelf.arms)
    motion, memory = CollisionChecker(shelf.scene, shelf.arms), trees.memory
    trees.restart(limits.lower, limits.upper - limits.lower, 0.5, 2.0, 7.0)
    trees.grow(random_state(1), 600, motion)
    for side, size in enumerate(trees.sizes):
        assert size > 2
        for i in range(1, size):
            parent = memory.parents[side, i]
            edge = np.linalg.norm(memory.vertices[side, :, i] - memory.vertices[side, :, parent])
            assert edge <= 0.5 + 1e-12
            assert memory.lengths[side, i] == pytest.approx(memory.lengths[side, parent] + edge, abs=1e-9)


def test_neither_chunks_nor_room_change_the_path(shelf, monkeypatch):
    first = AnytimePlanner().plan(shelf, budget=COUNTED, rng=4)
    monkeypatch.setattr("rr1plan.planners.planning_query._CHUNK", 1)
    monkeypatch.setattr("rr1plan.planners.planning_query._LEAST", 0.0)
    monkeypatch.setattr("rr1plan.planners.tree_search._CAPACITY", 2)
    again = AnytimePlanner().plan(shelf, budget=COUNTED, rng=4)
    assert first.path.waypoints.tobytes() == again.path.waypoints.tobytes()
    assert (first.iterations, first.edges_checked) == (again.iterations, again.edges_checked)


def test_the_path_gets_shorter_while_the_budget_lasts(shelf):
    costs = [AnytimePlanner().plan(shelf, budget=Budget(float("inf"), n), rng=2).path.length for n in (300, 3000)]
    result = AnytimePlanner().plan(shelf, budget=Budget(float("inf"), 10000), rng=2)
    history = np.array(result.cost_history)
    assert costs[0] > costs[1] >= result.path.length == history[-1, 1]
    assert result.iterations == 10000
    assert (np.diff(history, axis=0) * [1.0, -1.0] > 0.0).all()


def test_it_comes_as_near_to_the_shortest_path_as_another_optimal_planner_does(seam):
    ours = AnytimePlanner().plan(seam, budget=COUNTED, rng=1).path.length
    others = [rp.plan(seam, planner=name, budget=COUNTED, rng=1).path.length for name in ("rrt_star", "bit_star")]
    assert ours <= 1.005 * min(others)


def test_the_nearest_goal_by_way_of_the_path_is_taken(shelf):
    far = shelf.goal[shelf.arms[0]][0]
    near = rp.JointGoal(shelf.start + 0.02)
    result = AnytimePlanner().plan(rp.Problem(shelf.scene, shelf.start, [far, near]), budget=COUNTED, rng=0)
    assert result.path.waypoints[-1].tobytes() == np.asarray(near.q).tobytes()
    assert result.iterations == 0


@pytest.mark.parametrize("seed", range(3))
def test_nearer_configurations_of_a_position_are_found_after_the_first_path(seed):
    """A straight line to one configuration that reaches a position ends no search for nearer ones."""
    problem = load_problems("rr1_cluttered")["into_the_rack"]
    result = AnytimePlanner().plan(problem, budget=Budget(seconds=float("inf"), iterations=10_000), rng=seed)
    assert result.cost_history[0][1] > 1.7
    assert result.path.length < 1.5
    assert result.path.length == result.cost_history[-1][1]


def test_the_clock_is_kept_with_a_path_and_without(shelf):
    for problem, status in (
        (load_problems("planar2r_no_path")["no_way"], PlanStatus.TIMEOUT),
        (shelf, PlanStatus.FOUND),
    ):
        began = time.perf_counter()
        result = AnytimePlanner().plan(problem, budget=Budget(seconds=0.2), rng=0)
        assert result.status is status
        assert 0.2 <= time.perf_counter() - began < 5.0


def test_progress_tells_the_best_length_and_may_cancel(shelf):
    told = []

    def progress(p):
        told.append(p)
        return len(told) < 3

    result = AnytimePlanner().plan(shelf, budget=Budget(seconds=20.0), rng=0, progress=progress)
    assert result.status is PlanStatus.CANCELLED
    assert [p.stage for p in told] == ["anytime"] * 3
    assert told[0].best_cost is None
    assert told[1].best_cost >= told[2].best_cost > 0.0


@pytest.mark.parametrize("wrong", [-1.0, float("nan"), 1e-9])
def test_a_senseless_range_is_refused(shelf, wrong):
    with pytest.raises(InputError, match="range"):
        AnytimePlanner(range=wrong).plan(shelf, budget=COUNTED, rng=0)


def test_the_numbers_of_samples_are_lubys_sequence():
    terms = [1]
    while len(terms) < 1000:
        terms += [*terms, 2 * terms[-1]]
    assert [luby(i + 1) for i in range(1000)] == terms[:1000]
