"""Models by name: robots and scenes that ship with rr1plan, or from files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

from rr1plan.checks import check_text, file_path, known_name, of_kind, shown
from rr1plan.errors import FormatError, InputError, UnknownNameError
from rr1plan.formats.convex_pieces import Convexity
from rr1plan.formats.files import is_regular, write_text
from rr1plan.formats.motion_bench import read_bench_scene
from rr1plan.formats.moveit_scene import read_moveit_scene
from rr1plan.formats.robot_data import installed_robots
from rr1plan.formats.robot_folder import RobotFolder, read_robot_folder
from rr1plan.formats.robots import Choice, assemble
from rr1plan.formats.scene_toml import SceneFile, parse_scene, read_scene, scene_text
from rr1plan.formats.srdf import Semantics, read_srdf
from rr1plan.formats.urdf import Tree, read_urdf
from rr1plan.formats.xacro import expand_xacro
from rr1plan.limits import Limits
from rr1plan.problem import Problem
from rr1plan.robot import Robot
from rr1plan.scene import Scene

_SCENE_SUFFIXES = (".toml", ".scene", ".yaml", ".yml")
_PACKAGE = Path(__file__).resolve().parent


def models_folder() -> Path:
    """The folder of the shipped models: inside an installed package, next to it in a source tree."""
    inside = _PACKAGE / "models"
    return inside if inside.is_dir() else _PACKAGE.parent / "models"


# ---- robots ------------------------------------------------------------------------------


def robot_names() -> tuple[str, ...]:
    """The names of the shipped robots, sorted."""
    return tuple(sorted(file.parent.name for file in (models_folder() / "robots").glob("*/robot.toml")))


def installed_robot_names() -> tuple[str, ...]:
    """The names of the robots that the extra `robots` installs (the package example-robot-data), sorted."""
    return tuple(name for name in installed_robots() if name not in robot_names())


def robot_folder(name: str) -> Path:
    """The folder of a shipped robot.

    Args:
        name: One of `robot_names()`.

    Raises:
        UnknownNameError: no shipped robot of that name.
    """
    return models_folder() / "robots" / known_name("robot", name, robot_names())


def load_robot(
    name_or_file: str | Path,
    *,
    srdf: str | Path | Literal[False] | None = None,
    group: str | None = None,
    groups: Sequence[str | Sequence[str]] | None = None,
    joints: Sequence[str] | None = None,
    package_dirs: Sequence[str | Path] = (),
    convex: Convexity = "hull",
    limits: Limits | str | None = None,
    tool: str | None = None,
    name: str | None = None,
    xacro_arguments: Mapping[str, str] | None = None,
) -> Robot:
    """Load a robot that ships with rr1plan or is installed, or an arm from its URDF or xacro file.

    The planning joints are the given `joints`, those of the given `group`, or else those of the
    SRDF's arm with an end effector, of its first group, or all independent joints.
    All other independent joints are held at zero, or at their limit nearest to zero.

    URDF has no acceleration and jerk limits: the defaults reach the velocity limit in 0.25 s and the
    acceleration limit in 0.1 s. Missing velocity limits become 1 rad/s or 0.25 m/s.
    Pass `limits` to set the real ones.

    "home" is the SRDF's state of that name, else "ready", else its first one; without an SRDF, zero or
    the middle of the range if that is free of self-collision, else a free configuration near it.

    If no SRDF disables pairs of links, adjacent links and links in contact in all of 200 random
    configurations are not checked against each other; see `propose_never_collide`. If no configuration
    is free even so, links in contact at home are not checked either, with a warning in the log.

    Args:
        name_or_file: One of `robot_names()`, one of `installed_robot_names()` (`pip install 'rr1plan[robots]'`), or a
            .urdf or .xacro file. A xacro file is a program: load only those you trust.
        srdf: The SRDF; None searches for one of the same name next to the URDF and in ../srdf, False
            uses none.
        group: The planning group of the SRDF.
        groups: Several planning groups combined, in order, e.g. both arms of a robot. Each is a group of the SRDF or
            a chain (base link, tip link). The robot's tool is that of the first.
        joints: The planning joints, in order.
        package_dirs: Folders to search for `package://` meshes, before those around the file.
        convex: Replacement of a concave collision mesh: its "hull", or convex "pieces"
            (slow the first time, with a progress bar on a terminal; then cached on disk).
        limits: Limits of the planning joints, or the name of one of the robot's presets.
        tool: The frame of pose goals for "tool"; by default the tip of the group's
            chain, or the last link after the last planning joint.
        name: Another name for the robot.
        xacro_arguments: Values of a xacro file's arguments; if given, even {}, a .urdf is expanded as well.

    Raises:
        UnknownNameError: no such robot, group, joint, link or preset.
        FormatError: a malformed file.
        InputError: joints that cannot be planning joints, or limits of another length.
        MissingPackageError: a xacro file, and xacrodoc is not installed.
    """
    if group is not None and groups is not None:
        raise InputError(f"got group={shown(group)} and groups={shown(groups)}, expected one of them")
    for option, text in (("group", group), ("tool", tool), ("name", name)):
        if text is not None:
            check_text(option, text)
    folder, file, beside = _locate(name_or_file)
    tree = _read_tree(file, package_dirs, convex, xacro_arguments)
    if srdf is not None:
        semantics = None if srdf is False else read_srdf(file_path(srdf), tree)
    else:
        semantics = _semantics_beside(beside, tree)
    if folder is not None:
        group, tool = folder.group if group is None else group, folder.tool if tool is None else tool
    if groups is None and group is not None:
        groups = (group,)
    robot = assemble(tree, semantics, Choice(groups, joints, tool, name))
    if folder is not None:
        robot = folder.apply(robot)
    return robot if limits is None else robot.with_limits(limits)


def _locate(name_or_file: str | Path) -> tuple[RobotFolder | None, Path, Path | None]:
    """Folder of a shipped robot (or None), URDF or xacro file, and SRDF (or None)."""
    file = file_path(name_or_file)
    if isinstance(name_or_file, str) and name_or_file in robot_names():
        folder = read_robot_folder(robot_folder(name_or_file))
        return folder, folder.urdf, folder.srdf
    installed = installed_robots()
    if isinstance(name_or_file, str) and name_or_file in installed:
        return None, *installed[name_or_file]
    if file.suffix in (".urdf", ".xacro", ".xml"):
        return None, file, _srdf_beside(file)
    if isinstance(name_or_file, Path) or len(file.parts) > 1:
        raise InputError(f"robot file {str(file)!r} has the suffix {file.suffix!r}, expected .urdf or .xacro")
    more = "" if installed else "More come with: pip install 'rr1plan[robots]'. Or give a .urdf or .xacro file."
    raise UnknownNameError("robot", name_or_file, (*robot_names(), *installed), more)


def _read_tree(
    file: Path, package_dirs: Sequence[str | Path], convex: Convexity, arguments: Mapping[str, str] | None
) -> Tree:
    if file.suffix != ".xacro" and arguments is None:
        return read_urdf(file, package_dirs=package_dirs, convex=convex)
    text = expand_xacro(file, package_dirs=package_dirs, arguments=arguments)
    return read_urdf(text, package_dirs=package_dirs, convex=convex, file=file)


def _semantics_beside(srdf: Path | None, tree: Tree) -> Semantics | None:
    """Content of an SRDF that was found next to the URDF; errors explain how to load the robot without it."""
    try:
        return None if srdf is None else read_srdf(srdf, tree)
    except FormatError as error:
        raise FormatError(
            f"{error}; to load {tree.name!r} without this SRDF, rename it, or set option srdf to False"
        ) from error


def _srdf_beside(file: Path) -> Path | None:
    """An SRDF of the same name next to a URDF, or in the folder "srdf" next to its folder."""
    name = f"{file.name.removesuffix('.xacro').removesuffix('.xml').removesuffix('.urdf')}.srdf"
    candidates = (file.parent / name, file.parent.parent / "srdf" / name)
    return next((file for file in candidates if is_regular(file)), None)


# ---- scenes ------------------------------------------------------------------------------


def scene_names() -> tuple[str, ...]:
    """The names of the shipped scenes, sorted."""
    return tuple(sorted(file.stem for file in (models_folder() / "scenes").glob("*.toml")))


def load_scene(name_or_file: str | Path) -> Scene:
    """Load a scene that ships with rr1plan, or one from a file.

    Args:
        name_or_file: A name of `scene_names`, or a scene file (.toml), a MoveIt scene (.scene) or a
            MotionBenchMaker scene (.yaml, .yml). The last two contain obstacles only: add arms with
            `scene.with_arm`.

    Raises:
        UnknownNameError: no shipped scene of that name.
        FormatError: the file is not a scene.
    """
    return load_scene_file(name_or_file).scene


def load_scene_file(name_or_file: str | Path) -> SceneFile:
    """Load a scene like `load_scene`, together with the named queries of the file.

    Raises:
        UnknownNameError: no shipped scene of that name.
        FormatError: the file is not a scene.
    """
    file = _scene_file(name_or_file)
    if file.suffix == ".scene":
        return SceneFile(read_moveit_scene(file), {})
    if file.suffix in (".yaml", ".yml"):
        return SceneFile(read_bench_scene(file), {})
    return read_scene(file, load_robot)


def load_problems(name_or_file: str | Path) -> Mapping[str, Problem]:
    """The named queries of a scene that ships with rr1plan, or of a scene file (.toml), as problems.

    Raises:
        UnknownNameError: no shipped scene of that name.
        FormatError: the file is not a scene.
    """
    return read_scene(_scene_file(name_or_file), load_robot).problems


def save_scene(
    file: str | Path,
    scene: Scene,
    problems: Mapping[str, Problem] | None = None,
    robots: Mapping[str, str] | None = None,
) -> Path:
    """Write a scene file (.toml) from which `load_scene` loads the same scene, to the last bit.

    Args:
        file: The file; it is replaced atomically.
        scene: The scene. Meshes and point clouds are written into the file.
        problems: Named queries in that scene, for `load_problems`.
        robots: Name or file of the robot of each arm, files relative to the scene file (default: the robot's name if it
            ships with rr1plan, else the file it was loaded from).

    Returns:
        The file.

    Raises:
        InputError: a robot that was not loaded from a file, a scene that would read back differently (a robot that
            was loaded with another SRDF), or a file that cannot be written.
        UnknownNameError: a name in `robots` is not an arm.
    """
    of_kind("scene", scene, Scene)
    path = file_path(file)
    of_kind("problems", problems, Mapping, optional=True)
    of_kind("robots", robots, Mapping, optional=True)
    for problem in (problems or {}).values():
        of_kind("one of the problems", problem, Problem)
    for name, robot in (robots or {}).items():
        known_name("arm", name, scene.arms)
        check_text(f"robot of arm {name!r}", robot)
    names = {name: (robots or {}).get(name) or _robot_entry(name, arm.robot) for name, arm in scene.arms.items()}
    text = scene_text(scene, problems, names)
    again = parse_scene(text, path, load_robot).scene
    for name, arm in scene.arms.items():
        if again.arms[name].robot.content_hash != arm.robot.content_hash:
            raise InputError(
                f"{path} would not read back as this scene: the robot of arm {name!r} differs from what "
                f"load_robot({names[name]!r}) makes; save its URDF and SRDF as files and name the URDF with robots="
            )
    return write_text(path, text)


def _robot_entry(arm: str, robot: Robot) -> str:
    """Entry of a robot in a scene file: its name if it ships with rr1plan, else its file."""
    if robot.name in robot_names():
        return robot.name
    source = Path(robot.source)
    if not robot.source or not source.is_file():
        raise InputError(
            f"the robot {robot.name!r} of arm {arm!r} was loaded from no file that is there now; "
            f"name one with robots={{{arm!r}: 'robot.urdf'}}"
        )
    return str(source.absolute())


def _scene_file(name_or_file: str | Path) -> Path:
    """The scene file: a name with a suffix is a file, a bare name a shipped scene."""
    file = file_path(name_or_file)
    if file.suffix in _SCENE_SUFFIXES:
        return file
    if not isinstance(name_or_file, str) or len(file.parts) > 1:
        expected = ", ".join(_SCENE_SUFFIXES)
        raise InputError(f"scene file {str(file)!r} has the suffix {file.suffix!r}, expected one of {expected}")
    return models_folder() / "scenes" / f"{known_name('scene', name_or_file, scene_names())}.toml"
