"""The page of the lesson about potential fields computes what Python computes, also for dragged obstacles and goals."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.lessons.potential_field import attraction, descend, fill_minima, reached_share, repulsion
from rr1plan.lessons.potential_fields_lesson import GAIN, PotentialFieldsLesson
from rr1plan.playback.viewer.page_capture import wait_until

pytestmark = pytest.mark.browser

SCENES = {
    "RR": None,
    "PR": rp.Problem(
        rp.Scene()
        .with_arm("arm", rp.planar_arm("PR", (2.0, 0.6), width=0.08))
        .with_obstacle("post", rp.Sphere(0.1), (1.0, 0.5, 0.0)),
        [0.3, 0.9],
        rp.JointGoal([1.7, 2.2]),
    ),
}


@pytest.fixture(scope="module", params=SCENES)
def lesson(request: pytest.FixtureRequest) -> PotentialFieldsLesson:
    made = rp.lesson("potential_fields", problem=SCENES[request.param])
    assert isinstance(made, PotentialFieldsLesson)
    return made


@pytest.fixture(scope="module")
def opened(shared_tab: Any, lesson: PotentialFieldsLesson, tmp_path_factory: pytest.TempPathFactory) -> Any:
    file: Path = lesson.save_html(tmp_path_factory.mktemp("field") / "field.html")
    shared_tab.open(file, "Boolean(window.RR1 && RR1.ready && (RR1.planner || RR1.noPlanner))")
    return shared_tab


@pytest.fixture
def page(opened: Any) -> Iterator[Any]:
    """The page with the query and the numbers that it was made with."""
    opened.ask("RR1.lesson.edits.past.length && RR1.lesson.edits.restore(RR1.lesson.edits.first)")
    wait_until(opened.page, "!RR1.lesson.edits.planning")
    opened.ask("RR1.lesson.edits.past = [], RR1.potential.choose(...RR1.panelData.potential.usual)")
    yield opened
    assert opened.complaints == []


def shown(page: Any, name: str) -> Any:
    return page.ask(f"(({{ potential }}) => potential.{name})(RR1)")


def way(page: Any, lesson: PotentialFieldsLesson) -> list[tuple[int, int]]:
    """The cells of the way, without the goal itself, which the page appends."""
    cells = [lesson.grid.cell(q) for q in shown(page, "way")]
    return cells[:-1] if shown(page, "arrives") else cells


def test_fields_and_descents_are_those_of_python(page: Any, lesson: PotentialFieldsLesson) -> None:
    grid, start = lesson.grid, lesson.problem.start
    assert np.reshape(shown(page, "blocked"), grid.free.shape).tolist() == (~grid.free).astype(int).tolist()
    for mode, values in (("attraction", lesson.attractive), ("sum", lesson.total), ("wave", lesson.wave)):
        page.ask(f"RR1.potential.show('{mode}')")
        found = np.array(page.ask("Array.from(RR1.potential.values, (v) => (v < Infinity ? v : -1))"))
        expected = np.where(np.isfinite(values), values, -1.0)
        np.testing.assert_allclose(found.reshape(grid.free.shape), expected, rtol=1e-7, atol=1e-7)
        assert way(page, lesson) == list(map(tuple, descend(grid, values, start).tolist()))
        assert shown(page, "share") == pytest.approx(reached_share(grid, values, lesson.goal))
    page.ask("RR1.potential.show('fill')")
    filled = fill_minima(grid, lesson.total, start, lesson.goal)
    assert shown(page, "visited") == filled.visited
    assert way(page, lesson) == list(map(tuple, filled.cells.tolist()))


def test_sliders_change_the_field(page: Any, lesson: PotentialFieldsLesson) -> None:
    page.ask("RR1.potential.show('sum')")
    page.ask("(s) => { const x = document.querySelector(s); x.value = x.max; x.oninput(); }", "#panel-potential .reach")
    values = lesson.attractive + repulsion(lesson.distance, GAIN, 0.8)
    assert shown(page, "share") == pytest.approx(reached_share(lesson.grid, values, lesson.goal))


@pytest.mark.parametrize("lesson", ["RR"], indirect=True)
def test_the_field_follows_what_is_dragged(page: Any, lesson: PotentialFieldsLesson) -> None:
    page.ask("RR1.potential.show('attraction')")
    wait_until(page.page, "Boolean(RR1.lesson.live)")
    before = shown(page, "share")
    goal = [-2.0, 2.7]
    page.ask(f"RR1.lesson.edits.remember(), RR1.lesson.edits.moveEnd(0, {goal})")
    page.ask("RR1.lesson.chart.draw()")
    values = attraction(lesson.grid, goal)
    assert shown(page, "share") == pytest.approx(reached_share(lesson.grid, values, goal))
    blocked = page.ask("RR1.potential.blocked.reduce((a, b) => a + b)")
    page.ask("RR1.lesson.edits.moveObstacle('red', 0.9, 1.2)")
    wait_until(page.page, f"(RR1.lesson.chart.draw(), RR1.potential.blocked.reduce((a, b) => a + b)) !== {blocked}")
    assert shown(page, "share") != before


@pytest.mark.parametrize(("size", "reach", "digits"), [(2e-3, "0.000127 m", 6), (50.0, "3.18 m", 2)])
def test_the_field_fits_the_size_of_the_arm(tab: Any, tmp_path: Path, size: float, reach: str, digits: int) -> None:
    scene = rp.Scene().with_arm("arm", rp.planar_arm("PP", (size, 0.8 * size)))
    scene = scene.with_obstacle("disc", rp.Cylinder(0.1 * size, 0.2 * size), (0.5 * size, 0.4 * size, 0.0))
    problem = rp.Problem(scene, (0.05 * size, 0.4 * size), (0.95 * size, 0.4 * size))
    lesson: Any = rp.lesson("potential_fields", problem=problem)
    assert 0.5 < reached_share(lesson.grid, lesson.total, lesson.goal) < 1.0
    tab.open(lesson.save_html(tmp_path / "a.html"))
    tab.ask("RR1.steps.go(2)")
    assert shown(tab, "share") == pytest.approx(reached_share(lesson.grid, lesson.total, lesson.goal))
    assert tab.page.locator("#panel-potential .reach + output").inner_text() == reach
    said = tab.page.locator("#panel-potential .said").inner_text()
    assert f"{tab.ask('RR1.potential.gap'):.{digits}f} m from the goal" in said
    assert tab.complaints == []


def test_a_goal_at_the_upper_limits_is_reached(tab: Any, tmp_path: Path) -> None:
    scene = rp.Scene().with_arm("arm", rp.planar_arm("PP", (1.5, 0.8)))
    scene = scene.with_obstacle("disc", rp.Cylinder(0.1, 0.2), (0.7, 0.4, 0.0))
    lesson: Any = rp.lesson("potential_fields", problem=rp.Problem(scene, [0.0, 0.0], rp.JointGoal([1.5, 0.8])))
    n, m = lesson.grid.free.shape
    assert lesson.grid.cell(lesson.goal) == (n - 1, m - 1)
    tab.open(lesson.save_html(tmp_path / "a.html"))
    tab.ask("RR1.potential.show('wave')")
    assert way(tab, lesson) == list(map(tuple, descend(lesson.grid, lesson.wave, [0.0, 0.0]).tolist()))
    assert shown(tab, "arrives")
    assert tab.complaints == []
