# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""Maps of how far two bodies are apart, over the one or two columns of q that move them against each other.

Links that follow each other closely are always near, so spheres never tell them apart, but few joints
move one against the other. A cell of the map holds a bound of the gap anywhere in it: the gap at its middle less what
the bodies can approach. Cells that have less than is asked for are cut in quarters down to the finest.
"""

from __future__ import annotations

import numpy as np
from numba import types

from rr1plan._kernels.exact import RECORD, exact_of
from rr1plan._kernels.gaps import fine_gap
from rr1plan._kernels.jit import F64, FLOATS1, FLOATS2, INTS1, jit
from rr1plan._kernels.poses import bound_travel, place_body, place_joints

# Bodies move on: a proof needs this much more than the travel [m].
_ROUNDING = 1e-9
_RELATIVE = 1.0 + 1e-9
# Cells are kept in single precision [m].
_ROUNDING_OF_CELLS = 1e-7
# A cell has so many parts along each side, a power of two.
_PARTS = 4
# A bound is sharp enough that is so much of the gap in the middle, or as much as paddings are [m]; gaps below the last
# are contacts [m].
_SHARP = 0.6
_PADDING = 0.0025
_CONTACT = 1e-5


@jit(types.UniTuple(F64, 2)(FLOATS1, FLOATS1, F64, RECORD), allocates=False)
def _bound_gap(q, reach, most, record):
    """Bounds from below of the gap of the first pair: within some reach of a configuration, up to `most`, and there."""
    t = exact_of(record)
    a, b, shared = t.pairs[0, 0], t.pairs[0, 1], t.pairs[0, 2]
    place_joints(q, record)
    moved = 0.0
    for body in (a, b):
        if t.bodies[body, 5] > t.bodies[body, 4]:
            place_body(body, record)
            bound_travel(body, reach, record)
            moved += t.travel[body, shared]
    moved = moved * _RELATIVE + _ROUNDING
    lower, _ = fine_gap(a, b, most + moved, most + moved, t.directions[0], record)
    return lower - moved, lower


@jit(types.void(INTS1, FLOATS2, F64, types.float32[:, ::1], RECORD), entry=True)
def map_gaps(columns, ranges, most, gaps, record):
    """Bound the gap of the first pair from below, cell by cell.

    Args:
        columns: The two columns of q (or one, twice), shape (2,).
        ranges: Low and high of each [rad or m], shape (2, 2).
        most: Gaps beyond this are not told from it [m].
        gaps: Out: the bound, `most` at most [m], shape (n, n) or (n, 1), n a power of two.
        record: Of `exact.EXACT`.
    """
    t = exact_of(record)
    nq = 0
    for j in range(t.joints.shape[0]):
        nq = max(nq, t.joints[j, 2] + 1)
    q, reach = np.zeros(nq), np.zeros(nq)
    t.directions[:, :] = 0.0
    rows, width = gaps.shape
    gaps[:, :] = most
    # Of the parts of cells; a single column of cells is not cut across.
    across = _PARTS if width > 1 else 1
    widths = (ranges[0, 1] - ranges[0, 0]) / (rows * _PARTS), (ranges[1, 1] - ranges[1, 0]) / (width * across)
    stack, known = np.empty((4 * 64, 3), np.int64), np.empty(4 * 64)
    stack[0] = 0
    stack[0, 2] = rows * _PARTS
    known[0] = -np.inf
    count = 1
    while count > 0:
        count -= 1
        x, y, size, bound = stack[count, 0], stack[count, 1], stack[count, 2], known[count]
        i, k, cells = x // _PARTS, y // across, max(size // _PARTS, 1)
        if size < _PARTS and (gaps[i, k] <= _CONTACT or gaps[i, k] <= bound - _ROUNDING_OF_CELLS):
            # Nothing is left to be gained in this cell.
            gaps[i, k] = min(gaps[i, k], bound - _ROUNDING_OF_CELLS)
            continue
        if width > 1:
            q[columns[1]] = ranges[1, 0] + (y + 0.5 * size) * widths[1]
            reach[columns[1]] = 0.5 * size * widths[1] * _RELATIVE + 1e-12
        q[columns[0]] = ranges[0, 0] + (x + 0.5 * size) * widths[0]
        reach[columns[0]] = 0.5 * size * widths[0] * _RELATIVE + 1e-12
        around, middle = _bound_gap(q, reach, most, record)
        # What was proven of the whole is true of its parts.
        bound = max(bound, around)
        sharp = middle <= _CONTACT or bound >= min(_SHARP * middle, _PADDING)
        if bound >= most or size == 1 or (size <= _PARTS and sharp):
            for one in range(i, i + cells):
                for other in range(k, min(k + cells, width)):
                    gaps[one, other] = min(gaps[one, other], min(bound, most) - _ROUNDING_OF_CELLS)
            continue
        half = size // 2
        for one in range(2):
            for other in range(2 if width > 1 else 1):
                stack[count, 0], stack[count, 1], stack[count, 2] = x + one * half, y + other * half, half
                known[count] = bound
                count += 1


@jit(types.void(types.float32[:, ::1], F64, types.int16[:, ::1]), entry=True, allocates=False)
def count_near(gaps, least, counts):
    """How many cells before each corner of a map may have too small a gap.

    Args:
        gaps: Bound of the gap in each cell [m], shape (n, m).
        least: The gap that has to be proven [m].
        counts: Out: shape (n + 1, m + 1), small numbers: many maps are to fit the processor's memory.
    """
    rows, width = gaps.shape
    counts[0, :] = 0
    for x in range(rows):
        along = 0
        counts[x + 1, 0] = 0
        for y in range(width):
            along += 0 if gaps[x, y] >= least else 1
            counts[x + 1, y + 1] = counts[x, y + 1] + along
