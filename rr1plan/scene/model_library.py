"""Models by name: robots and scenes that ship with rr1plan, or from files."""

from __future__ import annotations

import pickle
from collections.abc import Mapping, Sequence
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal
from weakref import WeakValueDictionary

from rr1plan.checks import check_text, file_path, items_of, known_name, resolved_path
from rr1plan.errors import FormatError, InputError, InstallationError, UnknownNameError
from rr1plan.files.file_access import is_regular
from rr1plan.robot import Robot
from rr1plan.robot.mjcf_document import is_mjcf
from rr1plan.robot.robot_builder import Choice, assemble, warn_of_unknown_velocities
from rr1plan.robot.robot_folder import RobotFolder, read_robot_folder
from rr1plan.robot.robot_packages import installed_robots
from rr1plan.robot.srdf import Semantics, joined_semantics, read_srdf
from rr1plan.robot.urdf import Tree, read_urdf
from rr1plan.robot.xacro import XacroArguments, argument_text, expand_xacro
from rr1plan.scene import Scene
from rr1plan.scene.mjcf_scene import read_mjcf_scene
from rr1plan.scene.motion_bench import read_bench_scene
from rr1plan.scene.moveit_scene import read_moveit_scene
from rr1plan.scene.problem import Problem
from rr1plan.scene.scene_toml import RobotLoader, SceneFile, read_scene
from rr1plan.shapes.convex_decomposition import Convexity

if TYPE_CHECKING:
    from rr1plan.robot.mjcf import MjcfContent

_URDF_SUFFIXES, _MJCF_SUFFIXES = (".urdf", ".xacro"), (".xml", ".mjcf")
# USD and SDF, which are not read.
_SDF_SUFFIXES = (".sdf", ".world")
_FOREIGN_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz", *_SDF_SUFFIXES)
_SCENE_SUFFIXES = (".toml", ".scene", ".yaml", ".yml", *_MJCF_SUFFIXES)
_PACKAGE = Path(__file__).resolve().parent.parent


