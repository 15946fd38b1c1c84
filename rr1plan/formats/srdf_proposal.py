"""Pairs of links that need no collision check, found by sampling, for robots without an SRDF.

The idea of MoveIt's setup assistant: links joined by a joint may always touch; two links that touch
in every sample say nothing about a motion; two that touch in none probably never can. Only the
first two kinds are left out when a robot without an SRDF is loaded, the third is for the user to
judge. Shapes are compared by Coal directly.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any, Literal

import coal
import numpy as np

from rr1plan.checks import Array, Seed, as_generator
from rr1plan.errors import InputError
from rr1plan.robot import Joint, Robot
from rr1plan.shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere

Pair = frozenset[str]
Reason = Literal["Adjacent", "Always", "Never"]


def rigid_pairs(joints: Sequence[Joint]) -> frozenset[Pair]:
    """Pairs of links whose relative pose never changes: a check could tell nothing new."""
    body: dict[str, list[str]] = {}
    for joint in joints:
        members = body.setdefault(joint.parent, [joint.parent])
        if joint.kind == "fixed":
            members.append(joint.child)
            body[joint.child] = members
        else:
            body[joint.child] = [joint.child]
    return frozenset(frozenset(pair) for members in body.values() for pair in combinations(members, 2))


def adjacent_pairs(joints: Sequence[Joint]) -> frozenset[Pair]:
    """Pairs of links that a movable joint joins, rigid neighbours of both included."""
    bodies: dict[str, set[str]] = {}
    for joint in joints:
        members = bodies.setdefault(joint.parent, {joint.parent})
        if joint.kind == "fixed":
            members.add(joint.child)
            bodies[joint.child] = members
        else:
            bodies[joint.child] = {joint.child}
    moving = [joint for joint in joints if joint.kind != "fixed"]
    return frozenset(frozenset((a, b)) for j in moving for a in bodies[j.parent] for b in bodies[j.child])


def propose_never_collide(robot: Robot, samples: int = 1000, rng: Seed = None) -> Mapping[Pair, Reason]:
    """Pairs of links that need no check, each with the reason.

    Args:
        robot: The robot; its `never_collide` is not looked at.
        samples: How many random configurations decide, grippers opened and closed at random too.
        rng: Generator or seed.

    Returns:
        "Adjacent" for links that a joint joins, "Always" for links that touch in every sample,
        "Never" for links that touch in none (a guess that grows with the samples).

    Raises:
        InputError: `samples` below 1.
    """
    if samples < 1:
        raise InputError(f"samples is {samples}, expected at least 1")
    generator = as_generator(rng)
    found: dict[Pair, Reason] = dict.fromkeys(adjacent_pairs(robot.joints) | rigid_pairs(robot.joints), "Adjacent")
    bodies = LinkBodies(robot)
    seen: dict[Pair, set[bool]] = {pair: set() for pair in bodies.pairs if pair not in found}
    for _ in range(samples):
        open_pairs = [pair for pair, outcomes in seen.items() if len(outcomes) < 2]
        touching = bodies.touching(_sample(robot, generator), open_pairs)
        for pair in open_pairs:
            seen[pair].add(pair in touching)
    found.update({pair: "Always" if True in seen[pair] else "Never" for pair in seen if len(seen[pair]) == 1})
    return found


def jammed_pairs(robot: Robot, samples: int, rng: Seed = None) -> frozenset[Pair]:
    """Pairs of links that may not touch, but do at home and in each of some random configurations.

    Args:
        robot: The robot.
        samples: How many random configurations decide.
        rng: Generator or seed.
    """
    generator = as_generator(rng)
    bodies = LinkBodies(robot)
    jammed = touching_links(robot, robot.home, bodies)
    for _ in range(samples):
        if not jammed:
            break
        jammed &= bodies.touching(_sample(robot, generator), list(jammed))
    return frozenset(jammed)


def free_configuration(robot: Robot, wish: Array, samples: int = 300, rng: Seed = None) -> Array:
    """A configuration without self-collision near a wished one; the wish itself where it is free.

    Args:
        robot: The robot.
        wish: Configuration [rad], shape (nq,).
        samples: How many random configurations to try.
        rng: Generator or seed.

    Returns:
        The free one nearest to the wish; the wish where none was found.
    """
    generator = as_generator(rng)
    bodies = LinkBodies(robot)
    pairs = [pair for pair in bodies.pairs if pair not in robot.never_collide]
    values = robot.joint_values(wish)
    if not bodies.touching(values, pairs):
        return wish
    candidates = sorted(
        (_random(robot, generator) for _ in range(samples)), key=lambda q: float(np.abs(q - wish).sum())
    )
    return next((q for q in candidates if not bodies.touching(robot.joint_values(q), pairs)), wish)


def touching_links(robot: Robot, q: Array, bodies: LinkBodies | None = None) -> set[Pair]:
    """The pairs of links that touch at q (nq,), those that may left out; `bodies` where they are at hand."""
    bodies = bodies or LinkBodies(robot)
    return bodies.touching(robot.joint_values(q), [pair for pair in bodies.pairs if pair not in robot.never_collide])


class LinkBodies:
    """The collision shapes of a robot's links as Coal objects."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._shapes = {
            link.name: [(coal_shape(g.shape), np.array(g.pose)) for g in link.collisions]
            for link in robot.links
            if link.collisions
        }
        self.pairs = [frozenset(pair) for pair in combinations(self._shapes, 2)]

    def touching(self, values: Mapping[str, float], pairs: Sequence[Pair]) -> set[Pair]:
        """Those of the pairs that touch at the given joint values."""
        poses = _poses(self._robot, values)
        placed = {
            name: [(shape, _transform(poses[name] @ pose)) for shape, pose in shapes]
            for name, shapes in self._shapes.items()
        }
        return {pair for pair in pairs if _touch(*(placed[name] for name in pair))}


