"""The convex solids of one obstacle: scenes that have it at the same place share them, and all tables made of them."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

from rr1plan.checks import read_only
from rr1plan.collision.carried import Solid, solids_of, surfaceless
from rr1plan.collision.solids import obstacle_pieces
from rr1plan.scene import Obstacle
from rr1plan.shapes import Shape
from rr1plan.skeleton import ElementGeometry


@dataclass(frozen=True, eq=False)
class Standing:
    """An obstacle's solids.

    Args:
        solids: Its solids; their joint is the world.
        surfaceless: Which of them are half-spaces or point clouds.
        kept: What others have made of them and may use again.
    """

    solids: tuple[Solid, ...]
    surfaceless: tuple[bool, ...]
    kept: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class _Content:
    """All that the solids of an obstacle depend on, to compare; and what to make them from."""

    name: str
    pose: bytes
    shapes: tuple[tuple[Shape, bytes], ...]
    obstacle: Obstacle = field(compare=False)


def standing_of(name: str, obstacle: Obstacle) -> Standing:
    """The solids of an obstacle; one that is equal gets the same.

    Raises:
        InputError: a shape that cannot be made solid.
    """
    shapes = tuple((g.shape, g.pose.tobytes()) for g in obstacle.geometries)
    return _standing(_Content(name, obstacle.pose.tobytes(), shapes, obstacle))


@lru_cache(maxsize=1024)
def _standing(content: _Content) -> Standing:
    pose = content.obstacle.pose
    placed = (ElementGeometry(content.name, g, 0, read_only(pose @ g.pose)) for g in content.obstacle.geometries)
    solids = tuple(solids_of(placed, obstacle_pieces))
    return Standing(solids, surfaceless(solids))
