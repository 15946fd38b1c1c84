from __future__ import annotations

import numpy as np
import pytest
import ruckig
from hypothesis import given, settings
from hypothesis import strategies as st

import rr1plan as rp
from rr1plan.retiming import point_to_point

NAMES = ("a/x", "a/y", "a/z")


def textbook_duration(way, v, a, j):
    """Rest to rest under velocity, acceleration and jerk limits (Biagiotti, Melchiorri 2008, section 3.4)."""
    ramp = a / j if v * j >= a**2 else np.sqrt(v / j)
    rise = ramp + v / a if v * j >= a**2 else 2.0 * ramp
    if way >= v * rise:
        return way / v + rise
    if way >= 2.0 * a**3 / j**2:
        peak = (-(a**2) / j + np.sqrt((a**2 / j) ** 2 + 4.0 * a * way)) / 2.0
        return 2.0 * (a / j + peak / a)
    return 4.0 * np.cbrt(way / (2.0 * j))


@settings(deadline=None, max_examples=100)
@given(*(st.floats(low, high) for low, high in ((-6, 2), (-2, 2), (-2, 3), (-1, 5))))
def test_one_joint_takes_the_time_of_the_textbook(way, v, a, j):
    way, v, a, j = (10.0**x for x in (way, v, a, j))
    limits = rp.Limits(*(np.array([x]) for x in (-np.inf, np.inf, v, a, j, np.inf)))
    motion = point_to_point(("a/x",), [0.0], [-way], limits)
    expected = textbook_duration(way, v, a, j)
    # limits out of Ruckig's range are lowered, which may cost a thousandth
    assert expected * (1.0 - 1e-9) <= motion.duration <= expected * (1.0 + 2e-3)


@pytest.mark.parametrize(
    ("way", "duration"),
    [
        (1.0, 1.7),  # all seven phases: 1 / 1 + 1 / 2 + 2 / 10
        (0.5, 0.2 + np.sqrt(1.04)),  # no phase of constant speed
        (0.02, 0.4),  # nor of constant acceleration: 4 (d / 2 j)^(1/3)
    ],
)
@pytest.mark.parametrize("method", ["ruckig", "ruckig_direct"])
def test_known_times(tools, method, way, duration):
    assert textbook_duration(way, 1.0, 2.0, 10.0) == pytest.approx(duration)
    assert tools.retime_points([[0.0], [way]], None, method).duration == pytest.approx(duration, rel=1e-9)


def test_the_pieces_are_ruckigs_own_motion(tools):
    limits = tools.limits_of(3, [1.0, 2.0, 0.5], [2.0, 1.0, 4.0], [10.0, 5.0, 40.0])
    given_ = ruckig.InputParameter(3)
    given_.current_position, given_.target_position = [0.1, -0.5, 0.0], [1.0, 0.7, -0.3]
    given_.max_velocity, given_.max_acceleration, given_.max_jerk = (
        list(x) for x in (limits.velocity, limits.acceleration, limits.jerk)
    )
    answer = ruckig.Trajectory(3)
    ruckig.Ruckig(3).calculate(given_, answer)
    motion = point_to_point(NAMES, given_.current_position, given_.target_position, limits)
    assert motion.duration == pytest.approx(answer.duration, rel=1e-9)
    for t in np.linspace(0.0, motion.duration, 50):
        q, qd, _ = answer.at_time(t)[:3]
        np.testing.assert_allclose(motion(t), q, atol=1e-7)
        np.testing.assert_allclose(motion(t, 1), qd, atol=1e-6)


def test_each_joint_moves_monotonically_to_its_end(tools):
    limits = tools.limits_of(3, [1.0, 2.0, 0.5], [2.0, 1.0, 4.0], [10.0, 5.0, 40.0])
    start, end = np.array([0.1, -0.5, 0.0]), np.array([1.0, 0.7, -3.0])
    motion = point_to_point(NAMES, start, end, limits)
    tools.check_motion(motion, [start, end], limits, jerk=True)
    steps = np.diff(motion(np.linspace(0.0, motion.duration, 3000)), axis=0) * np.sign(end - start)
    assert steps.min() >= -1e-12


