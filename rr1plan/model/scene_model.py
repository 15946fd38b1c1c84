"""A scene as one Pinocchio model of all arms, with one number for each movable joint.

Built from our own description, never from a file, so every back end sees the same robot. The
planning configuration q (the moving arms' planning joints, in the order of the scene) maps to the
configuration of the whole model by an affine map: planning joints take their column, mimic joints
follow through their chain of multipliers, locked joints and resting arms are constants. Obstacles and
attached objects are geometry only here; `ArmBranches.with_held_masses` adds the masses of attached objects.

Instances are cheap, contain no scratch memory, and are thread-safe.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, known_name, of_kind, read_only
from rr1plan.model.arm_model import Body, arm_model_of
from rr1plan.robot.joint_limits import Limits
from rr1plan.scene import Scene


class SceneModel:
    """One Pinocchio model of all arms of a scene, and the affine map from q to its configuration.

    Args:
        scene: The scene.
        arms: The arms that move (default: all); the others hold their configuration of the scene.

    Attributes:
        scene, arms: As given; arms in the order of the scene.
        arm_model: The part shared with other scenes with the same arms.
        joint_names: Columns of q, "arm/joint".
        limits: Limits of those columns.
        model: The `pinocchio.Model`. Joints are named "arm/joint", frames "arm/link"; every joint has
            one position and one velocity, continuous joints included.
        columns: The column of q that drives each entry of the model's configuration, or -1.
        gains, offsets: entry = gain * q[column] + offset [rad or m].

    Raises:
        UnknownNameError: no such arm.
        InputError: an arm twice, or a joint that is neither planned, locked nor mimics one that is.
    """

    def __init__(self, scene: Scene, arms: Sequence[str] | None = None) -> None:
        of_kind("scene", scene, Scene)
        self.scene = scene
        # Checked again, because a scene may have no arms.
        self.arms = scene.arm_names(scene.arm_names(arms))
        self.arm_model = arm_model_of(scene, self.arms)
        self.joint_names: tuple[str, ...] = self.arm_model.joint_names
        self.limits: Limits = self.arm_model.limits
        self.model: Any = self.arm_model.model
        self.columns: NDArray[np.intp] = self.arm_model.columns
        self.gains: Array = self.arm_model.gains
        self.offsets: Array = self.arm_model.offsets
        self._bodies, self._frames = self.arm_model.bodies, self.arm_model.frames
        self._taken = np.maximum(self.columns, 0)

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle the scene; the model is rebuilt on loading."""
        return SceneModel, (self.scene, self.arms)

    @property
    def nq(self) -> int:
        """Number of columns of q."""
        return len(self.joint_names)

    # ---- the affine map ------------------------------------------------------------------

    def full(self, q: Array) -> Array:
        """The model's configuration at q, shape (nq,) or (n, nq) to (model.nq,) or (n, model.nq)."""
        if not self.nq:
            return np.broadcast_to(self.offsets, (*np.shape(q)[:-1], len(self.offsets))).copy()
        return np.asarray(self.offsets + self.gains * q[..., self._taken])

    def full_velocity(self, v: Array) -> Array:
        """The model's velocity (or acceleration) for that of q, (nq,) or (n, nq)."""
        if not self.nq:
            return np.zeros((*np.shape(v)[:-1], len(self.offsets)))
        return np.asarray(self.gains * v[..., self._taken])

    @cached_property
    def selection(self) -> Array:
        """Derivative S of `full`, shape (model.nv, nq): maps Jacobians (J @ S) and torques (S.T @ tau) to q."""
        S = np.zeros((len(self.columns), self.nq))
        driven = np.flatnonzero(self.columns >= 0)
        S[driven, self.columns[driven]] = self.gains[driven]
        return read_only(S)

    # ---- frames and bodies ---------------------------------------------------------------

    def frame_id(self, frame: str) -> int:
        """Pinocchio's index of the frame "arm/link".

        Raises:
            UnknownNameError: no such frame.
        """
        return self._frames[known_name("frame", frame, self._frames)]

    def body(self, name: str) -> Body:
        """Joint and placement of a link "arm/link", an obstacle or an attached object.

        Raises:
            UnknownNameError: no such element.
        """
        if name in self._bodies:
            return self._bodies[name]
        if name in self.scene.obstacles:
            return Body(0, self.scene.obstacles[name].pose)
        known_name("element", name, (*self._bodies, *self.scene.obstacles, *self.scene.attachments))
        held = self.scene.attachments[name]
        link = self._bodies[f"{held.arm}/{held.link}"]
        return Body(link.joint, read_only(link.placement @ held.pose))
