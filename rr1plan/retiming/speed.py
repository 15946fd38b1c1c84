"""Timing of a curve from its squared path speed x = (ds/dt)², which is linear in s between gridpoints.

Constant path acceleration u on an interval makes s(t) quadratic there, so a straight line
becomes quadratic in time and a parabola quartic: exact pieces, nothing is sampled or fitted.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.limits import Limits
from rr1plan.retiming.blends import Curve
from rr1plan.retiming.pieces import Pieces


class Grid(NamedTuple):
    """Gridpoints of a curve, every knot among them.

    Args:
        piece: Piece of the curve each interval lies on, shape (n,).
        offset: Where each interval begins on its piece [rad], shape (n,).
        delta: Length of each interval [rad], shape (n,).
    """

    piece: NDArray[np.intp]
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


def make_grid(curve: Curve, counts: NDArray[np.intp]) -> Grid:
    """`counts[i]` equal intervals on piece i."""
    piece = np.repeat(np.arange(len(counts)), counts)
    delta = np.repeat(curve.lengths / counts, counts)
    index = np.concatenate([np.arange(count) for count in counts])
    return Grid(piece, index * delta, delta)


def line_rates(direction: Array, limits: Limits) -> tuple[float, float, float]:
    """Highest path speed, acceleration and jerk along a unit direction (nq,); infinite where nothing limits."""
    moving = direction != 0.0
    size = np.abs(direction[moving])
    bounds = [(limit[moving] / size).min() for limit in (limits.velocity, limits.acceleration, limits.jerk)]
    return float(bounds[0]), float(bounds[1]), float(bounds[2])


def fill_lines(curve: Curve, grid: Grid, x: Array, limits: Limits) -> tuple[Grid, Array]:
    """Fastest speed profile on straight intervals between given squared speeds, in closed form.

    Full acceleration, top speed, full deceleration: the switch points become gridpoints.

    Args:
        curve: The curve.
        grid: Its gridpoints.
        x: Squared path speeds there, shape (n + 1,).
        limits: Velocity and acceleration limits.
    """
    pieces: list[int] = []
    spans: list[tuple[float, float]] = []
    speeds = [float(x[0])]
    for i, (piece, offset, delta) in enumerate(zip(*grid, strict=True)):
        cuts, peak = [delta], float(x[i + 1])
        if not curve.coefficients[piece, 2].any():
            speed, acceleration, _ = line_rates(curve.coefficients[piece, 1], limits)
            peak = max(min(speed**2, 0.5 * (x[i] + x[i + 1]) + acceleration * delta), x[i], x[i + 1])
            rise = (peak - x[i]) / (2.0 * acceleration)
            fall = (peak - x[i + 1]) / (2.0 * acceleration)
            cuts = [min(rise, delta), max(delta - fall, min(rise, delta)), delta]
        tops = [peak] * (len(cuts) - 1) + [float(x[i + 1])]
        start = 0.0
        for cut, top in zip(cuts, tops, strict=True):
            if cut - start > 1e-12 * delta:
                pieces.append(piece)
                spans.append((offset + start, cut - start))
                speeds.append(top)
                start = cut
    offsets, deltas = np.array(spans).T
    return Grid(np.array(pieces), offsets, deltas), np.array(speeds)


def timed(curve: Curve, grid: Grid, x: Array) -> Pieces:
    """Exact polynomials in time of a curve with squared path speed x (n + 1,), linear in s on intervals."""
    v0, v1 = np.sqrt(x[:-1]), np.sqrt(x[1:])
    durations = 2.0 * grid.delta / (v0 + v1)
    v = v0[:, None]
    half = (0.25 * (x[1:] - x[:-1]) / grid.delta)[:, None]
    c1, c2 = grid.first(curve, 0.0), 0.5 * grid.second(curve)
    terms = [grid.position(curve, 0.0), c1 * v, c1 * half + c2 * v**2, 2.0 * c2 * v * half, c2 * half**2]
    degree = 5 if c2.any() else 3
    return Pieces(durations, np.stack(terms[:degree], axis=1))


def time_line(curve: Curve, limits: Limits) -> Pieces:
    """A straight line from rest to rest under velocity and acceleration limits, in closed form."""
    grid = make_grid(curve, np.ones(1, dtype=int))
    return timed(curve, *fill_lines(curve, grid, np.zeros(2), limits))
