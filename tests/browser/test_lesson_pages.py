"""Every lesson's page in a real browser: steps walked by keyboard and by buttons, joints moved, nothing loaded."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.playback.viewer.page_capture import wait_until

pytestmark = pytest.mark.browser

READY = "Boolean(window.RR1 && RR1.ready && RR1.steps)"


@pytest.fixture(scope="module", params=rp.lesson_names())
def lesson(request: pytest.FixtureRequest) -> rp.Lesson:
    return rp.lesson(request.param)


@pytest.fixture(scope="module")
def page_file(lesson: rp.Lesson, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lesson.save_html(tmp_path_factory.mktemp("lesson") / f"{lesson.name}.html")


@pytest.fixture(scope="module")
def opened(shared_tab: Any, page_file: Path) -> Any:
    shared_tab.resize(1280, 720)
    shared_tab.open(page_file, f"{READY} && Boolean(RR1.planner || RR1.noPlanner || !RR1.document.planner)")
    return shared_tab


@pytest.fixture
def page(opened: Any) -> Iterator[Any]:
    """The page at its first step."""
    opened.resize(1280, 720)
    opened.ask("document.activeElement.blur(), RR1.pause(), RR1.steps.go(1), RR1.steps.go(0)")
    yield opened
    assert opened.complaints == []
    assert [url for url in opened.requests if not url.startswith(("file:", "data:", "blob:"))] == []


NAMELESS = """[...document.querySelectorAll("canvas")].filter((canvas) => canvas.checkVisibility()
    && !canvas.ariaLabel && !canvas.closest("#pane, button")).map((canvas) => canvas.parentElement.className)"""


def test_arrow_keys_walk_all_steps(page: Any, lesson: rp.Lesson) -> None:
    for step in lesson.steps:
        assert page.ask("RR1.steps.name") == step.name
        shown = page.ask("[...document.querySelectorAll('#panel-steps article')].filter((a) => !a.hidden).length")
        assert shown == 1
        assert page.ask("document.querySelector('#panel-steps article:not([hidden]) h3').textContent") == step.title
        if step.q is not None and not page.ask("RR1.playing"):
            np.testing.assert_allclose(page.ask("Array.from(RR1.q)"), step.q, atol=1e-6)
        page.next_frames()
        assert page.faint_texts() == []
        assert page.ask(NAMELESS) == []
        page.page.keyboard.press("ArrowRight")
    assert page.ask("RR1.steps.index") == len(lesson.steps) - 1
    for _ in lesson.steps:
        page.page.keyboard.press("ArrowLeft")
    assert page.ask("RR1.steps.index") == 0


def test_buttons_walk_too_and_end_at_the_ends(page: Any, lesson: rp.Lesson) -> None:
    back, fore = (page.page.locator(f"#panel-steps [data-move='{move}']") for move in (-1, 1))
    assert back.is_disabled()
    for _ in lesson.steps[1:]:
        fore.click()
    assert fore.is_disabled()
    assert page.page.locator("#panel-steps output").inner_text() == f"{len(lesson.steps)} / {len(lesson.steps)}"


@pytest.mark.parametrize("lesson", ["kinematics"], indirect=True)
def test_the_address_names_the_step(tab: Any, page_file: Path) -> None:
    tab.open(f"{page_file.as_uri()}#step=3", READY)
    assert tab.ask("RR1.steps.index") == 2
    tab.ask("() => { location.hash = 'step=2'; }")
    wait_until(tab.page, "RR1.steps.index === 1")
    tab.page.keyboard.press("PageDown")
    assert tab.page.url.endswith("#step=3")
    tab.page.reload()
    wait_until(tab.page, READY)
    assert tab.ask("RR1.steps.index") == 2
    tab.ask("() => { location.hash = 'step=2&q=0.3,-1.5'; }")
    wait_until(tab.page, "RR1.steps.index === 1 && Math.abs(RR1.q[1] + 1.5) < 1e-6")
    tab.ask("() => { location.hash = 'step=2&q=0.3,x'; }")
    tab.page.keyboard.press("PageDown")
    assert tab.page.url.endswith("#step=3")
    assert tab.complaints == []
    # The title is a heading of the page for screen readers, and not drawn twice.
    heading = tab.page.get_by_role("heading", level=1)
    assert heading.inner_text() == tab.page.title()
    assert tab.ask("getComputedStyle(headline).clipPath") == "inset(50%)"


@pytest.mark.parametrize(("lesson", "step"), [("workspace", 1), ("kinematics", 3)], indirect=["lesson"])
def test_forced_colors_leave_the_legend_its_colors(page: Any, step: int) -> None:
    colors = """[...document.querySelectorAll(".corner i")].filter((mark) => mark.checkVisibility()).map((mark) => {
        const { color, background } = getComputedStyle(mark);
        return mark.textContent ? color : background;
    })"""
    page.ask(f"RR1.steps.go({step})")
    usual = page.ask(colors)
    assert len(set(usual)) >= 2
    page.page.emulate_media(forced_colors="active")
    try:
        assert page.ask(colors) == usual
    finally:
        page.page.emulate_media(forced_colors="none")


# Of each lesson with an animation a step that has one, and what it changes.
ANIMATIONS = {
    "no_path": ("planner", "RR1.lesson.grown"),
    "planning": ("rrt", "RR1.search.at"),
    "potential_fields": ("sum", "RR1.potential.at"),
    "motion": ("blend", "RR1.timing.share"),
    "continuous_checking": ("halving", "RR1.edge.shown"),
    "two_arms": ("orders", "RR1.pair.time"),
}


# The sliders without a text for screen readers, and the texts that they would read out, during some frames.
SPOKEN = """async () => {
    const part = (selector) => [...document.querySelectorAll(selector)].filter((node) => node.checkVisibility());
    const frame = () => new Promise(requestAnimationFrame), read = [];
    const silent = part(".panel input[type=range]").filter((slider) => !slider.getAttribute("aria-valuetext"));
    const observer = new MutationObserver((changes) => read.push(...changes.map((change) => {
        const node = change.target.parentElement?.closest("output, [aria-live], [role=status]") || change.target;
        const spoken = node.closest?.("[aria-live]") || node.closest?.("output, [role=status]");
        return spoken && spoken.ariaLive !== "off" ? node.textContent : "";
    })));
    observer.observe(document.body, { childList: true, characterData: true, subtree: true });
    for (let k = 0; k < 3; k++) await frame();
    observer.disconnect();
    return [...silent.map((slider) => slider.outerHTML), ...read.filter(Boolean)];
}"""


@pytest.mark.parametrize("lesson", ANIMATIONS, indirect=True)
def test_animations_are_paused_and_stepped_by_keyboard_and_filmed(page: Any, lesson: rp.Lesson) -> None:
    step, value = ANIMATIONS[lesson.name]
    page.ask("RR1.steps.go(0)")
    while page.ask("RR1.steps.name") != step:
        page.page.keyboard.press("ArrowRight")
    # What a video shows: nothing at the begin, everything at the end.
    page.ask("RR1.film.show(RR1.film.end)")
    last = page.ask(value)
    page.ask("RR1.film.show(RR1.film.start)")
    first = page.ask(value)
    assert 2.0 < page.ask("RR1.film.end") < 20.0
    assert first < last
    runs = "g" if lesson.name == "no_path" else " "
    # Screen readers find the value at the slider, and read no text out at each frame.
    assert page.run_until(runs, f"{value} > {first}", f"({SPOKEN})()") == []
    paused = page.ask(value)
    page.next_frames()
    assert page.ask(value) == paused
    page.page.keyboard.press(".")
    after = page.ask(value)
    assert paused < after <= last or paused == last
    page.page.keyboard.press(",")
    assert page.ask(value) == pytest.approx(paused)


@pytest.mark.parametrize("lesson", ANIMATIONS, indirect=True)
def test_animations_show_their_end_at_once_with_reduced_motion(page: Any, lesson: rp.Lesson) -> None:
    step, value = ANIMATIONS[lesson.name]
    page.ask("name => RR1.steps.go(RR1.steps.articles.findIndex(({ dataset }) => dataset.step === name))", step)
    page.ask("RR1.film.show(RR1.film.end)")
    last = page.ask(value)
    page.ask("RR1.film.show(RR1.film.start)")
    page.page.emulate_media(reduced_motion="reduce")
    try:
        page.page.keyboard.press("g" if lesson.name == "no_path" else " ")
        assert page.ask(value) == last
    finally:
        page.page.emulate_media(reduced_motion="no-preference")


@pytest.mark.parametrize("lesson", ["two_arms"], indirect=True)
def test_paper_shows_all_of_a_text_that_scrolls_in_the_window(page: Any, lesson: rp.Lesson) -> None:
    page.resize(800, 600)
    hidden = "RR1.steps.texts.scrollHeight - RR1.steps.texts.clientHeight"
    in_window = page.ask(hidden)
    assert in_window > 4
    assert page.ask(f"dispatchEvent(new Event('beforeprint')) && {hidden}") <= 4
    assert page.ask(f"dispatchEvent(new Event('afterprint')) && {hidden}") == in_window


@pytest.mark.parametrize("lesson", ["two_arms"], indirect=True)
def test_a_lesson_saved_from_the_browser_begins_anew(page: Any, lesson: rp.Lesson, tab: Any, tmp_path: Path) -> None:
    page.ask("RR1.steps.go(2)")
    saved = tmp_path / "saved.html"
    saved.write_text("<!DOCTYPE html>" + page.ask("document.documentElement.outerHTML"), encoding="utf-8")
    tab.open(saved, READY)
    assert tab.ask("RR1.steps.index") == 0
    assert tab.page.locator("#panel-steps").count() == 1
    assert tab.complaints == []


@pytest.mark.parametrize("lesson", ["potential_fields"], indirect=True)
def test_the_workspace_fills_a_small_window_beside_its_buttons(page: Any, lesson: rp.Lesson) -> None:
    page.resize(640, 360)  # as at a zoom of 200 %
    page.next_frames()
    top, bottom, pane = page.ask("""(() => {
        const { center: [x, y], height, radius } = RR1.panelData.cspace.planar, { camera, pane } = RR1.stage;
        const at = (r) => new RR1.THREE.Vector3(x, height, -y - r).project(camera).y;
        return [...[radius, -radius].map((r) => 0.5 * (1 - at(r)) * pane.clientHeight), pane.clientHeight];
    })()""")
    assert bottom - top > 0.5 * pane


@pytest.mark.parametrize("lesson", ["no_path"], indirect=True)
def test_a_growing_tree_stays_in_its_step(page: Any, lesson: rp.Lesson) -> None:
    step = [step.name for step in lesson.steps].index("planner")
    leave_while_it_grows = """async (step) => {
        RR1.steps.go(step);
        while (!RR1.lesson.grown) await new Promise(requestAnimationFrame);
        const growing = Boolean(RR1.lesson.growing);
        RR1.steps.go(0);
        return growing;
    }"""
    for _ in range(2):  # also when the step is entered again
        assert page.ask(leave_while_it_grows, step)
        page.next_frames()
        assert not page.ask("RR1.lesson.showTree || RR1.lesson.growing")


def test_the_keys_of_a_step_are_listed(page: Any, lesson: rp.Lesson) -> None:
    page.page.click("#panel-steps [data-help]")
    words = page.page.locator("#help").inner_text()
    page.page.keyboard.press("Escape")
    assert "The next step" in words
    assert "Look at everything" in words
    # What does nothing here is not listed.
    assert ("Run the schedule" in words) == (lesson.name == "two_arms")
    assert ("Grow the search" in words) == (lesson.name == "planning")


def test_moving_a_joint_moves_the_arm_in_every_step(page: Any, lesson: rp.Lesson) -> None:
    for _ in lesson.steps:
        before = page.ask("RR1.q[0]")
        page.ask("RR1.setJoint(0, RR1.q[0] + 0.05)")
        assert page.ask("RR1.q[0]") == pytest.approx(before + 0.05, abs=1e-6)
        page.page.keyboard.press("ArrowRight")


@pytest.mark.parametrize("size", [(1440, 900), (800, 600), (390, 844)], ids=lambda s: f"{s[0]}x{s[1]}")
def test_workspace_steps_and_panels_fit_in_the_window(page: Any, size: tuple[int, int]) -> None:
    page.resize(size[0], size[1])
    page.next_frames()
    boxes = page.ask(
        "['stage', 'panel-steps', 'panels'].map((id) => document.getElementById(id).getBoundingClientRect().toJSON())"
    )
    for box in boxes:
        assert box["left"] >= 0
        assert box["right"] <= size[0] + 0.5
        assert box["bottom"] <= size[1] + 0.5
        assert box["width"] >= 200
        assert box["height"] >= 120
    stage, steps, _ = boxes
    assert stage["bottom"] <= steps["top"] + 0.5
    assert page.ask("document.documentElement.scrollWidth") <= size[0]


def test_panels_of_every_step_are_whole_in_a_small_window(page: Any, lesson: rp.Lesson) -> None:
    beyond = {}
    for k, step in enumerate(lesson.steps):
        page.ask(f"RR1.steps.go({k})")
        page.next_frames()
        beyond[step.name] = page.ask("(panels => panels.scrollHeight - panels.clientHeight)(panels)")
    assert set(beyond.values()) == {0}, beyond


@pytest.mark.parametrize("size", [(820, 1180), (768, 1024)], ids=lambda s: f"{s[0]}x{s[1]}")
def test_panels_are_whole_and_fill_a_tall_window(page: Any, lesson: rp.Lesson, size: tuple[int, int]) -> None:
    page.resize(*size)
    for k, step in enumerate(lesson.steps):
        page.ask(f"RR1.steps.go({k})")
        page.next_frames()
        assert page.ask("panels.scrollHeight - panels.clientHeight") == 0, step.name
        right, empty = page.ask("""(() => {
            const box = (node) => node.getBoundingClientRect(), cards = [...panels.children];
            const lowest = (card) => Math.max(...[...card.children].map((node) => box(node).bottom));
            return [Math.max(...cards.map((card) => box(card).right)),
                    Math.min(...cards.map((card) => box(card).bottom - lowest(card)))];
        })()""")
        assert right > size[0] - 20
        assert empty < 30, step.name


@pytest.mark.parametrize("lesson", ["kinematics", "two_arms"], indirect=True)
@pytest.mark.parametrize("size", [(1280, 720), (1920, 1080)], ids=lambda s: f"{s[0]}x{s[1]}")
def test_texts_are_whole_on_a_projector(page: Any, lesson: rp.Lesson, size: tuple[int, int]) -> None:
    page.resize(*size)
    for k, step in enumerate(lesson.steps):
        page.ask(f"RR1.steps.go({k})")
        page.next_frames()
        assert page.ask("RR1.steps.texts.scrollHeight - RR1.steps.texts.clientHeight") < 12, step.name  # half a line


@pytest.mark.parametrize("lesson", ["kinematics"], indirect=True)
def test_a_table_stands_beside_its_text_in_wide_steps_only(page: Any, lesson: rp.Lesson) -> None:
    page.ask(f"RR1.steps.go({[step.name for step in lesson.steps].index('dh')})")
    below = {}
    for size in ((800, 600), (1280, 720)):
        page.resize(*size)
        table, text = page.ask("""['table', 'p'].map((tag) =>
            document.querySelector(`#panel-steps article:not([hidden]) ${tag}`).getBoundingClientRect().toJSON())""")
        below[size] = text["top"] >= table["bottom"]
    assert below == {(800, 600): True, (1280, 720): False}


@pytest.mark.parametrize("lesson", ["motion"], indirect=True)
def test_the_workspace_is_in_the_middle_below_numbers_in_a_line(page: Any, lesson: rp.Lesson) -> None:
    page.resize(820, 1180)
    page.next_frames()
    x, y = page.ask("(({ x, y }) => [x, y])(RR1.editing.picker.project({ x: 0, y: 0, z: 0 }))")
    pane = page.page.locator("#pane").bounding_box()
    assert x == pytest.approx(0.5 * pane["width"], abs=20)
    assert y == pytest.approx(0.5 * pane["height"], abs=40)


@pytest.mark.parametrize("lesson", ["two_arms"], indirect=True)
@pytest.mark.parametrize("size", [(1024, 768), (1280, 720), (1920, 1080)], ids=lambda s: f"{s[0]}x{s[1]}")
def test_steps_beside_two_pictures_leave_no_empty_area(page: Any, size: tuple[int, int]) -> None:
    page.resize(*size)
    page.next_frames()
    card, steps = page.ask(
        "['panel-pair', 'panel-steps'].map((id) => document.getElementById(id).getBoundingClientRect().toJSON())"
    )
    assert 0 <= steps["top"] - card["bottom"] < 40
    assert steps["width"] > 900


@pytest.mark.parametrize("lesson", ["two_arms"], indirect=True)
def test_pictures_side_by_side_are_aligned(page: Any, lesson: rp.Lesson) -> None:
    tops = page.ask(
        "[...document.querySelectorAll('#panel-pair .plot')].map((plot) => plot.getBoundingClientRect().top)"
    )
    assert tops[0] == tops[1]


@pytest.mark.parametrize("lesson", ["two_arms"], indirect=True)
def test_steps_are_readable_below_two_pictures(tab: Any, lesson: rp.Lesson, tmp_path: Path) -> None:
    own = rp.Panel("own", "Own", html="<p>A panel of a teacher.</p>" * 20)
    for panels, sizes in (((), [(910, 660), (1280, 650)]), ((own,), [(1280, 650), (1280, 800)])):
        file = lesson.save_html(tmp_path / "two.html", options=rp.ViewOptions(panels=panels))
        for width, height in sizes:
            tab.resize(width, height)
            tab.open(file, READY)
            top, bottom = tab.ask(
                "(({ top, bottom }) => [top, bottom])(document.querySelector('.texts').getBoundingClientRect())"
            )
            assert bottom < height
            assert bottom - top > 60
    assert tab.complaints == []


@pytest.mark.parametrize("lesson", ["configuration_space", "potential_fields"], indirect=True)
def test_a_further_panel_is_in_view_and_as_wide_as_the_others(tab: Any, lesson: rp.Lesson, tmp_path: Path) -> None:
    own = rp.Panel("own", "Own", html="<p>A panel of a teacher.</p>")
    tab.resize(1280, 800)
    tab.open(lesson.save_html(tmp_path / "own.html", options=rp.ViewOptions(panels=(own,))), READY)
    first, last = (tab.page.locator(f"#panel-{name}").bounding_box() for name in ("cspace", "own"))
    assert last["y"] < 760
    assert last["x"] + last["width"] == pytest.approx(first["x"] + first["width"], abs=1)
    assert last["width"] == pytest.approx(first["width"], abs=5)
    assert tab.complaints == []
