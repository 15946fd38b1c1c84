"""The pictures of the lessons about checking, two arms and six joints: the page computes what Python does."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser.conftest import Tab
from lift_arm import lift_scene

import rr1plan as rp
from rr1plan.lessons.continuous_checking_lesson import ContinuousCheckingLesson
from rr1plan.lessons.edge_intervals import advance_edge, contact_share, halve_edge, sample_edge
from rr1plan.lessons.six_joints_lesson import SixJointsLesson
from rr1plan.lessons.two_arms_lesson import TwoArmsLesson
from rr1plan.playback.viewer.page_capture import wait_until

pytestmark = pytest.mark.browser

READY = "Boolean(window.RR1 && RR1.ready && RR1.steps)"
LESSONS = {
    "continuous_checking": ContinuousCheckingLesson,
    "two_arms": TwoArmsLesson,
    "six_joints": SixJointsLesson,
}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Any, Path]]:
    folder, found = tmp_path_factory.mktemp("lessons"), {}
    for name, kind in LESSONS.items():
        lesson = rp.lesson(name)
        assert isinstance(lesson, kind)
        found[name] = lesson, lesson.save_html(folder / f"{name}.html")
    return found


@pytest.fixture(scope="module")
def tabs(browser: Any) -> Iterator[dict[str, Tab]]:
    """The lessons opened so far."""
    opened: dict[str, Tab] = defaultdict(lambda: Tab(browser.new_page()))
    yield opened
    for tab in opened.values():
        tab.page.close()


@pytest.fixture
def page(
    tabs: dict[str, Tab], files: dict[str, tuple[Any, Path]], request: pytest.FixtureRequest
) -> Iterator[tuple[Any, Any]]:
    """The page of a lesson at its first step, in its initial state."""
    name = request.param
    lesson, file = files[name]
    if name not in tabs:
        tab = tabs[name]
        tab.resize(1440, 900)
        tab.open(file, READY)
        if name != "continuous_checking":
            wait_until(tab.page, "Boolean(RR1.planner)")
    tab = tabs[name]
    tab.page.bring_to_front()
    tab.resize(1440, 900)
    tab.ask("document.activeElement.blur(), RR1.editing.changed && RR1.editing.reset()")
    tab.ask("RR1.steps.go(1), RR1.steps.go(0)")
    yield tab, lesson
    assert tab.complaints == []


def go_to(tab: Any, name: str) -> None:
    for _ in range(12):
        if tab.ask("RR1.steps.name") == name:
            return
        tab.page.keyboard.press("ArrowRight")
    raise AssertionError(f"there is no step {name}")


# ---- continuous checking ---------------------------------------------------------------------


@pytest.mark.parametrize("page", ["continuous_checking"], indirect=True)
def test_the_page_looks_at_the_same_intervals(page: tuple[Any, Any]) -> None:
    tab, lesson = page
    names = tab.ask("RR1.panelData.edge.presets.map((preset) => preset.name)")
    for name, (begin, end) in zip(names, lesson.edges.values(), strict=True):
        tab.ask("(name) => RR1.edge.setPreset(name)", name)
        for method, key in ((halve_edge, "halved"), (advance_edge, "advanced")):
            expected = method(lesson.checker, begin, end)
            found = tab.ask(f"RR1.edge.edge.{key}.map((i) => [i.begin, i.end, i.distance, i.bound, i.verdict])")
            assert [row[4] for row in found] == [i.verdict for i in expected]
            numbers = [[i.begin, i.end, i.distance, i.bound] for i in expected]
            np.testing.assert_allclose([row[:4] for row in found[:-1]], numbers[:-1], atol=2e-5)
        share = contact_share(lesson.checker, begin, end)
        shown = tab.ask("RR1.edge.inContact")
        np.testing.assert_allclose(shown, [] if share is None else [share], atol=2e-5)


@pytest.mark.parametrize("page", ["continuous_checking"], indirect=True)
def test_the_slider_sets_the_step_and_samples_follow(page: tuple[Any, Any]) -> None:
    tab, lesson = page
    begin, end = next(iter(lesson.edges.values()))
    slider, said = tab.page.locator("#panel-edge .steps input"), tab.page.locator("#panel-edge .verdict")
    assert "taken for free. It is not" in said.inner_text()
    slider.focus()
    for _ in range(30):
        tab.page.keyboard.press("ArrowRight")
    step = tab.ask("RR1.edge.stepSize")
    expected = sample_edge(lesson.checker, begin, end, step)
    assert tab.ask("RR1.edge.samples.map((sample) => sample.free)") == expected.free.tolist()
    assert not expected.passes
    assert "not free" in said.inner_text()


@pytest.mark.parametrize("page", ["continuous_checking"], indirect=True)
def test_fixed_steps_find_what_the_text_says(page: tuple[Any, Any]) -> None:
    tab, _ = page
    for name, degrees, words in (("steps", 12, "9 samples, all free"), ("small_steps", 1, "105 samples, all free")):
        go_to(tab, name)
        assert f"{degrees}°" in tab.page.locator("#panel-steps article:visible").inner_text()
        assert tab.ask("RR1.edge.stepSize") == pytest.approx(np.radians(degrees))
        assert tab.page.locator("#panel-edge .verdict").inner_text().startswith(words)


@pytest.mark.parametrize(("size", "unit", "step"), [(2e-3, "mm", "0.42 mm"), (50.0, "m", "10.5 m")])
def test_distances_fit_the_size_of_the_arm(tab: Any, tmp_path: Path, size: float, unit: str, step: str) -> None:
    wedge = rp.polygon_prism(size * np.array([(0.5, 0.5), (0.8, 0.4), (0.6, 0.9)]), height=0.2 * size)
    gantry = rp.planar_arm("PP", (size, 0.8 * size), width=0.08 * size)
    scene = rp.Scene().with_arm("arm", gantry).with_obstacle("wedge", wedge)
    problem = rp.Problem(scene, (0.1 * size, 0.1 * size), (0.95 * size, 0.1 * size))
    tab.page.add_init_script("""
        window.written = [];
        const usual = CanvasRenderingContext2D.prototype.fillText;
        CanvasRenderingContext2D.prototype.fillText = function (text, ...more) {
            if (this.canvas.closest(".bars")) written.push(text);
            return usual.call(this, text, ...more);
        };
    """)
    lesson = rp.lesson("continuous_checking", problem=problem)
    tab.open(lesson.save_html(tmp_path / "a.html"), "Boolean(window.RR1 && RR1.edge)")
    wait_until(tab.page, "written.length > 4")
    assert tab.page.locator("#panel-edge .steps output").inner_text() == step
    written = set(tab.ask("written"))
    assert f"distance [{unit}]" in written
    assert 3 <= len([text for text in written if text.replace(".", "").isdigit()]) <= 7
    assert tab.complaints == []


@pytest.mark.parametrize("page", ["continuous_checking"], indirect=True)
def test_the_region_of_a_proven_interval_is_in_view(page: tuple[Any, Any]) -> None:
    tab, _ = page
    tab.resize(1280, 720)
    tab.ask("RR1.steps.go(2)")
    tab.next_frames()
    off = tab.ask(
        """() => {
            const { pane } = RR1.stage, wide = pane.clientWidth, high = pane.clientHeight;
            const rim = RR1.edge.swept(RR1.edge.current).flatMap(({ points, radius: r }) => (
                points.flatMap(([x, y]) => [[x - r, y], [x + r, y], [x, y - r], [x, y + r]])));
            const spots = rim.map(([x, y]) => RR1.editing.picker.project({ x, y, z: RR1.panelData.edge.height }));
            return spots.filter(({ x, y }) => x < 0 || x > wide || y < 0 || y > high).length;
        }"""
    )
    assert off == 0


@pytest.mark.parametrize("page", ["continuous_checking"], indirect=True)
def test_keys_step_through_the_intervals_and_the_end_can_be_dragged(page: tuple[Any, Any]) -> None:
    tab, lesson = page
    go_to(tab, "halving")
    assert tab.ask("RR1.edge.shown") == 1
    for _ in range(3):
        tab.page.keyboard.press(".")
    tab.page.keyboard.press(",")
    assert tab.ask("RR1.edge.shown") == 3
    assert "halved" in tab.page.locator("#panel-edge .verdict").inner_text()
    middle = tab.ask("RR1.edge.edge.at(RR1.edge.current.where)")
    np.testing.assert_allclose(tab.ask("Array.from(RR1.q)"), middle, atol=1e-6)
    before = tab.ask("RR1.edge.edge.q1")
    canvas = "#panel-edge .plot canvas"
    x, y = tab.ask(
        """(canvas) => {
            const box = document.querySelector(canvas).getBoundingClientRect(), { square, edge } = RR1.edge;
            return square.of(edge.q1).map((v, k) => v / square.ratio + [box.left, box.top][k]);
        }""",
        canvas,
    )
    tab.page.mouse.move(x, y)
    tab.page.mouse.down()
    tab.page.mouse.move(x - 30, y + 20, steps=3)
    tab.page.mouse.up()
    q0, q1 = tab.ask("[RR1.edge.edge.q0, RR1.edge.edge.q1]")
    assert q1[0] < before[0] - 0.1
    expected = [i.verdict for i in halve_edge(lesson.checker, q0, q1)]
    assert tab.ask("RR1.edge.edge.halved.map((i) => i.verdict)") == expected


# ---- two arms --------------------------------------------------------------------------------


def cells(tab: Any, owner: str) -> np.ndarray:
    return np.array(tab.ask(f"Array.from(RR1.{owner}.square.cells.bits)")) > 0


@pytest.mark.parametrize("page", ["two_arms"], indirect=True)
def test_cells_of_slices_are_those_of_the_checker(page: tuple[Any, Any]) -> None:
    tab, lesson = page
    checker, rng = rp.CollisionChecker(lesson.scene), np.random.default_rng(0)
    seen = []
    for arm, places in ((0, [2.0, 3.0]), (1, [1.5, 2.0]), (0, [0.0, 0.0])):
        tab.ask("([arm, places]) => { RR1.pair.setArm(arm); RR1.pair.setPlaces(places); }", [arm, places])
        found, q = cells(tab, "pair"), np.array(tab.ask("RR1.pair.q()"))
        low, high = (np.array(tab.ask(f"RR1.panelData.pair.{side}")) for side in ("low", "high"))
        count = round(len(found) ** 0.5)
        for _ in range(300):
            cell = rng.integers(0, count, 2)
            q[2 * arm : 2 * arm + 2] = low + (cell + 0.5) * (high - low) / count
            seen.append(bool(found[cell[0] * count + cell[1]]))
            assert seen[-1] != checker.is_free(q)
    assert 40 < sum(seen) < len(seen) - 40


@pytest.mark.parametrize("page", ["two_arms"], indirect=True)
def test_the_diagram_moves_both_arms_along_their_paths(page: tuple[Any, Any]) -> None:
    tab, lesson = page
    go_to(tab, "diagram")
    pair = lesson.pairs["take_turns"]
    # The mark of both arms is there from the beginning, and other layers do not remove it.
    tab.ask("RR1.play(), RR1.pause(), RR1.setShown('frames', false)")
    assert len(tab.ask("RR1.pair.places")) == 2
    box = tab.page.locator("#panel-pair .diagram canvas").bounding_box()
    tab.page.mouse.click(box["x"] + 0.5 * box["width"], box["y"] + 0.3 * box["height"])
    places = tab.ask("RR1.pair.places")
    np.testing.assert_allclose(tab.ask("RR1.pair.q()"), np.hstack(pair.at([places]))[0], atol=1e-5)
    assert 0.3 < places[0] / pair.lengths[0][-1] < 0.6
    tab.page.locator("#panel-pair .diagram canvas").focus()
    tab.page.keyboard.press("ArrowUp")
    assert tab.ask("RR1.pair.places[1]") == pytest.approx(places[1] + 0.01 * pair.lengths[1][-1])
    assert tab.ask("RR1.pair.places[0]") == pytest.approx(places[0])


@pytest.mark.parametrize("page", ["two_arms"], indirect=True)
def test_schedules_run_and_contacts_are_named(page: tuple[Any, Any]) -> None:
    tab, _ = page
    go_to(tab, "orders")
    said = tab.page.locator("#panel-pair .verdict")
    tab.run_until("x", "RR1.pair.time > 0.1")
    time = tab.ask("RR1.pair.time")
    tab.next_frames()
    assert tab.ask("RR1.pair.time") == time
    assert "touch." not in said.inner_text()
    tab.ask("RR1.pair.setSchedule('at_once'), RR1.pair.setTime(1.6)")
    assert "touch." in said.inner_text()
    tab.page.locator("#panel-pair [data-choice=left_first]").click()
    assert tab.ask("RR1.pair.schedule.name") == "left_first"


@pytest.mark.parametrize("page", ["two_arms"], indirect=True)
def test_no_schedule_touches_anything_in_the_page(page: tuple[Any, Any]) -> None:
    tab, _ = page
    touching = tab.ask(
        """() => {
            const found = {};
            for (const scenario of RR1.panelData.pair.scenarios) {
                RR1.pair.setScenario(scenario.name);
                for (const { name, times } of scenario.schedules) {
                    RR1.pair.setSchedule(name);
                    let count = 0;
                    for (let k = 0; k <= 80; k++) {
                        RR1.pair.setTime((k / 80) * times[times.length - 1]);
                        if (RR1.planner.contacts(RR1.pair.q()).length) count += 1;
                    }
                    found[`${scenario.name} ${name}`] = count;
                }
            }
            return found;
        }"""
    )
    assert {name for name, count in touching.items() if count} == {
        "take_turns at_once", "back_up at_once", "swap_sides at_once",
    }  # fmt: skip


# ---- six joints ------------------------------------------------------------------------------


@pytest.mark.parametrize("page", ["six_joints"], indirect=True)
def test_slices_of_all_pairs_of_joints_are_those_of_the_checker(page: tuple[Any, Any]) -> None:
    tab, lesson = page
    rng, seen = np.random.default_rng(0), []
    limits = lesson.checker.limits
    for columns in ([0, 2], [1, 2], [4, 3], [2, 5]):
        q = rng.uniform(limits.lower, limits.upper)
        q[2] = -0.9
        tab.ask("([columns, q]) => { RR1.slices.pose(q); RR1.slices.setColumns(columns); }", [columns, q.tolist()])
        found = cells(tab, "slices")
        count = round(len(found) ** 0.5)
        for _ in range(150):
            cell = rng.integers(0, count, 2)
            q[columns] = (limits.lower + (limits.upper - limits.lower) * (0.5 / count))[columns] + cell * (
                (limits.upper - limits.lower)[columns] / count
            )
            seen.append(bool(found[cell[0] * count + cell[1]]))
            assert seen[-1] != lesson.checker.is_free(q)
    assert 40 < sum(seen) < len(seen) - 40


@pytest.mark.parametrize("page", ["six_joints"], indirect=True)
def test_the_free_share_is_that_of_the_slice_shown(page: tuple[Any, Any]) -> None:
    tab, _ = page
    go_to(tab, "slices")
    shares = []
    for joint in ("1", "3", "2"):
        tab.page.select_option("#panel-slices select[data-axis='1']", joint)
        shares.append(f"{100 * (1 - tab.ask('RR1.slices.blocked')):.0f} %")
        assert f"Of this slice {shares[-1]} is free" in tab.page.locator("#panel-slices .verdict").inner_text()
    assert len(set(shares)) > 1


@pytest.mark.parametrize("page", ["six_joints"], indirect=True)
def test_the_slice_follows_an_obstacle_that_is_dragged(page: tuple[Any, Any]) -> None:
    tab, lesson = page
    go_to(tab, "slices")
    before = cells(tab, "slices")
    x, y = tab.ask(
        """() => {
            const center = RR1.world.boxAround("crate").getCenter(new RR1.THREE.Vector3());
            const at = RR1.editing.picker.project(center);
            return [at.x, at.y];
        }"""
    )
    tab.page.mouse.move(x, y)
    tab.page.mouse.down()
    tab.page.mouse.move(x - 25, y + 30, steps=4)
    tab.page.mouse.up()
    wait_until(tab.page, "!RR1.slices.waiting")
    after = cells(tab, "slices")
    assert (before != after).any()
    pose = np.reshape(tab.ask("Array.from(RR1.planner.obstaclePose('crate'))"), (4, 4)).T
    checker = rp.CollisionChecker(lesson.scene.with_obstacle_at("crate", pose))
    q, count, limits = np.array(tab.ask("Array.from(RR1.q)")), round(len(after) ** 0.5), lesson.checker.limits
    wide = (limits.upper - limits.lower)[[0, 2]] / count
    changed = np.flatnonzero(before != after)
    for cell in np.random.default_rng(0).choice(changed, 40):
        q[[0, 2]] = limits.lower[[0, 2]] + (np.array(divmod(int(cell), count)) + 0.5) * wide
        assert after[cell] != checker.is_free(q)


@pytest.mark.parametrize("page", ["six_joints"], indirect=True)
@pytest.mark.parametrize("button", ["left", "right"])
def test_only_the_main_button_drags_in_a_picture(page: tuple[Any, Any], button: Any) -> None:
    tab, _ = page
    box = tab.page.locator("#panel-slices .plot canvas").bounding_box()
    x, y = box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]
    before = tab.ask("Array.from(RR1.q)")
    tab.page.mouse.move(x, y)
    tab.page.mouse.down(button=button)
    tab.page.mouse.move(x + 20, y + 20)
    tab.page.mouse.up(button=button)
    assert (tab.ask("Array.from(RR1.q)") != before) == (button == "left")


@pytest.mark.parametrize("page", ["six_joints"], indirect=True)
def test_keys_go_to_solutions_and_the_tool_stays(page: tuple[Any, Any]) -> None:
    tab, lesson = page
    go_to(tab, "solutions")
    place = tab.ask("RR1.linkPose('rr1/tool')")
    said = tab.page.locator("#panel-slices .verdict")
    for key, solution in enumerate(lesson.solutions, start=1):
        tab.page.keyboard.press(str(key))
        np.testing.assert_allclose(tab.ask("Array.from(RR1.q)"), solution.q, atol=1e-6)
        np.testing.assert_allclose(tab.ask("RR1.linkPose('rr1/tool')"), place, atol=1e-5)
        words = said.inner_text()
        assert words.startswith(f"Solution {key}: ")
        assert ("free." in words) == solution.is_valid
        assert ("outside the joint limits" in words) == (not solution.within_limits)


@pytest.mark.parametrize("page", ["six_joints"], indirect=True)
def test_the_self_motion_leaves_the_tool_where_it_is(page: tuple[Any, Any]) -> None:
    tab, _ = page
    go_to(tab, "self_motion")
    slider = tab.page.locator("#panel-slices .motion input")
    place = tab.ask("RR1.linkPose('rr1/tool')")[12:15]
    joints = []
    for share in (0.1, 0.5, 0.9):
        slider.fill(str(share))
        np.testing.assert_allclose(tab.ask("RR1.linkPose('rr1/tool')")[12:15], place, atol=1e-3)
        joints.append(tab.ask("Array.from(RR1.q)"))
    assert (np.ptp(joints, axis=0) > 0.05).all()


@pytest.mark.parametrize("page", ["six_joints"], indirect=True)
def test_samples_of_the_page_agree_with_those_of_python(page: tuple[Any, Any]) -> None:
    tab, lesson = page
    go_to(tab, "measure")
    for _ in range(3):
        tab.page.keyboard.press("s")
    assert tab.ask("RR1.slices.counts.length") == 2000
    share, low, high = tab.ask("RR1.slices.interval(2000)")
    assert low < lesson.share.share < high
    assert 0.03 < high - low < 0.05
    assert f"{100 * share:.1f} %" in tab.page.locator("#panel-slices .verdict").inner_text()


@pytest.mark.parametrize("page", ["six_joints"], indirect=True)
def test_names_of_joints_have_room_beside_their_values_in_a_small_window(page: tuple[Any, Any]) -> None:
    tab, _ = page
    tab.resize(1280, 720)
    go_to(tab, "self_motion")
    cut = """[...document.querySelectorAll('#panel-slices .sliders label')]
        .filter((label) => label.scrollWidth > label.clientWidth).map((label) => label.textContent)"""
    found = tab.ask(cut)
    tab.resize(1440, 900)
    assert found == []


@pytest.mark.parametrize("page", ["six_joints"], indirect=True)
def test_sliders_reach_the_limits_of_joints_and_stay_inside(page: tuple[Any, Any]) -> None:
    tab, lesson = page
    go_to(tab, "slices")
    drag = """([k, end]) => {
        const slider = document.getElementById(`slices-${k}`);
        slider.value = slider[end];
        slider.dispatchEvent(new Event("input", { bubbles: true }));
        return [RR1.q[k], document.querySelector("#panel-slices .verdict").textContent];
    }"""
    limits = lesson.scene.limits()
    for k, (low, high) in enumerate(zip(limits.lower, limits.upper, strict=True)):
        for end, limit in (("min", low), ("max", high)):
            value, said = tab.ask(drag, [k, end])
            assert value == pytest.approx(limit, abs=1e-9), (k, end)
            assert "outside the joint limits" not in said, (k, end)


def test_six_joints_may_slide_and_be_blocked_most_of_the_time(tab: Any, tmp_path: Path) -> None:
    tab.open(rp.lesson("six_joints", lift_scene(tmp_path)).save_html(tmp_path / "page.html"), READY)
    wait_until(tab.page, "Boolean(RR1.planner)")
    readings = tab.page.locator("#panel-slices .sliders output").all_inner_texts()
    assert readings[:2] == ["200.0 mm", "138°"]
    go_to(tab, "measure")
    tab.page.keyboard.press("s")
    marks = tab.ask(
        """() => {
            const usual = CanvasRenderingContext2D.prototype.fillText, texts = [];
            CanvasRenderingContext2D.prototype.fillText = function (text) { texts.push(text); };
            RR1.slices.drawChart(RR1.slices.chart.canvas.getContext("2d"), 1);
            CanvasRenderingContext2D.prototype.fillText = usual;
            return texts;
        }"""
    )
    assert tab.ask("RR1.slices.interval(RR1.slices.counts.length)")[2] < 0.5
    assert {"0 %", "50 %", "100 %"} <= set(marks)
    assert tab.complaints == []


@pytest.mark.parametrize("name", ["two_arms", "six_joints"])
def test_without_webassembly_the_page_says_so(tab: Any, files: dict[str, tuple[Any, Path]], name: str) -> None:
    tab.page.add_init_script("WebAssembly.validate = () => false")
    tab.open(files[name][1], READY)
    wait_until(tab.page, "Boolean(RR1.noPlanner)")
    assert "needs WebAssembly" in tab.page.locator(".plot .missing").inner_text()
    for _ in range(6):
        tab.page.keyboard.press("ArrowRight")
    assert tab.complaints == []
