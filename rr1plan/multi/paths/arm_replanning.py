"""A motion of one arm among others whose motions are given, searched in configurations and time (`replan_arm.c`).

To make the motion of a group faster, one arm is taken out of it, while all others keep theirs (large neighborhood
search: Li et al., 2021). The group then takes only as long as the others need, and another motion of the arm is
searched that takes no longer than a random duration in between.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.kernels.planner_kernels import CStruct, load_library
from rr1plan.kernels.random_state import random_state
from rr1plan.multi.paths.nominal_clock import Track, nominal_velocity
from rr1plan.multi.paths.paced_polyline import PacedPolyline
from rr1plan.robot.joint_limits import Limits

_SAMPLES = 60  # of a search
_SAMPLES_AT_ONCE = 25  # 0.1 s among many arms with many solids
_SHORTCUTS = 15  # of the motion that is found
# A new motion takes at most this share of the present duration, or as long as the others or the arm alone need.
_SAVING = 0.9
# An arm is replanned only if the others need less than this share of the present duration.
_OTHERS = 0.99


def replanned(path: PacedPolyline, checker: CollisionChecker, rng: np.random.Generator) -> Array | None:
    """A path with another motion of one random arm, shape (m, nq); None if none is found.

    Its edges are not certified: only pairs that involve the arm have been tested.

    Args:
        path: A certified path of several arms.
        checker: Certifies edges of their joints.
        rng: Source of random numbers.
    """
    points, duration = path.points, path.arm_times.max(axis=1).sum()
    # Durations of the edges without each arm, shape (edges, arms).
    without = np.stack([np.delete(path.arm_times, k, axis=1).max(axis=1) for k in range(len(path.columns))], axis=1)
    gains = duration - without.sum(axis=0)
    gains[gains < (1.0 - _OTHERS) * duration] = 0.0
    if gains.sum() == 0.0:
        return None
    arm = int(rng.choice(len(gains), p=gains / gains.sum()))
    own, times = path.columns[arm], np.concatenate([[0.0], np.cumsum(without[:, arm])])
    # Waypoints between which only this arm moves coincide.
    kept = np.concatenate([[True], np.diff(times) > 0.0])
    if kept.sum() < 2:
        return None
    alone = (np.abs(points[-1, own] - points[0, own]) / path.velocity[own]).max()
    least = max(times[-1], alone)
    most = least + rng.random() * max(0.0, _SAVING * duration - least)
    times = times[kept] * (most / times[-1])
    given = points[kept]
    given[-1] = points[-1]
    others = Track(times, given)
    found = search_in_time(checker, others, own, path.limits, rng, samples=_SAMPLES)
    if found is None:
        return None
    instants = np.union1d(times, found.times)
    made = others.at(instants)
    made[:, own] = found.at(instants)
    return made


def search_in_time(
    checker: CollisionChecker,
    others: Track,
    own: slice,
    limits: Limits,
    rng: np.random.Generator,
    *,
    samples: int,
    left_out: NDArray[np.uint8] | None = None,
    goes_on: Callable[[], bool] = lambda: True,
) -> Track | None:
    """Search for a motion of one arm among others whose motions are given.

    Args:
        checker: Certifies edges of the joints of all arms.
        others: The motions of all arms; of the arm itself only its start and its goal matter.
        own: Columns of the arm.
        limits: Limits of all joints; a missing velocity limit counts as 1.
        rng: Source of random numbers.
        samples: Largest number of samples.
        left_out: 1 for columns of arms that are ignored, shape (nq,) (default: none).
        goes_on: Whether time is left; called every few samples.

    Returns:
        The motion of the arm, at its velocity limits or slower; None if none is found.
    """
    nq, width = others.points.shape[1], own.stop - own.start
    knots, knot_times = np.empty((samples + 2, width)), np.empty(samples + 2)
    search = CStruct(
        "ArmReplan",
        times=others.times,
        points=others.points,
        count=len(others.points),
        column_count=nq,
        first_column=own.start,
        width=width,
        left_out=np.zeros(nq, np.uint8) if left_out is None else left_out,
        velocity=nominal_velocity(limits)[own].copy(),
        lower=limits.lower[own].copy(),
        upper=limits.upper[own].copy(),
        samples=min(samples, _SAMPLES_AT_ONCE),
        shortcuts=_SHORTCUTS,
        vertices=np.empty((samples + 1, width)),
        reached=np.empty(samples + 1),
        parents=np.empty(samples + 1, np.int64),
        knots=knots,
        knot_times=knot_times,
        memory=np.empty(2 * (nq + width)),
    )
    kernel, random = load_library().rr1_replan_arm, random_state(int(rng.integers(2**63)))
    count = checker.run_edge_kernel(kernel, search, random)
    for first in range(_SAMPLES_AT_ONCE, samples, _SAMPLES_AT_ONCE):
        if count or not goes_on():
            break
        search.set(samples=min(samples, first + _SAMPLES_AT_ONCE))
        count = checker.run_edge_kernel(kernel, search, random)
    return Track(knot_times[:count], knots[:count]) if count else None
