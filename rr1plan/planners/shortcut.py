"""Path shortening by certified shortcuts.

Each new edge is certified before it is taken. Three moves shorten a path: skip vertices; join two random
points by a straight line; straighten a single joint between two random points and leave the others unchanged
(Geraerts and Overmars, Creating high-quality paths for motion planning, 2007). Of eight random moves
the one with the largest expected gain is tried, given the shortcuts that failed before. `smooth` then cuts
corners (Chaikin, An algorithm for high-speed curve generation, 1974). No move makes the path longer. All
moves except corner cutting are compiled (`shortcut.c`).
"""

from __future__ import annotations

import math
import time
from itertools import pairwise

import numpy as np

from rr1plan.checks import Array, Seed, as_seed, of_kind, positive_number, whole_number
from rr1plan.collision import CollisionChecker
from rr1plan.collision.checker import check_fits
from rr1plan.kernels.planner_kernels import CStruct, load_library
from rr1plan.kernels.random_state import random_state
from rr1plan.path import Path
from rr1plan.planning_constants import SHORTCUTS
from rr1plan.scene import Scene

_MOST_ITERATIONS = 1_000_000
_MOST_SMOOTH = 10
# Steps of the compiled loop between two clock readings, times the number of joints.
_CHUNK = 896
# Attempts to cut a corner, each at half the distance of the one before.
_CLOSER = 4


def shorten(
    path: Path,
    scene: Scene,
    *,
    checker: CollisionChecker | None = None,
    iterations: int = 16,
    seconds: float = math.inf,
    smooth: int = 0,
    rng: Seed = None,
) -> Path:
    """Shorten a path between the same start and end; the result is never longer.

    A free path stays free: every edge of the result is a part of an edge of `path`, or certified given that its ends on
    `path` are free.

    Args:
        path: Any number of waypoints; repeated ones are dropped.
        scene: The scene with its obstacles.
        checker: Collision checker for the joints of the path (default: a `CollisionChecker` of the scene for its arms).
        iterations: Random shortcuts to try at most, >= 0; four times as many take three times as long, and make
            paths around many obstacles shorter by a twentieth or more.
        seconds: Wall time to stop after [s].
        smooth: How often to cut the corners (each time nearly doubles the waypoints), 0 to 10.
        rng: Generator or seed; with a seed and no time limit the result is reproducible.

    Raises:
        UnknownNameError: a joint's arm is not in the scene.
        InputError: a checker of other joints or another scene, a count that is negative or too large, or no time at
            all.
    """
    of_kind("path", path, Path)
    of_kind("scene", scene, Scene)
    of_kind("checker", checker, CollisionChecker, optional=True)
    if checker is None:
        checker = CollisionChecker(scene, path.arms)
    check_fits(checker, path, scene)
    iterations = whole_number("iterations", iterations, 0, _MOST_ITERATIONS)
    smooth = whole_number("smooth", smooth, 0, _MOST_SMOOTH)
    if type(seconds) is not float or seconds != math.inf:
        seconds = positive_number("seconds", seconds)
    shortener = _Shortener(path, checker, as_seed(rng), iterations, time.perf_counter() + seconds)
    shortener.run(iterations)
    points = shortener.waypoints()
    for _ in range(smooth):
        points = shortener.cut_corners(points)
    # Rounding may lengthen a path whose waypoints are on a line.
    rows = (np.ascontiguousarray(path.waypoints), points)
    before, after = (load_library().rr1_polyline_length(points, *points.shape) for points in rows)
    return Path.trusted(path.joint_names, points) if after <= before else path


class _Shortener:
    """The path in the arrays of the kernel, and the moves on it."""

    def __init__(self, path: Path, checker: CollisionChecker, seed: int, iterations: int, deadline: float) -> None:
        self._checker = checker
        self._deadline = deadline
        rows, nq = path.waypoints.shape
        capacity = rows + 2 * iterations
        self._points = np.empty((capacity, nq))
        self._points[:rows] = path.waypoints
        self._path = CStruct(
            "ShortcutPath",
            points=self._points,
            piece=np.empty((capacity, nq)),
            along=np.empty(capacity),
            column_count=nq,
            size=rows,
        )
        self._state = random_state(seed)

    def run(self, iterations: int) -> None:
        """Skip vertices, try shortcuts, skip vertices again."""
        # The kernel skips pairs without relative motion; if one of them collides, no edge is free.
        if not self._checker.static_is_free:
            self._deadline = -math.inf
        call, chunk = load_library().rr1_shorten, max(1, _CHUNK // self._points.shape[1])
        over = done = False
        while not (over or done):
            over = self._expired()
            steps = 0 if over else chunk
            given = self._path, self._state, steps, iterations, SHORTCUTS.patience
            done = bool(self._checker.run_edge_kernel(call, *given))
        self._checker.edges_checked += self._path.value.edges

    def waypoints(self) -> Array:
        """The current path, shape (n, nq)."""
        return self._points[: self._path.value.size].copy()

    def _expired(self) -> bool:
        return time.perf_counter() >= self._deadline

    def cut_corners(self, points: Array) -> Array:
        """Replace each corner by two points, at most a quarter of the distance to its neighbors away."""
        result = list(points[:1])
        for before, corner, after in zip(points[:-2], points[1:-1], points[2:], strict=True):
            cut = 0.25
            for _ in range(_CLOSER):
                one, two = corner + cut * (before - corner), corner + cut * (after - corner)
                if not self._expired() and self._checker.edge_is_free(one, two):
                    result += [one, two]
                    break
                cut *= 0.5
            else:
                result.append(corner)
        return np.array(_without_repeats([*result, *points[1:][-1:]]))


def _without_repeats(points: list[Array]) -> list[Array]:
    kept = [points[0]]
    kept += [p for last, p in pairwise(points) if not np.array_equal(last, p)]
    return kept
