"""Motions from files, validated in the scene in which they were planned, or in another."""

from __future__ import annotations

import hashlib
import io
import json
import shutil
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from path_files import save_path

import rr1plan as rp
from rr1plan.export.plan_files import save_trajectory
from rr1plan.robot import Geometry
from rr1plan.scene import Attachment


@pytest.fixture(scope="module")
def problem() -> rp.Problem:
    return rp.load_problems("planar2r_path")["to_a_point"]


@pytest.fixture(scope="module")
def motion(problem: rp.Problem) -> rp.MotionPlan:
    motion = rp.plan_motion(problem, rng=0)
    assert motion
    return motion


@pytest.fixture(scope="module")
def file(motion: rp.MotionPlan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return motion.save(tmp_path_factory.mktemp("motion") / "motion.json")


def test_a_loaded_motion_is_what_planning_gave(motion: rp.MotionPlan, file: Path, tmp_path: Path) -> None:
    again = rp.load_motion(file)
    assert isinstance(again, rp.MotionPlan)
    assert again
    assert again.path.allclose(motion.path, atol=0.0)
    assert again.trajectory.allclose(motion.trajectory, atol=0.0)
    assert again.report.margins == motion.report.margins
    assert again.scene.content_hash == motion.scene.content_hash
    assert again.changes == ()
    assert again.problem is not None
    assert again.status is rp.PlanStatus.FOUND
    assert again.save_html(tmp_path / "again.html").stat().st_size > 10_000
    with again.show(options=rp.ViewOptions(quiet=True)) as viewer:
        assert viewer.url.startswith("http")
    assert again.save(tmp_path / "again.json").read_text() == again.to_json()
    assert str(motion.path.waypoints.shape[0]) in str(again)


def test_a_verdict_in_the_file_is_not_taken_over(motion: rp.MotionPlan, tmp_path: Path) -> None:
    fast = motion.trajectory.stretched(0.2)
    file = rp.save_motion(
        tmp_path / "m.json",
        motion.scene,
        path=motion.path,
        trajectory=fast,
        report=motion.report,
        problem=motion.problem,
    )
    assert not rp.load_motion(file)


def test_a_changed_scene_judges_the_motion_and_says_what_differs(motion: rp.MotionPlan, file: Path) -> None:
    scene = motion.scene
    here = scene.link_poses({"arm": motion.trajectory(0.5 * motion.trajectory.end_time)})["arm/tool"][:3, 3]
    blocked = scene.with_obstacle("late", rp.Sphere(0.02), here)
    judged = rp.load_motion(file, blocked)
    assert not judged
    assert {v.kind for v in judged.report.violations} == {"collision"}
    assert judged.changes == ("obstacle 'late' is new",)
    assert judged.scene is blocked
    assert "obstacle 'late' is new" in str(judged)
    away = rp.load_motion(file, scene.with_obstacle("late", rp.Sphere(0.02), (5, 5, 5)))
    assert away
    slow = scene.arms["arm"].robot.with_limits(scene.arms["arm"].robot.limits.scaled(velocity=0.5))
    judged = rp.load_motion(file, scene.with_robot("arm", slow))
    assert {v.kind for v in judged.report.violations} == {"velocity"}
    (change,) = judged.changes
    assert change.startswith("arm 'arm' has other velocity limits: joint1 1 (was 2)")


def test_the_goal_counts_in_the_other_scene_too(motion: rp.MotionPlan, file: Path) -> None:
    moved = replace(motion.scene, arms={"arm": replace(motion.scene.arms["arm"], base=rp.transforms.pose((0, 0, 0.1)))})
    judged = rp.load_motion(file, moved)
    assert "goal" in {v.kind for v in judged.report.violations}
    assert judged.changes == ("arm 'arm' moved by 100 mm",)


def test_a_motion_that_cannot_be_meant_for_a_scene_is_refused_by_joint(file: Path, planar2r: rp.Robot) -> None:
    with pytest.raises(
        rp.FormatError, match=r"motion.json: cannot be a motion of the scene .*'arm/joint1'.*other/joint1"
    ):
        rp.load_motion(file, rp.Scene().with_arm("other", planar2r).with_arm("second", planar2r, (9, 9, 9)))
    with pytest.raises(rp.FormatError, match="unknown joint 'arm/joint1'"):
        rp.load_motion(file, rp.load_scene("rr1_table"))
    with pytest.raises(rp.FormatError, match="joint 'arm/joint1' is locked in the scene"):
        rp.load_motion(file, rp.Scene().with_arm("arm", rp.load_robot("planar2r", joints=["joint2"])))
    with pytest.raises(rp.InputError, match="scene is of type str"):
        rp.load_motion(file, "rr1_table")


def test_a_scene_that_cannot_be_checked_is_the_fault_of_the_file_that_holds_it(
    motion: rp.MotionPlan, tmp_path: Path
) -> None:
    plate = Attachment((Geometry("plate", rp.HalfSpace()),), "arm", "link1", np.eye(4))
    scene = replace(motion.scene, attachments={"plate": plate})
    file = rp.save_motion(tmp_path / "m.json", scene, path=motion.path, trajectory=motion.trajectory)
    with pytest.raises(rp.FormatError, match=r"m.json: cannot be judged in its own scene: 'plate' moves"):
        rp.load_motion(file)
    assert rp.load_motion(file, motion.scene).changes == ("held object 'plate' is gone",)
    with pytest.raises(rp.InputError, match=r"^'plate' moves"):
        rp.load_motion(file, scene)


# ---- other kinds of files ----------------------------------------------------------------------


def test_a_path_or_trajectory_file_is_judged_where_it_is_said(motion: rp.MotionPlan, tmp_path: Path) -> None:
    scene = motion.scene
    timed = save_trajectory(tmp_path / "t.json", motion.trajectory, scene)
    for loaded in (rp.load_motion(timed), rp.load_motion(timed, scene)):
        assert loaded
        assert loaded.changes == ()
        assert loaded.scene.content_hash == scene.content_hash
    with pytest.raises(rp.NoPlanError, match=r"t\.json holds no path"):
        _ = loaded.path
    untimed = rp.load_motion(save_path(tmp_path / "p.json", motion.path, scene))
    assert untimed
    assert untimed.report.not_checked["velocity"] == "a path has no times, those given are at 1 rad/s"
    with pytest.raises(rp.NoPlanError, match=r"p\.json holds no trajectory"):
        _ = untimed.trajectory
    assert untimed.save_html(tmp_path / "p.html").exists()
    with pytest.raises(rp.FormatError, match="neither a path nor a trajectory"):
        rp.load_motion(rp.save_motion(tmp_path / "s.json", scene))


@pytest.mark.parametrize("kind", ["motion", "trajectory", "path"])
def test_what_differs_is_listed_for_every_kind_of_file(motion: rp.MotionPlan, tmp_path: Path, kind: str) -> None:
    file, scene = tmp_path / "x.json", motion.scene
    save = {
        "motion": lambda: motion.save(file),
        "trajectory": lambda: save_trajectory(file, motion.trajectory, scene),
        "path": lambda: save_path(file, motion.path, scene),
    }
    save[kind]()
    other = scene.without_obstacle("red").with_obstacle("late", rp.Sphere(0.02), (5, 5, 5)).with_padding(1e-4)
    assert rp.load_motion(file, other).changes == (
        "obstacle 'red' is gone",
        "obstacle 'late' is new",
        "the padding is 0.1 mm, was 0 mm",
    )


def without_scene(file: Path) -> Path:
    """A path or trajectory file as earlier versions wrote it."""
    data = json.loads(file.read_text())
    del data["content"]["scene"], data["content"]["robots"]
    text = json.dumps(data["content"], sort_keys=True, separators=(",", ":"))
    file.write_text(json.dumps(data | {"sha256": hashlib.sha256(text.encode()).hexdigest()}))
    return file


def test_files_of_earlier_versions_name_their_scene_by_its_hash(motion: rp.MotionPlan, tmp_path: Path) -> None:
    scene = motion.scene
    timed = without_scene(save_trajectory(tmp_path / "t.json", motion.trajectory, scene))
    untimed = without_scene(save_path(tmp_path / "p.json", motion.path, scene))
    for file in (timed, untimed):
        with pytest.raises(rp.InputError, match=r"without its scene; give .*; it was made for 'planar2r_path'"):
            rp.load_motion(file)
        same = rp.load_motion(file, scene)
        assert same
        assert same.changes == ()
        (change,) = rp.load_motion(file, scene.without_obstacle("red")).changes
        assert "'planar2r_path' only the hash is known" in change


def test_a_trajectory_without_its_meshes_is_still_judged_in_a_scene_that_is_given(
    tmp_path: Path, bulky: dict[str, Any]
) -> None:
    scene, trajectory = bulky["scene"], bulky["trajectory"]
    file = save_trajectory(tmp_path / "t.json", trajectory, scene)
    whole = save_trajectory(tmp_path / "w.json", trajectory, scene, embed=True)
    other = scene.without_obstacle("tent")
    assert rp.load_motion(file, other).changes == ("obstacle 'tent' is gone",)
    shutil.rmtree(tmp_path / "geometry")
    with pytest.raises(rp.FormatError, match=r"t\.json: refers to the mesh .*option embed"):
        rp.load_motion(file)
    judged = rp.load_motion(file, other)
    assert judged
    assert "only the hash is known" in judged.changes[-1]
    assert rp.load_motion(file, scene).changes == ()
    assert rp.load_motion(whole, other).changes == ("obstacle 'tent' is gone",)


def test_samples_and_ros_messages_are_judged_by_the_same_referee(motion: rp.MotionPlan, tmp_path: Path) -> None:
    table = rp.load_motion(rp.save_csv(tmp_path / "t.csv", motion.trajectory), motion.scene)
    assert table
    assert table.trajectory.degree == 3  # accelerations jump
    times, q = motion.trajectory.sample(0.05)
    points = [
        {"positions": [float(v) for v in row[::-1]], "time_from_start": float(t)}
        for t, row in zip(times, q, strict=True)
    ]
    (tmp_path / "t.yaml").write_text(yaml.safe_dump({"joint_names": ["joint2", "joint1"], "points": points}))
    message = rp.load_motion(tmp_path / "t.yaml", motion.scene)
    assert message.trajectory.joint_names == motion.trajectory.joint_names
    np.testing.assert_allclose(message.trajectory(times), q, atol=1e-12)
    assert "continuity" in {v.kind for v in message.report.violations}
    assert message.problem is None
    assert "linear piece" in str(message)
    with pytest.raises(rp.InputError, match="give the scene too"):
        rp.load_motion(tmp_path / "t.yaml")


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["joint1", "joint2"], "several arms have a joint 'joint1'; name it 'a/joint1' or 'b/joint1'"),
        (["a/joint1", "a_joint1"], "'a_joint1' and 'a/joint1' are both the joint 'a/joint1'"),
        (["a/joint1", "b/joint1"], "no column for a/joint2, b/joint2"),
        (["a/joint1", "a/joint3"], "unknown joint 'a/joint3'"),
    ],
)
def test_columns_that_fit_no_scene_are_named(tmp_path: Path, planar2r: rp.Robot, names: list[str], words: str) -> None:
    scene = rp.Scene().with_arm("a", planar2r).with_arm("b", planar2r, (9, 9, 9))
    rp.save_csv(tmp_path / "t.csv", rp.Trajectory.rest(tuple(names), [0.1, 0.2], duration=1.0))
    with pytest.raises(rp.FormatError, match=words):
        rp.load_motion(tmp_path / "t.csv", scene)


