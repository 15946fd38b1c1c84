"""Records of simulations: read while recording, frozen by `stop`, complete to the last instant, one clock."""

from __future__ import annotations

import signal
import sys
import threading

import numpy as np
import pytest

import rr1plan as rp


@pytest.fixture
def scene() -> rp.Scene:
    return rp.load_scene("rr1_table")


def following(scene: rp.Scene) -> rp.Simulation:
    """A simulation in which the arm turns its first joint by 0.3 rad within 0.2 s."""
    names, q = scene.joint_names(), scene.configuration()
    sim, follow = rp.Simulation(scene), rp.JointTrajectoryController(names)
    sim.activate(follow)
    still = np.zeros((2, len(names)))
    follow.send(rp.Trajectory.from_samples(names, [0.0, 0.2], [q, q + 0.3 * np.eye(len(names))[0]], still, still))
    return sim


def test_a_record_may_be_read_while_it_is_made(scene: rp.Scene) -> None:
    sim = following(scene)
    recorder = rp.Recorder(sim, 0.02)
    sim.step(25)
    early = recorder.replay()
    errors, times = early.max_error.copy(), early.record.times
    np.testing.assert_allclose(times, [0.0, 0.02, 0.04, 0.05], atol=1e-12)
    sim.step(25)
    late = recorder.replay()
    # Reading changed neither the earlier record nor the instants of the later one.
    np.testing.assert_array_equal(early.max_error, errors)
    np.testing.assert_allclose(late.record.times, [0.0, 0.02, 0.04, 0.06, 0.08, 0.1], atol=1e-12)
    assert (early.steps, late.steps) == (25, 50)
    assert (late.max_error >= errors).all()
    unread = following(scene)
    with rp.Recorder(unread, 0.02) as other:
        unread.step(50)
    np.testing.assert_array_equal(other.replay().record.desired, late.record.desired)
    np.testing.assert_array_equal(other.replay().rms_error, late.rms_error)


def test_a_replaced_body_is_not_recorded_as_another_one_of_its_record_name() -> None:
    """The body "part (2)", of the same shape, is another one."""
    thin, thick = (rp.Geometry("part", rp.Box((0.1, 0.1, height))) for height in (0.02, 0.04))
    scene = rp.Scene().with_obstacle("part", thin, [0.0, 0.0, 1.0], mass=0.1)
    scene = scene.with_obstacle("part (2)", thick, [1.0, 0.0, 1.0], mass=0.1)
    sim = rp.Simulation(scene)
    with rp.Recorder(sim) as recorder:
        sim.step(20)
        sim.update_scene(sim.current_scene.with_obstacle("part", thick, [2.0, 0.0, 1.0], mass=0.1))
        sim.step(20)
    bodies = recorder.replay().record.bodies
    assert bodies is not None
    across = {name: bodies.poses[[0, -1], i, 0] for i, name in enumerate(bodies.bodies)}
    np.testing.assert_allclose(across["part (2)"], 1.0)
    np.testing.assert_allclose(across["part (3)"], [np.nan, 2.0])


def test_what_happens_after_stop_is_not_in_the_record(scene: rp.Scene) -> None:
    sim = following(scene)
    with rp.Recorder(sim) as recorder:
        sim.step(100)
    steps, wall = recorder.replay().steps, recorder.replay().wall_seconds
    rms = recorder.replay().rms_error.copy()
    hand = sim.current_scene.link_poses()["rr1/hand_link"][:3, 3]
    sim.update_scene(scene.with_obstacle("post", rp.Sphere(0.02), hand))
    sim.step(900)
    assert sim.contacts
    replay = recorder.replay()
    assert replay.contacts == ()
    assert (replay.steps, steps) == (100, 100)
    assert replay.wall_seconds == wall
    np.testing.assert_array_equal(replay.rms_error, rms)
    assert replay.record.times[-1] == pytest.approx(0.2)
    recorder.stop()
    assert recorder.replay().steps == 100
    sim.reset()
    assert recorder.replay().steps == 100


def test_the_last_instant_is_recorded_with_its_bodies() -> None:
    scene = rp.Scene().with_obstacle("ball", rp.Sphere(0.05), [0.0, 0.0, 1.0], mass=0.2)
    sim = rp.Simulation(scene)
    with rp.Recorder(sim, 0.02) as recorder:
        sim.step(105)
    record = recorder.replay().record
    assert record.times[-1] == sim.time
    assert np.all(np.diff(record.times) > 0.0)
    assert record.bodies is not None
    assert len(record.bodies.poses) == len(record.times) == 12
    np.testing.assert_array_equal(record.bodies.poses[-1, 0], sim.body_coordinates("ball"))


