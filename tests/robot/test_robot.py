"""The robot value: read-only, consistent, and with plain kinematics."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest
from concave_meshes import open_bowl
from hypothesis import given, settings
from hypothesis import strategies as st

import rr1plan as rp
from rr1plan.errors import InputError, UnknownNameError
from rr1plan.robot import Geometry, Joint, Mimic
from rr1plan.shapes.convex_hulls import convex_hull


def test_arrays_are_read_only_and_stay_so_after_pickling(rr1: rp.Robot) -> None:
    for robot in (rr1, pickle.loads(pickle.dumps(rr1))):
        for array in (robot.home, robot.limits.lower, robot.continuous, robot.joints[0].origin):
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 1.0
        with pytest.raises(TypeError):
            robot.configurations["new"] = robot.home
        with pytest.raises(FrozenInstanceError):
            robot.name = "other"


def test_concave_meshes_are_named_by_their_links(planar2r: rp.Robot) -> None:
    bowl, hull = open_bowl(), convex_hull(open_bowl().vertices)
    one, two, *rest = planar2r.links
    shapes = [Geometry("bowl", bowl), Geometry("hull", hull), Geometry("box", rp.Box((0.1, 0.1, 0.1)))]
    robot = replace(planar2r, links=(one, replace(two, collisions=(*two.collisions, *shapes)), *rest))
    assert planar2r.concave_meshes == ()
    assert robot.concave_meshes == ((two.name, bowl),)


def test_a_robot_is_shown_in_a_line(planar2r: rp.Robot) -> None:
    assert repr(planar2r) == "Robot('planar2r', joints=[joint1, joint2])"


def test_pickling_keeps_the_content(rr1: rp.Robot) -> None:
    again = pickle.loads(pickle.dumps(rr1))
    assert again.content_hash == rr1.content_hash
    assert np.array_equal(again.link_poses("home")["tool"], rr1.link_poses("home")["tool"])


def test_the_hash_changes_with_what_plans_depend_on(rr1: rp.Robot) -> None:
    others = [
        rr1.with_limits("hardware"),
        rr1.with_locked_joints("open"),
        replace(rr1, disabled_collisions=frozenset()),
        replace(rr1, links=(replace(rr1.links[0], collisions=()), *rr1.links[1:])),
    ]
    assert len({r.content_hash for r in (rr1, *others)}) == 5
    assert rp.load_robot("rr1").content_hash == rr1.content_hash


def test_a_configuration_comes_from_its_name_or_its_numbers(rr1: rp.Robot) -> None:
    assert np.array_equal(rr1.configuration("zero"), np.zeros(6))
    assert np.array_equal(rr1.configuration([1, 2, 3, 4, 5, 6]), [1, 2, 3, 4, 5, 6])
    with pytest.raises(UnknownNameError, match="'home'"):
        rr1.configuration("hoem")


class Tensor:
    """An array as of other libraries: its elements are arrays without dimensions."""

    def __init__(self, values: object) -> None:
        self.values = np.array(values)

    def __array__(self, dtype: object = None, copy: bool | None = None) -> np.ndarray:
        return np.array(self.values, dtype=dtype)

    def __iter__(self) -> Iterator[Tensor]:
        return map(Tensor, self.values)


def test_a_configuration_comes_from_the_arrays_of_other_libraries(rr1: rp.Robot) -> None:
    values = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    for array in (Tensor(values), list(map(np.array, values))):
        assert np.array_equal(rr1.configuration(array), values)
    with pytest.raises(InputError, match="elbow_joint"):
        rr1.configuration(Tensor([0, 0, np.nan, 0, 0, 0]))


@pytest.mark.parametrize("bad", [[0.0] * 5, [0.0] * 7, [[0.0] * 6], 3.0])
def test_a_configuration_of_another_shape_names_the_joints(rr1: rp.Robot, bad: object) -> None:
    with pytest.raises(InputError, match="wrist_joint"):
        rr1.configuration(bad)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_number_that_is_not_finite_names_its_joint(rr1: rp.Robot, value: float) -> None:
    with pytest.raises(InputError, match="elbow_joint"):
        rr1.configuration([0, 0, value, 0, 0, 0])


def test_unknown_names_are_answered_with_the_near_ones(rr1: rp.Robot) -> None:
    with pytest.raises(UnknownNameError, match="elbow_joint"):
        rr1.joint("elbow_jiont")
    with pytest.raises(UnknownNameError, match="hand_link"):
        rr1.link("hand_lnk")
    with pytest.raises(UnknownNameError, match="hardware"):
        rr1.with_limits("hardwar")
    with pytest.raises(UnknownNameError, match="open"):
        rr1.with_locked_joints("opened")
    with pytest.raises(UnknownNameError, match="finger_joint"):
        rr1.with_locked_joints({"fingr_joint": 0.0})


@pytest.mark.parametrize("value", [-0.1, 2.0, np.nan])
def test_a_gripper_stays_in_its_limits(rr1: rp.Robot, value: float) -> None:
    with pytest.raises(InputError, match="finger_joint"):
        rr1.with_locked_joints({"finger_joint": value})


def test_the_fingers_follow_each_other(rr1: rp.Robot) -> None:
    values = rr1.with_locked_joints({"finger_joint": 0.7}).joint_values(rr1.home)
    assert values["opposite_finger_joint"] == values["finger_joint"] == 0.7


def test_a_mimic_of_a_mimic_is_resolved_in_any_order(planar2r: rp.Robot) -> None:
    tail = planar2r.joints[-1]
    extra = (
        Joint("a", "revolute", "link2", "x", mimic=Mimic("b", 2.0, 1.0)),
        Joint("b", "revolute", "link2", "y", mimic=Mimic("joint1", -1.0, 0.5)),
    )
    robot = replace(planar2r, joints=(*planar2r.joints[:-1], *extra, tail))
    values = robot.joint_values(np.array([0.2, 0.0]))
    assert values["b"] == pytest.approx(0.3)
    assert values["a"] == pytest.approx(1.6)


def test_a_joint_without_a_value_is_an_error_not_a_zero(rr1: rp.Robot) -> None:
    with pytest.raises(InputError, match="finger_joint"):
        replace(rr1, locked_joints={}).joint_values(rr1.home)


def test_a_robot_needs_a_home_and_limits_for_each_joint(rr1: rp.Robot) -> None:
    with pytest.raises(InputError, match="home"):
        replace(rr1, configurations={})
    with pytest.raises(InputError, match="limits for 6 of 5"):
        replace(rr1, joint_names=rr1.joint_names[:5], configurations={"home": np.zeros(5)})
    with pytest.raises(UnknownNameError, match="tool"):
        replace(rr1, tool="toool")


@settings(deadline=None, max_examples=100)
@given(q1=st.floats(-10, 10), q2=st.floats(-10, 10))
def test_the_planar_arm_reaches_where_the_textbook_says(q1: float, q2: float) -> None:
    robot = rp.load_robot("planar2r")
    tip = robot.link_poses([q1, q2])["tool"][:3, 3]
    expected = [np.cos(q1) + 0.7 * np.cos(q1 + q2), np.sin(q1) + 0.7 * np.sin(q1 + q2), 0]
    assert np.abs(tip - expected).max() < 1e-12


def test_a_chain_of_a_group_ends_at_a_link_that_it_moves() -> None:
    with pytest.raises(rp.InputError, match="no joint below 'hand_link' moves 'base_link'"):
        rp.load_robot("rr1", groups=[("hand_link", "base_link")])
