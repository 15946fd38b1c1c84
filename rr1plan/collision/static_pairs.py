"""Pairs of elements that do not move against each other: what is true of them whatever q is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, read_only
from rr1plan.collision.coal_pairs import CoalPairs
from rr1plan.collision.results import Nearest

_NONE = Nearest(np.inf, (), read_only(np.zeros(3)), read_only(np.zeros(3)))


@dataclass(frozen=True, eq=False)
class StaticPairs:
    """Their distances and contacts.

    Args:
        distances: Distance of every checked pair [m], inf where its elements move, shape (n_pairs,).
        touching: (index of the pair, padding - distance [m], point between them) of those that collide.
        nearest: The nearest of them.
    """

    distances: Array
    touching: tuple[tuple[int, float, Array], ...] = ()
    nearest: Nearest = _NONE


def measure_static(
    things: CoalPairs, pairs: tuple[tuple[str, str], ...], owner: NDArray[np.int64], padding: Array
) -> StaticPairs:
    """Measure them with Coal.

    Args:
        things: Pairs of solids that do not move against each other, in place; at least one.
        pairs: Names of all checked pairs of elements.
        owner: For each pair of solids the index in `pairs`, shape (m,).
        padding: Padding of each pair of solids [m], shape (m,).
    """
    distances, found = np.full(len(pairs), np.inf), things.distances()
    np.minimum.at(distances, owner, found)
    touching = []
    for i in np.flatnonzero(found <= padding).tolist():
        distance, a, b = things.distance(i)
        touching.append((int(owner[i]), float(padding[i]) - distance, 0.5 * (a + b)))
    nearest = int(np.argmin(found))
    _, a, b = things.distance(nearest)
    closest = Nearest(float(found[nearest]), pairs[owner[nearest]], read_only(a), read_only(b))
    return StaticPairs(read_only(distances), tuple(touching), closest)
