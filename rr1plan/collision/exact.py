"""Exact answers about one configuration, from Coal through Pinocchio's broad phase.

Every shape is solid. Two elements collide when their distance is at most their padding (0: when
they touch). Joint limits are another question: see `CollisionChecker.limit_violations`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from math import isfinite
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, finite_array, finite_number, items_of, read_only, whole_number
from rr1plan.collision.answers import Contact, Nearest
from rr1plan.collision.carried import Solid
from rr1plan.collision.coal_pairs import CoalPairs
from rr1plan.collision.edge_kernel import ExactKernel
from rr1plan.collision.exact_tables import build_resting_tables, build_tables
from rr1plan.collision.kernel_tables import ExactTables
from rr1plan.collision.layout import layout_of
from rr1plan.collision.resting import Resting, measure_resting
from rr1plan.limits import Limits
from rr1plan.model import SceneModel
from rr1plan.scene import Scene

# Rounding of a gap that the kernel computed is far below this [m].
_ROUNDING = 1e-9


class CollisionChecker:
    """Which elements of a scene touch, and how far apart they are, at a configuration.

    An instance keeps scratch memory: give each thread its own (they pickle, as scene and arms). Coal's objects
    are made when it is first asked.

    Args:
        scene: The scene.
        arms: The arms that move (default: all); the others rest in their posture of the scene.

    Attributes:
        model: The scene's `SceneModel`.
        layout: The convex pieces of all elements, and their pairs.
        solid_pairs: Pairs of solids [index] whose relative pose depends on q, shape (m, 2).
        solid_padding: Padding of each of those [m], shape (m,).
        solid_owner: For each of those the index in `pairs`, shape (m,).

    Raises:
        UnknownNameError: no such arm.
        InputError: a shape that cannot be made solid.
    """

    def __init__(self, scene: Scene, arms: Sequence[str] | None = None) -> None:
        self.model = SceneModel(scene, arms)
        self.layout = layout_of(self.model)
        self.solid_pairs: NDArray[np.int64] = self.layout.pairs.moving
        self.solid_owner: NDArray[np.int64] = self.layout.pairs.moving_owner
        self.solid_padding: Array = read_only(scene.checked_padding[self.solid_owner])

    def __repr__(self) -> str:
        return f"CollisionChecker({self.scene.name!r}, arms={list(self.arms)}, {len(self.pairs)} pairs)"

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickles as its scene and arms."""
        return CollisionChecker, (self.scene, self.arms)

    # ---- what it is about ----------------------------------------------------------------

    @property
    def scene(self) -> Scene:
        """The scene."""
        return self.model.scene

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """All pairs of elements that must not touch."""
        return self.scene.checked_pairs

    @property
    def solids(self) -> tuple[Solid, ...]:
        """The convex pieces of all elements."""
        return self.layout.solids

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

    @cached_property
    def resting_is_free(self) -> bool:
        """No two elements collide that do not move against each other."""
        return self._resting_clearance(_ROUNDING) >= _ROUNDING or not self._resting.touching

    @property
    def resting_contacts(self) -> tuple[tuple[str, str], ...]:
        """The pairs of elements that touch and do not move against each other."""
        return tuple(dict.fromkeys(self.pairs[owner] for owner, *_ in self._resting.touching))

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
        moving = self._placed(q)
        return self.resting_is_free and not moving.any_touches()

    def contacts(self, q: Any) -> tuple[Contact, ...]:
        """All pairs of elements that touch or are nearer than their padding, the deepest first.

        Args:
            q: Configuration [rad or m], shape (nq,).

        Raises:
            InputError: wrong shape or not finite.
        """
        moving = self._placed(q)
        touching = list(self._resting.touching)
        for i in moving.touching():
            distance, a, b = moving.distance(i)
            depth = max(0.0, float(self.solid_padding[i]) - distance)
            touching.append((int(self.solid_owner[i]), depth, 0.5 * (a + b)))
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
        distance, a, b = self._moving.distance(i)
        return Nearest(distance, self.pairs[self.solid_owner[i]], read_only(a), read_only(b))

    def clearance(self, q: Any, most: float = np.inf) -> float:
        """The least distance of any checked pair beyond its padding [m], `most` at most.

        Where elements overlap it is below zero, and no more than that. It comes from the compiled kernel, which can
        only understate a distance; Coal is not asked.

        Args:
            q: Configuration [rad or m], shape (nq,).
            most: What is more is not looked at [m].

        Raises:
            InputError: wrong shape or not finite, or elements that cannot be measured against each other.
        """
        q = self.checked(q)
        most = most if type(most) is float and most > 0.0 else finite_number("most", most)
        return self.exact_kernel.least_clearance(q, self._resting_clearance(most))

    # ---- for the motion checker -----------------------------------------------------------

    @cached_property
    def tables(self) -> ExactTables:
        """What the exact kernel knows of the pairs that move, with its scratch memory."""
        return build_tables(self)

    @cached_property
    def exact_kernel(self) -> ExactKernel:
        """The exact kernel of those pairs."""
        return ExactKernel(self.tables, self.nq)

    def solid_distances(self, q: Any, pairs: NDArray[np.intp] | None = None) -> Array:
        """Distance of every pair in `solid_pairs`, or of these of them [m], negative where they overlap, shape (m,).

        Raises:
            InputError: wrong shape or not finite, or no pairs of these numbers.
        """
        placed = self._placed(q)
        if pairs is None:
            return placed.distances()
        numbers = items_of("pairs", pairs, "numbers of pairs")
        for pair in numbers:
            whole_number("pair", pair, 0, len(self.solid_pairs) - 1)
        return np.array([placed.distance(int(i))[0] for i in numbers])

    def solid_distance(self, q: Any, pair: int) -> float:
        """Distance of one pair in `solid_pairs` [m], negative where they overlap.

        Raises:
            InputError: wrong shape or not finite, or no pair of that number.
        """
        whole_number("pair", pair, 0, len(self.solid_pairs) - 1)
        return self._placed(q).distance(pair)[0]

    def checked(self, q: Any) -> Array:
        """The configuration q as an array of finite numbers, shape (nq,).

        Raises:
            InputError: wrong shape or not finite.
        """
        if _is_plain(q, self.nq) and isfinite(q.dot(q)):
            return q
        return finite_array("q", q, (self.nq,))

    # ---- inside ---------------------------------------------------------------------------

    @cached_property
    def _moving(self) -> CoalPairs:
        return CoalPairs(self.model, self.solids, self.solid_pairs, self.solid_padding)

    def _placed(self, q: Any) -> CoalPairs:
        """Coal's view of the pairs that move, at q."""
        q = self.checked(q)
        self._moving.place(q)
        return self._moving

    def _resting_clearance(self, most: float) -> float:
        """The least distance beyond their padding of pairs that do not move against each other [m], `most` at most."""
        if len(self.layout.pairs.resting) == 0:
            return most
        tables = build_resting_tables(self)
        if tables is None:
            beyond = self._resting.distances - self.scene.checked_padding
            return min(most, float(beyond.min()))
        return ExactKernel(tables, self.nq).least_clearance(np.zeros(self.nq), most)

    @cached_property
    def _resting(self) -> Resting:
        index, owner = self.layout.pairs.resting, self.layout.pairs.resting_owner
        if len(index) == 0:
            return Resting(read_only(np.full(len(self.pairs), np.inf)))
        padding = self.scene.checked_padding[owner]
        things = CoalPairs(self.model, self.solids, index, padding)
        things.place(np.zeros(self.nq))
        return measure_resting(things, self.pairs, owner, padding)


def _is_plain(q: Any, length: int) -> TypeGuard[Array]:
    """A vector of this length as compiled kernels take it."""
    return type(q) is np.ndarray and q.dtype == np.float64 and q.shape == (length,) and bool(q.flags.c_contiguous)
