"""Timing of a curve from its squared path speed x = (ds/dt)², which is linear in s between gridpoints.

Constant path acceleration u on an interval makes s(t) quadratic there, so a straight line
becomes quadratic in time and a parabola quartic: exact pieces, nothing is sampled or fitted.
The passes along the curve are compiled: `rr1plan._kernels.parameterize`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rr1plan._kernels import blended, path_grid
from rr1plan._kernels import timed as timed_kernels
from rr1plan.checks import Array
from rr1plan.errors import RetimingError
from rr1plan.limits import Limits
from rr1plan.retiming.blends import DUPLICATE, Curve
from rr1plan.retiming.pieces import Pieces

_STEP = 0.2

_make_grid: Callable[..., tuple[NDArray[np.int64], Array, Array]] = path_grid.make_grid
_time_polyline: Callable[..., tuple[Array, Array, bool, int]] = blended.time_polyline
_put_on_clock: Callable[..., None] = timed_kernels.put_on_clock


class Grid(NamedTuple):
    """Gridpoints of a curve, every knot among them.

    Args:
        piece: Piece of the curve each interval lies on, shape (n,).
        offset: Where each interval begins on its piece [rad], shape (n,).
        delta: Length of each interval [rad], shape (n,).
    """

    piece: NDArray[np.int64]
    offset: Array
    delta: Array

    def first(self, curve: Curve, at: float) -> Array:
        """dq/ds on every interval, a fraction `at` (0..1) along it, shape (n, nq)."""
        s = (self.offset + at * self.delta)[:, None]
        return np.asarray(curve.coefficients[self.piece, 1] + 2.0 * s * curve.coefficients[self.piece, 2])

    def second(self, curve: Curve) -> Array:
        """d²q/ds² on every interval, constant there, shape (n, nq)."""
        return np.asarray(2.0 * curve.coefficients[self.piece, 2])

    def position(self, curve: Curve, at: float) -> Array:
        """Position on every interval, a fraction `at` (0..1) along it, shape (n, nq)."""
        s = (self.offset + at * self.delta)[:, None]
        c = curve.coefficients[self.piece]
        return np.asarray(c[:, 0] + s * (c[:, 1] + s * c[:, 2]))


def make_grid(curve: Curve, limits: Limits, longest: Array) -> Grid:
    """Gridpoints between which little changes, and no interval longer than `longest` (m,) [rad] on each piece."""
    velocity, acceleration = limits.velocity, limits.acceleration
    return Grid(*_make_grid(curve.lengths, curve.coefficients, velocity, acceleration, 0.5 * _STEP, longest))


def line_rates(direction: Array, limits: Limits) -> tuple[Array, Array, Array]:
    """Highest path speed, acceleration and jerk along unit directions (..., nq), shape (...) each."""
    size = np.abs(direction)
    with np.errstate(divide="ignore"):
        speed, acceleration, jerk = (
            (limit / size).min(axis=-1) for limit in (limits.velocity, limits.acceleration, limits.jerk)
        )
    return speed, acceleration, jerk


def time_polyline(points: Array, sizes: Array, limits: Limits) -> Pieces:
    """A rounded polyline from rest to rest, as fast as velocity and acceleration limits allow on the grid.

    The motion rests at waypoints without a blend, and at those where a blend would be slower.

    Args:
        points: Cleaned waypoints [rad], shape (m, nq), m >= 2.
        sizes: How far before and behind each its blend reaches [rad], shape (m,).
        limits: Velocity and acceleration limits, finite for joints that move.

    Raises:
        RetimingError: numbers so large or small that no speed is left; says between which waypoints.
    """
    durations, coefficients, bent, failed = _time_polyline(
        points, sizes, limits.velocity, limits.acceleration, _STEP, DUPLICATE
    )
    if failed >= 0:
        raise RetimingError(f"no speed between waypoints {failed - 1} and {failed}; try wider limits")
    return Pieces(durations, coefficients if bent else coefficients[:, :3])


def timed(curve: Curve, grid: Grid, x: Array) -> Pieces:
    """Exact polynomials in time of a curve with squared path speed x (n + 1,), linear in s on intervals."""
    n, _, nq = len(grid.piece), *curve.coefficients.shape[1:]
    durations, coefficients = np.empty(n), np.empty((n, 5, nq))
    _put_on_clock(curve.coefficients, *grid, x, durations, coefficients)
    return Pieces(durations, coefficients if curve.coefficients[:, 2].any() else coefficients[:, :3])
