"""Rigid transforms as read-only 4x4 arrays, quaternions as wxyz.

`T_world_tool` maps tool coordinates to world coordinates. Other quaternion orders are converted
in the module that needs them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from rr1plan.checks import Array, finite_array, finite_number, near_array, number_array, read_only, turn_angles
from rr1plan.errors import InputError


def identity() -> Array:
    """The identity transform, shape (4, 4)."""
    return read_only(np.eye(4))


def rotation_from_rpy(roll: float, pitch: float, yaw: float) -> Array:
    """Rotation matrix of URDF's fixed-axis roll, pitch, yaw [rad], shape (3, 3).

    Raises:
        InputError: an angle that is not a finite number.
    """
    angles = (finite_number(name, a) for name, a in (("roll", roll), ("pitch", pitch), ("yaw", yaw)))
    cr, sr, cp, sp, cy, sy = (f(a) for a in angles for f in (np.cos, np.sin))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def rotation_about(axis: ArrayLike, angle: float) -> Array:
    """Rotation matrix about a unit axis (3,) by an angle [rad] (Rodrigues), shape (3, 3).

    Raises:
        InputError: an axis of another shape, or numbers that are not finite.
    """
    x, y, z = finite_array("axis", axis, (3,))
    angle = finite_number("angle", angle)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * (K @ K))


def unit_quaternion(wxyz: ArrayLike) -> Array:
    """A quaternion wxyz normalized to 1, shape (4,); unchanged if its norm is 1 up to rounding.

    Raises:
        InputError: not four finite numbers, or a norm too close to zero or infinite.
    """
    q = finite_array("quaternion wxyz", wxyz, (4,))
    with np.errstate(over="ignore"):
        norm = float(np.linalg.norm(q))
    if not 1e-6 <= norm < np.inf:
        raise InputError(f"quaternion wxyz {q.tolist()} has norm {norm:.3g}, expected about 1")
    return read_only(q if abs(norm - 1.0) < 1e-15 else q / norm)


def rotation_from_quaternion(wxyz: ArrayLike) -> Array:
    """Rotation matrix of a quaternion wxyz, normalized first, shape (3, 3).

    Raises:
        InputError: not four finite numbers, or a norm too close to zero.
    """
    w, x, y, z = unit_quaternion(wxyz)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_from_rotation(R: ArrayLike) -> Array:
    """Unit quaternion wxyz with w >= 0 of a rotation matrix (3, 3) (Shepperd 1978), shape (4,).

    Raises:
        InputError: another shape, or not finite.
    """
    R = finite_array("rotation", R, (3, 3))
    trace = float(np.trace(R))
    squares = np.array([trace, R[0, 0], R[1, 1], R[2, 2]])
    largest = int(np.argmax(squares))
    root = np.sqrt(max(0.0, 1.0 + 2.0 * squares[largest] - trace))
    w = [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]
    if largest == 0:
        q = np.array([root * root, *w])
    else:
        i = largest - 1
        j, k = (i + 1) % 3, (i + 2) % 3
        q = np.empty(4)
        q[0] = w[i]
        q[1 + i] = root * root
        q[1 + j] = R[i, j] + R[j, i]
        q[1 + k] = R[i, k] + R[k, i]
    q /= np.linalg.norm(q)
    return np.asarray(-q if q[0] < 0 else q)


def pose(
    xyz: ArrayLike = (0.0, 0.0, 0.0), *, rpy: ArrayLike | None = None, quaternion: ArrayLike | None = None
) -> Array:
    """A transform from a position and roll, pitch, yaw or a quaternion.

    Args:
        xyz: Position [m], shape (3,).
        rpy: Roll, pitch, yaw [rad], each within a turn, shape (3,).
        quaternion: Quaternion wxyz, shape (4,).

    Returns:
        Transform, shape (4, 4), read-only.

    Raises:
        InputError: not finite, wrong shape, both rotations given, or angles that look like degrees.
    """
    if rpy is not None and quaternion is not None:
        raise InputError("pose got both rpy and quaternion, expected at most one of them")
    T = np.eye(4)
    T[:3, 3] = near_array("xyz", xyz, (3,))
    if rpy is not None:
        T[:3, :3] = rotation_from_rpy(*turn_angles("rpy", rpy, (3,)))
    elif quaternion is not None:
        T[:3, :3] = rotation_from_quaternion(quaternion)
    return read_only(T)


def as_pose(value: ArrayLike | None, name: str = "pose") -> Array:
    """A validated read-only transform from a (4, 4) array, a position (3,) or None (identity).

    Args:
        value: The pose, its position [m], or None.
        name: Its name in messages.

    Raises:
        InputError: another shape, not finite, not a rigid transform, or farther than 10 km.
    """
    if value is None:
        return identity()
    T = number_array(name, value)
    if T.shape == (3,):
        return pose(near_array(name, value, (3,)))
    if T.shape != (4, 4):
        raise InputError(f"{name} has shape {T.shape}, expected a position (3,) or a pose (4, 4)")
    T = finite_array(name, value, (4, 4))
    R = T[:3, :3]
    if not _is_rotation(R) or np.abs(T[3] - [0, 0, 0, 1]).max() > 1e-9:
        raise InputError(f"{name} is not a rigid transform: its rotation part is not a rotation matrix")
    near_array(f"position of {name}", T[:3, 3], (3,))
    return read_only(T)


def position_and_quaternion(T: ArrayLike) -> Array:
    """The position [m] and the unit quaternion wxyz of a pose, shape (7,).

    Args:
        T: The pose, shape (4, 4).

    Raises:
        InputError: not a pose.
    """
    T = as_pose(T)
    return np.concatenate([T[:3, 3], quaternion_from_rotation(T[:3, :3])])


def _is_rotation(R: Array) -> bool:
    """Whether R is orthonormal with determinant 1; entries beyond 1 are tested first, because products may overflow."""
    return bool(np.abs(R).max() < 2.0 and np.abs(R @ R.T - np.eye(3)).max() <= 1e-6 and np.linalg.det(R) > 0.0)


def inverse(T: ArrayLike) -> Array:
    """The inverse of a rigid transform, shape (4, 4).

    Args:
        T: The transform, shape (4, 4).

    Raises:
        InputError: another shape, or not finite.
    """
    T = finite_array("transform", T, (4, 4))
    out = np.eye(4)
    out[:3, :3] = T[:3, :3].T
    out[:3, 3] = -T[:3, :3].T @ T[:3, 3]
    return out


def rotation_angle(R: ArrayLike) -> float:
    """The angle [rad], 0..pi, of a rotation matrix (3, 3).

    Raises:
        InputError: another shape, or not finite.
    """
    R = finite_array("rotation", R, (3, 3))
    sine = 0.5 * np.linalg.norm([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    return float(np.arctan2(sine, 0.5 * (np.trace(R) - 1.0)))
