"""Limits of every joint between samples, joints between pieces, rest at both ends."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from rr1plan.checks import Array
from rr1plan.limits import Limits
from rr1plan.report import Margin, Violation, ViolationKind
from rr1plan.validation.polynomials import derivative, evaluate, peaks

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


def check_positions(
    ledger: Ledger, names: tuple[str, ...], units: tuple[str, ...], limits: Limits, breaks: Array, coefficients: Array
) -> None:
    """Position limits, by the exact extremes of the polynomials; infinite limits hold always."""
    high, low = peaks(coefficients, breaks), peaks(-coefficients, breaks)
    for j, name in enumerate(names):
        for value, bound, time, sign in (
            (float(high.value[j]), float(limits.upper[j]), float(high.time[j]), 1.0),
            (float(-low.value[j]), float(limits.lower[j]), float(low.time[j]), -1.0),
        ):
            if sign * (value - bound) > TOLERANCE * max(1.0, abs(bound)):
                side = "above its upper" if sign > 0.0 else "below its lower"
                message = f"{name} is at {value:.9g} {units[j]} at {time:.6f} s, {side} limit {bound:.9g} {units[j]}"
                ledger.violations.append(Violation("position", (name,), time, value, bound, message))
            half = 0.5 * float(limits.upper[j] - limits.lower[j])
            if np.isfinite(half) and half > 0.0:
                _tighten(ledger, "position", 1.0 + sign * (value - bound) / half, name, time)
    ledger.checked.append("position")


def check_rates(
    ledger: Ledger,
    names: tuple[str, ...],
    units: tuple[str, ...],
    limits: Limits,
    breaks: Array,
    coefficients: Array,
    jerk: bool,
) -> None:
    """Velocity, acceleration and on request jerk limits, by exact extremes; jumps of acceleration for the last."""
    rate = coefficients
    for kind, per in _RATES:
        rate = derivative(rate)
        bounds: Array = getattr(limits, kind)
        if kind == "jerk" and not jerk:
            ledger.not_checked[kind] = "not asked for (jerk_limits=True checks it)"
            return
        if not np.isfinite(bounds).any():
            ledger.not_checked[kind] = "no joint has a limit for it"
            continue
        high, low = peaks(rate, breaks), peaks(-rate, breaks)
        value = np.maximum(high.value, low.value)
        time = np.where(high.value >= low.value, high.time, low.time)
        for j, name in enumerate(names):
            unit = units[j] + per
            _hold(ledger, kind, name, unit, float(value[j]), float(bounds[j]), float(time[j]))
        ledger.checked.append(kind)
    _check_jumps(ledger, "jerk", names, units, derivative(derivative(coefficients)), breaks, _acceleration_jump(limits))


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


def check_continuity(
    ledger: Ledger, names: tuple[str, ...], units: tuple[str, ...], breaks: Array, coefficients: Array
) -> None:
    """Position and velocity must not jump where two pieces meet."""
    ledger.checked.append("continuity")
    scale = np.maximum(1.0, np.abs(coefficients[:, 0]).max(axis=0))
    _check_jumps(ledger, "continuity", names, units, coefficients, breaks, _POSITION_JUMP * scale)
    rate_units = tuple(unit + "/s" for unit in units)
    flat = np.full(len(names), _VELOCITY_JUMP)
    _check_jumps(ledger, "continuity", names, rate_units, derivative(coefficients), breaks, flat)


def _check_jumps(
    ledger: Ledger,
    kind: ViolationKind,
    names: tuple[str, ...],
    units: tuple[str, ...],
    coefficients: Array,
    breaks: Array,
    allowed: Array,
) -> None:
    if len(coefficients) < 2:
        return
    ends = evaluate(coefficients[:-1], np.diff(breaks)[:-1])
    jumps = np.abs(coefficients[1:, 0] - ends)
    for j, name in enumerate(names):
        i = int(np.argmax(jumps[:, j]))
        jump, time = float(jumps[i, j]), float(breaks[i + 1])
        if jump > allowed[j]:
            what = {"continuity": "jumps", "jerk": "has a jump of acceleration, an infinite jerk,"}[kind]
            unit = units[j] + ("/s²" if kind == "jerk" else "")
            message = f"{name} {what} by {jump:.6g} {unit} at {time:.6f} s"
            ledger.violations.append(Violation(kind, (name,), time, jump, float(allowed[j]), message))


def check_rest(
    ledger: Ledger, names: tuple[str, ...], units: tuple[str, ...], breaks: Array, coefficients: Array
) -> None:
    """A motion starts and ends at rest; one of no duration is at rest."""
    ledger.checked.append("rest")
    if len(breaks) < 2:
        return
    rate = derivative(coefficients)
    for when, speeds, time in (
        ("starts", rate[0, 0], breaks[0]),
        ("ends", evaluate(rate[-1:], np.diff(breaks)[-1:])[0], breaks[-1]),
    ):
        for name, unit, speed in zip(names, units, speeds, strict=True):
            if abs(speed) > _VELOCITY_JUMP:
                message = f"{name} {when} with {speed:.6g} {unit}/s at {time:.6f} s, expected rest"
                violation = Violation("rest", (name,), float(time), abs(float(speed)), _VELOCITY_JUMP, message)
                ledger.violations.append(violation)
