"""Coupled windows: arms that conflict are planned as one on a window of time around the conflict.

All arms follow their paths on a nominal clock, and the first contact between two of them is resolved by a path in the
joint space of both, from where they are at the beginning of the window to where they are at its end. If there is none,
or too hard a one, the window grows, in the end over all of the motion; arms that such a path meets become part of the
next window around that conflict, so that at last all arms are planned as one (Solis, Motes, Qin, Morales, Amato,
Adaptive robot coordination: a subproblem-based approach for hybrid multi-robot motion planning, 2023).
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
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.path import Path
from rr1plan.planners import RrtConnect
from rr1plan.planners.shortcut import shorten
from rr1plan.planning import Budget
from rr1plan.robot.joint_limits import Limits
from rr1plan.scene.problem import Problem

_FIRST = 0.1  # half of the first window, as a share of the slowest arm's motion
_GROWTH = 2.0  # of a window without a path
_ITERATIONS, _MOST_COUNTED = 500, 4  # of the planner on the first window, for each arm up to some
_SHORTCUTS = 48
# Windows in all, for each arm, before it is given up.
_MOST_WINDOWS = 6
_HALVINGS = 5  # of an edge until the conflict on it is looked at
# The slowest arm alone takes 1 on the nominal clock: instants nearer than this are one, and a step takes at least that.
_SAME, _SHORTEST = 1e-9, 1e-6


class Track(NamedTuple):
    """A polyline on the nominal clock; after its last waypoint it stays there.

    Args:
        times: When it is at each waypoint, from 0, ascending, shape (n,).
        points: Waypoints, shape (n, nq).
    """

    times: Array
    points: Array

    def at(self, times: Array) -> Array:
        """Configurations at some instants, shape (k, nq)."""
        return np.asarray(np.column_stack([np.interp(times, self.times, column) for column in self.points.T]))


class _Window(NamedTuple):
    """Arms that were planned as one from one instant to another."""

    arms: frozenset[str]
    begin: float
    end: float


def nominal_track(waypoints: Array, limits: Limits, unit: float = 1.0) -> Track:
    """A path at the velocity limits of its joints, from waypoint to waypoint.

    Args:
        waypoints: Shape (n, nq).
        limits: Of its joints.
        unit: Of its times [s].
    """
    fastest = np.where(np.isfinite(limits.velocity), limits.velocity, 1.0)
    steps = np.abs(np.diff(waypoints, axis=0))
    moves = steps.any(axis=1)
    # No step is so short that its ends are one instant.
    durations = np.maximum((steps[moves] / fastest).max(axis=1) / unit, _SHORTEST)
    return Track(np.concatenate([[0.0], np.cumsum(durations)]), waypoints[np.concatenate([[True], moves])])


class CoupledWindows:
    """Resolves the conflicts of some arms on the nominal clock.

    Args:
        paths: Waypoints of each arm's path alone, shape (n, nq).
        agent_of: The agent of some arms.
        margin: Distance to keep between all of them and from what stands still, beyond the padding [m].
        rng: Where random numbers come from.
        watch: Says when to give up.

    Attributes:
        tracks: Of each arm.
        windows: How many were planned.
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
        """When the last arm is at its goal on the nominal clock."""
        return max(float(track.times[-1]) for track in self.tracks.values())

    def solve(self, effort: int) -> bool:
        """Resolve one conflict after the other; whether none is left.

        Args:
            effort: How often the planner may double its iterations on a window that cannot grow any more.
        """
        scene = self._agent.question({}, self._margin).scene
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
                # Nothing has changed before it.
                after = window.begin
            return False

    def coupled_sets(self) -> list[tuple[str, ...]]:
        """Arms that were planned as one in some window, directly or through others; of one arm where it was not."""
        sets = [frozenset((arm,)) for arm in self.arms]
        for window in self._solved:
            joined = window.arms.union(*(s for s in sets if s & window.arms))
            sets = [*(s for s in sets if not s & joined), joined]
        return [tuple(arm for arm in self.arms if arm in s) for s in sets]

    def path(self, arms: Iterable[str]) -> Path:
        """The path of some arms in their joint space, as they move on the nominal clock."""
        names = tuple(arms)
        points = self._composite(names, self._knots(names))
        return Path(self._problem.scene.joint_names(names), points)

    # ---- conflicts -------------------------------------------------------------------------

    def _knots(self, arms: Iterable[str], begin: float = 0.0) -> Array:
        """Instants at which an arm is at a waypoint, from one on."""
        times = np.unique(np.concatenate([[begin], *(self.tracks[arm].times for arm in arms)]))
        times = times[times >= begin]
        # Of instants that are nearly the same the last, so that the end stays.
        kept: Array = times[np.append(np.diff(times) > _SAME, True)]
        return kept

    def _composite(self, arms: Iterable[str], times: Array) -> Array:
        return np.asarray(np.hstack([self.tracks[arm].at(times) for arm in arms]))

    def _first_conflict(self, checker: CollisionChecker, after: float) -> tuple[float, frozenset[str]] | None:
        """When and between which arms the first contact is; None if there is none."""
        times = self._knots(self.arms, after)
        points = self._composite(self.arms, times)
        if len(points) == 1:
            points, times = points.repeat(2, axis=0), times.repeat(2)
        for (one, two), (begin, end) in zip(pairwise(points), pairwise(times.tolist()), strict=True):
            if not self._watch.goes_on():
                # Not known, so there is no answer.
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
                # The fast and the exact certificate differ by a hair: all that moves there is planned anew.
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
        """Plan some arms as one around an instant; None if no path is found."""
        horizon, half, iterations = self.end, _FIRST * self.end, _ITERATIONS
        last: _Window | None = None
        while self._watch.goes_on():
            window = self._absorb(_Window(arms, max(0.0, time - half), min(horizon, time + half)))
            # What it absorbs may be longer than what it has grown by.
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
        """A window together with those before it that overlap with it and share an arm."""
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
        """A path of the arms of a window from where they are at its beginning to where they are at its end."""
        agent = self._agent_of(window.arms)
        ends = self._composite(agent.arms, np.array([window.begin, window.end]))
        scene = agent.question({}, self._margin).scene
        begin, end = (scene.split(q, agent.arms) for q in ends)
        question = Problem(
            scene, {arm: begin[arm] for arm in agent.arms}, {arm: end[arm] for arm in agent.arms}, arms=agent.arms
        ).with_margin(self._margin)
        with checker_from_pool(scene, agent.arms, self._margin) as checker:
            # Where others come to rest in the way, only the goal is sure to be free.
            if not (checker.edge_is_free(ends[0], ends[0]) and checker.edge_is_free(ends[1], ends[1])):
                return None
            budget = Budget(max(self._watch.left, 1e-3), iterations)
            result = RrtConnect().plan(question, budget=budget, rng=self._rng, progress=self._watch.let_planner_go_on)
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
        """Replace what the arms of a window do in it; what comes after it is shifted in time."""
        agent = self._agent_of(window.arms)
        track = nominal_track(points, agent.limits, self._unit)
        duration = float(track.times[-1])
        shift = duration - (window.end - window.begin)
        # Of joints that wrap, the planner may end some turns farther.
        turns = points[-1] - self._composite(agent.arms, np.array([window.end]))[0]
        parts = self._problem.scene.split(track.points[0], agent.arms)
        first = 0
        for arm in agent.arms:
            columns = slice(first, first + len(parts[arm]))
            first = columns.stop
            old = self.tracks[arm]
            before, behind = old.times < window.begin - _SAME, old.times > window.end + _SAME
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
            if other.arms & window.arms and other.begin >= window.end - _SAME
            else other
            for other in kept
        ]
        self._solved.append(solved)
        return solved
