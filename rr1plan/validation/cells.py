"""How far a convex body is from the nearest cell of a point cloud, compiled.

The search of `apart.py` for one cell after the other, the nearest first. Boxes around blocks of cells and around single
ones, and the plane that parted the body from the cell asked last, are lower bounds that leave few to ask.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rr1plan.validation.apart import BOUND, MIDDLE, ORIGIN, ROUND, part_bodies, reach
from rr1plan.validation.compiled import F64, FLOATS2, INTS1, INTS2, OUT1, OUT2, entry, part

# Cells that could be nearer than the nearest by less than this are not asked [m].
_ROUNDING = 1e-9


@part
def _box_gap(sizes: Any, placed: Any, x: float, y: float, z: float, hx: float, hy: float, hz: float) -> float:
    """A lower bound of the distance of body 0 to an upright box [m]; 0 where the bounding boxes meet."""
    x, y, z = x - placed[0, MIDDLE], y - placed[0, MIDDLE + 1], z - placed[0, MIDDLE + 2]
    total = 0.0
    for j in range(3):
        u, v, w = placed[0, j], placed[0, 3 + j], placed[0, 6 + j]
        along = abs(u * x + v * y + w * z) - sizes[0, BOUND + j] - (abs(u) * hx + abs(v) * hy + abs(w) * hz)
        if along > 0.0:
            total += along * along
    return float(np.sqrt(total))


@part
def _ask(
    kinds: Any, sizes: Any, corners: Any, placed: Any, centers: Any, i: int, known: Any, share: Any, best: float
) -> tuple[float, float, float, float, float]:
    """Bounds of the distance of body 0 to cell i, without its rounding, and the direction that proves the lower."""
    for k in range(3):
        placed[1, ORIGIN + k] = placed[1, MIDDLE + k] = centers[i, k]
    return part_bodies(kinds, sizes, corners, placed, 0, 1, known, share, 1e300, best + sizes[0, ROUND])


@entry((INTS2, FLOATS2, FLOATS2, OUT2, FLOATS2, F64, FLOATS2, FLOATS2, INTS1, INTS1, OUT1))
def nearest_cell(
    kinds: Any,
    sizes: Any,
    corners: Any,
    placed: Any,
    centers: Any,
    half: float,
    middles: Any,
    halves: Any,
    firsts: Any,
    counts: Any,
    answer: Any,
) -> None:
    """Write the distance of a convex body to the nearest cell and a proven bound of it [m], both 0 in contact.

    Args:
        kinds: Kinds of the body and of a cell, shape (2, 6), as `apart.py` reads them.
        sizes: Their sizes, shape (2, 23).
        corners: Corners of the body, shape (4, n).
        placed: Where the body is in the cloud's frame, shape (2, 15); the second row is written to.
        centers: Centres of the cells, block after block, shape (m, 3).
        half: Half a cell's edge.
        middles: Centres of the blocks, shape (b, 3).
        halves: Half their edges, shape (b, 3).
        firsts: First cell of each block, shape (b,).
        counts: Number of its cells, shape (b,).
        answer: Out, shape (3,); the last is the number of cells asked.
    """
    blocks = len(middles)
    bound, most = np.empty(blocks), 0
    for b in range(blocks):
        bound[b] = _box_gap(
            sizes, placed, middles[b, 0], middles[b, 1], middles[b, 2], halves[b, 0], halves[b, 1], halves[b, 2]
        )
        most = max(most, counts[b])
    near, known, share = np.empty(most), np.zeros((5, 9)), np.zeros((3, 4))
    best, proven, rounding = 1e300, 1e300, sizes[0, ROUND]
    answer[0], answer[1], answer[2] = 0.0, 0.0, 0.0
    while True:
        b = int(np.argmin(bound))
        if bound[b] >= best - _ROUNDING:
            break
        bound[b] = np.inf
        first, count = firsts[b], counts[b]
        for i in range(count):
            c = first + i
            near[i] = _box_gap(sizes, placed, centers[c, 0], centers[c, 1], centers[c, 2], half, half, half)
        while True:
            i = int(np.argmin(near[:count]))
            if near[i] >= best - _ROUNDING:
                break
            near[i] = np.inf
            answer[2] += 1.0
            upper, lower, x, y, z = _ask(kinds, sizes, corners, placed, centers, first + i, known, share, best)
            if lower - rounding <= 0.0:
                return
            best, proven = min(best, upper - rounding), min(proven, lower - rounding)
            # All cells beyond the plane that parts the two are as far at least.
            edge = reach(kinds, sizes, corners, placed, 0, x, y, z) + half * (abs(x) + abs(y) + abs(z))
            edge += x * placed[0, ORIGIN] + y * placed[0, ORIGIN + 1] + z * placed[0, ORIGIN + 2]
            for i in range(count):
                c = first + i
                near[i] = max(near[i], x * centers[c, 0] + y * centers[c, 1] + z * centers[c, 2] - edge)
    answer[0], answer[1] = best, min(best, proven) - _ROUNDING
