"""The certified edge in C: a scene's tables are passed once, then each edge or curve is certified by one call."""

from __future__ import annotations

import ctypes
import threading
from copy import copy
from functools import partial
from threading import get_ident
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rr1plan.binding.memory_image import Root
from rr1plan.checks import Array
from rr1plan.collision.tables.edge_tables import (
    EdgeTables,
    PaddedPairs,
    edge_scratch,
    list_sizes,
    pair_struct,
    scene_struct,
)
from rr1plan.collision.tables.exact_tables import ExactTables, exact_scratch, exact_struct
from rr1plan.kernels.planner_kernels import CStruct, address_of, constants, load_library
from rr1plan.kernels.wasm_core import memory_image

# Memory for lists, a block for each thread: page faults of new memory cost as much as an edge check.
_threads = threading.local()
EdgeResult = tuple[int, float, int]

FREE, CONTACT = constants()["EDGE_FREE"], constants()["EDGE_CONTACT"]
"""Results for an edge; grazing edges are neither."""


class EdgeCounters(NamedTuple):
    """Counters of collision checks.

    Args:
        edges: Edges and curves certified or rejected.
        exact_edges: Those that spheres and directions could not decide.
        configurations: Configurations placed.
        gaps: Exact distances computed.
    """

    edges: int
    exact_edges: int
    configurations: int
    gaps: int


class ExactKernel:
    """Distances of pairs of convex bodies at one configuration.

    It writes scratch memory, so only one thread may use it at a time: a checker calls it while holding its lock.

    Args:
        tables: The bodies and pairs.
        columns: Number of columns of q.
        like: See `exact_struct`.
        pairs: See `exact_scratch`.
    """

    def __init__(self, tables: ExactTables, columns: int, like: CStruct | None = None, pairs: int = 0) -> None:
        self.struct = exact_struct(tables, columns, like)
        self.scratch = exact_scratch(tables, columns, pairs=pairs)
        self._least_clearance = load_library().rr1_least_clearance

    def of_pairs(self, tables: ExactTables) -> ExactKernel:
        """The kernel for other pairs of the same bodies, as many as its memory allows, in the same memory."""
        other = copy(self)
        other.struct = exact_struct(tables, self.struct.value.column_count, self.struct)
        return other

    def least_clearance(self, q: Array, most: float) -> float:
        """The smallest distance of any pair beyond its padding [m], at most `most`; -inf for deep overlaps.

        Args:
            q: Configuration [rad or m], shape (nq,).
            most: Larger distances are not computed [m].
        """
        clearance: float = self._least_clearance(self.struct.address, self.scratch.address, q, most)
        return clearance


