"""Proofs that simulated arms touch nothing, so that MuJoCo need not search for contacts.

From the state of the arms a parabola is drawn in joint space, along their velocities and accelerations, and certified
by the collision checker with a margin. A joint that is off that curve by an angle moves no point farther than the angle
times its lever, the largest distance that anything it carries can ever have from its axis. A state is therefore free of
contact if in each arm the levers times the deviations from a point of the curve add up to less than half of the margin,
whatever brought the arms there.
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

# Clearance that is proven on a curve [m], and how far off it any point of an arm may be, which leaves more than the
# rounding of MuJoCo's vertices to single precision.
_MARGIN, _OFF = 0.002, 0.00095
# States of one curve, and states until the next attempt where there was no proof.
_STEPS, _PAUSE = 32, 16
# Joints that slide may be beyond their limits by this much [m].
_BEYOND = 0.01
# Levers and positions that occur in no arm [m].
_FARTHEST = 1e3


class ContactProof:
    """Decides which states of the arms of a scene are proven to be free of contact.

    Args:
        world: The scene and its MuJoCo model, without loose bodies.

    Attributes:
        proven: How many states were.

    Raises:
        InputError: a scene that cannot be checked.
    """

    def __init__(self, world: MujocoScene) -> None:
        # Grippers move in simulations, so that none of their joints is locked here.
        locked = {name: tuple(arm.robot.locked_joints) for name, arm in world.scene.arms.items()}
        self._checker = CollisionChecker(unlocked_scene(world.scene, locked), margin=_MARGIN)
        self._checker.warm_up()
        self._joints = joints = JointMap(world.scene)
        self._planned = np.array([joints.index[name] for name in self._checker.joint_names], dtype=np.int64)
        self._slides = np.flatnonzero(world.model.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE)
        travel = np.zeros(len(joints.names))
        travel[self._slides] = np.maximum(np.abs(joints.lower), np.abs(joints.upper))[self._slides] + _BEYOND
        self._travel = travel[self._slides]
        self._levers = _levers(world.model, travel)
        arms = [name.split("/", 1)[0] for name in joints.names]
        self._first_joints = np.array([i for i, arm in enumerate(arms) if i == 0 or arm != arms[i - 1]], dtype=np.int64)
        self._times = float(world.model.opt.timestep) * np.arange(_STEPS)[:, None]
        # Memory for the curve, of which there are `_count` points, and for deviations from it, which is kept.
        self._points, self._off = np.zeros((2, _STEPS, len(joints.names)))
        self._count = self._next = self._pause = 0
        self.proven = 0

    def covers(self, positions: Array, velocities: Array, accelerations: Array) -> bool:
        """Whether a state is proven; to be called for one state after the other.

        Args:
            positions: Positions of all joints [rad or m], shape (n,).
            velocities: Their velocities, shape (n,); like accelerations only a guess of where the arms will be.
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
        """How many states the certified curve may still prove."""
        return self._count - self._next

    def count_near(self, positions: Array) -> int:
        """How many of the next states the certified curve proves, from the first of them on.

        Args:
            positions: Positions of all joints in these states, not more than `left`, shape (k, n).
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
        """Go on after some states that `count_near` has proven."""
        self._next += count
        self.proven += count

    def _is_near(self, positions: Array) -> bool:
        """Whether positions are as near to the next point of the certified curve as the margin allows."""
        if not self.left:
            return False
        found = self.count_near(positions[None]) == 1
        self._next += 1
        return found

    def _certify(self, curve: Array) -> bool:
        """Certify a curve, coefficients (3, n), and go on from its beginning."""
        self._count = self._next = 0
        planned = curve[:, self._planned]
        if not np.abs(planned).max(initial=0.0) <= _FARTHEST:
            return False  # also where a number is not finite
        if not self._checker.polynomial_is_free(planned, float(self._times[-1, 0])):
            return False
        # Mimicking joints follow on the whole curve if its coefficients do.
        place, rates = self._joints.follow(curve[0]), self._joints.follow(curve[1:], rates=True)
        points, self._count = self._points, _STEPS
        np.multiply(rates[1], self._times, out=points)
        points += rates[0]
        points *= self._times
        points += place
        return True


def _levers(model: mujoco.MjModel, travel: Array) -> Array:
    """How far a change of each joint moves any point that it carries at most [m/rad, or m/m], shape (n,).

    Args:
        model: The model; its first joints are those.
        travel: Largest distance of each from zero if it slides, 0 if it turns [m], shape (n,).
    """
    # How far from the origin of a body anything can be that is on it or on what it carries; parents come first.
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
