"""The collision checker: configurations, and motions that are certified free as a whole, not sampled.

The proof is in the kernels: straight edges and parabolas in `certify_edge.c`, other curves in `certify_curve.c`. A thin
obstacle cannot slip through between samples. Motions that pass at less than `tolerance` beyond the padding are not
proven, so they are rejected.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rr1plan.binding.memory_image import Root
from rr1plan.checks import (
    FARTHEST,
    Array,
    Value,
    finite_array,
    finite_number,
    is_plain,
    known_name,
    near_array,
    number_from_zero,
    of_kind,
    positive_number,
    read_only,
)
from rr1plan.collision.coal_checker import CoalChecker
from rr1plan.collision.collision_geometry import CollisionGeometry, collision_geometry, geometry_distance
from rr1plan.collision.edge_kernel import CONTACT, FREE, EdgeCounters, EdgeKernel, EdgeResult, ExactKernel
from rr1plan.collision.reach_broad_phase import FEW_OBSTACLES
from rr1plan.collision.tables.edge_tables import build_edge_tables, padded_pairs
from rr1plan.errors import InputError
from rr1plan.path import Path
from rr1plan.scene import Scene
from rr1plan.scene.scene_differences import check_same_scene
from rr1plan.thread_locks import ExclusiveCache, exclusive
from rr1plan.transforms import as_pose

TOLERANCE = 1e-6
_PRECISION = 1e-9  # of the fraction of an edge at its first contact
_BLOCK = 4096  # edges of a call of a kernel
_FEW_TERMS = 64  # of a curve that is checked quickly


@dataclass(frozen=True, eq=False, repr=False)
class FirstContact(Value):
    """First contact on an edge.

    Args:
        fraction: The edge is certified free up to this fraction of it, 0..1.
        q: The configuration there, free unless the edge begins in contact; shape (nq,).
        pair: The elements in contact.
    """

    fraction: float
    q: Array
    pair: tuple[str, str]


class CollisionChecker(CoalChecker):
    """Contacts and distances of a scene's elements at configurations, and proofs that edges and curves are free.

    An edge is the straight line between two configurations; it is certified as a whole. Joint limits are checked
    separately (`limit_violations`), and an edge does not take the shorter way round of a continuous joint.

    Threads may share an instance: each waits while another one uses it. For parallel checks, give each thread its own
    instance (instances are pickled as their constructor arguments).

    Args:
        scene: The scene.
        arms: The arms that move (default: all); the others keep their configuration of the scene.
        margin: Distance to keep beyond the scene's padding between elements that move relative to each other [m].
        tolerance: Motions that pass at less than this distance beyond padding and margin are rejected [m].

    Attributes:
        edges_checked: Edges and curves checked so far.

    Raises:
        UnknownNameError: no such arm.
        InputError: not a scene, one that cannot be checked, a negative margin, or a tolerance that is not positive.
    """

    def __init__(
        self,
        scene: Scene,
        arms: Sequence[str] | None = None,
        *,
        margin: float = 0.0,
        tolerance: float = TOLERANCE,
    ) -> None:
        super().__init__(scene, arms, margin=margin)
        self.tolerance = positive_number("tolerance", tolerance)
        self._without: dict[frozenset[str], ExactKernel] = {}
        self.edges_checked = 0

    def __repr__(self) -> str:
        return f"CollisionChecker({self.scene.name!r}, arms={list(self.arms)}, {len(self.pairs)} pairs)"

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle the constructor arguments; the counters start at zero."""
        return _rebuild, (self.scene, self.arms, self.margin, self.tolerance)

    @property
    def counters(self) -> EdgeCounters:
        """Counters of the work so far, including that of compiled planners."""
        return self._kernel.counters

    @exclusive
    def keep_margin(self, margin: float) -> None:
        """Change the margin in place, which keeps the tables.

        Args:
            margin: Distance to keep beyond the scene's padding [m].

        Raises:
            InputError: a negative margin, or one so different that the set of nearby elements changes.
        """
        margin = number_from_zero("margin", margin)
        if margin == self.margin:
            return
        if geometry_distance(self._scene, margin) != self.omission_distance:
            raise InputError(f"a margin of {margin:g} m needs another checker than one of {self.margin:g} m; make one")
        self._keep_margin(margin)
        self._without.clear()
        if "_kernel" in self.__dict__:
            kernel = self._kernel
            kernel.use_padding(padded_pairs(self.geometry, self.solid_padding, self.tolerance, kernel.rest))

    @exclusive
    def move_obstacle(self, name: str, pose: ArrayLike) -> None:
        """Move an obstacle in place: only its rows of the collision tables are rewritten.

        Results equal those of a new checker of the changed scene. In scenes of more than 64 obstacles, where obstacles
        out of reach may be omitted, all tables are rebuilt.

        Args:
            name: The obstacle.
            pose: T_world_object: (4, 4), or a position (3,) [m].

        Raises:
            UnknownNameError: no such obstacle.
            InputError: not a pose.
        """
        known_name("obstacle", name, self._scene.obstacles)
        T = as_pose(pose)
        if len(self._scene.obstacles) > FEW_OBSTACLES:
            self._begin_anew(self.scene.with_obstacle_at(name, T))
            return
        self._kernel.move_object(self.object_numbers[name], T)
        self._moved[name] = T
        self._geometry = None
        self._obstacles_moved()

    @exclusive
    def change_to(self, geometry: CollisionGeometry, scene: Scene) -> bool:
        """Switch to another scene in place: rewrite only the rows of solids that do not move.

        Args:
            geometry: The geometry of that scene.
            scene: The scene.

        Returns:
            Whether that was possible, which requires the same pairs of solids, padding and kinds of obstacles.
            Otherwise nothing has changed.
        """
        mine = self._scene
        same_padding = (scene.padding, scene.pair_padding) == (mine.padding, mine.pair_padding)
        same_tables = (
            geometry.pairs is self.pair_tables and geometry.distance == self.omission_distance and self.is_warm
        )
        if not (same_tables and same_padding and self.fixed.fit(geometry.obstacles)):
            return False
        self.fixed.replace(geometry.obstacles, self._kernel.context)
        self._scene, self._geometry = scene, geometry
        self._moved.clear()
        self._obstacles_moved()
        return True

    def _obstacles_moved(self) -> None:
        """Update the data for the current poses that the edge kernel does not read."""
        super()._obstacles_moved()
        tables = self.tables
        self.fixed.place_bodies(tables.body_values, tables.poses, tables.centers)
        self._without.clear()

    def complete(self) -> CollisionChecker:
        """A checker of the same scene and arms that omits nothing, so that pages can move all obstacles."""
        other = CollisionChecker(self.scene, self.arms, margin=self.margin, tolerance=self.tolerance)
        other._use(collision_geometry(other.scene, other.arms, np.inf), other.margin)
        return other

    @ExclusiveCache
    def object_numbers(self) -> Mapping[str, int]:
        """The object index of each obstacle for `rr1_move_objects`, which pages call.

        Empty above 64 obstacles, where some may be omitted, unless the checker is `complete`. The kernel updates pairs
        that involve a moving arm; it does not check contacts with stationary arms.
        """
        complete = len(self._scene.obstacles) <= FEW_OBSTACLES or self.omission_distance == np.inf
        names = self._scene.obstacles if complete else ()
        first = len(self.arms) + len(self.geometry.obstacles.counts) - len(names)
        return {name: first + i for i, name in enumerate(names)}

    def _begin_anew(self, scene: Scene) -> None:
        """Rebuild the checker for another scene; only its lock and `edges_checked` are kept."""
        anew = CollisionChecker(scene, self.arms, margin=self.margin, tolerance=self.tolerance)
        self.__dict__ = vars(anew) | {"_lock": self._lock, "edges_checked": self.edges_checked}

    def warm_up(self) -> None:
        """Build the collision tables that the first query needs."""
        _ = self._kernel, self.static_is_free

    @property
    def is_warm(self) -> bool:
        """Whether the collision tables have been built."""
        return "_kernel" in self.__dict__

    def run_edge_kernel(self, kernel: Callable[..., int], *given: Any) -> int:
        """Call a compiled planner; its last arguments are the addresses of tables and scratch memory.

        Args:
            kernel: The planner, a function of the library.
            *given: Its other arguments.
        """
        with self._lock:
            return kernel(*given, *self._kernel.context)

    @exclusive
    def memory_image(self, **roots: Root) -> bytes:
        """The collision tables and new scratch memory for `core.wasm`, with which pages certify edges.

        Equal scenes have equal images. `rr1plan/kernels/core.js` loads an image into memory. Its names are `scene` and
        `scratch`; `padding` and `bare_padding`, the distances to keep between pairs of solids with and without the
        margin [m]; and `pair_owner`, the index in `pairs` of each pair of solids.

        Args:
            **roots: Further structs and arrays for the image, by name.

        Raises:
            InputError: two elements that do not move are in contact, which no kernel checks.
        """
        if not self.static_is_free:
            raise InputError(f"no edge is free: {' and '.join(self._names(-1))} are in contact, and neither moves")
        return self._make_kernel(ExactKernel(self.tables, self.nq)).memory_image(
            padding=("double", self.tables.padding),
            bare_padding=("double", self._bare_padding),
            pair_owner=("int64_t", self.solid_owner),
            **roots,
        )

    @ExclusiveCache
    def _kernel(self) -> EdgeKernel:
        return self._make_kernel(self.exact_kernel)

    def _make_kernel(self, exact: ExactKernel) -> EdgeKernel:
        tables = build_edge_tables(self.geometry, self.fixed, self.tables.padding, self.tolerance)
        return EdgeKernel(tables, exact, self.nq, fixed=self.fixed.struct)

    def is_free(self, q: ArrayLike) -> bool:
        """Whether all checked pairs keep their padding at a configuration; Coal decides the few that kernels do not.

        Args:
            q: Configuration [rad or m], shape (nq,).

        Raises:
            InputError: wrong shape, not finite or beyond ±1e4.
        """
        q = self.checked(q)
        with self._lock:
            status = self._certify(q, q)[0]
            return status == FREE or (status != CONTACT and self.is_free_slowly(q))

    def are_free(self, q: ArrayLike) -> NDArray[np.bool_]:
        """Whether all checked pairs keep their padding, at each of many configurations; see `is_free`.

        Args:
            q: Configurations [rad or m], shape (n, nq).

        Returns:
            Booleans, shape (n,).

        Raises:
            InputError: wrong shape, not finite or beyond ±1e4.
        """
        q = near_array("q", q, (None, self.nq))
        statuses = self._certify_many(q, q)
        free: NDArray[np.bool_] = statuses == FREE
        for i in np.flatnonzero(~free & (statuses != CONTACT)):
            free[i] = self.is_free_slowly(q[i])
        return free

    @exclusive
    def is_free_ignoring(self, q: ArrayLike, arms: frozenset[str]) -> bool:
        """Whether motions may start at a configuration if pairs that involve some arms are ignored.

        All other pairs keep their padding and the part of a gap that remains in every proof, about `tolerance`.

        Args:
            q: Configuration [rad or m], shape (nq,).
            arms: Arms whose pairs are ignored.

        Raises:
            InputError: wrong shape, not finite or beyond ±1e4, or elements whose distance cannot be measured.
        """
        q = self.checked(q)
        of_kind("arms", arms, frozenset)
        if self._certify(q, q)[0] == FREE:
            return True
        rest = self._kernel.rest
        return self.static_is_free and self._kernel_without(arms).least_clearance(q, rest) >= rest

    def _kernel_without(self, arms: frozenset[str]) -> ExactKernel:
        """The exact kernel for the pairs that involve none of these arms."""
        if arms not in self._without:
            owner = self.scene.owner
            counts = np.array([owner(a) not in arms and owner(b) not in arms for a, b in self.pairs], np.bool_)
            chosen = counts[self.solid_owner]
            tables = self.tables
            tables = tables._replace(pairs=tables.pairs[chosen], padding=tables.padding[chosen])
            self._without[arms] = self.exact_kernel.of_pairs(tables)
        return self._without[arms]

    def edge_is_free(self, q0: ArrayLike, q1: ArrayLike) -> bool:
        """Whether every configuration on the straight line from q0 to q1 is free.

        Args:
            q0: Start [rad or m], shape (nq,).
            q1: End [rad or m], shape (nq,).

        Raises:
            InputError: wrong shape, not finite or beyond ±1e4.
        """
        q0, q1 = self.checked(q0), self.checked(q1)
        with self._lock:
            self.edges_checked += 1
            return self._certify(q0, q1)[0] == FREE

    def edges_are_free(self, q0: ArrayLike, q1: ArrayLike) -> NDArray[np.bool_]:
        """Whether every configuration on each of many straight lines is free; see `edge_is_free`.

        Args:
            q0: Starts [rad or m], shape (n, nq).
            q1: Ends [rad or m], shape (n, nq).

        Returns:
            Booleans, shape (n,).

        Raises:
            InputError: wrong shapes, not finite or beyond ±1e4.
        """
        q0 = near_array("q0", q0, (None, self.nq))
        q1 = near_array("q1", q1, q0.shape)
        free: NDArray[np.bool_] = self._certify_many(q0, q1) == FREE
        self.edges_checked += len(free)
        return free

    @exclusive
    def edge_is_free_slowly(self, q0: ArrayLike, q1: ArrayLike) -> bool:
        """Like `edge_is_free`, by the exact kernel alone; the reference in tests.

        Args:
            q0: Start [rad or m], shape (nq,).
            q1: End [rad or m], shape (nq,).

        Raises:
            InputError: wrong shape, not finite or beyond ±1e4.
        """
        q0, q1 = self.checked(q0), self.checked(q1)
        return self._certify_exactly(np.array([q0, q1 - q0]), 1.0)[0] == FREE

    @exclusive
    def path_is_free(self, waypoints: Path | ArrayLike) -> bool:
        """Whether every edge between consecutive waypoints is free; a single waypoint is an edge of length zero.

        Args:
            waypoints: A `Path` of the moving arms, or configurations [rad or m], shape (n, nq).

        Raises:
            InputError: wrong shape, no waypoint, not finite or beyond ±1e4, or a path of other joints.
        """
        if isinstance(waypoints, Path):
            waypoints = self._in_order(waypoints)
        points = near_array("waypoints", waypoints, (None, self.nq))
        if len(points) == 0:
            raise InputError("a path has at least one waypoint, got none")
        if not self.static_is_free:
            return False
        edges = max(1, len(points) - 1)
        free = self._kernel.certify_path(points if len(points) > 1 else np.repeat(points, 2, axis=0))
        self.edges_checked += min(free + 1, edges)
        return free == edges

    def _in_order(self, path: Path) -> Array:
        """The waypoints of a path, columns in the checker's order."""
        names = self.joint_names
        if sorted(path.joint_names) != sorted(names):
            raise InputError(f"the path's joints are {', '.join(path.joint_names)}, expected {', '.join(names)}")
        return path.waypoints[:, [path.joint_names.index(name) for name in names]]

    def polynomial_is_free(self, coefficients: ArrayLike, duration: float) -> bool:
        """Whether every configuration on the curve q(t) = sum_k c_k t^k, 0 <= t <= duration, is free.

        Args:
            coefficients: c_k [rad/s^k or m/s^k], shape (k + 1, nq).
            duration: End of the curve [s], >= 0.

        Raises:
            InputError: wrong shape, no coefficient, not finite, or a negative duration.
        """
        curve, duration = self._checked_curve(coefficients, duration)
        with self._lock:
            if len(curve) > 3:
                return self._certify_exactly(curve, duration)[0] == FREE
            self.edges_checked += 1
            return self.static_is_free and self._kernel.certify_parabola(curve, duration)[0] == FREE

    @exclusive
    def first_contact(self, q0: ArrayLike, q1: ArrayLike, *, precision: float = _PRECISION) -> FirstContact | None:
        """The first contact on the straight line from q0 to q1, or None if it is free.

        Args:
            q0: Start [rad or m], shape (nq,).
            q1: End [rad or m], shape (nq,).
            precision: How much later than `fraction` the contact may be, as a fraction of the line.

        Raises:
            InputError: wrong shape, not finite or beyond ±1e4.
        """
        q0, q1 = self.checked(q0), self.checked(q1)
        return self._first_contact(np.array([q0, q1 - q0]), 1.0, positive_number("precision", precision))

    @exclusive
    def first_contact_on(self, coefficients: ArrayLike, duration: float) -> FirstContact | None:
        """The first contact on the curve q(t) = sum_k c_k t^k, 0 <= t <= duration, or None if it is free.

        Args:
            coefficients: c_k [rad/s^k or m/s^k], shape (k + 1, nq).
            duration: End of the curve [s], >= 0.

        Raises:
            InputError: wrong shape, no coefficient, not finite, or a negative duration.
        """
        return self._first_contact(*self._checked_curve(coefficients, duration), _PRECISION)

    def _first_contact(self, curve: Array, duration: float, precision: float) -> FirstContact | None:
        status, _, pair = self._certify_exactly(curve, duration)
        if status == FREE:
            return None
        free, blocked = 0.0, 1.0
        while blocked - free > precision:
            middle = 0.5 * (free + blocked)
            part, end = (shifted_polynomial(curve, fraction * duration) for fraction in (free, middle))
            status, _, found = self._certify_exactly(part, (middle - free) * duration)
            if status == FREE:
                # Proofs of motions allow smaller gaps at their ends than those of configurations.
                status, _, found = self._certify_exactly(end[:1], 0.0)
            if status == FREE:
                free = middle
            else:
                blocked, pair = middle, found
        return FirstContact(free, read_only(shifted_polynomial(curve, free * duration)[0]), self._names(pair))

    def _checked_curve(self, coefficients: ArrayLike, duration: float) -> tuple[Array, float]:
        terms = getattr(coefficients, "shape", ())[:1]
        if is_plain(coefficients, (*terms, self.nq)) and terms != (0,) and type(duration) is float:
            count = len(coefficients)
            # NaN and infinity fail these comparisons; powers of other durations do not overflow.
            quick = 0.0 <= duration <= FARTHEST and count <= _FEW_TERMS
            if quick and np.abs(coefficients).max() * count * max(1.0, duration) ** (count - 1) <= FARTHEST:
                return coefficients, duration
        curve = finite_array("coefficients", coefficients, (None, self.nq))
        duration = finite_number("duration", duration)
        if len(curve) == 0 or duration < 0.0:
            raise InputError(f"a curve of {len(curve)} coefficients and duration {duration}, expected >= 1 and >= 0")
        _check_reach(curve, duration)
        return curve, duration

    def _certify(self, q0: Array, q1: Array) -> EdgeResult:
        """Status, fraction (0..1) and pair of solids (-1: a stationary one) of an edge whose shape was checked."""
        if not self.static_is_free:
            return CONTACT, 0.0, -1
        return self._kernel.certify_edge(q0, q1)

    def _certify_many(self, q0: Array, q1: Array) -> NDArray[np.int64]:
        """The statuses of edges between the rows of two arrays (n, nq), shape (n,)."""
        statuses = np.full(len(q0), CONTACT, np.int64)
        # In blocks, between which other threads have their turn and Ctrl-C takes effect.
        for first in range(0, len(q0), _BLOCK):
            block = slice(first, first + _BLOCK)
            with self._lock:
                if self.static_is_free:
                    statuses[block] = self._kernel.certify_edges(q0[block], q1[block])
        return statuses

    def _certify_exactly(self, curve: Array, duration: float) -> EdgeResult:
        """Likewise for a curve, by the exact kernel alone."""
        self.edges_checked += 1
        if not self.static_is_free:
            return CONTACT, 0.0, -1
        return self._kernel.certify_curve(curve, duration)

    def _names(self, pair: int) -> tuple[str, str]:
        if pair < 0:
            return self.static_contacts[0]
        # Not through `pairs`, whose names take 10 ms for 16 arms.
        rules = self.geometry.rules
        i, j = rules.checked[self.solid_owner[pair]].tolist()
        return rules.names[i], rules.names[j]


