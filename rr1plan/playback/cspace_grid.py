"""The configuration space of two joints on a grid: each obstacle's image, free space and its components.

Idea: every cell is one configuration, its centre, and every answer is Coal's. A block of cells is
free of an obstacle as a whole when the clearance at its centre exceeds how far any point of the
arm can move on the way to the block's farthest cell (Lozano-Perez 1983 for the picture; the bound
is the one of Schwarzer, Saha, Latombe 2005), and forbidden by it as a whole when two convex solids
are deeper in each other than that. Other blocks are quartered, so only cells at the rim of an
obstacle's image are asked for one by one. Components of free space are joined across the seams of
the torus.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from rr1plan.checks import Array, finite_array, known_name, read_only
from rr1plan.collision import CollisionChecker
from rr1plan.errors import InputError
from rr1plan.playback.outlines import bounding_radius
from rr1plan.scene import Scene
from rr1plan.shapes import PointCloud

Mask = NDArray[np.bool_]
SELF = "self-collision"
LIMITS = "joint limits"
_BLOCK = 16
_SLACK = 1e-6  # how much a depth may be overestimated [m]


@dataclass(frozen=True, eq=False)
class CSpaceGrid:
    """Configuration space of two joints, cell by cell; index [i, j] is (first joint, second joint).

    Args:
        scene: The scene; everything but the two joints stands as it does there.
        arm: The arm the joints belong to.
        joint_names: The two joints.
        axes: Values at the cell centres of each joint [rad], shapes (n,) and (m,).
        periodic: Whether each axis is a full turn whose ends are the same place.
        layers: For each obstacle (and "self-collision", "joint limits") the cells it makes impossible,
            shape (n, m).
        labels: Number of the component of free space of each cell, 0 where it is not free.
    """

    scene: Scene
    arm: str
    joint_names: tuple[str, str]
    axes: tuple[Array, Array]
    periodic: tuple[bool, bool]
    layers: Mapping[str, Mask]
    labels: NDArray[np.int32] = field(repr=False)

    @property
    def free(self) -> Mask:
        """Cells that nothing forbids, shape (n, m)."""
        return self.labels > 0

    @property
    def components(self) -> int:
        """Number of components of free space on the grid."""
        return int(self.labels.max(initial=0))

    def cell(self, q: Any) -> tuple[int, int]:
        """The cell that holds a configuration (2,) [rad]; periodic joints are wrapped.

        Raises:
            InputError: not two finite numbers, or outside the picture.
        """
        pair = finite_array("q", q, (2,))
        i, j = (self._index(axis, float(value)) for axis, value in enumerate(pair))
        return i, j

    def _index(self, axis: int, value: float) -> int:
        centres = self.axes[axis]
        step = float(centres[1] - centres[0])
        index = int(np.floor((value - centres[0]) / step + 0.5))
        if self.periodic[axis]:
            return index % len(centres)
        if index == len(centres) and value <= centres[-1] + step * (0.5 + 1e-9):
            index -= 1
        if not 0 <= index < len(centres):
            raise InputError(f"{self.joint_names[axis]} = {value} is outside the picture")
        return index

    def component_of(self, q: Any) -> int:
        """Number of the component of free space that holds a configuration (2,), 0 if it is not free."""
        return int(self.labels[self.cell(q)])

    def connected(self, a: Any, b: Any) -> bool:
        """Whether two configurations (2,) are free and in the same component of free space on the grid."""
        first, second = self.component_of(a), self.component_of(b)
        return first > 0 and first == second

    def why_not_free(self, q: Any) -> tuple[str, ...]:
        """Names of the layers that forbid the cell of a configuration (2,)."""
        cell = self.cell(q)
        return tuple(name for name, mask in self.layers.items() if mask[cell])

    def shortest_path(self, a: Any, b: Any) -> Array | None:
        """A shortest path over free cells (8 neighbours, Dijkstra 1959), unwrapped across the seams.

        Args:
            a: Start [rad], shape (2,).
            b: Goal [rad], shape (2,).

        Returns:
            Cell centres from the cell of a to that of b, shape (k, 2), or None when there is no path.
        """
        if not self.connected(a, b):
            return None
        return self._unwrapped(_dijkstra(self.free, self.periodic, self.cell(a), self.cell(b)))

    def _unwrapped(self, cells: list[tuple[int, int]]) -> Array:
        points = np.array([[self.axes[0][i], self.axes[1][j]] for i, j in cells])
        for axis in (0, 1):
            if self.periodic[axis]:
                points[:, axis] = np.unwrap(points[:, axis])
        return points


def compute_grid(
    scene: Scene,
    arm: str | None = None,
    joints: tuple[str, str] | None = None,
    resolution: int = 360,
    progress: Callable[[float], None] | None = None,
) -> CSpaceGrid:
    """The configuration space of two joints of an arm.

    Args:
        scene: The scene.
        arm: The arm (default: the only one).
        joints: Two of its planning joints (default: the first two).
        resolution: Cells along each axis.
        progress: Called with the fraction done, 0 to 1.

    Raises:
        UnknownNameError: no such arm or joint.
        InputError: fewer than two joints, the same joint twice, or a resolution below 8.
    """
    arm = scene.only_arm(arm)
    names = _two_joints(scene, arm, joints)
    if not isinstance(resolution, int) or resolution < 8:
        raise InputError(f"resolution is {resolution!r}, expected a whole number of cells, at least 8")
    columns = [scene.arms[arm].robot.joint_names.index(name) for name in names]
    limits = scene.arms[arm].robot.limits
    axes, periodic, inside = zip(*(_axis(limits.lower[c], limits.upper[c], resolution) for c in columns), strict=True)
    checker = CollisionChecker(scene, (arm,))
    images = _Images(checker, scene.arms[arm].q, columns, axes, progress)
    layers = images.compute()
    outside = ~(inside[0][:, None] & inside[1][None, :])
    if outside.any():
        layers[LIMITS] = outside
    blocked = np.zeros((resolution, resolution), dtype=bool)
    for mask in layers.values():
        blocked |= mask
        read_only(mask)
    labels = label_components(~blocked, (periodic[0], periodic[1]))
    return CSpaceGrid(scene, arm, names, (axes[0], axes[1]), (periodic[0], periodic[1]), layers, labels)


def _two_joints(scene: Scene, arm: str, joints: tuple[str, str] | None) -> tuple[str, str]:
    known = scene.arms[arm].robot.joint_names
    if joints is None:
        if len(known) < 2:
            raise InputError(f"arm {arm!r} has {len(known)} joint, a picture of its configuration space needs two")
        return known[0], known[1]
    if len(joints) != 2 or joints[0] == joints[1]:
        raise InputError(f"joints is {joints!r}, expected two different joints")
    return known_name("joint", joints[0], known), known_name("joint", joints[1], known)


def _axis(lower: float, upper: float, resolution: int) -> tuple[Array, bool, Mask]:
    """Cell centres, whether the axis closes, and which centres are within the limits."""
    turn = 2.0 * np.pi
    unlimited = not np.isfinite(lower) or not np.isfinite(upper)
    if unlimited or upper - lower <= turn + 1e-9:
        low, high = (
            (-np.pi, np.pi) if unlimited or (lower >= -np.pi - 1e-9 and upper <= np.pi + 1e-9) else (lower, upper)
        )
    else:
        low, high = lower, upper
    centres = low + (np.arange(resolution) + 0.5) * ((high - low) / resolution)
    return read_only(centres), bool(unlimited), (centres >= lower) & (centres <= upper)


class _Images:
    """Computes the image of every obstacle by blocks, then by cells."""

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
        own = max((_radius_of(scene, arm, joint.child, g) for g in robot.link(joint.child).collisions), default=0.0)
        held = (a for a in scene.attachments.values() if a.arm == arm and a.link == joint.child)
        for attachment in held:
            start = float(np.linalg.norm(attachment.pose[:3, 3]))
            own = max(own, *(start + _radius_of(scene, arm, "", g) for g in attachment.geometries))
        size[joint.child] = max(own, size.get(joint.child, 0.0))
        slide = max(abs(joint.lower), abs(joint.upper)) if joint.kind == "prismatic" else 0.0
        step = float(np.linalg.norm(joint.origin[:3, 3])) + slide
        size[joint.parent] = max(size.get(joint.parent, 0.0), step + size[joint.child])
    moving = (robot.joint(robot.joint_names[c]) for c in columns)
    first, second = (1.0 if j.kind == "prismatic" else size[j.child] for j in moving)
    return first, second


def _radius_of(scene: Scene, arm: str, link: str, geometry: Any) -> float:
    return float(np.linalg.norm(geometry.pose[:3, 3])) + bounding_radius(geometry.shape)


def label_components(free: Mask, periodic: tuple[bool, bool]) -> NDArray[np.int32]:
    """Number the components of free cells (4 neighbours), joined across periodic seams; 0 is not free."""
    labels, count = ndimage.label(free)
    parent = np.arange(count + 1)

    def root(k: int) -> int:
        while parent[k] != k:
            parent[k] = parent[parent[k]]
            k = int(parent[k])
        return k

    for axis, closes in enumerate(periodic):
        if closes:
            first, last = np.take(labels, 0, axis=axis), np.take(labels, -1, axis=axis)
            for a, b in zip(first, last, strict=True):
                if a and b:
                    parent[root(int(a))] = root(int(b))
    roots = np.array([root(k) for k in range(count + 1)])
    _, joined = np.unique(roots, return_inverse=True)
    return np.asarray(joined[labels], dtype=np.int32)


def _dijkstra(
    free: Mask, periodic: tuple[bool, bool], start: tuple[int, int], goal: tuple[int, int]
) -> list[tuple[int, int]]:
    """Cells of a shortest path; start and goal are in the same component."""
    steps = [(di, dj) for di in (-1, 0, 1) for dj in (-1, 0, 1) if di or dj]
    cost = {start: 0.0}
    came: dict[tuple[int, int], tuple[int, int]] = {}
    queue = [(0.0, start)]
    while queue:
        spent, cell = heapq.heappop(queue)
        if cell == goal:
            break
        if spent > cost[cell]:
            continue
        for step in steps:
            following = _neighbour(free, periodic, cell, step)
            if following is not None:
                total = spent + float(np.hypot(*step))
                if total < cost.get(following, np.inf) - 1e-12:
                    cost[following] = total
                    came[following] = cell
                    heapq.heappush(queue, (total, following))
    cells = [goal]
    while cells[-1] != start:
        cells.append(came[cells[-1]])
    return cells[::-1]


def _neighbour(
    free: Mask, periodic: tuple[bool, bool], cell: tuple[int, int], step: tuple[int, int]
) -> tuple[int, int] | None:
    """The free cell one step on, or None; a diagonal step needs both its sides free."""
    moved = []
    for axis in (0, 1):
        index, size = cell[axis] + step[axis], free.shape[axis]
        if not 0 <= index < size and not periodic[axis]:
            return None
        moved.append(index % size)
    i, j = moved
    if not free[i, j] or (step[0] and step[1] and not (free[cell[0], j] and free[i, cell[1]])):
        return None
    return i, j
