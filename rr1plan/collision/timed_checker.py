"""Edges in space and time: motions of some arms, certified among other arms that follow trajectories.

Pairs of the checker's arms and all stationary objects do not depend on time; `certify_edge.c` checks them. Pairs of
these arms and the other arms are certified in continuous time by `certify_timed.c`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from threading import RLock

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rr1plan.checks import FARTHEST, Array, Value, finite_number, known_name, of_kind, read_only
from rr1plan.collision.arm_geometry import ArmInstances
from rr1plan.collision.checker import CollisionChecker, shifted_polynomial
from rr1plan.collision.collision_geometry import geometries_of
from rr1plan.collision.edge_kernel import FREE
from rr1plan.collision.reach_broad_phase import ball_gaps, reach_balls
from rr1plan.collision.tables.exact_tables import exact_scratch, exact_struct
from rr1plan.collision.tables.timed_tables import TimedPairs, build_timed_pairs
from rr1plan.errors import InputError
from rr1plan.kernels.planner_kernels import CStruct, load_library
from rr1plan.object_cache import kept_in
from rr1plan.scene import Scene
from rr1plan.thread_locks import exclusive, per_process
from rr1plan.trajectory import Trajectory

_INTS = NDArray[np.int64]
# Slices of a motion: their duration [s], and their largest number.
_SLICE, _MOST_SLICES = 0.1, 256
# Number of lists of open pairs that fit into memory while intervals are halved.
_LISTS = 16
_LATEST = 1e9  # later times lose precision [s]


@dataclass(frozen=True, eq=False, repr=False)
class TimedContact(Value):
    """First contact of a motion.

    Args:
        time: The motion is certified free up to this time [s].
        q: The configuration of the checker's arms at that time, shape (nq,).
        pair: The elements that touch, or that are not proven collision-free.
    """

    time: float
    q: Array
    pair: tuple[str, str]


class TimedChecker:
    """Edges of a checker's arms in space and time, among other arms that follow trajectories.

    All pairs that involve the checker's arms are checked: among these arms, with stationary objects, and with the arms
    that have a trajectory; contacts of those arms with each other or with obstacles are not. Results are certified in
    continuous time, like those of `CollisionChecker.edge_is_free`: motions that pass at less than the checker's
    tolerance beyond the padding are rejected.

    Before its trajectory an arm rests at its start, and afterwards at its end. Times may be arbitrary, also negative.

    Scene, margin and tolerance are those of the checker at construction; later changes of the checker have no effect.
    Threads may share an instance, like a `CollisionChecker`: each waits while another one uses it.

    Args:
        checker: The arms that move along edges, and their scene.
        motions: Trajectories of other arms of the scene by name, each with exactly the joints of its arm. All other
            arms keep their configuration of the scene.

    Attributes:
        arms: The arms that move along edges.
        joint_names: Names of the columns of q.
        near_arms: Arms with a trajectory that the checker's arms can reach; the others are irrelevant.

    Raises:
        UnknownNameError: a trajectory of an arm that is not in the scene.
        InputError: a trajectory of an arm that moves along edges, or with the columns of another arm.
    """

    def __init__(self, checker: CollisionChecker, motions: Mapping[str, Trajectory]) -> None:
        of_kind("checker", checker, CollisionChecker)
        self._scene = scene = checker.scene
        self._motions = _checked_motions(scene, checker.arms, motions)
        self.arms, self.joint_names = checker.arms, checker.joint_names
        self._alone = CollisionChecker(
            _without(scene, tuple(self._motions)), self.arms, margin=checker.margin, tolerance=checker.tolerance
        )
        self.near_arms = _near_arms(scene, self.arms, tuple(self._motions), checker.omission_distance)

    def __repr__(self) -> str:
        return f"TimedChecker(arms={list(self.arms)}, among {list(self._motions)})"

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle the constructor arguments."""
        alone = self._alone
        return _rebuild, (self._scene, self.arms, alone.margin, alone.tolerance, self._motions)

    @property
    def motions(self) -> dict[str, Trajectory]:
        """The trajectories of the other arms."""
        return dict(self._motions)

    @cached_property
    def _pairs(self) -> _MovingPairs | None:
        """The pairs between the own arms and the others; None if there are none."""
        if not self.near_arms:
            return None
        alone, near = self._alone, {name: self._motions[name] for name in self.near_arms}
        arms = [*self.arms, *near]
        whole = CollisionChecker(self._scene, arms, margin=alone.margin, tolerance=alone.tolerance)
        return _MovingPairs(whole, self.arms, near)

    def edge_is_free(self, q_from: ArrayLike, q_to: ArrayLike, t_from: float, t_to: float) -> bool:
        """Whether the straight line from q_from at t_from to q_to at t_to, at constant speed, is free.

        Args:
            q_from: Start [rad or m], shape (nq,).
            q_to: End [rad or m], shape (nq,).
            t_from: Time at `q_from` [s].
            t_to: Time at `q_to` [s], not before `t_from`; equal to it only if both configurations are equal.

        Raises:
            InputError: wrong shape, not finite, or times in the wrong order.
        """
        q_from, q_to, t_from, t_to = self._checked_edge(q_from, q_to, t_from, t_to)
        if not self._alone.edge_is_free(q_from, q_to):
            return False
        pairs = self._pairs
        return pairs is None or pairs.is_free(*_line(q_from, q_to, t_from, t_to), t_from, t_to)

    def first_contact(self, q_from: ArrayLike, q_to: ArrayLike, t_from: float, t_to: float) -> TimedContact | None:
        """The first contact on an edge, or None if it is free.

        Args:
            q_from: As in `edge_is_free`.
            q_to: As in `edge_is_free`.
            t_from: As in `edge_is_free`.
            t_to: As in `edge_is_free`.

        Raises:
            InputError: wrong shape, not finite, or times in the wrong order.
        """
        q_from, q_to, t_from, t_to = self._checked_edge(q_from, q_to, t_from, t_to)
        found = self._alone.first_contact(q_from, q_to)
        still = None
        if found is not None:
            still = TimedContact(t_from + found.fraction * (t_to - t_from), found.q, found.pair)
        return self._first(_line(q_from, q_to, t_from, t_to), t_from, t_to, still)

    def trajectory_is_free(
        self, trajectory: Trajectory, t_from: float | None = None, t_to: float | None = None
    ) -> bool:
        """Whether every configuration of a trajectory of the checker's arms is free in an interval of time.

        Args:
            trajectory: A motion of these arms; constant before and after its time span.
            t_from: Start of the interval [s] (default: that of the trajectory).
            t_to: End of the interval [s] (default: that of the trajectory).

        Raises:
            InputError: a trajectory of other joints, times that are not finite, or in the wrong order.
        """
        motion, t_from, t_to = self._checked_motion(trajectory, t_from, t_to)
        for _, curve, duration in _pieces(*motion, t_from, t_to):
            if not self._alone.polynomial_is_free(curve, duration):
                return False
        return self._pairs is None or self._pairs.is_free(*motion, t_from, t_to)

    def first_contact_of(
        self, trajectory: Trajectory, t_from: float | None = None, t_to: float | None = None
    ) -> TimedContact | None:
        """The first contact on a trajectory, or None if it is free.

        Args:
            trajectory: As in `trajectory_is_free`.
            t_from: As in `trajectory_is_free`.
            t_to: As in `trajectory_is_free`.

        Raises:
            InputError: a trajectory of other joints, times that are not finite, or in the wrong order.
        """
        motion, t_from, t_to = self._checked_motion(trajectory, t_from, t_to)
        still = None
        for begin, curve, duration in _pieces(*motion, t_from, t_to):
            found = self._alone.first_contact_on(curve, duration)
            if found is not None:
                still = TimedContact(begin + found.fraction * duration, found.q, found.pair)
                break
        return self._first(motion, t_from, t_to, still)

    def _first(
        self, motion: tuple[Array, Array], t_from: float, t_to: float, still: TimedContact | None
    ) -> TimedContact | None:
        """The earlier of a contact with stationary objects and the first one with another arm."""
        if self._pairs is None:
            return still
        # Contacts later than `still` do not matter.
        found = self._pairs.first_contact(*motion, t_from, t_to if still is None else still.time)
        if found is None:
            return still
        time, pair = found
        return TimedContact(time, read_only(_position(*motion, time)), pair)

    def _checked_edge(
        self, q_from: ArrayLike, q_to: ArrayLike, t_from: float, t_to: float
    ) -> tuple[Array, Array, float, float]:
        q_from, q_to = self._alone.checked(q_from), self._alone.checked(q_to)
        t_from, t_to = _checked_times(t_from, t_to)
        if t_from == t_to and not np.array_equal(q_from, q_to):
            raise InputError(f"an edge from {t_from} s to {t_to} s between two configurations; give it time to move")
        return q_from, q_to, t_from, t_to

    def _checked_motion(
        self, trajectory: Trajectory, t_from: float | None, t_to: float | None
    ) -> tuple[tuple[Array, Array], float, float]:
        """Breaks and coefficients of a trajectory with columns in the checker's order, and an interval of time."""
        of_kind("trajectory", trajectory, Trajectory)
        motion = _in_order("the trajectory", trajectory, self.joint_names)
        begin = trajectory.start_time if t_from is None else t_from
        end = trajectory.end_time if t_to is None else t_to
        return motion, *_checked_times(begin, end)