def models_folder() -> Path:
    """The folder of the shipped models: inside an installed package, next to the package in a source tree.

    Raises:
        InstallationError: there is none.
    """
    folder = next((f for f in (_PACKAGE / "models", _PACKAGE.parent / "models") if f.is_dir()), None)
    if folder is None:
        raise InstallationError(
            f"the folder of models beside {_PACKAGE} is missing; rr1plan runs unpacked, not in a zip"
        )
    return folder


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
    groups: Sequence[str | Sequence[str]] | None = None,
    joints: Sequence[str] | None = None,
    package_dirs: Sequence[str | Path] = (),
    convex: Convexity = "hull",
    tool: str | None = None,
    xacro_arguments: XacroArguments | None = None,
) -> Robot:
    """Load a robot that ships with rr1plan or is installed, or any arm from its URDF, xacro or MJCF file.

    The planning joints are the given `joints`, those of the given `groups`, or else those of the
    SRDF's arm that carries an end effector, of its first group, or all that move by themselves.
    Every other joint that moves by itself is locked at zero, or at its limit nearest to zero. An MJCF file has a group
    for each of its robots, named after its first body: the driven hinges and slides on the way to the tool. Its
    keyframes are states, and its other joints are locked as in "home".

    URDF has acceleration and jerk limits from version 1.2 on. For a file without them the defaults reach the velocity
    limit in 0.25 s and the acceleration limit in 0.1 s. A missing velocity limit becomes 1 rad/s or 0.25 m/s. Set known
    limits with `robot.with_limits`. A revolute joint with limits of ±10000 rad or more, such as SDF's ±1e16, is
    continuous.

    States of the SRDF that are outside the limits by whole turns, or by rounding, are moved into them. "home" is its
    state of that name, moved to the limits if it is outside them, else "ready", else its first state within them;
    without an SRDF, zero or the middle of the range if that is free of self-collision, else a free configuration near
    it.

    If no SRDF disables pairs of links, neighbors and links that touch in each of 200 random configurations are not
    checked against each other; see `propose_disabled_collisions`. If no configuration is free even so, links that touch
    at home are not checked either, with a warning in the log.

    Files are read anew every time. If the result equals a loaded robot that is still in use, that one is returned.

    Args:
        name_or_file: One of `robot_names()`, one of `installed_robot_names()` (`pip install 'rr1plan[robots]'`), or a
            .urdf, .xacro or MJCF (.xml, .mjcf) file. A xacro file is a program: load only those you trust.
        srdf: The SRDF; None looks beside the URDF and in ../srdf for one of the same name, False uses none.
        groups: The SRDF groups to plan for, as one: the joints of the first, then those of the next, e.g. one arm or
            both arms of a robot. A group that no SRDF defines is given as a chain: (base link, tip link). The robot's
            tool is that of the first group.
        joints: The joints to plan for, in this order.
        package_dirs: Folders in which to search for `package://` meshes before those around the file; for MJCF, folders
            with meshes in addition to the file's own.
        convex: Replacement of non-convex collision meshes: their "hull", or convex "pieces" (slow the first time, with
            a progress bar on a terminal; then cached on disk).
        tool: The link that pose goals mean when they name none; by default the tip of the group's chain; with `joints`,
            the last link after the last of them, through fixed joints and joints that mimic planning joints; else a
            link with a tool's name, or the end of the longest chain, before its fingers. In MJCF files it is a body or
            a site, and the joints between the base and the tool are planned for; by default a site with a tool's name,
            or the body that holds the fingers.
        xacro_arguments: Values of a xacro file's arguments: text, numbers or booleans; if given, even {}, a .urdf is
            expanded as well.

    Raises:
        UnknownNameError: no such robot, group, joint or link.
        FormatError: a file that is not in its format.
        InputError: folders that are not there, joints that cannot be planned for, or that have limits beyond ±10000
            rad or m.
        MissingPackageError: a xacro file, and xacrodoc is not installed.
    """
    robot, content = _load(name_or_file, srdf, groups, joints, package_dirs, convex, tool, xacro_arguments)
    if content is not None:
        content.warn_of_surroundings()
    warn_of_unknown_velocities(robot, robot.joint_names)
    return robot


def load_arm_robot(name_or_file: str | Path, **options: Any) -> Robot:
    """A robot as `load_robot` makes it, for an arm of a scene file, which has all obstacles and may have limits."""
    return _load(name_or_file, **options)[0]


def _load(
    name_or_file: str | Path,
    srdf: str | Path | Literal[False] | None = None,
    groups: Sequence[str | Sequence[str]] | None = None,
    joints: Sequence[str] | None = None,
    package_dirs: Sequence[str | Path] = (),
    convex: Convexity = "hull",
    tool: str | None = None,
    xacro_arguments: XacroArguments | None = None,
) -> tuple[Robot, MjcfContent | None]:
    """The robot of `load_robot`, and the content of its file if it is MJCF."""
    if tool is not None:
        check_text("tool", tool)
    _check_folders(package_dirs)
    folder, file, beside = locate_robot(name_or_file)
    if file.suffix.lower() in _MJCF_SUFFIXES and is_mjcf(file):
        if xacro_arguments is not None:
            raise InputError(f"{file} is MJCF; option xacro_arguments is for xacro files")
        content = _read_mjcf(file, package_dirs, convex, tool)
        tree, own = content.tree, content.semantics
    else:
        content = None
        tree, own = _read_tree(file, package_dirs, convex, xacro_arguments), None
    semantics = _semantics(srdf, beside, tree, own)
    if folder is not None:
        tool = folder.tool if tool is None else tool
    default_group = None if folder is None or folder.group is None else (folder.group,)
    robot = assemble(tree, semantics, Choice(default_group if groups is None else groups, joints, tool))
    robot = robot if folder is None else folder.apply(robot)
    options = _srdf_option(srdf, beside)
    folders = tuple(str(resolved_path(folder)) for folder in package_dirs)
    if folders:
        options["package_dirs"] = folders
    if convex != "hull":
        options["convex"] = convex
    if groups is not None:  # they decide which of an SRDF's states are named configurations
        options["groups"] = [group if isinstance(group, str) else list(group) for group in groups]
    if xacro_arguments is not None:
        options["xacro_arguments"] = {str(n): argument_text(value) for n, value in xacro_arguments.items()}
    return _shared(replace(robot, load_options=options)), content


