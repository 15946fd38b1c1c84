"""Time-optimal path parameterization under torque limits, by TOPPRA's reachability analysis.

In x = (ds/dt)² and u = d²s/dt² every limit on velocity, acceleration and torque is linear. A
backward pass computes the controllable sets, a forward pass the highest controllable speeds.
Pham, Pham, "A New Approach to Time-Optimal Path Parameterization Based on
Reachability Analysis", IEEE T-RO 34(3), 2018.

The constraints are not TOPPRA's: d²q/ds² is constant and x linear in s on every interval of a parabola, so
acceleration is linear in s there, and a limit satisfied at both ends (with the second derivative
of that interval, not its neighbor's) is satisfied between them. `path_speed.time_polyline` is the compiled
equivalent without torque limits; the gravity term needs a full linear program.
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import toppra
from toppra.algorithm import TOPPRA
from toppra.constraint import LinearConstraint

from rr1plan.checks import Array
from rr1plan.errors import RetimingError
from rr1plan.retiming.path_blends import Curve
from rr1plan.retiming.path_speed import Grid, make_grid, timed
from rr1plan.retiming.timed_pieces import Pieces
from rr1plan.retiming.torque_limits import InverseDynamics
from rr1plan.robot.joint_limits import Limits

_BETWEEN = (0.125, 0.375, 0.625, 0.875)
_TORQUE_STEP = 0.05
_MOST = 200


class ConstraintRows(NamedTuple):
    """|a u + b x + c| <= 1 on every interval, each (n, rows), and x <= top (n + 1,)."""

    a: Array
    b: Array
    c: Array
    top: Array


def time_curve_with_torque(curve: Curve, limits: Limits, inverse_dynamics: InverseDynamics) -> Pieces:
    """Time a curve from rest to rest, optimally on the grid.

    Args:
        curve: The curve.
        limits: Velocity and acceleration limits, finite for moving joints; effort limits.
        inverse_dynamics: Torques [Nm or N] of q, qd, qdd, each (n, nq).

    Raises:
        RetimingError: TOPPRA finds no speed; the message names the waypoints.
    """
    # Intervals are short also on straight lines, along which torques change.
    longest = np.asarray(curve.lengths / np.clip(np.ceil(curve.lengths / _TORQUE_STEP), 8, _MOST))
    grid = make_grid(curve, limits, longest)
    rows = _stack(rate_rows(curve, grid, limits), _torque_rows(curve, grid, limits.effort, inverse_dynamics))
    return timed(curve, grid, solve_speeds(curve, grid, rows))


def rate_rows(curve: Curve, grid: Grid, limits: Limits) -> ConstraintRows:
    """The rows of velocity and acceleration limits on the intervals of a grid."""
    second = grid.second(curve)
    begin, end = grid.first(curve, 0.0), grid.first(curve, 1.0)
    delta = grid.delta[:, None]
    a = [begin / limits.acceleration, (end + 2.0 * delta * second) / limits.acceleration]
    b = [second / limits.acceleration] * 2
    for at in _BETWEEN:
        slowness = 1.0 / _top_speed(grid.first(curve, at), limits)[:, None]
        a.append(2.0 * at * delta * slowness)
        b.append(slowness)
    top = _top_speed(np.vstack([begin, end[-1:]]), limits)
    left, right = np.hstack(a), np.hstack(b)
    return ConstraintRows(left, right, np.zeros_like(left), top)


def _top_speed(first: Array, limits: Limits) -> Array:
    """Highest x under the velocity limits where dq/ds is `first` (n, nq)."""
    slowest = (np.abs(first) / limits.velocity).max(axis=1)
    return np.asarray(np.maximum(slowest, 1e-12) ** -2.0)


def _torque_rows(curve: Curve, grid: Grid, effort: Array, inverse_dynamics: InverseDynamics) -> ConstraintRows:
    second = grid.second(curve)
    a, b, c = [], [], []
    for at in (0.0, 1.0):
        q, first = grid.position(curve, at), grid.first(curve, at)
        zero = np.zeros_like(q)
        static = inverse_dynamics(q, zero, zero)
        inertial = inverse_dynamics(q, zero, first) - static
        bent = inverse_dynamics(q, first, second) - static
        # The squared speed at the end of the interval is x + 2 delta u.
        a.append(inertial + 2.0 * at * grid.delta[:, None] * bent)
        b.append(bent)
        c.append(static)
    parts = [np.hstack(part) / np.tile(effort, 2) for part in (a, b, c)]
    return ConstraintRows(parts[0], parts[1], parts[2], np.full(len(grid.delta) + 1, np.inf))


def _stack(one: ConstraintRows, other: ConstraintRows) -> ConstraintRows:
    a, b, c = (np.hstack(pair) for pair in zip(one[:3], other[:3], strict=True))
    return ConstraintRows(a, b, c, np.minimum(one.top, other.top))


def solve_speeds(curve: Curve, grid: Grid, rows: ConstraintRows) -> Array:
    """Squared speeds at the gridpoints (n + 1,), from TOPPRA, with lengths and speeds scaled to about one."""
    length = float(grid.delta.sum())
    pull = float((1.0 / np.maximum(np.abs(rows.a).max(axis=1), 1e-12)).max())
    unit = max(float(rows.top.max()), 1e-12)
    unit = min(unit, pull * length)
    points = np.concatenate([[0.0], np.cumsum(grid.delta / length)])
    scaled = ConstraintRows(rows.a * (unit / length), rows.b * unit, rows.c, rows.top / unit)
    with _quiet():
        algorithm = TOPPRA([_Constraint(scaled)], _Line(points[-1]), points, solver_wrapper="seidel")
        _, speed, _, _ = algorithm.compute_parameterization(0.0, 0.0, return_data=True)
    if speed is None or not np.isfinite(speed).all():
        raise _failure(curve, grid, algorithm)
    x = _within_rows(np.asarray(speed) ** 2, np.diff(points), scaled)
    if not ((x[:-1] + x[1:]) > 0.0).all():
        raise _failure(curve, grid, algorithm, int(np.argmin(x[:-1] + x[1:])))
    return np.asarray(x * unit)


def _within_rows(x: Array, delta: Array, rows: ConstraintRows) -> Array:
    """Squared speeds lowered until every interval satisfies its rows, shape (n + 1,).

    TOPPRA's speeds are accurate to about 1e-8, which is a large acceleration on short intervals.
    """
    x = x.copy()
    n = len(delta)
    for order, ahead in ((range(n), True), (range(n - 1, -1, -1), False)):
        for i in order:
            low, high = _accelerations(rows.a[i], rows.b[i] * x[i] + rows.c[i])
            if not low <= high:
                continue
            if ahead:
                x[i + 1] = min(x[i + 1], x[i] + 2.0 * delta[i] * max(high, 0.0))
            else:
                x[i] = min(x[i], x[i + 1] - 2.0 * delta[i] * min(low, 0.0))
    return x


def _accelerations(a: Array, rest: Array) -> tuple[float, float]:
    """The lowest and the highest u with |a u + rest| <= 1, shape (rows,) each."""
    moving = np.abs(a) > 0.0
    one, other = (1.0 - rest[moving]) / a[moving], (-1.0 - rest[moving]) / a[moving]
    return float(np.minimum(one, other).max(initial=-np.inf)), float(np.maximum(one, other).min(initial=np.inf))


def _failure(curve: Curve, grid: Grid, algorithm: Any, stage: int | None = None) -> RetimingError:
    data = algorithm.problem_data
    if stage is None:
        speeds = np.zeros(1) if data.sd_vec is None else np.asarray(data.sd_vec)
        stage = int(np.argmax(~np.isfinite(speeds)))
    place = float(grid.delta[:stage].sum())
    begin, end = curve.corners
    code = getattr(data.return_code, "name", data.return_code)
    return RetimingError(
        f"TOPPRA finds no speed between waypoints {begin} and {end}: {code} at gridpoint {stage} of {len(grid.delta)}, "
        f"{place:.6g} of {float(grid.delta.sum()):.6g} rad (or m) along"
    )


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Suppress log messages of TOPPRA and warnings of NumPy; failures raise `RetimingError`."""
    log = logging.getLogger("toppra")
    level = log.level
    log.setLevel(logging.CRITICAL)
    try:
        with np.errstate(all="ignore"):
            yield
    finally:
        log.setLevel(level)


