"""Pairs of solids in Coal, through Pinocchio's geometry model; results for pairs that do not depend on q."""

from __future__ import annotations

import warnings
from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

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
        self._model = model
        self._branches = () if model is None else tuple(ArmBranches(model).all_arms())
        self._pinocchio = pin.Model() if model is None else model.model
        self._geometry = _geometry_model(solids, pairs)
        self._scratch = _geometry_data(self._geometry, padding)
        self._manager = pin.BroadPhaseManager_NaiveCollisionManager(self._pinocchio, self._geometry, self._scratch)
        # Solids of each branch: index, joint in the branch's model, placement in the frame of that joint.
        self._carried: list[list[tuple[int, int, pin.SE3]]] = [[] for _ in self._branches]
        last_joints = [branch.rows.stop for branch in self._branches]
        for k, (solid, shape) in enumerate(zip(solids, self._geometry.geometryObjects, strict=True)):
            if solid.joint == 0:
                self._scratch.oMg[k] = shape.placement
            else:
                number = bisect_left(last_joints, solid.joint)
                joint = solid.joint - self._branches[number].rows.start
                self._carried[number].append((k, joint, shape.placement.copy()))
        self._callback = pin.CollisionCallBackDefault(self._geometry, self._scratch)
        self._callback.stopAtFirstCollision = True
        self._solids_of_pairs, self._padding = pairs, padding
        self._hollow = {hollow.pair: hollow for hollow in _hollow_pairs(solids, pairs)}
        for pair in self._hollow:
            # Coal's collision test of a surface misses shallow contacts; its distance does not.
            self._scratch.deactivateCollisionPair(pair)

    def place(self, q: Array, pairs: NDArray[np.intp] | None = None) -> None:
        """Place the solids at q (nq,).

        Args:
            q: Configuration [rad or m], shape (nq,).
            pairs: The pairs that are queried next, shape (n,); solids of other arms keep their poses (default: all).
        """
        if self._model is None:
            return
        full, placed = self._model.full(q), self._scratch.oMg
        if len(self._branches) == 1:
            # One call takes a tenth of the time.
            data = self._branches[0].data
            pin.updateGeometryPlacements(self._pinocchio, data, self._geometry, self._scratch, full)
            return
        needed = None if pairs is None else set(self._solids_of_pairs[pairs].ravel().tolist())
        for branch, all_carried in zip(self._branches, self._carried, strict=True):
            carried = all_carried if needed is None else [one for one in all_carried if one[0] in needed]
            if not carried:
                continue
            branch.place(full)
            poses = branch.data.oMi
            for k, joint, placement in carried:
                placed[k] = poses[joint] * placement

    def any_touches(self) -> bool:
        """Whether any pair is nearer than its padding."""
        self._manager.update(False)
        self._callback.init()
        return bool(pin.computeCollisions(self._manager, self._callback)) or any(map(self._touches, self._hollow))

    def touching(self) -> list[int]:
        """The pairs that are nearer than their padding."""
        pin.computeCollisions(self._geometry, self._scratch, False)
        results = enumerate(self._scratch.collisionResults)
        return [i for i, found in results if (self._touches(i) if i in self._hollow else found.isCollision())]

    def distances(self) -> Array:
        """Distance of every pair [m], negative if they overlap, shape (m,).

        If a body crosses the surface of a non-convex mesh, it is minus the depth in one of the triangles; if the body
        is entirely inside, it is minus the distance from the surface.
        """
        pin.computeDistances(self._geometry, self._scratch)
        found = np.array([r.min_distance for r in self._scratch.distanceResults], dtype=np.float64)
        for pair in (*np.flatnonzero(found < _NO_DISTANCE).tolist(), *self._hollow):
            found[pair] = self.distance(pair)[0]
        return found

    def distance(self, pair: int) -> tuple[float, Array, Array]:
        """Distance of one pair [m], and the nearest point of each solid in world coordinates."""
        result = pin.computeDistance(self._geometry, self._scratch, pair)
        if result.min_distance < _NO_DISTANCE:
            placement = self._scratch.oMg[self._geometry.collisionPairs[pair].first]
            exactly = placement.translation.copy()
            placement.translation = exactly + _NUDGE
            result = pin.computeDistance(self._geometry, self._scratch, pair)
            placement.translation = exactly
        distance = float(result.min_distance)
        if distance > 0.0 and pair in self._hollow and self._is_inside(self._hollow[pair]):
            distance = -distance
        return distance, np.array(result.getNearestPoint1()), np.array(result.getNearestPoint2())

    def _touches(self, pair: int) -> bool:
        """Whether a pair with a non-convex mesh is nearer than its padding."""
        return self.distance(pair)[0] <= float(self._padding[pair])

    def _is_inside(self, hollow: _Hollow) -> bool:
        """Whether a point of the solid is inside the mesh, and thus the whole solid unless it touches the surface."""
        placed = self._scratch.oMg[hollow.surface].actInv(self._scratch.oMg[hollow.solid])
        return any(holds_point(hollow.mesh, placed.act(point)) for point in hollow.points)


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


def _hollow_pairs(solids: tuple[Solid, ...], pairs: NDArray[np.int64]) -> Iterator[_Hollow]:
    for pair, (i, j) in enumerate(pairs.tolist()):
        for solid, surface in ((i, j), (j, i)):
            mesh = solids[surface].shape
            if is_concave(mesh):
                yield _Hollow(pair, solid, _points_in(solids[solid].shape), surface, mesh)


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


def _geometry_model(solids: tuple[Solid, ...], pairs: NDArray[np.int64]) -> pin.GeometryModel:
    geometry = pin.GeometryModel()
    for k, solid in enumerate(solids):
        placement = pin.SE3(np.array(solid.placement))
        name = f"{k} {solid.element}"
        geometry.addGeometryObject(pin.GeometryObject(name, solid.joint, placement, coal_geometry(solid.shape)))
    for i, j in pairs.tolist():
        geometry.addCollisionPair(pin.CollisionPair(i, j))
    return geometry


def _geometry_data(geometry: pin.GeometryModel, padding: Array) -> pin.GeometryData:
    data = pin.GeometryData(geometry)
    for request in data.distanceRequests:
        request.gjk_tolerance = _GJK_TOLERANCE
        request.enable_signed_distance = True
    for request, distance in zip(data.collisionRequests, padding.tolist(), strict=True):
        request.security_margin = distance
        # With this flag off, Coal 3.0.3 reports balls and capsules as free if their core lies within its tolerance of
        # the other shape's surface, even centimeters deep.
        request.enable_contact = True
    _forget_guesses(data.distanceRequests)
    _forget_guesses(data.collisionRequests)
    return data


def _forget_guesses(requests: coal.StdVec_DistanceRequest | coal.StdVec_CollisionRequest) -> None:
    """Start every search without a guess: the guess kept from the last one can be NaN, which spoils all later ones."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # its successor does not turn guesses off
        for request in requests:
            request.enable_cached_gjk_guess = False


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
