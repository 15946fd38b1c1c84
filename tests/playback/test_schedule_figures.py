"""Time lines and coordination diagrams: their content, and valid output files."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.text import Text

import rr1plan as rp
from rr1plan.playback.arm_colors import ARM_COLORS, arm_color

PAGE = Path(rp.__file__).parent / "playback" / "viewer" / "page"


def moving(names: tuple[str, ...], breaks: list[float], rates: list[list[float]]) -> rp.Trajectory:
    """A trajectory of steady speeds, a row for each piece."""
    speeds = np.array(rates)
    steps = speeds * np.diff(breaks)[:, None]
    positions = np.concatenate([np.zeros((1, len(names))), np.cumsum(steps, axis=0)[:-1]])
    return rp.Trajectory(names, breaks, np.stack([positions, speeds], axis=1))


@pytest.fixture
def two() -> rp.Scene:
    robot = rp.load_robot("planar2r")
    return rp.Scene(name="two").with_arm("a", robot).with_arm("b", robot, (1.5, 0.0, 0.0))


@pytest.fixture
def line(two: rp.Scene) -> rp.Timeline:
    """Arm a: moves, rests, moves; arm b: rests, moves, rests at its goal."""
    names = two.joint_names()
    rates = [[0.1, 0, 0, 0], [0, 0, 0.1, 0.1], [0.1, 0.2, 0, 0], [0, 0.1, 0, 0]]
    trajectory = moving(names, [0.0, 1.0, 2.0, 2.5, 3.0], rates)
    return rp.timeline(trajectory, two, waits=[rp.Wait("a", 1.1, 1.9, ("b",))], undelayed={"a": 2.0, "b": 1.0})


def test_motions_and_rests_are_those_of_the_trajectory(line: rp.Timeline) -> None:
    assert line.arms == ("a", "b")
    assert dict(line.motions) == {"a": ((0.0, 1.0), (2.0, 3.0)), "b": ((1.0, 2.0),)}
    assert line.waits == (rp.Wait("a", 1.0, 2.0, ("b",)), rp.Wait("b", 0.0, 1.0))
    assert (line.makespan, line.waiting) == (3.0, 2.0)
    assert (line.arrival("a"), line.arrival("b")) == (3.0, 2.0)
    assert "a waits for b from 1.000 to 2.000 s" in str(line)
    with pytest.raises(rp.UnknownNameError):
        line.arrival("c")


def test_a_motion_that_begins_later_has_its_own_clock(two: rp.Scene) -> None:
    trajectory = moving(two.joint_names(["b"]), [5.0, 6.0, 7.0], [[0.0, 0.0], [0.1, 0.0]])
    line = rp.timeline(trajectory, two)
    assert line.arms == ("b",)
    assert (line.start, line.makespan) == (5.0, 2.0)
    assert line.waits == (rp.Wait("b", 5.0, 6.0),)
    assert line.numbers["b"] == 1


def test_rests_of_less_than_a_millisecond_are_not_listed(two: rp.Scene) -> None:
    breaks, rates = [0.0, 1.0, 1.0 + 4e-4, 2.0, 2.002, 3.0], [[0.1, 0.1], [0.0, 0.0]] * 2 + [[0.1, 0.1]]
    line = rp.timeline(moving(two.joint_names(["b"]), breaks, rates), two)
    assert line.waits == (rp.Wait("b", 2.0, 2.002),)
    assert line.waiting == pytest.approx(0.002)


def test_contacts_of_a_report_are_marked(two: rp.Scene, tmp_path: Path) -> None:
    names = two.joint_names()
    swing = moving(names, [0.0, 4.0], [[0.0, 0.0, 0.7, 0.0]])
    report = rp.validate(swing, two)
    assert not report.valid
    line = rp.timeline(swing, two, report=report)
    assert line.conflicts
    assert all(violation.kind in ("collision", "undecided") for violation in line.conflicts)
    assert all(set(arms) <= {"a", "b"} and arms for arms in line.touching)
    data = line.panel().data
    assert data["conflicts"][0]["elements"] == list(line.conflicts[0].subject)
    text = line.save(tmp_path / "bad.svg").read_text()
    assert "#d1003f" in text


def test_numbers_of_conflicts_at_about_the_same_time_do_not_overlap(two: rp.Scene) -> None:
    swing = moving(two.joint_names(), [0.0, 4.0], [[0.0, 0.0, 0.7, 0.0]])
    report = rp.validate(swing, two)
    crowd = [replace(report.violations[0], time=1.0 + 1e-3 * k) for k in range(6)]
    figure = rp.timeline(swing, two, report=replace(report, violations=crowd)).figure()
    figure.canvas.draw()
    numbers = [text for text in figure.findobj(Text) if text.get_fontweight() == "bold"]
    assert sorted(text.get_text() for text in numbers) == [*"123456"]
    boxes = sorted((text.get_window_extent() for text in numbers), key=lambda box: box.x0)
    assert all(one.x1 <= two.x0 for one, two in pairwise(boxes))


def test_descriptions_of_conflicts_fit_into_narrow_figures(two: rp.Scene) -> None:
    swing = moving(two.joint_names(), [0.0, 4.0], [[0.0, 0.0, 0.7, 0.0]])
    line = rp.timeline(swing, two, report=rp.validate(swing, two))
    figure = line.figure(width=5.0)
    figure.canvas.draw()
    (words,) = (text for text in figure.findobj(Text) if "overlap" in text.get_text())
    assert words.get_window_extent().x1 <= figure.bbox.x1
    assert figure.axes[0].get_window_extent().width > 0.6 * figure.bbox.width


def test_what_is_no_time_line_is_refused(two: rp.Scene, line: rp.Timeline, tmp_path: Path) -> None:
    trajectory = moving(two.joint_names(), [0.0, 1.0], [[0.1] * 4])
    with pytest.raises(rp.InputError, match="one of the waits"):
        rp.timeline(trajectory, two, waits=[("a", 0.0, 1.0)])
    with pytest.raises(rp.UnknownNameError, match="moving arm"):
        rp.timeline(trajectory, two, waits=[rp.Wait("c", 0.0, 1.0)])
    with pytest.raises(rp.UnknownNameError, match="joint of the scene"):
        rp.timeline(moving(("c/x",), [0.0, 1.0], [[0.1]]), two)
    with pytest.raises(rp.InputError, match=r"ends in .png or .svg or .pdf"):
        line.save(tmp_path / "line.gif")
    with pytest.raises(rp.InputError, match="at most 100"):
        line.figure(width=101)


@pytest.mark.parametrize("dark", [False, True])
def test_files_are_what_their_names_say_and_repeat(line: rp.Timeline, tmp_path: Path, dark: bool) -> None:
    heads = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}
    for kind, head in heads.items():
        once, twice = (line.save(tmp_path / f"{k}.{kind}", dark=dark).read_bytes() for k in range(2))
        assert once.startswith(head)
        assert once == twice
    assert arm_color(0) in (tmp_path / "0.svg").read_text()


def test_bars_of_dark_arms_are_visible_on_the_dark_background(line: rp.Timeline) -> None:
    figure = line.figure(dark=True)
    paper = np.mean(to_rgb(figure.get_facecolor()))
    bars = [*figure.axes[0].collections]
    assert len(bars) == 4  # motions and rests of each arm
    assert all(np.mean(to_rgb(bar.get_edgecolor()[0])) > paper + 0.4 for bar in bars)


def diagram() -> rp.CoordinationDiagram:
    blocked = np.zeros((6, 5), np.uint8)
    blocked[2:4, 1:3] = 1
    lengths = np.array([0.0, 1.0, 2.0, 3.0, 4.0]), np.array([0.0, 1.0, 2.0, 3.0])
    undelayed = np.array([0.0, 2.0, 3.0, 4.0, 6.0]), np.array([0.0, 1.0, 2.0, 3.0])
    times = np.array([0.0, 3.0, 5.0, 9.0])
    places = np.array([[0.0, 0.0], [0.0, 3.0], [1.5, 3.0], [4.0, 3.0]])
    return rp.CoordinationDiagram(("a", "b"), (0, 1), blocked, lengths, undelayed, times, places)


def test_long_names_stay_inside_the_figures(line: rp.Timeline) -> None:
    names = ("one " * 30, "two " * 30)
    pair = replace(diagram(), names=names).figure()
    time_line = replace(line, name="a scene " * 30).figure()
    for figure in (pair, time_line):
        figure.draw_without_rendering()
    axes = pair.axes[0]
    named = [text for text in axes.findobj(Text) if any(word in text.get_text() for word in ("one", "two"))]
    titles = [text for text in time_line.texts if text.get_text().startswith("a scene")]
    assert (len(named), len(titles)) == (3, 1)
    for text in (*named, *titles):
        box, frame = text.get_window_extent(), text.figure.bbox
        assert 0.0 <= box.x0 < box.x1 <= frame.x1, text
        assert 0.0 <= box.y0 < box.y1 <= frame.y1, text


def test_long_names_of_arms_leave_room_for_the_time_line(planar2r: rp.Robot) -> None:
    scene = rp.Scene().with_arm("m" * 300, planar2r)
    figure = rp.timeline(moving(scene.joint_names(), [0.0, 1.0], [[0.1, 0.1]]), scene).figure()
    figure.draw_without_rendering()
    (label,) = figure.axes[0].get_yticklabels()
    assert label.get_text() == "m" * 59 + "…"
    assert label.get_window_extent().x0 >= 0.0


def test_a_diagram_has_axes_in_seconds_and_in_path_length(tmp_path: Path) -> None:
    picture = diagram()
    np.testing.assert_allclose(picture.curve("length"), [[0, 0], [0, 3], [1.5, 3], [4, 3]])
    np.testing.assert_allclose(picture.curve(), [[0, 0], [0, 3], [2.5, 3], [6, 3]])
    assert picture.blocked_share == pytest.approx(4 / 12)
    for axes in ("time", "length"):
        assert "a waits, 3.00 s" in "".join(
            text.get_text() for text in picture.figure(axes=axes).legends[0].get_texts()
        )
    assert picture.save(tmp_path / "d.pdf").read_bytes().startswith(b"%PDF")
    with pytest.raises(rp.UnknownNameError, match="axes"):
        picture.save(tmp_path / "d.png", axes="rad")


def test_rests_of_less_than_a_millisecond_are_no_waits_in_a_diagram() -> None:
    rounded = replace(diagram(), times=np.array([0.0, 3.0, np.nextafter(3.0, 4.0), 9.0]))
    rounded = replace(rounded, places=np.array([[0.0, 0.0], [2.0, 1.5], [2.0, 1.5], [4.0, 3.0]]))
    labels = [text.get_text() for text in rounded.figure().legends[0].get_texts()]
    assert labels == ["not proven free", "the plan", "at the start or goal"]


def test_axes_in_path_length_have_the_units_of_the_arms() -> None:
    scene = rp.Scene().with_arm("gantry", rp.planar_arm("PP")).with_arm("crane", rp.planar_arm("RP"), [5.0, 0.0, 0.0])
    starts, goals = {"gantry": [0.1, 0.1], "crane": [0.0, 0.1]}, {"gantry": [0.5, 0.2], "crane": [1.0, 0.2]}
    problem = rp.Problem(scene, starts, goals)
    motion = rp.plan_motion(problem, planner="many_arms", rng=0)
    axes = motion.coordination_diagram("gantry", "crane").figure(axes="length").axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("path of gantry [m]", "path of crane [rad and m]")


def test_an_arm_that_does_not_move_has_a_diagram_too() -> None:
    one, still = np.array([0.0, 1.0, 2.0]), np.zeros(1)
    blocked = np.zeros((4, 2), np.uint8)
    places = np.array([[0.0, 0.0], [2.0, 0.0]])
    picture = rp.CoordinationDiagram(
        ("a", "b"), (0, 1), blocked, (one, still), (one, still), np.array([0.0, 2.0]), places
    )
    assert picture.blocked_share == 0.0
    (axes,) = picture.figure().axes
    assert len(axes.get_xticks()) > 1
    assert axes.get_yticks().tolist() == [0.0]


# ---- colors --------------------------------------------------------------------------------------

# Machado, Oliveira and Fernandes 2009: linear RGB as eyes see it that lack one kind of cones.
_EYES = {
    "all cones": np.eye(3),
    "no L cones": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "no M cones": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "no S cones": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}
# Ottosson's Oklab.
_CONES = [[0.4122214708, 0.5363325363, 0.0514459929], [0.2119034982, 0.6806995451, 0.1073969566],
          [0.0883024619, 0.2817188376, 0.6299787005]]  # fmt: skip
_LAB = [[0.2104542553, 0.7936177850, -0.0040720468], [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660]]  # fmt: skip


def rgb(color: str) -> np.ndarray:
    return np.array([int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)])


@pytest.mark.parametrize("eyes", list(_EYES))
def test_ten_arms_are_told_apart_by_any_eyes(eyes: str) -> None:
    written = np.array([rgb(color) for color in ARM_COLORS])
    light = np.where(written <= 0.04045, written / 12.92, ((written + 0.055) / 1.055) ** 2.4)
    seen = np.clip(light @ np.array(_EYES[eyes]).T, 0.0, 1.0)
    lab = np.cbrt(seen @ np.array(_CONES).T) @ np.array(_LAB).T
    differences = np.linalg.norm(lab[:, None] - lab, axis=2)[np.triu_indices(len(lab), 1)]
    assert differences.min() > 0.10


def test_colors_of_more_arms_differ() -> None:
    assert len({arm_color(k) for k in range(200)}) == 200


def test_the_page_has_the_same_colors() -> None:
    text = (PAGE / "world.js").read_text()
    rows = re.search(r"const ARMS = \[(.*?)\];", text, re.S)
    assert rows
    page = [[float(v) for v in row.split(",")] for row in re.findall(r"\[([^\[\]]+)\]", rows[1])]
    np.testing.assert_allclose(page, [rgb(color) for color in ARM_COLORS], atol=1e-3)


def test_a_time_line_without_motion_has_an_axis_of_a_second(two: rp.Scene) -> None:
    q = np.zeros(4)
    still = rp.timeline(rp.Trajectory(two.joint_names(), [0.0], [[q]]), two, undelayed={"a": 0.0, "b": 0.0})
    figure = still.figure()
    assert figure.axes[0].get_xlim() == (0.0, 1.0)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["moves"]
