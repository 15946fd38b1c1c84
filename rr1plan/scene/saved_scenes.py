"""Scenes as files that read back as the same scene, with the robots that they name."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rr1plan.checks import check_text, known_name, of_kind
from rr1plan.errors import FormatError, InputError, UnknownNameError
from rr1plan.files.file_access import check_writable, write_text
from rr1plan.robot import Robot
from rr1plan.robot.robot_packages import installed_robots
from rr1plan.scene import Arm, Scene
from rr1plan.scene.model_library import load_arm_robot, locate_robot, robot_names
from rr1plan.scene.problem import Problem
from rr1plan.scene.scene_toml import RobotLoader, parse_scene, scene_text


def save_scene(
    file: str | Path,
    scene: Scene,
    *,
    problems: Mapping[str, Problem] | None = None,
    robots: Mapping[str, str] | None = None,
) -> Path:
    """Write a scene file (.toml) from which `load_scene` loads the same scene, to the last bit.

    Args:
        file: The file, whose name ends in .toml; it is replaced atomically.
        scene: The scene. Meshes and point clouds are written into the file.
        problems: Named queries, for `load_problems`. Those of another scene are saved as queries in `scene`, if their
            arms have the same joints there (`Problem.in_scene`).
        robots: Name or file of the robot of each arm, files relative to the scene file (default: the name with which
            `load_robot` makes this robot if it ships with rr1plan or is installed, else the file it was loaded from).

    Returns:
        The file.

    Raises:
        InputError: a problem of other arms or joints, a robot that was not loaded from a file, a scene that would read
            back differently (a robot that was changed after loading, or has other named configurations) or not at all,
            another suffix, or a file that cannot be written.
        UnknownNameError: a name in `robots` is not an arm.
    """
    of_kind("scene", scene, Scene)
    path = check_writable(file, ".toml")
    of_kind("problems", problems, Mapping, optional=True)
    of_kind("robots", robots, Mapping, optional=True)
    problems = {name: _problem_in(scene, name, problem) for name, problem in (problems or {}).items()}
    for name, robot in (robots or {}).items():
        known_name("arm", name, scene.arms)
        check_text(f"robot of arm {name!r}", robot)
    # One entry for each robot: the many arms of a scene often share one.
    entries: dict[Robot, str] = {}
    names = dict(robots or {})
    load = _once_for_each(load_arm_robot)
    for name, arm in scene.arms.items():
        if not names.get(name):
            names[name] = entries.get(arm.robot) or entries.setdefault(arm.robot, _robot_entry(name, arm.robot, load))
    try:
        text = scene_text(scene, problems, names, load)
        again = parse_scene(text, path, load).scene
    except (FormatError, UnknownNameError) as error:
        raise InputError(f"{path} would not read back: {error}") from error
    for name, arm in scene.arms.items():
        _check_reads_back(path, name, arm, again.arms[name], names[name])
    return write_text(path, text)


def _problem_in(scene: Scene, name: str, problem: Problem) -> Problem:
    of_kind("one of the problems", problem, Problem)
    try:
        return problem if problem.scene is scene else problem.in_scene(scene)
    except InputError as error:
        raise InputError(f"problem {name!r} cannot be a query of the scene {scene.name!r}: {error}") from error


def _check_reads_back(path: Path, name: str, arm: Arm, again: Arm, entry: str) -> None:
    """Reject an arm that differs from what its entry in the file makes.

    Raises:
        InputError: names what differs, and what to do.
    """
    part = _unequal_part(arm, again)
    if not part:
        return
    advice = (
        "scene files contain no named configurations: keep those of load_robot and give other values as "
        "numbers, or define them in an SRDF beside a URDF and name it"
        if part.startswith("configuration")
        else "save its URDF and SRDF as files, or name a robot that equals it"
    )
    raise InputError(
        f"{path} would not read back as this scene: the {part} of arm {name!r} differs from what "
        f"load_robot({entry!r}) makes; {advice}: robots={{{name!r}: NAME_OR_FILE}}"
    )


def _unequal_part(arm: Arm, again: Arm) -> str:
    """What differs in an arm that was read back; "" if nothing does."""
    one, two = arm.robot, again.robot
    if one.content_hash != two.content_hash:
        return "robot"
    # The hash contains neither of these.
    if one.tool != two.tool:
        return f"tool {one.tool!r}"
    before, after = _values(one), _values(two)
    for name in {**before, **after}:
        if before.get(name) != after.get(name):
            return f"configuration {name!r}"
    return "" if np.array_equal(arm.q, again.q) else "q"


def _values(robot: Robot) -> dict[str, list[float]]:
    """The named configurations of a robot as lists [rad or m]."""
    return {name: q.tolist() for name, q in robot.configurations.items()}


def _once_for_each(load: RobotLoader) -> RobotLoader:
    """The loader, called once for the same arguments."""
    loaded: dict[str, Robot] = {}

    def once(name_or_file: str, **options: Any) -> Robot:
        given = {name: value for name, value in options.items() if value not in (None, (), "hull")}
        key = json.dumps((name_or_file, given), sort_keys=True)  # lists are equal to tuples
        if key not in loaded:
            loaded[key] = load(name_or_file, **options)
        return loaded[key]

    return once


def _robot_entry(arm: str, robot: Robot, load: RobotLoader) -> str:
    """Entry of a robot in a scene file: its name if it ships with rr1plan or is installed, else its file."""
    source = Path(robot.source)
    named = next((name for name in (*robot_names(), *installed_robots()) if locate_robot(name)[1] == source), None)
    if named is not None and (named in robot_names() or _is_default(robot, named, load)):
        return named
    if not source.suffix:  # of planar_arm, for example
        raise InputError(
            f"the robot {robot.name!r} of arm {arm!r} was made in Python and has no file that a scene file could name; "
            "save a motion of plan_motion instead, which contains its scene and robots, or pickle the scene"
        )
    if not source.is_file():
        raise InputError(
            f"the robot {robot.name!r} of arm {arm!r} was loaded from no file that is there now; "
            f"name one with robots={{{arm!r}: 'robot.urdf'}}"
        )
    return str(source.absolute())


def _is_default(robot: Robot, name: str, load: RobotLoader) -> bool:
    """Whether the loader makes this robot from its name, up to what scene files hold.

    That is tool, planning joints, limits and locked joints.
    """
    options: dict[str, Any] = dict(robot.load_options)
    made = load(name, **options)
    if made.joint_names != robot.joint_names:
        made = load(name, tool=robot.tool, joints=robot.joint_names, **options)
    elif made.tool != robot.tool:
        made = load(name, tool=robot.tool, **options)
    made = replace(made, limits=robot.limits, locked_joints=robot.locked_joints)
    # The configurations are not in the hash, but decide what goals and `q` of the file mean.
    return (made.content_hash, _values(made)) == (robot.content_hash, _values(robot))
