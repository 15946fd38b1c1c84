"""Artificial potential fields over the configuration space of two joints, on a grid.

The goal attracts, obstacles repel, and the arm moves downhill: Khatib, "Real-time obstacle avoidance for manipulators
and mobile robots", IJRR 5 (1986). Descents end in local minima. Best-first search fills them, and the wave from the
goal has none: Barraquand, Latombe, "Robot motion planning: a distributed representation approach", IJRR 10 (1991).
Siciliano et al., "Robotics: modelling, planning and control" (2009), 12.6; Lynch, Park, "Modern Robotics" (2017), 10.6.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import distance_transform_edt

from rr1plan.checks import Array, Value, finite_array, number_from_zero, positive_number, read_only, whole_number
from rr1plan.errors import InputError
from rr1plan.playback.cspace.configuration_space import cspace
from rr1plan.playback.cspace.cspace_grid import CSpaceGrid
from rr1plan.scene import Scene

# Along the axes first: among equally low neighbors the first one counts.
MOVES = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1))
_BORDER = 1e-9
FINER = 3  # cells of a configuration space along each side of a cell of its field

Bits = NDArray[np.bool_]
Indices = NDArray[np.int64]


class FilledField(NamedTuple):
    """The result of `fill_minima`.

    Args:
        cells: Cells from the start to the goal, shape (k, 2); none if the goal is not connected.
        visited: Number of cells that the search visited.
    """

    cells: Indices
    visited: int


@dataclass(frozen=True, eq=False, repr=False)
class FieldGrid(Value):
    """Cells of a configuration space of two joints.

    Args:
        free: Cells without any blocked configuration on the finer grid, shape (n, m).
        low: Lower left corner of the picture [rad or m], shape (2,).
        sides: Sides of a cell [rad or m], shape (2,).
        periodic: Whether the axes wrap around.
    """

    free: Bits
    low: Array
    sides: Array
    periodic: tuple[bool, bool]

    def __repr__(self) -> str:
        return f"FieldGrid({self.free.shape[0]} × {self.free.shape[1]} cells, {100 * self.free.mean():.0f} % free)"

    def centers(self) -> Array:
        """Configurations at the centers of the cells, shape (n, m, 2)."""
        axes = [
            low + side * (np.arange(n) + 0.5)
            for low, side, n in zip(self.low, self.sides, self.free.shape, strict=True)
        ]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)

    def cell(self, q: ArrayLike) -> tuple[int, int]:
        """The cell of a configuration.

        Raises:
            InputError: it is outside the picture.
        """
        # A configuration on the border of two cells is in the upper one, whatever rounding does, and one at the upper
        # limit of a joint in the last one.
        sides = (finite_array("q", q, (2,)) - self.low) / self.sides
        place = np.floor(sides + _BORDER).astype(int)
        last = np.where(self.periodic, np.inf, np.array(self.free.shape))
        place -= (place == last) & (sides <= last + _BORDER)
        i, j = (
            int(k % n) if wraps else int(k) for k, n, wraps in zip(place, self.free.shape, self.periodic, strict=True)
        )
        if not (0 <= i < self.free.shape[0] and 0 <= j < self.free.shape[1]):
            raise InputError(f"q is {np.asarray(q).tolist()}, outside the joint limits")
        return i, j

    def shifted(self, values: Array, move: tuple[int, int], beyond: float) -> Array:
        """For each cell the value of the neighbor after a move; `beyond` outside the picture."""
        found = np.roll(values, (-move[0], -move[1]), axis=(0, 1))
        for axis, step in enumerate(move):
            if step and not self.periodic[axis]:
                edge: list[slice | int] = [slice(None), slice(None)]
                edge[axis] = -1 if step > 0 else 0
                found[tuple(edge)] = beyond
        return found

    def allowed(self, move: tuple[int, int]) -> Bits:
        """Cells from which a move stays in free cells; diagonal moves cut no corner."""
        free = self.free.astype(float)
        steps = {move, (move[0], 0), (0, move[1])} - {(0, 0)}
        return np.asarray(np.logical_and.reduce([self.free, *(self.shifted(free, step, 0.0) > 0.0 for step in steps)]))


def field_grid(scene: Scene, *, cells: int = 120) -> FieldGrid:
    """The cells of the configuration space of an arm of two joints.

    Args:
        scene: A scene with one arm of two joints.
        cells: Number of cells along each axis, 10 to 300.

    Raises:
        InputError: another scene, or a number out of range.
    """
    return coarse_grid(cspace(scene, resolution=FINER * whole_number("cells", cells, 10, 300)).grid)


def coarse_grid(grid: CSpaceGrid) -> FieldGrid:
    """Cells of 3 × 3 cells of a configuration space; blocked if one of them is."""
    n, m = (size // FINER for size in grid.free.shape)
    free = grid.free[: n * FINER, : m * FINER].reshape(n, FINER, m, FINER).all(axis=(1, 3))
    steps = np.array([float(centers[1] - centers[0]) for centers in grid.axes])
    low = np.array([float(centers[0]) for centers in grid.axes]) - 0.5 * steps
    first, second = grid.periodic
    return FieldGrid(read_only(np.asarray(free)), read_only(low), read_only(FINER * steps), (bool(first), bool(second)))


# ---- potentials ------------------------------------------------------------------------------------


def attraction(grid: FieldGrid, goal: ArrayLike) -> Array:
    """½ d², with the distance d to the goal, around the torus if that is shorter [rad²], shape (n, m).

    The distance is that of the cell's center, and zero in the cell of the goal, which is the lowest one.

    Args:
        grid: The cells.
        goal: The goal [rad or m], shape (2,).
    """
    delta = grid.centers() - finite_array("goal", goal, (2,))
    wrapped = (delta + np.pi) % (2.0 * np.pi) - np.pi
    delta = np.where(grid.periodic, wrapped, delta)
    values = 0.5 * (delta[..., 0] ** 2 + delta[..., 1] ** 2)
    values[grid.cell(goal)] = 0.0
    return np.asarray(values)


def obstacle_distance(grid: FieldGrid) -> Array:
    """Distance from the center of each cell to that of the nearest blocked one [rad or m], shape (n, m).

    It is zero in blocked cells, and infinite without any.
    """
    if grid.free.all():
        return np.full(grid.free.shape, np.inf)
    n, m = grid.free.shape
    copies = tuple(3 if wraps else 1 for wraps in grid.periodic)
    found = distance_transform_edt(np.tile(grid.free, copies), sampling=tuple(grid.sides))
    first, second = (size * (count // 2) for size, count in zip((n, m), copies, strict=True))
    return np.asarray(found)[first : first + n, second : second + m]


def repulsion(distance: ArrayLike, gain: float, reach: float) -> Array:
    """½ η (1/ρ − 1/ρ₀)² below the distance of influence ρ₀, and 0 beyond it; infinite in obstacles.

    Args:
        distance: Distances ρ to the obstacles [rad or m], any shape.
        gain: η, from 0.
        reach: ρ₀ [rad or m], above 0.

    Raises:
        InputError: a number out of range.
    """
    rho = np.asarray(distance, dtype=float)
    gain, reach = number_from_zero("gain", gain), positive_number("reach", reach)
    with np.errstate(divide="ignore"):
        near = 1.0 / rho - 1.0 / reach
    pushed = np.where(rho < reach, 0.5 * gain * np.where(rho > 0.0, near, 0.0) ** 2, 0.0)
    return np.asarray(np.where(rho > 0.0, pushed, np.inf))


def wave(grid: FieldGrid, goal: ArrayLike) -> Array:
    """Number of steps along the axes from each free cell to the goal's; infinite where there is no path; shape (n, m).

    Args:
        grid: The cells.
        goal: The goal [rad or m], shape (2,).
    """
    values = np.full(grid.free.shape, np.inf)
    if grid.free[grid.cell(goal)]:
        values[grid.cell(goal)] = 0.0
    for step in range(values.size):
        front = np.logical_or.reduce([grid.shifted(values, move, np.inf) == step for move in MOVES[:4]])
        front &= grid.free & np.isinf(values)
        if not front.any():
            break
        values[front] = step + 1.0
    return values


# ---- motions ---------------------------------------------------------------------------------------


def downhill(grid: FieldGrid, values: Array) -> Indices:
    """For each cell, as a flat index, its lowest neighbor; the cell itself if none is lower; shape (n m,)."""
    best, target = np.where(grid.free, values, np.inf), np.arange(values.size).reshape(values.shape)
    numbers = target.astype(float)
    for move in MOVES:
        there = np.where(grid.allowed(move), grid.shifted(values, move, np.inf), np.inf)
        lower = there < best
        best = np.where(lower, there, best)
        target = np.where(lower, grid.shifted(numbers, move, 0.0).astype(np.int64), target)
    return np.asarray(target.ravel(), dtype=np.int64)


def descend(grid: FieldGrid, values: Array, start: ArrayLike) -> Indices:
    """The cells on the way downhill from a configuration to a minimum, shape (k, 2).

    Args:
        grid: The cells.
        values: The potential, shape (n, m).
        start: The configuration [rad or m], shape (2,).
    """
    following, width = downhill(grid, values), values.shape[1]
    i, j = grid.cell(start)
    cells = [i * width + j]
    while following[cells[-1]] != cells[-1]:
        cells.append(int(following[cells[-1]]))
    return np.array([divmod(cell, width) for cell in cells], dtype=np.int64)


def basins(grid: FieldGrid, values: Array) -> Indices:
    """The minimum, as a flat index, at which the descent from each cell ends; -1 in blocked cells; shape (n, m)."""
    ends = downhill(grid, values)
    while not np.array_equal(ends, ends[ends]):
        ends = ends[ends]
    return np.where(grid.free, ends.reshape(values.shape), -1)


def reached_share(grid: FieldGrid, values: Array, goal: ArrayLike) -> float:
    """Share of the free cells from which the descent ends in the goal's cell."""
    i, j = grid.cell(goal)
    return float((basins(grid, values) == i * values.shape[1] + j).sum() / max(int(grid.free.sum()), 1))


