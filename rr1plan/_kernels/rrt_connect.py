# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""RRT-Connect as one compiled loop.

Two trees, one rooted in the start, one in all goals. The smaller one takes a step towards a random
configuration; the other one then walks towards what was added, step by step, until it gets there or is
blocked (Kuffner and LaValle, RRT-Connect: an efficient approach to single-query path planning, 2000). A
vertex that has met an obstacle takes only samples near to it: others would lead into the same obstacle again
(Yershova et al., Dynamic-domain RRTs, 2005).

Every decision but the edges' own is made with sums, products and square roots, which IEEE 754 rounds the same
way everywhere. Edges use sines, whose last bit may differ between machines: that could decide otherwise only
for an edge that is free or blocked by less than about 1e-15 m.

The loop stops after a given number of samples and goes on where it stopped: all it knows is in its arrays.
Trees are kept column by column, so that distances to many vertices are computed side by side.
"""

from __future__ import annotations

import numpy as np
from numba import boolean, float64, int64, types

from rr1plan._kernels.edges import CONTEXT, edge_code
from rr1plan._kernels.generator import STATE, draw_between
from rr1plan._kernels.jit import F64, FLOATS1, FLOATS2, I64, OUT1, jit

GOING, SOLVED, FULL = range(3)

# Entries of `counts`.
SIZE_START, SIZE_GOAL, SAMPLES, EDGES, JOIN_START, JOIN_GOAL, PASSED = range(7)

_BLOCK = 64
# So many samples in a row may be passed over: in spaces of many joints hardly any is near to anything.
_MOST_PASSED = 64
_TREE = float64[:, ::1]
_TREES = float64[:, :, ::1]
_PARENTS = int64[:, ::1]
_MARKS = boolean[:, ::1]
_COUNTS = int64[::1]


@jit(types.Tuple((I64, F64))(_TREE, I64, FLOATS1, OUT1), allocates=False)
def nearest(tree, count, q, squares):
    """The vertex nearest to q, the first of equals, and its distance.

    Args:
        tree: Vertices, one a column, shape (nq, capacity).
        count: How many there are.
        q: Configuration, shape (nq,).
        squares: Scratch memory, shape (64,).
    """
    best, index = np.inf, 0
    for first in range(0, count, _BLOCK):
        size = min(_BLOCK, count - first)
        for i in range(size):
            squares[i] = 0.0
        for j in range(len(q)):
            value = q[j]
            for i in range(size):
                difference = tree[j, first + i] - value
                squares[i] += difference * difference
        for i in range(size):
            if squares[i] < best:
                best, index = squares[i], first + i
    return index, np.sqrt(best)


@jit(types.void(_TREES, _PARENTS, _COUNTS, I64, FLOATS1, I64), allocates=False)
def _add(trees, parents, counts, side, q, parent):
    """One more vertex of a tree."""
    i = counts[side]
    for j in range(len(q)):
        trees[side, j, i] = q[j]
    parents[side, i] = parent
    counts[side] = i + 1


@jit(boolean(I64, FLOATS1, FLOATS1, _COUNTS, CONTEXT), allocates=False)
def _is_free(side, near, new, counts, context):
    """Ask for an edge of a tree in the direction in which the path would take it: same question, same answer."""
    counts[EDGES] += 1
    return edge_code(near, new, context) == 0 if side == 0 else edge_code(new, near, context) == 0


@jit(boolean(_TREES, _PARENTS, _COUNTS, I64, I64, F64, FLOATS1, F64, OUT1, OUT1, CONTEXT), allocates=False)
def _connect(trees, parents, counts, side, index, distance, target, step, a, b, context):
    """Walk from a vertex towards a target in steps of equal length; whether it got there.

    What is reached becomes vertices; the target itself does not, so the last vertex joins the trees.
    """
    nq = len(target)
    if distance == 0.0 and parents[side, index] >= 0:
        # They meet in one place, which is a waypoint once.
        counts[JOIN_START + side] = parents[side, index]
        return True
    steps = max(1, int(np.ceil(distance / step)))
    for j in range(nq):
        a[j] = trees[side, j, index]
    for k in range(1, steps + 1):
        for j in range(nq):
            origin = trees[side, j, index]
            b[j] = target[j] if k == steps else origin + (target[j] - origin) * (k / steps)
        if not _is_free(side, a, b, counts, context):
            return False
        if k == steps:
            counts[JOIN_START + side] = index if k == 1 else counts[side] - 1
            return True
        _add(trees, parents, counts, side, b, index if k == 1 else counts[side] - 1)
        for j in range(nq):
            a[j] = b[j]
    return False


@jit(boolean(_COUNTS, types.Array(boolean, 1, "C"), I64, F64, F64), allocates=False)
def _passes_over(counts, blocked, index, distance, domain):
    """Whether a sample is too far from a nearest vertex that has met an obstacle."""
    if blocked[index] and distance > domain and counts[PASSED] < _MOST_PASSED:
        counts[PASSED] += 1
        return True
    counts[PASSED] = 0
    return False


@jit(I64(_TREES, _PARENTS, _MARKS, _COUNTS, STATE, FLOATS1, FLOATS1, F64, F64, I64, CONTEXT))
def grow(trees, parents, blocked, counts, state, lower, extent, step, domain, samples, context):
    """Grow both trees by so many samples, or until they meet.

    Args:
        trees: Vertices of the start's tree and of the goals', shape (2, nq, capacity).
        parents: Index of each vertex's parent, -1 for a root, shape (2, capacity).
        blocked: Whether a step from a vertex towards a sample was blocked, shape (2, capacity).
        counts: Sizes of both trees, samples and edges so far, the two vertices that meet, samples passed
            over in a row; shape (7,).
        state: Of the generator, shape (1,).
        lower: Corner of the box to sample, shape (nq,).
        extent: Its sides, shape (nq,).
        step: Longest edge of a tree.
        domain: How near a sample has to be to a vertex that has met an obstacle.
        samples: `counts[SAMPLES]` to stop at.
        context: See `edge_code`.

    Returns:
        GOING, SOLVED, or FULL when the arrays have to be made larger.
    """
    nq, capacity = trees.shape[1], trees.shape[2]
    q, a, b, squares = np.empty(nq), np.empty(nq), np.empty(nq), np.empty(_BLOCK)
    longest_walk = 3.0
    for j in range(nq):
        longest_walk += extent[j] / step
    while counts[SAMPLES] < samples:
        if max(counts[SIZE_START], counts[SIZE_GOAL]) + longest_walk > capacity:
            return FULL
        side = 0 if counts[SIZE_START] <= counts[SIZE_GOAL] else 1
        other = 1 - side
        draw_between(state, lower, extent, q)
        counts[SAMPLES] += 1
        index, distance = nearest(trees[side], counts[side], q, squares)
        if distance == 0.0 or _passes_over(counts, blocked[side], index, distance, domain):
            continue
        part = min(1.0, step / distance)
        for j in range(nq):
            a[j] = trees[side, j, index]
            if part < 1.0:
                q[j] = a[j] + (q[j] - a[j]) * part
        if not _is_free(side, a, q, counts, context):
            blocked[side, index] = True
            continue
        _add(trees, parents, counts, side, q, index)
        index, distance = nearest(trees[other], counts[other], q, squares)
        if _connect(trees, parents, counts, other, index, distance, q, step, a, b, context):
            counts[JOIN_START + side] = counts[side] - 1
            return SOLVED
    return GOING


@jit(float64[:, ::1](_TREES, _PARENTS, _COUNTS))
def trace(trees, parents, counts):
    """The path through the two vertices that meet, from the start to a goal, shape (n, nq)."""
    nq = trees.shape[1]
    before, after = 0, 0
    i = counts[JOIN_START]
    while i >= 0:
        before += 1
        i = parents[0, i]
    i = counts[JOIN_GOAL]
    while i >= 0:
        after += 1
        i = parents[1, i]
    path = np.empty((before + after, nq))
    i = counts[JOIN_START]
    for k in range(before - 1, -1, -1):
        for j in range(nq):
            path[k, j] = trees[0, j, i]
        i = parents[0, i]
    i = counts[JOIN_GOAL]
    for k in range(before, before + after):
        for j in range(nq):
            path[k, j] = trees[1, j, i]
        i = parents[1, i]
    return path


@jit(I64(FLOATS1, FLOATS2, I64, CONTEXT), allocates=False)
def nearest_direct(start, goals, most, context):
    """The first of the goals that a straight edge from the start reaches, of the first `most`; -1: none."""
    for k in range(min(most, len(goals))):
        if edge_code(start, goals[k], context) == 0:
            return k
    return -1
