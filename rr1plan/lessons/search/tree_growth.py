"""RRT, RRT-Connect and RRT*, one sample per step.

LaValle, "Rapidly-exploring random trees: a new tool for path planning", TR 98-11, Iowa State University (1998).
Kuffner, LaValle, "RRT-Connect: an efficient approach to single-query path planning", ICRA 2000.
Karaman, Frazzoli, "Sampling-based algorithms for optimal motion planning", IJRR 30 (2011).
"""

from __future__ import annotations

from math import gamma

import numpy as np

from rr1plan.checks import Array, Seed, as_generator, finite_number, positive_number, whole_number
from rr1plan.errors import InputError
from rr1plan.lessons.search.search_record import PARENT, SAMPLE, SearchRecord, SearchRecorder, chain_to
from rr1plan.lessons.search.search_space import SearchSpace
from rr1plan.scene.problem import Problem

_MOST_SAMPLES = 20_000
_SHORTEST_STEP = 1.6e-4  # of the widest range; one connection of RRT-Connect has as many vertices as steps


class _Tree:
    """Vertices of one tree and their parents, by their indices in the record."""

    def __init__(self, note: SearchRecorder, root: Array, side: int = 0) -> None:
        self.note, self.side = note, side
        self.members: list[int] = []
        self.parents: dict[int, int] = {}
        self._points = np.empty((64, len(root)))  # doubled on demand
        self.add(root, -1)

    def points(self) -> Array:
        """The members' configurations, shape (n, nq)."""
        return self._points[: len(self.members)]

    def nearest(self, q: Array) -> int:
        return self.members[int(np.argmin(self.note.space.distance(self.points(), q)))]

    def add(self, q: Array, parent: int) -> int:
        vertex = self.note.add_vertex(q, parent, self.side)
        if len(self.members) == len(self._points):
            self._points = np.concatenate([self._points, np.empty_like(self._points)])
        self._points[len(self.members)] = q
        self.members.append(vertex)
        self.parents[vertex] = parent
        return vertex

    def extend(self, q: Array, step: float) -> int | None:
        """One step from the nearest vertex toward q: the new vertex, or None if its edge is not free."""
        near = self.nearest(q)
        to = self.note.space.steer(self.note.vertices[near], q, step)
        return self.add(to, near) if self.note.edge_is_free(near, to) else None

    def chain(self, vertex: int) -> list[int]:
        """The vertices from the root to one."""
        return chain_to(self.parents, vertex)


def grow_rrt(
    problem: Problem, *, step: float = 0.3, goal_bias: float = 0.05, samples: int = 2000, rng: Seed = 0
) -> SearchRecord:
    """RRT: extend the vertex nearest to a sample by one step toward it, until the goal is one free step away.

    Args:
        problem: One arm, a start, a joint goal.
        step: Longest edge [rad or m].
        goal_bias: Share of the samples that are the goal, 0 to 1.
        samples: Samples to draw at most.
        rng: Seed or generator.

    Raises:
        InputError: several arms, another goal, a start or goal that is not free, a joint without limits that does not
            wrap, or a number out of range.
    """
    space, step, samples, generator = _checked(problem, step, samples, rng)
    bias = _share(goal_bias)
    note = SearchRecorder("RRT", space)
    tree = _Tree(note, space.start)
    if space.is_goal(space.start):
        note.add_path([0])
    note.step()
    for _ in range(samples):
        if np.isfinite(note.best):
            break
        q = space.goal if generator.random() < bias else space.sample(generator)
        note.add(SAMPLE, point=q)
        new = tree.extend(q, step)
        goal = None if new is None else _join_goal(tree, new, step)
        if goal is not None:
            note.add_path(tree.chain(goal))
        note.step()
    return note.record()


def grow_rrt_connect(problem: Problem, *, step: float = 0.3, samples: int = 2000, rng: Seed = 0) -> SearchRecord:
    """RRT-Connect: one tree takes a step toward a sample, the other steps toward it until it is reached or blocked.

    Args:
        problem: One arm, a start, a joint goal.
        step: Longest edge [rad or m].
        samples: Samples to draw at most.
        rng: Seed or generator.

    Raises:
        InputError: several arms, another goal, a start or goal that is not free, a joint without limits that does not
            wrap, or a number out of range.
    """
    space, step, samples, generator = _checked(problem, step, samples, rng)
    note = SearchRecorder("RRT-Connect", space)
    trees = [_Tree(note, space.start, 0), _Tree(note, space.goal, 1)]
    if space.is_goal(space.start):
        note.add_path([0])
    note.step()
    for k in range(samples):
        if np.isfinite(note.best):
            break
        active, other = trees[k % 2], trees[(k + 1) % 2]
        q = space.sample(generator)
        note.add(SAMPLE, point=q)
        new = active.extend(q, step)
        joined = None
        if new is not None:
            target = note.vertices[new]
            joined = other.extend(target, step)
            while joined is not None and space.distance(note.vertices[joined], target) > 1e-9:
                joined = other.extend(target, step)
        if new is not None and joined is not None:
            first, second = (new, joined) if active.side == 0 else (joined, new)
            note.add_path([*trees[0].chain(first), *trees[1].chain(second)[-2::-1]])
        note.step()
    return note.record()


