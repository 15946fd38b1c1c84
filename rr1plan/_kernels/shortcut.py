# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""Certified shortcuts as compiled loops; the moves are those of `rr1plan.planners.shortcut`.

A path is the first `counts[SIZE]` rows of an array that has room for two more with every shortcut. Each loop
does so many steps and goes on where it stopped: all it knows is in its arrays. Random numbers and
decisions are the same on every machine, as in `rrt_connect.py`.
"""

from __future__ import annotations

import numpy as np
from numba import boolean, int64, types

from rr1plan._kernels.edges import CONTEXT, edge_code
from rr1plan._kernels.generator import STATE, draw, draw_below
from rr1plan._kernels.jit import F64, FLOATS1, FLOATS2, I64, OUT1, OUT2, jit

# Entries of `counts`: rows in use, the vertex to go on from, shortcuts in a row that gained nothing, edges so far.
SIZE, PLACE, IDLE, EDGES = range(4)

# A shortcut that gains less than this part of the length is not worth its check.
_WORTH = 1e-3
# No shortcut begins or ends this near beside a vertex [rad].
_SNAP = 1e-3
_COUNTS = int64[::1]


@jit(F64(FLOATS2, I64, I64), allocates=False)
def _distance(points, i, j):
    """Length of the straight line between two rows."""
    square = 0.0
    for k in range(points.shape[1]):
        difference = points[j, k] - points[i, k]
        square += difference * difference
    return np.sqrt(square)


@jit(boolean(FLOATS2, I64, I64), allocates=False)
def _equal(points, i, j):
    """Whether two rows are the same."""
    same = True
    for k in range(points.shape[1]):
        same = same and points[i, k] == points[j, k]
    return same


@jit(types.void(OUT2, _COUNTS))
def drop_repeats(points, counts):
    """Keep one of several equal rows that follow each other."""
    kept = 1
    for i in range(1, counts[SIZE]):
        if not _equal(points, kept - 1, i):
            points[kept] = points[i]
            kept += 1
    counts[SIZE] = kept


@jit(types.void(OUT2, _COUNTS, I64, CONTEXT))
def skip_vertices(points, counts, vertices, context):
    """From each of so many vertices go straight as far ahead as it takes; the jumps tried are all, a half...

    Args:
        points: The path, shape (capacity, nq).
        counts: See the constants of this file; it begins at `counts[PLACE]`.
        vertices: How many to do.
        context: See `edge_code`.
    """
    for _ in range(vertices):
        i, size = counts[PLACE], counts[SIZE]
        if i >= size - 2:
            return
        jump = size - 1 - i
        while jump > 1:
            counts[EDGES] += 1
            if edge_code(points[i], points[i + jump], context) == 0:
                break
            jump //= 2
        if jump > 1:
            for k in range(i + jump, size):
                points[k - jump + 1] = points[k]
            counts[SIZE] = size - jump + 1
        counts[PLACE] = i + 1


@jit(F64(F64, FLOATS1, I64), allocates=False)
def _snapped(place, along, size):
    """The place, or a vertex so near that the edge between would only be a burden."""
    for i in range(size):
        if abs(along[i] - place) < _SNAP:
            return along[i]
    return place


@jit(types.void(FLOATS2, FLOATS1, I64, F64, OUT1), allocates=False)
def _point_at(points, along, i, place, out):
    """The point of edge i at a length along the path."""
    share = (place - along[i]) / (along[i + 1] - along[i])
    for k in range(len(out)):
        if share <= 0.0:
            out[k] = points[i, k]
        elif share >= 1.0:
            out[k] = points[i + 1, k]
        else:
            out[k] = points[i, k] + share * (points[i + 1, k] - points[i, k])


@jit(I64(FLOATS2, FLOATS1, I64, I64, F64, F64, I64, OUT2))
def _make_piece(points, along, i, j, begin, end, joint, piece):
    """What would replace the path from a place on edge i to one on edge j: straight, or in one joint only; its rows."""
    _point_at(points, along, i, begin, piece[0])
    last = 1 if joint < 0 else j - i + 1
    _point_at(points, along, j, end, piece[last])
    for k in range(1, last):
        piece[k] = points[i + k]
        share = (along[i + k] - begin) / (end - begin)
        piece[k, joint] = piece[0, joint] + share * (piece[last, joint] - piece[0, joint])
    return last + 1


@jit(boolean(FLOATS2, I64, _COUNTS, CONTEXT), allocates=False)
def _is_free(piece, rows, counts, context):
    """Whether all edges of a piece are free."""
    for k in range(rows - 1):
        counts[EDGES] += 1
        if edge_code(piece[k], piece[k + 1], context) != 0:
            return False
    return True


@jit(types.void(OUT2, _COUNTS, I64, I64, OUT2, I64))
def _replace(points, counts, i, j, piece, rows):
    """Rows i + 1 .. j of the path give way to the piece."""
    size = counts[SIZE]
    shift = rows - (j - i)
    if shift > 0:
        for k in range(size - 1, j, -1):
            points[k + shift] = points[k]
    elif shift < 0:
        for k in range(j + 1, size):
            points[k + shift] = points[k]
    for k in range(rows):
        points[i + 1 + k] = piece[k]
    counts[SIZE] = size + shift
    drop_repeats(points, counts)


@jit(boolean(OUT2, _COUNTS, STATE, OUT1, OUT2, CONTEXT))
def _try_shortcut(points, counts, state, along, piece, context):
    """Replace one random piece of the path by a shorter free one; whether that was possible."""
    size, nq = counts[SIZE], points.shape[1]
    along[0] = 0.0
    for k in range(1, size):
        along[k] = along[k - 1] + _distance(points, k - 1, k)
    whole = along[size - 1]
    one, two = draw(state) * whole, draw(state) * whole
    joint = draw_below(state, nq + 2) - 2
    begin, end = _snapped(min(one, two), along, size), _snapped(max(one, two), along, size)
    i, j = 0, size - 2
    while i < size - 2 and along[i + 1] <= begin:
        i += 1
    while j > 0 and along[j] >= end:
        j -= 1
    if i >= j:
        return False
    rows = _make_piece(points, along, i, j, begin, end, joint, piece)
    length = 0.0
    for k in range(rows - 1):
        length += _distance(piece, k, k + 1)
    if length > end - begin - _WORTH * whole or not _is_free(piece, rows, counts, context):
        return False
    _replace(points, counts, i, j, piece, rows)
    return True


@jit(types.void(OUT2, _COUNTS, STATE, I64, I64, CONTEXT))
def take_shortcuts(points, counts, state, shortcuts, patience, context):
    """Try so many random shortcuts, fewer when `patience` of them in a row gain nothing.

    Args:
        points: The path, shape (capacity, nq), capacity >= counts[SIZE] + 2 * shortcuts.
        counts: See the constants of this file.
        state: Of the generator, shape (1,).
        shortcuts: How many to try.
        patience: How many may gain nothing.
        context: See `edge_code`.
    """
    along, piece = np.empty(len(points)), np.empty(points.shape)
    for _ in range(shortcuts):
        if counts[SIZE] < 3 or counts[IDLE] >= patience:
            return
        if _try_shortcut(points, counts, state, along, piece, context):
            counts[IDLE] = 0
        else:
            counts[IDLE] += 1
