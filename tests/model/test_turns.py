"""Whole turns of rotary joints."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from rr1plan.model import Kinematics, copies_within_limits, nearest_copy

ANGLES = st.lists(st.floats(-30.0, 30.0), min_size=6, max_size=6).map(np.array)


@settings(deadline=None, max_examples=60)
@given(q=ANGLES, near=ANGLES)
def test_the_nearest_copy_is_the_same_place_within_half_a_turn_on_continuous_joints(odd_arm, q, near):
    copy = nearest_copy(odd_arm, q, near)
    np.testing.assert_allclose(Kinematics(odd_arm).pose(copy), Kinematics(odd_arm).pose(q), atol=1e-12)
    endless = odd_arm.continuous > 0
    assert (np.abs(copy - near)[endless] <= np.pi + 1e-9).all()
    assert copy[2] == q[2]


def test_joints_with_limits_come_back_into_them_unless_a_mimic_joint_would_not(odd_arm):
    turn = 2 * np.pi
    q = np.array([0.0, 1.0 + turn, 0.0, 1.0 + turn, 1.0, 0.0])
    copy = nearest_copy(odd_arm, q, np.array([0.0, -1.5, 0.0, 7.0, 0.0, 0.0]))
    np.testing.assert_allclose(copy, [0.0, 1.0 + turn, 0.0, 1.0, 1.0, 0.0], atol=1e-12)


def test_wide_limits_hold_several_copies_nearest_first(redundant_arm):
    q = np.array([1.0, 0.5, 0.2, -0.3, 0.4, 0.1, -2.0])
    copies = copies_within_limits(redundant_arm, q, q)
    far = np.linalg.norm(copies - q, axis=1)
    assert (np.diff(far) >= 0).all()
    np.testing.assert_array_equal(copies[0], q)
    assert sorted(set(np.round(copies[:, 0], 9))) == [round(1.0 - 2 * np.pi, 9), 1.0]
    assert sorted(set(np.round(copies[:, 6], 9))) == [-2.0, round(-2.0 + 2 * np.pi, 9)]
    assert len(copies) == 4
    kinematics = Kinematics(redundant_arm)
    for copy in copies:
        assert (copy >= redundant_arm.limits.lower).all()
        assert (copy <= redundant_arm.limits.upper).all()
        np.testing.assert_allclose(kinematics.pose(copy), kinematics.pose(q), atol=1e-12)
