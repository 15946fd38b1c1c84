"""Results of the compiled search, by element names of the scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rr1plan.validation.compiled_search import ElementPair, FoundPair, ProgressCallback, ProofOptions, Search
from rr1plan.validation.link_motion import TimedColumns
from rr1plan.validation.moving_scene import MovingScene
from rr1plan.validation.referee_kernels import GROUPS


class SmallestClearance(NamedTuple):
    """A smallest clearance [m], its pair of elements and its time [s]."""

    clearance: float
    pair: tuple[str, str]
    time: float


class PairFinding(NamedTuple):
    """A pair of elements in contact, or undecided.

    Args:
        pair: Names of the elements.
        clearance: Smallest clearance found [m]; for a pair in contact, minus the largest depth.
        time: Its time [s].
        first: Time of the first contact found [s]; inf if there is none.
        own: Whether both elements belong to one arm.
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
        nearest: Smallest clearance to the surroundings, and within an arm; None where there is no pair, or without the
            option `clearance`.
        proven: Lower bounds of these clearances [m], valid if nothing is undecided; empty without the option
            `clearance`.
        ends: Smallest clearance to the surroundings at the first and at the last instant, likewise None or empty.
        cancelled: Whether the search was cancelled; the rest of it is undecided.
        statistics: Counts of the work done.
    """

    contacts: list[PairFinding]
    nearest: list[SmallestClearance | None]
    proven: list[float]
    ends: list[SmallestClearance | None]
    cancelled: bool
    statistics: dict[str, float]


def prove(
    scene: MovingScene, motion: TimedColumns, options: ProofOptions, progress: ProgressCallback | None = None
) -> CollisionProof:
    """Decide every pair of elements over a whole motion.

    Args:
        scene: The scene.
        motion: The motion.
        options: Options of the search.
        progress: Called with the fraction decided; returns False to cancel.
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
            nearest[contact.own] = SmallestClearance(contact.clearance, contact.pair, contact.time)
    ends = [_nearest(scene, end) for end in search.ends]
    return CollisionProof(contacts, nearest, search.proven, ends, search.cancelled, search.statistics)


def _contacts(scene: MovingScene, search: Search) -> list[PairFinding]:
    """The contacts in the order of the scene's elements, including those of arms equal to the searched ones."""
    rows = []
    for found in search.marked:
        for elements in scene.equal_pairs(found.elements):
            (i, a, one), (j, b, two) = _names(scene, elements)
            rows.append(((i, j), PairFinding((a, b), found.clearance, found.time, found.first, one == two)))
    return [contact for _, contact in sorted(rows, key=lambda row: row[0])]


def _names(scene: MovingScene, elements: ElementPair) -> tuple[tuple[int, str, str], tuple[int, str, str]]:
    """Indices of two elements in the scene, in order, with their names and those of their owners."""
    one, two = map(scene.element, elements)
    return (one, two) if one <= two else (two, one)


def _nearest(scene: MovingScene, found: FoundPair | None) -> SmallestClearance | None:
    if found is None:
        return None
    (_, a, _), (_, b, _) = _names(scene, found.elements)
    return SmallestClearance(found.clearance, (a, b), found.time)
