"""Contact rules of a scene as tables, so that scenes with hundreds of pairs are set up quickly.

A name in a rule is that of an element, or of an arm for all elements that move with it. `Scene.may_touch`
and `Scene.padding_of` evaluate the rules for a single pair; the tables here contain the same for all pairs.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, read_only

Indices = NDArray[np.int64]
_Names = frozenset[str]


@dataclass(frozen=True)
class RuleContent:
    """Cache key of contact rules: all data that determines which pairs need a check.

    Args:
        arms: Name, base link, links with a shape and unchecked pairs of links of each arm.
        obstacles: Names of the obstacles.
        held: Name, arm, link and allowed links of each attached object.
        allowed: Pairs of elements or arms that may touch.
        near_pairs: Pairs of arms, or of an arm and an obstacle, that need a check (default: all pairs).
    """

    arms: tuple[tuple[str, str, tuple[str, ...], frozenset[_Names]], ...]
    obstacles: tuple[str, ...]
    held: tuple[tuple[str, str, str, _Names], ...]
    allowed: frozenset[_Names]
    near_pairs: frozenset[_Names] | None = None


@lru_cache(maxsize=128)
def rules_of(content: RuleContent) -> ContactRules:
    """The rules of a scene, shared by all scenes with equal content."""
    return ContactRules(content)


class ContactRules:
    """Pairs of elements that must not touch, and their paddings.

    Args:
        content: Content of the rules.
        checked: Some of the pairs that must not touch, shape (m, 2) (default: all).

    Attributes:
        names: All elements: links of the arms, obstacles, attached objects.
        obstacles: Indices of the obstacles in `names`.
    """

    def __init__(self, content: RuleContent, checked: Indices | None = None) -> None:
        self._content, self._given = content, checked
        links = [(f"{arm}/{link}", arm) for arm, _, links, _ in content.arms for link in links]
        named = [
            *links,
            *((name, None) for name in content.obstacles),
            *((name, arm) for name, arm, *_ in content.held),
        ]
        self.names = tuple(name for name, _ in named)
        self._owners = tuple(name if arm is None else arm for name, arm in named)
        self._count = len(named)
        self._index = {name: i for i, name in enumerate(self.names)}
        self._of_arm: dict[str, list[int]] = {}
        self.obstacles = list(range(len(links), len(links) + len(content.obstacles)))
        for i, (_, arm) in enumerate(named):
            if arm is not None:
                self._of_arm.setdefault(arm, []).append(i)

    @cached_property
    def checked(self) -> Indices:
        """The pairs that must not touch, by ascending indices, shape (m, 2)."""
        if self._given is not None:
            return read_only(self._given)
        index = self._index
        checked = np.ones((self._count, self._count), dtype=np.bool_)
        # Names of elements without a shape are skipped.
        pairs = [(index[a], index[b]) for a, b in self._unchecked() if a in index and b in index]
        rows, columns = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
        checked[rows, columns] = checked[columns, rows] = False
        still = [f"{arm}/{base}" for arm, base, *_ in self._content.arms]
        fixed = self.obstacles + [index[name] for name in still if name in index]
        checked[np.ix_(fixed, self.obstacles)] = checked[np.ix_(self.obstacles, fixed)] = False
        for both in self._content.allowed:
            if len(both) == 2:
                one, two = (self._members(name) for name in both)
                checked[np.ix_(one, two)] = checked[np.ix_(two, one)] = False
        if self._content.near_pairs is not None:
            checked &= self._are_near(self._content.near_pairs)
        return read_only(np.ascontiguousarray(np.argwhere(np.triu(checked, 1))))

    def with_checked(self, checked: Indices) -> ContactRules:
        """These rules with fewer checked pairs.

        Args:
            checked: Some rows of `checked`.
        """
        return ContactRules(self._content, checked)

    def paddings(self, general: float, special: Mapping[_Names, float]) -> Array:
        """Padding of each checked pair [m], shape (m,).

        Args:
            general: Default padding [m].
            special: Paddings of pairs of elements or arms [m].
        """
        if not special:
            return np.full(len(self.checked), general)
        table = np.full((self._count, self._count), general)
        for _, distance, first, second in sorted(self._blocks(special), key=itemgetter(0, 1)):
            table[np.ix_(first, second)] = distance
        return table[self.checked[:, 0], self.checked[:, 1]]

    def _are_near(self, pairs: frozenset[_Names]) -> NDArray[np.bool_]:
        """Mask of the pairs of elements of `pairs` of arms or obstacles, shape (n, n)."""
        number = {owner: i for i, owner in enumerate(dict.fromkeys(self._owners))}
        table = np.zeros((len(number), len(number)), dtype=np.bool_)
        for both in pairs:
            one, two = (tuple(both) * 2)[:2]
            if one in number and two in number:
                table[number[one], number[two]] = table[number[two], number[one]] = True
        index = [number[owner] for owner in self._owners]
        return table[np.ix_(index, index)]

    def _unchecked(self) -> Iterator[tuple[str, str]]:
        """Pairs of one arm's links and held objects that need no check."""
        for arm, _, _, never in self._content.arms:
            for one, *two in map(tuple, never):
                yield f"{arm}/{one}", f"{arm}/{two[0] if two else one}"
        for name, arm, link, touch in self._content.held:
            for near in touch | {link}:
                yield name, f"{arm}/{near}"
            for other, *also, _ in self._content.held:
                if also == [arm, link]:
                    yield name, other

    def _blocks(self, special: Mapping[_Names, float]) -> Iterator[tuple[int, float, list[int], list[int]]]:
        """Blocks of the padding table: rank (the higher wins, then the larger distance), distance, rows, columns."""
        for both, distance in special.items():
            # A rule with one arm name applies to pairs of that arm.
            a, b = (tuple(both) * 2)[:2]
            for x, y in {(a, b), (b, a)}:
                rank = (x in self._index) + (y in self._index)
                yield rank, distance, self._members(x), self._members(y)

    def _members(self, name: str) -> list[int]:
        index = self._index.get(name)
        return self._of_arm.get(name, []) if index is None else [index]
