# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""Certified shortcuts as a compiled loop; the moves are those of `rr1plan.planners.shortcut`.

A path is the first `counts[SIZE]` rows of an array that has room for two more with every shortcut. The loop
does so many steps and goes on where it stopped: all it knows is in its arrays. Random numbers and
decisions are the same on every machine, as in `rrt_connect.py`.

To certify a shortcut takes a hundred times as long as to draw one, so that of several drawn the one that would
gain most is tried. One like it that has failed makes it less likely to be free, so its gain counts less.
"""

from __future__ import annotations

import numpy as np
from numba import boolean, int64, types

from rr1plan._kernels.edges import CONTEXT, edge_code
from rr1plan._kernels.generator import STATE, draw, draw_below
from rr1plan._kernels.jit import F64, FLOATS1, FLOATS2, I64, OUT1, OUT2, jit

# Entries of `counts`: rows in use, the stage, the vertex to go on from, shortcuts tried, those in a row that gained
# nothing, edges so far, shortcuts that failed and are remembered.
SIZE, STAGE, PLACE, TRIED, IDLE, EDGES, FAILED = range(7)
_FRESH, _SKIPPING, _CUTTING, _SKIPPING_AGAIN, _DONE = range(5)

# So many shortcuts are drawn for each that is tried.
_DRAWN = 8

# A shortcut that gains less than this part of the length is not worth its check.
_WORTH = 3e-3
# What is left of the hope for a shortcut that replaces all that another one like it has failed to replace.
_HOPE = 0.1
# So many that failed are remembered.
MEMORY = 64
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


@jit(types.void(FLOATS2, I64, OUT2, I64), inline=True, allocates=False)
def _copy_row(source, i, target, j):
    """Row i of one array becomes row j of another; numba compiles an assignment's check of shapes for seconds."""
    for k in range(source.shape[1]):
        target[j, k] = source[i, k]


@jit(types.void(OUT2, _COUNTS))
def _drop_repeats(points, counts):
    """Keep one of several equal rows that follow each other."""
    kept = 1
    for i in range(1, counts[SIZE]):
        if not _equal(points, kept - 1, i):
            _copy_row(points, i, points, kept)
            kept += 1
    counts[SIZE] = kept


@jit(types.void(OUT2, _COUNTS, CONTEXT))
def _skip_vertices(points, counts, context):
    """From vertex `counts[PLACE]` go straight as far ahead as it takes; the jumps tried are all, a half..."""
    i, size = counts[PLACE], counts[SIZE]
    jump = size - 1 - i
    while jump > 1:
        counts[EDGES] += 1
        if edge_code(points[i], points[i + jump], context) == 0:
            break
        jump //= 2
    if jump > 1:
        for k in range(i + jump, size):
            _copy_row(points, k, points, k - jump + 1)
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
        _copy_row(points, i + k, piece, k)
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
            _copy_row(points, k, points, k + shift)
    elif shift < 0:
        for k in range(j + 1, size):
            _copy_row(points, k, points, k + shift)
    for k in range(rows):
        _copy_row(piece, k, points, i + 1 + k)
    counts[SIZE] = size + shift
    _drop_repeats(points, counts)


@jit(F64(FLOATS2, I64, OUT1), allocates=False)
def _measure(points, size, along):
    """Lengths along the path up to each vertex; that of all."""
    along[0] = 0.0
    for k in range(1, size):
        along[k] = along[k - 1] + _distance(points, k - 1, k)
    return along[size - 1]


@jit(types.Tuple((I64, I64, F64, F64, I64))(OUT1, I64, I64, STATE), allocates=False)
def _draw_shortcut(along, size, nq, state):
    """Two random edges of a path, a place on each, and the joint to straighten (< 0: all)."""
    whole = along[size - 1]
    one, two = draw(state) * whole, draw(state) * whole
    joint = draw_below(state, nq + 2) - 2
    begin, end = _snapped(min(one, two), along, size), _snapped(max(one, two), along, size)
    i, j = 0, size - 2
    while i < size - 2 and along[i + 1] <= begin:
        i += 1
    while j > 0 and along[j] >= end:
        j -= 1
    return i, j, begin, end, joint


@jit(F64(FLOATS2, I64, F64, F64, I64), allocates=False)
def _hope(failed, count, begin, end, joint):
    """How likely a shortcut is to be free, as far as those tell that have failed: 1 if there is none like it."""
    hope = 1.0
    for k in range(count):
        first, last = failed[k, 0], failed[k, 1]
        if failed[k, 2] == max(joint, -1) and first < end and begin < last:
            shared = (min(end, last) - max(begin, first)) / max(end - begin, last - first)
            hope *= _HOPE if begin <= first and last <= end else 1.0 - (1.0 - _HOPE) * shared
    return hope


