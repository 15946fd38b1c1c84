"""Pairs of links that need no collision check, found by sampling, for robots without an SRDF.

The idea is that of MoveIt's setup assistant: links connected by a joint may always touch; two links that touch in every
sample carry no information about a motion; two that touch in no sample probably never can. When a robot without an SRDF
is loaded, only the first two kinds are omitted; the third is for the user to judge. Coal compares the shapes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from itertools import combinations
from types import MappingProxyType
from typing import Literal

import numpy as np

from rr1plan.checks import Array, Seed, Value, as_generator, of_kind, whole_number
from rr1plan.robot import Joint, Robot
from rr1plan.robot.contact_bands import ContactBand, contact_bands, sampling_bounds
from rr1plan.robot.link_contacts import LinkBodies, Pair

Reason = Literal["Adjacent", "Always", "Never"]

_HOME_SAMPLES = 300  # random configurations among which the home configuration is chosen
_MOST_SAMPLES = 1_000_000


def rigid_pairs(joints: Sequence[Joint]) -> frozenset[Pair]:
    """Pairs of links with a constant relative pose, which need no check."""
    bodies = {id(members): members for members in _bodies(joints).values()}  # each list occurs once for each member
    return frozenset(frozenset(pair) for members in bodies.values() for pair in combinations(members, 2))


def adjacent_pairs(joints: Sequence[Joint]) -> frozenset[Pair]:
    """Pairs of links connected by a movable joint, including links fixed to either."""
    bodies, moving = _bodies(joints), [joint for joint in joints if joint.kind != "fixed"]
    return frozenset(frozenset((a, b)) for j in moving for a in bodies[j.parent] for b in bodies[j.child])


def _bodies(joints: Sequence[Joint]) -> dict[str, list[str]]:
    """For each link the links that are fixed to it, and itself, in a list that they share."""
    bodies: dict[str, list[str]] = {}
    for joint in joints:
        members = bodies.setdefault(joint.parent, [joint.parent])
        if joint.kind == "fixed":
            members.append(joint.child)
            bodies[joint.child] = members
        else:
            bodies[joint.child] = [joint.child]
    return bodies


@dataclass(frozen=True, eq=False)
class PairProposal(Value, Mapping[Pair, Reason]):
    """Pairs of links that need no check, each with the reason, and contact bands to inspect.

    Args:
        reasons: "Adjacent" for links connected by a joint, "Always" for links that touch in every sample, "Never" for
            links that touch in none (a guess that improves with the number of samples).
        bands: Pairs that touch whenever one joint is within an interval inside its range, which splits the free space.
            If this is due to a shape larger than its link, the pair needs no check either.
    """

    reasons: Mapping[Pair, Reason]
    bands: tuple[ContactBand, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "reasons", MappingProxyType(dict(self.reasons)))

    def __getitem__(self, pair: Pair) -> Reason:
        return self.reasons[pair]

    def __iter__(self) -> Iterator[Pair]:
        return iter(self.reasons)

    def __len__(self) -> int:
        return len(self.reasons)

    def __str__(self) -> str:
        lines = sorted(f"{reason}: {' - '.join(sorted(pair))}" for pair, reason in self.reasons.items())
        return "\n".join([*lines, *(f"Check: {band}" for band in self.bands)])


def propose_disabled_collisions(robot: Robot, *, samples: int = 1000, rng: Seed = None) -> PairProposal:
    """Pairs of links that need no check, each with the reason.

    Args:
        robot: The robot; its `disabled_collisions` is ignored.
        samples: Number of random configurations; grippers are opened and closed at random too.
        rng: Generator or seed.

    Returns:
        A mapping from pair to reason; its `bands` are the pairs that touch in a band that splits a joint's range.

    Raises:
        InputError: not a robot, or `samples` below 1 or above a million.
    """
    of_kind("robot", robot, Robot)
    whole_number("samples", samples, 1, _MOST_SAMPLES)
    generator = as_generator(rng)
    bodies = LinkBodies(robot)
    reasons, mixed = sampled_reasons(robot, samples, generator, bodies)
    return PairProposal(reasons, contact_bands(robot, mixed, generator, bodies))


def sampled_reasons(
    robot: Robot, samples: int, generator: np.random.Generator, bodies: LinkBodies
) -> tuple[Mapping[Pair, Reason], frozenset[Pair]]:
    """Pairs that need no check with the reason, and pairs that touch in some samples only."""
    found: dict[Pair, Reason] = dict.fromkeys(adjacent_pairs(robot.joints) | rigid_pairs(robot.joints), "Adjacent")
    seen: dict[Pair, set[bool]] = {pair: set() for pair in bodies.pairs if pair not in found}
    for _ in range(samples):
        open_pairs = [pair for pair, outcomes in seen.items() if len(outcomes) < 2]
        touching = bodies.touching(_sample(robot, generator), open_pairs)
        for pair in open_pairs:
            seen[pair].add(pair in touching)
    found.update({pair: "Always" if True in seen[pair] else "Never" for pair in seen if len(seen[pair]) == 1})
    return found, frozenset(pair for pair, outcomes in seen.items() if len(outcomes) == 2)


def always_colliding(robot: Robot, samples: int, bodies: LinkBodies) -> frozenset[Pair]:
    """Pairs of links that may not touch, but do at home and in each of some random configurations.

    Args:
        robot: The robot.
        samples: Number of random configurations, the same in each call.
        bodies: Its links.
    """
    generator = np.random.default_rng(0)
    touching = touching_links(robot, robot.home, bodies)
    for _ in range(samples):
        if not touching:
            break
        touching &= bodies.touching(_sample(robot, generator), list(touching))
    return frozenset(touching)


def stuck_pairs(robot: Robot, pairs: Set[Pair], samples: int, bodies: LinkBodies) -> frozenset[Pair]:
    """The pairs of links that touch in each of some random configurations, with locked joints at their values."""
    generator = np.random.default_rng(0)
    stuck = set(pairs)
    for _ in range(samples):
        if not stuck:
            break
        stuck &= bodies.touching(robot.joint_values(_random(robot, generator)), list(stuck))
    return frozenset(stuck)


def free_configuration(robot: Robot, wish: Array, bodies: LinkBodies) -> Array:
    """A configuration without self-collision near `wish`, or `wish` itself if it is free.

    Args:
        robot: The robot.
        wish: Desired configuration [rad or m], shape (nq,).
        bodies: Its links.

    Returns:
        The nearest free configuration found; if none was found, the nearest of those with the fewest pairs in contact.
    """
    generator = np.random.default_rng(0)
    pairs = [pair for pair in bodies.pairs if pair not in robot.disabled_collisions]
    best, fewest = wish, len(bodies.touching(robot.joint_values(wish), pairs))
    candidates = [_random(robot, generator) for _ in range(_HOME_SAMPLES)] if fewest else []
    for q in sorted(candidates, key=lambda q: float(np.abs(q - wish).sum())):
        contacts = len(bodies.touching(robot.joint_values(q), pairs))
        if contacts < fewest:
            best, fewest = q, contacts
        if not fewest:
            break
    return best


def touching_links(robot: Robot, q: Array, bodies: LinkBodies) -> set[Pair]:
    """Pairs of links in contact at q (nq,), except for allowed ones."""
    return bodies.touching(
        robot.joint_values(q), [pair for pair in bodies.pairs if pair not in robot.disabled_collisions]
    )


def _sample(robot: Robot, generator: np.random.Generator) -> dict[str, float]:
    """Random values of all joints, including locked ones."""
    locked = {
        name: _between(robot.joint(name).lower, robot.joint(name).upper, generator) for name in robot.locked_joints
    }
    return replace(robot, locked_joints=locked).joint_values(_random(robot, generator))


def _random(robot: Robot, generator: np.random.Generator) -> Array:
    return generator.uniform(*sampling_bounds(robot))


def _between(lower: float, upper: float, generator: np.random.Generator) -> float:
    """A random value between limits; within a full turn if there are none."""
    if np.isfinite(upper - lower):
        return float(generator.uniform(lower, upper))
    return float(generator.uniform(-np.pi, np.pi))
