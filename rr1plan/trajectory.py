"""Trajectories: piecewise polynomials in time, with common breaks for all arms.

All retiming methods produce exact piecewise polynomials (straight lines and parabolic blends under a
constant path acceleration, Ruckig's cubic phases). Limits can therefore be checked between samples, and
trajectories of several arms can be merged exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rr1plan.checks import (
    Array,
    Value,
    finite_array,
    finite_number,
    known_name,
    number_array,
    number_from_zero,
    of_kind,
    positive_number,
    read_only,
    whole_number,
)
from rr1plan.errors import InputError
from rr1plan.notebook_view import NotebookView
from rr1plan.path import MOST_SAMPLES, arms_of, check_joint_names

_MOST_DERIVATIVE = 100
_LARGEST_ROUNDING = 1e-6  # of times [s]
_FINE_ROUNDING = 1e-12  # of times, for which coefficients are not adapted [s]


@dataclass(frozen=True, eq=False)
class Trajectory(Value, NotebookView):
    """Position as a function of time: q(t) = sum_k coefficients[i, k] (t - breaks[i])^k on piece i.

    Outside its time span a trajectory is constant (derivatives are zero).

    Args:
        joint_names: Name of each column, "arm/joint", length nq.
        breaks: Strictly increasing times [s], shape (m + 1,), m >= 1; or shape (1,) for a
            trajectory of duration zero.
        coefficients: Local polynomial coefficients, lowest power first, shape (m, degree + 1, nq);
            (1, degree + 1, nq) for a duration of zero.

    Raises:
        InputError: inconsistent shapes, NaN, breaks that do not strictly increase.
    """

    joint_names: tuple[str, ...]
    breaks: Array
    coefficients: Array

    if TYPE_CHECKING:  # accepted types; the fields above have the stored ones

        def __init__(self, joint_names: Sequence[str], breaks: ArrayLike, coefficients: ArrayLike) -> None: ...

    def __post_init__(self) -> None:
        names = check_joint_names(self.joint_names)
        breaks = finite_array("breaks", self.breaks, (None,))
        coefficients = finite_array("coefficients", self.coefficients, (None, None, len(names)))
        if len(breaks) < 1 or len(coefficients) != max(1, len(breaks) - 1) or coefficients.shape[1] < 1:
            raise InputError(f"{len(breaks)} breaks do not fit coefficients of shape {coefficients.shape}")
        if (np.diff(breaks) <= 0.0).any():
            i = int(np.argmax(np.diff(breaks) <= 0.0))
            raise InputError(f"breaks[{i + 1}] = {breaks[i + 1]} is not after breaks[{i}] = {breaks[i]}")
        object.__setattr__(self, "joint_names", names)
        object.__setattr__(self, "breaks", read_only(breaks))
        object.__setattr__(self, "coefficients", read_only(coefficients))

    def __repr__(self) -> str:
        joints = ", ".join(self.joint_names)
        pieces = f"pieces={len(self.coefficients)}, degree={self.degree}"
        return f"Trajectory({self.duration:.3f} s, {pieces}, joints=[{joints}])"

    # ---- construction ------------------------------------------------------------------

    @classmethod
    def trusted(cls, joint_names: tuple[str, ...], breaks: Array, coefficients: Array) -> Trajectory:
        """A trajectory from validated arguments, without checks or copies; the arrays become read-only.

        The caller must not keep the arrays; see the class for their shapes.
        """
        made = object.__new__(cls)
        values = (
            ("joint_names", joint_names),
            ("breaks", read_only(breaks)),
            ("coefficients", read_only(coefficients)),
        )
        for name, value in values:
            object.__setattr__(made, name, value)
        return made

    @staticmethod
    def rest(joint_names: Sequence[str], q: ArrayLike, *, start: float = 0.0, duration: float = 0.0) -> Trajectory:
        """A motion that rests at one configuration.

        Args:
            joint_names: Name of each column, "arm/joint", length nq.
            q: The configuration [rad or m], shape (nq,).
            start: First instant [s].
            duration: Time from start to end [s].

        Raises:
            InputError: inconsistent shapes, not finite, a negative duration.
        """
        names = check_joint_names(joint_names)
        q = finite_array("q", q, (len(names),))
        start, duration = finite_number("start", start), number_from_zero("duration", duration)
        breaks = [start] if duration == 0.0 else [start, start + duration]
        return Trajectory(names, np.array(breaks), q[None, None, :])

    @staticmethod
    def from_samples(
        joint_names: Sequence[str],
        times: ArrayLike,
        q: ArrayLike,
        qd: ArrayLike | None = None,
        qdd: ArrayLike | None = None,
    ) -> Trajectory:
        """A motion through samples, as a ROS joint trajectory controller interpolates them.

        Positions alone are joined by straight lines (velocity jumps at each sample, which the referee reports),
        positions and velocities by cubics, positions, velocities and accelerations by quintics; see `degree`.

        Args:
            joint_names: Name of each column, "arm/joint", length nq.
            times: Strictly increasing [s], shape (n,), n >= 1.
            q: Positions [rad or m], shape (n, nq).
            qd: Velocities [rad/s or m/s], shape (n, nq), or None.
            qdd: Accelerations [rad/s² or m/s²], shape (n, nq), or None.

        Raises:
            InputError: inconsistent shapes, values that are not finite, times that do not increase, samples so close
                together that derivatives between them overflow, or accelerations without velocities.
        """
        names = check_joint_names(joint_names)
        times = finite_array("times", times, (None,))
        if len(times) == 0:
            raise InputError("a trajectory has at least one sample, got none")
        if qdd is not None and qd is None:
            raise InputError("got accelerations without velocities, expected qd too")
        shape = (len(times), len(names))
        rates = ((n, v) for n, v in (("qd", qd), ("qdd", qdd)) if v is not None)
        rows = [finite_array(n, v, shape) for n, v in (("q", q), *rates)]
        if not (np.diff(times) > 0.0).all():
            i = int(np.argmax(np.diff(times) <= 0.0))
            raise InputError(f"times do not strictly increase: times[{i + 1}] = {times[i + 1]} after {times[i]}")
        if len(times) == 1:
            return Trajectory(names, times, rows[0][None])
        with np.errstate(all="ignore"):
            coefficients = _interpolate(np.diff(times)[:, None], rows)
        if not np.isfinite(coefficients).all():
            i = int(np.argwhere(~np.isfinite(coefficients))[0, 0])
            raise InputError(
                f"samples {i} and {i + 1}, {times[i + 1] - times[i]:.3g} s apart, give rates that overflow"
            )
        return Trajectory(names, times, coefficients)

    @staticmethod
    def merge(*parts: Trajectory) -> Trajectory:
        """One trajectory with the joints of all `parts`, each constant outside its own time span.

        Raises:
            InputError: no parts, or a joint in two of them.
        """
        if not parts:
            raise InputError("merge got no trajectories")
        for part in parts:
            of_kind("a part to merge", part, Trajectory)
        names = check_joint_names([name for part in parts for name in part.joint_names])
        breaks = np.unique(np.concatenate([part.breaks for part in parts]))
        degree = max(part.coefficients.shape[1] for part in parts)
        return Trajectory(names, breaks, np.concatenate([part._on(breaks, degree) for part in parts], axis=2))

    def select(self, arm: str) -> Trajectory:
        """The columns of one arm, with the same breaks.

        Raises:
            UnknownNameError: no column belongs to that arm.
        """
        known_name("arm", arm, self.arms)
        return of_joints(self, tuple(name for name in self.joint_names if name.split("/", 1)[0] == arm))

    def stretched(self, factor: float) -> Trajectory:
        """The same motion, `factor` times as long (derivatives are divided by factor, factor², factor³).

        Raises:
            InputError: not a number above zero, or times or rates that floats cannot represent.
        """
        factor = positive_number("factor", factor)
        start = self.breaks[0]
        with np.errstate(over="ignore", invalid="ignore"):
            breaks = start + (self.breaks - start) * factor
            coefficients = self.coefficients * (factor ** -np.arange(self.coefficients.shape[1]))[None, :, None]
        lasts = breaks[-1] > start or self.duration == 0.0
        if not (lasts and np.isfinite(breaks).all() and np.isfinite(coefficients).all()):
            raise InputError(f"factor is {factor:g}, which makes times or rates that floats cannot represent")
        return self._with_rounded(breaks, coefficients, (breaks - start) - (self.breaks - start) * factor)

    def shifted(self, seconds: float) -> Trajectory:
        """The same motion, `seconds` [s] later (earlier if negative).

        Times since 1970 are rounded to 0.2 µs. A motion shifted back from there has velocity jumps of 1e-6 rad/s where
        its acceleration jumps, which `validate` reports: keep the motion that was shifted instead.

        Raises:
            InputError: not finite, or so large that times would be rounded to more than a microsecond.
        """
        breaks = self.breaks + finite_number("seconds", seconds)
        before, rounding = (float(np.spacing(np.abs(times).max())) for times in (self.breaks, breaks))
        if not rounding <= max(_LARGEST_ROUNDING, before):
            raise InputError(
                f"seconds is {seconds:g}, which rounds times to {rounding:.3g} s, expected a time within ±4e9 s"
            )
        return self._with_rounded(breaks, self.coefficients, (breaks - seconds) - self.breaks)

    def cut(self, begin: float, end: float) -> Trajectory:
        """The motion between two times; before its start and after its end it rests.

        Args:
            begin: First instant [s].
            end: Last instant [s], not before the first.

        Raises:
            InputError: not finite, or an end before the beginning.
        """
        begin, end = finite_number("begin", begin), finite_number("end", end)
        if end < begin:
            raise InputError(f"the motion is to end at {end}, before {begin}")
        inner = self.breaks[np.searchsorted(self.breaks, begin, "right") : np.searchsorted(self.breaks, end)]
        breaks = np.concatenate([[begin], inner, [end]]) if end > begin else np.array([begin])
        return Trajectory.trusted(self.joint_names, breaks, self._on(breaks, self.coefficients.shape[1]))

    # ---- reading -----------------------------------------------------------------------

    @property
    def arms(self) -> tuple[str, ...]:
        """Names of the arms, in the order of their columns."""
        return arms_of(self.joint_names)

    @property
    def degree(self) -> int:
        """Degree of the polynomials: 1 for straight lines between samples, 3 for cubics, 5 for quintics."""
        return int(self.coefficients.shape[1]) - 1

    @property
    def start_time(self) -> float:
        """First instant [s]."""
        return float(self.breaks[0])

    @property
    def end_time(self) -> float:
        """Last instant [s]."""
        return float(self.breaks[-1])

    @property
    def duration(self) -> float:
        """Time from start to end [s]."""
        return self.end_time - self.start_time

    def __call__(self, t: ArrayLike, derivative: int = 0) -> Array:
        """Position (or a derivative of it) at time t.

        Args:
            t: Time [s], a number or an array of any shape.
            derivative: 0 position, 1 velocity, 2 acceleration, 3 jerk. At a break, the piece that
                begins there is evaluated (the last piece at the end).

        Returns:
            Shape (*t.shape, nq) [rad/s^derivative].

        Raises:
            InputError: a time that is not finite, or another derivative.
        """
        whole_number("derivative", derivative, 0, 3)
        times = number_array("t", t)
        flat = times.ravel()
        if not np.isfinite(flat).all():
            raise InputError("t is not finite")
        piece, local = locate(self.breaks, flat)
        first = int(piece.min(initial=len(self.coefficients) - 1))
        used = self.coefficients[first : int(piece.max(initial=first)) + 1]
        coefficients = differentiate(used, derivative)
        if len(used) > 1:  # else a row for all times
            coefficients = coefficients[piece - first]
        value = np.zeros((len(flat), len(self.joint_names)))
        for k in range(coefficients.shape[1] - 1, -1, -1):
            value *= local[:, None]
            value += coefficients[:, k]
        if derivative > 0:
            value[(flat < self.breaks[0]) | (flat > self.breaks[-1])] = 0.0
        return value.reshape(*times.shape, len(self.joint_names))

    def derivative_coefficients(self, derivative: int) -> Array:
        """Local coefficients of a derivative, lowest power first, shape (m, max(degree + 1 - derivative, 1), nq).

        Raises:
            InputError: a derivative that is negative or above 100.
        """
        whole_number("derivative", derivative, 0, _MOST_DERIVATIVE)
        return differentiate(self.coefficients, derivative)

    def sample_times(self, dt: float) -> Array:
        """Times start, start + dt, ..., and the end [s], shape (n,).

        Raises:
            InputError: not a number above zero, or more than ten million times.
        """
        dt = positive_number("dt", dt)
        if self.duration > MOST_SAMPLES * dt:
            raise InputError(f"dt of {dt} s makes more than {MOST_SAMPLES} samples, take a longer one")
        count = int(np.floor(self.duration / dt + 1e-9))
        times: Array = np.asarray(self.start_time + dt * np.arange(count + 1), dtype=np.float64)
        return times if self.end_time - times[-1] < 1e-9 * max(1.0, dt) else np.append(times, self.end_time)

    def sample(self, dt: float) -> tuple[Array, Array]:
        """Times (n,) [s] every dt [s] and at the end, and positions (n, nq) [rad or m] there.

        Raises:
            InputError: as `sample_times`.
        """
        times = self.sample_times(dt)
        return times, self(times)

    def allclose(self, other: Trajectory, atol: float = 1e-12) -> bool:
        """Whether joints are the same, and breaks and coefficients of `other` agree within `atol`."""
        of_kind("other", other, Trajectory)
        atol = finite_number("atol", atol)
        return (
            self.joint_names == other.joint_names
            and self.breaks.shape == other.breaks.shape
            and self.coefficients.shape == other.coefficients.shape
            and bool(np.allclose(self.breaks, other.breaks, rtol=0.0, atol=atol))
            and bool(np.allclose(self.coefficients, other.coefficients, rtol=0.0, atol=atol))
        )

    def _with_rounded(self, breaks: Array, coefficients: Array, late: Array) -> Trajectory:
        """The trajectory with other breaks and coefficients, without pieces whose breaks are equal.

        Pieces of merged trajectories may be so short that their breaks are equal after rounding. Where breaks are
        rounded as coarsely as times since 1970, coefficients are adapted, so that positions do not jump.

        Args:
            breaks: The breaks [s], shape (m + 1,).
            coefficients: Coefficients for exact breaks, shape (m, degree + 1, nq).
            late: Rounded minus exact breaks [s], shape (m + 1,).
        """
        begin = late[: len(coefficients)]
        if (coarse := np.abs(begin) > _FINE_ROUNDING).any():
            coefficients = _begin_later(coefficients, np.where(coarse, begin, 0.0))
        lasts = np.diff(breaks) > 0.0
        if lasts.all():
            return Trajectory(self.joint_names, breaks, coefficients)
        kept = coefficients[lasts] if lasts.any() else coefficients[:1]
        return Trajectory(self.joint_names, np.append(breaks[:1], breaks[1:][lasts]), kept)

    def _on(self, breaks: Array, degree: int) -> Array:
        """Coefficients on a refinement of `self.breaks`, shape (m, degree, nq)."""
        starts = breaks[:-1] if len(breaks) > 1 else breaks
        out = np.zeros((len(starts), degree, len(self.joint_names)))
        inside = (starts >= self.breaks[0]) & (starts < self.breaks[-1])
        piece = np.clip(np.searchsorted(self.breaks, starts, side="right") - 1, 0, len(self.coefficients) - 1)
        terms = self.coefficients.shape[1]
        out[:, :terms] += self.coefficients[piece]
        # Most breaks are breaks of this trajectory, where its coefficients are kept.
        shift = starts - self.breaks[piece]
        rows = np.flatnonzero(shift)
        out[rows, :terms] = _begin_later(out[rows, :terms], shift[rows])
        out[~inside] = 0.0
        out[~inside, 0] = self(np.where(starts[~inside] < self.breaks[0], self.breaks[0], self.breaks[-1]))
        return out


def of_joints(trajectory: Trajectory, joint_names: tuple[str, ...]) -> Trajectory:
    """The columns of some joints of a trajectory, in the order of these names, with the same breaks."""
    column = {name: i for i, name in enumerate(trajectory.joint_names)}
    coefficients = trajectory.coefficients[:, :, [column[name] for name in joint_names]]
    return Trajectory.trusted(joint_names, trajectory.breaks, np.ascontiguousarray(coefficients))


def locate(breaks: Array, times: Array) -> tuple[NDArray[np.int64], Array]:
    """The piece of each time, and the time since its beginning [s], shape (n,) each; ends of the span beyond it.

    Args:
        breaks: Breaks of a trajectory [s], shape (m + 1,).
        times: Times [s], shape (n,).
    """
    piece = np.clip(np.searchsorted(breaks, times, side="right") - 1, 0, max(0, len(breaks) - 2))
    return piece, np.clip(times, breaks[0], breaks[-1]) - breaks[piece]


def _begin_later(coefficients: Array, late: Array) -> Array:
    """Local coefficients (m, degree + 1, n) of the same polynomials from instants that are `late` (m,) [s] later."""
    moved = coefficients.copy()
    for k in range(coefficients.shape[1]):
        for j in range(k + 1, coefficients.shape[1]):
            moved[:, k] += comb(j, k) * coefficients[:, j] * (late ** (j - k))[:, None]
    return moved


def _interpolate(h: Array, rows: list[Array]) -> Array:
    """Coefficients between samples at steps of h (m, 1) [s]: degree 1, 3 or 5 for 1, 2 or 3 arrays in `rows`."""
    q0, q1 = rows[0][:-1], rows[0][1:]
    if len(rows) == 1:
        return np.stack([q0, (q1 - q0) / h], axis=1)
    v0, v1 = rows[1][:-1], rows[1][1:]
    if len(rows) == 2:
        dq, dv = q1 - q0 - v0 * h, (v1 - v0) * h
        return np.stack([q0, v0, (3.0 * dq - dv) / h**2, (dv - 2.0 * dq) / h**3], axis=1)
    a0, a1 = rows[2][:-1], rows[2][1:]
    dq, dv, da = q1 - q0 - v0 * h - a0 * h**2 / 2.0, (v1 - v0 - a0 * h) * h, (a1 - a0) * h**2
    cubic = (10.0 * dq - 4.0 * dv + da / 2.0) / h**3
    quartic = (-15.0 * dq + 7.0 * dv - da) / h**4
    quintic = (6.0 * dq - 3.0 * dv + da / 2.0) / h**5
    return np.stack([q0, v0, a0 / 2.0, cubic, quartic, quintic], axis=1)


def differentiate(coefficients: Array, derivative: int) -> Array:
    """Local coefficients of a derivative of polynomials.

    Args:
        coefficients: Lowest power first, shape (m, k + 1, n).
        derivative: 1 velocity, 2 acceleration, and so on.

    Returns:
        Shape (m, max(k + 1 - derivative, 1), n).
    """
    c = coefficients
    for _ in range(derivative):
        c = np.asarray(c[:, 1:] * np.arange(1, c.shape[1])[None, :, None] if c.shape[1] > 1 else np.zeros_like(c))
    return c
