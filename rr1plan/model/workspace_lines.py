"""Straight lines of a frame in the world, and bounds of the deviation of a joint-space edge from them.

Along q + t dq, 0 <= t <= 1, the frame's origin has |p''| <= sum_ij |dq_i| |dq_j| r_max(i,j), where r_j
bounds its distance from joint j's axis: d2p / dq_i dq_j = a_i x (a_j x r_j) for i before j on the chain. An
eighth of that bounds its distance from the chord between its ends, and an eighth of (sum |dq_i|)^2 the
angle to the interpolated rotation (half of that is the second-order term; steps are small).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rr1plan.checks import Array
from rr1plan.model.arm_model import joint_axis
from rr1plan.model.forward_kinematics import Kinematics
from rr1plan.model.ik_descent import Target


@dataclass(frozen=True, eq=False)
class Line:
    """A straight line of a frame: its origin moves on a line, its orientation is interpolated by slerp.

    Args:
        p0: Initial position [m], shape (3,).
        p1: Final position [m], shape (3,).
        R0: Initial rotation, shape (3, 3).
        turn: Rotation vector to the final rotation in the frame's axes [rad], shape (3,); None if it is free.
    """

    p0: Array
    p1: Array
    R0: Array
    turn: Array | None

    @staticmethod
    def between(kinematics: Kinematics, q: Array, index: int, position: Array, rotation: Array | None) -> Line:
        """The line from the frame's pose at q (nq,) to a position (3,) and a rotation (3, 3) or None."""
        p, R, _ = kinematics.pose_and_jacobian(q, index)
        return Line(p, position, R, None if rotation is None else pin.log3(R.T @ rotation))

    @property
    def length(self) -> float:
        """Length of the line [m] plus the angle of the rotation [rad]."""
        turn = 0.0 if self.turn is None else float(np.linalg.norm(self.turn))
        return float(np.linalg.norm(self.p1 - self.p0)) + turn

    def at(self, s: float) -> Target:
        """Target of the frame at a fraction s (0..1) of the line."""
        p = self.p0 + s * (self.p1 - self.p0) if s < 1.0 else self.p1
        R = None if self.turn is None else self.R0 @ pin.exp3(s * self.turn)
        return Target(p, p, R)


class EdgeBound:
    """Bounds the deviation of a frame from the straight line between the ends of a joint-space edge.

    Args:
        kinematics: Kinematics of the moving arms.
        index: Pinocchio's index of the frame.
    """

    def __init__(self, kinematics: Kinematics, index: int) -> None:
        self._map = kinematics.scene_model
        model = self._map.model
        frame = model.frames[index]
        chain = [j for j in model.supports[frame.parentJoint] if j > 0]
        self._chain = np.array(chain, dtype=np.intp) - 1
        after = [model.jointPlacements[j].translation for j in chain[1:]] + [frame.placement.translation]
        self._arms = np.array([np.linalg.norm(v) for v in after])[: len(chain)]
        self._slides = np.array([joint_axis(model.joints[j])[0] for j in chain], dtype=np.bool_)

    def bound(self, a: Array, b: Array) -> tuple[float, float]:
        """Bounds of the deviation from the line [m] and from slerp [rad] on the edge from a (nq,) to b (nq,)."""
        if not len(self._chain):
            return 0.0, 0.0
        v = np.abs(self._map.full_velocity(b - a)[self._chain])
        ends = np.abs([self._map.full(a)[self._chain], self._map.full(b)[self._chain]]).max(axis=0)
        travel = np.where(self._slides, ends, 0.0)
        reach = np.cumsum((self._arms + travel)[::-1])[::-1]
        weight = np.where(self._slides, 1.0, reach)
        before = np.cumsum(v) - v
        turning = float(np.where(self._slides, 0.0, v).sum())
        return float((weight * v * (v + 2.0 * before)).sum()) / 8.0, turning**2 / 8.0