def test_a_name_with_the_arm_in_the_ros_manner_is_found(tmp_path: Path, planar2r: rp.Robot) -> None:
    scene = rp.Scene().with_arm("a", planar2r).with_arm("b", planar2r, (9, 9, 9))
    rest = rp.Trajectory.rest(("b_joint2", "b_joint1"), [0.1, 0.2], duration=1.0)
    assert rp.load_motion(rp.save_csv(tmp_path / "t.csv", rest), scene).trajectory.joint_names == (
        "b/joint1",
        "b/joint2",
    )


@pytest.mark.parametrize("name", ["none.json", "none.csv", "none.yaml", "none.bag", "none", "none.txt"])
def test_a_file_that_is_not_there_or_of_another_kind_is_named(tmp_path: Path, name: str) -> None:
    with pytest.raises(rp.FormatError, match=name):
        rp.load_motion(tmp_path / name, rp.Scene())


# ---- meshes beside the file --------------------------------------------------------------------


@pytest.fixture
def bulky(motion: rp.MotionPlan) -> dict[str, Any]:
    """A scene to save, with a mesh and a cloud that are too large for the document."""
    turns = np.linspace(0.0, 2.0 * np.pi, 81)[:-1]
    corners = [[0, 0, 0], [0, 0, 0.1], *np.stack([np.cos(turns), np.sin(turns), 0 * turns], axis=1).tolist()]
    ring = [(k + 2, (k + 1) % 80 + 2) for k in range(80)]
    faces = [f for a, b in ring for f in ((a, b, 1), (b, a, 0))]
    scene = motion.scene.with_obstacle("tent", rp.Mesh(corners, faces), (9, 9, 9))
    scene = scene.with_obstacle("scan", rp.PointCloud(np.random.default_rng(0).uniform(7, 8, (100, 3))))
    return {"scene": scene, "path": motion.path, "trajectory": motion.trajectory}


