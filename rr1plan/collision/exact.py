"""Exact answers about one configuration, from Coal through Pinocchio's broad phase.

Every shape is solid. Two elements collide when their distance is at most their padding (0: when
they touch). Joint limits are another question: see `CollisionChecker.limit_violations`.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from rr1plan.checks import Array, finite_array, read_only
from rr1plan.collision.solids import coal_geometry, solid_pieces
from rr1plan.limits import Limits
from rr1plan.model import SceneModel
from rr1plan.scene import Scene
from rr1plan.shapes import Shape

# Coal's distances of cylinders are this sharp, not 1e-5 m as with its own default.
_GJK_TOLERANCE = 1e-10
# Where a core lies exactly in another surface, Coal may end with -1.8e308; a nanometre beside it, it does not.
_NO_DISTANCE = -1e300
_NUDGE = np.array([0.7e-9, -0.5e-9, 0.6e-9])


@dataclass(frozen=True, eq=False)
class Contact:
    """Two elements that touch, or come nearer than their padding.

    Args:
        a, b: The elements.
        depth: Padding less distance [m], >= 0.
        point: Halfway between the two deepest points, in the world [m], shape (3,).
    """

    a: str
    b: str
    depth: float
    point: Array


@dataclass(frozen=True, eq=False)
class Nearest:
    """The two elements that are nearest to each other.

    Args:
        distance: Their distance [m], negative where they overlap; inf when no pair is checked.
        pair: The elements; empty when no pair is checked.
        point_a, point_b: The nearest points in the world [m], shape (3,).
    """

    distance: float
    pair: tuple[str, ...]
    point_a: Array
    point_b: Array


@dataclass(frozen=True, eq=False)
class Solid:
    """One convex piece (or point cloud) of one element, carried by a joint of the model.

    Args:
        element: The element it is a part of.
        shape: A shape Coal takes as solid.
        joint: Index of the Pinocchio joint that carries it; 0 is the world.
        placement: T_joint_solid, shape (4, 4).
    """

    element: str
    shape: Shape
    joint: int
    placement: Array


@dataclass(frozen=True, eq=False)
class _Resting:
    """What is true, whatever q is, of the pairs that do not move against each other.

    Args:
        distances: Distance of every checked pair [m], inf where its elements move, shape (n_pairs,).
        touching: (index of the pair, padding - distance [m], point between them) of those that collide.
        nearest: The nearest of them.
    """

    distances: Array
    touching: tuple[tuple[int, float, Array], ...] = ()
    nearest: Nearest = Nearest(np.inf, (), np.zeros(3), np.zeros(3))


class CollisionChecker:
    """Which elements of a scene touch, and how far apart they are, at a configuration.

    An instance keeps scratch memory: give each thread its own (they pickle, as scene and arms).

    Args:
        scene: The scene.
        arms: The arms that move (default: all); the others rest in their posture of the scene.

    Attributes:
        model: The scene's `SceneModel`.
        pairs: All pairs of elements that must not touch.
        solids: The convex pieces of all elements.
        solid_pairs: Pairs of solids [index] whose relative pose depends on q, shape (m, 2).
        solid_padding: Padding of each of those [m], shape (m,).
        solid_owner: For each of those the index in `pairs`, shape (m,).

    Raises:
        UnknownNameError: no such arm.
        InputError: a shape that cannot be made solid.
    """

    def __init__(self, scene: Scene, arms: Sequence[str] | None = None) -> None:
        self.model = SceneModel(scene, arms)
        self.pairs = scene.checked_pairs
        self.solids = _solids(self.model)
        self._padding = read_only(np.array([scene.padding_of(a, b) for a, b in self.pairs], dtype=np.float64))
        index, owner = _solid_pairs(self.pairs, self.solids)
        moving = _relative_motion(self.model, self.solids, index)
        self.solid_pairs = read_only(index[moving])
        self.solid_owner = read_only(owner[moving])
        self.solid_padding = read_only(self._padding[self.solid_owner])
        self._geometry = _geometry_model(self.model, self.solids, self.solid_pairs)
        self._data = self.model.model.createData()
        self._scratch = _geometry_data(self._geometry, self.solid_padding)
        self._manager = pin.BroadPhaseManager_NaiveCollisionManager(self.model.model, self._geometry, self._scratch)
        self._callback = pin.CollisionCallBackDefault(self._geometry, self._scratch)
        self._callback.stopAtFirstCollision = True
        self._resting = self._answer_resting_pairs(index[~moving], owner[~moving])

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickles as its scene and arms."""
        return CollisionChecker, (self.scene, self.arms)

    # ---- what it is about ----------------------------------------------------------------

    @property
    def scene(self) -> Scene:
        """The scene."""
        return self.model.scene

    @property
    def arms(self) -> tuple[str, ...]:
        """The arms that move."""
        return self.model.arms

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Columns of q, "arm/joint"."""
        return self.model.joint_names

    @property
    def nq(self) -> int:
        """Number of columns of q."""
        return self.model.nq

    @property
    def limits(self) -> Limits:
        """Limits of those columns."""
        return self.model.limits

    @property
    def resting_is_free(self) -> bool:
        """No two elements collide that do not move against each other."""
        return not self._resting.touching

    def limit_violations(self, q: Any) -> tuple[tuple[str, float], ...]:
        """Joints outside their position limits, each with how far [rad or m].

        Raises:
            InputError: q has the wrong shape or is not finite.
        """
        q = self.checked(q)
        excess = np.maximum(self.limits.lower - q, q - self.limits.upper)
        return tuple((self.joint_names[j], float(excess[j])) for j in np.flatnonzero(excess > 0.0))

    def within_limits(self, q: Any) -> bool:
        """Every joint is within its position limits; `limit_violations` says which are not."""
        return not self.limit_violations(q)

    # ---- one configuration ---------------------------------------------------------------

    def is_free(self, q: Any) -> bool:
        """No checked pair is nearer than its padding.

        Args:
            q: Configuration [rad or m], shape (nq,).

        Raises:
            InputError: wrong shape or not finite.
        """
        self._place(q)
        self._manager.update(False)
        self._callback.init()
        return self.resting_is_free and not pin.computeCollisions(self._manager, self._callback)

    def contacts(self, q: Any) -> tuple[Contact, ...]:
        """All pairs of elements that touch or are nearer than their padding, the deepest first.

        Args:
            q: Configuration [rad or m], shape (nq,).

        Raises:
            InputError: wrong shape or not finite.
        """
        self._place(q)
        pin.computeCollisions(self._geometry, self._scratch, False)
        touching = list(self._resting.touching)
        for i, owner in enumerate(self.solid_owner):
            if self._scratch.collisionResults[i].isCollision():
                distance, a, b = _distance(self._geometry, self._scratch, i)
                touching.append((int(owner), max(0.0, float(self.solid_padding[i]) - distance), 0.5 * (a + b)))
        deepest: dict[int, tuple[float, Array]] = {}
        for owner, depth, point in touching:
            if owner not in deepest or depth > deepest[owner][0]:
                deepest[owner] = (depth, point)
        ordered = sorted(deepest.items(), key=lambda item: (-item[1][0], item[0]))
        return tuple(Contact(*self.pairs[k], depth, read_only(point)) for k, (depth, point) in ordered)

    def distances(self, q: Any) -> Array:
        """Distance of every checked pair [m], negative where they overlap, shape (n_pairs,).

        Args:
            q: Configuration [rad or m], shape (nq,).

        Raises:
            InputError: wrong shape or not finite.
        """
        out = self._resting.distances.copy()
        np.minimum.at(out, self.solid_owner, self.solid_distances(q))
        return out

    def nearest(self, q: Any) -> Nearest:
        """The nearest of all checked pairs.

        Args:
            q: Configuration [rad or m], shape (nq,).

        Raises:
            InputError: wrong shape or not finite.
        """
        distances = self.solid_distances(q)
        if len(distances) == 0 or distances.min() >= self._resting.nearest.distance:
            return self._resting.nearest
        i = int(np.argmin(distances))
        distance, a, b = _distance(self._geometry, self._scratch, i)
        return Nearest(distance, self.pairs[self.solid_owner[i]], read_only(a), read_only(b))

    # ---- for the motion checker -----------------------------------------------------------

    def solid_distances(self, q: Any) -> Array:
        """Distance of every pair in `solid_pairs` [m], negative where they overlap, shape (m,)."""
        self._place(q)
        pin.computeDistances(self._geometry, self._scratch)
        return _found_distances(self._geometry, self._scratch)

    def solid_distance(self, q: Any, pair: int) -> float:
        """Distance of one pair in `solid_pairs` [m], negative where they overlap."""
        self._place(q)
        return _distance(self._geometry, self._scratch, pair)[0]

    def checked(self, q: Any) -> Array:
        """The configuration q as an array of finite numbers, shape (nq,).

        Raises:
            InputError: wrong shape or not finite.
        """
        if type(q) is np.ndarray and q.dtype == np.float64 and q.shape == (self.nq,) and isfinite(q.dot(q)):
            return q
        return finite_array("q", q, (self.nq,))

    # ---- inside ---------------------------------------------------------------------------

    def _place(self, q: Any) -> None:
        q = self.model.full(self.checked(q))
        pin.updateGeometryPlacements(self.model.model, self._data, self._geometry, self._scratch, q)

    def _answer_resting_pairs(self, index: NDArray[np.int64], owner: NDArray[np.int64]) -> _Resting:
        distances = np.full(len(self.pairs), np.inf)
        if len(index) == 0:
            return _Resting(read_only(distances))
        geometry = _geometry_model(self.model, self.solids, index)
        scratch = _distance_data(geometry)
        q = self.model.full(np.zeros(self.nq))
        pin.updateGeometryPlacements(self.model.model, self._data, geometry, scratch, q)
        pin.computeDistances(geometry, scratch)
        found = _found_distances(geometry, scratch)
        np.minimum.at(distances, owner, found)
        nearest = int(np.argmin(found))
        _, a, b = _distance(geometry, scratch, nearest)
        touching = []
        for i in np.flatnonzero(found <= self._padding[owner]):
            distance, near_a, near_b = _distance(geometry, scratch, int(i))
            touching.append((int(owner[i]), float(self._padding[owner[i]]) - distance, 0.5 * (near_a + near_b)))
        pair = self.pairs[owner[nearest]]
        return _Resting(
            read_only(distances), tuple(touching), Nearest(float(found[nearest]), pair, read_only(a), read_only(b))
        )


def _found_distances(geometry: Any, data: Any) -> Array:
    """The distances that `computeDistances` found [m], shape (m,)."""
    found = np.array([r.min_distance for r in data.distanceResults], dtype=np.float64)
    for pair in np.flatnonzero(found < _NO_DISTANCE):
        found[pair] = _distance(geometry, data, int(pair))[0]
    return found


def _distance(geometry: Any, data: Any, pair: int) -> tuple[float, Array, Array]:
    """Distance of a pair of solids as they are placed [m], and the nearest point of each."""
    result = pin.computeDistance(geometry, data, pair)
    if result.min_distance < _NO_DISTANCE:
        placement = data.oMg[geometry.collisionPairs[pair].first]
        exactly = placement.translation.copy()
        placement.translation = exactly + _NUDGE
        result = pin.computeDistance(geometry, data, pair)
        placement.translation = exactly
    return float(result.min_distance), np.array(result.getNearestPoint1()), np.array(result.getNearestPoint2())


def _solids(model: SceneModel) -> tuple[Solid, ...]:
    return tuple(
        Solid(g.element, piece, g.joint, g.placement)
        for g in model.element_geometries
        for piece in solid_pieces(g.geometry.shape)
    )


def _solid_pairs(
    pairs: tuple[tuple[str, str], ...], solids: tuple[Solid, ...]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pairs of solids (m, 2) and the pair of elements each belongs to (m,)."""
    parts: dict[str, list[int]] = {}
    for i, solid in enumerate(solids):
        parts.setdefault(solid.element, []).append(i)
    rows = [(i, j, k) for k, (a, b) in enumerate(pairs) for i in parts[a] for j in parts[b]]
    table = np.array(rows, dtype=np.int64).reshape(-1, 3)
    return table[:, :2].copy(), table[:, 2].copy()


