"""Contact bands: intervals of one joint in which two links touch for all values of the other joints, by sampling.

A band inside the joint's range separates the free space. For real arms that is rare; most bands are due to shapes that
are larger than the links, for example the convex hull of a bent link.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from rr1plan.checks import Array
from rr1plan.robot import Robot
from rr1plan.robot.link_contacts import LinkBodies, Pair
from rr1plan.robot.robot import independent_joint

# Number of sampled values of a joint; narrower bands may be missed.
_GRID = 48
# Number of random samples of the other joints at each of these values.
_OTHERS = 16
_BISECTIONS = 8
# Most joints between two links of a band; with more joints bands are unlikely.
_MOST_JOINTS = 3


@dataclass(frozen=True)
class ContactBand:
    """Two links touch whenever a joint is within an interval.

    Args:
        a, b: The links.
        joint: The joint.
        lower, upper: The interval [rad or m].
    """

    a: str
    b: str
    joint: str
    lower: float
    upper: float

    def __str__(self) -> str:
        return f"{self.a} and {self.b} touch whenever {self.joint} is in [{self.lower:.3g}, {self.upper:.3g}]"


def contact_bands(
    robot: Robot, pairs: Collection[Pair], generator: np.random.Generator, bodies: LinkBodies
) -> tuple[ContactBand, ...]:
    """Bands of contact that split the range of a joint, for pairs of links with at most three joints between them.

    Args:
        robot: The robot; locked joints stay at their values.
        pairs: Pairs of links.
        generator: Generator of the values of the other joints.
        bodies: The robot's links.
    """
    lower, upper = sampling_bounds(robot)
    search = _Search(robot, bodies, generator.uniform(lower, upper, (_OTHERS, robot.nq)))
    found: list[ContactBand] = []
    between = {pair: joints_between(robot, pair) for pair in sorted(pairs, key=sorted)}
    for j in range(robot.nq):
        members = [pair for pair, joints in between.items() if j in joints and len(joints) <= _MOST_JOINTS]
        found += search.bands(j, members, np.linspace(lower[j], upper[j], _GRID))
    return tuple(found)


def sampling_bounds(robot: Robot) -> tuple[Array, Array]:
    """Position limits of the planning joints, a full turn where there are none [rad or m], each (nq,)."""
    bounded = np.isfinite(robot.limits.upper - robot.limits.lower)
    return np.where(bounded, robot.limits.lower, -np.pi), np.where(bounded, robot.limits.upper, np.pi)


def joints_between(robot: Robot, pair: Pair) -> list[int]:
    """Indices of the planning joints that move two links relative to each other."""
    above = {robot.base: frozenset[str]()}
    for joint in robot.joints:
        leader, _, _ = independent_joint(robot, joint)
        above[joint.child] = above[joint.parent] | ({leader.name} if joint.kind != "fixed" else set())
    one, two = (above[link] for link in pair)
    return [j for j, name in enumerate(robot.joint_names) if name in one ^ two]


class _Search:
    """Search for pairs in contact at a value of one joint for all values of the others.

    Args:
        robot: The robot.
        bodies: Its links.
        others: Configurations that provide the other joints' values, shape (n, nq).
    """

    def __init__(self, robot: Robot, bodies: LinkBodies, others: Array) -> None:
        self._robot, self._bodies, self._others = robot, bodies, others

    def bands(self, j: int, pairs: Sequence[Pair], grid: Array) -> Iterator[ContactBand]:
        """Bands of joint j strictly inside a grid of its values (n,)."""
        touching = [self.always_touching(j, value, pairs) for value in grid.tolist()]
        for pair in pairs:
            (a, b), blocked = sorted(pair), [pair in there for there in touching]
            for first, last in _runs(blocked):
                if first > 0 and last < len(grid) - 1:
                    low = self._border(j, pair, float(grid[first - 1]), float(grid[first]))
                    high = self._border(j, pair, float(grid[last + 1]), float(grid[last]))
                    yield ContactBand(a, b, self._robot.joint_names[j], low, high)

    def always_touching(self, j: int, value: float, pairs: Collection[Pair]) -> set[Pair]:
        """The pairs in contact at a value of joint j for all samples of the others."""
        left = set(pairs)
        for other in self._others:
            if not left:
                break
            q = other.copy()
            q[j] = value
            left = self._bodies.touching(self._robot.joint_values(q), list(left))
        return left

    def _border(self, j: int, pair: Pair, free: float, blocked: float) -> float:
        """Boundary of a band, by bisection between a value inside and one outside."""
        for _ in range(_BISECTIONS):
            middle = 0.5 * (free + blocked)
            free, blocked = (free, middle) if self.always_touching(j, middle, [pair]) else (middle, blocked)
        return blocked


def _runs(marks: Sequence[bool]) -> Iterator[tuple[int, int]]:
    """First and last index of each run of True."""
    first = 0
    for mark, run in groupby(marks):
        count = len(list(run))
        if mark:
            yield first, first + count - 1
        first += count
