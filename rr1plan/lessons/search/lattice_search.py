"""A* and Dijkstra's algorithm on a regular lattice of configurations.

Hart, Nilsson, Raphael, "A formal basis for the heuristic determination of minimum cost paths", IEEE Trans. Systems
Science and Cybernetics 4 (1968). LaValle, "Planning Algorithms" (2006), 2.2.
"""

from __future__ import annotations

import heapq
from itertools import product

import numpy as np

from rr1plan.checks import Array, number_from_zero, whole_number
from rr1plan.lessons.search.search_record import CLOSED, PARENT, SearchRecord, SearchRecorder, chain_to
from rr1plan.lessons.search.search_space import SearchSpace
from rr1plan.scene.problem import Problem

Index = tuple[int, ...]
_GOAL: Index = ()  # the goal is a vertex that is not on the lattice


def search_lattice(problem: Problem, *, cells: int = 36, weight: float = 1.0) -> SearchRecord:
    """Search a lattice through the start, whose points have 3^nq - 1 neighbors; one step closes one vertex.

    The goal is an additional vertex, connected to the lattice points around it. The path is a shortest one on this
    graph if `weight` is at most 1.

    Args:
        problem: One arm, a start, a joint goal.
        cells: Lattice points along each joint, 4 to 120.
        weight: 0: Dijkstra's algorithm. 1: A*, with the distance to the goal as the heuristic. Above 1: more directed
            toward the goal; the path is at most `weight` times as long as a shortest one.

    Raises:
        InputError: several arms, another goal, a start or goal that is not free, a joint without limits that does not
            wrap, or a number out of range.
    """
    cells, weight = whole_number("cells", cells, 4, 120), number_from_zero("weight", weight)
    space = SearchSpace(problem)
    note = SearchRecorder("Dijkstra" if weight == 0.0 else "A*" if weight == 1.0 else f"A* × {weight:g}", space)
    lattice = Lattice(space, cells)
    origin: Index = (0,) * len(space.start)
    numbers, indices = {origin: note.add_vertex(space.start)}, [origin]
    costs, parents, closed = [0.0], [-1], set()
    queue = [(weight * float(space.distance(space.start, space.goal)), 0.0, 0)]
    while queue:
        _, _, v = heapq.heappop(queue)
        if v in closed:
            continue
        closed.add(v)
        note.add(CLOSED, v)
        if indices[v] == _GOAL:
            note.add_path(chain_to(parents, v))
            note.step()
            break
        for index, q in lattice.neighbors(indices[v]):
            cost, w = costs[v] + float(space.distance(note.vertices[v], q)), numbers.get(index)
            known = w is not None and (w in closed or cost >= costs[w] - 1e-12)
            if known or not note.edge_is_free(v, q):
                continue
            if w is None:
                w = numbers[index] = note.add_vertex(q, v)
                indices.append(index)
                costs.append(cost)
                parents.append(v)
            else:
                costs[w], parents[w] = cost, v
                note.add(PARENT, w, v)
            # Among equal estimates the vertex with the larger cost so far is closed first.
            heapq.heappush(queue, (cost + weight * float(space.distance(q, space.goal)), -cost, w))
        note.step()
    return note.record()


class Lattice:
    """Points start + index * size within the limits, and the goal.

    Args:
        space: The joint space.
        cells: Points along each joint.
    """

    def __init__(self, space: SearchSpace, cells: int) -> None:
        self.space, self.cells = space, cells
        self.size = (space.upper - space.lower) / cells
        self.moves = [np.array(move) for move in product((-1, 0, 1), repeat=len(self.size)) if any(move)]

    def place(self, index: Index) -> Array:
        """The configuration of an index."""
        return self.space.wrapped(self.space.start + np.array(index) * self.size)

    def neighbors(self, index: Index) -> list[tuple[Index, Array]]:
        """The points one step away, also diagonally, and the goal if it is not farther than that."""
        found = []
        for move in self.moves:
            moved = np.array(index) + move
            other = tuple(int(i) for i in np.where(self.space.wraps, moved % self.cells, moved))
            q = self.place(other)
            if (q >= self.space.lower).all() and (q <= self.space.upper).all():
                found.append((other, q))
        if (np.abs(self.space.difference(self.place(index), self.space.goal)) <= self.size).all():
            found.append((_GOAL, self.space.goal))
        return found
