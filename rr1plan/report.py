"""Reports of the referee: violations, margins, and rules that were not checked."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal, get_args

from rr1plan.checks import Value, counted, shown
from rr1plan.errors import FormatError

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
    "finite",
    "continuity",
    "rest",
]
_KINDS: tuple[str, ...] = get_args(ViolationKind)

NO_SHAPE = "has no collision shape"
"""Why a link is not checked."""
NO_PAIR = "the scene has no pair of elements that must not touch"
"""Why there is no clearance."""
_NAMED = 3  # links that the verdict names


@dataclass(frozen=True)
class Violation:
    """A rule that a trajectory violates.

    Args:
        kind: The violated rule.
        subject: The joint ("arm/joint",) or the pair ("arm/link", "obstacle").
        time: Time of the worst violation [s], or None if no time applies.
        value: Worst value, in the unit of the rule; for a collision the signed distance, negative in penetration [m].
        limit: Allowed value, in the unit of the rule.
        message: Description in words.
    """

    kind: ViolationKind
    subject: tuple[str, ...]
    time: float | None
    value: float
    limit: float
    message: str


@dataclass(frozen=True)
class Margin:
    """Distance of a trajectory to one of its limits.

    Args:
        value: A clearance [m], or the ratio to the limit (1 is the limit).
        unit: "m", or "" for a ratio.
        subject: The joint or the pair with the smallest margin.
        time: Time of the smallest margin [s], or None if no time applies.
    """

    value: float
    unit: str = ""
    subject: tuple[str, ...] = ()
    time: float | None = None

    def __float__(self) -> float:
        return self.value

    def __str__(self) -> str:
        amount = _meters(self.value) if self.unit == "m" else f"{100.0 * self.value:.4g} % of the limit"
        where = f"  {' - '.join(self.subject)}" if self.subject else ""
        return amount + where + ("" if self.time is None else f" at {self.time:.4f} s")


@dataclass(frozen=True)
class Report(Value):
    """The referee's verdict on one trajectory.

    Args:
        violations: The worst violation of each kind and subject.
        margins: Margin to each limit, by name: "clearance", "clearance_start" and
            "clearance_end" to obstacles and other arms, "self_clearance" between the links of one arm
            and its held objects, all beyond the padding of each pair [m], with their proven lower bounds
            ("clearance_proven", "self_clearance_proven"); "position", "velocity", "acceleration", "jerk" and
            "torque" as the ratio to the limit (1 is the limit). If one of the two clearances is a contact, the other
            is omitted.
        checked: The rules that were checked.
        not_checked: The rules that were not checked, each with the reason.
        duration: Duration of the trajectory [s].
        statistics: Counters of the checks.
    """

    violations: tuple[Violation, ...]
    margins: Mapping[str, Margin]
    checked: tuple[str, ...]
    not_checked: Mapping[str, str] = field(default_factory=dict)
    duration: float = 0.0
    statistics: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("margins", "not_checked", "statistics"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    @property
    def valid(self) -> bool:
        """Whether no checked rule is violated."""
        return not self.violations

    @property
    def certified(self) -> bool:
        """Whether the trajectory is valid and the continuous-time collision certificate was checked."""
        return self.valid and "collision" in self.checked

    @property
    def unchecked_links(self) -> tuple[str, ...]:
        """Links ("arm/link") that are not checked for collision because they have no collision shape.

        The certificate holds for the other links only; see `Robot.unchecked_links`.
        """
        return tuple(name for name, why in self.not_checked.items() if why == NO_SHAPE)

    @property
    def verdict(self) -> str:
        """The verdict in one line, with the links that were not checked for collision."""
        if not self.valid:
            return f"INVALID, {counted(len(self.violations), 'violation')}"
        if not self.certified:
            return "VALID"
        free, links = "certified free of collision in continuous time", self.unchecked_links
        if not links:
            return f"VALID, {free}"
        bare = f"{counted(len(links), 'link')} without a collision shape ({', '.join(links[:_NAMED])}"
        bare += ", ...)" if len(links) > _NAMED else ")"
        if self._compares_nothing:
            return f"VALID, but NOTHING WAS CHECKED FOR COLLISION: {bare}"
        return f"VALID, {free}, EXCEPT FOR {bare}"

    @property
    def _compares_nothing(self) -> bool:
        """Whether the collision proof is empty because links have no shape."""
        return bool(self.unchecked_links) and self.not_checked.get("clearance") == NO_PAIR

    def __bool__(self) -> bool:
        """Same as `valid`."""
        return self.valid

    def __repr__(self) -> str:
        found, bare = ", ".join(sorted({v.kind for v in self.violations})), len(self.unchecked_links)
        verdict = "certified" if self.certified else "valid" if self.valid else f"not valid: {found}"
        except_for = f" except for {counted(bare, 'link')}" if bare and self.certified else ""
        return f"Report({verdict}{except_for}, {self.duration:.3f} s of motion)"

    def __str__(self) -> str:
        lines = [f"{self.verdict} ({self.duration:.3f} s of motion)"]
        lines += [f"  violation    {v.kind}: {v.message}" for v in self.violations]
        width = max((len(name) for name in self.margins), default=0)
        lines += [f"  margin       {name:<{width}}  {margin}" for name, margin in self.margins.items()]
        checked = [rule for rule in self.checked if rule != "collision" or not self._compares_nothing]
        lines.append(f"  checked      {', '.join(checked) or 'nothing'}")
        for why in dict.fromkeys(self.not_checked.values()):
            names = [name for name, reason in self.not_checked.items() if reason == why]
            lines.append(f"  not checked  {', '.join(names)}: {why}")
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """The report as JSON values."""
        return {
            "valid": self.valid,
            "certified": self.certified,
            "duration": self.duration,
            "margins": {
                name: {"value": m.value, "unit": m.unit, "subject": list(m.subject), "time": m.time}
                for name, m in self.margins.items()
            },
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

    @staticmethod
    def from_dict(data: object) -> Report:
        """The report of which `data` is the `to_dict`.

        Raises:
            FormatError: a key that is missing, unknown or of the wrong type, a number that is not
                finite, or a verdict that does not follow from the violations.
        """
        keys = ("valid", "certified", "duration", "margins", "checked", "not_checked", "statistics", "violations")
        given = _fields("report", data, keys)
        margins = _mapping("margins", given["margins"])
        report = Report(
            violations=tuple(_violation(v) for v in _list("violations", given["violations"])),
            margins={name: _margin(name, value) for name, value in margins.items()},
            checked=_texts("checked", given["checked"]),
            not_checked={k: _text(k, v) for k, v in _mapping("not_checked", given["not_checked"]).items()},
            duration=_number("duration", given["duration"]),
            statistics={k: _number(k, v) for k, v in _mapping("statistics", given["statistics"]).items()},
        )
        for name in ("valid", "certified"):
            if given[name] is not getattr(report, name):
                raise FormatError(f"report has {name} = {given[name]!r}, which contradicts its other entries")
        return report


def _meters(value: float) -> str:
    return f"{1000.0 * value:.3f} mm" if abs(value) < 0.1 else f"{value:.4f} m"


def _violation(data: Any) -> Violation:
    given = _fields("violation", data, ("kind", "subject", "time", "value", "limit", "message"))
    if given["kind"] not in _KINDS:
        raise FormatError(f"violation kind is {given['kind']!r}, expected one of {', '.join(_KINDS)}")
    return Violation(
        given["kind"],
        _texts("subject", given["subject"]),
        _time(given["time"]),
        _number("value", given["value"]),
        _number("limit", given["limit"]),
        _text("message", given["message"]),
    )


def _margin(name: str, data: object) -> Margin:
    given = _fields(f"margin {name!r}", data, ("value", "unit", "subject", "time"))
    return Margin(
        _number("value", given["value"]),
        _text("unit", given["unit"]),
        _texts("subject", given["subject"]),
        _time(given["time"]),
    )


def _fields(name: str, data: Any, keys: tuple[str, ...]) -> Mapping[str, Any]:
    given = _mapping(name, data)
    if set(given) != set(keys):
        wrong = sorted(set(given) ^ set(keys))
        raise FormatError(f"{name} has the wrong keys ({', '.join(map(repr, wrong))}), expected {', '.join(keys)}")
    return given


def _mapping(name: str, data: object) -> Mapping[str, object]:
    if not isinstance(data, Mapping) or not all(isinstance(key, str) for key in data):
        raise FormatError(f"{name} is {type(data).__name__}, expected a mapping with text keys")
    return data


def _list(name: str, data: object) -> list[object]:
    if not isinstance(data, list):
        raise FormatError(f"{name} is {type(data).__name__}, expected a list")
    return data


def _text(name: str, data: object) -> str:
    if not isinstance(data, str):
        raise FormatError(f"{name} is {shown(data)}, expected text")
    return data


def _texts(name: str, data: Any) -> tuple[str, ...]:
    return tuple(_text(name, item) for item in _list(name, data))


def _time(data: Any) -> float | None:
    return None if data is None else _number("time", data)


def _number(name: str, data: Any) -> float:
    try:
        # An int may exceed the range of floats.
        number = float(data) if isinstance(data, int | float) and not isinstance(data, bool) else math.nan
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise FormatError(f"{name} is {shown(data)}, expected a finite number")
    return number
