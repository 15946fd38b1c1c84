"""The arrays of a roadmap, and what the kernels (`rr1plan._kernels.roadmap`, `ways`) do to them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rr1plan._kernels import roadmap as kernel
from rr1plan._kernels import ways
from rr1plan._kernels.generator import generator_state
from rr1plan.checks import Array
from rr1plan.collision import MotionChecker
from rr1plan.errors import InputError
from rr1plan.planners.query import Pace
from rr1plan.planning import SearchTree
from rr1plan.scene import Scene

# The kernels are not typed.
_sample: Callable[..., int] = kernel.sample
_attach: Callable[..., None] = kernel.attach
_detach: Callable[..., None] = kernel.detach
_learn: Callable[..., None] = kernel.learn
_find_way: Callable[..., tuple[int, int]] = ways.find_way
_neighbours_of: Callable[[int, int], int] = kernel.neighbours_of

KERNELS = (kernel.sample, kernel.attach, kernel.detach, kernel.learn, ways.find_way)
_T = TypeVar("_T", bound=np.generic)

_CAPACITY = 256  # vertices to begin with
_TURN = 2.0 * np.pi


class Graph:
    """Free configurations of some arms and edges between near ones, many of them not asked for yet.

    Args:
        scene: The scene.
        arms: The arms that move.

    Attributes:
        samples: Samples drawn so far; always the same ones, so a graph is a function of their number.
        asked: Edges and samples asked for so far.

    Raises:
        InputError: a joint without limits that is not continuous.
    """

    def __init__(self, scene: Scene, arms: Sequence[str]) -> None:
        limits = scene.limits(arms)
        self._wraps = np.concatenate([scene.arm(name).robot.continuous for name in arms]) > 0.0
        self._lower = np.where(self._wraps, -np.pi, limits.lower)
        self._extent = np.where(self._wraps, _TURN, limits.upper - limits.lower)
        unbounded = np.flatnonzero(~np.isfinite(self._lower) | ~np.isfinite(self._extent))
        if len(unbounded):
            name = scene.joint_names(arms)[unbounded[0]]
            raise InputError(f"joint {name!r} has no position limits, expected finite ones")
        self._counts = np.zeros(kernel.ASKED + 1, np.int64)
        self._state = generator_state(0)
        self._vertices: Array = np.empty((len(self._lower), 0))
        self._ends: NDArray[np.int64] = np.empty(0, np.int64)
        self._following: NDArray[np.int64] = np.empty(0, np.int64)
        self._known: NDArray[np.int8] = np.empty(0, np.int8)
        self._lengths: Array = np.empty(0)
        self._first: NDArray[np.int64] = np.empty(0, np.int64)
        self._make_room(_CAPACITY)

    @property
    def samples(self) -> int:
        """How many samples were drawn."""
        return int(self._counts[kernel.SAMPLES])

    @property
    def asked(self) -> int:
        """How many edges and samples were asked for."""
        return int(self._counts[kernel.ASKED])

    @property
    def size(self) -> int:
        """How many vertices there are."""
        return int(self._counts[kernel.VERTICES])

    def picture(self) -> SearchTree:
        """Vertices, and the edges that are not known to be blocked."""
        count = int(self._counts[kernel.EDGES])
        ends, known = self._ends[: 2 * count].reshape(-1, 2), self._known[: 2 * count].reshape(-1, 2)
        edges = ends[(known != kernel.BLOCKED).all(axis=1)][:, ::-1]
        return SearchTree(self._vertices[:, : self.size].T.copy(), edges.copy())

    def sample(self, samples: int, motion: MotionChecker, goes_on: Callable[[], bool]) -> None:
        """Draw samples up to so many in all.

        Args:
            samples: The number.
            motion: Certifies edges; of the graph's scene and arms.
            goes_on: Asked every few milliseconds.
        """
        pace = Pace()
        box = (self._lower, self._extent, self._wraps)
        while self.samples < samples and goes_on():
            stop = min(samples, self.samples + pace.next())
            code = _sample(*self._arrays, self._state, *box, stop, motion.context)
            if code == kernel.FULL:
                self._make_room(2 * self.size)

    def find_way(self, start: Array, goals: Array, motion: MotionChecker, goes_on: Callable[[], bool]) -> Array | None:
        """The shortest free way from a start to one of the goals, shape (n, nq); None: none, or stopped.

        Args:
            start: Configuration, shape (nq,).
            goals: Configurations, shape (k, nq).
            motion: Certifies edges; of the graph's scene and arms.
            goes_on: Asked every few milliseconds.
        """
        pace = Pace()
        with self._attached(np.vstack([start, goals])):
            path: Array = np.empty((self.size + 1, len(start)))
            code = ways.GOING
            while code == ways.GOING and goes_on():
                first = self.size - len(goals) - 1
                code, rows = _find_way(*self._arrays, first, start, self._wraps, pace.next(), path, motion.context)
        if code != ways.FOUND:
            return None
        # A start that is a vertex already is a waypoint once.
        moves = (path[1:rows] != path[: rows - 1]).any(axis=1)
        way: Array = path[:rows][np.concatenate([[True], moves])]
        return way

    def learn(self, path: Array) -> None:
        """Insert the waypoints and edges of a free path, shape (n, nq)."""
        self._make_room(self.size + len(path))
        _learn(*self._arrays, self._wrapped(path), self._wraps)

    # ---- pieces ----------------------------------------------------------------------------------

    @property
    def _arrays(self) -> tuple[Array, tuple[NDArray[Any], ...], NDArray[np.int64]]:
        """What all kernels take first."""
        graph = (self._ends, self._following, self._known, self._lengths, self._first)
        return self._vertices, graph, self._counts

    @contextmanager
    def _attached(self, ends: Array) -> Iterator[None]:
        """Start and goals are vertices inside the block."""
        before = self._counts[: kernel.EDGES + 1].tolist()
        self._make_room(self.size + len(ends))
        _attach(*self._arrays, self._wrapped(ends), self._wraps)
        try:
            yield
        finally:
            _detach(*self._arrays[1:], *before)

    def _wrapped(self, q: Array) -> Array:
        """Angles that wrap around in [-pi, pi)."""
        return np.ascontiguousarray(np.where(self._wraps, q - _TURN * np.rint(q / _TURN), q))

    def _make_room(self, vertices: int) -> None:
        """Room for so many vertices, all their edges, and one more edge each."""
        nq, capacity = self._vertices.shape
        if vertices > capacity:
            capacity = max(vertices, 2 * capacity)
            self._vertices = _longer(self._vertices, capacity)
            self._first = _longer(self._first, capacity)
        edges = int(self._counts[kernel.EDGES]) + (capacity - self.size) * (_neighbours_of(capacity, nq) + 1)
        if edges > len(self._lengths):
            self._lengths = _longer(self._lengths, edges)
            self._ends, self._following = _longer(self._ends, 2 * edges), _longer(self._following, 2 * edges)
            self._known = _longer(self._known, 2 * edges)


def _longer(array: NDArray[_T], length: int) -> NDArray[_T]:
    """The array with a longer last axis."""
    longer: NDArray[_T] = np.empty((*array.shape[:-1], length), array.dtype)
    longer[..., : array.shape[-1]] = array
    return longer
