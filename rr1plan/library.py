"""Models by name: the robots and scenes that ship with rr1plan, and those of the user's files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from rr1plan.checks import known_name
from rr1plan.formats.convex import Convexity
from rr1plan.formats.robot_folder import read_robot_folder
from rr1plan.formats.robots import Choice, assemble
from rr1plan.formats.scene_toml import read_scene
from rr1plan.formats.srdf import read_srdf
from rr1plan.formats.urdf import read_urdf
from rr1plan.limits import Limits
from rr1plan.problem import Problem
from rr1plan.robot import Robot
from rr1plan.scene import Scene

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


# ---- scenes ------------------------------------------------------------------------------


def scene_names() -> tuple[str, ...]:
    """The names of the shipped scenes, sorted."""
    return tuple(sorted(file.stem for file in (models_folder() / "scenes").glob("*.toml")))


def load_scene(name_or_file: str | Path) -> Scene:
    """Load a scene that ships with rr1plan, or one from a file.

    Args:
        name_or_file: A name of `scene_names`, or a scene file (.toml).

    Raises:
        UnknownNameError: no scene of that name ships.
        FormatError: the file is not a scene.
    """
    file = _scene_file(name_or_file)
    return read_scene(file, load_robot).scene


def load_problems(name_or_file: str | Path) -> Mapping[str, Problem]:
    """The named queries of a scene that ships with rr1plan, or of a scene file (.toml), as problems.

    Raises:
        UnknownNameError: no scene of that name ships.
        FormatError: the file is not a scene.
    """
    return read_scene(_scene_file(name_or_file), load_robot).problems


def _scene_file(name_or_file: str | Path) -> Path:
    """The file that is meant: anything with a suffix is a file, a bare name is a shipped scene."""
    if isinstance(name_or_file, Path) or Path(name_or_file).suffix in (".toml", ".scene", ".yaml", ".yml"):
        return Path(name_or_file)
    return models_folder() / "scenes" / f"{known_name('scene', name_or_file, scene_names())}.toml"
