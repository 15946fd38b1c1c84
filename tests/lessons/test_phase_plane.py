"""The phase plane against TOPPRA, the compiled retiming and brute force; seven phases against Ruckig."""

from __future__ import annotations

import numpy as np
import pytest
import ruckig
import toppra
import toppra.algorithm
import toppra.constraint

import rr1plan as rp
from rr1plan.lessons.phase_plane import fastest_motion, path_grid

VELOCITY, ACCELERATION = np.array([2.0, 2.0]), np.array([8.0, 8.0])


@pytest.fixture(scope="module")
def problem() -> rp.Problem:
    return rp.load_problems("planar2r_path")["over_the_seam"]


@pytest.fixture(scope="module", params=[1, 4])
def path(request: pytest.FixtureRequest, problem: rp.Problem) -> rp.Path:
    result = rp.RrtConnect(range=0.4).plan(problem, budget=rp.Budget(iterations=2000), rng=request.param)
    assert result.path is not None
    return rp.shorten(result.path, problem.scene, iterations=300, rng=0)


class OnGrid(toppra.interpolator.AbstractGeometricPath):  # type: ignore[misc]  # toppra has no types
    """A path of lines and parabolas as toppra takes one; at a knot the derivatives behind it."""

    def __init__(self, grid: rp.PathGrid) -> None:
        self.grid = grid

    def __call__(self, s: object, order: int = 0) -> np.ndarray:
        at = np.atleast_1d(np.asarray(s, dtype=float))
        i = np.clip(np.searchsorted(self.grid.s, at + 1e-12, side="right") - 1, 0, len(self.grid.begin) - 1)
        h = (at - self.grid.s[i])[:, None]
        bend = self.grid.bend[i]
        values = (self.grid.q[i] + h * (self.grid.begin[i] + 0.5 * h * bend), self.grid.begin[i] + h * bend, bend)[
            order
        ]
        return values if np.ndim(s) else values[0]

    @property
    def dof(self) -> int:
        return 2

    @property
    def path_interval(self) -> np.ndarray:
        return self.grid.s[[0, -1]]


def toppra_speeds(grid: rp.PathGrid) -> tuple[np.ndarray, np.ndarray]:
    """TOPPRA's limit curve and fastest speeds at the gridpoints, by its public interface."""
    limits = [
        toppra.constraint.JointVelocityConstraint(np.column_stack([-VELOCITY, VELOCITY])),
        toppra.constraint.JointAccelerationConstraint(
            np.column_stack([-ACCELERATION, ACCELERATION]),
            discretization_scheme=toppra.constraint.DiscretizationType.Collocation,
        ),
    ]
    algorithm = toppra.algorithm.TOPPRA(limits, OnGrid(grid), gridpoints=grid.s, parametrizer="ParametrizeConstAccel")
    limit = np.sqrt(algorithm.compute_feasible_sets()[:, 1])
    _, speed, _ = algorithm.compute_parameterization(0.0, 0.0)
    return limit, speed


def test_speeds_are_those_of_toppra(path: rp.Path, problem: rp.Problem) -> None:
    grid = path_grid(path, problem.scene)
    plane = fastest_motion(grid, VELOCITY, ACCELERATION)
    limit, speed = toppra_speeds(grid)
    assert len(grid.s) > 150
    np.testing.assert_allclose(plane.limit[:, 0], limit[:-1], rtol=1e-4)
    # TOPPRA checks accelerations at gridpoints, here both ends of each interval count: the results differ by an
    # interval where the second derivative jumps.
    apart = np.abs(plane.speed - speed) / speed.max()
    assert (apart > 1e-4).mean() < 0.3
    assert apart.max() < 0.05
    theirs = float(np.sum(2.0 * np.diff(grid.s) / (speed[1:] + speed[:-1])))
    assert plane.duration == pytest.approx(theirs, rel=5e-3)
    assert plane.duration >= theirs * (1.0 - 1e-6)


@pytest.mark.parametrize("blend", [0.0, 0.05, 0.4])
def test_durations_are_those_of_the_compiled_retiming(blend: float, path: rp.Path, problem: rp.Problem) -> None:
    plane = rp.phase_plane(path, problem.scene, max_blend=blend)
    timed = rp.retime(path, problem.scene, max_blend=blend)
    assert plane.duration == pytest.approx(timed.duration, rel=4e-3)
    assert len(plane.grid.stops) == (0 if blend else len(path.waypoints) - 2)
    assert (plane.speed[list(plane.grid.stops)] == 0.0).all()


def test_the_motion_keeps_all_limits_and_cannot_be_faster(path: rp.Path, problem: rp.Problem) -> None:
    plane = rp.phase_plane(path, problem.scene)
    grid, u, x = plane.grid, plane.acceleration, plane.speed**2
    assert x[0] == x[-1] == 0.0
    assert (plane.speed[:-1] <= plane.limit[:, 0] + 1e-9).all()
    assert (plane.speed <= plane.reach + 1e-9).all()
    tight = np.zeros(len(u), dtype=bool)
    for share in (0.0, 0.3, 0.7, 1.0):
        first = (1.0 - share) * grid.begin + share * grid.end
        at = x[:-1] + share * (x[1:] - x[:-1])
        speeds = np.abs(first) * np.sqrt(at)[:, None]
        pushes = np.abs(first * u[:, None] + grid.bend * at[:, None])
        assert (speeds <= VELOCITY * (1.0 + 2e-3)).all()
        assert (pushes <= ACCELERATION * (1.0 + 1e-6)).all()
        tight |= (speeds > VELOCITY * 0.98).any(axis=1) | (pushes > ACCELERATION * 0.98).any(axis=1)
    # Time-optimal: some limit is reached everywhere except in intervals with a switching point.
    assert tight.mean() > 0.95
    signs = np.sign(np.where(np.abs(u) < 1e-6, 0.0, u))
    assert set(np.flatnonzero(np.diff(signs)) + 1) == set(plane.switches)
    assert len(plane.switches) >= 4


