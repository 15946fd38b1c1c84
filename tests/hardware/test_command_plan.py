"""Command plans: the emulated arm stays close to the motion, which is certified step by step."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

import rr1plan as rp


def test_commands_follow_the_motion_and_are_certified(motion: rp.MotionPlan, plan: rp.CommandPlan) -> None:
    assert plan
    assert plan.report.certified
    assert plan.path_report.certified
    assert "goal" not in plan.report.checked
    ends = motion.trajectory([motion.trajectory.start_time, motion.trajectory.end_time])
    # Within one or two steps of the coarsest joint, 1/14 degree each.
    np.testing.assert_allclose(plan.path.waypoints[[0, -1]], ends, atol=2.5e-3)
    samples = motion.trajectory(np.linspace(0.0, motion.trajectory.end_time, 50))
    path = plan.trajectory(np.linspace(0.0, plan.trajectory.end_time, 4000))
    nearest = np.abs(samples[:, None] - path).max(axis=2).min(axis=1)
    assert nearest.max() < 0.03


def test_the_path_is_that_of_an_emulator_that_gets_the_commands(
    plan: rp.CommandPlan, box: rp.ControlBox, calibration: rp.Calibration
) -> None:
    emulator, steps = rp.BoxEmulator(box), []
    for command in plan.commands:
        stepped = emulator.run(command)
        signs = dict(zip(("S1", "S2", "E1", "E2", "W1", "W2", "G"), np.sign(command.steps), strict=True))
        for tick in sorted({tick for ticks in stepped.values() for tick in ticks}):
            steps += [[signs[n] if tick in set(stepped.get(n, ())) else 0 for n in list(signs)[:6]]]
    counters = np.array(plan.start[:6]) + np.vstack([np.zeros(6), np.cumsum(steps, axis=0)])
    names = [name.split("/")[1] for name in plan.path.joint_names]
    np.testing.assert_allclose(plan.path.waypoints, calibration.positions(counters, names), atol=1e-12)


def test_the_trajectory_rests_between_commands_and_leaves_the_steps_by_little(plan: rp.CommandPlan) -> None:
    ends = np.cumsum(plan.ticks) * plan.box.tick
    assert plan.trajectory.end_time == pytest.approx(ends[-1])
    for derivative in (1, 2):
        np.testing.assert_allclose(plan.trajectory(ends - 1e-9, derivative), 0.0, atol=1e-6)
    # Two to three steps of the coarsest joint.
    assert plan.deviation.max() < 3.0 * np.radians(1.0 / 14.0)
    speeds = np.abs(np.gradient(plan.trajectory(times := np.linspace(0, ends[-1], 20001)), times[1], axis=0))
    np.testing.assert_allclose(speeds, np.abs(plan.trajectory(times, 1)), atol=2e-3)


def test_a_single_step_is_never_sent(plan: rp.CommandPlan) -> None:
    assert all(abs(steps) != 1 for command in plan.commands for steps in command.steps)


def test_high_safety_splits_long_commands(calibration: rp.Calibration, box: rp.ControlBox) -> None:
    scene = rp.Scene().with_arm("rr1", rp.load_robot("rr1"))
    q = np.array([[0.0, 0.0, 0.3, 0.0, 0.5, 0.0], [0.3, 0.0, 0.3, 0.0, 1.5, 0.0]])
    swing = rp.Trajectory.from_samples(scene.joint_names(), [0.0, 60.0], q, np.zeros((2, 6)))
    low = rp.plan_commands(swing, calibration, box, scene=scene, safety="low")
    high = rp.plan_commands(swing, calibration, box, scene=scene)
    assert len(low.commands) == 1
    assert len(high.commands) == 5
    assert max(abs(steps) for command in high.commands for steps in command.steps) <= 1024
    total = [sum(column) for column in zip(*(command.steps for command in high.commands), strict=True)]
    assert total == list(low.commands[0].steps)


def test_what_the_arm_would_hit_is_named_and_not_certified(
    motion: rp.MotionPlan, plan: rp.CommandPlan, calibration: rp.Calibration, box: rp.ControlBox
) -> None:
    middle = plan.trajectory(0.5 * plan.trajectory.end_time)
    at = motion.scene.link_poses({"rr1": middle})["rr1/tool"][:3, 3]
    blocked = rp.plan_commands(motion, calibration, box, scene=motion.scene.with_obstacle("ball", rp.Sphere(0.03), at))
    assert not blocked
    assert any(problem.startswith("collision") and "ball" in problem for problem in blocked.problems)
    assert "NOT CERTIFIED" in str(blocked)


def test_segments_follow_the_motion_more_closely_where_the_arm_would_collide(
    motion: rp.MotionPlan, calibration: rp.Calibration, box: rp.ControlBox
) -> None:
    empty = rp.Scene().with_arm("rr1", motion.scene.arms["rr1"].robot)
    alone = rp.plan_commands(motion, calibration, box, scene=empty, tolerance=0.16)
    around = rp.plan_commands(motion, calibration, box, tolerance=0.16)
    assert alone.certified
    assert around.certified
    assert len(around.commands) > len(alone.commands)


def test_other_arms_stand_where_the_trajectory_has_them(
    motion: rp.MotionPlan, calibration: rp.Calibration, box: rp.ControlBox
) -> None:
    """Not where the scene has them: here at a pole."""
    scene = motion.scene.with_arm("other", rp.load_robot("rr1"), [3.0, 0.0, 0.0])
    reaching = np.array([0.5, 0.3, 0.6, 0.0, 1.2, 0.0])
    at = scene.link_poses({"other": reaching})["other/tool"][:3, 3]
    scene = scene.with_obstacle("pole", rp.Sphere(0.03), at)
    names = scene.joint_names(["other"])
    for q, certified in ((scene.arms["other"].q, True), (reaching, False)):
        both = rp.Trajectory.merge(motion.trajectory, rp.Trajectory.rest(names, q))
        plan = rp.plan_commands(both, calibration, box, scene=scene)
        assert plan.arm == "rr1"
        assert plan.certified == certified
        assert certified or any("pole" in problem for problem in plan.problems)


def test_steps_that_are_larger_than_the_tolerance_are_refused(
    motion: rp.MotionPlan, calibration: rp.Calibration, box: rp.ControlBox
) -> None:
    """With a scale in steps per degree the joint would stay where it is, as all its motion is less than a step."""
    joints = {**calibration.joints, "elbow_joint": replace(calibration.joints["elbow_joint"], scale=1.0)}
    with pytest.raises(rp.InputError, match=r"a step of 'rr1/elbow_joint' is 1 rad, more than the tolerance 0.01"):
        rp.plan_commands(motion, replace(calibration, joints=joints), box)


def test_a_coarse_tolerance_gives_fewer_commands(
    motion: rp.MotionPlan, calibration: rp.Calibration, box: rp.ControlBox
) -> None:
    counts = [len(rp.plan_commands(motion, calibration, box, tolerance=t).commands) for t in (0.002, 0.02, 1.0)]
    assert counts[0] > counts[1] >= counts[2] > 0


def test_motions_to_joint_limits_are_not_rounded_beyond_them(calibration: rp.Calibration, box: rp.ControlBox) -> None:
    robot = rp.load_robot("rr1")
    scene = rp.Scene().with_arm("rr1", robot)
    for limit in (robot.limits.lower, robot.limits.upper):
        to_limits = np.where(np.arange(6) % 3 == 0, limit, robot.home)
        way = rp.retime(rp.Path(scene.joint_names(), [robot.home, to_limits]), scene, acceleration_scale=0.1)
        plan = rp.plan_commands(way, calibration, box, scene=scene)
        assert not plan.problems
        assert np.abs(plan.path.waypoints[-1] - to_limits).max() < 2.0 / 802.0  # less than two steps


def test_an_arm_that_stays_has_no_commands(calibration: rp.Calibration, box: rp.ControlBox) -> None:
    scene = rp.Scene().with_arm("rr1", rp.load_robot("rr1"))
    plan = rp.plan_commands(
        rp.Trajectory.rest(scene.joint_names(), scene.configuration()), calibration, box, scene=scene
    )
    assert plan.commands == ()
    assert plan.certified
    assert "0 commands for rr1" in str(plan)


@pytest.mark.parametrize(
    ("times", "turns"),
    [
        ([0.0, 3600.0, 3600.4, 3600.8], [0.0, 0.0, 0.3, 0.0]),  # a wave after a pause of an hour
        ([0.0, 0.5, 1.0, 1.5], [0.0, 0.3, 0.0, 0.3]),  # to and fro along a line, which its ends alone would span
        (range(801), [0.0, 0.1] * 400 + [0.0]),  # many waves
    ],
)
def test_motions_along_a_line_are_kept(
    times: list[float], turns: list[float], calibration: rp.Calibration, box: rp.ControlBox
) -> None:
    scene = rp.Scene().with_arm("rr1", rp.load_robot("rr1"))
    q = np.array([0.0, 0.0, 0.3, 0.0, 0.5, 0.0]) + np.outer(turns, np.eye(6)[4])
    swing = rp.Trajectory.from_samples(scene.joint_names(), times, q, np.zeros_like(q))
    plan = rp.plan_commands(swing, calibration, box, scene=scene, safety="low")
    wrist = calibration.joints["wrist_joint"].scale
    steps = [command.steps[4] for command in plan.commands]
    np.testing.assert_allclose(steps, wrist * np.diff(turns)[np.diff(turns) != 0.0], atol=1.0)


def test_locked_joints_have_to_be_where_the_certificate_has_them(
    motion: rp.MotionPlan, calibration: rp.Calibration, box: rp.ControlBox
) -> None:
    """Fingers that are not where they were certified may collide."""
    robot = motion.scene.arms["rr1"].robot.with_locked_joints({"finger_joint": 0.5})
    scene = motion.scene.with_robot("rr1", robot)
    swing = rp.Trajectory.from_samples(
        scene.joint_names(), [0.0, 2.0], scene.configuration() + 0.2 * np.eye(6)[[1, 0]], np.zeros((2, 6))
    )
    plan = rp.plan_commands(swing, calibration, box, scene=scene)
    fingers = round(float(calibration.readings([0.5], ["finger_joint"])[0]))
    assert fingers != 0
    assert plan.start[6] == fingers
    assert plan.certified, plan.problems
    assert plan.unchecked == {}
    start = dict(zip(box.channels, plan.start, strict=True))
    with pytest.raises(rp.HardwareError, match=f"G is at 0 steps, but the plan begins at {fingers}; nothing is sent"):
        rp.send_commands(plan, rp.EmulatedSerialLine(box, start | {"G": 0}))
    assert rp.send_commands(plan, rp.EmulatedSerialLine(box, start)).position[6] == fingers


def test_locked_joints_without_a_channel_are_listed_as_not_checked(
    motion: rp.MotionPlan, calibration: rp.Calibration, box: rp.ControlBox
) -> None:
    alone = rp.ControlBox({name: channel for name, channel in box.channels.items() if name != "G"}, box.tick)
    plan = rp.plan_commands(motion, calibration, alone)
    assert plan.unchecked == motion.scene.arms["rr1"].robot.locked_joints
    assert "finger_joint is assumed at 0 rad: no channel drives it, so that it is not checked" in str(plan)


@pytest.fixture
def sliding_box() -> rp.ControlBox:
    return rp.ControlBox({"S1": rp.BoxChannel("joint1", 4, 64), "S2": rp.BoxChannel("joint2", 4, 64)}, 0.000602)


def _sliding_plan(robot: rp.Robot, box: rp.ControlBox, shift: list[float]) -> rp.CommandPlan:
    scene = rp.Scene().with_arm("arm", robot)
    joints = {c.joint: rp.JointCalibration(1, 0.0, 4000.0, 1e-3, 1.0) for c in box.channels.values()}
    q = scene.configuration()
    swing = rp.Trajectory.from_samples(scene.joint_names(), [0.0, 2.0], [q, q + shift], np.zeros((2, len(q))))
    return rp.plan_commands(swing, rp.Calibration(robot.name, joints, "steps", source="made up"), box, scene=scene)


def test_a_locked_sliding_joint_is_assumed_at_meters(sliding_box: rp.ControlBox) -> None:
    gantry = rp.planar_arm("PP")
    one = np.array([[1.0], [0.0]])
    rail = replace(
        gantry,
        joint_names=("joint1",),
        limits=rp.Limits(*(getattr(gantry.limits, f.name) @ one for f in fields(gantry.limits))),
        configurations={"home": gantry.home @ one},
        locked_joints={"joint2": 0.25},
        presets={},
    )
    alone = rp.ControlBox({"S1": sliding_box.channels["S1"]}, sliding_box.tick)
    assert "joint2 is assumed at 0.25 m: no channel drives it" in str(_sliding_plan(rail, alone, [0.1]))


def test_deviations_of_sliding_joints_are_lengths(sliding_box: rp.ControlBox) -> None:
    plan = _sliding_plan(rp.planar_arm("RP"), sliding_box, [0.3, 0.1])
    degrees, millimeters = np.degrees(plan.deviation[0]), 1000.0 * plan.deviation[1]
    said = f"{degrees:.3f} degrees at most (arm/joint1) and {millimeters:.3f} mm at most (arm/joint2)"
    assert said in str(plan)


def test_links_without_a_collision_shape_are_named(
    motion: rp.MotionPlan, calibration: rp.Calibration, box: rp.ControlBox
) -> None:
    robot = motion.scene.arms["rr1"].robot
    hand = robot.link("hand_link")
    bare = replace(hand, visuals=hand.visuals or hand.collisions, collisions=())
    links = tuple(bare if link is hand else link for link in robot.links)
    scene = motion.scene.with_robot("rr1", replace(robot, links=links))
    said = str(rp.plan_commands(motion, calibration, box, scene=scene))
    assert "steps and ramps: VALID, certified free of collision in continuous time, EXCEPT FOR 1 link" in said
    assert "rr1/hand_link" in said


def test_without_a_measured_calibration_nothing_is_planned(
    motion: rp.MotionPlan, calibration: rp.Calibration, box: rp.ControlBox
) -> None:
    def refusal(**changes: object) -> str:
        with pytest.raises(rp.InputError) as caught:
            rp.plan_commands(motion, replace(calibration, **changes), box)
        return str(caught.value)

    joints = dict(calibration.joints)
    elbow = joints.pop("elbow_joint")
    assert "'elbow_joint' is not calibrated; nothing is guessed" in refusal(joints=joints)
    guessed = joints | {"elbow_joint": replace(elbow, scale_std=np.inf)}
    assert "scale of joint 'elbow_joint' is assumed" in refusal(joints=guessed)
    fingerless = {name: joint for name, joint in calibration.joints.items() if name != "finger_joint"}
    assert "'finger_joint' is not calibrated; nothing is guessed" in refusal(joints=fingerless)
    assert "readings in counts, expected steps" in refusal(unit="counts")
    assert "that of robot 'other'" in refusal(robot="other")
    with pytest.raises(rp.InputError, match="calibration is of type NoneType"):
        rp.plan_commands(motion, None, box)


def test_wrong_questions_are_refused(motion: rp.MotionPlan, calibration: rp.Calibration, box: rp.ControlBox) -> None:
    few = rp.ControlBox({"S1": box.channels["S1"]}, box.tick)
    with pytest.raises(rp.InputError, match="no channel of the control box drives joint 'upper_arm_joint'"):
        rp.plan_commands(motion, calibration, few)
    other = rp.ControlBox({**box.channels, "G": replace(box.channels["G"], joint="tail")}, box.tick)
    with pytest.raises(rp.InputError, match="channel G drives joint 'tail', which robot 'rr1' neither plans for nor"):
        rp.plan_commands(motion, calibration, other)
    with pytest.raises(rp.InputError, match="give the scene too"):
        rp.plan_commands(motion.trajectory, calibration, box)
    with pytest.raises(rp.UnknownNameError, match="unknown safety level 'none'"):
        rp.plan_commands(motion, calibration, box, safety="none")
    two = rp.Scene().with_arm("a", rp.load_robot("rr1")).with_arm("b", rp.load_robot("rr1"), [0.0, 2.0, 0.0])
    q = np.stack([two.configuration(), two.configuration() + 0.1])
    both = rp.Trajectory.from_samples(two.joint_names(), [0.0, 1.0], q)
    with pytest.raises(rp.InputError, match="the trajectory has no joints"):
        rp.plan_commands(rp.Trajectory.rest((), []), calibration, box, scene=two)
    with pytest.raises(rp.InputError, match="a and b move; a control box drives one arm"):
        rp.plan_commands(both, calibration, box, scene=two)
