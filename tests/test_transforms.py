"""Rigid transforms and quaternions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rr1plan.errors import InputError
from rr1plan.transforms import (
    as_pose,
    identity,
    inverse,
    pose,
    quaternion_from_rotation,
    rotation_about,
    rotation_angle,
    rotation_from_quaternion,
    rotation_from_rpy,
)

angles = st.floats(-7.0, 7.0)
unit_quaternions = st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1)
X, Y, Z = np.eye(3)


@given(angles, angles, angles)
@settings(deadline=None, max_examples=100)
def test_rpy_turns_about_the_fixed_axes_x_then_y_then_z(roll: float, pitch: float, yaw: float) -> None:
    composed = rotation_about(Z, yaw) @ rotation_about(Y, pitch) @ rotation_about(X, roll)
    assert np.allclose(rotation_from_rpy(roll, pitch, yaw), composed, atol=1e-14)


@given(unit_quaternions)
@settings(deadline=None, max_examples=200)
def test_quaternions_survive_the_way_to_a_matrix_and_back(q: tuple[float, ...]) -> None:
    R = rotation_from_quaternion(q)
    assert np.allclose(R @ R.T, np.eye(3), atol=1e-14)
    assert np.isclose(np.linalg.det(R), 1.0)
    back = quaternion_from_rotation(R)
    assert back[0] >= 0.0
    unit = np.array(q) / np.linalg.norm(q)
    assert np.isclose(abs(back @ unit), 1.0, atol=1e-12)


@pytest.mark.parametrize("axis", [X, Y, Z, -X, np.array([1.0, -1.0, 0.0]) / np.sqrt(2)])
def test_half_turns_have_a_quaternion_and_an_angle(axis: np.ndarray) -> None:
    R = rotation_about(axis, np.pi)
    assert np.allclose(rotation_from_quaternion(quaternion_from_rotation(R)), R, atol=1e-15)
    assert np.isclose(rotation_angle(R), np.pi)


@given(st.floats(0.0, np.pi))
@settings(deadline=None, max_examples=50)
def test_the_angle_of_a_rotation_is_found_also_when_it_is_tiny(angle: float) -> None:
    assert np.isclose(rotation_angle(rotation_about(np.array([0.6, 0.0, 0.8]), angle)), angle, rtol=1e-9, atol=1e-15)


def test_quaternions_are_wxyz() -> None:
    assert np.allclose(rotation_from_quaternion([np.sqrt(0.5), 0, 0, np.sqrt(0.5)]) @ X, Y)


def test_inverse_undoes_a_transform() -> None:
    T = pose((1, 2, 3), rpy=(0.3, -0.4, 2.0))
    assert np.allclose(T @ inverse(T), np.eye(4), atol=1e-15)


def test_poses_are_read_only() -> None:
    for T in (identity(), pose((1, 2, 3)), as_pose(None), as_pose((1, 2, 3)), as_pose(np.eye(4))):
        with pytest.raises(ValueError, match="read-only"):
            T[0, 0] = 2.0


def test_a_pose_does_not_change_with_what_it_was_made_from() -> None:
    source = np.eye(4)
    T = as_pose(source)
    source[0, 3] = 5.0
    assert T[0, 3] == 0.0


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: pose((1, 2)), "xyz has shape"),
        (lambda: pose((1, 2, np.nan)), r"xyz\[2\] is nan"),
        (lambda: pose(rpy=(0, 0, 0), quaternion=(1, 0, 0, 0)), "both rpy and quaternion"),
        (lambda: pose(quaternion=(0, 0, 0, 0)), "norm 0"),
        (lambda: pose(quaternion=(0, 0, 0)), "shape"),
        (lambda: pose(quaternion=(1e300, 1e300, 0, 0)), "norm inf"),
        (lambda: pose((True, False, True)), "not an array of numbers"),
        (lambda: as_pose(np.diag([1.0, 1, -1, 1])), "not a rigid transform"),
        (lambda: as_pose(2 * np.eye(4)), "not a rigid transform"),
        (lambda: as_pose(np.eye(3)), r"shape \(3, 3\), expected a position \(3,\) or a pose \(4, 4\)"),
        (lambda: as_pose("here"), "not an array of numbers"),
        (lambda: as_pose(np.full((4, 4), np.inf)), "is inf"),
    ],
)
def test_what_is_no_pose_is_refused(call: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        call()
