"""Two trees that grow until they meet: `rrt_connect.c` under the budget of a query."""

from __future__ import annotations

import math
from collections import deque
from contextlib import suppress

import numpy as np

from rr1plan.checks import Array
from rr1plan.errors import InputError
from rr1plan.kernels.library import CStruct, address_of, constants, load_library
from rr1plan.kernels.random_state import RandomState, random_state
from rr1plan.planners.query import NO_LIMIT, Pace, Query
from rr1plan.planning import SearchTree

_STEP = 0.06  # longest edge of a tree, as a part of the space's diagonal
_SHORTEST = 1e-4  # the least that may be set, the same way
_DOMAIN = 0.3  # how near to a vertex that has met an obstacle samples have to be, the same way
_CAPACITY = 256  # vertices of each tree to begin with
_SLICE = 500  # samples before the first look for more goals; before each other one twice as many as were drawn


class TreeSearch:
    """Searches for one query, each with fresh trees.

    Args:
        query: Whose ends they have, whose budget they use.
        step: Longest edge of a tree [rad]; 0: a part of the diagonal of the joints' ranges.

    Attributes:
        trees: Those of the last search.
        state: Of the random numbers.

    Raises:
        InputError: a step too short, or a joint without limits.
    """

    def __init__(self, query: Query, step: float = 0.0) -> None:
        self.query = query
        diagonal = query.space.diagonal
        self._step, self._domain = step or _STEP * diagonal, _DOMAIN * diagonal
        if self._step < _SHORTEST * diagonal:
            raise InputError(f"range is {step:g}, expected at least {_SHORTEST * diagonal:.3g} for these joints")
        self.state = random_state(query.seed)
        self.trees = Trees(query.problem.start, query.goals)
        self._pace = Pace()
        self._slice = query.iterations + _SLICE

    def meets(self, bound: float = math.inf, samples: int = NO_LIMIT) -> bool:
        """Whether trees meet within a bound, so many samples, and the budget of the query.

        Args:
            bound: Longest path [rad] (inf: any).
            samples: How many at most.
        """
        query, trees = self.query, self.trees
        trees.restart(query.space.lower, query.space.extent, self._step, self._domain, bound)
        begin = query.iterations
        last = begin + min(samples, query.most - begin)
        met = False
        while not met and query.iterations < last and query.in_time():
            stop = min(query.iterations + self._pace.next(), last)
            if bound == math.inf:
                if query.iterations >= self._slice:
                    self._look_for_goals()
                stop = min(stop, self._slice)
            met = trees.grow(self.state, stop - begin, query.motion.context)
            query.iterations = begin + trees.samples
        query.edges += trees.edges
        return met

    def _look_for_goals(self) -> None:
        """Aim at more configurations where those known may all lie where the start cannot get to."""
        self._slice = 2 * self.query.iterations
        self.trees.add_goals(self.query.more_goals())

    def describe(self) -> str:
        """How far the last search got, in words."""
        of_start, of_goal = self.trees.sizes
        return f"{of_start} configurations were reached from the start, {of_goal} from the goal"


