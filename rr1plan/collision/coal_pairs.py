"""Pairs of solids in Coal, placed by Pinocchio; results for pairs that do not depend on q."""

from __future__ import annotations

import warnings
from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple, TypeVar

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from rr1plan.checks import Array, Value, read_only
from rr1plan.collision.arm_geometry import Solid
from rr1plan.collision.convex.convex_bodies import coal_geometry, holds_point, is_concave, occupied_cells
from rr1plan.model.arm_branches import ArmBranches
from rr1plan.model.scene_model import SceneModel
from rr1plan.shapes import HalfSpace, Mesh, PointCloud, Shape

# Accuracy of Coal's distances of cylinders, instead of 1e-5 m with Coal's default.
_GJK_TOLERANCE = 1e-10
# If a core lies exactly on the other surface, Coal may return -1.8e308; a nanometer away it does not.
_NO_DISTANCE = -1e300
_NUDGE = np.array([0.7e-9, -0.5e-9, 0.6e-9])
# Above the rounding error of distances between balls [m].
_ROUNDING = 1e-9
_Request = TypeVar("_Request", coal.CollisionRequest, coal.DistanceRequest)


@dataclass(frozen=True, eq=False, repr=False)
class Contact(Value):
    """Two elements that touch or are nearer than their padding.

    Args:
        a, b: The elements.
        depth: Padding minus distance [m], >= 0.
        point: Halfway between the two deepest points, in the world [m], shape (3,).
    """

    a: str
    b: str
    depth: float
    point: Array


@dataclass(frozen=True, eq=False, repr=False)
class Nearest(Value):
    """The nearest pair of elements.

    Args:
        distance: Their distance [m], negative if they overlap; inf if no pair is checked.
        pair: The elements; empty if no pair is checked.
        point_a, point_b: The nearest points in the world [m], shape (3,).
    """

    distance: float
    pair: tuple[str, ...]
    point_a: Array
    point_b: Array


