"""Limits of every joint between samples, joints between pieces, rest at both ends."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import NamedTuple

import numpy as np

from rr1plan.checks import Array
from rr1plan.limits import Limits
from rr1plan.report import Margin, Violation, ViolationKind
from rr1plan.robot import Robot
from rr1plan.scene import Arm
from rr1plan.validation.extremes import Extremes

# Rounding that a limit forgives, relative to it.
TOLERANCE = 1e-9
# Jumps that rounding may leave at a break, and rates that count as rest [rad or m, per s].
_POSITION_JUMP = 1e-9
_VELOCITY_JUMP = 1e-7

_RATES: tuple[tuple[ViolationKind, str], ...] = (("velocity", "/s"), ("acceleration", "/s²"), ("jerk", "/s³"))


@dataclass
class Ledger:
    """What the checks write down as they go."""

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
        return "m" if self.arms[arm].robot.joint(joint).kind == "prismatic" else "rad"


def columns_of(arms: Mapping[str, Arm], places: Mapping[str, list[int]], names: tuple[str, ...]) -> Columns:
    """The columns of these names; of each arm that moves it is given where those of its joints are."""
    if not places:
        return Columns(names, Limits(*([np.zeros(0)] * len(fields(Limits)))), arms)
    limits = Limits.stack([arms[arm].robot.limits for arm in places])
    order = [column for columns in places.values() for column in columns]
    if order != list(range(len(order))):
        inverse = np.argsort(order)
        limits = Limits(*(getattr(limits, f.name)[inverse] for f in fields(Limits)))
    return Columns(names, limits, arms)


def check_positions(ledger: Ledger, columns: Columns, found: Extremes) -> None:
    """Position limits; infinite limits hold always."""
    upper, lower = columns.limits.upper.tolist(), columns.limits.lower.tolist()
    highest = zip(found.high[0].tolist(), upper, found.high_time[0].tolist(), strict=True)
    lowest = zip(found.low[0].tolist(), lower, found.low_time[0].tolist(), strict=True)
    for name, unit, above, below in zip(columns.names, [columns.unit(j) for j in range(len(columns.names))], highest, lowest, strict=True):
        half = 0.5 * (above[1] - below[1])
        for (value, bound, time), sign in ((above, 1.0), (below, -1.0)):
            if sign * (value - bound) > TOLERANCE * max(1.0, abs(bound)):
                side = "above its upper" if sign > 0.0 else "below its lower"
                message = f"{name} is at {value:.9g} {unit} at {time:.6f} s, {side} limit {bound:.9g} {unit}"
                ledger.violations.append(Violation("position", (name,), time, value, bound, message))
            if 0.0 < half < np.inf:
                _tighten(ledger, "position", 1.0 + sign * (value - bound) / half, name, time)
    ledger.checked.append("position")


def check_rates(ledger: Ledger, columns: Columns, found: Extremes, jerk: bool) -> None:
    """Velocity, acceleration and on request jerk limits; jumps of acceleration for the last."""
    for order, (kind, per) in enumerate(_RATES, start=1):
        bounds: Array = getattr(columns.limits, kind)
        if kind == "jerk" and not jerk:
            ledger.not_checked[kind] = "not asked for (option jerk_limits)"
            return
        if not np.isfinite(bounds).any():
            ledger.not_checked[kind] = "no joint has a limit for it"
            continue
        up = found.high[order] >= -found.low[order]
        values = np.where(up, found.high[order], -found.low[order]).tolist()
        times = np.where(up, found.high_time[order], found.low_time[order]).tolist()
        for name, unit, value, bound, time in zip(
            columns.names, [columns.unit(j) for j in range(len(columns.names))], values, bounds.tolist(), times, strict=True
        ):
            _hold(ledger, kind, name, unit + per, value, bound, time)
        ledger.checked.append(kind)
    _check_jumps(ledger, "jerk", columns, found, 2, _acceleration_jump(columns.limits))


def _acceleration_jump(limits: Limits) -> Array:
    """Jumps of acceleration that are rounding, per joint; none matters without a jerk limit."""
    scale = np.where(np.isfinite(limits.acceleration), limits.acceleration, 1.0)
    return np.asarray(np.where(np.isfinite(limits.jerk), 1e-6 * np.maximum(1.0, scale), np.inf))


def _hold(ledger: Ledger, kind: ViolationKind, name: str, unit: str, value: float, bound: float, time: float) -> None:
    """Hold a rate to its limit."""
    if not np.isfinite(bound):
        return
    _tighten(ledger, kind, value / bound, name, time)
    if value > bound * (1.0 + TOLERANCE):
        excess = 100.0 * (value / bound - 1.0)
        message = f"{name} has {kind} {value:.9g} {unit} at {time:.6f} s, limit {bound:.9g} {unit} (+{excess:.3g} %)"
        ledger.violations.append(Violation(kind, (name,), time, value, bound, message))


def _tighten(ledger: Ledger, kind: str, ratio: float, name: str, time: float) -> None:
    if kind not in ledger.margins or ratio > ledger.margins[kind].value:
        ledger.margins[kind] = Margin(ratio, "", (name,), time)


def check_continuity(ledger: Ledger, columns: Columns, found: Extremes, coefficients: Array) -> None:
    """Position and velocity must not jump where two pieces meet."""
    ledger.checked.append("continuity")
    scale = np.maximum(1.0, np.abs(coefficients[:, 0]).max(axis=0))
    _check_jumps(ledger, "continuity", columns, found, 0, _POSITION_JUMP * scale)
    _check_jumps(ledger, "continuity", columns, found, 1, np.full(len(columns.names), _VELOCITY_JUMP))


def _check_jumps(
    ledger: Ledger, kind: ViolationKind, columns: Columns, found: Extremes, order: int, allowed: Array
) -> None:
    for j in np.flatnonzero(found.jump[order] > allowed).tolist():
        name, unit = columns.names[j], columns.unit(j) + ("", "/s", "/s²")[order]
        jump, time = float(found.jump[order, j]), float(found.jump_time[order, j])
        what = {"continuity": "jumps", "jerk": "has a jump of acceleration, an infinite jerk,"}[kind]
        message = f"{name} {what} by {jump:.6g} {unit} at {time:.6f} s"
        ledger.violations.append(Violation(kind, (name,), time, jump, float(allowed[j]), message))


def check_rest(ledger: Ledger, columns: Columns, found: Extremes, breaks: Array, coefficients: Array) -> None:
    """A motion starts and ends at rest; one of no duration is at rest."""
    ledger.checked.append("rest")
    if len(breaks) < 2:
        return
    start = coefficients[0, 1] if coefficients.shape[1] > 1 else np.zeros(len(columns.names))
    for when, speeds, time in (("starts", start, breaks[0]), ("ends", found.end[1], breaks[-1])):
        for j in np.flatnonzero(np.abs(speeds) > _VELOCITY_JUMP).tolist():
            name, speed = columns.names[j], float(speeds[j])
            message = f"{name} {when} with {speed:.6g} {columns.unit(j)}/s at {time:.6f} s, expected rest"
            ledger.violations.append(Violation("rest", (name,), float(time), abs(speed), _VELOCITY_JUMP, message))
