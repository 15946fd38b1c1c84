"""The tables of the certified edge: moving bodies, the objects they can touch, and the pairs to check."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, read_only
from rr1plan.collision.arm_geometry import ArmInstances
from rr1plan.collision.clearance_maps import instance_maps
from rr1plan.collision.collision_geometry import CollisionGeometry
from rr1plan.collision.convex.convex_cores import CoreTables
from rr1plan.collision.tables.link_spheres import LinkSpheres, instance_spheres
from rr1plan.collision.tables.obstacle_tables import LANES, FixedSolids, fixed_links
from rr1plan.kernels.planner_kernels import CStruct, load_library
from rr1plan.object_cache import kept_in

_INTS = NDArray[np.int64]
# Capacity for the intervals of one edge and for open ones; an edge with more goes to the exact kernel.
_INTERVALS = 4096
# The world's joint frame in eight lanes: the diagonal of a rotation, row by row.
_WORLD_FRAME = np.repeat(np.concatenate([np.eye(3).ravel(), np.zeros(9)]), 8).view(np.uint8)


class EdgeTables(NamedTuple):
    """The tables of the certified edge (`scene_tables.h`).

    Args:
        instances: The arms that move.
        cores: The cores of their bodies and fixed links, then of each obstacle that has one.
        obstacles: `ObstacleTables` of fixed links and obstacles.
        pairs: Which of them must not touch.
        padding: Distance to keep for each pair [m], shape (p,).
        rest: Part of a gap that has to remain for a proof, beyond everything else [m].
        bare_rest: Likewise with all obstacles at the origin [m].
    """

    instances: ArmInstances
    cores: CoreTables
    obstacles: CStruct
    pairs: PaddedPairs
    padding: Array
    rest: float
    bare_rest: float

    @property
    def arm(self) -> LinkSpheres:
        """The moving bodies."""
        return instance_spheres(self.instances)


@dataclass(frozen=True, eq=False)
class PaddedPairs:
    """The pairs that move relative to each other, for the certified edge (`pair_tables.h`).

    Args:
        pair_of: Index of the pair of a body and an obstacle, -1 for none, shape (b, o).
        obstacle_blocks, first_obstacle_block: Blocks of obstacles that have pairs with some body of each group: first
            obstacle of a block, and bits for its obstacles; shapes (k, 3) and (g + 1,).
        group_blocks, first_group_block: Likewise for groups; the third column is the first of `group_pairs`.
        body_pairs: Body, body, number of joints that move both, index of the pair, start of its map in `maps` (-1: no
            map), the map's number of columns of cells, and its two columns of q; shape (m, 8).
        group_pairs: Groups with pairs of bodies: group, group, number of joints that move both, first and last of
            `body_pairs`, and start of a common map of all these pairs in `maps` (-1: no map); shape (f, 6).
        maps: For each clearance map, the number of cells before a corner that are not free (`clearance_map.c`).
        map_ranges: Low end and cells per rad or m, for both columns of q; shape (m, 4).
        greatest: The greatest padding [m].
        kept: Values derived from them.
    """

    pair_of: NDArray[np.int32]
    obstacle_blocks: _INTS
    first_obstacle_block: _INTS
    group_blocks: _INTS
    first_group_block: _INTS
    body_pairs: _INTS
    group_pairs: _INTS
    maps: NDArray[np.int16]
    map_ranges: Array
    greatest: float
    kept: dict[str, Any] = field(default_factory=dict)


def build_edge_tables(geometry: CollisionGeometry, fixed: FixedSolids, padding: Array, tolerance: float) -> EdgeTables:
    """The tables of the certified edge.

    Args:
        geometry: The moving arms and their pairs.
        fixed: The solids that do not move.
        padding: Distance to keep for each moving pair [m], shape (m,).
        tolerance: Smaller gaps beyond the padding do not count as proven [m].
    """
    instances, pairs = geometry.instances, _kernel_pairs(geometry)
    link_cores, numbers = _link_cores(instances)
    cores = fixed.place_cores(link_cores, numbers)
    obstacles, rounding = fixed.place_obstacles(pairs.obstacle_rows, pairs.pair_of.shape[1])
    bare = tolerance + instance_spheres(instances).rounding
    padded = padded_pairs(geometry, padding, tolerance, bare + rounding)
    return EdgeTables(instances, cores, obstacles, padded, padding, bare + rounding, bare)


def _link_cores(instances: ArmInstances) -> tuple[CoreTables, _INTS]:
    """Cores of the arms' bodies and of fixed links, and the `core` of each solid of the latter; cached."""

    def make() -> tuple[CoreTables, _INTS]:
        links = fixed_links(instances)
        cores = links.place_cores(instance_spheres(instances).cores)
        return cores, links.solids[:, 3].copy()

    return kept_in(instances.kept, "link cores", make)


