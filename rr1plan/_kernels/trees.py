# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""Two trees of configurations that grow towards each other: how they are kept, and what is asked of them.

They are kept column by column, so that distances to many vertices are computed side by side. Each vertex knows the
length of its way from its root. Where a joint turns without end a vertex has a plain number near to its parent's,
however many turns off; differences are those of the shorter way.
"""

from __future__ import annotations

import numpy as np
from numba import boolean, float64, int64, types

from rr1plan._kernels.jit import F64, FLOATS1, FLOATS2, I64, OUT1, OUT2, jit

# Entries of `counts`. The roots are a tree's first vertices.
SIZE_START, SIZE_GOAL, SAMPLES, EDGES, JOIN_START, JOIN_GOAL, PASSED, IDLE, ROOTS_START, ROOTS_GOAL, ROWS = range(11)

# Side 0 is the tree of the start, side 1 that of the goals.
TREE = float64[:, ::1]
TREES = float64[:, :, ::1]
PARENTS = int64[:, ::1]
MARKS = boolean[:, ::1]
COUNTS = int64[::1]
LENGTHS = float64[:, ::1]

# Vertices whose distances are computed side by side, in memory for so many numbers.
BLOCK = 64


@jit(F64(F64, F64), allocates=False)
def turns_in(difference, turn):
    """Whole turns that are nearest to a difference (0 for a joint that does not wrap, whose turn is 0)."""
    # Half a turn is rounded to even numbers: the same way forth and back.
    return turn * np.rint(difference / turn) if turn > 0.0 else 0.0


@jit(types.Tuple((I64, F64))(TREE, FLOATS1, I64, FLOATS1, F64, FLOATS1, OUT1), allocates=False)
def nearest_within(tree, lengths, count, q, most, turns, squares):
    """The nearest vertex from which q is reached within a length, the first of equals (-1: none), and its distance.

    Args:
        tree: Vertices, one a column, shape (nq, capacity).
        lengths: Of the ways to them, shape (capacity,).
        count: How many vertices there are.
        q: Configuration, shape (nq,).
        most: The length (inf: any).
        turns: A whole turn of each joint that wraps, 0 for the others, shape (nq,).
        squares: Scratch memory, shape (64,).
    """
    best, index = np.inf, -1
    for first in range(0, count, BLOCK):
        size = min(BLOCK, count - first)
        for i in range(size):
            squares[i] = 0.0
        for j in range(len(q)):
            value = q[j]
            turn = turns[j]
            if turn > 0.0:
                for i in range(size):
                    difference = tree[j, first + i] - value
                    difference -= turn * np.rint(difference / turn)
                    squares[i] += difference * difference
            else:
                for i in range(size):
                    difference = tree[j, first + i] - value
                    squares[i] += difference * difference
        for i in range(size):
            if squares[i] < best:
                left = most - lengths[first + i]
                if left >= 0.0 and squares[i] <= left * left:
                    best, index = squares[i], first + i
    return index, np.sqrt(best)


@jit(types.void(OUT1, TREES, I64, I64, FLOATS1), allocates=False)
def come_near(q, trees, side, index, turns):
    """Take whole turns off a configuration, so that a vertex is joined to it by the shorter way."""
    for j in range(len(q)):
        if turns[j] > 0.0:
            q[j] += turns_in(trees[side, j, index] - q[j], turns[j])


@jit(types.void(TREES, PARENTS, LENGTHS, COUNTS, I64, FLOATS1, I64, F64), allocates=False)
def add_vertex(trees, parents, lengths, counts, side, q, parent, length):
    """One more vertex of a tree."""
    i = counts[side]
    for j in range(len(q)):
        trees[side, j, i] = q[j]
    parents[side, i] = parent
    lengths[side, i] = length
    counts[side] = i + 1


@jit(types.void(TREES, PARENTS, LENGTHS, MARKS, COUNTS, FLOATS1, FLOATS2), allocates=False)
def plant(trees, parents, lengths, blocked, counts, start, goals):
    """Two trees that are nothing but their roots."""
    for i in range(len(counts)):
        counts[i] = 0
    for i in range(blocked.shape[1]):
        blocked[0, i] = blocked[1, i] = False
    counts[SIZE_START] = counts[ROOTS_START] = 1
    counts[SIZE_GOAL] = counts[ROOTS_GOAL] = len(goals)
    for i in range(len(goals)):
        parents[0, i] = parents[1, i] = -1
        lengths[0, i] = lengths[1, i] = 0.0
        for j in range(len(start)):
            trees[0, j, i] = start[j]
            trees[1, j, i] = goals[i, j]


@jit(types.void(TREES, COUNTS, FLOATS1), allocates=False)
def bring_together(trees, counts, turns):
    """Move the goals' tree by whole turns to where the start's meets it."""
    for j in range(len(turns)):
        move = turns_in(trees[0, j, counts[JOIN_START]] - trees[1, j, counts[JOIN_GOAL]], turns[j])
        if move != 0.0:
            for i in range(counts[SIZE_GOAL]):
                trees[1, j, i] += move


@jit(types.void(TREES, PARENTS, COUNTS, OUT2), allocates=False)
def trace(trees, parents, counts, path):
    """Write down the path through the two vertices that meet, from the start to a goal."""
    before = 0
    i = counts[JOIN_START]
    while i >= 0:
        before += 1
        i = parents[0, i]
    i = counts[JOIN_START]
    for k in range(before - 1, -1, -1):
        for j in range(trees.shape[1]):
            path[k, j] = trees[0, j, i]
        i = parents[0, i]
    rows, i = before, counts[JOIN_GOAL]
    while i >= 0:
        for j in range(trees.shape[1]):
            path[rows, j] = trees[1, j, i]
        rows += 1
        i = parents[1, i]
    counts[ROWS] = rows
