"""Groups of arms that may collide, directly or through others, judged by their reach."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from rr1plan.collision.collision_geometry import geometries_of
from rr1plan.collision.reach_broad_phase import near_balls, reach_balls
from rr1plan.scene import Scene
from rr1plan.scene.scene_content import largest_padding


def arms_in_reach(scene: Scene, arms: Iterable[str], margin: float) -> dict[str, frozenset[str]]:
    """The arms that each arm may collide with, by balls that contain everything an arm can reach.

    Args:
        scene: The scene.
        arms: The arms that move.
        margin: Distance to keep beyond the padding [m].
    """
    names = tuple(arms)
    padding = largest_padding(scene) + margin
    balls = reach_balls(scene, geometries_of(scene), names)
    near: dict[str, set[str]] = {name: set() for name in names}
    for i, j in near_balls(balls, padding).tolist():
        near[names[i]].add(names[j])
        near[names[j]].add(names[i])
    return {name: frozenset(others) for name, others in near.items()}


def interaction_groups(near: Mapping[str, Iterable[str]]) -> list[tuple[str, ...]]:
    """Connected components, each in the order of the arms.

    Args:
        near: The arms that each arm may collide with.
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
