"""Quality of the schedules of a plan: makespan, path length, waiting, and the slowest arm alone."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from rr1plan.multi.timing.schedule import Schedule


@dataclass(frozen=True)
class PlanQuality:
    """Quality figures of a plan of many arms.

    Args:
        makespan: When the last arm arrives [s].
        slowest_alone: Duration of the fastest known motion of the slowest arm alone [s].
        path_length: Sum of the lengths of the motions of all arms, also of those that move as one [rad].
        waiting: Sum of the times that arms rest before they arrive, also of those that move as one [s].
    """

    makespan: float = 0.0
    slowest_alone: float = 0.0
    path_length: float = 0.0
    waiting: float = 0.0

    @property
    def ratio(self) -> float:
        """Makespan over `slowest_alone`; 1 if nothing moves."""
        return self.makespan / self.slowest_alone if self.slowest_alone > 0.0 else 1.0


def plan_quality(schedules: Iterable[Schedule], alone: Mapping[str, float]) -> PlanQuality:
    """Quality figures of some schedules.

    Args:
        schedules: One for each agent.
        alone: Duration of the fastest known motion of each arm alone [s]; an earlier arrival in the plan replaces it.
    """
    schedules = list(schedules)
    bounds = [
        min(alone.get(arm, math.inf), schedule.arrival) for schedule in schedules for arm in schedule.path.agent.arms
    ]
    return PlanQuality(
        max((schedule.arrival for schedule in schedules), default=0.0),
        max(bounds, default=0.0),
        math.fsum(schedule.length for schedule in schedules),
        math.fsum(schedule.waiting_of_arms for schedule in schedules),
    )
