"""Scene files: arms, obstacles, held objects, rules and named queries as readable TOML.

    description = "An RR1 on a table."

    [arms.rr1]
    robot = "rr1"                      # a name, or a file relative to this one (and srdf (a file or false), group,
                                       # groups, joints, tool, package_dirs, convex, xacro_arguments: the options of
                                       # `load_robot`)
    xyz = [0, 0, 0]                    # and rpy, quaternion (wxyz) or rotation (rows)
    q = "home"                         # or numbers
    locked_joints = { finger_joint = 0.01 }  # or the name of a state, such as "open"
    limits = { velocity = [1, 1, 1, 2, 2, 2] }  # others: lower, upper, acceleration, jerk, effort; or a preset's name

    [obstacles.box]
    xyz = [-0.4, 0.1, 0.1]
    box = [0.1, 0.1, 0.2]              # see `scene_shapes` for the others
    color = "#8a9ba8"
    mass = 0.5                         # a loose body in simulations [kg]; default: fixed
    friction = 0.8                     # its friction coefficient; default: 1

    [queries.reach]
    goal = { frame = "tool", position = [-0.3, 0.25, 0.2] }

The reader is strict: an unknown key, a wrong type, NaN or a missing entry is an error with its place.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np

from rr1plan.checks import counted, resolved_path, shown
from rr1plan.files.checked_tables import Table, is_number
from rr1plan.files.documents import parse_toml
from rr1plan.files.file_access import read_text, text_stem
from rr1plan.files.toml_writer import to_toml
from rr1plan.robot import Robot
from rr1plan.robot.joint_limits import LIMIT_NAMES
from rr1plan.robot.robot_builder import warn_of_unknown_velocities
from rr1plan.robot.robot_packages import installed_robots
from rr1plan.robot.xacro import XacroArguments, argument_text
from rr1plan.scene import Arm, Attachment, Obstacle, Pair, Scene, pair
from rr1plan.scene.problem import Problem
from rr1plan.scene.scene_elements import names_of_pair
from rr1plan.scene.scene_queries import problem_entries, read_queries
from rr1plan.scene.scene_shapes import geometries_entries, pose_entries, read_convexity, read_geometries, read_pose
from rr1plan.shapes.convex_decomposition import Convexity


class RobotLoader(Protocol):
    """A function that reads robots for the scene, e.g. `rr1plan.load_robot`."""

    def __call__(
        self,
        name_or_file: str,
        *,
        srdf: str | Literal[False] | None = None,
        groups: Sequence[str | Sequence[str]] | None = None,
        joints: Sequence[str] | None = None,
        tool: str | None = None,
        package_dirs: Sequence[str] = (),
        convex: Convexity = "hull",
        xacro_arguments: XacroArguments | None = None,
    ) -> Robot:
        """A robot by name or by the absolute path of its file."""
        ...


_VERSION = 1
_CONTENT = ("arms", "obstacles", "attachments", "padding", "allowed", "pair_padding", "queries")
_FRICTION = Obstacle.friction
_MAX_BYTES = 64 * 1024 * 1024


@dataclass(frozen=True, eq=False)
class SceneFile:
    """The content of a scene file.

    Args:
        scene: The scene.
        problems: Its named queries, as problems in that scene.
    """

    scene: Scene
    problems: Mapping[str, Problem] = field(default_factory=dict)


def read_scene(file: str | Path, load_robot: RobotLoader) -> SceneFile:
    """Read a scene file.

    Args:
        file: The file; paths in it are relative to its folder, and meshes and points stay inside it.
        load_robot: Reads the robots; called once for each that is named.

    Raises:
        FormatError: not TOML, or not a scene; names the place and the line.
    """
    return parse_scene(read_text(file, _MAX_BYTES), file, load_robot)


def parse_scene(text: str, file: str | Path, load_robot: RobotLoader) -> SceneFile:
    """The scene that a scene file's text describes; see `read_scene`.

    Args:
        text: The content of the file.
        file: The file, which paths in the text are relative to.
        load_robot: Reads the robots; called once for each that is named.

    Raises:
        FormatError: not TOML, or not a scene; names the place and the line.
    """
    top = parse_toml(text, file)
    if top.raw("version", _VERSION) != _VERSION:
        raise top.error(f"is version {top.raw('version')!r}, expected {_VERSION}", "version")
    if "segments" in top.entries:
        raise top.error("holds a sequence, not a scene; read it with load_segments", "segments")
    folder = Path(file).absolute().parent
    scene = Scene(name=top.string("name", text_stem(file)), description=top.string("description", ""))
    top.finish(*_CONTENT)  # first, because a misspelled [arms.NAME] makes names in the rules unknown
    arms = _read_arms(top.table("arms"), folder, load_robot)
    with top.blame("arms"):
        scene = replace(scene, arms=arms)
    scene = _with_objects(scene, top, folder)
    scene = _with_rules(scene, top)
    problems = read_queries(top.table("queries"), scene)
    return SceneFile(scene, problems)


def scene_text(
    scene: Scene, problems: Mapping[str, Problem], robots: Mapping[str, str], load_robot: RobotLoader
) -> str:
    """The text of a scene file that reads back as the same scene, to the last bit.

    Args:
        scene: The scene. Meshes and point clouds are written into the file.
        problems: Named queries in that scene.
        robots: Name or file of the robot of each arm; for a file, planning joints and tool are written as well.
        load_robot: Reads the robots that are given by name, whose planning joints and tool are written if they differ
            from those it chooses.

    Raises:
        InputError: a number that TOML cannot represent.
        UnknownNameError: no such robot.
    """
    data: dict[str, Any] = {"version": _VERSION, "name": scene.name, "description": scene.description}
    if scene.padding:
        data["padding"] = scene.padding
    if scene.allowed:
        data["allowed"] = sorted(names_of_pair(p) for p in scene.allowed)
    if scene.pair_padding:
        rows = sorted((names_of_pair(p), distance) for p, distance in scene.pair_padding.items())
        data["pair_padding"] = [{"between": both, "distance": distance} for both, distance in rows]
    made: dict[tuple[Robot, str], Robot | None] = {}  # the many arms of a scene often share one robot
    for n, arm in scene.arms.items():
        if (arm.robot, robots[n]) not in made:
            made[arm.robot, robots[n]] = _named_robot(arm.robot, robots[n], load_robot)
    data["arms"] = {n: _arm_entries(arm, robots[n], made[arm.robot, robots[n]]) for n, arm in scene.arms.items()}
    data["obstacles"] = {
        n: pose_entries(o.pose) | geometries_entries(n, o.geometries) | _body_entries(o)
        for n, o in scene.obstacles.items()
    }
    data["attachments"] = {n: _attachment_entries(n, held) for n, held in scene.attachments.items()}
    data["queries"] = {n: problem_entries(problem) for n, problem in problems.items()}
    return to_toml(data)


def _read_arms(arms: Table, folder: Path, load_robot: RobotLoader) -> dict[str, Arm]:
    loaded: dict[_Reference, Robot] = {}
    finished: dict[tuple[_Reference, str, str], Robot] = {}  # arms with the same entries share one robot
    arms_by_name = {}
    for name in arms.names():
        entry = arms.table(name)
        key = _robot_reference(entry, folder)
        if key not in loaded:
            with entry.blame("robot"):
                arguments = None if key.xacro_arguments is None else dict(key.xacro_arguments)
                loaded[key] = load_robot(**{**key._asdict(), "xacro_arguments": arguments})
        own = (key, repr(entry.raw("limits")), repr(entry.raw(_locked_key(entry))))
        if own not in finished:
            finished[own] = _with_settings(loaded[key], entry)
        arms_by_name[name] = _read_arm(entry, finished[own])
    return arms_by_name


def _with_settings(robot: Robot, entry: Table) -> Robot:
    if "limits" in entry:
        robot = _with_limits(robot, entry)
    given = entry.raw("limits", {})
    if not isinstance(given, str) and "velocity" not in given:
        warn_of_unknown_velocities(robot, robot.joint_names)
    return _with_locked_joints(robot, entry) if _locked_key(entry) in entry else robot


def _read_arm(entry: Table, robot: Robot) -> Arm:
    base = read_pose(entry)
    q = entry.raw("q", "home")
    if not isinstance(q, str):
        q = entry.numbers("q", (None,))
    with entry.blame("q"):
        arm = Arm(robot, base, q)
    entry.finish()
    return arm


class _Reference(NamedTuple):
    """The source of a robot."""

    name_or_file: str
    srdf: str | Literal[False] | None
    groups: tuple[str | tuple[str, ...], ...] | None
    joints: tuple[str, ...] | None
    tool: str | None
    package_dirs: tuple[str, ...]
    convex: Convexity
    xacro_arguments: tuple[tuple[str, str], ...] | None


def _robot_reference(entry: Table, folder: Path) -> _Reference:
    """The source of an arm's robot; a name with a suffix or a slash is a file."""
    name = entry.string("robot")
    with entry.blame("robot"):
        if _is_file(name):
            path = resolved_path(folder / name)
            entry.check_there(path, "robot")
            name = str(path)
    groups = tuple(g if isinstance(g, str) else _chain(entry, g) for g in entry.rows("groups"))
    group = entry.string("group", "")
    if group and groups:
        raise entry.error("expected one of group and groups, got both", "group")
    return _Reference(
        name,
        _srdf(entry, folder),
        (group,) if group else groups or None,
        entry.strings("joints") or None,
        entry.string("tool", "") or None,
        tuple(str(resolved_path(folder / other)) for other in entry.strings("package_dirs")),
        read_convexity(entry),
        _xacro_arguments(entry),
    )


