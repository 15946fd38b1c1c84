"""Search trees as drawn: the tree of each edge, and their order by distance along the tree."""

from __future__ import annotations

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.planning import SearchTree
from rr1plan.playback.search_trees import DrawnTree, drawn_tree

START, GOAL = np.array([0.0, 0.0]), np.array([5.0, 5.0])


def tree_of(vertices: list[list[float]], edges: list[list[int]]) -> SearchTree:
    return SearchTree(np.array(vertices), np.array(edges, dtype=np.int64).reshape(-1, 2))


@pytest.mark.parametrize(
    ("vertices", "edges", "words"),
    [
        ([[0.0, np.nan]], [[0, 0]], r"vertices of the tree\[0, 1\] is nan"),
        ([0.0, 1.0], [[0, 0]], "vertices of the tree has shape"),
        ([[0.0, 1.0]], [0, 0], "edges of the tree has shape"),
        ([[0.0, 1.0]], [[0, 9]], "has the vertex 9, expected 0 to 0"),
        ([[0.0, 1.0]], [[0, -1]], "has the vertex -1"),
        ([[0.0, 1.0]], [[0, 0.5]], "has the vertex 0.5"),
    ],
)
def test_a_tree_that_is_none_is_refused(vertices: list[float], edges: list[int], words: str) -> None:
    with pytest.raises(rp.InputError, match=words):
        SearchTree(np.array(vertices), np.array(edges))


def drawn_edges(drawn: DrawnTree) -> list[list[list[float]]]:
    """The ends of the drawn edges, in the order in which they are drawn."""
    return [drawn.vertices[edge].tolist() for edge in drawn.edges]


def test_each_edge_is_its_roots_and_nearer_ones_come_first() -> None:
    tree = tree_of([[0, 0], [1, 0], [1, 1], [5, 5], [5, 6.5]], [[3, 4], [1, 2], [0, 1]])
    drawn = drawn_tree(tree, START, (GOAL,))
    assert drawn_edges(drawn) == [[[0, 0], [1, 0]], [[5, 5], [5, 6.5]], [[1, 0], [1, 1]]]
    assert drawn.sides.tolist() == [0, 1, 0]


def test_the_last_edge_joins_two_trees_and_makes_them_no_one_tree() -> None:
    tree = tree_of([[0, 0], [1, 0], [5, 5], [3, 5], [3, 6.5]], [[0, 1], [2, 3], [3, 4], [1, 3]])
    drawn = drawn_tree(tree, START, (GOAL,))
    # The far end of the edge between the trees is as near to the goal's root as that of the second edge.
    assert drawn_edges(drawn) == [[[0, 0], [1, 0]], [[5, 5], [3, 5]], [[1, 0], [3, 5]], [[3, 5], [3, 6.5]]]
    assert drawn.sides.tolist() == [0, 1, 0, 1]


def test_a_goal_is_the_same_a_turn_farther_and_may_be_there_twice() -> None:
    turn = 2.0 * np.pi
    tree = tree_of([[0, 0], [5 - turn, 5], [5, 5 + turn], [4, 5]], [[2, 3], [0, 1]])
    drawn = drawn_tree(tree, START, (GOAL,))
    assert {str(ends): side for ends, side in zip(drawn_edges(drawn), drawn.sides.tolist(), strict=True)} == {
        str(tree.vertices[[2, 3]].tolist()): 1,
        str(tree.vertices[[0, 1]].tolist()): 0,
    }


def test_a_tree_that_hangs_on_no_known_root_begins_at_its_first_vertex() -> None:
    drawn = drawn_tree(tree_of([[1, 0], [2, 0], [2, 3]], [[2, 1], [1, 0]]), None, ())
    assert drawn_edges(drawn) == [[[2, 0], [1, 0]], [[2, 3], [2, 0]]]
    assert drawn.sides.tolist() == [1, 1]


@pytest.mark.parametrize(
    "planner",
    [rp.RrtConnect(tree=True), rp.OmplPlanner("ompl_rrt_connect", tree=True), rp.OmplPlanner("rrt", tree=True)],
    ids=["rrt_connect", "ompl_rrt_connect", "rrt"],
)
def test_a_planners_trees_hang_together_as_they_grow(planner: rp.Planner) -> None:
    """In order of their distance along the tree, edges start at its root or at an earlier edge."""
    problem = rp.load_problems("planar2r_path")["over_the_seam"]
    tree = planner.plan(problem, budget=rp.Budget(iterations=20000), rng=3).tree
    assert tree is not None
    goals = [goal.q for goal in problem.goal["arm"]]
    drawn = drawn_tree(tree, problem.start, goals, len(tree.edges))
    assert len(drawn.edges) == len(tree.edges)
    seen: dict[int, set[int]] = {0: set(), 1: set()}
    new_roots = 0
    for edge, side in zip(drawn.edges.tolist(), drawn.sides.tolist(), strict=True):
        ends = set(edge)
        new_roots += not ends & (seen[0] | seen[1])
        seen[side] |= ends
    roots = [q for q in tree.vertices if min(np.abs(np.sin((q - r) / 2)).max() for r in (problem.start, *goals)) < 1e-6]
    assert new_roots <= len(roots)


def a_big_tree(count: int, seed: int = 0) -> SearchTree:
    """Vertices near START, each joined to one before it, in a random direction of the edge."""
    rng = np.random.default_rng(seed)
    parents = np.array([rng.integers(max(0, k - 40), k) for k in range(1, count)])
    vertices = np.zeros((count, 2))
    for k, parent in enumerate(parents, 1):
        vertices[k] = vertices[parent] + rng.normal(size=2)
    edges = np.column_stack([parents, np.arange(1, count)])
    swapped = rng.random(count - 1) < 0.5
    edges[swapped] = edges[swapped, ::-1]
    return SearchTree(vertices, rng.permutation(edges))


@pytest.mark.parametrize("most", [400, 1000])
def test_a_huge_tree_is_thinned_to_a_part_of_it_that_hangs_together(most: int) -> None:
    tree = a_big_tree(5000)
    drawn = drawn_tree(tree, START, (), most)
    assert drawn.explored == 4999
    assert 0.1 * most < len(drawn.edges) <= most
    known = {frozenset(map(tuple, tree.vertices[edge].tolist())) for edge in tree.edges}
    seen = {tuple(START.tolist())}
    for edge in drawn.edges:
        ends = set(map(tuple, drawn.vertices[edge].tolist()))
        assert frozenset(ends) in known
        assert ends & seen, "an edge that begins nowhere"
        seen |= ends
    # It still reaches as far as the complete tree.
    span = np.ptp(tree.vertices, axis=0)
    assert (np.ptp(drawn.vertices, axis=0) > 0.75 * span).all()


def test_a_small_tree_is_drawn_whole() -> None:
    tree = tree_of([[0, 0], [1, 0], [1, 1], [5, 5], [5, 8]], [[1, 2], [0, 1], [3, 4]])
    drawn = drawn_tree(tree, START, (GOAL,))
    assert drawn.explored == len(drawn.edges) == 3
    assert drawn.sides.tolist() == [0, 0, 1]
    np.testing.assert_allclose(drawn.vertices[drawn.edges[0]], [[0, 0], [1, 0]])
