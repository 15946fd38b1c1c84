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
