"""The tables of the certified edge: bodies that move, what they can touch, and the pairs to check."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import read_only
from rr1plan.collision.clearance_maps import instance_maps
from rr1plan.collision.coal_checker import CoalChecker
from rr1plan.collision.collision_geometry import CollisionGeometry
from rr1plan.collision.groups import families_of
from rr1plan.collision.kernel_tables import EdgeTables, ExactTables
from rr1plan.collision.link_spheres import instance_spheres
from rr1plan.collision.obstacle_tables import LANES, fixed_links, joined_obstacles, obstacle_tables
from rr1plan.kept import kept_in

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
    still = joined_obstacles(
        spheres.cores, [fixed_links(geometry.instances), *obstacle_tables(geometry.obstacles)], pairs.obstacles
    )
    scale = float(np.abs(still.values[:, :16]).max(initial=0.0)) + float(np.abs(spheres.joint_values[:, 9:12]).sum())
    margins = np.array([2.0 * tolerance + 1e-9 + 1e-12 * scale, float(np.max(tables.padding, initial=0.0))])
    # Rounded up, so that maps serve scenes of other sizes too.
    margin = max(10.0 * tolerance, float(margins[0]))
    maps = instance_maps(
        geometry.instances, pairs.solids, tables.padding[pairs.body_pairs[:, 3]] + margin, pairs.group_pairs
    )
    return EdgeTables(
        spheres.joints, spheres.joint_values, spheres.bodies, spheres.groups, spheres.group_boxes,
        spheres.spheres, spheres.chain, spheres.chain_reach,
        still.kinds, still.values, np.ascontiguousarray(still.boxes.T),
        pairs.pair_of, *pairs.obstacle_blocks, *pairs.group_blocks,
        np.column_stack([pairs.body_pairs, maps.places]), np.column_stack([pairs.group_pairs, maps.groups]),
        maps.counts, maps.ranges,
        tables.padding, *still.cores, still.core_of, margins,
    )  # fmt: skip


# ---- pairs -----------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _KernelPairs:
    """Which bodies and obstacles must not touch; columns as in `EdgeTables`.

    Args:
        body_pairs, group_pairs: Their first columns there.
        solids: The solids of `body_pairs`, shape (m, 2).
        pair_of: As there.
        obstacle_blocks, group_blocks: As there, with the first of each group.
        obstacles: Which of the links that do not move, then of the obstacles it counts [index], and some beyond the
            last.
    """

    body_pairs: _INTS
    group_pairs: _INTS
    solids: _INTS
    pair_of: _INTS
    obstacle_blocks: tuple[_INTS, _INTS]
    group_blocks: tuple[_INTS, _INTS]
    obstacles: _INTS


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
    chosen = np.concatenate([chosen, len(fixed) + np.arange(more)])
    count = len(spheres.groups)
    to_obstacles = np.logical_or.reduceat(pair_of >= 0, spheres.groups[:, 2], axis=0)
    return _KernelPairs(
        *map(read_only, (rows, group_pairs, pairs.moving[rows[:, 3]], pair_of)),
        _near_blocks(*np.nonzero(to_obstacles), count),
        _near_blocks(group_pairs[:, 0], group_pairs[:, 1], count),
        read_only(chosen),
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