def _srdf(entry: Table, folder: Path) -> str | Literal[False] | None:
    given = entry.raw("srdf", "")
    if given is False:
        return False
    if not isinstance(given, str):
        raise entry.error(f"expected a file or false, got {shown(given)}", "srdf")
    with entry.blame("srdf"):
        return str(resolved_path(folder / given)) if given else None


def _xacro_arguments(entry: Table) -> tuple[tuple[str, str], ...] | None:
    """Names and values, which decide whether a .urdf is expanded as well; None without the key."""
    if "xacro_arguments" not in entry:
        return None
    table = entry.table("xacro_arguments")
    return tuple((name, _xacro_argument(table, name)) for name in table.names())


def _xacro_argument(table: Table, name: str) -> str:
    value = table.required(name)
    if not isinstance(value, str | int | float):
        raise table.error(f"expected text, a number, true or false, got {shown(value)}", name)
    return argument_text(value)


def _chain(entry: Table, value: Any) -> tuple[str, ...]:
    """An entry of groups that is not a name."""
    if not isinstance(value, list) or not all(isinstance(link, str) for link in value):
        raise entry.error(f"expected names of groups or [base link, tip link], got {shown(value)}", "groups")
    return tuple(value)


def _is_file(robot: str) -> bool:
    """Whether a scene file's entry for a robot means a file, not a robot's name."""
    # The names of some installed robots contain a dot.
    return "/" in robot or (bool(Path(robot).suffix) and robot not in installed_robots())


