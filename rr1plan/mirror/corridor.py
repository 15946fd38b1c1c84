"""The certified corridor of a motion: configurations around it that are proven free of collision.

A joint that turns by an angle moves no point of a body farther than the angle times the lever, the largest distance
that the body can have from the joint's axis. A configuration q' is therefore free of collision if for each pair of
bodies

    sum of lever_j |q'_j - q_j| over the joints j that move the pair relative to each other < distance of the pair at q.

The corridor is the union of these neighborhoods of samples q of the motion, with distances computed by Coal.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array

from rr1plan.checks import Array, Value, counted, near_array, number_from_zero, of_kind, read_only, shape_of
from rr1plan.collision import CollisionChecker
from rr1plan.errors import InputError
from rr1plan.model.joint_turns import difference, rotary
from rr1plan.scene import Scene
from rr1plan.trajectory import Trajectory

# Samples are so dense that each one uses at most this share of the distances at the previous one ...
_OVERLAP = 0.5
# ... at time intervals between these bounds [s].
_LONGEST, _SHORTEST = 0.05, 0.001
# Largest number of distances in a corridor, 160 MB.
_MOST_DISTANCES = 20_000_000
# Error of a distance [m].
_ACCURACY = 1e-5
# Number of nearest samples that are compared in full.
_NEAREST = 24
# Number of pairs that decide whether a sample is compared in full.
_CRITICAL = 64


class CorridorPosition(NamedTuple):
    """The position of a configuration in a corridor.

    Args:
        use: Used share of the certified distances; below 1 the configuration is proven free of collision.
        time: Time of the sample of the motion with this share [s].
        pair: The two elements with this share; empty if no pair can touch, so that all configurations are free.
    """

    use: float
    time: float
    pair: tuple[str, ...]


@dataclass(frozen=True, eq=False, repr=False)
class Corridor(Value):
    """Configurations around a motion that are proven free of collision; `certified_corridor` computes it.

    The proof holds for the scene as given: bodies as described, other arms and obstacles at their poses.

    Args:
        joint_names: Columns, "arm/joint".
        times: Times of the samples [s], shape (k,).
        configurations: The motion at these times [rad or m], shape (k, nq).
        distances: Distances of all pairs of bodies there [m], shape (k, p).
        levers: Largest relative displacement of each pair per change of each joint [m/rad], shape (p, nq).
        pairs: The elements of each pair.
        rotary: Joints for which a whole turn is the identity, shape (nq,).
    """

    joint_names: tuple[str, ...]
    times: Array
    configurations: Array
    distances: Array
    levers: Array
    pairs: tuple[tuple[str, str], ...]
    rotary: NDArray[np.bool_]

    def __repr__(self) -> str:
        free = self.free_change()
        name = self.joint_names[int(np.argmin(free))]
        return f"Corridor({counted(len(self.times), 'sample')}, at least {free.min():.3g} rad or m for {name!r})"

    def free_change(self) -> Array:
        """Largest deviation of each single joint that is free everywhere on the motion [rad or m], shape (nq,)."""
        with np.errstate(divide="ignore"):
            each = self.distances.min(axis=0)[:, None] / self.levers
        return np.asarray(each.min(axis=0, initial=np.inf))

    def deviation(self, q: ArrayLike, planned: ArrayLike) -> Array:
        """Configurations minus planned ones, without whole turns of joints.

        Args:
            q: Configurations [rad or m], shape (nq,) or (n, nq), columns as in `joint_names`.
            planned: Planned configurations, of the same shape.

        Raises:
            InputError: wrong shapes, not finite or too large.
        """
        count = len(self.joint_names)
        shape = (count,) if len(shape_of(planned)) == 1 else (None, count)
        values, others = near_array("q", q, shape), near_array("planned", planned, shape)
        if values.shape != others.shape:
            raise InputError(f"q and planned have shapes {values.shape} and {others.shape}, expected the same")
        return difference(values, others, self.rotary)

    def position(self, q: ArrayLike, *, displacement: float = 0.0) -> CorridorPosition:
        """The position of a configuration in the corridor, at the sample of the motion with the smallest used share.

        Args:
            q: Configuration [rad or m], shape (nq,), columns as in `joint_names`.
            displacement: Largest distance of a point of a body from its place in the scene, other than by these joints
                [m]; both bodies of a pair may be displaced.

        Raises:
            InputError: wrong shape, not finite or too large, or a negative displacement.
        """
        displacement = number_from_zero("displacement", displacement)
        off = np.abs(difference(near_array("q", q, (len(self.joint_names),)), self.configurations, self.rotary))
        if not self.pairs:
            return CorridorPosition(0.0, float(self.times[np.argmin(off.max(axis=1, initial=0.0))]), ())

        def uses_at(k: int) -> Array:
            """The used shares of the distances of all pairs at a sample."""
            return np.asarray((self._sparse_levers @ off[k] + 2.0 * displacement) / self.distances[k])

        nearest = np.argsort(off @ self._largest_levers, kind="stable")[:_NEAREST].tolist()
        k, uses = nearest[0], uses_at(nearest[0])
        # Other samples are compared in full only if these pairs do not use a larger share there.
        critical = np.argpartition(uses, -min(_CRITICAL, len(uses)))[-_CRITICAL:]
        some = off[nearest] @ self.levers[critical].T + 2.0 * displacement
        least = (some / self.distances[np.ix_(nearest, critical)]).max(axis=1).tolist()
        for other, bound in zip(nearest[1:], least[1:], strict=True):
            if bound < uses.max():
                found = uses_at(other)
                k, uses = (other, found) if found.max() < uses.max() else (k, uses)
        pair = int(np.argmax(uses))
        return CorridorPosition(float(uses[pair]), float(self.times[k]), self.pairs[pair])

    @cached_property
    def _largest_levers(self) -> Array:
        """The largest lever of each joint [m/rad], shape (nq,)."""
        return np.asarray(self.levers.max(axis=0, initial=0.0))

    @cached_property
    def _sparse_levers(self) -> csr_array:
        """The levers; of many arms only few move a pair."""
        return csr_array(self.levers)


def certified_corridor(scene: Scene, trajectory: Trajectory) -> Corridor:
    """Compute the deviations from a motion at which arms are proven free of collision.

    Args:
        scene: The scene.
        trajectory: A motion without collision, of all joints of some of its arms.

    Raises:
        InputError: the trajectory lacks joints of an arm, is in collision or nearly so, or is too long for the number
            of bodies; or the scene cannot be checked.
        UnknownNameError: an arm that the scene does not have.
    """
    of_kind("scene", scene, Scene)
    of_kind("trajectory", trajectory, Trajectory)
    if not trajectory.joint_names:
        raise InputError("the trajectory has no joints, expected those of the arms that move")
    names = scene.joint_names(trajectory.arms)
    if set(names) != set(trajectory.joint_names):
        odd = sorted(set(names) ^ set(trajectory.joint_names))[0]
        raise InputError(f"trajectory and arms have different joints: only one of them has {odd!r}")
    columns = [trajectory.joint_names.index(name) for name in names]
    checker = CollisionChecker(scene, trajectory.arms)
    levers = checker.tables.pair_levers(checker.limits.travel)
    turning = np.concatenate([rotary(scene.arms[arm].robot) for arm in checker.arms])
    pairs = tuple(checker.pairs[owner] for owner in checker.solid_owner)
    now, step = trajectory.start_time, _LONGEST
    moves = np.asarray(trajectory.coefficients[:, 1:].any(axis=(1, 2)))
    times: list[float] = []
    configurations: list[Array] = []
    distances: list[Array] = []
    while True:
        if (len(times) + 1) * len(pairs) > _MOST_DISTANCES:
            raise InputError(
                f"a corridor with {len(pairs)} pairs of bodies takes too much memory after {now:.3f} s; take a part of "
                "the motion (Trajectory.cut), or fewer arms"
            )
        q = trajectory(now)[columns]
        clearances = checker.solid_distances(q) - _ACCURACY
        if (clearances <= 0.0).any():
            touching = " and ".join(map(repr, pairs[int(np.argmin(clearances))]))
            raise InputError(f"the motion has no corridor: at {now:.3f} s {touching} touch")
        times.append(now)
        configurations.append(q)
        distances.append(clearances)
        if now >= trajectory.end_time:
            break
        piece = int(np.searchsorted(trajectory.breaks, now, side="right")) - 1
        if not moves[piece] and trajectory.breaks[piece + 1] > now + _LONGEST:  # a pause needs one sample
            now = float(trajectory.breaks[piece + 1])
            continue
        step = min(2.0 * step, _LONGEST)
        while step > _SHORTEST:
            ahead = np.abs(trajectory(min(now + step, trajectory.end_time))[columns] - q)
            if (levers @ ahead <= _OVERLAP * clearances).all():
                break
            step *= 0.5
        now = min(now + step, trajectory.end_time)
    samples = [read_only(np.array(rows)) for rows in (times, configurations, distances)]
    return Corridor(names, samples[0], samples[1], samples[2], read_only(levers), pairs, read_only(turning))
