"""A probabilistic roadmap, one sample per step.

Kavraki, Svestka, Latombe, Overmars, "Probabilistic roadmaps for path planning in high-dimensional configuration
spaces", IEEE Trans. Robotics and Automation 12 (1996).
"""

from __future__ import annotations

import heapq

import numpy as np

from rr1plan.checks import Array, Seed, as_generator, positive_number, whole_number
from rr1plan.lessons.search.search_record import BLOCKED, EDGE, SAMPLE, SearchRecord, SearchRecorder, chain_to
from rr1plan.lessons.search.search_space import SearchSpace
from rr1plan.scene.problem import Problem


def grow_prm(
    problem: Problem, *, neighbors: int = 6, longest: float = 1.2, samples: int = 200, rng: Seed = 0
) -> SearchRecord:
    """PRM: free samples are connected to the nearest vertices by free edges; Dijkstra's algorithm finds the path.

    Start and goal are the first two vertices, so that the path gets shorter as the roadmap grows.

    Args:
        problem: One arm, a start, a joint goal.
        neighbors: Largest number of vertices to which a new one is connected.
        longest: Longest edge [rad or m].
        samples: Samples to draw.
        rng: Seed or generator.

    Raises:
        InputError: several arms, another goal, a start or goal that is not free, a joint without limits that does not
            wrap, or a number out of range.
    """
    neighbors = whole_number("neighbors", neighbors, 1, 100)
    longest, samples = positive_number("longest", longest), whole_number("samples", samples, 1, 5000)
    space, generator = SearchSpace(problem), as_generator(rng)
    note = SearchRecorder("PRM", space)
    graph: list[dict[int, float]] = []

    def connect(q: Array, side: int = 0) -> None:
        """Add a vertex, and edges to its nearest neighbors."""
        distances = space.distance(np.array(note.vertices), q) if graph else np.zeros(0)
        new = note.add_vertex(q, side=side)
        graph.append({})
        for v in np.argsort(distances, kind="stable")[:neighbors].tolist():
            if distances[v] <= longest and note.edge_is_free(v, q):
                note.add(EDGE, new, v)
                graph[new][v] = graph[v][new] = float(distances[v])
        chain = _shortest(graph, 0, 1) if len(graph) > 1 else []
        if chain:
            note.add_path(chain)

    connect(space.start)
    connect(space.goal, side=1)
    note.step()
    for _ in range(samples):
        q = space.sample(generator)
        note.add(SAMPLE, point=q)
        if not space.is_free(q):
            note.add(BLOCKED, point=q)
            note.step()
            continue
        connect(q)
        note.step()
    return note.record()


def _shortest(graph: list[dict[int, float]], start: int, goal: int) -> list[int]:
    """Dijkstra's algorithm: the vertices of a shortest path, none if there is no path."""
    costs, parents, queue, closed = {start: 0.0}, {start: -1}, [(0.0, start)], set()
    while queue:
        cost, v = heapq.heappop(queue)
        if v == goal:
            return chain_to(parents, v)
        if v in closed:
            continue
        closed.add(v)
        for w, length in graph[v].items():
            if cost + length < costs.get(w, np.inf):
                costs[w], parents[w] = cost + length, v
                heapq.heappush(queue, (cost + length, w))
    return []