def _check_reach(curve: Array, duration: float) -> None:
    """Reject a curve that may leave the range in which distances are precise."""
    with np.errstate(over="ignore", invalid="ignore"):
        reach = np.abs(curve[0])
        for k in range(1, len(curve)):
            reach = reach + np.abs(curve[k]) * np.float64(duration) ** k
    if not (reach <= FARTHEST).all():
        raise InputError(f"a curve that may reach {reach.max():.6g} at {duration} s, expected at most {FARTHEST:g}")


def check_fits(checker: CollisionChecker, path: Path, scene: Scene) -> None:
    """Require that a checker is one of the joints of a path, in their order, and of a scene.

    Args:
        checker: The checker.
        path: The path.
        scene: The scene; the configurations of the path's arms in it do not matter.

    Raises:
        InputError: it is not; the message says what differs.
    """
    if path.joint_names != checker.joint_names:
        raise InputError(
            f"the path has joints {', '.join(path.joint_names)}, "
            f"the checker has {', '.join(checker.joint_names)}; expected the same"
        )
    check_same_scene("the checker", checker.scene, scene, checker.arms, "make one with CollisionChecker(scene, arms)")


def _rebuild(scene: Scene, arms: tuple[str, ...], margin: float, tolerance: float) -> CollisionChecker:
    return CollisionChecker(scene, arms, margin=margin, tolerance=tolerance)


def shifted_polynomial(coefficients: Array, shift: float | Array) -> Array:
    """The coefficients of p(shift + t), shape (..., k + 1, nq) like those of p; shifts of several have shape (m, 1)."""
    shifted, terms = coefficients.copy(), coefficients.shape[-2]
    for first in range(terms - 1):
        for k in range(terms - 2, first - 1, -1):
            shifted[..., k, :] += shift * shifted[..., k + 1, :]
    return shifted
