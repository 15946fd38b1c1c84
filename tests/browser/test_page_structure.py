"""Pages keep their structure: the same parts at the same positions, with the same look, in three window sizes."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from browser import page_structure as structure

from rr1plan.playback.viewer.page_capture import wait_until

pytestmark = pytest.mark.browser

NAMES = tuple(structure.makers())


@pytest.fixture(scope="module", params=NAMES)
def page(request: pytest.FixtureRequest, browser: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """A page, drawn and at rest, and its name."""
    file = tmp_path_factory.mktemp("page") / "page.html"
    structure.makers()[request.param](file)
    page = browser.new_page()
    structure.open_at_rest(page, file)
    yield request.param, page
    page.close()


def test_pages_are_built_as_stored_at_three_sizes(page: Any) -> None:
    name, tab = page
    for size in structure.SIZES:
        structure.resize(tab, size)
        found = structure.structure(tab)
        assert structure.differences(found, structure.stored(name, size)) == [], f"{name} at {size}"


@pytest.mark.parametrize("page", ["cspace"], indirect=True)
def test_what_is_moved_hidden_or_recolored_is_noticed(page: Any) -> None:
    """The comparison can fail: each of these faults is named."""
    name, tab = page
    size = structure.SIZES[-1]
    structure.resize(tab, size)
    stored = structure.stored(name, size)
    faults = {
        "document.querySelector('.verdict').style.display = 'none'": ".panel .verdict 0 is missing",
        "document.getElementById('panels').style.paddingLeft = '220px'": "#panels 0 is at",
        "document.querySelector('.panel .plot').style.visibility = 'hidden'": ".panel .plot 0 is missing",
        "document.querySelector('.panel canvas').style.filter = 'invert(1)'": "colors differ",
        "document.querySelector('#pane canvas').style.visibility = 'hidden'": "colors differ",
    }
    keep = "window.before = [...document.querySelectorAll('*')].map((node) => [node, node.style.cssText]), 0"
    restore = "window.before.forEach(([node, style]) => (node.style.cssText = style)), 0"
    for fault, words in faults.items():
        tab.evaluate(keep)
        tab.evaluate(fault)
        frames = tab.evaluate("RR1.frames")
        wait_until(tab, f"RR1.frames > {frames} + 2")
        found = structure.differences(structure.structure(tab), stored)
        assert any(words in word for word in found), (fault, found)
        tab.evaluate(restore)
    frames = tab.evaluate("RR1.frames")
    wait_until(tab, f"RR1.frames > {frames} + 2")


def test_small_differences_of_machines_do_not_count() -> None:
    """A font that is a little wider, and lines that are drawn a little otherwise."""
    stored = structure.stored("cspace", (800, 600))
    found: Any = copy.deepcopy(json.loads(json.dumps(stored)))
    for box in found["boxes"].values():
        box[2] += 0.03
    found["colors"] = [[[v + 6 for v in field] for field in row] for row in found["colors"]]
    found["detail"][0][0] += 90
    assert structure.differences(found, stored) == []


def test_every_page_is_stored() -> None:
    assert sorted(file.stem for file in structure.FOLDER.glob("*.json")) == sorted(NAMES)
    assert all(file.stat().st_size < 10_000 for file in Path(structure.FOLDER).glob("*.json"))
