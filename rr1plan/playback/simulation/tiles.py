"""Tiles: parts of a scene whose arms can never meet those of other parts, each simulated by a separate model.

One model of many arms spends most of its time on finding which of all their shapes are near each other, although most
of them never are. Tiles of a few arms do not.
"""

from __future__ import annotations

from rr1plan.collision.arm_groups import arms_in_reach, interaction_groups
from rr1plan.playback.simulation.mujoco_model import loose_bodies
from rr1plan.scene import Scene
from rr1plan.scene.subscene import subscene

# Largest number of arms in one model by default, and smallest number in a tile of a larger scene.
ARMS_IN_A_TILE = 20


def tile_scenes(scene: Scene) -> list[Scene]:
    """Parts of a scene, each with some of its arms, what these hold, and all obstacles.

    Args:
        scene: The scene.

    Returns:
        The scene itself, as always with loose bodies, which may come anywhere; or parts in the order of its arms.
    """
    if loose_bodies(scene):
        return [scene]
    groups = interaction_groups(arms_in_reach(scene, scene.arms, 0.0)) if len(scene.arms) > ARMS_IN_A_TILE else []
    if len(groups) < 2:
        return [scene]
    tiles: list[list[str]] = [[]]
    for group in groups:
        if len(tiles[-1]) >= ARMS_IN_A_TILE:
            tiles.append([])
        tiles[-1] += group
    return [subscene(scene, dict.fromkeys(names)) for names in tiles]
