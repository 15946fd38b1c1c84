"""The simulation and its controllers: one clock, exact repeats, the meaning of ros2_control, named errors."""

from __future__ import annotations

import json
import math
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import ArrayLike

import rr1plan as rp
from rr1plan.playback.simulation.arm_dynamics import ArmDynamics
from rr1plan.playback.simulation.contact_log import ContactLog
from rr1plan.transforms import pose

ARM = [f"rr1/{name}" for name in rp.load_robot("rr1").joint_names]


class Sway(rp.Controller):
    """A user-defined controller: one method."""

    def update(self, state: rp.JointState) -> rp.SetPoint:
        return rp.SetPoint(np.full(len(self.joints.names), 0.05 * math.sin(3.0 * state.time)))


def motion(scene: rp.Scene, names: list[str], seconds: float = 0.6, by: float = 0.2) -> rp.Trajectory:
    """A quintic motion from the scene's configuration by some angle, at rest at both ends."""
    q = scene.configuration()
    start = np.array([q[scene.joint_names().index(name)] for name in names])
    still = np.zeros((2, len(names)))
    return rp.Trajectory.from_samples(names, [0.0, seconds], [start, start + by], still, still)


@pytest.fixture
def scene() -> rp.Scene:
    return rp.load_scene("rr1_table")


def made(kind: str, scene: rp.Scene) -> tuple[rp.Controller, Callable[[], object]]:
    """A controller, and a call that commands a motion once it is active."""
    if kind == "own":
        return Sway(ARM), lambda: None
    if kind == "trajectory":
        follow = rp.JointTrajectoryController(ARM)
        return follow, lambda: follow.send(motion(scene, ARM))
    if kind == "position":
        step = rp.ForwardPositionController(ARM)
        return step, lambda: step.command(scene.configuration() + 0.02)
    if kind == "velocity":
        drift = rp.ForwardVelocityController(ARM)
        return drift, lambda: drift.command(np.full(len(ARM), 0.1))
    if kind == "manual":
        hand = rp.ManualController(ARM)
        return hand, lambda: hand.command(scene.configuration() + 0.02)
    grip = rp.GripperController(["rr1/finger_joint"])
    return grip, lambda: grip.command([0.02])


KINDS = ("own", "trajectory", "position", "velocity", "manual", "gripper")


# ---- the contract of every controller --------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_runs_repeat_to_the_bit_also_after_a_reset(kind: str, scene: rp.Scene) -> None:
    def run(sim: rp.Simulation) -> list[bytes]:
        states: list[bytes] = []
        end = sim.on_step(lambda s: states.append(s.positions.tobytes() + s.efforts.tobytes()))
        begin()
        sim.step(200)
        end()
        return states

    controller, begin = made(kind, scene)
    sim = rp.Simulation(scene)
    sim.activate(controller)
    first = run(sim)
    sim.reset()
    assert sim.time == 0.0
    assert run(sim) == first
    controller, begin = made(kind, scene)
    other = rp.Simulation(scene)
    other.activate(controller)
    assert run(other) == first
    assert len(set(first)) > 100  # something moves


@pytest.mark.parametrize("kind", KINDS)
def test_controllers_hold_until_commanded_and_leave_other_joints_alone(kind: str, scene: rp.Scene) -> None:
    controller, begin = made(kind, scene)
    sim = rp.Simulation(scene)
    sim.activate(controller)
    before = sim.positions
    if kind != "own":
        sim.step(100)
        np.testing.assert_allclose(sim.positions, before, atol=1e-4)
    begin()
    sim.step(150)
    others = [i for i, name in enumerate(sim.joint_names) if name not in controller.joint_names]
    others = [i for i in others if "finger" not in sim.joint_names[i]]
    np.testing.assert_allclose(sim.positions[others], before[others], atol=1e-3)
    claimed = [sim.joint_names.index(name) for name in controller.joint_names]
    assert np.abs(sim.positions[claimed] - before[claimed]).max() > 1e-3


@pytest.mark.parametrize("kind", KINDS)
def test_joints_are_claimed_by_one_controller_at_a_time(kind: str, scene: rp.Scene) -> None:
    sim = rp.Simulation(scene)
    controller, _ = made(kind, scene)
    sim.activate(controller)
    rival = Sway(controller.joint_names[:1])
    with pytest.raises(rp.InputError, match=f"{controller.joint_names[0]}.*{type(controller).__name__}.*replace=True"):
        sim.activate(rival)
    sim.activate(rival, replace=True)
    assert sim.controllers == (rival,)
    sim.deactivate(rival)
    with pytest.raises(rp.InputError, match="not active"):
        sim.deactivate(rival)
    held = sim.set_points
    sim.step(5)
    np.testing.assert_array_equal(sim.set_points, held)


# ---- the trajectory controller ------------------------------------------------------------------------


def test_a_trajectory_is_followed_and_its_execution_succeeds(scene: rp.Scene) -> None:
    sim = rp.Simulation(scene)
    follow = rp.JointTrajectoryController(ARM)
    sim.activate(follow)
    trajectory = motion(scene, ARM)
    shuffled = rp.Trajectory(trajectory.joint_names[::-1], trajectory.breaks, trajectory.coefficients[:, :, ::-1])
    execution = follow.send(shuffled)
    sim.run(duration=0.3)
    assert execution.status is rp.ExecutionStatus.ACTIVE
    assert execution.code is None
    assert not execution
    np.testing.assert_allclose(sim.configuration(), trajectory(0.3), atol=1e-3)
    sim.run(until=0.7)
    assert execution
    assert execution.code == 0
    assert execution.ended == pytest.approx(0.6, abs=0.003)
    assert 0.0 < execution.max_error.max() < 1e-3
    np.testing.assert_allclose(sim.configuration(), trajectory(0.6), atol=1e-4)


# Joint positions through which the RR1 twin of the thesis was driven [rad], each in 4 s.
POSES = (
    *((-2.25, -0.39, 1.30, 0.05, 3.10, 1.25), (-0.35, -0.25, 1.15, -2.15, 1.80, -1.20)),
    *((1.40, 0.39, 0.95, 2.30, 2.65, -0.60), (-2.35, 0.32, -1.10, -1.50, 1.40, 0.50)),
    *((-0.80, -0.28, 0.70, 0.0, 2.10, -0.15), (-0.17, 0.37, -1.13, -1.14, 0.95, 1.09), (0.0,) * 6),
)


@pytest.mark.parametrize(("payload", "most"), [(0.0, 1e-3), (1.0, 5e-3)])
def test_seven_poses_are_tracked_also_with_an_unknown_load(rr1: rp.Robot, payload: float, most: float) -> None:
    sim = rp.Simulation(rp.Scene().with_arm("rr1", rr1, q=np.zeros(6)))
    follow = rp.JointTrajectoryController(ARM, goal_time=0.1)
    sim.activate(follow)
    model, data = sim.model, sim.data
    tool, jacobian = model.body("rr1/tool").id, np.zeros((3, model.nv))

    def pull(_: rp.Simulation) -> None:
        """Mass of a load at the tool, which the feed-forward torque does not model [kg]."""
        mujoco.mj_jac(model, data, jacobian, None, data.xpos[tool], tool)
        data.qfrc_applied[:] = jacobian[2] * (-9.81 * payload)

    sim.on_step(pull)
    errors, now = [], np.zeros(6)
    for goal in POSES:
        move = rp.Trajectory.from_samples(ARM, [0.0, 4.0], [now, goal], np.zeros((2, 6)), np.zeros((2, 6)))
        execution, now = follow.send(move), np.array(goal)
        sim.run(duration=4.2)
        assert execution.code == 0
        errors.append(execution.max_error.max())
    assert max(errors) <= most


