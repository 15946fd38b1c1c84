"""Construction of MuJoCo models of scenes; their behavior is in `test_simulation`."""

from __future__ import annotations

import re
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import rr1plan as rp
from rr1plan.playback.simulation import mujoco_model
from rr1plan.playback.simulation.mujoco_model import build_mujoco
from rr1plan.transforms import pose

# What collision bits replace.
EXCLUSIONS = re.compile("contype|conaffinity|exclude|^name")


def arrays(model: mujoco.MjModel) -> dict[str, np.ndarray[Any, Any]]:
    """The arrays of a model by name, without those in which collision bits and exclusions differ."""
    values = ((name, getattr(model, name)) for name in dir(model) if not EXCLUSIONS.search(name) and name[0] != "_")
    return {name: value.copy() for name, value in values if isinstance(value, np.ndarray)}


def assert_same(found: mujoco.MjModel, expected: mujoco.MjModel) -> None:
    one, other = arrays(found), arrays(expected)
    assert len(one) > 100
    assert one.keys() == other.keys()
    for name, values in one.items():
        np.testing.assert_array_equal(values, other[name], err_msg=name)


def mixed_team(count: int) -> rp.Scene:
    """RR1 and Panda arms in a row, one of which holds a box, with a floor and a loose ball."""
    robots = [rp.load_robot(name) for name in ("rr1", "panda")]
    scene = rp.Scene()
    for i in range(count):
        scene = scene.with_arm(f"arm{i}", robots[i % 2], pose([1.2 * i, 0.0, 0.0], rpy=[0.0, 0.0, 0.3 * i]))
    scene = scene.with_obstacle("floor", rp.HalfSpace((0.0, 0.0, 1.0), -0.05))
    scene = scene.with_obstacle("ball", rp.Sphere(0.05), [0.6, 0.5, 1.0], mass=0.2)
    return scene.with_obstacle("box", rp.Box((0.02, 0.02, 0.1)), [1.2, 0.0, 1.5]).attach("box", "arm1")


@pytest.fixture
def team() -> rp.Scene:
    return mixed_team(5)


def test_inertias_that_no_body_can_have_are_corrected_in_arms_of_groups_too(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = rp.load_robot("planar2r")
    inertial = rp.Inertial(1.0, np.zeros(3), np.diag([1e-3, 1e-3, 2.5e-3]))
    robot = replace(robot, links=tuple(replace(link, inertial=inertial) for link in robot.links))
    scene = rp.Scene()
    for i in range(3):
        scene = scene.with_arm(f"arm{i}", robot, [3.0 * i, 0.0, 0.0])
    alone = build_mujoco(scene).model
    monkeypatch.setattr(mujoco_model, "_MANY", 2)
    assert_same(build_mujoco(scene).model, alone)


@pytest.mark.parametrize(
    ("moments", "built"),
    [
        ((1.234565e-3, 2.345675e-3, 3.58024e-3), (1.234565e-3, 2.345675e-3, 3.58024e-3)),  # a plate
        ((1e-3, 1e-3, 5e-3), (1e-3, 1e-3, 2e-3)),  # no body
        ((1.2e-13, 1.2e-4, 1.2e-4), (4.8e-9, 1.2e-4, 1.2e-4)),  # a rod without thickness
    ],
)
def test_only_moments_that_no_body_can_have_are_corrected(
    moments: tuple[float, ...], built: tuple[float, ...], tmp_path: Path
) -> None:
    robot = rp.load_robot("planar2r")
    for turn in np.linspace(0.0, 3.0, 20):
        axes = pose([0.0, 0.0, 0.0], rpy=[turn, 0.8 * turn, 0.7 * turn])[:3, :3]
        inertial = rp.Inertial(1.0, np.zeros(3), axes @ np.diag(moments) @ axes.T)
        links = tuple(replace(link, inertial=inertial) for link in robot.links)
        scene = rp.Scene().with_arm("arm", replace(robot, links=links))
        model = build_mujoco(scene).model
        moving = model.body_inertia[model.body_dofnum > 0]
        assert len(moving) == 2
        np.testing.assert_allclose(np.sort(moving), np.tile(built, (2, 1)), rtol=1e-4)
        assert rp.load_robot(rp.save_mjcf(tmp_path / "arm.xml", scene)).nq == 2


def test_arms_that_are_added_in_groups_are_the_same_model_without_a_warning(
    team: rp.Scene, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    expected, saved = build_mujoco(team), rp.save_mjcf(tmp_path / "expected.xml", team)
    monkeypatch.setattr(mujoco_model, "_MANY", 2)
    monkeypatch.chdir(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = build_mujoco(team)
        file = rp.save_mjcf(tmp_path / "team.xml", team)
    assert_same(found.model, expected.model)
    assert found.geom_elements == expected.geom_elements
    assert found.joint_names == expected.joint_names
    assert capfd.readouterr().err == ""
    assert sorted(path.name for path in tmp_path.iterdir()) == ["expected.xml", "team.xml"]
    assert_same(*(mujoco.MjModel.from_xml_path(str(path)) for path in (file, saved)))


@pytest.mark.parametrize("name", ["rr1", "panda", "planar2r"])
def test_the_editable_model_is_the_compiled_one(name: str) -> None:
    world = build_mujoco(rp.Scene().with_arm("arm", rp.load_robot(name)))
    assert_same(world.spec.compile(), world.model)


def test_a_hundred_contacts_of_each_arm_have_room_in_memory(rr1: rp.Robot) -> None:
    arms = {f"r{i}": rp.Arm(rr1, pose([0.25 * (i % 5), 0.25 * (i // 5), 0.0])) for i in range(25)}
    world = build_mujoco(rp.Scene(arms=arms))
    data = mujoco.MjData(world.model)
    mujoco.mj_step(world.model, data)
    assert data.ncon > 100 * len(arms)
    assert data.maxuse_arena < world.model.narena
    assert not any(warning.number for warning in data.warning)
