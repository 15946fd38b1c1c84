"""Simulated arms that differ from their description in payload, masses and friction, unmodeled in the servos."""

from __future__ import annotations

import copy
from dataclasses import dataclass

import mujoco
import numpy as np

from rr1plan.checks import Array, number_from_zero, positive_number
from rr1plan.errors import InputError
from rr1plan.scene import Scene

_MOST_PAYLOAD = 1e4  # [kg]
# Radius of the ball of a payload [m].
_PAYLOAD_RADIUS = 0.05
# Impedance of friction, MuJoCo's largest. With its default of 0.9, and 0.02 s to stop instead of two steps, joints that
# friction holds creep to their set-points within tenths of a second.
_FRICTION_IMPEDANCE = 0.9999


@dataclass(frozen=True)
class ArmVariation:
    """Differences of simulated arms from their description, on which the feed-forward torque of their servos is based.

    Args:
        payload: Mass at the tool of each arm [kg], a ball of 5 cm radius around the tool's origin.
        mass: Factor for the masses and inertias of all links.
        friction: Coulomb friction of each joint as a fraction of its effort limit; joints without a limit have none.

    Raises:
        InputError: a payload that is not 0 to 10,000 kg, a negative friction, a factor that is not above zero,
            numbers that are not finite.
    """

    payload: float = 0.0
    mass: float = 1.0
    friction: float = 0.0

    def __post_init__(self) -> None:
        for name in ("payload", "friction"):
            object.__setattr__(self, name, number_from_zero(name, getattr(self, name)))
        if self.payload > _MOST_PAYLOAD:
            raise InputError(f"payload is {self.payload:g} kg, expected at most {_MOST_PAYLOAD:g} kg")
        object.__setattr__(self, "mass", positive_number("mass", self.mass))

    def __str__(self) -> str:
        return (
            f"payload {self.payload:.3g} kg, masses x {self.mass:.3g}, friction {100.0 * self.friction:.3g} % of effort"
        )


def varied_model(model: mujoco.MjModel, scene: Scene, effort_limits: Array, variation: ArmVariation) -> mujoco.MjModel:
    """A copy of a MuJoCo model with varied arms.

    Args:
        model: The model of a scene, whose first degrees of freedom are the joints.
        scene: The scene.
        effort_limits: Largest effort of each joint [Nm or N], shape (n,).
        variation: How the arms differ.
    """
    varied = copy.copy(model)
    for name, arm in scene.arms.items():
        for link in arm.robot.links:
            body = varied.body(f"{name}/{link.name}").id
            varied.body_mass[body] *= variation.mass
            varied.body_inertia[body] *= variation.mass
        if variation.payload > 0.0:
            _add_payload(varied, varied.body(f"{name}/{arm.robot.tool}").id, variation.payload)
    joints = slice(len(effort_limits))
    varied.dof_frictionloss[joints] += variation.friction * np.where(np.isfinite(effort_limits), effort_limits, 0.0)
    varied.dof_solimp[joints, :2] = _FRICTION_IMPEDANCE
    varied.dof_solref[joints] = 2.0 * varied.opt.timestep, 1.0
    # Update the constants that MuJoCo derives from the masses.
    mujoco.mj_setConst(varied, mujoco.MjData(varied))
    return varied


def _add_payload(model: mujoco.MjModel, body: int, payload: float) -> None:
    own, com = float(model.body_mass[body]), model.body_ipos[body].copy()
    total = own + payload
    model.body_mass[body] = total
    model.body_ipos[body] = com * (own / total)
    # The same parallel-axis term in all directions: an upper bound, and zero for a frame without mass.
    shifted = own * payload / total * float(com @ com)
    model.body_inertia[body] += shifted + 0.4 * payload * _PAYLOAD_RADIUS**2