def test_a_body_of_another_shape_under_the_same_name_is_recorded_as_another_body() -> None:
    ball = rp.Scene().with_arm("arm", rp.planar_arm("RR")).with_obstacle("part", rp.Sphere(0.1), [9, 0, 1], mass=1.0)
    box = ball.without_obstacle("part").with_obstacle("part", rp.Box((0.1, 0.2, 0.3)), [9, 0, 2], mass=1.0)
    sim = rp.Simulation(ball)
    with rp.Recorder(sim, 0.002) as recorder:
        sim.step(5)
        for scene in (box, ball):
            sim.update_scene(scene)
            sim.step(5)
    bodies = recorder.replay().record.bodies
    assert bodies is not None
    assert {name: body.geometries[0].shape for name, body in bodies.bodies.items()} == {
        "part": rp.Sphere(0.1),
        "part (2)": rp.Box((0.1, 0.2, 0.3)),
    }
    assert np.isnan(bodies.poses[:, :, 0]).T.tolist() == [
        [False] * 6 + [True] * 5 + [False] * 5,
        [True] * 6 + [False] * 5 + [True] * 5,
    ]


def test_a_body_that_an_arm_takes_is_recorded_in_its_hand(scene: rp.Scene) -> None:
    cube = rp.transforms.pose([-0.3, 0.25, 0.4], rpy=[0.1, 0.2, 0.3])
    sim = following(scene.with_obstacle("cube", rp.Box((0.03, 0.03, 0.03)), cube, mass=0.1))
    with rp.Recorder(sim) as recorder:
        sim.run(duration=0.1)
        sim.update_scene(sim.current_scene.attach("cube", "rr1"))
        sim.run(duration=0.2)
        carried = sim.current_scene.detach("cube")
        sim.update_scene(carried)
        sim.run(duration=0.1)
    bodies = recorder.replay().record.bodies
    assert bodies is not None
    assert np.isfinite(bodies.poses).all()
    at = carried.obstacles["cube"].pose
    np.testing.assert_allclose(bodies.poses[15, 0], rp.transforms.position_and_quaternion(at), atol=1e-9)


def test_the_last_instant_has_the_set_points_of_the_last_step(scene: rp.Scene) -> None:
    sim = following(scene)
    with rp.Recorder(sim, 0.02) as recorder:
        sim.step(45)
    record = recorder.replay().record
    columns = [sim.joint_names.index(name) for name in scene.joint_names()]
    assert record.times[-1] == pytest.approx(0.09)
    np.testing.assert_array_equal(record.desired[-1], sim.set_points[columns])
    np.testing.assert_array_equal(record.actual[-1], sim.positions[columns])


def test_a_reset_while_recording_is_refused(scene: rp.Scene) -> None:
    sim = following(scene)
    sim.step(10)
    with rp.Recorder(sim) as recorder:
        sim.step(30)
        sim.reset()
        with pytest.raises(rp.InputError, match=r"reset.*call Recorder\.stop first"):
            recorder.replay()
        for _ in range(50):  # beyond the time of the reset
            with pytest.raises(rp.InputError, match=r"reset.*call Recorder\.stop first"):
                sim.step()
    with pytest.raises(rp.InputError, match="reset"):
        recorder.replay()
    sim.step(10)  # the simulation itself continues
    assert sim.steps == 60


def test_a_reset_just_before_stop_is_refused(scene: rp.Scene) -> None:
    sim = following(scene)
    recorder = rp.Recorder(sim)
    sim.step(30)
    sim.reset()
    recorder.stop()
    sim.step(50)
    with pytest.raises(rp.InputError, match="reset"):
        recorder.replay()


def test_an_error_of_another_callback_is_no_reset(scene: rp.Scene) -> None:
    def fail(sim: rp.Simulation) -> None:
        if sim.steps == 25:
            raise RuntimeError("out of paper")

    sim = following(scene)
    sim.on_step(fail)
    with rp.Recorder(sim) as recorder, pytest.raises(RuntimeError):
        sim.step(50)
    assert recorder.replay().steps == 24
    assert recorder.replay().record.times[-1] == pytest.approx(0.04)


