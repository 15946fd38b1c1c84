"""Local inverse kinematics: minimization of a frame's pose error within joint limits, from a configuration."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rr1plan.checks import Array
from rr1plan.kernels.planner_kernels import CStruct, load_library
from rr1plan.model.kinematic_chain import Chain

# Weight of orientation errors [m/rad], about the size of an arm.
METERS_PER_RADIAN = 0.3


@dataclass(frozen=True, eq=False)
class Target:
    """Target of a frame: a box for its origin (a point if the corners agree) and an orientation.

    Args:
        lower, upper: Corners of the box in the world [m], each (3,).
        rotation: Target R_world_frame (3, 3), or None if the orientation is free.
    """

    lower: Array
    upper: Array
    rotation: Array | None

    @cached_property
    def struct(self) -> CStruct:
        """The target as a struct of the kernels."""
        struct = CStruct("IkTarget")
        struct.value.lower[:], struct.value.upper[:] = self.lower.tolist(), self.upper.tolist()
        if self.rotation is not None:
            struct.value.rotation[:], struct.value.weight = self.rotation.ravel().tolist(), METERS_PER_RADIAN
        return struct


def descend(chain: Chain, target: Target, q: Array, lower: Array, upper: Array, steps: int = 60) -> tuple[Array, float]:
    """The final configuration of the descent from q, and its squared error [m²], with 0.3 m per radian.

    Args:
        chain: Kinematic chain of the frame.
        target: Target of the frame.
        q: Initial configuration [rad or m], within the limits, shape (nq,).
        lower: Lower limits [rad or m], shape (nq,).
        upper: Upper limits [rad or m], shape (nq,).
        steps: Most evaluations.
    """
    end, library = np.array(q, np.float64), load_library()
    memory = np.empty(library.rr1_descent_memory(len(q)))
    return end, library.rr1_descend(chain.struct, target.struct, end, len(q), lower, upper, steps, memory)


def errors_at(chain: Chain, target: Target, q: Array) -> tuple[float, float]:
    """Position error [m] and orientation error [rad] at q (nq,)."""
    errors = np.empty(2)
    load_library().rr1_chain_errors(chain.struct, target.struct, np.ascontiguousarray(q), errors)
    return float(errors[0]), float(errors[1])


def position_at(chain: Chain, q: Array) -> Array:
    """The frame's origin in the world at q (nq,) [m], shape (3,)."""
    pose = np.empty(12)
    load_library().rr1_chain_pose(chain.struct, np.ascontiguousarray(q), pose)
    return pose[9:]