def fill_minima(grid: FieldGrid, values: Array, start: ArrayLike, goal: ArrayLike) -> FilledField:
    """Best-first search: always continue at the lowest cell seen so far, which fills local minima until they overflow.

    Args:
        grid: The cells.
        values: The potential, shape (n, m).
        start: The configuration to start at [rad or m], shape (2,).
        goal: The goal [rad or m], shape (2,).
    """
    first, last = grid.cell(start), grid.cell(goal)
    allowed = [grid.allowed(move) for move in MOVES]
    parents: dict[tuple[int, int], tuple[int, int] | None] = {first: None}
    queue, visited = [(float(values[first]), first)], 0
    while queue:
        _, cell = heapq.heappop(queue)
        visited += 1
        if cell == last:
            return FilledField(_chain(parents, cell), visited)
        for move, mask in zip(MOVES, allowed, strict=True):
            if mask[cell]:
                other = ((cell[0] + move[0]) % values.shape[0], (cell[1] + move[1]) % values.shape[1])
                if other not in parents:
                    parents[other] = cell
                    heapq.heappush(queue, (float(values[other]), other))
    return FilledField(np.zeros((0, 2), dtype=np.int64), visited)


def _chain(parents: dict[tuple[int, int], tuple[int, int] | None], last: tuple[int, int]) -> Indices:
    cells: list[tuple[int, int]] = []
    cell: tuple[int, int] | None = last
    while cell is not None:
        cells.append(cell)
        cell = parents[cell]
    return np.array(cells[::-1], dtype=np.int64)
