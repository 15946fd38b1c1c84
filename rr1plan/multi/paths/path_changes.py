"""Random changes of a polyline: shortcuts, and waypoints that are moved, inserted or straightened.

Most changes shorten a path where other agents leave room; some lengthen it, because a longer path that no other agent
crosses may be faster.
"""

from __future__ import annotations

import numpy as np

from rr1plan.checks import Array
from rr1plan.path import edge_lengths
from rr1plan.robot.joint_limits import Limits

# Standard deviation of the displacement of a waypoint, as a share of the path length.
_DISPLACEMENT = 0.1
# Kinds of changes: a shortcut, straightening at a waypoint, moving a waypoint, inserting one.
_SHORTCUT, _STRAIGHTEN, _MOVE, _INSERT = range(4)
_KINDS = (_SHORTCUT, _STRAIGHTEN, _MOVE, _INSERT)


def changed_waypoints(waypoints: Array, limits: Limits, rng: np.random.Generator) -> Array:
    """A polyline with the same ends and one random change, within position limits; not certified.

    Args:
        waypoints: The polyline, without repeated waypoints, shape (n, nq), n >= 2.
        limits: Position limits.
        rng: Source of random numbers.

    Returns:
        Waypoints, shape (m, nq).
    """
    kind = _KINDS[int(rng.integers(len(_KINDS)))] if len(waypoints) > 2 else _INSERT
    if kind == _SHORTCUT:
        return _shortcut(waypoints, rng)
    if kind == _STRAIGHTEN:
        return _straightened(waypoints, rng)
    length = float(edge_lengths(waypoints).sum())
    size = _DISPLACEMENT * length * rng.random()
    if kind == _MOVE:
        row = 1 + int(rng.integers(len(waypoints) - 2))
        changed = waypoints.copy()
    else:
        row, point = _random_point(waypoints, rng)
        changed = np.insert(waypoints, row, point, axis=0)
    moved = changed[row] + size * rng.standard_normal(changed[row].shape)
    changed[row] = np.clip(moved, limits.lower, limits.upper)
    return changed


def _shortcut(waypoints: Array, rng: np.random.Generator) -> Array:
    """Connect two random points by a straight line."""
    (a, one), (b, two) = sorted((_random_point(waypoints, rng) for _ in range(2)), key=lambda found: found[0])
    return np.vstack([waypoints[:a], one, two, waypoints[b:]])


def _straightened(waypoints: Array, rng: np.random.Generator) -> Array:
    """Move a waypoint toward the line between its neighbors, often onto it."""
    row = 1 + int(rng.integers(len(waypoints) - 2))
    before, corner, after = waypoints[row - 1 : row + 2]
    line = after - before
    share = float(np.clip((corner - before) @ line / max(float(line @ line), 1e-300), 0.0, 1.0))
    changed = waypoints.copy()
    changed[row] += min(1.0, 1.5 * rng.random()) * (before + share * line - corner)
    return changed


def _random_point(waypoints: Array, rng: np.random.Generator) -> tuple[int, Array]:
    """A random point on the polyline, and the row of the waypoint after it."""
    borders = np.concatenate([[0.0], np.cumsum(edge_lengths(waypoints))])
    at = rng.random() * borders[-1]
    row = min(int(np.searchsorted(borders, at, side="right")), len(waypoints) - 1)
    length = borders[row] - borders[row - 1]
    share = (at - borders[row - 1]) / length if length > 0.0 else 0.0
    return row, waypoints[row - 1] + share * (waypoints[row] - waypoints[row - 1])
