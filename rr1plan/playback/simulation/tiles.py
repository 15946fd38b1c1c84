"""Tiles: parts of a scene whose arms can never meet those of other parts, each simulated by a separate model.

One model of many arms spends most of its time on finding which of all their shapes are near each other, although most
of them never are. Tiles of a few arms do not.
"""

from __future__ import annotations

import numpy as np

from rr1plan.collision.collision_geometry import geometries_of
from rr1plan.collision.reach_broad_phase import bases_of, near_balls, placed_balls, reach_ball
from rr1plan.scene import Scene
from rr1plan.scene.subscene import subscene

# Largest number of arms in one model by default, and smallest number in a tile of a larger scene.
ARMS_IN_A_TILE = 20


def tile_scenes(scene: Scene) -> list[Scene]:
    """Parts of a scene, each with some of its arms, what these hold, and all obstacles.

    Args:
        scene: The scene.

    Returns:
        The scene itself, or parts in the order of its arms.
    """
    groups = _groups(scene) if len(scene.arms) > ARMS_IN_A_TILE else []
    if len(groups) < 2:
        return [scene]
    tiles: list[list[str]] = [[]]
    for group in groups:
        if len(tiles[-1]) >= ARMS_IN_A_TILE:
            tiles.append([])
        tiles[-1] += group
    return [subscene(scene, dict.fromkeys(names)) for names in tiles]


def _groups(scene: Scene) -> list[list[str]]:
    """Arms that can meet, directly or through others, by balls that contain all they can reach."""
    names, geometries = list(scene.arms), geometries_of(scene)
    balls = placed_balls(np.array([reach_ball(geometries[a]) for a in names]).reshape(-1, 4), bases_of(scene, names))
    group = list(range(len(names)))
    for i, j in near_balls(balls, 0.0).tolist():
        a, b = sorted((group[i], group[j]))
        if a != b:
            group = [a if g == b else g for g in group]
    members: dict[int, list[str]] = {}
    for name, g in zip(names, group, strict=True):
        members.setdefault(g, []).append(name)
    return list(members.values())