def _touch(one: list[tuple[Any, Any]], other: list[tuple[Any, Any]]) -> bool:
    request = coal.CollisionRequest()
    return any(coal.collide(a, at, b, bt, request, coal.CollisionResult()) > 0 for a, at in one for b, bt in other)


def _poses(robot: Robot, values: Mapping[str, float]) -> dict[str, Array]:
    """T_base_link of every link at the values of all movable joints."""
    poses = {robot.base: np.eye(4)}
    for joint in robot.joints:
        poses[joint.child] = poses[joint.parent] @ joint.origin @ joint.motion(values.get(joint.name, 0.0))
    return poses


def _sample(robot: Robot, generator: np.random.Generator) -> dict[str, float]:
    """Random values of all joints, held ones included."""
    held = {name: _between(robot.joint(name).lower, robot.joint(name).upper, generator) for name in robot.held}
    return replace(robot, held=held).joint_values(_random(robot, generator))


def _random(robot: Robot, generator: np.random.Generator) -> Array:
    bounds = zip(robot.limits.lower, robot.limits.upper, strict=True)
    return np.array([_between(lower, upper, generator) for lower, upper in bounds])


def _between(lower: float, upper: float, generator: np.random.Generator) -> float:
    """A value between limits; a full turn where there are none."""
    if np.isfinite(upper - lower):
        return float(generator.uniform(lower, upper))
    return float(generator.uniform(-np.pi, np.pi))


def _transform(T: Array) -> Any:
    return coal.Transform3s(T[:3, :3], T[:3, 3])


def coal_shape(shape: Shape) -> Any:
    """A link's shape as a Coal geometry; of a mesh, which has to be convex, a convex one.

    Raises:
        InputError: a half-space or a point cloud.
    """
    if isinstance(shape, Box):
        return coal.Box(*shape.size)
    if isinstance(shape, Sphere):
        return coal.Sphere(shape.radius)
    if isinstance(shape, Cylinder):
        return coal.Cylinder(shape.radius, shape.length)
    if isinstance(shape, Capsule):
        return coal.Capsule(shape.radius, shape.length)
    if not isinstance(shape, Mesh):
        raise InputError(f"a link has a {type(shape).__name__} to collide with, expected a solid shape")
    vertices, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    vertices.extend(list(np.array(shape.vertices)))
    triangles.extend([coal.Triangle(int(a), int(b), int(c)) for a, b, c in shape.faces])
    return coal.Convex(vertices, triangles)
