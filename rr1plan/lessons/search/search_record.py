"""A record of a search, step by step: the events that a lecture shows one after the other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rr1plan.checks import Array, Value, read_only
from rr1plan.lessons.search.search_space import SearchSpace
from rr1plan.path import edge_lengths

SAMPLE, BLOCKED, REFUSED, VERTEX, EDGE, PARENT, CLOSED, FOUND = (
    "sample",
    "blocked",
    "refused",
    "vertex",
    "edge",
    "parent",
    "closed",
    "found",
)
EVENTS = (SAMPLE, BLOCKED, REFUSED, VERTEX, EDGE, PARENT, CLOSED, FOUND)
"""Kinds of events, see `SearchEvent`."""


class SearchEvent(NamedTuple):
    """One event of a search, by its kind.

    - sample: `point` was drawn;
    - blocked: `point` is in collision and rejected;
    - refused: the edge from `vertex` to `point` is not free and rejected;
    - vertex: `vertex` is new, connected to `parent` (-1: a root);
    - edge: `vertex` and `parent` are connected by another edge of a roadmap;
    - parent: `vertex` is cheaper via `parent`, which replaces its previous parent;
    - closed: the cost of `vertex` is final, and its neighbors are examined;
    - found: a path to the goal, cheaper than those before.
    """

    kind: str
    vertex: int = -1
    parent: int = -1
    point: Array | None = None


@dataclass(frozen=True, eq=False, repr=False)
class SearchRecord(Value):
    """A search with all its events.

    Args:
        planner: Its name.
        vertices: Configurations of the tree, roadmap or lattice [rad or m], shape (n, nq).
        sides: 0 for vertices of the start's tree (or of the only one), 1 for the goal's, shape (n,).
        steps: The events of each step.
        edges_checked: Number of edges checked at the end of each step, shape (steps,).
        costs: Length of the best path at the end of each step, infinite before the first [rad], shape (steps,).
        paths: The paths found, each shorter than the previous one: (step, configurations (k, nq)).
    """

    planner: str
    vertices: Array
    sides: Array
    steps: tuple[tuple[SearchEvent, ...], ...]
    edges_checked: Array
    costs: Array
    paths: tuple[tuple[int, Array], ...]

    def __repr__(self) -> str:
        outcome = f"path of {self.cost:.2f} rad" if self.found else "no path"
        return f"SearchRecord({self.planner}, {len(self.steps)} steps, {len(self.vertices)} vertices, {outcome})"

    @property
    def found(self) -> bool:
        """There is a path."""
        return bool(self.paths)

    @property
    def path(self) -> Array | None:
        """The best path, continuous across the seams [rad or m], shape (k, nq); None without one."""
        return self.paths[-1][1] if self.paths else None

    @property
    def cost(self) -> float:
        """Length of the best path [rad], infinite without one."""
        return float(self.costs[-1]) if len(self.costs) else np.inf

    def count(self, *kinds: str) -> int:
        """Number of events of some kinds."""
        return sum(event.kind in kinds for step in self.steps for event in step)


class SearchRecorder:
    """Collects the events of a search; `step()` ends a step, `record()` the search."""

    def __init__(self, planner: str, space: SearchSpace) -> None:
        self.planner, self.space = planner, space
        self.vertices: list[Array] = []
        self.sides: list[int] = []
        self.best = np.inf
        self._events: list[SearchEvent] = []
        self._steps: list[tuple[SearchEvent, ...]] = []
        self._checks: list[int] = []
        self._costs: list[float] = []
        self._paths: list[tuple[int, Array]] = []
        self._before = space.edges_checked

    def add(self, kind: str, vertex: int = -1, parent: int = -1, point: Array | None = None) -> None:
        """Record an event."""
        self._events.append(SearchEvent(kind, vertex, parent, None if point is None else read_only(np.array(point))))

    def add_vertex(self, q: Array, parent: int = -1, side: int = 0) -> int:
        """Record a new vertex and return its number."""
        self.vertices.append(np.array(q))
        self.sides.append(side)
        self.add(VERTEX, len(self.vertices) - 1, parent)
        return len(self.vertices) - 1

    def edge_is_free(self, vertex: int, q: Array) -> bool:
        """Check the edge from a vertex to a configuration; a rejected one is recorded."""
        free = self.space.edge_is_free(self.vertices[vertex], q)
        if not free:
            self.add(REFUSED, vertex, point=q)
        return free

    def add_path(self, vertices: Sequence[int]) -> None:
        """Record a path over vertices if it is shorter than the best one so far."""
        points = self.space.unwrapped(np.array([self.vertices[v] for v in vertices]))
        length = float(edge_lengths(points).sum())
        if length < self.best - 1e-9:
            self.best = length
            self._paths.append((len(self._steps), read_only(points)))
            self.add(FOUND)

    def step(self) -> None:
        """Close a step."""
        self._steps.append(tuple(self._events))
        self._events = []
        self._checks.append(self.space.edges_checked - self._before)
        self._costs.append(self.best)

    def record(self) -> SearchRecord:
        """Everything, as a value."""
        return SearchRecord(
            self.planner,
            read_only(np.array(self.vertices)),
            read_only(np.array(self.sides)),
            tuple(self._steps),
            read_only(np.array(self._checks)),
            read_only(np.array(self._costs)),
            tuple(self._paths),
        )


def chain_to(parents: Sequence[int] | Mapping[int, int], vertex: int) -> list[int]:
    """The vertices from the root, whose parent is -1, to one."""
    chain = [vertex]
    while parents[chain[-1]] >= 0:
        chain.append(parents[chain[-1]])
    return chain[::-1]
