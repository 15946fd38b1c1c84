"""The arms that move in a scene: instances of arm geometries, each at its base and with its columns of q."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, read_only
from rr1plan.collision.arm_geometry import ArmGeometry, Solid

_INTS = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ArmInstances:
    """Arm geometries placed in the world; solids, joints and columns of q are numbered arm after arm.

    Args:
        geometries: The geometry of each arm; arms with equal robots and held objects have the same.
        bases: T_world_base of each, shape (arms, 4, 4).
        first_joint: For each arm how many joints come before its first; joint 0 is the world, shape (arms,).
        first_column: For each arm its first column of q, shape (arms,).
        chains: Every set of joints that moves a solid, root first. The first is empty.
        groups: Index of each solid's in `chains`, shape (n,).
        shared: How many joints two chains have in common, shape (len(chains), len(chains)).
        surfaceless: Which solids are half-spaces or point clouds.
        kept: Tables that were made of them.
        unplaced: Tables independent of the bases, shared by all instances of these geometries.
    """

    geometries: tuple[ArmGeometry, ...]
    bases: Array
    first_joint: _INTS
    first_column: _INTS
    chains: tuple[tuple[int, ...], ...]
    groups: _INTS
    shared: _INTS
    surfaceless: tuple[bool, ...]
    unplaced: dict[str, Any]
    kept: dict[str, Any] = field(default_factory=dict)

    def solids(self, arms: Sequence[str]) -> tuple[Solid, ...]:
        """The solids as Coal takes them, in arms of these names."""
        return tuple(
            _placed(solid, element, base, first)
            for geometry, arm, base, first in zip(
                self.geometries, arms, self.bases, self.first_joint.tolist(), strict=True
            )
            for solid, element in zip(geometry.solids, geometry.elements(arm), strict=True)
        )


def arm_instances(geometries: Sequence[ArmGeometry], bases: Sequence[Array]) -> ArmInstances:
    """Geometries placed in the world; equal ones at equal places are made once.

    Args:
        geometries: The geometry of each arm.
        bases: T_world_base of each, (4, 4).
    """
    return _arm_instances(_Content(tuple(geometries), tuple(base.tobytes() for base in bases)))


@dataclass(frozen=True)
class _Content:
    geometries: tuple[ArmGeometry, ...]
    bases: tuple[bytes, ...]


@lru_cache(maxsize=64)
def _arm_instances(content: _Content) -> ArmInstances:
    bases = np.frombuffer(b"".join(content.bases)).reshape(-1, 4, 4)  # read-only, as bytes are
    return replace(_at_origin(content.geometries), bases=bases, kept={})


@lru_cache(maxsize=64)
def _at_origin(geometries: tuple[ArmGeometry, ...]) -> ArmInstances:
    """Instances of which all bases are at the origin."""
    joints = _first([len(g.arm_model.model.parents) - 1 for g in geometries])
    columns = _first([len(g.arm_model.joint_names) for g in geometries])
    groups, chains = [np.zeros(0, np.int64)], [()]
    shared = np.zeros((1 + sum(len(g.chains) - 1 for g in geometries),) * 2, np.int64)
    for geometry, first in zip(geometries, joints.tolist(), strict=True):
        before = len(chains) - 1
        groups.append(np.where(geometry.groups > 0, geometry.groups + before, 0))
        chains += [tuple(joint + first for joint in chain) for chain in geometry.chains[1:]]
        shared[before + 1 : len(chains), before + 1 : len(chains)] = geometry.shared[1:, 1:]
    return ArmInstances(
        geometries,
        read_only(np.tile(np.eye(4), (len(geometries), 1, 1))),
        read_only(joints),
        read_only(columns),
        tuple(chains),
        read_only(np.concatenate(groups)),
        read_only(shared),
        tuple(kind for geometry in geometries for kind in geometry.surfaceless),
        {},
    )


def _first(counts: Sequence[int]) -> _INTS:
    """The number of items before each."""
    return np.cumsum([0, *counts], dtype=np.int64)[:-1]


def _placed(solid: Solid, element: str, base: Array, first: int) -> Solid:
    if solid.joint:
        return Solid(element, solid.shape, solid.joint + first, solid.placement)
    return Solid(element, solid.shape, 0, read_only(base @ solid.placement))
