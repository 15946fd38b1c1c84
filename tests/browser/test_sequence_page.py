"""A sequence in a real browser: the held block moves with the hand, and a list leads to each stage."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import rr1plan as rp

pytestmark = [pytest.mark.browser, pytest.mark.drawn]


@pytest.fixture(scope="module")
def plan(rr1: rp.Robot) -> rp.SequencePlan:
    """A magenta block in the hand of an RR1, which takes it somewhere and puts it down in the air."""
    scene = rp.Scene(name="carried").with_arm("arm", rr1)
    at = scene.link_poses()["arm/tool"] @ rp.transforms.pose([0.0, 0.0, 0.085])
    scene = scene.with_obstacle("block", rp.Box((0.06, 0.06, 0.06)), at, color=(1.0, 0.0, 1.0, 1.0))
    segments = [rp.Pause(0.2), rp.Attach("block"), rp.FreeMotion("raised"), rp.Detach("block")]
    segments += [rp.FreeMotion("zero", stop=False), rp.FreeMotion("home")]
    plan = rp.plan_sequence(rp.Sequence(scene, segments), rng=0)
    assert plan, plan
    return plan


@pytest.fixture(scope="module")
def opened(shared_tab: Any, plan: rp.SequencePlan, tmp_path_factory: pytest.TempPathFactory) -> Any:
    file = tmp_path_factory.mktemp("page") / "page.html"
    plan.save_html(file, options=rp.ViewOptions(play=False))
    shared_tab.open(file)
    return shared_tab


def magenta(tab: Any) -> np.ndarray:
    """Where pixels of the block are, shape (n, 2)."""
    pixels = tab.bare_picture()
    return np.argwhere((pixels[..., 0] > pixels[..., 1] + 60) & (pixels[..., 2] > pixels[..., 1] + 60))


def test_the_block_is_drawn_in_the_hand_and_stays_where_it_is_put_down(opened: Any, plan: rp.SequencePlan) -> None:
    taken, left = (event.begin for event in plan.events)
    centers = []
    for time in (0.0, 0.5 * (taken + left), left, plan.trajectory.end_time):
        opened.ask(f"RR1.pause(), RR1.seek({time})")
        drawn = np.array(opened.ask("Array.from(RR1.world.bodyPoses)")).reshape(4, 4).T
        np.testing.assert_allclose(drawn, plan.object_poses("block", [time])[0], atol=1e-3)
        if taken <= time <= left:
            tool = np.array(opened.ask("RR1.linkPose('arm/tool')")).reshape(4, 4).T
            np.testing.assert_allclose(np.linalg.inv(tool) @ drawn, rp.transforms.pose([0, 0, 0.085]), atol=1e-3)
        centers.append(magenta(opened).mean(axis=0))
    first, middle, last, end = centers
    assert np.linalg.norm(middle - first) > 20
    assert np.linalg.norm(last - middle) > 20
    assert np.linalg.norm(end - last) < 10
    assert opened.complaints == []


def test_a_click_on_a_stage_goes_to_its_beginning(opened: Any, plan: rp.SequencePlan) -> None:
    rows = "#panel-stages li button"
    assert opened.ask(f"[...document.querySelectorAll('{rows} .label')].map((r) => r.textContent)") == [
        stage.label for stage in plan.stages
    ]
    opened.page.click(f"#panel-stages li:nth-child({len(plan.stages)}) button")
    assert opened.ask("RR1.time") == pytest.approx(plan.stages[-1].begin)
    assert opened.ask(f"[...document.querySelectorAll('{rows}')].map((r) => r.classList.contains('now'))") == [
        *[False] * (len(plan.stages) - 1),
        True,
    ]


def test_segments_that_are_passed_without_a_stop_say_so(opened: Any, plan: rp.SequencePlan) -> None:
    rows = opened.ask(
        "[...document.querySelectorAll('#panel-stages li')].map((row) => Boolean(row.querySelector('.passed')))"
    )
    speeds = [float(np.abs(plan.trajectory(stage.end, 1)).max()) for stage in plan.stages]
    assert rows == [speed > 1e-4 for speed in speeds]
    assert rows.count(True) == 1


def test_the_buttons_stay_in_their_bar_beside_the_list(opened: Any) -> None:
    size = opened.page.viewport_size
    boxes = """() => [...document.querySelectorAll("#bar, #bar > *")].filter((node) => node.checkVisibility())
        .map((node) => node.getBoundingClientRect()).map(({ left, right }) => [left, right])"""
    for width in (800, 840):
        opened.page.set_viewport_size({"width": width, "height": 600})
        (left, right), *parts = opened.ask(boxes)
        assert len(parts) > 4
        assert all(left <= begin and end <= right for begin, end in parts)
    opened.page.set_viewport_size(size)
