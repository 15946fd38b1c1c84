"""The planners of lessons: paths that the checker certifies, shortest ones by SciPy, records that can be replayed."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

import rr1plan as rp
from rr1plan.lessons.search.lattice_search import Lattice
from rr1plan.lessons.search.search_space import SearchSpace
from rr1plan.lessons.search.shortcut_steps import record_shortcuts

GROW: dict[str, Callable[..., rp.SearchRecord]] = {
    "RRT": rp.grow_rrt,
    "RRT-Connect": rp.grow_rrt_connect,
    "RRT*": rp.grow_rrt_star,
    "PRM": rp.grow_prm,
}
ALL = {**GROW, "A*": rp.search_lattice, "Dijkstra": lambda problem: rp.search_lattice(problem, weight=0.0)}


@pytest.fixture(scope="module")
def problem() -> rp.Problem:
    return rp.load_problems("planar2r_path")["over_the_seam"]


def limited() -> rp.Problem:
    """Joints with limits, one of which slides."""
    arm = rp.planar_arm("RP", (0.6, 0.8), limits=((-2.0, 2.0), (0.1, 0.8)))
    scene = rp.Scene(name="limited").with_arm("arm", arm, q=(-1.2, 0.5))
    scene = scene.with_obstacle("disc", rp.Cylinder(0.12, 0.1), (1.2, 0.0, 0.0))
    return rp.Problem(scene, [-1.2, 0.6], rp.JointGoal([1.2, 0.6]))


def length(path: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("limits", [False, True], ids=["wraps", "limits"])
def test_paths_are_free_and_join_start_and_goal(name: str, limits: bool, problem: rp.Problem) -> None:
    asked = limited() if limits else problem
    record = ALL[name](asked)
    assert record.planner == name
    assert record.found
    path, checker = record.path, rp.CollisionChecker(asked.scene)
    assert path is not None
    space = SearchSpace(asked)
    np.testing.assert_allclose(path[0], space.start, atol=1e-12)
    np.testing.assert_allclose(space.difference(path[-1], space.goal), 0.0, atol=1e-9)
    assert all(checker.edge_is_free_slowly(a, b) for a, b in pairwise(path))
    assert record.cost == pytest.approx(length(path), abs=1e-9)
    # The steps of a path never go the long way around.
    assert np.abs(np.diff(path, axis=0)).max() <= np.pi
    if limits:
        assert (path >= space.lower).all()
        assert (path <= space.upper).all()


@pytest.mark.parametrize("name", ALL)
def test_a_record_replays_to_its_vertices_edges_and_costs(name: str, problem: rp.Problem) -> None:
    record, space = ALL[name](problem), SearchSpace(problem)
    known: set[int] = set()
    parents: dict[int, int] = {}
    checks, found = 0, 0
    for number, step in enumerate(record.steps):
        for event in step:
            if event.kind == "vertex":
                assert event.vertex == len(known)
                known.add(event.vertex)
                parents[event.vertex] = event.parent
                assert event.parent in known | {-1}
            elif event.kind in ("edge", "parent"):
                assert {event.vertex, event.parent} <= known
                if event.kind == "parent":
                    parents[event.vertex] = event.parent
            elif event.kind == "refused":
                assert not space.edge_is_free(record.vertices[event.vertex], event.point)
            elif event.kind == "blocked":
                assert not space.is_free(event.point)
            found += event.kind == "found"
        assert record.edges_checked[number] >= checks
        checks = record.edges_checked[number]
        best = [length(path) for at, path in record.paths if at <= number]
        assert record.costs[number] == pytest.approx(min(best, default=np.inf))
    assert len(known) == len(record.vertices)
    assert found == len(record.paths)
    assert record.count("found", "vertex") == found + len(known)
    assert (np.diff([length(path) for _, path in record.paths]) < 0.0).all()
    # Every edge of the tree that stands at the end is free.
    edges = [(vertex, parent) for vertex, parent in parents.items() if parent >= 0]
    assert all(space.edge_is_free(record.vertices[a], record.vertices[b]) for a, b in edges)


@pytest.mark.parametrize("cells", [16, 30])
@pytest.mark.parametrize("query", ["over_the_seam", "elbow_flip"])
def test_lattice_paths_are_as_short_as_those_of_scipy(cells: int, query: str) -> None:
    problem = rp.load_problems("planar2r_path")[query]
    space = SearchSpace(problem)
    lattice = Lattice(space, cells)
    points = [space.wrapped(space.start + np.array([i, j]) * lattice.size) for i in range(cells) for j in range(cells)]
    points.append(space.goal)
    place = np.array(points)
    rows, columns, weights = [], [], []
    for a, q in enumerate(place[:-1]):
        near = np.flatnonzero((np.abs(space.difference(q, place)) <= lattice.size * (1 + 1e-9)).all(axis=1))
        for b in near.tolist():
            if a != b and space.checker.edge_is_free(q, q + space.difference(q, place[b])):
                rows.append(a)
                columns.append(b)
                weights.append(float(space.distance(q, place[b])))
    graph = csr_matrix((weights, (rows, columns)), shape=(len(place), len(place)))
    shortest = float(dijkstra(graph, directed=True, indices=0)[-1])
    first, aimed, greedy = (rp.search_lattice(problem, cells=cells, weight=weight) for weight in (0.0, 1.0, 2.0))
    if not np.isfinite(shortest):
        assert not any(record.found for record in (first, aimed, greedy))
        return
    assert first.cost == pytest.approx(shortest, abs=1e-9)
    assert aimed.cost == pytest.approx(shortest, abs=1e-9)
    assert shortest - 1e-9 <= greedy.cost <= 2.0 * shortest
    assert aimed.count("closed") < first.count("closed")


@pytest.mark.parametrize("name", GROW)
def test_the_seed_decides(name: str, problem: rp.Problem) -> None:
    one, same, other = (GROW[name](problem, rng=seed) for seed in (4, 4, 5))
    np.testing.assert_array_equal(one.vertices, same.vertices)
    np.testing.assert_array_equal(one.edges_checked, same.edges_checked)
    assert one.vertices.shape != other.vertices.shape or not np.array_equal(one.vertices, other.vertices)


def test_edges_are_at_most_a_step_long(problem: rp.Problem) -> None:
    space = SearchSpace(problem)
    for step in (0.15, 0.6):
        for grow in (rp.grow_rrt, rp.grow_rrt_connect, rp.grow_rrt_star):
            record = grow(problem, step=step, rng=2)
            pairs = [e for events in record.steps for e in events if e.kind in ("vertex", "parent") and e.parent >= 0]
            spans = [space.distance(record.vertices[e.vertex], record.vertices[e.parent]) for e in pairs]
            assert len(spans) > 20
            assert max(spans) <= step + 1e-9


def test_rewiring_shortens_the_path_after_it_was_found(problem: rp.Problem) -> None:
    record = rp.grow_rrt_star(problem, samples=900, rng=0)
    costs = record.costs[np.isfinite(record.costs)]
    assert record.count("parent") > 100
    assert costs[-1] < 0.95 * costs[0]
    assert costs[-1] < np.median([rp.grow_rrt(problem, rng=seed).cost for seed in range(5)])


def test_bias_is_the_share_of_samples_that_are_the_goal(problem: rp.Problem) -> None:
    for bias in (0.0, 0.5, 1.0):
        record = rp.grow_rrt(problem, goal_bias=bias, samples=150, step=0.05, rng=0)
        goals = [np.array_equal(e.point, [2.55, -0.5]) for step in record.steps for e in step if e.kind == "sample"]
        assert len(goals) == 150
        assert np.mean(goals) == pytest.approx(bias, abs=0.1)


def test_shortcuts_never_lengthen_a_free_path(problem: rp.Problem) -> None:
    raw, checker = rp.grow_rrt_connect(problem, rng=3).path, rp.CollisionChecker(problem.scene)
    assert raw is not None
    tries = record_shortcuts(checker, raw, tries=80, rng=0)
    lengths = [length(raw), *(length(t.path) for t in tries)]
    assert (np.diff(lengths) <= 1e-9).all()
    assert lengths[-1] < 0.8 * lengths[0]
    assert {t.free for t in tries} == {True, False}
    for before, shortcut in pairwise((None, *tries)):
        assert shortcut is not None
        assert shortcut.free == checker.edge_is_free_slowly(shortcut.begin, shortcut.end)
        if before is not None and not shortcut.free:
            assert shortcut.path is before.path
    assert all(checker.edge_is_free_slowly(a, b) for a, b in pairwise(tries[-1].path))
    np.testing.assert_allclose(tries[-1].path[[0, -1]], raw[[0, -1]])


def test_questions_that_the_planners_do_not_take(problem: rp.Problem) -> None:
    scene = problem.scene
    inside = rp.Problem(scene, [0.2, -0.9], rp.JointGoal([1.1, 0.0]))
    with pytest.raises(rp.InputError, match="the goal is not free"):
        rp.grow_rrt(inside)
    somewhere = rp.Problem(scene, [0.2, -0.9], rp.PoseGoal("tool", [-1.25, 0.75, 0.0]))
    with pytest.raises(rp.InputError, match="the goal is a PoseGoal, expected a JointGoal"):
        rp.grow_prm(somewhere)
    with pytest.raises(rp.InputError, match=r"goal_bias is 1\.5, expected 0 to 1"):
        rp.grow_rrt(problem, goal_bias=1.5)
    with pytest.raises(rp.InputError, match="cells"):
        rp.search_lattice(problem, cells=3)
    lost = rp.load_problems("planar2r_no_path")
    record = rp.search_lattice(next(iter(lost.values())))
    assert not record.found
    assert record.path is None
    assert record.cost == np.inf


def test_a_step_that_one_connection_could_not_end_is_refused(problem: rp.Problem) -> None:
    for name in ("RRT", "RRT-Connect", "RRT*"):
        with pytest.raises(rp.InputError, match=r"step is 1e-09, expected at least 0\.001"):
            GROW[name](problem, step=1e-9)


def test_a_roadmap_joins_a_start_and_a_goal_that_are_close() -> None:
    scene = rp.Scene().with_arm("arm", rp.planar_arm("RR"))
    record = rp.grow_prm(rp.Problem(scene, [0.1, 0.2], [1.0, 0.2]), samples=1)
    assert record.cost == pytest.approx(0.9)
    assert record.edges_checked[0] == 1


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("limits", [False, True], ids=["wraps", "limits"])
def test_a_start_that_is_the_goal_has_a_path_of_length_zero(name: str, limits: bool, problem: rp.Problem) -> None:
    asked = limited() if limits else problem
    record = ALL[name](rp.Problem(asked.scene, asked.start, rp.JointGoal(asked.start)))
    assert record.cost == 0.0
    assert record.costs[0] == 0.0 or name in ("A*", "Dijkstra")


@pytest.mark.parametrize("name", ALL)
def test_ends_of_joints_without_limits_may_be_turns_away(name: str) -> None:
    scene = rp.Scene().with_arm("arm", rp.planar_arm("RR", (1.0, 0.7)))
    scene = scene.with_obstacle("disc", rp.Cylinder(0.15, 0.2), (1.0, -0.7, 0.0))
    record = ALL[name](rp.Problem(scene, [0.3, -5.0], rp.JointGoal([9.0, 4.0])))
    assert record.path is not None
    np.testing.assert_allclose(record.path[0], [0.3, -5.0])
    turns = (record.path[-1] - [9.0, 4.0]) / (2.0 * np.pi)
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-9)


@pytest.mark.parametrize("name", ["RRT", "RRT*"])
def test_the_goal_is_one_vertex_of_a_tree(name: str, problem: rp.Problem) -> None:
    for seed in range(20):
        record = GROW[name](problem, samples=200, goal_bias=1.0 if seed == 0 else 0.3, rng=seed)
        space = SearchSpace(problem)
        assert sum(space.is_goal(q) for q in record.vertices) <= 1
        for _, path in record.paths:
            assert np.linalg.norm(np.diff(path, axis=0), axis=1).min() > 1e-9
