"""What the lessons about the configuration space draw: regions of the workspace, certified cells."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.lessons.workspace_lesson import WorkspaceLesson, solution_counts
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
        ("elbows", tuple(lesson.picture.grid.layers)),
        ("limits", ("disc", "plate")),
        ("obstacles", ()),
    ):
        go_to(tab, step)
        counts = tab.ask("(points) => RR1.steps.map.counts(points)", points.tolist())
        expected = solution_counts(lesson.picture, lesson.arm, points, ignored)
        assert (np.array(counts) == expected).mean() > 0.99
    assert tab.complaints == []


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
    overlay = tab.page.locator("#panel-cspace canvas.overlay")
    assert overlay.is_visible()
    painted = tab.ask(
        """() => {
            const canvas = document.querySelector("canvas.overlay"), { width, height } = canvas;
            const pixels = canvas.getContext("2d").getImageData(0, 0, width, height).data;
            let count = 0;
            for (let k = 3; k < pixels.length; k += 4) if (pixels[k]) count += 1;
            return count / (width * height);
        }"""
    )
    assert 0.3 < painted < 0.9
    tab.page.keyboard.press("ArrowLeft")
    assert not overlay.is_visible()
    assert tab.complaints == []
