"""Figures of configuration spaces: no text overlaps another, axes have scales, legends list what is drawn."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text

import rr1plan as rp
from rr1plan.playback.cspace.cspace_grid import LIMITS
from rr1plan.playback.cspace.cspace_lines import place_names, write_name
from rr1plan.playback.trajectory_figure import trajectory_svg
from rr1plan.scene.model_library import load_problems

SLICES = {
    "rr1_table": ("rr1_table", None, None),
    "rr1_table elbow": ("rr1_table", None, ("shoulder_joint", "elbow_joint")),
    "rr1_pair": ("rr1_pair", "left", ("shoulder_joint", "elbow_joint")),
}
QUERIES = ("planar2r_path", "planar2r_no_path", "planar2r_plate")


def picture_of(name: str) -> rp.CSpace:
    if name in SLICES:
        scene, arm, joints = SLICES[name]
        return rp.cspace(rp.load_scene(scene), arm=arm, joints=joints, resolution=60)
    problem = next(iter(load_problems(name).values()))
    return rp.cspace(problem.scene, problem, result=rp.plan(problem, rng=0), resolution=60)


@pytest.fixture(scope="module")
def pictures() -> dict[str, rp.CSpace]:
    return {name: picture_of(name) for name in (*QUERIES, *SLICES)}


@pytest.fixture(scope="module")
def figures(pictures: dict[str, rp.CSpace]) -> dict[str, Figure]:
    drawn = {name: picture.figure() for name, picture in pictures.items()}
    for figure in drawn.values():
        figure.draw_without_rendering()
    return drawn


def ticks_in_view(axes: Axes) -> list[list[Text]]:
    shown = []
    for axis in (axes.xaxis, axes.yaxis):
        low, high = sorted(axis.get_view_interval())
        ticks = zip(axis.get_ticklocs(), axis.get_ticklabels(), strict=True)
        shown.append([label for value, label in ticks if low - 1e-9 <= value <= high + 1e-9])
    return shown


def visible_texts(figure: Figure) -> list[Text]:
    every = {label for axes in figure.axes for axis in (axes.xaxis, axes.yaxis) for label in axis.get_ticklabels()}
    seen = {label for axes in figure.axes for labels in ticks_in_view(axes) for label in labels}
    return [
        text
        for text in figure.findobj(Text)
        if text.get_text() and text.get_visible() and (text in seen or text not in every)
    ]


def legend_of(figure: Figure) -> set[str]:
    return {text.get_text() for legend in figure.legends for text in legend.get_texts()}


@pytest.mark.parametrize("name", [*QUERIES, *SLICES])
def test_no_text_overlaps_another_or_leaves_the_figure(name: str, figures: dict[str, Figure]) -> None:
    boxes = [(text.get_text(), text.get_window_extent()) for text in visible_texts(figures[name])]
    assert len(boxes) > 12
    for (one, a), (other, b) in combinations(boxes, 2):
        assert not a.overlaps(b), (one, other)
    frame = figures[name].bbox.padded(0.5)
    for text, box in boxes:
        assert frame.contains(*box.min), text
        assert frame.contains(*box.max), text


@pytest.mark.parametrize("name", [*QUERIES, *SLICES])
def test_no_text_lies_on_the_frame_of_the_axes(name: str, figures: dict[str, Figure]) -> None:
    for axes in figures[name].axes:
        frame = axes.get_window_extent()
        for text in axes.texts:
            box = text.get_window_extent()
            inside = frame.contains(*box.min) and frame.contains(*box.max)
            assert inside or not frame.overlaps(box), text.get_text()


@pytest.mark.parametrize("name", [*QUERIES, *SLICES])
def test_every_axis_has_a_scale(name: str, figures: dict[str, Figure]) -> None:
    for axes in figures[name].axes:
        assert all(len(labels) >= 2 for labels in ticks_in_view(axes))


@pytest.mark.parametrize("name", [*QUERIES, *SLICES])
def test_axes_range_over_the_joint_limits(
    name: str, pictures: dict[str, rp.CSpace], figures: dict[str, Figure]
) -> None:
    grid = pictures[name].grid
    robot = grid.scene.arms[grid.arm].robot
    axes = figures[name].axes[1]
    for joint, closes, (low, high) in zip(
        grid.joint_names, grid.periodic, (axes.get_xlim(), axes.get_ylim()), strict=True
    ):
        k = robot.joint_names.index(joint)
        lower, upper = (-np.pi, np.pi) if closes else (robot.limits.lower[k], robot.limits.upper[k])
        border = 0.0 if closes else 0.03 * (upper - lower)
        assert (low, high) == pytest.approx((lower - border, upper + border))


@pytest.mark.parametrize("name", [*QUERIES, *SLICES])
def test_the_legend_lists_images_without_a_name(
    name: str, pictures: dict[str, rp.CSpace], figures: dict[str, Figure]
) -> None:
    grid = pictures[name].grid
    inside = ~grid.layers.get(LIMITS, np.zeros_like(grid.free))
    images = {layer for layer, mask in grid.layers.items() if (mask & inside).any()}
    named = {text.get_text() for text in figures[name].axes[1].texts}
    assert legend_of(figures[name]) & {*grid.layers, LIMITS} == images - named
    assert all(grid.periodic) or "gray: joint limits" in named


def test_limits_beside_a_seam_are_in_the_legend() -> None:
    arm = rp.planar_arm("RR", limits=[(-2.0, 2.0), None])
    figure = rp.cspace(rp.Scene().with_arm("arm", arm), resolution=24).figure()
    assert LIMITS in legend_of(figure)
    assert "dashed edges meet" in {text.get_text() for text in figure.axes[1].texts}


def test_what_nobody_sees_has_no_name(figures: dict[str, Figure]) -> None:
    """The floor is not drawn, and the legs are below the table."""
    shown = {text.get_text() for text in visible_texts(figures["rr1_table"])}
    assert {"table", "crate", "parcel", "tower", "bottle", "ball"} <= shown
    assert not shown & {"floor", "table_legs"}


def test_long_names_are_in_the_legend_inside_the_figure(planar2r: rp.Robot) -> None:
    names = [letter * 30 for letter in "abcd"] + ["e" * 200]
    scene = rp.Scene(name="a long name " * 12).with_arm("arm", planar2r)
    for name, angle in zip(names, range(5), strict=True):
        scene = scene.with_obstacle(name, rp.Sphere(0.1), [np.cos(angle), np.sin(angle), 0.0])
    figure = rp.cspace(scene, resolution=24).figure()
    assert legend_of(figure) == {*names[:4], "e" * 59 + "…"}
    assert not {text.get_text() for axes in figure.axes for text in axes.texts} & set(names)
    box = figure.legends[0].get_window_extent()
    assert 0.0 <= box.x0 < box.x1 <= figure.bbox.width
    title = next(text for text in figure.texts if text.get_text().startswith("a long name")).get_window_extent()
    assert 0.0 <= title.x0 < title.x1 <= figure.bbox.width
    assert title.y0 > max(axes.get_window_extent().y1 for axes in figure.axes)


def test_a_start_outside_the_limits_is_in_the_picture() -> None:
    arm = rp.planar_arm("RR", limits=[(-2.0, 2.0), (-2.0, 2.0)])
    scene = rp.Scene().with_arm("arm", arm)
    problem = rp.Problem(scene, [2.9, 0.0], rp.JointGoal([-1.0, 0.5]))
    axes = rp.cspace(scene, problem, resolution=24).figure().axes[1]
    assert axes.get_xlim() == pytest.approx((-2.0 - 0.147, 2.9 + 0.147))
    assert axes.get_ylim() == pytest.approx((-2.12, 2.12))


@pytest.mark.parametrize(
    ("bounds", "labels"),
    [
        ((-np.pi / 8, np.pi / 8), ["−π/8", "0", "π/8"]),
        ((0.0, 1.0), ["0", "π/8", "π/4"]),
        ((-np.pi / 2, np.pi / 2), ["−π/2", "0", "π/2"]),
        ((0.4, 2.5), ["π/4", "π/2", "3π/4"]),
    ],
)
def test_ticks_of_short_ranges_are_fractions_of_pi(bounds: tuple[float, float], labels: list[str]) -> None:
    arm = rp.planar_arm("RR", limits=[bounds, (-1.0, 1.0)])
    axes = rp.cspace(rp.Scene().with_arm("arm", arm), resolution=8).figure().axes[1]
    assert [label.get_text() for label in ticks_in_view(axes)[0]] == labels


def test_ticks_of_very_short_ranges_are_decimals() -> None:
    arm = rp.planar_arm("RR", limits=[(1.0, 1.1), (-1.0, 1.0)])
    axes = rp.cspace(rp.Scene().with_arm("arm", arm), resolution=8).figure().axes[1]
    labels = [label.get_text() for label in ticks_in_view(axes)[0]]
    assert len(labels) >= 2
    assert all(1.0 <= float(label) <= 1.1 for label in labels)


def test_a_name_moves_to_a_free_spot_or_goes() -> None:
    figure = Figure()
    axes = figure.subplots()
    here, there = np.array([0.5, 0.5]), np.array([0.5, 0.2])
    names = {
        "first": write_name(axes, "first", [here], "#ffffff"),
        "second": write_name(axes, "second", [here, there], "#ffffff"),
        "third": write_name(axes, "third", [here, there], "#ffffff"),
        "edge": write_name(axes, "edge", [np.array([1.0, 0.8])], "#ffffff"),
        "outside": write_name(axes, "outside", [np.array([1.5, 0.8])], "#ffffff"),
    }
    left = place_names(axes, names)
    assert list(left) == ["first", "second", "edge"]
    assert {text.get_text() for text in axes.texts} == set(left)
    assert left["second"].text.get_position() == pytest.approx(tuple(there))
    box = left["edge"].text.get_window_extent()
    assert box.x1 <= axes.get_window_extent().x1
    assert place_names(axes, left) == left


def test_names_are_text_not_formulas(planar2r: rp.Robot, tmp_path: Path) -> None:
    name = r"$\nothing{$"
    scene = rp.Scene(name=name).with_arm(name, planar2r).with_arm("other", planar2r, [9.0, 0.0, 0.0])
    motion = rp.Trajectory.from_samples(scene.joint_names(), [0.0, 1.0], np.array([[0.0], [0.1]]) * np.ones(4))
    line = rp.timeline(motion, scene).save(tmp_path / "line.svg")
    alone = scene.without_arm("other").with_obstacle(name[::-1], rp.Sphere(0.1), [0.5, 0.5, 0.0])
    space = rp.cspace(alone, resolution=24).save_svg(tmp_path / "space.svg")
    assert line.stat().st_size > 1000
    assert space.stat().st_size > 1000
    assert trajectory_svg(motion)


def test_axes_number_joints_as_the_arm_does(pictures: dict[str, rp.CSpace], figures: dict[str, Figure]) -> None:
    axes = figures["rr1_table elbow"].axes[1]
    assert axes.get_xlabel().startswith("θ₁ shoulder_joint")
    assert axes.get_ylabel().startswith("θ₃ elbow_joint")
