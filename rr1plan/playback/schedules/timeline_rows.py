"""The content of a time line: intervals of motion and rest of each arm, and conflicts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from rr1plan.checks import Value, counted, known_name
from rr1plan.planning import Wait
from rr1plan.report import Violation

Interval = tuple[float, float]


@dataclass(frozen=True, eq=False)
class TimelineRows(Value):
    """When each arm of a motion moves and rests, for whom it waits, and where arms touch.

    Args:
        name: Name of the scene.
        arms: The moving arms.
        numbers: Number of each in its scene, which determines its color.
        motions: Intervals in which each arm moves: start and end [s], in order.
        waits: Rests of arms before they arrive.
        start: Start of the motion [s], usually 0.
        makespan: Time from the start until the last arm arrives [s].
        undelayed: Duration of the path of each arm without waiting [s], where known.
        conflicts: Findings of the referee between two elements: collisions, and pairs that it cannot decide.
        touching: The arms involved in each conflict.
    """

    name: str
    arms: tuple[str, ...]
    numbers: Mapping[str, int]
    motions: Mapping[str, tuple[Interval, ...]]
    waits: tuple[Wait, ...]
    start: float
    makespan: float
    undelayed: Mapping[str, float] = field(default_factory=dict)
    conflicts: tuple[Violation, ...] = ()
    touching: tuple[tuple[str, ...], ...] = ()

    def __post_init__(self) -> None:
        for name in ("numbers", "motions", "undelayed"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    def arrival(self, arm: str) -> float:
        """Time from which an arm remains at rest [s].

        Raises:
            UnknownNameError: no such arm.
        """
        known_name("moving arm", arm, self.arms)
        return self.motions[arm][-1][1] if self.motions[arm] else self.start

    @property
    def waiting(self) -> float:
        """Sum of the times that arms rest before their arrival [s]."""
        return sum(wait.end - wait.begin for wait in self.waits)

    def __str__(self) -> str:
        lines = [f"{counted(len(self.arms), 'arm')}, makespan {self.makespan:.3f} s, {self.waiting:.3f} s of waiting"]
        for wait in self.waits:
            whom = f" for {', '.join(wait.others)}" if wait.others else ""
            lines.append(f"  {wait.arm} waits{whom} from {wait.begin:.3f} to {wait.end:.3f} s")
        lines += [f"  {violation.message}" for violation in self.conflicts]
        return "\n".join(lines)
