"""MotionBenchMaker's YAML and the JSON sets of its problems."""

from __future__ import annotations

import gzip
import json
import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rr1plan.errors import FormatError, InputError
from rr1plan.robot import Robot
from rr1plan.scene.model_library import load_robot, load_scene, robot_folder
from rr1plan.scene.motion_bench import (
    hold,
    problem_set_joints,
    read_bench_scene,
    read_problem_set,
)
from rr1plan.shapes import Box, Capsule, Cylinder, Mesh, Sphere
from rr1plan.transforms import pose

HALF = 0.7071067811865476
SCENE = f"""
name: kitchen
world:
  collision_objects:
    - id: can
      primitives:
        - {{type: cylinder, dimensions: [0.4, 0.05]}}
      primitive_poses:
        - position: [1, 2, 3e0]
          orientation: [0, 0, {HALF}, {HALF}]
    - id: table
      pose: {{position: {{x: 1, y: 0, z: 0}}, orientation: {{x: 0, y: 0, z: 0, w: 1}}}}
      primitives:
        - {{type: box, dimensions: [1, 2, 1e-1]}}
        - {{type: sphere, dimensions: [0.5]}}
      primitive_poses:
        - {{position: [0, 0, 0], orientation: [0, 0, 0, 1]}}
        - {{position: [0, 0, 1], orientation: [0, 0, 0, 1]}}
"""


def written(tmp_path: Path, text: str) -> Path:
    (tmp_path / "a.yaml").write_text(text)
    return tmp_path / "a.yaml"


def problem_set(**changes: Any) -> dict[str, Any]:
    problem = {
        "i": 3,
        "start": [0.2, 0.1],
        "goals": [[1.0, 0.5], [1.5, -0.5]],
        "other": {"finger_joint": 2.0},
        "boxes": [["b", [0.1, 0.2, 0.3], [1, 2, 3], [0, 0, HALF, HALF]]],
        "cylinders": [["c", 0.05, 0.4, [3, 0, 0], [0, 0, 0, 1]]],
        "spheres": [["s", 0.5, [0, 3, 0]]],
    } | changes
    return {"robot": "planar2r", "joints": ["joint2", "joint1"], "format": "", "problems": {"set": [problem]}}


def read_set(tmp_path: Path, data: Any, robot: Robot) -> Any:
    (tmp_path / "set.json").write_text(json.dumps(data))
    return read_problem_set(tmp_path / "set.json", robot)


def test_the_yaml_order_of_cylinders_and_quaternions_is_understood(tmp_path: Path) -> None:
    scene = read_bench_scene(written(tmp_path, SCENE))
    assert scene.name == "kitchen"
    can, table = scene.obstacles["can"], scene.obstacles["table"]
    assert can.geometries[0].shape == Cylinder(radius=0.05, length=0.4)
    assert np.allclose(can.geometries[0].pose, pose((1, 2, 3), rpy=(0, 0, np.pi / 2)))
    assert [g.shape for g in table.geometries] == [Box((1, 2, 0.1)), Sphere(0.5)]
    assert np.allclose(table.pose[:3, 3], (1, 0, 0))


@pytest.mark.parametrize(("number", "word"), [(1, "box"), (2, "sphere"), (3, "cylinder"), (4, "cone")])
def test_kinds_of_shapes_may_be_numbers(tmp_path: Path, number: int, word: str) -> None:
    sizes = {"box": "[1, 2, 3]", "sphere": "[1]"}.get(word, "[1, 2]")
    text = (
        f"collision_objects:\n- id: a\n  primitives:\n  - {{type: TYPE, dimensions: {sizes}}}\n"
        "  primitive_poses:\n  - {position: [0, 0, 0], orientation: [0, 0.383, 0, 0.924]}\n"
    )
    found = [
        read_bench_scene(written(tmp_path, text.replace("TYPE", kind))).obstacles["a"] for kind in (str(number), word)
    ]
    assert type(found[0].geometries[0].shape) is type(found[1].geometries[0].shape)
    if word != "cone":
        assert found[0].geometries[0].shape == found[1].geometries[0].shape
    with pytest.raises(FormatError, match="expected text, got 5"):
        read_bench_scene(written(tmp_path, text.replace("TYPE", "5")))


