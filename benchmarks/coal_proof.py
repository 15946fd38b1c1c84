"""Checks of configurations and edges by Coal alone, without the package's compiled kernels.

`PlainCoal` places every shape by the robot's own numpy kinematics and asks Coal for each pair; where an answer
depends on the last micrometer, it brackets the distance between points that are in both bodies and a plane between
them. `CoalProof` proves edges free: when joint i turns by d_i, no distance of two bodies changes by more than the sum
of d_i times how far anything is from the axis of i, so bodies that Coal finds farther apart than that stay apart on the
interval (Schwarzer, Saha, Latombe 2005).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import coal
import numpy as np
from scipy.optimize import minimize, nnls

import rr1plan as rp
from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.collision.coal_pairs import CoalPairs
from rr1plan.collision.solids import coal_geometry, is_concave, obstacle_pieces, occupied_cells
from rr1plan.transforms import inverse

# Coal may overstate a distance of round bodies by this much [m].
COAL_ERROR = 2e-5
# Intervals on which nothing moves farther than this are not halved [m].
FINEST = 5e-6
_WIDEST = 0.2
_MOST = 400_000


# ---- configurations ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Bracket:
    """The least distance of any pair beyond its padding lies between `lower` and `upper` [m].

    Below zero `lower` says that no pair is deeper in each other than that.
    """

    lower: float
    upper: float
    pair: tuple[str, str]


class PlainCoal:
    """A scene's shapes in Coal, placed by numpy."""

    def __init__(self, scene: rp.Scene) -> None:
        self._scene = scene
        self._parts = {name: self._pieces(name) for name in scene.element_names}
        self._pairs = [(a, b, scene.padding_of(a, b)) for a, b in scene.checked_pairs]

    def _pieces(self, name: str) -> list[tuple[str, Array, Any]]:
        scene = self._scene
        if name in scene.attachments:
            held = scene.attachments[name]
            frame, geometries, place = f"{held.arm}/{held.link}", held.geometries, held.pose
        elif name in scene.obstacles:
            frame, geometries, place = "", scene.obstacles[name].geometries, scene.obstacles[name].pose
        else:
            arm, link = name.split("/", 1)
            frame, geometries, place = name, scene.arms[arm].robot.link(link).collisions, np.eye(4)
        return [(frame, place @ g.pose @ move, shape) for g in geometries for move, shape in _convex(g.shape)]

    def _placed(self, q: Array) -> dict[str, list[tuple[Array, Any]]]:
        frames = {"": np.eye(4), **self._scene.link_poses(self._scene.split(q))}
        return {name: [(frames[f] @ T, shape) for f, T, shape in parts] for name, parts in self._parts.items()}

    def is_free(self, q: Array) -> bool:
        """No pair is nearer than its padding."""
        placed, request = self._placed(q), coal.CollisionRequest(coal.CollisionRequestFlag.CONTACT, 1)
        for a, b, padding in self._pairs:
            request.security_margin = padding
            for A, one in placed[a]:
                for B, two in placed[b]:
                    things = coal_geometry(one), _transform(A), coal_geometry(two), _transform(B)
                    if coal.collide(*things, request, coal.CollisionResult()):
                        return False
        return True

    def bracket(self, q: Array) -> Bracket:
        """Proven bounds of the least distance beyond the padding."""
        placed, found = self._placed(q), Bracket(np.inf, np.inf, ("", ""))
        for a, b, padding in self._pairs:
            for A, one in placed[a]:
                for B, two in placed[b]:
                    lower, upper = (bound - padding for bound in bounds_of(one, A, two, B))
                    pair = (a, b) if upper < found.upper else found.pair
                    found = Bracket(min(lower, found.lower), min(upper, found.upper), pair)
        return found


def _convex(shape: Any) -> list[tuple[Array, Any]]:
    """A shape as convex ones, each with its pose.

    Raises:
        ValueError: a concave mesh; Coal's distances to triangles are not bracketed here.
    """
    if not isinstance(shape, rp.PointCloud):
        pieces = obstacle_pieces(shape)
        if any(is_concave(piece) for piece in pieces):
            raise ValueError("a mesh that is not convex has no convex parts that are the same solid")
        return [(np.eye(4), piece) for piece in pieces]
    cell, poses = rp.Box((shape.resolution,) * 3), np.tile(np.eye(4), (len(centers := occupied_cells(shape)), 1, 1))
    poses[:, :3, 3] = centers
    return [(pose, cell) for pose in poses]


