"""Checks of configurations and edges by Coal alone, without the package's compiled kernels.

`PlainCoal` places every shape by the NumPy kinematics of `Robot` and queries Coal for each pair whose bounding balls
overlap; if a result depends on the last micrometer, it brackets the distance between points in both bodies and a
separating plane. Coal checks the triangles of a concave mesh, and rays decide whether a point is inside. `CoalProof`
proves edges free: if joint i turns by d_i, the distance of two bodies changes by at most the sum over the joints of
their arms of d_i times the largest distance of any point from the axis of i, so bodies whose distance by Coal is
greater stay separated on the interval (Schwarzer, Saha, Latombe 2005).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import coal
import numpy as np
from clutter import box_of
from numpy.typing import NDArray
from scipy.optimize import minimize, nnls
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

import rr1plan as rp
from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.collision.convex.convex_bodies import (
    coal_geometry,
    is_concave,
    obstacle_pieces,
    occupied_cells,
    solid_pieces,
)
from rr1plan.testing.scene_bodies import link_frames
from rr1plan.transforms import inverse

# Coal may overstate a distance of round bodies by this much [m].
COAL_ERROR = 2e-5
# Intervals with displacements below this are not halved [m].
FINEST = 5e-6
_WIDEST = 0.4
_MOST = 400_000
_CHUNK = 20_000
# A ray that passes an edge of a triangle within this fraction of the triangle's size is inconclusive.
_BESIDE_EDGE = 1e-9


# ---- configurations ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Bracket:
    """Bounds of the least distance of any pair minus its padding [m].

    A negative `lower` bounds the penetration depth of all pairs.
    """

    lower: float
    upper: float
    pair: tuple[str, str]


@dataclass(frozen=True, eq=False)
class Part:
    """A convex shape or a surface, with a pose in the frame of a link or the world."""

    element: str
    frame: str
    place: Array
    shape: Any

    def ball(self) -> tuple[Array, float]:
        """Center, in its own frame, and radius of a bounding ball [m]."""
        vertices = getattr(self.shape, "vertices", None)
        if vertices is None:
            return np.zeros(3), _extent(np.eye(4), self.shape)
        center = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
        return center, float(np.linalg.norm(vertices - center, axis=1).max())


class PlainCoal:
    """A scene's shapes in Coal, with poses computed by NumPy.

    Args:
        scene: The scene.
        arms: The moving arms (default: all); the others keep their configurations in the scene.
        margin: Distance to keep in addition to the padding between elements in relative motion [m].

    Attributes:
        parts: All convex shapes and surfaces.
        index: Pairs of them that must not touch, shape (m, 2).
        padding: Distance to keep between each pair, including the margin [m], shape (m,).
        moves: Whether each pair is in relative motion, shape (m,).
    """

    def __init__(self, scene: rp.Scene, arms: Sequence[str] | None = None, margin: float = 0.0) -> None:
        self._scene, self._arms = scene, scene.arm_names(arms)
        self.parts = [part for name in scene.element_names for part in self._pieces(name)]
        self._frames = list(dict.fromkeys(part.frame for part in self.parts))
        self._frame_of = np.array([self._frames.index(part.frame) for part in self.parts])
        self._places = np.array([part.place for part in self.parts])
        balls = [part.ball() for part in self.parts]
        self._centers, self._radii = np.array([c for c, _ in balls]), np.array([r for _, r in balls])
        numbers: dict[str, list[int]] = {}
        for i, part in enumerate(self.parts):
            numbers.setdefault(part.element, []).append(i)
        pairs = [(i, j, scene.padding_of(a, b)) for a, b in scene.checked_pairs for i in numbers[a] for j in numbers[b]]
        self.index = np.array([(i, j) for i, j, _ in pairs], np.int64).reshape(-1, 2)
        self.moves = self._moves()
        self.padding = np.array([padding for *_, padding in pairs]) + margin * self.moves

    def is_free(self, q: Array) -> bool:
        """Whether no pair is closer than its padding."""
        placed = self.placed(q[None])[0]
        gaps = self.ball_gaps(self.ball_centers(placed)[self.index])
        return not any(self.touches(k, placed) for k in np.argsort(gaps)[: np.count_nonzero(gaps <= 0.0)])

    def bracket(self, q: Array) -> Bracket:
        """Proven bounds of the least distance minus padding."""
        placed, found = self.placed(q[None])[0], Bracket(np.inf, np.inf, ("", ""))
        gaps = self.ball_gaps(self.ball_centers(placed)[self.index])
        for k in np.argsort(gaps):
            if gaps[k] > found.upper:
                break
            i, j = self.index[k]
            one, two = self.parts[i], self.parts[j]
            lower, upper = (b - self.padding[k] for b in bounds_of(one.shape, placed[i], two.shape, placed[j]))
            pair = (one.element, two.element) if upper < found.upper else found.pair
            found = Bracket(min(lower, found.lower), min(upper, found.upper), pair)
        return found

    def _pieces(self, name: str) -> list[Part]:
        scene = self._scene
        if name in scene.obstacles:
            thing = scene.obstacles[name]
            shapes = [(thing.pose @ g.pose, one) for g in thing.geometries for one in obstacle_pieces(g.shape)]
            frame = ""
        elif name in scene.attachments:
            held = scene.attachments[name]
            frame = f"{held.arm}/{held.link}"
            shapes = [(held.pose @ g.pose, one) for g in held.geometries for one in solid_pieces(g.shape)]
        else:
            arm, link = name.split("/", 1)
            links = scene.arms[arm].robot.link(link).collisions
            frame, shapes = name, [(g.pose, one) for g in links for one in solid_pieces(g.shape)]
        plain = [(place @ move, one) for place, shape in shapes for move, one in _plain(shape)]
        return [Part(name, frame, place, one) for place, one in plain]

    def placed(self, q: Array) -> Array:
        """The pose of every part at configurations (n, nq), shape (n, parts, 4, 4)."""
        scene, first, poses = self._scene, 0, {"": np.broadcast_to(np.eye(4), (len(q), 4, 4))}
        for name, arm in scene.arms.items():
            own = np.broadcast_to(arm.q, (len(q), arm.robot.nq))
            if name in self._arms:
                own, first = q[:, first : first + arm.robot.nq], first + arm.robot.nq
            poses |= {f"{name}/{link}": arm.base @ T for link, T in link_frames(arm.robot, own).items()}
        return np.asarray(np.stack([poses[name] for name in self._frames], axis=1)[:, self._frame_of] @ self._places)

    def _moves(self) -> NDArray[np.bool_]:
        """Pairs in relative motion, whose relative pose differs between two random configurations."""
        low, high = box_of(self._scene.limits(self._arms))
        draws = np.random.default_rng(0).uniform(low, high, (2, len(low)))
        i, j = self.index.T
        one, two = (np.linalg.inv(placed[i]) @ placed[j] for placed in self.placed(draws))
        return np.asarray(np.abs(one - two).max(axis=(1, 2), initial=0.0) > 1e-9)

    def ball_centers(self, placed: Array) -> Array:
        """Centers of the bounding balls of parts at poses (..., parts, 4, 4) [m], shape (..., parts, 3)."""
        return np.asarray((placed[..., :3, :3] @ self._centers[:, :, None])[..., 0] + placed[..., :3, 3])

    def ball_gaps(self, centers: Array, pairs: NDArray[np.int64] | slice = slice(None)) -> Array:
        """Distance of the bounding balls of some pairs minus their padding [m], negative if they overlap.

        Args:
            centers: Centers of both balls of each pair, shape (n, 2, 3).
            pairs: The pairs, shape (n,).
        """
        distances = np.linalg.norm(centers[:, 0] - centers[:, 1], axis=1)
        return np.asarray(distances - self._radii[self.index[pairs]].sum(axis=1) - self.padding[pairs])

    def touches(self, k: int, placed: Array, beyond: float = 0.0) -> bool:
        """Whether a pair is closer than its padding plus a limit [m]; the parts are at `placed` (parts, 4, 4)."""
        (i, j), padding = self.index[k], float(self.padding[k]) + beyond
        one, two, A, B = self.parts[i].shape, self.parts[j].shape, placed[i], placed[j]
        if isinstance(one, Surface):
            one, two, A, B = two, one, B, A
        if isinstance(two, Surface):
            # Coal's collision test of triangles misses shallow contacts; its distance does not.
            gap = _coal_distance(one, A, two, B).min_distance
            return bool(gap <= padding) or two.holds(_point_of(one, inverse(B) @ A))
        request = coal.CollisionRequest(coal.CollisionRequestFlag.CONTACT, 1)
        request.security_margin = padding
        things = _in_coal(one), _transform(A), _in_coal(two), _transform(B)
        return bool(coal.collide(*things, request, coal.CollisionResult()))


# ---- shapes ----------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Triangle:
    """A triangle; its corners [m], shape (3, 3)."""

    vertices: Array


class Surface:
    """A concave mesh of an obstacle: its triangles, and the inside of its closed parts.

    Args:
        mesh: The mesh.
    """

    def __init__(self, mesh: rp.Mesh) -> None:
        self.vertices = mesh.vertices
        self.corners = mesh.vertices[mesh.faces]
        self._closed = [self.corners[part] for part in _closed_parts(mesh)]
        self._directions = np.random.default_rng(0).normal(size=(50, 3))
        self.coal = coal.BVHModelOBBRSS()
        points, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
        points.extend(list(self.corners.reshape(-1, 3)))
        faces.extend([coal.Triangle(3 * i, 3 * i + 1, 3 * i + 2) for i in range(len(self.corners))])
        self.coal.beginModel(len(faces), len(points))
        self.coal.addSubModel(points, faces)
        self.coal.endModel()

    def holds(self, point: Array) -> bool:
        """Whether a point in the mesh's frame is inside a closed part: a ray crosses it an odd number of times."""
        return any(self._crossings(part, point) % 2 for part in self._closed)

    def _crossings(self, corners: Array, point: Array) -> int:
        a, b, c = (corners[:, k] - point for k in range(3))
        for direction in self._directions:
            # The volumes spanned by the ray and the edges have the same sign if it passes through the triangle.
            volumes = np.array([np.cross(x, y) @ direction for x, y in ((a, b), (b, c), (c, a))])
            scale = np.linalg.norm(volumes, axis=0)
            within = (volumes > 0.0).all(axis=0) | (volumes < 0.0).all(axis=0)
            beside = np.abs(volumes).min(axis=0) <= _BESIDE_EDGE * scale
            ahead = np.einsum("ij,ij->i", a, np.cross(b - a, c - a)) * volumes.sum(axis=0) > 0.0
            if not (beside & ahead).any():
                return int(np.count_nonzero(within & ahead))
        raise RuntimeError("every ray passes an edge")


