"""Data of the lesson page: components, the tree from its roots, the arm as two bars, one true sentence."""

from __future__ import annotations

import base64
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rr1plan as rp
from rr1plan import CSpace
from rr1plan.errors import InputError
from rr1plan.planning import SearchTree
from rr1plan.playback.cspace.cspace_verdict import verdict
from rr1plan.playback.cspace.cspace_viewer import show_page
from rr1plan.playback.viewer.page_arrays import unpack_array
from rr1plan.robot import Joint, Link, Robot
from rr1plan.robot.joint_limits import Limits
from rr1plan.scene.model_library import load_problems


@pytest.fixture(scope="module")
def lesson() -> rp.CSpace:
    problem = load_problems("planar2r_path")["over_the_seam"]
    return rp.cspace(problem.scene, problem, result=rp.plan(problem, rng=0), resolution=48)


@pytest.fixture(scope="module")
def hopeless() -> rp.CSpace:
    problem = load_problems("planar2r_no_path")["no_way"]
    return rp.cspace(problem.scene, problem, resolution=72)


def told(file: Path) -> dict[str, Any]:
    """The panel's data in a page."""
    found = re.search(r'<script type="application/json" id="settings">(.*?)</script>', file.read_text("utf-8"), re.S)
    assert found is not None
    (panel,) = json.loads(found.group(1))["panels"]
    data: dict[str, Any] = panel["data"]
    return data


def test_cells_are_sent_as_bits(lesson: rp.CSpace, tmp_path: Path) -> None:
    data = told(lesson.save_html(tmp_path / "page.html"))
    assert data["size"] == [48, 48]
    np.testing.assert_allclose([data["low"], data["high"]], [[-np.pi] * 2, [np.pi] * 2])
    for layer in data["layers"]:
        sent = np.frombuffer(base64.b64decode(layer["cells"]["data"]), dtype=np.uint8)
        bits = np.unpackbits(sent, bitorder="little")[: 48 * 48].reshape(48, 48)
        assert (bits == lesson.grid.layers[layer["name"]]).all()


def test_the_starts_component_comes_first_and_the_goals_next(hopeless: rp.CSpace, tmp_path: Path) -> None:
    data, grid = told(hopeless.save_html(tmp_path / "page.html")), hopeless.grid
    labels = unpack_array(data["labels"]).view(np.uint8)[: grid.free.size].reshape(grid.free.shape)
    assert hopeless.start is not None
    assert labels[grid.cell(hopeless.start)] == 1
    assert labels[grid.cell(hopeless.goals[0])] == 2
    assert ((labels > 0) == grid.free).all()


def test_the_sentence_is_true(lesson: rp.CSpace, hopeless: rp.CSpace) -> None:
    assert verdict(lesson) == "Start and goal lie in the same component of free space; the path leads over the seam."
    assert verdict(hopeless).startswith("No path exists: start and goal are free")
    grid = lesson.grid
    inside = np.argwhere(grid.layers["red"])[0]
    blocked = np.array([grid.axes[0][inside[0]], grid.axes[1][inside[1]]])
    assert verdict(CSpace(grid, blocked, lesson.goals)).startswith("The start is not free: red")
    assert "no configuration that reaches the goal is free" in verdict(CSpace(grid, lesson.start, (blocked,)))
    assert verdict(CSpace(grid, lesson.start, lesson.goals)).endswith("free space.")
    assert "1 component of free space" in verdict(CSpace(grid))


def test_a_tree_without_edges_is_no_trouble(lesson: rp.CSpace, tmp_path: Path) -> None:
    tree = SearchTree(np.array([[0.2, -0.9]]), np.zeros((0, 2), dtype=np.int64))
    picture = CSpace(lesson.grid, lesson.start, lesson.goals, None, tree)
    assert told(picture.save_html(tmp_path / "page.html"))["tree"] is None


def test_only_a_planar_arm_of_two_joints_is_two_bars(lesson: rp.CSpace, rr1_table: rp.Scene, tmp_path: Path) -> None:
    def planar(picture: rp.CSpace) -> dict[str, Any] | None:
        return told(picture.save_html(tmp_path / "page.html"))["planar"]

    bars = planar(lesson)
    assert bars is not None
    np.testing.assert_allclose(bars["bars"], [[1.0, 0.0], [0.7, 0.0]], atol=1e-12)
    moved = rp.Scene().with_arm(
        "arm", rp.load_robot("planar2r"), rp.transforms.pose([1.0, 2.0, 0.5], rpy=[np.pi, 0, 1])
    )
    turned = planar(rp.cspace(moved, resolution=8))
    assert turned is not None
    assert turned["senses"] == [-1.0, -1.0]
    np.testing.assert_allclose(turned["base"], [1.0, 2.0, 0.5])
    upright = rp.Scene().with_arm("arm", rp.load_robot("planar2r"), rp.transforms.pose([0, 0, 0], rpy=[1.0, 0, 0]))
    assert planar(rp.cspace(upright, resolution=8)) is None
    assert planar(rp.cspace(rr1_table, resolution=8)) is None


def test_a_motion_of_other_joints_is_refused(lesson: rp.CSpace, tmp_path: Path) -> None:
    other = rp.Trajectory.rest(("arm/joint1", "arm/elbow"), np.zeros(2))
    with pytest.raises(InputError, match=r"moves arm/joint1, arm/elbow, expected the joints shown"):
        lesson.save_html(tmp_path / "page.html", trajectory=other)
    assert list(tmp_path.iterdir()) == []


def test_the_page_can_be_live(lesson: rp.CSpace) -> None:
    with show_page(lesson, options=rp.ViewOptions(port=0, quiet=True)) as viewer:
        assert viewer.url.startswith("http://127.0.0.1:")
        viewer.update({"arm": [0.1, 0.2]})
    assert viewer.closed


def test_a_live_page_takes_scenes_and_refuses_what_does_not_fit(lesson: rp.CSpace, hopeless: rp.CSpace) -> None:
    scene, said = hopeless.grid.scene, "&quot;verdict&quot;:&quot;No path exists"
    with show_page(lesson, options=rp.ViewOptions(port=0, quiet=True)) as viewer:
        viewer.load(scene)
        assert "planar2r_no_path" in viewer._repr_html_()
        assert said not in viewer._repr_html_()
        viewer.load(hopeless)
        assert said in viewer._repr_html_()
        with pytest.raises(InputError, match="arm 'slider' has 1 joint"):
            viewer.load(rp.Scene().with_arm("slider", one_joint()))
        with pytest.raises(InputError, match="the path moves arm/joint2, arm/joint1, expected the joints shown"):
            viewer.load(scene, path=rp.Path(("arm/joint2", "arm/joint1"), np.zeros((2, 2))))
        assert said in viewer._repr_html_()


def one_joint() -> rp.Robot:
    joint = Joint("slide", "prismatic", "base", "tip", lower=-1, upper=1)
    one = np.ones(1)
    return Robot(
        "one",
        (Link("base"), Link("tip")),
        (joint,),
        ("slide",),
        Limits(-one, *[one] * 5),
        {"home": np.zeros(1)},
        {},
        frozenset(),
        "tip",
    )
