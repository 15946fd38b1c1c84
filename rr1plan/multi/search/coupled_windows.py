"""Coupled windows: arms that conflict are planned as one in a time window around the conflict.

All arms follow their paths on a nominal clock. The first contact between two of them is resolved by a path in the joint
space of both, between their configurations at the beginning and end of the window. If no path is found, the window
grows, eventually to the whole motion. Arms that collide with such a path become part of the next window around that
conflict, so that eventually all arms are planned as one (Solis, Motes, Qin, Morales, Amato, Adaptive robot
coordination: a subproblem-based approach for hybrid multi-robot motion planning, 2023).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.nominal_clock import SAME, Track, knots, nominal_track
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.path import Path
from rr1plan.planners import RrtConnect
from rr1plan.planners.shortcut import shorten
from rr1plan.planning import Budget
from rr1plan.scene.problem import Problem

_FIRST = 0.1  # half width of the first window, as a fraction of the makespan
_GROWTH = 2.0  # growth factor of a window without a path
_ITERATIONS, _MOST_COUNTED = 500, 4  # initial planner iterations per arm, and largest number of arms counted
_SHORTCUTS = 48
# Largest total number of windows per arm.
_MOST_WINDOWS = 6
_HALVINGS = 5  # bisections of an edge before the contact on it is located


class _Window(NamedTuple):
    """Arms that are planned as one between two instants."""

    arms: frozenset[str]
    begin: float
    end: float


class CoupledWindows:
    """Resolves the conflicts of some arms on the nominal clock.

    Args:
        paths: Waypoints of each arm's path alone, shape (n, nq).
        agent_of: Function that returns the agent of some arms.
        margin: Clearance between the arms and from stationary objects, in addition to the padding [m].
        rng: Source of random numbers.
        watch: Stopwatch with the deadline.

    Attributes:
        tracks: Track of each arm.
        windows: Number of windows that were planned.
    """

    def __init__(
        self,
        paths: Mapping[str, Array],
        agent_of: Callable[[Iterable[str]], Agent],
        margin: float,
        rng: np.random.Generator,
        watch: Stopwatch,
    ) -> None:
        self._agent_of, self._margin, self._rng, self._watch = agent_of, margin, rng, watch
        self._agent = agent_of(paths)
        self._problem = self._agent.problem
        self.arms = self._agent.arms
        limits = {arm: self._problem.scene.limits((arm,)) for arm in self.arms}
        alone = (float(nominal_track(paths[arm], limits[arm]).times[-1]) for arm in self.arms)
        self._unit = max(alone) or 1.0
        self.tracks = {arm: nominal_track(paths[arm], limits[arm], self._unit) for arm in self.arms}
        self._solved: list[_Window] = []
        self.windows = 0

    @property
    def end(self) -> float:
        """When the last arm reaches its goal, on the nominal clock."""
        return max(float(track.times[-1]) for track in self.tracks.values())

    def solve(self, effort: int) -> bool:
        """Resolve one conflict after the other; returns whether none is left.

        Args:
            effort: How often to double the planner's iterations for a window that covers the whole motion.
        """
        scene = self._agent.query({}, self._margin).scene
        with checker_from_pool(scene, self.arms, self._margin) as checker:
            after = 0.0
            for _ in range(_MOST_WINDOWS * len(self.arms)):
                if not self._watch.goes_on():
                    return False
                conflict = self._first_conflict(checker, after)
                if conflict is None:
                    return True
                time, arms = conflict
                window = self._couple(time, arms, effort)
                if window is None:
                    return False
                # Nothing before the window has changed.
                after = window.begin
            return False

    def coupled_sets(self) -> list[tuple[str, ...]]:
        """Sets of arms that shared a window, directly or through other arms; single arms that were in none."""
        sets = [frozenset((arm,)) for arm in self.arms]
        for window in self._solved:
            joined = window.arms.union(*(s for s in sets if s & window.arms))
            sets = [*(s for s in sets if not s & joined), joined]
        return [tuple(arm for arm in self.arms if arm in s) for s in sets]

    def path(self, arms: Iterable[str]) -> Path:
        """The path of some arms in their joint space, synchronized by the nominal clock."""
        names = tuple(arms)
        points = self._composite(names, self._knots(names))
        return Path(self._problem.scene.joint_names(names), points)

    # ---- conflicts -------------------------------------------------------------------------

    def _knots(self, arms: Iterable[str], begin: float = 0.0) -> Array:
        """Instants from `begin` on at which some arm is at a waypoint."""
        return knots([self.tracks[arm] for arm in arms], begin)

    def _composite(self, arms: Iterable[str], times: Array) -> Array:
        return np.asarray(np.hstack([self.tracks[arm].at(times) for arm in arms]))

    def _first_conflict(self, checker: CollisionChecker, after: float) -> tuple[float, frozenset[str]] | None:
        """Time and arms of the first contact; None if there is none."""
        times = self._knots(self.arms, after)
        points = self._composite(self.arms, times)
        if len(points) == 1:
            points, times = points.repeat(2, axis=0), times.repeat(2)
        for (one, two), (begin, end) in zip(pairwise(points), pairwise(times.tolist()), strict=True):
            if not self._watch.goes_on():
                # The remaining steps are unchecked: report a conflict.
                return begin, self._moving(begin, end)
            if checker.edge_is_free(one, two):
                continue
            low, high = 0.0, 1.0
            for _ in range(_HALVINGS):
                middle = 0.5 * (low + high)
                free = checker.edge_is_free(one + low * (two - one), one + middle * (two - one))
                low, high = (middle, high) if free else (low, middle)
            ends = one + low * (two - one), one + high * (two - one)
            contact = checker.first_contact(*ends, precision=0.25)
            if contact is None:
                # The fast and the exact certificate differ slightly: replan all arms that move here.
                return begin + low * (end - begin), self._moving(begin, end)
            owners = (checker.scene.owner(element) for element in contact.pair)
            arms = frozenset(arm for arm in owners if arm in self.tracks)
            return begin + (low + contact.fraction * (high - low)) * (end - begin), arms
        return None

    def _moving(self, begin: float, end: float) -> frozenset[str]:
        moving = [
            arm for arm, track in self.tracks.items() if np.ptp(track.at(np.array([begin, end])), axis=0).max() > 0.0
        ]
        return frozenset(moving or self.arms)

    # ---- windows ---------------------------------------------------------------------------

    def _couple(self, time: float, arms: frozenset[str], effort: int) -> _Window | None:
        """Plan some arms as one in a window around an instant; None if no path is found."""
        horizon, half, iterations = self.end, _FIRST * self.end, _ITERATIONS
        last: _Window | None = None
        while self._watch.goes_on():
            window = self._absorb(_Window(arms, max(0.0, time - half), min(horizon, time + half)))
            # The window may absorb more than its growth.
            if window == last and not (window.begin <= 0.0 and window.end >= horizon):
                half *= _GROWTH
                continue
            last = window
            self.windows += 1
            points = self._plan(window, iterations * min(len(window.arms), _MOST_COUNTED))
            if points is not None:
                return self._splice(window, points)
            if window.begin <= 0.0 and window.end >= horizon:
                if effort <= 0:
                    return None
                effort -= 1
                iterations *= 2
            half *= _GROWTH
        return None

    def _absorb(self, window: _Window) -> _Window:
        """A window merged with earlier ones that overlap with it and share an arm."""
        grown = True
        while grown:
            grown = False
            for other in self._solved:
                overlaps = other.begin < window.end and window.begin < other.end and bool(other.arms & window.arms)
                inside = other.arms <= window.arms and window.begin <= other.begin and other.end <= window.end
                if overlaps and not inside:
                    begin, end = min(window.begin, other.begin), max(window.end, other.end)
                    window, grown = _Window(window.arms | other.arms, begin, end), True
        return window

    def _plan(self, window: _Window, iterations: int) -> Array | None:
        """Waypoints of a window's arms between their configurations at its ends, shape (n, nq); None if not found."""
        agent = self._agent_of(window.arms)
        ends = self._composite(agent.arms, np.array([window.begin, window.end]))
        scene = agent.query({}, self._margin).scene
        begin, end = (agent.split(q) for q in ends)
        query = Problem(scene, begin, end, arms=agent.arms).with_margin(self._margin)
        with checker_from_pool(scene, agent.arms, self._margin) as checker:
            # Tracks may be in contact at the end of a window, such as where one passes an arm that has arrived.
            if not (checker.edge_is_free(ends[0], ends[0]) and checker.edge_is_free(ends[1], ends[1])):
                return None
            budget = Budget(self._watch.time_left, iterations)
            result = RrtConnect().plan(query, budget=budget, rng=self._rng, progress=self._watch.let_planner_go_on)
            if result.path is None:
                return None
            short = shorten(
                result.path,
                scene,
                checker=checker,
                iterations=_SHORTCUTS,
                seconds=self._watch.time_left,
                rng=self._rng,
            )
        return np.asarray(short.waypoints)

    def _splice(self, window: _Window, points: Array) -> _Window:
        """Replace the tracks of the arms of a window in it, and shift their later parts in time."""
        agent = self._agent_of(window.arms)
        track = nominal_track(points, agent.limits, self._unit)
        duration = float(track.times[-1])
        shift = duration - (window.end - window.begin)
        # Joints that wrap may end with an offset of whole turns.
        turns = points[-1] - self._composite(agent.arms, np.array([window.end]))[0]
        for arm, columns in agent.columns.items():
            old = self.tracks[arm]
            before, behind = old.times < window.begin - SAME, old.times > window.end + SAME
            self.tracks[arm] = Track(
                np.concatenate([old.times[before], window.begin + track.times, old.times[behind] + shift]),
                np.concatenate([old.points[before], track.points[:, columns], old.points[behind] + turns[columns]]),
            )
        solved = _Window(window.arms, window.begin, window.begin + duration)
        kept = [
            other
            for other in self._solved
            if not (other.arms <= window.arms and window.begin <= other.begin and other.end <= window.end)
        ]
        self._solved = [
            other._replace(begin=other.begin + shift, end=other.end + shift)
            if other.arms & window.arms and other.begin >= window.end - SAME
            else other
            for other in kept
        ]
        self._solved.append(solved)
        return solved
