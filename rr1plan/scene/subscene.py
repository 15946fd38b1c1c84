"""Parts of scenes: some of the arms with the objects they hold."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np

from rr1plan.checks import Array
from rr1plan.robot import Robot
from rr1plan.robot.joint_limits import Limits
from rr1plan.scene import Arm, Scene
from rr1plan.scene.scene import with_fewer

_NO_JOINTS = Limits(*[np.zeros(0)] * len(Limits.__dataclass_fields__))


def subscene(
    scene: Scene,
    configurations: Mapping[str, Array | None],
    *,
    obstacles: bool = True,
    bases: Collection[str] = frozenset(),
) -> Scene:
    """The part of a scene with some of its arms and the objects they hold.

    Args:
        scene: The scene.
        configurations: The arms to keep, each with a configuration (nq,), or None for that of the scene.
        obstacles: Whether to keep the obstacles.
        bases: Other arms of which to keep the links that no joint moves.
    """
    arms = {}
    for name, arm in scene.arms.items():
        if name in configurations:
            q = configurations[name]
            arms[name] = arm if q is None else Arm(arm.robot, arm.base, q)
        elif name in bases:
            arms[name] = Arm(_base_of(arm.robot), arm.base)
    held = {
        name: thing
        for name, thing in scene.attachments.items()
        if thing.arm in arms and thing.link in arms[thing.arm].robot.link_names
    }
    return with_fewer(scene, arms=arms, obstacles=scene.obstacles if obstacles else {}, attachments=held)


@lru_cache(maxsize=128)
def _base_of(robot: Robot) -> Robot:
    """The links that no joint of a robot moves, as a robot without planning joints."""
    links = robot.bodies[0]
    names = frozenset(link.name for link in links)
    return replace(
        robot,
        links=links,
        joints=tuple(joint for joint in robot.joints if joint.child in names),
        joint_names=(),
        limits=_NO_JOINTS,
        configurations={"home": np.zeros(0)},
        locked_joints={},
        disabled_collisions=frozenset(both for both in robot.disabled_collisions if both <= names),
        tool=robot.base,
        presets={},
        locked_joint_states={},
    )
