"""Convex cores: points whose hull, widened by a radius, is a solid. Separating directions are tested on them.

Large hulls have support tables: the few vertices that can be the lowest along the directions of a cell.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, read_only
from rr1plan.files.disk_cache import cache_key, load_cached, store_cached
from rr1plan.kernels.planner_kernels import constants
from rr1plan.shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere

_INTS = NDArray[np.int64]
_KIND = constants()


class CoreTables(NamedTuple):
    """Convex cores as in `arm_geometry.h`.

    Args:
        rows: Frame, first and last row of `points`, kind of core, first row of `blocks`, first row of `lowest`, and
            number of corners per bit there (0: no table); shape (c, 7).
        values: A point in the core, the radius around the core, the distance that the core reaches from the point [m],
            and the rotation from the axes of `lowest`, row by row; shape (c, 14).
        points: Corners of a core in its frame; for a cylinder, center, axis, half length and radius; shape (p, 3).
        blocks: Ball around each block of corners of a core: center and radius; shape (n, 4).
        lowest: Support tables: the corners that can be the lowest along the directions of each cell.
    """

    rows: _INTS
    values: Array
    points: Array
    blocks: Array
    lowest: _INTS

    def fields(self) -> dict[str, NDArray[Any]]:
        """The fields of `ArmGeometry`."""
        return {
            "cores": self.rows,
            "core_shapes": self.values,
            "points": self.points,
            "blocks": self.blocks,
            "lowest": self.lowest.view(np.uint64),
        }


_NONE = np.zeros(0, np.int64)


class Cores:
    """Rows of the kernel's tables, while they are added."""

    def __init__(self) -> None:
        self._rows: list[tuple[int, ...]] = []
        self._values: list[Array] = []
        self._points: list[Array] = [np.zeros((0, 3))]
        self._blocks: list[Array] = [np.zeros((0, 4))]
        self._lowest: list[_INTS] = [_NONE]
        self._counts = np.zeros(3, np.int64)

    def add(self, frame: int, shape: Shape, T: Array) -> None:
        """Add the core of a shape, placed in a frame."""
        rotate, shift = T[:3, :3], T[:3, 3]
        if isinstance(shape, Cylinder):
            kind, middle = _KIND["CORE_CYLINDER"], shift
            points = np.array([shift, rotate[:, 2], [0.5 * shape.length, shape.radius, 0.0]])
            blocks, lowest, shared = np.zeros((0, 4)), _NONE, 0
            reach = float(np.hypot(0.5 * shape.length, shape.radius))
        else:
            points, blocks, lowest, shared = _placed_blocks(shape, rotate, shift)
            kind, middle = _KIND["CORE_POINTS"], points.mean(axis=0)
            reach = float(np.linalg.norm(points - middle, axis=1).max())
        first, first_block, first_word = self._counts.tolist()
        self._rows.append((frame, first, first + len(points), kind, first_block, first_word, shared))
        self._values.append(np.array([*middle, core_radius(shape), reach * _SAFETY, *rotate.ravel()]))
        self._points.append(points)
        self._blocks.append(blocks)
        self._lowest.append(lowest)
        self._counts += len(points), len(blocks), len(lowest)

    def tables(self) -> CoreTables:
        """The added rows, counted from zero."""
        rows, values = np.array(self._rows, np.int64).reshape(-1, 7), np.array(self._values).reshape(-1, 14)
        points, blocks = (np.ascontiguousarray(np.concatenate(parts)) for parts in (self._points, self._blocks))
        return CoreTables(*map(read_only, (rows, values, points, blocks, np.concatenate(self._lowest))))


NO_CORES = Cores().tables()


def joined_cores(parts: Sequence[CoreTables]) -> tuple[CoreTables, list[int]]:
    """Tables joined into one, and the number of cores before those of each part."""
    before, points, blocks, words = [0], 0, 0, 0
    full = []
    for part in parts:
        if len(part.rows):
            full.append(part._replace(rows=part.rows + np.array([0, points, points, 0, blocks, words, 0])))
        before.append(before[-1] + len(part.rows))
        points, blocks = points + len(part.points), blocks + len(part.blocks)
        words += len(part.lowest)
    if len(full) == 1:
        return full[0], before[:-1]
    return CoreTables(*(np.concatenate(tables) for tables in zip(*(full or parts), strict=True))), before[:-1]


@lru_cache(maxsize=512)
def shape_core(shape: Shape) -> CoreTables:
    """The core of a shape in its own frame."""
    cores = Cores()
    cores.add(0, shape, np.eye(4))
    return cores.tables()


@lru_cache(maxsize=512)
def _blocks(shape: Shape) -> tuple[Array, Array, _INTS]:
    points, balls = in_vertex_blocks(core_points(shape))
    # Few corners are all tested.
    lowest = support_cells(points) if len(points) > _KIND["BLOCK_POINTS"] else _NONE
    return read_only(points), read_only(balls), read_only(lowest)


def _placed_blocks(shape: Shape, rotate: Array, shift: Array) -> tuple[Array, Array, _INTS, int]:
    """Core points of a shape in blocks and balls around these, in a frame; its support table and corners per bit."""
    points, balls, lowest = _blocks(shape)
    # Rounding error of a product with a rotation and a sum.
    radii = balls[:, 3] + 1e-14 * (1.0 + float(np.abs(shift).max()))
    balls = np.column_stack([balls[:, :3] @ rotate.T + shift, radii])
    return points @ rotate.T + shift, balls, lowest, corners_per_bit(len(points)) if len(lowest) else 0


