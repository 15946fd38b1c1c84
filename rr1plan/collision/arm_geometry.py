"""The convex bodies of arms and the objects they hold: of one arm in its base frame, and of the moving arms of a scene.

Arms with the same bodies share them; a scene has instances, each with its own base pose and columns of q.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, read_only
from rr1plan.collision.convex.convex_bodies import is_surfaceless, solid_pieces
from rr1plan.errors import InputError
from rr1plan.model.arm_model import ArmModel, Body, ElementGeometry, arm_model_of, hang
from rr1plan.robot import Robot
from rr1plan.scene import Arm, Attachment, Scene
from rr1plan.shapes import Shape

_INTS = NDArray[np.int64]
Pieces = Callable[[Shape], tuple[Shape, ...]]
# The name of the single arm in the scene from which a robot's model is made.
_ARM = "arm"
_PREFIX = f"{_ARM}/"


@dataclass(frozen=True, eq=False)
class Solid:
    """One convex piece (or point cloud, or concave mesh) of one element, carried by a joint of the model.

    Args:
        element: The element that it is a part of.
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
        robot: The robot, or one with equal content.
        arm_model: The arm alone, its base at the origin.
        solids: Its solids, those of links first; their elements are names of links and of held objects.
        link_solids: Number of solids that belong to links.
        chains: Every set of driven joints that moves a solid, root first; the first one is empty.
        groups: Index in `chains` of each solid's chain, shape (n,).
        shared: Number of joints that two chains have in common, shape (len(chains), len(chains)).
        surfaceless: Which solids are half-spaces or point clouds.
        kept: Tables derived from it.
    """

    robot: Robot
    arm_model: ArmModel
    solids: tuple[Solid, ...]
    link_solids: int
    chains: tuple[tuple[int, ...], ...]
    groups: _INTS
    shared: _INTS
    surfaceless: tuple[bool, ...]
    kept: dict[str, Any] = field(default_factory=dict)

    def elements(self, arm: str) -> list[str]:
        """The element of each solid in a scene in which the arm has this name."""
        names = [solid.element for solid in self.solids]
        return [f"{arm}/{link}" for link in names[: self.link_solids]] + names[self.link_solids :]


@dataclass(frozen=True)
class _Content:
    """The inputs of an arm's geometry, compared by content."""

    robot: str
    held: tuple[tuple[str, str, bytes, tuple[tuple[Shape, bytes], ...]], ...]
    arm: Arm = field(compare=False)
    attachments: Mapping[str, Attachment] = field(compare=False)


def arm_geometry(arm: Arm, attachments: Mapping[str, Attachment]) -> ArmGeometry:
    """The geometry of an arm and the objects it holds; arms with equal robots and objects share it.

    Args:
        arm: The arm.
        attachments: The objects it holds.

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
    # Two chains coincide from the root until they part.
    shared = np.array([[len(a & b) for b in sets] for a in sets], dtype=np.int64)
    kinds = tuple(is_surfaceless(solid.shape) for solid in solids)
    chains, groups = tuple(number), read_only(groups)
    return ArmGeometry(content.arm.robot, arm_model, solids, len(links), chains, groups, read_only(shared), kinds)


def _held(arm_model: ArmModel, name: str, thing: Attachment) -> tuple[ElementGeometry, ...]:
    link = arm_model.bodies[_PREFIX + thing.link]
    return hang(name, Body(link.joint, read_only(link.placement @ thing.pose)), thing.geometries)


def solids_of(geometries: Iterable[ElementGeometry]) -> list[Solid]:
    """Shapes of elements as solids: their convex pieces.

    Raises:
        InputError: a shape that cannot be made solid.
    """
    return [
        Solid(g.element, piece, g.joint, g.placement)
        for g in geometries
        for piece in pieces_of(g.element, g.geometry.shape, solid_pieces)
    ]


def pieces_of(element: str, shape: Shape, pieces: Pieces) -> tuple[Shape, ...]:
    """The solids of a shape; error messages name its element."""
    try:
        return pieces(shape)
    except InputError as error:
        raise InputError(f"shape of {element!r}: {error}") from error


# ---- the arms that move in a scene -----------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class ArmInstances:
    """Arm geometries placed in the world; solids, joints and columns of q are numbered arm after arm.

    Args:
        geometries: The geometry of each arm; arms with equal robots and held objects share one.
        bases: T_world_base of each, shape (arms, 4, 4).
        first_joint: Number of joints before the first one of each arm; joint 0 is the world, shape (arms,).
        first_column: First column of q of each arm, shape (arms,).
        chains: Every set of joints that moves a solid, root first; the first one is empty.
        groups: Index in `chains` of each solid's chain, shape (n,).
        surfaceless: Which solids are half-spaces or point clouds.
        kept: Tables derived from them.
        unplaced: Tables independent of the bases, shared by all instances of these geometries.
    """

    geometries: tuple[ArmGeometry, ...]
    bases: Array
    first_joint: _INTS
    first_column: _INTS
    chains: tuple[tuple[int, ...], ...]
    groups: _INTS
    surfaceless: tuple[bool, ...]
    unplaced: dict[str, Any]
    kept: dict[str, Any] = field(default_factory=dict)

    def solids(self, arms: Sequence[str]) -> tuple[Solid, ...]:
        """The solids for Coal, in arms with these names."""
        return tuple(
            _placed(solid, element, base, first)
            for geometry, arm, base, first in zip(
                self.geometries, arms, self.bases, self.first_joint.tolist(), strict=True
            )
            for solid, element in zip(geometry.solids, geometry.elements(arm), strict=True)
        )


@lru_cache(maxsize=256)
def arm_instances(geometries: tuple[ArmGeometry, ...], bases: tuple[bytes, ...]) -> ArmInstances:
    """Geometries placed in the world; equal ones at equal poses are made once.

    Args:
        geometries: The geometry of each arm.
        bases: T_world_base of each as bytes, (4, 4).
    """
    placed = np.frombuffer(b"".join(bases)).reshape(-1, 4, 4)  # read-only, like the bytes
    return replace(_at_origin(geometries), bases=placed, kept={})


@lru_cache(maxsize=64)
def _at_origin(geometries: tuple[ArmGeometry, ...]) -> ArmInstances:
    """Instances with all bases at the origin."""
    joints = _first([len(g.arm_model.model.parents) - 1 for g in geometries])
    columns = _first([len(g.arm_model.joint_names) for g in geometries])
    groups, chains = [np.zeros(0, np.int64)], [()]
    for geometry, first in zip(geometries, joints.tolist(), strict=True):
        before = len(chains) - 1
        groups.append(np.where(geometry.groups > 0, geometry.groups + before, 0))
        chains += [tuple(joint + first for joint in chain) for chain in geometry.chains[1:]]
    return ArmInstances(
        geometries,
        read_only(np.tile(np.eye(4), (len(geometries), 1, 1))),
        read_only(joints),
        read_only(columns),
        tuple(chains),
        read_only(np.concatenate(groups)),
        tuple(kind for geometry in geometries for kind in geometry.surfaceless),
        {},
    )


def _first(counts: Sequence[int]) -> _INTS:
    """The number of items before each part."""
    return np.cumsum([0, *counts], dtype=np.int64)[:-1]


def _placed(solid: Solid, element: str, base: Array, first: int) -> Solid:
    if solid.joint:
        return Solid(element, solid.shape, solid.joint + first, solid.placement)
    return Solid(element, solid.shape, 0, read_only(base @ solid.placement))