def _check_folders(package_dirs: Sequence[str | Path]) -> None:
    for folder in items_of("package_dirs", package_dirs, "folders"):
        if not file_path(folder).is_dir():
            raise InputError(f"package_dirs names {str(folder)!r}, which is not a folder")


def _srdf_option(srdf: str | Path | Literal[False] | None, beside: Path | None) -> dict[str, object]:
    """The option of a scene file that selects this SRDF; none for the one beside the robot's file."""
    if srdf is False:
        return {"srdf": False}
    if srdf is None or (beside is not None and resolved_path(srdf) == resolved_path(beside)):
        return {}
    return {"srdf": str(resolved_path(srdf))}


# Loaded robots in use, by the SHA-256 of their whole content.
_loaded: WeakValueDictionary[bytes, Robot] = WeakValueDictionary()


def _shared(robot: Robot) -> Robot:
    """An equal robot that is in use, or this one, so that values derived from a robot are computed only once."""
    return _loaded.setdefault(sha256(pickle.dumps(robot, pickle.HIGHEST_PROTOCOL)).digest(), robot)


def locate_robot(name_or_file: str | Path) -> tuple[RobotFolder | None, Path, Path | None]:
    """Folder of a shipped robot (or None), its URDF, xacro or MJCF file, and SRDF (or None).

    Raises:
        UnknownNameError: no such robot.
        InputError: a file with another suffix.
    """
    file = file_path(name_or_file)
    if isinstance(name_or_file, str) and name_or_file in robot_names():
        folder = read_robot_folder(robot_folder(name_or_file))
        return folder, folder.urdf, folder.srdf
    installed = installed_robots()
    if isinstance(name_or_file, str) and name_or_file in installed:
        return None, *installed[name_or_file]
    if file.suffix.lower() in (*_URDF_SUFFIXES, *_MJCF_SUFFIXES):
        return None, file, _srdf_beside(file)
    if file.suffix.lower() in (".toml", ".scene"):
        raise InputError(f"{file} is a scene, expected a robot; load_scene reads scenes, and their arms have robots")
    if isinstance(name_or_file, Path) or len(file.parts) > 1 or _is_foreign(file) or file.exists():
        raise InputError(
            f"robot file {str(file)!r} {_fault(file)}, expected .urdf, .xacro or .xml (MJCF){_conversion(file)}"
        )
    more = "" if installed else "More come with: pip install 'rr1plan[robots]'. Or give a .urdf, .xacro or MJCF file."
    raise UnknownNameError("robot", name_or_file, (*robot_names(), *installed), more)


def _is_foreign(file: Path) -> bool:
    """Whether a name is that of a file in another program's format, rather than the name of a model with a dot."""
    return file.suffix.lower() in _FOREIGN_SUFFIXES


def _fault(file: Path) -> str:
    """Why a path cannot be that of a robot or a scene."""
    if file.is_dir():
        return "is a folder"
    return f"{'' if file.exists() else 'does not exist and '}has the suffix {file.suffix!r}"


def _conversion(file: Path) -> str:
    """How to convert a file in another program's format, as the end of a message; empty for others."""
    if file.suffix.lower() in _SDF_SUFFIXES:
        return "; the package sdformat-mjcf converts SDF to MJCF"
    return "; export it as URDF or MJCF from the program that wrote it" if _is_foreign(file) else ""


