"""Time-optimal path parameterization by the squared path speed x = (ds/dt)², piecewise linear in s.

With constant path acceleration u on an interval, s(t) is quadratic there, so a straight line
becomes quadratic in time and a parabola quartic: exact pieces, without sampling or fitting.
The forward and backward passes are compiled (`parameterize.c`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.errors import RetimingError
from rr1plan.kernels.planner_kernels import CStruct, constants, load_library
from rr1plan.planning_constants import TIMING
from rr1plan.retiming.path_blends import DUPLICATE, Curve
from rr1plan.retiming.timed_pieces import Pieces
from rr1plan.robot.joint_limits import Limits

_STEP = TIMING.step
# Least initial sizes of the arena and of the arrays of timed pieces; both are doubled on demand.
_ARENA = 1 << 16
_PIECES = 256
# Pieces of a waypoint with a blend, numbers in the arena for each piece and joint; measured on paths of short edges.
_PIECES_PER_WAYPOINT, _ARENA_PER_PIECE = 72, 24


class Grid(NamedTuple):
    """Grid on a curve; all knots are gridpoints.

    Args:
        piece: Index of the piece that contains each interval, shape (n,).
        offset: Parameter s at the beginning of each interval on its piece [rad or m], shape (n,).
        delta: Length of each interval [rad or m], shape (n,).
    """

    piece: NDArray[np.int64]
    offset: Array
    delta: Array

    def part(self, begin: int, end: int) -> Grid:
        """The intervals from gridpoint `begin` to gridpoint `end`."""
        return Grid(self.piece[begin:end], self.offset[begin:end], self.delta[begin:end])

    def first(self, curve: Curve, at: float) -> Array:
        """dq/ds at a fraction `at` (0..1) of every interval, shape (n, nq)."""
        s = (self.offset + at * self.delta)[:, None]
        return np.asarray(curve.coefficients[self.piece, 1] + 2.0 * s * curve.coefficients[self.piece, 2])

    def second(self, curve: Curve) -> Array:
        """d²q/ds² on every interval, where it is constant, shape (n, nq)."""
        return np.asarray(2.0 * curve.coefficients[self.piece, 2])

    def position(self, curve: Curve, at: float) -> Array:
        """Position at a fraction `at` (0..1) of every interval, shape (n, nq)."""
        s = (self.offset + at * self.delta)[:, None]
        c = curve.coefficients[self.piece]
        return np.asarray(c[:, 0] + s * (c[:, 1] + s * c[:, 2]))


NO_INTERVALS = Grid(np.zeros(0, np.int64), np.zeros(0), np.zeros(0))
"""The grid of a curve without pieces."""


def joined(parts: Sequence[tuple[Curve, Grid]]) -> tuple[Curve, Grid]:
    """Curves with their grids, one after the other, as one; its `corners` have no meaning.

    Args:
        parts: The curves and grids, at least one.
    """
    curves, grids = zip(*parts, strict=True)
    before = np.cumsum([0, *(len(curve.lengths) for curve in curves)])
    moved = [grid._replace(piece=grid.piece + first) for grid, first in zip(grids, before, strict=False)]
    lengths = np.concatenate([curve.lengths for curve in curves])
    coefficients = np.concatenate([curve.coefficients for curve in curves])
    return Curve(lengths, coefficients, (0, 0)), Grid(*map(np.concatenate, zip(*moved, strict=True)))


def make_grid(curve: Curve, limits: Limits, longest: Array) -> Grid:
    """An adaptive grid, with intervals of at most `longest` (m,) [rad or m] on each piece."""
    path, rates, longest = _curve_struct(curve), _limits_struct(limits), np.ascontiguousarray(longest)
    capacity = _PIECES
    while True:
        piece, offset, delta = np.empty(capacity, np.int64), np.empty(capacity), np.empty(capacity)
        arena = CStruct("Arena", memory=np.empty(3 * capacity), size=3 * capacity)
        count = load_library().rr1_make_grid(
            *(path, rates, 0.5 * _STEP, longest, arena), *(piece, offset, delta, capacity)
        )
        if count != constants()["ARENA_FULL"]:
            return Grid(piece[:count], offset[:count], delta[:count])
        capacity *= 2


def _curve_struct(curve: Curve) -> CStruct:
    lengths, coefficients = np.ascontiguousarray(curve.lengths), np.ascontiguousarray(curve.coefficients)
    count, _, nq = coefficients.shape
    return CStruct("PathCurve", lengths=lengths, coefficients=coefficients.ravel(), count=count, column_count=nq)


def _limits_struct(limits: Limits) -> CStruct:
    # Limits are above zero.
    velocity, acceleration = np.ascontiguousarray(limits.velocity), np.ascontiguousarray(limits.acceleration)
    return CStruct(
        "RateLimits",
        velocity=velocity,
        acceleration=acceleration,
        inverse_velocity=1.0 / velocity,
        inverse_acceleration=1.0 / acceleration,
    )


def line_rates(direction: Array, limits: Limits) -> tuple[Array, Array, Array]:
    """Highest path speed, acceleration and jerk along unit directions (..., nq), shape (...) each."""
    size = np.abs(direction)
    with np.errstate(divide="ignore"):
        speed, acceleration, jerk = (
            (limit / size).min(axis=-1) for limit in (limits.velocity, limits.acceleration, limits.jerk)
        )
    return speed, acceleration, jerk


def time_polyline(points: Array, sizes: Array, limits: Limits) -> Pieces:
    """Time a rounded polyline from rest to rest, optimally on the grid under velocity and acceleration limits.

    The motion stops at waypoints without a blend, and at those where a blend would be slower.

    Args:
        points: Cleaned waypoints [rad or m], shape (m, nq), m >= 2.
        sizes: Blend sizes, see `blend_sizes` [rad or m], shape (m,).
        limits: Velocity and acceleration limits, finite for moving joints.

    Raises:
        RetimingError: no feasible speed because of extreme numbers; the message names the waypoints.
    """
    points, sizes, rates = np.ascontiguousarray(points), np.ascontiguousarray(sizes), _limits_struct(limits)
    capacity = max(_PIECES, _PIECES_PER_WAYPOINT * len(points))
    arena_size = max(_ARENA, _ARENA_PER_PIECE * capacity * points.shape[1])
    full = code = constants()["ARENA_FULL"]
    while code == full:
        durations, coefficients = np.empty(capacity), np.empty((capacity, 5, points.shape[1]))
        arena = CStruct("Arena", memory=np.empty(arena_size), size=arena_size)
        pieces = CStruct("TimedPieces", durations=durations, coefficients=coefficients.ravel(), capacity=capacity)
        code = load_library().rr1_time_polyline(points, sizes, *points.shape, rates, _STEP, DUPLICATE, arena, pieces)
        arena_size, capacity = 2 * arena_size, 2 * capacity
    if code < full:
        failed = full - 1 - code
        raise RetimingError(f"no speed between waypoints {failed - 1} and {failed}; try wider limits")
    made = pieces.value.count
    terms = 5 if code == constants()["TIMED_BENT"] else 3
    return Pieces(durations[:made], coefficients[:made, :terms])


def timed(curve: Curve, grid: Grid, x: Array) -> Pieces:
    """Exact polynomials in time of a curve with squared path speed x (n + 1,), linear in s on intervals."""
    n, _, nq = len(grid.piece), *curve.coefficients.shape[1:]
    durations, coefficients = np.empty(n), np.empty((n, 5, nq))
    offset, delta, x = np.ascontiguousarray(grid.offset), np.ascontiguousarray(grid.delta), np.ascontiguousarray(x)
    piece = np.ascontiguousarray(grid.piece)
    load_library().rr1_time_intervals(_curve_struct(curve), piece, offset, delta, x, n, durations, coefficients)
    return Pieces(durations, coefficients if curve.coefficients[:, 2].any() else coefficients[:, :3])


def hop_times(
    curve: Curve,
    grid: Grid,
    limits: Limits,
    halts: NDArray[np.int64],
    begins: NDArray[np.int64],
    ends: NDArray[np.int64],
) -> Array:
    """When the fastest motions from rest at some gridpoints to rest at others pass those in between [s].

    Args:
        curve: The curve.
        grid: Its gridpoints, n + 1 of them.
        limits: Velocity and acceleration limits, finite for joints that move.
        halts: 1 for gridpoints where every motion stops, shape (n + 1,).
        begins: Gridpoints where the motions begin, shape (m,).
        ends: Gridpoints where they end, after those, shape (m,).

    Returns:
        Times since the start of each motion, shape (m, n + 1); meaningless outside the motion.
    """
    path, rates, size = _curve_struct(curve), _limits_struct(limits), _ARENA
    piece, offset, delta = (np.ascontiguousarray(part) for part in grid)
    times = np.zeros((len(begins), len(delta) + 1))
    hops = np.ascontiguousarray(begins), np.ascontiguousarray(ends), len(begins)
    code = full = constants()["ARENA_FULL"]
    while code == full:
        arena = CStruct("Arena", memory=np.empty(size), size=size)
        code = load_library().rr1_time_hops(
            *(path, rates, piece, offset, delta, len(delta), np.ascontiguousarray(halts)), *hops, arena, times
        )
        size *= 4
    return times


def rounded_duration(points: Array, sizes: Array, limits: Limits, intervals: int) -> float:
    """Duration of the fastest motion from rest to rest along a rounded polyline, on a coarse grid [s].

    Args:
        points: Cleaned waypoints, shape (n, nq).
        sizes: Blend sizes, see `blend_sizes`; the motion stops where they are zero, shape (n,).
        limits: Velocity and acceleration limits, finite for joints that move.
        intervals: Intervals of each straight line and each blend, >= 2.
    """
    if len(points) < 2:
        return 0.0
    points, sizes = np.ascontiguousarray(points), np.ascontiguousarray(sizes)
    rates, size = _limits_struct(limits), _ARENA
    while True:
        arena = CStruct("Arena", memory=np.empty(size), size=size)
        duration: float = load_library().rr1_rounded_duration(
            points, sizes, *points.shape, rates, intervals, DUPLICATE, arena
        )
        if duration >= 0.0:
            return duration
        size *= 4


def fastest_speeds(curve: Curve, grid: Grid, limits: Limits, first: float = 0.0) -> Array:
    """The fastest squared path speeds at the gridpoints of a curve with rest at its end, shape (n + 1,).

    They are linear in s between gridpoints, so from rest to rest a grid has to have at least two intervals.

    Args:
        curve: The curve.
        grid: Its gridpoints.
        limits: Velocity and acceleration limits, finite for joints that move.
        first: Squared path speed at the beginning; the result begins with less if the motion cannot stop from there.
    """
    path, rates = _curve_struct(curve), _limits_struct(limits)
    piece, offset, delta = (np.ascontiguousarray(part) for part in grid)
    x, size = np.empty(len(delta) + 1), _ARENA
    while True:
        arena = CStruct("Arena", memory=np.empty(size), size=size)
        code = load_library().rr1_fastest_speeds(path, rates, piece, offset, delta, len(delta), first, arena, x)
        if code != constants()["ARENA_FULL"]:
            return x
        size *= 4
