"""Rules about pairs of elements as tables, so that a scene of hundreds of pairs costs no time to set up.

A name in a rule is an element's, or an arm's, which stands for all that moves with it. What a single pair
may do is said in words by `Scene.may_touch` and `Scene.padding_of`; the tables here say the same of all pairs.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array

Indices = NDArray[np.int64]


class Elements:
    """The elements of a scene by index, for rules that name them.

    Args:
        names: All elements.
        owners: The arm each moves with, None for an obstacle.
    """

    def __init__(self, names: Sequence[str], owners: Sequence[str | None]) -> None:
        self._count = len(names)
        self._index = {name: i for i, name in enumerate(names)}
        self._of_arm: dict[str, list[int]] = {}
        self._obstacles: list[int] = []
        for i, arm in enumerate(owners):
            if arm is None:
                self._obstacles.append(i)
            else:
                self._of_arm.setdefault(arm, []).append(i)

    def checked(
        self, apart: Iterable[tuple[str, str]], still: Iterable[str], allowed: Iterable[frozenset[str]]
    ) -> Indices:
        """The pairs that must not touch, by ascending indices, shape (m, 2).

        Args:
            apart: Pairs of elements that need no check; names of nothing are passed over.
            still: Elements that need no check against obstacles, as no obstacle does.
            allowed: Pairs of elements or arms that may touch.
        """
        index = self._index
        checked = np.ones((self._count, self._count), dtype=np.bool_)
        pairs = [(index[a], index[b]) for a, b in apart if a in index and b in index]
        rows, columns = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
        checked[rows, columns] = checked[columns, rows] = False
        fixed = self._obstacles + [index[name] for name in still if name in index]
        checked[np.ix_(fixed, self._obstacles)] = checked[np.ix_(self._obstacles, fixed)] = False
        for both in allowed:
            if len(both) == 2:
                one, two = (self._members(name) for name in both)
                checked[np.ix_(one, two)] = checked[np.ix_(two, one)] = False
        return np.argwhere(np.triu(checked, 1))

    def paddings(self, pairs: Indices, general: float, special: Mapping[frozenset[str], float]) -> Array:
        """Distance to keep between the elements of each pair [m], shape (m,).

        Args:
            pairs: Pairs of elements by ascending indices, shape (m, 2).
            general: What counts where no rule says otherwise [m].
            special: Distances of pairs of elements or arms [m].
        """
        if not special:
            return np.full(len(pairs), general)
        table = np.full((self._count, self._count), general)
        for _, first, second, distance in sorted(self._blocks(special), key=itemgetter(0)):
            table[np.ix_(first, second)] = distance
        return table[pairs[:, 0], pairs[:, 1]]

    def _blocks(self, special: Mapping[frozenset[str], float]) -> Iterator[tuple[int, list[int], list[int], float]]:
        """Parts of the table of paddings: rank (of two rules the higher counts), rows, columns, distance."""
        for both, distance in special.items():
            # An arm's name alone is about the arm's own pairs.
            a, b = (tuple(both) * 2)[:2]
            for x, y in {(a, b), (b, a)}:
                rank = 3 * (x in self._index) + 2 * (y in self._index)
                yield rank, self._members(x), self._members(y), distance

    def _members(self, name: str) -> list[int]:
        index = self._index.get(name)
        return self._of_arm.get(name, []) if index is None else [index]
