"""What an independent check found: violations, margins, and what was not checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

ViolationKind = Literal[
    "collision",
    "undecided",
    "position",
    "velocity",
    "acceleration",
    "jerk",
    "torque",
    "start",
    "goal",
    "clock",
    "continuity",
    "rest",
]


@dataclass(frozen=True)
class Violation:
    """One way in which a motion is not what it should be.

    Args:
        kind: Which rule is broken.
        subject: The joint ("arm/joint") or the pair ("arm/link", "obstacle") it is about.
        time: When it is worst [s], or None when no time applies.
        value: What was found, in the unit of the rule.
        limit: What was allowed, in the unit of the rule.
        message: The same in words.
    """

    kind: ViolationKind
    subject: tuple[str, ...]
    time: float | None
    value: float
    limit: float
    message: str


@dataclass(frozen=True)
class Report:
    """The referee's verdict on one trajectory.

    Args:
        violations: All that was found, worst of each kind and subject.
        margins: What is left up to each limit: ratios used of velocity, acceleration, jerk and
            torque (1 is the limit), smallest clearance [m].
        checked: The rules that were checked.
        not_checked: The rules that were not, each with the reason.
        duration: Length of the motion [s].
        statistics: Counts of the work done.
    """

    violations: tuple[Violation, ...]
    margins: Mapping[str, float]
    checked: tuple[str, ...]
    not_checked: Mapping[str, str] = field(default_factory=dict)
    duration: float = 0.0
    statistics: Mapping[str, float] = field(default_factory=dict)

    @property
    def valid(self) -> bool:
        """Nothing that was checked is broken."""
        return not self.violations

    @property
    def certified(self) -> bool:
        """Valid, and the continuous-time collision certificate was among the checks."""
        return self.valid and "collision" in self.checked

    def __str__(self) -> str:
        head = "certified free in continuous time" if self.certified else ("valid" if self.valid else "INVALID")
        lines = [f"{head}: {self.duration:.3f} s, checked {', '.join(self.checked)}"]
        lines += [f"  {name}: {value:.6g}" for name, value in self.margins.items()]
        lines += [f"  violation: {v.message}" for v in self.violations]
        lines += [f"  not checked: {name} ({why})" for name, why in self.not_checked.items()]
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """The same as plain values, for JSON."""
        return {
            "valid": self.valid,
            "certified": self.certified,
            "duration": self.duration,
            "margins": dict(self.margins),
            "checked": list(self.checked),
            "not_checked": dict(self.not_checked),
            "statistics": dict(self.statistics),
            "violations": [
                {
                    "kind": v.kind,
                    "subject": list(v.subject),
                    "time": v.time,
                    "value": v.value,
                    "limit": v.limit,
                    "message": v.message,
                }
                for v in self.violations
            ],
        }
