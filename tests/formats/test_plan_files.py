"""Saved paths, trajectories and motions: complete, exact, for the right scene, or rejected with a reason."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from path_files import save_path

from rr1plan.errors import FormatError, InputError, UnknownNameError
from rr1plan.export import plan_files
from rr1plan.export.motion_values import plain
from rr1plan.export.plan_files import read_plan_file
from rr1plan.files import file_access
from rr1plan.path import Path
from rr1plan.report import Margin, Report, Violation
from rr1plan.scene import Scene
from rr1plan.scene.model_library import load_problems, load_robot, load_scene
from rr1plan.scene.problem import PoseGoal, Problem, RegionGoal
from rr1plan.shapes import Box, Mesh, PointCloud
from rr1plan.trajectory import Trajectory
from rr1plan.transforms import pose


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene("planar2r_path")


@pytest.fixture(scope="module")
def trajectory(scene: Scene) -> Trajectory:
    q0, move = np.array([0.2, -0.9]), np.array([1.0 / 3.0, 0.7])
    return Trajectory(scene.joint_names(), [0.0, 2.0], np.array([q0, 0 * q0, 3 * move / 4, -2 * move / 8])[None])


@pytest.fixture
def path(scene: Scene) -> Path:
    return Path(scene.joint_names(), [[0.1, 1.0 / 3.0], [0.2, 1e-17], [np.pi, -2.0]])


def rewritten(file: FilePath, change: Callable[[dict[str, Any]], object]) -> FilePath:
    data = json.loads(file.read_text())
    change(data)
    file.write_text(json.dumps(data))
    return file


def resealed(file: FilePath, change: Callable[[dict[str, Any]], object]) -> FilePath:
    """The file with another content and the sha256 that goes with it."""
    data = json.loads(file.read_text())
    change(data["content"])
    text = json.dumps(data["content"], sort_keys=True, separators=(",", ":"))
    file.write_text(json.dumps(data | {"sha256": hashlib.sha256(text.encode()).hexdigest()}))
    return file


def test_paths_and_trajectories_read_back_to_the_last_bit(
    tmp_path: FilePath, scene: Scene, path: Path, trajectory: Trajectory
) -> None:
    read = read_plan_file(save_path(tmp_path / "p.json", path, scene)).path
    assert read is not None
    assert np.array_equal(read.waypoints, path.waypoints)
    assert read.joint_names == path.joint_names
    timed = read_plan_file(plan_files.save_trajectory(tmp_path / "t.json", trajectory, scene)).trajectory
    assert timed is not None
    assert timed.allclose(trajectory, atol=0.0)


def test_files_name_joints_units_and_models(tmp_path: FilePath, scene: Scene, path: Path) -> None:
    data = json.loads(save_path(tmp_path / "p.json", path, scene).read_text())
    assert (data["format"], data["version"], data["kind"]) == ("rr1plan", 2, "path")
    assert data["content"]["path"]["joint_names"] == ["arm/joint1", "arm/joint2"]
    assert data["content"]["path"]["units"] == ["rad", "rad"]
    assert data["content"]["made_for"]["sha256"] == scene.content_hash
    assert data["content"]["made_for"]["arms"]["arm"]["sha256"] == scene.arms["arm"].robot.content_hash


def test_a_motion_is_read_without_anything_but_its_file(
    tmp_path: FilePath, scene: Scene, path: Path, trajectory: Trajectory
) -> None:
    problem = load_problems("planar2r_path")["to_a_point"]
    violation = Violation("velocity", ("arm/joint1",), 0.5, 2.0, 1.0, "too fast")
    margins = {"clearance": Margin(0.1, "m", ("arm/upper", "red"), 0.25), "velocity": Margin(2.0)}
    report = Report((violation,), margins, ("velocity",), {"torque": "not asked"}, 2.0)
    path = Path(path.joint_names, [trajectory(0.0), *path.waypoints, trajectory(2.0)])
    file = plan_files.save_motion(
        tmp_path / "m.json", scene, path=path, trajectory=trajectory, report=report, problem=problem
    )
    read = read_plan_file(file)
    assert read.scene is not None
    assert read.scene.content_hash == scene.content_hash
    assert read.report == report
    assert read.problem is not None
    assert np.array_equal(read.problem.start, problem.start)
    assert read.path is not None
    assert read.path.allclose(path, atol=0.0)
    assert read.trajectory is not None
    assert read.trajectory.allclose(trajectory, atol=0.0)
    assert read_plan_file(plan_files.save_motion(file, scene)).trajectory is None


@pytest.mark.parametrize("name", ["rr1_pair", "rr1_twelve", "rr1_cage"])
def test_scenes_in_motion_files_keep_their_hash_and_share_robots(name: str, tmp_path: FilePath) -> None:
    scene = load_scene(name)
    read = read_plan_file(plan_files.save_motion(tmp_path / "m.json", scene)).scene
    assert read is not None
    assert read.content_hash == scene.content_hash
    assert len({id(arm.robot) for arm in read.arms.values()}) == 1
    assert not read.arms[next(iter(read.arms))].base.flags.writeable


def test_every_goal_and_shape_survives(tmp_path: FilePath) -> None:
    robot = load_robot("rr1")
    mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.array([[0, 2, 1]]))
    scene = Scene().with_arm("a", robot).with_arm("b", robot, (0, 2, 0)).with_padding(0.01, "a", "b")
    scene = scene.with_obstacle("m", mesh, (3, 3, 3)).with_obstacle("p", PointCloud([[4.0, 4, 4]]))
    scene = scene.with_obstacle("x", Box((0.1, 0.1, 0.1)), (-0.4, 0, 0.2)).attach("x", "a", touch=["hand_link"])
    goals = {"a": [PoseGoal("tool", pose((0.1, 0, 0.2), rpy=(1, 2, 3))), RegionGoal("tool", (0, 0, 0), (1, 1, 1))]}
    problem = Problem(scene, None, goals, arms=["a", "b"])
    read = read_plan_file(plan_files.save_motion(tmp_path / "m.json", scene, problem=problem))
    assert read.scene is not None
    assert read.scene.content_hash == scene.content_hash
    assert read.problem is not None
    first, second = read.problem.goal["a"]
    assert isinstance(first, PoseGoal)
    assert np.array_equal(first.rotation, problem.goal["a"][0].rotation)
    assert isinstance(second, RegionGoal)
    assert len(read.problem.goal["b"]) == 1


# ---- what is refused -------------------------------------------------------------------------


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.9, 0.999])
def test_a_file_that_was_cut_off_is_refused(
    tmp_path: FilePath, scene: Scene, trajectory: Trajectory, share: float
) -> None:
    file = plan_files.save_trajectory(tmp_path / "t.json", trajectory, scene)
    text = file.read_text().rstrip()
    file.write_text(text[: int(len(text) * share)])
    with pytest.raises(FormatError, match=r"t\.json.*cut off"):
        read_plan_file(file)


def test_an_altered_number_is_refused(tmp_path: FilePath, scene: Scene, path: Path) -> None:
    file = save_path(tmp_path / "p.json", path, scene)
    rewritten(file, lambda data: data["content"]["path"]["waypoints"][0].__setitem__(0, 0.1000001))
    with pytest.raises(FormatError, match=r"p\.json: was altered"):
        read_plan_file(file)


@pytest.mark.parametrize(
    ("entry", "value", "message"),
    [
        ("version", 1, "version 1, expected 2"),
        ("version", None, "version None"),
        ("format", "other", "not a file of rr1plan"),
        ("kind", "trajectory", r"unknown field `path`|required field `trajectory`"),
        ("kind", "poem", "unknown kind of file 'poem'"),
        ("sha256", "00", "was altered"),
        ("sha256", 5, "expected text"),
        ("content", 5, "expected a table"),
        ("extra", 5, "unknown key 'extra'"),
    ],
)
def test_a_wrong_head_is_refused(
    tmp_path: FilePath, scene: Scene, path: Path, entry: str, value: object, message: str
) -> None:
    file = rewritten(save_path(tmp_path / "p.json", path, scene), lambda data: data.__setitem__(entry, value))
    with pytest.raises(FormatError, match=message) as caught:
        read_plan_file(file)
    assert caught.value.file == str(file)


@pytest.mark.parametrize(
    "text", ["", "null", "[]", "{}", "1e999", "NaN", "1" * 5000, '{"format": "rr1plan"', "[" * 50_000]
)
def test_files_that_are_something_else_are_refused(tmp_path: FilePath, text: str) -> None:
    (tmp_path / "x.json").write_text(text)
    with pytest.raises(FormatError, match=r"x\.json"):
        read_plan_file(tmp_path / "x.json")


def test_a_nan_is_refused(tmp_path: FilePath, scene: Scene, path: Path) -> None:
    file = save_path(tmp_path / "p.json", path, scene)
    rewritten(file, lambda data: data["content"]["path"]["waypoints"][0].__setitem__(0, float("nan")))
    with pytest.raises(FormatError, match="not finite"):
        read_plan_file(file)


@pytest.mark.parametrize(
    "change",
    [
        lambda c: c["path"].pop("waypoints"),
        lambda c: c["path"].__setitem__("waypoints", [[1.0]]),
        lambda c: c["path"].__setitem__("waypoints", [["1", "2"]]),
        lambda c: c["path"].__setitem__("joint_names", ["arm/joint1", "arm/joint1"]),
        lambda c: c["path"].__setitem__("joint_names", ["arm/joint1", "arm/joint9"]),
        lambda c: c["path"].__setitem__("units", ["m", "m"]),
        lambda c: c["path"].__setitem__("units", ["rad"]),
        lambda c: c["path"].__setitem__("speed", 1.0),
        lambda c: c.__setitem__("surprise", 1),
        lambda c: c.pop("scene"),
        lambda c: c["scene"].__setitem__("padding", -1.0),
        lambda c: c["scene"].__setitem__("surprise", 1),
        lambda c: c["scene"]["arms"].__setitem__(0, "x"),
        lambda c: c["scene"]["arms"].append(c["scene"]["arms"][0]),
        lambda c: c["scene"]["arms"][0].__setitem__("robot", 7),
        lambda c: c["scene"]["obstacles"].append(c["scene"]["obstacles"][0]),
        lambda c: c["scene"]["obstacles"][0]["geometries"][0].__setitem__("color", [0.1, 0.2, 0.3, 2.0]),
        lambda c: c["scene"]["obstacles"][0]["geometries"][0].__setitem__("shape", {"type": "os.system"}),
        lambda c: c["scene"]["obstacles"][0]["pose"][3].__setitem__(0, 1.0),
        lambda c: c["robots"].clear(),
        lambda c: c.__setitem__("robots", 3),
        lambda c: c["robots"][0].__setitem__("tool", "no such link"),
        lambda c: c["robots"][0]["joints"][0].__setitem__("axis", [0.0, 0.0, 0.0]),
        lambda c: c["robots"][0]["joints"].reverse(),
        lambda c: c["robots"][0]["links"].append(c["robots"][0]["links"][-1]),
        lambda c: c["robots"][0]["held"].__setitem__("joint1", 0.0),
        lambda c: c["made_for"].__setitem__("sha256", "0" * 64),
        lambda c: c["made_for"].__setitem__("scene", "elsewhere"),
        lambda c: c["made_for"]["arms"].clear(),
        lambda c: c.__setitem__("report", {"map": []}),
        lambda c: c.__setitem__("problem", {"start": [0.0], "goal": "home", "arms": ["arm"]}),
        lambda c: c.__setitem__("problem", {"start": [0.0, 0.0], "goal": {"arm": []}, "arms": ["arm"]}),
    ],
)
def test_content_that_makes_no_sense_is_refused_even_with_the_right_hash(
    tmp_path: FilePath, scene: Scene, path: Path, change: Callable[[dict[str, Any]], object]
) -> None:
    file = resealed(plan_files.save_motion(tmp_path / "m.json", scene, path=path), change)
    with pytest.raises(FormatError, match=r"m\.json"):
        read_plan_file(file)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c["made_for"].__setitem__("sha256", "0" * 64), "made_for: names another scene"),
        (lambda c: c["path"].__setitem__("units", ["m", "m"]), "units are m, m, expected"),
        (lambda c: c["scene"]["arms"][0].__setitem__("robot", 7), ".*has robot 7, but the file holds 1"),
        (lambda c: c.__setitem__("scene", None), "robots: belong to a scene"),
        (lambda c: c.__setitem__("robots", []), ".*has robot 0, but the file holds 0"),
    ],
)
def test_the_scene_of_a_path_is_checked_like_that_of_a_motion(
    tmp_path: FilePath, scene: Scene, path: Path, change: Callable[[dict[str, Any]], object], message: str
) -> None:
    file = resealed(save_path(tmp_path / "p.json", path, scene), change)
    with pytest.raises(FormatError, match=rf"p\.json: {message}"):
        read_plan_file(file)


def test_joints_the_scene_does_not_have_cannot_be_saved(tmp_path: FilePath, scene: Scene) -> None:
    with pytest.raises(UnknownNameError, match=r"Did you mean .*'arm/joint1'"):
        save_path(tmp_path / "p.json", Path(("arm/joint9",), [[0.0]]), scene)
    assert list(tmp_path.iterdir()) == []


# ---- written in one step -----------------------------------------------------------------------


def test_a_write_that_fails_leaves_the_old_file_and_no_other(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = file_access.write_text(tmp_path / "a.txt", "old")

    def broken(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", broken)
    with pytest.raises(InputError, match="No space left"):
        file_access.write_text(file, "new")
    assert file.read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.txt"]


def test_an_interrupted_write_leaves_the_old_file(tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch) -> None:
    file = file_access.write_text(tmp_path / "a.txt", "old")

    def interrupted(_: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        file_access.write_text(file, "new")
    assert [entry.read_text() for entry in tmp_path.iterdir()] == ["old"]


def test_a_missing_folder_is_named(tmp_path: FilePath) -> None:
    with pytest.raises(InputError, match=r"cannot write .*gone"):
        file_access.write_text(tmp_path / "gone" / "a.txt", "x")


def test_written_files_have_the_usual_mode_and_replaced_ones_keep_theirs(tmp_path: FilePath) -> None:
    (tmp_path / "usual").write_text("")
    file = file_access.write_text(tmp_path / "new", "x")
    assert file.stat().st_mode == (tmp_path / "usual").stat().st_mode
    file.chmod(0o640)
    assert file_access.write_text(file, "y").stat().st_mode & 0o777 == 0o640


def test_files_that_are_too_large_are_refused_packed_or_not(tmp_path: FilePath) -> None:
    import gzip

    (tmp_path / "a.json.gz").write_bytes(gzip.compress(b" " * 100_000))
    with pytest.raises(FormatError, match="larger than 1000 bytes"):
        file_access.read_bytes(tmp_path / "a.json.gz", max_bytes=1000)
    assert len(file_access.read_bytes(tmp_path / "a.json.gz")) == 100_000
    (tmp_path / "b.json.gz").write_bytes(gzip.compress(b"x" * 100)[:-12])
    with pytest.raises(FormatError, match="cannot be read"):
        file_access.read_bytes(tmp_path / "b.json.gz")
    (tmp_path / "c.json.gz").write_bytes(b"not gzip")
    with pytest.raises(FormatError, match="cannot be read"):
        file_access.read_bytes(tmp_path / "c.json.gz")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda w: w.reverse(), r"'arm/joint2' starts .* because the path runs backwards"),
        (lambda w: w.pop(), r"ends [\d.]+ rad or m from where the trajectory ends$"),
        (lambda w: w[0].__setitem__(1, w[0][1] + 2e-6), r"'arm/joint2' starts 2e-06 rad or m from where"),
    ],
)
def test_a_path_that_is_not_that_of_its_trajectory_is_refused(
    tmp_path: FilePath, scene: Scene, trajectory: Trajectory, change: Callable[[list[Any]], object], words: str
) -> None:
    waypoints = [trajectory(0.0), trajectory(0.5), trajectory(2.0)]
    path = Path(scene.joint_names(), waypoints)
    file = plan_files.save_motion(tmp_path / "m.json", scene, path=path, trajectory=trajectory)
    assert read_plan_file(file).path is not None
    forged = resealed(file, lambda content: change(content["path"]["waypoints"]))
    with pytest.raises(FormatError, match=rf"m\.json: the path is not that of the trajectory: .*{words}"):
        read_plan_file(forged)
    wrong = path.waypoints.tolist()
    change(wrong)
    with pytest.raises(InputError, match=f"the path is not that of the trajectory: .*{words}"):
        plan_files.save_motion(tmp_path / "n.json", scene, path=Path(path.joint_names, wrong), trajectory=trajectory)
    assert not (tmp_path / "n.json").exists()


# ---- values ------------------------------------------------------------------------------------


def test_only_our_own_values_have_a_form(tmp_path: FilePath, scene: Scene) -> None:
    with pytest.raises(InputError, match="object cannot be stored in a motion file"):
        plain(object())
    with pytest.raises(InputError, match="NaN cannot be stored"):
        plain({"a": [np.nan]})
    assert plain({"a": frozenset({"x"}), "b": (np.inf, None, np.int64(3))}) == {"a": ["x"], "b": ["inf", None, 3]}
    unreadable = Report((), {"clearance": Margin(np.inf, "m")}, ())
    with pytest.raises(InputError, match=r"the motion cannot be saved: .*inf"):
        plan_files.save_motion(tmp_path / "m.json", scene, report=unreadable)
    assert not list(tmp_path.iterdir())


def test_a_number_too_large_for_a_float_is_refused(tmp_path: FilePath, scene: Scene, path: Path) -> None:
    file = save_path(tmp_path / "path.json", path, scene)
    huge = resealed(file, lambda content: content["path"]["waypoints"][0].__setitem__(0, 10**400))
    with pytest.raises(FormatError, match="waypoints"):
        read_plan_file(huge)


@pytest.mark.parametrize("wrong", [3, "report", [], {}])
def test_what_is_saved_has_to_be_what_it_is_saved_as(tmp_path: FilePath, scene: Scene, wrong: Any) -> None:
    for name in ("path", "trajectory", "report", "problem"):
        with pytest.raises(InputError, match=f"{name} is of type"):
            plan_files.save_motion(tmp_path / "motion.json", scene, **{name: wrong})
    assert not list(tmp_path.iterdir())
