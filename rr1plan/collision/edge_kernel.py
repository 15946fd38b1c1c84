"""The certified edge in C: a scene's tables handed over once, then edges and curves certified by one call each."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.collision.convex.mesh_trees import NO_MESHES
from rr1plan.collision.tables.kernel_tables import EdgeTables, ExactTables, PaddedPairs
from rr1plan.kernels.planner_kernels import CStruct, address_of, constants, load_library
from rr1plan.kernels.wasm_core import memory_image
from rr1plan.object_cache import kept_in

# Intervals of one edge, and those left open, that are kept before the whole edge goes to the exact kernel.
_INTERVALS = 512
# Pairs and intervals that the exact kernel keeps open at once, at least; a power of two.
_QUEUE = 1 << 15
# Scratch memory that is written before it is read.
_LISTS = (
    "near_obstacles", "near_spheres", "mesh_spheres", "near_groups", "near_bodies", "candidates", "intervals", "open",
)  # fmt: skip
# Coefficients of a curve there is room for until a longer one comes.
_TERMS = 8

Answer = tuple[int, float, int]

FREE, CONTACT = constants()["EDGE_FREE"], constants()["EDGE_CONTACT"]
"""What an edge is found to be; grazing ones are neither."""


class EdgeCounters(NamedTuple):
    """What has been done so far.

    Args:
        edges: Edges and curves certified or refused.
        exact_edges: Those of them that spheres and directions could not decide.
        configurations: Configurations placed.
        gaps: Distances of pairs computed finely.
    """

    edges: int
    exact_edges: int
    configurations: int
    gaps: int


def exact_struct(tables: ExactTables, columns: int) -> CStruct:
    """The exact kernel's tables as C reads them.

    Args:
        tables: The tables.
        columns: Number of columns of q.
    """
    return CStruct(
        "ExactTables",
        joint_count=len(tables.joints),
        body_count=len(tables.bodies),
        pair_count=len(tables.pairs),
        column_count=columns,
        joints=tables.joints,
        placements=tables.joint_values,
        bodies=tables.bodies,
        shapes=tables.body_values,
        corners=tables.corners,
        links=tables.links,
        chain=tables.chain,
        chain_reach=tables.chain_reach,
        pairs=tables.pairs,
        padding=tables.padding,
        meshes=_no_meshes() if tables.meshes is NO_MESHES else CStruct("MeshTables", **vars(tables.meshes)),
    )


@cache
def _no_meshes() -> CStruct:
    return CStruct("MeshTables", **vars(NO_MESHES))


def exact_scratch(tables: ExactTables, columns: int, terms: int = _TERMS, queue: int | None = None) -> CStruct:
    """Memory that the exact kernel writes.

    Args:
        tables: Its tables; the poses of fixed bodies are copied from them.
        columns: Number of columns of q.
        terms: Coefficients of the longest curve.
        queue: Pairs and intervals that can be open at once, a power of two (default: enough for curves).
    """
    queue = queue or max(_QUEUE, 1 << (16 * len(tables.pairs)).bit_length())
    stride = len(tables.joints) + 1
    scratch = CStruct("ExactScratch", travel_stride=stride, coefficient_rows=terms, queue_size=queue)
    scratch.give_room(
        joint_poses=len(tables.joints),
        poses=len(tables.bodies),
        centers=len(tables.bodies),
        directions=len(tables.pairs),
        travel=len(tables.bodies) * stride,
        coefficients=terms * columns,
        q=columns,
        reach=columns,
        placed_at=len(tables.bodies),
    )
    scratch.give_room(unset=True, queue=queue)
    for name, start in (("joint_poses", tables.joint_poses), ("poses", tables.poses), ("centers", tables.centers)):
        scratch.part(name).view(np.float64)[:] = start
    return scratch


class ExactKernel:
    """Distances of pairs of convex bodies in one configuration. It keeps scratch memory: give each thread its own.

    Args:
        tables: The bodies and pairs.
        columns: Number of columns of q.
        like: The kernel of other pairs of the same bodies, if there is one: its struct is copied.
    """

    def __init__(self, tables: ExactTables, columns: int, like: ExactKernel | None = None) -> None:
        if like is None:
            self.struct = exact_struct(tables, columns)
        else:
            pairs, padding = tables.pairs, tables.padding
            self.struct = like.struct.copied(pair_count=len(pairs), pairs=pairs, padding=padding)
        self.scratch = exact_scratch(tables, columns)
        self._least_clearance = load_library().rr1_least_clearance

    def least_clearance(self, q: Array, most: float) -> float:
        """The least distance of any pair beyond its padding [m], `most` at most; -inf where bodies overlap deeply.

        Args:
            q: Configuration [rad or m], shape (nq,).
            most: Greater distances are not computed [m].
        """
        clearance: float = self._least_clearance(self.struct, self.scratch, q, most)
        return clearance


def scene_struct(
    tables: EdgeTables, exact: CStruct, columns: int, tolerance: float, known: Mapping[str, CStruct] | None = None
) -> CStruct:
    """A scene's tables as C reads them.

    Args:
        tables: What the kernel knows of spheres, cores and pairs.
        exact: What the exact kernel knows of the same pairs.
        columns: Number of columns of q.
        tolerance: Motions that pass at less than this beyond the padding are refused [m].
        known: Structs that exist already, by field: `fixed`, needed to move obstacles; `arm` and `pairs`, which scenes
            share (the padding of the pairs is replaced).
    """
    obstacles = CStruct(
        "ObstacleTables",
        count=len(tables.obstacles),
        kinds=tables.obstacles,
        shapes=tables.obstacle_values,
        boxes=tables.boxes,
        core=tables.core_of,
    )
    known = {} if known is None else known
    pairs = known["pairs"] if "pairs" in known else pair_struct(tables)
    return CStruct(
        "SceneTables",
        arm=known["arm"] if "arm" in known else arm_struct(tables),
        obstacles=obstacles,
        pairs=pairs.copied(padding=tables.padding, pair_count=len(tables.padding)),
        exact=exact,
        column_count=columns,
        margin=float(tables.margins[0]),
        max_padding=float(tables.margins[1]),
        bare_margin=float(tables.margins[2]),
        tolerance=tolerance,
        **({"fixed": known["fixed"]} if "fixed" in known else {}),
    )


def arm_struct(tables: EdgeTables) -> CStruct:
    """What moves, and cores, as C reads them."""
    depths, blocks, reach = _chain_tables(tables)
    return CStruct(
        "ArmGeometry",
        joint_count=len(tables.joints),
        body_count=len(tables.bodies),
        group_count=len(tables.groups),
        sphere_count=len(tables.spheres),
        joints=tables.joints,
        placements=tables.joint_values,
        bodies=tables.bodies,
        groups=tables.groups,
        group_boxes=tables.group_boxes,
        spheres=tables.spheres,
        chain=tables.chain,
        depths=depths,
        group_blocks=blocks,
        reach=reach,
        group_stride=len(blocks) * constants()["LANES"],
        cores=tables.cores,
        core_shapes=tables.core_values,
        points=tables.points,
        blocks=tables.blocks,
        lowest=tables.lowest.view(np.uint64),
    )


def padded_struct(pairs: PaddedPairs) -> CStruct:
    """The struct of pairs that are shared, made once."""
    return kept_in(pairs.kept, "struct", lambda: pair_struct(pairs))


def pair_struct(pairs: EdgeTables | PaddedPairs) -> CStruct:
    """Pairs as C reads them, without their paddings."""
    return CStruct(
        "PairTables",
        body_pair_count=len(pairs.body_pairs),
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


def _chain_tables(tables: EdgeTables) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
    """How many driven joints are above each joint, and the kernel's `group_blocks` and `reach`."""
    lanes = constants()["LANES"]
    depths = np.zeros(len(tables.joints), np.int64)
    for j, parent in enumerate(tables.joints[1:, 0].tolist(), 1):
        depths[j] = depths[parent] + (parent > 0)
    group = np.repeat(np.arange(len(tables.groups)), tables.groups[:, 5] - tables.groups[:, 4])
    first = np.full(-(-len(tables.groups) // lanes), len(tables.joints), np.int64)
    last = np.zeros_like(first)
    np.minimum.at(first, group // lanes, tables.chain)
    np.maximum.at(last, group // lanes, tables.chain + 1)
    rows = np.cumsum(last - first) - (last - first)
    reach = np.full((int((last - first).sum()), lanes), -1.0)
    reach[rows[group // lanes] + tables.chain - first[group // lanes], group % lanes] = tables.chain_reach
    return depths, np.column_stack([first, last, rows]), reach


def _whole_lanes(count: int) -> int:
    """A count rounded up to whole vectors."""
    lanes = constants()["LANES"]
    return -(-count // lanes) * lanes


def edge_scratch(tables: EdgeTables, exact: CStruct, columns: int) -> CStruct:
    """Memory that the kernel writes: one thread's.

    Args:
        tables: What the kernel knows of spheres, cores and pairs.
        exact: Memory of the exact kernel.
        columns: Number of columns of q.
    """
    rows = int((tables.groups[:, 5] - tables.groups[:, 4]).max(initial=0)) + 1
    stride = _whole_lanes(len(tables.groups))
    largest = int((tables.groups[:, 3] - tables.groups[:, 2]).max(initial=0))
    bodies, obstacles = len(tables.bodies), len(tables.obstacles)
    scratch = CStruct("Scratch", bound_rows=rows, interval_size=_INTERVALS, exact=exact)
    scratch.give_room(
        joint_motions=len(tables.joints),
        curve=3 * columns,
        speeds=rows * stride,
        accelerations=rows * stride,
        group_boxes=6 * stride,
        placed_batch=bodies,
        group_lanes=bodies,
        frames=len(tables.joints),
        spheres=len(tables.spheres),
        seeds=len(tables.padding),
    )
    scratch.give_room(
        unset=True,
        # One more than there are: what is not kept is written behind the last.
        near_obstacles=obstacles + 1,
        near_spheres=len(tables.spheres) + 1,
        mesh_spheres=len(tables.spheres),
        near_groups=len(tables.group_pairs) + 1,
        near_bodies=largest * max(largest, obstacles) + 1,
        candidates=len(tables.padding) + 1,
        intervals=_INTERVALS,
        open=_INTERVALS,
    )
    # The world's frame; all others are placed for every batch.
    scratch.part("frames").view(np.float64).reshape(len(tables.joints), 18, 8)[0, [0, 4, 8]] = 1.0
    return scratch


class EdgeKernel:
    """Edges and curves of a scene's moving arms, certified in C. It keeps scratch memory: give each thread its own.

    Args:
        tables: What the kernel knows of spheres, cores and pairs.
        exact: The exact kernel of the same pairs.
        columns: Number of columns of q.
        tolerance: Motions that pass at less than this beyond the padding are refused [m].
        library: The compiled kernels (default: the fastest ones this processor can run).
        known: Structs that are known, see `scene_struct`.

    Attributes:
        context: Addresses of the scene's tables and of the scratch memory, as the kernels of planners take them.
    """

    def __init__(
        self,
        tables: EdgeTables,
        exact: ExactKernel,
        columns: int,
        tolerance: float,
        library: ctypes.CDLL | None = None,
        known: Mapping[str, CStruct] | None = None,
    ) -> None:
        self._library = library or load_library()
        self._exact = exact
        self._scene = scene_struct(tables, exact.struct, columns, tolerance, known)
        self._scratch = edge_scratch(tables, exact.scratch, columns)
        self.context = self._scene.address, self._scratch.address
        self._ends = np.zeros((2, columns))
        begin = address_of(self._ends, "double")
        self._edge_call = *self.context, begin, begin + self._ends.strides[0]
        self._certify_edge = self._library.rr1_certify_edge

    @property
    def done(self) -> EdgeCounters:
        """What has been done so far."""
        done = self._scratch.value.done
        return EdgeCounters(done.edges, done.exact_edges, done.configurations, done.gaps)

    @property
    def rest(self) -> float:
        """What must be left of a gap beyond everything else for a proof [m]."""
        rest: float = self._scene.value.margin
        return rest

    def use_padding(self, pairs: PaddedPairs) -> None:
        """Use another padding, after the padding array of the tables was changed in place.

        Args:
            pairs: The same pairs with clearance maps for it.
        """
        padding = self._scene.part("pairs").part("padding")
        self._scene.set(pairs=padded_struct(pairs).copied(padding=padding, pair_count=len(padding)))
        self._scene.set(max_padding=pairs.greatest)

    def move_object(self, number: int, pose: Array) -> None:
        """Move an object of the `FixedSolids` and update all tables.

        Args:
            number: The object [index].
            pose: T_world_object, shape (4, 4).
        """
        self._library.rr1_move_object(*self.context, number, pose)

    def certify_edge(self, q0: Array, q1: Array) -> Answer:
        """Certify the straight line between two configurations; shapes and numbers have been checked.

        Args:
            q0: Begin [rad or m], shape (nq,).
            q1: End [rad or m], shape (nq,).

        Returns:
            FREE, CONTACT or GRAZING; where that is found (0..1); which pair (-1: free).
        """
        self._ends[0], self._ends[1] = q0, q1
        return self._answer(self._certify_edge(*self._edge_call))

    def certify_parabola(self, curve: Array, duration: float) -> Answer:
        """Certify a curve q(t) = sum_k curve[k] t^k, 0 <= t <= duration, of one to three terms.

        Args:
            curve: Coefficients, shape (k, nq).
            duration: End of the curve; it begins at 0.

        Returns:
            See `certify_edge`.
        """
        curve = np.ascontiguousarray(curve)
        return self._answer(self._library.rr1_certify_parabola(*self.context, curve, len(curve), duration))

    def certify_curve(self, curve: Array, duration: float) -> Answer:
        """Certify a curve of any number of terms by the exact kernel alone.

        Args:
            curve: Coefficients, shape (k, nq).
            duration: End of the curve; it begins at 0.

        Returns:
            See `certify_edge`, where in units of the duration.
        """
        curve = np.ascontiguousarray(curve)
        scratch = self._exact.scratch
        if len(curve) > scratch.value.coefficient_rows:
            scratch.set(coefficients=np.zeros_like(curve), coefficient_rows=len(curve))
        return self._answer(self._library.rr1_certify_curve(*self.context, curve, len(curve), duration))

    def certify_edges(self, begins: Array, ends: Array) -> NDArray[np.int64]:
        """The statuses of many edges.

        Args:
            begins: Configurations [rad or m], shape (n, nq).
            ends: The same.
        """
        statuses = np.zeros(len(begins), np.int64)
        begins, ends = np.ascontiguousarray(begins), np.ascontiguousarray(ends)
        self._library.rr1_certify_edges(*self.context, begins, ends, len(begins), statuses)
        return statuses

    def memory_image(self) -> bytes:
        """The scene's tables and the scratch memory for `core.wasm`, named `scene` and `scratch`."""
        for scratch, names in ((self._scratch, _LISTS), (self._exact.scratch, ("queue",))):
            for name in names:
                scratch.part(name)[:] = 0
        return memory_image(scene=self._scene, scratch=self._scratch)

    def scratch_bytes(self) -> bytes:
        """All directions and frames that the last calls left behind, to compare libraries by."""
        parts = {**self._scratch.targets, **self._exact.scratch.targets}
        return b"".join(part.tobytes() for name, part in parts.items() if name not in (*_LISTS, "queue", "exact"))

    def _answer(self, status: int) -> Answer:
        result = self._scratch.value.result
        return status, result.fraction, result.pair
