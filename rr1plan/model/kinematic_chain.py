"""Kinematic chains from the world to a link, in the layout of the kernels."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, read_only
from rr1plan.kernels.planner_kernels import CStruct
from rr1plan.model.arm_model import ArmModel, joint_axis
from rr1plan.transforms import inverse, rotation_about


@dataclass(frozen=True, eq=False)
class Chain:
    """The joints that move a frame, base first; joint axes are z.

    Args:
        joints: Per joint, whether it is prismatic and the column of q that drives it; shape (n, 2).
        links: Per joint, rotation (9) and origin (3) relative to the previous joint at zero, gain and offset;
            the last row is the frame relative to the last joint; shape (n + 1, 14).
    """

    joints: NDArray[np.int64]
    links: Array

    @cached_property
    def struct(self) -> CStruct:
        """The chain as a struct of the kernels."""
        return CStruct("Chain", joints=self.joints, links=self.links, joint_count=len(self.joints))


@lru_cache(maxsize=256)
def chain_of(arm_model: ArmModel, link: str, first: int = 0) -> Chain:
    """The kinematic chain of a link.

    Locked joints are merged into the fixed transforms between the others.

    Args:
        arm_model: The `ArmModel` of a scene.
        link: "arm/link".
        first: Column of q that becomes column 0 of the chain.
    """
    model, body = arm_model.model, arm_model.bodies[link]
    joints, values, T = [], [], np.eye(4)
    for j in [j for j in model.supports[body.joint] if j > 0]:
        slides, axis = joint_axis(model.joints[j])
        turned = turned_to(axis)
        gain, offset = float(arm_model.gains[j - 1]), float(arm_model.offsets[j - 1])
        T = T @ model.jointPlacements[j].homogeneous @ turned
        if arm_model.columns[j - 1] >= 0 and gain != 0.0:
            joints.append([int(slides), int(arm_model.columns[j - 1]) - first])
            values.append([*T[:3, :3].ravel(), *T[:3, 3], gain, offset])
            T = inverse(turned)
        else:
            T = T @ _moved(slides, offset) @ inverse(turned)
    T = T @ body.placement
    values.append([*T[:3, :3].ravel(), *T[:3, 3], 0.0, 0.0])
    return Chain(read_only(np.array(joints, np.int64).reshape(-1, 2)), read_only(np.array(values)))


def turned_to(axis: Array) -> Array:
    """A rotation (4, 4) that maps z to an axis."""
    T = np.eye(4)
    if axis[2] != 1.0:
        other = np.zeros(3)
        other[np.argmin(np.abs(axis))] = 1.0
        x = np.cross(other, axis)
        x /= np.linalg.norm(x)
        T[:3, :3] = np.column_stack([x, np.cross(axis, x), axis])
    return T


def _moved(slides: bool, value: float) -> Array:
    """The transform of a joint along or about z."""
    T = np.eye(4)
    if slides:
        T[2, 3] = value
    else:
        T[:3, :3] = rotation_about(np.array([0.0, 0.0, 1.0]), value)
    return T
