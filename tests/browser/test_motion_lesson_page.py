"""The page of the lesson about motions: its phase plane and seven phases against Python, sliders, driving."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.lessons.motion_lesson import BLENDS, MotionLesson
from rr1plan.lessons.phase_plane import fastest_motion
from rr1plan.retiming.path_blends import clean

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def lesson() -> MotionLesson:
    made = rp.lesson("motion")
    assert isinstance(made, MotionLesson)
    return made


@pytest.fixture(scope="module")
def page_file(lesson: MotionLesson, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lesson.save_html(tmp_path_factory.mktemp("motion") / "motion.html")


@pytest.fixture
def page(opened: Any) -> Iterator[Any]:
    opened.ask("RR1.timing.stop(); RR1.steps.go(1); RR1.steps.go(0)")
    yield opened
    assert opened.complaints == []


@pytest.mark.parametrize("blend", range(len(BLENDS)))
@pytest.mark.parametrize("scales", [(1.0, 1.0), (0.4, 1.3), (1.5, 0.3)])
def test_the_phase_plane_is_that_of_python(
    page: Any, lesson: MotionLesson, blend: int, scales: tuple[float, float]
) -> None:
    limits, grid = lesson.limits, lesson.grids[BLENDS[blend]]
    expected = fastest_motion(grid, scales[0] * limits.velocity, scales[1] * limits.acceleration)
    page.ask("RR1.timing.show('plane')")
    page.ask(f"Object.assign(RR1.timing.values, {{blend: {blend}, velocity: {scales[0]}, acceleration: {scales[1]}}})")
    page.ask("RR1.timing.compute()")
    np.testing.assert_allclose(page.ask("Array.from(RR1.timing.plane.speed)"), expected.speed, atol=1e-9)
    np.testing.assert_allclose(page.ask("RR1.timing.plane.limit"), expected.limit, rtol=1e-9)
    assert page.ask("RR1.timing.duration") == pytest.approx(expected.duration, rel=1e-9)
    assert page.ask("RR1.timing.plane.switches") == list(expected.switches)
    page.ask("Object.assign(RR1.timing.values, {blend: 3, velocity: 1, acceleration: 1})")


@pytest.mark.parametrize("mode", ["plane", "blend", "phases"])
def test_sliders_are_long_enough_to_drag_in_a_small_window(page: Any, mode: str) -> None:
    page.resize(1280, 720)
    page.ask("(mode) => RR1.timing.show(mode)", mode)
    knobs = page.ask(
        """Array.from(document.querySelectorAll('#panel-timing .knobs label'), (label) => [
            label.querySelector('input').offsetWidth, label.scrollWidth - label.clientWidth])"""
    )
    page.resize(960, 640)
    assert all(width >= 34 and beyond <= 0 for width, beyond in knobs), knobs


def test_names_in_the_configuration_space_do_not_overlap(page: Any) -> None:
    page.resize(1280, 720)
    boxes = page.ask(
        """() => {
            const usual = CanvasRenderingContext2D.prototype.fillText, rows = [], { chart } = RR1.lesson;
            CanvasRenderingContext2D.prototype.fillText = function (text, x, y) {
                const wide = this.measureText(text).width, left = x - (this.textAlign === "center" ? wide / 2 : 0);
                rows.push([text, left, y - 5 * chart.unit, left + wide, y + 5 * chart.unit]);
            };
            chart.redraw();
            CanvasRenderingContext2D.prototype.fillText = usual;
            chart.redraw();
            return rows;
        }"""
    )
    page.resize(960, 640)
    names = [box for box in boxes if re.fullmatch("[a-z ]{3,}", box[0])]
    assert {"other elbow", "start", "goal", "blue", "yellow"} <= {name for name, *_ in names}
    for a, b in combinations(names, 2):
        assert a[3] <= b[1] or b[3] <= a[1] or a[4] <= b[2] or b[4] <= a[2], (a, b)


def test_no_path_is_drawn_over_the_names_of_images(page: Any) -> None:
    page.resize(1280, 720)
    page.ask("RR1.steps.go(2)")
    order = page.ask(
        """() => {
            const { chart } = RR1.lesson, order = [], usual = CanvasRenderingContext2D.prototype.fillText;
            chart.overlays.push(() => order.push("path"));
            CanvasRenderingContext2D.prototype.fillText = function (text, ...at) {
                if (this.canvas === chart.canvas) order.push(text);
                usual.call(this, text, ...at);
            };
            chart.redraw();
            CanvasRenderingContext2D.prototype.fillText = usual;
            chart.overlays.pop();
            return order;
        }"""
    )
    page.resize(960, 640)
    assert order[0] == "path"
    assert "yellow" in order


@pytest.mark.parametrize("mode", ["plane", "blend", "phases", "cost"])
def test_no_words_of_a_chart_overlap_in_a_small_window(page: Any, mode: str) -> None:
    page.resize(1280, 720)
    boxes = page.ask(
        """(mode) => {
            const usual = CanvasRenderingContext2D.prototype.fillText, rows = [];
            RR1.timing.show(mode);
            CanvasRenderingContext2D.prototype.fillText = function (text, x, y) {
                const wide = this.measureText(text).width, before = { center: 0.5, right: 1 }[this.textAlign] || 0;
                if (wide) rows.push([x - before * wide, y - 8, x + (1 - before) * wide, y]);
                usual.call(this, text, x, y);
            };
            RR1.timing.drawChart();
            CanvasRenderingContext2D.prototype.fillText = usual;
            return rows;
        }""",
        mode,
    )
    page.resize(960, 640)
    left, top, right, bottom = np.array(boxes).T
    across = np.minimum(right[:, None], right) - np.maximum(left[:, None], left)
    along = np.minimum(bottom[:, None], bottom) - np.maximum(top[:, None], top)
    assert len(boxes) > 6
    assert ((across > 0) & (along > 0)).sum() == len(boxes)
    assert left.min() >= 0


def test_seven_phases_are_those_of_python(page: Any) -> None:
    page.ask("RR1.timing.show('phases')")
    rng = np.random.default_rng(3)
    for _ in range(12):
        numbers = np.exp(rng.uniform([-3.0, -1.0, 0.0, 2.5], [1.0, 1.3, 2.7, 7.0])).tolist()
        motion = rp.seven_phases(*numbers)
        names = ("distance", "speed", "push", "jerk")
        values = ", ".join(f"{name}: {value!r}" for name, value in zip(names, numbers, strict=True))
        page.ask(f"Object.assign(RR1.timing.values, {{{values}}}); RR1.timing.compute()")
        np.testing.assert_allclose(page.ask("RR1.timing.seven.durations"), motion.durations, atol=1e-12)
        times = np.linspace(0.0, 0.999 * motion.duration, 7)
        states = page.ask(f"{times.tolist()}.map((t) => RR1.timing.seven.at(t))")
        np.testing.assert_allclose(np.array(states)[:, :3], motion.state(times)[:, :3], atol=1e-9)


def test_driving_follows_the_blended_path_at_the_speed_of_the_plane(page: Any, lesson: MotionLesson) -> None:
    page.ask("RR1.steps.go(3)")
    plane, grid = lesson.plane, lesson.plane.grid
    for k in (0, 40, 130, len(grid.s) - 1):
        page.ask(f"RR1.timing.at({float(plane.times[k] / plane.duration)!r})")
        np.testing.assert_allclose(page.ask("Array.from(RR1.q)"), grid.q[k], atol=1e-4)
    page.ask("RR1.timing.at(0)")
    page.page.locator("#panel-steps h2").click()
    page.run_until("d", "RR1.timing.share > 0.05")
    share = page.ask("RR1.timing.share")
    page.next_frames()
    assert page.ask("RR1.timing.share") == share
    page.ask("RR1.timing.drive()")
    page.ask("RR1.setJoint(0, 0.0)")
    assert page.ask("RR1.timing.driving") == 0


def test_sliders_of_every_step_move_what_is_shown(page: Any) -> None:
    for step, names in enumerate(((), ("tries",), ("blend",), ("blend", "velocity", "acceleration"))):
        page.ask(f"RR1.steps.go({step})")
        assert page.ask("[...document.querySelectorAll('[data-knob]')].map((k) => k.dataset.knob)") == list(names)
        for name in names:
            before = page.ask("RR1.timing.duration")
            page.page.locator(f"[data-knob={name}]").focus()
            for _ in range(3 if name == "blend" else 25):
                page.page.keyboard.press("ArrowLeft")
            assert abs(page.ask("RR1.timing.duration") - before) > 0.001, name
            for _ in range(3 if name == "blend" else 25):
                page.page.keyboard.press("ArrowRight")
            assert page.ask("RR1.timing.duration") == pytest.approx(before, rel=1e-3), name  # sliders go by steps
    assert page.ask("RR1.steps.index") == 3


def test_a_click_in_the_phase_plane_puts_the_arm_there(page: Any, lesson: MotionLesson) -> None:
    page.ask("RR1.steps.go(3)")
    chart = page.page.locator("#panel-timing .chart")
    box = chart.bounding_box()
    left, right = page.ask("[RR1.timing.frame.left, RR1.timing.frame.right]")
    chart.click(position={"x": left + 0.5 * (right - left), "y": 0.5 * box["height"]})
    grid = lesson.plane.grid
    k = int(np.searchsorted(grid.s, 0.5 * grid.s[-1]))
    np.testing.assert_allclose(page.ask("Array.from(RR1.q)"), grid.q[k], atol=0.05)


def test_rejected_shortcuts_are_told_from_those_that_are_taken(page: Any, lesson: MotionLesson) -> None:
    page.ask("RR1.steps.go(1)")
    for k, shortcut in enumerate(lesson.shortcuts[:8], 1):
        page.ask(f"RR1.timing.set('tries', {k})")
        said = page.page.locator("#panel-timing .said").inner_text()
        assert said.startswith("Free: taken." if shortcut.free else "Not free: rejected.")
        length = float(np.linalg.norm(np.diff(shortcut.path, axis=0), axis=1).sum())
        assert f"{length:.2f} rad" in said
    page.ask("RR1.timing.set('tries', 60)")


def test_the_legend_of_the_cost_covers_no_other_text(tab: Any, page_file: Path) -> None:
    tab.resize(1024, 768)
    tab.page.add_init_script("""
        const usual = CanvasRenderingContext2D.prototype.fillText;
        window.texts = [];
        CanvasRenderingContext2D.prototype.fillText = function (text, x, y) {
            const wide = this.measureText(text).width, share = { left: 0, center: 0.5, right: 1 }[this.textAlign];
            const left = x - share * wide;
            window.texts.push([text, left, y - 9, left + wide, y + 2]);
            usual.call(this, text, x, y);
        };
    """)
    tab.open(page_file, "Boolean(window.RR1 && RR1.ready && RR1.steps)")
    tab.ask("(RR1.steps.go(RR1.steps.articles.length - 1), window.texts = [], RR1.timing.drawChart(), 0)")
    texts = tab.ask("window.texts")
    legend = [box for text, *box in texts if "jerk limit" in text and "[" not in text]
    others = [box for text, *box in texts if "jerk limit" not in text or "[" in text]
    assert len({tuple(box) for box in legend}) == 3
    for a in legend:
        for b in others:
            assert a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1], (a, b)


@pytest.mark.parametrize("kinds", ["PP", "RP"])
def test_sliding_joints_move_by_meters(tab: Any, tmp_path: Path, kinds: str) -> None:
    arm = rp.planar_arm(kinds, (0.6, 0.8), limits=((0.0, 1.5), (0.1, 0.8)))
    scene = rp.Scene(name="gantry").with_arm("arm", arm, q=(0.2, 0.2))
    problem = rp.Problem(scene, [0.2, 0.2], rp.JointGoal([1.4, 0.3]))
    tab.record_texts()
    tab.open(rp.lesson("motion", scene, problem).save_html(tmp_path / "sliding.html"))
    texts = {}
    for mode in ("path", "shortcut", "blend", "plane", "phases", "cost"):
        texts[mode] = tab.ask(
            """(mode) => {
                window.texts = [];
                RR1.timing.show(mode);
                RR1.timing.drawChart();
                return [...window.texts, ...RR1.timing.knobs.map(({ say }) => say(1)), RR1.timing.say()];
            }""",
            mode,
        )
    # The seven phases are those of the first joint.
    first = "m" if kinds == "PP" else "rad"
    assert f"velocity [{first}/s]" in texts["phases"]
    assert f"1.00 {first}" in texts["phases"]
    assert f"1.0 {first}/s²" in texts["phases"]
    assert ("jerk limit [m/s³]" if kinds == "PP" else "jerk limit") in texts["cost"]
    assert ("joint velocities [m/s]" if kinds == "PP" else "joint velocities") in texts["blend"]
    assert ("ṡ [m/s]" if kinds == "PP" else "ṡ") in texts["plane"]
    del texts["phases"]
    assert not any("rad" in text for shown in texts.values() for text in shown)
    assert tab.complaints == []


@pytest.mark.parametrize(
    ("size", "blend", "distance"), [(2e-3, "0.000127 m", "0.00080 m"), (50.0, "3.18 m", "20.00 m")]
)
def test_lengths_fit_the_size_of_the_arm(tab: Any, tmp_path: Path, size: float, blend: str, distance: str) -> None:
    scene = rp.Scene().with_arm("arm", rp.planar_arm("PP", (size, 0.8 * size)))
    scene = scene.with_obstacle("disc", rp.Cylinder(0.2 * size, 0.2 * size), (0.5 * size, 0.4 * size, 0.0))
    problem = rp.Problem(scene, (0.1 * size, 0.4 * size), (0.9 * size, 0.4 * size))
    lesson: Any = rp.lesson("motion", problem=problem)
    lesson.figure()
    assert 5 < len(clean(lesson.raw)) < 60
    tab.open(lesson.save_html(tmp_path / "a.html"))
    length = f"{lengths(lesson.raw):.{6 if size < 1 else 2}f} m"
    assert f"{length} long" in str(lesson.steps)
    assert length in tab.page.locator("#panel-timing .said").inner_text()
    for mode, knob, text in (("blend", "blend", blend), ("phases", "distance", distance)):
        tab.ask(f"RR1.timing.show('{mode}')")
        assert tab.page.locator(f"#panel-timing [data-knob={knob}] + output").inner_text() == text
    # The first joint stays within its limits, also over the largest distance.
    for value in ("RR1.timing.values.distance", str(size)):
        tab.ask(f"RR1.timing.set('distance', {value})")
        for share in (0, 1):
            tab.ask(f"RR1.timing.at({share})")
            assert -1e-9 <= tab.ask("RR1.q[0]") <= size * (1.0 + 1e-9)
    assert tab.complaints == []


def lengths(path: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
