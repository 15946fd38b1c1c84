"""Two trees that grow until they meet: `rr1plan._kernels.rrt_connect` under the budget of a query."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from rr1plan._kernels import rrt_connect as kernel
from rr1plan._kernels import trees as layout
from rr1plan._kernels.generator import generator_state
from rr1plan.checks import Array
from rr1plan.errors import InputError
from rr1plan.planners.query import NO_LIMIT, Pace, Query
from rr1plan.planning import SearchTree

# The kernels are not typed.
_grow: Callable[..., int] = kernel.grow

# What a search calls.
KERNELS = (kernel.grow,)

_STEP = 0.06  # longest edge of a tree, as a part of the space's diagonal
_SHORTEST = 1e-4  # the least that may be set, the same way
_DOMAIN = 0.3  # how near to a vertex that has met an obstacle samples have to be, the same way
_CAPACITY = 256  # vertices of each tree to begin with
_SLICE = 500  # samples before the first look for more goals; before each other one twice as many as were drawn


_Memory = tuple[Array, NDArray[np.int64], Array, NDArray[np.bool_], Array]
# Of trees that are no more; appending to it and popping from it are atomic.
_idle: deque[_Memory] = deque(maxlen=4)


class TreeSearch:
    """Searches for one query, each with fresh trees.

    Args:
        query: Whose ends they have, whose budget they use.
        step: Longest edge of a tree [rad]; 0: a part of the diagonal of the joints' ranges.

    Attributes:
        trees: Those of the last search.
        state: Of the generator, shape (1,).

    Raises:
        InputError: a step too short, or a joint without limits.
    """

    def __init__(self, query: Query, step: float = 0.0) -> None:
        self.query = query
        diagonal = query.space.diagonal
        self._step, self._domain = step or _STEP * diagonal, _DOMAIN * diagonal
        if self._step < _SHORTEST * diagonal:
            raise InputError(f"range is {step:g}, expected at least {_SHORTEST * diagonal:.3g} for these joints")
        self.state = generator_state(query.seed)
        self.trees = Trees(query.problem.start, query.goals)
        self._pace = Pace()
        self._slice = query.iterations + _SLICE

    def meets(self, bound: float = math.inf, samples: int = NO_LIMIT) -> bool:
        """Whether trees meet within a bound, so many samples, and the budget of the query.

        Args:
            bound: Longest path [rad] (inf: any).
            samples: How many at most.
        """
        query, trees, counts = self.query, self.trees, self.trees.counts
        counts[:] = 0
        settings = (query.space.lower, query.space.extent, self._step, self._domain, bound)
        begin = query.iterations
        last = begin + min(samples, query.most - begin)
        code = kernel.GOING
        while code != kernel.SOLVED and query.iterations < last and query.in_time():
            stop = min(query.iterations + self._pace.next(), last)
            if bound == math.inf:
                if query.iterations >= self._slice:
                    self._look_for_goals()
                stop = min(stop, self._slice)
            code = trees.grow(self.state, *settings, stop - begin, query.motion.context)
            query.iterations = begin + int(counts[layout.SAMPLES])
            if code == kernel.FULL:
                trees.enlarge()
        query.edges += int(counts[layout.EDGES])
        return bool(code == kernel.SOLVED)

    def _look_for_goals(self) -> None:
        """Aim at more configurations where those known may all lie where the start cannot get to."""
        self._slice = 2 * self.query.iterations
        self.trees.add_goals(self.query.more_goals())

    def describe(self) -> str:
        """How far the last search got, in words."""
        of_start, of_goal = self.trees.counts[:2].tolist()
        return f"{of_start} configurations were reached from the start, {of_goal} from the goal"


class Trees:
    """The arrays that the kernel grows.

    Args:
        start: Root of the one, shape (nq,).
        goals: Roots of the other, shape (k, nq).
    """

    def __init__(self, start: Array, goals: Array) -> None:
        self._roots = (start, goals)
        self.counts = np.zeros(layout.ROWS + 1, np.int64)
        nq, capacity = len(start), max(_CAPACITY, 2 * len(goals))
        self._memory = _take_memory(nq, capacity)
        self.vertices, self.parents, self.lengths, self.blocked, self._way = self._memory

    def __del__(self) -> None:
        """Leave the memory to other trees: to touch new memory for the first time takes as long as an edge."""
        _idle.append(self._memory)

    def grow(self, state: NDArray[np.uint64], *settings: object) -> int:
        """Let the kernel grow them; it says what the settings are."""
        trees = (self.vertices, self.parents, self.lengths, self.blocked, self.counts, self._way)
        return _grow(*trees, *self._roots, state, *settings)

    def enlarge(self) -> None:
        """Twice the room."""
        self.vertices = np.concatenate([self.vertices, np.empty_like(self.vertices)], axis=2)
        self.parents = np.concatenate([self.parents, np.empty_like(self.parents)], axis=1)
        self.lengths = np.concatenate([self.lengths, np.empty_like(self.lengths)], axis=1)
        self.blocked = np.concatenate([self.blocked, np.zeros_like(self.blocked)], axis=1)
        self._way = np.empty((2 * len(self._way), self._way.shape[1]))

    def add_goals(self, goals: Array) -> None:
        """More roots of the goals' tree, shape (k, nq)."""
        self._roots = (self._roots[0], np.concatenate([self._roots[1], goals]))
        size = int(self.counts[layout.SIZE_GOAL])
        end = size + len(goals)
        while max(end, 2 * len(self._roots[1])) > self.parents.shape[1]:
            self.enlarge()
        self.vertices[1, :, size:end] = goals.T
        self.parents[1, size:end], self.lengths[1, size:end], self.blocked[1, size:end] = -1, 0.0, False
        self.counts[layout.SIZE_GOAL] = end

    def path(self) -> Array:
        """The way from the start to a goal, shape (n, nq)."""
        return self._way[: self.counts[layout.ROWS]].copy()

    def explored(self, *, joined: bool) -> SearchTree:
        """Both trees, and the edge between them when they have met."""
        sizes = self.counts[:2].tolist()
        vertices = np.concatenate([self.vertices[side, :, :size].T for side, size in enumerate(sizes)])
        edges = []
        for side, first in enumerate((0, sizes[0])):
            parents = self.parents[side, : sizes[side]]
            children = np.flatnonzero(parents >= 0)
            edges.append(np.stack([parents[children], children], axis=1) + first)
        if joined:
            join = self.counts[[layout.JOIN_START, layout.JOIN_GOAL]] + np.array([0, sizes[0]])
            edges.append(join[None])
        return SearchTree(vertices, np.concatenate(edges).astype(np.int64))


def _take_memory(nq: int, capacity: int) -> _Memory:
    """Arrays for two trees of so many vertices each, used before where possible."""
    with suppress(IndexError):
        used = _idle.pop()
        if used[0].shape[1:] == (nq, capacity):
            return used
    vertices, way = np.empty((2, nq, capacity)), np.empty((2 * capacity, nq))
    return vertices, np.empty((2, capacity), np.int64), np.empty((2, capacity)), np.empty((2, capacity), np.bool_), way
