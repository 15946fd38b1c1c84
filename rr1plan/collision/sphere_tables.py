"""The plain arrays that the sphere kernel reads: what moves, and what it may meet in a scene."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import read_only
from rr1plan.collision.carried_cover import carried_cover
from rr1plan.collision.exact import CollisionChecker
from rr1plan.collision.groups import families_of
from rr1plan.collision.kernel_tables import EdgeTables, ExactTables
from rr1plan.collision.neighbour_maps import neighbour_maps
from rr1plan.collision.obstacle_rows import LANES, joined_obstacles, resting_links, standing_obstacles
from rr1plan.collision.pairs import SolidPairs

_INTS = NDArray[np.int64]


def build_edge_tables(checker: CollisionChecker, tables: ExactTables, tolerance: float) -> EdgeTables:
    """What the certified edge reads, for the pairs of a checker and its tables for the exact kernel.

    Args:
        checker: The checker.
        tables: Its tables for the exact kernel.
        tolerance: Gaps beyond the padding smaller than this are no proof [m].
    """
    layout = checker.layout
    carried, met = carried_cover(layout.carried), _meetings(layout.pairs)
    still = joined_obstacles(
        carried.cores, [resting_links(layout.carried), *standing_obstacles(layout.standing)], met.obstacles
    )
    scale = float(np.abs(still.values[:, :16]).max(initial=0.0)) + float(np.abs(carried.joint_values[:, 9:12]).sum())
    margins = np.array([2.0 * tolerance + 1e-9 + 1e-12 * scale, float(np.max(tables.padding, initial=0.0))])
    # Rounded up, so that maps serve scenes of other sizes too.
    margin = max(10.0 * tolerance, float(margins[0]))
    maps = neighbour_maps(layout.carried, met.pairs, tables.padding[met.rows[:, 3]] + margin, met.families[:, 3:])
    return EdgeTables(
        carried.joints, carried.joint_values, carried.bodies, carried.groups, carried.spheres,
        carried.chain, carried.chain_reach,
        still.kinds, still.values, np.ascontiguousarray(still.boxes.T), met.pair_of,
        np.column_stack([met.rows, maps.places]), np.column_stack([met.families, maps.families]),
        maps.counts, maps.ranges,
        tables.padding, *still.cores, still.core_of, margins,
    )  # fmt: skip


# ---- pairs -----------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Meetings:
    """Who meets whom; columns as in `EdgeTables`.

    Args:
        rows: The first columns of `body_pairs`.
        families: The first columns of `group_pairs`.
        pairs: Those pairs of carried solids [index], shape (m, 2).
        pair_of: As there.
        obstacles: Which of the resting links, then of the obstacles it counts [index], and some beyond the last.
    """

    rows: _INTS
    families: _INTS
    pairs: _INTS
    pair_of: _INTS
    obstacles: _INTS


@lru_cache(maxsize=128)
def _meetings(pairs: SolidPairs) -> _Meetings:
    carried = carried_cover(pairs.carried)
    bodies = carried.body
    body = np.concatenate([bodies, np.full(len(pairs.surfaceless) - len(bodies), -1, np.int64)])
    one, two = pairs.moving.T
    number = np.arange(len(one))
    meets = (body[one] >= 0) & (body[two] >= 0)
    rows = np.column_stack([body[one], body[two], pairs.moving_rows[:, 2], number])[meets]
    rows, families = families_of(rows, carried.bodies[:, 3])
    one, two, number = one[~meets], two[~meets], number[~meets]
    moving, still = np.where(body[one] >= 0, one, two), np.where(body[one] >= 0, two, one)
    resting = np.flatnonzero(body < 0)
    chosen, place = np.unique(np.searchsorted(resting, still), return_inverse=True)
    more = -len(chosen) % LANES
    pair_of = np.full((int(np.count_nonzero(bodies >= 0)), len(chosen) + more), -1, np.int64)
    pair_of[body[moving], place] = number
    chosen = np.concatenate([chosen, len(resting) + np.arange(more)])
    return _Meetings(*map(read_only, (rows, families, pairs.moving[rows[:, 3]], pair_of, chosen)))