def grow_rrt_star(
    problem: Problem,
    *,
    step: float = 0.5,
    goal_bias: float = 0.05,
    samples: int = 600,
    rng: Seed = 0,
) -> SearchRecord:
    """RRT*: a new vertex gets the parent that makes it cheapest, and becomes the parent of vertices it makes cheaper.

    All samples are used: the path gets shorter after it has been found.

    Args:
        problem: One arm, a start, a joint goal.
        step: Longest edge [rad or m].
        goal_bias: Share of the samples that are the goal, before it is reached.
        samples: Samples to draw.
        rng: Seed or generator.

    Raises:
        InputError: several arms, another goal, a start or goal that is not free, a joint without limits that does not
            wrap, or a number out of range.
    """
    space, step, samples, generator = _checked(problem, step, samples, rng)
    bias = _share(goal_bias)
    note = SearchRecorder("RRT*", space)
    tree, costs = _Tree(note, space.start), {0: 0.0}
    goal = 0 if space.is_goal(space.start) else None
    if goal is not None:
        note.add_path([goal])
    # The constant of Karaman and Frazzoli, theorem 38, with the volume of the whole space instead of its free part, and
    # that of the unit ball.
    volume, dimension = float(np.prod(space.upper - space.lower)), len(space.start)
    ball = np.pi ** (dimension / 2.0) / gamma(dimension / 2.0 + 1.0)
    constant = 2.0 * ((1.0 + 1.0 / dimension) * volume / ball) ** (1.0 / dimension)
    note.step()
    for _ in range(samples):
        q = space.goal if goal is None and generator.random() < bias else space.sample(generator)
        note.add(SAMPLE, point=q)
        near = tree.nearest(q)
        to = space.steer(note.vertices[near], q, step)
        if space.distance(note.vertices[near], to) < 1e-9 or not note.edge_is_free(near, to):
            note.step()
            continue
        count = len(tree.members) + 1
        radius = min(constant * (np.log(count) / count) ** (1.0 / dimension), step)
        new = _join_cheapest(tree, costs, to, near, radius)
        if goal is None:
            goal = _join_goal(tree, new, step)
            if goal is not None:
                costs[goal] = costs[new] + float(space.distance(to, space.goal))
        if goal is not None:
            note.add_path(tree.chain(goal))
        note.step()
    return note.record()


def _join_goal(tree: _Tree, vertex: int, step: float) -> int | None:
    """The vertex at the goal: this one, or a new one if a free edge of at most `step` leads there; else None."""
    note, space = tree.note, tree.note.space
    if space.is_goal(note.vertices[vertex]):
        return vertex
    near = space.distance(note.vertices[vertex], space.goal) <= step
    return tree.add(space.goal, vertex) if near and note.edge_is_free(vertex, space.goal) else None


def _join_cheapest(tree: _Tree, costs: dict[int, float], q: Array, near: int, radius: float) -> int:
    """Add q as a child of the cheapest vertex around it, and rewire the vertices around it to q if that is cheaper."""
    note, space = tree.note, tree.note.space
    distances = space.distance(tree.points(), q)
    around = [(v, float(d)) for v, d in zip(tree.members, distances, strict=True) if d <= radius or v == near]
    parent = near
    for v, _ in sorted(around, key=lambda row: costs[row[0]] + row[1]):
        # The edge to the nearest vertex is known to be free.
        if v == near or note.edge_is_free(v, q):
            parent = v
            break
    new = tree.add(q, parent)
    costs[new] = costs[parent] + float(space.distance(note.vertices[parent], q))
    for v, d in around:
        if v != parent and costs[new] + d < costs[v] - 1e-9 and note.edge_is_free(new, note.vertices[v]):
            saved = costs[v] - costs[new] - d
            tree.parents[v] = new
            note.add(PARENT, v, new)
            for below in _subtree(tree, v):
                costs[below] -= saved
    return new


def _subtree(tree: _Tree, root: int) -> list[int]:
    """A vertex and all its descendants."""
    children: dict[int, list[int]] = {}
    for vertex, parent in tree.parents.items():
        children.setdefault(parent, []).append(vertex)
    found = [root]
    for vertex in found:
        found += children.get(vertex, [])
    return found


def _checked(
    problem: Problem, step: float, samples: int, rng: Seed
) -> tuple[SearchSpace, float, int, np.random.Generator]:
    """Check the arguments common to all planners."""
    step = positive_number("step", step)
    samples = whole_number("samples", samples, 1, _MOST_SAMPLES)
    space = SearchSpace(problem)
    least = _SHORTEST_STEP * float((space.upper - space.lower).max())
    if step < least:
        raise InputError(f"step is {step:g}, expected at least {least:.3g} rad or m")
    return space, step, samples, as_generator(rng)


def _share(goal_bias: float) -> float:
    bias = finite_number("goal_bias", goal_bias)
    if not 0.0 <= bias <= 1.0:
        raise InputError(f"goal_bias is {bias}, expected 0 to 1")
    return bias
