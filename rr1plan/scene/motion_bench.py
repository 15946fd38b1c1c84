"""MotionBenchMaker's scenes (YAML), and sets of its problems in one JSON file.

In the YAML a cylinder's dimensions are [length, radius] and quaternions are xyzw. In the JSON
boxes have full sides, cylinders radius and length, quaternions are xyzw, poses are world poses:

    {"robot": name, "joints": [name, ...], "problems": {set: [
        {"i": 1, "start": [q], "goals": [[q], ...], "other": {joint: value},
         "boxes": [[name, [sx, sy, sz], [x, y, z], [qx, qy, qz, qw]], ...],
         "cylinders": [[name, radius, length, [x, y, z], [qx, qy, qz, qw]], ...],
         "capsules": [[name, radius, length, [x, y, z], [qx, qy, qz, qw]], ...],
         "meshes": [[name, [[x, y, z], ...], [[corner, corner, corner], ...], [x, y, z], [qx, qy, qz, qw]], ...],
         "spheres": [[name, radius, [x, y, z]], ...]}, ...]}}

Only joints, problems, start and goals are required; a problem without a number gets that of its position, and one with
`"valid": false` is skipped. Lists by other names are rejected: they may be obstacles.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rr1plan.checks import Array
from rr1plan.errors import FormatError, InputError
from rr1plan.files.checked_tables import Table
from rr1plan.files.documents import read_json, read_yaml
from rr1plan.files.file_access import text_stem
from rr1plan.robot import Geometry, Robot
from rr1plan.scene import Arm, Obstacle, Scene
from rr1plan.scene.moveit_scene import cone
from rr1plan.scene.problem import JointGoal, Problem
from rr1plan.shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere
from rr1plan.transforms import identity, pose

_log = logging.getLogger(__name__)
_MAX_BYTES = 64 * 1024 * 1024


def read_bench_scene(file: str | Path) -> Scene:
    """Read the obstacles of a MotionBenchMaker scene (YAML).

    Args:
        file: The file, with `world.collision_objects`.

    Returns:
        A scene without arms; add them with `scene.with_arm`.

    Raises:
        FormatError: not YAML, or not such a scene; names the place.
    """
    top = read_yaml(file, _MAX_BYTES)
    state = top.table("robot_state")
    if state.raw("attached_collision_objects"):
        raise state.error("holds attached objects, which are not read; attach them with scene.attach")
    world = top.table("world") if "world" in top else top
    world.required("collision_objects")
    obstacles: dict[str, Obstacle] = {}
    for entry in world.tables("collision_objects"):
        name = entry.string("id")
        if name in obstacles:
            raise entry.error(f"has the id {name!r}, which another object has too")
        obstacles[name] = Obstacle(_read_object(entry, name), _read_pose(entry, "pose"))
    with top.blame():
        return Scene(obstacles=obstacles, name=top.string("name", "") or text_stem(file))


def read_problem_set(file: str | Path, robot: Robot) -> dict[str, Problem]:
    """Read a set of problems (JSON, also packed as .json.gz).

    Args:
        file: The file.
        robot: Their robot; its base is at the origin. Joints that it does not plan for are locked at the file's values,
            as far as their limits allow.

    Returns:
        Problems by name, "set/number", in the order of the file; the arm has the robot's name.

    Raises:
        FormatError: not JSON, or not such a set; names the place.
    """
    top = read_json(file, _MAX_BYTES)
    joints = top.strings("joints")
    if sorted(joints) != sorted(robot.joint_names):
        raise top.error(
            f"has the joints {', '.join(joints)}, but {robot.name!r} has {', '.join(robot.joint_names)}; "
            "try load_robot(..., joints=problem_set_joints(file))"
        )
    order = [joints.index(name) for name in robot.joint_names]
    problems: dict[str, Problem] = {}
    robots: dict[tuple[tuple[str, float], ...], Robot] = {}
    sets = top.table("problems")
    for group in sets.names():
        for place, entry in enumerate(sets.tables(group), 1):
            name = f"{group}/{int(entry.number('i', place))}"
            if not entry.boolean("valid", default=True):
                _log.info("%s says that it is not valid, it is passed over", name)
                continue
            if name in problems:
                raise entry.error(f"is the second problem {name!r}", "i")
            other = entry.table("other")
            held = tuple((joint, other.number(joint)) for joint in other.names())
            if held not in robots:
                robots[held] = hold(robot, dict(held))
            problems[name] = _read_problem(entry, robots[held], order, name)
    return problems


def problem_set_joints(file: str | Path) -> tuple[str, ...]:
    """The joints of a set of problems (JSON), for `load_robot`.

    Raises:
        FormatError: not JSON, or not such a set.
    """
    joints = read_json(file, _MAX_BYTES).strings("joints")
    if not joints:
        raise FormatError("has no joints, expected a list of names", file)
    return joints


def hold(robot: Robot, values: Mapping[str, float]) -> Robot:
    """The robot with the locked joints of `values` at their values; fixed and unknown joints are skipped.

    A value beyond a joint's limits is clipped, with a warning in the log: the benchmark's gripper opens slightly
    farther than some of its descriptions allow.

    Raises:
        InputError: a value that is not finite.
    """
    inside: dict[str, float] = {}
    for name, value in values.items():
        if name not in robot.locked_joints:
            continue
        joint = robot.joint(name)
        inside[name] = min(max(value, joint.lower), joint.upper)
        if inside[name] != value:
            _log.warning("joint %r is %g, outside [%g, %g]; held at the limit", name, value, joint.lower, joint.upper)
    return robot.with_locked_joints(inside) if inside else robot


# ---- YAML ------------------------------------------------------------------------------------


def _read_object(entry: Table, name: str) -> tuple[Geometry, ...]:
    shapes: list[tuple[Shape, Array]] = []
    for kind, poses, read in (("primitives", "primitive_poses", _read_primitive), ("meshes", "mesh_poses", _read_mesh)):
        parts, places = entry.tables(kind), entry.tables(poses)
        if len(parts) != len(places):
            raise entry.error(f"has {len(parts)} {kind} and {len(places)} {poses}")
        for part, place in zip(parts, places, strict=True):
            with part.blame():
                shapes.append((read(part), _pose_of(place)))
    if not shapes:
        raise entry.error("has no primitives and no meshes, expected at least one")
    names = [name] if len(shapes) == 1 else [f"{name}_{i}" for i in range(len(shapes))]
    return tuple(Geometry(n, shape, T) for n, (shape, T) in zip(names, shapes, strict=True))


def _read_primitive(entry: Table) -> Shape:
    counts = {"box": 3, "sphere": 1, "cylinder": 2, "cone": 2}
    number = entry.raw("type")
    # MoveIt's own files count types from one.
    by_number = type(number) is int and 1 <= number <= len(counts)
    kind = list(counts)[number - 1] if by_number else entry.string("type")
    d = _numbers(entry, "dimensions")
    if kind not in counts:
        raise entry.error(f"unknown type {kind!r}, expected one of {', '.join(counts)}", "type")
    if len(d) != counts[kind]:
        raise entry.error(f"a {kind} has {counts[kind]} dimensions, got {len(d)}", "dimensions")
    makers: dict[str, Callable[[], Shape]] = {
        "box": lambda: Box((d[0], d[1], d[2])),
        "sphere": lambda: Sphere(d[0]),
        "cylinder": lambda: Cylinder(radius=d[1], length=d[0]),
        "cone": lambda: cone(radius=d[1], length=d[0]),
    }
    return makers[kind]()


def _read_mesh(entry: Table) -> Shape:
    if "vertices" not in entry or "triangles" not in entry:
        raise entry.error("expected vertices and triangles; a mesh that is named by a resource is not read")
    return Mesh(entry.numbers("vertices", (None, 3)), entry.indices("triangles", (None, 3)))


def _read_pose(entry: Table, key: str) -> Array:
    return _pose_of(entry.table(key)) if key in entry else identity()


def _pose_of(entry: Table) -> Array:
    position = _components(entry, "position", "xyz")
    qx, qy, qz, qw = _components(entry, "orientation", "xyzw")
    with entry.blame():
        return pose(position, quaternion=(qw, qx, qy, qz))


def _components(entry: Table, key: str, letters: str) -> list[float]:
    """Numbers from a list, or from a table of x, y, z (, w)."""
    value = entry.required(key)
    if isinstance(value, Mapping):
        table = entry.table(key)
        return [_number(table, table.required(letter), letter) for letter in letters]
    numbers = _numbers(entry, key)
    if len(numbers) != len(letters):
        raise entry.error(f"expected {len(letters)} numbers, got {len(numbers)}", key)
    return numbers


def _numbers(entry: Table, key: str) -> list[float]:
    value = entry.required(key)
    if not isinstance(value, list):
        raise entry.error(f"expected a list of numbers, got {value!r}", key)
    return [_number(entry, item, key) for item in value]


def _number(entry: Table, value: Any, key: str) -> float:
    """A finite number; YAML 1.1 reads 1e3 as text, which is converted."""
    if isinstance(value, str | int | float) and not isinstance(value, bool):
        try:
            number = float(value)
        except (ValueError, OverflowError):
            raise entry.error(f"expected a number, got {value!r}", key) from None
        if math.isfinite(number):
            return number
    raise entry.error(f"expected a finite number, got {value!r}", key)


# ---- JSON ------------------------------------------------------------------------------------


def _read_problem(entry: Table, robot: Robot, order: list[int], name: str) -> Problem:
    with entry.blame():
        scene = Scene({robot.name: Arm(robot)}, _read_obstacles(entry), name=name)
        start = entry.numbers("start", (robot.nq,))[order]
        goals = entry.numbers("goals", (None, robot.nq))[:, order]
        unknown = [key for key in entry.unasked() if isinstance(entry.raw(key), list | dict)]
        if unknown:
            raise entry.error(f"is not known, expected one of {', '.join(_MAKERS)}", unknown[0])
        return Problem(scene, start, [JointGoal(goal) for goal in goals])


# The length of a row, and the shape that it represents.
_MAKERS: dict[str, tuple[int, Callable[[Sequence[Any]], Shape]]] = {
    "boxes": (4, lambda row: Box(row[1])),
    "cylinders": (5, lambda row: Cylinder(row[1], row[2])),
    "capsules": (5, lambda row: Capsule(row[1], row[2])),
    "meshes": (5, lambda row: Mesh(row[1], row[2])),
    "spheres": (3, lambda row: Sphere(row[1])),
}


def _read_obstacles(entry: Table) -> dict[str, Obstacle]:
    obstacles: dict[str, Obstacle] = {}
    for kind, (length, make) in _MAKERS.items():
        for row in entry.rows(kind):
            if not isinstance(row, list) or len(row) != length or not isinstance(row[0], str):
                raise entry.error(f"expected a name and {length - 1} values, got {row!r}", kind)
            if row[0] in obstacles:
                raise entry.error(f"has two obstacles named {row[0]!r}", kind)
            place = row[-1:] if kind == "spheres" else row[-2:]
            obstacles[row[0]] = Obstacle([Geometry(row[0], make(row))], _world_pose(place))
    return obstacles


def _world_pose(place: Sequence[Any]) -> Array:
    if len(place) == 1:
        return pose(place[0])
    if not isinstance(place[1], list) or len(place[1]) != 4:
        raise InputError(f"expected a quaternion xyzw, got {place[1]!r}")
    qx, qy, qz, qw = place[1]
    return pose(place[0], quaternion=(qw, qx, qy, qz))