def test_a_force_on_a_frame_without_mass_acts_at_its_origin(rr1: rp.Robot) -> None:
    sim = rp.Simulation(rp.Scene().with_arm("rr1", rr1))
    tool = sim.model.body("rr1/tool").id
    np.testing.assert_array_equal(sim.model.body_ipos[tool], 0.0)
    np.testing.assert_allclose(sim.data.xipos[tool], sim.data.xpos[tool])


def test_simulate_is_the_same_motion(scene: rp.Scene) -> None:
    trajectory = motion(scene, ARM)
    replay = rp.simulate(trajectory, scene, record_dt=0.002)
    sim = rp.Simulation(scene)
    follow = rp.JointTrajectoryController(ARM)
    sim.activate(follow)
    follow.send(trajectory)
    rows = [sim.configuration()]
    sim.on_step(lambda s: rows.append(s.configuration()))
    sim.step(replay.steps)
    np.testing.assert_allclose(np.array(rows), replay.record.actual, atol=1e-9)


def test_points_are_interpolated_by_what_they_carry(scene: rp.Scene) -> None:
    q = scene.configuration()
    still, times = np.zeros((2, len(q))), [0.0, 0.4]
    middle = {"linear": (), "cubic": (still,), "quintic": (still, still)}
    for rates in middle.values():
        sim = rp.Simulation(scene)
        follow = rp.JointTrajectoryController(ARM)
        sim.activate(follow)
        follow.send(rp.Trajectory.from_samples(ARM, times, [q, q + 0.1], *rates))
        sim.run(until=0.102)
        u = 0.25
        part = {0: u, 1: 3 * u**2 - 2 * u**3, 2: 10 * u**3 - 15 * u**4 + 6 * u**5}[len(rates)]
        columns = [sim.joint_names.index(name) for name in ARM]
        np.testing.assert_allclose(sim.set_points[columns], q + 0.1 * part, atol=1e-9)


def test_set_points_are_the_bytes_of_the_trajectory(scene: rp.Scene) -> None:
    rng, dt = np.random.default_rng(1), 0.002
    for degree in (0, 1, 5):
        coefficients = 0.02 * rng.normal(size=(3, degree + 1, len(ARM)))
        coefficients[:, 0] += 0.2
        path = rp.Trajectory(ARM, [0.5, 0.52, 0.63, 0.9], coefficients)
        follow = rp.JointTrajectoryController(ARM[::-1], start_tolerance=math.inf, goal_tolerance=math.inf)
        sim = rp.Simulation(scene, dt)
        sim.activate(follow)
        follow.send(path)
        for number in range(200):
            point = follow.update(sim.state(ARM[::-1])._replace(time=dt * number))
            for derivative, row in enumerate((point.positions, point.velocities, point.accelerations)):
                assert row is not None
                assert row.tobytes() == path(0.5 + dt * number, derivative)[::-1].tobytes()
            # A preview has the same, whatever was evaluated before.
            times = dt * np.arange(number + 1, number + 1 + number % 40)
            if (ahead := follow.preview(times)) is not None:
                expected = path(0.5 + times[: len(ahead.positions)])[:, ::-1]
                assert ahead.positions.tobytes() == expected.tobytes()


def test_a_newer_trajectory_preempts_at_its_time(scene: rp.Scene) -> None:
    sim = rp.Simulation(scene)
    follow = rp.JointTrajectoryController(ARM, start_tolerance=1.0)
    sim.activate(follow)
    first = follow.send(motion(scene, ARM))
    second = follow.send(motion(scene, ARM, by=-0.1), at=0.2)
    assert second.status is rp.ExecutionStatus.WAITING
    sim.run(until=0.1)
    assert first.status is rp.ExecutionStatus.ACTIVE
    assert second.status is rp.ExecutionStatus.WAITING
    third = follow.send(motion(scene, ARM, by=0.05))
    assert second.status is rp.ExecutionStatus.PREEMPTED
    assert second.ended == pytest.approx(0.1)
    sim.run(until=1.0)
    assert first.status is rp.ExecutionStatus.PREEMPTED
    assert first.ended == third.start == pytest.approx(0.1)
    assert third


def between(start: np.ndarray, goal: np.ndarray, seconds: float = 0.3) -> rp.Trajectory:
    """A quintic motion, at rest at both ends."""
    still = np.zeros((2, len(start)))
    return rp.Trajectory.from_samples(ARM, [0.0, seconds], [start, goal], still, still)


def test_trajectories_wait_in_a_queue_and_follow_each_other(scene: rp.Scene) -> None:
    q = scene.configuration()
    sim, follow = rp.Simulation(scene), rp.JointTrajectoryController(ARM)
    sim.activate(follow)
    sent = [follow.send(between(q, q + 0.1))]
    sent += [follow.send(between(q + 0.1, q), at=0.3), follow.send(between(q, q - 0.1), at=0.8)]
    set_points: list[np.ndarray] = []
    sim.on_step(lambda s: set_points.append(s.set_points))
    sim.run(until=1.2)
    assert [execution.status for execution in sent] == [rp.ExecutionStatus.SUCCEEDED] * 3
    assert [execution.start for execution in sent] == pytest.approx([0.0, 0.3, 0.8])
    assert np.abs(np.diff(set_points, axis=0)).max() < 0.002
    # Those that wait are canceled together, at the present time.
    sent = [follow.send(between(q - 0.1, q), at=sim.time + wait) for wait in (1.0, 2.0)]
    follow.cancel()
    assert {execution.status for execution in sent} == {rp.ExecutionStatus.CANCELED}
    assert [execution.ended for execution in sent] == pytest.approx([1.2, 1.2])


def test_a_trajectory_that_begins_elsewhere_is_refused_when_it_begins(scene: rp.Scene) -> None:
    q = scene.configuration()
    far = q + np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    sim, follow = rp.Simulation(scene), rp.JointTrajectoryController(ARM)
    sim.activate(follow)
    with pytest.raises(rp.InputError, match="begins elsewhere"):
        follow.send(between(far, far), at=0.0)
    running, refused = follow.send(between(q, q + 0.1, 0.4)), follow.send(between(far, far), at=0.2)
    set_points: list[np.ndarray] = []
    sim.on_step(lambda s: set_points.append(s.set_points))
    sim.run(until=0.6)
    assert refused.status is rp.ExecutionStatus.START_TOLERANCE_VIOLATED
    assert refused.code == -1
    assert refused.ended == pytest.approx(0.2)
    assert "begins elsewhere: 6 joints off, 'rr1/shoulder_joint' by 0.95" in refused.message
    assert running
    assert np.abs(np.diff(set_points, axis=0)).max() < 0.002


