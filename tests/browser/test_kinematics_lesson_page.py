"""The page of the lesson about kinematics: live numbers against Pinocchio's, the other elbow, the map of |det J|."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.lessons.kinematics_lesson import KinematicsLesson

pytestmark = pytest.mark.browser

POSES = ((0.5, 0.9), (-2.0, 2.2), (1.4, -0.7), (3.0, 0.05))


@pytest.fixture(scope="module")
def lesson() -> KinematicsLesson:
    made = rp.lesson("kinematics")
    assert isinstance(made, KinematicsLesson)
    return made


@pytest.fixture(scope="module")
def page_file(lesson: KinematicsLesson, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lesson.save_html(tmp_path_factory.mktemp("kinematics") / "kinematics.html")


@pytest.fixture
def page(opened: Any) -> Iterator[Any]:
    opened.ask("RR1.steps.go(1); RR1.steps.go(0)")
    yield opened
    assert opened.complaints == []


def live(page: Any, name: str) -> str:
    return str(page.ask(f"document.querySelector('[data-live=\"{name}\"]').textContent")).replace("−", "-")


def in_units(page: Any, name: str, unit: str) -> float:
    """A number of the page that is followed by its unit."""
    text = live(page, name)
    assert text.endswith(unit)
    return float(text.removesuffix(unit))


def matrix(page: Any, name: str, size: int) -> np.ndarray:
    return np.array([[float(live(page, f"{name}{i}{k}")) for k in range(size)] for i in range(size)])


@pytest.mark.parametrize("q", POSES)
def test_matrices_are_the_products_of_link_transforms(
    page: Any, lesson: KinematicsLesson, q: tuple[float, float]
) -> None:
    page.ask(f"RR1.setQ({list(q)})")
    frames = lesson.table.frames(q)
    planar = [frame[np.ix_([0, 1, 3], [0, 1, 3])] for frame in frames]
    np.testing.assert_allclose(matrix(page, "A", 3), planar[1], atol=0.006)
    np.testing.assert_allclose(matrix(page, "B", 3), np.linalg.inv(planar[1]) @ planar[2], atol=0.006)
    np.testing.assert_allclose(matrix(page, "C", 3), planar[2], atol=0.006)
    jacobian = rp.Kinematics(lesson.scene).jacobian(q)[:2]
    np.testing.assert_allclose(matrix(page, "J", 2), jacobian, atol=0.006)
    sizes = np.linalg.svd(jacobian, compute_uv=False)
    np.testing.assert_allclose([in_units(page, "s1", " m"), in_units(page, "s2", " m")], sizes, atol=6e-4)
    assert in_units(page, "w", " m²") == pytest.approx(abs(np.linalg.det(jacobian)), abs=6e-4)
    assert in_units(page, "det", " m²") == pytest.approx(np.linalg.det(jacobian), abs=6e-4)


def test_transforms_begin_at_the_base(tab: Any, tmp_path: Path) -> None:
    base = rp.transforms.pose([3.0, -2.0, 0.0], rpy=[0.0, 0.0, 2.0])
    scene = rp.Scene().with_arm("arm", rp.planar_arm("RR", (1.0, 0.7)), base=base, q=(0.6, 0.3))
    lesson: Any = rp.lesson("kinematics", scene)
    tab.open(lesson.save_html(tmp_path / "turned.html"), "Boolean(window.RR1 && RR1.steps)")
    planar = [frame[np.ix_([0, 1, 3], [0, 1, 3])] for frame in lesson.table.frames([0.6, 0.3])]
    np.testing.assert_allclose(matrix(tab, "A", 3), planar[1], atol=0.006)
    np.testing.assert_allclose(matrix(tab, "C", 3), planar[2], atol=0.006)


@pytest.mark.parametrize("kinds", ["RR", "RP", "PR", "PP"])
def test_a_joint_changes_one_factor(kinds: str, tab: Any, tmp_path: Path) -> None:
    scene = rp.Scene().with_arm("arm", rp.planar_arm(kinds, (0.6, 0.8)), q=(0.2, 0.3))
    tab.open(rp.lesson("kinematics", scene).save_html(tmp_path / "a.html"), "Boolean(window.RR1 && RR1.steps)")
    before = [matrix(tab, name, 3) for name in "AB"]
    for k, q in enumerate(([0.4, 0.3], [0.2, 0.5])):
        tab.ask(f"RR1.setQ({q})")
        changed = [(matrix(tab, name, 3) != other).any() for name, other in zip("AB", before, strict=True)]
        assert changed == [k == 0, k == 1]


def test_no_other_solution_is_named_beyond_the_limits(tab: Any, tmp_path: Path) -> None:
    scene = rp.Scene().with_arm("arm", rp.planar_arm("PR", (0.8, 0.6)), q=(0.1, 0.8))
    tab.open(rp.lesson("kinematics", scene).save_html(tmp_path / "rail.html"), "Boolean(window.RR1 && RR1.steps)")
    tab.ask("RR1.steps.go(2)")
    hidden = "document.querySelector('#lesson-kinematics').hidden"
    assert (live(tab, "two"), tab.ask(hidden)) == ("out of range", True)
    tab.ask("RR1.setQ([0.1, 1.2])")
    assert (live(tab, "two"), tab.ask(hidden)) == ("(0.535 m, 111.2°)", False)
    # The outline of an arm at a boundary is that of both solutions.
    tab.ask("RR1.setQ([0.1, Math.PI / 2])")
    assert (live(tab, "two"), tab.ask(hidden)) == ("the same", True)


def test_lengths_have_digits_for_small_arms(tab: Any, tmp_path: Path) -> None:
    scene = rp.Scene().with_arm("arm", rp.planar_arm("RR", (2e-3, 1.6e-3), width=1e-4))
    tab.open(rp.lesson("kinematics", scene).save_html(tmp_path / "small.html"), "Boolean(window.RR1 && RR1.ready)")
    tab.ask("RR1.setQ([0, Math.PI / 2])")
    np.testing.assert_allclose(matrix(tab, "C", 3), [[0, -1, 2e-3], [1, 0, 1.6e-3], [0, 0, 1]], atol=1e-9)
    jacobian = [[-1.6e-3, -1.6e-3], [2e-3, 0]]
    np.testing.assert_allclose(matrix(tab, "J", 2), jacobian, atol=1e-9)
    sizes = np.linalg.svd(jacobian, compute_uv=False)
    np.testing.assert_allclose([in_units(tab, "s1", " m"), in_units(tab, "s2", " m")], sizes, atol=6e-6)


@pytest.mark.parametrize("q", POSES)
def test_the_other_elbow_reaches_the_same_point(page: Any, lesson: KinematicsLesson, q: tuple[float, float]) -> None:
    page.ask(f"RR1.steps.go(2); RR1.setQ({list(q)})")
    twin = np.radians([float(number) for number in re.findall(r"-?[\d.]+", live(page, "two"))])
    tool, other = (lesson.flat.points(angles)[2] for angles in (q, twin))
    np.testing.assert_allclose(other, tool, atol=5e-3)
    assert np.abs(np.angle(np.exp(1j * (twin - np.array(q))))).max() > 0.05
    drawn = page.ask("RR1.arm.twinSpots[1].position.toArray().slice(0, 2)")
    np.testing.assert_allclose(drawn, tool, atol=1e-6)
    page.page.locator("#panel-steps h2").click()
    page.page.keyboard.press("e")
    np.testing.assert_allclose(np.exp(1j * np.array(page.ask("Array.from(RR1.q)"))), np.exp(1j * twin), atol=2e-3)


def test_what_is_drawn_belongs_to_the_step(page: Any) -> None:
    names = ("frames[0][0]", "twinBars[0]", "columns[0]", "velocity", "force")
    visible = f"[{', '.join(f'RR1.arm.{name}.visible' for name in names)}]"
    expected = {
        0: [True, False, False, False, False],
        2: [False, True, False, False, False],
        3: [False, False, True, False, False],
        4: [False, False, False, True, True],
        5: [False, False, False, True, False],
    }
    for step, shown in expected.items():
        page.ask(f"RR1.steps.go({step})")
        assert page.ask(visible) == shown


def test_the_velocity_ellipse_is_the_image_of_the_unit_circle(page: Any, lesson: KinematicsLesson) -> None:
    q = (0.4, 1.3)
    page.ask(f"RR1.steps.go(4); RR1.setQ({list(q)})")
    points = np.reshape(page.ask("Array.from(RR1.arm.velocity.geometry.attributes.position.array)"), (-1, 3))[:, :2]
    jacobian = rp.Kinematics(lesson.scene).jacobian(q)[:2]
    circle = (points - lesson.flat.points(q)[2]) @ np.linalg.inv(jacobian).T
    lengths = np.linalg.norm(circle, axis=1)
    # A ribbon around it.
    assert lengths.mean() == pytest.approx(0.25, rel=0.02)
    assert lengths.std() < 0.03


def test_the_map_is_dark_where_the_arm_is_singular(page: Any) -> None:
    page.ask("RR1.steps.go(4)")
    page.next_frames()
    pixels = page.cspace_picture()
    plot = page.ask("(({ plot, ratio }) => [plot.x, plot.y, plot.size].map((v) => v / ratio))(RR1.lesson.chart)")
    column = int(plot[0] + 0.15 * plot[2])

    def brightness(bend: float) -> float:
        row = int(plot[1] + (0.5 - bend / (2 * np.pi)) * plot[2])
        return float(pixels[row, column].mean())

    assert brightness(np.pi / 2) > 180
    assert brightness(-np.pi / 2) > 180
    assert brightness(0.2) < 140
    assert brightness(-0.2) < 140


def test_the_other_solution_of_an_arm_that_slides_is_shown_within_its_limits(tab: Any, tmp_path: Path) -> None:
    lesson: Any = rp.lesson("kinematics", rp.Scene().with_arm("arm", rp.planar_arm("PR", (2.0, 0.6))))
    tab.open(lesson.save_html(tmp_path / "slides.html"))
    tab.ask("RR1.setQ([0.5, 0.4])")
    other = max(lesson.flat.solutions(lesson.flat.points([0.5, 0.4])[2]), key=lambda q: q[0])
    slide, turn = (float(number) for number in re.findall(r"-?[\d.]+", live(tab, "two")))
    assert (slide, turn) == pytest.approx((other[0], np.degrees(other[1])), abs=0.06)
    tab.ask("RR1.setQ([1.9, 0.4])")
    assert live(tab, "two") == "out of range"
    assert tab.complaints == []


@pytest.mark.parametrize("size", [0.1, 10.0])
def test_the_frames_of_a_gantry_fit_its_range(tab: Any, tmp_path: Path, size: float) -> None:
    scene = rp.Scene().with_arm("arm", rp.planar_arm("PP", (size, 0.8 * size)))
    tab.open(rp.lesson("kinematics", scene).save_html(tmp_path / "gantry.html"))
    shown = "RR1.arm.frames[0][0].visible && RR1.arm.frames[0][0].geometry.attributes.position.array"
    assert 0.05 < np.max(tab.ask(f"Array.from({shown})")) / size < 0.2
    assert tab.complaints == []


@pytest.mark.parametrize("size", [(390, 844), (820, 1180)], ids=lambda s: f"{s[0]}x{s[1]}")
def test_formulas_are_as_large_as_their_text_in_narrow_windows(page: Any, size: tuple[int, int]) -> None:
    page.resize(*size)
    page.ask("RR1.steps.go(3)")
    formula, text = page.ask(
        """['math', 'p'].map((part) => document.querySelector(`#panel-steps article:not([hidden]) ${part}`))
        .map((node) => parseFloat(getComputedStyle(node).fontSize))"""
    )
    fits = page.ask("(texts => texts.scrollWidth <= texts.clientWidth)(RR1.steps.texts)")
    page.resize(960, 640)
    assert formula >= text
    assert fits


def test_the_product_of_matrices_fits_in_its_text(page: Any) -> None:
    page.ask("RR1.steps.go(0)")
    page.resize(640, 360)  # as at a zoom of 200 %
    wide = page.ask("(texts => texts.scrollWidth - texts.clientWidth)(RR1.steps.texts)")
    page.resize(1280, 720)
    faded = page.ask("RR1.steps.texts.classList.contains('more')")
    page.resize(960, 640)
    assert wide == 0
    assert not faded
