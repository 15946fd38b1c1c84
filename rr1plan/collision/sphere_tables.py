"""The plain arrays that the sphere kernel reads: what moves, and what it may meet in a scene."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rr1plan._kernels.cover import FRAME, SPHERE, Cover, Work
from rr1plan._kernels.exact import ExactTables
from rr1plan._kernels.lanes import WIDTH
from rr1plan.checks import Array, read_only
from rr1plan.collision.carried_cover import carried_cover
from rr1plan.collision.exact import CollisionChecker
from rr1plan.collision.groups import families_of
from rr1plan.collision.neighbour_maps import neighbour_maps
from rr1plan.collision.obstacle_rows import joined_obstacles, resting_links, standing_obstacles
from rr1plan.collision.pairs import SolidPairs

_INTS = NDArray[np.int64]
# Intervals of one edge, and what is left of them, that are kept before the whole edge goes to the exact kernel.
_SPANS = 512


def build_cover(checker: CollisionChecker, tables: ExactTables, tolerance: float) -> tuple[Cover, Work]:
    """What the sphere kernel reads and writes, for the pairs of a checker and its motion tables.

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
    made = Cover(
        carried.joints, carried.joint_values, carried.bodies, carried.groups, carried.spheres,
        carried.chain, carried.chain_reach,
        still.kinds, still.values, np.ascontiguousarray(still.boxes.T), met.pair_of,
        np.column_stack([met.rows, maps.places]), np.column_stack([met.families, maps.families]),
        maps.counts, maps.ranges,
        tables.padding, *still.cores, still.core_of, margins,
    )  # fmt: skip
    return made, _work(made, checker.nq)


def _aligned(count: int) -> Array:
    """Zeros that begin where a whole vector of lanes does: vectors across two lines of the cache take twice as long."""
    room = np.zeros(count + WIDTH)
    first = -room.__array_interface__["data"][0] // room.itemsize % WIDTH
    return room[first : first + count]


def _work(made: Cover, columns: int) -> Work:
    longest = int((made.groups[:, 5] - made.groups[:, 4]).max(initial=0))
    items = len(made.padding)
    frames = _aligned(len(made.joints) * FRAME)
    frames.reshape(-1, 18, WIDTH)[0, [0, 4, 8]] = 1.0
    return Work(
        frames,
        _aligned(len(made.spheres) * SPHERE),
        np.zeros(len(made.bodies), np.int64),
        np.zeros((made.boxes.shape[1], 2), np.int64),
        np.zeros(len(made.bodies), np.int64),
        np.zeros((len(made.groups), longest + 1)),
        np.zeros((len(made.groups), longest + 1)),
        np.zeros((len(made.spheres), 2), np.int64),
        np.zeros((len(made.joints), 5)),
        np.zeros((items + 1, 7), np.int64),
        np.zeros((_SPANS, 2)),
        np.zeros(_SPANS, np.int64),
        _aligned(2 * WIDTH),
        np.zeros((_SPANS, 2)),
        np.zeros(_SPANS, np.int64),
        np.zeros((items, 3)),
        np.zeros(items, np.int64),
        _aligned(3 * WIDTH),
        np.zeros(8 + WIDTH, np.int64),
        np.zeros((3, columns)),
    )


# ---- pairs -----------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Meetings:
    """Who meets whom; columns as in the kernel's `Cover`.

    Args:
        rows: The first columns of `meetings`.
        families: The first columns of `families`.
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
    more = -len(chosen) % WIDTH
    pair_of = np.full((int(np.count_nonzero(bodies >= 0)), len(chosen) + more), -1, np.int64)
    pair_of[body[moving], place] = number
    chosen = np.concatenate([chosen, len(resting) + np.arange(more)])
    return _Meetings(*map(read_only, (rows, families, pairs.moving[rows[:, 3]], pair_of, chosen)))
