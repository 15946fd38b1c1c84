"""Sequential moves: arms withdraw one at a time to retreats, and leave them one at a time for their goals.

Each move is a query of one arm among others that stand still, so a crowded group takes milliseconds where the joint
space of all its arms takes seconds. Arms withdraw from the starts, and from the goals, as parts of an assembly are
taken apart (Wilson and Latombe, Geometric reasoning about mechanical assembly, 1994): the second order, reversed,
leads to the goals. Arms that hold each other withdraw as one. The result is a path in the joint space of all arms;
`time_shortcuts.py` lets them move at the same time.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np

from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.kernels.planner_kernels import CStruct
from rr1plan.kernels.random_state import random_state
from rr1plan.model.joint_space import Space
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.placed_path import placed_configuration
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.multi.timing.coordination import are_apart
from rr1plan.planners.tree_search import Trees

# Random configurations that are compared for a retreat, and how far it should be from the ends of other arms [m].
_CANDIDATES, _ROOM = 24, 0.03
# Samples of the search for one move: at first, how many times as many where no arm can move, and at most.
_SAMPLES, _MORE, _MOST_SAMPLES = 250, 4, 4000
# Arms that withdraw as one, and sets of them that are tried, at most.
_MOST_TOGETHER, _MOST_SETS = 3, 12
# Of the trees, as shares of the diagonal of the moving joints' space: longest edge, and radius of sampling around
# vertices with a blocked edge.
_STEP, _DOMAIN = 0.06, 0.3
_SLICE = 20  # samples between two looks at the clock


class SequentialMoves:
    """Plans a group of arms by moves of one arm at a time.

    Args:
        agent: All arms as one.
        goal: Where they end, shape (nq,).
        single: The agent of each arm.
        near: Of each arm those that it can meet.
        margin: Distance to keep between all of them and from what stands still, beyond the padding [m].
        rng: Where random numbers come from.
        watch: Says when to give up.
    """

    def __init__(
        self,
        agent: Agent,
        goal: Array,
        single: Mapping[str, Agent],
        near: Mapping[str, frozenset[str]],
        margin: float,
        rng: np.random.Generator,
        watch: Stopwatch,
    ) -> None:
        self._agent, self._goal, self._margin, self._rng, self._watch = agent, goal, margin, rng, watch
        self._single = [single[arm] for arm in agent.arms]
        self._columns = list(agent.columns.values())
        self._question = agent.question({}, margin)
        self._near = [[k for k, other in enumerate(agent.arms) if other in near[arm]] for arm in agent.arms]
        self._space = Space.around(self._question, goal[None])

    def find(self, effort: int = 0) -> Array | None:
        """Waypoints of a path from the starts to the goals, shape (n, nq); None if none was found.

        Args:
            effort: How often to double the samples after which a move is given up.
        """
        with checker_from_pool(self._question.scene, self._agent.arms, self._margin) as checker:
            retreats = self._retreats()
            if retreats is None:
                return None
            begin = self._withdraw(checker, self._agent.start, retreats, effort)
            end = None if begin is None else self._withdraw(checker, self._goal, retreats, effort)
        if begin is None or end is None:
            return None
        # Joints that wrap may have withdrawn to the same place with some turns more or less.
        back = end[::-1] + (begin[-1] - end[-1])
        return np.concatenate([begin, back[1:]])

    # ---- retreats ----------------------------------------------------------------------------

    def _retreats(self) -> Array | None:
        """A configuration for each arm, in the way of few starts and goals, shape (nq,); None if it is too late."""
        ends = [(one.start, self._goal[columns]) for one, columns in zip(self._single, self._columns, strict=True)]
        placed = [
            [placed_configuration(one.bodies, q) for q in both] for one, both in zip(self._single, ends, strict=True)
        ]
        retreats = self._agent.start.copy()
        chosen: dict[int, CStruct] = {}
        for arm in self._rng.permutation(len(ends)).tolist():
            best: tuple[int, float] | None = None
            for q in self._candidates(arm):
                own = placed_configuration(self._single[arm].bodies, q)
                most = 2 * len(ends) if best is None else best[0]
                number = self._conflicts(arm, own, placed, chosen, most)
                far = float(sum(np.linalg.norm(q - end) for end in ends[arm]))
                if best is None or (number, far) < best:
                    best, kept = (number, far), own
                    retreats[self._columns[arm]] = q
            if best is not None:
                chosen[arm] = kept
            if not self._watch.goes_on():
                return None
        return retreats

    def _candidates(self, arm: int) -> Iterator[Array]:
        """Free configurations of an arm: its home, and random ones, from near its way to anywhere."""
        agent, columns = self._single[arm], self._columns[arm]
        home = agent.problem.scene.arms[agent.arms[0]].robot.home
        wraps = self._space.wraps[columns]
        low = np.where(wraps, -np.pi, self._space.lower[columns])
        high = np.where(wraps, np.pi, self._space.upper[columns])
        begin, end = agent.start, self._goal[columns]
        question = agent.question({}, self._margin)
        with checker_from_pool(question.scene, question.arms, self._margin) as checker:
            if (low <= home).all() and (home <= high).all() and checker.is_free(home):
                yield home
            for number in range(_CANDIDATES):
                if not self._watch.goes_on():
                    return
                middle = begin + self._rng.random() * (end - begin)
                share = (number + 1) / _CANDIDATES
                q = np.clip(middle + share * (self._rng.uniform(low, high) - middle), low, high)
                if checker.is_free(q):
                    yield q

    def _conflicts(
        self, arm: int, own: CStruct, ends: Sequence[Sequence[CStruct]], chosen: Mapping[int, CStruct], most: int
    ) -> int:
        """With how many starts, goals and chosen retreats of others an arm is in conflict; counted to `most` + 1."""
        number = 0
        for other in self._near[arm]:
            for placed in (*ends[other], chosen[other]) if other in chosen else ends[other]:
                number += not are_apart(self._single[arm], own, self._single[other], placed, _ROOM)
                if number > most:
                    return number
        return number

    # ---- moves -------------------------------------------------------------------------------

    def _withdraw(self, checker: CollisionChecker, q: Array, retreats: Array, effort: int) -> Array | None:
        """Waypoints that lead all arms from a configuration to their retreats, shape (n, nq); None if some stay."""
        parts, left, samples = [q[None]], list(range(len(self._columns))), _SAMPLES
        while left:
            for arms in self._sets(left, together=samples >= _MOST_SAMPLES << effort):
                if not self._watch.goes_on():
                    return None
                points = self._move(checker, parts[-1][-1], arms, retreats, samples * len(arms))
                if points is not None:
                    parts.append(points[1:])
                    left = [arm for arm in left if arm not in arms]
                    samples = _SAMPLES
                    break
            else:
                if samples >= _MOST_SAMPLES << effort:
                    return None
                samples *= _MORE
        return np.concatenate(parts)

    def _sets(self, left: Sequence[int], *, together: bool) -> Iterator[tuple[int, ...]]:
        """Arms that may withdraw next: each one, and then a few as one."""
        yield from ((arm,) for arm in left)
        for size in range(2, _MOST_TOGETHER + 1) if together else ():
            sets = list(combinations(left, size))
            for i in self._rng.permutation(len(sets))[:_MOST_SETS].tolist():
                yield sets[i]

    def _move(
        self, checker: CollisionChecker, q: Array, arms: Iterable[int], target: Array, samples: int
    ) -> Array | None:
        """Waypoints that lead some arms to a target while all others stand still, shape (n, nq)."""
        goal, lower, extent = q.copy(), q.copy(), np.zeros_like(q)
        for arm in arms:
            columns = self._columns[arm]
            goal[columns] = target[columns]
            lower[columns], extent[columns] = self._space.lower[columns], self._space.extent[columns]
        if checker.edge_is_free(q, goal):
            return np.stack([q, goal])
        diagonal = float(np.linalg.norm(np.where(np.isinf(extent), 2.0 * np.pi, extent)))
        if diagonal == 0.0:
            return None
        trees = Trees(q, goal[None])
        trees.restart(lower, extent, _STEP * diagonal, _DOMAIN * diagonal, np.inf)
        state = random_state(int(self._rng.integers(2**63)))
        while trees.samples < samples and self._watch.goes_on():
            if trees.grow(state, min(trees.samples + _SLICE, samples), checker):
                return trees.path()
        return None