@pytest.mark.parametrize("dt", [0.002, 0.02])
def test_a_fast_motion_may_be_continued_from_what_it_commands(dt: float, scene: rp.Scene) -> None:
    """A joint at 2 rad/s moves farther in one step than the start tolerance."""
    q = scene.configuration()
    path = rp.Trajectory(ARM, [0.0, 0.4], np.array([[q, [2.0, 0.0, 0.0, 0.0, 0.0, 0.0]]]))
    rest = rp.Trajectory(ARM, [0.2, 0.4], np.array([[path(0.2), path(0.2, 1)]]))
    sim, follow = rp.Simulation(scene, dt), rp.JointTrajectoryController(ARM, goal_tolerance=math.inf)
    sim.activate(follow)
    first, second = follow.send(path), follow.send(rest, at=0.2)
    sim.run(until=0.3)
    assert first.status is rp.ExecutionStatus.PREEMPTED
    assert second.status is rp.ExecutionStatus.ACTIVE
    np.testing.assert_allclose(sim.set_points[:6], path(0.3 - dt), atol=1e-9)


def test_an_execution_can_be_canceled_and_the_arm_holds(scene: rp.Scene) -> None:
    sim = rp.Simulation(scene)
    follow = rp.JointTrajectoryController(ARM)
    sim.activate(follow)
    execution = follow.send(motion(scene, ARM))
    sim.run(until=0.3)
    follow.cancel()
    sim.run(until=0.302)
    held = sim.configuration()
    sim.run(until=1.0)
    assert execution.status is rp.ExecutionStatus.CANCELED
    np.testing.assert_allclose(sim.configuration(), held, atol=0.02)
    np.testing.assert_allclose(sim.velocities, 0.0, atol=1e-4)


def test_tolerances_end_an_execution_with_the_codes_of_ros(scene: rp.Scene) -> None:
    sim = rp.Simulation(scene)
    tight = rp.JointTrajectoryController(ARM, path_tolerance=1e-7)
    sim.activate(tight)
    execution = tight.send(motion(scene, ARM))
    sim.run(until=0.8)
    assert execution.status is rp.ExecutionStatus.PATH_TOLERANCE_VIOLATED
    assert execution.code == -4
    assert "rr1/" in execution.message
    assert execution.ended < 0.6

    pushed = rp.Simulation(scene)
    late = rp.JointTrajectoryController(ARM, goal_tolerance=1e-3, goal_time=0.1)
    pushed.activate(late)
    execution = late.send(motion(scene, ARM))
    body = pushed.model.body("rr1/hand_link").id
    pushed.data.xfrc_applied[body, 2] = -20.0  # a load that the feed-forward torque does not model
    pushed.run(until=1.0)
    assert execution.status is rp.ExecutionStatus.GOAL_TOLERANCE_VIOLATED
    assert execution.code == -5
    assert execution.ended == pytest.approx(0.7, abs=0.01)

    # After the end only the goal tolerance applies.
    pushed = rp.Simulation(scene)
    both = rp.JointTrajectoryController(ARM, path_tolerance=5e-3, goal_tolerance=1e-9, goal_time=0.1)
    pushed.activate(both)
    execution = both.send(motion(scene, ARM))
    pushed.run(until=0.604)
    assert execution.status is rp.ExecutionStatus.ACTIVE
    pushed.data.qfrc_applied[0] = 60.0
    pushed.run(until=0.68)
    assert abs(pushed.configuration()[0] - pushed.set_points[0]) > 5e-3
    assert execution.status is rp.ExecutionStatus.ACTIVE
    pushed.run(until=0.8)
    assert execution.code == -5


def test_tolerances_are_numbers_of_any_kind() -> None:
    follow = rp.JointTrajectoryController(ARM, path_tolerance=np.float32(0.5), goal_time=np.int64(2))
    assert (follow.path_tolerance, follow.goal_time) == (0.5, 2.0)
    assert rp.JointTrajectoryController(ARM, goal_tolerance=np.float32(math.inf)).goal_tolerance == math.inf
    for value in (True, -1, math.nan, "1", [1.0], None):
        with pytest.raises(rp.InputError, match="goal_tolerance"):
            rp.JointTrajectoryController(ARM, goal_tolerance=value)


def test_a_recorder_compares_positions_with_set_points_of_the_same_instant(scene: rp.Scene) -> None:
    sim, follow, fast = rp.Simulation(scene, 0.004), rp.JointTrajectoryController(ARM), motion(scene, ARM, 0.4, 0.3)
    sim.activate(follow)
    execution = follow.send(fast)
    with rp.Recorder(sim, 0.02) as recorder:
        sim.run(duration=fast.duration)
    replay = recorder.replay()
    np.testing.assert_array_equal(replay.max_error, execution.max_error)
    # The distance that the joints travel in one step is far larger.
    assert replay.worst_error < 0.1 * float(np.abs(fast(0.2, 1)).max()) * sim.dt
    np.testing.assert_allclose(replay.record.desired[:-1], fast(replay.record.times[:-1]), atol=1e-12)


def test_trajectories_that_do_not_fit_are_refused_by_name(scene: rp.Scene) -> None:
    follow = rp.JointTrajectoryController(ARM)
    with pytest.raises(rp.InputError, match="not active"):
        follow.send(motion(scene, ARM))
    sim = rp.Simulation(scene)
    sim.activate(follow)
    with pytest.raises(rp.InputError, match=ARM[0]):
        follow.send(motion(scene, ARM[1:]))
    with pytest.raises(rp.InputError, match=r"joint .rr1/.*beyond its limits"):
        follow.send(motion(scene, ARM, by=30.0))
    elsewhere = motion(scene.with_configuration("rr1", scene.configuration() + 0.05), ARM)
    with pytest.raises(rp.InputError, match=r"begins elsewhere: 6 joints off.*start_tolerance"):
        follow.send(elsewhere)
    sim.step(10)
    for passed in (0.0, sim.time - 0.001):
        with pytest.raises(rp.InputError, match=r"which has passed: it is 0\.02 s"):
            follow.send(motion(scene, ARM), at=passed)
    assert follow.send(motion(scene, ARM), at=sim.time).start == sim.time
    with pytest.raises(rp.InputError, match="goal_time"):
        rp.JointTrajectoryController(ARM, goal_time=math.nan)


@pytest.mark.parametrize("rates", ["velocities", "efforts"])
def test_joints_that_a_replaced_controller_leaves_hold_their_set_points(rates: str, scene: rp.Scene) -> None:
    class Drives(rp.Controller):
        def update(self, state: rp.JointState) -> rp.SetPoint:
            return rp.SetPoint(scene.configuration(), **{rates: np.full(len(ARM), 2.0)})

    sim = rp.Simulation(scene)
    sim.activate(Drives(ARM))
    sim.run(duration=0.1)
    sim.activate(rp.ForwardPositionController(ARM[:1]), replace=True)
    sim.run(duration=1.0)
    np.testing.assert_allclose(sim.positions, sim.set_points, atol=1e-5)


