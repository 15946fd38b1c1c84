"""Conversion of robots, scenes, goals, paths and trajectories to JSON data and back.

Floats are exact. Values are built from validated entries of `motion_schema` by their validating
constructors; nothing is unpickled or looked up by a path.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from rr1plan.checks import counted
from rr1plan.errors import InputError
from rr1plan.export import motion_schema as schema
from rr1plan.path import Path
from rr1plan.robot import Geometry, Inertial, Joint, Link, Mimic, Robot, check_robot
from rr1plan.robot.joint_limits import Limits
from rr1plan.scene import Arm, Attachment, Obstacle, Scene, pair
from rr1plan.scene.problem import Goal, JointGoal, PoseGoal, Problem, RegionGoal
from rr1plan.scene.scene_elements import names_of_pair
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, PointCloud, Shape, Sphere
from rr1plan.shapes.content_digest import value_hash
from rr1plan.shapes.convex_hulls import bounds_its_hull
from rr1plan.trajectory import Trajectory

# Classes whose fields are those of the entry of the same name.
_SHAPES = (Box, Sphere, Cylinder, Capsule, HalfSpace, Mesh, PointCloud)
_OTHERS = (Geometry, Inertial, Joint, Link, Mimic, Limits, Robot, JointGoal, PoseGoal, RegionGoal)
_ENTRIES: dict[type, type[schema.Entry]] = {c: getattr(schema, c.__name__) for c in (*_SHAPES, *_OTHERS)}
# Meshes with more vertices, and clouds with more points, can be stored in separate files.
_FEW = 64
Shapes = dict[str, Mesh | PointCloud]
ReadShape = Callable[[str], Mesh | PointCloud]


# ---- to plain data -------------------------------------------------------------------------


def plain(value: Any, stored: Shapes | None = None) -> Any:
    """JSON data of a value, by the schema.

    Args:
        value: A robot, shape, goal, or nested mappings, sequences, arrays and numbers.
        stored: Collects large meshes and point clouds, to which the data refers by their hash; None: all numbers are in
            the data.

    Raises:
        InputError: a value that cannot be converted.
    """
    if value is None or isinstance(value, bool | str | int):
        return value
    if isinstance(value, float):
        if math.isnan(value):
            raise InputError("NaN cannot be stored in a motion file")
        return value if math.isfinite(value) else repr(value)
    if isinstance(value, np.generic | np.ndarray):
        finite = bool(np.isfinite(value).all())
        return value.tolist() if finite else plain(value.tolist())
    if isinstance(value, Mapping):
        return {key: plain(item, stored) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item, stored) for item in value]
    if isinstance(value, frozenset):
        return sorted(names_of_pair(item) if isinstance(item, frozenset) else item for item in value)
    if stored is not None and isinstance(value, Mesh | PointCloud):
        points = value.vertices if isinstance(value, Mesh) else value.points
        if len(points) > _FEW:
            sha256 = value_hash(value)
            stored[sha256] = value
            return {"type": "stored", "sha256": sha256}
    return _plain_fields(value, stored)


def _plain_fields(value: object, stored: Shapes | None) -> dict[str, object]:
    if type(value) not in _ENTRIES:
        raise InputError(f"values of type {type(value).__name__} cannot be stored in a motion file")
    entry = _ENTRIES[type(value)]
    tag = entry.__struct_config__.tag
    names = zip(entry.__struct_encode_fields__, entry.__struct_fields__, strict=True)
    fields = {key: plain(getattr(value, name), stored) for key, name in names}
    return fields if tag is None else {"type": tag, **fields}


def plain_scene(scene: Scene, stored: Shapes | None = None) -> dict[str, object]:
    """A scene, and the robots of its arms, as the entries `scene` and `robots` of a document."""
    robots: list[Robot] = []
    arms = []
    for name, arm in scene.arms.items():
        if not any(robot is arm.robot for robot in robots):
            robots.append(arm.robot)
        index = next(i for i, robot in enumerate(robots) if robot is arm.robot)
        arms.append({"name": name, "robot": index, "base": plain(arm.base), "q": plain(arm.q)})
    things = {
        kind: [
            {"name": n, **{f: plain(getattr(thing, f), stored) for f in entry.__struct_fields__ if f != "name"}}
            for n, thing in named.items()
        ]
        for kind, entry, named in (
            ("obstacles", schema.Obstacle, scene.obstacles),
            ("attachments", schema.Attachment, scene.attachments),
        )
    }
    distances = sorted((names_of_pair(names), distance) for names, distance in scene.pair_padding.items())
    return {
        "robots": [plain(robot, stored) for robot in robots],
        "scene": {
            "name": scene.name,
            "description": scene.description,
            "arms": arms,
            **things,
            "allowed": plain(scene.allowed),
            "padding": float(scene.padding),
            "pair_padding": [{"between": names, "distance": float(distance)} for names, distance in distances],
        },
    }


# ---- from checked entries ------------------------------------------------------------------


def build_scene(entry: schema.Scene, robots: list[schema.Robot], read_shape: ReadShape) -> Scene:
    """The scene of a document.

    Args:
        entry: The scene.
        robots: The robots of its arms.
        read_shape: Finds a mesh or point cloud by its hash.

    Raises:
        InputError: entries that do not define a valid robot or scene.
    """
    built = [_robot(robot, read_shape) for robot in robots]
    arms = {}
    for arm in _by_name("arm", entry.arms).values():
        if arm.robot >= len(built):
            raise InputError(f"arm {arm.name!r} has robot {arm.robot}, but the file holds {len(built)}")
        arms[arm.name] = Arm(built[arm.robot], np.array(arm.base), np.array(arm.q))
    obstacles = {
        name: Obstacle(_geometries(thing.geometries, read_shape), np.array(thing.pose), thing.mass, thing.friction)
        for name, thing in _by_name("obstacle", entry.obstacles).items()
    }
    attachments = {
        name: Attachment(
            _geometries(held.geometries, read_shape),
            held.arm,
            held.link,
            np.array(held.pose),
            frozenset(held.touch),
            held.mass,
            held.friction,
        )
        for name, held in _by_name("attached object", entry.attachments).items()
    }
    return Scene(
        arms=arms,
        obstacles=obstacles,
        attachments=attachments,
        allowed=frozenset(pair(a, b) for a, b in entry.allowed),
        padding=entry.padding,
        pair_padding={pair(*one.between): one.distance for one in entry.pair_padding},
        name=entry.name,
        description=entry.description,
    )


def build_problem(entry: schema.Problem, scene: Scene) -> Problem:
    """The problem of a motion document in its scene.

    Raises:
        InputError: entries that do not define a valid problem in this scene.
    """
    goals = {arm: [_goal(goal) for goal in alternatives] for arm, alternatives in entry.goal.items()}
    return Problem(scene, np.array(entry.start), goals, arms=entry.arms).with_margin(entry.margin)


def build_path(entry: schema.Path) -> Path:
    """A document's path.

    Raises:
        InputError: entries that do not define a valid path.
    """
    _check_rows("waypoints", entry.waypoints, len(entry.joint_names))
    return Path(tuple(entry.joint_names), np.array(entry.waypoints))


def build_trajectory(entry: schema.Trajectory) -> Trajectory:
    """A document's trajectory.

    Raises:
        InputError: entries that do not define a valid trajectory.
    """
    degree = len(entry.coefficients[0])
    for i, piece in enumerate(entry.coefficients):
        if len(piece) != degree:
            raise InputError(f"coefficients[{i}] has {counted(len(piece), 'row')}, expected {degree} like the first")
        _check_rows(f"coefficients[{i}]", piece, len(entry.joint_names))
    return Trajectory(tuple(entry.joint_names), np.array(entry.breaks), np.array(entry.coefficients))


def _check_rows(name: str, rows: list[list[float]], width: int) -> None:
    bad = next((i for i, row in enumerate(rows) if len(row) != width), None)
    if bad is not None:
        raise InputError(f"{name}[{bad}] has {counted(len(rows[bad]), 'number')}, expected {width}, one for each joint")


def _by_name(kind: str, entries: list[Any]) -> dict[str, Any]:
    """Entries by their name."""
    found: dict[str, Any] = {}
    for entry in entries:
        if entry.name in found:
            raise InputError(f"the file holds two entries for the {kind} {entry.name!r}")
        found[entry.name] = entry
    return found


def _robot(entry: schema.Robot, read_shape: ReadShape) -> Robot:
    return check_robot(
        Robot(
            name=entry.name,
            links=tuple(_link(link, read_shape) for link in entry.links),
            joints=tuple(_joint(joint) for joint in entry.joints),
            joint_names=tuple(entry.joint_names),
            limits=_limits(entry.limits),
            configurations={name: np.array(q) for name, q in entry.configurations.items()},
            locked_joints=entry.locked_joints,
            disabled_collisions=frozenset(pair(a, b) for a, b in entry.disabled_collisions),
            tool=entry.tool,
            presets={name: _limits(limits) for name, limits in entry.presets.items()},
            locked_joint_states=entry.locked_joint_states,
            source=entry.source,
        )
    )


def _link(entry: schema.Link, read_shape: ReadShape) -> Link:
    own = entry.inertial
    inertial = None if own is None else Inertial(own.mass, np.array(own.com), np.array(own.inertia), own.assumed)
    return Link(entry.name, inertial, _geometries(entry.visuals, read_shape), _geometries(entry.collisions, read_shape))


def _joint(entry: schema.Joint) -> Joint:
    mimic = None if entry.mimic is None else Mimic(entry.mimic.joint, entry.mimic.multiplier, entry.mimic.offset)
    return Joint(
        name=entry.name,
        kind=entry.kind,
        parent=entry.parent,
        child=entry.child,
        origin=np.array(entry.origin),
        axis=np.array(entry.axis),
        lower=float(entry.lower),
        upper=float(entry.upper),
        velocity=float(entry.velocity),
        effort=float(entry.effort),
        damping=entry.damping,
        friction=entry.friction,
        mimic=mimic,
        acceleration=float(entry.acceleration),
        jerk=float(entry.jerk),
    )


def _limits(entry: schema.Limits) -> Limits:
    return Limits(**{name: np.array(getattr(entry, name), dtype=float) for name in entry.__struct_fields__})


def _geometries(entries: list[schema.Geometry], read_shape: ReadShape) -> tuple[Geometry, ...]:
    return tuple(Geometry(g.name, _shape(g.shape, read_shape), np.array(g.pose), g.color) for g in entries)


def _shape(entry: schema.Shape, read_shape: ReadShape) -> Shape:
    match entry:
        case schema.Box(size):
            return Box(size)
        case schema.Sphere(radius):
            return Sphere(radius)
        case schema.Cylinder(radius, length):
            return Cylinder(radius, length)
        case schema.Capsule(radius, length):
            return Capsule(radius, length)
        case schema.HalfSpace(normal, offset):
            return HalfSpace(normal, offset)
        case schema.PointCloud(points, resolution):
            return PointCloud(np.array(points).reshape(-1, 3), resolution)
        case schema.Mesh(vertices, faces, convex):
            shape: Shape = Mesh(np.array(vertices).reshape(-1, 3), np.array(faces).reshape(-1, 3), convex)
        case schema.Stored(sha256):
            shape = read_shape(sha256)
    if isinstance(shape, Mesh) and shape.convex and not bounds_its_hull(shape):
        raise InputError("a mesh says it is convex, but a vertex lies outside one of its faces")
    return shape


def _goal(entry: schema.JointGoal | schema.PoseGoal | schema.RegionGoal) -> Goal:
    match entry:
        case schema.JointGoal(q):
            return JointGoal(np.array(q))
        case schema.PoseGoal():
            return PoseGoal(**{name: getattr(entry, name) for name in entry.__struct_fields__})
        case schema.RegionGoal():
            return RegionGoal(**{name: getattr(entry, name) for name in entry.__struct_fields__})
