"""Conflict-based search on the roadmaps of a few arms, in continuous time, with a bound on the sum of arrivals.

Each arm moves on its roadmap and stops at each vertex, where it may wait. The search branches on conflicts: one of the
two arms is forbidden its action at the times of the conflict (Sharon et al., Conflict-based search for optimal
multi-agent pathfinding, 2015; in continuous time: Andreychuk et al., Multi-agent pathfinding with continuous time,
2019). Certified coordination diagrams determine conflicts of two actions, without sampling of time. Each pair of
constraints excludes only pairs of actions that conflict, so no solution is lost; in particular, constraints on waiting
are chosen such that each excluded time of waiting is in conflict with each departure that the other constraint
excludes.

Among all nodes whose cost is at most `suboptimality` times the lower bound, the node with the fewest conflicts is
expanded (Barer et al., Suboptimal variants of the conflict-based search algorithm, 2014, with a bound on the high
level). Its moves are first replaced by those of a child, without the child's constraint, as long as this removes
conflicts within the bound (a bypass: Boyarski et al., Don't split, try to work it out, 2015); then the node is split at
the conflict that raises the bound of both children most, a cardinal conflict if there is one (Boyarski et al., ICBS,
2015). A node stores the earliest arrival of each arm under its constraints together with the moves; the minimum sum of
these arrivals in the queue is a lower bound of the sum of arrivals on these roadmaps.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from heapq import heappop, heappush
from itertools import combinations
from typing import TypeVar

from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.search.arm_roadmap import ArmRoadmap
from rr1plan.multi.search.relative_conflicts import Action, Conflict, RelativeConflicts
from rr1plan.multi.search.roadmap_search import Constraint, Departure, Move, Presence, Settling, earliest_moves
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.multi.timing.schedule import Leg, Schedule

_INSTANT = 1e-6  # [s]
# A departure is delayed until the conflict with a finite rest is this short, then by half of it [s].
_SHORT_REST = 1e-3
_MOST_NODES = 20_000
# Number of conflicts of a node among which one is chosen.
_MOST_CONFLICTS = 4


@dataclass
class SearchResult:
    """The result of a search.

    Args:
        moves: The moves of each arm on its roadmap; None if none were found.
        cost: Sum of the arrivals [s].
        lower_bound: Lower bound of the cost of all plans on these roadmaps [s]; inf if there is none.
        nodes: Number of expanded nodes.
    """

    moves: dict[str, list[Move]] | None
    cost: float
    lower_bound: float
    nodes: int

    @property
    def suboptimality(self) -> float:
        """Proven bound of the ratio of the cost to the minimum on the roadmaps."""
        return max(1.0, self.cost / self.lower_bound) if self.lower_bound > 0.0 else 1.0


_Conflicts = dict[tuple[str, str], list[tuple[Action, Action, Conflict]]]


@dataclass
class _Node:
    """Constraints, and moves that satisfy them.

    Args:
        constraints: The constraints of each arm.
        best: The earliest moves of each arm under its constraints.
        moves: Moves of each arm that satisfy the constraints; some may be later than `best`, with fewer conflicts.
        conflicts: Conflicts of `moves`, by pairs of arms.
    """

    constraints: dict[str, tuple[Constraint, ...]]
    best: dict[str, list[Move]]
    moves: dict[str, list[Move]]
    conflicts: _Conflicts = field(default_factory=dict)

    @property
    def bound(self) -> float:
        """Lower bound of the cost of all moves that satisfy the constraints [s]."""
        return math.fsum(map(_arrival, self.best.values()))

    @property
    def cost(self) -> float:
        """Sum of the arrivals [s]."""
        return math.fsum(map(_arrival, self.moves.values()))

    @property
    def count(self) -> int:
        """Number of conflicts."""
        return sum(len(found) for found in self.conflicts.values())

    def first_conflicts(self, most: int) -> list[tuple[str, str, Action, Action, Conflict]]:
        """The earliest conflicts; conflicts with a finite rest come last, because they exclude the least time.

        Args:
            most: Largest number of conflicts.
        """
        found = [(*pair, *each) for pair, several in self.conflicts.items() for each in several]
        return sorted(found, key=lambda item: (_rests(item[2]) or _rests(item[3]), item[4].begin))[:most]


_Entry = TypeVar("_Entry", tuple[float, int], tuple[int, float, int])


class _Queue:
    """Nodes to be expanded; within the suboptimality bound, nodes with fewer conflicts come first.

    Attributes:
        least: Lower bound of the cost of all solutions [s].
    """

    def __init__(self, suboptimality: float) -> None:
        self.least = 0.0
        self._suboptimality = suboptimality
        self._nodes: dict[int, _Node] = {}
        self._by_bound: list[tuple[float, int]] = []
        self._within: list[tuple[int, float, int]] = []
        self._beyond: list[tuple[float, int]] = []
        self._count = 0

    def push(self, node: _Node) -> None:
        self._count += 1
        self._nodes[self._count] = node
        heappush(self._by_bound, (node.bound, self._count))
        heappush(self._beyond, (node.cost, self._count))

    def pop(self) -> _Node | None:
        """The node with the fewest conflicts within the bound, else that with the lowest bound; None if empty."""
        self._forget_popped(self._by_bound)
        if not self._by_bound:
            return None
        self.least = max(self.least, self._by_bound[0][0])
        while self._beyond and self._beyond[0][0] <= self.most:
            cost, number = heappop(self._beyond)
            if number in self._nodes:
                heappush(self._within, (self._nodes[number].count, cost, number))
        self._forget_popped(self._within)
        number = self._within[0][2] if self._within else self._by_bound[0][1]
        return self._nodes.pop(number)

    @property
    def most(self) -> float:
        """Largest cost of a solution [s]."""
        return self._suboptimality * self.least

    def _forget_popped(self, heap: list[_Entry]) -> None:
        while heap and heap[0][-1] not in self._nodes:
            heappop(heap)


class ConflictBasedSearch:
    """A search for the motions of a few arms on their roadmaps.

    Args:
        roadmaps: The roadmap of each arm.
        near: For each arm, the arms that it can touch.
        conflicts: Conflicts between paths of these arms.
        watch: Deadline.
        suboptimality: Largest ratio of the sum of arrivals to the minimum on the roadmaps, at least 1.
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

    def run(self, most_nodes: int = _MOST_NODES, known_cost: float = math.inf) -> SearchResult:
        """Search until the arms do not conflict, a known plan is within the bound, or time or nodes run out.

        Args:
            most_nodes: Nodes to expand, at most.
            known_cost: Sum of the arrivals of a known plan [s]; inf if there is none.
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
            if known_cost <= queue.most:
                break
            if node.cost > queue.most:
                # Its moves include later ones from ancestors; the earliest moves are within the bound.
                self._use(node, node.best)
            children = self._children(node, queue.most) if node.count else []
            if node.count == 0:
                return SearchResult(node.moves, node.cost, queue.least, expanded)
            expanded += 1
            for child in children:
                queue.push(child)
        return SearchResult(None, math.inf, queue.least, expanded)

    def _root(self) -> _Node | None:
        moves: dict[str, list[Move]] = {}
        for arm, roadmap in self._roadmaps.items():
            found = earliest_moves(roadmap, (), self._watch.goes_on)
            if found is None:
                return None
            moves[arm] = found
        root = _Node(dict.fromkeys(self._roadmaps, ()), moves, {})
        self._use(root, moves)
        return root

    def _use(self, node: _Node, moves: Mapping[str, list[Move]]) -> None:
        """Replace the moves of a node by others that satisfy its constraints."""
        changed = {arm for arm, own in moves.items() if node.moves.get(arm) is not own}
        node.moves = dict(moves)
        node.conflicts = {
            pair: self._conflicts_of(moves, *pair) if changed.intersection(pair) else node.conflicts[pair]
            for pair in self._pairs
        }

    def _children(self, node: _Node, most: float) -> list[_Node]:
        """The node's children at the conflict that raises their bounds most, after bypassing conflicts.

        Args:
            node: The node; bypasses may leave it without conflicts.
            most: Largest cost of a bypass [s].
        """
        replanned: dict[tuple[str, Constraint], list[Move] | None] = {}
        while node.count and self._watch.goes_on():
            best: tuple[float, list[_Node]] = (-1.0, [])
            for conflict in node.first_conflicts(_MOST_CONFLICTS):
                children = [self._child(node, *branch, replanned) for branch in self._branches(*conflict)]
                if not self._watch.goes_on():
                    return []  # searches for children may have been cut short
                found = [child for child in children if child is not None]
                bypass = min(found, key=lambda child: child.count, default=node)
                if bypass.count < node.count and bypass.cost <= most:
                    node.moves, node.conflicts = bypass.moves, bypass.conflicts
                    break
                gain = min((child.bound for child in found), default=math.inf) if len(found) == 2 else math.inf
                if gain > best[0]:
                    best = gain, found
            else:
                return best[1]
        return []

    def _child(
        self, node: _Node, arm: str, constraint: Constraint, replanned: dict[tuple[str, Constraint], list[Move] | None]
    ) -> _Node | None:
        """The node with one more constraint; None if the arm then has no moves.

        Args:
            node: The node.
            arm: The constrained arm.
            constraint: The constraint.
            replanned: Cached moves of arms under one more constraint than those of the node.
        """
        constraints = (*node.constraints[arm], constraint)
        if (arm, constraint) not in replanned:
            replanned[arm, constraint] = earliest_moves(self._roadmaps[arm], constraints, self._watch.goes_on)
        found = replanned[arm, constraint]
        if found is None:
            return None
        child = _Node({**node.constraints, arm: constraints}, {**node.best, arm: found}, node.moves, node.conflicts)
        self._use(child, {**node.moves, arm: found})
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

    def _branches(self, one: str, two: str, a: Action, b: Action, conflict: Conflict) -> list[tuple[str, Constraint]]:
        """Two constraints such that every solution satisfies at least one."""
        low, high = conflict.low, conflict.high
        if a.moves and b.moves:
            return [
                (one, Departure(self._edge(one, a), a.begin, b.begin + high)),
                (two, Departure(self._edge(two, b), b.begin, a.begin - low)),
            ]
        if not a.moves and not b.moves:
            rests = [(arm, self._edge(arm, action)[0]) for arm, action in ((one, a), (two, b))]
            if math.isinf(conflict.end):
                # The goals exclude each other.
                return [(arm, Settling(place, math.inf)) for arm, place in rests]
            return [(arm, Presence(place, conflict.begin, conflict.begin + _INSTANT)) for arm, place in rests]
        if b.moves:
            # Exchange the roles, so that `one` moves and `two` rests.
            one, two, a, b, low, high = two, one, b, a, -high, -low
        # If the moving arm departs at t, it conflicts with the resting arm from t - high to t - low.
        edge, place = self._edge(one, a), self._edge(two, b)[0]
        if math.isinf(b.end):
            # The other arm stays at its goal: every later departure conflicts with it.
            return [(one, Departure(edge, a.begin, math.inf)), (two, Settling(place, a.begin - low))]
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
    """All actions of an arm, including rests; the last one does not end.

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
    """The moves of an arm as a schedule on one path, with a stop at each vertex.

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