def test_a_failed_activation_replaces_nothing(scene: rp.Scene) -> None:
    class Fails(Sway):
        def activate(self, joints: rp.JointInfo, state: rp.JointState) -> None:
            raise ValueError("not today")

    sim, hold = rp.Simulation(scene), rp.ForwardPositionController(ARM)
    sim.activate(hold)
    with pytest.raises(ValueError, match="not today"):
        sim.activate(Fails(ARM), replace=True)
    assert sim.controllers == (hold,)
    hold.command(scene.configuration() + 0.01)
    sim.step()
    np.testing.assert_allclose(sim.set_points[:6], scene.configuration() + 0.01)


def test_a_controller_commands_one_simulation_at_a_time(scene: rp.Scene) -> None:
    first, second = rp.Simulation(scene), rp.Simulation(scene)
    hold = rp.ForwardPositionController(ARM)
    first.activate(hold)
    with pytest.raises(rp.InputError, match="ForwardPositionController of 'rr1/shoulder_joint' is active in another"):
        second.activate(hold)
    assert second.controllers == ()
    first.reset()
    first.deactivate(hold)
    second.activate(hold)
    # One that was replaced is free, and one of a simulation that is gone.
    second.activate(rp.ForwardPositionController(ARM), replace=True)
    first.activate(hold)
    del first
    second.activate(hold, replace=True)
    second.step()


# ---- other controllers --------------------------------------------------------------------------------


def test_velocities_stop_at_the_limits(scene: rp.Scene) -> None:
    sim = rp.Simulation(scene)
    drift = rp.ForwardVelocityController(ARM[1:2])
    sim.activate(drift)
    upper = scene.limits().upper[1]
    drift.command([1.0])
    sim.run(until=5.0)
    assert sim.state(ARM[1:2]).positions[0] == pytest.approx(upper, abs=1e-3)
    with pytest.raises(rp.InputError, match="above its limit"):
        drift.command([1000.0])


def test_a_joint_beyond_its_limit_can_move_back_without_a_jump(scene: rp.Scene) -> None:
    q, joint = scene.configuration(), ARM[1:2]
    q[1] = scene.limits().upper[1] + 0.2
    for back in (rp.ForwardVelocityController(joint), rp.ManualController(joint)):
        sim = rp.Simulation(scene)
        sim.place(ARM, q)
        sim.activate(back)
        sim.step(5)
        assert sim.set_points[1] == q[1]
        back.command([0.5] if isinstance(back, rp.ForwardVelocityController) else [9.0])
        before = sim.set_points[1]
        sim.step()
        assert before - 0.005 < sim.set_points[1] <= before
        back.command([-0.5])
        sim.step(100)
        assert sim.set_points[1] < q[1] - 0.02


@pytest.mark.parametrize("speed", [0.25, 1.0])
@pytest.mark.parametrize("dt", [0.002, 0.02, 0.2, 1.0])
def test_manual_control_is_within_limits_and_its_acceleration(dt: float, speed: float, scene: rp.Scene) -> None:
    limits, rng = scene.limits(), np.random.default_rng(0)
    sim, hand = rp.Simulation(scene, dt), rp.ManualController(ARM, speed=speed)
    sim.activate(hand)
    state, before = sim.state(ARM), np.zeros(len(ARM))
    fastest = speed * limits.velocity
    for number in range(1000):
        if number % 25 == 0 and number < 800:
            hand.command(target := np.where(rng.uniform(size=6) < 0.3, 9.0, rng.uniform(limits.lower, limits.upper)))
        point = hand.update(state)
        assert point.velocities is not None
        assert (limits.lower <= point.positions).all()
        assert (point.positions <= limits.upper).all()
        assert (np.abs(point.velocities) <= fastest * (1.0 + 1e-9)).all()
        assert (np.abs(point.velocities - before) <= fastest / 0.2 * dt * (1.0 + 1e-9)).all()
        before = point.velocities
    if dt > 0.002:  # there is enough time
        np.testing.assert_array_equal(point.positions, np.clip(target, limits.lower, limits.upper))
        np.testing.assert_array_equal(before, 0.0)


@pytest.mark.parametrize("speed", [0.25, 1.0])
def test_joints_moved_by_hand_are_at_rest_when_they_arrive(speed: float, scene: rp.Scene) -> None:
    sim, hand = rp.Simulation(scene), rp.ManualController(ARM, speed=speed)
    sim.activate(hand)
    hand.move(ARM[0], 0.5)
    positions: list[float] = []
    velocities: list[float] = []
    sim.on_step(lambda s: positions.append(s.positions[0]))
    sim.on_step(lambda s: velocities.append(s.velocities[0]))
    sim.run(duration=0.6)
    assert max(positions) < 0.5 + 1e-6
    assert min(velocities) > -1e-4
    assert positions[-1] == pytest.approx(0.5, abs=1e-6)


def test_manual_control_follows_sliders_and_keys_within_speed_and_limits(scene: rp.Scene) -> None:
    sim = rp.Simulation(scene)
    hand = rp.ManualController(ARM, speed=0.1, step=0.05)
    with pytest.raises(rp.InputError, match="not active"):
        hand.press("+")
    sim.activate(hand)
    start, limit = sim.configuration(), scene.limits()
    hand.move(ARM[1], 9.0)  # as far as the joint goes
    speeds: list[float] = []
    ended = sim.on_step(lambda s: speeds.append(float(np.abs(s.velocities[:6]).max())))
    sim.run(duration=1.5)
    ended()
    assert sim.configuration()[1] == pytest.approx(limit.upper[1], abs=1e-4)
    assert max(speeds) <= 0.1 * limit.velocity[1] * 1.02
    assert [hand.press(key) for key in ("3", "+", "+", "-", "x", "9", "")] == [
        True,
        True,
        True,
        True,
        False,
        False,
        False,
    ]
    assert hand.selected == ARM[2]
    sim.run(duration=1.0)
    assert sim.configuration()[2] == pytest.approx(start[2] + 0.05, abs=1e-3)
    # A new target during the motion, without a jump of the velocity.
    hand.move(ARM[0], 1.0)
    sim.run(duration=0.3)
    before = sim.velocities[0]
    assert before > 0.1
    hand.move(ARM[0], -1.0)
    sim.step()
    assert abs(sim.velocities[0] - before) < 0.05
    sim.run(duration=0.3)
    hand.press(" ")
    there, velocity = sim.configuration()[0], sim.velocities[0]
    assert velocity < -0.01
    for _ in range(100):  # without turning back
        sim.step()
        assert sim.velocities[0] < 0.02
    sim.run(duration=2.0)
    assert sim.configuration()[0] == pytest.approx(there, abs=0.1)
    assert np.abs(sim.velocities).max() < 1e-3
    with pytest.raises(rp.UnknownNameError, match="unknown joint 'rr1/shouldr_joint'"):
        hand.move("rr1/shouldr_joint", 0.0)


def test_a_removed_callback_is_not_called_again(scene: rp.Scene) -> None:
    sim, calls = rp.Simulation(scene), []
    sim.on_step(lambda _: remove() if sim.steps == 3 else None)
    remove = sim.on_step(lambda _: calls.append(sim.steps))
    sim.step(5)
    assert calls == [1, 2]


