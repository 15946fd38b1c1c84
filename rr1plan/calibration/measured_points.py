"""Measured positions of a point of the tool, as residuals of calibration parameters with their Jacobian."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from rr1plan.calibration.joint_calibration import Calibration
from rr1plan.checks import Array
from rr1plan.model import Kinematics
from rr1plan.robot import Robot


def point_jacobians(kinematics: Kinematics, configurations: Array, points: Array) -> tuple[Array, Array]:
    """Positions of points of the tool, and their Jacobians.

    Args:
        kinematics: Kinematics of one arm.
        configurations: Configurations [rad or m], shape (m, nq).
        points: The point in the frame of the tool at each [m], shape (m, 3).

    Returns:
        The positions [m], shape (m, 3), and their derivatives by the configurations, shape (m, 3, nq).
    """
    frame = kinematics.scene_model.frame_id(kinematics.frame("tool"))
    parts = [kinematics.pose_and_jacobian(q, frame) for q in configurations]
    origins, rotations, jacobians = (np.array(part) for part in zip(*parts, strict=True))
    arms = (rotations @ points[:, :, None])[:, :, 0]
    return origins + arms, jacobians[:, :3] - _cross_matrices(arms) @ jacobians[:, 3:]


@dataclass(frozen=True, eq=False)
class Parameters:
    """Parameters of the residuals.

    Args:
        signs: Sign of each joint, shape (nq,).
        values: Zeros [rad or m] and factors of the start's scales; for a free base also its rotation vector [rad] and
            its shift [m]; shape (2 nq,) or (2 nq + 6,).
        T_measured_base: Pose of the base in the measurement frame, to which rotation vector and shift are applied.
    """

    signs: Array
    values: Array
    T_measured_base: Array


class MeasuredPoints:
    """Readings, and the measured positions of a point of the tool.

    Args:
        robot: The robot.
        start: Initial values for all of its planning joints.
        readings: Readings, shape (m, nq).
        positions: Measured positions [m], shape (m, 3).
        points: The measured points in the frame of the tool [m], shape (m, 3).

    Attributes:
        turns: Readings divided by the scales of the start, shape (m, nq).
        spread: Mean distance of the positions from their center [m].
    """

    def __init__(self, robot: Robot, start: Calibration, readings: Array, positions: Array, points: Array) -> None:
        self.positions, self.points = positions, points
        self.spread = float(np.linalg.norm(positions - positions.mean(axis=0), axis=1).mean())
        joints = [start.joints[name] for name in robot.joint_names]
        self.zeros = np.array([joint.zero for joint in joints])
        self.signs = np.array([float(joint.sign) for joint in joints])
        self.turns = readings / np.array([joint.scale for joint in joints])
        self._kinematics = Kinematics(robot)

    def begin(self, *, free_base: bool) -> Parameters:
        """Parameters of the start; a free base is placed where the measurements fit best."""
        values = np.concatenate([self.zeros, np.ones(len(self.signs)), np.zeros(6 if free_base else 0)])
        return self.with_signs(Parameters(self.signs, values, np.eye(4)), self.signs)

    def with_signs(self, parameters: Parameters, signs: Array) -> Parameters:
        """The same parameters with other signs; a free base is placed where the measurements fit best."""
        changed = replace(parameters, signs=signs)
        if len(parameters.values) == 2 * len(signs):
            return changed
        return replace(changed, T_measured_base=_fitted_pose(self._points_in_base(changed)[0], self.positions))

    def base_pose(self, parameters: Parameters) -> Array:
        """Pose of the base in the measurement frame, shape (4, 4)."""
        T = np.eye(4)
        added = parameters.values[2 * len(parameters.signs) :]
        if len(added):
            T[:3, :3], T[:3, 3] = Rotation.from_rotvec(added[:3]).as_matrix(), added[3:]
        return np.asarray(T @ parameters.T_measured_base)

    def residuals(self, parameters: Parameters) -> Array:
        """Predicted minus measured positions [m], shape (m, 3)."""
        return self.with_jacobian(parameters)[0]

    def with_jacobian(self, parameters: Parameters) -> tuple[Array, Array]:
        """Residuals [m], shape (m, 3), and their derivatives by the parameters, shape (m, 3, p)."""
        values, nq = parameters.values, len(parameters.signs)
        points, jacobians = self._points_in_base(parameters)
        T = parameters.T_measured_base
        moved, columns = points @ T[:3, :3].T + T[:3, 3], T[:3, :3] @ jacobians
        parts = [columns, columns * (parameters.signs * self.turns)[:, None, :]]
        if len(values) > 2 * nq:
            vector, shift = values[2 * nq : 2 * nq + 3], values[2 * nq + 3 :]
            turn = Rotation.from_rotvec(vector).as_matrix()
            moved = moved @ turn.T
            parts = [turn @ part for part in parts]
            parts.append(-_cross_matrices(moved) @ _left_jacobian(vector))
            parts.append(np.broadcast_to(np.eye(3), (len(moved), 3, 3)))
            moved = moved + shift
        return moved - self.positions, np.concatenate(parts, axis=2)

    def _points_in_base(self, parameters: Parameters) -> tuple[Array, Array]:
        """Positions of the points in the frame of the base, (m, 3), and their Jacobians, (m, 3, nq)."""
        nq = len(parameters.signs)
        zeros, factors = parameters.values[:nq], parameters.values[nq : 2 * nq]
        configurations = zeros + parameters.signs * factors * self.turns
        return point_jacobians(self._kinematics, configurations, self.points)


def _cross_matrices(vectors: Array) -> Array:
    """Matrices [v]x of vectors (m, 3), shape (m, 3, 3)."""
    found = np.zeros((len(vectors), 3, 3))
    found[:, [2, 0, 1], [1, 2, 0]], found[:, [1, 2, 0], [2, 0, 1]] = vectors, -vectors
    return found


def _left_jacobian(vector: Array) -> Array:
    """Angular velocity per rate of a rotation vector (3,), shape (3, 3): the left Jacobian of SO(3)."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-6:
        return np.asarray(np.eye(3) + 0.5 * _cross_matrices(vector[None])[0])
    K = _cross_matrices(vector[None] / angle)[0]
    return np.asarray(np.eye(3) + (1.0 - np.cos(angle)) / angle * K + (angle - np.sin(angle)) / angle * (K @ K))


def _fitted_pose(points: Array, targets: Array) -> Array:
    """The pose that maps points to targets with least squares, by singular value decomposition (Kabsch)."""
    center, aim = points.mean(axis=0), targets.mean(axis=0)
    u, _, vt = np.linalg.svd((points - center).T @ (targets - aim))
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(vt.T @ u.T))])
    T = np.eye(4)
    T[:3, :3] = vt.T @ flip @ u.T
    T[:3, 3] = aim - T[:3, :3] @ center
    return T
