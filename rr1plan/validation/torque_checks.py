"""Torque limits, by Pinocchio's inverse dynamics, at samples in time."""

from __future__ import annotations

import numpy as np

from rr1plan.checks import Array
from rr1plan.model.forward_kinematics import Kinematics
from rr1plan.report import Margin, Violation
from rr1plan.scene import Scene
from rr1plan.trajectory import Trajectory
from rr1plan.validation.limit_checks import Findings

_STEP = 1e-3
_MOST_SAMPLES = 20_000
# Rounding error tolerated at a limit, relative to it.
_ROUNDING = 1e-9


def check_torques(findings: Findings, trajectory: Trajectory, scene: Scene) -> None:
    """Check torques of all moving joints at the breaks and about every millisecond between them."""
    limits = scene.limits(trajectory.arms).effort
    if not np.isfinite(limits).any():
        findings.not_checked["torque"] = "no joint has a limit for it"
        return
    kinematics = Kinematics(scene, trajectory.arms)
    order = [trajectory.joint_names.index(name) for name in scene.joint_names(trajectory.arms)]
    step = max(_STEP, trajectory.duration / _MOST_SAMPLES)
    times = np.unique(np.concatenate([trajectory.sample_times(step), trajectory.breaks]))
    q, qd, qdd = (trajectory(times, k)[:, order] for k in range(3))
    _judge(findings, kinematics.joint_names, kinematics.inverse_dynamics(q, qd, qdd), limits, times)
    findings.checked.append("torque")
    findings.not_checked["torque between samples"] = f"sampled every {1000.0 * step:.3g} ms and at the breaks"
    for name, held in scene.attachments.items():
        if held.arm in trajectory.arms and held.mass is None:
            findings.not_checked[f"mass of {name}"] = "not given, treated as weightless"
    for arm in trajectory.arms:
        for link in scene.arms[arm].robot.links_of_assumed_mass:
            findings.not_checked[f"mass of {arm}/{link}"] = "not given, estimated from its shape"
    findings.statistics["torque_samples"] = float(len(times))


def _judge(findings: Findings, names: tuple[str, ...], torques: Array, limits: Array, times: Array) -> None:
    for j, name in enumerate(names):
        i = int(np.argmax(np.abs(torques[:, j])))
        value, time, bound = float(abs(torques[i, j])), float(times[i]), float(limits[j])
        if not np.isfinite(bound):
            continue
        if "torque" not in findings.margins or value / bound > findings.margins["torque"].value:
            findings.margins["torque"] = Margin(value / bound, "", (name,), time)
        if value > bound * (1.0 + _ROUNDING):
            message = f"{name} needs {value:.6g} Nm (or N) at {time:.6f} s, limit {bound:.6g}"
            findings.violations.append(Violation("torque", (name,), time, value, bound, message))
