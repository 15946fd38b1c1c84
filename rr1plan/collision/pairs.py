"""Which pairs of solids are checked: scenes that differ only in where their obstacles are share the answer."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import read_only
from rr1plan.collision.carried import Carried, Solid
from rr1plan.collision.standing import Standing
from rr1plan.contact_rules import ContactRules
from rr1plan.errors import InputError

_INTS = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class SolidPairs:
    """The pairs of solids that must not touch; solids are counted carried first, then standing.

    Args:
        carried: What the arms carry.
        moving: Pairs of solids [index] whose relative pose depends on q, shape (m, 2).
        moving_owner: For each of those the index in `scene.checked_pairs`, shape (m,).
        moving_rows: The same pairs, a half-space or point cloud second, and how many driven joints move both;
            shape (m, 3).
        resting, resting_owner, resting_rows: The same of pairs that do not move against each other.
        surfaceless: Which solids are half-spaces or point clouds, shape (n,).
    """

    carried: Carried
    moving: _INTS
    moving_owner: _INTS
    moving_rows: _INTS
    resting: _INTS
    resting_owner: _INTS
    resting_rows: _INTS
    surfaceless: NDArray[np.bool_]

    def check_kinds(self, solids: tuple[Solid, ...]) -> None:
        """Refuse moving pairs of which neither has a surface to measure from.

        Raises:
            InputError: a half-space or a point cloud that would be checked against another one.
        """
        both = self.surfaceless[self.moving].all(axis=1)
        if both.any():
            one, two = (solids[i].element for i in self.moving[int(both.argmax())])
            raise InputError(f"{one!r} and {two!r} are half-spaces or point clouds; they cannot be checked")


def solid_pairs(carried: Carried, standing: tuple[Standing, ...], rules: ContactRules) -> SolidPairs:
    """The pairs of a scene's solids; scenes with equal arms, rules and kinds of obstacles get the same.

    Args:
        carried: What the arms carry.
        standing: Its obstacles, in the order of the scene.
        rules: Which elements must not touch.
    """
    return _solid_pairs(_Content(carried, rules, tuple(thing.surfaceless for thing in standing)))


@dataclass(frozen=True)
class _Content:
    """All that the pairs depend on, to compare."""

    carried: Carried
    rules: ContactRules
    surfaceless: tuple[tuple[bool, ...], ...]


@lru_cache(maxsize=128)
def _solid_pairs(content: _Content) -> SolidPairs:
    carried, rules = content.carried, content.rules
    number = {name: i for i, name in enumerate(rules.names)}
    held = [number[s.element] for s in carried.solids]
    still = np.repeat(np.array(rules.obstacles, np.int64), [len(kinds) for kinds in content.surfaceless])
    index, owner = _pairs_of(rules.checked, np.concatenate([np.array(held, np.int64), still]), len(number))
    groups = np.concatenate([carried.groups, np.zeros(len(still), np.int64)])
    surfaceless = np.array([*carried.surfaceless, *chain.from_iterable(content.surfaceless)], np.bool_)
    one, two = groups[index].T
    moves = one != two
    # Pairs are measured from the first to the second.
    turned = np.where(surfaceless[index[:, 0]][:, None], index[:, ::-1], index)
    rows = np.column_stack([turned, np.where(moves, carried.shared[one, two], 0)])
    return SolidPairs(
        carried,
        read_only(index[moves]),
        read_only(owner[moves]),
        read_only(rows[moves]),
        read_only(index[~moves]),
        read_only(owner[~moves]),
        read_only(rows[~moves]),
        read_only(surfaceless),
    )


def _pairs_of(checked: _INTS, elements: _INTS, count: int) -> tuple[_INTS, _INTS]:
    """Pairs of solids (m, 2) and the pair of elements each belongs to (m,); an element's solids are neighbours.

    Args:
        checked: Pairs of elements, shape (k, 2).
        elements: The element of each solid, shape (n,).
        count: How many elements there are.
    """
    sizes = np.bincount(elements, minlength=count)
    first = np.zeros(count, np.int64)
    first[elements[::-1]] = np.arange(len(elements))[::-1]
    a, b = checked.T
    many = sizes[a] * sizes[b]
    owner = np.repeat(np.arange(len(a)), many)
    place = np.arange(len(owner)) - (np.cumsum(many) - many)[owner]
    a, b = a[owner], b[owner]
    return np.column_stack([first[a] + place // sizes[b], first[b] + place % sizes[b]]), owner
