"""Contacts between stationary objects: independent of which arms move, so they are computed once for a scene."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, read_only
from rr1plan.collision.arm_geometry import ArmGeometry
from rr1plan.collision.coal_pairs import CoalPairs, Contact
from rr1plan.collision.collision_geometry import geometries_of
from rr1plan.collision.edge_kernel import ExactKernel
from rr1plan.collision.obstacle_geometry import (
    ObstacleGeometry,
    obstacle_geometry,
    placed_arm,
    stationary_arm_geometry,
)
from rr1plan.collision.reach_broad_phase import (
    ball_gaps,
    bases_of,
    box_gaps,
    near_balls,
    obstacle_boxes,
    placed_balls,
    stationary_balls,
)
from rr1plan.collision.tables.exact_tables import build_fixed_tables
from rr1plan.collision.tables.obstacle_tables import balls_of
from rr1plan.object_cache import kept_in
from rr1plan.scene import Arm, Scene
from rr1plan.scene.scene_content import largest_padding
from rr1plan.transforms import identity


def stationary_contacts(scene: Scene, moving: Sequence[str]) -> tuple[Contact, ...]:
    """Pairs of stationary arms and obstacles that touch or are nearer than their padding, deepest first.

    Args:
        scene: The scene, with its stationary arms in their configurations.
        moving: The arms that move.
    """
    if set(scene.arms) <= set(moving):
        return ()
    found = kept_in(
        scene.kept,
        "standing contacts",
        lambda: tuple(sorted(_contacts(scene), key=lambda contact: -contact.depth)),
    )
    arms = set(moving)
    return tuple(c for c in found if scene.owner(c.a) not in arms and scene.owner(c.b) not in arms)


def _contacts(scene: Scene) -> Iterator[Contact]:
    geometries = geometries_of(scene)
    names, obstacles = list(scene.arms), list(scene.obstacles)
    for name in names:
        yield from _own_contacts(scene, name, geometries[name])
    padding = largest_padding(scene)
    balls = stationary_balls(scene, geometries, names)
    boxes = obstacle_boxes(obstacle_geometry(scene.obstacles))
    near = near_balls(balls, padding)
    placed = [placed_arm(geometries[name], scene.arms[name].q.tobytes()) for name in names]
    for parts in ([arm.elements for arm in placed], [arm.bodies for arm in placed]):
        near = _still_near(near, parts, bases_of(scene, names), padding)
    for i, j in near.tolist():
        yield from _contacts_between(scene, (names[i], names[j]), geometries)
    for i, j in np.argwhere(box_gaps(balls, boxes) <= padding).tolist():
        # The base may touch what it is mounted on.
        bodies = placed[i].bodies[_above_base(geometries[names[i]], scene.arms[names[i]])]
        own = placed_balls(bodies[None], scene.arms[names[i]].base[None])[0]
        if (box_gaps(own, boxes[j : j + 1]) <= padding).any():
            yield from _contacts_between(scene, (names[i], obstacles[j]), geometries)


# Far above the rounding error of gaps from the kernel [m].
ROUNDING = 1e-9
# Configurations of an arm for which contacts with itself are cached.
_MOST_KEPT = 1024
# Pairs of parts that are measured together.
_CHUNK = 1 << 18


def _still_near(pairs: NDArray[np.int64], parts: Sequence[Array], bases: Array, distance: float) -> NDArray[np.int64]:
    """The pairs of arms of which some parts are within a distance.

    Args:
        pairs: Arms [index], shape (m, 2).
        parts: For each arm, balls in its base frame [m], shape (k, 4).
        bases: T_world_base of each arm, shape (n, 4, 4).
        distance: The distance [m].
    """
    counts = np.array([len(balls) for balls in parts], np.int64)
    if not len(pairs):
        return pairs
    first = np.cumsum(counts) - counts
    balls = placed_balls(np.concatenate(parts), np.repeat(bases, counts, axis=0))
    a, b = pairs.T
    ends = np.cumsum(counts[a] * counts[b])
    kept = []
    for chunk in np.split(np.arange(len(pairs)), np.searchsorted(ends, np.arange(_CHUNK, ends[-1], _CHUNK))):
        one, two = a[chunk], b[chunk]
        many = counts[one] * counts[two]
        owner = np.repeat(np.arange(len(chunk)), many)
        place = np.arange(len(owner)) - (np.cumsum(many) - many)[owner]
        i = first[one][owner] + place // counts[two][owner]
        j = first[two][owner] + place % counts[two][owner]
        gaps = np.linalg.norm(balls[i, :3] - balls[j, :3], axis=1) - balls[i, 3] - balls[j, 3]
        kept.append(chunk[np.unique(owner[gaps <= distance + 1e-9])])
    return np.asarray(pairs[np.concatenate(kept)])


def _above_base(geometry: ArmGeometry, arm: Arm) -> list[int]:
    """The solids of an arm that are not part of its base link."""
    return [
        i for i, solid in enumerate(geometry.solids) if i >= geometry.link_solids or solid.element != arm.robot.base
    ]


def _own_contacts(scene: Scene, name: str, geometry: ArmGeometry) -> Iterator[Contact]:
    """Contacts of one arm with itself; those in the base frame are shared by all arms with equal rules."""
    arm = scene.arms[name]
    rules = (*scene.allowed, *scene.pair_padding)
    if rules and any(both & {name, *geometry.elements(name)} for both in rules):
        yield from _contacts_between(scene, (name,), {name: geometry})
        return
    held = {n: thing for n, thing in scene.attachments.items() if thing.arm == name}
    kept: dict[tuple[Any, ...], tuple[Contact, ...]] = geometry.kept.setdefault("own contacts", {})
    # What a held object may touch is a rule, not a part of the geometry.
    key = (arm.q.tobytes(), scene.padding, *(thing.touch for thing in held.values()))

    def make() -> tuple[Contact, ...]:
        alone = Scene({name: Arm(arm.robot, identity(), arm.q)}, {}, held, padding=scene.padding)
        return tuple(
            Contact(_local(c.a, name), _local(c.b, name), c.depth, c.point)
            for c in _contacts_between(alone, (name,), {name: geometry})
        )

    R, t = arm.base[:3, :3], arm.base[:3, 3]
    for c in kept_in(kept, key, make, _MOST_KEPT):
        yield Contact(_in_arm(c.a, name), _in_arm(c.b, name), c.depth, read_only(R @ c.point + t))


def _local(element: str, arm: str) -> str:
    """The name of a link without the arm's name."""
    return element.removeprefix(arm) if "/" in element else element


