"""The convex solids of what the arms carry, made once for all scenes with the same arms."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, read_only
from rr1plan.collision.solids import is_concave, solid_pieces
from rr1plan.errors import InputError
from rr1plan.model import SceneModel
from rr1plan.shapes import HalfSpace, PointCloud, Shape
from rr1plan.skeleton import ElementGeometry, Skeleton

_INTS = NDArray[np.int64]
Pieces = Callable[[Shape], tuple[Shape, ...]]


@dataclass(frozen=True, eq=False)
class Solid:
    """One convex piece (or point cloud) of one element, carried by a joint of the model.

    Args:
        element: The element it is a part of.
        shape: A shape Coal takes as solid.
        joint: Index of the Pinocchio joint that carries it; 0 is the world.
        placement: T_joint_solid, shape (4, 4).
    """

    element: str
    shape: Shape
    joint: int
    placement: Array


@dataclass(frozen=True, eq=False)
class Carried:
    """The solids of all links and held objects; scenes that agree in these share one.

    Args:
        skeleton: The arms' skeleton.
        solids: Their solids; those of links come first.
        chains: Every set of joints that moves a solid, root first: those that a column of q drives. The first is empty.
        groups: Index of each solid's in `chains`, shape (n,).
        shared: How many joints two chains have in common, shape (len(chains), len(chains)).
        surfaceless: Which solids are half-spaces or point clouds.
    """

    skeleton: Skeleton
    solids: tuple[Solid, ...]
    chains: tuple[tuple[int, ...], ...]
    groups: _INTS
    shared: _INTS
    surfaceless: tuple[bool, ...]


@dataclass(frozen=True)
class _Content:
    """All that carried solids depend on, to compare; and what to make them from."""

    skeleton: Skeleton
    held: tuple[tuple[str, Shape, int, bytes], ...]
    geometries: tuple[ElementGeometry, ...] = field(compare=False)


def carried_by(model: SceneModel) -> Carried:
    """The carried solids of a scene; scenes with equal arms that hold equal objects get the same."""
    attached = model.scene.attachments.items()
    held = tuple(g for name, thing in attached for g in model.geometries_of(name, thing.geometries))
    key = tuple((g.element, g.geometry.shape, g.joint, g.placement.tobytes()) for g in held)
    return _carried(_Content(model.skeleton, key, held))


@lru_cache(maxsize=64)
def _carried(content: _Content) -> Carried:
    skeleton = content.skeleton
    solids = tuple(solids_of((*skeleton.link_geometries, *content.geometries)))
    above: list[tuple[int, ...]] = [()]
    for joint in range(1, len(skeleton.model.parents)):
        driven = skeleton.columns[joint - 1] >= 0 and skeleton.gains[joint - 1] != 0.0
        above.append(above[skeleton.model.parents[joint]] + ((joint,) if driven else ()))
    number = {chain: i for i, chain in enumerate(dict.fromkeys([(), *(above[s.joint] for s in solids)]))}
    groups = np.array([number[above[s.joint]] for s in solids], dtype=np.int64)
    sets = [frozenset(chain) for chain in number]
    # Two chains run together from the root until they part.
    shared = np.array([[len(a & b) for b in sets] for a in sets], dtype=np.int64)
    return Carried(skeleton, solids, tuple(number), read_only(groups), read_only(shared), surfaceless(solids))


def solids_of(geometries: Iterable[ElementGeometry], pieces: Pieces = solid_pieces) -> list[Solid]:
    """Shapes of elements as solids: convex ones, unless `pieces` makes others.

    Raises:
        InputError: a shape that cannot be made solid.
    """
    return [Solid(g.element, piece, g.joint, g.placement) for g in geometries for piece in _pieces(g, pieces)]


def _pieces(geometry: ElementGeometry, pieces: Pieces) -> tuple[Shape, ...]:
    """The solids of a shape; what is wrong with it is told with the name of its element."""
    try:
        return pieces(geometry.geometry.shape)
    except InputError as error:
        raise InputError(f"shape of {geometry.element!r}: {error}") from error


def surfaceless(solids: Iterable[Solid]) -> tuple[bool, ...]:
    """Which solids are half-spaces, point clouds or concave meshes: distances are measured to them, not from them."""
    return tuple(
        isinstance(solid.shape, HalfSpace | PointCloud) or is_concave(solid.shape) for solid in solids
    )
