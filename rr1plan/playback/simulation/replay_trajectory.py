"""Replay of a trajectory in MuJoCo.

Dynamic: a `Simulation` whose servos follow the trajectory, like a well-tuned arm.
Kinematic: the arms are placed at the configurations of the trajectory, and MuJoCo detects contacts.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import mujoco
import numpy as np

from rr1plan.checks import Array, check_callback, known_name, near_array, number_from_zero, of_kind, positive_number
from rr1plan.errors import InputError
from rr1plan.playback.simulation.arm_variation import ArmVariation
from rr1plan.playback.simulation.contact_log import ContactLog
from rr1plan.playback.simulation.controllers import Controller, JointState, SetPoint
from rr1plan.playback.simulation.joint_map import JointTargets
from rr1plan.playback.simulation.mujoco_model import build_mujoco, usual_stiffness
from rr1plan.playback.simulation.recorder import BodyLog
from rr1plan.playback.simulation.replay import BodyMotion, Replay, ReplayContact, ReplayRecord
from rr1plan.playback.simulation.replay_notes import replay_remarks, replay_settings
from rr1plan.playback.simulation.simulation import Simulation, step_count
from rr1plan.progress import ProgressCallback, fraction_callback
from rr1plan.robot.mujoco_warnings import mujoco_warnings
from rr1plan.scene import Scene
from rr1plan.scene.joint_units import joint_units
from rr1plan.trajectory import Trajectory

# A joint that moves more than this in one step is not tracked well [rad or m].
_LONG_STRIDE = 0.05
# Time between two reports of progress [s].
_REPORT_EVERY = 0.1
Mode = Literal["dynamic", "kinematic"]


def simulate(
    trajectory: Trajectory,
    scene: Scene,
    *,
    mode: Mode = "dynamic",
    dt: float = 0.002,
    record_dt: float = 0.01,
    stiffness: float | None = None,
    hold: float = 0.0,
    variation: ArmVariation | None = None,
    progress: ProgressCallback | None = None,
) -> Replay:
    """Replay a trajectory in MuJoCo, with the whole scene.

    Joint damping and friction of the description are ignored: they belong to the drives, whose controllers compensate
    them. The referee checks position limits.

    Args:
        trajectory: The motion; arms without columns hold their configuration in the scene.
        scene: The scene it was planned in.
        mode: "dynamic": servos drive the joints; "kinematic": the joints have their planned positions.
        dt: Time of a step [s].
        record_dt: Time between recorded positions [s].
        stiffness: Natural frequency of the joint servos [rad/s] (default: 160, or 0.8 / dt if that is lower, because
            stiffer servos oscillate).
        hold: Simulated time after the end, with constant set-points [s].
        variation: Differences of the arms from their description, unmodeled in the servos (default: none).
        progress: Called about ten times a second; False cancels.

    Returns:
        Tracking error, contacts, effort and speed; true if the arms followed the motion without contacts.

    Raises:
        InputError: a joint that the scene does not have, a step that is not above zero, an unknown mode, or a variation
            of a kinematic replay.
        BackendError: MuJoCo does not accept the scene, or its simulation became unstable.
        CancelledError: `progress` returned False.
    """
    known_name("replay mode", mode, ("dynamic", "kinematic"))
    check_callback("progress", progress)
    dt = positive_number("dt", dt)
    record_dt = positive_number("record_dt", record_dt)
    hold = number_from_zero("hold", hold)
    if hasattr(trajectory, "stages"):
        # In a replay of its trajectory alone, fingers would collide with the objects that they grasp.
        raise InputError("trajectory is the plan of a sequence, with objects to grasp; call simulate_sequence(plan)")
    of_kind("trajectory", trajectory, Trajectory)
    of_kind("scene", scene, Scene)
    of_kind("variation", variation, ArmVariation, optional=True)
    stiffness = usual_stiffness(dt) if stiffness is None else positive_number("stiffness", stiffness)
    if variation is not None and mode == "kinematic":
        raise InputError("variation has no effect on a kinematic replay, take the mode 'dynamic'")
    targets = JointTargets(trajectory, scene)
    steps = step_count(trajectory.duration + hold, dt)
    times = trajectory.start_time + dt * np.arange(steps + 1, dtype=np.float64)
    desired = targets(times)
    stride = max(1, round(min(record_dt / dt, len(times))))
    report = _reporter(fraction_callback("simulate", progress), steps)
    if mode == "dynamic":
        sim = Simulation(scene, dt, stiffness=stiffness, variation=variation)
        seen = _dynamic(sim, targets, _Steps(times, desired, stride), report)
    else:
        seen = _kinematic(scene, times, desired, dt, report)
    columns = targets.columns
    error = (seen.actual - desired)[:, columns]
    kept = np.unique(np.append(np.arange(0, len(times), stride), len(times) - 1))
    return Replay(
        mode=mode,
        joint_names=trajectory.joint_names,
        record=ReplayRecord(
            times[kept], desired[np.ix_(kept, columns)], seen.actual[np.ix_(kept, columns)], seen.bodies
        ),
        max_error=np.abs(error).max(axis=0),
        rms_error=np.sqrt((error**2).mean(axis=0)),
        peak_effort=seen.effort[columns],
        contacts=seen.contacts,
        steps=steps,
        timestep=dt,
        wall_seconds=seen.wall,
        settings=seen.settings,
        remarks=seen.remarks,
        units=tuple(joint_units(trajectory.joint_names, scene)),
    )


class _Seen(NamedTuple):
    """Observations of a replay: all joint positions, fractions of effort limits, contacts, settings, loose bodies."""

    actual: Array
    effort: Array
    contacts: tuple[ReplayContact, ...]
    remarks: tuple[str, ...]
    wall: float
    settings: dict[str, Any]
    bodies: BodyMotion | None = None


class _Steps(NamedTuple):
    """Times of steps [s], set-points of all joints at these times, number of steps between records of loose bodies."""

    times: Array
    desired: Array
    stride: int


class _Follow(Controller):
    """Follows a trajectory from the first step on, without checking limits, which the referee does."""

    def __init__(self, trajectory: Trajectory, times: Array) -> None:
        super().__init__(trajectory.joint_names)
        self._rates = [trajectory(times, derivative) for derivative in range(3)]

    def update(self, state: JointState) -> SetPoint:
        k = round(state.time / self.joints.dt)
        return SetPoint(*(rates[k] for rates in self._rates))


def _dynamic(sim: Simulation, targets: JointTargets, steps: _Steps, report: Callable[[int], None]) -> _Seen:
    """Simulate servos that move the arms."""
    times, desired = steps.times, steps.desired
    velocities = targets(times[:1], 1)[0]
    near_array("velocities at the start of the trajectory", velocities, velocities.shape)
    sim.place(targets.names, desired[0], velocities)
    bodies = BodyLog()
    bodies.add(sim)
    actual, effort = desired.copy(), np.zeros(len(targets.names))
    if targets.trajectory.joint_names:
        sim.activate(_Follow(targets.trajectory, times))

    def record(sim: Simulation) -> None:
        actual[sim.steps] = sim.positions
        np.maximum(effort, np.abs(sim.efforts), out=effort)
        if sim.steps % steps.stride == 0 or sim.steps == len(times) - 1:
            bodies.add(sim)
        report(sim.steps)

    sim.on_step(record)
    began = time.perf_counter()
    sim.step(len(times) - 1)
    wall = time.perf_counter() - began
    begin = float(times[0])
    contacts = tuple(replace(c, first=begin + c.first, last=begin + c.last) for c in sim.contacts)
    remarks = (*_long_stride(desired), *replay_remarks(sim))
    effort /= sim.effort_limits
    return _Seen(actual, effort, contacts, remarks, wall, replay_settings(sim), bodies.motion())


def _kinematic(scene: Scene, times: Array, desired: Array, dt: float, report: Callable[[int], None]) -> _Seen:
    """Place arms at their set-points, and detect contacts with MuJoCo."""
    contacts = ContactLog(1.5 * dt)
    with mujoco_warnings() as warnings:
        world = build_mujoco(scene, timestep=dt)
        model, data = world.model, mujoco.MjData(world.model)
        began = time.perf_counter()
        for k, q in enumerate(desired):
            data.qpos[: len(q)] = q  # loose bodies keep their poses
            mujoco.mj_kinematics(model, data)
            mujoco.mj_collision(model, data)
            if data.ncon:
                contacts.add(world, data, float(times[k]))
            report(k)
        wall = time.perf_counter() - began
    remarks = tuple(f"MuJoCo: {text}" for text in warnings)
    settings = {"mujoco": mujoco.__version__}
    return _Seen(desired, np.zeros(desired.shape[1]), contacts.intervals(), remarks, wall, settings)


def _reporter(progress: Callable[[float], None] | None, steps: int) -> Callable[[int], None]:
    """A function that reports the fraction of the steps done, about ten times a second."""
    last = 0.0

    def report(k: int) -> None:
        nonlocal last
        if progress is None or k % 16:
            return
        now = time.monotonic()
        if now - last > _REPORT_EVERY:
            last = now
            progress(k / steps)

    return report


def _long_stride(desired: Array) -> tuple[str, ...]:
    """A remark if set-points (n, joints) change too much per step."""
    stride = float(np.abs(np.diff(desired, axis=0)).max(initial=0.0))
    if stride <= _LONG_STRIDE:
        return ()
    return (f"joints move up to {stride:.2g} rad or m in a step, which costs accuracy: take a smaller time step",)
