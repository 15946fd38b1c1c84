"""Parts of scenes: some of the arms with the objects they hold."""

from __future__ import annotations

from collections.abc import Mapping

from rr1plan.checks import Array
from rr1plan.scene import Scene
from rr1plan.scene.scene import with_fewer
from rr1plan.scene.scene_elements import moved_arm


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
            arms[name] = arm if q is None else moved_arm(arm, q)
    held = {name: thing for name, thing in scene.attachments.items() if thing.arm in arms}
    return with_fewer(scene, arms=arms, obstacles=scene.obstacles if obstacles else {}, attachments=held)