def _transform(T: Array) -> coal.Transform3s:
    return coal.Transform3s(T[:3, :3], T[:3, 3])


def bounds_of(one: Any, A: Array, two: Any, B: Array) -> tuple[float, float]:
    """A lower and an upper bound of the distance of two convex shapes [m], proven by a plane and by two points."""
    if isinstance(one, rp.HalfSpace):
        one, A, two, B = two, B, one, A
    if isinstance(two, rp.HalfSpace):
        normal = B[:3, :3] @ np.array(two.normal)
        gap = normal @ (A[:3, 3] - B[:3, 3]) - two.offset - support(one, -A[:3, :3].T @ normal)
        return float(gap), float(gap)
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.gjk_tolerance, request.enable_signed_distance = 1e-10, True
    distance = coal.distance(coal_geometry(one), _transform(A), coal_geometry(two), _transform(B), request, result)
    ends = np.array(result.getNearestPoint1()), np.array(result.getNearestPoint2())
    upper = min(
        float(np.linalg.norm(a - b) + outside(one, A, a) + outside(two, B, b))
        for a, b in (ends, (ends[0],) * 2, (ends[1],) * 2, (0.5 * (ends[0] + ends[1]),) * 2)
    )

    def overlap(direction: Array) -> float:
        n = direction / max(float(np.linalg.norm(direction)), 1e-300)
        along = support(one, A[:3, :3].T @ n) + support(two, -B[:3, :3].T @ n)
        return float(along - n @ (B[:3, 3] - A[:3, 3]))

    best = min((np.array(result.normal), ends[1] - ends[0], ends[0] - ends[1], B[:3, 3] - A[:3, 3]), key=overlap)
    if abs(distance) < 1e-3:
        best = minimize(overlap, best / np.linalg.norm(best), method="Nelder-Mead", options={"xatol": 1e-12}).x
    return -overlap(best), upper


def support(shape: Any, d: Array) -> float:
    """The greatest d . p over the points p of a convex shape."""
    match shape:
        case rp.Box(size):
            return float(np.abs(d) @ np.array(size)) / 2
        case rp.Sphere(radius):
            return radius * float(np.linalg.norm(d))
        case rp.Cylinder(radius, length):
            return radius * float(np.hypot(d[0], d[1])) + abs(float(d[2])) * length / 2
        case rp.Capsule(radius, length):
            return radius * float(np.linalg.norm(d)) + abs(float(d[2])) * length / 2
        case _:
            return float((shape.vertices @ d).max())


def outside(shape: Any, T: Array, point: Array) -> float:
    """Distance of a point from a convex shape at T [m], 0 inside; never too small."""
    p = (inverse(T) @ [*point, 1.0])[:3]
    match shape:
        case rp.Box(size):
            return float(np.linalg.norm(np.maximum(np.abs(p) - np.array(size) / 2, 0.0)))
        case rp.Sphere(radius):
            return max(0.0, float(np.linalg.norm(p)) - radius)
        case rp.Cylinder(radius, length):
            return float(np.hypot(max(0.0, np.hypot(p[0], p[1]) - radius), max(0.0, abs(p[2]) - length / 2)))
        case rp.Capsule(radius, length):
            return max(0.0, float(np.hypot(np.hypot(p[0], p[1]), max(0.0, abs(p[2]) - length / 2))) - radius)
    # Weights of the corners whose point is near; of those that sum to one, any give a point of the hull.
    corners = shape.vertices
    weights, _ = nnls(np.vstack([corners.T, np.full(len(corners), 1e3)]), np.array([*p, 1e3]))
    return float(np.linalg.norm(weights @ corners / weights.sum() - p))


# ---- edges ---------------------------------------------------------------------------------------


