"""The compiled chain of joints against Pinocchio."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from rr1plan.kernels.planner_kernels import load_library
from rr1plan.model import Kinematics
from rr1plan.model.arm_model import joint_axis
from rr1plan.model.ik_descent import Target, errors_at, position_at
from rr1plan.model.kinematic_chain import Chain, chain_of
from rr1plan.scene import Arm, Scene
from rr1plan.transforms import pose

ROBOTS = ["rr1", "planar2r", "odd_arm", "redundant_arm", "wrist_arm"]


def flat(T):
    return np.concatenate([T[:3, :3].ravel(), T[:3, 3]])


def error_and_jacobian(chain, target, q):
    """The error (6,), its derivative (6, nq), and how many entries of both count."""
    error, jacobian = np.empty(6), np.empty((len(q), 6))
    rows = load_library().rr1_chain_jacobian(chain.struct, target.struct, q, len(q), error, jacobian)
    return error, jacobian.T, rows


@pytest.mark.parametrize("name", ROBOTS)
def test_every_link_is_where_pinocchio_has_it(name, request):
    robot = request.getfixturevalue(name)
    base = pose([0.2, 0.1, -0.3], rpy=[0.4, 0.1, -0.2])
    kinematics, rng = Kinematics(Scene({"it": Arm(robot, base)})), np.random.default_rng(1)
    for link in robot.link_names:
        chain = chain_of(kinematics.scene_model.arm_model, f"it/{link}")
        frame = np.empty(12)
        for _ in range(5):
            q = rng.uniform(-2.0, 2.0, robot.nq)
            load_library().rr1_chain_pose(chain.struct, q, frame)
            np.testing.assert_allclose(frame, flat(kinematics.pose(q, link)), atol=1e-12)
            np.testing.assert_array_equal(position_at(chain, q), frame[9:])


def test_a_chain_holds_only_what_is_driven(odd_arm, rr1):
    arm_model = Kinematics(odd_arm).scene_model.arm_model
    # Six planning joints and the one that mimics; the locked joint is part of a fixed transform.
    np.testing.assert_array_equal(chain_of(arm_model, "arm/h").joints[:, 1], [0, 1, 1, 2, 3, 4, 5])
    assert len(chain_of(arm_model, "arm/base").joints) == 0
    two = Kinematics(Scene({"left": Arm(rr1), "right": Arm(rr1, [0.0, 0.9, 0.0])})).scene_model.arm_model
    for first in (0, 6):
        columns = chain_of(two, f"right/{rr1.tool}", first).joints[:, 1]
        np.testing.assert_array_equal(columns, np.arange(6) + 6 - first)


@pytest.mark.parametrize("joint_kind", [pin.JointModelRevoluteUnaligned, pin.JointModelPrismaticUnaligned])
def test_the_axis_of_a_joint_needs_no_configuration(joint_kind):
    axis = np.array([0.6, 0.0, -0.8])
    joint = joint_kind(axis)
    # Its place in a configuration that no memory holds: reading it would be a segmentation fault.
    joint.setIndexes(1, 10**8, 10**8)
    slides, found = joint_axis(pin.JointModel(joint))
    assert slides is (joint_kind is pin.JointModelPrismaticUnaligned)
    np.testing.assert_array_equal(found, axis)


@pytest.mark.parametrize("name", ROBOTS)
def test_the_jacobian_is_pinocchios(name, request):
    robot = request.getfixturevalue(name)
    kinematics, rng = Kinematics(robot), np.random.default_rng(2)
    index = kinematics.scene_model.frame_id(f"arm/{robot.tool}")
    chain = chain_of(kinematics.scene_model.arm_model, f"arm/{robot.tool}")
    for _ in range(20):
        q = rng.uniform(-2.0, 2.0, robot.nq)
        p, R, J = kinematics.pose_and_jacobian(q, index)
        target = Target(p - 0.1, p - 0.1, R)
        _, jacobian, rows = error_and_jacobian(chain, target, q)
        expected = np.concatenate([J[:3], target.struct.value.weight * J[3:]])
        np.testing.assert_allclose(jacobian, expected, atol=1e-12)
        assert rows == 6
        _, jacobian, rows = error_and_jacobian(chain, Target(p - 0.1, p - 0.1, None), q)
        np.testing.assert_allclose(jacobian[:3], J[:3], atol=1e-12)
        assert rows == 3


def test_a_coordinate_inside_its_box_may_change(rr1):
    kinematics = Kinematics(rr1)
    chain, q = chain_of(kinematics.scene_model.arm_model, f"arm/{rr1.tool}"), rr1.home
    p = kinematics.pose(q)[:3, 3]
    low, high = np.array([[-0.1, -0.3, -0.1], [0.1, -0.2, 0.1]])
    target = Target(p + low, p + high, None)
    error, jacobian, _ = error_and_jacobian(chain, target, q)
    np.testing.assert_allclose(error[:3], [0.0, 0.2, 0.0], atol=1e-12)
    assert (jacobian[[0, 2]] == 0.0).all()
    assert (jacobian[1] != 0.0).any()


ANGLES = st.one_of(st.floats(0.0, np.pi), st.floats(-16.0, -1.0).map(lambda x: np.pi - 10.0**x))


@settings(deadline=None, max_examples=200)
@given(st.integers(0, 10**6), ANGLES)
@example(0, 0.0)
@example(1, np.pi)
@example(2, 1e-9)
@example(3, np.pi - 1e-8)
def test_the_turn_between_rotations_undoes_itself(seed, angle):
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    wanted = pin.exp3(rng.normal(size=3))
    # A chain without joints: its frame is where its only link is.
    link = np.concatenate([(pin.exp3(angle * axis) @ wanted).ravel(), np.zeros(5)])[None]
    chain, target = Chain(np.zeros((0, 2), np.int64), link), Target(np.zeros(3), np.zeros(3), wanted)
    error, _, _ = error_and_jacobian(chain, target, np.zeros(0))
    turn = error[3:] / target.struct.value.weight
    np.testing.assert_allclose(np.linalg.norm(turn), angle, atol=2e-8)
    np.testing.assert_allclose(pin.exp3(turn), pin.exp3(angle * axis), atol=4e-8)
    if angle < 3.0:
        np.testing.assert_allclose(turn, angle * axis, atol=1e-12)


def test_errors_are_distance_and_angle(rr1):
    kinematics = Kinematics(rr1)
    chain = chain_of(kinematics.scene_model.arm_model, f"arm/{rr1.tool}")
    T = kinematics.pose(rr1.home)
    aim = T[:3, 3] + [0.03, 0.0, 0.04]
    target = Target(aim, aim, pin.exp3(np.array([0.0, 0.6, 0.8])) @ T[:3, :3])
    assert errors_at(chain, target, rr1.home) == pytest.approx((0.05, 1.0))
    assert errors_at(chain, Target(aim, aim, None), rr1.home) == pytest.approx((0.05, 0.0))
