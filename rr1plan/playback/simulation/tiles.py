"""Tiles: parts of a scene whose arms can never meet those of other parts, each simulated by a separate model.

Threads step them side by side, and where the arms of one tile are near each other, MuJoCo does not look for contacts
in the others. Each tile costs some calls from Python in every step, so that there are few of them.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence

from rr1plan.checks import counted
from rr1plan.collision.arm_groups import arms_in_reach, interaction_groups
from rr1plan.errors import InputError
from rr1plan.playback.simulation.mujoco_model import loose_bodies, stack_memory
from rr1plan.scene import Scene
from rr1plan.scene.subscene import subscene

# Memory of the collision checker for each arm beside eight others [bytes].
_BYTES_PER_ARM = 3.0e6
# Smallest number of arms in a tile, and largest number of tiles.
_ARMS_IN_A_TILE, _MOST_TILES = 60, 4


def tile_scenes(scene: Scene) -> list[Scene]:
    """Parts of a scene, each with some of its arms, what these hold, and all obstacles.

    Args:
        scene: The scene.

    Returns:
        The scene itself, as always with loose bodies, which may come anywhere; or parts in the order of its arms.
    """
    if loose_bodies(scene):
        return [scene]
    groups = interaction_groups(arms_in_reach(scene, scene.arms, 0.0)) if len(scene.arms) > _ARMS_IN_A_TILE else []
    if len(groups) < 2:
        return [scene]
    least = max(_ARMS_IN_A_TILE, math.ceil(len(scene.arms) / _MOST_TILES))
    tiles: list[list[str]] = [[]]
    for group in groups:
        if len(tiles[-1]) >= least:
            tiles.append([])
        tiles[-1] += group
    return [subscene(scene, dict.fromkeys(names)) for names in tiles]


def check_memory(tiles: Sequence[Scene]) -> None:
    """Refuse a simulation that takes more memory than the machine has.

    Args:
        tiles: The scene of each model.

    Raises:
        InputError: too many arms or loose bodies; gives both sizes.
    """
    have = _physical_memory()
    need = float(sum(stack_memory(_degrees_of_freedom(tile)) for tile in tiles))
    need += sum(_BYTES_PER_ARM * len(tile.arms) for tile in tiles)
    if have is not None and need > have:
        arms, bodies = sum(len(tile.arms) for tile in tiles), sum(len(loose_bodies(tile)) for tile in tiles)
        raise InputError(
            f"a simulation of {counted(arms, 'arm')} and {counted(bodies, 'loose body', 'loose bodies')} takes about "
            f"{need / 1e9:.3g} GB of memory, this machine has {have / 1e9:.3g} GB; take fewer, or place arms so that "
            "groups of them cannot meet, which have separate models"
        )


def _degrees_of_freedom(scene: Scene) -> int:
    joints = sum(joint.kind != "fixed" for arm in scene.arms.values() for joint in arm.robot.joints)
    return joints + 6 * len(loose_bodies(scene))


def _physical_memory() -> int | None:
    """Memory of the machine [bytes]; None where the system does not say."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return None
