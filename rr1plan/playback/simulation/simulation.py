"""Replay of a trajectory in MuJoCo.

Dynamic: each joint has a servo with position and velocity set-points and a torque feed-forward
from inverse dynamics, updated at every step; what comes out is what a well-tuned arm would do.
Kinematic: the arms are put where the trajectory says, and MuJoCo says what touches.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

import mujoco
import numpy as np

from rr1plan.checks import Array, check_callback, finite_number, known_name, of_kind, positive_number
from rr1plan.errors import BackendError, InputError, UnknownNameError
from rr1plan.playback.simulation.mujoco_model import MujocoScene, build_mujoco
from rr1plan.playback.simulation.replay import Replay, ReplayContact
from rr1plan.progress import ProgressCallback, fraction_callback
from rr1plan.robot import Joint
from rr1plan.robot.mujoco_warnings import mujoco_warnings
from rr1plan.scene import Scene
from rr1plan.trajectory import Trajectory

_UNSTABLE = [int(getattr(mujoco.mjtWarning, f"mjWARN_BAD{what}")) for what in ("QPOS", "QVEL", "QACC", "CTRL")]
# More steps than this take hours and more memory than there is.
_MOST_STEPS = 5_000_000
# A joint that moves more than this in one step is not tracked well [rad or m].
_LONG_STRIDE = 0.05
_MOST_STIFFNESS = 1e6  # [rad/s]
Mode = Literal["dynamic", "kinematic"]


def simulate(
    trajectory: Trajectory,
    scene: Scene,
    *,
    mode: Mode = "dynamic",
    timestep: float = 0.002,
    record_dt: float = 0.01,
    stiffness: float = 80.0,
    hold: float = 0.0,
    progress: ProgressCallback | None = None,
) -> Replay:
    """Replay a trajectory in MuJoCo, the whole scene at once.

    Joint damping and friction of the description are left out: they belong to a drive, whose
    controller compensates them. Position limits are the referee's to check.

    Args:
        trajectory: The motion; arms without columns hold their configuration of the scene.
        scene: The scene it was planned in.
        mode: "dynamic" or "kinematic".
        timestep: Step of the simulator [s].
        record_dt: Time between recorded positions [s].
        stiffness: Natural frequency of the joint servos [rad/s].
        hold: How long to go on after the end, the set-points resting there [s].
        progress: Called about ten times a second; False cancels.

    Returns:
        Tracking error, contacts, effort and speed; true where the arms followed the motion without contact.

    Raises:
        InputError: a joint the scene does not have, a step that is not above zero, a mode we don't know.
        BackendError: MuJoCo does not take the scene, or its simulation became unstable.
        CancelledError: `progress` returned False.
    """
    known_name("replay mode", mode, ("dynamic", "kinematic"))
    check_callback("progress", progress)
    timestep = positive_number("timestep", timestep)
    record_dt = positive_number("record_dt", record_dt)
    hold = finite_number("hold", hold)
    if hold < 0.0:
        raise InputError(f"hold is {hold}, expected a time >= 0")
    of_kind("trajectory", trajectory, Trajectory)
    of_kind("scene", scene, Scene)
    targets = JointTargets(trajectory, scene)
    if trajectory.duration + hold > _MOST_STEPS * timestep:
        raise InputError(f"{trajectory.duration + hold:g} s in steps of {timestep:g} s are too many; take longer steps")
    steps = max(1, int(np.ceil((trajectory.duration + hold) / timestep - 1e-9)))
    with mujoco_warnings() as warnings:
        world = build_mujoco(scene, timestep=timestep, stiffness=_bounded_stiffness(stiffness))
        times = trajectory.start_time + timestep * np.arange(steps + 1, dtype=np.float64)
        run = _Run(world, targets, times, fraction_callback("simulate", progress), warnings)
        started = time.perf_counter()
        (run.dynamic if mode == "dynamic" else run.kinematic)()
    return _report(mode, run, record_dt, time.perf_counter() - started, stiffness)


class JointTargets:
    """Where every movable joint of a scene has to be: planned, locked, mimicking and resting ones.

    Args:
        trajectory: The motion of some arms.
        scene: The scene.

    Raises:
        UnknownNameError: a column of the trajectory is no joint of the scene.
        InputError: only some joints of an arm have columns.
    """

    def __init__(self, trajectory: Trajectory, scene: Scene) -> None:
        known = scene.joint_names()
        for name in trajectory.joint_names:
            if name not in known:
                raise UnknownNameError("joint", name, known)
        missing = [n for n in scene.joint_names(trajectory.arms) if n not in trajectory.joint_names]
        if missing:
            raise InputError(f"the trajectory moves {', '.join(trajectory.arms)} but has no column for {missing[0]!r}")
        self.trajectory = trajectory
        self.scene = scene
        movable = [(a, j) for a, arm in scene.arms.items() for j in arm.robot.joints if j.kind != "fixed"]
        self.names = tuple(f"{a}/{j.name}" for a, j in movable)
        self._factor = np.zeros((len(movable), len(trajectory.joint_names)))
        self._offset = np.zeros(len(movable))
        for row, (arm, joint) in enumerate(movable):
            self._fill(row, arm, joint)

    def _fill(self, row: int, arm: str, joint: Joint) -> None:
        """One row of the affine map from columns to joints, following a chain of mimics."""
        robot = self.scene.arms[arm].robot
        factor, offset = 1.0, 0.0
        while joint.mimic is not None and joint.name not in robot.joint_names and joint.name not in robot.locked_joints:
            offset += factor * joint.mimic.offset
            factor *= joint.mimic.multiplier
            joint = robot.joint(joint.mimic.joint)
        column = f"{arm}/{joint.name}"
        if column in self.trajectory.joint_names:
            self._factor[row, self.trajectory.joint_names.index(column)] = factor
            self._offset[row] = offset
        else:
            self._offset[row] = factor * robot.joint_values(self.scene.arms[arm].q)[joint.name] + offset

    def __call__(self, times: Array, derivative: int = 0) -> Array:
        """Positions (or rates) of all movable joints at `times`, shape (n, joints)."""
        rates = self.trajectory(times, derivative) @ self._factor.T
        return np.asarray(rates + self._offset if derivative == 0 else rates)


@dataclass
class _Run:
    """One pass through the simulator, and what it leaves behind."""

    world: MujocoScene
    targets: JointTargets
    times: Array
    progress: Callable[[float], None] | None
    warnings: list[str]
    actual: Array = field(init=False)
    effort: Array = field(init=False)
    contacts: dict[tuple[str, str], list[ReplayContact]] = field(default_factory=dict)
    _told: float = 0.0

    def __post_init__(self) -> None:
        self.desired = self.targets(self.times)
        self.actual = self.desired.copy()
        self.effort = np.zeros(len(self.targets.names))

    def dynamic(self) -> None:
        """Step the physics, set-points and feed-forward updated at each step."""
        model = self.world.model
        data = mujoco.MjData(model)
        velocity = self.targets(self.times, 1)
        feedforward = self._feedforward(velocity)
        control = np.stack([self.desired, velocity, feedforward], axis=2).reshape(len(self.times), -1)
        limit = self.world.effort_limits
        data.qpos[:] = self.desired[0]
        data.qvel[:] = velocity[0]
        for k in range(len(self.times) - 1):
            data.ctrl[:] = control[k]
            mujoco.mj_step(model, data)
            if data.warning.number[_UNSTABLE].any():
                said = f" ({self.warnings[-1]})" if self.warnings else ""
                raise BackendError(
                    f"MuJoCo's simulation became unstable at {self.times[k]:.3f} s{said}; "
                    "try a smaller timestep or a slower motion"
                )
            self.actual[k + 1] = data.qpos
            np.maximum(self.effort, np.abs(data.actuator_force) / limit, out=self.effort)
            if data.ncon:
                self._note(data, self.times[k])
            self._tell(k)

    def kinematic(self) -> None:
        """Put the arms where they should be and ask what touches."""
        model = self.world.model
        data = mujoco.MjData(model)
        for k, q in enumerate(self.desired):
            data.qpos[:] = q
            mujoco.mj_kinematics(model, data)
            mujoco.mj_collision(model, data)
            if data.ncon:
                self._note(data, self.times[k])
            self._tell(k)

    def _feedforward(self, velocity: Array) -> Array:
        """Torques of the wanted motion by MuJoCo's inverse dynamics, shape (n, joints)."""
        model = self.world.model
        flags = model.opt.disableflags
        model.opt.disableflags = flags | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        data = mujoco.MjData(model)
        acceleration = self.targets(self.times, 2)
        torque = np.empty_like(velocity)
        for k in range(len(self.times)):
            data.qpos[:] = self.desired[k]
            data.qvel[:] = velocity[k]
            data.qacc[:] = acceleration[k]
            mujoco.mj_inverse(model, data)
            torque[k] = data.qfrc_inverse
        model.opt.disableflags = flags
        return torque

    def _note(self, data: Any, t: float) -> None:
        """Add the contacts of this instant to the intervals of their pairs."""
        elements = self.world.geom_elements
        gap = 1.5 * (self.times[1] - self.times[0]) if len(self.times) > 1 else 0.0
        for (first, second), distance in zip(data.contact.geom, data.contact.dist, strict=True):
            if distance > 0.0:
                continue
            a, b = sorted((elements[first], elements[second]))
            intervals = self.contacts.setdefault((a, b), [])
            if intervals and t - intervals[-1].last <= gap:
                last = intervals.pop()
                intervals.append(ReplayContact((a, b), last.first, float(t), max(last.depth, -float(distance))))
            else:
                intervals.append(ReplayContact((a, b), float(t), float(t), -float(distance)))

    def _tell(self, k: int) -> None:
        if self.progress is not None and k % 16 == 0:
            now = time.monotonic()
            if now - self._told > 0.1:
                self._told = now
                self.progress(k / len(self.times))


