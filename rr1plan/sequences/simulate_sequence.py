"""Replay of a planned sequence in MuJoCo: objects are loose bodies held by fingers through friction only."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np

from rr1plan.checks import Array, check_callback, number_from_zero, of_kind, positive_number, read_only
from rr1plan.errors import InputError
from rr1plan.playback.simulation.joint_map import JointMap
from rr1plan.playback.simulation.mujoco_model import usual_stiffness
from rr1plan.playback.simulation.recorder import Recorder
from rr1plan.playback.simulation.simulation import Simulation, step_count
from rr1plan.playback.simulation.trajectory_controller import JointTrajectoryController
from rr1plan.progress import ProgressCallback, fraction_callback
from rr1plan.robot.link_masses import DENSITY, solid_inertial
from rr1plan.scene import Scene, pair
from rr1plan.sequences.grippers import finger_lever
from rr1plan.sequences.segments import Attach
from rr1plan.sequences.sequence_plan import SequencePlan
from rr1plan.sequences.sequence_replay import NEAR, CarriedObject, SequenceReplay
from rr1plan.transforms import rotation_angle, rotation_from_quaternion

# MuJoCo's contact dimension (condim) for tangential, torsional and rolling friction. Without the last, a cylinder that
# lies along a slope rolls away as soon as its axis deviates from the slope by a hundredth of a degree.
_ALL_FRICTION = 6
# Iterations of the no-slip solver, without which objects held by MuJoCo's soft contacts creep.
_NO_SLIP = 5
# Least inertia of a finger including its drive, at its tip [kg]. The gains of servos follow from the inertia, and
# fingers of a few grams would press with less than a newton.
_FINGER_INERTIA = 0.25
# Usual natural frequency of the joint servos [rad/s].
_STIFFNESS = 200.0
# Steps between two reports of progress.
_REPORT_EVERY = 50


def simulate_sequence(
    plan: SequencePlan,
    *,
    dt: float = 0.002,
    record_dt: float = 0.02,
    stiffness: float | None = None,
    hold: float = 0.5,
    progress: ProgressCallback | None = None,
) -> SequenceReplay:
    """Replay a planned sequence in MuJoCo, where fingers hold objects by contact and friction only.

    Objects that are attached or detached are loose bodies all the time. The mass of an object without one is computed
    from its shapes at 1000 kg/m³, with a remark. Their contacts also have torsional and rolling friction. Fingers have
    at least the inertia of a drive, 0.25 kg at their tips.

    Args:
        plan: The sequence, found.
        dt: Time of a step [s]. Held objects move outward in turns, by dt / 2 times the centripetal acceleration.
        record_dt: Time between recorded positions [s].
        stiffness: Natural frequency of the joint servos [rad/s]; that of the fingers determines the grasp force
            (default: 200, or 0.8 / dt if that is lower, because stiffer servos oscillate).
        hold: Time to continue after the end [s].
        progress: Called about ten times a second; False cancels.

    Raises:
        NoPlanError: there is no motion.
        InputError: numbers out of range, or an object that cannot be loose.
        BackendError: MuJoCo does not accept the scene, or its simulation became unstable.
        CancelledError: `progress` returned False.
    """
    of_kind("plan", plan, SequencePlan)
    check_callback("progress", progress)
    dt, record_dt = positive_number("dt", dt), positive_number("record_dt", record_dt)
    hold = number_from_zero("hold", hold)
    trajectory = plan.trajectory
    steps = step_count(trajectory.duration + hold, dt)
    scene, names, remarks = _physical(plan)
    stiffness = usual_stiffness(dt, _STIFFNESS) if stiffness is None else stiffness
    sim = Simulation(scene, dt, stiffness=stiffness)
    _hold_by_friction(sim, names)
    _drive_fingers(sim, plan, stiffness)
    report = fraction_callback("simulate", progress)

    def show_progress(sim: Simulation) -> None:
        if report is not None and sim.steps % _REPORT_EVERY == 0:
            report(sim.steps / steps)

    sim.on_step(show_progress)
    if trajectory.joint_names:
        controller = JointTrajectoryController(trajectory.joint_names, goal_tolerance=np.inf)
        sim.activate(controller)
        controller.send(trajectory)
    with Recorder(sim, record_dt) as recorder:
        sim.step(steps)
    replay = recorder.replay()
    of_arms = tuple(name for name in replay.joint_names if _is_arm_joint(plan, name))
    bodies = replay.record.bodies
    rows = {} if bodies is None else dict(zip(bodies.bodies, bodies.poses.swapaxes(0, 1), strict=True))
    objects = {name: _carried(plan, name, replay.record.times, rows[name]) for name in names}
    lost = [_where_lost(plan, one, replay.record.times, dt) for one in objects.values() if one.max_offset > NEAR]
    return SequenceReplay(replay, objects, of_arms, (*remarks, *lost, *replay.remarks))


def _physical(plan: SequencePlan) -> tuple[Scene, tuple[str, ...], tuple[str, ...]]:
    """The scene with loose objects and all contacts that a stage allows; the objects; assumptions."""
    scene, remarks = plan.scene, []
    names = plan.carried_names
    for name in names:
        if name in scene.attachments:
            scene = scene.detach(name)
    things = dict(scene.obstacles)
    for name in names:
        if things[name].mass is None:
            inertial = solid_inertial(things[name].geometries)
            if inertial is None:
                raise InputError(f"{name!r} has neither a mass nor a volume, so it cannot be simulated as a loose body")
            things[name] = replace(things[name], mass=inertial.mass)
            remarks.append(f"mass of {name!r} taken as {inertial.mass:.3g} kg, its volume at {DENSITY:g} kg/m³")
    touched = {
        pair(f"{stage.change.arm}/{link}", stage.change.obstacle)
        for stage in plan.events
        if isinstance(stage.change, Attach)
        for link in stage.change.touch or ()
        if scene.arm(scene.only_arm(stage.change.arm)).robot.link(link).collisions
    }
    allowed = scene.allowed.union(touched, *(stage.allowed for stage in plan.stages))
    return replace(scene, obstacles=things, allowed=allowed), names, tuple(remarks)


def _hold_by_friction(sim: Simulation, names: tuple[str, ...]) -> None:
    """Approximate dry friction, so that bodies neither creep nor turn freely between two fingers."""
    for tile in sim.tiles:
        tile.model.opt.noslip_iterations = _NO_SLIP
        held = [k for k, element in enumerate(tile.world.geom_elements) if element in names]
        tile.model.geom_condim[held] = _ALL_FRICTION
        # The no-slip solver needs matrices that are created with contacts; without them MuJoCo crashes.
        tile.refresh()


def _drive_fingers(sim: Simulation, plan: SequencePlan, stiffness: float) -> None:
    """Add the inertia of their drives to fingers, with servos of a natural frequency [rad/s], critically damped."""
    levers = _finger_levers(plan)
    for tile in sim.tiles:
        model, light = tile.model, False
        for column, name in enumerate(tile.world.joint_names):
            least, carried = _FINGER_INERTIA * levers.get(name, 0.0) ** 2, float(model.dof_M0[column])
            if carried < least:
                model.dof_armature[column] += least - carried
                # Not in proportion: servos of fingers of milligrams are based on more than the inertia they carry.
                model.actuator_biasprm[column, 1:3] = -least * stiffness * np.array([stiffness, 2.0])
                light = True
        if light:
            mujoco.mj_setConst(model, mujoco.MjData(model))
            tile.refresh()


def _finger_levers(plan: SequencePlan) -> dict[str, float]:
    """How far fingers travel for each unit of a joint that moves them [m/rad or m/m], by "arm/joint"."""
    joints, levers = JointMap(plan.scene), {}
    for i, (name, slides) in enumerate(zip(joints.names, joints.slides, strict=True)):
        leader = joints.followers.get(name, name)
        arm, joint = leader.split("/", 1)
        own = plan.gripper_joints.get(arm, ())
        rates = np.zeros(len(joints.names))
        rates[joints.index[leader]] = 1.0
        gain = abs(float(joints.follow(rates, rates=True)[i]))
        if joint in own and slides:
            levers[name] = 1.0
        elif own == (joint,) and gain > 0.0:
            levers[name] = finger_lever(plan.scene.arms[arm].robot, joint) / gain
    return levers


def _is_arm_joint(plan: SequencePlan, name: str) -> bool:
    """Whether a column belongs to an arm rather than to its gripper."""
    arm, joint = name.split("/", 1)
    return joint not in plan.gripper_joints.get(arm, ())


def _where_lost(plan: SequencePlan, one: CarriedObject, times: Array, dt: float) -> str:
    """When an object left its planned position in steps of `dt` [s], and what may help."""
    time = float(times[int(np.argmax(one.offsets > NEAR))])
    k = max((k for k, stage in enumerate(plan.stages) if stage.begin <= time), default=0)
    held = plan.scenes()[k].attachments.get(one.name)
    if held is None:
        why = "not held then: does it stand on something, and does nothing push it?"
    elif held.arm not in plan.gripper_joints:
        why = f"the gripper of {held.arm!r} does not move: only fingers that close hold objects here, not suction"
    elif usual_stiffness(dt, _STIFFNESS) < _STIFFNESS:
        why = f"take a smaller time step: in steps of {1e3 * dt:g} ms servos are softer and fingers press less"
    else:
        why = (
            "a firmer grasp may hold, by squeeze of MoveGripper or stiffness of the servos; if it moves outward in "
            "turns only, take a smaller time step"
        )
    return f"{one.name!r} is lost at {time:.2f} s ({plan.stages[k].label}): {why}"


def _carried(plan: SequencePlan, name: str, times: Array, coordinates: Array) -> CarriedObject:
    """The motion of an object, from its positions and quaternions (n, 7)."""
    poses = np.tile(np.eye(4), (len(times), 1, 1))
    poses[:, :3, 3] = coordinates[:, :3]
    poses[:, :3, :3] = [rotation_from_quaternion(row) for row in coordinates[:, 3:]]
    planned = plan.object_poses(name, times)
    offsets = np.linalg.norm(poses[:, :3, 3] - planned[:, :3, 3], axis=1)
    angle = rotation_angle(planned[-1, :3, :3].T @ poses[-1, :3, :3])
    return CarriedObject(name, read_only(poses), read_only(offsets), float(angle))
