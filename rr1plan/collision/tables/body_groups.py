"""Bodies that one joint carries, together: what a whole group clears, none of its bodies has to be asked about."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array

_INTS = NDArray[np.int64]


def group_rows(frames: list[int], chains: list[list[int]], reaches: list[list[float]]) -> tuple[_INTS, _INTS, Array]:
    """Neighboring bodies of one joint put into groups.

    Args:
        frames: The joint that carries each body.
        chains: Joints above each, root first.
        reaches: For each of those, how far points of the body can be from its axis [m].

    Returns:
        The kernel's `groups` without balls, its `chain` and its `chain_reach`.
    """
    begins = [b for b in range(len(frames)) if b == 0 or frames[b] != frames[b - 1]]
    rows = []
    chain: list[int] = []
    reach: list[float] = []
    for first, last in pairwise([*begins, len(frames)]):
        rows.append((frames[first], -1, first, last, len(chain), len(chain) + len(chains[first])))
        chain += chains[first]
        reach += np.max(reaches[first:last], axis=0).tolist()
    return np.array(rows, np.int64).reshape(-1, 6), np.array(chain, np.int64), np.array(reach, np.float64)


def group_pairs_of(body_pairs: _INTS, group: _INTS) -> tuple[_INTS, _INTS]:
    """Pairs of bodies sorted by the pair of groups they belong to.

    Args:
        body_pairs: Body, body, joints that move both, and more; shape (m, k).
        group: The group of each body.

    Returns:
        The same rows in another order, and the kernel's `families`, shape (f, 5).
    """
    if not len(body_pairs):
        return body_pairs, np.zeros((0, 5), np.int64)
    one, two, shared = group[body_pairs[:, 0]], group[body_pairs[:, 1]], body_pairs[:, 2]
    # One number for each pair of groups and the joints that move both, in their order.
    sizes = int(group.max()) + 1, int(shared.max()) + 1
    keys = (one * sizes[0] + two) * sizes[1] + shared
    order = np.argsort(keys, kind="stable")
    begins = np.flatnonzero(np.diff(keys[order], prepend=-1))
    first = order[begins]
    ends = np.append(begins[1:], len(order))
    return body_pairs[order], np.column_stack([one[first], two[first], shared[first], begins, ends])
