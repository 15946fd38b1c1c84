"""Clearance maps: lower bounds of the gap of two links over the one or two joints between them, made once for a robot.

A clearance map depends only on the two solids and the joints between them, not on the arm's pose, its surroundings or
the padding. The cells that are near for a given padding are read from it in microseconds.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.collision.arm_geometry import ArmGeometry, ArmInstances
from rr1plan.collision.convex.mesh_trees import NO_MESHES
from rr1plan.collision.tables.arm_tables import ArmTables, arm_tables, chain_reach, joint_motion
from rr1plan.collision.tables.exact_tables import ExactTables, exact_scratch, exact_struct
from rr1plan.files.disk_cache import cache_key, load_cached, store_cached
from rr1plan.kernels.planner_kernels import constants, load_library
from rr1plan.model.joint_turns import TURN
from rr1plan.object_cache import kept_in

_INTS = NDArray[np.int64]
# Upper ends of the ranges of gaps that maps resolve [m]; a map uses the smallest one that the padding allows.
_STEPS = (0.02, 0.06, 0.2)
_VERSION = "clearance-maps-1"
CELLS = constants()["MAP_CELLS"]
"""Cells of a map along each side."""


@dataclass(frozen=True, eq=False)
class ClearanceMaps:
    """Maps for some pairs; see `PaddedPairs`.

    Args:
        of_pairs: The last four columns of `PaddedPairs.body_pairs`, shape (m, 4).
        of_groups: The last column of `PaddedPairs.group_pairs`, shape (f,).
        counts: `PaddedPairs.maps`.
        ranges: `PaddedPairs.map_ranges`, shape (m, 4).
    """

    of_pairs: _INTS
    of_groups: _INTS
    counts: NDArray[np.int16]
    ranges: Array


@dataclass(frozen=True, eq=False)
class _Between:
    """Two solids and the joints between them, without any surroundings.

    Args:
        columns: All columns of q that move them relative to each other.
        ends: Lower and upper end of the first and the last of these columns [rad or m], shape (2, 2).
        tables: The exact kernel's tables of both.
        key: Name of the map: the hash of its inputs.
    """

    columns: tuple[int, ...]
    ends: Array
    tables: ExactTables
    key: str


def instance_maps(instances: ArmInstances, pairs: _INTS, least: Array, ends: _INTS) -> ClearanceMaps:
    """Maps for the pairs of bodies of one arm that one or two columns of q move relative to each other.

    Pairs of two arms have none: all arms with equal geometry share maps, whatever their base pose.

    Args:
        instances: The arms that move.
        pairs: Pairs of their solids that move relative to each other [index], sorted by pairs of groups, shape (m, 2).
        least: The gap that a map has to prove for each pair [m], shape (m,).
        ends: First and last of the pairs of each pair of groups, shape (f, 2).
    """
    of_pairs, ranges = np.zeros((len(pairs), 4), np.int64), np.zeros((len(pairs), 4))
    of_pairs[:, 0] = -1
    of_groups = np.full(len(ends), -1, np.int64)
    begins: dict[ClearanceMaps, int] = {}
    first = end = 0
    arm_of = np.repeat(np.arange(len(instances.geometries)), [len(g.solids) for g in instances.geometries])
    own = np.where(arm_of[pairs[:, 0]] == arm_of[pairs[:, 1]], arm_of[pairs[:, 0]], -1)
    count = len(instances.geometries)
    rows_of, groups_of = _rows_of(own, count), _rows_of(own[ends[:, 0]], count)
    for geometry, column, rows, families in zip(
        instances.geometries, instances.first_column.tolist(), rows_of, groups_of, strict=True
    ):
        # The pairs of one group pair are consecutive, here and among all pairs.
        maps = _arm_maps(geometry, pairs[rows] - first, least[rows], np.searchsorted(rows, ends[families]))
        if maps not in begins:
            begins[maps] = end
            end += len(maps.counts)
        begin = begins[maps]
        own_pairs = maps.of_pairs.copy()
        own_pairs[:, 0] = np.where(own_pairs[:, 0] < 0, -1, own_pairs[:, 0] + begin)
        own_pairs[:, 2:] += column
        of_pairs[rows], ranges[rows] = own_pairs, maps.ranges
        of_groups[families] = np.where(maps.of_groups < 0, -1, maps.of_groups + begin)
        first += len(geometry.solids)
    # Usually there is one set of maps, of half a megabyte.
    counts = [maps.counts for maps in begins] or [np.zeros(0, np.int16)]
    return ClearanceMaps(of_pairs, of_groups, counts[0] if len(counts) == 1 else np.concatenate(counts), ranges)


def _rows_of(arms: _INTS, count: int) -> list[_INTS]:
    """The rows of each arm, ascending."""
    order = np.argsort(arms, kind="stable")
    return np.split(order, np.searchsorted(arms[order], np.arange(count + 1)))[1:-1]


# Sets of pairs and paddings for which an arm keeps its maps.
_MOST_MAPS = 8


def _arm_maps(geometry: ArmGeometry, pairs: _INTS, least: Array, ends: _INTS) -> ClearanceMaps:
    """The maps of one arm; see `instance_maps`."""
    kept: dict[tuple[bytes, ...], ClearanceMaps] = geometry.kept.setdefault("maps", {})
    key = (pairs.tobytes(), least.tobytes(), ends.tobytes())
    return kept_in(kept, key, lambda: _new_maps(geometry, pairs, least, ends), _MOST_MAPS)


def _new_maps(geometry: ArmGeometry, pairs: _INTS, least: Array, ends: _INTS) -> ClearanceMaps:
    of_pairs = np.zeros((len(pairs), 4), np.int64)
    ranges = np.zeros((len(pairs), 4))
    counts, begins = _Counts(), dict[tuple[str, float], int]()
    free = list[NDArray[np.bool_]]()
    for i, ((one, two), gap) in enumerate(zip(pairs.tolist(), least.tolist(), strict=True)):
        between = _between(_Pair(geometry, (one, two)))
        step = next((s for s in _STEPS if gap <= 0.8 * s), None)
        if between is None or step is None:
            of_pairs[i, 0] = -1
            free.append(np.zeros((0, 0), np.bool_))
            continue
        gaps = _gaps(_Named(f"{between.key} {step}", between, step))
        free.append(gaps >= gap)
        if (between.key, gap) not in begins:
            begins[between.key, gap] = counts.add(gaps, gap)
        of_pairs[i] = begins[between.key, gap], gaps.shape[1], between.columns[0], between.columns[-1]
        ranges[i, ::2], ranges[i, 1::2] = between.ends[:, 0], CELLS / (between.ends[:, 1] - between.ends[:, 0])
    of_groups = np.full(len(ends), -1, np.int64)
    for f, (first, last) in enumerate(ends.tolist()):
        rows = of_pairs[first:last]
        if last - first > 1 and (rows[:, 0] >= 0).all() and (rows[:, 1:] == rows[0, 1:]).all():
            of_groups[f] = counts.add(np.logical_and.reduce(free[first:last]).astype(np.float32), 0.5)
    return ClearanceMaps(of_pairs, of_groups, counts.joined(), ranges)


class _Counts:
    """The kernel's `maps`, while they are added."""

    def __init__(self) -> None:
        self._parts = [np.zeros(0, np.int16)]
        self._end = 0

    def add(self, gaps: NDArray[np.float32], least: float) -> int:
        """Add the counts of cells with less than the smallest gap. Returns where they begin."""
        made = np.empty((gaps.shape[0] + 1, gaps.shape[1] + 1), np.int16)
        load_library().rr1_count_near_cells(gaps, *gaps.shape, least, made)
        self._parts.append(made.ravel())
        self._end += made.size
        return self._end - made.size

    def joined(self) -> NDArray[np.int16]:
        """All counts."""
        return np.concatenate(self._parts)


