"""Scenes of one arm among others, with which a page of many arms plans for each of them.

A page cannot contain the tables of all arms that might move: in the joint space of a hundred arms they take gigabytes.
It contains those of one arm of each kind instead, in its base frame, with an obstacle for each link of as many
neighbors as any arm of that kind has. To plan for an arm, the page moves these obstacles to the poses of its neighbors'
links (`page/many_arms_planner.js`).
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

from rr1plan.checks import Array
from rr1plan.collision.arm_geometry import pieces_of
from rr1plan.collision.arm_groups import arms_in_reach
from rr1plan.collision.collision_geometry import geometries_of, held_by_arm
from rr1plan.collision.convex.convex_bodies import solid_pieces
from rr1plan.robot import Geometry
from rr1plan.scene import Arm, Obstacle, Scene
from rr1plan.transforms import identity, inverse, pose

ARM = "arm"
"""The name of the arm in a template."""
# Position of unused neighbors: beyond the reach of any arm, but not so far that rounding matters [m].
_FAR = 100.0


@dataclass(frozen=True, eq=False)
class ArmPart:
    """A link of an arm, or an object that it holds.

    Args:
        link: The link that carries it.
        pose: T_link_part, shape (4, 4).
        geometries: Its convex shapes, in the frame of the part.
    """

    link: str
    pose: Array
    geometries: tuple[Geometry, ...]


@dataclass(frozen=True, eq=False)
class ArmTemplate:
    """The scene of an arm among neighbors.

    Args:
        scene: The arm, called `ARM`, with its base at the origin; the obstacles; then the parts of all neighbors, far
            away.
        parts: The parts of an arm of this kind, which its neighbors must not touch.
        neighbors: Number of neighbors of each kind in the scene, by the index of the kind.
    """

    scene: Scene
    parts: tuple[ArmPart, ...]
    neighbors: dict[int, int]


def arm_kinds(scene: Scene) -> dict[str, int]:
    """The kind of each arm: equal numbers for equal robots and held objects under equal contact rules."""
    geometries = geometries_of(scene)
    numbers: dict[object, int] = {}
    return {
        name: numbers.setdefault((id(geometries[name]), *_own_rules(scene, name)), len(numbers)) for name in scene.arms
    }


def has_rules_between_arms(scene: Scene) -> bool:
    """Whether some contact rule concerns two particular arms, which templates cannot represent."""
    owners = ({scene.owner(name) or name for name in both} for both in (*scene.allowed, *scene.pair_padding))
    return any(len(both & scene.arms.keys()) > 1 for both in owners)


def neighbors_of(scene: Scene, distance: float) -> dict[str, tuple[str, ...]]:
    """For each arm the arms that it can come near to in some configurations, in the order of their kinds.

    Args:
        scene: The scene.
        distance: All other arms stay farther away than this in addition to the padding [m].
    """
    kinds, near = arm_kinds(scene), arms_in_reach(scene, scene.arms, distance)
    order = {name: (kinds[name], i) for i, name in enumerate(scene.arms)}
    return {name: tuple(sorted(others, key=order.__getitem__)) for name, others in near.items()}


def arm_templates(scene: Scene, distance: float) -> list[ArmTemplate]:
    """A template for each kind of arm.

    Args:
        scene: The scene.
        distance: See `neighbors_of`.

    Raises:
        InputError: a shape that cannot be converted to a solid.
    """
    kinds, near = arm_kinds(scene), neighbors_of(scene, distance)
    first = {kind: name for name, kind in reversed(kinds.items())}
    parts = {kind: _parts(scene, first[kind]) for kind in sorted(first)}
    most: dict[int, Counter[int]] = {kind: Counter() for kind in parts}
    for name, others in near.items():
        most[kinds[name]] |= Counter(kinds[other] for other in others)
    templates = []
    for kind, own in parts.items():
        neighbors = dict(sorted(most[kind].items()))
        obstacles = {
            f"{other}.{number} {part}": Obstacle(thing.geometries, pose([_FAR] * 3))
            for other, count in neighbors.items()
            for number in range(count)
            for part, thing in enumerate(parts[other])
        }
        templates.append(ArmTemplate(_alone(scene, first[kind]).with_obstacles(obstacles), own, neighbors))
    return templates


def _renamed(arm: str, name: str) -> str:
    """The name of an element of an arm in its template."""
    return ARM if name == arm else f"{ARM}/{name.split('/', 1)[1]}" if name.startswith(f"{arm}/") else name


def _own_rules(scene: Scene, arm: str) -> tuple[frozenset[frozenset[str]], frozenset[tuple[frozenset[str], float]]]:
    """The allowed contacts and paddings of an arm, and those without any arm, with the names of its template."""

    def concerns(both: frozenset[str]) -> bool:
        return {scene.owner(name) or name for name in both} & scene.arms.keys() <= {arm}

    def renamed(both: frozenset[str]) -> frozenset[str]:
        return frozenset(_renamed(arm, name) for name in both)

    return (
        frozenset(renamed(both) for both in scene.allowed if concerns(both)),
        frozenset((renamed(both), distance) for both, distance in scene.pair_padding.items() if concerns(both)),
    )


def _alone(scene: Scene, arm: str) -> Scene:
    """An arm with its held objects and all obstacles, in its base frame."""
    placed, to_base = scene.arms[arm], inverse(scene.arms[arm].base)
    held = held_by_arm(scene).get(arm, {})
    allowed, paddings = _own_rules(scene, arm)
    return Scene(
        arms={ARM: Arm(placed.robot, None, placed.q)},
        obstacles={name: replace(o, pose=to_base @ o.pose) for name, o in scene.obstacles.items()},
        attachments={name: replace(thing, arm=ARM) for name, thing in held.items()},
        allowed=allowed,
        padding=scene.padding,
        pair_padding=dict(paddings),
    )


def _parts(scene: Scene, arm: str) -> tuple[ArmPart, ...]:
    """The links of an arm and its held objects, as the same convex pieces that moving arms have."""
    robot, held = scene.arms[arm].robot, held_by_arm(scene).get(arm, {})
    things = [(link.name, identity(), link.name, link.collisions) for link in robot.links if link.collisions]
    things += [(name, thing.pose, thing.link, thing.geometries) for name, thing in held.items()]
    return tuple(
        ArmPart(
            link,
            pose,
            tuple(
                replace(geometry, shape=piece)
                for geometry in geometries
                for piece in pieces_of(name, geometry.shape, solid_pieces)
            ),
        )
        for name, pose, link, geometries in things
    )
