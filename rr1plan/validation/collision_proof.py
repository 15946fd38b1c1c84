"""Findings of the compiled search, by the names of the scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rr1plan.validation.compiled_search import ElementPair, FoundPair, ProgressCallback, ProofOptions, Search
from rr1plan.validation.link_motion import TimedColumns
from rr1plan.validation.moving_scene import MovingScene
from rr1plan.validation.referee_kernels import GROUPS


class Nearest(NamedTuple):
    """A smallest clearance [m], its pair of elements and the time [s]."""

    clearance: float
    pair: tuple[str, str]
    time: float


class Contact(NamedTuple):
    """A pair of elements that touches, or that could not be decided.

    Args:
        pair: Their names.
        clearance: The smallest one seen [m]; of a pair in contact minus the largest depth.
        time: When that was [s].
        first: The first moment seen in contact [s]; inf for none.
        own: Whether one arm owns both.
    """

    pair: tuple[str, str]
    clearance: float
    time: float
    first: float
    own: bool


@dataclass
class CollisionProof:
    """Findings about all pairs of elements over the whole motion.

    Args:
        contacts: Pairs that are not free, in the order of the scene's elements.
        nearest: Smallest clearance with the surroundings, and of one arm's own; None where there is no pair, or where
            clearances were not looked for.
        proven: Lower bounds of them [m], where nothing is undecided; none if they were not looked for.
        ends: Smallest clearance with the surroundings at the first and at the last instant; the same.
        cancelled: The search was cut off; what is left of it is not decided.
        statistics: Counts of the work done.
    """

    contacts: list[Contact]
    nearest: list[Nearest | None]
    proven: list[float]
    ends: list[Nearest | None]
    cancelled: bool
    statistics: dict[str, float]


def prove(
    scene: MovingScene, motion: TimedColumns, options: ProofOptions, progress: ProgressCallback | None = None
) -> CollisionProof:
    """Decide every pair of elements on all of a motion.

    Args:
        scene: The scene.
        motion: The motion.
        options: What is to be found.
        progress: Called with the fraction decided; False from it cancels.
    """
    search = Search(scene, motion, options)
    search.run(progress)
    contacts = _contacts(scene, search)
    if not options.clearance:
        return CollisionProof(contacts, [None] * GROUPS, [], [], search.cancelled, search.statistics)
    nearest = [_nearest(scene, search.nearest(group)) for group in range(GROUPS)]
    for contact in contacts:
        known = nearest[contact.own]
        if np.isfinite(contact.clearance) and (known is None or contact.clearance < known.clearance):
            nearest[contact.own] = Nearest(contact.clearance, contact.pair, contact.time)
    ends = [_nearest(scene, end) for end in search.ends]
    return CollisionProof(contacts, nearest, search.proven, ends, search.cancelled, search.statistics)


def _contacts(scene: MovingScene, search: Search) -> list[Contact]:
    """The contacts in the order of the scene's elements, with those of arms in equal configurations."""
    rows = []
    for found in search.marked:
        for elements in scene.equal_pairs(found.elements):
            (i, a, one), (j, b, two) = _names(scene, elements)
            rows.append(((i, j), Contact((a, b), found.clearance, found.time, found.first, one == two)))
    return [contact for _, contact in sorted(rows, key=lambda row: row[0])]


def _names(scene: MovingScene, elements: ElementPair) -> tuple[tuple[int, str, str], tuple[int, str, str]]:
    """Places of two elements in the scene, in order, with their names and those of their owners."""
    one, two = map(scene.element, elements)
    return (one, two) if one <= two else (two, one)


def _nearest(scene: MovingScene, found: FoundPair | None) -> Nearest | None:
    if found is None:
        return None
    (_, a, _), (_, b, _) = _names(scene, found.elements)
    return Nearest(found.clearance, (a, b), found.time)
