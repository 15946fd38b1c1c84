"""The result of planning many arms: one trajectory, schedules, the stage that solved each group, and the quality."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType

from rr1plan.checks import Value, counted
from rr1plan.multi.execution.separated_schedules import SeparatedSchedules, separate
from rr1plan.multi.plan_quality import PlanQuality
from rr1plan.multi.search.agent_schedules import Statistics
from rr1plan.multi.timing.schedule import Schedule
from rr1plan.path import Path
from rr1plan.planning import PlanStatus
from rr1plan.trajectory import Trajectory


@dataclass(frozen=True)
class GroupResult:
    """The result of one interaction group.

    Args:
        arms: Its arms.
        stage: The last stage that was needed: "timing", "detours", "eviction", "space-time", "composite", "windows" or
            "sequential", or the method "conflict_based_search"; empty if none did.
        seconds: Wall time [s].
        reason: Why there is no solution, as text; empty if there is one.
        statistics: Counts of the search's operations.
        suboptimality: Proven bound: the sum of its arrival times is at most this multiple of the minimum on the
            searched roadmaps, on which each arm stops at each vertex; None: unknown.
    """

    arms: tuple[str, ...]
    stage: str
    seconds: float
    reason: str = ""
    statistics: Statistics = field(default_factory=Statistics)
    suboptimality: float | None = None

    @property
    def found(self) -> bool:
        """Whether there is a schedule for all of its arms."""
        return not self.reason


@dataclass(frozen=True, eq=False, repr=False)
class ManyArmsResult(Value):
    """The result of planning many arms.

    Args:
        status: Outcome.
        reason: Why there is no motion, as text.
        trajectory: All moving arms on one clock, columns in the order of the problem; or None.
        paths: The path of each arm.
        schedules: When each agent moves along its path; an agent is one arm, or a few that move as one.
        groups: Result of each interaction group.
        seconds: Wall time [s].
        quality: Makespan, path length, waiting, and the slowest arm alone.
        first: Likewise for the first plan, before `improvement`; None if there is no plan.
        improvements: Number of attempted improvements.
        history: (seconds, makespan [s]) of the first plan and of each plan with a shorter makespan.
    """

    status: PlanStatus
    reason: str = ""
    trajectory: Trajectory | None = None
    paths: Mapping[str, Path] = field(default_factory=dict)
    schedules: tuple[Schedule, ...] = ()
    groups: tuple[GroupResult, ...] = ()
    seconds: float = 0.0
    quality: PlanQuality = field(default_factory=PlanQuality)
    first: PlanQuality | None = None
    improvements: int = 0
    history: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "paths", MappingProxyType(dict(self.paths)))

    @property
    def found(self) -> bool:
        """Whether there is a motion."""
        return self.status is PlanStatus.FOUND

    def __bool__(self) -> bool:
        """The same as `found`."""
        return self.found

    @cached_property
    def separated(self) -> SeparatedSchedules:
        """The same motion with a schedule for each arm, wherever an order of the arms is certified."""
        return separate(self.schedules)

    @property
    def inseparable(self) -> tuple[tuple[str, ...], ...]:
        """Groups of arms that can only move as one, because no order in which they pass each other is certified."""
        return tuple(schedule.arms for schedule in self.separated.schedules if len(schedule.arms) > 1)

    @property
    def makespan(self) -> float:
        """When the last arm arrives [s]."""
        return self.quality.makespan

    @property
    def ratio(self) -> float:
        """Makespan over the duration of the fastest motion found for the slowest arm alone; 1 if nothing moves."""
        return self.quality.ratio

    def __repr__(self) -> str:
        if not self.found:
            return f"ManyArmsResult({self.status.value}: {self.reason})"
        stages = ", ".join(dict.fromkeys(group.stage for group in self.groups))
        timing = f"{self.makespan:.3f} s, {self.ratio:.2f} times the slowest arm alone"
        return f"ManyArmsResult({counted(len(self.paths), 'arm')}, {timing}, by {stages})"
