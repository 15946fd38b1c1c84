"""The time line beside a plan of many arms, in a real browser."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.playback.viewer.page_capture import wait_until

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


@pytest.fixture
def page(opened: Any) -> Iterator[Any]:
    """The page in its initial state, at the start of its motion."""
    opened.resize(960, 640)
    opened.ask("RR1.pause(), RR1.setMoved([]), document.body.classList.add('few-rows')")
    opened.ask("RR1.editing.changed && RR1.editing.reset(), RR1.editing.open(false), RR1.seek(0)")
    yield opened
    assert opened.complaints == []


def place_of(tab: Any, row: int, time: float) -> dict[str, float]:
    """Where a moment of a row is on the canvas; the line of the clock tells where a moment is."""
    tab.ask(f"RR1.pause(), RR1.seek({time})")
    left = float(tab.ask("parseFloat(document.querySelector('#panel-timeline .now').style.left)"))
    height = float(tab.ask("parseFloat(document.querySelector('#panel-timeline .now').style.height)"))
    return {"x": left, "y": height * (row + 0.5) / 2}


def test_a_click_goes_to_the_moment(page: Any) -> None:
    place = place_of(page, 1, 0.5)
    page.ask("RR1.seek(0)")
    page.page.click(CANVAS, position=place)
    assert page.ask("RR1.time") == pytest.approx(0.5, abs=0.02)
    said = page.ask("document.querySelector('#panel-timeline .said').textContent")
    assert said == "arm02 waits 1.00 s for arm01"


def test_a_click_on_a_cross_paints_what_touches(page: Any) -> None:
    conflict = page.conflict
    place = place_of(page, 0, conflict.time)
    page.page.click(CANVAS, position=place)
    assert page.ask("RR1.time") == pytest.approx(conflict.time, abs=1e-6)
    assert set(page.ask("RR1.touched")) == set(conflict.subject)
    said = page.ask("document.querySelector('#panel-timeline .said').textContent")
    assert said == conflict.message


def test_a_conflict_with_something_that_has_moved_since_is_none(page: Any) -> None:
    conflict = page.conflict
    place = place_of(page, 1, conflict.time)
    page.ask("name => RR1.setMoved([name])", conflict.subject[0])
    page.page.mouse.move(0, 0)
    page.page.hover(CANVAS, position=place)
    said = page.ask("document.querySelector('#panel-timeline .said').textContent")
    assert said != conflict.message


def test_a_few_rows_lie_below_the_arms(page: Any) -> None:
    boxes = "['stage', 'panels'].map((id) => document.getElementById(id).getBoundingClientRect().toJSON())"
    stage, panels = page.ask(boxes)
    assert stage["bottom"] <= panels["top"] + 0.5
    assert stage["width"] == panels["width"] == page.page.viewport_size["width"]
    assert panels["bottom"] <= page.page.viewport_size["height"] + 0.5
    # Beside them on a phone held sideways.
    page.resize(844, 390)
    stage, panels = page.ask(boxes)
    assert stage["right"] <= panels["left"] + 0.5
    assert stage["height"] == 390


def test_a_motion_planned_in_the_page_has_rows_of_its_own(page: Any) -> None:
    said = "document.querySelector('#panel-timeline .said').textContent"
    wait_until(page.page, "RR1.planner")
    page.page.mouse.move(1, 1)
    before = page.ask(said)
    turn = "() => { const { editing } = RR1, q = editing.start.slice(); q[0] += 0.3; editing.setEnd('goal', q); }"
    page.ask(turn)
    assert page.ask("RR1.editing.plan().then((answer) => answer.certified)")
    middle = page.ask("RR1.player.start + 0.5 * RR1.duration")
    for row, expected in enumerate(("arm01 moves", "arm02 is at its goal")):
        page.page.hover(CANVAS, position=place_of(page, row, middle))
        assert page.ask(said) == expected
    page.page.mouse.move(1, 1)
    assert page.ask(said) == f"2 arms, {page.ask('RR1.duration'):.2f} s, planned here in their joint space"
    page.ask("RR1.editing.reset()")
    assert page.ask(said) == before


def test_many_arms_that_were_planned_here_move_one_after_the_other(
    tab: Any, planar2r: rp.Robot, tmp_path: FilePath
) -> None:
    scene = rp.place_grid(planar2r, 13, 1, spacing=6.0)
    goal = {name: [0.4, 0.3] for name in scene.arms}
    motion = rp.plan_motion(rp.Problem(scene, None, goal), rng=0)
    tab.open(motion.save_html(tmp_path / "page.html", options=rp.ViewOptions(play=False)))
    wait_until(tab.page, "Boolean(RR1.planner)")
    assert tab.ask("RR1.editing.plan().then((answer) => answer.legs.length)") == 13
    said = tab.page.inner_text("#panel-timeline .said")
    assert said == f"13 arms, {tab.ask('RR1.duration'):.2f} s, planned here one after the other"
    # The first arm has arrived while the one in the middle moves, and the last one has not begun.
    found = set()
    for row in (0, 6, 12):
        place = place_of(tab, row, 0.5 * tab.ask("RR1.duration"))
        tab.page.hover(CANVAS, position={**place, "y": 2 / 13 * place["y"]})
        found.add(tab.page.inner_text("#panel-timeline .said").split(" ", 1)[1])
    assert found == {"is at its goal", "moves", "stands still"}
    assert tab.complaints == []


def test_a_small_window_leaves_the_arms_room_while_they_are_moved(page: Any) -> None:
    width = "document.getElementById('stage').clientWidth"
    for small in ({"width": 800, "height": 600}, {"width": 390, "height": 844}):
        page.resize(**small)
        page.ask("RR1.editing.open()")
        assert not page.page.is_visible("#panels")
        assert page.ask(width) == small["width"]
        page.ask("RR1.editing.open(false)")
        assert page.page.is_visible(CANVAS)


def test_the_bar_beside_a_panel_holds_its_buttons_when_zoomed(page: Any) -> None:
    page.resize(640, 360)
    page.ask("document.body.classList.remove('few-rows')")
    page.next_frames()
    bar, last = page.ask("[bar, plotter].map((node) => node.getBoundingClientRect().right)")
    assert last <= bar


def test_cards_beside_a_panel_do_not_overlap_on_a_projector(tab: Any, planar2r: rp.Robot, tmp_path: FilePath) -> None:
    scene = rp.place_grid(planar2r, 10, 1, spacing=6.0)
    start = scene.configuration()
    trajectory = rp.Trajectory.from_samples(scene.joint_names(), [0.0, 1.0], [start, start + 0.2])
    report = rp.validate(trajectory, scene)
    line = rp.timeline(trajectory, scene, report=report)
    options = rp.ViewOptions(title="Ten arms in a row on a table", panels=[line.panel()], play=False)
    tab.resize(1024, 768)
    tab.open(rp.save_html(tmp_path / "page.html", scene, trajectory=trajectory, report=report, options=options))
    tab.next_frames()
    boxes = tab.ask("""() => {
        const box = (node) => { const b = node.getBoundingClientRect(); return [b.left, b.top, b.right, b.bottom]; };
        const parts = [...document.querySelectorAll("#headline, #side, #bar, #bar > *")];
        const shown = parts.filter((node) => node.checkVisibility());
        return Object.fromEntries(shown.map((node) => [node.id || node.className, box(node)]));
    }""")
    head, side, bar = boxes.pop("headline"), boxes.pop("side", None), boxes.pop("bar")
    assert side is None or head[2] <= side[0]
    assert len(boxes) > 5
    assert all(bar[0] <= box[0] and box[2] <= bar[2] for box in boxes.values())
    assert tab.complaints == []


def test_a_time_line_of_one_arm_says_so(tab: Any, planar2r: rp.Robot, tmp_path: FilePath) -> None:
    scene = rp.Scene().with_arm("arm", planar2r)
    motion = rp.plan_motion(rp.Problem(scene, None, [0.4, 0.3]), rng=0)
    options = rp.ViewOptions(play=False, panels=[rp.timeline(motion.trajectory, scene).panel()])
    tab.open(motion.save_html(tmp_path / "page.html", options=options))
    wait_until(tab.page, "Boolean(RR1.planner)")
    assert tab.ask("RR1.editing.plan().then((answer) => answer.legs === undefined || answer.certified)")
    assert tab.page.inner_text("#panel-timeline .said").startswith("1 arm, ")
    assert tab.ask("RR1.jointText(0, -0.5)") == "−28.6°"
    assert tab.complaints == []


def test_the_picture_changes_only_after_the_drag_that_replaces_the_time_line(page: Any) -> None:
    page.resize(640, 360)
    page.ask("RR1.look()")
    x, y = page.ask("""() => {
        const { hands, picker } = RR1.editing, { width, height } = RR1.stage.pane.getBoundingClientRect(), found = [];
        for (let x = 0; x < width; x += 4) for (let y = 0; y < height; y += 4) {
            const thing = hands.thingAt(picker.at({ clientX: x, clientY: y }));
            if (thing && thing.kind === "joint" && document.elementFromPoint(x, y).closest("#pane")) found.push([x, y]);
        }
        return found[found.length >> 1];
    }""")
    width = "RR1.stage.pane.clientWidth"
    before = page.ask(width)
    page.page.mouse.move(x, y)
    page.page.mouse.down()
    page.page.mouse.move(x + 8, y + 6, steps=3)
    page.next_frames()
    assert page.page.locator("#editing").is_visible()
    assert page.ask(width) == before
    page.page.mouse.up()
    wait_until(page.page, f"{width} === 640")
    page.next_frames()
    heights = (
        "Object.values(RR1.poses(RR1.q)).map((T) => RR1.editing.picker.project({ x: T[12], y: T[13], z: T[14] }).y)"
    )
    assert max(page.ask(heights)) < page.ask("editing.getBoundingClientRect().top")
    # The next drag changes nothing any more.
    box = page.page.locator(".handle.joint").bounding_box()
    page.page.mouse.move(box["x"] + 15, box["y"] + 15)
    page.page.mouse.down()
    page.page.mouse.move(box["x"] + 20, box["y"] + 12, steps=3)
    page.next_frames()
    assert page.ask(width) == 640
    page.page.mouse.up()
