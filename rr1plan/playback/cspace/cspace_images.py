"""The image of each obstacle in the plane of two joints, on a grid of cells.

Every cell is one configuration, its center, and every answer is Coal's. A block of cells is free of a pair of solids as
a whole when their distance at its center exceeds how far they can approach on the way to the block's farthest cell
(Lozano-Perez 1983 for the picture; the bound is the one of Schwarzer, Saha, Latombe 2005), and forbidden as a whole
when they are deeper in each other than that. Other blocks are quartered, with those pairs that are left, so only cells
at the rim of an obstacle's image are looked at one by one.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.collision.contact_cells import ContactCells
from rr1plan.playback.cspace.cspace_cells import Mask
from rr1plan.scene import Scene
from rr1plan.shapes import PointCloud

SELF = "self-collision"
_BLOCKS = (16, 8, 4, 2, 1)  # cells along the side of a block
_SLACK = 1e-6  # how much a depth may be overestimated [m]
_REPORT_EVERY = 256  # blocks between reports of progress
_QUARTERS = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])


class Images:
    """Computes the image of every obstacle by blocks, then by cells.

    Args:
        checker: Answers about the arm's configurations.
        configuration: The arm's configuration, shape (nq,) [rad or m]; two of its columns are replaced.
        columns: Those two.
        axes: Values at the cell centers of each of them, shapes (n,) and (m,).
        progress: Called with the fraction done, 0 to 1.
    """

    def __init__(
        self,
        checker: CollisionChecker,
        configuration: Array,
        columns: tuple[int, int],
        axes: tuple[Array, Array],
        progress: Callable[[float], None] | None,
    ) -> None:
        self.checker = checker
        self.q = np.array(configuration)
        self.columns = list(columns)
        self.axes = axes
        self.progress = progress
        self.shape = (len(axes[0]), len(axes[1]))
        self.cells = ContactCells(checker, self.q, columns)
        owners = [layer_of(checker.scene, pair, checker.arms[0]) for pair in checker.pairs]
        self.names = tuple(dict.fromkeys(owners))
        self.hits = {name: np.zeros(self.shape, dtype=np.bool_) for name in self.names}
        self.owner = [owners[k] for k in checker.solid_owner]
        clouds = np.array([isinstance(solid.shape, PointCloud) for solid in checker.solids], dtype=np.bool_)
        # The depth of a point cloud is no depth of a solid.
        self.convex: Mask = np.logical_not(clouds[checker.solid_pairs].any(axis=1))

    def compute(self) -> dict[str, Mask]:
        """The cells that each obstacle (and "self-collision") makes impossible."""
        for pair in self.checker.static_contacts:
            self.hits[layer_of(self.checker.scene, pair, self.checker.arms[0])][:] = True
        side = _BLOCKS[0]
        blocks = np.argwhere(np.ones([-(-n // side) for n in self.shape], dtype=np.bool_)) * side
        near = np.ones((len(blocks), len(self.owner)), dtype=np.bool_)
        for side in _BLOCKS:
            near = self._look_at(blocks, near, side)
            left = near.any(axis=1)
            blocks = (blocks[left][:, None] + side // 2 * _QUARTERS).reshape(-1, 2)
            within = np.asarray((blocks < self.shape).all(axis=1))
            blocks, near = blocks[within], near[left].repeat(4, axis=0)[within]
        return {name: mask for name, mask in self.hits.items() if mask.any() or name != SELF}

    def _look_at(self, blocks: NDArray[np.intp], near: Mask, side: int) -> Mask:
        """Mark the blocks that are forbidden as a whole; which pairs are undecided in each, shape (n, pairs)."""
        ends = np.minimum(blocks + side, self.shape)
        low, high = (
            np.column_stack([axis[k] for axis, k in zip(self.axes, at.T, strict=True)]) for at in (blocks, ends - 1)
        )
        centers, half = 0.5 * (low + high), 0.5 * (high - low).max(axis=0, initial=0.0)
        travel, left = self.cells.travels(centers, half, near), np.zeros_like(near)
        for k, (begin, end) in enumerate(zip(blocks, ends, strict=True)):
            self._report(side, k / len(blocks), k)
            pairs = np.flatnonzero(near[k])
            self.q[self.columns] = centers[k]
            clearance = self.checker.solid_distances(self.q, pairs) - self.checker.solid_padding[pairs]
            most = travel[k, pairs]
            # Where a capsule's core lies in the other's surface Coal may answer a depth of 1e308 m.
            deep = self.convex[pairs] & (clearance < -most - _SLACK) & (clearance > -1e9)
            inside = np.where(most > 0.0, deep, clearance <= 0.0)
            for name in {self.owner[pair] for pair in pairs[inside]}:
                self.hits[name][begin[0] : end[0], begin[1] : end[1]] = True
            left[k, pairs] = (most > 0.0) & ~inside & (clearance <= most + 1e-9)
        return left

    def _report(self, side: int, part: float, count: int) -> None:
        """Report progress: each round has about twice as many blocks as the one before."""
        if self.progress is not None and count % _REPORT_EVERY == 0:
            rounds = _BLOCKS.index(side)
            self.progress((2**rounds - 1 + 2**rounds * part) / (2 ** len(_BLOCKS) - 1))


def layer_of(scene: Scene, pair: tuple[str, str], arm: str) -> str:
    """The layer that a contact of an arm belongs to: the obstacle, the other arm, or self-collision."""
    for name in pair:
        if name in scene.obstacles:
            return name
    others = [owner for owner in map(scene.owner, pair) if owner != arm]
    return f"{others[-1]}" if others else SELF
