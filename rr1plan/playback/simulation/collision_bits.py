"""MuJoCo's collision bits (contype and conaffinity) for models of many arms.

MuJoCo checks two geoms if the contype of one and the conaffinity of the other share a bit. It also supports excluded
pairs of bodies, but searches all of them for each pair of bodies near each other, which takes most of a step for
hundreds of arms. Arms that can meet have different colors: a color is a bit in contype, with the bits of all other
colors in conaffinity. The checked pairs of links within one arm are covered by products of two sets of links. Each
product has a bit, and all arms share these bits.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import combinations

from rr1plan.collision.arm_groups import arms_in_reach
from rr1plan.scene import Scene

# Bit of obstacles and loose bodies; index of the first bit for products, number of these bits, and number of colors.
OTHERS = 1
_FIRST, _OWN, _COLORS = 1, 8, 22


def collision_bits(scene: Scene) -> dict[str, tuple[int, int]]:
    """Contype and conaffinity of links and held objects, by name.

    Args:
        scene: The scene.

    Returns:
        The bits of all arms for which they suffice. Elements of other arms have `OTHERS` for both, and their unchecked
            pairs have to be excluded.
    """
    colors = _colored(arms_in_reach(scene, scene.arms, 0.0))
    owned: dict[str, list[str]] = {name: [] for name in scene.arms}
    for element in scene.element_names:
        owner = scene.owner(element)
        if owner is not None:
            owned[owner].append(element)
    found = {}
    every = ((1 << _COLORS) - 1) << (_FIRST + _OWN)
    for arm, color in colors.items():
        elements = owned[arm]
        pairs = [pair for pair in combinations(elements, 2) if not scene.may_touch(*pair)]
        products = products_of(pairs)
        if len(products) > _OWN:
            continue
        mine = 1 << (_FIRST + _OWN + color)
        for element in elements:
            kinds = sum(1 << (_FIRST + i) for i, (one, _) in enumerate(products) if element in one)
            checked = sum(1 << (_FIRST + i) for i, (_, other) in enumerate(products) if element in other)
            found[element] = mine | kinds, OTHERS | (every & ~mine) | checked
    return found


def products_of(pairs: Iterable[tuple[str, str]]) -> list[tuple[set[str], set[str]]]:
    """Products of two sets that cover exactly the given pairs."""
    partners: dict[str, set[str]] = {}
    for a, b in pairs:
        partners.setdefault(a, set()).add(b)
        partners.setdefault(b, set()).add(a)
    left = {name: set(others) for name, others in partners.items()}
    found = []
    for name in partners:
        if others := set(left[name]):
            alike = {other for other, theirs in partners.items() if others <= theirs}
            found.append((alike, others))
            for one in alike:
                left[one] -= others
            for one in others:
                left[one] -= alike
    return found


def _colored(near: Mapping[str, Iterable[str]]) -> dict[str, int]:
    """Colors of arms, different for arms that can meet; arms for which no color is left are omitted."""
    colors: dict[str, int] = {}
    for arm, others in near.items():
        taken = {colors.get(other) for other in others}
        free = (color for color in range(_COLORS) if color not in taken)
        if (color := next(free, None)) is not None:
            colors[arm] = color
    return colors