def test_a_gripper_arrives_or_stalls(scene: rp.Scene) -> None:
    sim = rp.Simulation(scene)
    grip = rp.GripperController(["rr1/finger_joint"], speed=0.5)
    sim.activate(grip)
    target = 0.5 * sum(_limits(scene, "finger_joint"))
    grip.command([target])
    assert grip.status is rp.GripperStatus.MOVING
    sim.run(duration=2.0)
    assert grip.status is rp.GripperStatus.ARRIVED
    with pytest.raises(rp.InputError, match="mimics 'rr1/finger_joint'"):
        sim.activate(rp.GripperController(["rr1/opposite_finger_joint"]))


def _limits(scene: rp.Scene, joint: str) -> tuple[float, float]:
    found = scene.arms["rr1"].robot.joint(joint)
    return found.lower, found.upper


def test_states_are_broadcast_at_a_rate(scene: rp.Scene, tmp_path: Path) -> None:
    sim = rp.Simulation(scene)
    seen: list[float] = []
    receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    receiver.bind(("127.0.0.1", 0))
    receiver.settimeout(5.0)
    file = tmp_path / "states.jsonl"
    targets = (lambda state: seen.append(state.time)), file, receiver.getsockname()
    casters = [rp.JointStateBroadcaster(ARM, to, rate=50.0) for to in targets]
    for caster in casters:
        caster.attach(sim)
    sim.run(until=0.2)
    for caster in casters:
        caster.close()
    sim.run(until=0.4)
    assert np.allclose(np.diff(seen), 0.02, atol=0.0021)
    assert len(seen) == 10
    lines = [json.loads(line) for line in file.read_text().splitlines()]
    assert [line["time"] for line in lines] == pytest.approx(seen)
    assert lines[0]["name"] == ARM
    assert json.loads(receiver.recv(65536)) == lines[0]
    receiver.close()


# ---- the simulation -----------------------------------------------------------------------------------


def test_arms_that_cannot_meet_have_models_of_their_own_and_threads_change_nothing() -> None:
    robot = rp.load_robot("rr1")
    arms = {f"a{i}": rp.Arm(robot, pose([5.0 * i, 0.0, 0.0])) for i in range(75)}
    scene = rp.Scene(arms=arms).with_obstacle("floor", rp.HalfSpace((0.0, 0.0, 1.0), -0.02))
    names = list(scene.joint_names())
    runs = []
    for threads in (1, 3):
        sim = rp.Simulation(scene, threads=threads)
        assert len(sim.tiles) == 2
        with pytest.raises(rp.InputError, match="2 MuJoCo models"):
            _ = sim.model
        follow = rp.JointTrajectoryController(names)
        sim.activate(follow)
        follow.send(motion(scene, names, 0.2, 0.05))
        sim.step(50)
        runs.append(sim.positions)
        # One clock: every arm does exactly the same.
        each = sim.configuration().reshape(75, -1)
        np.testing.assert_allclose(each, np.broadcast_to(each[0], each.shape), atol=1e-12)
    np.testing.assert_array_equal(*runs)


def test_contacts_are_named_with_their_time(scene: rp.Scene) -> None:
    sim = rp.Simulation(scene)
    assert sim.contacts == ()
    low = sim.data.qpos.copy()
    drop = rp.ForwardPositionController(ARM)
    sim.activate(drop)
    limits = scene.limits()
    rng = np.random.default_rng(0)
    checker = rp.CollisionChecker(scene)
    samples = (rng.uniform(limits.lower, limits.upper) for _ in range(1000))
    blocked = next(q for q in samples if not checker.is_free(q) and all("/" not in c.b for c in checker.contacts(q)))
    sim.place(ARM, blocked)
    pairs = {frozenset((c.a, c.b)) for c in checker.contacts(blocked)}
    assert {frozenset(c.pair) for c in sim.contacts} == pairs
    assert all(c.first == 0.0 for c in sim.contacts)
    assert not np.allclose(sim.data.qpos, low)


def pause_soon(sim: rp.Simulation, **run: float) -> bool:
    """Run until another thread pauses after the first step, as a pause before a run has no effect."""
    timer = threading.Timer(0.05, sim.pause)

    def begin(_: rp.Simulation) -> None:
        if timer.ident is None:
            timer.start()

    stop = sim.on_step(begin)
    reached = sim.run(**run)
    timer.join()
    stop()
    return reached


def test_a_run_can_be_paused_and_paced(scene: rp.Scene) -> None:
    sim = rp.Simulation(scene)
    stop = sim.on_step(lambda s: s.steps < 10)
    assert sim.run(until=1.0) is False
    assert sim.steps == 10
    stop()
    began = time.perf_counter()
    assert sim.run(duration=0.1, speed=1.0)
    assert time.perf_counter() - began > 0.09
    assert pause_soon(sim, until=1000.0, speed=1.0) is False
    # A pause also ends the wait for the next step of a slow run, here of hours.
    for slow in (1e-7, 1e-300):
        assert pause_soon(sim, duration=1.0, speed=slow) is False
    with pytest.raises(rp.InputError, match=r"duration is -0\.5 s, expected at least 0"):
        sim.run(duration=-0.5)
    with pytest.raises(rp.InputError, match="it cannot run to 0 s; reset it first"):
        sim.run(until=0.0)
    with pytest.raises(rp.InputError, match="either until or duration"):
        sim.run()


def test_threads_share_a_simulation(scene: rp.Scene) -> None:
    """Runs follow each other, and other calls take effect between two steps; anything else would crash MuJoCo."""
    sim = rp.Simulation(scene.with_obstacle("ball", rp.Sphere(0.02), [0.4, 0.0, 0.5], mass=0.1))
    begun = threading.Event()
    sim.on_step(lambda s: begun.set())
    runs = [threading.Thread(target=sim.run, kwargs={"duration": 0.2}) for _ in range(2)]
    for run in runs:
        run.start()
    begun.wait(10.0)
    hold = rp.ForwardPositionController(ARM)
    while any(run.is_alive() for run in runs):
        sim.place_body("ball", [0.4, 0.0, 0.5])
        sim.activate(hold)
        sim.deactivate(hold)
    assert sim.steps == 200
    assert not sim.controllers