def test_meshes_with_their_points_are_read(tmp_path: Path) -> None:
    mesh = (
        "collision_objects:\n- id: m\n  meshes:\n"
        "  - {vertices: [[0,0,0],[1,0,0],[0,1,0],[0,0,1]], triangles: [[0,2,1],[0,1,3],[0,3,2],[1,2,3]]}\n"
        "  mesh_poses:\n  - {position: [0,0,0], orientation: [0,0,0,1]}\n"
    )
    shape = load_scene(written(tmp_path, mesh)).obstacles["m"].geometries[0].shape
    assert isinstance(shape, Mesh)
    assert shape.faces.tolist() == [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("name: kitchen", "name: [", "is not YAML"),
        ("name: kitchen", "name: !!python/object/apply:os.system [ls]", "is not YAML"),
        ("collision_objects", "objects", "world: has no 'collision_objects'"),
        ("id: can", "id: 5", "expected text, got 5"),
        ("id: can", "id: table", "has the id 'table'"),
        ("id: can", "id: a/b", "cannot name"),
        ("type: cylinder", "type: torus", "unknown type 'torus'"),
        ("[0.4, 0.05]", "[0.4]", "a cylinder has 2 dimensions, got 1"),
        ("[0.4, 0.05]", "[0.4, .nan]", "expected a finite number, got nan"),
        ("[0.4, 0.05]", "[0.4, yes]", "expected a finite number, got True"),
        ("[0.4, 0.05]", "[0.4, abc]", "expected a number, got 'abc'"),
        ("[0.4, 0.05]", "[0.4, -1]", "cylinder radius is -1.0"),
        ("[0.4, 0.05]", "5", "expected a list of numbers"),
        (f"[0, 0, {HALF}, {HALF}]", "[0, 0, 0, 0]", "norm 0"),
        (f"[0, 0, {HALF}, {HALF}]", "[0, 0, 1]", "expected 4 numbers, got 3"),
        ("orientation: {x: 0, y: 0, z: 0, w: 1}", "orientation: {x: 0}", "has no 'y'"),
        ("        - {type: sphere, dimensions: [0.5]}\n", "", "1 primitives and 2 primitive_poses"),
        ("name: kitchen", "robot_state: {attached_collision_objects: [{}]}", "attached objects"),
    ],
)
def test_a_wrong_scene_is_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in SCENE
    with pytest.raises(FormatError, match=message):
        read_bench_scene(written(tmp_path, SCENE.replace(old, new, 1)))


def test_deep_yaml_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="nested deeper"):
        read_bench_scene(written(tmp_path, "[" * 20_000))


def test_a_problem_set_gives_named_problems_in_the_robot_s_order(tmp_path: Path, planar2r: Robot) -> None:
    problems = read_set(tmp_path, problem_set(), planar2r)
    assert list(problems) == ["set/3"]
    problem = problems["set/3"]
    assert np.array_equal(problem.start, [0.1, 0.2])
    assert [goal.q.tolist() for goal in problem.goal["planar2r"]] == [[0.5, 1.0], [-0.5, 1.5]]
    obstacles = problem.scene.obstacles
    assert obstacles["b"].geometries[0].shape == Box((0.1, 0.2, 0.3))
    assert np.allclose(obstacles["b"].pose, pose((1, 2, 3), rpy=(0, 0, np.pi / 2)))
    assert obstacles["c"].geometries[0].shape == Cylinder(0.05, 0.4)
    assert obstacles["s"].geometries[0].shape == Sphere(0.5)


def test_a_set_need_not_hold_more_than_it_has_to(tmp_path: Path, planar2r: Robot) -> None:
    data = problem_set()
    least = {"start": [0.2, 0.1], "goals": [[1.0, 0.5]]}
    data["problems"] = {"a": [least, {**least, "valid": False}, {**least, "seconds": 3, "comment": "short"}], "b": []}
    problems = read_set(tmp_path, data, planar2r)
    assert list(problems) == ["a/1", "a/3"]
    assert not problems["a/1"].scene.obstacles
    data["problems"] = {"a": [{**least, "i": 2}, least]}
    with pytest.raises(FormatError, match="second problem 'a/2'"):
        read_set(tmp_path, data, planar2r)


def test_capsules_and_meshes_are_read_too(tmp_path: Path, planar2r: Robot) -> None:
    corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    capsule, mesh = ["c", 0.05, 0.4, [3, 0, 0], [0, 0, 0, 1]], ["m", corners, faces, [5, 5, 5], [0, 0, HALF, HALF]]
    data = problem_set(cylinders=[], capsules=[capsule], meshes=[mesh])
    obstacles = read_set(tmp_path, data, planar2r)["set/3"].scene.obstacles
    assert obstacles["c"].geometries[0].shape == Capsule(0.05, 0.4)
    (solid,) = obstacles["m"].geometries
    assert isinstance(solid.shape, Mesh)
    assert sorted(solid.shape.vertices.tolist()) == sorted(corners)
    assert np.allclose(obstacles["m"].pose, pose((5, 5, 5), rpy=(0, 0, np.pi / 2)))