def test_large_shapes_lie_beside_the_file_unless_it_is_to_be_whole(tmp_path: Path, bulky: dict[str, Any]) -> None:
    file, whole = rp.save_motion(tmp_path / "m.json", **bulky), rp.save_motion(tmp_path / "w.json", **bulky, embed=True)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["geometry", "m.json", "w.json"]
    assert len(list((tmp_path / "geometry").iterdir())) == 2
    assert len(file.read_text()) + 5_000 < len(whole.read_text())
    moved = shutil.copy(whole, tmp_path / "geometry" / "moved.json")
    for saved in (file, whole, moved):
        assert rp.load_motion(saved).scene.content_hash == bulky["scene"].content_hash
    before = [entry.stat().st_mtime_ns for entry in sorted((tmp_path / "geometry").glob("*.npz"))]
    rp.save_motion(tmp_path / "second.json", **bulky)
    assert [entry.stat().st_mtime_ns for entry in sorted((tmp_path / "geometry").glob("*.npz"))] == before


def test_shapes_that_are_gone_or_altered_are_named_and_a_scene_can_stand_in(
    tmp_path: Path, bulky: dict[str, Any]
) -> None:
    file = rp.save_motion(tmp_path / "m.json", **bulky)
    first, second = sorted((tmp_path / "geometry").iterdir())
    damaged = first.read_bytes()
    for wrong in (second.read_bytes(), b"", b"PK\x03\x04", damaged[:100], damaged[:-30]):
        first.write_bytes(wrong)
        with pytest.raises(rp.FormatError, match=first.name):
            rp.load_motion(file)
    rp.save_motion(tmp_path / "m.json", **bulky)
    assert rp.load_motion(file)
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        # A header that ends within a bracket, for which numpy's reader raises a TokenError.
        archive.writestr("vertices.npy", b"\x93NUMPY\x01\x00" + b"v\x00" + b"{'shape': (3,".ljust(118))
    first.write_bytes(packed.getvalue())
    with pytest.raises(rp.FormatError, match=f"{first.name}: holds no mesh or point cloud: damaged"):
        rp.load_motion(file)
    shutil.rmtree(tmp_path / "geometry")
    with pytest.raises(rp.FormatError, match=r"m\.json: refers to the mesh .*not in .*geometry.*option embed"):
        rp.load_motion(file)
    assert rp.load_motion(file, bulky["scene"]).changes == ()
