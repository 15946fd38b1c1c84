"""Descriptions from other sources get the same checks as those of the URDF reader."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.errors import InputError
from rr1plan.robot import Geometry, Inertial, Mimic, Robot, check_robot


def with_joint(robot: Robot, which: str, **changes: Any) -> Robot:
    return replace(robot, joints=tuple(replace(j, **changes) if j.name == which else j for j in robot.joints))


def with_link(robot: Robot, which: str, **changes: Any) -> Robot:
    return replace(robot, links=tuple(replace(part, **changes) if part.name == which else part for part in robot.links))


@pytest.mark.parametrize("name", rp.robot_names())
def test_shipped_robots_are_robots_with_any_preset(name: str) -> None:
    robot = rp.load_robot(name)
    assert check_robot(robot) is robot
    for preset in robot.presets:
        check_robot(robot.with_limits(preset))


def test_an_arm_with_mimic_joints_and_a_gripper_is_a_robot(rr1: Robot) -> None:
    assert rr1.locked_joints
    assert any(joint.mimic for joint in rr1.joints)
    check_robot(rr1)


BROKEN: list[tuple[Callable[[Robot], Robot], str]] = [
    (lambda r: with_joint(r, "joint1", axis=np.array([0.0, 0.0, 2.0])), "axis of joint 'joint1'"),
    (lambda r: with_joint(r, "joint1", axis=np.zeros(3)), "axis of joint 'joint1'"),
    (lambda r: with_joint(r, "joint1", origin=np.zeros((4, 4))), "origin of joint 'joint1' is not a rigid transform"),
    (lambda r: with_joint(r, "joint1", lower=1.0, upper=-1.0), "joint 'joint1' has limits"),
    (lambda r: with_joint(r, "joint1", lower=np.nan), "joint 'joint1' has limits"),
    (lambda r: with_joint(r, "joint1", velocity=0.0), "joint 'joint1' has limits"),
    (lambda r: with_joint(r, "joint1", kind="revolute", lower=-np.inf), "position limits of joint 'joint1'"),
    (lambda r: with_joint(r, "joint1", damping=-1.0), "damping of joint 'joint1'"),
    (lambda r: with_joint(r, "joint1", parent="link2"), "joint 'joint1' hangs on 'link2'"),
    (lambda r: with_joint(r, "joint2", child="link1"), "joint 'joint2' moves 'link1'"),
    (lambda r: with_joint(r, "joint2", name="joint1"), "two joints named 'joint1'"),
    (lambda r: with_joint(r, "joint1", kind="fixed"), "unknown independent joint 'joint1'"),
    (lambda r: with_joint(r, "joint2", mimic=Mimic("joint9")), "unknown joint 'joint9'"),
    (lambda r: with_joint(r, "joint2", mimic=Mimic("joint2")), "mimic each other in a circle"),
    (lambda r: with_link(r, "link2", name="link1"), "two links named 'link1'"),
    (lambda r: replace(r, links=r.links[:-1], tool="link1"), "expected the links"),
    (lambda r: with_link(r, "link1", inertial=Inertial(-1.0, np.zeros(3), np.eye(3))), "link 'link1' has mass -1"),
    (lambda r: with_link(r, "link1", inertial=Inertial(1.0, np.zeros(3), -np.eye(3))), "inertia of link 'link1'"),
    (lambda r: with_link(r, "link1", inertial=Inertial(1.0, np.zeros(2), np.eye(3))), "center of mass of link"),
    (lambda r: replace(r, locked_joints={"joint1": 0.0}), "joint 'joint1' is both planned for and locked"),
    (lambda r: replace(r, locked_joints={"joint9": 0.0}), "unknown independent joint 'joint9'"),
    (lambda r: replace(r, disabled_collisions=frozenset({frozenset({"link1", "link9"})})), "unknown link 'link9'"),
    (lambda r: replace(r, presets={"one": rp.load_robot("rr1").limits}), "preset 'one' has limits for 6 of 2"),
    (lambda r: replace(r, locked_joint_states={"open": {"joint9": 0.0}}), "unknown locked joint 'joint9'"),
    (lambda r: replace(r, configurations={**r.configurations, "far": [1e9, 0.0]}), "configuration 'far'"),
]


@pytest.mark.parametrize(("break_it", "words"), BROKEN)
def test_what_does_not_fit_is_named(planar2r: Robot, break_it: Callable[[Robot], Robot], words: str) -> None:
    with pytest.raises(InputError, match=words):
        check_robot(break_it(planar2r))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"shape": "box"}, "shape 'x' is of type str"),
        ({"name": 3}, "name of a shape is of type int"),
        ({"pose": np.zeros((4, 4))}, "pose of shape 'x' is not a rigid transform"),
        ({"color": (1.0, 0.0)}, r"color of shape 'x' is \(1.0, 0.0\), expected '#rrggbb' or 3 or 4 numbers"),
        ({"color": "red"}, "color of shape 'x': expected '#rrggbb' or '#rrggbbaa', got 'red'"),
        ({"color": (2.0, 0.0, 0.0, 1.0)}, "color of shape 'x'.*from 0 to 1"),
        ({"color": (np.nan, 0.0, 0.0, 1.0)}, "color of shape 'x'.*finite"),
    ],
)
def test_a_posed_shape_is_checked_where_it_is_made(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        Geometry(**{"name": "x", "shape": rp.Sphere(0.1), **changes})


def test_a_color_is_text_or_numbers() -> None:
    assert Geometry("x", rp.Sphere(0.1), color="#ff0000").color == (1.0, 0.0, 0.0, 1.0)
    assert Geometry("x", rp.Sphere(0.1), color="#00FF0000").color == (0.0, 1.0, 0.0, 0.0)
    assert Geometry("x", rp.Sphere(0.1), color=np.array([0.0, 0.5, 1.0])).color == (0.0, 0.5, 1.0, 1.0)
    scene = rp.Scene().with_obstacle("x", rp.Sphere(0.1), color="#0000ff")
    assert scene.obstacles["x"].geometries[0].color == (0.0, 0.0, 1.0, 1.0)
