"""Bits by which MuJoCo leaves out what an arm may touch of itself, in models of many arms.

Two shapes are checked if the type bits of one meet the affinity bits of the other. MuJoCo also knows excluded pairs of
bodies, but goes through all of them for each two bodies that are near each other, which takes most of a step of
hundreds of arms. Arms that can meet have different colors: a bit of type, and affinity to all other colors. What an arm
is checked for of itself is covered by products of sets, with a bit for each that all arms share.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import combinations

from rr1plan.collision.arm_groups import arms_in_reach
from rr1plan.scene import Scene

# Of obstacles and loose bodies; of planes, which are checked for loose bodies and pair by pair for arms.
OTHERS, PLANES = 1, 2
_FIRST, _OWN, _COLORS = 2, 8, 21


def collision_bits(scene: Scene) -> dict[str, tuple[int, int]]:
    """Type and affinity bits of what arms consist of and hold, by the name of the element.

    Args:
        scene: The scene.

    Returns:
        For those arms for which there are enough bits; shapes of others have to be excluded in pairs, and have
        `OTHERS` for both.
    """
    colors = _colored(arms_in_reach(scene, scene.arms, 0.0))
    owned: dict[str, list[str]] = {name: [] for name in scene.arms}
    for element in scene.element_names:
        owner = scene.owner(element)
        if owner is not None:
            owned[owner].append(element)
    found = {}
    every = sum(1 << (_FIRST + _OWN + color) for color in range(_COLORS))
    for arm, color in colors.items():
        elements = owned[arm]
        pairs = [pair for pair in combinations(elements, 2) if not scene.may_touch(*pair)]
        products = products_of(pairs)
        if len(products) > _OWN:
            continue
        mine = 1 << (_FIRST + _OWN + color)
        for element in elements:
            bits = [mine, OTHERS | (every & ~mine)]
            for i, product in enumerate(products):
                for side in (0, 1):
                    bits[side] |= (element in product[side]) << (_FIRST + i)
            found[element] = bits[0], bits[1]
    return found


def products_of(pairs: Iterable[tuple[str, str]]) -> list[tuple[set[str], set[str]]]:
    """Products of two sets that cover some pairs and no others."""
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
    """Colors of arms, those that can meet have different ones; not of those for which none is left."""
    colors: dict[str, int] = {}
    for arm, others in near.items():
        taken = {colors.get(other) for other in others}
        free = (color for color in range(_COLORS) if color not in taken)
        if (color := next(free, None)) is not None:
            colors[arm] = color
    return colors