def test_a_record_may_be_read_by_another_thread(scene: rp.Scene) -> None:
    """The last instant, which a reader adds for itself, once stayed in the record in place of a later one."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        sim = rp.Simulation(scene.with_obstacle("ball", rp.Sphere(0.02), [0.5, 0.5, 0.9], mass=0.1))
        recorder = rp.Recorder(sim, 0.02)
        runner = threading.Thread(target=sim.run, kwargs={"duration": 1.5})
        runner.start()
        while runner.is_alive():
            record = recorder.replay().record
            assert (np.diff(record.times) > 0.0).all()
            assert record.bodies is not None
            assert len(record.bodies.poses) == len(record.times)
        runner.join()
    finally:
        sys.setswitchinterval(before)
    np.testing.assert_allclose(recorder.replay().record.times, 0.02 * np.arange(76), atol=1e-9)
    recorder.stop()


def test_a_recorder_may_be_made_by_another_thread(scene: rp.Scene) -> None:
    """It once ended the run, when it was made between a step and the calls after it."""
    sim = rp.Simulation(scene)
    made: list[rp.Recorder] = []

    def make(_: rp.Simulation) -> None:
        if not made:
            thread = threading.Thread(target=lambda: made.append(rp.Recorder(sim)))
            thread.start()
            thread.join()

    sim.on_step(make)
    sim.step(11)
    record = made[0].replay().record
    np.testing.assert_allclose(record.times, [0.002, 0.022], atol=1e-12)


def test_a_callback_of_another_thread_begins_with_the_next_step(scene: rp.Scene) -> None:
    sim, seen = rp.Simulation(scene), []

    def add(_: rp.Simulation) -> None:
        if sim.steps == 1:
            sim.on_step(lambda now: seen.append(now.steps))

    sim.on_step(add)
    sim.step(3)
    assert seen == [2, 3]


def test_a_record_has_the_settings_and_remarks_of_a_replay(scene: rp.Scene) -> None:
    still = rp.Trajectory.rest(scene.joint_names(), scene.configuration(), duration=0.01)
    heavy = rp.ArmVariation(payload=0.5)
    replay = rp.simulate(still, scene, stiffness=1e4, variation=heavy)
    assert "may oscillate" in replay.remarks[0]
    assert replay.settings["payload"] == 0.5
    sim = rp.Simulation(scene, stiffness=1e4, variation=heavy)
    with rp.Recorder(sim) as recorder:
        sim.step(5)
    assert (recorder.replay().settings, recorder.replay().remarks) == (replay.settings, replay.remarks)


class Pressing(rp.ForwardVelocityController):
    """Ctrl-C in the middle of a step.

    Args:
        names: The joints.
        at: The step.
        times: How often.
    """

    def __init__(self, names: tuple[str, ...], at: int, times: int) -> None:
        super().__init__(names)
        self.left, self._at = times, at

    def update(self, state: rp.JointState) -> rp.SetPoint:
        point = super().update(state)
        while self.left and round(state.time / self.joints.dt) == self._at:
            self.left -= 1
            signal.raise_signal(signal.SIGINT)
        return point


def pressed(scene: rp.Scene, times: int) -> tuple[rp.Simulation, rp.Recorder]:
    sim, names = rp.Simulation(scene), scene.joint_names()
    press = Pressing(names, 5, times)
    sim.activate(press)
    press.command([0.1] * len(names))
    return sim, rp.Recorder(sim, 0.004)


def test_after_ctrl_c_a_run_goes_on_as_if_it_had_not_been_interrupted(scene: rp.Scene) -> None:
    before = signal.getsignal(signal.SIGINT)
    (sim, recorder), (other, whole) = pressed(scene, 1), pressed(scene, 0)
    with pytest.raises(KeyboardInterrupt):
        sim.run(duration=0.04)
    assert sim.steps == 6
    assert signal.getsignal(signal.SIGINT) is before
    sim.run(until=0.04)
    other.run(until=0.04)
    np.testing.assert_array_equal(sim.positions, other.positions)
    np.testing.assert_array_equal(recorder.replay().record.desired, whole.replay().record.desired)


def test_a_second_ctrl_c_ends_a_controller_at_once(scene: rp.Scene) -> None:
    sim, _ = pressed(scene, 2)
    with pytest.raises(KeyboardInterrupt):
        sim.run(duration=0.04)
    assert sim.steps == 5
