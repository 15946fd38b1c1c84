"""Limits of every joint between samples, continuity between pieces, rest at both ends."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from rr1plan.checks import DEGREES, Array, rounded
from rr1plan.report import Margin, Violation, ViolationKind
from rr1plan.robot.joint_limits import Limits, selected_limits
from rr1plan.scene import Arm
from rr1plan.validation.bernstein_extremes import Extremes
from rr1plan.validation.referee_kernels import SOURCES, load_library

_C = SOURCES.constants
_ROWS = sorted(
    ((name, _C[f"LIMIT_{name.upper()}"]) for name in ("lower", "upper", "velocity", "acceleration", "jerk")),
    key=lambda row: row[1],
)
_RATES: tuple[tuple[ViolationKind, str], ...] = (("velocity", "/s"), ("acceleration", "/s²"), ("jerk", "/s³"))
# Times are rounded to at most this [s], those since 1970 to a quarter of it; the share of a limit that this may exceed.
_ROUNDED_TIMES, _ROUNDED_SHARE = 1e-6, 1e-4


@dataclass
class Findings:
    """Violations and margins that the checks collect."""

    violations: list[Violation] = field(default_factory=list)
    margins: dict[str, Margin] = field(default_factory=dict)
    checked: list[str] = field(default_factory=list)
    not_checked: dict[str, str] = field(default_factory=dict)
    statistics: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Columns:
    """The columns of a motion.

    Args:
        names: Their names "arm/joint".
        limits: Their limits.
        arms: The arms of the scene.
    """

    names: tuple[str, ...]
    limits: Limits
    arms: Mapping[str, Arm]

    def unit(self, column: int) -> str:
        """Unit of a column: rad or m."""
        arm, joint = self.names[column].split("/", 1)
        return self.arms[arm].robot.joint(joint).unit

    @cached_property
    def table(self) -> Array:
        """The limits as the kernels read them, shape (5, nq)."""
        return np.array([getattr(self.limits, name) for name, _ in _ROWS])


def columns_of(arms: Mapping[str, Arm], places: Mapping[str, list[int]], names: tuple[str, ...]) -> Columns:
    """The columns of these names; `places` has the columns of each arm that moves."""
    limits = Limits.stack([arms[arm].robot.limits for arm in places])
    order = [column for columns in places.values() for column in columns]
    if order != list(range(len(order))):
        limits = selected_limits(limits, np.argsort(order))
    return Columns(names, limits, arms)


class Judgment:
    """Comparison of a motion's extremes with the limits: violations, and how much of each limit is used.

    Args:
        columns: The columns.
        found: Their extremes.
        breaks, coefficients: The motion.
    """

    def __init__(self, columns: Columns, found: Extremes, breaks: Array, coefficients: Array) -> None:
        self._columns, self._found, self._breaks, self._coefficients = columns, found, breaks, coefficients
        nq = len(columns.names)
        self._tightest, self._allowed = np.empty((_C["TIGHTEST_ROWS"], 3)), np.empty((3, nq))
        self._flaws = np.empty(nq, dtype=np.int64)
        self._any = load_library().rr1_judge_columns(
            len(breaks),
            np.ascontiguousarray(coefficients),
            *coefficients.shape,
            found.peaks.reshape(-1, 4),
            found.jumps.reshape(-1, 2),
            found.end,
            columns.table,
            self._tightest,
            self._allowed,
            self._flaws,
        )
        if self._any:
            self._forgive_rounded_times()

    def _forgive_rounded_times(self) -> None:
        """Clear the flaws of rates within the rounding of times.

        Rounded breaks are earlier or later than those of the exact motion, so that a rate differs at a break by up to
        the rounding times the next derivative.
        """
        found, limits, flaws = self._found, self._columns.limits, self._flaws
        rounding = min(float(np.spacing(np.abs(self._breaks).max())), _ROUNDED_TIMES)
        peaks, start = np.maximum(found.high, -found.low), self._coefficients[0, 1:2]
        for order, name in ((1, "velocity"), (2, "acceleration")):
            bound = getattr(limits, name)
            excess = np.minimum(rounding * peaks[order + 1], _ROUNDED_SHARE * bound)
            self._allowed[order] += excess
            flaws[peaks[order] <= bound + excess] &= ~_C[f"FLAW_{name.upper()}"]
            flaws[found.jumps[order, :, 0] <= self._allowed[order]] &= ~_C[f"FLAW_{name.upper()}_JUMP"]
        flaws[(np.abs(start) <= self._allowed[1]).all(axis=0)] &= ~_C["FLAW_START"]
        flaws[np.abs(found.end[1]) <= self._allowed[1]] &= ~_C["FLAW_END"]
        self._any = int(np.bitwise_or.reduce(flaws))

    def is_absurd(self, times: float, fast: float) -> bool:
        """Whether a speed exceeds a multiple of its limit, or of `fast` [rad/s or m/s] for joints without a limit."""
        if self._tightest[_C["TIGHTEST_VELOCITY"], 0] > times:
            return True
        speeds, unlimited = self._found.peaks[1], np.isinf(self._columns.limits.velocity)
        return bool(unlimited.any() and (np.maximum(speeds[:, 0], -speeds[:, 2])[unlimited] > times * fast).any())

    def check_positions(self, findings: Findings) -> None:
        """Check position limits; infinite limits always hold."""
        limits, found, columns = self._columns.limits, self._found, self._columns
        for j in self._columns_with("ABOVE", "BELOW"):
            name, unit = columns.names[j], columns.unit(j)
            for flaw, side, bound, value, time in (
                ("ABOVE", "above its upper", limits.upper[j], found.high[0, j], found.high_time[0, j]),
                ("BELOW", "below its lower", limits.lower[j], found.low[0, j], found.low_time[0, j]),
            ):
                if self._flaws[j] & _C[f"FLAW_{flaw}"]:
                    hint = f" {DEGREES}" if unit == "rad" and abs(value - bound) > np.pi else ""
                    message = f"{name} is at {value:.9g} {unit} at {time:.6f} s, {side} limit {bound:.9g} {unit}{hint}"
                    findings.violations.append(
                        Violation("position", (name,), float(time), float(value), float(bound), message)
                    )
        self._note_tightest(findings, "position")
        findings.checked.append("position")

    def check_continuity(self, findings: Findings) -> None:
        """Position and velocity must not jump where two pieces meet."""
        findings.checked.append("continuity")
        for order, name in enumerate(("POSITION_JUMP", "VELOCITY_JUMP")):
            self._add_jumps(findings, "continuity", order, name)

    def check_rest(self, findings: Findings) -> None:
        """Check that a motion starts and ends at rest; a motion of zero duration is at rest."""
        findings.checked.append("rest")
        for flaw, when, time in (("START", "starts", self._breaks[0]), ("END", "ends", self._breaks[-1])):
            for j in self._columns_with(flaw):
                speed = float(self._coefficients[0, 1, j] if flaw == "START" else self._found.end[1, j])
                name, unit = self._columns.names[j], self._columns.unit(j)
                message = f"{name} {when} with {speed:.6g} {unit}/s at {time:.6f} s, expected rest"
                limit = float(self._allowed[1, j])
                findings.violations.append(Violation("rest", (name,), float(time), abs(speed), limit, message))

    def check_rates(self, findings: Findings, jerk: bool) -> None:
        """Check velocity and acceleration limits and, on request, jerk limits including jumps of acceleration."""
        for order, (kind, per) in enumerate(_RATES, start=1):
            if kind == "jerk" and not jerk:
                findings.not_checked[kind] = "not asked for (option jerk_limits)"
                return
            if not self._note_tightest(findings, kind):
                findings.not_checked[kind] = "no joint has a limit for it"
                continue
            for j in self._columns_with(kind.upper()):
                self._add_rate(findings, kind, order, j, self._columns.unit(j) + per)
            findings.checked.append(kind)
        self._add_jumps(findings, "jerk", 2, "ACCELERATION_JUMP")

    def _columns_with(self, *flaws: str) -> list[int]:
        """The columns that have any of these flaws."""
        bits = sum(_C[f"FLAW_{flaw}"] for flaw in flaws)
        if not self._any & bits:
            return []
        found: list[int] = np.flatnonzero(self._flaws & bits).tolist()
        return found

    def _note_tightest(self, findings: Findings, kind: ViolationKind) -> bool:
        """Note how much of a limit is used. Returns whether any column has such a limit."""
        ratio, column, time = self._tightest[_C[f"TIGHTEST_{kind.upper()}"]].tolist()
        if ratio == -np.inf:
            return False
        findings.margins[kind] = Margin(ratio, "", (self._columns.names[int(column)],), time)
        return True

    def _add_rate(self, findings: Findings, kind: ViolationKind, order: int, j: int, unit: str) -> None:
        high, high_time, low, low_time = self._found.peaks[order, j].tolist()
        value, time = (high, high_time) if high >= -low else (-low, low_time)
        name, bound = self._columns.names[j], float(getattr(self._columns.limits, kind)[j])
        over = f"+{rounded(100.0 * (value / bound - 1.0))} %"
        message = f"{name} has {kind} {value:.9g} {unit} at {time:.6f} s, limit {bound:.9g} {unit} ({over})"
        findings.violations.append(Violation(kind, (name,), time, value, bound, message))

    def _add_jumps(self, findings: Findings, kind: ViolationKind, order: int, flaw: str) -> None:
        for j in self._columns_with(flaw):
            name, unit = self._columns.names[j], self._columns.unit(j) + ("", "/s", "/s²")[order]
            jump, time = self._found.jumps[order, j].tolist()
            what = {"continuity": "jumps", "jerk": "has a jump of acceleration, an infinite jerk,"}[kind]
            message = f"{name} {what} by {jump:.6g} {unit} at {time:.6f} s"
            findings.violations.append(Violation(kind, (name,), time, jump, float(self._allowed[order, j]), message))
