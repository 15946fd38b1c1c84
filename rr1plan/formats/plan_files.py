"""Paths, trajectories and whole motions as JSON files that prove they are whole.

    {"format": "rr1plan", "version": 1, "kind": "trajectory", "sha256": "...", "content": {...}}

`sha256` is that of the content in one canonical form, so a file that was cut off or altered is
refused. The content names the scene and the robots by their hashes; a motion holds the scene
itself and can be validated and played from the file alone. Floats are written so that they read
back to the last bit; nothing is unpickled; files are replaced in one step.
"""

from __future__ import annotations

import hashlib
import json
import pathlib
from dataclasses import dataclass
from typing import Any

from rr1plan.checks import Value, known_name, of_kind
from rr1plan.formats.csv_files import load_csv as load_csv
from rr1plan.formats.csv_files import save_csv as save_csv
from rr1plan.formats.documents import read_json
from rr1plan.formats.files import write_text
from rr1plan.formats.tables import Table
from rr1plan.formats.values import from_plain, to_plain
from rr1plan.path import Path
from rr1plan.problem import Problem
from rr1plan.report import Report
from rr1plan.robot import Robot
from rr1plan.scene import Arm, Attachment, Obstacle, Scene
from rr1plan.trajectory import Trajectory

_FORMAT = "rr1plan"
_VERSION = 1
_File = str | pathlib.Path


@dataclass(frozen=True, eq=False, repr=False)
class SavedMotion(Value):
    """What a motion file holds.

    Args:
        scene: The scene it was planned in.
        path: The path, when it was saved.
        trajectory: The timed motion, when it was saved.
        report: The referee's verdict at the time, when it was saved.
        problem: The question, when it was saved.
    """

    scene: Scene
    path: Path | None = None
    trajectory: Trajectory | None = None
    report: Report | None = None
    problem: Problem | None = None


def save_path(file: _File, path: Path, scene: Scene) -> pathlib.Path:
    """Write a path to a JSON file and return the file's path.

    Raises:
        UnknownNameError: a joint the scene does not have.
        InputError: the file cannot be written.
    """
    return _write(file, "path", _scene_summary(scene) | {"path": _path_entries(path, scene)})


def save_trajectory(file: _File, trajectory: Trajectory, scene: Scene) -> pathlib.Path:
    """Write a trajectory to a JSON file and return the file's path.

    Raises:
        UnknownNameError: a joint the scene does not have.
        InputError: the file cannot be written.
    """
    return _write(file, "trajectory", _scene_summary(scene) | {"trajectory": _trajectory_entries(trajectory, scene)})


def save_motion(
    file: _File,
    scene: Scene,
    path: Path | None = None,
    trajectory: Trajectory | None = None,
    report: Report | None = None,
    problem: Problem | None = None,
) -> pathlib.Path:
    """Write a scene and what is known of a motion in it to a JSON file and return the file's path.

    Raises:
        UnknownNameError: a joint the scene does not have.
        InputError: the file cannot be written.
    """
    robots: list[Robot] = []
    content = _scene_summary(scene) | {"scene": to_plain(scene, robots)}
    content["robots"] = [to_plain(robot) for robot in robots]
    if path is not None:
        content["path"] = _path_entries(path, scene)
    if trajectory is not None:
        content["trajectory"] = _trajectory_entries(trajectory, scene)
    if report is not None:
        of_kind("report", report, Report)
        content["report"] = to_plain(report)
    if problem is not None:
        of_kind("problem", problem, Problem)
        content["problem"] = {n: to_plain(getattr(problem, n)) for n in ("start", "goal", "arms")}
    return _write(file, "motion", content)


def load_path(file: _File, scene: Scene | None = None) -> Path:
    """Read a path from a path file or a motion file.

    Args:
        file: The file.
        scene: The scene it has to be for.

    Raises:
        FormatError: cut off, altered, of another version or kind, or made for another scene.
    """
    content = _read(file, ("path", "motion"))
    _check_scene(content, scene)
    return _read_path(content.table("path"))


def load_trajectory(file: _File, scene: Scene | None = None) -> Trajectory:
    """Read a trajectory from a trajectory file or a motion file.

    Args:
        file: The file.
        scene: The scene it has to be for.

    Raises:
        FormatError: cut off, altered, of another version or kind, or made for another scene.
    """
    content = _read(file, ("trajectory", "motion"))
    _check_scene(content, scene)
    return _read_trajectory(content.table("trajectory"))


def load_motion(file: _File, scene: Scene | None = None) -> SavedMotion:
    """Read a motion file.

    Args:
        file: The file.
        scene: The scene it has to be for (default: the one it holds).

    Raises:
        FormatError: cut off, altered, of another version or kind, or made for another scene.
    """
    content = _read(file, ("motion",))
    _check_scene(content, scene)
    with content.blame():
        held = _read_scene(content)
        report = from_plain(content.raw("report"))
        if not isinstance(report, Report | None):
            raise content.error("holds something else in the place of a report")
        problem = content.table("problem") if "problem" in content else None
        question = {n: from_plain(problem.required(n)) for n in ("start", "goal", "arms")} if problem else None
        return SavedMotion(
            scene=held,
            path=_read_path(content.table("path")) if "path" in content else None,
            trajectory=_read_trajectory(content.table("trajectory")) if "trajectory" in content else None,
            report=report,
            problem=Problem(held, **question) if question else None,
        )


