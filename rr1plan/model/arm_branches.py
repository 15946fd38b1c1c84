"""Pinocchio models of single arms of a scene.

Pinocchio's data contain tensors of second derivatives, whose size grows with the cube of the number of joints: 67 MB
for the 128 joints of 16 arms, 16 GB for 100 arms. The arms of a scene are attached only to the world, so results
computed for each arm alone are the same.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from rr1plan.checks import Array
from rr1plan.errors import InputError
from rr1plan.model.arm_model import arm_model_of
from rr1plan.model.scene_model import SceneModel
from rr1plan.object_cache import kept_in
from rr1plan.robot.link_masses import solid_inertial
from rr1plan.scene import Scene


@dataclass(frozen=True, eq=False)
class ArmBranch:
    """One arm of a `SceneModel`.

    Args:
        model: The `pinocchio.Model` of this arm alone.
        data: Pinocchio's data of this model.
        rows: Its entries of the whole model's configuration; a row is the index of a joint, minus 1.
        first_frame: Index in the whole model of its first frame, which has index 1 in the branch.
    """

    model: pin.Model
    data: pin.Data
    rows: slice
    first_frame: int

    def place(self, full: Array) -> None:
        """Compute the poses of its joints at a configuration of the whole model, shape (model.nq,)."""
        pin.forwardKinematics(self.model, self.data, full[self.rows])

    def own_frame(self, index: int) -> int:
        """Index in its own model of a frame of the whole model."""
        return index - self.first_frame + 1


class ArmBranches:
    """The arms of a `SceneModel`, each built when it is first needed; not shared between threads.

    Args:
        scene_model: The arms as one model.
    """

    def __init__(self, scene_model: SceneModel) -> None:
        self._whole = scene_model
        self._made: dict[str, ArmBranch] = {}
        self._loaded: dict[str, ArmBranch] = {}

    def of_arm(self, arm: str) -> ArmBranch:
        """The branch of an arm, moving or not."""
        return kept_in(self._made, arm, lambda: self._branch(arm))

    def with_held_masses(self, arm: str) -> ArmBranch:
        """The branch of an arm whose links also have the masses of the objects that they hold, for dynamics.

        Raises:
            InputError: a held object has a mass, but its shapes have no volume.
        """
        return kept_in(self._loaded, arm, lambda: self._load(arm))

    def of_frame(self, index: int) -> ArmBranch:
        """The branch that contains a frame of the whole model other than that of the world."""
        arms, frames = tuple(self._begins), [frame for _, frame in self._begins.values()]
        return self.of_arm(arms[bisect_right(frames, index) - 1])

    def all_arms(self) -> Iterable[ArmBranch]:
        """The branches of all arms, in the order of their joints."""
        return map(self.of_arm, self._begins)

    @cached_property
    def _begins(self) -> dict[str, tuple[int, int]]:
        """First row and first frame of each arm."""
        begins, row, frame = {}, 0, 1
        for name, arm in self._whole.scene.arms.items():
            begins[name] = row, frame
            row += sum(joint.kind != "fixed" for joint in arm.robot.joints)
            frame += len(arm.robot.links)
        return begins

    def _branch(self, arm: str) -> ArmBranch:
        scene = self._whole.scene
        alone = scene if len(scene.arms) == 1 else Scene({arm: scene.arms[arm]})
        model = self._whole.model if alone is scene else arm_model_of(alone, (arm,)).model
        row, frame = self._begins[arm]
        return ArmBranch(model, model.createData(), slice(row, row + model.nq), frame)

    def _load(self, arm: str) -> ArmBranch:
        branch, weights = self.of_arm(arm), []
        for name, held in self._whole.scene.attachments.items():
            body = self._whole.body(name)
            if held.arm != arm or held.mass is None or body.joint == 0:
                continue
            inertial = solid_inertial(held.geometries, held.mass)
            if inertial is None:
                raise InputError(f"{name!r} has a mass, but its shapes have no volume")
            inertia = pin.Inertia(inertial.mass, np.array(inertial.com), np.array(inertial.inertia))
            weights.append((body.joint - branch.rows.start, inertia, pin.SE3(np.array(body.placement))))
        if not weights:
            return branch
        model = branch.model.copy()
        for weight in weights:
            model.appendBodyToJoint(*weight)
        return ArmBranch(model, model.createData(), branch.rows, branch.first_frame)
