"""Problems in a form that all planners support: a URDF of convex shapes, obstacles, two configurations.

Locked and mimic joints are written as fixed joints, meshes as STL files, a capsule as a cylinder and two
spheres, a half-space as a slab beyond the arm's reach: all planners get the same bodies and pairs to check.
A continuous joint is limited to one turn, from -pi to pi, because peers treat continuous joints differently.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

import rr1plan as rp
from rr1plan.checks import Array
from rr1plan.robot import Geometry, Joint, Robot
from rr1plan.transforms import inverse, pose, rotation_about

_SLAB = 10.0  # sides and depth of the slab that replaces a half-space [m]


def settle(problem: rp.Problem, seed: int) -> rp.Problem:
    """The same problem with slabs for half-spaces and, for a goal in space, one configuration that reaches it.

    Raises:
        InputError: several arms, or nothing reaches the goal.
    """
    scene = problem.scene
    slabs = {
        name: replace(thing, geometries=tuple(map(_slab, thing.geometries))) for name, thing in scene.obstacles.items()
    }
    scene = replace(scene, obstacles=slabs)
    arm = scene.only_arm()
    goals = {arm: list(problem.goal[arm])}
    settled = rp.Problem(scene, {arm: problem.start}, goals)
    if len(goals[arm]) == 1 and isinstance(goals[arm][0], rp.JointGoal):
        return settled
    found = rp.plan(settled, planner="rrt_connect", budget=rp.Budget(seconds=10.0), rng=np.random.default_rng(seed))
    if found.path is None:
        raise rp.InputError(f"no configuration for the goal of scene {scene.name!r}: {found.status.value}")
    return rp.Problem(scene, {arm: problem.start}, {arm: rp.JointGoal(found.path.waypoints[-1])})


def _slab(geometry: Geometry) -> Geometry:
    if not isinstance(geometry.shape, rp.HalfSpace):
        return geometry
    n = np.array(geometry.shape.normal)
    across = np.cross([0.0, 0.0, 1.0], n)
    length = float(np.linalg.norm(across))
    turn = rotation_about(across / length if length > 1e-12 else np.array([1.0, 0.0, 0.0]), np.arctan2(length, n[2]))
    place = np.eye(4)
    place[:3, :3], place[:3, 3] = turn, (geometry.shape.offset - 0.5 * _SLAB) * n
    return replace(geometry, shape=rp.Box((_SLAB, _SLAB, _SLAB)), pose=geometry.pose @ place)


# ---- a problem -------------------------------------------------------------------------------------


def describe_problem(problem: rp.Problem, folder: Path) -> dict[str, Any]:
    """The description of a problem for a peer, with poses in the frame of the arm's base; see `worker.py`.

    Args:
        problem: One moving arm, with one goal configuration.
        folder: Folder of the robot's files, written if missing.

    Raises:
        InputError: an unsupported problem; the message gives the reason.
    """
    scene = problem.scene
    if len(scene.arms) > 1:
        raise rp.InputError(f"{len(scene.arms)} arms in the scene; the peers support one")
    if scene.padding or scene.pair_padding or scene.attachments:
        raise rp.InputError("the scene has paddings or attached objects")
    (arm,) = scene.arms
    goals = problem.goal[arm]
    if len(goals) != 1 or not isinstance(goals[0], rp.JointGoal):
        raise rp.InputError("the goal is not one configuration")
    parts = {name: list(_parts(thing)) for name, thing in scene.obstacles.items()}
    checked = {frozenset(pair) for pair in scene.checked_pairs}
    links = [f"{arm}/{link.name}" for link in scene.arms[arm].robot.links if link.collisions]
    base = inverse(scene.arms[arm].base)
    obstacles = [
        {"name": f"{name}.{i}", "kind": kind, "size": size, "pose": (base @ T).tolist()}
        for name, own in parts.items()
        for i, (kind, size, T) in enumerate(own)
    ]
    free = [
        [link.split("/", 1)[1], f"{name}.{i}"]
        for link in links
        for name, own in parts.items()
        if frozenset((link, name)) not in checked
        for i in range(len(own))
    ]
    unchecked = [[a.split("/", 1)[1], b.split("/", 1)[1]] for a, b in combinations(links, 2) if {a, b} not in checked]
    robot = write_robot(scene.arms[arm].robot, unchecked, folder)
    endless = scene.arms[arm].robot.continuous > 0.0
    ends = {"start": _in_one_turn(problem.start, endless), "goal": _in_one_turn(goals[0].q, endless)}
    return {"robot": robot, "obstacles": obstacles, "may_touch": free, **ends}


def describe_changes(problem: rp.Problem) -> str:
    """Simplifications for peers that may affect results; empty if there are none."""
    robots = [problem.scene.arms[arm].robot for arm in problem.arms]
    names = [name for robot in robots for name in np.array(robot.joint_names)[robot.continuous > 0.0]]
    return f"{', '.join(names)} turn from -pi to pi, not continuously" if names else ""


def _in_one_turn(q: Array, endless: Array) -> list[float]:
    """A configuration, with continuous joints reduced to one turn."""
    turned = np.where(endless, q - 2.0 * np.pi * np.round(q / (2.0 * np.pi)), q)
    return [float(x) for x in np.where(endless, np.clip(turned, -np.pi, np.pi), q)]


def _parts(thing: rp.Obstacle) -> Any:
    """Kind, sizes and T_world of each part of an obstacle."""
    for g in thing.geometries:
        for kind, size, T in _simple(g):
            if kind == "mesh":
                raise rp.InputError("an obstacle is a mesh; the peers get boxes, cylinders and balls")
            yield kind, size, thing.pose @ T


def _simple(g: Geometry) -> list[tuple[str, list[float], Array]]:
    match g.shape:
        case rp.Box(size):
            return [("box", list(size), g.pose)]
        case rp.Cylinder(radius, length):
            return [("cylinder", [radius, length], g.pose)]
        case rp.Sphere(radius):
            return [("sphere", [radius], g.pose)]
        case rp.Capsule(radius, length):
            ends = [("sphere", [radius], g.pose @ pose([0.0, 0.0, z])) for z in (-0.5 * length, 0.5 * length)]
            return [("cylinder", [radius, length], g.pose), *ends]
        case rp.Mesh():
            return [("mesh", [], g.pose)]
    raise rp.InputError(f"no plain form of a {type(g.shape).__name__}")


# ---- a robot ---------------------------------------------------------------------------------------


def write_robot(robot: Robot, unchecked: Sequence[Sequence[str]], folder: Path) -> dict[str, Any]:
    """Write a robot's URDF, SRDF and hulls to a folder; return their paths."""
    place = folder / robot.content_hash[:16]
    urdf, srdf = place / f"{robot.name}.urdf", place / f"{robot.name}.srdf"
    if not urdf.exists():
        place.mkdir(parents=True)
        ElementTree.ElementTree(_urdf(robot, place)).write(urdf)
        ElementTree.ElementTree(_srdf(robot, unchecked)).write(srdf)
    return {
        "name": robot.name,
        "urdf": str(urdf),
        "srdf": str(srdf),
        "base": robot.base,
        "tip": robot.joint(robot.joint_names[-1]).child,
        "joints": list(robot.joint_names),
        "velocity": robot.limits.velocity.tolist(),
        "acceleration": robot.limits.acceleration.tolist(),
    }


