"""Three ways to check a straight edge in configuration space: at fixed steps, by halving, and by advancing.

A joint that turns by an angle moves no point of a body farther than the angle times its lever, the largest distance
that the body can have from the joint's axis. From the middle of an interval of an edge to its ends, two bodies
therefore approach each other by no more than

    bound = sum of lever_j |q1_j - q0_j| times half the length of the interval,

and an interval on which all distances at the middle exceed their bounds is free as a whole. The others are halved
(adaptive bisection: Schwarzer, Saha and Latombe, Adaptive dynamic collision checking for single and multiple
articulated robots in complex environments, IEEE Trans. Robotics 21, 2005), or the distance at one configuration
determines the step to the next one (conservative advancement: Mirtich, Impulse-based dynamic simulation of rigid body
systems, 1996).

These are plain implementations for teaching. `CollisionChecker.edge_is_free` decides the same with compiled kernels.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from rr1plan.checks import Array, of_kind, positive_number, read_only, whole_number
from rr1plan.collision import CollisionChecker
from rr1plan.errors import InputError

Verdict = Literal["free", "halved", "contact", "undecided"]

# Halvings after which an interval remains undecided: its middle is at the tolerance from contact.
_MOST_HALVINGS = 40
_MOST_SAMPLES = 1_000_000


@dataclass(frozen=True)
class EdgeInterval:
    """A checked interval of an edge.

    Args:
        begin: Its start, as a fraction of the edge.
        end: Its end, likewise.
        distance: Distance of the deciding pair at its middle, beyond padding and tolerance [m].
        bound: Bound on the approach of that pair between the middle and an end [m].
        pair: The deciding pair: the one with the least distance − bound.
        verdict: "free": distance > bound for all pairs; "contact": the distance of the pair is not above zero;
            "halved"; or "undecided": the distance is too small for any interval.
    """

    begin: float
    end: float
    distance: float
    bound: float
    pair: tuple[str, str]
    verdict: Verdict

    @property
    def middle(self) -> float:
        """The fraction of the edge at which the distance was measured."""
        return 0.5 * (self.begin + self.end)


@dataclass(frozen=True, eq=False)
class FixedSteps:
    """The result of checking an edge at fixed steps.

    Args:
        step: Distance of two neighboring samples [rad], at most the requested step.
        fractions: Positions of the samples as fractions of the edge, shape (n,).
        free: Which of them are free, shape (n,).
    """

    step: float
    fractions: Array
    free: np.ndarray[tuple[int], np.dtype[np.bool_]]

    @property
    def passes(self) -> bool:
        """Whether the check accepts the edge as free."""
        return bool(self.free.all())


def sample_edge(checker: CollisionChecker, q0: ArrayLike, q1: ArrayLike, step: float) -> FixedSteps:
    """Check an edge at fixed steps, ends included: no proof, whatever the step.

    Args:
        checker: Of the scene.
        q0: Start [rad or m], shape (nq,).
        q1: End [rad or m], shape (nq,).
        step: Largest distance between two samples in configuration space [rad].

    Raises:
        InputError: a wrong shape, or a step that is not above zero or that needs more than a million samples.
    """
    of_kind("checker", checker, CollisionChecker)
    q0, q1 = checker.checked(q0), checker.checked(q1)
    length = float(np.linalg.norm(q1 - q0))
    count = max(1, int(np.ceil(length / positive_number("step", step) * (1.0 - 1e-12))))
    if count > _MOST_SAMPLES:
        raise InputError(f"step is {step:g} on an edge of length {length:g}, expected at most {_MOST_SAMPLES} steps")
    fractions = np.linspace(0.0, 1.0, count + 1)
    free = checker.are_free(q0 + fractions[:, None] * (q1 - q0))
    return FixedSteps(length / count, read_only(fractions), free)


def halve_edge(
    checker: CollisionChecker, q0: ArrayLike, q1: ArrayLike, *, most: int = 100_000
) -> tuple[EdgeInterval, ...]:
    """Decide an edge by halving its intervals until each is proven free, or one is in contact at its middle.

    Args:
        checker: Of the scene.
        q0: Start [rad or m], shape (nq,).
        q1: End [rad or m], shape (nq,).
        most: Number of intervals after which the search gives up with an undecided one.

    Returns:
        All intervals in the order in which they were checked, long ones first; the edge is free if none has the verdict
        "contact" or "undecided".

    Raises:
        InputError: a wrong shape, fewer than one interval, or a scene without obstacles.
    """
    of_kind("checker", checker, CollisionChecker)
    whole_number("most", most, 1, 10_000_000)
    q0, q1 = checker.checked(q0), checker.checked(q1)
    speeds = _approach_speeds(checker, q0, q1)
    found: list[EdgeInterval] = []
    waiting = deque([(0.0, 1.0)])
    while waiting:
        begin, end = waiting.popleft()
        interval = _decided(checker, q0, q1, speeds, begin, end)
        if interval.verdict == "halved" and (len(found) + 1 >= most or end - begin < 2.0**-_MOST_HALVINGS):
            interval = EdgeInterval(begin, end, interval.distance, interval.bound, interval.pair, "undecided")
        found.append(interval)
        if interval.verdict in ("contact", "undecided"):
            break
        if interval.verdict == "halved":
            waiting += [(begin, interval.middle), (interval.middle, end)]
    return tuple(found)


def is_proven_free(intervals: tuple[EdgeInterval, ...]) -> bool:
    """Whether intervals of `halve_edge` or `advance_edge` prove their edge free.

    Args:
        intervals: All of them.
    """
    return all(interval.verdict in ("free", "halved") for interval in intervals)


def advance_edge(
    checker: CollisionChecker, q0: ArrayLike, q1: ArrayLike, *, most: int = 100_000, shortest: float = 1e-6
) -> tuple[EdgeInterval, ...]:
    """Decide an edge by advancing from each configuration as far as distances allow, until the end or a contact.

    Args:
        checker: Of the scene.
        q0: Start [rad or m], shape (nq,).
        q1: End [rad or m], shape (nq,).
        most: Number of steps after which the search gives up.
        shortest: A step below this fraction of the edge counts as contact.

    Returns:
        The steps; the distance of each was computed at its start, and the bound is for its whole length. The last one
        is a contact if the edge is not free.

    Raises:
        InputError: a wrong shape, fewer than one step, a shortest step that is not above zero, or a scene without
            obstacles.
    """
    of_kind("checker", checker, CollisionChecker)
    whole_number("most", most, 1, 10_000_000)
    positive_number("shortest", shortest)
    q0, q1 = checker.checked(q0), checker.checked(q1)
    speeds = _approach_speeds(checker, q0, q1)
    found: list[EdgeInterval] = []
    at = 0.0
    while at < 1.0 and len(found) < most:
        distances = _clearances(checker, q0 + at * (q1 - q0))
        steps = np.divide(distances, speeds, out=np.full_like(speeds, np.inf), where=speeds > 0.0)
        steps[(speeds == 0.0) & (distances <= 0.0)] = 0.0
        k = int(np.argmin(steps))
        step = min(float(steps[k]), 1.0 - at)
        pair = checker.pairs[checker.solid_owner[k]]
        if step < shortest and at + step < 1.0:
            found.append(EdgeInterval(at, at, float(distances[k]), 0.0, pair, "contact"))
            break
        found.append(EdgeInterval(at, at + step, float(distances[k]), float(speeds[k] * step), pair, "free"))
        at += step
    return tuple(found)


def _approach_speeds(checker: CollisionChecker, q0: Array, q1: Array) -> Array:
    """Bound on the approach of the two solids of each pair on a whole edge [m], shape (p,)."""
    if not checker.pairs:
        raise InputError("the scene has nothing that the arm could touch, and so no distances; add an obstacle")
    return checker.tables.pair_levers(np.maximum(np.abs(q0), np.abs(q1))) @ np.abs(q1 - q0)


def _clearances(checker: CollisionChecker, q: Array) -> Array:
    """Distance of each pair of solids beyond padding and tolerance [m], shape (p,)."""
    return checker.solid_distances(q) - checker.solid_padding - checker.tolerance


def _decided(checker: CollisionChecker, q0: Array, q1: Array, speeds: Array, begin: float, end: float) -> EdgeInterval:
    """An interval with its verdict."""
    distances = _clearances(checker, q0 + 0.5 * (begin + end) * (q1 - q0))
    bounds = 0.5 * (end - begin) * speeds
    touching = distances <= 0.0
    k = int(np.argmin(np.where(touching, distances - bounds.max() - 1.0, distances - bounds)))
    pair, distance, bound = checker.pairs[checker.solid_owner[k]], float(distances[k]), float(bounds[k])
    verdict: Verdict = "contact" if touching.any() else "free" if distance > bound else "halved"
    return EdgeInterval(begin, end, distance, bound, pair, verdict)


def contact_share(checker: CollisionChecker, q0: ArrayLike, q1: ArrayLike) -> tuple[float, float] | None:
    """The part of an edge from its first contact to the last, or None if it is free.

    Args:
        checker: Of the scene.
        q0: Start [rad or m], shape (nq,).
        q1: End [rad or m], shape (nq,).

    Returns:
        Start and end as fractions of the edge.

    Raises:
        InputError: a wrong shape.
    """
    of_kind("checker", checker, CollisionChecker)
    first, last = checker.first_contact(q0, q1), checker.first_contact(q1, q0)
    return None if first is None or last is None else (first.fraction, 1.0 - last.fraction)
