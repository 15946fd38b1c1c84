"""The fastest motion of one joint from rest to rest, with and without a limit of jerk, in closed form.

With a jerk limit it has seven phases of constant jerk: +j, 0, -j, 0, -j, 0, +j. Biagiotti, Melchiorri, "Trajectory
planning for automatic machines and robots" (2008), 3.4; Berscheid, Kröger, "Jerk-limited real-time trajectory
generation with arbitrary target states", RSS 2021, solve it for any state.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rr1plan.checks import Array, Value, finite_array, positive_number, read_only

PHASES = (
    "acceleration rises",
    "acceleration is constant",
    "acceleration falls",
    "speed is constant",
    "deceleration rises",
    "deceleration is constant",
    "deceleration falls",
)
_SIGNS = np.array([1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False, repr=False)
class SevenPhases(Value):
    """A motion of one joint from rest to rest.

    Args:
        durations: Duration of each phase [s], shape (7,); zero for phases that do not occur.
        jerk: Jerk of each phase [rad/s³], shape (7,).
    """

    durations: Array
    jerk: Array

    @property
    def duration(self) -> float:
        """Duration of the whole motion [s]."""
        return float(self.durations.sum())

    def __repr__(self) -> str:
        return f"SevenPhases({int((self.durations > 1e-12).sum())} of 7 phases, {self.duration:.4f} s)"

    def state(self, times: ArrayLike) -> Array:
        """Position, velocity, acceleration and jerk at times (n,) [s], shape (n, 4)."""
        t = finite_array("times", times, (None,))
        states, ends = [np.zeros(3)], np.concatenate([[0.0], np.cumsum(self.durations)])
        for duration, jerk in zip(self.durations, self.jerk, strict=True):
            states.append(_advance(states[-1], float(jerk), duration))
        phase = np.clip(np.searchsorted(ends, t, side="right") - 1, 0, 6)
        moved = _advance(np.array(states)[phase].T, self.jerk[phase], np.clip(t, 0.0, ends[-1]) - ends[phase])
        return np.column_stack([*moved, self.jerk[phase]])


def _advance(state: Array, jerk: Array | float, t: Array | float) -> Array:
    p, v, a = state
    return np.array([p + t * (v + t * (a / 2 + t * jerk / 6)), v + t * (a + t * jerk / 2), a + t * jerk])


def seven_phases(distance: float, velocity: float, acceleration: float, jerk: float) -> SevenPhases:
    """The fastest motion of one joint from rest to rest under three limits.

    Args:
        distance: Distance [rad], above 0.
        velocity: Limit [rad/s].
        acceleration: Limit [rad/s²].
        jerk: Limit [rad/s³].

    Raises:
        InputError: a number that is not above 0.
    """
    h, v = positive_number("distance", distance), positive_number("velocity", velocity)
    a, j = positive_number("acceleration", acceleration), positive_number("jerk", jerk)
    # Durations of a jerk phase and of the whole acceleration if the speed limit is reached.
    rise, up = (a / j, a / j + v / a) if v * j >= a * a else (np.sqrt(v / j), 2.0 * np.sqrt(v / j))
    if h < v * up:
        # It is not reached: the motion consists of acceleration and deceleration only.
        if h >= 2.0 * a**3 / j**2:
            rise, up = a / j, 0.5 * (a / j + np.sqrt((a / j) ** 2 + 4.0 * h / a))
        else:
            rise = np.cbrt(h / (2.0 * j))
            up = 2.0 * rise
    cruise = max(0.0, (h - v * up) / v)
    durations = np.array([rise, up - 2.0 * rise, rise, cruise, rise, up - 2.0 * rise, rise])
    return SevenPhases(read_only(durations), read_only(_SIGNS * j))
