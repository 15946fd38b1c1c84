"""Cells of two joints that may contain a configuration that reaches the goal."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rr1plan.checks import Array
from rr1plan.collision.contact_cells import JointPlane
from rr1plan.model.joint_turns import rotary
from rr1plan.playback.cspace.cspace_cells import Mask
from rr1plan.scene import Scene
from rr1plan.scene.problem import Goal, JointGoal, PoseGoal, RegionGoal, frame_link
from rr1plan.transforms import rotation_from_quaternion

NEAR = 1e-9  # values on the border of two cells belong to both [rad or m]
_ROUNDING = 1e-6  # goals that are missed by less count as reached [m or rad]
_TURN = 2.0 * np.pi


class CellTargets:
    """Excludes cells without a goal: at their center the frame is farther from the target than it can move in the cell.

    Args:
        plane: The two joints.
        scene: The scene.
        arm: The arm they belong to.
        targets: What counts as the goal: any of these.
    """

    def __init__(self, plane: JointPlane, scene: Scene, arm: str, targets: Sequence[Goal]) -> None:
        self._plane, self._scene, self._arm, self._targets = plane, scene, arm, tuple(targets)
        # With limits beyond a turn, an angle a full turn away is another configuration.
        robot = scene.arms[arm].robot
        self._turns = rotary(robot) & ~np.isfinite(robot.limits.upper - robot.limits.lower)

    def may_hold(self, centers: Array, half: Array) -> Mask:
        """Whether cells may contain a goal.

        Args:
            centers: Centers of the cells [rad or m], shape (n, 2).
            half: Half their size [rad or m], shape (2,).
        """
        found = np.zeros(len(centers), dtype=np.bool_)
        for target in self._targets:
            if isinstance(target, JointGoal):
                found |= (off_by(centers, target.q, self._turns) <= half + NEAR).all(axis=1)
            else:
                found |= self._may_reach(target, centers, half)
        return found

    def _may_reach(self, target: PoseGoal | RegionGoal, centers: Array, half: Array) -> Mask:
        plane, robot = self._plane, self._scene.arms[self._arm].robot
        body = plane.model.body(f"{self._arm}/{frame_link(robot, target.frame)}")
        joints, placed = plane.joints_above(body.joint), plane.place(centers)
        rotation = placed.rotations[body.joint] @ body.placement[:3, :3]
        position = placed.positions[body.joint] + placed.rotations[body.joint] @ body.placement[:3, 3]
        position = np.broadcast_to(position, (len(centers), 3))
        travel = plane.travel(placed, joints, position, half) + _ROUNDING
        if isinstance(target, RegionGoal):
            off = np.linalg.norm(position - np.clip(position, target.lower, target.upper), axis=1)
            found = off <= travel
        else:
            off = np.linalg.norm(position - target.position, axis=1)
            found = off <= target.position_tolerance + travel
        if target.quaternion is not None:
            wanted = rotation_from_quaternion(target.quaternion)
            cosine = 0.5 * (np.einsum("...ij,ij->...", rotation, wanted) - 1.0)
            angle = np.arccos(np.clip(cosine, -1.0, 1.0))
            found &= angle <= target.orientation_tolerance + plane.turn(joints, half) + _ROUNDING
        return np.asarray(found)


def off_by(values: Array, q: Array, turns: Mask) -> Array:
    """Distance of two joints from q (2,) [rad or m], shape (n, 2), modulo whole turns where `turns`."""
    return np.where(turns, np.abs((values - q + np.pi) % _TURN - np.pi), np.abs(values - q))
