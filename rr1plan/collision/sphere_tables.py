"""The tables of the certified edge: bodies that move, what they can touch, and the pairs to check."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, read_only
from rr1plan.collision.clearance_maps import instance_maps
from rr1plan.collision.coal_checker import CoalChecker
from rr1plan.collision.collision_geometry import CollisionGeometry
from rr1plan.collision.edge_kernel import arm_struct, padded_struct
from rr1plan.collision.groups import families_of
from rr1plan.collision.kernel_tables import EdgeTables, ExactTables, PaddedPairs
from rr1plan.collision.link_spheres import instance_spheres
from rr1plan.collision.obstacle_tables import LANES, link_cores
from rr1plan.kept import kept_in
from rr1plan.kernels.library import CStruct, load_library

_INTS = NDArray[np.int64]


def build_edge_tables(checker: CoalChecker, tables: ExactTables, tolerance: float) -> EdgeTables:
    """What the certified edge reads, for the pairs of a checker and its tables for the exact kernel.

    Args:
        checker: The checker.
        tables: Its tables for the exact kernel.
        tolerance: Gaps beyond the padding smaller than this are no proof [m].
    """
    geometry = checker.geometry
    spheres, pairs = instance_spheres(geometry.instances), _kernel_pairs(geometry)
    kinds, values, boxes = checker.fixed.placed_shapes(pairs.places, pairs.pair_of.shape[1])
    carried, links = link_cores(geometry.instances, spheres.cores)
    checker.fixed.solids[: len(links), 3] = links
    cores, core_of = checker.fixed.placed_cores(carried, pairs.places, pairs.pair_of.shape[1])
    bare = 2.0 * tolerance + 1e-9 + 1e-12 * float(np.abs(spheres.joint_values[:, 9:12]).sum())
    rest = bare + float(load_library().rr1_obstacle_rounding(values, len(values)))
    padded = padded_pairs(geometry, tables.padding, tolerance, rest)
    return EdgeTables(
        spheres.joints, spheres.joint_values, spheres.bodies, spheres.groups, spheres.spheres,
        spheres.chain, spheres.chain_reach,
        kinds, values, boxes,
        pairs.pair_of, pairs.obstacle_blocks, pairs.first_block,
        padded.body_pairs, padded.group_pairs, padded.maps, padded.map_ranges,
        tables.padding, *cores, core_of, np.array([rest, padded.greatest, bare]),
    )  # fmt: skip


def shared_structs(geometry: CollisionGeometry, tables: EdgeTables, tolerance: float) -> dict[str, CStruct]:
    """What other scenes share of the structs made of tables, see `scene_struct`: each is made once.

    Args:
        geometry: What the tables are of.
        tables: The tables.
        tolerance: As they were made with [m].
    """
    shared = {"pairs": padded_struct(padded_pairs(geometry, tables.padding, tolerance, float(tables.margins[0])))}
    instances = geometry.instances
    if tables.cores is link_cores(instances, instance_spheres(instances).cores)[0].rows:  # no obstacle has a core
        shared["arm"] = kept_in(instances.kept, "struct", lambda: arm_struct(tables))
    return shared


# ---- pairs -----------------------------------------------------------------------------------------

# Paddings for which pairs are kept.
_MOST_PADDINGS = 8


def padded_pairs(geometry: CollisionGeometry, padding: Array, tolerance: float, rest: float) -> PaddedPairs:
    """The pairs of a geometry with clearance maps for a padding.

    Args:
        geometry: The geometry.
        padding: Distance to keep of each of its pairs that move [m], shape (m,).
        tolerance: Gaps beyond the padding smaller than this are no proof [m].
        rest: What must be left of a gap for a proof [m].
    """
    # Rounded up, so that maps serve scenes of other sizes too.
    rest = max(10.0 * tolerance, rest)
    kept: dict[tuple[bytes, float], PaddedPairs] = geometry.pairs.kept.setdefault("padded", {})
    key = (padding.tobytes(), rest)
    return kept_in(kept, key, lambda: _new_padded_pairs(geometry, padding, rest), _MOST_PADDINGS)


def _new_padded_pairs(geometry: CollisionGeometry, padding: Array, rest: float) -> PaddedPairs:
    pairs = _kernel_pairs(geometry)
    least = padding[pairs.body_pairs[:, 3]] + rest
    maps = instance_maps(geometry.instances, pairs.solids, least, pairs.group_pairs)
    return PaddedPairs(
        pairs.pair_of,
        pairs.obstacle_blocks,
        pairs.first_block,
        read_only(np.column_stack([pairs.body_pairs, maps.places])),
        read_only(np.column_stack([pairs.group_pairs, maps.groups])),
        maps.counts,
        maps.ranges,
        float(np.max(padding, initial=0.0)),
        {},
    )


@dataclass(frozen=True, eq=False)
class _KernelPairs:
    """Which bodies and obstacles must not touch; columns as in `EdgeTables`.

    Args:
        body_pairs, group_pairs: Their first columns there.
        solids: The solids of `body_pairs`, shape (m, 2).
        pair_of, obstacle_blocks, first_block: As there.
        places: Of each link that does not move, then of each solid of the obstacles, its column in `pair_of`; -1 where
            nothing that moves must not touch it.
    """

    body_pairs: _INTS
    group_pairs: _INTS
    solids: _INTS
    pair_of: _INTS
    obstacle_blocks: _INTS
    first_block: _INTS
    places: _INTS


def _kernel_pairs(geometry: CollisionGeometry) -> _KernelPairs:
    """The pairs of a geometry as the kernel reads them; they are kept with its pairs of solids."""
    return kept_in(geometry.pairs.kept, "kernel", lambda: _new_kernel_pairs(geometry))


def _new_kernel_pairs(geometry: CollisionGeometry) -> _KernelPairs:
    spheres, pairs = instance_spheres(geometry.instances), geometry.pairs
    bodies = spheres.body
    body = np.concatenate([bodies, np.full(len(pairs.surfaceless) - len(bodies), -1, np.int64)])
    one, two = pairs.moving.T
    number = np.arange(len(one))
    both_move = (body[one] >= 0) & (body[two] >= 0)
    rows = np.column_stack([body[one], body[two], pairs.moving_rows[:, 2], number])[both_move]
    rows, group_pairs = families_of(rows, spheres.bodies[:, 3])
    one, two, number = one[~both_move], two[~both_move], number[~both_move]
    moving, still = np.where(body[one] >= 0, one, two), np.where(body[one] >= 0, two, one)
    fixed = np.flatnonzero(body < 0)
    chosen, place = np.unique(np.searchsorted(fixed, still), return_inverse=True)
    more = -len(chosen) % LANES
    pair_of = np.full((int(np.count_nonzero(bodies >= 0)), len(chosen) + more), -1, np.int64)
    pair_of[body[moving], place] = number
    places = np.full(len(fixed), -1, np.int64)
    places[chosen] = np.arange(len(chosen))
    blocks = _blocks_of_groups(pair_of, spheres.bodies[:, 3], len(spheres.groups))
    return _KernelPairs(*map(read_only, (rows, group_pairs, pairs.moving[rows[:, 3]], pair_of, *blocks, places)))


def _blocks_of_groups(pair_of: _INTS, group: _INTS, count: int) -> tuple[_INTS, _INTS]:
    """The `obstacle_blocks` and `first_block` of the groups that bodies belong to."""
    there = np.zeros((count, pair_of.shape[1] // LANES), np.bool_)
    np.logical_or.at(there, group, (pair_of >= 0).reshape(len(group), there.shape[1], LANES).any(axis=2))
    groups, blocks = np.nonzero(there)
    return blocks * LANES, np.searchsorted(groups, np.arange(count + 1))