class Trees:
    """Two trees, as the kernel grows them.

    Args:
        start: Root of the one, shape (nq,).
        goals: Roots of the other, shape (k, nq).

    Attributes:
        memory: Their arrays.
    """

    def __init__(self, start: Array, goals: Array) -> None:
        self.memory = _take_memory(len(start), max(_CAPACITY, 2 * len(goals)))
        self._query = CStruct("TreeQuery", start=start, goals=goals, goal_count=len(goals))
        self._goals = goals
        self._call = load_library().rr1_grow_trees

    def __del__(self) -> None:
        """Leave the memory to other trees: to touch new memory for the first time takes as long as an edge."""
        _idle.append(self.memory)

    @property
    def samples(self) -> int:
        """Samples drawn so far."""
        samples: int = self.memory.struct.value.samples
        return samples

    @property
    def edges(self) -> int:
        """Edges checked so far."""
        edges: int = self.memory.struct.value.edges
        return edges

    @property
    def sizes(self) -> tuple[int, int]:
        """Vertices of the start's tree and of the goals'."""
        one, two = self.memory.struct.value.sides
        return one.size, two.size

    def restart(self, lower: Array, extent: Array, step: float, domain: float, bound: float) -> None:
        """Begin with the roots alone.

        Args:
            lower: Corner of the box to sample, shape (nq,).
            extent: Its sides, infinite where a joint wraps, shape (nq,).
            step: Longest edge of a tree [rad].
            domain: How near a sample has to be to a vertex with a blocked edge [rad].
            bound: Longest path [rad] (inf: any).
        """
        self._query.set(lower=lower, extent=extent, step=step, domain=domain, bound=bound)
        trees = self.memory.struct.value
        trees.sides[0].size = trees.samples = trees.edges = 0

    def grow(self, state: RandomState, samples: int, scene: tuple[int, int]) -> bool:
        """Grow until `samples` have been drawn in all, or there is no room; whether the trees have met."""
        struct = self.memory.struct
        code = self._call(struct, self._query, state, samples, *scene)
        if code == constants()["SEARCH_FULL"]:
            self.memory.enlarge()
        return bool(code == constants()["SEARCH_SOLVED"])

    def add_goals(self, goals: Array) -> None:
        """More roots of the goals' tree, shape (k, nq)."""
        self._goals = np.concatenate([self._goals, goals])
        self._query.set(goals=self._goals, goal_count=len(self._goals))
        memory = self.memory
        size = self.sizes[1]
        end = size + len(goals)
        while max(end, 2 * len(self._goals)) > memory.capacity:
            memory.enlarge()
        memory.vertices[1, :, size:end] = goals.T
        memory.parents[1, size:end], memory.lengths[1, size:end], memory.blocked[1, size:end] = -1, 0.0, 0
        memory.struct.value.sides[1].size = end

    def path(self) -> Array:
        """The path from the start to a goal, shape (n, nq)."""
        return self.memory.path[: self.memory.struct.value.path_rows].copy()

    def explored(self, *, joined: bool) -> SearchTree:
        """Both trees, and the edge between them when they have met."""
        memory, sizes = self.memory, self.sizes
        vertices = np.concatenate([memory.vertices[side, :, :size].T for side, size in enumerate(sizes)])
        edges = []
        for side, first in enumerate((0, sizes[0])):
            parents = memory.parents[side, : sizes[side]]
            children = np.flatnonzero(parents >= 0)
            edges.append(np.stack([parents[children], children], axis=1) + first)
        if joined:
            one, two = memory.struct.value.sides
            edges.append(np.array([[one.meeting, two.meeting + sizes[0]]]))
        return SearchTree(vertices, np.concatenate(edges).astype(np.int64))


class TreeMemory:
    """Arrays of two trees, and the struct that leads to them."""

    def __init__(self, nq: int, capacity: int) -> None:
        self.vertices, self.path = np.empty((2, nq, capacity)), np.empty((2 * capacity, nq))
        self.parents, self.lengths = np.empty((2, capacity), np.int64), np.empty((2, capacity))
        self.blocked = np.empty((2, capacity), np.uint8)
        self.struct = CStruct("Trees", column_count=nq, scratch=np.empty((6, nq)))
        self._point_to_arrays()

    @property
    def capacity(self) -> int:
        """Vertices of either tree there is room for."""
        return self.parents.shape[1]

    def enlarge(self) -> None:
        """Twice the room."""
        self.vertices = np.concatenate([self.vertices, np.empty_like(self.vertices)], axis=2)
        self.parents = np.concatenate([self.parents, np.empty_like(self.parents)], axis=1)
        self.lengths = np.concatenate([self.lengths, np.empty_like(self.lengths)], axis=1)
        self.blocked = np.concatenate([self.blocked, np.zeros_like(self.blocked)], axis=1)
        self.path = np.empty((2 * len(self.path), self.path.shape[1]))
        self._point_to_arrays()

    def _point_to_arrays(self) -> None:
        self.struct.set(capacity=self.capacity, path=self.path)
        for side, tree in enumerate(self.struct.value.sides):
            tree.vertices = address_of(self.vertices[side], "double")
            tree.parents = address_of(self.parents[side], "int64_t")
            tree.lengths = address_of(self.lengths[side], "double")
            tree.blocked = address_of(self.blocked[side], "uint8_t")


# Of trees that are no more; appending to it and popping from it are atomic.
_idle: deque[TreeMemory] = deque(maxlen=4)


def _take_memory(nq: int, capacity: int) -> TreeMemory:
    """Memory for two trees of `capacity` vertices each, reused where possible."""
    with suppress(IndexError):
        used = _idle.pop()
        if used.vertices.shape[1:] == (nq, capacity):
            return used
    return TreeMemory(nq, capacity)
