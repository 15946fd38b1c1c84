"""The tables of the certified edge: bodies that move, what they can touch, and the pairs to check."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, read_only
from rr1plan.collision.arm_instances import ArmInstances
from rr1plan.collision.clearance_maps import instance_maps
from rr1plan.collision.coal_checker import CoalChecker
from rr1plan.collision.collision_geometry import CollisionGeometry
from rr1plan.collision.edge_kernel import arm_struct, padded_struct
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
        shared["arm"] = kept_in(instances.kept, "struct", lambda: _arm_struct(instances, tables))
    return shared


def _arm_struct(instances: ArmInstances, tables: EdgeTables) -> CStruct:
    """What moves as C reads it: where the arms stand, only the placements of joints and cores of fixed links tell."""
    if tables.cores is not instance_spheres(instances).cores.rows:
        return arm_struct(tables)
    made = kept_in(instances.unplaced, "struct", lambda: arm_struct(tables))
    return made.copied(placements=tables.joint_values)


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
    spheres, pairs, library = instance_spheres(geometry.instances), geometry.pairs, load_library()
    body = np.full(len(pairs.surfaceless), -1, np.int64)
    body[: len(spheres.body)] = spheres.body
    place, count = np.empty(len(body), np.int64), len(pairs.moving)
    obstacles = library.rr1_number_obstacles(pairs.moving, count, body, len(body), place)
    columns = obstacles + -obstacles % LANES
    bodies, groups = len(spheres.bodies), len(spheres.groups)
    # Room for as many as there can be: what is not used is never touched.
    pair_of, room = np.empty((bodies, columns), np.int64), np.empty((count, 4), np.int64)
    body_pairs, solids, group_pairs = (np.empty((count, width), np.int64) for width in (4, 2, 5))
    obstacle_blocks = np.empty((min(count, groups * columns // LANES), 3), np.int64)
    group_blocks, counts = np.empty((count, 3), np.int64), np.empty(3, np.int64)
    first_obstacle_block, first_group_block = np.empty((2, groups + 1), np.int64)
    library.rr1_list_body_pairs(
        pairs.moving, pairs.moving_rows, count, body, place, spheres.bodies, bodies, spheres.groups, groups,
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
        read_only(place[body < 0]),
    )
