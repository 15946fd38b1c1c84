"""Points put in an order in which blocks of neighbours follow each other, and balls around the blocks."""

from __future__ import annotations

import numpy as np

from rr1plan._kernels.cover import BLOCK
from rr1plan.checks import Array

# Beyond all rounding in a support value.
_SAFETY = 1.0 + 1e-9
_ROUNDING = 1e-12


def in_blocks(points: Array) -> tuple[Array, Array]:
    """Points in blocks of neighbours, and a ball around each block.

    Args:
        points: Points [m], shape (n, 3).

    Returns:
        The same points in another order, the one farthest out of each block first, shape (n, 3); centres and radii of
        the balls around each `BLOCK` of them [m], shape (ceil(n / BLOCK), 4).
    """
    middle = points.mean(axis=0)
    blocks = [_outermost_first(block, middle) for block in _split(points)]
    balls = []
    for block in blocks:
        centre = 0.5 * (block.min(axis=0) + block.max(axis=0))
        radius = float(np.linalg.norm(block - centre, axis=1).max())
        balls.append([*centre, radius * _SAFETY + _ROUNDING * (1.0 + float(np.abs(block).max()))])
    return np.concatenate(blocks), np.array(balls)


def _split(points: Array) -> list[Array]:
    """Points cut in halves of whole blocks across their longest side, until each is one block."""
    if len(points) <= BLOCK:
        return [points]
    order = np.argsort(points[:, np.ptp(points, axis=0).argmax()], kind="stable")
    half = (len(points) + BLOCK - 1) // BLOCK // 2 * BLOCK
    half = max(half, BLOCK)
    return _split(points[order[:half]]) + _split(points[order[half:]])


def _outermost_first(block: Array, middle: Array) -> Array:
    outward = (block - middle) @ (block.mean(axis=0) - middle)
    first = int(outward.argmax())
    return np.concatenate([block[first : first + 1], block[:first], block[first + 1 :]])
