"""Interaction groups: arms that can meet, directly or through others. Groups are planned apart.

First what an arm can reach at all decides, then what it sweeps on its path: a ball, a box, a coordination diagram.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import combinations

import numpy as np

from rr1plan.collision.collision_geometry import geometries_of
from rr1plan.collision.reach_broad_phase import bases_of, near_balls, placed_balls, reach_ball
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.timing.diagram_cache import DiagramCache
from rr1plan.scene import Scene


def arms_in_reach(scene: Scene, arms: Iterable[str], margin: float) -> dict[str, frozenset[str]]:
    """Of each arm those that it can meet, by balls that contain all an arm can reach.

    Args:
        scene: The scene.
        arms: The arms that move.
        margin: Distance to keep beyond the padding [m].
    """
    names = tuple(arms)
    geometries = geometries_of(scene)
    padding = max((scene.padding, *scene.pair_padding.values())) + margin
    balls = placed_balls(np.array([reach_ball(geometries[a]) for a in names]).reshape(-1, 4), bases_of(scene, names))
    near: dict[str, set[str]] = {name: set() for name in names}
    for i, j in near_balls(balls, padding).tolist():
        near[names[i]].add(names[j])
        near[names[j]].add(names[i])
    return {name: frozenset(others) for name, others in near.items()}


def interaction_groups(near: Mapping[str, Iterable[str]]) -> list[tuple[str, ...]]:
    """Connected components, each in the order of the arms.

    Args:
        near: Of each arm those that it can meet.
    """
    groups, seen = [], set()
    order = {name: i for i, name in enumerate(near)}
    for first in near:
        if first in seen:
            continue
        group, open_ = {first}, [first]
        while open_:
            for other in near[open_.pop()]:
                if other not in group:
                    group.add(other)
                    open_.append(other)
        seen |= group
        groups.append(tuple(sorted(group, key=order.__getitem__)))
    return groups


def meeting_groups(
    paths: Mapping[str, AgentPath],
    near: Mapping[str, frozenset[str]],
    diagrams: DiagramCache,
    *,
    exactly: bool = False,
) -> list[tuple[str, ...]]:
    """Groups of arms whose paths may meet: arms of different groups never touch, whenever they are where.

    Args:
        paths: The path of each arm; arms that move as one share it.
        near: Of each arm those that it can meet at all.
        diagrams: Coordination diagrams of the problem.
        exactly: Whether to decide by coordination diagrams, not by boxes around what is swept.
    """
    meets = (lambda a, b: diagrams.diagram(a, b) is not None) if exactly else diagrams.may_touch
    found: dict[str, list[str]] = {arm: [] for arm in paths}
    for one, two in combinations(paths, 2):
        if two in near[one] and (paths[one] is paths[two] or meets(paths[one], paths[two])):
            found[one].append(two)
            found[two].append(one)
    return interaction_groups(found)
