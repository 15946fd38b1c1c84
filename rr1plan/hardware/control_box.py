"""The control box of one arm: the joint and the speed of each channel.

It is a part of the arm's calibration file:

    [control_box]
    tick = 0.000602            # duration of a pass of the firmware's loop [s]

    [control_box.channels.S1]
    joint = "shoulder_joint"
    fast_period = 6            # ticks of a step at full speed
    ramp_steps = 128           # steps from rest to full speed
    counts_per_step = 2.56     # of its encoder

Without `counts_per_step` the encoder is not checked.
"""

from __future__ import annotations

import pathlib
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from rr1plan.calibration.joint_calibration import Calibration, check_position_units, read_calibration_table
from rr1plan.checks import Array, Value, check_text, finite_number, known_name, of_kind, positive_number, whole_number
from rr1plan.errors import InputError
from rr1plan.files.checked_tables import Table
from rr1plan.hardware.control_box_frames import CHANNELS
from rr1plan.robot import Robot

_MOST_COUNTS = 1e4  # encoder counts per step
# Upper bounds on the period of a step and of a pass of the loop [ticks, s].
_LONGEST_PERIOD, _LONGEST_TICK = 1e4, 1.0


@dataclass(frozen=True)
class BoxChannel:
    """A channel of the control box: the motor of one joint.

    Args:
        joint: The joint of the robot.
        fast_period: Ticks of a step at full speed.
        ramp_steps: Steps from rest to full speed.
        counts_per_step: Counts of the joint's encoder for a step in the direction of commands; None: not checked.

    Raises:
        InputError: a value out of bounds.
    """

    joint: str
    fast_period: float
    ramp_steps: int
    counts_per_step: float | None = None

    def __post_init__(self) -> None:
        check_text("joint", self.joint)
        period = positive_number("fast_period", self.fast_period)
        if not 1.0 <= period <= _LONGEST_PERIOD:
            raise InputError(f"fast_period is {period:g} ticks, expected 1 to {_LONGEST_PERIOD:g}")
        object.__setattr__(self, "fast_period", period)
        whole_number("ramp_steps", self.ramp_steps, 1, 1_000_000)
        if self.counts_per_step is not None:
            counts = finite_number("counts_per_step", self.counts_per_step)
            if abs(counts) > _MOST_COUNTS:
                raise InputError(f"counts_per_step is {counts:g}, expected at most {_MOST_COUNTS:g} to either side")
            object.__setattr__(self, "counts_per_step", counts)


@dataclass(frozen=True, eq=False)
class ControlBox(Value):
    """The control box of one arm; `load_control_box` reads it.

    Args:
        channels: The channels in use, by name: "S1", "S2", "E1", "E2", "W1", "W2", "G".
        tick: Duration of a pass of the firmware's loop [s].

    Raises:
        InputError: a joint on two channels, no channels, a value of another type.
        UnknownNameError: another channel.
    """

    channels: Mapping[str, BoxChannel]
    tick: float

    def __post_init__(self) -> None:
        of_kind("channels", self.channels, Mapping)
        for name, channel in self.channels.items():
            known_name("channel", name, CHANNELS)
            of_kind(f"channel {name!r}", channel, BoxChannel)
        joints = [channel.joint for channel in self.channels.values()]
        if not joints or len(set(joints)) != len(joints):
            raise InputError(f"channels drive {', '.join(joints) or 'nothing'}, expected distinct joints, at least one")
        object.__setattr__(
            self, "channels", MappingProxyType({n: self.channels[n] for n in CHANNELS if n in self.channels})
        )
        tick = positive_number("tick", self.tick)
        if tick > _LONGEST_TICK:
            raise InputError(f"tick is {tick:g} s, expected at most {_LONGEST_TICK:g} s")
        object.__setattr__(self, "tick", tick)


