"""Spheres that contain links and held objects, for display and for other programs.

There are three levels: one sphere around the whole element, one around each of its convex bodies, and a few tight ones
that fill each body. At every level, all spheres together contain the whole element. The compiled search uses the two
finer levels.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, Value, read_only, whole_number
from rr1plan.collision.convex.bounding_spheres import SphereCover, cover
from rr1plan.collision.convex.convex_bodies import solid_pieces
from rr1plan.collision.convex.enclosing_ball import ball_reach, enclosing_ball
from rr1plan.errors import InputError
from rr1plan.robot import Geometry, Robot
from rr1plan.scene import Scene

WHOLE, BODIES, PARTS = 0, 1, 2
# Rounding error of a moved sphere, relative to its distance from the origin.
_ROUNDING = 1e-14


@dataclass(frozen=True, eq=False, repr=False)
class ElementCover(Value):
    """Spheres that contain a link or a held object, in its coordinates, coarse to fine.

    An element without collision geometry has none.

    Args:
        centers: Centers [m], shape (n, 3).
        radii: Radii [m], shape (n,).
        levels: 0 for the sphere around the whole, 1 for those around its convex bodies, 2 for those that fill them,
            ascending, shape (n,).
    """

    centers: Array
    radii: Array
    levels: NDArray[np.int64]

    def at(self, level: int) -> tuple[Array, Array]:
        """Centers [m], shape (m, 3), and radii [m], shape (m,), of a level.

        Raises:
            InputError: a level other than 0, 1 and 2.
        """
        whole_number("level (0: around the whole, 1: around its bodies, 2: parts)", level, WHOLE, PARTS)
        chosen = self.levels == level
        return self.centers[chosen], self.radii[chosen]


def cover_with_spheres(thing: Robot | Scene) -> dict[str, ElementCover]:
    """Spheres that provably contain the collision geometry of everything that moves.

    Args:
        thing: A robot, or a scene with its arms and the objects they hold. Obstacles are checked as they are.

    Returns:
        For a robot, each link's spheres in the link's coordinates. For a scene, those of each "arm/link" in the link's
        coordinates, and of each held object in the object's.

    Raises:
        InputError: neither a robot nor a scene, or a shape that an arm cannot carry.
        BackendError: a mesh could not be cut into convex pieces.
    """
    if isinstance(thing, Robot):
        return {link.name: cover_geometries(link.name, link.collisions) for link in thing.links}
    if not isinstance(thing, Scene):
        raise InputError(f"no spheres around a {type(thing).__name__}, expected a Robot or a Scene")
    robots = {id(arm.robot): arm.robot for arm in thing.arms.values()}
    covers = {key: cover_with_spheres(robot) for key, robot in robots.items()}
    links = {f"{name}/{link}": c for name, arm in thing.arms.items() for link, c in covers[id(arm.robot)].items()}
    return links | {name: cover_geometries(name, held.geometries) for name, held in thing.attachments.items()}


def cover_geometries(name: str, geometries: Iterable[Geometry]) -> ElementCover:
    """Spheres that contain the placed shapes of one rigid element, whose name is used in messages.

    Raises:
        InputError: a half-space, a point cloud, or a mesh without volume.
        BackendError: a mesh could not be cut into convex pieces.
    """
    try:
        placed = [_placed(cover(piece), g.pose) for g in geometries for piece in solid_pieces(g.shape)]
    except InputError as error:
        raise InputError(f"no spheres around {name!r}: {error}") from error
    if not placed:
        return ElementCover(read_only(np.zeros((0, 3))), read_only(np.zeros(0)), read_only(np.zeros(0, np.int64)))
    balls, parts = np.array([ball for ball, _ in placed]), np.concatenate([rows for _, rows in placed])
    spheres = np.concatenate([_around(placed)[None], balls, parts])
    levels = np.repeat([WHOLE, BODIES, PARTS], [1, len(balls), len(parts)]).astype(np.int64)
    return ElementCover(read_only(spheres[:, :3].copy()), read_only(spheres[:, 3].copy()), read_only(levels))


def _placed(made: SphereCover, T: Array) -> tuple[Array, Array]:
    """The ball around a body, shape (4,), and its spheres, shape (n, 4), moved by a pose."""
    rows = np.concatenate([made.ball[None], np.column_stack([made.centers, made.radii])])
    centers = rows[:, :3] @ T[:3, :3].T + T[:3, 3]
    far = np.linalg.norm(rows[:, :3], axis=1) + np.linalg.norm(T[:3, 3])
    moved = np.column_stack([centers, rows[:, 3] + _ROUNDING * far])
    return moved[0], moved[1:]


def _around(placed: list[tuple[Array, Array]]) -> Array:
    """A sphere around all bodies, not much larger than the smallest one, shape (4,).

    It contains each body's ball or all of its spheres, whichever needs the smaller radius.
    """
    parts = np.concatenate([rows for _, rows in placed])
    candidates = [enclosing_ball(parts)[:3], *(ball[:3] for ball, _ in placed)]
    radii = [
        max(min(ball_reach(ball[None], c).max(), ball_reach(rows, c).max()) for ball, rows in placed)
        for c in candidates
    ]
    best = int(np.argmin(radii))
    return np.array([*candidates[best], radii[best] * (1.0 + _ROUNDING)])
