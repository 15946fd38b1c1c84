"""Proof that no path exists: a value of one joint at which two bodies touch for all values of the others.

If start and goal are on different sides of this value, every path has to pass it. Contact of two bodies depends on the
joints between them or, for an obstacle, on the joints that carry the body. If these are at most two, the range of the
second one is cut into intervals until contact is certified on each (`rr1plan.collision.contact_cells`). For example,
the upper arm of a robot on a floor cannot swing through below its shoulder, wherever that is turned.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.collision.contact_cells import ContactCells, columns_between

# Number of tested values between start and goal, and of values of the other joint at which each is tested first.
_VALUES, _SAMPLES = 24, 8
# Initial number of intervals of the other joint, and how often intervals without a certificate are halved.
_INTERVALS, _HALVINGS = 16, 5
# A barrier is certified this far on both sides of its value [rad or m].
_HALF_WIDTH = 1e-9


@dataclass(frozen=True)
class JointBarrier:
    """A value that a joint cannot pass.

    Args:
        joint: The joint, as "arm/joint".
        value: The value [rad or m].
        elements: Pairs of elements; whatever the values of the other joints, one of the pairs is in contact there.
    """

    joint: str
    value: float
    elements: tuple[tuple[str, str], ...]

    def __str__(self) -> str:
        pairs = " or ".join(f"{a!r} and {b!r}" for a, b in self.elements)
        return f"joint {self.joint!r} cannot pass {self.value:.3g}: {pairs} touch there, wherever the others are"


def find_joint_barrier(
    checker: CollisionChecker,
    start: Array,
    goal: Array,
    *,
    most_tests: float = math.inf,
    goes_on: Callable[[], bool] = lambda: True,
) -> JointBarrier | None:
    """Search for a value that a joint has to pass on every path from a start to a goal, and cannot.

    Two links of one arm do not count, because they may be in contact only because their shapes are too large.

    Args:
        checker: Collision checker of the moving arms.
        start: Configuration within the limits, shape (nq,).
        goal: Configuration, shape (nq,); joints without limits count modulo whole turns.
        most_tests: Largest number of contact tests of two bodies; about 150,000 take a second.
        goes_on: Whether time is left; called between groups of tests.

    Returns:
        The barrier; None if none is found, which proves nothing.
    """
    groups: dict[frozenset[int], list[int]] = {}
    for pair, columns in enumerate(columns_between(checker)):
        a, b = (checker.scene.owner(element) for element in checker.pairs[checker.solid_owner[pair]])
        if 1 <= len(columns) <= 2 and a != b:
            groups.setdefault(columns, []).append(pair)
    tests = 0

    def may_test(count: int) -> bool:
        nonlocal tests
        tests += count
        return tests <= most_tests and goes_on()

    limits = checker.limits
    for columns, pairs in groups.items():
        for column in sorted(columns):
            # Joints without limits can go the other way round.
            if start[column] == goal[column] or not np.isfinite(limits.upper[column] - limits.lower[column]):
                continue
            other = next(iter(columns - {column}), None)
            values = np.linspace(start[column], goal[column], _VALUES + 2)[1:-1]
            if not may_test(0):
                return None
            found = _Barriers(checker, start, column, other, pairs, may_test).find(values)
            if found is not None:
                return found
    return None


class _Barriers:
    """The search for barriers of one joint, by pairs of solids that only this joint and another one move.

    Args:
        checker: Collision checker of the moving arms.
        q: A configuration.
        column: The joint.
        other: The other joint; None if there is none.
        pairs: Indices of the pairs among the checker's solid pairs.
        may_test: Whether a number of contact tests of two bodies may follow.
    """

    def __init__(
        self,
        checker: CollisionChecker,
        q: Array,
        column: int,
        other: int | None,
        pairs: list[int],
        may_test: Callable[[int], bool],
    ) -> None:
        self._checker, self._column, self._q, self._may_test = checker, column, q, may_test
        self._pairs = np.array(pairs, np.intp)
        # A single joint takes both places, with cells equally thin in both.
        self._alone = other is None
        other = column if other is None else other
        self._columns = column, other
        self._contacts = ContactCells(checker, q, (column, other), pairs)
        low, high = float(checker.limits.lower[other]), float(checker.limits.upper[other])
        bounded = np.isfinite(high - low)
        self._low, self._high = (low, high) if bounded else (-np.pi, np.pi)

    def find(self, values: Array) -> JointBarrier | None:
        """A barrier at one of some values; None if none is certified by the tests that are left."""
        samples = np.linspace(self._low, self._high, _SAMPLES)
        for value in values.tolist():
            # Nearly all values fail at the first sample, where a distance is much cheaper than a certificate.
            touching = (
                self._may_test(len(self._pairs)) and self._touching(value, other).any() for other in samples.tolist()
            )
            if all(touching) and self._is_certified(value):
                return JointBarrier(self._checker.joint_names[self._column], value, self._elements(value, samples))
        return None

    def _touching(self, value: float, other: float) -> NDArray[np.bool_]:
        """Which of the pairs touch at values of both joints, shape (pairs,)."""
        q = self._q.copy()
        q[self._columns[1]], q[self._columns[0]] = other, value
        distances = self._checker.solid_distances(q, self._pairs)
        return np.asarray(distances <= self._checker.solid_padding[self._pairs])

    def _is_certified(self, value: float) -> bool:
        """Whether contact is certified at a value of the joint, for the whole range of the other joint."""
        half = 0.5 * (self._high - self._low) / _INTERVALS
        middles = self._low + half * (1.0 + 2.0 * np.arange(_INTERVALS))
        for _ in range(_HALVINGS + 1):
            if not self._may_test(len(middles) * len(self._pairs)):
                return False
            blocked = self._classify(np.column_stack([np.full(len(middles), value), middles]), half)
            middles = middles[~blocked]
            if len(middles) == 0:
                return True
            half *= 0.5
            middles = np.concatenate([middles - half, middles + half])
        return False

    def _classify(self, cells: Array, half: float) -> NDArray[np.bool_]:
        """Cells in which contact of some pair is certified, for both values within their half widths."""
        if self._alone:
            cells, half = cells[:, [0, 0]], 0.0
        near = np.ones((len(cells), self._contacts.pairs), dtype=np.bool_)
        return self._contacts.classify(cells, np.array([_HALF_WIDTH, half]), near)[0]

    def _elements(self, value: float, samples: Array) -> tuple[tuple[str, str], ...]:
        """Pairs of elements such that at each sample one of them is in contact, by greedy selection."""
        unexplained = np.array([self._touching(value, other) for other in samples.tolist()])
        named: dict[tuple[str, str], None] = {}
        while len(unexplained):
            k = int(unexplained.any(axis=0).argmax())
            named[self._checker.pairs[self._checker.solid_owner[self._pairs[k]]]] = None
            unexplained = unexplained[~unexplained[:, k]]
        return tuple(named)