def _rebuild(
    scene: Scene,
    arms: tuple[str, ...],
    margin: float,
    tolerance: float,
    motions: Mapping[str, Trajectory],
) -> TimedChecker:
    return TimedChecker(CollisionChecker(scene, arms, margin=margin, tolerance=tolerance), motions)


class _MovingPairs:
    """The pairs of bodies between own arms and others, and the motions of the others, for the kernel.

    Args:
        whole: A checker of all of these arms together.
        own: The own arms.
        motions: Trajectories of the others.
    """

    def __init__(self, whole: CollisionChecker, own: Sequence[str], motions: Mapping[str, Trajectory]) -> None:
        self._whole = whole
        names, instances = whole.arms, whole.geometry.instances
        is_own = np.array([name in own for name in names], np.bool_)
        pairs = _all_pairs(whole, _arm_of_body(instances, len(whole.solids)), is_own)
        self._owner = pairs.owner
        self._arms, breaks, coefficients, slices = _arm_rows(whole, is_own, motions)
        self._own = np.flatnonzero(is_own)
        own_terms = max(2, *(len(t.coefficients[0]) for t in motions.values()))
        exact = exact_struct(pairs.tables, whole.nq)
        self._scene = CStruct(
            "TimedScene",
            exact=exact,
            arms=self._arms,
            arm_count=len(names),
            pairs=pairs.rows,
            first_root=len(pairs.owner),
            arm_of_body=pairs.arm_of_body,
            first_box=pairs.first_box,
            breaks=breaks,
            coefficients=coefficients,
            slices=np.zeros((max(1, slices), 6)),
            tolerance=whole.tolerance,
        )
        self._exact = exact_scratch(pairs.tables, whole.nq, own_terms)
        self._scratch = CStruct(
            "TimedScratch",
            exact=self._exact,
            placed_arm=np.zeros(len(names), np.int64),
            open=np.empty(_LISTS * len(pairs.rows) + 1, np.int64),
            open_size=_LISTS * len(pairs.rows) + 1,
        )
        self._lock = per_process(self, "_lock", RLock)
        self._library = load_library()
        self._library.rr1_sweep_timed_arms(self._scene, self._scratch)

    @exclusive
    def is_free(self, breaks: Array, coefficients: Array, t_from: float, t_to: float) -> bool:
        """Whether the motion is free in the interval of time.

        Args:
            breaks: Times [s], shape (m + 1,).
            coefficients: Coefficients of the own arms, shape (m, k, nq).
            t_from: Start of the interval [s].
            t_to: End of the interval [s].
        """
        return self._certify(breaks, coefficients, t_from, t_to, find_first=False) == FREE

    @exclusive
    def first_contact(
        self, breaks: Array, coefficients: Array, t_from: float, t_to: float
    ) -> tuple[float, tuple[str, str]] | None:
        """The time until which the motion is free [s] and the pair in contact then; None if all of it is free."""
        if self._certify(breaks, coefficients, t_from, t_to, find_first=True) == FREE:
            return None
        result = self._scratch.value.result
        pair = int(result.pair)
        if pair >= len(self._owner):  # two boxes of bodies: the first pair of bodies in them
            pair = int(self._scene.part("pairs")[pair, 2])
        return max(t_from, float(result.free_until)), self._whole.pairs[self._owner[pair]]

    def _certify(self, breaks: Array, coefficients: Array, t_from: float, t_to: float, *, find_first: bool) -> int:
        terms, stride = coefficients.shape[1:]
        if terms * self._whole.nq > self._exact.part("coefficients").size:
            self._exact.set(coefficients=np.zeros(terms * self._whole.nq))
        self._arms[self._own, 6], self._arms[self._own, 7] = len(coefficients), terms
        self._arms[self._own, 9] = stride
        self._scene.set(own_breaks=breaks, own_coefficients=coefficients)
        status: int = self._library.rr1_certify_timed(self._scene, self._scratch, t_from, t_to, int(find_first))
        return status


