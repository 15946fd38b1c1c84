from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rr1plan as rp
from rr1plan.retiming import point_to_point, retime, retiming_names

METHODS = ("blend", "stop", "ruckig", "ruckig_direct")
JERKY = ("blend", "stop")

ODD_PATHS = {
    "two waypoints": [[0.0, 0.0], [1.0, -0.5]],
    "a corner": [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]],
    "duplicates": [[0.0, 0.0], [0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 1.0], [1.0, 1.0]],
    "a micro segment": [[0.0, 0.0], [1.0, 0.0], [1.0, 1e-6], [2.0, 1.0]],
    "only micro segments": [[0.0, 0.0], [1e-6, 0.0], [1e-6, 1e-6]],
    "barely more than a duplicate": [[0.0, 0.0], [2e-9, 0.0]],
    "a reversal": [[0.0, 0.0], [1.0, 0.0], [0.2, 0.0]],
    "nearly a reversal": [[0.0, 0.0], [1.0, 0.0], [0.2, 5e-3]],
    "back to the start": [[0.0, 0.0], [1.0, 1.0], [0.0, 0.0]],
    "one joint moves": [[0.0, 0.3], [1.0, 0.3], [2.5, 0.3]],
    "a dense bend": np.stack([np.cos(np.linspace(0, 2, 100)), np.sin(np.linspace(0, 2, 100))], axis=1),
    "far": [[0.0, 0.0], [3000.0, 0.0], [3000.0, 40.0]],
}


@pytest.fixture(params=METHODS)
def method(request):
    return request.param


@pytest.mark.parametrize("count", [1000, 1500, 3000])
def test_a_finely_sampled_path_is_as_fast_as_a_coarse_one(tools, count):
    limits = tools.limits_of(3, velocity=3.0, acceleration=[4.0, 9.0, 15.0])
    durations = []
    for n in (300, count):
        s = np.linspace(0.0, 20.0, n)
        points = 0.3 * np.sin(s[:, None] + np.arange(3.0))
        durations.append(tools.retime_points(points, limits, max_blend=1.0).duration)
    assert durations[1] == pytest.approx(durations[0], rel=0.02)


def test_the_names_are_all_there_is():
    assert retiming_names() == METHODS


@pytest.mark.parametrize("case", ODD_PATHS)
def test_odd_paths_keep_the_contract(tools, method, case):
    points = np.array(ODD_PATHS[case])
    limits = tools.limits_of(2)
    trajectory = tools.retime_points(points, limits, method, max_blend=0.3)
    tools.check_motion(trajectory, points, limits, jerk=method not in JERKY)
    q = trajectory(np.linspace(0.0, trajectory.end_time, 3000))
    assert tools.distance_to_polyline(q, points).max() <= (0.15 if method == "blend" else 1e-9 * (1 + np.abs(q).max()))


@settings(deadline=None, max_examples=12)
@given(seed=st.integers(0, 2**32 - 1), nq=st.sampled_from([1, 6, 7]), n=st.integers(2, 6))
@pytest.mark.parametrize("name", METHODS)
def test_random_paths_keep_the_contract(name, seed, nq, n, request):
    tools = request.getfixturevalue("tools")
    rng = np.random.default_rng(seed)
    points = rng.uniform(-2.0, 2.0, (n, nq))
    limits = tools.limits_of(nq, *10.0 ** rng.uniform([[-1], [-1], [0]], [[1], [2], [3]], (3, nq)))
    max_blend = 10.0 ** rng.uniform(-2.0, 0.5)
    trajectory = tools.retime_points(points, limits, name, max_blend=max_blend)
    tools.check_motion(trajectory, points, limits, jerk=name not in JERKY)
    q = trajectory(np.linspace(0.0, trajectory.end_time, 2000))
    if name != "ruckig_direct":
        assert tools.distance_to_polyline(q, points).max() <= (0.5 * max_blend if name == "blend" else 1e-11)
    if name == "blend":
        assert trajectory.duration <= tools.retime_points(points, limits, "stop").duration * (1.0 + 1e-12)


def test_nothing_moving_takes_no_time(tools, method):
    for points in (np.ones((1, 3)), np.ones((4, 3))):
        trajectory = tools.retime_points(points, None, method)
        assert trajectory.duration == 0.0
        np.testing.assert_array_equal(trajectory(0.0), points[0])