def test_joints_of_very_different_ways_arrive_together(tools):
    limits = tools.limits_of(3)
    end = np.array([3.0, 1e-9, 0.0])
    motion = point_to_point(NAMES, np.zeros(3), end, limits)
    tools.check_motion(motion, [np.zeros(3), end], limits, jerk=True)
    np.testing.assert_array_equal(motion.coefficients[:, :, 2], 0.0)


def test_a_motion_to_where_it_is_takes_no_time(tools):
    assert point_to_point(NAMES, np.ones(3), np.ones(3), tools.limits_of(3)).duration == 0.0


def test_ways_beyond_ruckigs_range_are_solved(tools):
    # Ruckig itself refuses a target at 1e9
    limits = tools.limits_of(3)
    motion = point_to_point(NAMES, np.zeros(3), [1e9, 0.0, 0.0], limits)
    assert motion.duration == pytest.approx(1e9, rel=1e-3)


@pytest.mark.parametrize("bad", [[0.0, 0.0], [0.0, np.nan, 0.0], [0.0, np.inf, 0.0], "home"])
def test_bad_configurations_are_refused(tools, bad):
    with pytest.raises(rp.InputError, match="end"):
        point_to_point(NAMES, np.zeros(3), bad, tools.limits_of(3))


def test_limits_of_other_joints_are_refused(tools):
    with pytest.raises(rp.InputError, match="limits are of 2 joints"):
        point_to_point(NAMES, np.zeros(3), np.ones(3), tools.limits_of(2))


def test_a_failure_of_ruckig_says_where(tools, monkeypatch):
    def fail(*arguments):
        raise ValueError("-101 is not a valid Result")

    monkeypatch.setattr(ruckig.Ruckig, "calculate", fail)
    with pytest.raises(rp.RetimingError, match=r"between waypoints 0 and 1.*-101"):
        tools.retime_points([[0.0], [1.0]], None, "ruckig")


def test_an_error_code_of_ruckig_is_named(tools, monkeypatch):
    monkeypatch.setattr(ruckig.Ruckig, "calculate", lambda *arguments: ruckig.Result.ErrorInvalidInput)
    with pytest.raises(rp.RetimingError, match="ErrorInvalidInput"):
        tools.retime_points([[0.0], [1.0]], None, "ruckig")


def test_nothing_is_asked_from_a_network(tools, monkeypatch):
    import socket

    def refuse(*arguments):
        raise AssertionError("a retiming opened a connection")

    monkeypatch.setattr(socket.socket, "connect", refuse)
    points = np.random.default_rng(0).uniform(-2.0, 2.0, (5, 3))
    assert tools.retime_points(points, None, "ruckig").duration > 0.0


@pytest.mark.parametrize("method", ["ruckig", "ruckig_direct"])
@pytest.mark.parametrize(("acceleration", "jerk"), [(0.5, 1e6), (50.0, 1e9)])
def test_high_jerk_limits_keep_the_acceleration_limit_late_in_a_motion(method, acceleration, jerk):
    # Phases of constant jerk take a few hundred nanoseconds, and times are rounded to a few femtoseconds.
    robot = rp.load_robot("planar2r")
    limits = robot.limits
    robot = robot.with_limits(
        rp.Limits(limits.lower, limits.upper, limits.velocity, [acceleration] * 2, [jerk] * 2, limits.effort)
    )
    scene = rp.Scene().with_arm("arm", robot)
    waypoints = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 2))
    motion = rp.retime(rp.Path(scene.joint_names(), waypoints), scene, method=method)
    report = rp.validate(motion, scene, jerk_limits=True)
    assert not [violation for violation in report.violations if violation.kind in ("velocity", "acceleration", "jerk")]