# ---- gaps ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Named:
    """A map of gaps: its name and its inputs."""

    name: str
    between: _Between = field(compare=False)
    most: float = field(compare=False)


@lru_cache(maxsize=512)
def _gaps(named: _Named) -> NDArray[np.float32]:
    """A lower bound of the gap in each cell [m], shape (n, n) or (n, 1)."""
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
    geometry: ArmGeometry
    solids: tuple[int, int]


@lru_cache(maxsize=4096)
def _between(pair: _Pair) -> _Between | None:
    """Two solids and the joints between them; None if more than two columns of q move them relative to each other."""
    geometry = pair.geometry
    tables = arm_tables(geometry)
    shared = geometry.shared[tuple(geometry.groups[list(pair.solids)])]
    chains = [geometry.chains[geometry.groups[solid]][shared:] for solid in pair.solids]
    columns = tuple(sorted({int(tables.joints[j, 2]) for chain in chains for j in chain}))
    if len(columns) > 2:
        return None
    limits = geometry.arm_model.limits
    ends = np.array([_range(float(limits.lower[c]), float(limits.upper[c])) for c in (columns[0], columns[-1])])
    arrays = _two_bodies(tables, pair.solids, chains, columns)
    return _Between(columns, ends, arrays, cache_key(f"{CELLS}", ends, *arrays[:10]))