def _urdf(robot: Robot, folder: Path) -> ElementTree.Element:
    top = ElementTree.Element("robot", name=robot.name)
    for link in robot.links:
        element = ElementTree.SubElement(top, "link", name=link.name)
        _add_inertia(element)
        for i, g in enumerate(link.collisions):
            for kind, size, T in _simple(g):
                collision = ElementTree.SubElement(element, "collision")
                _add_origin(collision, T)
                stl = folder / f"{link.name}.{i}.stl"
                if isinstance(g.shape, rp.Mesh):
                    _write_hull(g.shape, stl)
                _add_shape(ElementTree.SubElement(collision, "geometry"), kind, size, stl)
    values = robot.joint_values(robot.home)
    for joint in robot.joints:
        top.append(_joint(robot, joint, values))
    return top


def _joint(robot: Robot, joint: Joint, values: dict[str, float]) -> ElementTree.Element:
    if joint.name not in robot.joint_names:
        element = ElementTree.Element("joint", name=joint.name, type="fixed")
        _add_origin(element, joint.origin @ joint.motion(values.get(joint.name, 0.0)))
    else:
        element = ElementTree.Element("joint", name=joint.name, type=joint.kind.replace("continuous", "revolute"))
        _add_origin(element, joint.origin)
        ElementTree.SubElement(element, "axis", xyz=_text(joint.axis))
        i, limits = robot.joint_names.index(joint.name), robot.limits
        turn = joint.kind == "continuous"
        lower, upper = (-np.pi, np.pi) if turn else (limits.lower[i], limits.upper[i])
        bounds = {"lower": lower, "upper": upper, "velocity": limits.velocity[i], "effort": 100.0}
        ElementTree.SubElement(element, "limit", {k: repr(float(v)) for k, v in bounds.items()})
    ElementTree.SubElement(element, "parent", link=joint.parent)
    ElementTree.SubElement(element, "child", link=joint.child)
    return element


