"""What moves links: the columns of a motion, and what determines the value of each joint."""

from __future__ import annotations

from dataclasses import dataclass

from rr1plan.checks import Array
from rr1plan.errors import InputError
from rr1plan.robot import Robot


@dataclass(frozen=True, eq=False)
class TimedColumns:
    """A motion of some columns.

    Args:
        joint_names: Their names "arm/joint".
        breaks: Times of the pieces [s], shape (m + 1,), or (1,) for a duration of zero.
        coefficients: Local coefficients, lowest power first, shape (m, d + 1, nq).
    """

    joint_names: tuple[str, ...]
    breaks: Array
    coefficients: Array


@dataclass(frozen=True)
class Drive:
    """Value of a joint: scale * q[column] + offset; column -1 stands for a stationary joint."""

    column: int
    scale: float
    offset: float


def drives(robot: Robot, columns: dict[str, int], configuration: dict[str, float]) -> dict[str, Drive]:
    """What determines each joint's value: a column, the configuration, a locked value, or a leading joint.

    Args:
        robot: The robot.
        columns: Column of each planning joint that moves, by joint name.
        configuration: Value [rad or m] of the planning joints that do not move, by joint name.

    Raises:
        InputError: a joint without a value.
    """
    found: dict[str, Drive] = {name: Drive(column, 1.0, 0.0) for name, column in columns.items()}
    found |= {name: Drive(-1, 0.0, value) for name, value in (*configuration.items(), *robot.locked_joints.items())}
    waiting = [joint for joint in robot.joints if joint.kind != "fixed" and joint.name not in found]
    while waiting:
        ready = [joint for joint in waiting if joint.mimic is not None and joint.mimic.joint in found]
        if not ready:
            raise InputError(f"joint {waiting[0].name!r} of robot {robot.name!r} follows no joint that has a value")
        for joint in ready:
            assert joint.mimic is not None
            leader, gain = found[joint.mimic.joint], joint.mimic.multiplier
            found[joint.name] = Drive(leader.column, gain * leader.scale, gain * leader.offset + joint.mimic.offset)
        waiting = [joint for joint in waiting if joint.name not in found]
    return found