def _relative_motion(model: SceneModel, solids: tuple[Solid, ...], index: NDArray[np.int64]) -> NDArray[np.bool_]:
    """For each pair of solids whether any column of q moves one against the other, shape (m,)."""
    parents = [int(p) for p in model.model.parents]
    driven = [False, *((model.columns >= 0) & (model.gains != 0.0)).tolist()]
    movers: list[frozenset[int]] = [frozenset()]
    for joint in range(1, len(parents)):
        movers.append(movers[parents[joint]] | ({joint} if driven[joint] else frozenset()))
    above = [movers[s.joint] for s in solids]
    return np.array([above[i] != above[j] for i, j in index.tolist()], dtype=np.bool_)


def _geometry_model(model: SceneModel, solids: tuple[Solid, ...], index: NDArray[np.int64]) -> Any:
    geometry = pin.GeometryModel()
    for k, solid in enumerate(solids):
        placement = pin.SE3(np.array(solid.placement))
        name = f"{k} {solid.element}"
        geometry.addGeometryObject(pin.GeometryObject(name, solid.joint, placement, coal_geometry(solid.shape)))
    for i, j in index:
        geometry.addCollisionPair(pin.CollisionPair(int(i), int(j)))
    return geometry


def _distance_data(geometry: Any) -> Any:
    """Room for distances alone."""
    data = pin.GeometryData(geometry)
    for request in data.distanceRequests:
        request.gjk_tolerance = _GJK_TOLERANCE
        request.enable_signed_distance = True
    _forget_guesses(data.distanceRequests)
    return data


def _geometry_data(geometry: Any, padding: Array) -> Any:
    data = _distance_data(geometry)
    for request, distance in zip(data.collisionRequests, padding.tolist(), strict=True):
        request.security_margin = distance
        # Without contacts Coal 3.0.3 answers "free" for balls and capsules whose core lies within
        # its tolerance of the other shape's surface: centimetres deep, and not seen.
        request.enable_contact = True
    _forget_guesses(data.collisionRequests)
    return data


def _forget_guesses(requests: Any) -> None:
    """Start every search afresh: a guess kept from the last one can be NaN, and then spoils all that follow."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # the successor of this switch does not turn it off
        for request in requests:
            request.enable_cached_gjk_guess = False
