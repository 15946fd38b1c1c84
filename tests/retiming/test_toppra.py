"""The default method against closed forms, TOPPRA and TOPPRA's own constraints; TOPPRA under torque limits."""

from __future__ import annotations

import logging
import subprocess
import sys

import numpy as np
import pytest
import toppra
from hypothesis import example, given, settings
from hypothesis import strategies as st
from toppra.algorithm import TOPPRA
from toppra.constraint import DiscretizationType, JointAccelerationConstraint, JointVelocityConstraint

import rr1plan as rp
from rr1plan.kernels.planner_kernels import CStruct, load_library
from rr1plan.retiming.path_blends import blend_sizes, clean, curves
from rr1plan.retiming.path_speed import make_grid, time_polyline, timed
from rr1plan.retiming.timed_pieces import as_trajectory
from rr1plan.retiming.toppra_retiming import rate_rows, solve_speeds, time_curve_with_torque


def fastest_speeds(curve, grid, limits):
    x, n, rates = np.empty(len(grid.piece) + 1), len(grid.piece), (limits.velocity.copy(), limits.acceleration.copy())
    path = CStruct(
        "PathCurve",
        lengths=curve.lengths.copy(),
        coefficients=curve.coefficients.copy().ravel(),
        count=len(curve.lengths),
        column_count=curve.coefficients.shape[2],
    )
    both = CStruct(
        "RateLimits",
        velocity=rates[0],
        acceleration=rates[1],
        inverse_velocity=1.0 / rates[0],
        inverse_acceleration=1.0 / rates[1],
    )
    arena = CStruct("Arena", memory=np.empty(1 << 20), size=1 << 20)
    columns = (np.ascontiguousarray(column) for column in grid)
    assert load_library().rr1_fastest_speeds(path, both, *columns, n, 0.0, arena, x) == 0
    return x


def no_torque(q, qd, qdd):
    return np.zeros_like(q)


class CurvePath(toppra.interpolator.AbstractGeometricPath):
    """Our curve as TOPPRA reads paths."""

    def __init__(self, curve):
        self.curve = curve
        self.knots = np.concatenate([[0.0], np.cumsum(curve.lengths)])

    def __call__(self, path_positions, order=0):
        s = np.atleast_1d(path_positions)
        i = np.clip(np.searchsorted(self.knots, s, side="right") - 1, 0, len(self.curve.lengths) - 1)
        h, c = (s - self.knots[i])[:, None], self.curve.coefficients[i]
        return [c[:, 0] + h * (c[:, 1] + h * c[:, 2]), c[:, 1] + 2.0 * h * c[:, 2], 2.0 * c[:, 2]][order]

    @property
    def dof(self):
        return self.curve.coefficients.shape[2]

    @property
    def path_interval(self):
        return np.array([0.0, self.knots[-1]])


def toppra_duration(curve, limits):
    """TOPPRA's own constraints on a fine grid, stretched by the factor by which its motion exceeds the limits."""
    path = CurvePath(curve)
    grid = np.unique(
        np.concatenate([np.linspace(a, b, 41) for a, b in zip(path.knots[:-1], path.knots[1:], strict=True)])
    )
    acceleration = JointAccelerationConstraint(
        limits.acceleration, discretization_scheme=DiscretizationType.Interpolation
    )
    solver = TOPPRA(
        [JointVelocityConstraint(limits.velocity), acceleration],
        path,
        grid,
        solver_wrapper="seidel",
        parametrizer="ParametrizeConstAccel",
    )
    motion = solver.compute_trajectory(0.0, 0.0)
    t = np.linspace(0.0, motion.duration, 5000)
    velocity = (np.abs(motion(t, 1)) / limits.velocity).max()
    return motion.duration * max(1.0, velocity, np.sqrt((np.abs(motion(t, 2)) / limits.acceleration).max()))


def test_durations_are_those_of_toppra_itself_or_shorter(tools):
    limits = tools.limits_of(6)
    ratios = []
    for seed in range(8):
        points = np.random.default_rng(seed).uniform(-2.0, 2.0, (8, 6))
        sizes = blend_sizes(points, 0.3, None)
        (curve,) = curves(points, sizes)
        ratios.append(time_polyline(points, sizes, limits).duration / toppra_duration(curve, limits))
    # its interpolation takes the neighbor's second derivative at the knots, which costs it a percent
    assert max(ratios) <= 1.0 + 1e-3
    assert min(ratios) >= 0.97


