"""Paths, trajectories and motions as JSON files with a checksum.

    {"format": "rr1plan", "version": 2, "kind": "trajectory", "sha256": "...", "content": {...}}

`sha256` is the hash of the content in canonical form, so a truncated or modified file is
rejected. The content is first validated against `motion_schema`. It contains the scene with its
robots, and their hashes; path and trajectory files of earlier versions contain the hashes only. Large meshes and point
clouds are in the folder "geometry" next to the file, unless they are embedded. Floats are exact to
the last bit; nothing is unpickled; files are replaced atomically.
"""

from __future__ import annotations

import hashlib
import json
import pathlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from rr1plan.checks import Value, counted, file_path, known_name, of_kind, shown
from rr1plan.errors import FormatError, InputError
from rr1plan.export import motion_schema as schema
from rr1plan.export import motion_values as values
from rr1plan.files.documents import read_json
from rr1plan.files.file_access import check_writable, write_text
from rr1plan.path import Path
from rr1plan.report import Report
from rr1plan.scene import Scene
from rr1plan.scene.joint_units import joint_units
from rr1plan.scene.problem import Problem
from rr1plan.shapes import Mesh, PointCloud
from rr1plan.shapes.content_digest import value_hash
from rr1plan.shapes.stored_shapes import FOLDER, read_shape, store_shapes
from rr1plan.trajectory import Trajectory

_FORMAT = "rr1plan"
# A trajectory starts and ends where its path does, up to rounding [rad or m].
_SAME_END = 1e-6
_File = str | pathlib.Path


@dataclass(frozen=True, eq=False, repr=False)
class SavedMotion(Value):
    """Content of a motion file; entries that the file lacks are None.

    Args:
        scene: The scene in which the motion was planned.
        path: The path.
        trajectory: The trajectory.
        report: The referee's report at the time of saving.
        problem: The planning problem.
        plan_graph: The temporal plan graph as plain values; `rr1plan.load_plan_graph` converts it.
        sequence: The stages of a sequence as in the file; `rr1plan.load_sequence` converts them.
        units: The unit of each column of the trajectory or path.
        made_for: Names and hashes of the scene and its robots.
    """

    scene: Scene | None = None
    path: Path | None = None
    trajectory: Trajectory | None = None
    report: Report | None = None
    problem: Problem | None = None
    plan_graph: Mapping[str, object] | None = None
    sequence: schema.Sequence | None = None
    units: tuple[str, ...] | None = None
    made_for: schema.SceneReference | None = None


# ---- writing -------------------------------------------------------------------------------


def save_trajectory(file: _File, trajectory: Trajectory, scene: Scene, *, embed: bool = False) -> pathlib.Path:
    """Write a trajectory and its scene to a JSON file and return the file's path.

    Args:
        file: The file; read it with `load_motion`.
        trajectory: The timed motion.
        scene: The scene it was made in.
        embed: Put large meshes and point clouds into the file; see `save_motion`.

    Raises:
        UnknownNameError: a joint the scene does not have.
        InputError: the file cannot be written.
    """
    return _save(file, "trajectory", scene, {"trajectory": _trajectory_entry(trajectory, scene)}, embed)


def save_motion(
    file: _File,
    scene: Scene,
    *,
    path: Path | None = None,
    trajectory: Trajectory | None = None,
    report: Report | None = None,
    problem: Problem | None = None,
    plan_graph: Mapping[str, object] | None = None,
    embed: bool = False,
) -> pathlib.Path:
    """Write a scene and a motion in it to a JSON file and return the file's path.

    Args:
        file: The file, whose name ends in .json; read it with `load_motion`.
        scene: The scene.
        path: The path.
        trajectory: The trajectory.
        report: The referee's report.
        problem: The planning problem, whose arms have the same joints in `scene`.
        plan_graph: The temporal plan graph of the trajectory as returned by `PlanGraph.to_dict`; see also
            `rr1plan.save_plan_graph`.
        embed: Embed large meshes and point clouds, which makes the file self-contained. Otherwise they are written to
            the folder "geometry" next to it, named by their hashes and shared by all motions there; copy both.

    Raises:
        UnknownNameError: a joint the scene does not have.
        InputError: a value that cannot be saved, a trajectory whose start or end differs from that of the path, a
            problem of other arms or joints, another suffix, or the file cannot be written.
    """
    of_kind("scene", scene, Scene, method="save")
    entries = _motion_entries(scene, path, trajectory, report, problem)
    if plan_graph is not None:
        if not isinstance(plan_graph, Mapping):
            raise InputError(f"plan_graph is {shown(plan_graph)}, expected a mapping, which PlanGraph.to_dict gives")
        if trajectory is None:
            raise InputError("a plan graph is saved with the trajectory of its plan")
        entries["plan_graph"] = dict(plan_graph)
    return _save(file, "motion", scene, entries, embed)


