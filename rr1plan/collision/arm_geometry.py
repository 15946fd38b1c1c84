"""The convex bodies of an arm and what it holds, in the frame of its base; every arm with the same ones shares them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, read_only
from rr1plan.collision.convex.convex_bodies import is_surfaceless, solid_pieces
from rr1plan.errors import InputError
from rr1plan.model.arm_model import ArmModel, Body, ElementGeometry, arm_model_of, hang
from rr1plan.scene import Arm, Attachment, Scene
from rr1plan.shapes import Shape

_INTS = NDArray[np.int64]
Pieces = Callable[[Shape], tuple[Shape, ...]]
# The name of the only arm of the scene that a robot's model is made from.
_ARM = "arm"
_PREFIX = f"{_ARM}/"


@dataclass(frozen=True, eq=False)
class Solid:
    """One convex piece (or point cloud, or concave mesh) of one element, carried by a joint of the model.

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
class ArmGeometry:
    """The solids of an arm's links and held objects.

    Args:
        arm_model: The arm alone, its base at the origin.
        solids: Its solids, those of links first; their elements are names of links and of held objects.
        link_solids: How many of them are of links.
        chains: Every set of joints that moves a solid, root first: those that a column of q drives. The first is empty.
        groups: Index of each solid's in `chains`, shape (n,).
        shared: How many joints two chains have in common, shape (len(chains), len(chains)).
        surfaceless: Which solids are half-spaces or point clouds.
        kept: Tables that were made of it.
    """

    arm_model: ArmModel
    solids: tuple[Solid, ...]
    link_solids: int
    chains: tuple[tuple[int, ...], ...]
    groups: _INTS
    shared: _INTS
    surfaceless: tuple[bool, ...]
    kept: dict[str, Any] = field(default_factory=dict)

    def elements(self, arm: str) -> list[str]:
        """The element of each solid in a scene in which the arm has that name."""
        names = [solid.element for solid in self.solids]
        return [f"{arm}/{link}" for link in names[: self.link_solids]] + names[self.link_solids :]


@dataclass(frozen=True)
class _Content:
    """The inputs of an arm's geometry, and the part of them that decides whether two are equal."""

    robot: str
    held: tuple[tuple[str, str, bytes, tuple[tuple[Shape, bytes], ...]], ...]
    arm: Arm = field(compare=False)
    attachments: Mapping[str, Attachment] = field(compare=False)


def arm_geometry(arm: Arm, attachments: Mapping[str, Attachment]) -> ArmGeometry:
    """The geometry of an arm that holds some objects; arms with equal robots and objects share it.

    Args:
        arm: The arm.
        attachments: What it holds.

    Raises:
        InputError: a shape that cannot be made solid.
    """
    held = tuple(
        (name, thing.link, thing.pose.tobytes(), tuple((g.shape, g.pose.tobytes()) for g in thing.geometries))
        for name, thing in attachments.items()
    )
    return _arm_geometry(_Content(arm.robot.content_hash, held, arm, attachments))


@lru_cache(maxsize=128)
def _arm_geometry(content: _Content) -> ArmGeometry:
    # The robot alone, its base at the origin and its planning joints free.
    arm_model = arm_model_of(Scene({_ARM: Arm(content.arm.robot)}), (_ARM,))
    links = solids_of(replace(g, element=g.element[len(_PREFIX) :]) for g in arm_model.link_geometries)
    held = solids_of(g for name, thing in content.attachments.items() for g in _held(arm_model, name, thing))
    solids = (*links, *held)
    above: list[tuple[int, ...]] = [()]
    for joint in range(1, len(arm_model.model.parents)):
        driven = arm_model.columns[joint - 1] >= 0 and arm_model.gains[joint - 1] != 0.0
        above.append(above[arm_model.model.parents[joint]] + ((joint,) if driven else ()))
    number = {chain: i for i, chain in enumerate(dict.fromkeys([(), *(above[s.joint] for s in solids)]))}
    groups = np.array([number[above[s.joint]] for s in solids], dtype=np.int64)
    sets = [frozenset(chain) for chain in number]
    # Two chains run together from the root until they part.
    shared = np.array([[len(a & b) for b in sets] for a in sets], dtype=np.int64)
    kinds = tuple(is_surfaceless(solid.shape) for solid in solids)
    return ArmGeometry(arm_model, solids, len(links), tuple(number), read_only(groups), read_only(shared), kinds)


def _held(arm_model: ArmModel, name: str, thing: Attachment) -> tuple[ElementGeometry, ...]:
    link = arm_model.bodies[_PREFIX + thing.link]
    return hang(name, Body(link.joint, read_only(link.placement @ thing.pose)), thing.geometries)


def solids_of(geometries: Iterable[ElementGeometry], pieces: Pieces = solid_pieces) -> list[Solid]:
    """Shapes of elements as solids: convex ones, unless `pieces` makes others.

    Raises:
        InputError: a shape that cannot be made solid.
    """
    return [
        Solid(g.element, piece, g.joint, g.placement)
        for g in geometries
        for piece in pieces_of(g.element, g.geometry.shape, pieces)
    ]


def pieces_of(element: str, shape: Shape, pieces: Pieces) -> tuple[Shape, ...]:
    """The solids of a shape; errors name its element."""
    try:
        return pieces(shape)
    except InputError as error:
        raise InputError(f"shape of {element!r}: {error}") from error
