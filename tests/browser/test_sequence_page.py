"""A sequence in a real browser: the held block moves with the hand, and a list leads to each stage."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.playback.viewer.page_capture import wait_until

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


@pytest.fixture
def page(opened: Any) -> Iterator[Any]:
    """The page in its initial state, at the start of its motion."""
    opened.resize(960, 640)
    opened.ask("RR1.pause(), RR1.plots.open && RR1.plots.toggle(), document.body.classList.remove('bare')")
    opened.ask("RR1.editing.open(false), RR1.editing.changed && RR1.editing.reset(), RR1.seek(0)")
    yield opened
    assert opened.complaints == []


def magenta(tab: Any) -> np.ndarray:
    """Positions of pixels of the block, shape (n, 2)."""
    pixels = tab.bare_picture()
    return np.argwhere((pixels[..., 0] > pixels[..., 1] + 60) & (pixels[..., 2] > pixels[..., 1] + 60))


def test_the_block_is_drawn_in_the_hand_and_stays_where_it_is_put_down(page: Any, plan: rp.SequencePlan) -> None:
    taken, left = (event.begin for event in plan.events)
    centers = []
    for time in (0.0, 0.5 * (taken + left), left, plan.trajectory.end_time):
        page.ask(f"RR1.pause(), RR1.seek({time})")
        drawn = np.array(page.ask("Array.from(RR1.world.bodyPoses)")).reshape(4, 4).T
        np.testing.assert_allclose(drawn, plan.object_poses("block", [time])[0], atol=1e-3)
        if taken <= time <= left:
            tool = np.array(page.ask("RR1.linkPose('arm/tool')")).reshape(4, 4).T
            np.testing.assert_allclose(np.linalg.inv(tool) @ drawn, rp.transforms.pose([0, 0, 0.085]), atol=1e-3)
        centers.append(magenta(page).mean(axis=0))
    first, middle, last, end = centers
    assert np.linalg.norm(middle - first) > 20
    assert np.linalg.norm(last - middle) > 20
    assert np.linalg.norm(end - last) < 10


def test_a_click_on_a_stage_goes_to_its_beginning(page: Any, plan: rp.SequencePlan) -> None:
    rows = "#panel-stages li button"
    assert page.ask(f"[...document.querySelectorAll('{rows} .label')].map((r) => r.textContent)") == [
        stage.label for stage in plan.stages
    ]
    page.page.click(f"#panel-stages li:nth-child({len(plan.stages)}) button")
    assert page.ask("RR1.time") == pytest.approx(plan.stages[-1].begin)
    assert page.ask(f"[...document.querySelectorAll('{rows}')].map((r) => r.classList.contains('now'))") == [
        *[False] * (len(plan.stages) - 1),
        True,
    ]


def test_segments_that_are_passed_without_a_stop_say_so(page: Any, plan: rp.SequencePlan) -> None:
    rows = page.ask(
        "[...document.querySelectorAll('#panel-stages li')].map((row) => Boolean(row.querySelector('.passed')))"
    )
    speeds = [float(np.abs(plan.trajectory(stage.end, 1)).max()) for stage in plan.stages]
    assert rows == [speed > 1e-4 for speed in speeds]
    assert rows.count(True) == 1


def test_the_buttons_stay_in_their_bar_beside_the_list(page: Any) -> None:
    boxes = """() => [...document.querySelectorAll("#bar, #bar > *")].filter((node) => node.checkVisibility())
        .map((node) => node.getBoundingClientRect()).map(({ left, right }) => [left, right])"""
    for width in (800, 840):
        page.resize(width, 600)
        (left, right), *parts = page.ask(boxes)
        assert len(parts) > 4
        assert all(left <= begin and end <= right for begin, end in parts)


def test_the_arm_is_planned_for_with_the_block_in_its_hand(page: Any, plan: rp.SequencePlan) -> None:
    taken, left = (event.begin for event in plan.events)
    time = 0.5 * (taken + left)
    page.ask(f"RR1.pause(), RR1.seek({time}), RR1.editing.open()")
    wait_until(page.page, "Boolean(RR1.planner)")
    start = plan.trajectory(time)
    page.ask("RR1.editing.turn(0, RR1.q[0] - 0.9)")
    in_hand(page)
    assert page.ask("RR1.editing.plan().then((answer) => answer.certified)")
    assert page.page.inner_text("#badge") == "Planned here, certified free"
    track = page.ask(
        "(({ breaks, coefficients: c }) => [[...breaks.values], [...c.values], c.shape])(RR1.document.track)"
    )
    trajectory = rp.Trajectory(plan.trajectory.joint_names, track[0], np.reshape(track[1], track[2]))
    np.testing.assert_allclose(trajectory(0.0), start, atol=1e-5)
    np.testing.assert_allclose(trajectory(trajectory.end_time) - start, [-0.9, 0, 0, 0, 0, 0], atol=1e-5)
    held = next(scene for scene in plan.scenes() if "block" in scene.attachments)
    assert rp.validate(trajectory, held).certified
    for share in (0.2, 0.9):
        page.ask(f"RR1.pause(), RR1.seek({share} * RR1.duration)")
        in_hand(page)
        np.testing.assert_allclose(page.ask("[...RR1.q]"), trajectory(share * trajectory.duration), atol=1e-9)
    # Undone, the arm is again where it was posed; then everything is as it came, at the same time.
    page.ask("RR1.editing.undo()")
    in_hand(page)
    assert page.ask("[RR1.manual, RR1.duration]") == [True, plan.trajectory.duration]
    page.ask("RR1.editing.reset()")
    assert page.ask("[RR1.manual, RR1.time, RR1.editing.changed]") == [False, time, False]


def in_hand(tab: Any) -> None:
    """The block is drawn in the hand that holds it."""
    tool, drawn = (
        np.array(tab.ask(ask)).reshape(4, 4).T for ask in ("RR1.linkPose('arm/tool')", "[...RR1.world.bodyPoses]")
    )
    np.testing.assert_allclose(np.linalg.inv(tool) @ drawn, rp.transforms.pose([0, 0, 0.085]), atol=1e-6)


def test_a_click_on_a_stage_leads_back_to_the_sequence(page: Any, plan: rp.SequencePlan) -> None:
    last = plan.stages[-1]
    page.ask(f"RR1.pause(), RR1.seek({0.5 * (last.begin + last.end)}), RR1.editing.open()")
    wait_until(page.page, "Boolean(RR1.planner)")
    page.ask("RR1.editing.turn(0, RR1.q[0] + 0.3)")
    # The block has been put down: it stays.
    before = page.ask("[...RR1.world.bodyPoses]")
    assert page.ask("RR1.editing.plan().then((answer) => answer.certified)")
    page.ask("RR1.pause(), RR1.seek(RR1.duration)")
    assert page.ask("[...RR1.world.bodyPoses]") == before
    assert "now" in page.page.locator("#panel-stages li button").last.get_attribute("class")
    page.page.locator("#panel-stages li button").nth(2).click()
    assert page.ask("[RR1.time, RR1.duration]") == [plan.stages[2].begin, plan.trajectory.duration]


def test_the_planner_of_one_stage_measures_no_clearance_of_the_whole_motion(page: Any) -> None:
    wait_until(page.page, "Boolean(RR1.planner)")
    page.ask("RR1.plots.open || RR1.plots.toggle()")
    page.ask("RR1.plots.load()")
    assert "clearance" not in page.ask("RR1.plots.source.quantities(RR1.plots.arm)")
    assert "velocity" in page.ask("RR1.plots.offered")
    assert page.ask("Boolean(RR1.plots.source.planner) && RR1.plots.source.background === null")