def test_the_same_call_gives_the_same_bytes(tools, method):
    points = np.random.default_rng(3).uniform(-2.0, 2.0, (6, 6))
    one, two = (tools.retime_points(points, None, method) for _ in range(2))
    np.testing.assert_array_equal(one.breaks, two.breaks)
    np.testing.assert_array_equal(one.coefficients, two.coefficients)


def test_a_joint_at_rest_needs_no_limits(tools, method):
    limits = tools.limits_of(2, [1.0, np.inf], [2.0, np.inf], [10.0, np.inf])
    points = [[0.0, 0.4], [1.0, 0.4], [0.5, 0.4]]
    trajectory = tools.retime_points(points, limits, method)
    assert (trajectory.coefficients[:, 1:, 1] == 0.0).all()
    tools.check_motion(trajectory, points, limits, jerk=method not in JERKY)


@pytest.mark.parametrize("largest", [1e24, 1e100, 1e300])
def test_limits_beyond_what_times_resolve_are_refused(tools, largest):
    limits = tools.limits_of(2, [largest, largest], [largest, largest])
    for name in JERKY:
        with pytest.raises(rp.RetimingError, match=r"'a/j[01]' moves in .* which times cannot resolve"):
            tools.retime_points([[0.0, 0.0], [1.0, 0.5], [0.0, 1.0]], limits, name)
    # Without motion there is nothing to resolve.
    assert tools.retime_points([[0.5, 0.5], [0.5, 0.5]], limits, "blend").duration == 0.0


@pytest.mark.parametrize("acceleration", [1e10, 1e12, 1e300])
def test_accelerations_beyond_what_times_resolve_start_and_end_at_rest(tools, method, acceleration):
    points = [[0.0, 0.0], [1.0, 0.5], [0.0, 1.0]]
    limits = tools.limits_of(2, 1.0, acceleration, 1e300)
    trajectory = tools.retime_points(points, limits, method, max_blend=0.0)
    tools.check_motion(trajectory, points, limits, jerk=method not in JERKY)
    assert trajectory.duration == pytest.approx(2.0, rel=1e-3)
    assert np.abs(trajectory([0.0, trajectory.end_time], 1)).max() < 1e-8


@pytest.mark.parametrize("speed", [1e-4, 1e-6, 1e-8])
def test_motions_of_days_keep_their_limits_between_rounded_breaks(tools, method, speed):
    points = [[0.0, 0.0], [0.37, 0.11], [-0.2, 0.3], [0.6, -0.5]]
    scene = tools.shapeless_scene(tools.limits_of(2, speed, 1.0, 1.0))
    trajectory = rp.retime(rp.Path(scene.joint_names(), points), scene, method=method, max_blend=0.0)
    report = rp.validate(trajectory, scene, jerk_limits=method not in JERKY)
    assert report.valid, report
    assert trajectory.duration == pytest.approx(1.74 / speed, rel=1e-3)


@pytest.mark.parametrize("kind", ["velocity", "acceleration", "jerk"])
def test_a_moving_joint_without_a_limit_is_named(tools, method, kind):
    limits = replace(tools.limits_of(3), **{kind: np.array([1.0, np.inf, 1.0])})
    if kind == "jerk" and method in JERKY:
        tools.retime_points([[0.0] * 3, [1.0] * 3], limits, method)
    else:
        with pytest.raises(rp.RetimingError, match=f"'a/j1' moves and has no {kind} limit"):
            tools.retime_points([[0.0] * 3, [1.0] * 3], limits, method)


def test_scales_slow_the_motion_down(tools):
    points = [[0.0], [10.0]]
    # a trapezoid: way / speed + speed / acceleration
    assert tools.retime_points(points).duration == pytest.approx(10.5)
    assert tools.retime_points(points, velocity_scale=0.5).duration == pytest.approx(20.25)
    assert tools.retime_points(points, acceleration_scale=0.5).duration == pytest.approx(11.0)


@pytest.mark.parametrize("name", ["velocity_scale", "acceleration_scale"])
@pytest.mark.parametrize("value", [0.0, -1.0, 1.5, np.nan, "fast"])
def test_scales_out_of_range_are_refused(tools, name, value):
    with pytest.raises(rp.InputError, match=name):
        tools.retime_points([[0.0], [1.0]], **{name: value})


