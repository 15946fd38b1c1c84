"""Conflict-based search on the roadmaps of a few arms, in continuous time, with a bound on the sum of arrivals.

Each arm moves on its roadmap and stops at each vertex, where it may wait. The search branches on conflicts: one of two
arms must not do what it does at such times (Sharon et al., Conflict-based search for optimal multi-agent pathfinding,
2015; in continuous time: Andreychuk et al., Multi-agent pathfinding with continuous time, 2019). Two actions conflict
as certified coordination diagrams say, at no resolution in time. Each pair of constraints excludes only pairs of
actions that conflict, so no solution is lost; in particular, constraints on waiting are chosen such that every time
they exclude conflicts with every departure that the other one excludes.

Of all nodes whose cost is at most `suboptimality` times the least cost in the queue, that with the fewest conflicts is
expanded (Barer et al., Suboptimal variants of the conflict-based search algorithm, 2014, with a bound on the high
level). The least cost in the queue is a lower bound of the sum of arrivals on these roadmaps.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from heapq import heappop, heappush
from itertools import combinations

from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.search.arm_roadmap import ArmRoadmap
from rr1plan.multi.search.relative_conflicts import Action, Conflict, RelativeConflicts
from rr1plan.multi.search.roadmap_search import Constraint, Departure, Move, Presence, Settling, earliest_moves
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.multi.timing.schedule import Leg, Schedule

_INSTANT = 1e-6  # [s]
# A departure is put off until the conflict with rest that ends is this short, then by half of it [s].
_SHORT_REST = 1e-3
_MOST_NODES = 20_000


@dataclass
class SearchResult:
    """The result of a search.

    Args:
        moves: The moves of each arm on its roadmap; None if none were found.
        cost: Sum of the arrivals [s].
        lower_bound: No motion on these roadmaps has a lower one [s]; inf if there is none on them.
        nodes: Nodes that were expanded.
    """

    moves: dict[str, list[Move]] | None
    cost: float
    lower_bound: float
    nodes: int

    @property
    def suboptimality(self) -> float:
        """The cost is at most this multiple of the least on the roadmaps."""
        return max(1.0, self.cost / self.lower_bound) if self.lower_bound > 0.0 else 1.0


@dataclass
class _Node:
    constraints: dict[str, tuple[Constraint, ...]]
    moves: dict[str, list[Move]]
    cost: float
    conflicts: dict[tuple[str, str], list[tuple[Action, Action, Conflict]]] = field(default_factory=dict)

    @property
    def count(self) -> int:
        return sum(len(found) for found in self.conflicts.values())

    def first_conflict(self) -> tuple[str, str, Action, Action, Conflict]:
        """The earliest one; those with an arm that rests for a while come last, because they exclude the least time."""
        found = [(pair, *each) for pair, several in self.conflicts.items() for each in several]
        (one, two), a, b, conflict = min(found, key=lambda item: (_rests(item[1]) or _rests(item[2]), item[3].begin))
        return one, two, a, b, conflict


class _Queue:
    """Nodes that are still to be expanded, those within the bound by their number of conflicts.

    Attributes:
        least: No solution costs less [s].
    """

    def __init__(self, suboptimality: float) -> None:
        self.least = 0.0
        self._suboptimality = suboptimality
        self._nodes: dict[int, _Node] = {}
        self._by_cost: list[tuple[float, int]] = []
        self._within: list[tuple[int, float, int]] = []
        self._beyond: list[tuple[float, int]] = []
        self._count = 0

    def push(self, node: _Node) -> None:
        self._count += 1
        self._nodes[self._count] = node
        heappush(self._by_cost, (node.cost, self._count))
        heappush(self._beyond, (node.cost, self._count))

    def pop(self) -> _Node | None:
        """The node with the fewest conflicts within the bound; None if there are no nodes."""
        while self._by_cost and self._by_cost[0][1] not in self._nodes:
            heappop(self._by_cost)
        if not self._by_cost:
            return None
        self.least = max(self.least, self._by_cost[0][0])
        while self._beyond and self._beyond[0][0] <= self._suboptimality * self.least:
            cost, number = heappop(self._beyond)
            heappush(self._within, (self._nodes[number].count, cost, number))
        return self._nodes.pop(heappop(self._within)[2])


class ConflictBasedSearch:
    """A search for the motions of a few arms on their roadmaps.

    Args:
        roadmaps: The roadmap of each arm.
        near: Of each arm those that it can meet.
        conflicts: When paths of these arms conflict.
        watch: Says when to give up.
        suboptimality: The sum of arrivals may be this multiple of the least on the roadmaps, at least 1.
    """

    def __init__(
        self,
        roadmaps: Mapping[str, ArmRoadmap],
        near: Mapping[str, frozenset[str]],
        conflicts: RelativeConflicts,
        watch: Stopwatch,
        suboptimality: float,
    ) -> None:
        self._roadmaps, self._conflicts, self._watch = roadmaps, conflicts, watch
        self._pairs = [(a, b) for a, b in combinations(roadmaps, 2) if b in near[a]]
        self._suboptimality = suboptimality

    def run(self, most_nodes: int = _MOST_NODES) -> SearchResult:
        """Search until the arms do not conflict, or time or nodes run out.

        Args:
            most_nodes: Nodes to expand, at most.
        """
        root = self._root()
        if root is None:
            return SearchResult(None, math.inf, math.inf, 0)
        queue, expanded = _Queue(self._suboptimality), 0
        queue.push(root)
        while expanded < most_nodes and self._watch.goes_on():
            node = queue.pop()
            if node is None:
                return SearchResult(None, math.inf, math.inf, expanded)
            if node.count == 0:
                return SearchResult(node.moves, node.cost, queue.least, expanded)
            expanded += 1
            for arm, constraint in self._branches(node):
                child = self._child(node, arm, constraint)
                if child is not None:
                    queue.push(child)
        return SearchResult(None, math.inf, queue.least, expanded)

    def _root(self) -> _Node | None:
        moves: dict[str, list[Move]] = {}
        for arm, roadmap in self._roadmaps.items():
            found = earliest_moves(roadmap, ())
            if found is None:
                return None
            moves[arm] = found
        root = _Node(dict.fromkeys(self._roadmaps, ()), moves, sum(map(_arrival, moves.values())))
        root.conflicts = {pair: self._conflicts_of(root.moves, *pair) for pair in self._pairs}
        return root

    def _child(self, node: _Node, arm: str, constraint: Constraint) -> _Node | None:
        constraints = (*node.constraints[arm], constraint)
        found = earliest_moves(self._roadmaps[arm], constraints)
        if found is None:
            return None
        moves = {**node.moves, arm: found}
        child = _Node({**node.constraints, arm: constraints}, moves, sum(map(_arrival, moves.values())))
        child.conflicts = {
            pair: self._conflicts_of(moves, *pair) if arm in pair else known for pair, known in node.conflicts.items()
        }
        return child

    def _conflicts_of(
        self, moves: Mapping[str, list[Move]], one: str, two: str
    ) -> list[tuple[Action, Action, Conflict]]:
        found = []
        others = actions_of(self._roadmaps[two], moves[two])
        for a in actions_of(self._roadmaps[one], moves[one]):
            for b in others:
                conflict = self._conflicts.between(a, b) if a.begin < b.end and b.begin < a.end else None
                if conflict is not None:
                    found.append((a, b, conflict))
        return found

    def _branches(self, node: _Node) -> list[tuple[str, Constraint]]:
        """Two constraints of which every solution keeps one."""
        one, two, a, b, conflict = node.first_conflict()
        low, high = conflict.low, conflict.high
        if a.moves and b.moves:
            return [
                (one, Departure(self._edge(one, a), a.begin, b.begin + high)),
                (two, Departure(self._edge(two, b), b.begin, a.begin - low)),
            ]
        if not a.moves and not b.moves:
            return [
                (arm, Presence(self._edge(arm, action)[0], conflict.begin, conflict.begin + _INSTANT))
                for arm, action in ((one, a), (two, b))
            ]
        if b.moves:
            # The same with the roles exchanged.
            one, two, a, b, low, high = two, one, b, a, -high, -low
        # The mover is in the way of who rests at times from t - high to t - low, if it departs at t.
        edge, place = self._edge(one, a), self._edge(two, b)[0]
        if math.isinf(b.end):
            # However late it departs, who has come for good before is in its way.
            return [(one, Departure(edge, a.begin, math.inf)), (two, Settling(a.begin - low))]
        overlap = conflict.end - (a.begin - high)
        delay = overlap - min(_SHORT_REST, 0.5 * overlap)
        return [
            (one, Departure(edge, a.begin, a.begin + delay)),
            (two, Presence(place, a.begin - high + delay, a.begin - low)),
        ]

    def _edge(self, arm: str, action: Action) -> tuple[int, int]:
        return self._roadmaps[arm].ends(action.path)


def _rests(action: Action) -> bool:
    return not action.moves and math.isfinite(action.end)


def _arrival(moves: Sequence[Move]) -> float:
    return moves[-1].arrival if moves else 0.0


def actions_of(roadmap: ArmRoadmap, moves: Sequence[Move]) -> list[Action]:
    """All actions of an arm, rests included, until infinity.

    Args:
        roadmap: Its roadmap.
        moves: Its moves.
    """
    actions, now, vertex = [], 0.0, roadmap.start
    for move in moves:
        if move.departure > now:
            actions.append(Action(roadmap.move(vertex, vertex), now, move.departure))
        actions.append(Action(roadmap.move(move.begin, move.end), move.departure, move.arrival))
        now, vertex = move.arrival, move.end
    return [*actions, Action(roadmap.move(vertex, vertex), now, math.inf)]


def schedule_of(roadmap: ArmRoadmap, moves: Sequence[Move]) -> Schedule:
    """The moves of an arm as a schedule on one path, which stops at each vertex.

    Args:
        roadmap: Its roadmap.
        moves: Its moves.
    """
    if not moves:
        return Schedule(roadmap.move(roadmap.start, roadmap.start), ())
    parts = [roadmap.move(move.begin, move.end) for move in moves]
    path, legs, gridpoint = AgentPath.chained(parts), [], 0
    for move, part in zip(moves, parts, strict=True):
        legs.append(Leg(move.departure, gridpoint, gridpoint + part.segments))
        gridpoint += part.segments
    return Schedule(path, tuple(legs))