def save_sequence_document(
    file: _File,
    scene: Scene,
    trajectory: Trajectory,
    sequence: Mapping[str, object],
    *,
    report: Report | None = None,
    embed: bool = False,
) -> pathlib.Path:
    """Write a planned sequence to a JSON file and return the file's path; see `rr1plan.SequencePlan.save`.

    Args:
        file: The file; read it with `rr1plan.load_sequence`.
        scene: The scene at the beginning.
        trajectory: The motion.
        sequence: Its stages and gripper joints in the form of the schema.
        report: The referee's report.
        embed: Put large meshes and point clouds into the file; see `save_motion`.

    Raises:
        InputError: a value that cannot be saved, or the file cannot be written.
    """
    entries = _motion_entries(scene, None, trajectory, report, None) | {"sequence": dict(sequence)}
    return _save(file, "sequence", scene, entries, embed)


def motion_text(
    scene: Scene,
    *,
    path: Path | None = None,
    trajectory: Trajectory | None = None,
    report: Report | None = None,
    problem: Problem | None = None,
) -> str:
    """The text of a self-contained motion file; see `save_motion`."""
    return _text("motion", scene, _motion_entries(scene, path, trajectory, report, problem), None)


def _motion_entries(
    scene: Scene,
    path: Path | None,
    trajectory: Trajectory | None,
    report: Report | None,
    problem: Problem | None,
) -> dict[str, object]:
    entries: dict[str, Any] = {}
    if path is not None:
        entries["path"] = _path_entry(path, scene)
    if trajectory is not None:
        entries["trajectory"] = _trajectory_entry(trajectory, scene)
    _check_ends(path, trajectory)
    if report is not None:
        of_kind("report", report, Report)
        entries["report"] = report.to_dict()
    if problem is not None:
        of_kind("problem", problem, Problem)
        if problem.scene is not scene:
            problem = problem.in_scene(scene)  # values are read back in the order of the joints there
        entries["problem"] = {n: values.plain(getattr(problem, n)) for n in ("start", "goal", "arms")}
        if problem.margin > 0.0:  # earlier versions reject the entry
            entries["problem"]["margin"] = problem.margin
    return entries


def _save(file: _File, kind: str, scene: Scene, entries: dict[str, object], embed: bool) -> pathlib.Path:
    of_kind("embed", embed, bool)
    stored: values.Shapes | None = None if embed else {}
    target = check_writable(file, ".json")
    text = _text(kind, scene, entries, stored)
    if stored:
        store_shapes(target.parent / FOLDER, stored)
    return write_text(target, text)


def _text(kind: str, scene: Scene, entries: dict[str, object], stored: values.Shapes | None) -> str:
    """The text of the file, validated for reading. `stored` collects shapes in separate files."""
    content = {"made_for": _reference(scene), **values.plain_scene(scene, stored), **entries}
    try:
        msgspec.convert(content, schema.DOCUMENTS[kind])
        if content.get("report") is not None:
            Report.from_dict(content["report"])
        text = json.dumps(content, separators=(",", ":"), allow_nan=False)
        digest = _digest(content)
    except (msgspec.ValidationError, ValueError) as error:
        raise InputError(f"the {kind} cannot be saved: {error}") from error
    head = json.dumps({"format": _FORMAT, "version": schema.VERSION, "kind": kind, "sha256": digest})
    return f'{head[:-1]}, "content": {text}}}\n'


