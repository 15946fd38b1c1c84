"""Sequential moves: arms move to their goals one at a time, some of them via retreats.

Each move is a query for one arm among stationary others, so a crowded group takes milliseconds where a search in the
joint space of all its arms takes seconds. Each arm moves to its goal as soon as it can; if none can, one withdraws to
its retreat. Several random orders are tried, forward from the starts and backward from the goals. If arms get stuck,
all withdraw, from the starts and from the goals, like parts in assembly planning by disassembly (Wilson and Latombe,
Geometric reasoning about mechanical assembly, 1994): the moves from the goals, reversed, lead to the goals. Arms that
block each other withdraw as one. Finally, each move is started as early as possible during the moves before it. The
results are paths in the joint space of all arms; `path_refinement.py` makes one of them faster.
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
from rr1plan.multi.paths.hop_timing import joint_times
from rr1plan.multi.paths.nominal_clock import Track
from rr1plan.multi.paths.path_refinement import estimated_duration
from rr1plan.multi.search.retreats import RetreatSearch
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.path import Path
from rr1plan.planners.shortcut import shorten
from rr1plan.planners.tree_search import Trees
from rr1plan.retiming.path_blends import clean

# Samples of the search for one move: initial number, growth factor if no arm can move, and maximum.
_SAMPLES, _MORE, _MOST_SAMPLES = 250, 4, 1000
# Largest number of arms that withdraw as one, and of sets of each size that are tried.
_MOST_TOGETHER, _MOST_SETS = 3, 12
# Longest edge of the trees and radius of sampling around vertices with a blocked edge, as fractions of the diagonal of
# the moving joints' space.
_STEP, _DOMAIN = 0.06, 0.3
# Attempts at paths on which some arms withdraw, each with other retreats, backward and forward: as many as arms, but at
# most this number; and the largest expected fraction of arms that withdraw first.
_ATTEMPTS, _LARGEST_SHARE = 8, 0.5
# Attempts at paths on which all arms withdraw, if no others were found.
_ATTEMPTS_OF_ALL = 3
_WITHDRAWALS = 2  # tried from the starts and from the goals; the fastest of each is used
# Shortcuts of one move, shortcuts of a withdrawal of all arms, and bisection steps for the departure of a move.
_MOVE_SHORTCUTS, _SHORTCUTS, _HALVINGS = 8, 24, 4
_SLICE = 20  # samples between two checks of the time


class SequentialMoves:
    """Plans a group of arms by moves of one arm at a time.

    Args:
        agent: All arms as one agent.
        goal: Their goal configuration, shape (nq,).
        retreats: Search for the retreats of the arms.
        margin: Clearance between the arms and from stationary objects, in addition to the padding [m].
        rng: Source of random numbers.
        watch: Stopwatch with the deadline.
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
        self._query = agent.query({}, margin)
        self._space = Space.around(self._query, goal[None])

    def paths(self, effort: int = 0) -> Iterator[Array]:
        """Waypoints of paths from the starts to the goals, each of shape (n, nq).

        On these paths some arms withdraw; if there are none, all arms do.

        Args:
            effort: How often to double the maximum number of samples of a move when all arms withdraw.
        """
        found = False
        for _ in range(min(_ATTEMPTS, len(self._columns))):
            retreats = self._retreats.find()
            if retreats is None:
                return
            for back in (True, False):
                points = self._by_some_retreats(retreats, back=back)
                if points is not None:
                    found = True
                    yield points
        for _ in range(0 if found else _ATTEMPTS_OF_ALL):
            retreats = self._retreats.find()
            if retreats is None:
                return
            points = self._by_all_retreats(retreats, effort)
            if points is not None:
                yield points

    # ---- some arms withdraw ------------------------------------------------------------------

    def _by_some_retreats(self, retreats: Array, *, back: bool) -> Array | None:
        """Waypoints on which each arm moves to its goal as soon as it can, shape (n, nq); None if arms get stuck.

        Args:
            retreats: Configurations to which arms withdraw, shape (nq,).
            back: Whether to search backward, for moves from the goals to the starts.
        """
        start, goal = self._agent.start, self._goal
        begin, end = (goal, start) if back else (start, goal)
        with self._checker() as checker:
            moves = self._moves_to(checker, begin, end, retreats)
            if moves is not None and back:
                # Joints that wrap may reach the start with an offset of whole turns.
                turns = start - moves[-1][-1]
                moves = [move[::-1] + turns for move in reversed(moves)]
            return None if moves is None else self._overlapped(checker, start, moves)

    def _moves_to(self, checker: CollisionChecker, q: Array, goal: Array, retreats: Array) -> list[Array] | None:
        """Moves that take all arms from one configuration to another, each of shape (n, nq); None if some get stuck.

        A few random arms withdraw first, so that fewer arms wait for each other. Then each arm moves to its goal as
        soon as it can; if none can, one more withdraws.
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
            # First straight lines, if they are free.
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
        """The first arm that can move to its target, and its waypoints, shape (n, nq); -1 and None if none can."""
        for arm in arms:
            points = self._move(checker, q, (arm,), target, samples)
            if points is not None:
                return arm, points
        return -1, None

    # ---- all arms withdraw -------------------------------------------------------------------

    def _by_all_retreats(self, retreats: Array, effort: int) -> Array | None:
        """Waypoints on which all arms withdraw before any moves to its goal, shape (n, nq); None if none are found."""
        with self._checker() as checker:
            begin = self._fastest_withdrawal(checker, self._agent.start, retreats, effort)
            end = None if begin is None else self._fastest_withdrawal(checker, self._goal, retreats, effort)
        if begin is None or end is None:
            return None
        # Joints that wrap may reach the same retreat with an offset of whole turns.
        turns = begin[-1] - end[-1]
        return np.concatenate([begin, end[-2::-1] + turns])

    def _fastest_withdrawal(self, checker: CollisionChecker, q: Array, retreats: Array, effort: int) -> Array | None:
        """The fastest of a few paths of all arms to their retreats, shape (n, nq); None if none is found."""
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
        """Waypoints of all moves, each started as early as possible during the moves before it, shape (n, nq)."""
        track = Track(np.zeros(1), q[None])
        for move in moves:
            changes = move.min(axis=0) < move.max(axis=0)
            moving = np.concatenate(
                [np.full(columns.stop - columns.start, changes[columns].any()) for columns in self._columns]
            )
            durations = joint_times(np.diff(move, axis=0), self._agent.limits).max(axis=1)
            own = Track(np.append(0.0, np.cumsum(durations)), move)
            before = np.flatnonzero((track.points[1:, moving] != track.points[:-1, moving]).any(axis=1))
            earliest = float(track.times[before[-1] + 1]) if len(before) else 0.0
            latest = float(track.times[-1])
            made = _with_move(track, latest, own, moving)
            departure = earliest
            for _ in range(_HALVINGS if self._watch.goes_on() else 0):
                tried = _with_move(track, departure, own, moving)
                if checker.path_is_free(tried.points):
                    made, latest = tried, departure
                else:
                    earliest = departure
                if latest == earliest:
                    break
                departure = 0.5 * (earliest + latest)
            kept = int(np.searchsorted(track.times, latest))
            track = Track(
                np.concatenate([track.times[:kept], made.times]), np.concatenate([track.points[:kept], made.points])
            )
        return track.points

    # ---- moves -------------------------------------------------------------------------------

    def _checker(self) -> AbstractContextManager[CollisionChecker]:
        return checker_from_pool(self._query.scene, self._agent.arms, self._margin)

    def _withdraw(self, checker: CollisionChecker, q: Array, retreats: Array, effort: int) -> list[Array] | None:
        """Moves of all arms from a configuration to their retreats, each of shape (n, nq); None if some get stuck."""
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
        """Candidates for the next withdrawal: each single arm, then sets of a few arms."""
        yield from ((arm,) for arm in left)
        for size in range(2, _MOST_TOGETHER + 1) if together else ():
            sets = list(combinations(left, size))
            for i in self._rng.permutation(len(sets))[:_MOST_SETS].tolist():
                yield sets[i]

    def _move(
        self, checker: CollisionChecker, q: Array, arms: Iterable[int], target: Array, samples: int
    ) -> Array | None:
        """Waypoints of some arms to a target while all others are stationary, shape (n, nq); None if none are found."""
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


def _with_move(track: Track, departure: float, move: Track, moving: NDArray[np.bool_]) -> Track:
    """The part of a track from a departure on, with a move added to it.

    Args:
        track: The other moves, of all arms.
        departure: When the move starts.
        move: The move to add, of all arms, with times relative to the departure.
        moving: Mask of the columns of the arms that it moves, shape (nq,).
    """
    instants = np.unique(np.concatenate([track.times[track.times > departure], departure + move.times]))
    points = track.at(instants)
    points[:, moving] = Track(departure + move.times, move.points[:, moving]).at(instants)
    return Track(instants, points)
