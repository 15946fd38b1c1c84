"""Motions side by side on one page: a picture for each, the same camera, one clock."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

import rr1plan as rp

pytestmark = [pytest.mark.browser, pytest.mark.drawn]


@pytest.fixture(scope="module")
def motions(planar2r: rp.Robot) -> tuple[rp.Scene, rp.Trajectory, rp.Trajectory]:
    """Two motions of an arm: half a turn one way, and slower the other way."""
    scene = rp.Scene(name="two motions").with_arm("arm", planar2r)
    scene = scene.with_obstacle("box", rp.Box((0.2, 0.2, 0.2)), [0, 1.2, 0])
    names = scene.joint_names()
    one, other = (
        rp.Trajectory(names, np.array([0.0, end]), np.array([[[0.0, 0.5], [sign * np.pi / end, 0.0]]]))
        for end, sign in ((1.0, 1), (2.0, -1))
    )
    return scene, one, other


@pytest.fixture(scope="module")
def page_file(motions: Any, tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    scene, one, other = motions
    replay = rp.simulate(one, scene, mode="kinematic")
    options = rp.ViewOptions(compare={"slow": other}, side_by_side=True, play=False, view="top")
    return rp.save_html(
        tmp_path_factory.mktemp("page") / "page.html", scene, trajectory=one, replay=replay, options=options
    )


@pytest.fixture
def calm(opened: Any) -> Iterator[Any]:
    opened.resize(960, 640)
    opened.ask("RR1.pause(), RR1.seek(0.5), RR1.setShown('replay', false), RR1.setShown('compare', true)")
    opened.ask("RR1.sideBySide.toggle(true), RR1.look([0, 0, 1])")
    yield opened
    assert opened.complaints == []


def tiles(tab: Any) -> list[dict[str, float]]:
    found: list[dict[str, float]] = tab.ask("RR1.stage.tiles()")
    return found


def labels(tab: Any) -> list[str]:
    return list(tab.page.locator("#tiles b").all_inner_texts())


def test_a_key_and_a_chip_switch_between_both_ways(calm: Any) -> None:
    chip = calm.page.locator("[data-layer=sidebyside]")
    assert labels(calm) == ["Plan, 1.00 s", "slow, 2.00 s"]
    assert chip.get_attribute("aria-pressed") == "true"
    ghost = "RR1.world.followers.compare.bodies.group.visible"
    assert not calm.ask(ghost)
    calm.page.keyboard.press("v")
    assert chip.get_attribute("aria-pressed") == "false"
    assert labels(calm) == []
    assert calm.ask(f"{ghost} && RR1.world.layers.compare.visible")
    assert len(tiles(calm)) == 1
    chip.click()
    assert len(tiles(calm)) == 2


def test_each_tile_shows_its_own_motion_with_the_same_camera(calm: Any, motions: Any) -> None:
    _, _, other = motions
    for layer in ("toolpath", "compare"):
        calm.ask(
            "layer => RR1.world.layers[layer].traverse((o) => { if (o.isLine || o.isMesh) o.visible = false; })", layer
        )
    calm.ask("document.body.classList.add('bare'), RR1.look([0, 0, 1])")
    first = calm.picture()
    calm.ask("q => RR1.setQ(q)", other(0.5).tolist())
    second = calm.picture()
    calm.ask("document.body.classList.remove('bare')")
    half = first.shape[1] // 2
    left, right, moved = first[:540, : half - 2], first[:540, half + 2 : 2 * half], second[:540, : half - 2]

    def off(a: np.ndarray, b: np.ndarray) -> float:
        return float((np.abs(a - b).max(axis=2) > 40).mean())

    right = right[:, : moved.shape[1]]
    # The rim between the tiles shifts one of the pictures by a pixel or two.
    nearest = min(off(np.roll(right, shift, axis=1)[:, 4:-4], moved[:, 4:-4]) for shift in range(-3, 4))
    assert off(left[:, : right.shape[1]], right) > 0.02
    assert nearest < 0.25 * off(left[:, : right.shape[1]], right)


def test_the_pointer_finds_the_arm_in_the_first_tile(calm: Any) -> None:
    found = calm.ask(
        """() => {
            const [{ name, robot }] = RR1.kinematics.arms, base = RR1.linkPose(`${name}/${robot.links[0]}`);
            const tool = RR1.linkPose(`${name}/${robot.links[robot.tool]}`);
            const middle = new RR1.THREE.Vector3(...[12, 13, 14].map((k) => 0.75 * tool[k] + 0.25 * base[k]));
            const at = RR1.editing.picker.project(middle), box = RR1.stage.pane.getBoundingClientRect();
            const hit = RR1.editing.picker.at({ clientX: at.x, clientY: at.y });
            return [at.x - box.left, RR1.stage.tiles()[0].width, hit && hit.element];
        }"""
    )
    assert 0 < found[0] < found[1]


def test_a_tall_window_has_one_below_the_other(calm: Any) -> None:
    calm.resize(390, 844)
    one, other = tiles(calm)
    assert one["width"] == other["width"] == 390
    assert other["top"] == one["height"] > 400
    calm.next_frames()
    for box in calm.page.locator("#tiles b").all():
        place = box.bounding_box()
        assert place["x"] >= 0
        assert place["x"] + place["width"] <= 390


def test_a_motion_that_is_hidden_has_no_tile(calm: Any) -> None:
    calm.ask("RR1.setShown('replay', true)")
    assert labels(calm) == ["Plan, 1.00 s", "Simulated", "slow, 2.00 s"]
    calm.next_frames()
    calm.page.click("[data-layer=compare]")
    assert labels(calm) == ["Plan, 1.00 s", "Simulated"]
    calm.page.click("[data-layer=replay]")
    assert labels(calm) == []
    calm.page.keyboard.press("v")
    calm.page.keyboard.press("v")
    assert len(labels(calm)) == 3  # all of them, where all were hidden


def test_contacts_of_the_replay_are_red_in_its_tile_alone(calm: Any) -> None:
    red = calm.ask(
        """() => {
            RR1.conflicts.now = [{ elements: ["arm/tool"], simulated: true }, { elements: ["box"] }];
            const found = [null, "plan", "replay", "compare"].map((kind) => RR1.conflicts.elements(kind));
            RR1.conflicts.now = [];
            return found;
        }"""
    )
    assert red == [["arm/tool", "box"], ["box"], ["arm/tool"], []]


def test_a_page_of_one_motion_has_nothing_to_show_beside_it(tab: Any, motions: Any, tmp_path: FilePath) -> None:
    scene, one, _ = motions
    options = rp.ViewOptions(side_by_side=True, play=False)
    tab.open(rp.save_html(tmp_path / "page.html", scene, trajectory=one, options=options))
    assert tab.page.locator("[data-layer=sidebyside]").count() == 0
    tab.page.keyboard.press("v")
    assert len(tiles(tab)) == 1
    assert tab.complaints == []