def _arm_of_body(instances: ArmInstances, count: int) -> _INTS:
    """The arm index of each body, -1 for obstacles, shape (count,)."""
    arms = np.full(count, -1, np.int64)
    sizes = [len(geometry.solids) for geometry in instances.geometries]
    arms[: sum(sizes)] = np.repeat(np.arange(len(sizes)), sizes)
    return arms


def _all_pairs(whole: CollisionChecker, arms: _INTS, is_own: NDArray[np.bool_]) -> TimedPairs:
    """The pairs between own arms and others, including bodies that no joint moves; owners index `whole.pairs`."""
    pairs = whole.pair_tables
    rows = np.concatenate([pairs.moving_rows, pairs.static_rows])
    owner = np.concatenate([pairs.moving_owner, pairs.static_owner])
    padding = np.concatenate([whole.solid_padding, whole.padding[pairs.static_owner]])
    found = build_timed_pairs(whole.tables, rows, padding, arms, is_own)
    return found._replace(owner=owner[found.owner])


def _arm_rows(
    whole: CollisionChecker, is_own: NDArray[np.bool_], motions: Mapping[str, Trajectory]
) -> tuple[_INTS, Array, Array, int]:
    """The kernel's `TimedArm` rows, breaks and coefficients of all motions one after the other, and all slices."""
    instances = whole.geometry.instances
    joints = [*instances.first_joint.tolist(), len(whole.tables.joints) - 1]
    columns = [*instances.first_column.tolist(), whole.nq]
    rows = np.zeros((len(whole.arms), 12), np.int64)
    breaks: list[Array] = [np.zeros(0)]
    coefficients: list[Array] = [np.zeros(0)]
    first_break = first_coefficient = own_columns = slices = 0
    for i, name in enumerate(whole.arms):
        count = columns[i + 1] - columns[i]
        rows[i, :5] = joints[i] + 1, joints[i + 1] + 1, columns[i], count, is_own[i]
        if is_own[i]:
            rows[i, 8] = own_columns
            own_columns += count
            continue
        times, pieces = _in_order(
            f"the trajectory of {name!r}", motions[name], whole.joint_names[columns[i] : columns[i + 1]]
        )
        number = int(np.clip(np.ceil((times[-1] - times[0]) / _SLICE), 1, _MOST_SLICES))
        rows[i, 5:] = first_break, len(pieces), pieces.shape[1], first_coefficient, count, slices, number
        breaks.append(times)
        coefficients.append(pieces.ravel())
        first_break, first_coefficient = first_break + len(times), first_coefficient + pieces.size
        slices += number
    return rows, np.concatenate(breaks), np.concatenate(coefficients), slices