def _digest(content: object) -> str:
    """SHA-256 of the content in canonical form.

    Raises:
        ValueError: a number that is not finite.
    """
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _reference(scene: Scene) -> dict[str, object]:
    of_kind("scene", scene, Scene)
    arms = {name: {"robot": arm.robot.name, "sha256": arm.robot.content_hash} for name, arm in scene.arms.items()}
    return {"scene": scene.name, "sha256": scene.content_hash, "arms": arms}


def _path_entry(path: Path, scene: Scene) -> dict[str, object]:
    of_kind("path", path, Path)
    head = {"joint_names": list(path.joint_names), "units": joint_units(path.joint_names, scene)}
    return head | {"waypoints": path.waypoints.tolist()}


def _trajectory_entry(trajectory: Trajectory, scene: Scene) -> dict[str, object]:
    of_kind("trajectory", trajectory, Trajectory)
    head = {"joint_names": list(trajectory.joint_names), "units": joint_units(trajectory.joint_names, scene)}
    return head | {
        "time_unit": "s",
        "breaks": trajectory.breaks.tolist(),
        "coefficients": trajectory.coefficients.tolist(),
    }


# ---- reading -------------------------------------------------------------------------------


def read_plan_file(file: _File, scene: Scene | None = None) -> SavedMotion:
    """Read a motion, trajectory or path file.

    Args:
        file: The file.
        scene: A scene with the meshes that are missing next to the file.

    Raises:
        FormatError: truncated, modified, of another version or kind, or inconsistent content.
    """
    document = _read(file)
    try:
        return _saved(document, _Geometry(file_path(file), scene))
    except FormatError as error:
        raise error if error.file is not None else FormatError(str(error), file) from error
    except InputError as error:
        raise FormatError(str(error), file) from error


def _read(file: _File) -> schema.Document:
    """The content of a file, with checksum and types validated."""
    top = read_json(file)
    if top.raw("format") != _FORMAT:
        raise top.error("is not a file of rr1plan: it has no entry 'format' that says so")
    if top.raw("version") != schema.VERSION:
        raise top.error(f"has version {top.raw('version')!r}, expected {schema.VERSION}")
    kind, sha256, content = top.string("kind"), top.string("sha256"), top.table("content").entries
    top.finish()
    with top.blame("kind"):
        entries = schema.DOCUMENTS[known_name("kind of file", kind, schema.DOCUMENTS)]
    try:
        whole = _digest(content) == sha256
    except ValueError as error:
        raise top.error(f"holds a number that is not finite: {error}") from error
    if not whole:
        raise top.error("was altered after it was written: its content does not match its sha256")
    try:
        return msgspec.convert(content, entries)
    except msgspec.ValidationError as error:
        raise top.error(str(error), "content") from error


class _MissingShape(InputError):
    """A mesh or point cloud is neither next to the file nor in the given scene."""


class _Geometry:
    """Finds meshes and point clouds by their hashes: next to a file, or in a scene."""

    def __init__(self, file: pathlib.Path, scene: Scene | None) -> None:
        self.has_scene = scene is not None
        self._folder = file.parent / FOLDER
        self._known = {} if scene is None else {value_hash(shape): shape for shape in _large_shapes(scene)}

    def __call__(self, sha256: str) -> Mesh | PointCloud:
        if sha256 not in self._known:
            if not (self._folder / f"{sha256}.npz").exists():
                raise _MissingShape(
                    f"refers to the mesh {sha256[:12]}..., which is not in {self._folder}: keep that folder beside the "
                    "file, give a scene with the same robots (option scene), or save the motion whole (option embed)"
                )
            self._known[sha256] = read_shape(self._folder, sha256)
        return self._known[sha256]


def _large_shapes(scene: Scene) -> list[Mesh | PointCloud]:
    robots = {id(arm.robot): arm.robot for arm in scene.arms.values()}.values()
    geometries = [g for robot in robots for link in robot.links for g in (*link.visuals, *link.collisions)]
    for parts in (scene.obstacles, scene.attachments):
        geometries += [g for part in parts.values() for g in part.geometries]
    return [g.shape for g in geometries if isinstance(g.shape, Mesh | PointCloud)]


