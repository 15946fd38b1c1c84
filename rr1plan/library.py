"""Models by name: the robots and scenes that ship with rr1plan, and those of the user's files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rr1plan.checks import known_name
from rr1plan.formats.convex import Convexity
from rr1plan.formats.robot_folder import read_robot_folder
from rr1plan.formats.robots import Choice, assemble
from rr1plan.formats.srdf import read_srdf
from rr1plan.formats.urdf import read_urdf
from rr1plan.limits import Limits
from rr1plan.robot import Robot

_PACKAGE = Path(__file__).resolve().parent


def models_folder() -> Path:
    """The folder with the shipped models: inside an installed package, beside it in a source tree."""
    inside = _PACKAGE / "models"
    return inside if inside.is_dir() else _PACKAGE.parent / "models"


# ---- robots ------------------------------------------------------------------------------


def robot_names() -> tuple[str, ...]:
    """The names of the shipped robots, sorted."""
    return tuple(sorted(file.parent.name for file in (models_folder() / "robots").glob("*/robot.toml")))


def robot_folder(name: str) -> Path:
    """The folder of a shipped robot.

    Raises:
        UnknownNameError: no robot of that name ships.
    """
    return models_folder() / "robots" / known_name("robot", name, robot_names())


def load_robot(
    name_or_file: str | Path,
    *,
    srdf: str | Path | None = None,
    group: str | None = None,
    joints: Sequence[str] | None = None,
    package_dirs: Sequence[str | Path] = (),
    convex: Convexity = "hull",
    limits: Limits | str | None = None,
    tool: str | None = None,
    name: str | None = None,
) -> Robot:
    """Load a robot that ships with rr1plan, or one from a URDF or xacro file."""
    file = Path(name_or_file)
    folder = None
    if isinstance(name_or_file, str) and file.suffix not in (".urdf", ".xacro", ".xml"):
        folder = read_robot_folder(robot_folder(name_or_file))
        file, srdf = folder.urdf, srdf or folder.srdf
    tree = read_urdf(file, package_dirs=package_dirs, convex=convex)
    semantics = None if srdf is None else read_srdf(Path(srdf), tree)
    robot = assemble(tree, semantics, Choice(group, joints, tool or (folder.tool if folder else None), name))
    if folder is not None:
        robot = folder.apply(robot)
    return robot if limits is None else robot.with_limits(limits)
