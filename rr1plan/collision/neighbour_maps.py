"""Maps of links that few joints move against each other: made once for a robot, good for every padding.

A map of gaps depends on the two solids and the joints between them, on nothing else: not on where the arm stands, what
is around it or which padding is asked for. Where they are near is counted from it in microseconds.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.collision.carried import Carried
from rr1plan.collision.edge_kernel import exact_scratch, exact_struct
from rr1plan.collision.exact_tables import CarriedTables, carried_tables, chain_reach, joint_motion
from rr1plan.collision.kernel_tables import ExactTables
from rr1plan.collision.mesh_trees import NO_MESHES
from rr1plan.formats.cache import cache_key, load_cached, store_cached
from rr1plan.kernels.library import constants, load_library

_INTS = NDArray[np.int64]
# Gaps up to these are told apart [m]; a map takes the least that the padding allows.
_STEPS = (0.02, 0.06, 0.2)
# Joints that turn without end have a map of a turn to both sides; one that slides, of as many metres.
_TURN = 2.0 * np.pi
_VERSION = "clearance-maps-1"
CELLS = constants()["MAP_CELLS"]
"""Cells of a map along each side."""


@dataclass(frozen=True, eq=False)
class NeighbourMaps:
    """Maps of some pairs; see `EdgeTables`.

    Args:
        places: The last four columns of its `body_pairs`, shape (m, 4).
        counts: Its `maps`.
        ranges: Its `map_ranges`, shape (m, 4).
        families: The last column of its `group_pairs`, shape (f,).
    """

    places: _INTS
    counts: NDArray[np.int16]
    ranges: Array
    families: _INTS


@dataclass(frozen=True)
class _Content:
    """All that maps depend on, to compare."""

    carried: Carried
    pairs: tuple[tuple[int, int], ...]
    least: tuple[float, ...]
    families: tuple[tuple[int, int], ...]


@dataclass(frozen=True, eq=False)
class _Between:
    """Two solids and the joints between them, alone in the world.

    Args:
        columns: The columns of q that move them against each other, all of them.
        ends: Low and high of the first and the last of those [rad or m], shape (2, 2).
        tables: What the exact kernel knows of them.
        key: Name of its map: the hash of all it depends on.
    """

    columns: tuple[int, ...]
    ends: Array
    tables: ExactTables
    key: str


def neighbour_maps(carried: Carried, pairs: _INTS, least: Array, families: _INTS) -> NeighbourMaps:
    """Maps of those pairs that one or two columns of q move against each other.

    Args:
        carried: What the arms carry.
        pairs: Pairs of its solids that move against each other [index], shape (m, 2).
        least: The gap that a map has to prove of each [m], shape (m,).
        families: First and last of pairs that have a map together as well, if all have one of their own, shape (f, 2).
    """
    rows, together = (tuple(map(tuple, table.tolist())) for table in (pairs, families))
    return _maps(_Content(carried, rows, tuple(least.tolist()), together))


@lru_cache(maxsize=8)
def _maps(content: _Content) -> NeighbourMaps:
    places = np.zeros((len(content.pairs), 4), np.int64)
    ranges = np.zeros((len(content.pairs), 4))
    counts, begins = _Counts(), dict[tuple[str, float], int]()
    free = list[NDArray[np.bool_]]()
    for i, (pair, least) in enumerate(zip(content.pairs, content.least, strict=True)):
        between = _between(_Pair(content.carried, pair))
        step = next((s for s in _STEPS if least <= 0.8 * s), None)
        if between is None or step is None:
            places[i, 0] = -1
            free.append(np.zeros((0, 0), np.bool_))
            continue
        gaps = _gaps(_Named(f"{between.key} {step}", between, step))
        free.append(gaps >= least)
        if (between.key, least) not in begins:
            begins[between.key, least] = counts.add(gaps, least)
        places[i] = begins[between.key, least], gaps.shape[1], between.columns[0], between.columns[-1]
        ranges[i, ::2], ranges[i, 1::2] = between.ends[:, 0], CELLS / (between.ends[:, 1] - between.ends[:, 0])
    families = np.full(len(content.families), -1, np.int64)
    for f, (first, last) in enumerate(content.families):
        rows = places[first:last]
        if last - first > 1 and (rows[:, 0] >= 0).all() and (rows[:, 1:] == rows[0, 1:]).all():
            families[f] = counts.add(np.logical_and.reduce(free[first:last]).astype(np.float32), 0.5)
    return NeighbourMaps(places, counts.joined(), ranges, families)


class _Counts:
    """The kernel's `maps`, as they are added."""

    def __init__(self) -> None:
        self._parts = [np.zeros(0, np.int16)]
        self._end = 0

    def add(self, gaps: NDArray[np.float32], least: float) -> int:
        """Where the counts of cells begin that have less than the least gap."""
        made = np.empty((gaps.shape[0] + 1, gaps.shape[1] + 1), np.int16)
        load_library().rr1_count_near_cells(gaps, *gaps.shape, least, made)
        self._parts.append(made.ravel())
        self._end += made.size
        return self._end - made.size

    def joined(self) -> NDArray[np.int16]:
        """All of them."""
        return np.concatenate(self._parts)


# ---- gaps ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Named:
    """A map of gaps by its name, and what to make it from."""

    name: str
    between: _Between = field(compare=False)
    most: float = field(compare=False)