class CoalPairs:
    """Pairs of solids in Coal: call `place` first, then the queries.

    Args:
        model: The moving arms; None if nothing moves.
        solids: The solids.
        pairs: Pairs of solids [index], shape (m, 2).
        padding: Distance at which a pair counts as in contact [m], shape (m,).
    """

    def __init__(
        self, model: SceneModel | None, solids: tuple[Solid, ...], pairs: NDArray[np.int64], padding: Array
    ) -> None:
        used, numbers = np.unique(pairs, return_inverse=True)
        solids = tuple(solids[k] for k in used.tolist())
        self._pairs: list[list[int]] = numbers.reshape(-1, 2).tolist()
        self._model, self._padding = model, padding
        self._shapes = [coal_geometry(solid.shape) for solid in solids]
        self._first, self._second = numbers.reshape(-1, 2).T
        balls = [_ball_around(shape) for shape in self._shapes]
        self._centers = [center for center, _ in balls]
        radii = np.array([radius for _, radius in balls])
        self._both_radii = radii[self._first] + radii[self._second] + _ROUNDING
        self._poses = [_as_transform(pin.SE3(np.array(solid.placement))) for solid in solids]
        self._branches = () if model is None else tuple(ArmBranches(model).all_arms())
        # Solids of each branch: index, joint in the branch's model, placement in the frame of that joint.
        self._carried: list[list[tuple[int, int, coal.Transform3s]]] = [[] for _ in self._branches]
        last_joints = [branch.rows.stop for branch in self._branches]
        for k, (solid, placement) in enumerate(zip(solids, self._poses, strict=True)):
            if solid.joint > 0:
                number = bisect_left(last_joints, solid.joint)
                joint = solid.joint - self._branches[number].rows.start
                self._carried[number].append((k, joint, placement))
        self._hollow = {hollow.pair: hollow for hollow in _hollow_pairs(solids, self._pairs)}
        self._found, self._nearest = coal.CollisionResult(), coal.DistanceResult()

    def place(self, q: Array, pairs: NDArray[np.intp] | None = None) -> None:
        """Place the solids at q (nq,).

        Args:
            q: Configuration [rad or m], shape (nq,).
            pairs: The pairs that are queried next, shape (n,); other solids may keep their poses (default: all).
        """
        if self._model is None:
            return
        full = self._model.full(q)
        needed = None if pairs is None else {k for pair in pairs.tolist() for k in self._pairs[pair]}
        for branch, all_carried in zip(self._branches, self._carried, strict=True):
            carried = all_carried if needed is None else [one for one in all_carried if one[0] in needed]
            if not carried:
                continue
            branch.place(full)
            poses = branch.data.oMi
            joints = {joint: _as_transform(poses[joint]) for joint in {joint for _, joint, _ in carried}}
            for k, joint, placement in carried:
                self._poses[k] = joints[joint] * placement

    def any_touches(self) -> bool:
        """Whether any pair is nearer than its padding."""
        return any(map(self._touches, self._near()))

    def touching(self) -> list[int]:
        """The pairs that are nearer than their padding."""
        return [pair for pair in self._near() if self._touches(pair)]

    def distances(self) -> Array:
        """Distance of every pair [m], negative if they overlap, shape (m,).

        If a body crosses the surface of a non-convex mesh, it is minus the depth in one of the triangles; if the body
        is entirely inside, it is minus the distance from the surface.
        """
        poses, nearest, each = self._poses, self._nearest, []
        for (i, j), measure in zip(self._pairs, self._measures, strict=True):
            nearest.clear()
            each.append(measure(poses[i], poses[j], _DISTANCE, nearest))
        found = np.array(each, dtype=np.float64)
        for pair in (*np.flatnonzero(found < _NO_DISTANCE).tolist(), *self._hollow):
            found[pair] = self._distance(pair)
        return found

    def distance(self, pair: int) -> tuple[float, Array, Array]:
        """Distance of one pair [m], and the nearest point of each solid in world coordinates."""
        distance, nearest = self._distance(pair), self._nearest
        return distance, np.array(nearest.getNearestPoint1()), np.array(nearest.getNearestPoint2())

    def _distance(self, pair: int) -> float:
        """Distance of one pair [m]; the nearest points are in `_nearest`."""
        i, j = self._pairs[pair]
        distance = self._measure(i, j, self._poses[i])
        if distance < _NO_DISTANCE:
            pose = self._poses[i]
            distance = self._measure(i, j, coal.Transform3s(pose.getRotation(), pose.getTranslation() + _NUDGE))
        if distance > 0.0 and pair in self._hollow and self._is_inside(self._hollow[pair]):
            distance = -distance
        return distance

    def _measure(self, i: int, j: int, pose: coal.Transform3s) -> float:
        """Distance of two solids, the first one at another pose [m]."""
        self._nearest.clear()
        coal.distance(self._shapes[i], pose, self._shapes[j], self._poses[j], _DISTANCE, self._nearest)
        return float(self._nearest.min_distance)

    @cached_property
    def _measures(self) -> list[coal.ComputeDistance]:
        """What measures each pair; a few milliseconds to make, then faster than `coal.distance`."""
        return [coal.ComputeDistance(self._shapes[i], self._shapes[j]) for i, j in self._pairs]

    def _near(self) -> list[int]:
        """The pairs of which balls around both solids are nearer than the padding."""
        if not self._pairs:
            return []
        placed = [pose.transform(center) for pose, center in zip(self._poses, self._centers, strict=True)]
        centers = np.array(placed)
        offsets = centers[self._first] - centers[self._second]
        reach = self._both_radii + self._padding
        near: list[int] = np.flatnonzero(np.einsum("ij,ij->i", offsets, offsets) <= reach * reach).tolist()
        return near

    def _touches(self, pair: int) -> bool:
        """Whether a pair is nearer than its padding."""
        padding, (i, j) = float(self._padding[pair]), self._pairs[pair]
        if pair in self._hollow:
            # Coal's collision test of a surface misses shallow contacts; its distance does not.
            return self._distance(pair) <= padding
        request = _collision_request(padding)
        self._found.clear()
        coal.collide(self._shapes[i], self._poses[i], self._shapes[j], self._poses[j], request, self._found)
        return bool(self._found.isCollision())

    def _is_inside(self, hollow: _Hollow) -> bool:
        """Whether a point of the solid is inside the mesh, and thus the whole solid unless it touches the surface."""
        placed = self._poses[hollow.surface].inverseTimes(self._poses[hollow.solid])
        return any(holds_point(hollow.mesh, placed.transform(point)) for point in hollow.points)


