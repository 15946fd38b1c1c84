"""Sequential moves: one arm at a time moves to its goal, some of them by way of retreats.

Each move is a query of one arm among others that stand still, so a crowded group takes milliseconds where the joint
space of all its arms takes seconds. Each arm moves to its goal as soon as it can; where none can, one withdraws to its
retreat. Several random orders are tried, from the starts to the goals and from the goals back. Where arms get stuck,
all withdraw, from the starts and from the goals, as parts of an assembly are taken apart (Wilson and Latombe, Geometric
reasoning about mechanical assembly, 1994): the second order, reversed, leads to the goals. Arms that hold each other
withdraw as one. At last each move begins as early as it can while those before it go on. The results are paths in the
joint space of all arms, of which `time_shortcuts.py` makes one faster.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.kernels.random_state import random_state
from rr1plan.model.joint_space import Space
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.path_refinement import estimated_duration
from rr1plan.multi.paths.time_shortcuts import joint_times
from rr1plan.multi.search.retreats import RetreatSearch
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.path import Path
from rr1plan.planners.shortcut import shorten
from rr1plan.planners.tree_search import Trees
from rr1plan.retiming.path_blends import clean

# Samples of the search for one move: at first, how many times as many where no arm can move, and at most.
_SAMPLES, _MORE, _MOST_SAMPLES = 250, 4, 1000
# Arms that withdraw as one, and sets of them that are tried, at most.
_MOST_TOGETHER, _MOST_SETS = 3, 12
# Of the trees, as shares of the diagonal of the moving joints' space: longest edge, and radius of sampling around
# vertices with a blocked edge.
_STEP, _DOMAIN = 0.06, 0.3
# Attempts at paths on which some arms withdraw, and the largest share of the arms that do so first.
_ATTEMPTS, _LARGEST_SHARE = 10, 0.5
# Attempts at paths on which all arms withdraw: where there are no others, and else one for so many arms.
_ATTEMPTS_ALONE, _ARMS_PER_ATTEMPT = 3, 4
_WITHDRAWALS = 2  # from the starts, and from the goals, of which the fastest is taken
# Shortcuts of a move, and moments that are tried for its beginning.
_MOVE_SHORTCUTS, _SHORTCUTS, _HALVINGS = 8, 24, 4
_SLICE = 20  # samples between two looks at the clock


class SequentialMoves:
    """Plans a group of arms by moves of one arm at a time.

    Args:
        agent: All arms as one.
        goal: Where they end, shape (nq,).
        retreats: Finds where the arms withdraw to.
        margin: Distance to keep between all of them and from what stands still, beyond the padding [m].
        rng: Where random numbers come from.
        watch: Says when to give up.
    """

    def __init__(
        self,
        agent: Agent,
        goal: Array,
        retreats: RetreatSearch,
        margin: float,
        rng: np.random.Generator,
        watch: Stopwatch,
    ) -> None:
        self._agent, self._goal, self._margin, self._rng, self._watch = agent, goal, margin, rng, watch
        self._retreats = retreats
        self._columns = list(agent.columns.values())
        self._question = agent.question({}, margin)
        self._space = Space.around(self._question, goal[None])

    def paths(self, effort: int = 0) -> Iterator[Array]:
        """Waypoints of paths from the starts to the goals, each of shape (n, nq).

        On the first ones some arms withdraw, on the last ones all of them.

        Args:
            effort: How often to double the samples after which a move is given up where all arms withdraw.
        """
        retreats, alone = self._retreats.find(), True
        for number in range(_ATTEMPTS):
            points = None if retreats is None else self._by_some_retreats(retreats, back=number % 2 == 0)
            if points is not None:
                alone = False
                yield points
        for number in range(_ATTEMPTS_ALONE if alone else len(self._columns) // _ARMS_PER_ATTEMPT):
            if number > 0 and self._watch.goes_on():
                retreats = self._retreats.find()
            points = None if retreats is None else self._by_all_retreats(retreats, effort)
            if points is not None:
                yield points

    # ---- some arms withdraw ------------------------------------------------------------------

    def _by_some_retreats(self, retreats: Array, *, back: bool) -> Array | None:
        """Waypoints on which each arm moves to its goal as soon as it can, shape (n, nq); None if arms get stuck.

        Args:
            retreats: Where arms withdraw to, shape (nq,).
            back: Whether to look for the moves from the goals to the starts.
        """
        start, goal = self._agent.start, self._goal
        begin, end = (goal, start) if back else (start, goal)
        with self._checker() as checker:
            moves = self._moves_to(checker, begin, end, retreats)
            if moves is not None and back:
                # Joints that wrap may have come to the start with some turns more or less.
                turns = start - moves[-1][-1]
                moves = [move[::-1] + turns for move in reversed(moves)]
            return None if moves is None else self._overlapped(checker, start, moves)

    def _moves_to(self, checker: CollisionChecker, q: Array, goal: Array, retreats: Array) -> list[Array] | None:
        """Moves that lead all arms from a configuration to another one, each of shape (n, nq); None if some get stuck.

        A few random arms withdraw first, so that those that wait for each other are fewer. Then each arm moves to its
        goal as soon as it can, and where none can, one more withdraws.
        """
        moves: list[Array] = []
        left = self._rng.permutation(len(self._columns)).tolist()
        first = self._rng.random(len(left)) < _LARGEST_SHARE * self._rng.random()
        for arm in np.flatnonzero(first).tolist():
            withdrawal = self._move(checker, q, (arm,), retreats, _SAMPLES)
            if withdrawal is not None:
                moves.append(withdrawal)
                q = withdrawal[-1]
        inside = [arm for arm in left if not first[arm]]
        while left:
            # Straight where that is free.
            for arms, target, samples in ((left, goal, 0), (left, goal, _SAMPLES), (inside, retreats, _SAMPLES)):
                arm, points = self._first_move(checker, q, arms, target, samples)
                if points is not None:
                    arms.remove(arm)
                    moves.append(points)
                    q = points[-1]
                    break
            else:
                return None
            inside = [arm for arm in inside if arm in left]
        return moves

    def _first_move(
        self, checker: CollisionChecker, q: Array, arms: Sequence[int], target: Array, samples: int
    ) -> tuple[int, Array | None]:
        """The first of some arms that can move to a target, and its waypoints, shape (n, nq); None if none can."""
        for arm in arms:
            points = self._move(checker, q, (arm,), target, samples)
            if points is not None:
                return arm, points
        return -1, None

    # ---- all arms withdraw -------------------------------------------------------------------

    def _by_all_retreats(self, retreats: Array, effort: int) -> Array | None:
        """Waypoints on which all arms withdraw before one moves to its goal, shape (n, nq); None if none was found."""
        with self._checker() as checker:
            begin = self._fastest_withdrawal(checker, self._agent.start, retreats, effort)
            end = None if begin is None else self._fastest_withdrawal(checker, self._goal, retreats, effort)
        if begin is None or end is None:
            return None
        # Joints that wrap may have withdrawn to the same place with some turns more or less.
        turns = begin[-1] - end[-1]
        return np.concatenate([begin, end[-2::-1] + turns])

    def _fastest_withdrawal(self, checker: CollisionChecker, q: Array, retreats: Array, effort: int) -> Array | None:
        """The fastest of a few paths that lead all arms to their retreats, shape (n, nq); None if none was found."""
        fastest, best = np.inf, None
        for _ in range(_WITHDRAWALS):
            moves = self._withdraw(checker, q, retreats, effort)
            if moves is None:
                continue
            path = Path(self._agent.joint_names, self._overlapped(checker, q, moves))
            points = shorten(path, checker.scene, checker=checker, iterations=_SHORTCUTS, rng=self._rng).waypoints
            duration = estimated_duration(clean(points), self._agent, None)
            if duration < fastest:
                fastest, best = duration, points
        return best

    def _overlapped(self, checker: CollisionChecker, q: Array, moves: Sequence[Array]) -> Array:
        """Waypoints of moves of which each begins as early as it can among those before it, shape (n, nq)."""
        times, points = np.zeros(1), q[None]
        for move in moves:
            changes = move.min(axis=0) < move.max(axis=0)
            moving = np.concatenate(
                [np.full(columns.stop - columns.start, changes[columns].any()) for columns in self._columns]
            )
            own = np.concatenate([[0.0], np.cumsum(joint_times(np.diff(move, axis=0), self._agent.limits).max(axis=1))])
            before = np.flatnonzero((points[1:, moving] != points[:-1, moving]).any(axis=1))
            earliest, latest = float(times[before[-1] + 1]) if len(before) else 0.0, float(times[-1])
            made = _with_move(times, points, latest, own, move, moving)
            departure = earliest
            for _ in range(_HALVINGS if self._watch.goes_on() else 0):
                tried = _with_move(times, points, departure, own, move, moving)
                if checker.path_is_free(tried[1]):
                    made, latest = tried, departure
                else:
                    earliest = departure
                if latest == earliest:
                    break
                departure = 0.5 * (earliest + latest)
            kept = int(np.searchsorted(times, latest))
            times, points = np.concatenate([times[:kept], made[0]]), np.concatenate([points[:kept], made[1]])
        return points

    # ---- moves -------------------------------------------------------------------------------

    def _checker(self) -> AbstractContextManager[CollisionChecker]:
        return checker_from_pool(self._question.scene, self._agent.arms, self._margin)

    def _withdraw(self, checker: CollisionChecker, q: Array, retreats: Array, effort: int) -> list[Array] | None:
        """Moves that lead all arms from a configuration to their retreats, each of shape (n, nq); None if some stay."""
        moves: list[Array] = []
        left, samples = list(range(len(self._columns))), _SAMPLES
        while left:
            for arms in self._sets(left, together=samples >= _MOST_SAMPLES << effort):
                if not self._watch.goes_on():
                    return None
                points = self._move(checker, q, arms, retreats, samples * len(arms))
                if points is not None:
                    moves.append(points)
                    q = points[-1]
                    left = [arm for arm in left if arm not in arms]
                    samples = _SAMPLES
                    break
            else:
                if samples >= _MOST_SAMPLES << effort:
                    return None
                samples *= _MORE
        return moves

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
        if not self._watch.goes_on() or not checker.is_free(goal):
            return None
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
                path = Path(self._agent.joint_names, trees.path())
                return shorten(
                    path, checker.scene, checker=checker, iterations=_MOVE_SHORTCUTS, rng=self._rng
                ).waypoints
        return None


def _with_move(
    times: Array, points: Array, departure: float, own: Array, move: Array, moving: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Times and waypoints of some moves and one more, from when it begins.

    Args:
        times: Of the waypoints, shape (n,).
        points: All arms, shape (n, nq).
        departure: When the move begins.
        own: Times of its waypoints from then on, shape (m,).
        move: Its waypoints, all arms, shape (m, nq).
        moving: Columns of the arms that move by it, shape (nq,).
    """
    knots = np.unique(np.concatenate([times[times > departure], departure + own]))
    made = _at(knots, times, points)
    made[:, moving] = _at(knots, departure + own, move[:, moving])
    return knots, made


def _at(instants: Array, times: Array, points: Array) -> Array:
    """Where a polyline is at some instants, shape (k, nq); after its last waypoint it stays there.

    Args:
        instants: Not before the first of the times, shape (k,).
        times: Of the waypoints, shape (n,).
        points: Waypoints, shape (n, nq).
    """
    row = np.minimum(np.searchsorted(times, instants, side="right") - 1, max(0, len(times) - 2))
    after = np.minimum(row + 1, len(times) - 1)
    durations = times[after] - times[row]
    share = np.clip((instants - times[row]) / np.where(durations > 0.0, durations, 1.0), 0.0, 1.0)[:, None]
    # Exact at both ends.
    return np.asarray(np.where(share == 1.0, points[after], points[row] + share * (points[after] - points[row])))
