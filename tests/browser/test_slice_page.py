"""Slices of the configuration space of an arm of six joints, which follow obstacles and the other joints."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.playback.cspace.cspace_grid import CSpaceGrid, compute_grid
from rr1plan.playback.viewer.page_capture import wait_until

pytestmark = pytest.mark.browser

READY = "Boolean(window.RR1 && RR1.ready && RR1.lesson)"
JOINTS = ("shoulder_joint", "elbow_joint")
CELLS = 60


@pytest.fixture(scope="module")
def page_file(rr1_table: rp.Scene, tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    picture = rp.cspace(rr1_table, joints=JOINTS, resolution=CELLS)
    return picture.save_html(tmp_path_factory.mktemp("slice") / "slice.html")


@pytest.fixture(scope="module")
def opened(shared_tab: Any, page_file: FilePath) -> Any:
    shared_tab.resize(1100, 700)
    shared_tab.open(page_file, f"{READY} && Boolean(RR1.lesson.live)")
    return shared_tab


@pytest.fixture
def fresh(opened: Any, rr1_table: rp.Scene) -> Iterator[Any]:
    opened.resize(1100, 700)
    opened.ask("RR1.editing.reset(), RR1.editing.open(false)")
    opened.ask("q => RR1.setQ(q)", np.concatenate([arm.q for arm in rr1_table.arms.values()]).tolist())
    opened.ask("document.activeElement.blur()")
    settle(opened)
    yield opened
    assert opened.complaints == []


def settle(tab: Any) -> None:
    wait_until(tab.page, "!RR1.lesson.cutting && !RR1.lesson.live.stale.size")


def check_cells(tab: Any, scene: rp.Scene) -> CSpaceGrid:
    """The cells of the page are those of Python's grid of the scene as the page has it, layer by layer."""
    for name in tab.ask("RR1.planner.obstacles"):
        scene = scene.with_obstacle_at(
            name, np.reshape(tab.ask("n => Array.from(RR1.planner.obstaclePose(n))", name), (4, 4)).T
        )
    scene = scene.with_configuration("rr1", tab.ask("Array.from(RR1.q)"))
    grid = compute_grid(scene, "rr1", JOINTS, CELLS)
    bits = np.array(tab.ask("Array.from(RR1.lesson.cells.bits)")).reshape(grid.free.shape)
    names = tab.ask("RR1.panelData.cspace.layers.map(({ name }) => name)")
    for k, name in enumerate(names):
        expected = grid.layers.get(name, np.zeros_like(grid.free))
        # The page rounds configurations and poses, so that a cell at a rim may be on its other side.
        assert ((bits >> k & 1).astype(bool) != expected).mean() < 1e-3, name
    shown = tab.page.locator("#panel-cspace .verdict").inner_text()
    assert shown.startswith(f"{round(100 * (bits == 0).mean())} % of all configurations are free")
    return grid


def test_a_joint_that_is_not_shown_changes_the_slice(fresh: Any, rr1_table: rp.Scene) -> None:
    before = check_cells(fresh, rr1_table)
    fresh.page.click("#panel-cspace .others summary")
    slider = fresh.page.locator("#panel-cspace .others input").nth(0)
    slider.fill("0.7")
    settle(fresh)
    after = check_cells(fresh, rr1_table)
    assert (before.free != after.free).mean() > 0.02
    # The joints that are shown only move the mark in it.
    fresh.page.locator("#cspace-0").fill("0.4")
    assert fresh.ask("Boolean(RR1.lesson.cutting || RR1.lesson.live.stale.size)") is False
    fresh.page.click("#panel-cspace .others summary")


def test_a_dragged_obstacle_takes_its_image_with_it(fresh: Any, rr1_table: rp.Scene) -> None:
    before = check_cells(fresh, rr1_table)
    x, y = fresh.ask(
        """() => {
            const center = RR1.world.boxAround("crate").getCenter(new RR1.THREE.Vector3());
            const at = RR1.editing.picker.project(center);
            return [at.x, at.y];
        }"""
    )
    pose = fresh.ask("Array.from(RR1.planner.obstaclePose('crate'))")
    fresh.page.mouse.move(x, y)
    fresh.page.mouse.down()
    fresh.page.mouse.move(x + 30, y + 25, steps=4)
    fresh.page.mouse.up()
    settle(fresh)
    assert fresh.ask("Array.from(RR1.planner.obstaclePose('crate'))") != pose
    after = check_cells(fresh, rr1_table)
    assert (before.layers["crate"] != after.layers["crate"]).any()
    fresh.page.keyboard.press("Control+z")
    settle(fresh)
    assert np.array_equal(check_cells(fresh, rr1_table).layers["crate"], before.layers["crate"])


def test_in_a_small_window_the_slice_stays_while_the_arm_is_moved(fresh: Any) -> None:
    for small in ({"width": 800, "height": 600}, {"width": 390, "height": 844}):
        fresh.resize(**small)
        fresh.ask("RR1.editing.open()")
        assert fresh.page.is_visible("#panel-cspace canvas")
        fresh.ask("RR1.editing.open(false)")


def test_without_webassembly_the_slice_stays_and_says_so(tab: Any, page_file: FilePath) -> None:
    tab.page.add_init_script("WebAssembly.validate = () => false")
    tab.open(page_file, READY)
    wait_until(tab.page, "Boolean(RR1.noPlanner)")
    assert "The slice stays as it was saved" in tab.page.locator("#panel-cspace .fixed").inner_text()
    assert tab.page.locator("#panel-cspace .others").is_hidden()
    assert tab.complaints == []


def test_joints_have_their_numbers_in_the_arm(fresh: Any) -> None:
    labels = fresh.page.locator("#panel-cspace .pair.shown label").all_inner_texts()
    assert labels == ["θ₁ shoulder_joint", "θ₃ elbow_joint"]
