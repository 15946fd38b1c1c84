"""Contacts between links of a robot at given joint values, by Coal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import coal
import numpy as np

from rr1plan.checks import Array
from rr1plan.errors import InputError
from rr1plan.robot import Robot
from rr1plan.robot.robot import poses_at
from rr1plan.shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere

Pair = frozenset[str]
_Placed = tuple[coal.CollisionGeometry, coal.Transform3s]
# Bounding balls with a larger gap do not touch; far above rounding errors [m].
_SLACK = 1e-9


class LinkBodies:
    """The collision shapes of a robot's links as Coal objects."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._shapes = {
            link.name: [(coal_solid(g.shape), np.array(g.pose)) for g in link.collisions]
            for link in robot.links
            if link.collisions
        }
        self._balls = {name: _ball(shapes) for name, shapes in self._shapes.items()}
        self.pairs = [frozenset(pair) for pair in combinations(self._shapes, 2)]
        # Every link with its ancestors.
        self._above = {robot.base: frozenset({robot.base})}
        for joint in robot.joints:
            self._above[joint.child] = self._above[joint.parent] | {joint.child}

    def touching(self, values: Mapping[str, float], pairs: Sequence[Pair]) -> set[Pair]:
        """The pairs in contact at the given joint values."""
        named = frozenset[str]().union(*pairs)
        poses = poses_at(self._robot, values, frozenset[str]().union(*(self._above[name] for name in named)))
        near = self._near(poses, pairs)
        names = frozenset[str]().union(*near)
        placed = {
            name: [(shape, _transform(poses[name] @ pose)) for shape, pose in self._shapes[name]] for name in names
        }
        return {pair for pair in near if _touch(*(placed[name] for name in pair))}

    def _near(self, poses: Mapping[str, Array], pairs: Sequence[Pair]) -> list[Pair]:
        """The pairs whose bounding spheres intersect."""
        if len(pairs) < 2:
            return list(pairs)
        place = {name: i for i, name in enumerate(name for name in self._balls if name in poses)}
        centers = np.array([poses[name][:3, :3] @ self._balls[name][0] + poses[name][:3, 3] for name in place])
        radii = np.array([self._balls[name][1] for name in place])
        one, other = np.array([[place[name] for name in pair] for pair in pairs]).T
        gaps = np.linalg.norm(centers[one] - centers[other], axis=1) - radii[one] - radii[other]
        return [pairs[i] for i in np.flatnonzero(gaps <= _SLACK).tolist()]


def _ball(shapes: list[tuple[coal.CollisionGeometry, Array]]) -> tuple[Array, float]:
    """Bounding sphere of a link's shapes: center in the link's frame (3,) and radius [m]."""
    for shape, _ in shapes:
        shape.computeLocalAABB()
    centers = np.array([pose[:3, :3] @ shape.aabb_center + pose[:3, 3] for shape, pose in shapes])
    return ball_around(centers, np.array([shape.aabb_radius for shape, _ in shapes]))


def ball_around(centers: Array, radii: Array) -> tuple[Array, float]:
    """Center (3,) and radius of a ball around other balls, with centers (n, 3) and radii (n,) [m]."""
    center = 0.5 * ((centers - radii[:, None]).min(axis=0) + (centers + radii[:, None]).max(axis=0))
    return center, float((np.linalg.norm(centers - center, axis=1) + radii).max())


def _touch(one: list[_Placed], other: list[_Placed]) -> bool:
    request = coal.CollisionRequest()
    return any(coal.collide(a, at, b, bt, request, coal.CollisionResult()) > 0 for a, at in one for b, bt in other)


def _transform(T: Array) -> coal.Transform3s:
    return coal.Transform3s(T[:3, :3], T[:3, 3])


def coal_solid(shape: Shape) -> coal.CollisionGeometry:
    """A box, sphere, cylinder, capsule or convex mesh as a Coal geometry.

    Raises:
        InputError: another shape.
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