def test_a_set_tells_which_joints_to_load_a_robot_with(tmp_path: Path) -> None:
    data = problem_set()
    read_set(tmp_path, data, load_robot("planar2r"))
    file = tmp_path / "set.json"
    assert problem_set_joints(file) == ("joint2", "joint1")
    urdf = robot_folder("planar2r") / "planar2r.urdf"
    robot = load_robot(urdf, joints=problem_set_joints(file))
    problem = read_problem_set(file, robot)["set/3"]
    assert problem.start.tolist() == data["problems"]["set"][0]["start"]
    file.write_text('{"problems": {}}')
    with pytest.raises(FormatError, match="no joints"):
        problem_set_joints(file)


def test_a_packed_problem_set_is_read_too(tmp_path: Path, planar2r: Robot) -> None:
    (tmp_path / "set.json.gz").write_bytes(gzip.compress(json.dumps(problem_set()).encode()))
    assert len(read_problem_set(tmp_path / "set.json.gz", planar2r)) == 1


def test_held_joints_beyond_their_limits_are_held_at_them_and_logged(
    rr1: Robot, caplog: pytest.LogCaptureFixture
) -> None:
    upper = rr1.joint("finger_joint").upper
    with caplog.at_level(logging.WARNING):
        assert hold(rr1, {"finger_joint": 2.0, "no such joint": 1.0, "shoulder_joint": 0.5}).locked_joints == {
            "finger_joint": upper
        }
    assert "held at the limit" in caplog.text
    caplog.clear()
    assert hold(rr1, {"finger_joint": 0.25}).locked_joints == {"finger_joint": 0.25}
    assert caplog.text == ""


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"start": [0.1]}, "shape"),
        ({"start": [0.1, float("nan")]}, "is nan"),
        ({"goals": []}, "shape"),
        ({"goals": [[1.0]]}, "shape"),
        ({"i": None}, "has no 'i'|expected a number"),
        ({"other": {"finger": "open"}}, "expected a number"),
        ({"boxes": [["b", [1, 1, 1]]]}, "expected a name and 3 values"),
        ({"boxes": [["b", [1, 1, -1], [0, 0, 0], [0, 0, 0, 1]]]}, "box size is -1"),
        ({"boxes": [["b", [1, 1, 1], [0, 0, 0], [0, 0, 1]]]}, "expected a quaternion xyzw"),
        ({"spheres": [["s", 1, [0, 0, 0]], ["s", 1, [0, 0, 0]]]}, "two obstacles named 's'"),
        ({"spheres": [["planar2r", 1, [5, 5, 5]]]}, "two elements named"),
        ({"spheres": 5}, "expected a list"),
        ({"cones": [["c", 0.1, 0.2, [0, 0, 0], [0, 0, 0, 1]]]}, "cones: is not known, expected one of boxes"),
        ({"capsules": [["k", 0.1, -0.2, [0, 0, 0], [0, 0, 0, 1]]]}, "capsule length is -0.2"),
        ({"meshes": [["m", [[0, 0, 0]], [[0, 0, 0]], [0, 0, 0], [0, 0, 0, 1]]]}, "mesh has 1 vertices"),
        ({"meshes": [["m", "abc", [[0, 0, 0]], [0, 0, 0], [0, 0, 0, 1]]]}, "mesh vertices"),
        ({"valid": "no"}, "expected true or false"),
    ],
)
def test_a_wrong_problem_is_refused(tmp_path: Path, planar2r: Robot, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(FormatError, match=message):
        read_set(tmp_path, problem_set(**changes), planar2r)


def test_a_set_for_another_robot_or_of_another_kind_is_refused(tmp_path: Path, rr1: Robot, planar2r: Robot) -> None:
    with pytest.raises(FormatError, match=r"'rr1' has shoulder_joint.*joints=problem_set_joints"):
        read_set(tmp_path, problem_set(), rr1)
    with pytest.raises(FormatError, match="expected a table"):
        read_set(tmp_path, [1], planar2r)
    (tmp_path / "x.json").write_text("{")
    with pytest.raises(FormatError, match=r"x\.json:1: is not JSON"):
        read_problem_set(tmp_path / "x.json", planar2r)
    with pytest.raises(InputError, match="finger_joint"):
        hold(rr1, {"finger_joint": float("nan")})
