# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""Polylines without points that say nothing: duplicates, and points on a straight line."""

from __future__ import annotations

import numpy as np
from numba import types

from rr1plan._kernels.jit import F64, FLOATS2, I64, jit


@jit(F64(FLOATS2, I64, I64))
def _distance(points, a, b):
    """Euclidean distance of two points of a polyline."""
    square = 0.0
    for j in range(points.shape[1]):
        square += (points[b, j] - points[a, j]) ** 2
    return np.sqrt(square)


@jit(types.boolean(FLOATS2, types.int64[::1], I64, I64, F64))
def _is_straight(points, index, first, last, tolerance):
    """The points between two of them lie on the line from one to the other, in this order."""
    a, b = index[first], index[last]
    length = _distance(points, a, b)
    if length < tolerance:
        return False
    before = 0.0
    for i in range(first + 1, last):
        along, square = 0.0, 0.0
        for j in range(points.shape[1]):
            along += (points[index[i], j] - points[a, j]) * (points[b, j] - points[a, j]) / length
        for j in range(points.shape[1]):
            off = points[index[i], j] - points[a, j] - along * (points[b, j] - points[a, j]) / length
            square += off * off
        if along <= before or square > tolerance * tolerance:
            return False
        before = along
    return before < length


@jit(types.int64[::1](FLOATS2, F64), entry=True)
def corners(points, tolerance):
    """Which points of a polyline are its ends or corners.

    Args:
        points: Shape (n, nq).
        tolerance: Points closer than this, and points this close to a straight line, say nothing.

    Returns:
        Their indices, ascending: first and last point, or the first alone where all are one.
    """
    index = np.empty(len(points), np.int64)
    index[0] = 0
    count = 1
    for i in range(1, len(points)):
        if _distance(points, index[count - 1], i) >= tolerance:
            index[count] = i
            count += 1
    if count > 1:
        index[count - 1] = len(points) - 1
    kept, last = 1, 0
    while last < count - 1:
        end = last + 1
        while end + 1 < count and _is_straight(points, index, last, end + 1, tolerance):
            end += 1
        # never ahead of what is still to be read: kept <= end
        index[kept] = index[end]
        kept += 1
        last = end
    return index[:kept].copy()