def _read_mjcf(file: Path, package_dirs: Sequence[str | Path], convex: Convexity, tool: str | None) -> MjcfContent:
    # Importing MuJoCo takes a fifth of a second.
    from rr1plan.robot.mjcf import read_mjcf

    return read_mjcf(file, package_dirs=package_dirs, convex=convex, tool=tool)


def _read_tree(
    file: Path, package_dirs: Sequence[str | Path], convex: Convexity, arguments: XacroArguments | None
) -> Tree:
    if file.suffix.lower() != ".xacro" and arguments is None:
        return read_urdf(file, package_dirs=package_dirs, convex=convex)
    text = expand_xacro(file, package_dirs=package_dirs, arguments=arguments)
    return read_urdf(text, package_dirs=package_dirs, convex=convex, file=file)


def _semantics(
    srdf: str | Path | Literal[False] | None, beside: Path | None, tree: Tree, own: Semantics | None
) -> Semantics | None:
    """The semantics that the given SRDF, or the one beside the robot's file, adds to that file."""
    if srdf is None:
        found = _semantics_beside(beside, tree)
    else:
        found = None if srdf is False else read_srdf(file_path(srdf), tree)
    if own is None or found is None:
        return own or found
    return joined_semantics(found, own)


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
        name_or_file: A name of `scene_names`, or a scene file (.toml), a MoveIt scene (.scene), a MotionBenchMaker
            scene (.yaml, .yml) or an MJCF file (.xml, .mjcf). MoveIt's and MotionBenchMaker's contain only obstacles:
            add arms with `scene.with_arm`. The robot of an MJCF file is the arm "arm" (of several robots, the first one
            moves); all other bodies with contacts are obstacles, at their poses in its first keyframe. Those with a
            free joint are loose bodies with their mass and friction.

    Raises:
        UnknownNameError: no shipped scene of that name.
        FormatError: the file is not a scene.
    """
    return load_scene_file(name_or_file).scene


def load_scene_file(name_or_file: str | Path, robot_loader: RobotLoader = load_arm_robot) -> SceneFile:
    """Load a scene like `load_scene`, together with the named queries of the file.

    Args:
        name_or_file: A name of `scene_names`, or a scene file.
        robot_loader: Reads the robots of .toml files; a cached one serves several scenes.

    Raises:
        UnknownNameError: no shipped scene of that name.
        FormatError: the file is not a scene.
    """
    file = _scene_file(name_or_file)
    if file.suffix.lower() == ".scene":
        return SceneFile(read_moveit_scene(file), {})
    if file.suffix.lower() in (".yaml", ".yml"):
        return SceneFile(read_bench_scene(file), {})
    if file.suffix.lower() in _MJCF_SUFFIXES:
        return SceneFile(read_mjcf_scene(file), {})
    return read_scene(file, robot_loader)


def load_problems(name_or_file: str | Path) -> Mapping[str, Problem]:
    """The named queries of a scene as problems.

    Args:
        name_or_file: A name of `scene_names`, or a scene file; only .toml files have queries.

    Raises:
        UnknownNameError: no shipped scene of that name.
        FormatError: the file is not a scene.
    """
    return load_scene_file(name_or_file).problems


def _scene_file(name_or_file: str | Path) -> Path:
    """The scene file: a name with a suffix is a file, a bare name a shipped scene."""
    file = file_path(name_or_file)
    if file.suffix.lower() in _SCENE_SUFFIXES:
        return file
    if file.suffix.lower() in _URDF_SUFFIXES:
        raise InputError(
            f"{file} is a robot, expected a scene; Scene().with_arm('arm', load_robot({str(file)!r})) is one with it"
        )
    name = str(name_or_file)
    if (
        not isinstance(name_or_file, str)
        or len(file.parts) > 1
        or file.suffix
        or (name not in scene_names() and file.exists())
    ):
        expected = ", ".join(_SCENE_SUFFIXES)
        raise InputError(f"scene file {str(file)!r} {_fault(file)}, expected one of {expected}{_conversion(file)}")
    return models_folder() / "scenes" / f"{known_name('scene', name, scene_names())}.toml"
