"""The arrays of a roadmap, which `roadmap.c` and `astar.c` fill and search."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.kernels.planner_kernels import CStruct, constants, load_library
from rr1plan.kernels.random_state import random_state
from rr1plan.model.joint_space import joint_space
from rr1plan.model.joint_turns import TURN
from rr1plan.planners.planning_query import Pace
from rr1plan.planning import SearchTree
from rr1plan.scene import Scene

_T = TypeVar("_T", bound=np.generic)

_CAPACITY = 256  # vertices to begin with


class Graph:
    """A lazy roadmap: free configurations of some arms and edges between neighbors, most not yet checked.

    Args:
        scene: The scene.
        arms: The arms that move.

    Attributes:
        samples: Samples drawn so far, from a fixed sequence, so a graph is a function of their number. Wide ranges of
            turning joints are sampled near home only.
        checks: Edges and samples checked so far.

    Raises:
        InputError: a joint without limits that is not continuous.
    """

    def __init__(self, scene: Scene, arms: Sequence[str]) -> None:
        home = np.concatenate([scene.arm(name).robot.home for name in arms])
        space = joint_space(scene, arms).bounded_near(home[None])
        space.check_bounded(scene.joint_names(arms))
        self._wraps = space.wraps
        self._lower = np.where(self._wraps, -np.pi, space.lower)
        self._extent = np.where(self._wraps, TURN, space.extent)
        self._state = random_state(0)
        self._struct = CStruct("RoadmapGraph", column_count=len(self._lower), wraps=self._wraps.view(np.uint8))
        self._library = load_library()
        self._vertices: Array = np.empty((len(self._lower), 0))
        self._ends: NDArray[np.int64] = np.empty(0, np.int64)
        self._next: NDArray[np.int64] = np.empty(0, np.int64)
        self._known: NDArray[np.int8] = np.empty(0, np.int8)
        self._lengths: Array = np.empty(0)
        self._first: NDArray[np.int64] = np.empty(0, np.int64)
        self._degrees: NDArray[np.int64] = np.empty(0, np.int64)
        self._make_room(_CAPACITY)

    @property
    def samples(self) -> int:
        """Number of samples drawn."""
        samples: int = self._struct.value.samples
        return samples

    @property
    def checks(self) -> int:
        """Number of edges and samples checked."""
        checks: int = self._struct.value.checks
        return checks

    @property
    def size(self) -> int:
        """Number of vertices."""
        vertices: int = self._struct.value.vertex_count
        return vertices

    def picture(self) -> SearchTree:
        """Vertices and the edges that are not known to be blocked."""
        count = self._struct.value.edge_count
        ends, known = self._ends[: 2 * count].reshape(-1, 2), self._known[: 2 * count].reshape(-1, 2)
        edges = ends[(known != constants()["EDGE_KNOWN_BLOCKED"]).all(axis=1)][:, ::-1]
        return SearchTree(self._vertices[:, : self.size].T.copy(), edges.copy())

    def sample(self, samples: int, motion: CollisionChecker, goes_on: Callable[[], bool]) -> None:
        """Draw samples until there are `samples` in all.

        Args:
            samples: Number of samples in all.
            motion: Collision checker of the graph's scene and arms.
            goes_on: Called every few milliseconds; False stops.
        """
        pace = Pace()
        q = np.empty_like(self._lower)
        given = (self._struct, self._state, self._lower, self._extent, q)
        while self.samples < samples and goes_on():
            stop = min(samples, self.samples + pace.next())
            code = motion.run_edge_kernel(self._library.rr1_sample_roadmap, *given, stop)
            if code == constants()["ROADMAP_FULL"]:
                self._make_room(2 * self.size)

    def find_path(
        self, start: Array, goals: Array, motion: CollisionChecker, goes_on: Callable[[], bool]
    ) -> Array | None:
        """The shortest free path from a start to one of the goals, shape (n, nq); None if there is none, or stopped.

        Args:
            start: Configuration, shape (nq,).
            goals: Configurations, shape (k, nq).
            motion: Collision checker of the graph's scene and arms.
            goes_on: Called every few milliseconds; False stops.
        """
        pace = Pace()
        with self._attached(np.vstack([start, goals])):
            path, count = np.empty((self.size + 1, len(start))), np.zeros(1, np.int64)
            first = self.size - len(goals) - 1
            going = code = constants()["ASTAR_GOING"]
            while code == going and goes_on():
                given = self._struct, first, start, pace.next(), path, count
                code = motion.run_edge_kernel(self._library.rr1_find_roadmap_path, *given)
        if code != constants()["ASTAR_FOUND"]:
            return None
        rows = int(count[0])
        # The start is repeated if it is a vertex.
        moves = (path[1:rows] != path[: rows - 1]).any(axis=1)
        distinct: Array = path[:rows][np.concatenate([[True], moves])]
        return distinct

    def learn(self, path: Array) -> None:
        """Insert the waypoints and edges of a free path, shape (n, nq)."""
        self._make_room(self.size + len(path))
        self._library.rr1_learn_path(self._struct, self._wrapped(path), len(path))

    # ---- pieces ----------------------------------------------------------------------------------

    @contextmanager
    def _attached(self, ends: Array) -> Iterator[None]:
        """Add start and goals as vertices inside the `with` block."""
        before = self.size, self._struct.value.edge_count
        self._make_room(self.size + len(ends))
        self._library.rr1_attach_ends(self._struct, self._wrapped(ends), len(ends))
        try:
            yield
        finally:
            self._library.rr1_truncate_roadmap(self._struct, *before)

    def _wrapped(self, q: Array) -> Array:
        """Angles that wrap around in [-pi, pi)."""
        return np.ascontiguousarray(np.where(self._wraps, q - TURN * np.rint(q / TURN), q))

    def _make_room(self, vertices: int) -> None:
        """Allocate `vertices` vertices, all their edges, and one more edge per vertex."""
        nq, capacity = self._vertices.shape
        if vertices > capacity:
            capacity = max(vertices, 2 * capacity)
            self._vertices = _longer(self._vertices, capacity)
            self._first = _longer(self._first, capacity)
            self._degrees = _degrees(capacity, nq)
            self._struct.set(distances=np.empty(3 * capacity), indices=np.empty(4 * capacity, np.int64))
        edges = self._struct.value.edge_count + (capacity - self.size) * (int(self._degrees[-1]) + 1)
        if edges > len(self._lengths):
            self._lengths = _longer(self._lengths, edges)
            self._ends, self._next = _longer(self._ends, 2 * edges), _longer(self._next, 2 * edges)
            self._known = _longer(self._known, 2 * edges)
        self._struct.set(
            vertices=self._vertices,
            ends=self._ends,
            next=self._next,
            known=self._known,
            lengths=self._lengths,
            first=self._first,
            degrees=self._degrees,
            capacity=capacity,
            edge_capacity=len(self._lengths),
        )


def _degrees(capacity: int, nq: int) -> NDArray[np.int64]:
    """Number of neighbors k of PRM* with 0, 1, ..., n other vertices (Karaman, Frazzoli 2011), shape (n + 1,)."""
    counts = np.arange(capacity + 1)
    return np.asarray(np.ceil(np.e * (1.0 + 1.0 / nq) * np.log(counts + 1.0)), np.int64)


def _longer(array: NDArray[_T], length: int) -> NDArray[_T]:
    """A copy of an array with a longer last axis."""
    longer: NDArray[_T] = np.empty((*array.shape[:-1], length), array.dtype)
    longer[..., : array.shape[-1]] = array
    return longer