def _bounded_stiffness(value: float) -> float:
    if positive_number("stiffness", value) > _MOST_STIFFNESS:
        raise InputError(f"stiffness is {value}, expected at most {_MOST_STIFFNESS:g} rad/s")
    return float(value)


def _report(mode: Mode, run: _Run, record_dt: float, wall: float, stiffness: float) -> Replay:
    names = run.targets.trajectory.joint_names
    columns = [run.targets.names.index(name) for name in names]
    error = run.actual[:, columns] - run.desired[:, columns]
    timestep = float(run.times[1] - run.times[0])
    stride = max(1, round(min(record_dt / timestep, len(run.times))))
    record = np.unique(np.append(np.arange(0, len(run.times), stride), len(run.times) - 1))
    contacts = sorted((c for intervals in run.contacts.values() for c in intervals), key=lambda c: c.first)
    return Replay(
        mode=mode,
        joint_names=names,
        times=run.times[record],
        desired=run.desired[record][:, columns],
        actual=run.actual[record][:, columns],
        max_error=np.abs(error).max(axis=0),
        rms_error=np.sqrt((error**2).mean(axis=0)),
        peak_effort=run.effort[columns],
        contacts=tuple(contacts),
        steps=len(run.times) - 1,
        timestep=timestep,
        wall_seconds=wall,
        settings={"mujoco": mujoco.__version__, "integrator": "implicitfast", "stiffness": stiffness},
        remarks=(*(_remarks(run) if mode == "dynamic" else ()), *(f"MuJoCo: {text}" for text in run.warnings)),
    )


def _remarks(run: _Run) -> tuple[str, ...]:
    """What the description or the step lacks for the physics, in words."""
    arms = run.targets.scene.arms.items()
    links = [f"{name}/{link}" for name, arm in arms for link in arm.robot.links_of_assumed_mass]
    found = []
    if links:
        found.append(f"masses estimated from shapes: {', '.join(links)}")
    if run.world.massless_joints:
        found.append(f"joints that carry no mass: {', '.join(run.world.massless_joints)}")
    stride = float(np.abs(np.diff(run.desired, axis=0)).max(initial=0.0))
    if stride > _LONG_STRIDE:
        found.append(f"joints move up to {stride:.2g} rad in a step, which costs accuracy: take a smaller timestep")
    return tuple(found)
