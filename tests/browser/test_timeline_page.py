"""The time line beside a plan of many arms, in a real browser."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import rr1plan as rp

pytestmark = pytest.mark.browser

CANVAS = "#panel-timeline canvas"


@pytest.fixture(scope="module")
def opened(shared_tab: Any, rr1: rp.Robot, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Two arms that swing into each other, one after the other."""
    scene = rp.place_grid(rr1, 1, 2, spacing=0.4)
    start = scene.configuration()
    first, second = np.zeros(len(start)), np.zeros(len(start))
    first[0], second[rr1.nq] = -1.0, 1.0
    positions = np.array([start, start + first])
    coefficients = np.stack([positions, np.array([first, second])], axis=1)
    trajectory = rp.Trajectory(scene.joint_names(), np.array([0.0, 1.0, 2.0]), coefficients)
    report = rp.validate(trajectory, scene)
    line = rp.timeline(trajectory, scene, report=report, waits=[rp.Wait("arm02", 0.0, 1.0, ("arm01",))])
    assert line.conflicts
    file = tmp_path_factory.mktemp("page") / "page.html"
    options = rp.ViewOptions(panels=[line.panel()], play=False)
    rp.save_html(file, scene, trajectory=trajectory, report=report, options=options)
    shared_tab.open(file)
    shared_tab.conflict = line.conflicts[0]
    return shared_tab


def place_of(tab: Any, row: int, time: float) -> dict[str, float]:
    """Where a moment of a row is on the canvas; the line of the clock tells where a moment is."""
    tab.ask(f"RR1.pause(), RR1.seek({time})")
    left = float(tab.ask("parseFloat(document.querySelector('#panel-timeline .now').style.left)"))
    height = float(tab.ask("parseFloat(document.querySelector('#panel-timeline .now').style.height)"))
    return {"x": left, "y": height * (row + 0.5) / 2}


def test_a_click_goes_to_the_moment(opened: Any) -> None:
    place = place_of(opened, 1, 0.5)
    opened.ask("RR1.seek(0)")
    opened.page.click(CANVAS, position=place)
    assert opened.ask("RR1.time") == pytest.approx(0.5, abs=0.02)
    said = opened.ask("document.querySelector('#panel-timeline .said').textContent")
    assert said == "arm02 waits 1.00 s for arm01"
    assert opened.complaints == []


def test_a_click_on_a_cross_paints_what_touches(opened: Any) -> None:
    conflict = opened.conflict
    place = place_of(opened, 0, conflict.time)
    opened.page.click(CANVAS, position=place)
    assert opened.ask("RR1.time") == pytest.approx(conflict.time, abs=1e-6)
    assert set(opened.ask("RR1.touched")) == set(conflict.subject)
    said = opened.ask("document.querySelector('#panel-timeline .said').textContent")
    assert said == conflict.message
    assert opened.complaints == []


def test_a_few_rows_lie_below_the_arms(opened: Any) -> None:
    boxes = "['stage', 'panels'].map((id) => document.getElementById(id).getBoundingClientRect().toJSON())"
    stage, panels = opened.ask(boxes)
    assert stage["bottom"] <= panels["top"] + 0.5
    assert stage["width"] == panels["width"] == opened.page.viewport_size["width"]
    assert panels["bottom"] <= opened.page.viewport_size["height"] + 0.5
