"""Potential fields: distances by brute force, waves by SciPy, forces by the textbook's formulas, descents and fills."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

import rr1plan as rp
from rr1plan.lessons.potential_field import (
    MOVES,
    FieldGrid,
    attraction,
    basins,
    descend,
    field_grid,
    fill_minima,
    obstacle_distance,
    reached_share,
    repulsion,
    wave,
)

START, GOAL = (-0.9, -2.6), (2.0, 2.7)


@pytest.fixture(scope="module")
def grid() -> FieldGrid:
    return field_grid(rp.load_scene("planar2r_path"), cells=60)


@pytest.fixture(scope="module")
def total(grid: FieldGrid) -> np.ndarray:
    return attraction(grid, GOAL) + repulsion(obstacle_distance(grid), 0.03, 0.4)


def gantry(*goal: float) -> rp.Problem:
    scene = rp.Scene().with_arm("arm", rp.planar_arm("PP", (2.0, 1.0), width=0.1))
    scene = scene.with_obstacle("wall", rp.Box((0.1, 0.5, 0.2)), (1.0, 0.5, 0.0))
    return rp.Problem(scene, [0.2, 0.5], rp.JointGoal(list(goal)))


def test_blocked_cells_are_those_of_the_checker(grid: FieldGrid) -> None:
    checker = rp.CollisionChecker(rp.load_scene("planar2r_path"))
    assert all(checker.are_free(grid.centers()[grid.free]))
    assert not grid.free.all()


def test_the_distance_to_obstacles_goes_around_the_torus(grid: FieldGrid) -> None:
    centers, blocked = grid.centers(), grid.centers()[~grid.free]
    distance = obstacle_distance(grid)
    for cell in [(0, 0), (59, 3), (30, 59), (17, 40)]:
        delta = (blocked - centers[cell] + np.pi) % (2.0 * np.pi) - np.pi
        assert distance[cell] == pytest.approx(np.linalg.norm(delta, axis=1).min(), abs=1e-9)


def test_potentials_are_those_of_the_textbook(grid: FieldGrid) -> None:
    delta = (grid.centers()[5, 50] - GOAL + np.pi) % (2.0 * np.pi) - np.pi
    assert attraction(grid, GOAL)[5, 50] == pytest.approx(0.5 * delta @ delta)
    assert repulsion([0.0, 0.2, 0.4, 1.0], 0.03, 0.4) == pytest.approx([np.inf, 0.015 * 2.5**2, 0.0, 0.0])
    assert repulsion([0.1], 0.0, 0.4) == 0.0


def test_the_wave_counts_the_steps_of_a_shortest_path(grid: FieldGrid) -> None:
    numbers = np.arange(grid.free.size).reshape(grid.free.shape)
    edges = [
        (numbers[mask], np.roll(numbers, (-a, -b), (0, 1))[mask])
        for a, b in MOVES[:4]
        for mask in [grid.allowed((a, b))]
    ]
    rows, columns = (np.concatenate(part) for part in zip(*edges, strict=True))
    graph = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(grid.free.size,) * 2)
    expected = dijkstra(graph.tocsr(), indices=numbers[grid.cell(GOAL)]).reshape(grid.free.shape)
    np.testing.assert_array_equal(wave(grid, GOAL), np.where(grid.free, expected, np.inf))


def test_a_descent_goes_down_in_free_cells_to_a_minimum(grid: FieldGrid, total: np.ndarray) -> None:
    cells = descend(grid, total, START)
    heights = total[tuple(cells.T)]
    assert (np.diff(heights) < 0.0).all()
    assert grid.free[tuple(cells.T)].all()
    steps = (np.diff(cells, axis=0) + 1) % 60 - 1
    assert set(map(tuple, steps.tolist())) <= set(MOVES)
    i, j = cells[-1]
    around = [total[(i + a) % 60, (j + b) % 60] for a, b in MOVES]
    assert min(around) > total[i, j]
    assert basins(grid, total)[grid.cell(START)] == i * 60 + j
    assert (basins(grid, total) == -1).tolist() == (~grid.free).tolist()


def test_a_wave_has_no_other_minimum_and_a_sum_has(grid: FieldGrid, total: np.ndarray) -> None:
    assert reached_share(grid, wave(grid, GOAL), GOAL) == 1.0
    assert 0.3 < reached_share(grid, total, GOAL) < 0.9


def test_best_first_search_leaves_the_minimum(grid: FieldGrid, total: np.ndarray) -> None:
    filled = fill_minima(grid, total, START, GOAL)
    assert (tuple(filled.cells[0]), tuple(filled.cells[-1])) == (grid.cell(START), grid.cell(GOAL))
    assert len(descend(grid, total, START)) < filled.visited < grid.free.sum()
    for one, two in pairwise(filled.cells.tolist()):
        move = tuple((b - a + 1) % 60 - 1 for a, b in zip(one, two, strict=True))
        assert grid.allowed((move[0], move[1]))[tuple(one)]


def test_without_a_path_the_wave_and_the_search_say_so() -> None:
    scene = gantry(1.7, 0.5).scene.with_obstacle("plate", rp.Box((0.1, 3.0, 0.2)), (1.0, 0.5, 0.0))
    grid = field_grid(scene, cells=40)
    assert np.isinf(wave(grid, [1.7, 0.5])[grid.cell([0.2, 0.5])])
    filled = fill_minima(grid, attraction(grid, [1.7, 0.5]), [0.2, 0.5], [1.7, 0.5])
    assert len(filled.cells) == 0
    assert filled.visited == np.isfinite(wave(grid, [0.2, 0.5])).sum()


def test_a_space_without_obstacles_has_one_minimum() -> None:
    grid = field_grid(rp.Scene().with_arm("arm", rp.planar_arm("RR")), cells=30)
    assert np.isinf(obstacle_distance(grid)).all()
    values = attraction(grid, [1.0, 2.0]) + repulsion(obstacle_distance(grid), 0.1, 0.4)
    assert reached_share(grid, values, [1.0, 2.0]) == 1.0


def test_wrong_questions_are_refused(grid: FieldGrid) -> None:
    with pytest.raises(rp.InputError, match="cells is 5, expected a whole number from 10 to 300"):
        field_grid(rp.load_scene("planar2r_path"), cells=5)
    with pytest.raises(rp.InputError, match="reach is 0"):
        repulsion([1.0], 1.0, 0.0)
    with pytest.raises(rp.InputError, match="outside the joint limits"):
        field_grid(gantry(1.7, 0.5).scene, cells=20).cell([3.0, 0.5])
    with pytest.raises(rp.InputError, match="is about a query; pass problem="):
        rp.lesson("potential_fields", rp.load_scene("planar2r_path"))
    with pytest.raises(rp.InputError, match="the cell of the goal is not free"):
        rp.lesson("potential_fields", problem=gantry(1.0, 0.5))


def test_the_texts_are_about_the_query() -> None:
    lesson: Any = rp.lesson("potential_fields", problem=gantry(1.7, 0.5))
    text = {step.name: step.text for step in lesson.steps}
    assert "torus" not in text["attraction"]
    assert "local minimum" in text["sum"]
    assert lesson._page(rp.ViewOptions())[1][1].data["unit"] == " m"
    near = rp.lesson("potential_fields", problem=gantry(0.4, 0.6))
    assert "It reaches the goal." in str(near.steps)


def test_the_default_distance_of_influence_is_below_that_of_the_goal() -> None:
    cell = rp.Scene().with_arm("arm", rp.planar_arm("PP", (0.5, 0.5)))
    cell = cell.with_obstacle("wall", rp.Box((0.1, 0.2, 0.2)), (0.3, 0.25, 0.0))
    lesson: Any = rp.lesson("potential_fields", problem=rp.Problem(cell, [0.05, 0.25], rp.JointGoal([0.45, 0.25])))
    assert lesson.reach < lesson.distance[lesson.grid.cell(lesson.goal)]
    assert reached_share(lesson.grid, lesson.total, lesson.goal) > 0.4
    data = lesson._page(rp.ViewOptions())[1][1].data
    assert data["usual"][1] in data["reaches"]
    text = {step.name: step.text for step in lesson.steps}
    assert "goal: 0 %" not in text["basins"]


def test_tick_labels_of_the_figure_do_not_overlap() -> None:
    figure = rp.lesson("potential_fields", problem=gantry(1.7, 0.5)).figure()
    figure.draw_without_rendering()
    for axes in figure.axes:
        boxes = [label.get_window_extent() for label in axes.get_xticklabels()]
        assert all(one.x1 < two.x0 for one, two in pairwise(boxes))
