"""The image of each obstacle in the plane of two joints, on a grid of cells.

Every cell is one configuration, its centre, and every answer is Coal's. A block of cells is free of an obstacle as a
whole when the clearance at its centre exceeds how far any point of the arm can move on the way to the block's farthest
cell (Lozano-Perez 1983 for the picture; the bound is the one of Schwarzer, Saha, Latombe 2005), and forbidden by it as
a whole when two convex solids are deeper in each other than that. Other blocks are quartered, so only cells at the rim
of an obstacle's image are asked for one by one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.playback.cspace_cells import Mask
from rr1plan.playback.outlines import bounding_radius
from rr1plan.robot import Geometry
from rr1plan.scene import Scene
from rr1plan.shapes import PointCloud

SELF = "self-collision"
_BLOCK = 16
_SLACK = 1e-6  # how much a depth may be overestimated [m]


class Images:
    """Computes the image of every obstacle by blocks, then by cells.

    Args:
        checker: Answers about the arm's configurations.
        posture: The arm's configuration, shape (nq,) [rad or m]; two of its columns are replaced.
        columns: Those two.
        axes: Values at the cell centres of each of them, shapes (n,) and (m,).
        progress: Called with the fraction done, 0 to 1.
    """

    def __init__(
        self,
        checker: CollisionChecker,
        posture: Array,
        columns: list[int],
        axes: tuple[Array, ...],
        progress: Callable[[float], None] | None,
    ) -> None:
        self.checker = checker
        self.q = np.array(posture)
        self.columns = columns
        self.axes = axes
        self.progress = progress
        self.owners = [_layer_of(checker.scene, pair) for pair in checker.pairs]
        self.padding = np.array([checker.scene.padding_of(a, b) for a, b in checker.pairs])
        self.convex = np.array([not _has_cloud(checker.scene, pair) for pair in checker.pairs], dtype=bool)
        self.reach = _reach(checker.scene, checker.arms[0], columns)

    def compute(self) -> dict[str, Mask]:
        """The cells that each obstacle (and "self-collision") makes impossible."""
        shape = (len(self.axes[0]), len(self.axes[1]))
        hits = {name: np.zeros(shape, dtype=bool) for name in dict.fromkeys(self.owners)}
        blocks = [(i, j) for i in range(0, shape[0], _BLOCK) for j in range(0, shape[1], _BLOCK)]
        for done, (i, j) in enumerate(blocks):
            self._block(i, j, _BLOCK, hits)
            if self.progress is not None and done % 64 == 0:
                self.progress(done / len(blocks))
        return {name: mask for name, mask in hits.items() if mask.any() or name != SELF}

    def _block(self, i: int, j: int, size: int, hits: dict[str, Mask]) -> None:
        rows, cols = self.axes[0][i : i + size], self.axes[1][j : j + size]
        if len(rows) == 0 or len(cols) == 0:
            return
        travel = self.reach[0] * 0.5 * (rows[-1] - rows[0]) + self.reach[1] * 0.5 * (cols[-1] - cols[0])
        clearance = self._distances(0.5 * (rows[0] + rows[-1]), 0.5 * (cols[0] + cols[-1])) - self.padding
        single = len(rows) == len(cols) == 1
        # Where a capsule's core lies in the other's surface Coal may answer a depth of 1e308 m.
        inside = clearance <= 0.0 if single else self.convex & (clearance < -travel - _SLACK) & (clearance > -1e9)
        if single or (inside | (clearance > travel + 1e-9)).all():
            for index in np.flatnonzero(inside):
                hits[self.owners[index]][i : i + size, j : j + size] = True
            return
        half = size // 2
        for di, dj in ((0, 0), (0, half), (half, 0), (half, half)):
            self._block(i + di, j + dj, half, hits)

    def _distances(self, first: float, second: float) -> Array:
        self.q[self.columns[0]] = first
        self.q[self.columns[1]] = second
        return self.checker.distances(self.q)


def _layer_of(scene: Scene, pair: tuple[str, str]) -> str:
    """The layer a pair's contact belongs to: the obstacle, the other arm, or self-collision."""
    for name in pair:
        if name in scene.obstacles:
            return name
    first, second = (scene.owner(name) for name in pair)
    return SELF if first == second else f"{second}"


def _has_cloud(scene: Scene, pair: tuple[str, str]) -> bool:
    """Whether one of the elements holds a point cloud, whose depth is no depth of a solid."""
    return any(isinstance(shape, PointCloud) for name in pair for shape in _shapes_of(scene, name))


def _shapes_of(scene: Scene, name: str) -> list[Any]:
    holder = scene.obstacles.get(name) or scene.attachments.get(name)
    return [] if holder is None else [g.shape for g in holder.geometries]


def _reach(scene: Scene, arm: str, columns: list[int]) -> tuple[float, float]:
    """How far any point of the arm can be from each joint's axis [m]: an upper bound of link lengths and sizes."""
    robot = scene.arms[arm].robot
    size: dict[str, float] = {}
    for joint in reversed(robot.joints):
        own = max((_radius_of(g) for g in robot.link(joint.child).collisions), default=0.0)
        held = (a for a in scene.attachments.values() if a.arm == arm and a.link == joint.child)
        for attachment in held:
            start = float(np.linalg.norm(attachment.pose[:3, 3]))
            own = max(own, *(start + _radius_of(g) for g in attachment.geometries))
        size[joint.child] = max(own, size.get(joint.child, 0.0))
        slide = max(abs(joint.lower), abs(joint.upper)) if joint.kind == "prismatic" else 0.0
        step = float(np.linalg.norm(joint.origin[:3, 3])) + slide
        size[joint.parent] = max(size.get(joint.parent, 0.0), step + size[joint.child])
    moving = (robot.joint(robot.joint_names[c]) for c in columns)
    first, second = (1.0 if j.kind == "prismatic" else size[j.child] for j in moving)
    return first, second


def _radius_of(geometry: Geometry) -> float:
    """How far it reaches from the origin of the frame it stands in [m]."""
    return float(np.linalg.norm(geometry.pose[:3, 3])) + bounding_radius(geometry.shape)