# ---- structs and memory ----------------------------------------------------------------------------


def scene_struct(tables: EdgeTables, exact: CStruct, columns: int, fixed: CStruct | None = None) -> CStruct:
    """A scene's tables as a C struct.

    Args:
        tables: Spheres, cores and pairs.
        exact: The exact kernel's tables for the same pairs.
        columns: Number of columns of q.
        fixed: The objects that do not move; needed only for moving them.
    """
    return CStruct(
        "SceneTables",
        arm=_arm_struct(tables),
        obstacles=tables.obstacles,
        pairs=pair_struct(tables.pairs, tables.padding),
        exact=exact,
        column_count=columns,
        margin=tables.rest,
        max_padding=tables.pairs.greatest,
        bare_margin=tables.bare_rest,
        **({} if fixed is None else {"fixed": fixed}),
    )


def _arm_struct(tables: EdgeTables) -> CStruct:
    """The moving arms and the cores as C structs; scenes without cores of obstacles share them."""
    arm, instances = tables.arm, tables.instances

    def with_cores(cores: CoreTables) -> CStruct:
        made = kept_in(instances.unplaced, "struct", arm.struct)
        return made.copied(placements=arm.joint_values, **cores.fields())

    links = _link_cores(instances)[0]
    shared = kept_in(instances.kept, "struct", lambda: with_cores(links))
    return shared if tables.cores is links else with_cores(tables.cores)


def pair_struct(pairs: PaddedPairs, padding: Array) -> CStruct:
    """Pairs as a C struct.

    Args:
        pairs: The pairs.
        padding: Distance to keep for each pair [m], shape (p,).
    """

    def make() -> CStruct:
        return CStruct(
            "PairTables",
            obstacle_pair=pairs.pair_of,
            obstacle_blocks=pairs.obstacle_blocks,
            first_obstacle_block=pairs.first_obstacle_block,
            group_blocks=pairs.group_blocks,
            first_group_block=pairs.first_group_block,
            body_pairs=pairs.body_pairs,
            group_pairs=pairs.group_pairs,
            map_ranges=pairs.map_ranges,
            maps=pairs.maps,
        )

    return kept_in(pairs.kept, "struct", make).copied(padding=padding)


def edge_scratch(tables: EdgeTables, exact: CStruct, columns: int) -> CStruct:
    """Memory that the kernel writes and keeps between calls; `list_sizes` describes the rest.

    Args:
        tables: Spheres, cores and pairs.
        exact: Memory of the exact kernel.
        columns: Number of columns of q.
    """
    arm, rows, bodies = tables.arm, tables.arm.longest_chain + 1, len(tables.pairs.pair_of)
    stride, joints = len(arm.groups) + -len(arm.groups) % LANES, len(arm.joints)
    scratch = CStruct("Scratch", bound_rows=rows, interval_size=_INTERVALS, exact=exact)
    scratch.give_room(
        joint_motions=joints,
        curve=3 * columns,
        speeds=rows * stride,
        accelerations=rows * stride,
        group_boxes=6 * stride,
        placed_batch=bodies,
        group_lanes=bodies,
        frames=joints,
        spheres=len(arm.spheres),
        seeds=len(tables.padding),
    )
    # All others are computed for every batch.
    scratch.part("frames")[0] = _WORLD_FRAME
    return scratch


def list_sizes(tables: EdgeTables) -> dict[str, int]:
    """Number of entries in the lists of `Scratch`, which every call writes before it reads them."""
    arm, pairs = tables.arm, tables.pairs
    spheres, largest, obstacles = len(arm.spheres), arm.largest_group, pairs.pair_of.shape[1]
    return {
        # One extra entry each: rejected items are written after the last one.
        "near_obstacles": obstacles + 1,
        "near_spheres": spheres + 1,
        "mesh_spheres": spheres,
        "near_groups": len(pairs.group_pairs) + 1,
        "near_bodies": largest * max(largest, obstacles) + 1,
        "candidates": len(tables.padding) + 1,
        "intervals": _INTERVALS,
        "open": _INTERVALS,
    }


# ---- pairs -----------------------------------------------------------------------------------------

# Number of paddings for which pairs are cached.
_MOST_PADDINGS = 8


