"""The phase plane of a path: the limit curve, and the fastest motion from rest to rest.

A path q(s) is traversed with speed ṡ and acceleration s̈. The limits of the joints,

    |q'(s) ṡ| <= v   and   |q'(s) s̈ + q''(s) ṡ²| <= a,

are linear in s̈ and x = ṡ². The largest x for which any s̈ is allowed is the limit curve. A backward pass computes the
speeds from which the end can be reached at rest, a forward pass goes as fast as these allow: Pham, Pham, "A new
approach to time-optimal path parameterization based on reachability analysis", IEEE Trans. Robotics 34 (2018).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rr1plan.checks import Array, Value, number_from_zero, of_kind, positive_number, read_only
from rr1plan.collision import CollisionChecker
from rr1plan.errors import InputError
from rr1plan.path import Path
from rr1plan.retiming.check_limits import check_limits
from rr1plan.retiming.path_blends import Curve, blend_sizes, clean, curves
from rr1plan.retiming.path_speed import make_grid
from rr1plan.robot.joint_limits import Limits
from rr1plan.scene import Scene

FINEST = 0.02  # longest interval of the grid [rad]
_STEADY = 1e-3  # largest acceleration of a motion that looks steady, as a share of its largest one


@dataclass(frozen=True, eq=False, repr=False)
class PathGrid(Value):
    """A path on a grid, by its derivatives at both ends of every interval; the second derivative is constant on it.

    Args:
        s: Gridpoints [rad], shape (n + 1,).
        q: Configurations there [rad], shape (n + 1, nq).
        begin: dq/ds at the beginning of each interval, shape (n, nq).
        end: dq/ds at its end.
        bend: d²q/ds² on each interval [1/rad], shape (n, nq).
        stops: Interior gridpoints at which the motion stops, i.e. corners without a blend.
    """

    s: Array
    q: Array
    begin: Array
    end: Array
    bend: Array
    stops: tuple[int, ...] = ()

    def __repr__(self) -> str:
        return f"PathGrid({len(self.s)} points, {self.s[-1]:.2f} rad)"


@dataclass(frozen=True, eq=False, repr=False)
class PhasePlane(Value):
    """Speeds along a path; n intervals.

    Args:
        grid: The path.
        limit: The limit curve ṡ at the beginning and at the end of each interval [rad/s], shape (n, 2). It jumps where
            the second derivative does.
        reach: Largest ṡ from which the motion can still stop in time, shape (n + 1,).
        speed: ṡ of the fastest motion, shape (n + 1,).
        acceleration: s̈ of the fastest motion [rad/s²], shape (n,).
        times: Times at the gridpoints [s], shape (n + 1,).
    """

    grid: PathGrid
    limit: Array
    reach: Array
    speed: Array
    acceleration: Array
    times: Array

    @property
    def duration(self) -> float:
        """Duration of the fastest motion [s]."""
        return float(self.times[-1])

    @property
    def switches(self) -> tuple[int, ...]:
        """Gridpoints at which the motion changes from accelerating or cruising to braking, or the reverse."""
        return tuple((np.flatnonzero(np.diff(signs_of(self.acceleration))) + 1).tolist())

    def __repr__(self) -> str:
        return f"PhasePlane({len(self.switches)} switching points, {self.duration:.3f} s)"


def signs_of(acceleration: Array) -> Array:
    """1 where a motion gets faster, -1 where it gets slower, 0 where it is steady.

    At the limits of velocity, the smallest bend of a path changes its speed a little.
    """
    small = _STEADY * float(np.abs(acceleration).max())
    return np.where(np.abs(acceleration) < small, 0.0, np.sign(acceleration))


def phase_plane(
    path: Path,
    scene: Scene,
    *,
    max_blend: float = 0.4,
    velocity_scale: float = 1.0,
    acceleration_scale: float = 1.0,
) -> PhasePlane:
    """The limit curve of a path, and its fastest motion from rest to rest.

    Args:
        path: A path of arms of the scene, with at least two different waypoints.
        scene: The scene, which certifies blends and gives limits.
        max_blend: Largest distance from a corner to the beginning of its blend [rad]; 0 stops at every corner.
        velocity_scale: Share of the velocity limits to use, 0.001 to 1000.
        acceleration_scale: Share of the acceleration limits to use, 0.001 to 1000.

    Raises:
        UnknownNameError: a joint's arm is not in the scene.
        InputError: a number out of range, a path that does not move, or a joint without limits.
    """
    velocity = _scale("velocity_scale", velocity_scale)
    acceleration = _scale("acceleration_scale", acceleration_scale)
    grid = path_grid(path, scene, max_blend=max_blend)
    limits = scene.limits(path.arms)
    return fastest_motion(grid, velocity * limits.velocity, acceleration * limits.acceleration)


def _scale(name: str, value: float) -> float:
    scale = positive_number(name, value)
    if not 1e-3 <= scale <= 1e3:
        raise InputError(f"{name} is {scale:g}, expected 0.001 to 1000")
    return scale


def path_grid(path: Path, scene: Scene, *, max_blend: float = 0.4) -> PathGrid:
    """The grid of a path with certified blends; for arguments and errors see `phase_plane`."""
    of_kind("path", path, Path)
    of_kind("scene", scene, Scene)
    arms, largest = path.arms, number_from_zero("max_blend", max_blend)
    checker, limits = CollisionChecker(scene, arms), scene.limits(arms)
    if path.joint_names != checker.joint_names:
        raise InputError(f"the path moves {', '.join(path.joint_names)}, expected {', '.join(checker.joint_names)}")
    points = clean(path.waypoints)
    if len(points) < 2:
        raise InputError("the path does not move, expected two different waypoints")
    check_limits(path.joint_names, points, limits)
    return grid_of(curves(points, blend_sizes(points, largest, checker)), limits)


def grid_of(parts: list[Curve], limits: Limits) -> PathGrid:
    """The grid of curves that consist of lines and parabolas, with a stop after each curve but the last."""
    grids = [make_grid(curve, limits, np.minimum(FINEST, 0.5 * curve.lengths)) for curve in parts]
    pairs = list(zip(parts, grids, strict=True))
    lengths = np.concatenate([grid.delta for grid in grids])
    s = np.concatenate([[0.0], np.cumsum(lengths)])
    q = [grid.position(curve, 0.0) for curve, grid in pairs] + [pairs[-1][1].position(pairs[-1][0], 1.0)[-1:]]
    begin = np.vstack([grid.first(curve, 0.0) for curve, grid in pairs])
    end = np.vstack([grid.first(curve, 1.0) for curve, grid in pairs])
    bend = np.vstack([grid.second(curve) for curve, grid in pairs])
    stops = np.cumsum([len(grid.delta) for grid in grids])[:-1].tolist()
    s, positions, begin, end, bend = (read_only(part) for part in (s, np.vstack(q), begin, end, bend))
    return PathGrid(s, positions, begin, end, bend, tuple(stops))


def fastest_motion(grid: PathGrid, velocity: Array, acceleration: Array) -> PhasePlane:
    """The limit curve and the fastest motion from rest to rest.

    Args:
        grid: The path.
        velocity: Limits of the joints [rad/s], shape (nq,).
        acceleration: Limits of the joints [rad/s²], shape (nq,).
    """
    n, delta = len(grid.begin), np.diff(grid.s)
    rows = [_rows(grid, i, delta[i], acceleration) for i in range(n)]
    tops = np.array([[_top(first, velocity) for first in (grid.begin[i], grid.end[i])] for i in range(n)])
    limit = np.array(
        [
            [
                min(_largest_x(_rows_at(end, grid.bend[i], acceleration)), top)
                for end, top in zip(ends, tops[i], strict=True)
            ]
            for i, ends in enumerate(zip(grid.begin, grid.end, strict=True))
        ]
    )
    reach = np.zeros(n + 1)
    for i in range(n - 1, -1, -1):
        # x + 2 Δ u, the squared speed at the end of the interval, is between 0 and what the next one allows.
        a = np.concatenate([rows[i][0], [2.0 * delta[i], -2.0 * delta[i]]])
        b = np.concatenate([rows[i][1], [1.0, -1.0]])
        c = np.concatenate([rows[i][2], [min(reach[i + 1], tops[i, 1]), 0.0]])
        reach[i] = 0.0 if i in grid.stops else min(_largest_x((a, b, c)), tops[i, 0])
    x, u = np.zeros(n + 1), np.zeros(n)
    for i in range(n):
        a, b, c = rows[i]
        u[i] = min(((c - b * x[i]) / a)[a > 0.0].min(), (reach[i + 1] - x[i]) / (2.0 * delta[i]))
        x[i + 1] = min(max(0.0, x[i] + 2.0 * delta[i] * u[i]), reach[i + 1])
    speed = np.sqrt(x)
    times = np.concatenate([[0.0], np.cumsum(2.0 * delta / (speed[:-1] + speed[1:]))])
    found = (np.sqrt(limit), np.sqrt(reach), speed, u, times)
    return PhasePlane(grid, *(read_only(part) for part in found))


Rows = tuple[Array, Array, Array]  # a, b, c of a u + b x <= c


def _rows(grid: PathGrid, i: int, delta: float, acceleration: Array) -> Rows:
    """The limits of acceleration at both ends of an interval, in terms of u and of x at its beginning."""
    a0, b0, c0 = _rows_at(grid.begin[i], grid.bend[i], acceleration)
    a1, b1, c1 = _rows_at(grid.end[i], grid.bend[i], acceleration)
    return np.concatenate([a0, a1 + 2.0 * delta * b1]), np.concatenate([b0, b1]), np.concatenate([c0, c1])


def _rows_at(first: Array, second: Array, acceleration: Array) -> Rows:
    """|q' u + q'' x| <= a as rows of a u + b x <= c."""
    return np.concatenate([first, -first]), np.concatenate([second, -second]), np.tile(acceleration, 2)


def _top(first: Array, velocity: Array) -> float:
    """The largest x under the limits of velocity."""
    with np.errstate(divide="ignore"):
        return float(((velocity / np.abs(first)) ** 2).min())


def _largest_x(rows: Rows) -> float:
    """The largest x >= 0 for which some u satisfies a u + b x <= c.

    Rows with a > 0 bound u from above, rows with a < 0 from below. Each pair of them bounds x: eliminating u leaves
    (b/a - b'/a') x <= c/a - c'/a'.
    """
    a, b, c = rows
    up, down, flat = a > 1e-12, a < -1e-12, np.abs(a) <= 1e-12
    slope = np.subtract.outer(b[up] / a[up], b[down] / a[down]).ravel()
    room = np.subtract.outer(c[up] / a[up], c[down] / a[down]).ravel()
    slope, room = np.concatenate([slope, b[flat]]), np.concatenate([room, c[flat]])
    bounds = room[slope > 1e-12] / slope[slope > 1e-12]
    return float(max(0.0, bounds.min(initial=np.inf)))