class CoalProof:
    """Edges proven free by Coal's answers at the middles of intervals, halved until these suffice.

    Args:
        checker: The collision checker; only its Coal geometry is used.
    """

    def __init__(self, checker: CollisionChecker) -> None:
        self._checker = checker
        self._swings = swings(checker.scene)
        self._margins = _WIDEST * 0.5 ** np.arange(1 + int(np.ceil(np.log2(_WIDEST / FINEST))))
        self._pairs = [
            CoalPairs(checker.model, checker.solids, checker.solid_pairs, checker.solid_padding + margin + COAL_ERROR)
            for margin in self._margins
        ]
        self.asked = 0

    def judge(self, q0: Array, q1: Array) -> tuple[str, float]:
        """Coal's verdict on a straight edge, and its position.

        "free": proven. "contact": Coal finds one there. "narrow": proven, except where a clearance is
        within Coal's error; there all samples at `FINEST` are free. "undecided": too many samples would be needed.
        """
        travel = float(self._swings @ np.abs(q1 - q0))
        left, narrow, asked = [(0.5, 0.5)], -1.0, 0
        while left:
            middle, half = left.pop()
            moved = travel * half
            if moved <= _WIDEST:
                asked += 1
                q = q0 + middle * (q1 - q0)
                pairs = self._pairs[int(np.searchsorted(-self._margins, -moved, side="right")) - 1]
                pairs.place(q)
                if not pairs.any_touches():
                    continue
                if not self._checker.is_free(q):
                    return "contact", middle
                if moved < FINEST:
                    narrow = middle
                    continue
                if asked > _MOST:
                    return "undecided", middle
            left += [(middle - 0.5 * half, 0.5 * half), (middle + 0.5 * half, 0.5 * half)]
        self.asked += asked
        return ("free", 0.0) if narrow < 0.0 else ("narrow", narrow)


def swings(scene: rp.Scene) -> Array:
    """How far any point can be from the axis of the joints of each column of q [m], 1 for one that slides."""
    return np.concatenate([_arm_swings(scene, name) for name in scene.arms])


def _arm_swings(scene: rp.Scene, name: str) -> Array:
    robot = scene.arms[name].robot
    extent = {link.name: max((_extent(g.pose, g.shape) for g in link.collisions), default=0.0) for link in robot.links}
    for held in scene.attachments.values():
        if held.arm == name:
            far = max(_extent(held.pose @ g.pose, g.shape) for g in held.geometries)
            extent[held.link] = max(extent[held.link], far)
    total = np.zeros(robot.nq)
    for joint in reversed(robot.joints):  # children first
        swing = extent[joint.child]
        stretch = _stretch(robot, joint)
        far = float(np.linalg.norm(joint.origin[:3, 3])) + stretch + swing
        extent[joint.parent] = max(extent[joint.parent], far)
        leader, gain = (joint.name, 1.0) if joint.mimic is None else (joint.mimic.joint, joint.mimic.multiplier)
        if leader in robot.joint_names:
            total[robot.joint_names.index(leader)] += abs(gain) * (1.0 if joint.kind == "prismatic" else swing)
    return total * (1.0 + 1e-9)


def _stretch(robot: rp.Robot, joint: Any) -> float:
    """How far a joint that slides can be from zero [m]."""
    if joint.kind != "prismatic":
        return 0.0
    if joint.mimic is not None:
        return abs(joint.mimic.multiplier) * _stretch(robot, robot.joint(joint.mimic.joint)) + abs(joint.mimic.offset)
    if joint.name in robot.joint_names:
        i = robot.joint_names.index(joint.name)
        return float(max(abs(robot.limits.lower[i]), abs(robot.limits.upper[i])))
    return abs(float(robot.joint_values(robot.home).get(joint.name, 0.0)))


def _extent(T: Array, shape: Any) -> float:
    """How far a shape at T reaches from the origin at most [m]."""
    match shape:
        case rp.Box(size):
            far = float(np.linalg.norm(size)) / 2
        case rp.Sphere(radius):
            far = radius
        case rp.Cylinder(radius, length):
            far = float(np.hypot(radius, length / 2))
        case rp.Capsule(radius, length):
            far = radius + length / 2
        case _:
            return float(np.linalg.norm(shape.vertices @ T[:3, :3].T + T[:3, 3], axis=1).max())
    return float(np.linalg.norm(T[:3, 3])) + far
