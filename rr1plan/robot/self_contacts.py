"""Pairs of links in contact always or at home, found by sampling when a robot is loaded.

Sampling takes seconds for a robot with sixty links, so slow results are cached on disk by the robot's content.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from importlib.metadata import version

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, as_generator
from rr1plan.files.disk_cache import cache_key, load_cached, store_cached
from rr1plan.files.npy_files import Arrays
from rr1plan.robot import Robot
from rr1plan.robot.disabled_collisions import (
    always_colliding,
    free_configuration,
    sampled_reasons,
    stuck_pairs,
    touching_links,
)
from rr1plan.robot.link_contacts import LinkBodies, Pair

log = logging.getLogger(__name__)

SAMPLES = 200
_VERSION = "self-contacts-4"
# Faster results are not cached [s].
_WORTH_KEEPING = 0.3


@dataclass(frozen=True, eq=False)
class SelfContacts:
    """Result of sampling.

    Args:
        always: Pairs that need no check: those that touch in every configuration; without rules also links connected by
            a joint, and pairs that touch in every configuration with the locked joints at their values.
        home: A configuration without other contacts, at or near the requested one, shape (nq,).
        at_home: Pairs that touch even there.
    """

    always: frozenset[Pair]
    home: Array
    at_home: frozenset[Pair]


def self_contacts(robot: Robot, has_rules: bool, keeps_home: bool) -> SelfContacts:
    """Sample a robot's self-contacts, or load them from the cache.

    Args:
        robot: The robot.
        has_rules: Whether its `disabled_collisions` comes from an SRDF.
        keeps_home: Whether its home is given and must not change.
    """
    rules = f"{_VERSION} {version('coal')} {SAMPLES} {has_rules} {keeps_home}"
    key = cache_key(rules, robot.content_hash, np.array(robot.home))
    kept = load_cached(key)
    found = None if kept is None else _unpacked(robot, kept)
    if found is None:
        log.info("%s: sampling which of its links touch each other", robot.name)
        began = time.perf_counter()
        found = _sampled(robot, has_rules, keeps_home)
        if time.perf_counter() - began > _WORTH_KEEPING:
            store_cached(key, _packed(robot, found))
    return found


def _sampled(robot: Robot, has_rules: bool, keeps_home: bool) -> SelfContacts:
    bodies = LinkBodies(robot)
    if has_rules:
        always = always_colliding(robot, SAMPLES, bodies)
    else:
        reasons, _ = sampled_reasons(robot, SAMPLES, as_generator(0), bodies)
        always = frozenset(pair for pair, reason in reasons.items() if reason != "Never")
    robot = replace(robot, disabled_collisions=robot.disabled_collisions | always)
    if not has_rules:
        stuck = stuck_pairs(robot, touching_links(robot, robot.home, bodies), SAMPLES, bodies)
        always |= stuck
        robot = replace(robot, disabled_collisions=robot.disabled_collisions | stuck)
    home = robot.home if keeps_home else free_configuration(robot, robot.home, bodies)
    return SelfContacts(always, home, frozenset(touching_links(robot, home, bodies)))


def _packed(robot: Robot, found: SelfContacts) -> Arrays:
    place = {name: i for i, name in enumerate(robot.link_names)}

    def rows(pairs: Iterable[Pair]) -> NDArray[np.int64]:
        return np.array(sorted(sorted(place[name] for name in pair) for pair in pairs), np.int64).reshape(-1, 2)

    return {"always": rows(found.always), "home": np.array(found.home), "at_home": rows(found.at_home)}


def _unpacked(robot: Robot, kept: Arrays) -> SelfContacts | None:
    """The content of a cache entry, or None if it is damaged."""
    names = robot.link_names
    try:
        always, at_home = (
            frozenset(frozenset(names[i] for i in row) for row in kept[n]) for n in ("always", "at_home")
        )
        return SelfContacts(always, robot.configuration(kept["home"]), at_home)
    except (KeyError, IndexError, TypeError, ValueError):
        return None