class _Constraint(LinearConstraint):  # type: ignore[misc]  # toppra has no types
    """Precomputed rows |a u + b x + c| <= 1."""

    def __init__(self, rows: ConstraintRows) -> None:
        super().__init__()
        self.rows = rows
        self.dof = rows.a.shape[1]
        self.identical = True

    def compute_constraint_params(self, path: Any, gridpoints: Array) -> tuple[Any, ...]:
        """TOPPRA's a, b, c, F, g, bounds of u (none) and bounds of x at every gridpoint."""
        a, b, c = (np.ascontiguousarray(np.vstack([part, part[-1:]])) for part in self.rows[:3])
        m = a.shape[1]
        bound = np.stack([np.zeros(len(self.rows.top)), self.rows.top], axis=1)
        return a, b, c, np.vstack([np.eye(m), -np.eye(m)]), np.ones(2 * m), None, bound


class _Line(toppra.interpolator.AbstractGeometricPath):  # type: ignore[misc]  # toppra has no types
    """Placeholder path: TOPPRA only reads its interval, because the constraints are precomputed."""

    def __init__(self, length: float) -> None:
        self.length = length

    def __call__(self, path_positions: object, order: int = 0) -> Array:
        """The path parameter itself."""
        s = np.asarray(path_positions, dtype=np.float64)[..., None]
        return np.asarray(s if order == 0 else np.full_like(s, float(order == 1)))

    @property
    def dof(self) -> int:
        """One."""
        return 1

    @property
    def path_interval(self) -> Array:
        """From zero to the length."""
        return np.array([0.0, self.length])
