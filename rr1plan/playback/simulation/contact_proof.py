"""Proofs that simulated arms are free of contact, so that MuJoCo need not search for contacts.

The state of the arms is extrapolated along a parabola in joint space, given by their velocities and accelerations, and
the collision checker certifies this curve with a margin. If a joint deviates from the curve by an angle, no point moves
farther than this angle times the lever of the joint, the largest possible distance from its axis of anything that it
carries. A state is therefore free of contact if in each arm the levers times the deviations from a point of the curve
sum to less than half of the margin, regardless of how the arms got there.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.playback.simulation.joint_map import JointMap
from rr1plan.playback.simulation.mujoco_model import MujocoScene
from rr1plan.scene.unlocked_joints import unlocked_scene

# Clearance that is certified on a curve [m], and largest displacement of any point of an arm from it, which leaves more
# than the rounding of MuJoCo's vertices to single precision.
_MARGIN, _OFF = 0.002, 0.00095
# Number of states on one curve, and number of states to skip after a failed attempt.
_STEPS, _PAUSE = 32, 16
# Prismatic joints may exceed their limits by this much [m].
_BEYOND = 0.01
# Bound on levers and positions, larger than in any arm [m or rad].
_FARTHEST = 1e3


class ContactProof:
    """Decides which states of the arms of a scene are proven to be free of contact.

    Args:
        world: The scene and its MuJoCo model, without loose bodies.

    Attributes:
        proven: Number of states proven so far.

    Raises:
        InputError: a scene that cannot be checked.
    """

    def __init__(self, world: MujocoScene) -> None:
        # Grippers move in simulations, so none of their joints is locked here.
        locked = {name: tuple(arm.robot.locked_joints) for name, arm in world.scene.arms.items()}
        self._checker = CollisionChecker(unlocked_scene(world.scene, locked), margin=_MARGIN)
        self._checker.warm_up()
        self._joints = joints = JointMap(world.scene)
        self._planned = joints.indices(self._checker.joint_names)
        self._slides = np.flatnonzero(world.model.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE)
        travel = np.zeros(len(joints.names))
        travel[self._slides] = np.maximum(np.abs(joints.lower), np.abs(joints.upper))[self._slides] + _BEYOND
        self._travel = travel[self._slides]
        self._levers = _levers(world.model, travel)
        arms = [name.split("/", 1)[0] for name in joints.names]
        self._first_joints = np.array([i for i, arm in enumerate(arms) if i == 0 or arm != arms[i - 1]], dtype=np.int64)
        self._times = float(world.model.opt.timestep) * np.arange(_STEPS)[:, None]
        # Reused memory for the curve, of which `_count` points are valid, and for deviations from it.
        self._points, self._off = np.zeros((2, _STEPS, len(joints.names)))
        self._count = self._next = self._pause = 0
        self.proven = 0

    def covers(self, positions: Array, velocities: Array, accelerations: Array) -> bool:
        """Whether a state is proven to be free of contact; call it for consecutive states.

        Args:
            positions: Positions of all joints [rad or m], shape (n,).
            velocities: Their velocities, shape (n,); like the accelerations, only used to predict the next states.
            accelerations: Their accelerations, shape (n,).
        """
        found = self._is_near(positions)
        if not found and self._pause == 0:
            found = self._certify(np.array([positions, velocities, 0.5 * accelerations])) and self._is_near(positions)
            self._pause = 0 if found else _PAUSE
        elif not found:
            self._pause -= 1
        self.proven += found
        return found

    @property
    def left(self) -> int:
        """Number of remaining states on the certified curve."""
        return self._count - self._next

    def count_near(self, positions: Array) -> int:
        """Number of leading states that the certified curve proves to be free of contact.

        Args:
            positions: Positions of all joints in the next states, at most `left`, shape (k, n).
        """
        off = self._off[: len(positions)]
        np.subtract(positions, self._points[self._next : self._next + len(positions)], out=off)
        np.abs(off, out=off)
        off *= self._levers
        moved = np.add.reduceat(off, self._first_joints, axis=1)
        near: NDArray[np.bool_] = moved.max(axis=1, initial=0.0) <= _OFF
        if len(self._slides):
            near &= (np.abs(positions[:, self._slides]) <= self._travel).all(axis=1)
        return len(near) if near.all() else int(near.argmin())

    def pass_over(self, count: int) -> None:
        """Skip states that `count_near` has proven."""
        self._next += count
        self.proven += count

    def _is_near(self, positions: Array) -> bool:
        """Whether positions are within the allowed deviation from the next point of the certified curve."""
        if not self.left:
            return False
        found = self.count_near(positions[None]) == 1
        self._next += 1
        return found

    def _certify(self, curve: Array) -> bool:
        """Certify a curve, coefficients (3, n), and return to its first point; whether it is free."""
        self._count = self._next = 0
        planned = curve[:, self._planned]
        if not np.abs(planned).max(initial=0.0) <= _FARTHEST:
            return False  # also for nan
        if not self._checker.polynomial_is_free(planned, float(self._times[-1, 0])):
            return False
        # Mimic joints are affine in their leaders, so mapping the coefficients maps the whole curve.
        place, rates = self._joints.follow(curve[0]), self._joints.follow(curve[1:], rates=True)
        points, self._count = self._points, _STEPS
        np.multiply(rates[1], self._times, out=points)
        points += rates[0]
        points *= self._times
        points += place
        return True


def _levers(model: mujoco.MjModel, travel: Array) -> Array:
    """Largest displacement of any carried point per change of each joint [m/rad or m/m], shape (n,).

    Args:
        model: The model, which begins with these joints.
        travel: Largest absolute position of each prismatic joint, 0 for revolute joints [m], shape (n,).
    """
    # Largest distance from the origin of each body to any point of it and of the bodies that it carries; parents come
    # first.
    extent = np.zeros(model.nbody)
    radius = np.where(model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE, _FARTHEST, model.geom_rbound)
    np.maximum.at(extent, model.geom_bodyid, np.linalg.norm(model.geom_pos, axis=1) + radius)
    offset = np.linalg.norm(model.body_pos, axis=1)
    np.add.at(offset, model.jnt_bodyid[: len(travel)], travel)
    for body in range(model.nbody - 1, 0, -1):
        parent = model.body_parentid[body]
        extent[parent] = max(extent[parent], offset[body] + extent[body])
    levers = np.where(travel > 0.0, 1.0, extent[model.jnt_bodyid[: len(travel)]])
    return np.minimum(levers, _FARTHEST)
