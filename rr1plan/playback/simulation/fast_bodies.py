"""Loose bodies that move into or through other bodies, because they are too fast for the time step.

MuJoCo searches for contacts between steps and its contacts are soft: a body penetrates a wall by up to 1.5 times the
distance that it moves per step. If its center of mass enters the wall, it may be pushed out on the other side; a fast
body passes a thin wall without any contact.
"""

from __future__ import annotations

import mujoco
import numpy as np

from rr1plan.checks import Array
from rr1plan.playback.simulation.mujoco_model import MujocoScene

# Slower bodies, which move less than this share of half their thickness per step, are stopped by contacts.
_SLOW = 0.25


class FastBodies:
    """Watches the loose bodies of a model.

    Args:
        world: The compiled model.
        data: Its data.
    """

    def __init__(self, world: MujocoScene, data: mujoco.MjData) -> None:
        model, first = world.model, len(world.joint_names)
        self._elements, self._names = world.geom_elements, world.body_names
        self._bodies = [int(model.jnt_bodyid[first + i]) for i in range(len(self._names))]
        self._half = np.array([_half_thickness(model, body) for body in self._bodies])
        self._rates = data.qvel[first:].reshape(-1, 6)[:, :3]

    def passages(self, model: mujoco.MjModel, data: mujoco.MjData) -> dict[tuple[str, str], float]:
        """Bodies whose centers of mass entered another body in the last step, with its element.

        Args:
            model: MuJoCo's model.
            data: The data, with poses and velocities computed.

        Returns:
            The distances that they moved in this step [m].
        """
        dt, found = model.opt.timestep, dict[tuple[str, str], float]()
        moved = dt * np.abs(self._rates).max(axis=1)
        fast = moved > _SLOW * self._half
        if not fast.any():
            return found
        # The center of a body enters another one only if the bodies touch, unless it moves by half its thickness.
        touches = np.isin(self._bodies, model.geom_bodyid[data.contact.geom])
        for i in np.flatnonzero(fast & (touches | (moved > self._half))).tolist():
            velocity, body = np.empty(6), self._bodies[i]
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, body, velocity, 0)
            geom = _entered(model, data, body, dt * velocity[3:])
            if geom is not None:
                found[self._names[i], self._elements[geom]] = dt * float(np.linalg.norm(velocity[3:]))
        return found


def _entered(model: mujoco.MjModel, data: mujoco.MjData, body: int, move: Array) -> int | None:
    """The geom of another body whose surface the center of mass crossed; planes push bodies to one side only."""
    hit = np.array([-1], dtype=np.int32)
    share = mujoco.mj_ray(model, data, data.xipos[body] - move, move, None, 1, body, hit)
    geom = int(hit[0])
    return geom if 0.0 <= share <= 1.0 and model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_PLANE else None


def _half_thickness(model: mujoco.MjModel, body: int) -> float:
    """Half the thickness of the thickest shape of a body [m]."""
    first = int(model.body_geomadr[body])
    sizes = model.geom_aabb[first : first + int(model.body_geomnum[body]), 3:]
    return float(sizes.min(axis=1).max())
