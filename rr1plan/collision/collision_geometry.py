"""The collision geometry of a scene: instances of arms, obstacles near them, and the pairs to check.

A stationary arm is an obstacle. Arms and obstacles that a moving arm can never come near are omitted (see
`reach_broad_phase.py`), so the size of everything built here grows with the number of nearby objects, not with the
scene.

A geometry does not depend on padding, so scenes that differ only in padding share it as a whole. Its parts are shared
by content: an arm's geometry by all arms with equal robots and held objects, the pairs by all scenes that differ only
in the poses of objects.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import FARTHEST, read_only
from rr1plan.collision.arm_geometry import ArmGeometry, ArmInstances, Solid, arm_geometry, arm_instances
from rr1plan.collision.obstacle_geometry import ObstacleGeometry, obstacle_geometry, stationary_arm_geometry
from rr1plan.collision.reach_broad_phase import find_near, gaps_between, placed_balls, solid_reach
from rr1plan.errors import InputError
from rr1plan.kernels.planner_kernels import load_library
from rr1plan.object_cache import kept_in
from rr1plan.scene import Attachment, Scene
from rr1plan.scene.contact_rules import ContactRules, RuleContent, rules_of
from rr1plan.scene.scene_content import largest_padding

_INTS = NDArray[np.int64]


class CollisionGeometry:
    """Solids of the moving arms and of all arms and obstacles near them, and the pairs that must not touch.

    Args:
        scene: The scene.
        arms: The arms that move, in the order of the scene.
        distance: Elements that provably stay farther than this from every moving arm are omitted [m].

    Attributes:
        distance: As given.
        instances: The moving arms.
        obstacles: Objects that do not move: stationary arms, then obstacles.
        rules: Which elements must not touch; its `names` are the elements.
        pairs: Which solids must not touch.
        least_gap: Omitted elements stay at least this far from every moving arm [m]; inf if there are none.

    Raises:
        InputError: a shape that cannot be made solid.
    """

    def __init__(self, scene: Scene, arms: tuple[str, ...], distance: float) -> None:
        geometries = geometries_of(scene)
        obstacles = obstacle_geometry(scene.obstacles)
        near = find_near(scene, geometries, obstacles, arms, distance)
        self._arms = arms
        self.distance = distance
        if len(near.obstacles) < len(scene.obstacles):
            obstacles = obstacle_geometry({name: scene.obstacles[name] for name in near.obstacles})
        if near.arms:
            still = ((name, geometries[name], scene.arms[name]) for name in near.arms)
            standing = [stationary_arm_geometry(name, geometry, arm.base, arm.q) for name, geometry, arm in still]
            obstacles = ObstacleGeometry.joined([*standing, obstacles])
        self.obstacles = obstacles
        names = {*arms, *near.arms}
        layout = _large_layout if len(arms) > _MANY else _layout
        self.instances, self.rules, self.pairs, least_gap = layout(
            arms,
            tuple([scene.arms[name].base.tobytes() for name in arms]),
            tuple([(name, geometry) for name, geometry in geometries.items() if name in names]),
            tuple([(name, thing.arm, thing.link, frozenset(thing.touch)) for name, thing in scene.attachments.items()]),
            near.obstacles,
            scene.allowed,
            near.near_pairs,
            tuple(obstacles.elements),
            obstacles.surfaceless.tobytes(),
            distance,
        )
        self.least_gap = min(near.least_gap, least_gap)

    @cached_property
    def solids(self) -> tuple[Solid, ...]:
        """All solids: those of the moving arms, then those that do not move."""
        return self.instances.solids(self._arms) + self.obstacles.solids

    def check_kinds(self) -> None:
        """Reject moving pairs in which neither solid has a surface to measure from.

        Raises:
            InputError: a half-space or a point cloud that would have to be checked against another one.
        """
        if self.pairs.has_unmeasurable:
            both = self.pairs.surfaceless[self.pairs.moving].all(axis=1)
            one, two = (self.solids[i].element for i in self.pairs.moving[int(both.argmax())])
            raise InputError(f"{one!r} and {two!r} are half-spaces or point clouds; they cannot be checked")


def held_by_arm(scene: Scene) -> dict[str, dict[str, Attachment]]:
    """The attached objects of each arm that has any."""
    held: dict[str, dict[str, Attachment]] = {}
    for name, thing in scene.attachments.items():
        held.setdefault(thing.arm, {})[name] = thing
    return held


_Names = frozenset[str]
_Held = tuple[str, str, str, _Names]


def _new_layout(
    arms: tuple[str, ...],
    bases: tuple[bytes, ...],
    geometries: tuple[tuple[str, ArmGeometry], ...],
    held: tuple[_Held, ...],
    obstacles: tuple[str, ...],
    allowed: frozenset[_Names],
    near_pairs: frozenset[_Names] | None,
    elements: tuple[str, ...],
    surfaceless: bytes,
    distance: float,
) -> tuple[ArmInstances, ContactRules, SolidPairs, float]:
    """The moving arms, which elements and solids must not touch, and the least gap of links that are out of reach.

    Independent of the poses of obstacles.

    Args:
        arms: The arms that move.
        bases: T_world_base of each of them, as bytes.
        geometries: Geometries of these arms and of stationary arms near them.
        held: Name, arm, link and allowed links of each attached object of the scene.
        obstacles: The obstacles near them.
        allowed: Pairs of elements or arms that may touch.
        near_pairs: See `Near`.
        elements: The element of each solid that does not move.
        surfaceless: Which of these solids are half-spaces, point clouds or concave meshes, as bytes of bool.
        distance: Elements of two moving arms that provably stay farther apart than this are omitted [m]; only in scenes
            in which arms or obstacles are omitted.
    """
    of_arm = dict(geometries)
    held = tuple(thing for thing in held if thing[1] in of_arm)
    links = [f"{name}/{link}" for name, geometry in geometries for link in geometry.robot.solid_links]
    names = {*of_arm, *links, *obstacles, *(name for name, *_ in held)}
    robots = [(name, geometry.robot) for name, geometry in geometries]
    rules = rules_of(
        RuleContent(
            # Links of one arm are a near pair only if the arm moves.
            tuple(
                (name, robot.base, robot.solid_links, robot.disabled_collisions if name in arms else frozenset())
                for name, robot in robots
            ),
            obstacles,
            held,
            frozenset(both for both in allowed if both <= names),
            near_pairs,
        )
    )
    instances = arm_instances(tuple(of_arm[name] for name in arms), bases)
    least_gap = np.inf
    if near_pairs is not None:
        rules, least_gap = _within_reach(rules, instances, arms, distance)
    return instances, rules, _solid_pairs(instances, arms, rules, elements, surfaceless), least_gap


_layout = lru_cache(maxsize=128)(_new_layout)
# The pairs of a thousand arms take two gigabytes.
_MANY = 32
_large_layout = lru_cache(maxsize=2)(_new_layout)


def _within_reach(
    rules: ContactRules, instances: ArmInstances, arms: tuple[str, ...], distance: float
) -> tuple[ContactRules, float]:
    """The rules without pairs of elements of two moving arms that stay apart, and the least gap of those [m]."""
    number = {name: i for i, name in enumerate(rules.names)}
    balls, owner = np.full((len(number), 4), [0.0, 0.0, 0.0, -np.inf]), np.full(len(number), -1, np.int64)
    for i, (geometry, arm) in enumerate(zip(instances.geometries, arms, strict=True)):
        index, reach = [number[name] for name in geometry.elements(arm)], solid_reach(geometry)
        owner[index], balls[index, :3] = i, placed_balls(reach, instances.bases[i : i + 1])[:, :3]
        np.maximum.at(balls[:, 3], index, reach[:, 3])
    one, two = rules.checked.T
    gaps = np.where((owner[one] >= 0) & (owner[two] >= 0) & (owner[one] != owner[two]), 0.0, -np.inf)
    of_two_arms = np.flatnonzero(gaps == 0.0)
    gaps[of_two_arms] = gaps_between(balls[one[of_two_arms]], balls[two[of_two_arms]])
    near = gaps <= distance
    return (rules, np.inf) if near.all() else (rules.with_checked(rules.checked[near]), float(gaps[~near].min()))


# ---- pairs -----------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class SolidPairs:
    """The pairs of solids that must not touch; solids are numbered as in `CollisionGeometry.solids`.

    Args:
        moving: Pairs of solids [index] whose relative pose depends on q, shape (m, 2).
        moving_owner: Index in the `checked` of the rules of each of those, shape (m,).
        moving_rows: The same pairs, a half-space or point cloud second, and the number of driven joints that move both;
            shape (m, 3).
        static, static_owner, static_rows: Likewise for pairs that do not move relative to each other.
        surfaceless: Which solids are half-spaces or point clouds, shape (n,).
        has_unmeasurable: Whether some moving pair consists of two such solids.
        kept: Tables derived from them.
    """

    moving: _INTS
    moving_owner: _INTS
    moving_rows: _INTS
    static: _INTS
    static_owner: _INTS
    static_rows: _INTS
    surfaceless: NDArray[np.bool_]
    has_unmeasurable: bool
    kept: dict[str, Any] = field(default_factory=dict)


def _solid_pairs(
    instances: ArmInstances, arms: tuple[str, ...], rules: ContactRules, elements: tuple[str, ...], surfaceless: bytes
) -> SolidPairs:
    """The pairs of solids; see `_new_layout`."""
    checked = rules.checked
    number = {name: i for i, name in enumerate(rules.names)}
    moving = [name for g, arm in zip(instances.geometries, arms, strict=True) for name in g.elements(arm)]
    element_of, element_count = np.array([number[name] for name in (*moving, *elements)], np.int64), len(number)
    chains = np.zeros(len(element_of), np.int64)
    chains[: len(instances.groups)] = instances.groups
    links = np.array([joint for chain in instances.chains for joint in chain], np.int64)
    first_link = np.cumsum([0, *map(len, instances.chains)], dtype=np.int64)
    kinds = np.array([*instances.surfaceless, *np.frombuffer(surfaceless, np.bool_)], np.bool_)
    sizes = np.bincount(element_of, minlength=element_count)
    count = int(sizes[checked[:, 0]] @ sizes[checked[:, 1]])
    order, first = np.empty(len(element_of), np.int64), np.empty(element_count + 1, np.int64)
    index, owner = np.empty((count, 2), np.int64), np.empty(count, np.int64)
    rows = np.empty((count, 3), np.int64)
    count_moving = load_library().rr1_list_solid_pairs(
        checked, len(checked), element_of, len(element_of), element_count, chains, links, first_link,
        kinds.view(np.uint8), order, first, index, owner, rows,
    )  # fmt: skip
    for array in (index, owner, rows, kinds):
        read_only(array)
    unmeasurable = bool(kinds[index[:count_moving]].all(axis=1).any())
    halves = ((array[:count_moving], array[count_moving:]) for array in (index, owner, rows))
    (pairs, static), (owners, static_owners), (moving_rows, static_rows) = halves
    return SolidPairs(pairs, owners, moving_rows, static, static_owners, static_rows, kinds, unmeasurable)


# Elements within this distance beyond the greatest padding belong to a geometry [m]; the sum is rounded up to a
# multiple of `_STEP`, so that scenes whose paddings differ by millimeters share a geometry.
_NEAR = 0.05
_STEP = 0.1


def geometry_distance(scene: Scene, margin: float) -> float:
    """Distance within which elements belong to a geometry for a scene with a margin beyond its padding [m]."""
    greatest = largest_padding(scene) + margin
    return _STEP * math.ceil((greatest + _NEAR) / _STEP) if greatest < FARTHEST else math.inf


def collision_geometry(scene: Scene, arms: tuple[str, ...], distance: float) -> CollisionGeometry:
    """The geometry of a scene and its moving arms, which the scene keeps.

    Args:
        scene: The scene.
        arms: The arms that move, in the order of the scene.
        distance: See `geometry_distance`; infinite: omit nothing.
    """
    key = ("collision geometry", arms, distance)
    return kept_in(scene.kept_for_any_padding, key, lambda: CollisionGeometry(scene, arms, distance))


def geometries_of(scene: Scene, arms: Iterable[str] | None = None) -> Mapping[str, ArmGeometry]:
    """The geometry of some arms of a scene (default: all)."""
    held = held_by_arm(scene)
    return {name: arm_geometry(scene.arms[name], held.get(name, {})) for name in (scene.arms if arms is None else arms)}
