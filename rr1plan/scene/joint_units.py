"""Units of joint positions."""

from __future__ import annotations

from collections.abc import Iterable

from rr1plan.checks import known_name
from rr1plan.scene.scene import Scene


def joint_units(joint_names: Iterable[str], scene: Scene) -> list[str]:
    """The unit of each joint "arm/joint" of a scene, "m" for a prismatic joint and "rad" for others.

    Raises:
        UnknownNameError: a joint the scene does not have.
    """
    known = {
        f"{arm}/{name}": placed.robot.joint(name).unit
        for arm, placed in scene.arms.items()
        for name in placed.robot.joint_names
    }
    return [known[known_name("joint", name, known)] for name in joint_names]


def length_unit(joint_names: Iterable[str], scene: Scene) -> str:
    """The unit of lengths in the space of some joints: "rad", "m", or "rad and m" if both kinds are among them.

    Raises:
        UnknownNameError: a joint the scene does not have.
    """
    return " and ".join(dict.fromkeys(joint_units(joint_names, scene)))
