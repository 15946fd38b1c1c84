"""Forward kinematics, Jacobians and inverse dynamics as functions of the planning q.

Pinocchio does the computation. Our affine map (`SceneModel.full`) takes q to its configuration and the results back, so
mimic joints count in every Jacobian and torque, and locked joints and stationary arms are fixed.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from threading import RLock

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from rr1plan.checks import Array, finite_array, items_of, shape_of, shown, whole_number
from rr1plan.errors import InputError
from rr1plan.model.arm_branches import ArmBranch, ArmBranches
from rr1plan.model.scene_model import SceneModel
from rr1plan.robot import Robot
from rr1plan.scene import Arm, Scene
from rr1plan.scene.problem import frame_link
from rr1plan.thread_locks import exclusive, per_process

_WORLD_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


class Kinematics:
    """Forward kinematics, Jacobians and inverse dynamics of the moving arms of a scene.

    A frame is "arm/link" or "arm/tool" (the robot's tool); if only one arm moves, "link" or "tool" suffices.
    Threads may share an instance: each waits while another one uses it.

    Args:
        scene_or_robot: A scene; or a robot, as the only arm "arm" of a scene.
        arms: The arms that move (default: all); the others hold their configuration of the scene.

    Raises:
        UnknownNameError: no such arm.
        InputError: neither a scene nor a robot.
    """

    def __init__(self, scene_or_robot: Scene | Robot, arms: Sequence[str] | None = None) -> None:
        scene = Scene({"arm": Arm(scene_or_robot)}) if isinstance(scene_or_robot, Robot) else scene_or_robot
        self.scene_model = SceneModel(scene, arms)
        self._lock = per_process(self, "_lock", RLock)
        self._branches = ArmBranches(self.scene_model)
        self._own: dict[str, Kinematics] = {}

    def __repr__(self) -> str:
        return f"Kinematics({self.scene.name!r}, arms={list(self.arms)})"

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle the scene; the model is rebuilt on loading."""
        return Kinematics, (self.scene, self.arms)

    @property
    def scene(self) -> Scene:
        """The scene."""
        return self.scene_model.scene

    @property
    def arms(self) -> tuple[str, ...]:
        """The arms that move, in the order of the scene."""
        return self.scene_model.arms

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Columns of q, "arm/joint"."""
        return self.scene_model.joint_names

    @property
    def nq(self) -> int:
        """Number of columns of q."""
        return self.scene_model.nq

    def frame(self, frame: str) -> str:
        """The full name "arm/link" of a frame.

        Raises:
            UnknownNameError: no such arm or link.
            InputError: no arm given although several move.
        """
        if not isinstance(frame, str):
            raise InputError(f"frame is {shown(frame)}, expected a name")
        arm, slash, link = frame.partition("/")
        # Links may have a "/" in their names, also after the name of an arm, as in exported scenes; arms have none.
        is_full = arm in self.scene.arms and link in ("tool", *self.scene.arms[arm].robot.link_names)
        is_link = not is_full and any(frame in self.scene.arms[a].robot.link_names for a in self.arms)
        if not slash or is_link:
            arm, link = "", frame
        if not arm and len(self.arms) != 1:
            raise InputError(
                f"frame {frame!r} could be of {', '.join(self.arms)}; say which, e.g. '{self.arms[0]}/{frame}'"
            )
        arm = arm or self.arms[0]
        return f"{arm}/{frame_link(self.scene.arm(arm).robot, link)}"

    def for_arm(self, arm: str | None = None) -> Kinematics:
        """The kinematics of one moving arm (this object if the scene contains nothing else).

        Raises:
            UnknownNameError: no such arm.
            InputError: None although several arms move.
        """
        if arm is None and len(self.arms) != 1:
            raise InputError(f"{len(self.arms)} arms move ({', '.join(self.arms)}); say which one with option arm")
        arm = self.scene.only_arm(self.arms[0] if arm is None else arm)
        if tuple(self.scene.arms) == self.arms == (arm,):
            return self
        if arm not in self._own:
            self._own[arm] = Kinematics(Scene({arm: self.scene.arms[arm]}))
        return self._own[arm]

    # ---- poses -----------------------------------------------------------------------------

    def pose(self, q: ArrayLike, frame: str = "tool") -> Array:
        """T_world_frame at q (nq,) [rad or m], shape (4, 4).

        Raises:
            UnknownNameError: no such frame.
            InputError: wrong shape or not finite.
        """
        index, full = self._index(frame), self._full(q)
        with self._lock:
            branch = self._branches.of_frame(index)
            branch.place(full)
            return _placement(branch, index)

    @exclusive
    def poses(self, q: ArrayLike, frames: Iterable[str]) -> dict[str, Array]:
        """T_world_frame of several frames at q (nq,), each (4, 4), by the names given.

        Raises:
            UnknownNameError: no such frame.
            InputError: wrong shape or not finite.
        """
        indices = {frame: self._index(frame) for frame in items_of("frames", frames, "frames")}
        full = self._full(q)
        branches = {frame: self._branches.of_frame(index) for frame, index in indices.items()}
        for branch in set(branches.values()):
            branch.place(full)
        return {frame: _placement(branches[frame], index) for frame, index in indices.items()}

    @exclusive
    def poses_batch(self, qs: ArrayLike, frame: str = "tool") -> Array:
        """T_world_frame at each of qs (n, nq), shape (n, 4, 4).

        Raises:
            UnknownNameError: no such frame.
            InputError: wrong shape or not finite.
        """
        index = self._index(frame)
        configurations = self.scene_model.full(finite_array("qs", qs, (None, self.nq)))
        out = np.empty((len(configurations), 4, 4))
        branch = self._branches.of_frame(index)
        for i, full in enumerate(configurations):
            branch.place(full)
            out[i] = _placement(branch, index)
        return out

    # ---- velocities ------------------------------------------------------------------------

    def jacobian(self, q: ArrayLike, frame: str = "tool") -> Array:
        """Jacobian at q (nq,) from qd to the frame's twist (linear; angular) in world axes, shape (6, nq).

        Raises:
            UnknownNameError: no such frame.
            InputError: wrong shape or not finite.
        """
        return self.pose_and_jacobian(q, self._index(frame))[2]

    @exclusive
    def pose_and_jacobian(self, q: ArrayLike, index: int) -> tuple[Array, Array, Array]:
        """Position (3,), rotation (3, 3) and Jacobian (6, nq) of a frame.

        Args:
            q: A configuration [rad or m], shape (nq,).
            index: Pinocchio's index of the frame (`scene_model.frame_id`).

        Raises:
            InputError: wrong shape or not finite, or no frame of that index.
        """
        full = self._full(q)
        whole_number("index", index, 1, self.scene_model.model.nframes - 1)
        branch = self._branches.of_frame(index)
        model, data, own = branch.model, branch.data, branch.own_frame(index)
        pin.computeJointJacobians(model, data, full[branch.rows])
        T = pin.updateFramePlacement(model, data, own)
        # Pinocchio returns a vector for a model with one joint.
        J = pin.getFrameJacobian(model, data, own, _WORLD_AXES).reshape(6, -1)
        return T.translation.copy(), T.rotation.copy(), np.asarray(J @ self.scene_model.selection[branch.rows])

    def manipulability(self, q: ArrayLike, frame: str = "tool") -> float:
        """Yoshikawa's measure: the product of the Jacobian's singular values; 0 for singular configurations.

        For fewer than six joints it is sqrt(det(J^T J)).
        Source: Yoshikawa, Manipulability of robotic mechanisms, IJRR 1985.

        Args:
            q: A configuration [rad or m], shape (nq,).
            frame: The frame.

        Raises:
            UnknownNameError: no such frame.
            InputError: wrong shape or not finite.
        """
        return float(np.prod(np.linalg.svd(self.jacobian(q, frame), compute_uv=False)))

    # ---- forces ----------------------------------------------------------------------------

    @exclusive
    def inverse_dynamics(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> Array:
        """Joint torques [Nm or N] of the motion (q, qd, qdd) under gravity, without friction.

        Held objects with a mass count as solid bodies of uniform density.

        Args:
            q: Configurations [rad or m], shape (nq,) or (n, nq).
            qd: Velocities [rad/s or m/s], same shape.
            qdd: Accelerations [rad/s² or m/s²], same shape.

        Returns:
            Torques of the planning joints (including the loads of their mimic joints), same shape.

        Raises:
            InputError: wrong shape or not finite.
        """
        shape = (self.nq,) if len(shape_of(q)) == 1 else (None, self.nq)
        q, qd, qdd = (finite_array(name, a, shape) for name, a in (("q", q), ("qd", qd), ("qdd", qdd)))
        if not q.shape == qd.shape == qdd.shape:
            raise InputError(f"q, qd and qdd have shapes {q.shape}, {qd.shape}, {qdd.shape}, expected the same")
        model = self.scene_model
        motion = [np.atleast_2d(a) for a in (model.full(q), model.full_velocity(qd), model.full_velocity(qdd))]
        torques = np.zeros((len(motion[0]), self.nq))
        at_rest = not (qd.any() or qdd.any())
        for branch in map(self._branches.with_held_masses, self.arms):
            rows = [a[:, branch.rows] for a in motion]
            # Gravity alone takes a third of the time.
            found = (
                [pin.computeGeneralizedGravity(branch.model, branch.data, row) for row in rows[0]]
                if at_rest
                else [pin.rnea(branch.model, branch.data, *row) for row in zip(*rows, strict=True)]
            )
            torques += np.reshape(found, (len(torques), branch.model.nv)) @ model.selection[branch.rows]
        return torques.reshape(q.shape)

    def gravity(self, q: ArrayLike) -> Array:
        """Gravity torques [Nm or N] of arms and held objects at q, shape (nq,) or (n, nq).

        Raises:
            InputError: wrong shape or not finite.
        """
        q = finite_array("q", q, (self.nq,) if len(shape_of(q)) == 1 else (None, self.nq))
        zero = np.zeros_like(q)
        return self.inverse_dynamics(q, zero, zero)

    @exclusive
    def mass_matrix(self, q: ArrayLike) -> Array:
        """Joint-space inertia matrix at q (nq,) with the masses of held objects, shape (nq, nq).

        Raises:
            InputError: wrong shape or not finite.
        """
        S, full = self.scene_model.selection, self._full(q)
        M = np.zeros((len(full), len(full)))
        for branch in map(self._branches.with_held_masses, self.arms):
            M[branch.rows, branch.rows] = np.triu(pin.crba(branch.model, branch.data, full[branch.rows]))
        return np.asarray(S.T @ (M + np.triu(M, 1).T) @ S)

    # ---- inside ----------------------------------------------------------------------------

    def _index(self, frame: str) -> int:
        return self.scene_model.frame_id(self.frame(frame))

    def _full(self, q: ArrayLike) -> Array:
        return self.scene_model.full(finite_array("q", q, (self.nq,)))


def _placement(branch: ArmBranch, index: int) -> Array:
    """Pose of a frame, shape (4, 4)."""
    T: Array = pin.updateFramePlacement(branch.model, branch.data, branch.own_frame(index)).homogeneous
    return T