def _near_arms(scene: Scene, arms: tuple[str, ...], others: tuple[str, ...], distance: float) -> tuple[str, ...]:
    """The other arms that can come within a distance of the arms in any configuration."""
    geometries = geometries_of(scene)
    gaps = ball_gaps(reach_balls(scene, geometries, arms), reach_balls(scene, geometries, others))
    is_near: NDArray[np.bool_] = np.any(gaps <= distance, axis=0)
    return tuple(name for name, near in zip(others, is_near.tolist(), strict=True) if near)


def _without(scene: Scene, arms: tuple[str, ...]) -> Scene:
    """The scene without some arms, kept so that its tables are made once."""

    def remove() -> Scene:
        rest = scene
        for name in arms:
            rest = rest.without_arm(name)
        return rest

    return kept_in(scene.kept, ("without arms", frozenset(arms)), remove) if arms else scene


# ---- motions ---------------------------------------------------------------------------------------


def _checked_motions(scene: Scene, arms: tuple[str, ...], motions: Mapping[str, Trajectory]) -> dict[str, Trajectory]:
    of_kind("motions", motions, Mapping)
    checked = {}
    for name, motion in motions.items():
        known_name("arm", name, scene.arms)
        if name in arms:
            raise InputError(f"{name!r} moves along the edges of this checker; give trajectories of other arms only")
        of_kind(f"the motion of {name!r}", motion, Trajectory)
        _in_order(f"the trajectory of {name!r}", motion, scene.joint_names([name]))
        checked[name] = motion
    return checked


