"""The scene, query and view of a command, from its options."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import rr1plan as rp
from rr1plan.checks import file_path, known_name
from rr1plan.errors import FormatError, InputError
from rr1plan.export.motion_files import is_motion_file
from rr1plan.files.documents import read_json
from rr1plan.files.file_access import content_suffix
from rr1plan.scene.model_library import installed_robot_names, load_problems, robot_names, scene_names
from rr1plan.scene.problem import Problem
from rr1plan.scene.scene_toml import SceneFile

ROBOT_SUFFIXES = (".urdf", ".xacro")
"""Suffixes of files that hold a robot and no scene; MJCF files hold both."""


def check_scene_name(name: str) -> None:
    """Reject robots, motions, recordings and sequences in place of a scene; the message names commands that take them.

    Raises:
        InputError: not a scene, or a file that does not exist.
    """
    file = Path(name)
    if name in scene_names():
        return
    is_robot = name in (*robot_names(), *installed_robot_names())
    if not is_robot:
        check_file_exists(name)
    if is_robot or file.suffix.lower() in ROBOT_SUFFIXES:
        raise InputError(
            f"{name} is a robot, expected a scene: a file with the lines [arms.NAME] and robot = {name!r}; to see the "
            f"robot: rr1plan view {name}"
        )
    if file.is_file() and file.suffix.lower() == ".jsonl":
        raise InputError(f"{name} is a recording, expected a scene; to see it: rr1plan mirror {name}")
    if file.is_file() and is_motion_file(name):
        if content_suffix(name) == ".json" and read_json(name).raw("format", None) != "rr1plan":
            raise InputError(f"{name} is JSON without a motion, expected a scene")
        raise InputError(
            f"{name} holds a motion, expected a scene; to see it: rr1plan view {name}, to check it: rr1plan validate "
            f"{name}"
        )
    refuse_sequence(name)


def check_file_exists(name: str) -> None:
    """Reject names that can only be those of files, with a suffix or a folder, if there is no such file.

    Raises:
        FormatError: no such file.
    """
    file = file_path(name)
    if (file.suffix or len(file.parts) > 1) and not file.exists():
        raise FormatError("there is no such file", file)


def refuse_sequence(name: str) -> None:
    """Reject files of sequences that are not planned; the message names the command that takes them.

    Raises:
        InputError: such a file.
    """
    # The readers of sequences are not needed for shipped scenes.
    from rr1plan.sequences.sequence_toml import is_sequence_file

    if is_sequence_file(name):
        raise InputError(f"{name} holds a sequence, which has no motion yet; to plan and see it: rr1plan plan {name}")


def chosen_problem(options: Namespace, file: SceneFile) -> Problem:
    """The problem given by the options, or the scene's first query.

    Raises:
        InputError: a scene without queries and no goal.
    """
    if options.goal is None and options.position is None:
        problem = chosen_query(options.scene, file.problems, options.query)
        if options.start is None:
            return problem
        start = name_or_numbers(options.start)
        return rp.Problem(problem.scene, start, dict(problem.goal)).with_margin(problem.margin)
    arm = file.scene.only_arm(options.arm)
    if options.goal is not None:
        robot = file.scene.arms[arm].robot
        goal: Any = robot.configuration(name_or_numbers(options.goal), f"goal of {arm!r}")
    else:
        goal = rp.PoseGoal(options.frame or "tool", options.position, options.quaternion)
    start = None if options.start is None else {arm: name_or_numbers(options.start)}
    return rp.Problem(file.scene, start, {arm: goal})


def named_query(scene: str, name: str | None) -> Problem:
    """A query of a scene by name, or its first.

    Raises:
        UnknownNameError: no query of that name.
        InputError: the scene has no queries.
    """
    return chosen_query(scene, load_problems(scene), name)


def chosen_query(scene: str, queries: Mapping[str, Problem], name: str | None) -> Problem:
    """The query of that name, or the first.

    Raises:
        UnknownNameError: no query of that name.
        InputError: there are no queries.
    """
    if not queries:
        raise InputError(f"scene {scene!r} has no queries; give a goal (option goal, option position)")
    return queries[next(iter(queries)) if name is None else known_name("query", name, queries)]


def page_options(options: Namespace) -> rp.ViewOptions | None:
    """The view options of the command line; None if it gives none, so that no viewer is loaded.

    Raises:
        UnknownNameError: no such view.
        InputError: numbers that are neither angles nor a direction.
    """
    spheres = getattr(options, "spheres", False)
    if options.view is None and not spheres:
        return None
    view = None if options.view is None else name_or_numbers(options.view, "a view's name")
    return rp.ViewOptions(view=view, spheres=spheres)


def name_or_numbers(values: list[str], name: str = "a configuration's name") -> Any:
    """The values of an option: a name, or numbers.

    Raises:
        InputError: several words that are not numbers, or numbers separated by commas.
    """
    text = " ".join(values).strip()
    try:
        return [float(word) for word in text.split() or values]
    except ValueError:
        if "," in text and not text.strip("0123456789+-.eE, "):
            raise InputError(f"{text!r}: separate numbers by spaces, not by commas") from None
        if len(values) == 1:
            return text
        raise InputError(f"{text!r} is neither {name} nor numbers") from None


def with_limits(problem: Problem, preset: str) -> Problem:
    """The problem with every arm under a limit preset of its robot."""
    scene = problem.scene
    for name, arm in scene.arms.items():
        known_name("limit preset", preset, arm.robot.presets, f"These are the presets of arm {name!r}.")
        scene = scene.with_robot(name, arm.robot.with_limits(preset))
    return problem.in_scene(scene)
