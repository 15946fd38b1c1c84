"""Certified changes of an agent's path; those that save time are kept.

Of several arms, one is given another motion among all others (`arm_replanning.py`), in turn with random changes.
A change is timed before it is certified, with corners as round as their edges allow, because most changes save nothing.
Most edges and corners of a changed path belong to the previous path, so each is certified once.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np

from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.errors import RetimingError
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.agent_path import LARGEST_BLEND, AgentPath
from rr1plan.multi.paths.arm_replanning import replanned
from rr1plan.multi.paths.paced_polyline import PacedPolyline
from rr1plan.multi.paths.path_changes import changed_waypoints
from rr1plan.path import Path
from rr1plan.retiming.path_blends import CurveChecker, blend_sizes, clean
from rr1plan.retiming.path_speed import rounded_duration

# Other motions of one arm, and random changes, that are tried for each arm in a round of refinement; a round that saves
# less than this ratio is the last one.
_REPLANS, _CHANGES, _LEAST_SAVING = 4, 17, 0.015
# Intervals of each line and each rounded corner in an estimate of a duration: 1 to 3 % longer than on a path's
# own grid, which takes ten times as long.
_INTERVALS = 2


class PathRefiner:
    """Changes the paths of one agent.

    Args:
        checker: Certifies edges and rounded corners of the agent's joints.
        rng: Where random numbers come from.
    """

    def __init__(self, checker: CollisionChecker, rng: np.random.Generator) -> None:
        self._checker, self._remembered, self._rng = checker, _RememberingChecker(checker), rng

    def change(self, path: AgentPath, longest: float) -> AgentPath | None:
        """A path of one arm with one random change.

        Args:
            path: A certified path.
            longest: Duration above which a path is useless [s].

        Returns:
            The path; None if the change is not free, or useless.
        """
        if path.segments == 0:
            return None
        agent, waypoints = path.agent, clean(path.path.waypoints)
        changed = changed_waypoints(waypoints, agent.limits, self._rng)
        if np.array_equal(changed, waypoints):
            return None
        new = Path(agent.joint_names, changed)
        try:
            if AgentPath(agent, new, None).fastest >= longest:
                return None
            if not self._edges_are_free(changed):
                return None
            made = AgentPath(agent, new, self._remembered)
            return made if made.fastest < longest else None
        except RetimingError:
            return None

    def refine(self, path: AgentPath, goes_on: Callable[[], bool], enough: float = 0.0) -> AgentPath:
        """The path of several arms after rounds of changes that save time, until a round saves little.

        In a round, single arms are given other motions first, and then random changes are tried.

        Args:
            path: A certified path.
            goes_on: Whether there is time for another change.
            enough: Duration that is not reduced further [s].
        """
        agent = path.agent
        best = PacedPolyline(clean(path.path.waypoints), agent.limits, list(agent.columns.values()))
        duration = estimated_duration(best.points, agent, self._remembered)
        searches, changes = (count * len(agent.arms) for count in (_REPLANS, _CHANGES))
        before = math.inf
        while duration < (1.0 - _LEAST_SAVING) * before:
            before = duration
            for k in range(searches + changes):
                if duration <= enough or len(best.points) <= 2 or not goes_on():
                    break
                changed = replanned(best, self._checker, self._rng) if k < searches else best.changed(self._rng)
                if changed is None:
                    continue
                points = clean(changed)
                if estimated_duration(points, agent, None) >= duration or not self._edges_are_free(points):
                    continue
                certified = estimated_duration(points, agent, self._remembered)
                if certified < duration:
                    best, duration = best.replaced(points), certified
        try:
            made = AgentPath(agent, Path(agent.joint_names, best.points), self._remembered)
            return made if made.fastest < path.fastest else path
        except RetimingError:
            return path

    def _edges_are_free(self, points: Array) -> bool:
        return all(self._remembered.edge_is_free(a, b) for a, b in pairwise(points))


def estimated_duration(points: Array, agent: Agent, checker: CurveChecker | None) -> float:
    """Approximate duration of an agent's motion along a polyline with rounded corners, or with stops at them [s].

    Args:
        points: Cleaned waypoints, shape (n, nq).
        agent: The agent.
        checker: Certifies rounded corners; None for corners as round as their edges allow.
    """
    rounded = agent.timing.method == "blend"
    sizes = blend_sizes(points, LARGEST_BLEND, checker) if rounded else np.zeros(len(points))
    return rounded_duration(points, sizes, agent.limits, _INTERVALS)


class _RememberingChecker:
    """A checker that certifies each edge and each rounded corner once."""

    def __init__(self, checker: CollisionChecker) -> None:
        self._checker = checker
        self._edges: dict[tuple[bytes, bytes], bool] = {}
        self._curves: dict[tuple[bytes, float], bool] = {}

    def edge_is_free(self, begin: Array, end: Array) -> bool:
        key = begin.tobytes(), end.tobytes()
        if key not in self._edges:
            self._edges[key] = self._checker.edge_is_free(begin, end)
        return self._edges[key]

    def polynomial_is_free(self, coefficients: Array, duration: float) -> bool:
        key = coefficients.tobytes(), duration
        if key not in self._curves:
            self._curves[key] = self._checker.polynomial_is_free(coefficients, duration)
        return self._curves[key]
