"""Scene files: shipped scenes, the round trip, and one test for each kind of fault."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rr1plan as rp
from rr1plan.collision import CollisionChecker
from rr1plan.errors import FormatError, InputError, UnknownNameError
from rr1plan.files.checked_tables import line_of
from rr1plan.files.toml_writer import to_toml
from rr1plan.robot import Geometry
from rr1plan.scene import Scene
from rr1plan.scene.model_library import load_problems, load_robot, load_scene, robot_folder, scene_names
from rr1plan.scene.problem import JointGoal, PoseGoal, Problem, RegionGoal
from rr1plan.scene.scene_toml import SceneFile, parse_scene, read_scene
from rr1plan.scene.scene_toml import scene_text as text_of_scene
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, PointCloud, Sphere
from rr1plan.transforms import pose

TETRAHEDRON = Mesh(
    np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]),
    np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]),
    convex=True,
)
SIMPLE = """
[arms.arm]
robot = "planar2r"
"""


def read_text(tmp_path: Path, text: str) -> SceneFile:
    file = tmp_path / "scene.toml"
    file.write_text(text)
    return read_scene(file, load_robot)


@pytest.mark.parametrize("key", ["locked_joints", "held"])
def test_locked_joints_are_read_by_their_earlier_name_too(tmp_path: Path, key: str) -> None:
    read = read_text(tmp_path, f'[arms.arm]\nrobot = "rr1"\n{key} = "open"\n')
    assert read.scene.arms["arm"].robot.locked_joints == load_robot("rr1").with_locked_joints("open").locked_joints


def refusal(tmp_path: Path, text: str) -> str:
    with pytest.raises(FormatError) as caught:
        read_text(tmp_path, text)
    return str(caught.value).replace(str(tmp_path) + "/", "")


# ---- the shipped scenes --------------------------------------------------------------------


@pytest.mark.parametrize("name", scene_names())
def test_shipped_scenes_are_free_at_home_and_described(name: str) -> None:
    scene = load_scene(name)
    assert scene.name == name
    assert scene.description.endswith(".")
    assert scene.arms
    assert CollisionChecker(scene).is_free(scene.configuration())


@pytest.mark.parametrize("name", scene_names())
def test_shipped_queries_start_free_and_their_joint_goals_are_free(name: str) -> None:
    problems = load_problems(name)
    assert len(problems) >= 2
    for query, problem in problems.items():
        checker = CollisionChecker(problem.scene, problem.arms)
        assert checker.is_free(problem.start), query
        goals = [alternatives[0] for alternatives in problem.goal.values()]
        if all(isinstance(goal, JointGoal) for goal in goals):
            assert checker.is_free(np.concatenate([goal.q for goal in goals])), query


def narrowed(robot: rp.Robot) -> rp.Robot:
    """The robot with the intersection of the position limits of all its presets."""
    presets = [robot.with_limits(name).limits for name in robot.presets]
    lower, upper = np.max([p.lower for p in presets], axis=0), np.min([p.upper for p in presets], axis=0)
    return robot.with_limits(replace(robot.limits, lower=lower, upper=upper))


@pytest.mark.parametrize("name", scene_names())
def test_shipped_queries_are_valid_under_every_limit_preset(name: str) -> None:
    scene, problems = load_scene(name), load_problems(name)
    robots = {id(arm.robot): arm.robot for arm in scene.arms.values()}
    limited = {key: narrowed(robot) for key, robot in robots.items()}
    for arm, placed in scene.arms.items():
        scene = scene.with_robot(arm, limited[id(placed.robot)])
    for query, problem in problems.items():
        same = Problem(scene, problem.start, dict(problem.goal), arms=problem.arms)
        result = rp.plan(same, budget=rp.Budget(seconds=float("inf"), iterations=1), rng=0)
        assert result.status in (rp.PlanStatus.FOUND, rp.PlanStatus.TIMEOUT), f"{query}: {result}"


def scene_text(scene: Scene, problems: Mapping[str, Problem] = MappingProxyType({})) -> str:
    return text_of_scene(scene, problems, {name: arm.robot.name for name, arm in scene.arms.items()}, load_robot)


@pytest.mark.parametrize("name", scene_names())
def test_shipped_scenes_round_trip_to_the_last_bit(name: str, tmp_path: Path) -> None:
    scene, problems = load_scene(name), load_problems(name)
    text = scene_text(scene, problems)
    once = parse_scene(text, tmp_path / "once.toml", load_robot)
    assert once.scene.content_hash == scene.content_hash
    assert once.scene.description == scene.description
    assert scene_text(once.scene, once.problems) == text
    for query, problem in problems.items():
        assert np.array_equal(once.problems[query].start, problem.start)
        assert once.problems[query].arms == problem.arms


def components_on_the_torus(scene: Scene, n: int = 180) -> np.ndarray:
    """Labels of the connected components of the free grid cells, by flood fill."""
    q1, q2 = np.meshgrid(angles := -np.pi + 2 * np.pi * np.arange(n) / n, angles, indexing="ij")
    elbow = np.stack([np.cos(q1), np.sin(q1)], axis=-1)
    tip = elbow + 0.7 * np.stack([np.cos(q1 + q2), np.sin(q1 + q2)], axis=-1)
    free = np.ones((n, n), dtype=bool)
    for obstacle in scene.obstacles.values():
        reach = obstacle.geometries[0].shape.radius + 0.04
        for a, b in ((np.zeros_like(elbow), elbow), (elbow, tip)):
            along = b - a
            s = np.clip(((obstacle.pose[:2, 3] - a) * along).sum(-1) / (along * along).sum(-1), 0.0, 1.0)
            free &= np.linalg.norm(a + s[..., None] * along - obstacle.pose[:2, 3], axis=-1) > reach
    labels = np.zeros((n, n), dtype=int)
    for seed in np.argwhere(free):
        if labels[tuple(seed)]:
            continue
        label, todo = labels.max() + 1, [tuple(int(i) for i in seed)]
        while todo:
            i, j = todo.pop()
            if free[i, j] and not labels[i, j]:
                labels[i, j] = label
                todo += [((i + 1) % n, j), ((i - 1) % n, j), (i, (j + 1) % n), (i, (j - 1) % n)]
    return labels


@pytest.mark.parametrize(
    ("name", "query", "joined"),
    [
        ("planar2r_path", "over_the_seam", True),
        ("planar2r_path", "elbow_flip", True),
        ("planar2r_no_path", "no_way", False),
        ("planar2r_no_path", "same_side", True),
    ],
)
def test_the_planar_lessons_have_a_path_or_none(name: str, query: str, joined: bool) -> None:
    problem = load_problems(name)[query]
    labels = components_on_the_torus(problem.scene)
    goal = problem.goal["arm"][0]
    assert isinstance(goal, JointGoal)
    ends = [
        labels[tuple(np.round((q + np.pi) / (2 * np.pi) * len(labels)).astype(int) % len(labels))]
        for q in (problem.start, goal.q)
    ]
    assert all(ends)
    assert bool(ends[0] == ends[1]) is joined


# ---- everything a file can hold ------------------------------------------------------------


def full_scene() -> Scene:
    robot = load_robot("rr1").with_locked_joints("open").with_limits("hardware")
    scene = Scene(name="full", description='With "quotes", \\ and\ttabs.')
    scene = scene.with_arm("left", robot, pose((0.1, 0.5, 0), rpy=(0.1, 0.2, 0.3)), q=robot.home + 0.01)
    scene = scene.with_arm("right", load_robot("rr1"), pose((0.1, -0.5, 0)))
    parts = (
        Geometry("rod", Capsule(0.02, 0.1), pose((0, 0, 1.2), quaternion=(1, 0.2, 0, 0)), (0.1, 0.2, 0.3, 0.5)),
        Geometry("end", Sphere(0.03), pose((0, 0, 1.5))),
    )
    scene = scene.with_obstacle("two parts", parts, pose((1, 2, 3)))
    scene = scene.with_obstacle("box", Box((0.1, 0.2, 0.3)), (3, 0, 0), color=(1.0, 0.5, 0.0, 1.0))
    scene = scene.with_obstacle("can", Cylinder(0.03, 0.1), (0, 3, 0))
    scene = scene.with_obstacle("ground", HalfSpace((0.1, 0.2, 1.0), -1.0))
    scene = scene.with_obstacle("solid", TETRAHEDRON, (4, 4, 4))
    scene = scene.with_obstacle("scan", PointCloud(np.array([[5.0, 5, 5], [5.1, 5, 5]]), 0.01))
    scene = scene.with_obstacle("cup", Cylinder(0.02, 0.05), (-0.2, 0.5, 0.3)).attach(
        "cup", "left", touch=["hand_link"]
    )
    scene = scene.allow("left", "box").allow("cup", "can").with_padding(0.001).with_padding(0.02, "left", "right")
    return scene.allow("left", "left/hand_link")


def test_everything_a_scene_holds_survives_the_round_trip(tmp_path: Path) -> None:
    scene = full_scene()
    goals = {
        "left": [PoseGoal("tool", pose((-0.3, 0.5, 0.2), rpy=(0.1, 0, 0))), "home"],
        "right": RegionGoal("tool", (-0.4, -0.6, 0.1), (-0.3, -0.5, 0.3), (1, 0, 0, 0)),
    }
    text = scene_text(scene, {"both": Problem(scene, None, goals)})
    read = parse_scene(text, tmp_path / "full.toml", load_robot)
    assert read.scene.content_hash == scene.content_hash
    assert (read.scene.name, read.scene.description) == (scene.name, scene.description)
    assert read.scene.allowed == scene.allowed
    assert read.scene.pair_padding == scene.pair_padding
    assert read.scene.obstacles["two parts"].geometries[0].color == (0.1, 0.2, 0.3, 0.5)
    assert read.scene.arms["left"].robot.locked_joints == scene.arms["left"].robot.locked_joints
    first, second = read.problems["both"].goal["left"]
    assert isinstance(first, PoseGoal)
    assert np.array_equal(first.rotation, goals["left"][0].rotation)
    assert np.array_equal(second.q, load_robot("rr1").home)
    assert isinstance(read.problems["both"].goal["right"][0], RegionGoal)


def test_a_file_with_a_byte_order_mark_and_lines_of_windows_is_read(tmp_path: Path) -> None:
    assert list(read_text(tmp_path, "\ufeff" + SIMPLE.replace("\n", "\r\n")).scene.arms) == ["arm"]


def test_a_file_may_give_some_limits_and_keep_the_others(tmp_path: Path) -> None:
    read = read_text(tmp_path, SIMPLE + "limits = { acceleration = [2, 3] }\n").scene.arms["arm"].robot.limits
    assert read.acceleration.tolist() == [2.0, 3.0]
    kept = load_robot("planar2r").limits
    assert all(np.array_equal(getattr(read, n), getattr(kept, n)) for n in ("lower", "upper", "velocity", "jerk"))


def test_velocities_that_a_scene_file_gives_are_not_said_to_be_unknown(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    joint = '<parent link="a"/><child link="b"/><limit lower="-1" upper="1" effort="1"/>'
    text = f'<robot name="bare"><link name="a"/><link name="b"/><joint name="j" type="revolute">{joint}</joint></robot>'
    (tmp_path / "bare.urdf").write_text(text)
    for limits, is_said in (("acceleration = [2]", True), ("velocity = [2]", False)):
        (tmp_path / "scene.toml").write_text(f'[arms.arm]\nrobot = "bare.urdf"\nlimits = {{ {limits} }}\n')
        caplog.clear()
        load_scene(tmp_path / "scene.toml")
        assert ("no velocity limit for j: 1 rad/s (0.25 m/s) is taken" in caplog.text) == is_said


def test_limits_that_no_preset_has_are_written_out(tmp_path: Path) -> None:
    robot = load_robot("planar2r")
    scene = Scene().with_arm("arm", robot.with_limits(robot.limits.scaled(velocity=0.25)))
    read = parse_scene(scene_text(scene), tmp_path / "slow.toml", load_robot).scene
    assert np.array_equal(read.limits().velocity, scene.limits().velocity)
    assert read.content_hash == scene.content_hash


def test_two_distances_for_a_pair_are_an_error(tmp_path: Path) -> None:
    text = scene_text(Scene().with_arm("a", load_robot("planar2r")).with_obstacle("box", Box((1, 1, 1)), (9, 0, 0)))
    rows = ['{ between = ["a", "box"], distance = 0.1 }', '{ between = ["box", "a"], distance = 0.2 }']
    with pytest.raises(FormatError, match=r"'a' and 'box' have two distances, keep one"):
        parse_scene(f"pair_padding = [{', '.join(rows)}]\n{text}", tmp_path / "s.toml", load_robot)


def test_arms_with_the_same_entries_share_one_robot() -> None:
    assert len({id(arm.robot) for arm in load_scene("rr1_twelve").arms.values()}) == 1


def test_the_joints_to_plan_for_can_be_chosen(tmp_path: Path) -> None:
    file = tmp_path / "s.toml"
    urdf = robot_folder("planar2r") / "planar2r.urdf"
    arms = [f'[arms.{name}]\nrobot = "{urdf}"\njoints = {joints}\n' for name, joints in (("a", ["joint2"]), ("b", []))]
    file.write_text("\n".join(arms))
    scene = load_scene(file)
    assert scene.joint_names() == ("a/joint2", "b/joint1", "b/joint2")
    file.write_text(arms[0].replace("joint2", "joint3"))
    with pytest.raises(FormatError, match="Did you mean 'joint"):
        load_scene(file)


def test_robots_point_files_and_meshes_are_found_beside_the_scene_file(tmp_path: Path) -> None:
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    np.save(folder / "scan.npy", np.array([[1.0, 2.0, 3.0]]))
    (folder / "scan.csv").write_text("# x, y, z\n1, 2, 3\n\n4 5 6\n")
    (folder / "solid.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    (folder / "arm.urdf").write_text(
        '<robot name="one"><link name="a"/><link name="b"/><joint name="j" type="revolute"><parent link="a"/>'
        '<child link="b"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>'
    )
    (folder / "scene.toml").write_text(
        '[arms.arm]\nrobot = "./arm.urdf"\n[obstacles.a]\npoints = { file = "scan.npy" }\n'
        '[obstacles.b]\npoints = { file = "scan.csv", resolution = 0.1 }\n'
        '[obstacles.c]\nmesh = { file = "solid.obj", scale = 2, convex = "hull" }\n'
    )
    scene = load_scene(folder / "scene.toml")
    assert scene.joint_names() == ("arm/j",)
    clouds = [scene.obstacles[name].geometries[0].shape for name in "ab"]
    assert [len(cloud.points) for cloud in clouds if isinstance(cloud, PointCloud)] == [1, 2]
    solid = scene.obstacles["c"].geometries[0].shape
    assert isinstance(solid, Mesh)
    assert solid.convex
    assert np.allclose(solid.vertices.max(axis=0), 2.0)


def test_a_mesh_file_is_one_mesh_its_hull_or_pieces(tmp_path: Path) -> None:
    """Two tetrahedra that have a corner in common, as they are unless the scene file says otherwise."""
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv -1 0 0\nv 0 -1 0\nv 0 0 -1\n"
    faces = "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\nf 1 5 6\nf 1 7 5\nf 1 6 7\nf 5 7 6\n"
    (tmp_path / "two.obj").write_text(corners + faces)
    table = 'mesh = { file = "two.obj", convex = "%s" }\n'
    text = '[obstacles.a]\nmesh = "two.obj"\n[obstacles.b]\n' + table % "hull" + "[obstacles.c]\n" + table % "pieces"
    (tmp_path / "scene.toml").write_text(text)
    found = load_scene(tmp_path / "scene.toml").obstacles
    (plain,), (hull,), pieces = ([g.shape for g in found[name].geometries] for name in "abc")
    assert isinstance(plain, Mesh)
    assert isinstance(hull, Mesh)
    assert (len(plain.faces), plain.convex) == (8, False)
    assert (len(hull.vertices), hull.convex) == (6, True)
    assert [(len(piece.faces), piece.convex) for piece in pieces if isinstance(piece, Mesh)] == [(4, True)] * 2
    assert "convex" in refusal(tmp_path, '[obstacles.a]\nmesh = { file = "two.obj", convex = "hulls" }\n')


# ---- what is refused, and how ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[arms.arm\n", "scene.toml:1: is not TOML"),
        ("\n\nx = = 1\n", "scene.toml:3: is not TOML"),
        ("\nx = .1\n", "scene.toml:2: is not TOML: Invalid value (at line 2, column 5): '.1'"),
        ("padding = -1.0\n" + SIMPLE, "padding is -1.0"),
        ("padding = nan\n" + SIMPLE, "scene.toml:1: padding: expected a finite number"),
        ("padding = true\n" + SIMPLE, "padding: expected a number, got True"),
        ("paddng = 0.1\n" + SIMPLE, "scene.toml:1: paddng: unknown key 'paddng'. Did you mean 'padding'"),
        (SIMPLE + "[obstacles.a]\nposition = [0, 0, 1]\nbox = [1, 1, 1]\n", "'position'. Did you mean 'xyz'? Known"),
        (
            SIMPLE + "[obstacles.a]\nposition = [0, 0, 1]\npoints = { points = [[0, 0, 0]] }\n",
            "obstacles.a.position: unknown key 'position'. Did you mean 'xyz'? Known",
        ),
        (SIMPLE + "[obstacles.a]\norigin = [0, 0, 1]\nsphere = 1\n", "'origin'. Did you mean 'xyz'? Known"),
        (
            SIMPLE + "orientation = [1, 0, 0, 0]\n",
            "'orientation'. Did you mean 'quaternion' or 'rpy' or 'rotation'? Known",
        ),
        (
            SIMPLE + "[obstacles.a]\ncylinder = { radius = 1, height = 1 }\n",
            "no 'length', which is required. Did you mean 'length' where it says 'height'?",
        ),
        (SIMPLE + "padding = 0.01\n", "xyz. A 'padding' of the whole file belongs before its first [table]."),
        (SIMPLE + "[query.a]\ngoal = 'home'\n", "scene.toml:4: query: unknown key 'query'. Did you mean 'queries'"),
        (
            "allowed = [['arm/link1', 'arm/link2']]\n[arm.arm]\nrobot = 'planar2r'\n",
            "scene.toml:2: arm: unknown key 'arm'. Did you mean 'arms'",
        ),
        (SIMPLE + "[obstacles.a]\nmesh = 'parts\\mug.stl'\n", "; a slash separates folders, not a backslash"),
        (SIMPLE + "[obstacles.a]\nsize = [1, 1, 1]\n", "Did you mean 'box' where it says 'size'?"),
        (SIMPLE + "[queries.q]\ngoal = { xyz = [1, 0, 0] }\n", "Did you mean 'position' where it says 'xyz'?"),
        ("version = 7\n", "version 7, expected 1"),
        ("arms = 3\n", "arms: expected a table"),
        ("name = 3\n", "name: expected text, got 3"),
        ("[arms.arm]\n", "arms.arm: has no 'robot'"),
        ('[arms.arm]\nrobot = "rr2"\n', "scene.toml:2: arms.arm.robot: unknown robot 'rr2'. Did you mean"),
        ('[arms."a/b"]\nrobot = "rr1"\n', "cannot name an element"),
        (SIMPLE + "q = [1.0]\n", "arm configuration has 1 number"),
        (SIMPLE + 'q = "hme"\n', "Did you mean 'home'"),
        (SIMPLE + "q = [nan, 0]\n", "q[0] is nan"),
        (SIMPLE + 'q = ["1", 0]\n', "expected a list of numbers, got '1'"),
        (SIMPLE + "q = [[1, 0]]\n", "q has shape (1, 2), expected a list of numbers"),
        (SIMPLE + "xyz = [1, 2]\n", "xyz has shape (2,), expected (3,)"),
        (SIMPLE + "rpy = [0, 0, 1]\nquaternion = [1, 0, 0, 0]\n", "got rpy and quaternion"),
        (SIMPLE + "quaternion = [0, 0, 0, 0]\n", "norm 0"),
        (SIMPLE + "rotation = [[1, 0, 0], [0, 1, 0], [0, 0, -1]]\n", "expected the rows of a rotation matrix"),
        (SIMPLE + 'limits = "fast"\n', "unknown limit preset 'fast'"),
        (SIMPLE + "limits = { lowr = [0, 0] }\n", "Did you mean 'lower'"),
        (SIMPLE + "limits = { velocity = [0, 1] }\n", "velocity"),
        (SIMPLE + "locked_joints = { finger = 1.0 }\n", "unknown locked joint 'finger'"),
        (SIMPLE + "held = { finger = 1.0 }\n", "unknown locked joint 'finger'"),
        (SIMPLE + "locked_joints = {}\nheld = {}\n", "unknown key 'held'"),
        ("[obstacles.a]\n", "obstacles.a: expected exactly one of box, sphere"),
        ("[obstacles.a]\nbox = [1, 1, 1]\nsphere = 1\n", "got box and sphere"),
        ("[obstacles.a]\nboxx = [1, 1, 1]\n", "got none (it has boxx)"),
        ("[obstacles.a]\nbox = [1, 1, -1]\n", "scene.toml:2: obstacles.a.box: box size is -1.0"),
        ("[obstacles.a]\nbox = [1, 1, inf]\n", "box[2] is inf"),
        ("[obstacles.a]\nsphere = 0\n", "sphere radius is 0.0"),
        ("obstacles.b.sphere = 1\nobstacles.a.sphere = 0\n", "scene.toml:2: obstacles.a.sphere: sphere radius is 0.0"),
        ("[obstacles.a]\ncylinder = { radius = 1 }\n", "obstacles.a.cylinder: has no 'length'"),
        ("[obstacles.a]\ncylinder = { radius = 1, length = 1, r = 2 }\n", "unknown key 'r'"),
        ("[obstacles.a]\nhalf_space = { normal = [0, 0, 0] }\n", "length zero"),
        ("[obstacles.a]\nsphere = 1\ncolor = 'orange'\n", "expected '#rrggbb'"),
        ("[obstacles.a]\nsphere = 1\ncolor = [2, 0, 0]\n", "numbers from 0 to 1"),
        ("[obstacles.a]\nshapes = []\n", "has no shapes"),
        ("[obstacles.a]\nshapes = [{ sphere = 1, radius = 2 }]\n", "unknown key 'radius'"),
        ("[obstacles.a]\nsphere = 1\nshapes = [{ sphere = 1 }]\n", "got both shapes and sphere"),
        ("[obstacles.a]\nmesh = { file = '../secret.stl' }\n", "the folder of the scene file; copy it there"),
        ("[obstacles.a]\nmesh = { file = '/etc/hostname' }\n", "is not inside"),
        ("[obstacles.a]\npoints = { file = '../scan.npy' }\n", "is not inside"),
        (
            "[obstacles.a]\npoints = { file = 'gone.npy' }\n",
            "scene.toml:2: obstacles.a.points.file: there is no such file: gone.npy",
        ),
        ("[obstacles.a]\nmesh = 'gone.stl'\n", "scene.toml:2: obstacles.a.mesh"),
        ("[obstacles.a]\nmesh = '.'\n", "scene.toml:2: obstacles.a.mesh.file: is a folder, expected a file"),
        ("[arms.a]\nrobot = 'gone.urdf'\n", "scene.toml:2: arms.a.robot: there is no such file: gone.urdf"),
        (SIMPLE + "[arms.b]\nbase = [0, 0, 1]\nrobot = 'planar2r'\n", "'base'. Did you mean 'xyz'"),
        (SIMPLE + "limits = { velocity = 4 }\n", "limits.velocity: expected a list of 2 numbers, one for each joint"),
        ("[obstacles.a]\npoints = { points = [] }\n", "expected (any, 3)"),
        ("[obstacles.a]\nmesh = { vertices = [[0, 0, 0]], faces = [[0, 1, 2.5]] }\n", "expected whole numbers"),
        (
            "[obstacles.arm]\nsphere = 1\n" + SIMPLE,
            "scene.toml:1: obstacles.arm: the scene has two elements named 'arm'",
        ),
        (SIMPLE + "[attachments.tool]\nsphere = 0.1\nlink = 'hand'\n", "unknown link 'hand'"),
        ("[attachments.tool]\nsphere = 0.1\n", "the scene has no arm"),
        ("allowed = [['arm', 'box']]\n" + SIMPLE, "unknown element 'box'"),
        ("allowed = 5\n" + SIMPLE, "scene.toml:1: allowed: expected a list, got 5"),
        ("allowed = [['arm']]\n" + SIMPLE, "expected pairs of names"),
        ("pair_padding = [{ between = ['arm', 'arm/link1'] }]\n" + SIMPLE, "has no 'distance'"),
        (
            "pair_padding = [{ between = ['arm', 'box'], distance = 0.1 }]\n" + SIMPLE,
            "scene.toml:1: pair_padding: unknown element 'box'",
        ),
        (
            SIMPLE + "[[pair_padding]]\nbetween = ['arm', 'arm']\ndistance = -0.1\n",
            "scene.toml:4: pair_padding: padding is -0.1",
        ),
        (SIMPLE + "[queries.q]\n", "expected exactly one of goal, goals"),
        (SIMPLE + "[queries.q]\ngoal = 'hme'\n", "queries.q: unknown configuration 'hme'. Did you mean 'home'"),
        (SIMPLE + "[queries.q]\ngoal = { frame = 'tol', position = [1, 0, 0] }\n", "unknown frame 'tol'"),
        (SIMPLE + "[queries.q]\ngoal = { position = [1, 0, 0], lower = [0, 0, 0] }\n", "got position and lower"),
        (SIMPLE + "[queries.q]\ngoal = { position = [1, 0, 0], tolerance = 1 }\n", "unknown key 'tolerance'"),
        (SIMPLE + "[queries.q]\ngoal = []\n", "is an empty list"),
        (SIMPLE + "[queries.q]\ngoal = { arm = 'home' }\n", "q.goal: names arms; with several arms the key is 'goals'"),
        (SIMPLE + "[queries.q]\ngoals = { arm = 'home' }\nstart = { arm = 'home' }\n", "the key is 'starts'"),
        (SIMPLE + "[queries.q]\ngoals = { other = 'home' }\n", "unknown arm 'other'"),
        (
            SIMPLE + "[arms.other]\nrobot = 'planar2r'\nxyz = [9, 0, 0]\n[queries.q]\ngoal = 'home'\n",
            "q.goal: names no arm; with several arms (arm, other) the key is 'goals'",
        ),
        (SIMPLE + "[queries.q]\ngoal = 1\n", "q.goal: expected a configuration's name, its numbers, a table"),
        (SIMPLE + "[queries.q]\ngoal = [1, 'x']\n", "q.goal: expected a list of numbers, got 'x' in it"),
        (SIMPLE + "[queries.q]\ngoal = ['home', true]\n", "q.goal[1]: expected a configuration's name"),
        (
            SIMPLE + "[queries.q]\ngoal = 'home'\nstart = { position = [1, 0, 0] }\n",
            "q.start: expected a configuration's name or its numbers, got {'position'",
        ),
        (
            SIMPLE + "[queries.q]\nstart = [1, 1]\ngoals = { arm = 'home' }\n",
            "q.start: unknown key 'start'. Did you mean 'starts'",
        ),
    ],
)
def test_a_wrong_file_is_refused_with_its_place(tmp_path: Path, text: str, message: str) -> None:
    assert message in refusal(tmp_path, text)


def test_a_mesh_that_only_claims_to_be_convex_is_refused(tmp_path: Path) -> None:
    dented = "vertices = [[0,0,0],[1,0,0],[0,1,0],[0,0,1],[0.4,0.4,0.4]], faces = [[0,2,1],[0,1,3],[0,3,2],[1,2,3]]"
    assert "says it is convex" in refusal(tmp_path, f"[obstacles.a]\nmesh = {{ {dented}, convex = true }}\n")


def test_points_are_never_unpickled(tmp_path: Path) -> None:
    np.save(tmp_path / "evil.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
    assert "is not a list of points" in refusal(tmp_path, "[obstacles.a]\npoints = { file = 'evil.npy' }\n")
    (tmp_path / "words.csv").write_text("1, 2, x\n")
    assert "is not a list of points" in refusal(tmp_path, "[obstacles.a]\npoints = { file = 'words.csv' }\n")
    (tmp_path / "scan.las").write_text("")
    assert "one of .npy, .ply, .pcd" in refusal(tmp_path, "[obstacles.a]\npoints = { file = 'scan.las' }\n")


def test_deep_nesting_and_other_bytes_are_refused(tmp_path: Path) -> None:
    assert "deep" in refusal(tmp_path, "x = " + "[" * 100_000)
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FormatError, match="not UTF-8"):
        read_scene(tmp_path / "binary.toml", load_robot)
    (tmp_path / "powershell.toml").write_text(SIMPLE, encoding="utf-16")
    with pytest.raises(FormatError, match="save it as UTF-8"):
        read_scene(tmp_path / "powershell.toml", load_robot)
    with pytest.raises(FormatError, match="no such file"):
        load_scene(tmp_path / "gone.toml")


def test_an_unknown_scene_lists_the_near_ones() -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'rr1_table'"):
        load_scene("rr1_tabel")


def test_a_name_with_a_suffix_is_a_file_that_is_missing() -> None:
    with pytest.raises(InputError, match=r"scene file 'missing\.json' does not exist and has the suffix '\.json', exp"):
        load_scene("missing.json")


def test_a_robot_in_place_of_a_scene_and_a_scene_in_place_of_a_robot_are_named() -> None:
    with pytest.raises(InputError, match=r"arm\.urdf is a robot, expected a scene; Scene\(\)\.with_arm"):
        load_scene("arm.urdf")
    with pytest.raises(InputError, match=r"cell\.toml is a scene, expected a robot; load_scene"):
        load_robot("cell.toml")


# ---- the writer ------------------------------------------------------------------------------


@given(
    st.dictionaries(
        st.text(max_size=8),
        st.recursive(
            st.none().map(lambda _: "x") | st.booleans() | st.integers(-(2**62), 2**62) | st.text(max_size=12)
            | st.floats(allow_nan=False),
            lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
            max_leaves=8,
        ),
        max_size=4,
    )
)  # fmt: skip
@settings(deadline=None, max_examples=150)
def test_what_the_writer_writes_reads_back_the_same(data: dict[str, object]) -> None:
    import tomllib

    assert tomllib.loads(to_toml(data)) == data


def test_the_line_of_a_place_is_found() -> None:
    text = "name = 'x'\n\n[arms.left]\nrobot = 'a'\n\n[obstacles.\"big box\"]\nxyz = [0, 0, 0]\n"
    assert line_of(text, ("name",)) == 1
    assert line_of(text, ("arms", "left")) == 3
    assert line_of(text, ("arms", "left", "robot")) == 4
    assert line_of(text, ("obstacles", "big box", "xyz")) == 7
    assert line_of(text, ("nowhere",)) is None


def test_a_file_name_that_is_not_utf8_names_a_scene(tmp_path: Path) -> None:
    file = tmp_path / os.fsdecode(b"caf\xe9.toml")
    try:
        file.write_text("version = 1\n")
    except OSError:
        pytest.skip("this file system has names in Unicode only")
    assert load_scene(file).name == "caf\N{REPLACEMENT CHARACTER}"