@pytest.mark.parametrize("value", [-0.1, np.nan, np.inf])
def test_a_blend_size_out_of_range_is_refused(tools, value):
    with pytest.raises(rp.InputError, match="max_blend"):
        tools.retime_points([[0.0], [1.0]], max_blend=value)


def test_an_unknown_method_gets_the_near_ones(tools):
    with pytest.raises(rp.UnknownNameError, match="'ruckig'"):
        tools.retime_points([[0.0], [1.0]], method="rukig")


def test_a_path_of_other_joints_is_refused(tools):
    scene = tools.shapeless_scene(tools.limits_of(2))
    with pytest.raises(rp.UnknownNameError, match="arm 'b'"):
        retime(rp.Path(("b/j0", "b/j1"), np.zeros((2, 2))), scene)
    with pytest.raises(rp.InputError, match="joints"):
        retime(rp.Path(("a/j1", "a/j0"), np.zeros((2, 2))), scene)


def test_one_of_two_arms_can_be_retimed(tools):
    scene = tools.shapeless_scene(tools.limits_of(2))
    scene = scene.with_arm("b", scene.arm("a").robot)
    path = rp.Path(("b/j0", "b/j1"), np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]))
    assert retime(path, scene, checker=tools.Certifier()).arms == ("b",)


def test_a_size_of_zero_stops_at_every_waypoint_and_asks_nobody(tools):
    checker = tools.Certifier()
    points = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]
    blended = tools.retime_points(points, checker=checker, max_blend=0.0)
    assert blended.allclose(tools.retime_points(points, method="stop"))
    assert not checker.asked


def test_blends_that_collide_are_not_driven(tools):
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [2.0, 1.0]])

    def is_free(coefficients, duration):
        # forbidden: what cuts the first corner by more than 0.01
        s = np.linspace(0.0, duration, 200)[:, None]
        q = coefficients[0] + s * (coefficients[1] + s * coefficients[2])
        return not ((q[:, 0] < 0.99) & (q[:, 1] > 0.01)).any()

    trajectory = tools.retime_points(points, checker=tools.Certifier(is_free))
    q = trajectory(np.linspace(0.0, trajectory.end_time, 5000))
    assert not ((q[:, 0] < 0.99) & (q[:, 1] > 0.01)).any()
    assert trajectory.duration < tools.retime_points(points, method="stop").duration


def test_a_failing_solver_falls_back_to_stops(tools, monkeypatch, caplog):
    from rr1plan.retiming import toppra_retiming

    time_curve = toppra_retiming.time_curve_with_torque

    def fail(curve, limits, inverse_dynamics):
        if len(curve.lengths) == 1:
            return time_curve(curve, limits, inverse_dynamics)
        raise rp.RetimingError("no speed")

    points = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]
    stops = tools.retime_points(points, method="stop", torque_limits=True)
    monkeypatch.setattr(toppra_retiming, "time_curve_with_torque", fail)
    with caplog.at_level(logging.INFO, logger="rr1plan"):
        trajectory = tools.retime_points(points, torque_limits=True)
    assert trajectory.allclose(stops)
    assert "one more stop from waypoint 0 to 2" in caplog.text


def test_a_failing_solver_costs_few_stops_and_keeps_the_path(tools, monkeypatch):
    from rr1plan.retiming import toppra_retiming

    time_curve = toppra_retiming.time_curve_with_torque
    rng = np.random.default_rng(0)
    points = np.cumsum(rng.uniform(0.2, 1.0, (9, 2)) * [1.0, -1.0], axis=0)

    def fail(curve, limits, inverse_dynamics):
        begin, end = curve.corners
        np.testing.assert_allclose(curve.coefficients[0, 0], points[begin], atol=1e-12)
        if begin <= 6 < end:
            raise rp.RetimingError("no speed")
        return time_curve(curve, limits, inverse_dynamics)

    smooth = tools.retime_points(points, torque_limits=True)
    stops = tools.retime_points(points, method="stop", torque_limits=True)
    monkeypatch.setattr(toppra_retiming, "time_curve_with_torque", fail)
    trajectory = tools.retime_points(points, torque_limits=True)
    tools.check_motion(trajectory, points, tools.limits_of(2))
    assert smooth.duration < trajectory.duration < 0.9 * stops.duration
    # The line that fails is timed without the solver, from rest to rest.
    times = np.linspace(0.0, trajectory.end_time, 2001)
    at_rest = np.abs(trajectory(times, 1)).max(axis=1) < 0.02
    for index in (6, 7):
        gaps = np.abs(trajectory(times) - points[index]).max(axis=1)
        assert at_rest[np.argmin(gaps)]


