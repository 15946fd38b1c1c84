"""`robot.toml`: settings of a shipped robot beyond its URDF and SRDF.

Keys, all but the first optional:

- `urdf`, `srdf`: files in the folder.
- `tool`, `group`: as in `load_robot`.
- `limits`: the initial preset of limits.
- `locked_joints`: values of joints that are not planned for [rad or m].
- `presets.<preset>.<joint>`: lower, upper, velocity, acceleration, jerk and effort of a planning
  joint; missing values are those of the URDF.
- `about`: title, license, provenance and notes, free text.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from rr1plan.checks import known_name
from rr1plan.errors import FormatError, InputError
from rr1plan.files.checked_tables import Table
from rr1plan.files.documents import read_toml
from rr1plan.robot import Robot
from rr1plan.robot.joint_limits import LIMIT_NAMES, Limits

Rows = Mapping[str, Mapping[str, float]]


@dataclass(frozen=True, eq=False)
class RobotFolder:
    """The content of a robot.toml."""

    file: Path
    urdf: Path
    srdf: Path | None = None
    tool: str | None = None
    group: str | None = None
    limits: str | None = None
    locked_joints: Mapping[str, float] = field(default_factory=dict)
    presets: Mapping[str, Rows] = field(default_factory=dict)

    def apply(self, robot: Robot) -> Robot:
        """The robot with this folder's locked joints, presets and first limits.

        Raises:
            FormatError: a joint that the robot does not have, or invalid limits.
        """
        locked = {name: value for name, value in self.locked_joints.items() if name not in robot.joint_names}
        try:
            presets = {name: _limits(robot, rows) for name, rows in self.presets.items()}
            robot = replace(robot.with_locked_joints(locked), presets=presets)
            return robot if self.limits is None else robot.with_limits(self.limits)
        except InputError as error:
            raise FormatError(str(error), self.file) from error


def read_robot_folder(folder: Path) -> RobotFolder:
    """Read a folder's robot.toml.

    Raises:
        FormatError: not TOML, an unknown key, or a value of the wrong kind.
    """
    file = folder / "robot.toml"
    table = read_toml(file)
    locked = table.table("locked_joints")
    presets, about = table.table("presets"), table.table("about")
    for name in about.names():
        about.string(name)
    found = RobotFolder(
        file=file,
        urdf=folder / table.string("urdf"),
        srdf=folder / table.string("srdf") if "srdf" in table else None,
        tool=table.string("tool") if "tool" in table else None,
        group=table.string("group") if "group" in table else None,
        limits=table.string("limits") if "limits" in table else None,
        locked_joints={name: locked.number(name) for name in locked.names()},
        presets={name: _rows(presets.table(name)) for name in presets.names()},
    )
    table.finish()
    return found


def _rows(preset: Table) -> Rows:
    """The limits of each joint in a preset."""
    found: dict[str, dict[str, float]] = {}
    for joint in preset.names():
        row = preset.table(joint)
        found[joint] = {name: row.number(name) for name in LIMIT_NAMES if name in row}
        row.finish()
    return found


def _limits(robot: Robot, rows: Rows) -> Limits:
    """A preset's limits in the order of the planning joints; rows of other joints are ignored."""
    values = {name: np.array(getattr(robot.limits, name)) for name in LIMIT_NAMES}
    movable = [joint.name for joint in robot.joints if joint.kind != "fixed"]
    for joint, row in rows.items():
        if known_name("joint", joint, movable) in robot.joint_names:
            for name, value in row.items():
                values[name][robot.joint_names.index(joint)] = value
    return Limits(**values)
