"""Shorter paths by certified shortcuts.

A planner's path wanders. Three moves make it shorter, and each new edge is certified before it is
taken: skip vertices; join two random points by a straight line; straighten a single joint between
two random points and leave the others as they are (Geraerts and Overmars, Creating high-quality paths
for motion planning, 2007). `smooth` then cuts corners (Chaikin, An algorithm for high-speed curve
generation, 1974). No move is taken that makes the path longer.
"""

from __future__ import annotations

import math
import time
from itertools import pairwise

import numpy as np

from rr1plan.checks import Array, Seed, as_generator, positive_number
from rr1plan.collision import MotionChecker
from rr1plan.errors import InputError
from rr1plan.path import Path

# A shortcut that gains less than this part of the length is not worth its check.
_WORTH = 1e-3
# After so many shortcuts in a row that gained nothing, more are unlikely to.
_PATIENCE = 60
# No shortcut begins or ends this near beside a vertex [rad].
_SNAP = 1e-3
# A corner that cannot be cut is tried closer, this many times.
_CLOSER = 4


def shorten(
    path: Path,
    checker: MotionChecker,
    *,
    rng: Seed = None,
    iterations: int = 300,
    seconds: float = math.inf,
    smooth: int = 0,
) -> Path:
    """A path with the same ends that is never longer.

    Every edge of the result is certified here, or is a part of an edge of `path`: a free path stays free.

    Args:
        path: Any number of waypoints; repeated ones are dropped.
        checker: Certifies edges; of the same joints as the path.
        rng: Generator or seed; with a seed and no time limit the result is reproducible.
        iterations: Random shortcuts to try at most, >= 0.
        seconds: Wall time to stop after [s].
        smooth: How often to cut the corners (each time nearly doubles the waypoints), >= 0.

    Raises:
        InputError: another set of joints, a negative count, or no time at all.
    """
    if path.joint_names != checker.checker.joint_names:
        raise InputError(
            f"the path has joints {', '.join(path.joint_names)}, "
            f"the checker has {', '.join(checker.checker.joint_names)}; expected the same"
        )
    if iterations < 0 or smooth < 0:
        raise InputError(f"iterations is {iterations} and smooth is {smooth}, expected numbers >= 0")
    if not math.isinf(seconds):
        positive_number("seconds", seconds)
    return _Shortener(checker, as_generator(rng), time.perf_counter() + seconds).run(path, iterations, smooth)


class _Shortener:
    """The moves, on a list of waypoints; out of time, every edge counts as blocked and the loops run dry."""

    def __init__(self, checker: MotionChecker, rng: np.random.Generator, deadline: float) -> None:
        self._checker = checker
        self._rng = rng
        self._deadline = deadline

    def run(self, path: Path, iterations: int, smooth: int) -> Path:
        points = self._skip_vertices(_without_repeats(path.waypoints))
        points = self._skip_vertices(self._random_shortcuts(points, iterations))
        for _ in range(smooth):
            points = self._cut_corners(points)
        result = Path(path.joint_names, np.array(points))
        return result if result.length <= path.length else Path(path.joint_names, path.waypoints)

    def _expired(self) -> bool:
        return time.perf_counter() >= self._deadline

    def _is_free(self, points: list[Array]) -> bool:
        return all(not self._expired() and self._checker.edge_is_free(a, b) for a, b in pairwise(points))

    def _skip_vertices(self, points: list[Array]) -> list[Array]:
        """From each vertex go straight as far ahead as it takes; the jumps tried are all, a half, a quarter..."""
        points = list(points)
        i = 0
        while i < len(points) - 2:
            jump = len(points) - 1 - i
            while jump > 1 and not self._is_free([points[i], points[i + jump]]):
                jump //= 2
            del points[i + 1 : i + jump]
            i += 1
        return points

    def _random_shortcuts(self, points: list[Array], iterations: int) -> list[Array]:
        idle = 0
        for _ in range(iterations):
            if len(points) < 3 or idle >= _PATIENCE or self._expired():
                break
            shorter = self._shortcut(points)
            idle = 0 if shorter is not None else idle + 1
            points = points if shorter is None else shorter
        return points

    def _shortcut(self, points: list[Array]) -> list[Array] | None:
        """The path with one random piece replaced by a shorter free one, or None."""
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        along = np.concatenate([[0.0], np.cumsum(steps)])
        begin, end = (_snapped(s, along) for s in np.sort(self._rng.uniform(0.0, along[-1], 2)))
        joint = int(self._rng.integers(-2, len(points[0])))
        i, j = int(np.searchsorted(along, begin, side="right")) - 1, int(np.searchsorted(along, end)) - 1
        if i >= j:
            return None
        a = points[i] if begin == along[i] else _between(points[i], points[i + 1], (begin - along[i]) / steps[i])
        b = points[j + 1] if end == along[j + 1] else _between(points[j], points[j + 1], (end - along[j]) / steps[j])
        piece = [a, b]
        if joint >= 0:
            share = (along[i + 1 : j + 1] - begin) / (end - begin)
            piece = [a, *_straightened(points[i + 1 : j + 1], a, b, joint, share), b]
        if _length(piece) > end - begin - _WORTH * along[-1] or not self._is_free(piece):
            return None
        return _without_repeats([*points[: i + 1], *piece, *points[j + 1 :]])

    def _cut_corners(self, points: list[Array]) -> list[Array]:
        """Each corner replaced by two points, a quarter of the way to its neighbours or closer."""
        result = points[:1]
        for before, corner, after in zip(points[:-2], points[1:-1], points[2:], strict=True):
            cut = 0.25
            for _ in range(_CLOSER):
                ends = [corner + cut * (before - corner), corner + cut * (after - corner)]
                if self._is_free(ends):
                    result += ends
                    break
                cut *= 0.5
            else:
                result.append(corner)
        return _without_repeats([*result, *points[1:][-1:]])


def _snapped(place: float, along: Array) -> float:
    """The place, or a vertex that is so near that the edge between would only be a burden."""
    nearest = float(along[np.argmin(np.abs(along - place))])
    return nearest if abs(nearest - place) < _SNAP else place


def _between(a: Array, b: Array, share: float) -> Array:
    return np.asarray(a + share * (b - a))


def _straightened(points: list[Array], a: Array, b: Array, joint: int, share: Array) -> list[Array]:
    """The points with one joint on the straight line from a to b, at the given shares of the way."""
    moved = [p.copy() for p in points]
    for p, s in zip(moved, share, strict=True):
        p[joint] = a[joint] + s * (b[joint] - a[joint])
    return moved


def _without_repeats(points: Array | list[Array]) -> list[Array]:
    kept = [points[0]]
    kept += [p for last, p in pairwise(points) if not np.array_equal(last, p)]
    return kept


def _length(points: list[Array]) -> float:
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
