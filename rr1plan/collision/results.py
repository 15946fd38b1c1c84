"""Results about two elements: a contact, the nearest pair."""

from __future__ import annotations

from dataclasses import dataclass

from rr1plan.checks import Array, Value


@dataclass(frozen=True, eq=False, repr=False)
class Contact(Value):
    """Two elements that touch, or come nearer than their padding.

    Args:
        a, b: The elements.
        depth: Padding less distance [m], >= 0.
        point: Halfway between the two deepest points, in the world [m], shape (3,).
    """

    a: str
    b: str
    depth: float
    point: Array


@dataclass(frozen=True, eq=False, repr=False)
class Nearest(Value):
    """The two elements that are nearest to each other.

    Args:
        distance: Their distance [m], negative where they overlap; inf when no pair is checked.
        pair: The elements; empty when no pair is checked.
        point_a, point_b: The nearest points in the world [m], shape (3,).
    """

    distance: float
    pair: tuple[str, ...]
    point_a: Array
    point_b: Array
