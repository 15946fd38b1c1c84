"""Results of a replay in the simulator: tracking, contacts, torques, speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np

from rr1plan.checks import Array, Value, counted, read_only
from rr1plan.scene import Obstacle

# An arm is tracked while no joint is farther than this from its set-point [rad or m].
TRACKED = 0.01


def largest_errors(replay: Replay, joint_names: Sequence[str] | None = None) -> dict[str, tuple[str, float]]:
    """The joint with the largest tracking error, and this error [rad or m], by unit: "rad", "m", "" if unknown.

    Args:
        replay: The replay.
        joint_names: Joints to consider (default: all).
    """
    found: dict[str, tuple[str, float]] = {}
    units = replay.units or ("",) * len(replay.joint_names)
    for name, unit, error in zip(replay.joint_names, units, replay.max_error.tolist(), strict=True):
        considered = joint_names is None or name in joint_names
        if considered and (unit not in found or not error <= found[unit][1]):
            found[unit] = name, error
    return found


def errors_in_words(errors: Mapping[str, tuple[str, float]], named: bool = True) -> str:
    """Errors from `largest_errors` as a text, with or without the names of their joints."""
    parts = [
        f"{error:.2e} {unit or 'rad or m'}" + f" at most ({name})" * named for unit, (name, error) in errors.items()
    ]
    return ", ".join(parts) or "no joints"


@dataclass(frozen=True)
class ReplayContact:
    """A contact of two elements over an interval of time.

    Args:
        pair: The two elements, e.g. ("arm/hand_link", "shelf").
        first: First instant of contact [s].
        last: Last instant of contact [s].
        depth: Deepest penetration [m].
    """

    pair: tuple[str, str]
    first: float
    last: float
    depth: float


@dataclass(frozen=True, eq=False, repr=False)
class BodyMotion(Value):
    """Recorded poses of loose bodies.

    Args:
        bodies: The bodies by name; "name (2)" is one of other shapes that took the place of an earlier one.
        poses: Position [m] and quaternion (wxyz) of each at the times of the record, shape (n, bodies, 7), also while
            an arm holds a body that was loose; NaN while a body is not in the scene.
    """

    bodies: Mapping[str, Obstacle]
    poses: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "bodies", MappingProxyType(dict(self.bodies)))
        read_only(self.poses)


@dataclass(frozen=True, eq=False, repr=False)
class ReplayRecord(Value):
    """Positions of joints and loose bodies recorded during a replay.

    Args:
        times: Instants [s], shape (n,).
        desired: Set-points [rad or m], shape (n, nq).
        actual: Measured positions [rad or m], shape (n, nq).
        bodies: Poses of loose bodies; None if there are none, and in a kinematic replay.
    """

    times: Array
    desired: Array
    actual: Array
    bodies: BodyMotion | None = None

    def __post_init__(self) -> None:
        for array in (self.times, self.desired, self.actual):
            read_only(array)


@dataclass(frozen=True, eq=False, repr=False)
class Replay(Value):
    """The result of `simulate`.

    Args:
        mode: "dynamic" (servos move the arms) or "kinematic" (the arms are placed at their set-points).
        joint_names: Columns of the arrays, "arm/joint", as in the trajectory.
        record: Set-points and positions over time, and the poses of loose bodies.
        max_error: Largest tracking error of each joint over all steps [rad or m], shape (nq,).
        rms_error: Root mean square tracking error of each joint over all steps [rad or m], shape (nq,).
        peak_effort: Peak effort of each joint as a fraction of its limit, shape (nq,); above 1 only in arms with
            estimated masses, to which effort limits do not apply.
        contacts: Contacts that the scene does not allow, in order of time.
        steps: Steps of the simulator.
        timestep: Length of a step [s].
        wall_seconds: Wall time of the replay [s].
        settings: Version and options, for reproduction.
        remarks: Notes on its accuracy: masses missing in the robot's file, steps that are too long, servos that are too
            stiff, warnings of MuJoCo.
        units: "rad" or "m" for each joint; empty if unknown.
    """

    mode: str
    joint_names: tuple[str, ...]
    record: ReplayRecord
    max_error: Array
    rms_error: Array
    peak_effort: Array
    contacts: tuple[ReplayContact, ...]
    steps: int
    timestep: float
    wall_seconds: float
    settings: dict[str, Any] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    units: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for array in (self.max_error, self.rms_error, self.peak_effort):
            read_only(array)

    @property
    def real_time_factor(self) -> float:
        """Simulated seconds per second of wall time."""
        return self.steps * self.timestep / max(self.wall_seconds, 1e-12)

    @property
    def worst_error(self) -> float:
        """Largest tracking error of any joint [rad or m]."""
        return float(self.max_error.max(initial=0.0))

    @property
    def free(self) -> bool:
        """Whether there were no contacts that the scene does not allow."""
        return not self.contacts

    @property
    def tracked(self) -> bool:
        """Whether all joints stayed within 0.01 rad (or m) of their set-points; always so in a kinematic replay."""
        return bool((self.max_error <= TRACKED).all())

    def __bool__(self) -> bool:
        """Whether the arms followed their motion: `free` and `tracked`."""
        return self.free and self.tracked

    def __repr__(self) -> str:
        seconds = self.steps * self.timestep
        return f"Replay({self.mode}, {seconds:.3f} s, {self._worst()}, {counted(len(self.contacts), 'contact')})"

    def _worst(self, named: bool = False) -> str:
        """The largest tracking error in each unit, and its joint."""
        return errors_in_words(largest_errors(self), named)

    def __str__(self) -> str:
        lines = [
            f"{self.mode} replay: {counted(self.steps, 'step')} of {self.timestep * 1e3:g} ms, "
            f"{self.real_time_factor:.0f} times real time"
        ]
        if self.mode == "dynamic" and self.joint_names:
            lines.append(f"  tracking error: {self._worst(named=True)}")
            busiest = int(np.argmax(self.peak_effort))
            saturated = ((self.peak_effort > 0.999) & ~(self.max_error <= TRACKED)).any()
            lines.append(
                f"  effort: {100 * self.peak_effort[busiest]:.0f} % of the limit at most ({self.joint_names[busiest]})"
                + ("; plan with option torque_limits, or with lower limits of acceleration" if saturated else "")
            )
        if not self.tracked:
            lost = int((~(self.max_error <= TRACKED)).sum())
            lines.append(
                f"  the motion was not followed: {counted(lost, 'joint')} of {len(self.joint_names)} more than "
                f"{TRACKED:g} {' or '.join(dict.fromkeys(self.units)) or 'rad or m'} from the set-point"
            )
        lines += [f"  {remark}" for remark in self.remarks]
        lines += [
            f"  contact: {' and '.join(c.pair)} from {c.first:.3f} s to {c.last:.3f} s, {c.depth * 1e3:.2f} mm deep"
            for c in self.contacts
        ]
        return "\n".join(lines if self.contacts else [*lines, "  contacts: none"])

    def to_dict(self) -> dict[str, Any]:
        """The summary as plain values, for JSON (without the recorded positions)."""
        joints = zip(self.joint_names, self.max_error, self.rms_error, self.peak_effort, strict=True)
        return {
            "mode": self.mode,
            "steps": self.steps,
            "timestep": self.timestep,
            "wall_seconds": self.wall_seconds,
            "real_time_factor": self.real_time_factor,
            "free": self.free,
            "tracked": self.tracked,
            "joints": {
                name: {"max_error": float(worst), "rms_error": float(rms), "peak_effort": float(effort)}
                for name, worst, rms, effort in joints
            },
            "contacts": [
                {"pair": list(c.pair), "first": c.first, "last": c.last, "depth": c.depth} for c in self.contacts
            ],
            "settings": dict(self.settings),
            "remarks": list(self.remarks),
        }
