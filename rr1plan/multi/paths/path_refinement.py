"""Random changes of an agent's path that are certified, of which those are kept that save time.

A change is timed before it is certified, with corners as round as their edges allow: four of five would save nothing.
Most edges and corners of a changed path are those of the path before, so each is certified once.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.errors import RetimingError
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.paths.path_changes import changed_waypoints
from rr1plan.path import Path
from rr1plan.retiming.path_blends import clean


class PathRefiner:
    """Changes the paths of one agent.

    Args:
        checker: Certifies edges and rounded corners of the agent's joints.
        rng: Where random numbers come from.
    """

    def __init__(self, checker: CollisionChecker, rng: np.random.Generator) -> None:
        self._checker, self._rng = _RememberingChecker(checker), rng

    def change(self, path: AgentPath, longest: float) -> AgentPath | None:
        """A path with one random change, of one arm where it is not a shortcut.

        Args:
            path: A certified path.
            longest: Duration from which on a path is of no use [s].

        Returns:
            The path; None where the change is not free, or of no use.
        """
        if path.segments == 0:
            return None
        agent, waypoints = path.agent, clean(path.path.waypoints)
        columns = list(agent.columns.values())
        arm = columns[int(self._rng.integers(len(columns)))]
        changed = changed_waypoints(waypoints, agent.limits, self._rng, arm)
        if np.array_equal(changed, waypoints):
            return None
        new = Path(agent.joint_names, changed)
        try:
            if AgentPath(agent, new, None).fastest >= longest:
                return None
            if not all(self._checker.edge_is_free(a, b) for a, b in pairwise(changed)):
                return None
            made = AgentPath(agent, new, self._checker)
        except RetimingError:
            return None
        return made if made.fastest < longest else None

    def refine(self, path: AgentPath, changes: int, goes_on: Callable[[], bool]) -> AgentPath:
        """A path after random changes, of which those are kept that save time.

        Args:
            path: A certified path.
            changes: How many to try, at most.
            goes_on: Whether there is time for another one.
        """
        for _ in range(changes):
            if not goes_on():
                break
            path = self.change(path, path.fastest) or path
        return path


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
