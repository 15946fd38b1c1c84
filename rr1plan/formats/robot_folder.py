"""`robot.toml`: what a shipped robot's folder says beyond its URDF and SRDF.

urdf = "rr1.urdf"            files, relative to the folder
srdf = "rr1.srdf"
limits = "sim"               the preset a robot starts with
[held]                       values of joints that are not planned for
finger_joint = 0.0
[presets.sim.shoulder_joint]     each planning joint; what is missing is the URDF's
lower = -2.3; upper = 2.3; velocity = 7.8; acceleration = 8.0; jerk = 80.0; effort = 30.0
[about]                      title, provenance, licence: free text
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rr1plan.checks import finite_number
from rr1plan.errors import FormatError, InputError
from rr1plan.limits import Limits
from rr1plan.robot import Robot

_KEYS = ("urdf", "srdf", "tool", "group", "limits", "held", "presets", "about")
_LIMITS = ("lower", "upper", "velocity", "acceleration", "jerk", "effort")


@dataclass(frozen=True, eq=False)
class RobotFolder:
    """The content of a robot.toml."""

    file: Path
    urdf: Path
    srdf: Path | None = None
    tool: str | None = None
    group: str | None = None
    limits: str | None = None
    held: Mapping[str, float] = field(default_factory=dict)
    presets: Mapping[str, Mapping[str, Mapping[str, float]]] = field(default_factory=dict)
    about: Mapping[str, Any] = field(default_factory=dict)

    def apply(self, robot: Robot) -> Robot:
        """The robot with this folder's held values, presets and first limits.

        Raises:
            FormatError: a joint the robot does not have, or limits that cannot be.
        """
        from dataclasses import replace

        try:
            presets = {name: _limits(robot, rows) for name, rows in self.presets.items()}
            robot = replace(robot.with_held(self.held), presets=presets)
            return robot if self.limits is None else robot.with_limits(self.limits)
        except InputError as error:
            raise FormatError(str(error), self.file) from error


def read_robot_folder(folder: Path) -> RobotFolder:
    """Read a folder's robot.toml.

    Raises:
        FormatError: not TOML, an unknown key, or a value of the wrong kind.
    """
    file = folder / "robot.toml"
    try:
        table = tomllib.loads(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise FormatError(f"cannot be read: {error}", file) from error
    unknown = sorted(set(table) - set(_KEYS))
    if unknown or not isinstance(table.get("urdf"), str):
        what = f"has the unknown key {unknown[0]!r}" if unknown else "names no urdf"
        raise FormatError(f"{what}, expected {', '.join(_KEYS)}", file)
    files = {key: folder / table.pop(key) for key in ("urdf", "srdf") if key in table}
    return RobotFolder(file, **files, **table)


def _limits(robot: Robot, rows: Mapping[str, Mapping[str, float]]) -> Limits:
    """A preset's limits in the order of the planning joints."""
    values = {name: np.array(getattr(robot.limits, name)) for name in _LIMITS}
    for joint, row in rows.items():
        if joint not in robot.joint_names:
            continue
        column = robot.joint_names.index(joint)
        for name, value in row.items():
            if name not in _LIMITS:
                raise InputError(f"limits of {joint!r} have the unknown key {name!r}, expected {', '.join(_LIMITS)}")
            values[name][column] = finite_number(f"{name} of {joint!r}", value)
    return Limits(**values)