# ---- the file ------------------------------------------------------------------------------


def _write(file: _File, kind: str, content: dict[str, Any]) -> pathlib.Path:
    text = _canonical(content)
    digest = hashlib.sha256(text.encode()).hexdigest()
    head = json.dumps({"format": _FORMAT, "version": _VERSION, "kind": kind, "sha256": digest})
    return write_text(file, f'{head[:-1]}, "content": {text}}}\n')


def _canonical(content: Any) -> str:
    return json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)


def _read(file: _File, kinds: tuple[str, ...]) -> Table:
    """The content of a file, proven whole."""
    top = read_json(file)
    if top.raw("format") != _FORMAT:
        raise top.error("is not a file of rr1plan: it has no entry 'format' that says so")
    if top.raw("version") != _VERSION:
        raise top.error(f"has version {top.raw('version')!r}, expected {_VERSION}")
    kind, digest = top.string("kind"), top.string("sha256")
    if kind not in kinds:
        raise top.error(f"holds a {kind}, expected a {' or a '.join(kinds)}")
    content = top.table("content")
    top.finish()
    try:
        whole = hashlib.sha256(_canonical(top.raw("content")).encode()).hexdigest() == digest
    except ValueError as error:
        raise top.error(f"holds a number that is not finite: {error}") from error
    if not whole:
        raise top.error("was altered after it was written: its content does not have the sha256 that it names")
    return content


def _scene_summary(scene: Scene) -> dict[str, Any]:
    of_kind("scene", scene, Scene)
    robots = {name: {"robot": arm.robot.name, "sha256": arm.robot.content_hash} for name, arm in scene.arms.items()}
    return {"made_for": {"scene": scene.name, "sha256": scene.content_hash, "arms": robots}}


def _check_scene(content: Table, scene: Scene | None) -> None:
    """Refuse a file that was made for another scene, saying what differs."""
    if scene is None:
        return
    of_kind("scene", scene, Scene)
    made_for = content.table("made_for")
    if made_for.string("sha256") == scene.content_hash:
        return
    mine = _scene_summary(scene)["made_for"]["arms"]
    arms = made_for.table("arms")
    differ = [name for name in {**mine, **dict.fromkeys(arms.names())} if arms.raw(name) != mine.get(name)]
    what = f"the robot of arm {differ[0]!r} differs" if differ else "its obstacles, places or rules differ"
    raise content.error(f"was made for another scene ({made_for.string('scene')!r}): {what}")


def _path_entries(path: Path, scene: Scene) -> dict[str, Any]:
    of_kind("path", path, Path)
    head = {"joint_names": list(path.joint_names), "units": _units(path.joint_names, scene)}
    return head | {"waypoints": path.waypoints.tolist()}


def _trajectory_entries(trajectory: Trajectory, scene: Scene) -> dict[str, Any]:
    of_kind("trajectory", trajectory, Trajectory)
    head = {"joint_names": list(trajectory.joint_names), "units": _units(trajectory.joint_names, scene)}
    return head | {
        "time_unit": "s",
        "breaks": trajectory.breaks.tolist(),
        "coefficients": trajectory.coefficients.tolist(),
    }


def _units(joint_names: tuple[str, ...], scene: Scene) -> list[str]:
    units: dict[str, str] = {}
    for arm, placed in scene.arms.items():
        kinds = {name: placed.robot.joint(name).kind for name in placed.robot.joint_names}
        units |= {f"{arm}/{name}": "m" if kind == "prismatic" else "rad" for name, kind in kinds.items()}
    return [units[known_name("joint", name, units)] for name in joint_names]


def _read_scene(content: Table) -> Scene:
    """The scene of a motion file."""
    listed = content.required("robots")
    if not isinstance(listed, list):
        raise content.error(f"holds {type(listed).__name__} in the place of a list of robots")
    try:
        scene = from_plain(content.required("scene"), [from_plain(data) for data in listed])
    except (AttributeError, TypeError) as error:
        # Parts that are values of their own, but not those a scene is made of.
        raise content.error(f"holds something that makes no scene: {error}") from error
    if not isinstance(scene, Scene):
        raise content.error("holds something else in the place of a scene")
    for parts, kind in ((scene.arms, Arm), (scene.obstacles, Obstacle), (scene.attachments, Attachment)):
        for name, part in parts.items():
            if not isinstance(part, kind):
                raise content.error(f"holds {type(part).__name__} in the place of the {kind.__name__} {name!r}")
    return scene


def _read_path(entry: Table) -> Path:
    with entry.blame():
        return Path(entry.strings("joint_names"), entry.numbers("waypoints", (None, None)))


def _read_trajectory(entry: Table) -> Trajectory:
    with entry.blame():
        breaks, coefficients = entry.numbers("breaks", (None,)), entry.numbers("coefficients", (None, None, None))
        return Trajectory(entry.strings("joint_names"), breaks, coefficients)
