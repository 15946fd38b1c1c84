"""Acceptance rules of the `joint_trajectory_controller` of ROS, checked and explained in words."""

from __future__ import annotations

import math
import pathlib
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import pairwise

from rr1plan.checks import counted, items_of, true_or_false
from rr1plan.errors import InputError
from rr1plan.export.ros_trajectories import JointTrajectoryMessage, read_joint_trajectory, sampled_message
from rr1plan.path import check_joint_names
from rr1plan.trajectory import Trajectory

# The controller compares velocities with the spacing of 32-bit floats at 1.
_STILL = 2.0**-23
_FIELDS = ("positions", "velocities", "accelerations")
# Seconds of a duration are 32-bit integers with a sign in ROS, nanoseconds a part of a second.
_MOST_SECONDS, _SECOND = 2**31, 1_000_000_000


def check_joint_trajectory(
    message: str | pathlib.Path | Trajectory,
    joint_names: Sequence[str] | None = None,
    *,
    topic: str | None = None,
    allow_partial_joints: bool = False,
    allow_final_velocity: bool = False,
) -> tuple[str, ...]:
    """The objections of `joint_trajectory_controller` to a trajectory.

    The rules of the controller with its default parameters are checked, and two that it lacks: numbers have to be
    finite, and no joint may be named twice.

    Args:
        message: A JointTrajectory in a YAML file or a bag; or a trajectory, checked as `save_joint_trajectory` samples
            it.
        joint_names: The controller's joints by their ROS names (default: those of the message).
        topic: The topic of a bag (default: the only one with a JointTrajectory).
        allow_partial_joints: The controller's parameter `allow_partial_joints_goal`.
        allow_final_velocity: The controller's parameter `allow_nonzero_velocity_at_trajectory_end`.

    Returns:
        The objections in words; empty if the controller accepts the trajectory.

    Raises:
        FormatError: a file without a JointTrajectory.
        InputError: a trajectory that cannot be sampled because it does not end at rest, a value of another type.
        MissingPackageError: a bag, and `rosbags` is not installed (extra `ros`).
    """
    partial = true_or_false("allow_partial_joints", allow_partial_joints)
    moving = true_or_false("allow_final_velocity", allow_final_velocity)
    if isinstance(message, Trajectory):
        found = sampled_message(message, 0.01, 0.0, None)
    else:
        found = read_joint_trajectory(message, topic)
    joints = found.joint_names if joint_names is None else items_of("joint_names", joint_names, "names")
    if joint_names is not None:
        check_joint_names(joints)
    return (
        *_about_joints(found.joint_names, list(joints), partial),
        *_about_points(found),
        *_about_times(found),
        *(() if moving or not found.points else _about_end(found)),
    )


def _about_joints(names: list[str], joints: list[str], partial: bool) -> Iterator[str]:
    if not names:
        yield "the message names no joints"
    for name, count in Counter(names).items():
        if count > 1:
            yield f"joint {name!r} is named {count} times"
        if name not in joints:
            yield f"joint {name!r} is none of the controller's: {', '.join(joints)}"
    missing = [name for name in joints if name not in names]
    if missing and not partial:
        yield f"joints are missing: {', '.join(missing)}; the controller takes partial goals only if configured to"


def _about_points(message: JointTrajectoryMessage) -> Iterator[str]:
    count = len(message.joint_names)
    if not message.points:
        yield "the message has no points"
    for number, point in enumerate(message.points):
        for field in _FIELDS:
            values = getattr(point, field)
            if len(values) != count and (values or field == "positions"):
                numbers = counted(len(values), "number")
                yield f"point {number} has {numbers} in {field}, expected {count}: one for each joint"
            bad = next((k for k, value in enumerate(values) if not math.isfinite(value)), None)
            if bad is not None:
                yield f"point {number} has {field} that are not finite: number {bad} is {values[bad]}"
        if point.effort:
            yield f"point {number} has efforts, which a controller of positions or velocities rejects"


def _about_times(message: JointTrajectoryMessage) -> Iterator[str]:
    try:
        stamps = message.stamps
    except InputError as error:
        yield str(error)
        return
    for number, stamp in enumerate(stamps):
        for field in ("sec", "secs"):
            value = getattr(stamp, field)
            if not -_MOST_SECONDS <= value < _MOST_SECONDS:
                yield f"point {number} has a time_from_start with {field} {value}, which does not fit into 32 bits"
        for field in ("nanosec", "nsecs"):
            value = getattr(stamp, field)
            if not 0 <= value < _SECOND:
                yield f"point {number} has a time_from_start with {field} {value}, expected 0 to {_SECOND - 1}"
    times = [stamp.nanoseconds for stamp in stamps]
    if times and times[0] < 0:
        yield f"the first point is due {1e-9 * times[0]:g} s from the start, expected a time from 0 on"
    for number, (before, after) in enumerate(pairwise(times), 1):
        if after <= before:
            yield (
                f"times do not strictly increase: point {number} is due at {1e-9 * after:.9f} s, "
                f"point {number - 1} at {1e-9 * before:.9f} s"
            )


def _about_end(message: JointTrajectoryMessage) -> Iterator[str]:
    for name, velocity in zip(message.joint_names, message.points[-1].velocities, strict=False):
        if abs(velocity) > _STILL:
            yield f"joint {name!r} has the velocity {velocity:g} at the last point, expected 0"