def test_a_path_that_bends_by_little_has_no_more_switching_points_than_a_line() -> None:
    scene = rp.Scene().with_arm("arm", rp.planar_arm("RR"))
    ends, middle = ([0.0, 0.0], [2.0, 1.0]), [1.0, 0.501]
    line, bent = (
        rp.phase_plane(rp.Path(("arm/joint1", "arm/joint2"), points), scene)
        for points in (ends, [ends[0], middle, ends[1]])
    )
    assert len(line.switches) == len(bent.switches) == 2


def test_the_limit_curve_is_the_largest_speed_of_brute_force(path: rp.Path, problem: rp.Problem) -> None:
    plane = rp.phase_plane(path, problem.scene)
    grid = plane.grid
    pushes, speeds = np.linspace(-40.0, 40.0, 2001), np.linspace(0.0, 4.0, 501)[1:]
    for i in range(0, len(grid.begin), 17):
        fits = (np.abs(grid.begin[i]) * speeds[:, None] <= VELOCITY).all(axis=1)
        needs = grid.begin[i] * pushes[:, None] + (grid.bend[i] * speeds[:, None, None] ** 2)
        fits &= (np.abs(needs) <= ACCELERATION + 0.05).all(axis=2).any(axis=1)
        assert speeds[fits].max() == pytest.approx(plane.limit[i, 0], abs=0.02)


def test_slower_limits_take_longer_in_known_ways(path: rp.Path, problem: rp.Problem) -> None:
    whole = rp.phase_plane(path, problem.scene).duration
    halves = [
        rp.phase_plane(path, problem.scene, **{f"{of}_scale": 0.5}).duration for of in ("velocity", "acceleration")
    ]
    assert whole < halves[0] < 2.0 * whole
    assert whole < halves[1] < np.sqrt(2.0) * whole
    # Time stretched by two is a motion with half the velocity and a quarter of the acceleration, and the reverse.
    stretched = rp.phase_plane(path, problem.scene, velocity_scale=0.5, acceleration_scale=0.25)
    assert stretched.duration == pytest.approx(2.0 * whole, rel=1e-9)


def test_paths_that_cannot_be_timed(problem: rp.Problem) -> None:
    names = problem.joint_names
    with pytest.raises(rp.InputError, match="does not move"):
        rp.phase_plane(rp.Path(names, [[0.0, 0.0], [0.0, 0.0]]), problem.scene)
    with pytest.raises(rp.InputError, match="max_blend"):
        rp.phase_plane(rp.Path(names, [[0.0, 0.0], [0.1, 0.0]]), problem.scene, max_blend=-1.0)
    with pytest.raises(rp.InputError, match="the path moves"):
        rp.phase_plane(rp.Path(names[::-1], [[0.0, 0.0], [0.1, 0.0]]), problem.scene)


# ---- one joint -----------------------------------------------------------------------------------


def by_ruckig(distance: float, velocity: float, acceleration: float, jerk: float) -> ruckig.Trajectory:
    given, found = ruckig.InputParameter(1), ruckig.Trajectory(1)
    given.current_position, given.target_position = [0.0], [distance]
    given.max_velocity, given.max_acceleration, given.max_jerk = [velocity], [acceleration], [jerk]
    ruckig.Ruckig(1).calculate(given, found)
    return found


def test_seven_phases_are_those_of_ruckig() -> None:
    rng = np.random.default_rng(0)
    counts = set()
    for _ in range(300):
        distance, velocity, acceleration, jerk = np.exp(rng.uniform(-2.5, 2.5, 4)).tolist()
        motion = rp.seven_phases(distance, velocity, acceleration, jerk)
        theirs = by_ruckig(distance, velocity, acceleration, jerk)
        assert motion.duration == pytest.approx(theirs.duration, rel=1e-7)
        times = np.linspace(0.0, min(motion.duration, theirs.duration), 41)
        states = motion.state(times)
        expected = np.array([np.ravel(theirs.at_time(float(t))[:3]) for t in times])
        assert np.abs(states[:, :3] - expected).max() < 1e-5 * max(1.0, distance, velocity, acceleration)
        assert (np.abs(states[:, 1:]) <= np.array([velocity, acceleration, jerk]) * (1.0 + 1e-9)).all()
        np.testing.assert_allclose(
            motion.state([motion.duration])[0, :3], [distance, 0.0, 0.0], atol=1e-6 * (1 + distance)
        )
        counts.add(int((motion.durations > 1e-9).sum()))
    assert counts == {4, 5, 6, 7}


def test_a_jerk_limit_costs_acceleration_over_jerk_where_all_phases_occur() -> None:
    for distance, velocity, acceleration, jerk in ((1.2, 2.0, 8.0, 80.0), (3.0, 1.5, 6.0, 40.0)):
        motion = rp.seven_phases(distance, velocity, acceleration, jerk)
        assert (motion.durations > 0.0).all()
        unlimited = rp.seven_phases(distance, velocity, acceleration, 1e9).duration
        assert unlimited == pytest.approx(distance / velocity + velocity / acceleration, abs=1e-6)
        assert motion.duration - unlimited == pytest.approx(acceleration / jerk, abs=1e-6)


@pytest.mark.parametrize("name", ["distance", "velocity", "acceleration", "jerk"])
def test_limits_are_above_zero(name: str) -> None:
    numbers = {"distance": 1.0, "velocity": 1.0, "acceleration": 1.0, "jerk": 1.0} | {name: 0.0}
    with pytest.raises(rp.InputError, match=name):
        rp.seven_phases(**numbers)
