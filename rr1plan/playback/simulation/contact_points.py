"""Points at which elements of a simulated scene touch, with the forces between them."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from rr1plan.checks import Array, Value, known_name, read_only
from rr1plan.playback.simulation.mujoco_model import MujocoScene
from rr1plan.scene import Scene


@dataclass(frozen=True, eq=False, repr=False)
class ContactPoint(Value):
    """A point at which two elements touch; a face that lies on another one touches it at several points.

    Args:
        pair: The two elements, e.g. ("arm/finger_link", "cube").
        position: The point in the world [m], shape (3,).
        normal: Unit vector from the first element to the second in world axes, shape (3,).
        depth: Penetration along the normal [m].
        force: Force of the first element on the second at the point, with friction, in world axes [N], shape (3,).
        torque: Likewise the torque by torsional and rolling friction [Nm], shape (3,); zero unless the model has
            these, as it does for the objects that a simulated sequence grasps.
    """

    pair: tuple[str, str]
    position: Array
    normal: Array
    depth: float
    force: Array
    torque: Array

    @property
    def normal_force(self) -> float:
        """Force along the normal [N], at least zero."""
        return float(self.force @ self.normal)

    def turned(self) -> ContactPoint:
        """The same contact with its elements in the other order."""
        first, second = self.pair
        normal, force, torque = (read_only(0.0 - vector) for vector in (self.normal, self.force, self.torque))
        return ContactPoint((second, first), self.position, normal, self.depth, force, torque)


def elements_of(scene: Scene, name: str) -> frozenset[str]:
    """The element of a name, or the links of an arm and what it holds, as far as they have shapes.

    Raises:
        UnknownNameError: no such element or arm.
    """
    named = scene.element_names if isinstance(name, str) else ()
    elements = frozenset(element for element in named if name in (element, scene.owner(element)))
    if not elements:
        links = (f"{arm}/{link.name}" for arm, placed in scene.arms.items() for link in placed.robot.links)
        known_name("element or arm", name, dict.fromkeys((*scene.arms, *scene.element_names, *links)))
    return elements


def contact_points(world: MujocoScene, model: mujoco.MjModel, now: mujoco.MjData) -> list[ContactPoint]:
    """The contacts of a state, each pair in alphabetical order.

    Args:
        world: The scene's names.
        model: Its model, perhaps with other masses.
        now: Data after all stages of forward dynamics.
    """
    found, wrench = [], np.zeros(6)
    for k, contact in enumerate(now.contact):
        if contact.dist > 0.0:
            continue
        mujoco.mj_contactForce(model, now, k, wrench)
        axes = contact.frame.reshape(3, 3)
        first, second = (world.geom_elements[geom] for geom in contact.geom)
        rows = contact.pos, axes[0], *(wrench.reshape(2, 3) @ axes)
        position, normal, force, torque = (read_only(np.array(row)) for row in rows)
        point = ContactPoint((first, second), position, normal, -float(contact.dist), force, torque)
        found.append(point if first <= second else point.turned())
    return found