@lru_cache(maxsize=512)
def _gaps(named: _Named) -> NDArray[np.float32]:
    """A bound of the gap in each cell [m], shape (n, n) or (n, 1)."""
    key = cache_key(_VERSION, named.name)
    width = CELLS if len(named.between.columns) == 2 else 1
    kept = load_cached(key)
    if kept is not None and list(kept) == ["gaps"]:
        found = kept["gaps"]
        if found.shape == (CELLS, width) and found.dtype == np.float32:
            return np.ascontiguousarray(found)
    gaps = np.empty((CELLS, width), np.float32)
    columns = len(named.between.columns)
    exact, scratch = exact_struct(named.between.tables, columns), exact_scratch(named.between.tables, columns)
    load_library().rr1_map_distances(named.between.ends, named.most, CELLS, width, exact, scratch, gaps)
    store_cached(key, {"gaps": gaps})
    return gaps


# ---- two solids alone ------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Pair:
    carried: Carried
    solids: tuple[int, int]


@lru_cache(maxsize=4096)
def _between(pair: _Pair) -> _Between | None:
    """Two solids and the joints between them; None where more than two columns of q move one against the other."""
    tables, carried = carried_tables(pair.carried), pair.carried
    shared = carried.shared[tuple(carried.groups[list(pair.solids)])]
    chains = [carried.chains[carried.groups[solid]][shared:] for solid in pair.solids]
    columns = tuple(sorted({int(tables.joints[j, 2]) for chain in chains for j in chain}))
    if len(columns) > 2:
        return None
    limits = carried.skeleton.limits
    ends = np.array([_range(float(limits.lower[c]), float(limits.upper[c])) for c in (columns[0], columns[-1])])
    arrays = _two_bodies(tables, pair.solids, chains, columns)
    return _Between(columns, ends, arrays, cache_key(f"{CELLS}", ends, *arrays[:10]))


def _range(low: float, high: float) -> tuple[float, float]:
    """Where a map is made: within the limits, or a turn to both sides."""
    low, high = max(low, -_TURN), min(high, _TURN)
    # A joint at its limit is in the map, whatever the rounding.
    return low - 1e-6, max(high, low) + 1e-6


def _two_bodies(
    tables: CarriedTables, solids: tuple[int, int], chains: list[tuple[int, ...]], columns: tuple[int, ...]
) -> ExactTables:
    """Tables of two solids alone. Their world is the last joint above both."""
    joints, values, poses = _joints_between(tables, [int(tables.rows.bodies[s, 1]) for s in solids], columns)
    rows = tables.rows
    bodies, body_values = rows.bodies[list(solids)], np.ascontiguousarray(rows.values[list(solids)])
    corners, degrees, neighbours = [], [], []
    body_poses, centres = np.zeros((2, 12)), np.zeros((2, 3))
    reach: list[float] = []
    first, link = 0, 0
    for i, (solid, chain) in enumerate(zip(solids, chains, strict=True)):
        begin, end = rows.bodies[solid, 2:4].tolist()
        corners.append(rows.corners[begin:end])
        degrees.append(rows.degrees[begin:end])
        before, own = int(rows.degrees[:begin].sum()), int(degrees[-1].sum())
        neighbours.append(rows.neighbours[before : before + own] - begin + first)
        joint = joints.number[int(rows.bodies[solid, 1])]
        bodies[i, 1:] = joint, first, first + end - begin, link, link + len(chain)
        R, t = poses[joint, :9].reshape(3, 3), poses[joint, 9:]
        body_poses[i, :9] = (R @ body_values[i, :9].reshape(3, 3)).ravel()
        body_poses[i, 9:] = R @ body_values[i, 9:12] + t
        centres[i] = R @ body_values[i, 12:15] + t
        chain = tuple(joints.number[j] for j in chain)
        reach += chain_reach(joints.rows, values, poses, chain, centres[i])
        first, link = first + end - begin, link + len(chain)
    begins = np.concatenate([[0], np.cumsum(np.concatenate(degrees))]) + first + 1
    return ExactTables(
        joints.rows,
        values,
        bodies,
        body_values,
        np.ascontiguousarray(np.concatenate(corners)),
        np.concatenate([begins, *neighbours]),
        np.array([joints.number[j] for chain in chains for j in chain], dtype=np.int64),
        np.array(reach, dtype=np.float64),
        np.array([[0, 1, 0]], dtype=np.int64),
        np.zeros(1),
        poses,
        body_poses,
        centres,
        NO_MESHES,
    )


@dataclass(frozen=True, eq=False)
class _Joints:
    """Joints between two bodies; `number` gives the row of each by its row in the whole table."""

    rows: _INTS
    number: dict[int, int]


def _joints_between(
    tables: CarriedTables, carriers: list[int], columns: tuple[int, ...]
) -> tuple[_Joints, Array, Array]:
    """The joints below the last one above both bodies, their values, and their poses at q = 0 in its frame."""
    above = []
    for joint in carriers:
        chain = [joint]
        while chain[-1]:
            chain.append(int(tables.joints[chain[-1], 0]))
        above.append(chain[::-1])
    common = max(set(above[0]) & set(above[1]), key=above[0].index)
    between = sorted({joint for chain in above for joint in chain[chain.index(common) + 1 :]})
    number = {common: 0} | {joint: i + 1 for i, joint in enumerate(between)}
    rows, values = np.zeros((len(number), 4), np.int64), np.zeros((len(number), 17))
    poses = np.tile(np.eye(4), (len(number), 1, 1))
    for joint, i in list(number.items())[1:]:
        parent, prismatic, column, _ = tables.joints[joint].tolist()
        # All of them are placed anew for each configuration.
        rows[i] = number[parent], prismatic, columns.index(column) if column >= 0 else -1, 1
        values[i] = tables.joint_values[joint]
        poses[i] = poses[number[parent]] @ joint_motion(prismatic, values[i])
    flat = np.concatenate([poses[:, :3, :3].reshape(-1, 9), poses[:, :3, 3]], axis=1)
    return _Joints(rows, number), values, flat