def _saved(document: schema.Document, geometry: _Geometry) -> SavedMotion:
    """The values of a document.

    Raises:
        InputError: values that are invalid, alone or together.
    """
    scene = _scene(document, geometry)
    motion = document if isinstance(document, schema.MotionDocument) else None
    sequence = document if isinstance(document, schema.SequenceDocument) else None
    whole = sequence or motion
    path = document.path if isinstance(document, schema.PathDocument | schema.MotionDocument) else None
    trajectory = document.trajectory if isinstance(document, schema.TrajectoryDocument) else None
    if whole is not None:
        trajectory = whole.trajectory
    columns = [entry for entry in (path, trajectory) if entry is not None]
    for entry in columns:
        _check_units(entry, scene)
    built_path = None if path is None else values.build_path(path)
    built_trajectory = None if trajectory is None else values.build_trajectory(trajectory)
    _check_ends(built_path, built_trajectory)
    return SavedMotion(
        scene=scene,
        path=built_path,
        trajectory=built_trajectory,
        report=None if whole is None or whole.report is None else Report.from_dict(whole.report),
        problem=_problem(motion, scene),
        plan_graph=None if motion is None or motion.plan_graph is None else msgspec.to_builtins(motion.plan_graph),
        sequence=None if sequence is None else sequence.sequence,
        units=None if whole is not None else tuple(columns[0].units),
        made_for=document.made_for,
    )


def _check_ends(path: Path | None, trajectory: Trajectory | None) -> None:
    """Require equal starts and ends of a path and a trajectory, in all joints of both.

    Raises:
        InputError: a path of another motion, or a reversed path.
    """
    if path is None or trajectory is None:
        return
    both = [name for name in path.joint_names if name in trajectory.joint_names]
    ends = path.waypoints[[0, -1]][:, [path.joint_names.index(name) for name in both]]
    timed = trajectory([trajectory.start_time, trajectory.end_time])
    timed = timed[:, [trajectory.joint_names.index(name) for name in both]]
    for verb, off in zip(("starts", "ends"), np.abs(ends - timed), strict=True):
        if off.max(initial=0.0) > _SAME_END:
            reversed_path = np.abs(ends[::-1] - timed).max() <= _SAME_END
            raise InputError(
                f"the path is not that of the trajectory: {both[int(off.argmax())]!r} {verb} {off.max():.3g} rad or m "
                f"from where the trajectory {verb}{', because the path runs backwards' if reversed_path else ''}"
            )


def _problem(motion: schema.MotionDocument | None, scene: Scene | None) -> Problem | None:
    if motion is None or motion.problem is None or scene is None:
        return None
    return values.build_problem(motion.problem, scene)


def _scene(document: schema.Document, geometry: _Geometry) -> Scene | None:
    """The scene in a document; None if it only refers to one.

    A path or trajectory with missing meshes can still be validated in a given scene.
    """
    if document.scene is None:
        if document.robots:
            raise InputError("robots: belong to a scene, which the file does not hold")
        return None
    try:
        scene = values.build_scene(document.scene, document.robots, geometry)
    except _MissingShape:
        if isinstance(document, schema.MotionDocument | schema.SequenceDocument) or not geometry.has_scene:
            raise
        return None
    if msgspec.to_builtins(document.made_for) != _reference(scene):
        raise InputError("made_for: names another scene than the one that the file holds")
    return scene


def _check_units(entry: schema.Path | schema.Trajectory, scene: Scene | None) -> None:
    """Require a unit for each column, that of its joint if the scene is known."""
    if len(entry.units) != len(entry.joint_names):
        raise InputError(f"has {counted(len(entry.units), 'unit')} for {counted(len(entry.joint_names), 'joint')}")
    if scene is not None and entry.units != (wanted := joint_units(entry.joint_names, scene)):
        raise InputError(f"units are {', '.join(entry.units)}, expected those of the joints: {', '.join(wanted)}")
