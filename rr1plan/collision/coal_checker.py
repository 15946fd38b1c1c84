"""Exact results for one configuration, from Coal.

Every shape is solid. Two elements collide if their distance is at most their padding (with a padding of 0: if they
touch). Joint limits are checked separately: see `CollisionChecker.limit_violations`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from threading import RLock
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rr1plan.checks import (
    Array,
    finite_number,
    is_near,
    items_of,
    near_array,
    number_from_zero,
    of_kind,
    read_only,
    whole_number,
)
from rr1plan.collision.arm_geometry import Solid
from rr1plan.collision.coal_pairs import CoalPairs, Contact, Nearest, StaticPairs, measure_static
from rr1plan.collision.collision_geometry import CollisionGeometry, collision_geometry, geometry_distance
from rr1plan.collision.edge_kernel import ExactKernel
from rr1plan.collision.stationary_contacts import ROUNDING, stationary_contacts
from rr1plan.collision.tables.exact_tables import ExactTables, arm_exact_struct, build_static_tables, build_tables
from rr1plan.collision.tables.obstacle_tables import FixedSolids, fixed_links
from rr1plan.model.scene_model import SceneModel
from rr1plan.robot.joint_limits import Limits
from rr1plan.scene import Scene
from rr1plan.scene.scene_content import largest_padding
from rr1plan.thread_locks import ExclusiveCache, exclusive, per_process


class CoalChecker:
    """Contacts and distances of the elements of a scene at a configuration; the base of `CollisionChecker`.

    Coal's objects are created when they are first needed.

    Args:
        scene: The scene.
        arms: The arms that move (default: all); the others keep their configuration of the scene.
        margin: Distance to keep beyond the scene's padding between elements that move relative to each other [m].

    Attributes:
        arms: As given, in the order of the scene.
        omission_distance: Elements that provably stay farther than this from every moving arm are omitted [m].
        pair_tables: The pairs of solids.
        solid_pairs: Pairs of solids [index] whose relative pose depends on q, shape (m, 2).
        solid_owner: Index in `pairs` of each of those, shape (m,).
        padding: The scene's padding for each of `pairs` [m], shape (n_pairs,).
        solid_padding: Distance to keep for each of `solid_pairs`, including the margin [m], shape (m,).

    Raises:
        UnknownNameError: no such arm.
        InputError: a shape that cannot be made solid, or a negative margin.
    """

    def __init__(self, scene: Scene, arms: Sequence[str] | None = None, *, margin: float = 0.0) -> None:
        of_kind("scene", scene, Scene)
        self._lock = per_process(self, "_lock", RLock)
        self._scene = scene
        self._moved: dict[str, Array] = {}
        # The outer call is for scenes without arms.
        self.arms = scene.arm_names(scene.arm_names(arms))
        margin = number_from_zero("margin", margin)
        self._use(collision_geometry(scene, self.arms, geometry_distance(scene, margin)), margin)

    def _use(self, geometry: CollisionGeometry, margin: float) -> None:
        scene = self.scene
        self._geometry: CollisionGeometry | None = geometry
        self.omission_distance, self.pair_tables = geometry.distance, geometry.pairs
        self.solid_pairs: NDArray[np.int64] = geometry.pairs.moving
        self.solid_owner: NDArray[np.int64] = geometry.pairs.moving_owner
        self.padding: Array = read_only(geometry.rules.paddings(scene.padding, scene.pair_padding))
        self._bare_padding: Array = self.padding[self.solid_owner]
        self._kept_padding: Array = self._bare_padding + margin
        self.solid_padding: Array = read_only(self._kept_padding.view())
        self.margin = margin
        self.nq = sum(scene.arms[name].robot.nq for name in self.arms)

    @property
    def scene(self) -> Scene:
        """The scene, with all obstacles at their current poses."""
        if self._moved:
            self._place_moved()
        return self._scene

    @exclusive
    def _place_moved(self) -> None:
        for name in list(self._moved):
            self._scene = self._scene.with_obstacle_at(name, self._moved[name])
            del self._moved[name]

    @property
    def geometry(self) -> CollisionGeometry:
        """The solids of the moving arms and of everything that can come near them, and their pairs."""
        return self._geometry or self._new_geometry()

    @exclusive
    def _new_geometry(self) -> CollisionGeometry:
        geometry = self._geometry = collision_geometry(self.scene, self.arms, self.omission_distance)
        return geometry

    def _obstacles_moved(self) -> None:
        """Drop cached values that depend on the poses of obstacles, except the kernels' tables."""
        for name in ("omitted_clearance", "_whole", "_moving", "_stationary_contacts", "_static", "static_is_free"):
            self.__dict__.pop(name, None)

    def _keep_margin(self, margin: float) -> None:
        """Change the margin; the geometry must be the same for both."""
        np.add(self._bare_padding, margin, out=self._kept_padding)
        self.margin = margin
        for name in ("omitted_clearance", "_whole", "_moving"):
            self.__dict__.pop(name, None)

    # ---- properties ----------------------------------------------------------------------

    @ExclusiveCache
    def model(self) -> SceneModel:
        """The moving arms alone as one Pinocchio model; joints have the same numbers as in `solids`."""
        return SceneModel(Scene({name: self.scene.arms[name] for name in self.arms}))

    @ExclusiveCache
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """Pairs of elements that must not touch, at least one of which belongs to a moving arm.

        Pairs of arms or of an arm and an obstacle that provably stay more than 5 cm beyond the greatest padding apart
        for all q are omitted; in scenes with such arms or obstacles, also pairs of links of two moving arms.
        """
        names = self.geometry.rules.names
        return tuple((names[i], names[j]) for i, j in self.geometry.rules.checked.tolist())

    @property
    def solids(self) -> tuple[Solid, ...]:
        """The convex pieces of the elements."""
        return self.geometry.solids

    @ExclusiveCache
    def joint_names(self) -> tuple[str, ...]:
        """Names "arm/joint" of the columns of q."""
        return self.scene.joint_names(self.arms)

    @ExclusiveCache
    def limits(self) -> Limits:
        """Limits of the columns of q."""
        return self.scene.limits(self.arms)

    @ExclusiveCache
    def static_is_free(self) -> bool:
        """Whether no elements with a fixed relative pose collide, including those of stationary arms."""
        own = self._static_clearance(ROUNDING) >= ROUNDING or not self._static.touching
        return own and not self._stationary_contacts

    @property
    @exclusive
    def static_contacts(self) -> tuple[tuple[str, str], ...]:
        """The pairs of elements in contact that do not move relative to each other."""
        own = dict.fromkeys(self.pairs[owner] for owner, *_ in self._static.touching)
        return (*own, *((contact.a, contact.b) for contact in self._stationary_contacts))

    def limit_violations(self, q: ArrayLike) -> tuple[tuple[str, float], ...]:
        """Joints outside their position limits, with the excess of each [rad or m].

        Raises:
            InputError: q has the wrong shape, is not finite or beyond ±1e4.
        """
        q = self.checked(q)
        excess = np.maximum(self.limits.lower - q, q - self.limits.upper)
        return tuple((self.joint_names[j], float(excess[j])) for j in np.flatnonzero(excess > 0.0))

    def within_limits(self, q: ArrayLike) -> bool:
        """Whether every joint is within its position limits; `limit_violations` lists those that are not.

        Args:
            q: Configuration [rad or m], shape (nq,).

        Raises:
            InputError: wrong shape, not finite or beyond ±1e4.
        """
        q = self.checked(q)
        return bool(((q >= self.limits.lower) & (q <= self.limits.upper)).all())

    # ---- one configuration ---------------------------------------------------------------

    @exclusive
    def is_free_slowly(self, q: ArrayLike) -> bool:
        """The result of `is_free` from Coal alone; the reference in tests.

        Args:
            q: Configuration [rad or m], shape (nq,).

        Raises:
            InputError: wrong shape, not finite or beyond ±1e4.
        """
        moving = self._placed(q)
        return self.static_is_free and not moving.any_touches()

    @exclusive
    def contacts(self, q: ArrayLike) -> tuple[Contact, ...]:
        """All pairs of elements that touch or are nearer than their padding, deepest first.

        Args:
            q: Configuration [rad or m], shape (nq,).

        Raises:
            InputError: wrong shape, not finite or beyond ±1e4.
        """
        moving = self._placed(q)
        touching = list(self._static.touching)
        for i in moving.touching():
            distance, a, b = moving.distance(i)
            depth = max(0.0, float(self.solid_padding[i]) - distance)
            touching.append((int(self.solid_owner[i]), depth, 0.5 * (a + b)))
        deepest: dict[int, tuple[float, Array]] = {}
        for owner, depth, point in touching:
            if owner not in deepest or depth > deepest[owner][0]:
                deepest[owner] = (depth, point)
        ordered = sorted(deepest.items(), key=lambda item: (-item[1][0], item[0]))
        own = [Contact(*self.pairs[k], depth, read_only(point)) for k, (depth, point) in ordered]
        return tuple(sorted([*own, *self._stationary_contacts], key=lambda contact: -contact.depth))

    @exclusive
    def distances(self, q: ArrayLike) -> Array:
        """Distance of every checked pair [m], negative if they overlap, shape (n_pairs,).

        Args:
            q: Configuration [rad or m], shape (nq,).

        Raises:
            InputError: wrong shape, not finite or beyond ±1e4.
        """
        out = self._static.distances.copy()
        np.minimum.at(out, self.solid_owner, self.solid_distances(q))
        return out

    @exclusive
    def nearest(self, q: ArrayLike) -> Nearest:
        """The nearest of all checked pairs.

        Args:
            q: Configuration [rad or m], shape (nq,).

        Raises:
            InputError: wrong shape, not finite or beyond ±1e4.
        """
        distances = self.solid_distances(q)
        least = min(float(distances.min(initial=np.inf)), self._static.nearest.distance)
        if least > self.geometry.least_gap:
            return self._whole.nearest(q)
        if least == self._static.nearest.distance:
            return self._static.nearest
        i = int(np.argmin(distances))
        distance, a, b = self._moving.distance(i)
        return Nearest(distance, self.pairs[self.solid_owner[i]], read_only(a), read_only(b))

    @exclusive
    def clearance(self, q: ArrayLike, most: float = np.inf) -> float:
        """The smallest distance of any checked pair beyond its padding [m], at most `most`.

        For overlapping elements only its sign is meaningful: it is negative. The compiled kernel computes it without
        Coal, and never overestimates a distance.

        Args:
            q: Configuration [rad or m], shape (nq,).
            most: Larger distances are not computed [m].

        Raises:
            InputError: wrong shape, not finite or beyond ±1e4, or elements whose distance cannot be measured.
        """
        q = self.checked(q)
        most = most if type(most) is float and most > 0.0 else finite_number("most", most)
        least = self.exact_kernel.least_clearance(q, self._static_clearance(most))
        return least if least <= self.omitted_clearance else self._whole.clearance(q, most)

    @exclusive
    def moving_clearance(self, q: ArrayLike, most: float = np.inf) -> float:
        """Like `clearance`, for the pairs that move relative to each other.

        Args:
            q: Configuration [rad or m], shape (nq,).
            most: Larger distances are not computed [m].

        Raises:
            InputError: wrong shape, not finite or beyond ±1e4, or elements whose distance cannot be measured.
        """
        q = self.checked(q)
        most = most if type(most) is float and most > 0.0 else finite_number("most", most)
        least = self.exact_kernel.least_clearance(q, most)
        return least if least <= self.omitted_clearance else self._whole.moving_clearance(q, most)

    # ---- for the kernels -----------------------------------------------------------

    @ExclusiveCache
    def fixed(self) -> FixedSolids:
        """The links and obstacles that do not move, for compiled code that places them."""
        instances = self.geometry.instances
        return FixedSolids(self.geometry.obstacles, len(instances.groups), fixed_links(instances))

    @ExclusiveCache
    def tables(self) -> ExactTables:
        """The exact kernel's tables for the pairs that move relative to each other."""
        return build_tables(self.geometry, self.fixed, self._kept_padding)

    @ExclusiveCache
    def exact_kernel(self) -> ExactKernel:
        """The exact kernel for these pairs."""
        like, static = arm_exact_struct(self.geometry.instances), len(self.pair_tables.static)
        return ExactKernel(self.tables, self.nq, like, static)

    def run_exact_kernel(self, kernel: Callable[..., Any], *given: Any) -> None:
        """Call a kernel whose first arguments are the tables and the scratch memory of the exact kernel.

        Args:
            kernel: A function of the library.
            *given: Its other arguments.
        """
        with self._lock:
            kernel(self.exact_kernel.struct, self.exact_kernel.scratch, *given)

    @exclusive
    def solid_distances(self, q: ArrayLike, pairs: NDArray[np.intp] | None = None) -> Array:
        """Distance of every pair in `solid_pairs`, or of the given ones [m], negative if they overlap, shape (m,).

        Args:
            q: Configuration [rad or m], shape (nq,).
            pairs: Indices of pairs, shape (m,) (default: all).

        Raises:
            InputError: wrong shape, not finite or beyond ±1e4, or pair numbers that do not exist.
        """
        if pairs is None:
            return self._placed(q).distances()
        numbers = items_of("pairs", pairs, "numbers of pairs")
        for pair in numbers:
            whole_number("pair", pair, 0, len(self.solid_pairs) - 1)
        placed = self._placed(q, np.array(numbers, np.intp))
        return np.array([placed.distance(int(i))[0] for i in numbers])

    @exclusive
    def solid_points(self, q: ArrayLike, pair: int) -> tuple[Array, Array]:
        """The nearest points of one pair in `solid_pairs`, in world coordinates [m], shape (3,) each.

        Args:
            q: Configuration [rad or m], shape (nq,).
            pair: Index of the pair.

        Raises:
            InputError: wrong shape, not finite or beyond ±1e4, or a pair number that does not exist.
        """
        whole_number("pair", pair, 0, len(self.solid_pairs) - 1)
        return self._placed(q, np.array([pair])).distance(pair)[1:]

    def checked(self, q: ArrayLike) -> Array:
        """The configuration q as an array of numbers within ±1e4, shape (nq,).

        Raises:
            InputError: wrong shape, not finite or beyond ±1e4.
        """
        return q if is_near(q, (self.nq,)) else near_array("q", q, (self.nq,))

    # ---- inside ---------------------------------------------------------------------------

    @ExclusiveCache
    def omitted_clearance(self) -> float:
        """Lower bound of the distances of omitted pairs beyond their padding and the margin [m]."""
        return self.geometry.least_gap - largest_padding(self.scene) - self.margin

    @ExclusiveCache
    def _whole(self) -> CoalChecker:
        """A checker of the same arms that omits nothing."""
        other = CoalChecker(self.scene, self.arms, margin=self.margin)
        other._use(collision_geometry(self.scene, self.arms, np.inf), self.margin)
        return other

    @ExclusiveCache
    def _moving(self) -> CoalPairs:
        return CoalPairs(self.model, self.solids, self.solid_pairs, self.solid_padding)

    def _placed(self, q: ArrayLike, pairs: NDArray[np.intp] | None = None) -> CoalPairs:
        """Coal's pairs that move relative to each other, placed at q: all of them, or at least the given ones."""
        q = self.checked(q)
        self._moving.place(q, pairs)
        return self._moving

    @ExclusiveCache
    def _stationary_contacts(self) -> tuple[Contact, ...]:
        return stationary_contacts(self.scene, self.arms) if len(self.arms) < len(self._scene.arms) else ()

    def _static_clearance(self, most: float) -> float:
        """The smallest distance beyond the padding of pairs with fixed relative poses [m], at most `most`."""
        if len(self.pair_tables.static) == 0:
            return most
        pairs = self.pair_tables
        tables = build_static_tables(self.tables, pairs, self.padding[pairs.static_owner])
        if tables is None:
            beyond = self._static.distances - self.padding
            return min(most, float(beyond.min()))
        return self.exact_kernel.of_pairs(tables).least_clearance(np.zeros(self.nq), most)

    @ExclusiveCache
    def _static(self) -> StaticPairs:
        index, owner = self.pair_tables.static, self.pair_tables.static_owner
        if len(index) == 0:
            return StaticPairs(read_only(np.full(len(self.pairs), np.inf)))
        padding = self.padding[owner]
        placed = CoalPairs(self.model, self.solids, index, padding)
        placed.place(np.zeros(self.nq))
        return measure_static(placed, self.pairs, owner, padding)
