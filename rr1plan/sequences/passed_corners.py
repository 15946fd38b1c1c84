"""Segments that do not stop at their ends: their paths are timed together, with rounded corners between them.

A segment then ends at the time at which the motion is nearest to the end of its path.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from rr1plan.checks import Array
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.path import Path, edge_lengths
from rr1plan.retiming import retime
from rr1plan.sequences.segment_options import PlannedSegment
from rr1plan.sequences.segments import FreeMotion, StraightLine
from rr1plan.trajectory import Trajectory

# Samples on each piece of a motion in the search for the end of a segment, and their number for refinement.
_PER_PIECE, _FINE, _ROUNDS = 8, 33, 4
# Rounded corners shorten a motion by at most this share of its path.
_SHORTER = 0.2
# Tolerance for reaching a corner, and for rest [rad or m; per second].
_MET = 1e-9


def pass_corners(steps: Sequence[PlannedSegment]) -> tuple[PlannedSegment, ...]:
    """The segments without stops where none is needed.

    Blends are certified with the allowed pairs of all segments of a run, and the referee validates each segment.

    Args:
        steps: Planned segments; motions are from rest to rest.
    """
    found: list[PlannedSegment] = []
    for run in _runs(steps):
        found += _timed_together(run) if len(run) > 1 else run
    return tuple(found)


def _runs(steps: Sequence[PlannedSegment]) -> Iterator[list[PlannedSegment]]:
    """Segments that are timed together."""
    run: list[PlannedSegment] = []
    for step in steps:
        if run and not _goes_on(run[-1], step):
            yield run
            run = []
        run.append(step)
    if run:
        yield run


def _goes_on(step: PlannedSegment, following: PlannedSegment) -> bool:
    segment, one, other = step.segment, step.trajectory, following.trajectory
    if not isinstance(segment, FreeMotion | StraightLine) or segment.stop or following.motion is None:
        return False
    both = one is not None and other is not None and one.joint_names == other.joint_names
    return both and min(step.seconds, following.seconds) > 0.0


def _timed_together(run: Sequence[PlannedSegment]) -> list[PlannedSegment]:
    """One motion for some segments, cut where it is nearest to their ends."""
    motions = [step.motion for step in run if step.motion is not None]
    scene = motions[0].scene
    scene = replace(scene, allowed=scene.allowed.union(*(motion.scene.allowed for motion in motions)))
    points = [motion.path.waypoints for motion in motions]
    path = Path(motions[0].path.joint_names, np.concatenate([points[0], *(part[1:] for part in points[1:])]))
    margin = min(motion.margin for motion in motions)
    with checker_from_pool(scene, path.arms, margin) as checker:
        trajectory = retime(path, scene, checker=checker)
    lengths = np.array([float(edge_lengths(part).sum()) for part in points])
    shares = lengths.cumsum() / lengths.sum()
    cuts = [0.0, *_ends(trajectory, [part[-1] for part in points[:-1]], shares[:-1]), trajectory.end_time]
    if not (np.diff(cuts) > 0.0).all():
        return list(run)
    return [
        replace(step, trajectory=trajectory.cut(begin, end), seconds=end - begin)
        for step, begin, end in zip(run, cuts[:-1], cuts[1:], strict=True)
    ]


def _ends(trajectory: Trajectory, corners: Sequence[Array], shares: Array) -> list[float]:
    """Times at which a motion is nearest to some points, each near a share of its length."""
    breaks = trajectory.breaks
    within = np.diff(breaks)[:, None] * np.arange(_PER_PIECE) / _PER_PIECE
    times = np.append((breaks[:-1, None] + within).ravel(), breaks[-1])
    q = trajectory(times)
    way = np.concatenate([[0.0], edge_lengths(q).cumsum()])
    found = []
    for corner, share in zip(corners, shares.tolist(), strict=True):
        off = np.linalg.norm(q - corner, axis=1)
        near = np.abs(way / way[-1] - share) <= _SHORTER
        k = int(np.argmin(np.where(near, off, np.inf)))
        time = float(times[k])
        if off[k] > _MET or np.abs(trajectory(time, 1)).max() > _MET:
            time = _nearest(trajectory, corner, float(times[max(k - 1, 0)]), float(times[min(k + 1, len(times) - 1)]))
        found.append(time)
    return found


def _nearest(trajectory: Trajectory, point: Array, begin: float, end: float) -> float:
    """Time between two others at which a motion is nearest to a point."""
    for _ in range(_ROUNDS):
        times = np.linspace(begin, end, _FINE)
        k = int(np.argmin(np.linalg.norm(trajectory(times) - point, axis=1)))
        begin, end = float(times[max(k - 1, 0)]), float(times[min(k + 1, _FINE - 1)])
    return float(times[k])
