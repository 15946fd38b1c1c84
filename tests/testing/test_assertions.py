"""Assertions for a user's tests: valid motions pass, and messages say what is wrong, where and when."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rr1plan as rp


@pytest.fixture(scope="module")
def motion() -> rp.MotionPlan:
    problem = next(iter(rp.load_problems("rr1_table").values()))
    scene = problem.scene.with_robot("rr1", problem.scene.arms["rr1"].robot.with_limits("hardware"))
    return rp.plan_motion(rp.Problem(scene, problem.start, dict(problem.goal)), rng=0)


@pytest.fixture(scope="module")
def blocked(motion: rp.MotionPlan) -> rp.Scene:
    """The scene with a ball at the final position of the tool."""
    end = motion.trajectory(motion.trajectory.end_time)
    return motion.scene.with_obstacle("ball", rp.Sphere(0.08), motion.scene.link_poses({"rr1": end})["rr1/tool"][:3, 3])


def failure_of(call, *args, **options) -> str:
    with pytest.raises(AssertionError) as caught:
        call(*args, **options)
    return str(caught.value)


# ---- assert_valid ----------------------------------------------------------------------------------


def test_a_certified_motion_is_valid(motion: rp.MotionPlan) -> None:
    report = rp.assert_valid(motion)
    assert report.certified
    assert "goal" in report.checked
    assert rp.assert_valid(motion.trajectory, motion.scene).certified


def test_a_motion_is_checked_now_whatever_report_it_carries(motion: rp.MotionPlan, blocked: rp.Scene) -> None:
    forged = replace(motion, _scene=blocked)
    assert forged
    said = failure_of(rp.assert_valid, forged)
    assert "the motion is not valid: collision: rr1/" in said
    assert "ball overlap by" in said
    assert " s" in said


@pytest.mark.parametrize("check", [rp.assert_valid, rp.assert_replays])
def test_pytest_shows_the_line_of_the_test(check, motion: rp.MotionPlan, blocked: rp.Scene) -> None:
    """Not the source of the assertion, in which the message would be lost."""
    with pytest.raises(AssertionError) as caught:
        check(motion.trajectory, blocked)
    assert all(entry.ishidden(caught) for entry in caught.traceback[1:])


def test_limits_goal_and_continuity_are_named(motion: rp.MotionPlan) -> None:
    fast = motion.trajectory.stretched(0.5)
    said = failure_of(rp.assert_valid, fast, motion.scene)
    assert "velocity: rr1/" in said.splitlines()[0]
    assert "limit" in said.splitlines()[0]
    other = rp.Problem(motion.scene, motion.problem.start, rp.JointGoal("home"))
    assert "goal:" in failure_of(rp.assert_valid, motion.trajectory, motion.scene, problem=other)


def test_a_path_without_times_is_certified(motion: rp.MotionPlan, blocked: rp.Scene) -> None:
    bare = replace(motion, _trajectory=None, _report=None)
    assert rp.assert_valid(bare).certified
    assert "ball overlap" in failure_of(rp.assert_valid, bare, blocked)


def test_a_failed_plan_is_no_motion(motion: rp.MotionPlan) -> None:
    problem = rp.Problem(motion.scene, "home", rp.PoseGoal("tool", [9.0, 0.0, 0.0]))
    failed = rp.plan_motion(problem, rng=0)
    assert "there is no motion: no plan" in failure_of(rp.assert_valid, failed)
    assert "infeasible" in failure_of(rp.assert_replays, failed)


def test_a_trajectory_needs_its_scene(motion: rp.MotionPlan) -> None:
    for check in (rp.assert_valid, rp.assert_replays):
        with pytest.raises(rp.InputError, match="give the scene too"):
            check(motion.trajectory)
    with pytest.raises(rp.InputError, match="has no times"):
        rp.assert_replays(replace(motion, _trajectory=None, _report=None))


# ---- assert_replays --------------------------------------------------------------------------------


def test_a_motion_replays_with_arms_as_described(motion: rp.MotionPlan) -> None:
    found = rp.assert_replays(motion, tolerance=1e-3)
    assert found.cases == (None,)
    assert found.passed == (True,)
    assert found.worst.worst_error < 1e-3


def test_contacts_errors_and_the_end_are_named(motion: rp.MotionPlan, blocked: rp.Scene) -> None:
    said = failure_of(rp.assert_replays, motion, blocked)
    assert "touch from" in said.splitlines()[0]
    assert "ball" in said.splitlines()[0]
    said = failure_of(rp.assert_replays, motion, tolerance=1e-7)
    assert "from its set-point at" in said
    assert "arms as described" in said
    sagging = rp.ReplayVariations(payload=0.5, count=2)
    said = failure_of(rp.assert_replays, motion, tolerance=1.0, goal_tolerance=1e-6, variations=sagging)
    assert "from the end of the motion, tolerance 1e-06, varied arms" in said


def test_the_worst_varied_arm_is_named_and_the_same_for_a_seed(motion: rp.MotionPlan) -> None:
    variations = rp.ReplayVariations(payload=1.0, mass=0.2, friction=0.001, count=5, rng=3)
    found = rp.assert_replays(motion, variations=variations, tolerance=0.1, goal_tolerance=0.1)
    assert len(found.replays) == 6
    errors = [replay.worst_error for replay in found.replays]
    assert found.worst_case == int(np.argmax(errors)) > 0
    assert errors[0] < min(errors[1:])
    again = rp.assert_replays(motion, variations=variations, tolerance=0.1, goal_tolerance=0.1)
    assert again.cases == found.cases
    assert [replay.worst_error for replay in again.replays] == errors
    said = failure_of(rp.assert_replays, motion, variations=variations, tolerance=1.5 * errors[0])
    number = found.worst_case
    assert f"varied arms {number} of 5 (payload {found.cases[number].payload:.3g} kg" in said


def test_arms_too_heavy_to_simulate_are_named() -> None:
    scene = rp.Scene().with_arm("rr1", rp.load_robot("rr1"))
    rest = np.zeros((2, 6))
    move = rp.Trajectory.from_samples(scene.joint_names(), [0.0, 1.0], [rest[0], rest[0] + 0.3], rest, rest)
    heavy = rp.ReplayVariations(payload=1e4, mass=0.0, count=1)
    with pytest.raises(rp.BackendError, match=r"^varied arms 1 of 1 \(payload 6.37e\+03 kg, .* became unstable"):
        rp.assert_replays(move, scene, tolerance=1e9, goal_tolerance=1e9, variations=heavy)


def test_variations_stay_within_their_bounds() -> None:
    cases = rp.ReplayVariations(payload=0.5, mass=0.1, friction=0.02, count=200, rng=1).cases()
    payloads, masses, frictions = np.array([(c.payload, c.mass, c.friction) for c in cases]).T
    assert 0.0 <= payloads.min() < 0.05
    assert 0.45 < payloads.max() <= 0.5
    assert 0.9 <= masses.min() < 0.92
    assert 1.08 < masses.max() <= 1.1
    assert 0.018 < frictions.max() <= 0.02


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"payload": -1.0}, "payload is -1.0, expected a number >= 0"),
        ({"mass": 1.0}, "expected a share below 1"),
        ({"payload": 1e9}, "payload is 1e.09 kg, expected at most 10000 kg"),
        ({"friction": np.nan}, "friction is nan"),
        ({"count": 0}, "count is 0, expected a whole number from 1"),
    ],
)
def test_wrong_variations_are_refused(options: dict[str, float], words: str) -> None:
    with pytest.raises(rp.InputError, match=words):
        rp.ReplayVariations(**options)


# ---- arms that differ from their description ---------------------------------------------------------


def test_a_variation_that_changes_nothing_replays_to_the_bit(motion: rp.MotionPlan) -> None:
    plain = rp.simulate(motion.trajectory, motion.scene)
    same = rp.simulate(motion.trajectory, motion.scene, variation=rp.ArmVariation())
    np.testing.assert_array_equal(same.record.actual, plain.record.actual)


def test_servos_do_not_know_of_a_payload_and_hold_it_by_an_error_that_follows_from_their_stiffness() -> None:
    """At rest the torque of the payload equals stiffness times error."""
    scene = rp.Scene().with_arm("rr1", rp.load_robot("rr1")).with_configuration("rr1", [0.0, 0.3, 0.8, 0.0, 0.9, 0.0])
    payload = 0.6
    sim = rp.Simulation(scene, variation=rp.ArmVariation(payload=payload))
    sim.run(duration=2.0)
    torque = rp.Kinematics(scene).jacobian(sim.configuration(), "tool")[2] * 9.81 * payload
    planned = [sim.joint_names.index(name) for name in scene.joint_names()]
    np.testing.assert_allclose(sim.efforts[planned] - _gravity(scene, sim), torque, atol=2e-3)


def _gravity(scene: rp.Scene, sim: rp.Simulation) -> np.ndarray:
    return rp.Kinematics(scene).gravity(sim.configuration())


# Poses of RR1, one after the other in 4 s each.
_POSES = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [-2.25, -0.39, 1.30, 0.05, 3.10, 1.25],
        [-0.35, -0.25, 1.15, -2.15, 1.80, -1.20],
        [1.40, 0.39, 0.95, 2.30, 2.65, -0.60],
        [-2.35, 0.32, -1.10, -1.50, 1.40, 0.50],
        [-0.80, -0.28, 0.70, 0.0, 2.10, -0.15],
        [-0.17, 0.37, -1.13, -1.14, 0.95, 1.09],
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    ]
)


@pytest.mark.parametrize(("payload", "tolerance"), [(0.0, 1e-3), (1.0, 5e-3)])
def test_seven_poses_are_followed_also_with_an_unknown_kilogram(payload: float, tolerance: float) -> None:
    scene = rp.Scene().with_arm("rr1", rp.load_robot("rr1"))
    still = np.zeros_like(_POSES)
    move = rp.Trajectory.from_samples(scene.joint_names(), 4.0 * np.arange(len(_POSES)), _POSES, still, still)
    replay = rp.simulate(move, scene, variation=rp.ArmVariation(payload=payload))
    assert replay.worst_error <= tolerance


@pytest.mark.parametrize("dt", [0.002, 0.005])
def test_friction_holds_joints_that_their_servos_cannot_move(dt: float) -> None:
    scene = rp.Scene().with_arm("rr1", rp.load_robot("rr1"))
    sim = rp.Simulation(scene, dt, variation=rp.ArmVariation(friction=0.05))
    stiffness = -sim.model.actuator_biasprm[: len(sim.joint_names), 1]
    friction = 0.05 * sim.effort_limits
    hold = rp.ForwardPositionController(sim.joint_names[:6])
    sim.activate(hold)
    start = sim.positions[:6]
    for share, moves in ((0.5, False), (2.0, True)):
        way = share * friction[:6] / stiffness[:6]
        hold.command(start + way)
        sim.run(duration=0.3)
        moved = (sim.positions[:6] - start) / way
        assert (moved > 0.3).all() if moves else (np.abs(moved) < 0.05).all()


def test_joints_without_an_effort_limit_have_no_friction() -> None:
    robot = rp.load_robot("planar2r")
    unlimited = replace(robot.limits, effort=np.full(robot.nq, np.inf))
    scene = rp.Scene().with_arm("arm", robot.with_limits(unlimited))
    for friction in (0.0, 0.1):
        varied = rp.Simulation(scene, variation=rp.ArmVariation(mass=1.1, friction=friction))
        assert not varied.model.dof_frictionloss.any()


def test_masses_and_friction_change_the_model_that_is_stepped_only() -> None:
    scene = rp.Scene().with_arm("rr1", rp.load_robot("rr1"))
    plain = rp.Simulation(scene)
    varied = rp.Simulation(scene, variation=rp.ArmVariation(mass=1.5, friction=0.1))
    np.testing.assert_allclose(varied.model.body_mass, 1.5 * plain.model.body_mass)
    np.testing.assert_allclose(varied.model.dof_frictionloss, 0.1 * plain.effort_limits)
    (tile,) = varied.tiles
    np.testing.assert_array_equal(tile.world.model.body_mass, plain.model.body_mass)


def test_a_kinematic_replay_takes_no_variation(motion: rp.MotionPlan) -> None:
    with pytest.raises(rp.InputError, match="no effect on a kinematic replay"):
        rp.simulate(motion.trajectory, motion.scene, mode="kinematic", variation=rp.ArmVariation())
    with pytest.raises(rp.InputError, match="mass is 0"):
        rp.ArmVariation(mass=0.0)