class _Hollow(NamedTuple):
    """A pair of a solid and a non-convex mesh.

    Args:
        pair: Number of the pair.
        solid: Number of the solid.
        points: A point of each of the solid's connected parts, in its frame, shape (n, 3).
        surface: Number of the mesh among the solids.
        mesh: The mesh.
    """

    pair: int
    solid: int
    points: Array
    surface: int
    mesh: Mesh


def _hollow_pairs(solids: tuple[Solid, ...], pairs: list[list[int]]) -> Iterator[_Hollow]:
    surfaces = {k: solid.shape for k, solid in enumerate(solids) if is_concave(solid.shape)}
    for pair, (i, j) in enumerate(pairs if surfaces else ()):
        for solid, surface in ((i, j), (j, i)):
            if surface in surfaces:
                yield _Hollow(pair, solid, _points_in(solids[solid].shape), surface, surfaces[surface])


def _points_in(shape: Shape) -> Array:
    """A point of a convex shape or of each cell of a cloud; none of a half-space, which is never inside."""
    match shape:
        case PointCloud():
            return occupied_cells(shape)
        case Mesh():
            return np.asarray(shape.vertices[:1])
        case HalfSpace():
            return np.zeros((0, 3))
        case _:
            return np.zeros((1, 3))


def _as_transform(pose: pin.SE3) -> coal.Transform3s:
    return coal.Transform3s(pose.rotation, pose.translation)


def _ball_around(shape: coal.CollisionGeometry) -> tuple[Array, float]:
    """Center (3,) and radius of a ball around a shape, in its frame [m]."""
    shape.computeLocalAABB()
    radius = float(shape.aabb_radius)
    return (np.array(shape.aabb_center), radius) if np.isfinite(radius) else (np.zeros(3), np.inf)


@lru_cache(maxsize=1024)
def _collision_request(padding: float) -> coal.CollisionRequest:
    """How to test whether solids are nearer than their padding [m]."""
    request = coal.CollisionRequest()
    request.security_margin = padding
    # With this flag off, Coal 3.0.3 reports balls and capsules as free if their core lies within its tolerance of the
    # other shape's surface, even centimeters deep.
    request.enable_contact = True
    return _without_guess(request)


def _distance_request() -> coal.DistanceRequest:
    """How to measure the distance of solids."""
    request = coal.DistanceRequest()
    request.gjk_tolerance = _GJK_TOLERANCE
    request.enable_signed_distance = True
    return _without_guess(request)


def _without_guess(request: _Request) -> _Request:
    """Start every search without a guess: the guess kept from the last one can be NaN, which spoils all later ones."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # its successor does not turn guesses off
        request.enable_cached_gjk_guess = False
    return request


_DISTANCE = _distance_request()


# ---- pairs with fixed relative poses ------------------------------------------------------------------

_NONE = Nearest(np.inf, (), read_only(np.zeros(3)), read_only(np.zeros(3)))


@dataclass(frozen=True, eq=False)
class StaticPairs:
    """Distances and contacts of pairs that do not move relative to each other, for all q.

    Args:
        distances: Distance of every checked pair [m], inf for elements that move relative to each other, shape
            (n_pairs,).
        touching: (index of the pair, padding - distance [m], point between the elements) of each pair in contact.
        nearest: The nearest of these pairs.
    """

    distances: Array
    touching: tuple[tuple[int, float, Array], ...] = ()
    nearest: Nearest = _NONE


def measure_static(
    placed: CoalPairs, pairs: tuple[tuple[str, str], ...], owner: NDArray[np.int64], padding: Array
) -> StaticPairs:
    """Measure pairs that do not move relative to each other.

    Args:
        placed: Placed pairs of solids that do not move relative to each other; at least one.
        pairs: Names of all checked pairs of elements.
        owner: Index in `pairs` of each pair of solids, shape (m,).
        padding: Padding of each pair of solids [m], shape (m,).
    """
    distances, found = np.full(len(pairs), np.inf), placed.distances()
    np.minimum.at(distances, owner, found)
    touching = []
    for i in np.flatnonzero(found <= padding).tolist():
        distance, a, b = placed.distance(i)
        touching.append((int(owner[i]), float(padding[i]) - distance, 0.5 * (a + b)))
    nearest = int(np.argmin(found))
    _, a, b = placed.distance(nearest)
    closest = Nearest(float(found[nearest]), pairs[owner[nearest]], read_only(a), read_only(b))
    return StaticPairs(read_only(distances), tuple(touching), closest)
