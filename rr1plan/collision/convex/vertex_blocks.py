"""Points put in an order in which blocks of neighbors follow each other, and balls around the blocks."""

from __future__ import annotations

import numpy as np

from rr1plan.checks import Array
from rr1plan.kernels.planner_kernels import constants

BLOCK = constants()["BLOCK_POINTS"]
"""Neighboring corners of a core in a block."""

# Beyond all rounding in a support value.
_SAFETY = 1.0 + 1e-9
_ROUNDING = 1e-12


def in_vertex_blocks(points: Array) -> tuple[Array, Array]:
    """Points in blocks of neighbors, and a ball around each block.

    Args:
        points: Points [m], shape (n, 3).

    Returns:
        The same points in another order, neighbors side by side, shape (n, 3); centers and radii of the balls around
        each `BLOCK` of them [m], shape (ceil(n / BLOCK), 4).
    """
    ordered = np.array(_split(points))
    balls = []
    for first in range(0, len(points), BLOCK):
        block = ordered[first : first + BLOCK]
        center = 0.5 * (block.min(axis=0) + block.max(axis=0))
        radius = float(np.linalg.norm(block - center, axis=1).max())
        balls.append([*center, radius * _SAFETY + _ROUNDING * (1.0 + float(np.abs(block).max()))])
    return ordered, np.array(balls)


def _split(points: Array) -> list[Array]:
    """Points cut in halves across their longest side again and again, of whole blocks where there is more than one."""
    if len(points) == 1:
        return [points[0]]
    order = np.argsort(points[:, np.ptp(points, axis=0).argmax()], kind="stable")
    blocks = (len(points) + BLOCK - 1) // BLOCK
    half = max(blocks // 2 * BLOCK, BLOCK) if blocks > 1 else len(points) // 2
    return _split(points[order[:half]]) + _split(points[order[half:]])
