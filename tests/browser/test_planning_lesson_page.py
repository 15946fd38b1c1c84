"""The page of the lesson about planners: the state of a search after each step, controls and keys."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.lessons.planning_lesson import COLORS, PlanningLesson
from rr1plan.playback.viewer.page_capture import wait_until

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def lesson() -> PlanningLesson:
    made = rp.lesson("planning")
    assert isinstance(made, PlanningLesson)
    return made


@pytest.fixture(scope="module")
def page_file(lesson: PlanningLesson, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lesson.save_html(tmp_path_factory.mktemp("planning") / "planning.html")


@pytest.fixture
def page(opened: Any) -> Iterator[Any]:
    opened.ask("RR1.search.stop(); RR1.steps.go(1); RR1.steps.go(0); RR1.search.stop()")
    yield opened
    assert opened.complaints == []


def number(page: Any, name: str) -> str:
    return str(page.ask(f"document.querySelector('#panel-search [data-of={name}]').textContent"))


def test_every_search_is_shown_as_it_was_recorded(page: Any, lesson: PlanningLesson) -> None:
    for variant in lesson.variants:
        bias = "null" if variant.bias is None else variant.bias
        page.ask(f"RR1.search.choose({{planner: '{variant.planner}', step: {variant.step}, bias: {bias}}})")
        record = variant.record
        assert page.ask("RR1.search.length") == len(record.steps)
        for at in (1, len(record.steps) // 3, len(record.steps)):
            page.ask(f"RR1.search.go({at})")
            events = [event for step in record.steps[:at] for event in step]
            assert number(page, "vertices") == f"{sum(event.kind == 'vertex' for event in events)}"
            assert number(page, "checks") == f"{record.edges_checked[at - 1]}"
            assert number(page, "rejected") == f"{sum(event.kind in ('refused', 'blocked') for event in events)}"
            cost = record.costs[at - 1]
            assert number(page, "cost") == (f"{cost:.2f} rad" if np.isfinite(cost) else "–")
            parents = {e.vertex: e.parent for e in events if e.kind in ("vertex", "parent") and e.parent >= 0}
            more = {(e.parent, e.vertex) for e in events if e.kind == "edge"}
            expected = {(parent, vertex) for vertex, parent in parents.items()} | more
            assert {tuple(edge) for edge in page.ask("RR1.search.state.edges")} == expected
        if record.path is not None:
            np.testing.assert_allclose(page.ask("RR1.search.state.path"), record.path, atol=1e-4)


def test_the_arm_follows_the_newest_vertex_in_both_views(page: Any, lesson: PlanningLesson) -> None:
    record = lesson.variant("RRT").record
    kinematics = rp.Kinematics(lesson.scene)
    page.ask("RR1.search.choose({planner: 'RRT', step: 0.3, bias: 0.05})")
    page.ask("RR1.search.go(0)")
    np.testing.assert_allclose(page.ask("Array.from(RR1.q)"), lesson.problem.start, atol=1e-5)
    for at in (3, 40, 90):
        page.ask(f"RR1.search.go({at})")
        event = next(e for e in reversed(record.steps[at - 1]) if e.kind in ("vertex", "refused"))
        q = record.vertices[event.vertex] if event.kind == "vertex" else event.point
        np.testing.assert_allclose(page.ask("Array.from(RR1.q)"), q, atol=1e-5)
        tools = page.ask("Array.from(RR1.search.clouds.vertices.geometry.attributes.position.array)")
        count = page.ask("RR1.search.state.count")
        expected = kinematics.poses_batch(record.vertices[:count])[:, :3, 3]
        np.testing.assert_allclose(np.reshape(tools, (-1, 3))[:count], expected, atol=1e-5)


def test_keys_and_buttons_walk_the_search(page: Any) -> None:
    page.ask("RR1.search.choose({planner: 'PRM'}); RR1.search.go(10)")
    page.page.locator("#panel-steps h2").click()
    page.page.keyboard.press(".")
    page.page.keyboard.press(".")
    assert page.ask("RR1.search.at") == 12
    page.page.keyboard.press(",")
    assert page.ask("RR1.search.at") == 11
    page.page.locator("#panel-search [data-move='1']").click()
    assert page.ask("RR1.search.at") == 12
    slider = page.page.locator("#panel-search .at")
    slider.focus()
    page.page.keyboard.press("ArrowRight")
    assert page.ask("RR1.search.at") == 13
    assert page.ask("RR1.steps.index") == 0
    name = "document.querySelector('#panel-search .play').textContent"
    assert page.run_until("p", "RR1.search.at > 14", name) == "Pause"
    assert page.page.locator("#panel-search .play").inner_text() == "Grow"
    at = page.ask("RR1.search.at")
    page.next_frames()
    assert page.ask("RR1.search.at") == at


def test_moving_the_arm_stops_the_growth(page: Any) -> None:
    page.ask("RR1.search.choose({planner: 'Dijkstra'}); RR1.search.go(0); RR1.search.play()")
    wait_until(page.page, "RR1.search.at > 3")
    page.ask("RR1.setJoint(0, 1.0)")
    assert page.ask("[RR1.search.playing, RR1.q[0]]") == [0, pytest.approx(1.0)]


def test_sliders_choose_step_and_bias(page: Any, lesson: PlanningLesson) -> None:
    page.page.locator("#panel-search [data-planner=RRT]").click()
    assert page.ask("RR1.search.record.planner") == "RRT"
    for name, of in (("step", "step"), ("bias", "bias")):
        slider = page.page.locator(f"#panel-search .{name}")
        before = page.ask(f"RR1.search.record.{of}")
        slider.focus()
        page.page.keyboard.press("ArrowRight")
        assert page.ask(f"RR1.search.record.{of}") > before
        page.page.keyboard.press("ArrowLeft")
        assert page.ask(f"RR1.search.record.{of}") == before
    page.page.locator("#panel-search [data-planner='A*']").click()
    assert page.page.locator("#panel-search .bias").is_disabled()
    chips = page.ask("[...document.querySelectorAll('[data-planner]')].map((chip) => chip.dataset.planner)")
    assert chips == list(COLORS)


def test_the_trees_are_drawn_in_their_planner_s_color(page: Any) -> None:
    counts = []
    for at in (5, 120, 366):
        page.ask(f"RR1.search.choose({{planner: 'RRT', step: 0.3, bias: 0.05}}); RR1.search.go({at})")
        page.next_frames()
        orange = (np.abs(page.cspace_picture() - np.array([213, 94, 0])) < 30).all(axis=2)
        counts.append(int(orange.sum()))
    assert counts[0] < counts[1] < counts[2]
    assert counts[2] > 300


def test_walking_through_the_steps_keeps_no_graphics_memory(page: Any) -> None:
    used = "(({ geometries, textures }) => [geometries, textures])(RR1.stage.renderer.info.memory)"
    counts = []
    for index in (1, 2, 3, 4, 1, 2):
        page.ask(f"RR1.steps.go({index})")
        page.next_frames()
        counts.append(page.ask(used))
    assert counts[-2:] == counts[:2]


def test_without_a_path_the_race_has_no_lengths(tab: Any, tmp_path: Path) -> None:
    scene = rp.Scene().with_arm("arm", rp.planar_arm("RR", (1.0, 0.7)))
    wall = rp.Cylinder(0.15, 0.2)
    scene = scene.with_obstacle("left", wall, (0.0, 0.6, 0.0)).with_obstacle("right", wall, (0.0, -0.6, 0.0))
    lesson = rp.lesson("planning", problem=rp.Problem(scene, [0.0, 0.3], [3.0, 0.3]))
    lesson.figure()
    tab.record_texts()
    tab.open(lesson.save_html(tmp_path / "none.html"))
    drawn = tab.ask("(texts.length = 0, RR1.search.drawRace(), texts)")
    assert "edges checked" in drawn
    assert not any("." in text for text in drawn)
    assert tab.complaints == []


@pytest.mark.parametrize(("size", "step", "digits"), [(2e-3, "0.000095 m", 6), (50.0, "2.39 m", 2)])
def test_steps_and_lengths_fit_the_size_of_the_arm(
    tab: Any, tmp_path: Path, size: float, step: str, digits: int
) -> None:
    scene = rp.Scene().with_arm("arm", rp.planar_arm("PP", (size, 0.8 * size)))
    scene = scene.with_obstacle("disc", rp.Cylinder(0.2 * size, 0.2 * size), (0.5 * size, 0.4 * size, 0.0))
    problem = rp.Problem(scene, (0.1 * size, 0.4 * size), (0.9 * size, 0.4 * size))
    lesson: Any = rp.lesson("planning", problem=problem)
    lesson.figure()
    cost = lesson.variant("RRT").record.cost
    assert 1.0 < cost / np.hypot(0.8 * size, 0.2 * size) < 4.0
    assert f"a path of {cost:.{digits}f} m" in str(lesson.steps)
    tab.record_texts()
    tab.open(lesson.save_html(tmp_path / "a.html"))
    tab.ask("RR1.steps.go(3)")
    assert tab.page.locator("#panel-search .step + output").inner_text() == step
    assert number(tab, "cost") == f"{cost:.{digits}f} m"
    assert 5 < int(number(tab, "vertices")) < 500
    low, top = (float(text) for text in tab.ask("(texts.length = 0, RR1.search.drawRace(), texts)") if "." in text)
    assert 0.8 * size < low < top < 4.0 * size
    np.testing.assert_allclose(tab.ask("RR1.search.state.path"), lesson.variant("RRT").record.path, atol=1e-4 * size)
    assert tab.complaints == []
