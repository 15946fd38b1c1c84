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
from rr1plan.collision.tables.body_groups import group_pairs_of
from rr1plan.collision.tables.kernel_tables import EdgeTables, ExactTables, PaddedPairs
from rr1plan.collision.tables.link_spheres import instance_spheres
from rr1plan.collision.tables.obstacle_tables import LANES, link_cores
from rr1plan.kernels.planner_kernels import CStruct, load_library
from rr1plan.object_cache import kept_in

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
        spheres.joints, spheres.joint_values, spheres.bodies, spheres.groups, spheres.group_boxes,
        spheres.spheres, spheres.chain, spheres.chain_reach,
        kinds, values, boxes,
        padded.pair_of, padded.obstacle_blocks, padded.first_obstacle_block,
        padded.group_blocks, padded.first_group_block,
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
        *pairs.obstacle_blocks,
        *pairs.group_blocks,
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
        pair_of: As there.
        obstacle_blocks, group_blocks: As there, with the first of each group.
        places: Of each link that does not move, then of each solid of the obstacles, its column in `pair_of`; -1 where
            nothing that moves must not touch it.
    """

    body_pairs: _INTS
    group_pairs: _INTS
    solids: _INTS
    pair_of: _INTS
    obstacle_blocks: tuple[_INTS, _INTS]
    group_blocks: tuple[_INTS, _INTS]
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
    rows, group_pairs = group_pairs_of(rows, spheres.bodies[:, 3])
    one, two, number = one[~both_move], two[~both_move], number[~both_move]
    moving, still = np.where(body[one] >= 0, one, two), np.where(body[one] >= 0, two, one)
    fixed = np.flatnonzero(body < 0)
    chosen, place = np.unique(np.searchsorted(fixed, still), return_inverse=True)
    more = -len(chosen) % LANES
    pair_of = np.full((int(np.count_nonzero(bodies >= 0)), len(chosen) + more), -1, np.int64)
    pair_of[body[moving], place] = number
    places = np.full(len(fixed), -1, np.int64)
    places[chosen] = np.arange(len(chosen))
    count = len(spheres.groups)
    to_obstacles = np.logical_or.reduceat(pair_of >= 0, spheres.groups[:, 2], axis=0)
    group, obstacle = np.nonzero(to_obstacles)
    return _KernelPairs(
        read_only(rows),
        read_only(group_pairs),
        read_only(pairs.moving[rows[:, 3]]),
        read_only(pair_of),
        _near_blocks(group, obstacle, count),
        _near_blocks(group_pairs[:, 0], group_pairs[:, 1], count),
        read_only(places),
    )


def _near_blocks(groups: _INTS, others: _INTS, count: int) -> tuple[_INTS, _INTS]:
    """Blocks of obstacles or groups, as in `EdgeTables`.

    Args:
        groups: The group of each pair, sorted.
        others: The obstacle or group that it has a pair with, sorted for each group.
        count: Number of groups.
    """
    # The blocks of one group follow each other, one number for each.
    blocks = others // LANES
    keys = groups * (int(blocks.max(initial=0)) + 1) + blocks
    begins = np.flatnonzero(np.diff(keys, prepend=-1))
    lanes = np.bitwise_or.reduceat(1 << others % LANES, begins) if len(begins) else begins
    return (
        read_only(np.column_stack([blocks[begins] * LANES, lanes, begins])),
        read_only(np.searchsorted(groups[begins], np.arange(count + 1))),
    )
