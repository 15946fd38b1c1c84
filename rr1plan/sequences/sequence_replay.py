"""The result of replaying a planned sequence: motions of the joints, and of the objects held by fingers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from rr1plan.checks import Array, Value, counted
from rr1plan.playback.simulation.replay import TRACKED, Replay, ReplayContact, errors_in_words, largest_errors

# Tolerance for an object at its planned position [m].
NEAR = 0.01


@dataclass(frozen=True, eq=False, repr=False)
class CarriedObject(Value):
    """The motion of a carried object in a replay.

    Args:
        name: The object.
        poses: T_world_object at the times of the record, shape (n, 4, 4).
        offsets: Its distance from the planned position at those times [m], shape (n,).
        angle: Angle of rotation between its final orientation and the planned one [rad].
    """

    name: str
    poses: Array
    offsets: Array
    angle: float

    @property
    def max_offset(self) -> float:
        """Largest distance from the planned position [m]."""
        return float(self.offsets.max(initial=0.0))

    @property
    def final_offset(self) -> float:
        """Its distance from the planned final position [m]."""
        return float(self.offsets[-1])


@dataclass(frozen=True, eq=False, repr=False)
class SequenceReplay(Value):
    """The outcome of `simulate_sequence`.

    Args:
        replay: Motions of joints and loose bodies. Held objects keep fingers from their set-points, so tracking errors
            of gripper joints do not count as failures.
        objects: Motions of the objects that are attached or detached, by name.
        arm_joints: The joints of arms, without those of their grippers.
        remarks: Assumptions of the replay, such as masses, and when and why objects left their planned positions.
    """

    replay: Replay
    objects: Mapping[str, CarriedObject]
    arm_joints: tuple[str, ...]
    remarks: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "objects", MappingProxyType(dict(self.objects)))

    @property
    def max_error(self) -> float:
        """Largest tracking error of any joint of an arm [rad or m]."""
        return max((error for _, error in largest_errors(self.replay, self.arm_joints).values()), default=0.0)

    @property
    def contacts(self) -> tuple[ReplayContact, ...]:
        """Contacts of arms that no stage allows, in order of time."""
        return self.replay.contacts

    @property
    def carried(self) -> bool:
        """Whether all objects stayed within 1 cm of their planned positions."""
        return all(one.max_offset <= NEAR for one in self.objects.values())

    @property
    def tracked(self) -> bool:
        """Whether no joint of an arm was farther than 0.01 rad (or m) from its set-point."""
        return self.max_error <= TRACKED

    def __bool__(self) -> bool:
        """Whether arms followed their motion without contact, and objects followed theirs."""
        return self.carried and self.tracked and not self.contacts

    def __repr__(self) -> str:
        worst = max((one.max_offset for one in self.objects.values()), default=0.0)
        return f"SequenceReplay({self.replay!r}, objects {1e3 * worst:.2f} mm off at most)"

    def __str__(self) -> str:
        replay = self.replay
        lines = [
            f"replay: {counted(replay.steps, 'step')} of {replay.timestep * 1e3:g} ms, "
            f"{replay.real_time_factor:.1f} times real time",
            f"  tracking error: {errors_in_words(largest_errors(replay, self.arm_joints))}",
        ]
        lines += [
            f"  {one.name}: at most {1e3 * one.max_offset:.2f} mm from its planned position, "
            f"{1e3 * one.final_offset:.2f} mm and {np.degrees(one.angle):.2f} degrees in the end"
            for one in self.objects.values()
        ]
        lines += [f"  {remark}" for remark in self.remarks]
        lines += [
            f"  contact: {' and '.join(c.pair)} from {c.first:.3f} s to {c.last:.3f} s, {c.depth * 1e3:.2f} mm deep"
            for c in self.contacts
        ]
        return "\n".join(lines if self.contacts else [*lines, "  contacts: none that no stage allows"])

    def to_dict(self) -> dict[str, Any]:
        """The summary as plain values, for JSON (without the recorded positions)."""
        objects = {
            name: {"max_offset": one.max_offset, "final_offset": one.final_offset, "angle": one.angle}
            for name, one in self.objects.items()
        }
        own = {"max_error": self.max_error, "carried": self.carried, "tracked": self.tracked, "objects": objects}
        return {**self.replay.to_dict(), **own, "remarks": list(self.remarks)}
