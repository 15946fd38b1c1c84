"""Parts of scenes: some of the arms with the objects they hold."""

from __future__ import annotations

from collections.abc import Mapping

from rr1plan.checks import Array
from rr1plan.scene import Scene


def subscene(scene: Scene, configurations: Mapping[str, Array | None], *, obstacles: bool = True) -> Scene:
    """The part of a scene with some of its arms and the objects they hold.

    Args:
        scene: The scene.
        configurations: The arms to keep, each with a configuration (nq,), or None for that of the scene.
        obstacles: Whether to keep the obstacles.
    """
    arms = {}
    for name, arm in scene.arms.items():
        if name in configurations:
            q = configurations[name]
            arms[name] = arm if q is None else type(arm)(arm.robot, arm.base, q)
    held = {name: thing for name, thing in scene.attachments.items() if thing.arm in arms}
    part = Scene(arms, scene.obstacles if obstacles else {}, held, padding=scene.padding, name=scene.name)
    if not scene.allowed and not scene.pair_padding:
        return part
    names = {*part.element_names, *part.arms}
    return Scene(
        part.arms,
        part.obstacles,
        part.attachments,
        frozenset(both for both in scene.allowed if both <= names),
        scene.padding,
        {both: distance for both, distance in scene.pair_padding.items() if both <= names},
        scene.name,
    )