def load_control_box(file: str | pathlib.Path) -> ControlBox:
    """Read the control box of a calibration file.

    Args:
        file: The file (.toml), with the table `control_box`.

    Raises:
        FormatError: the file cannot be read, is not a calibration, is of a newer version, has no table `control_box`,
            or an impossible value.
        UnknownNameError: another channel.
    """
    whole = read_calibration_table(file)
    if "control_box" not in whole:
        raise whole.error("has no table 'control_box', which says what drives the joints of this arm")
    table = whole.table("control_box")
    rows = table.table("channels")
    channels = {name: _channel(rows.table(name)) for name in rows.names()}
    tick = table.number("tick")
    table.finish()
    with table.blame():
        return ControlBox(channels, tick)


def _channel(row: Table) -> BoxChannel:
    joint, period, ramp = row.string("joint"), row.number("fast_period"), row.number("ramp_steps")
    counts: Any = row.number("counts_per_step") if "counts_per_step" in row else None
    row.finish()
    if ramp != round(ramp):
        raise row.error(f"expected a whole number, got {ramp:g}", "ramp_steps")
    with row.blame():
        return BoxChannel(joint, period, int(ramp), counts)


class StepScale:
    """Positions of an arm's joints as step counters of the control box.

    Args:
        robot: The robot.
        calibration: Its calibration in steps.
        box: Its control box.

    Attributes:
        joints: Channels of the planning joints, in their order.
        locked: Rounded step counters of the locked joints, by channel.
        unchecked: Values of the locked joints that no channel drives [rad or m], by name.

    Raises:
        InputError: another robot or unit of positions, readings other than steps, a planning joint without a channel,
            or a channel whose joint is neither planned nor locked, is not calibrated, or has an assumed scale or zero.
    """

    def __init__(self, robot: Robot, calibration: Calibration, box: ControlBox) -> None:
        if calibration.robot != robot.name:
            raise InputError(
                f"the calibration is that of robot {calibration.robot!r}, the motion that of {robot.name!r}"
            )
        if calibration.unit != "steps":
            raise InputError(f"the calibration has readings in {calibration.unit}, expected steps of the motors")
        check_position_units(calibration, robot)
        channel_of = {channel.joint: name for name, channel in box.channels.items()}
        for name in robot.joint_names:
            if name not in channel_of:
                raise InputError(f"no channel of the control box drives joint {name!r}")
        for name, channel in channel_of.items():
            if name not in robot.joint_names and name not in robot.locked_joints:
                raise InputError(
                    f"channel {channel} drives joint {name!r}, which robot {robot.name!r} neither plans for nor locks; "
                    "leave the channel out of the control box"
                )
            if name not in calibration.joints:
                raise InputError(f"joint {name!r} is not calibrated; nothing is guessed, so nothing is sent")
            joint = calibration.joints[name]
            assumed = [part for part in ("zero", "scale") if not np.isfinite(getattr(joint, f"{part}_std"))]
            if assumed:
                raise InputError(
                    f"{assumed[0]} of joint {name!r} is assumed, not measured: it has no standard deviation "
                    f"({assumed[0]}_std); calibrate the arm first"
                )
        self.joints = [channel_of[name] for name in robot.joint_names]
        self._names, self._calibration, self._limits = robot.joint_names, calibration, robot.limits
        self._signs = np.array([calibration.joints[name].sign for name in robot.joint_names])
        self.locked = {
            channel_of[name]: round(float(calibration.readings([value], [name])[0]))
            for name, value in robot.locked_joints.items()
            if name in channel_of
        }
        self.unchecked = {name: value for name, value in robot.locked_joints.items() if name not in channel_of}

    def counters(self, q: Array) -> Array:
        """Step counters at configurations, as whole numbers, shape (n, nq).

        They are rounded to the nearest step, or where that step is beyond a joint limit, to the one before it:
        otherwise motions that end at a limit would violate it.
        """
        nearest = np.rint(self._calibration.readings(q, self._names))
        rounded = self.positions(nearest)
        inward = (rounded < self._limits.lower).astype(np.float64) - (rounded > self._limits.upper)
        return np.asarray(nearest + self._signs * inward)

    def positions(self, counters: Array) -> Array:
        """Configurations at step counters [rad], shape (n, nq)."""
        return self._calibration.positions(counters, self._names)