@jit(types.void(OUT2, _COUNTS, F64, F64, I64), allocates=False)
def _remember(failed, counts, begin, end, joint):
    """Note a shortcut that has failed; the oldest one is forgotten where there is no room."""
    count = counts[FAILED]
    if count == len(failed):
        count -= 1
        for k in range(count):
            _copy_row(failed, k + 1, failed, k)
    failed[count, 0], failed[count, 1], failed[count, 2] = begin, end, max(joint, -1)
    counts[FAILED] = count + 1


@jit(types.void(OUT2, _COUNTS, F64, F64, F64), allocates=False)
def _adapt(failed, counts, begin, end, gain):
    """Let those that failed be where they are on a path that is shorter now between two places; forget those there."""
    kept = 0
    for k in range(counts[FAILED]):
        first, last = failed[k, 0], failed[k, 1]
        if last <= begin or first >= end or (first <= begin and end <= last):
            _copy_row(failed, k, failed, kept)
            failed[kept, 0] -= gain if first >= end else 0.0
            failed[kept, 1] -= gain if last >= end else 0.0
            kept += 1
    counts[FAILED] = kept


@jit(F64(FLOATS2, I64, F64), allocates=False)
def _gain(piece, rows, length):
    """By how much a piece is shorter than what it replaces, which has a length."""
    for k in range(rows - 1):
        length -= _distance(piece, k, k + 1)
    return length


@jit(boolean(OUT2, _COUNTS, STATE, OUT1, OUT2, OUT2, CONTEXT))
def _try_shortcut(points, counts, state, along, piece, failed, context):
    """Replace a piece of the path by a shorter free one, the best of some random ones; whether that was possible."""
    size, nq = counts[SIZE], points.shape[1]
    least, most = _WORTH * _measure(points, size, along), 0.0
    best = (0, 0, 0.0, 0.0, 0)
    for _ in range(_DRAWN):
        drawn = _draw_shortcut(along, size, nq, state)
        i, j, begin, end, joint = drawn
        if i < j:
            rows = _make_piece(points, along, i, j, begin, end, joint, piece)
            gain = _gain(piece, rows, end - begin)
            if gain >= least:
                gain *= _hope(failed, counts[FAILED], begin, end, joint)
                if gain > most:
                    most, best = gain, drawn
    i, j, begin, end, joint = best
    if i >= j:
        return False
    rows = _make_piece(points, along, i, j, begin, end, joint, piece)
    if not _is_free(piece, rows, counts, context):
        _remember(failed, counts, begin, end, joint)
        return False
    _adapt(failed, counts, begin, end, _gain(piece, rows, end - begin))
    _replace(points, counts, i, j, piece, rows)
    return True


@jit(boolean(OUT2, _COUNTS, OUT2, STATE, I64, I64, I64, CONTEXT), entry=True)
def shorten(points, counts, failed, state, steps, shortcuts, patience, context):
    """Skip vertices, try random shortcuts, skip vertices again: so many steps of that, or what is left.

    Args:
        points: The path, shape (capacity, nq), capacity >= rows + 2 * shortcuts.
        counts: See the constants of this file; of a path that is to be shortened the rows and zeros.
        failed: What is remembered of shortcuts that failed, shape (MEMORY, 3).
        state: Of the generator, shape (1,).
        steps: How many vertices and shortcuts to do.
        shortcuts: How many to try in all.
        patience: How many of them in a row may gain nothing.
        context: See `edge_code`.

    Returns:
        Whether nothing is left to be done.
    """
    along, piece = np.empty(len(points)), np.empty(points.shape)
    if counts[STAGE] == _FRESH:
        _drop_repeats(points, counts)
        counts[STAGE] = _SKIPPING
    for _ in range(steps):
        if counts[STAGE] == _CUTTING:
            if counts[SIZE] < 3 or counts[TRIED] == shortcuts or counts[IDLE] >= patience:
                counts[STAGE], counts[PLACE] = _SKIPPING_AGAIN, 0
            else:
                counts[TRIED] += 1
                better = _try_shortcut(points, counts, state, along, piece, failed, context)
                counts[IDLE] = 0 if better else counts[IDLE] + 1
        elif counts[PLACE] < counts[SIZE] - 2:
            _skip_vertices(points, counts, context)
        elif counts[STAGE] == _SKIPPING:
            counts[STAGE] = _CUTTING
        else:
            counts[STAGE] = _DONE
            break
    return counts[STAGE] == _DONE