def _closed_parts(mesh: rp.Mesh) -> list[NDArray[np.int64]]:
    """The triangles of each connected part whose every edge has two triangles."""
    edges = np.sort(np.stack([mesh.faces, np.roll(mesh.faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    _, edge, sharing = np.unique(edges, axis=0, return_inverse=True, return_counts=True)
    owner, edge = np.repeat(np.arange(len(mesh.faces)), 3), edge.ravel()
    beside = coo_matrix((np.ones(len(owner)), (owner, edge))).tocsr()
    count, part = connected_components(beside @ beside.T, directed=False)
    is_open = np.bincount(part[owner], weights=sharing[edge] != 2, minlength=count) > 0
    return [np.flatnonzero(part == k) for k in np.flatnonzero(~is_open)]


_surface = lru_cache(maxsize=64)(Surface)


def _plain(shape: Any) -> list[tuple[Array, Any]]:
    """A shape as convex shapes or a surface, each with its pose."""
    if not isinstance(shape, rp.PointCloud):
        return [(np.eye(4), _surface(shape) if is_concave(shape) else shape)]
    cell, poses = rp.Box((shape.resolution,) * 3), np.tile(np.eye(4), (len(centers := occupied_cells(shape)), 1, 1))
    poses[:, :3, 3] = centers
    return [(pose, cell) for pose in poses]


def _in_coal(shape: Any) -> Any:
    if isinstance(shape, Surface):
        return shape.coal
    return _flat(shape) if isinstance(shape, Triangle) else coal_geometry(shape)


def _flat(triangle: Triangle) -> Any:
    """A triangle as a convex body without volume: Coal cannot measure `TriangleP` against capsules."""
    corners, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    corners.extend(list(triangle.vertices))
    faces.extend([coal.Triangle(0, 1, 2), coal.Triangle(0, 2, 1)])
    return coal.Convex(corners, faces)


def _coal_distance(one: Any, A: Array, two: Any, B: Array) -> Any:
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.gjk_tolerance, request.enable_signed_distance = 1e-10, True
    coal.distance(_in_coal(one), _transform(A), _in_coal(two), _transform(B), request, result)
    return result


def _point_of(shape: Any, T: Array) -> Array:
    """A point of a convex shape at T."""
    own = shape.vertices[0] if isinstance(shape, rp.Mesh) else np.zeros(3)
    return np.asarray(T[:3, :3] @ own + T[:3, 3])


def _transform(T: Array) -> coal.Transform3s:
    return coal.Transform3s(T[:3, :3], T[:3, 3])


def bounds_of(one: Any, A: Array, two: Any, B: Array) -> tuple[float, float]:
    """Bounds of the distance of two convex shapes [m], proven by a plane (lower) and by two points (upper)."""
    if isinstance(one, rp.HalfSpace):
        one, A, two, B = two, B, one, A
    if isinstance(two, rp.HalfSpace):
        normal = B[:3, :3] @ np.array(two.normal)
        gap = normal @ (A[:3, 3] - B[:3, 3]) - two.offset - support(one, -A[:3, :3].T @ normal)
        return float(gap), float(gap)
    if isinstance(one, Surface):
        one, A, two, B = two, B, one, A
    if isinstance(two, Surface):
        return _bounds_of_surface(one, A, two, B)
    result = _coal_distance(one, A, two, B)
    distance = result.min_distance
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


def _bounds_of_surface(one: Any, A: Array, surface: Surface, B: Array) -> tuple[float, float]:
    """Likewise for a convex shape and a surface: bounds over its triangles, nearest balls first."""
    if surface.holds(_point_of(one, inverse(B) @ A)):
        return -np.inf, 0.0
    centers = surface.corners.mean(axis=1)
    radii = np.linalg.norm(surface.corners - centers[:, None], axis=2).max(axis=1)
    gaps = np.linalg.norm(centers @ B[:3, :3].T + B[:3, 3] - A[:3, 3], axis=1) - radii - _extent(np.eye(4), one)
    lower = upper = np.inf
    for k in np.argsort(gaps):
        if gaps[k] > upper:
            break
        bounds = bounds_of(one, A, Triangle(surface.corners[k]), B)
        lower, upper = min(lower, bounds[0]), min(upper, bounds[1])
    return lower, upper


def support(shape: Any, d: Array) -> float:
    """Largest d . p over the points p of a convex shape."""
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
    """An upper bound of the distance of a point from a convex shape at T [m], 0 inside."""
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
    # Weights of the corners for a near point; nonnegative weights that sum to one give a point of the hull.
    corners = shape.vertices
    weights, _ = nnls(np.vstack([corners.T, np.full(len(corners), 1e3)]), np.array([*p, 1e3]))
    return float(np.linalg.norm(weights @ corners / weights.sum() - p))


# ---- edges ---------------------------------------------------------------------------------------


class CoalProof:
    """Edges proven free by Coal's distances at the middles of intervals, halved until these suffice, pair by pair.

    Args:
        checker: The collision checker with the scene, moving arms and margin.
    """

    def __init__(self, checker: CollisionChecker) -> None:
        scene, self._arms = checker.scene, checker.arms
        self._plain = PlainCoal(scene, checker.arms, checker.margin)
        self._swings = swings(scene, checker.arms)
        self._column_arm = np.array([name.split("/", 1)[0] for name in checker.joint_names])
        arm_of = np.array([scene.owner(part.element) or "" for part in self._plain.parts])
        self._pair_arms = arm_of[self._plain.index]
        self.asked = 0

    def judge(self, q0: Array, q1: Array) -> tuple[str, float]:
        """Coal's verdict on a straight edge, and the position of the finding.

        Returns:
            "free", "contact", "narrow" (no sample touches, but some distance is below `COAL_ERROR`), or
            "undecided" (no sample has touched so far); and the position on the edge (0..1).
        """
        plain, travel, asked = self._plain, self._travel(q1 - q0), 0
        found, half = ("free", 0.0), 0.5
        pairs, middles = np.arange(len(plain.index)), np.full(len(plain.index), 0.5)
        # Intervals of one length after the other, each with its open pairs.
        while len(pairs):
            times, which = np.unique(middles, return_inverse=True)
            placed = plain.placed(q0 + times[:, None] * (q1 - q0))
            centers = plain.ball_centers(placed)
            moved = travel[pairs] * half
            open_ = []
            for chunk in np.array_split(np.arange(len(pairs)), 1 + len(pairs) // _CHUNK):
                both = centers[which[chunk, None], plain.index[pairs[chunk]]]
                near = plain.ball_gaps(both, pairs[chunk]) <= moved[chunk] + COAL_ERROR
                open_ += chunk[near].tolist()
            left = []
            for n in open_:
                k, poses = int(pairs[n]), placed[which[n]]
                if moved[n] > _WIDEST:
                    left.append(n)
                    continue
                asked += 1
                if not plain.touches(k, poses, moved[n] + COAL_ERROR if plain.moves[k] else 0.0):
                    continue
                if plain.touches(k, poses):
                    return "contact", float(middles[n])
                if moved[n] < FINEST:
                    found = "narrow", float(middles[n])
                else:
                    left.append(n)
            if asked > _MOST:
                return "undecided", 0.5
            half *= 0.5
            pairs = np.repeat(pairs[left], 2)
            middles = np.add.outer(middles[left], [-half, half]).ravel()
        self.asked += asked
        return found

    def _travel(self, step: Array) -> Array:
        """Largest displacement on an edge, summed over both parts of each pair [m], shape (m,)."""
        far = np.abs(step) * self._swings
        total = {arm: float(far[self._column_arm == arm].sum()) for arm in self._arms}
        one, two = (np.array([total.get(arm, 0.0) for arm in arms]) for arms in self._pair_arms.T)
        same = self._pair_arms[:, 0] == self._pair_arms[:, 1]
        return np.asarray(np.where(same, one, one + two))


def swings(scene: rp.Scene, arms: Sequence[str] | None = None) -> Array:
    """Largest distance of any point from the axis of the joints of each column of q [m], 1 for prismatic joints."""
    return np.concatenate([_arm_swings(scene, name) for name in scene.arm_names(arms)])


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
    """Largest displacement of a prismatic joint from zero [m]."""
    if joint.kind != "prismatic":
        return 0.0
    if joint.mimic is not None:
        return abs(joint.mimic.multiplier) * _stretch(robot, robot.joint(joint.mimic.joint)) + abs(joint.mimic.offset)
    if joint.name in robot.joint_names:
        i = robot.joint_names.index(joint.name)
        return float(max(abs(robot.limits.lower[i]), abs(robot.limits.upper[i])))
    return abs(float(robot.joint_values(robot.home).get(joint.name, 0.0)))


def _extent(T: Array, shape: Any) -> float:
    """Largest distance of a shape at T from the origin [m]."""
    match shape:
        case rp.Box(size):
            far = float(np.linalg.norm(size)) / 2
        case rp.Sphere(radius):
            far = radius
        case rp.Cylinder(radius, length):
            far = float(np.hypot(radius, length / 2))
        case rp.Capsule(radius, length):
            far = radius + length / 2
        case rp.HalfSpace():
            return float(np.inf)
        case _:
            return float(np.linalg.norm(shape.vertices @ T[:3, :3].T + T[:3, 3], axis=1).max())
    return float(np.linalg.norm(T[:3, 3])) + far
