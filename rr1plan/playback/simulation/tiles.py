"""Tiles: parts of a scene whose arms can never meet those of other parts, each simulated by a separate model.

Threads step them in parallel, and if the arms of one tile are close to each other, MuJoCo does not search for contacts
in the others. Each tile costs some calls from Python in every step, so only a few are made.
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

# Memory of the collision checker per arm with eight other arms near it [bytes].
_BYTES_PER_ARM = 3.0e6
# Smallest number of arms in a tile, and largest number of tiles.
_ARMS_IN_A_TILE, _MOST_TILES = 60, 4


def tile_scenes(scene: Scene) -> list[Scene]:
    """Parts of a scene, each with some of its arms, their held objects and all obstacles.

    Args:
        scene: The scene.

    Returns:
        Parts in the order of the arms, or the scene itself; always the scene if it has loose bodies, which can get
            anywhere.
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
    """Require that a simulation fits into the machine's memory.

    Args:
        tiles: The scene of each model.

    Raises:
        InputError: too many arms or loose bodies; the message gives required and available memory.
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
    """Memory of the machine [bytes]; None if the system does not report it."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return None