@pytest.mark.parametrize("seed", range(5))
def test_a_finer_grid_gains_next_to_nothing(tools, monkeypatch, seed):
    points = np.random.default_rng(seed).uniform(-2.0, 2.0, (8, 6))
    limits = tools.limits_of(6, 1.0, 10.0 ** np.random.default_rng(seed).uniform(-1, 2))
    coarse = tools.retime_points(points, limits).duration
    monkeypatch.setattr("rr1plan.retiming.path_speed._STEP", 0.02)
    assert coarse <= tools.retime_points(points, limits).duration * 1.005


@pytest.mark.parametrize(
    ("way", "velocity", "acceleration", "duration"),
    [
        (10.0, 1.0, 2.0, 10.5),  # trapezoid: d / v + v / a
        (0.5, 1.0, 2.0, 1.0),  # just a triangle
        (0.08, 1.0, 2.0, 0.4),  # triangle: 2 sqrt(d / a)
        (1e-6, 1.0, 4.0, 1e-3),
    ],
)
@pytest.mark.parametrize("method", ["blend", "stop"])
def test_one_joint_takes_the_time_of_the_textbook(tools, method, way, velocity, acceleration, duration):
    limits = tools.limits_of(1, velocity, acceleration)
    for points in ([[0.0], [way]], [[way], [0.0]], [[0.0], [0.3 * way], [way]]):
        assert tools.retime_points(points, limits, method).duration == pytest.approx(duration, rel=1e-12)


def test_the_slowest_joint_sets_the_pace_of_a_line(tools):
    limits = tools.limits_of(2, [1.0, 0.1], [2.0, 1.0])
    # joint 1 needs 1 / 0.1 + 0.1 / 1
    assert tools.retime_points([[0.0, 0.0], [1.0, 1.0]], limits).duration == pytest.approx(10.1)


def test_a_right_angle_beats_the_stop_and_keeps_full_acceleration(tools):
    points = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]
    trajectory = tools.retime_points(points)
    assert trajectory.duration < tools.retime_points(points, method="stop").duration
    np.testing.assert_allclose(tools.exact_peak(trajectory, 2), [2.0, 2.0], rtol=2e-3)


def test_the_checked_path_is_not_replaced_by_a_spline(tools):
    # the spline TOPPRA puts through sparse waypoints by default leaves such a polyline by a radian
    points = np.random.default_rng(0).uniform(-2.0, 2.0, (8, 6))
    trajectory = tools.retime_points(points, max_blend=0.1)
    q = trajectory(np.linspace(0.0, trajectory.end_time, 20_000))
    assert tools.distance_to_polyline(q, points).max() <= 0.05


def test_a_failure_of_toppra_says_where(tools, monkeypatch):
    (curve,) = curves(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]), np.array([0.0, 0.3, 0.0]))

    def give_up(self, *arguments, **settings):
        return None, None, None, None

    monkeypatch.setattr(TOPPRA, "compute_parameterization", give_up)
    with pytest.raises(rp.RetimingError, match="between waypoints 0 and 2"):
        time_curve_with_torque(curve, tools.limits_of(2), no_torque)


def test_nan_speeds_of_toppra_are_a_failure(tools, monkeypatch):
    (curve,) = curves(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]), np.array([0.0, 0.3, 0.0]))

    def break_down(self, *arguments, **settings):
        speed = np.full(len(self.gridpoints), np.nan)
        self.problem_data.sd_vec = speed
        return None, speed, None, None

    monkeypatch.setattr(TOPPRA, "compute_parameterization", break_down)
    with pytest.raises(rp.RetimingError, match="gridpoint 0"):
        time_curve_with_torque(curve, tools.limits_of(2), no_torque)


def test_toppra_stays_out_of_the_users_log(tools, caplog, capfd):
    points = np.random.default_rng(0).uniform(-2.0, 2.0, (5, 3))
    (curve,) = curves(points, blend_sizes(points, 0.3, None))
    with caplog.at_level(logging.DEBUG):
        time_curve_with_torque(curve, tools.limits_of(3), no_torque)
    assert not [record for record in caplog.records if record.name.startswith("toppra")]
    assert capfd.readouterr() == ("", "")