def test_corners_that_are_faster_from_rest_to_rest_get_a_stop_and_the_others_none(tools):
    # past the second corner only the slow joint moves: a blend there would hold up the fast one
    points = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 1.0], [2.0, 1.001], [2.0, 2.0]])
    limits = tools.limits_of(2, [10.0, 0.02], [50.0, 0.02])
    both = tools.retime_points(points, limits, max_blend=0.4)
    assert both.duration <= tools.retime_points(points, limits, "stop").duration * (1.0 + 1e-12)
    tools.check_motion(both, points, limits)


def test_limits_that_leave_no_speed_are_an_error_that_says_where(tools):
    with pytest.raises(rp.RetimingError, match="between waypoints 0 and 1"):
        tools.retime_points([[0.0], [1.0]], tools.limits_of(1, 1e-300, 1e-300))


def test_the_state_to_state_motion_is_only_driven_when_certified(tools):
    limits = tools.limits_of(2, [1.0, 5.0], [8.0, 0.5], [20.0, 3.0])
    points = np.array([[0.0, 0.0], [2.0, 0.3]])
    straight = tools.retime_points(points, limits, "ruckig")
    direct = tools.retime_points(points, limits, "ruckig_direct")
    assert direct.duration < straight.duration
    refused = tools.retime_points(points, limits, "ruckig_direct", tools.Certifier(lambda c, d: False))
    assert refused.allclose(straight)


def test_without_a_checker_the_scene_itself_certifies(rr1):
    scene = rp.Scene().with_arm("arm", rr1)
    home = rr1.home
    points = np.array([home, home + 0.1, home + 0.1 * np.array([1, -1, 1, -1, 1, -1])])
    trajectory = retime(rp.Path(scene.joint_names(), points), scene)
    assert trajectory.duration < retime(rp.Path(scene.joint_names(), points), scene, method="stop").duration


def test_a_checker_of_another_scene_or_other_joints_is_refused(tools):
    scene = tools.shapeless_scene(tools.limits_of(2))
    path = rp.Path(scene.joint_names(), np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]))
    block = scene.with_obstacle("block", rp.Box((1.0, 1.0, 1.0)), [5.0, 0.0, 0.0])
    with pytest.raises(rp.InputError, match=r"checker is for another scene.*obstacle 'block' is new; make one"):
        retime(path, block, checker=rp.CollisionChecker(scene))
    both = scene.with_arm("b", scene.arm("a").robot)
    with pytest.raises(rp.InputError, match=r"the path has joints a/j0, a/j1, the checker has b/j0"):
        retime(path, both, checker=rp.CollisionChecker(both, ["b"]))
    assert retime(path, both, checker=rp.CollisionChecker(both, ["a"])).duration > 0.0


@pytest.mark.parametrize("wrong", [None, 3, "path", [[0.0, 0.0], [1.0, 0.0]], {}])
def test_what_is_no_path_no_scene_or_no_checker_is_named(tools, wrong):
    scene = tools.shapeless_scene(tools.limits_of(2))
    path = rp.Path(scene.joint_names(), np.array([[0.0, 0.0], [1.0, 0.0]]))
    with pytest.raises(rp.InputError, match="path is of type"):
        retime(wrong, scene)
    with pytest.raises(rp.InputError, match="scene is of type"):
        retime(path, wrong)
    with pytest.raises(rp.UnknownNameError, match="retiming method"):
        retime(path, scene, method=wrong)
    if wrong is not None:
        with pytest.raises(rp.InputError, match="checker is of type"):
            retime(path, scene, checker=wrong)


@pytest.mark.parametrize("wrong", [None, 3, [1, 2]])
def test_a_motion_from_point_to_point_names_limits_that_are_none(wrong):
    with pytest.raises(rp.InputError, match="limits is of type"):
        point_to_point(("a/x", "a/y"), [0.0, 0.0], [1.0, 1.0], wrong)