def _with_limits(robot: Robot, entry: Table) -> Robot:
    """The robot under a preset's limits, or with those limits replaced that the file gives."""
    if isinstance(entry.raw("limits"), str):
        with entry.blame("limits"):
            return robot.with_limits(entry.string("limits"))
    table = entry.table("limits")
    values = {name: table.raw(name) for name in LIMIT_NAMES if name in table}
    for name, value in values.items():
        if not isinstance(value, list) or len(value) != robot.nq or not all(is_number(v) for v in value):
            raise table.error(f"expected a list of {counted(robot.nq, 'number')}, one for each joint", name)
    table.finish()
    with entry.blame("limits"):
        return robot.with_limits(replace(robot.limits, **values))


def _locked_key(entry: Table) -> str:
    """Files written before version 0.1 use the key `held`."""
    return entry.spelled("locked_joints", "held")


def _with_locked_joints(robot: Robot, entry: Table) -> Robot:
    key = _locked_key(entry)
    with entry.blame(key):
        if isinstance(entry.raw(key), str):
            return robot.with_locked_joints(entry.string(key))
        table = entry.table(key)
        return robot.with_locked_joints({joint: table.number(joint) for joint in table.names()})


def _with_objects(scene: Scene, top: Table, folder: Path) -> Scene:
    obstacles, attachments = top.table("obstacles"), top.table("attachments")
    read: dict[str, Obstacle] = {}
    for name in obstacles.names():
        entry = obstacles.table(name)
        geometries, where = read_geometries(entry, name, folder), read_pose(entry)
        mass, friction = _read_body(entry)
        entry.finish()
        with entry.blame():
            read[name] = Obstacle(geometries, where, mass, friction)
            replace(scene, obstacles={name: read[name]})  # its name, among those of the arms
    scene = scene.with_obstacles(read)
    for name in attachments.names():
        entry = attachments.table(name)
        with entry.blame():
            scene = _with_attachment(scene, name, entry, folder)
        entry.finish()
    return scene


