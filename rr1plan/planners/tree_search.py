"""RRT-Connect under the budget of a query: growth of two trees by `rrt_connect.c`."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from contextlib import suppress

import numpy as np

from rr1plan.checks import Array, counted
from rr1plan.collision import CollisionChecker
from rr1plan.errors import InputError
from rr1plan.kernels.planner_kernels import CStruct, address_of, constants, load_library
from rr1plan.kernels.random_state import RandomState, random_state
from rr1plan.planners.planning_query import NO_LIMIT, Pace, Query
from rr1plan.planning import SearchTree
from rr1plan.planning_constants import MARGINS, TREES

_SHORTEST = 1e-4  # smallest allowed step, as a share of the diagonal
_CAPACITY = 256  # initial capacity of each tree in vertices
_SLICE = 500  # samples before the first search for further goals; the number doubles for each later one
_PROOF = 8000  # samples before a proof is tried that there is no path, which takes a tenth of a second


SearchPause = Callable[[int], bool]
"""Called with the number of samples so far when a search has used many; returns whether to end it."""


class TreeSearch:
    """Searches for one query, each with fresh trees.

    Args:
        query: The query; its start, goals and budget are used.
        step: Longest edge of a tree [rad or m]; 0: a share of the diagonal of the joint space.

    Attributes:
        trees: Trees of the last search.
        state: State of the random numbers.

    Raises:
        InputError: a step too short, or a joint without limits.
    """

    def __init__(self, query: Query, step: float = 0.0) -> None:
        self.query = query
        diagonal = query.space.diagonal
        self._step, self._domain = step or TREES.step * diagonal, TREES.domain * diagonal
        if self._step < _SHORTEST * diagonal:
            raise InputError(f"range is {step:g}, expected at least {_SHORTEST * diagonal:.3g} for these joints")
        self.state = random_state(query.seed)
        self.trees = Trees(query.problem.start, query.goals)
        self._pace = Pace()
        self._slice = query.iterations + _SLICE

    def connect(self, bound: float = math.inf, samples: int = NO_LIMIT, *, pause: SearchPause | None = None) -> bool:
        """Grow new trees until they are connected, or a limit or the budget is reached. Returns whether they are.

        Args:
            bound: Longest path [rad or m] (inf: any).
            samples: Most samples.
            pause: Called after 16,000 samples, and whenever there are four times as many.
        """
        query, trees = self.query, self.trees
        trees.restart(query.space.lower, query.space.extent, self._step, self._domain, bound)
        begin = query.iterations
        last = begin + min(samples, query.most - begin)
        next_pause = NO_LIMIT if pause is None else begin + MARGINS.samples
        connected = proof_tried = False
        while not connected and query.iterations < last and query.in_time():
            stop = min(query.iterations + self._pace.next(), last)
            if bound == math.inf:
                if query.iterations >= self._slice:
                    # All known goals may be unreachable from the start.
                    self._slice = 2 * query.iterations
                    trees.add_goals(query.more_goals())
                    if query.iterations >= _PROOF and not proof_tried:
                        proof_tried = True
                        if query.prove_separated():
                            break
                stop = min(stop, self._slice)
            if pause is not None and query.iterations >= next_pause:
                next_pause *= MARGINS.growth
                if pause(query.iterations):
                    break
            stop = min(stop, next_pause)
            connected = trees.grow(self.state, stop - begin, query.motion)
            query.iterations = begin + trees.samples
        query.edges += trees.edges
        return connected

    def describe(self) -> str:
        """Message about the sizes of the last trees."""
        of_start, of_goal = self.trees.sizes
        were = "was" if of_start == 1 else "were"
        return f"{counted(of_start, 'configuration')} {were} reached from the start, {of_goal} from the goal"


class Trees:
    """The two trees of RRT-Connect.

    Args:
        start: Root of the start tree, shape (nq,).
        goals: Roots of the goal tree, shape (k, nq).

    Attributes:
        memory: The arrays of both trees.
    """

    def __init__(self, start: Array, goals: Array) -> None:
        self.memory = _take_memory(len(start), max(_CAPACITY, 2 * len(goals)))
        for side in self.memory.struct.value.sides:
            side.size = 0
        self._query = CStruct("TreeQuery", start=start, goals=goals, goal_count=len(goals))
        self._goals = goals
        self._call = load_library().rr1_grow_trees

    def __del__(self) -> None:
        """Release the memory for reuse, because page faults of new memory cost as much as an edge check."""
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
        """Numbers of vertices of the start tree and the goal tree."""
        one, two = self.memory.struct.value.sides
        return one.size, two.size

    def restart(self, lower: Array, extent: Array, step: float, domain: float, bound: float) -> None:
        """Reset both trees to their roots.

        Args:
            lower: Lower corner of the sampling box, shape (nq,).
            extent: Side lengths of the box, infinite for joints that wrap, shape (nq,).
            step: Longest edge of a tree [rad or m].
            domain: Sampling radius around vertices with a blocked edge [rad or m].
            bound: Longest path [rad or m] (inf: any).
        """
        self._query.set(lower=lower, extent=extent, step=step, domain=domain, bound=bound)
        trees = self.memory.struct.value
        trees.sides[0].size = trees.samples = trees.edges = 0

    def grow(self, state: RandomState, samples: int, motion: CollisionChecker) -> bool:
        """Grow until `samples` are drawn in all or the memory is full. Returns whether the trees are connected."""
        code = motion.run_edge_kernel(self._call, self.memory.struct, self._query, state, samples)
        if code == constants()["SEARCH_FULL"]:
            self.memory.enlarge()
        return bool(code == constants()["SEARCH_SOLVED"])

    def add_goals(self, goals: Array) -> None:
        """Add roots (k, nq) to the goal tree."""
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
        """Both trees, and the edge that connects them if `joined`."""
        memory, sizes = self.memory, self.sizes
        vertices = np.concatenate([memory.vertices[side, :, :size].T for side, size in enumerate(sizes)])
        edges = []
        for side, first in enumerate((0, sizes[0])):
            parents = memory.parents[side, : sizes[side]]
            children = np.flatnonzero(parents >= 0)
            edges.append(np.stack([parents[children], children], axis=1) + first)
        if joined:
            one, two = memory.struct.value.sides
            edges.append(np.array([[one.connection, two.connection + sizes[0]]]))
        return SearchTree(vertices, np.concatenate(edges).astype(np.int64))


class TreeMemory:
    """Arrays of two trees, and the kernel's struct of pointers to them."""

    def __init__(self, nq: int, capacity: int) -> None:
        self.vertices, self.path = np.empty((2, nq, capacity)), np.empty((2 * capacity, nq))
        self.parents, self.lengths = np.empty((2, capacity), np.int64), np.empty((2, capacity))
        self.blocked = np.empty((2, capacity), np.uint8)
        self.struct = CStruct("Trees", column_count=nq, scratch=np.empty((6, nq)))
        self._point_to_arrays()

    @property
    def capacity(self) -> int:
        """Capacity of either tree in vertices."""
        return self.parents.shape[1]

    def enlarge(self) -> None:
        """Double the capacity."""
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


# Memory of deleted trees; list.append and list.pop are atomic.
_idle: deque[TreeMemory] = deque(maxlen=4)


def _take_memory(nq: int, capacity: int) -> TreeMemory:
    """Memory for two trees of `capacity` vertices each, reused where possible."""
    with suppress(IndexError):
        used = _idle.pop()
        if used.vertices.shape[1:] == (nq, capacity):
            return used
    return TreeMemory(nq, capacity)