def _in_arm(element: str, arm: str) -> str:
    return arm + element if element.startswith("/") else element


def _contacts_between(
    scene: Scene, owners: tuple[str, ...], geometries: Mapping[str, ArmGeometry]
) -> Iterator[Contact]:
    """Contacts between two arms, an arm and an obstacle, or the links of one arm."""
    arms = {name: scene.arms[name] for name in owners if name in scene.arms}
    obstacles = {name: scene.obstacles[name] for name in owners if name in scene.obstacles}
    standing = [stationary_arm_geometry(n, geometries[n], arm.base, arm.q) for n, arm in arms.items()]
    objects = ObstacleGeometry.joined([*standing, obstacle_geometry(obstacles)])
    elements = objects.elements
    near = _near_solids(objects, largest_padding(scene))
    named = [(elements[i], elements[j]) for i, j in near]
    checked = {(a, b): scene.padding_of(a, b) for a, b in dict.fromkeys(named) if a != b and not scene.may_touch(a, b)}
    chosen = [k for k, both in enumerate(named) if both in checked]
    if not chosen:
        return
    padding = np.array([checked[named[k]] for k in chosen])
    tables = build_fixed_tables(objects, near[chosen], padding)
    nothing = np.zeros(0)
    if tables is not None and ExactKernel(tables, 0).least_clearance(nothing, ROUNDING) >= ROUNDING:
        return  # the usual case; Coal's objects would take milliseconds
    coal = CoalPairs(None, objects.solids, near[chosen], padding)
    coal.place(nothing)
    deepest: dict[tuple[str, str], Contact] = {}
    for k in coal.touching():
        distance, a, b = coal.distance(k)
        both, depth = named[chosen[k]], max(0.0, float(padding[k]) - distance)
        if both not in deepest or depth > deepest[both].depth:
            deepest[both] = Contact(*both, depth, read_only(0.5 * (a + b)))
    yield from deepest.values()


def _near_solids(objects: ObstacleGeometry, distance: float) -> NDArray[np.int64]:
    """Pairs of solids of two objects, or of one with itself, whose balls are within a distance, shape (m, 2)."""
    balls, alone = balls_of(objects), len(objects.counts) == 1
    one, two = (balls, balls) if alone else np.split(balls, [objects.counts[0]])
    near = ball_gaps(one, two) <= distance
    if alone:
        return np.argwhere(np.triu(near, 1))
    return np.asarray(np.argwhere(near) + np.array([0, len(one)]))
