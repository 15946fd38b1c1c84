"""Prioritized planning in space and time: each arm avoids the motions of those before it.

The first arm follows its own path. For each further one, configurations and times are searched for a motion among
these moving obstacles (Erdmann and Lozano-Pérez, On multiple moving objects, 1987); arms without a motion are
ignored. An arm for which none is found is the first one in the next attempt, in which motions may take longer. The
result is a path in the joint space of all arms; `path_refinement.py` makes it faster.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.arm_replanning import search_in_time
from rr1plan.multi.paths.nominal_clock import Track, knots, nominal_track
from rr1plan.multi.stopwatch import Stopwatch

_ATTEMPTS = 4  # per arm
_SAMPLES = 400  # of the search for one motion
# Largest duration of all motions as a multiple of that of the slowest path alone; reached in the last attempt.
_LONGEST = 2.2


class SpaceTimeSearch:
    """Plans a group of arms one after the other, in configurations and time.

    Args:
        agent: All arms as one agent.
        paths: Waypoints of each arm's path alone, shape (n, nq).
        margin: Clearance between the arms and from stationary objects, in addition to the padding [m].
        rng: Source of random numbers.
        watch: Stopwatch with the deadline.
    """

    def __init__(
        self, agent: Agent, paths: Mapping[str, Array], margin: float, rng: np.random.Generator, watch: Stopwatch
    ) -> None:
        self._agent, self._margin, self._rng, self._watch = agent, margin, rng, watch
        scene = agent.problem.scene
        self._alone = {arm: nominal_track(paths[arm], scene.limits((arm,))) for arm in agent.arms}

    def solve(self) -> Array | None:
        """Waypoints of all arms from their starts to their goals, shape (n, nq); None if none are found."""
        order = self._rng.permutation(self._agent.arms).tolist()
        slowest = max(float(track.times[-1]) for track in self._alone.values())
        if slowest == 0.0:
            return None
        with checker_from_pool(self._agent.query({}, self._margin).scene, self._agent.arms, self._margin) as checker:
            for factor in np.linspace(1.0, _LONGEST, _ATTEMPTS * len(order)).tolist():
                tracks = self._plan_in_order(checker, order, factor * slowest)
                if len(tracks) == len(order):
                    times = knots(tracks.values())
                    points = np.hstack([tracks[arm].at(times) for arm in self._agent.arms])
                    # Waypoints of other arms divide edges, which rounds them.
                    if checker.path_is_free(points):
                        return points
                else:
                    order.insert(0, order.pop(len(tracks)))
                if not self._watch.goes_on():
                    break
        return None

    def _plan_in_order(self, checker: CollisionChecker, order: list[str], duration: float) -> dict[str, Track]:
        """Motions of all arms that take a given time [s]; only those before the first arm without a motion."""
        first, *others = order
        tracks = {first: _rested(self._alone[first], duration, self._rng)}
        for arm in others:
            track = self._motion(checker, arm, tracks) if self._watch.goes_on() else None
            if track is None:
                break
            tracks[arm] = track
        return tracks

    def _motion(self, checker: CollisionChecker, arm: str, tracks: Mapping[str, Track]) -> Track | None:
        """A motion of an arm among others that takes as long as theirs; None if none is found."""
        agent, columns, times = self._agent, self._agent.columns, knots(tracks.values())
        points, left_out = np.tile(agent.start, (len(times), 1)), np.ones(len(agent.start), np.uint8)
        for other, track in tracks.items():
            points[:, columns[other]] = track.at(times)
            left_out[columns[other]] = 0
        left_out[columns[arm]] = 0
        points[-1, columns[arm]] = self._alone[arm].points[-1]
        return search_in_time(
            checker,
            Track(times, points),
            columns[arm],
            agent.limits,
            self._rng,
            samples=_SAMPLES,
            left_out=left_out,
            goes_on=self._watch.goes_on,
        )


def _rested(track: Track, end: float, rng: np.random.Generator) -> Track:
    """A track that rests before and after its motion, for random times that add up to an end."""
    times, points = track.times + rng.random() * max(0.0, end - float(track.times[-1])), track.points
    if times[0] > 0.0:
        times, points = np.append(0.0, times), np.vstack([points[:1], points])
    if times[-1] < end:
        times, points = np.append(times, end), np.vstack([points, points[-1:]])
    return Track(times, points)
