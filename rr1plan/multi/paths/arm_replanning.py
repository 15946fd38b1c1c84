"""A new motion of one arm of a group, while all others keep theirs (large neighborhood search: Li et al., 2021).

The arm is taken out of the motion of the group, which then takes only as long as the others need. `replan_arm.c`
searches its configurations and time for another motion that takes no longer than a random duration in between.
"""

from __future__ import annotations

import numpy as np

from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.kernels.planner_kernels import CStruct, load_library
from rr1plan.kernels.random_state import random_state
from rr1plan.multi.agents import Agent

# Samples of a search, and shortcuts of the motion that it finds.
_SAMPLES, _SHORTCUTS = 60, 15
# A new motion has to take less than this share of the present duration.
_SAVING = 0.9
# An arm is replanned only if the others need less than this share of the present duration.
_OTHERS = 0.99


class ArmReplanner:
    """Searches for other motions of single arms of a group.

    Args:
        agent: The arms.
        checker: Certifies edges of their joints.
    """

    def __init__(self, agent: Agent, checker: CollisionChecker) -> None:
        self._checker, self._columns = checker, list(agent.columns.values())
        limits = agent.limits
        self._velocity = np.where(np.isfinite(limits.velocity), limits.velocity, 1.0)
        self._lower, self._upper = np.asarray(limits.lower), np.asarray(limits.upper)
        self._search = load_library().rr1_replan_arm

    def replanned(self, points: Array, rng: np.random.Generator) -> Array | None:
        """The path with another motion of one random arm; None if none is found.

        Its edges are not certified: only pairs that involve the arm have been tested.

        Args:
            points: Waypoints of a certified path, no two consecutive ones equal, shape (n, nq).
            rng: Source of random numbers.
        """
        steps = np.abs(np.diff(points, axis=0)) / self._velocity
        slowest = np.column_stack([steps[:, own].max(axis=1) for own in self._columns])
        duration = float(slowest.max(axis=1).sum())
        # Durations of the edges for the other arms of each arm.
        others = np.column_stack([np.delete(slowest, k, axis=1).max(axis=1) for k in range(len(self._columns))])
        gains = duration - others.sum(axis=0)
        gains[gains < (1.0 - _OTHERS) * duration] = 0.0
        if gains.sum() == 0.0:
            return None
        arm = int(rng.choice(len(gains), p=gains / gains.sum()))
        own = self._columns[arm]
        times = np.concatenate([[0.0], np.cumsum(others[:, arm])])
        alone = float((np.abs(points[-1, own] - points[0, own]) / self._velocity[own]).max())
        least = max(float(times[-1]), alone)
        most = least + rng.random() * max(0.0, _SAVING * duration - least)
        # Waypoints between which only this arm moves coincide.
        kept = np.concatenate([[True], np.diff(times) > 0.0])
        if most == 0.0 or kept.sum() < 2:
            return None
        ways = points[kept]
        ways[-1] = points[-1]
        return self._led(ways, times[kept] * (most / times[-1]), own, rng)

    def _led(self, points: Array, times: Array, own: slice, rng: np.random.Generator) -> Array | None:
        """Waypoints with another motion of one arm, shape (m, nq); None if none is found.

        Args:
            points: Waypoints of all arms; of the arm itself only its start and its goal count, shape (n, nq).
            times: Their times [s], increasing from 0, shape (n,).
            own: Columns of the arm.
            rng: Source of random numbers.
        """
        nq, width = points.shape[1], own.stop - own.start
        knots, knot_times = np.empty((_SAMPLES + 2, width)), np.empty(_SAMPLES + 2)
        arm = CStruct(
            "ArmReplan",
            times=times,
            points=np.ascontiguousarray(points),
            count=len(points),
            column_count=nq,
            first_column=own.start,
            width=width,
            velocity=self._velocity[own].copy(),
            lower=self._lower[own].copy(),
            upper=self._upper[own].copy(),
            samples=_SAMPLES,
            shortcuts=_SHORTCUTS,
            vertices=np.empty((_SAMPLES + 1, width)),
            reached=np.empty(_SAMPLES + 1),
            parents=np.empty(_SAMPLES + 1, np.int64),
            knots=knots,
            knot_times=knot_times,
            memory=np.empty(2 * (nq + width)),
        )
        count = self._checker.run_edge_kernel(self._search, arm, random_state(int(rng.integers(2**63))))
        if count == 0:
            return None
        instants = np.union1d(times, knot_times[:count])
        made = np.column_stack([np.interp(instants, times, column) for column in points.T])
        made[:, own] = np.column_stack([np.interp(instants, knot_times[:count], q) for q in knots[:count].T])
        return made
