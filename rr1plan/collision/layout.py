"""The convex solids of a scene, and which pairs of them are checked.

What the arms carry is made once for all scenes with the same arms; of a scene with another obstacle only the
obstacles are new. A layout knows no padding, so scenes that differ in that alone share one.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, read_only
from rr1plan.collision.solids import solid_pieces
from rr1plan.errors import InputError
from rr1plan.model import ElementGeometry, SceneModel, Skeleton
from rr1plan.scene import Scene
from rr1plan.shapes import HalfSpace, PointCloud, Shape

_INTS = NDArray[np.int64]


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
    """

    skeleton: Skeleton
    solids: tuple[Solid, ...]
    chains: tuple[tuple[int, ...], ...]
    groups: _INTS
    shared: _INTS


class Layout:
    """The solids of a scene and the pairs of them that must not touch.

    Args:
        model: The scene's model.

    Attributes:
        carried: Solids of links and held objects.
        standing: Solids of obstacles.
        solids: Both, in this order.
        moving: Pairs of solids [index] whose relative pose depends on q, shape (m, 2).
        moving_owner: For each of those the index in `scene.checked_pairs`, shape (m,).
        moving_shared: How many driven joints move both, shape (m,).
        resting, resting_owner: The same of pairs that do not move against each other.
    """

    def __init__(self, model: SceneModel) -> None:
        scene = model.scene
        self.carried = carried_by(model)
        obstacles = (model.geometries_of(name, thing.geometries) for name, thing in scene.obstacles.items())
        self.standing = tuple(solid for geometries in obstacles for solid in _solids(geometries))
        self.solids = self.carried.solids + self.standing
        index, owner = _solid_pairs(scene, self.solids)
        groups = np.concatenate([self.carried.groups, np.zeros(len(self.standing), np.int64)])
        one, two = groups[index].T
        moves = one != two
        self.moving, self.moving_owner = read_only(index[moves]), read_only(owner[moves])
        self.moving_shared = self.carried.shared[one[moves], two[moves]]
        self.resting, self.resting_owner = index[~moves], owner[~moves]

    @cached_property
    def surfaceless(self) -> NDArray[np.bool_]:
        """Which solids are half-spaces or point clouds, shape (n,)."""
        return np.array([isinstance(s.shape, HalfSpace | PointCloud) for s in self.solids], dtype=np.bool_)

    def oriented(self, pairs: _INTS) -> _INTS:
        """Pairs of solids with the half-space or point cloud second, shape (m, 2)."""
        return np.where(self.surfaceless[pairs[:, 0]][:, None], pairs[:, ::-1], pairs)

    def check_kinds(self) -> None:
        """Refuse moving pairs of which neither has a surface to measure from.

        Raises:
            InputError: a half-space or a point cloud that would be checked against another one.
        """
        both = self.surfaceless[self.moving].all(axis=1)
        if both.any():
            one, two = (self.solids[i].element for i in self.moving[int(both.argmax())])
            raise InputError(f"{one!r} and {two!r} are half-spaces or point clouds; they cannot be checked")


def layout_of(model: SceneModel) -> Layout:
    """The layout of a scene and its moving arms, which is kept with the scene."""
    kept = model.scene.kept_for_any_padding
    found = kept.get(("layout", model.arms))
    if not isinstance(found, Layout):
        found = kept["layout", model.arms] = Layout(model)
    return found


# ---- what is carried -------------------------------------------------------------------------------


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
    solids = tuple(_solids((*skeleton.link_geometries, *content.geometries)))
    above: list[tuple[int, ...]] = [()]
    for joint in range(1, len(skeleton.model.parents)):
        driven = skeleton.columns[joint - 1] >= 0 and skeleton.gains[joint - 1] != 0.0
        above.append(above[skeleton.model.parents[joint]] + ((joint,) if driven else ()))
    number = {chain: i for i, chain in enumerate(dict.fromkeys([(), *(above[s.joint] for s in solids)]))}
    groups = np.array([number[above[s.joint]] for s in solids], dtype=np.int64)
    sets = [frozenset(chain) for chain in number]
    # Two chains run together from the root until they part.
    shared = np.array([[len(a & b) for b in sets] for a in sets], dtype=np.int64)
    return Carried(skeleton, solids, tuple(number), read_only(groups), read_only(shared))


def _solids(geometries: Iterable[ElementGeometry]) -> list[Solid]:
    return [
        Solid(g.element, piece, g.joint, g.placement) for g in geometries for piece in solid_pieces(g.geometry.shape)
    ]


# ---- pairs -----------------------------------------------------------------------------------------


def _solid_pairs(scene: Scene, solids: tuple[Solid, ...]) -> tuple[_INTS, _INTS]:
    """Pairs of solids (m, 2) and the pair of elements each belongs to (m,); an element's solids are neighbours."""
    number = {name: i for i, name in enumerate(scene.element_names)}
    elements = np.array([number[s.element] for s in solids], dtype=np.int64)
    count = np.bincount(elements, minlength=len(number))
    first = np.zeros(len(number), np.int64)
    first[elements[::-1]] = np.arange(len(solids))[::-1]
    a, b = scene.checked_index.T
    many = count[a] * count[b]
    owner = np.repeat(np.arange(len(a)), many)
    place = np.arange(len(owner)) - (np.cumsum(many) - many)[owner]
    a, b = a[owner], b[owner]
    return np.column_stack([first[a] + place // count[b], first[b] + place % count[b]]), owner
