"""Paddings between the elements of two owners, `ALLOWED` for pairs that may touch.

An owner is an arm with its links and what it holds, or an obstacle. `Scene.may_touch` and `Scene.padding_of` define the
rule for a single pair. Rules are grouped by owners: owners without a rule cost nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.scene import Pair, Scene

# No distance is kept where contact is allowed.
ALLOWED = -1.0


@dataclass(frozen=True, eq=False)
class Elements:
    """The elements of an owner.

    Args:
        owner: Its name.
        index: Number of each element within the owner, by name.
    """

    owner: str
    index: Mapping[str, int]

    def named(self, name: str) -> list[int]:
        """The elements that a name in a rule refers to: one, all for the owner's name, none for another name."""
        if name in self.index:
            return [self.index[name]]
        return list(range(len(self.index))) if name == self.owner else []


def rules_by_owners(scene: Scene) -> dict[Pair, list[Pair]]:
    """Pairs of names with a rule (an allowed contact or a padding), by the owners of the two elements."""
    found: dict[Pair, list[Pair]] = {}
    for both in dict.fromkeys((*scene.allowed, *scene.pair_padding)):
        found.setdefault(frozenset(scene.owner(name) or name for name in both), []).append(both)
    return found


def block_paddings(scene: Scene, one: Elements, two: Elements, checked: NDArray[np.uint8], rules: list[Pair]) -> Array:
    """Distances to keep between the elements of two owners [m], or `ALLOWED`, shape (n, m).

    Args:
        scene: The scene.
        one: The elements of the first owner.
        two: The elements of the second owner, which may be the same.
        checked: Pairs that must not touch unless a rule allows it, shape (n, m).
        rules: Pairs of names with a rule between these owners.
    """
    paddings = np.full(checked.shape, scene.padding)
    kept = {both: scene.pair_padding[both] for both in rules if both in scene.pair_padding}
    allowed = {both: ALLOWED for both in rules if both in scene.allowed and len(both) == 2}
    for both in (both for both in kept if _elements_named(both, one, two) == 0):
        _set(paddings, one, two, both, kept[both])
    # A rule may name an element and the other owner. If both elements have such a rule, the larger distance counts.
    of_one, of_two = np.full(checked.shape, np.nan), np.full(checked.shape, np.nan)
    for both in (both for both in kept if _elements_named(both, one, two) == 1):
        for x, y in _orders(both):
            (of_one if x in one.index else of_two)[np.ix_(one.named(x), two.named(y))] = kept[both]
    larger = np.fmax(of_one, of_two)  # the other one where one is NaN
    paddings = np.where(np.isnan(larger), paddings, larger)
    for both in (both for both in kept if _elements_named(both, one, two) == 2):
        _set(paddings, one, two, both, kept[both])
    for both, distance in allowed.items():
        _set(paddings, one, two, both, distance)
    return np.where(checked, paddings, ALLOWED)


def _elements_named(both: Pair, one: Elements, two: Elements) -> int:
    """How many of two names refer to an element rather than an owner."""
    return sum(name in one.index or name in two.index for name in both)


def _set(paddings: Array, one: Elements, two: Elements, both: Pair, distance: float) -> None:
    for x, y in _orders(both):
        paddings[np.ix_(one.named(x), two.named(y))] = distance


def _orders(both: Pair) -> Iterator[tuple[str, ...]]:
    """Two names in both orders; one name twice."""
    return permutations(both) if len(both) == 2 else iter([tuple(both) * 2])