def limits_of(n, velocity, acceleration):
    free = {"lower": np.full(n, -9.0), "upper": np.full(n, 9.0), "jerk": np.ones(n), "effort": np.full(n, np.inf)}
    return rp.Limits(velocity=np.broadcast_to(velocity, n), acceleration=np.broadcast_to(acceleration, n), **free)


def uneven(seed, nq):
    """A path of joints of very different limits; some rest, some do not move at first."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-2.0, 2.0, (rng.integers(3, 8), nq))
    points[:, rng.random(nq) < 0.2] = 0.5
    points[: len(points) // 2, 0] = points[0, 0]
    velocity, acceleration = (10.0 ** rng.uniform(-1.0, 1.5, nq) for _ in range(2))
    return clean(points), velocity, acceleration


random_paths = given(seed=st.integers(0, 2**32 - 1), nq=st.integers(2, 8), max_blend=st.sampled_from([0.003, 0.3, 2.0]))


def vertices(first, second, top, low, high):
    """Vertices (x, y) of |first x + second y| <= 1 for all rows, 0 <= x <= top, low <= y <= high, by enumeration."""
    if high == 0.0:
        steepest = np.abs(first).max()
        return np.array([[min(top, 1.0 / steepest if steepest > 0.0 else np.inf), 0.0]])
    one, two = first * top, second * high  # coefficients of x / top and y / high
    a, b = np.concatenate([one, -one, [1.0, -1.0, 0.0, 0.0]]), np.concatenate([two, -two, [0.0, 0.0, 1.0, -1.0]])
    c = np.concatenate([np.ones(2 * len(first)), [1.0, 0.0, 1.0, -low / high]])
    with np.errstate(all="ignore"):
        x, y = (np.outer(c, b) - np.outer(b, c), np.outer(a, c) - np.outer(c, a)) / (np.outer(a, b) - np.outer(b, a))
    crossings = np.stack([x, y], axis=-1)[np.isfinite(x) & np.isfinite(y)]
    rows, sizes = np.stack([a, b]), np.abs(np.stack([a, b]))
    inside = crossings @ rows <= c + 1e-11 * (1.0 + np.abs(crossings) @ sizes)
    return crossings[inside.all(axis=1)] * (top, high)


# Share of the highest squared speed that a motion keeps at the end of each bent interval, if it is feasible.
LEAST_SPEED = 0.3


def highest_speeds(grid, rows, is_bent):
    """Squared speeds at the gridpoints: controllable ones by vertices, then greedily the highest of them."""
    second = rows.a / (2.0 * grid.delta[:, None])
    first = rows.b - second
    x = np.zeros(len(grid.delta) + 1)
    for i in reversed(range(len(grid.delta))):
        low = min(LEAST_SPEED * x[i + 1], 0.5 / np.abs(second[i]).max()) if is_bent[i] else 0.0
        x[i] = vertices(first[i], second[i], rows.top[i], low, x[i + 1])[:, 0].max()
    x[0] = 0.0
    for i in range(len(grid.delta)):
        signs = np.sign(second[i])
        moves = signs != 0.0
        bounds = (1.0 - (signs * first[i] * x[i])[moves]) / np.abs(second[i][moves])
        x[i + 1] = max(0.0, min(x[i + 1], bounds.min(initial=np.inf)))
    return x


@random_paths
@settings(deadline=None, max_examples=50)
@example(seed=185, nq=5, max_blend=0.003)  # the highest speed before a bend leaves almost none within it
@example(seed=386096, nq=4, max_blend=2.0)  # the least speed is above that which follows the highest one
def test_the_compiled_passes_find_the_highest_speeds(seed, nq, max_blend):
    points, velocity, acceleration = uneven(seed, nq)
    limits = limits_of(nq, velocity, acceleration)
    for curve in curves(points, blend_sizes(points, max_blend, None)):
        if len(curve.lengths) == 1:  # one interval from rest to rest: nothing to find
            continue
        grid = make_grid(curve, limits, curve.lengths)
        exact = highest_speeds(grid, rate_rows(curve, grid, limits), grid.second(curve).any(axis=1))
        np.testing.assert_allclose(fastest_speeds(curve, grid, limits), exact, rtol=1e-6, atol=1e-9 * exact.max())


@random_paths
@settings(deadline=None, max_examples=20)
def test_motions_take_the_time_of_toppra_on_its_finer_grid(seed, nq, max_blend):
    points, velocity, _ = uneven(seed, nq)
    limits = limits_of(nq, 1.0 + 0.1 * velocity, 5.0)
    sizes = blend_sizes(points, max_blend, None)
    for curve in curves(points, sizes):
        some = slice(curve.corners[0], curve.corners[1] + 1)
        ours = time_polyline(points[some], sizes[some], limits).duration
        assert ours <= time_curve_with_torque(curve, limits, no_torque).within(limits).duration * 1.005


def corners_of_all_kinds(seed, nq):
    """Corners in all directions, nearly straight or a reversal; edges short and long; joints that hardly move."""
    rng = np.random.default_rng(seed)
    kind, count = rng.integers(4), rng.integers(3, 7)
    steps = rng.normal(size=(count, nq))
    if kind == 1:
        steps = steps[0] + 10.0 ** rng.uniform(-5.0, -0.5, (count, 1)) * steps
    elif kind == 2:
        steps = (-1.0) ** np.arange(count)[:, None] * steps[0] + 10.0 ** rng.uniform(-2.5, -0.5, (count, 1)) * steps
    elif kind == 3:
        steps = steps * 10.0 ** rng.uniform(-3.0, 0.0, nq)
        steps[: count // 2, 0] = 0.0
    steps *= 10.0 ** rng.uniform(-2.5, 0.5, (count, 1))
    return clean(np.cumsum(np.vstack([np.zeros(nq), steps]), axis=0))


@given(
    seed=st.integers(0, 2**32 - 1),
    nq=st.integers(2, 14),
    max_blend=st.sampled_from([0.003, 0.05, 0.5, 3.0]),
    decades=st.floats(0.0, 3.0),
)
@settings(deadline=None, max_examples=60)
def test_limits_spread_over_decades_cost_no_time_and_are_held(seed, nq, max_blend, decades):
    points = corners_of_all_kinds(seed, nq)
    velocity, acceleration = 10.0 ** np.random.default_rng(seed).uniform(-decades / 2.0, decades / 2.0, (2, nq))
    limits = limits_of(nq, velocity, 3.0 * acceleration)
    sizes = blend_sizes(points, max_blend, None)
    for curve in curves(points, sizes):
        some = slice(curve.corners[0], curve.corners[1] + 1)
        ours = time_polyline(points[some], sizes[some], limits)
        bent = curve.coefficients[:, 2].any(axis=1)
        grid = make_grid(curve, limits, curve.lengths / np.where(bent, 16, 60))
        toppras = timed(curve, grid, solve_speeds(curve, grid, rate_rows(curve, grid, limits))).within(limits)
        assert ours.duration <= toppras.duration * 1.005
        motion = as_trajectory(tuple(f"j{i}" for i in range(nq)), ours)
        shares = np.linspace(0.0, 1.0, 11)[:, None]
        times = np.unique(motion.breaks[:-1] + shares * np.diff(motion.breaks))
        for derivative, limit in ((1, limits.velocity), (2, limits.acceleration)):
            assert (np.abs(motion(times, derivative)) <= limit * (1.0 + 1e-9)).all()


def test_a_first_motion_without_torque_limits_loads_no_toppra():
    code = (
        "import sys, numpy as np, rr1plan as rp\n"
        "scene = rp.Scene().with_arm('a', rp.load_robot('planar2r'))\n"
        "path = rp.Path(scene.joint_names(), np.array([[0.0, 0.0], [0.5, 0.0], [0.5, 0.5]]))\n"
        "rp.retime(path, scene)\n"
        "print(*{'toppra', 'matplotlib', 'ruckig'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True)
    assert done.stdout.split() == []


@pytest.mark.parametrize("uneven", [1e-8, 1e-7, 1e-6, 1e-5])
def test_short_intervals_do_not_slow_a_motion_down(uneven):
    """Blends of edges of nearly the same length leave lines that are shorter than what TOPPRA's speeds resolve."""
    angles = np.cumsum(0.02 * (1.0 + uneven * np.arange(60)))
    points = 0.3 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    limits = limits_of(2, 1.0, 2.0)
    (curve,) = curves(points, blend_sizes(points, 1.0, None))
    assert curve.lengths.min() < 1e-4 * curve.lengths.max()
    grid = make_grid(curve, limits, curve.lengths)
    fastest = timed(curve, grid, fastest_speeds(curve, grid, limits)).duration
    pieces = time_curve_with_torque(curve, limits, no_torque).within(limits)
    assert pieces.duration < 1.01 * fastest