def _add_inertia(element: ElementTree.Element) -> None:
    """Some readers require a mass of every link; no planner here uses it."""
    inertial = ElementTree.SubElement(element, "inertial")
    ElementTree.SubElement(inertial, "mass", value="1.0")
    ElementTree.SubElement(inertial, "inertia", ixx="0.01", iyy="0.01", izz="0.01", ixy="0", ixz="0", iyz="0")


def _add_origin(element: ElementTree.Element, T: Array) -> None:
    R = T[:3, :3]
    pitch = np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0]))
    if np.hypot(R[0, 0], R[1, 0]) > 1e-9:
        roll, yaw = np.arctan2(R[2, 1], R[2, 2]), np.arctan2(R[1, 0], R[0, 0])
    else:  # straight up or down: roll and yaw are one angle
        roll, yaw = np.arctan2(-R[1, 2], R[1, 1]), 0.0
    ElementTree.SubElement(element, "origin", xyz=_text(T[:3, 3]), rpy=_text([roll, pitch, yaw]))


def _add_shape(element: ElementTree.Element, kind: str, size: list[float], stl: Path) -> None:
    if kind == "box":
        ElementTree.SubElement(element, "box", size=_text(size))
    elif kind == "cylinder":
        ElementTree.SubElement(element, "cylinder", radius=repr(size[0]), length=repr(size[1]))
    elif kind == "sphere":
        ElementTree.SubElement(element, "sphere", radius=repr(size[0]))
    else:
        ElementTree.SubElement(element, "mesh", filename=f"package://{stl.name}")


def _write_hull(mesh: rp.Mesh, file: Path) -> None:
    """Write the hull twice: one peer expects it next to the mesh under another name."""
    hull = trimesh.Trimesh(mesh.vertices, mesh.faces).convex_hull
    for name in (file.name, f"{file.name}.convex.stl"):
        hull.export(file.with_name(name))


def _srdf(robot: Robot, unchecked: Sequence[Sequence[str]]) -> ElementTree.Element:
    top = ElementTree.Element("robot", name=robot.name)
    group = ElementTree.SubElement(top, "group", name="arm")
    tip = robot.joint(robot.joint_names[-1]).child
    ElementTree.SubElement(group, "chain", base_link=robot.base, tip_link=tip)
    for a, b in unchecked:
        ElementTree.SubElement(top, "disable_collisions", link1=a, link2=b, reason="Never")
    return top


def _text(values: Any) -> str:
    return " ".join(repr(float(v)) for v in values)