def _range(low: float, high: float) -> tuple[float, float]:
    """The range of a map: the joint limits, or a turn to both sides."""
    # Maps of continuous joints cover one turn to both sides; those of unlimited sliding joints as many meters.
    low, high = max(low, -TURN), min(high, TURN)
    # A joint at its limit is on the map in spite of rounding.
    return low - 1e-6, max(high, low) + 1e-6


def _two_bodies(
    tables: ArmTables, solids: tuple[int, int], chains: list[tuple[int, ...]], columns: tuple[int, ...]
) -> ExactTables:
    """Tables of two solids alone, in the frame of the last joint above both."""
    joints, values, poses = _joints_between(tables, [int(tables.bodies.bodies[s, 1]) for s in solids], columns)
    rows = tables.bodies
    bodies, body_values = rows.bodies[list(solids)], np.ascontiguousarray(rows.values[list(solids)])
    corners, degrees, neighbors = [], [], []
    body_poses, centers = np.zeros((2, 12)), np.zeros((2, 3))
    reach: list[float] = []
    first, link = 0, 0
    for i, (solid, chain) in enumerate(zip(solids, chains, strict=True)):
        begin, end = rows.bodies[solid, 2:4].tolist()
        corners.append(rows.corners[begin:end])
        degrees.append(rows.degrees[begin:end])
        before, own = int(rows.degrees[:begin].sum()), int(degrees[-1].sum())
        neighbors.append(rows.neighbors[before : before + own] - begin + first)
        joint = joints.number[int(rows.bodies[solid, 1])]
        bodies[i, 1:] = joint, first, first + end - begin, link, link + len(chain)
        R, t = poses[joint, :9].reshape(3, 3), poses[joint, 9:]
        body_poses[i, :9] = (R @ body_values[i, :9].reshape(3, 3)).ravel()
        body_poses[i, 9:] = R @ body_values[i, 9:12] + t
        centers[i] = R @ body_values[i, 12:15] + t
        chain = tuple(joints.number[j] for j in chain)
        reach += chain_reach(joints.rows, values, poses, chain, centers[i])
        first, link = first + end - begin, link + len(chain)
    begins = np.concatenate([[0], np.cumsum(np.concatenate(degrees))]) + first + 1
    return ExactTables(
        joints.rows,
        values,
        bodies,
        body_values,
        np.ascontiguousarray(np.concatenate(corners)),
        np.concatenate([begins, *neighbors]),
        np.array([joints.number[j] for chain in chains for j in chain], dtype=np.int64),
        np.array(reach, dtype=np.float64),
        np.array([[0, 1, 0]], dtype=np.int64),
        np.zeros(1),
        poses,
        body_poses,
        centers,
        NO_MESHES,
    )


@dataclass(frozen=True, eq=False)
class _Joints:
    """Joints between two bodies; `number` maps the row of each in the whole table to its row here."""

    rows: _INTS
    number: dict[int, int]


def _joints_between(tables: ArmTables, carriers: list[int], columns: tuple[int, ...]) -> tuple[_Joints, Array, Array]:
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
        # All are placed anew for each configuration.
        rows[i] = number[parent], prismatic, columns.index(column) if column >= 0 else -1, 1
        values[i] = tables.joint_values[joint]
        poses[i] = poses[number[parent]] @ joint_motion(prismatic, values[i])
    flat = np.concatenate([poses[:, :3, :3].reshape(-1, 9), poses[:, :3, 3]], axis=1)
    return _Joints(rows, number), values, flat
