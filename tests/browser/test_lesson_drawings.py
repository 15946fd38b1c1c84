"""Drawings of the lessons about the configuration space: regions of the workspace, certified cells."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.lessons.workspace_lesson import WorkspaceLesson, solution_counts
from rr1plan.model.flat_arm import flat_arm
from rr1plan.playback.viewer.page_capture import wait_until

pytestmark = pytest.mark.browser

READY = "Boolean(window.RR1 && RR1.ready && RR1.steps)"


def go_to(tab: Any, name: str) -> None:
    wait_until(tab.page, "RR1.frames > 2")
    for _ in range(12):
        if tab.ask("RR1.steps.name") == name:
            return
        tab.page.keyboard.press("ArrowRight")
    raise AssertionError(f"there is no step {name}")


def test_the_page_counts_solutions_as_python_does(tab: Any, tmp_path: Path) -> None:
    lesson = rp.lesson("workspace")
    assert isinstance(lesson, WorkspaceLesson)
    tab.open(lesson.save_html(tmp_path / "a.html"), READY)
    points = np.random.default_rng(5).uniform(-1.75, 1.75, (400, 2))
    for step, ignored in (
        ("solutions", tuple(lesson.picture.grid.layers)),
        ("limits", ("disc", "plate")),
        ("obstacles", ()),
    ):
        go_to(tab, step)
        counts = tab.ask("(points) => RR1.steps.map.counts(points)", points.tolist())
        expected = solution_counts(lesson.picture, lesson.arm, points, ignored)
        assert (np.array(counts) == expected).mean() > 0.99
    assert tab.complaints == []


def test_the_place_of_the_tool_has_digits_for_small_arms(tab: Any, tmp_path: Path) -> None:
    scene = rp.Scene().with_arm("arm", rp.planar_arm("RR", (2e-3, 1.6e-3), width=1e-4))
    tab.open(rp.lesson("workspace", scene).save_html(tmp_path / "a.html"), READY)
    go_to(tab, "solutions")
    tab.ask("RR1.setQ([0, -Math.PI / 2])")
    assert tab.page.locator("#lesson-reach b").inner_text() == "tool at (0.00200, −0.00160) m: in two ways"


@pytest.mark.drawn
def test_regions_are_drawn_and_hidden_again(tab: Any, tmp_path: Path) -> None:
    tab.open(rp.lesson("workspace").save_html(tmp_path / "a.html"), READY)
    plain = tab.bare_picture()
    go_to(tab, "obstacles")
    colored = tab.bare_picture()
    assert (np.abs(plain - colored).max(axis=2) > 25).mean() > 0.1
    assert "in two ways" in tab.page.locator("#lesson-reach b").inner_text()
    tab.ask("RR1.setQ([-1.2, 0.4])")
    assert "not at all" not in tab.page.locator("#lesson-reach b").inner_text()
    for _ in range(3):
        tab.page.keyboard.press("ArrowLeft")
    assert not tab.page.locator("#lesson-reach").is_visible()
    assert tab.complaints == []


def test_the_verdict_is_kept_back_and_cells_prove_it(tab: Any, tmp_path: Path) -> None:
    tab.open(rp.lesson("no_path").save_html(tmp_path / "a.html"), READY)
    verdict = tab.page.locator("#panel-cspace .verdict")
    assert not verdict.is_visible()
    go_to(tab, "components")
    assert verdict.is_visible()
    assert tab.ask("RR1.lesson.tinted")
    go_to(tab, "proof")
    # The pixels stay in the page: as numbers for Python they take seconds.
    pixels = """() => {
        const { canvas } = RR1.lesson.chart;
        return new Uint32Array(canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data.buffer);
    }"""
    tab.ask(f"RR1.setQ([2.5, 2.5]), window.proven = ({pixels})(), 0")
    tab.ask("RR1.steps.reset(), RR1.setQ([2.5, 2.5])")
    changed = f"(plain => plain.filter((pixel, i) => pixel !== window.proven[i]).length / plain.length)(({pixels})())"
    assert 0.3 < tab.ask(changed) < 0.9
    assert tab.complaints == []


@pytest.mark.parametrize("kinds", ["RR", "RP", "PR", "PP"])
def test_arms_that_turn_and_slide_are_dragged_by_the_tool(kinds: str, tab: Any, tmp_path: Path) -> None:
    arm = rp.planar_arm(kinds, (1.0, 0.8))
    scene = rp.Scene(name=kinds).with_arm("arm", arm, rp.transforms.pose([0.1, -0.2, 0.0], rpy=[0.0, 0.0, 0.4]))
    tab.open(rp.lesson("workspace", scene).save_html(tmp_path / "a.html"), READY)
    flat = flat_arm(scene.arms["arm"])
    assert flat is not None
    q = np.random.default_rng(2).uniform(0.05, 0.75, (20, 2))
    places = tab.ask("(qs) => qs.map((q) => RR1.lesson.arm.flat.places(q))", q.tolist())
    np.testing.assert_allclose(places, flat.points(q), atol=1e-9)
    points = flat.points(q)[:, 2]
    found = tab.ask("(points) => points.map(([x, y]) => RR1.lesson.arm.flat.solutions(x, y))", points.tolist())
    for ours, theirs in zip(flat.solutions(points), found, strict=True):
        ours = ours[np.isfinite(ours).all(axis=1)]
        assert len(ours) == len(theirs)
        np.testing.assert_allclose(np.exp(1j * np.array(theirs)), np.exp(1j * ours), atol=1e-6)
    columns = tab.ask("(q) => RR1.lesson.arm.flat.columns(q)", q[0].tolist())
    step = 1e-6 * np.eye(2)
    slopes = [(flat.points(q[0] + d)[2] - flat.points(q[0] - d)[2]) / 2e-6 for d in step]
    np.testing.assert_allclose(columns, slopes, atol=1e-6)

    # A drag of the tool with the mouse from one configuration to the tool's place in another.
    begin, end = np.array([0.3, 0.3]), np.array([0.5, 0.6])
    tab.ask("(q) => RR1.setQ(q)", begin.tolist())
    tab.next_frames()
    pixels = [
        tab.ask(
            """([x, y]) => {
                const { camera, pane } = RR1.stage, box = pane.getBoundingClientRect();
                const at = new RR1.THREE.Vector3(x, RR1.panelData.cspace.planar.height, -y).project(camera);
                return [box.left + (at.x + 1) / 2 * box.width, box.top + (1 - at.y) / 2 * box.height];
            }""",
            flat.points(one)[2].tolist(),
        )
        for one in (begin, end)
    ]
    tab.page.mouse.move(*pixels[0])
    tab.page.mouse.down()
    tab.page.mouse.move(*pixels[1], steps=5)
    tab.page.mouse.up()
    np.testing.assert_allclose(tab.ask("Array.from(RR1.q)"), end, atol=0.03)
    assert tab.complaints == []


def test_the_legend_of_the_slice_of_two_arms_has_the_patterns_of_the_images(tab: Any, tmp_path: Path) -> None:
    tab.open(rp.lesson("two_arms").save_html(tmp_path / "page.html"))
    colors = """() => {
        const { square } = RR1.pair, { pen, plot: { x, y }, unit } = square;
        return [0, 1].map((k) => {
            const side = Math.round(6 * unit);
            const at = [x + 14 * unit - side / 2, y + (16 + 18 * k) * unit - side / 2];
            const { data } = pen.getImageData(...at.map(Math.round), side, side);
            return new Set(new Uint32Array(data.buffer)).size;
        });
    }"""
    first, second = tab.ask(colors)
    assert (first, second > 1) == (1, True)


def test_the_numbers_cover_no_obstacle_on_a_projector(tab: Any, tmp_path: Path) -> None:
    tab.resize(1024, 768)
    tab.open(rp.lesson("workspace").save_html(tmp_path / "a.html"), READY)
    wait_until(tab.page, "RR1.frames > 2")
    tops = tab.ask("""() => {
        const { camera, pane } = RR1.stage;
        return RR1.document.obstacles.map(({ name }) => {
            const { min, max } = RR1.world.boxAround(name);
            const corners = [min, max].flatMap((a) => [min, max].map((b) => [a.x, b.y, max.z]));
            return Math.min(...corners.map(([x, y, z]) => {
                const p = RR1.world.root.localToWorld(new RR1.THREE.Vector3(x, y, z)).project(camera);
                return ((1 - p.y) / 2) * pane.clientHeight;
            }));
        });
    }""")
    bottom = tab.ask("document.querySelector('.readout').getBoundingClientRect().bottom")
    assert len(tops) == 2
    assert min(tops) > bottom > 0