def _in_order(what: str, trajectory: Trajectory, joints: tuple[str, ...]) -> tuple[Array, Array]:
    """Breaks, at least two, and coefficients of a trajectory with columns in the order of these joints."""
    if sorted(trajectory.joint_names) != sorted(joints):
        raise InputError(
            f"{what} has the joints {', '.join(trajectory.joint_names)}, expected {', '.join(joints)}; "
            "`Trajectory.select` gives the columns of one arm"
        )
    breaks, coefficients = trajectory.breaks, trajectory.coefficients
    _checked_times(float(breaks[0]), float(breaks[-1]))
    if trajectory.joint_names != joints:
        coefficients = coefficients[:, :, [trajectory.joint_names.index(name) for name in joints]]
    local = np.diff(breaks)[:, None, None] if len(breaks) > 1 else np.zeros((1, 1, 1))
    with np.errstate(over="ignore", invalid="ignore"):
        reach = (np.abs(coefficients) * local ** np.arange(coefficients.shape[1])[None, :, None]).sum(axis=1)
    if not (reach <= FARTHEST).all():
        raise InputError(f"{what} may reach {reach.max():.6g}, expected at most {FARTHEST:g}")
    if len(breaks) == 1:
        breaks = np.repeat(breaks, 2)
    return breaks, np.ascontiguousarray(coefficients)


def _checked_times(begin: float, end: float) -> tuple[float, float]:
    begin, end = finite_number("t_from", begin), finite_number("t_to", end)
    if end < begin:
        raise InputError(f"t_to = {end} s is before t_from = {begin} s")
    if max(abs(begin), abs(end)) > _LATEST:
        raise InputError(f"times from {begin} s to {end} s, expected at most {_LATEST:g}")
    return begin, end


def _line(q_from: Array, q_to: Array, t_from: float, t_to: float) -> tuple[Array, Array]:
    """An edge as breaks and coefficients of a motion."""
    duration = t_to - t_from
    rate = (q_to - q_from) / duration if duration > 0.0 else np.zeros_like(q_from)
    return np.array([t_from, t_to]), np.array([[q_from, rate]])


def _pieces(breaks: Array, coefficients: Array, t_from: float, t_to: float) -> Iterator[tuple[float, Array, float]]:
    """Begin, coefficients (k + 1, nq) and duration of the parts of a motion in an interval of time, rest included."""
    begin, end = (float(np.clip(t, breaks[0], breaks[-1])) for t in (t_from, t_to))
    count = 0
    if t_from < breaks[0]:
        # At rest before the motion: one configuration for all of it, at the beginning of the interval.
        count = 1
        yield t_from, _position(breaks, coefficients, t_from)[None], 0.0
    for (low, high), curve in zip(pairwise(breaks.tolist()), coefficients, strict=True):
        first, last = max(low, begin), min(high, end)
        if last > first:
            count += 1
            yield (first, shifted_polynomial(curve, first - low), last - first)
    if count == 0:
        # At rest at the end throughout, or a single instant.
        yield t_from, _position(breaks, coefficients, t_from)[None], 0.0


def _position(breaks: Array, coefficients: Array, time: float) -> Array:
    """Configuration of a motion at a time, shape (nq,)."""
    time = float(np.clip(time, breaks[0], breaks[-1]))
    i = int(np.clip(np.searchsorted(breaks, time, side="right") - 1, 0, len(coefficients) - 1))
    return np.asarray(shifted_polynomial(coefficients[i], time - float(breaks[i]))[0])
