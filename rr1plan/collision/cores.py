"""Points whose hull, widened by a radius, is a solid: what separating directions are measured with."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from rr1plan._kernels.cover import POINTS, ROUND
from rr1plan.checks import Array
from rr1plan.shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere

_INTS = NDArray[np.int64]


class Cores:
    """Rows of the kernel's `cores`, `core_values` and `points`, as they are added."""

    def __init__(self) -> None:
        self._rows: list[tuple[int, int, int, int]] = []
        self._values: list[Array] = []
        self._points: list[Array] = [np.zeros((0, 3))]
        self._count = 0

    def add(self, frame: int, shape: Shape, T: Array) -> int:
        """The row of a shape placed in a frame."""
        rotate, shift = T[:3, :3], T[:3, 3]
        if isinstance(shape, Cylinder):
            middle, radius, kind = shift, 0.0, ROUND
            points = np.array([shift, rotate[:, 2], [0.5 * shape.length, shape.radius, 0.0]])
            reach = float(np.hypot(0.5 * shape.length, shape.radius)) * (1.0 + 1e-9)
        else:
            points, radius, kind = extremes(shape) @ rotate.T + shift, _radius(shape), POINTS
            middle = points.mean(axis=0)
            reach = float(np.linalg.norm(points - middle, axis=1).max()) * (1.0 + 1e-9)
        self._rows.append((frame, self._count, self._count + len(points), kind))
        self._values.append(np.array([*middle, radius, reach]))
        self._points.append(points)
        self._count += len(points)
        return len(self._rows) - 1

    def arrays(self) -> tuple[_INTS, Array, Array]:
        """The three tables."""
        rows = np.array(self._rows, np.int64).reshape(-1, 4)
        return rows, np.array(self._values).reshape(-1, 5), np.ascontiguousarray(np.concatenate(self._points))


def extremes(shape: Shape) -> Array:
    """Points of a shape's core that no other point of it is farther out than, in its frame, shape (n, 3)."""
    match shape:
        case Sphere():
            return np.zeros((1, 3))
        case Capsule(_, length):
            return np.array([[0.0, 0.0, -0.5 * length], [0.0, 0.0, 0.5 * length]])
        case Box(size):
            return _around(0.5 * np.array(size))
        case Cylinder(radius, length):
            # Corners of the box around it are farther out than any of its own.
            return _around(np.array([radius, radius, 0.5 * length]))
        case _:
            assert isinstance(shape, Mesh)
            return np.array(shape.vertices)


def _around(half: Array) -> Array:
    """Corners of a box of so much to both sides, shape (8, 3)."""
    return np.array(list(itertools.product((-1.0, 1.0), repeat=3))) * half


def _radius(shape: Shape) -> float:
    return shape.radius if isinstance(shape, Sphere | Capsule) else 0.0