def test_mujoco_s_data_are_read_between_steps(scene: rp.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first access by another thread in the middle of steps lost these steps."""
    rest = scene.configuration()
    motion = rp.Trajectory.from_samples(ARM, [0.0, 1.0], [rest, rest + 0.2], np.zeros((2, 6)), np.zeros((2, 6)))

    def follow() -> rp.Simulation:
        sim, arm = rp.Simulation(scene), rp.JointTrajectoryController(ARM)
        sim.activate(arm)
        arm.send(motion)
        return sim

    undisturbed, sim = follow(), follow()
    undisturbed.step(96)
    reading = threading.Thread(target=lambda: sim.data)
    whole_steps = ArmDynamics.take_steps

    def interrupted(self: ArmDynamics, *arguments: Any) -> None:
        whole_steps(self, *arguments)
        if sim.steps > 0 and reading.ident is None:
            reading.start()
            reading.join(0.05)  # it waits for the end of the steps

    monkeypatch.setattr(ArmDynamics, "take_steps", interrupted)
    sim.step(96)
    reading.join(10.0)
    assert reading.ident is not None
    np.testing.assert_allclose(sim.positions, undisturbed.positions, rtol=0.0, atol=1e-12)


def test_contacts_are_read_between_steps(scene: rp.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """A step that notes a contact changes the collection that is read."""
    sim = rp.Simulation(scene.with_obstacle("in the arm", rp.Sphere(0.1), [0.0, 0.0, 0.2]))
    found: list[tuple[rp.ReplayContact, ...]] = []
    reading, note = threading.Thread(target=lambda: found.append(sim.contacts)), ContactLog.add

    def interrupted(self: ContactLog, *arguments: Any) -> None:
        if reading.ident is None:
            reading.start()
            reading.join(0.05)  # it waits for the end of the step
            assert not found
        note(self, *arguments)

    monkeypatch.setattr(ContactLog, "add", interrupted)
    sim.step()
    reading.join(10.0)
    assert found == [sim.contacts]
    assert found[0][0].last == sim.time


def test_joints_are_moved_by_two_threads_at_a_time(scene: rp.Scene) -> None:
    first, second = names = scene.joint_names()[:2]
    entered, leave = threading.Event(), threading.Event()

    class Interrupted(rp.ManualController):
        def command(self, positions: ArrayLike) -> None:
            if not entered.is_set():
                entered.set()
                leave.wait(10.0)
            super().command(positions)

    sim, manual = rp.Simulation(scene), Interrupted(names, speed=1.0)
    sim.activate(manual)
    threads = [threading.Thread(target=manual.move, args=(joint, 0.1)) for joint in (first, second)]
    threads[0].start()
    entered.wait(10.0)
    threads[1].start()
    threads[1].join(0.05)  # it waits for the other one
    leave.set()
    for thread in threads:
        thread.join(10.0)
    sim.run(duration=0.5)
    np.testing.assert_allclose(sim.state(names).positions, 0.1, atol=1e-3)


def test_fingers_that_are_commanded_during_an_update_have_not_arrived() -> None:
    grip = rp.GripperController(["rr1/finger_joint"])
    commanding = threading.Thread(target=grip.command, args=([0.5],))

    class Interrupting(np.ndarray):
        def __sub__(self, other: object) -> np.ndarray:
            commanding.start()
            commanding.join(0.05)  # it waits for the end of the update
            return np.subtract(self, other)

    there = np.zeros(1)
    state = rp.JointState(0.0, there, there, there)
    grip.activate(rp.JointInfo(grip.joint_names, there, there + 1.0, there + 1.0, 0.002), state)
    grip.command([0.0])
    grip.update(state._replace(positions=there.view(Interrupting)))
    commanding.join(10.0)
    assert grip.status is rp.GripperStatus.MOVING


def test_a_trajectory_can_be_canceled_by_another_thread_while_it_is_sent(scene: rp.Scene) -> None:
    """The other thread waits for the end of `send`, so that no execution is lost."""
    sim, follow = rp.Simulation(scene), rp.JointTrajectoryController(ARM)
    sim.activate(follow)
    canceling = threading.Thread(target=follow.cancel)

    class Interrupted(rp.Trajectory):
        def __call__(self, *args: object, **options: object) -> np.ndarray:
            if canceling.ident is None:
                canceling.start()
                canceling.join(0.05)
            return super().__call__(*args, **options)

    rest = rp.Trajectory.rest(ARM, sim.configuration(), duration=1.0)
    execution = follow.send(Interrupted(rest.joint_names, rest.breaks, rest.coefficients))
    canceling.join(10.0)
    assert execution.status is rp.ExecutionStatus.CANCELED
    sim.step()
    assert not execution


@pytest.mark.parametrize("call", [lambda s: s.step(), lambda s: s.run(duration=1.0)])
def test_a_run_within_a_run_is_refused(scene: rp.Scene, call: Callable[[rp.Simulation], object]) -> None:
    class Impatient(rp.Controller):
        def update(self, state: rp.JointState) -> rp.SetPoint:
            call(sim)
            return rp.SetPoint(state.positions)

    sim = rp.Simulation(scene)
    stop = sim.on_step(call)
    with pytest.raises(rp.InputError, match="called while the simulation runs, by a callback or a controller"):
        sim.run(duration=0.1)
    stop()
    impatient = Impatient(ARM)
    sim.activate(impatient)
    with pytest.raises(rp.ControllerError, match=r"Impatient raised InputError at .*: step or run was called"):
        sim.step()
    sim.deactivate(impatient)
    assert sim.run(until=0.1)
    assert sim.steps == 50


def test_a_reset_belongs_between_steps_and_ends_before_the_end_of_a_run(scene: rp.Scene) -> None:
    class Restless(rp.Controller):
        def update(self, state: rp.JointState) -> rp.SetPoint:
            sim.reset()
            return rp.SetPoint(state.positions)

    sim = rp.Simulation(scene)
    stop = sim.on_step(lambda s: s.reset() if s.steps == 5 else None)
    assert sim.run(until=0.016) is False
    assert sim.steps == 3
    stop()
    sim.activate(Restless(ARM))
    with pytest.raises(rp.ControllerError, match="a controller called reset during a step; call it between steps"):
        sim.step()


def test_a_trajectory_ends_with_its_controller(scene: rp.Scene) -> None:
    """Waiting for its execution to end must not block forever."""
    follow, hold = rp.JointTrajectoryController(ARM), rp.ForwardPositionController(ARM)
    sim = rp.Simulation(scene)
    for swap in (lambda: sim.activate(hold, replace=True), lambda: sim.deactivate(follow)):
        sim.activate(follow, replace=True)
        now = scene.configuration()
        trajectory = rp.Trajectory.rest(ARM, sim.configuration(), duration=1.0)
        running, later = follow.send(trajectory), follow.send(trajectory, at=sim.time + 5.0)
        sim.run(duration=0.1)
        swap()
        assert running.status.terminal
        assert later.status is rp.ExecutionStatus.CANCELED
        with pytest.raises(rp.InputError, match="the controller is not active"):
            follow.send(trajectory)
        sim.run(duration=0.1)
        np.testing.assert_allclose(sim.configuration(), now, atol=1e-3)
    # An inactive controller can be activated again, in another simulation too.
    sim.activate(follow)
    execution = follow.send(rp.Trajectory.rest(ARM, sim.configuration(), duration=0.1))
    sim.run(duration=0.5)
    assert execution.status is rp.ExecutionStatus.SUCCEEDED


def test_a_callback_is_removed_once(scene: rp.Scene) -> None:
    sim, times = rp.Simulation(scene), list[float]()

    def note(s: rp.Simulation) -> None:
        times.append(s.time)

    first, second = sim.on_step(note), sim.on_step(note)
    first()
    first()
    sim.step()
    assert len(times) == 1
    second()
    sim.step()
    assert len(times) == 1


def test_the_current_scene_has_the_present_fingers(scene: rp.Scene) -> None:
    sim, grip = rp.Simulation(scene), rp.GripperController(["rr1/finger_joint"])
    assert sim.current_scene.arms["rr1"].robot is scene.arms["rr1"].robot
    sim.activate(grip)
    grip.command([0.5])
    sim.run(duration=1.0)
    finger = sim.state(["rr1/finger_joint"]).positions[0]
    assert finger == pytest.approx(0.5, abs=1e-3)
    now = sim.current_scene
    assert now.arms["rr1"].robot.locked_joints["finger_joint"] == finger
    # It may be extended and simulated further.
    before = sim.positions
    sim.update_scene(now.with_obstacle("ball", rp.Sphere(0.02), [2.0, 2.0, 1.0]))
    np.testing.assert_array_equal(sim.positions, before)
    sim.run(duration=0.1)
    np.testing.assert_allclose(sim.positions, before, atol=1e-4)
    assert sim.current_scene.arms["rr1"].robot.locked_joints["finger_joint"] == pytest.approx(finger, abs=1e-4)
    # Beyond its limit, as fingers that push may be slightly.
    upper = _limits(scene, "finger_joint")[1]
    sim.place(["rr1/finger_joint"], [upper + 0.001])
    assert sim.current_scene.arms["rr1"].robot.locked_joints["finger_joint"] == upper


def test_a_motion_can_be_planned_from_a_joint_that_sags_past_its_limit(scene: rp.Scene) -> None:
    """With an unknown payload servos are off by almost 1 mrad, and planners reject a start beyond a limit."""
    sim, names = rp.Simulation(scene, variation=rp.ArmVariation(payload=1.0)), scene.joint_names()
    upper = scene.limits().upper
    at_limit = scene.configuration()
    at_limit[4] = upper[4]
    sim.place(names, at_limit)
    sim.run(duration=0.2)
    assert 1e-4 < sim.configuration()[4] - upper[4] < 1e-3
    start = sim.current_scene.configuration()
    np.testing.assert_array_equal(start[4], upper[4])
    np.testing.assert_array_equal(np.delete(start, 4), np.delete(sim.configuration(), 4))
    arm = rp.JointTrajectoryController(names)
    sim.activate(arm)
    motion = rp.plan_motion(rp.Problem(sim.current_scene, start, start - [0.3, 0.0, 0.0, 0.0, 0.3, 0.0]))
    execution = arm.send(motion.trajectory)
    sim.run(duration=motion.trajectory.duration + 0.5)
    assert execution, execution
    # Farther beyond it is an arm that was placed there, which stays a fault of the start.
    sim.place(names[4:5], upper[4:5] + 0.02)
    assert sim.current_scene.configuration()[4] == upper[4] + 0.02


def test_huge_numbers_are_refused_and_warnings_collected(
    scene: rp.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    sim = rp.Simulation(scene.with_obstacle("cube", rp.Box((0.1, 0.1, 0.1)), [2.0, 0.0, 1.0], mass=0.2))
    sim.step(3)
    before = sim.positions
    for positions, velocities in (([1e300], None), ([0.0], [1e300])):
        name = "positions" if velocities is None else "velocities"
        with pytest.raises(rp.InputError, match=rf"{name} holds 1e\+300, expected at most 10000"):
            sim.place(ARM[:1], positions, velocities)
    with pytest.raises(rp.InputError, match=r"velocity holds 1e\+300, expected at most 10000"):
        sim.place_body("cube", [2.0, 0.0, 1.0], [1e300] * 6)
    np.testing.assert_array_equal(sim.positions, before)
    # MuJoCo warns when the state of these arms is set.
    light = rp.Simulation(scene, variation=rp.ArmVariation(mass=1e-300))
    light.reset()
    light.update_scene(scene)
    assert "close to singular" in light.warnings[0]
    sim.data.qvel[-1] = np.nan
    sim.place_body("cube", [2.0, 0.0, 1.0])
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr() == ("", "")


def test_simulations_on_threads_collect_their_own_warnings(
    scene: rp.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    running, ended = threading.Event(), threading.Event()
    quiet, loud = rp.Simulation(scene), rp.Simulation(scene)

    def wait(_: rp.Simulation) -> None:
        running.set()
        ended.wait(30.0)

    quiet.on_step(wait)
    thread = threading.Thread(target=quiet.step)
    thread.start()
    running.wait(30.0)
    loud.data.qvel[0] = np.nan
    try:
        with pytest.raises(rp.BackendError, match=r"unstable at 0\.002 s \(.*QPOS"):
            loud.step()
    finally:
        ended.set()
        thread.join()
    assert loud.warnings
    assert not quiet.warnings
    assert mujoco.get_mju_user_warning() is None
    assert list(tmp_path.iterdir()) == []


def test_warnings_of_models_on_threads_are_collected(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    far, robot = rp.Scene(), rp.planar_arm("RR")
    for k in range(61):
        far = far.with_arm(f"a{k}", robot, [10.0 * k, 0.0, 0.0])
    sim = rp.Simulation(far, threads=2)
    assert len(sim.tiles) > 1
    sim.tiles[-1].data.qvel[0] = np.nan
    with pytest.raises(rp.BackendError, match="QPOS"):
        sim.step()
    assert "QPOS" in sim.warnings[0]
    assert list(tmp_path.iterdir()) == []


def test_controllers_that_fail_are_named_and_nothing_moves(scene: rp.Scene) -> None:
    class Raises(rp.Controller):
        def update(self, state: rp.JointState) -> rp.SetPoint:
            raise ZeroDivisionError("no gain")

    class Nothing(rp.Controller):
        def update(self, state: rp.JointState) -> rp.SetPoint:
            return None

    class NotFinite(rp.Controller):
        def update(self, state: rp.JointState) -> rp.SetPoint:
            return rp.SetPoint(state.positions, np.full(len(state.positions), np.nan))

    class TooFew(rp.Controller):
        def update(self, state: rp.JointState) -> rp.SetPoint:
            return rp.SetPoint(state.positions[:-1])

    class Words(rp.Controller):
        def update(self, state: rp.JointState) -> rp.SetPoint:
            return rp.SetPoint(["home"] * 6)

    class NoPositions(rp.Controller):
        def update(self, state: rp.JointState) -> rp.SetPoint:
            return rp.SetPoint(None)

    class Ragged(rp.Controller):
        def update(self, state: rp.JointState) -> rp.SetPoint:
            return rp.SetPoint([[0.0], [0.0, 1.0]])

    class Overwrites(rp.Controller):
        def update(self, state: rp.JointState) -> rp.SetPoint:
            state.positions[:] = 0.0
            raise ValueError("no matter")

    messages = {Raises: "Raises raised ZeroDivisionError at 0.000 s: no gain", Nothing: "returned a NoneType"}
    messages |= {NotFinite: "velocities that are not finite", TooFew: r"positions of shape \(5,\).*expected \(6,\)"}
    messages |= {Words: "positions that are no numbers", Overwrites: "no matter"}
    messages |= {Ragged: "positions that are no numbers", NoPositions: r"positions of shape \(\)"}
    for kind, message in messages.items():
        sim = rp.Simulation(scene)
        sim.activate(kind(ARM))
        with pytest.raises(rp.ControllerError, match=message):
            sim.step()
        assert sim.steps == 0
        np.testing.assert_array_equal(sim.configuration(), scene.configuration())


def test_a_repeated_step_updates_each_controller_once(scene: rp.Scene) -> None:
    """Controllers before one that fails are not updated again when the step is repeated."""

    class FailsOnce(rp.Controller):
        failed = False

        def update(self, state: rp.JointState) -> rp.SetPoint:
            if not self.failed:
                self.failed = True
                raise OSError("no signal")
            return rp.SetPoint(state.positions)

    drift, flaky = rp.ForwardVelocityController(ARM[:1]), FailsOnce(ARM[1:])
    sim = rp.Simulation(scene)
    sim.activate(drift)
    sim.activate(flaky)
    drift.command([0.5])
    before = sim.set_points[0]
    with pytest.raises(rp.ControllerError, match="no signal"):
        sim.step()
    assert sim.set_points[0] == before
    sim.step()
    assert sim.set_points[0] == before + 0.5 * sim.dt
    sim.step()
    assert sim.set_points[0] == pytest.approx(before + 2 * 0.5 * sim.dt, abs=1e-12)


def test_a_step_is_repeated_without_the_controller_that_failed(scene: rp.Scene) -> None:
    class Fails(rp.Controller):
        def update(self, state: rp.JointState) -> rp.SetPoint:
            raise OSError("no signal")

    runs = []
    for fails in (True, False):
        follow, sim = rp.JointTrajectoryController(ARM[1:]), rp.Simulation(scene)
        sim.activate(follow)
        follow.send(motion(scene, ARM[1:], 0.1))
        sim.step(20)
        if fails:
            bad = Fails(ARM[:1])
            sim.activate(bad)
            with pytest.raises(rp.ControllerError, match="no signal"):
                sim.step()
            sim.deactivate(bad)
        sim.step(30)
        follow.send(motion(scene, ARM[1:], 0.1, 0.0), at=sim.time + 0.2)
        sim.step(5)
        runs.append((sim.positions.tobytes(), sim.set_points.tobytes()))
    assert runs[0] == runs[1]


def test_all_controllers_learn_of_passed_steps_if_one_fails(scene: rp.Scene) -> None:
    class Fails(rp.Controller):
        def update(self, state: rp.JointState) -> rp.SetPoint:
            return rp.SetPoint(np.zeros(1))

        def preview(self, times: rp.Array) -> rp.SetPoint:
            return rp.SetPoint(np.zeros((len(times), 1)))

        def passed(self, times: rp.Array, positions: rp.Array) -> None:
            raise OSError("disk full")

    follow, sim = rp.JointTrajectoryController(ARM[1:]), rp.Simulation(scene)
    sim.activate(Fails(ARM[:1]))
    sim.activate(follow)
    with pytest.raises(rp.ControllerError, match="disk full"):
        sim.step(8)
    # A trajectory may begin now, which the controller knows only if it was called.
    assert follow.send(motion(scene, ARM[1:])).start == sim.time


def test_a_controller_may_deactivate_itself(scene: rp.Scene) -> None:
    class Leaves(rp.Controller):
        def update(self, state: rp.JointState) -> rp.SetPoint:
            sim.deactivate(self)
            return rp.SetPoint(state.positions + 1.0)

    sim = rp.Simulation(scene)
    sim.activate(Leaves(ARM))
    sim.step(3)
    assert not sim.controllers
    np.testing.assert_array_equal(sim.set_points[: len(ARM)], scene.configuration())


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "own"])
def test_commands_need_an_active_controller(kind: str, scene: rp.Scene) -> None:
    with pytest.raises(rp.InputError, match="the controller is not active; activate it in a simulation first"):
        made(kind, scene)[1]()


@pytest.mark.parametrize(
    "make",
    [
        Sway,
        rp.JointTrajectoryController,
        rp.ForwardPositionController,
        rp.ForwardVelocityController,
        rp.GripperController,
        rp.ManualController,
        lambda names: rp.JointStateBroadcaster(names, print),
    ],
)
def test_controllers_without_joints_are_refused(make: Callable[[list[str]], object]) -> None:
    with pytest.raises(rp.InputError, match="joint_names is empty"):
        make([])


def test_bad_arguments_are_refused(scene: rp.Scene) -> None:
    for arguments in ({"dt": 0.0}, {"dt": math.nan}, {"threads": 0}, {"stiffness": -1.0}):
        with pytest.raises(rp.InputError, match=next(iter(arguments))):
            rp.Simulation(scene, **arguments)
    sim = rp.Simulation(scene)
    with pytest.raises(rp.UnknownNameError, match="rr1/elbow"):
        sim.activate(Sway(["rr1/elbow"]))
    with pytest.raises(rp.InputError, match="controller"):
        sim.activate(object())
    with pytest.raises(rp.InputError, match="speed"):
        sim.run(duration=1.0, speed=0.0)
    with pytest.raises(rp.InputError, match="host and a port"):
        rp.JointStateBroadcaster(ARM, ("127.0.0.1", 0))


def test_limits_are_those_of_the_arm_and_not_of_its_description(rr1: rp.Robot) -> None:
    own = replace(rr1.limits, velocity=np.full(6, 0.5), lower=rr1.limits.lower - 0.2, effort=np.full(6, 50.0))
    scene = rp.Scene().with_arm("arm", rr1.with_limits(own))
    names, sim = scene.joint_names(), rp.Simulation(scene)
    velocities = rp.ForwardVelocityController(names)
    sim.activate(velocities)
    with pytest.raises(rp.InputError, match=r"is commanded 0\.6 per second, above its limit"):
        velocities.command(np.full(6, 0.6))
    assert sim.effort_limits.tolist() == [*[50.0] * 6, 30.0, 30.0]  # fingers have those of the description
    positions, beyond = rp.ForwardPositionController(names), scene.configuration()
    beyond[1] = rr1.limits.lower[1] - 0.1
    sim.activate(positions, replace=True)
    positions.command(beyond)
    sim.run(duration=3.0)  # the step saturates the servos
    np.testing.assert_allclose(sim.configuration(), beyond, atol=1e-3)
    weak = scene.with_robot("arm", rr1.with_limits(replace(own, effort=np.full(6, 0.1))))
    motion = rp.retime(rp.Path(names, [scene.configuration(), beyond]), scene)
    assert rp.simulate(motion, scene)
    assert rp.simulate(motion, weak).peak_effort.max() == pytest.approx(1.0)


def test_fingers_keep_their_velocity_limit(scene: rp.Scene) -> None:
    gripper, sim = rp.GripperController(["rr1/finger_joint"], speed=100.0), rp.Simulation(scene)
    sim.activate(gripper)
    gripper.command([0.8])
    finger, seen = sim.joint_names.index("rr1/finger_joint"), [sim.set_points]
    sim.on_step(lambda now: seen.append(now.set_points))
    sim.run(duration=0.3)
    speeds = np.diff([row[finger] for row in seen]) / sim.dt
    limit = next(joint.velocity for joint in scene.arms["rr1"].robot.joints if joint.name == "finger_joint")
    assert speeds.max() == pytest.approx(limit)
