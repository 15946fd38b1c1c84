"""The roadmap of one arm, including its start and goals: certified edges, each a motion from rest to rest."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise

import numpy as np

from rr1plan.checks import Array
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.errors import RetimingError
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.object_cache import kept_in
from rr1plan.path import Path
from rr1plan.planners.roadmap_graph import Graph
from rr1plan.planning import SearchTree
from rr1plan.retiming.path_blends import clean
from rr1plan.retiming.path_speed import line_rates

_NEIGHBORS = 8  # nearest vertices to which the start, the goals and inserted waypoints are connected
_START = 0


class ArmRoadmap:
    """A roadmap on which an arm moves, with a stop at each vertex.

    Args:
        agent: The arm.
        vertices: Free configurations, the start first, shape (n, nq).
        edges: Pairs of vertices between which the straight line is certified.
        goals: The vertices at one of which the motion ends.

    Attributes:
        to_goal: Lower bound of the duration from each vertex to a goal [s], inf if there is no motion, shape (n,).
    """

    start = _START

    def __init__(
        self, agent: Agent, vertices: Array, edges: Iterable[tuple[int, int]], goals: Iterable[int] = (1,)
    ) -> None:
        self.agent, self.vertices, self.goals = agent, vertices, frozenset(goals)
        self.neighbors: list[list[int]] = [[] for _ in vertices]
        for a, b in edges:
            self.neighbors[a].append(b)
            self.neighbors[b].append(a)
        self._moves: dict[tuple[int, int], AgentPath] = {}
        self._ends: dict[AgentPath, tuple[int, int]] = {}
        self._durations: dict[tuple[int, int], float] = {}
        self.to_goal = self._bounds()

    def __len__(self) -> int:
        """Number of vertices."""
        return len(self.vertices)

    def move(self, begin: int, end: int) -> AgentPath:
        """The path of an edge, from rest to rest; of zero length from a vertex to itself, where the arm rests."""
        key = begin, end
        if key not in self._moves:
            points = self.vertices[[begin, end] if begin != end else [begin]]
            self._moves[key] = AgentPath(self.agent, Path(self.agent.joint_names, points), None)
            self._ends[self._moves[key]] = key
        return self._moves[key]

    def duration(self, begin: int, end: int) -> float:
        """Duration of an edge from rest to rest [s]; inf if it cannot be timed under the limits."""
        key = begin, end
        if key not in self._durations:
            try:
                self._durations[key] = self.move(begin, end).fastest
            except RetimingError:
                self._durations[key] = math.inf
        return self._durations[key]

    def ends(self, path: AgentPath) -> tuple[int, int]:
        """The vertices of a path from `move`."""
        return self._ends[path]

    def _bounds(self) -> Array:
        """Durations by Dijkstra's algorithm from the goals, of motions limited only in velocity and acceleration."""
        bounds = np.full(len(self.vertices), math.inf)
        queue = [(0.0, goal) for goal in sorted(self.goals)]
        while queue:
            bound, vertex = heapq.heappop(queue)
            if bound >= bounds[vertex]:
                continue
            bounds[vertex] = bound
            others = [other for other in self.neighbors[vertex] if math.isinf(bounds[other])]
            for other, duration in zip(others, self._least_durations(vertex, others).tolist(), strict=True):
                heapq.heappush(queue, (bound + duration, other))
        return bounds

    def _least_durations(self, one: int, others: list[int]) -> Array:
        """Lower bounds of the durations of straight lines from rest to rest [s], shape (others,)."""
        delta = self.vertices[others] - self.vertices[one]
        length = np.linalg.norm(delta, axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            speed, acceleration, _ = line_rates(delta / length[:, None], self.agent.limits)
            is_ramp = speed * speed >= length * acceleration
            durations = np.where(is_ramp, 2.0 * np.sqrt(length / acceleration), length / speed + speed / acceleration)
        return np.where(length == 0.0, 0.0, durations)


def build_roadmap(
    agent: Agent,
    goals: Array,
    margin: float,
    samples: int,
    known_paths: Sequence[Array] = (),
    goes_on: Callable[[], bool] = lambda: True,
) -> ArmRoadmap | None:
    """A roadmap for an arm; samples and their candidate edges are cached with the scene.

    Args:
        agent: The arm.
        goals: Its goal configurations, shape (k, nq).
        margin: Distance to keep from stationary objects in addition to the padding [m].
        samples: Number of samples of the roadmap.
        known_paths: Free paths from the start to the first goal to include, waypoints of shape (m, nq) each.
        goes_on: Called often; False stops.

    Returns:
        The roadmap, or None if stopped.
    """
    # Paths merge points as near as this to the start, so the arm rests there.
    rests = np.array([len(clean(np.stack([agent.start, goal]))) == 1 for goal in goals])
    ends = np.where(rests, _START, np.cumsum(~rests)).tolist()
    query = agent.query({}, margin)
    with checker_from_pool(query.scene, query.arms, margin) as checker:

        def sampled() -> SearchTree | None:
            graph = Graph(query.scene, query.arms)
            graph.sample(samples, checker, goes_on)
            return graph.picture() if graph.samples == samples else None

        key = ("roadmap of an arm", agent.arms, margin, samples)
        tree = kept_in(query.scene.kept, key, sampled)
        if tree is None:
            del query.scene.kept[key]
            return None
        inner = [points[1:-1] for points in known_paths]
        vertices = np.vstack([agent.start, goals[~rests], *inner, tree.vertices])
        first = len(vertices) - len(tree.vertices)
        candidates = {(int(a) + first, int(b) + first) for a, b in np.sort(tree.edges, axis=1)}
        for row in range(first):
            distance = np.linalg.norm(vertices - vertices[row], axis=1)
            distance[row] = math.inf
            for other in np.argsort(distance, kind="stable")[:_NEIGHBORS].tolist():
                candidates.add((min(row, other), max(row, other)))
        candidates |= {(_START, end) for end in ends}
        row = 1 + int(np.count_nonzero(~rests))
        for points in inner:
            chain = [_START, *range(row, row + len(points)), ends[0]]
            candidates |= {(min(a, b), max(a, b)) for a, b in pairwise(chain)}
            row += len(points)
        edges = []
        for a, b in sorted(candidates):
            if not goes_on():
                return None
            if (vertices[a] != vertices[b]).any() and checker.edge_is_free(vertices[a], vertices[b]):
                edges.append((a, b))
    return ArmRoadmap(agent, vertices, edges, ends)
