"""Shortening a path by random shortcuts, one try per step.

Geraerts, Overmars, "Creating high-quality paths for motion planning", IJRR 26 (2007).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rr1plan.checks import Array, Seed, as_generator, finite_array, whole_number
from rr1plan.collision import CollisionChecker
from rr1plan.path import edge_lengths


class Shortcut(NamedTuple):
    """One try.

    Args:
        begin: A point on the path [rad or m], shape (nq,).
        end: Another one, farther along it, shape (nq,).
        free: Whether the straight line between them is certified free, and used.
        path: The path afterwards, shape (k, nq).
    """

    begin: Array
    end: Array
    free: bool
    path: Array


def record_shortcuts(
    checker: CollisionChecker, waypoints: ArrayLike, *, tries: int = 60, rng: Seed = 0
) -> tuple[Shortcut, ...]:
    """Repeatedly connect two random points of a path by a straight line.

    Args:
        checker: Certifies edges.
        waypoints: A free path, continuous across the seams [rad or m], shape (k, nq).
        tries: Number of tries.
        rng: Seed or generator.

    Raises:
        InputError: not waypoints, or a number out of range.
    """
    path = np.array(finite_array("waypoints", waypoints, (None, checker.nq)))
    tries, generator, found = whole_number("tries", tries, 1, 10_000), as_generator(rng), []
    for _ in range(tries):
        lengths = np.concatenate([[0.0], np.cumsum(edge_lengths(path))])
        first, second = np.sort(generator.uniform(0.0, lengths[-1], 2))
        begin, end = (np.array([np.interp(at, lengths, column) for column in path.T]) for at in (first, second))
        free = checker.edge_is_free(begin, end)
        if free:
            before, after = lengths < first, lengths > second
            path = np.vstack([path[before], begin, end, path[after]])
        found.append(Shortcut(begin, end, free, path))
    return tuple(found)