class EdgeKernel:
    """Edges and curves of a scene's moving arms, certified in C.

    It writes scratch memory, so only one thread may use it at a time: a checker calls it while holding its lock.

    Args:
        tables: Spheres, cores and pairs for the kernel.
        exact: The exact kernel for the same pairs.
        columns: Number of columns of q.
        library: The compiled kernels (default: the fastest ones that this processor can run).
        fixed: Objects that do not move, for `move_object`.
    """

    def __init__(
        self,
        tables: EdgeTables,
        exact: ExactKernel,
        columns: int,
        library: ctypes.CDLL | None = None,
        fixed: CStruct | None = None,
    ) -> None:
        self._library = library or load_library()
        self._exact = exact
        self._scene = scene_struct(tables, exact.struct, columns, fixed)
        self._scratch = edge_scratch(tables, exact.scratch, columns)
        self._result = self._scratch.value.result
        self._lists, self._queue = list_sizes(tables), exact.scratch.value.queue_size
        self._context = self._scene.address, self._scratch.address
        self._thread: int | None = None
        self._ends = np.zeros((2, columns))
        begin = address_of(self._ends, "double")
        certify: Any = self._library.rr1_certify_edge
        self._certify_edge = partial(certify.native, *self._context, begin, begin + self._ends.strides[0])

    @property
    def context(self) -> tuple[int, int]:
        """Addresses of the scene's tables and of the scratch memory, as arguments of kernels in the calling thread."""
        if self._thread != get_ident():
            self._take_lists()
        return self._context

    def _take_lists(self) -> None:
        """Point the lists to the memory of the calling thread; no call reads what an earlier one wrote there."""
        scratch, exact = self._scratch, self._exact.scratch
        size = scratch.room_size(**self._lists)
        both = size + exact.room_size(queue=self._queue)
        room = getattr(_threads, "room", None)
        if room is None or len(room) < both:
            room = _threads.room = np.empty(both, np.uint8)
        scratch.give_room(room[:size], unset=True, **self._lists)
        exact.give_room(room[size:], unset=True, queue=self._queue)
        self._thread = get_ident()

    @property
    def counters(self) -> EdgeCounters:
        """Counters of the work so far."""
        done = self._scratch.value.done
        return EdgeCounters(done.edges, done.exact_edges, done.configurations, done.gaps)

    @property
    def rest(self) -> float:
        """The part of a gap that has to remain for a proof [m]."""
        rest: float = self._scene.value.margin
        return rest

    def use_padding(self, pairs: PaddedPairs) -> None:
        """Switch to another padding, after the padding array of the tables was changed in place.

        Args:
            pairs: The same pairs with clearance maps for the new padding.
        """
        self._scene.set(pairs=pair_struct(pairs, self._scene.part("pairs").part("padding")))
        self._scene.set(max_padding=pairs.greatest)

    def move_object(self, number: int, pose: Array) -> None:
        """Move an object of the `FixedSolids` and update all tables.

        Args:
            number: The object [index].
            pose: T_world_object, shape (4, 4).
        """
        self._library.rr1_move_objects(*self.context, number, 1, pose)

    def certify_edge(self, q0: Array, q1: Array) -> EdgeResult:
        """Certify the straight line between two configurations; shapes and values have been checked.

        Args:
            q0: Start [rad or m], shape (nq,).
            q1: End [rad or m], shape (nq,).

        Returns:
            FREE, CONTACT or GRAZING; the fraction at which that is decided (0..1); the pair (-1: free).
        """
        self._ends[0], self._ends[1] = q0, q1
        if self._thread != get_ident():
            self._take_lists()
        return self._edge_result(self._certify_edge())

    def certify_parabola(self, curve: Array, duration: float) -> EdgeResult:
        """Certify a curve q(t) = sum_k curve[k] t^k, 0 <= t <= duration, of one to three terms.

        Args:
            curve: Coefficients, shape (k, nq).
            duration: End of the curve; it begins at 0.

        Returns:
            See `certify_edge`.
        """
        curve = np.ascontiguousarray(curve)
        return self._edge_result(self._library.rr1_certify_parabola(*self.context, curve, len(curve), duration))

    def certify_curve(self, curve: Array, duration: float) -> EdgeResult:
        """Certify a curve of any number of terms by the exact kernel alone.

        Args:
            curve: Coefficients, shape (k, nq).
            duration: End of the curve; it begins at 0.

        Returns:
            See `certify_edge`; the second value is in units of the duration.
        """
        curve = np.ascontiguousarray(curve)
        scratch = self._exact.scratch
        if curve.size > scratch.part("coefficients").size:
            scratch.set(coefficients=np.zeros_like(curve))
        return self._edge_result(self._library.rr1_certify_curve(*self.context, curve, len(curve), duration))

    def certify_edges(self, begins: Array, ends: Array) -> NDArray[np.int64]:
        """The statuses of many edges.

        Args:
            begins: Configurations [rad or m], shape (n, nq).
            ends: Likewise.
        """
        statuses = np.zeros(len(begins), np.int64)
        begins, ends = np.ascontiguousarray(begins), np.ascontiguousarray(ends)
        self._library.rr1_certify_edges(*self.context, begins, ends, len(begins), statuses)
        return statuses

    def certify_path(self, points: Array) -> int:
        """The number of edges of a path that are free, before the first one that is not.

        Args:
            points: Configurations [rad or m], shape (n, nq), n >= 2.
        """
        free: int = self._library.rr1_certify_path(*self.context, np.ascontiguousarray(points), len(points))
        return free

    def memory_image(self, **roots: Root) -> bytes:
        """The scene's tables and the scratch memory for `core.wasm`, named `scene` and `scratch`, and further roots."""
        self._take_lists()
        for scratch, names in ((self._scratch, self._lists), (self._exact.scratch, ("queue",))):
            for name in names:
                scratch.part(name)[:] = 0
        return memory_image(scene=self._scene, scratch=self._scratch, **roots)

    def scratch_bytes(self) -> bytes:
        """All directions and frames that the last calls left behind, for comparing libraries."""
        parts = {**self._scratch.targets, **self._exact.scratch.targets}
        return b"".join(part.tobytes() for name, part in parts.items() if name not in (*self._lists, "queue", "exact"))

    def _edge_result(self, status: int) -> EdgeResult:
        return status, self._result.fraction, self._result.pair