def padded_pairs(geometry: CollisionGeometry, padding: Array, tolerance: float, rest: float) -> PaddedPairs:
    """The pairs of a geometry with clearance maps for a padding.

    Args:
        geometry: The geometry.
        padding: Distance to keep for each of its moving pairs [m], shape (m,).
        tolerance: Smaller gaps beyond the padding do not count as proven [m].
        rest: Part of a gap that has to remain for a proof [m].
    """
    # Rounded up, so that maps can be shared with scenes of other sizes.
    rest = max(10.0 * tolerance, rest)
    kept: dict[tuple[bytes, float], PaddedPairs] = geometry.pairs.kept.setdefault("padded", {})
    key = (padding.tobytes(), rest)
    return kept_in(kept, key, lambda: _new_padded_pairs(geometry, padding, rest), _MOST_PADDINGS)


def _new_padded_pairs(geometry: CollisionGeometry, padding: Array, rest: float) -> PaddedPairs:
    pairs = _kernel_pairs(geometry)
    least = padding[pairs.body_pairs[:, 3]] + rest
    maps = instance_maps(geometry.instances, pairs.solids, least, pairs.group_pairs[:, 3:5])
    body_pairs, group_pairs = pairs.body_pairs.copy(), pairs.group_pairs.copy()
    body_pairs[:, 4:], group_pairs[:, 5] = maps.of_pairs, maps.of_groups
    return PaddedPairs(
        pairs.pair_of,
        *pairs.obstacle_blocks,
        *pairs.group_blocks,
        read_only(body_pairs),
        read_only(group_pairs),
        maps.counts,
        maps.ranges,
        float(np.max(padding, initial=0.0)),
    )


@dataclass(frozen=True, eq=False)
class _KernelPairs:
    """Pairs of bodies and obstacles that must not touch; columns as in `PaddedPairs`.

    Args:
        body_pairs, group_pairs: As in `PaddedPairs`, without maps.
        solids: The solids of `body_pairs`, shape (m, 2).
        pair_of: As in `PaddedPairs`.
        obstacle_blocks, group_blocks: As in `PaddedPairs`, with the first block of each group.
        obstacle_rows: Column in `pair_of` of each fixed link, then of each obstacle solid; -1 if no moving body is
            checked against it.
    """

    body_pairs: _INTS
    group_pairs: _INTS
    solids: _INTS
    pair_of: NDArray[np.int32]
    obstacle_blocks: tuple[_INTS, _INTS]
    group_blocks: tuple[_INTS, _INTS]
    obstacle_rows: _INTS


def _kernel_pairs(geometry: CollisionGeometry) -> _KernelPairs:
    """The pairs of a geometry for the kernel, cached with its pairs of solids."""
    return kept_in(geometry.pairs.kept, "kernel", lambda: _new_kernel_pairs(geometry))


def _new_kernel_pairs(geometry: CollisionGeometry) -> _KernelPairs:
    spheres, pairs, library = instance_spheres(geometry.instances), geometry.pairs, load_library()
    body = np.full(len(pairs.surfaceless), -1, np.int64)
    body[: len(spheres.body)] = spheres.body
    obstacle, count = np.empty(len(body), np.int64), len(pairs.moving)
    obstacles = library.rr1_number_obstacles(pairs.moving, count, body, len(body), obstacle)
    columns = obstacles + -obstacles % LANES
    bodies, groups = len(spheres.bodies), len(spheres.groups)
    # Allocated for the largest possible number; unused memory is never touched.
    pair_of, room = np.empty((bodies, columns), np.int32), np.empty((count, 4), np.int64)
    body_pairs, solids, group_pairs = (np.empty((count, width), np.int64) for width in (8, 2, 6))
    obstacle_blocks = np.empty((min(count, groups * columns // LANES), 3), np.int64)
    group_blocks, counts = np.empty((count, 3), np.int64), np.empty(3, np.int64)
    first_obstacle_block, first_group_block = np.empty((2, groups + 1), np.int64)
    library.rr1_list_body_pairs(
        pairs.moving, pairs.moving_rows, count, body, obstacle, spheres.bodies, bodies, spheres.groups, groups,
        len(spheres.joints), columns, room, pair_of, body_pairs, solids, group_pairs,
        obstacle_blocks, first_obstacle_block, group_blocks, first_group_block, counts,
    )  # fmt: skip
    families, to_obstacles, to_groups = counts.tolist()
    both = int(group_pairs[families - 1, 4]) if families else 0
    return _KernelPairs(
        read_only(body_pairs[:both]),
        read_only(group_pairs[:families]),
        read_only(solids[:both]),
        read_only(pair_of),
        (read_only(obstacle_blocks[:to_obstacles]), read_only(first_obstacle_block)),
        (read_only(group_blocks[:to_groups]), read_only(first_group_block)),
        read_only(obstacle[body < 0]),
    )
