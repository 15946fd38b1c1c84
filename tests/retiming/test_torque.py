from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.model import Kinematics
from rr1plan.retiming import retime, retiming_names
from rr1plan.retiming.timed_pieces import Pieces
from rr1plan.retiming.torque_limits import torque_stretch


class Anywhere:
    def polynomial_is_free(self, coefficients, duration):
        return True


def effort_scene(rr1, effort):
    return rp.Scene().with_arm("arm", rr1.with_limits(replace(rr1.limits, effort=effort)))


@pytest.fixture(scope="module")
def setting(rr1):
    """A path of RR1, and torques of its motion without torque limits: of gravity, and in total."""
    rr1 = rr1.with_limits("hardware")
    limits = rr1.limits
    low, high = np.maximum(limits.lower, -1.5), np.minimum(limits.upper, 1.5)
    points = np.random.default_rng(0).uniform(low, high, (4, rr1.nq))
    path = rp.Path(tuple(f"arm/{name}" for name in rr1.joint_names), points)
    # faster joints than the real ones, so that torque is the active limit
    rates = {"velocity": 8.0, "acceleration": 60.0, "jerk": 5000.0}
    fast = replace(limits, **{name: np.full(rr1.nq, rate) for name, rate in rates.items()})
    robot = rr1.with_limits(fast)
    scene = rp.Scene().with_arm("arm", robot)
    free = retime(path, scene, checker=Anywhere())
    return robot, path, free, *torques(scene, free)


def torques(scene, trajectory):
    t = np.linspace(0.0, trajectory.end_time, 20_000)
    q, kinematics = trajectory(t), Kinematics(scene)
    zero = np.zeros_like(q)
    return (
        np.abs(kinematics.inverse_dynamics(q, zero, zero)).max(axis=0),
        np.abs(kinematics.inverse_dynamics(q, trajectory(t, 1), trajectory(t, 2))).max(axis=0),
    )


@pytest.mark.parametrize("method", retiming_names())
def test_torque_limits_that_bind_are_held_between_samples(setting, method):
    robot, path, _, gravity, peak = setting
    effort = gravity + 0.3 * np.maximum(peak - gravity, 1.0)
    scene = effort_scene(robot, effort)
    loose = retime(path, scene, method=method, checker=Anywhere())
    assert (torques(scene, loose)[1] > effort).any()
    tight = retime(path, scene, method=method, checker=Anywhere(), torque_limits=True)
    assert (torques(scene, tight)[1] <= effort * (1.0 + 1e-9)).all()
    assert tight.duration > loose.duration
    # not slower than need be: some joint is near its limit
    assert (torques(scene, tight)[1] / effort).max() > 0.98


def test_torque_limits_that_do_not_bind_cost_little(setting):
    robot, path, free, _, peak = setting
    scene = effort_scene(robot, 2.0 * peak + 1.0)
    assert retime(path, scene, checker=Anywhere(), torque_limits=True).duration == pytest.approx(
        free.duration, rel=0.01
    )


def test_no_torque_limit_at_all_is_fine(setting):
    robot, path, free, _, _ = setting
    scene = effort_scene(robot, np.full(robot.nq, np.inf))
    assert retime(path, scene, checker=Anywhere(), torque_limits=True).duration == pytest.approx(
        free.duration, rel=0.01
    )


@pytest.mark.parametrize("method", retiming_names())
def test_gravity_above_a_limit_names_the_joint(setting, method):
    robot, path, _, gravity, _ = setting
    heavy = int(np.argmax(gravity))
    effort = 10.0 * gravity + 10.0
    effort[heavy] = 0.5 * gravity[heavy]
    with pytest.raises(rp.RetimingError, match=f"{robot.joint_names[heavy]}.*gravity"):
        retime(path, effort_scene(robot, effort), method=method, checker=Anywhere(), torque_limits=True)


def test_torque_limits_leave_the_path_alone(setting):
    robot, path, _, gravity, peak = setting
    scene = effort_scene(robot, gravity + 0.3 * np.maximum(peak - gravity, 1.0))
    trajectory = retime(path, scene, method="stop", torque_limits=True)
    np.testing.assert_allclose(trajectory(trajectory.end_time), path.waypoints[-1], atol=1e-9)
    limits = robot.limits
    t = np.linspace(0.0, trajectory.end_time, 10_000)
    assert (np.abs(trajectory(t, 1)) <= limits.velocity * (1.0 + 1e-9)).all()
    assert (np.abs(trajectory(t, 2)) <= limits.acceleration * (1.0 + 1e-9)).all()


@pytest.mark.parametrize("length", [1e-7, 1e-8])
def test_short_lines_are_timed_under_torque_limits(rr1, length):
    robot = rr1.with_limits("hardware")
    scene, rng = rp.Scene().with_arm("arm", robot), np.random.default_rng(5)
    low, high = np.maximum(robot.limits.lower, -1.0), np.minimum(robot.limits.upper, 1.0)
    for _ in range(8):
        start = rng.uniform(low, high)
        for direction in np.eye(robot.nq):
            path = rp.Path(scene.joint_names(), [start, start + length * direction])
            loose = retime(path, scene, method="stop")
            tight = retime(path, scene, method="stop", torque_limits=True)
            assert loose.duration * (1.0 - 1e-9) <= tight.duration < 1.5 * loose.duration
            t = np.linspace(0.0, tight.end_time, 20)
            torque = Kinematics(scene).inverse_dynamics(tight(t), tight(t, 1), tight(t, 2))
            assert (np.abs(torque) <= robot.limits.effort).all()


def test_held_objects_weigh(rr1):
    free = rp.Scene().with_arm("arm", rr1)
    tool = free.link_poses()["arm/tool"]
    path = rp.Path(free.joint_names(), free.configuration() + np.outer([0.0, 0.2], [1.0, 0.5, -1.0, 1.0, 0.0, 1.0]))
    own = torques(free, retime(path, free, checker=Anywhere(), torque_limits=True))[0]
    scene = effort_scene(rr1, 1.5 * own + 1.0)
    light, heavy, unknown = (
        scene.with_obstacle("load", rp.Box((0.1, 0.1, 0.1)), tool, mass=mass).attach("load")
        for mass in (0.05, 5.0, None)
    )
    trajectory = retime(path, light, checker=Anywhere(), torque_limits=True)
    report = rp.validate(trajectory, light, torque_limits=True)
    assert "mass of load" not in report.not_checked
    kinds = {violation.kind for violation in rp.validate(trajectory, heavy, torque_limits=True).violations}
    assert "torque" in kinds
    with pytest.raises(rp.RetimingError, match="gravity"):
        retime(path, heavy, checker=Anywhere(), torque_limits=True)
    report = rp.validate(trajectory, unknown, torque_limits=True)
    assert report.not_checked["mass of load"] == "not given, treated as weightless"


def test_gravity_that_may_exceed_its_limit_between_samples_is_named_with_that_torque():
    line = Pieces(np.ones(1), np.array([[[0.0], [1.0]]]))
    said = r"'arm/j': holding the arm still .* takes 1\.485 Nm \(or N\) on the path, .* is 1;"
    with pytest.raises(rp.RetimingError, match=said):
        # 0.99 and -0.99 at the samples, every 0.02 rad.
        torque_stretch(line, ("arm/j",), np.ones(1), lambda q, qd, qdd: 0.99 * np.cos(50.0 * np.pi * q))