def core_points(shape: Shape) -> Array:
    """Points of a shape's core, in its frame, whose hull contains the core, shape (n, 3)."""
    match shape:
        case Sphere():
            return np.zeros((1, 3))
        case Capsule(_, length):
            return np.array([[0.0, 0.0, -0.5 * length], [0.0, 0.0, 0.5 * length]])
        case Box(size):
            return _around(0.5 * np.array(size))
        case Cylinder(radius, length):
            # The corners of the bounding box, whose hull contains the cylinder.
            return _around(np.array([radius, radius, 0.5 * length]))
        case _:
            assert isinstance(shape, Mesh)
            return np.array(shape.vertices)


def _around(half: Array) -> Array:
    """Corners of a box with these half sizes, shape (8, 3)."""
    return np.array(list(itertools.product((-1.0, 1.0), repeat=3))) * half


def core_radius(shape: Shape) -> float:
    """Radius of a shape around its core [m]."""
    return shape.radius if isinstance(shape, Sphere | Capsule) else 0.0


# ---- corners in blocks ---------------------------------------------------------------------------------

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
    """Points halved repeatedly across their longest side, into whole blocks where there is more than one."""
    if len(points) == 1:
        return [points[0]]
    order = np.argsort(points[:, np.ptp(points, axis=0).argmax()], kind="stable")
    blocks = (len(points) + BLOCK - 1) // BLOCK
    half = max(blocks // 2 * BLOCK, BLOCK) if blocks > 1 else len(points) // 2
    return _split(points[order[:half]]) + _split(points[order[half:]])


# ---- support tables ------------------------------------------------------------------------------------

# Directions are cells of two squares, one for each side of the third axis, as in an unfolded octahedron: the first two
# coordinates of n / (|n_1| + |n_2| + |n_3|). This map is linear within a cell, so a corner that is higher than another
# one along the directions at the cell's corners is higher along all of its directions, and cannot be the lowest.

DIRECTION_CELLS = _KIND["DIRECTION_CELLS"]
"""Cells of directions along each side of the two squares (`support_table.h`)."""
WORD = 63
"""Bits of a word that are used."""
_CELLS_VERSION = "lowest-corners-1"
# Corners count as equally low within this fraction of the body's size: beyond all rounding.
_EQUALLY_LOW = 1e-9


def corners_per_bit(count: int) -> int:
    """Number of consecutive vertices that share a bit of a word."""
    return -(-count // WORD)


def support_cells(points: Array) -> NDArray[np.int64]:
    """Vertices that can be the lowest along the directions of each cell, as bits for `corners_per_bit` vertices each.

    Args:
        points: Corners [m], shape (n, 3).

    Returns:
        A word for each cell, shape (2 * DIRECTION_CELLS**2,).
    """
    key = cache_key(_CELLS_VERSION, f"{DIRECTION_CELLS} {WORD} {_EQUALLY_LOW}", points)
    kept = load_cached(key)
    if kept is None or sorted(kept) != ["words"]:
        kept = {"words": _words(points)}
        store_cached(key, kept)
    return kept["words"]


def _words(points: Array) -> NDArray[np.int64]:
    ends, counts = _ends()
    step = corners_per_bit(len(points))
    bits = np.left_shift(np.int64(1), np.arange(len(points)) // step)
    middle = points.mean(axis=0)
    slack = _EQUALLY_LOW * float(np.abs(points - middle).max())
    words = np.empty(ends.shape[:2], np.int64)
    for row, (directions, beyond) in enumerate(zip(ends, counts, strict=True)):
        # Cell corners beyond the octahedron are not directions of the cell: they must not exclude any vertex.
        heights = np.where(beyond, 0.0, directions @ (points - middle).T)
        kept = np.ones((heights.shape[0], heights.shape[2]), np.bool_)
        for rival in (*heights.argmin(axis=2).T, heights.sum(axis=1).argmin(axis=1)):
            below = np.take_along_axis(heights, rival[:, None, None], axis=2)
            kept &= ~((heights > below + slack) | beyond).all(axis=1)
        kept |= beyond.all(axis=(1, 2))[:, None]
        words[row] = np.bitwise_or.reduce(np.where(kept, bits, 0), axis=1)
    return words.ravel()


@cache
def _ends() -> tuple[Array, NDArray[np.bool_]]:
    """Directions at the four corners of each cell, row by row, and which of them are beyond the octahedron."""
    at = np.linspace(-1.0, 1.0, DIRECTION_CELLS + 1)
    u, v = np.meshgrid(at, at, indexing="ij")
    height = 1.0 - np.abs(u) - np.abs(v)
    nodes = np.stack([u, v, height], axis=2)
    rows = np.stack([nodes[:-1, :-1], nodes[:-1, 1:], nodes[1:, :-1], nodes[1:, 1:]], axis=2)
    rows = np.concatenate([rows, rows * (1.0, 1.0, -1.0)])
    return rows, np.abs(rows[..., :2]).sum(axis=3, keepdims=True) > 1.0 + 1e-9