def _with_attachment(scene: Scene, name: str, entry: Table, folder: Path) -> Scene:
    arm = scene.only_arm(entry.string("arm") if "arm" in entry else None)
    robot = scene.arm(arm).robot
    link = robot.link(entry.string("link", robot.tool)).name
    touch = frozenset(robot.link(other).name for other in entry.strings("touch"))
    held = Attachment(read_geometries(entry, name, folder), arm, link, read_pose(entry), touch, *_read_body(entry))
    return replace(scene, attachments={**scene.attachments, name: held})


def _read_body(entry: Table) -> tuple[float | None, float]:
    """Mass and friction of an object."""
    return entry.number("mass") if "mass" in entry else None, entry.number("friction", _FRICTION)


def _body_entries(thing: Obstacle | Attachment) -> dict[str, Any]:
    entries = {} if thing.mass is None else {"mass": thing.mass}
    return entries | ({} if thing.friction == _FRICTION else {"friction": thing.friction})


def _with_rules(scene: Scene, top: Table) -> Scene:
    padding = top.number("padding", 0.0)
    allowed: set[Pair] = {_read_pair(top, "allowed", both) for both in top.rows("allowed")}
    distances: dict[Pair, float] = {}
    for entry in top.tables("pair_padding"):
        both = _read_pair(entry, "between", entry.required("between"))
        if both in distances:
            raise entry.error(f"{' and '.join(map(repr, sorted(both)))} have two distances, keep one", "between")
        distances[both] = entry.number("distance")
        entry.finish()
    with top.blame("allowed"):
        scene = replace(scene, allowed=frozenset(allowed))
    with top.blame("padding"):
        scene = replace(scene, padding=padding)
    with top.blame("pair_padding"):
        return replace(scene, pair_padding=distances)


def _read_pair(table: Table, key: str, value: object) -> Pair:
    if not isinstance(value, list) or len(value) != 2 or not all(isinstance(name, str) for name in value):
        raise table.error(f"expected pairs of names, got {value!r}", key)
    return pair(*value)


def _named_robot(robot: Robot, name: str, load_robot: RobotLoader) -> Robot | None:
    """The robot that `load_robot` makes from a name without a choice of joints and tool; None for a file."""
    if _is_file(name):
        return None
    options: dict[str, Any] = dict(robot.load_options)
    return load_robot(name, **options)


def _arm_entries(arm: Arm, robot: str, made: Robot | None) -> dict[str, object]:
    """Entries of an arm.

    Args:
        arm: The arm.
        robot: Name or file of its robot.
        made: The robot of that name with its own choice of joints and tool; None for a file.
    """
    entries: dict[str, Any] = {"robot": robot} | pose_entries(arm.base)
    is_file, default = _is_file(robot), made or arm.robot
    other_joints = is_file or default.joint_names != arm.robot.joint_names
    if other_joints:
        entries["joints"] = list(arm.robot.joint_names)
    if other_joints or default.tool != arm.robot.tool:
        entries["tool"] = arm.robot.tool
    named = [name for name, q in default.configurations.items() if np.array_equal(q, arm.q) and not other_joints]
    # Another file, such as the expanded URDF, is read without the arguments of xacro, and may have other groups and
    # another SRDF.
    same = not is_file or Path(robot) == Path(arm.robot.source).absolute()
    for name, value in arm.robot.load_options.items():
        if same or name not in ("xacro_arguments", "groups", "srdf"):
            entries[name] = list(value) if isinstance(value, tuple) else value
    entries["q"] = named[0] if named else arm.q.tolist()
    entries["limits"] = _limits_entry(arm.robot)
    if arm.robot.locked_joints:
        entries["locked_joints"] = dict(arm.robot.locked_joints)
    return entries


def _limits_entry(robot: Robot) -> Any:
    for name, preset in robot.presets.items():
        if all(np.array_equal(getattr(preset, n), getattr(robot.limits, n)) for n in LIMIT_NAMES):
            return name
    return {name: getattr(robot.limits, name).tolist() for name in LIMIT_NAMES}


def _attachment_entries(name: str, held: Attachment) -> dict[str, object]:
    entries: dict[str, Any] = {"arm": held.arm, "link": held.link} | pose_entries(held.pose)
    if held.touch:
        entries["touch"] = sorted(held.touch)
    return entries | geometries_entries(name, held.geometries) | _body_entries(held)
