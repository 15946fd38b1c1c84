# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""The one place where compiled planners ask whether a straight edge is free.

They know an edge function and a context they pass on unread, nothing else of the geometry.
"""

from __future__ import annotations

import numpy as np
from numba import boolean, types

from rr1plan._kernels.cover import RECORD
from rr1plan._kernels.jit import FLOATS1, FLOATS2, I64, OUT1, OUT2, jit
from rr1plan._kernels.swept import sweep_edge

# Arguments of `sweep_edge` after the ends of the edge.
CONTEXT = RECORD

# Goals to which the straight line is tried before anything else.
LINES = 8

_TURN = 2.0 * np.pi


@jit(I64(FLOATS1, FLOATS1, CONTEXT), allocates=False)
def edge_code(begin, end, context):
    """FREE (0) when the whole straight edge is proven free, another code when it is not.

    Args:
        begin: Configuration, shape (nq,).
        end: Configuration, shape (nq,).
        context: See `sweep_edge`.
    """
    status, _, _ = sweep_edge(begin, end, context)
    return status


@jit(boolean(FLOATS1, FLOATS1, FLOATS1), allocates=False)
def _holds(lower, upper, q):
    """Whether a configuration is within bounds."""
    inside = True
    for j in range(len(q)):
        inside = inside and lower[j] <= q[j] <= upper[j]
    return inside


@jit(types.void(FLOATS1, FLOATS1, FLOATS1, FLOATS1, OUT1), allocates=False)
def _come_near(goal, start, lower, upper, near):
    """Put whole turns of joints that wrap on a goal, so that it is as near to the start as it can be."""
    for j in range(len(goal)):
        wraps = upper[j] - lower[j] == np.inf
        near[j] = goal[j] + _TURN * np.rint((start[j] - goal[j]) / _TURN) if wraps else goal[j]


@jit(types.void(OUT2, I64, FLOATS1), allocates=False)
def _sort_in(rows, last, start):
    """Bring the last of some rows to its place among the others, which are sorted by their distance from the start."""
    nq, k = len(start), last
    while k > 0:
        before, after = 0.0, 0.0
        for j in range(nq):
            before += (rows[k - 1, j] - start[j]) ** 2
            after += (rows[k, j] - start[j]) ** 2
        if before <= after:
            break
        for j in range(nq):
            rows[k - 1, j], rows[k, j] = rows[k, j], rows[k - 1, j]
        k -= 1


@jit(types.UniTuple(I64, 2)(FLOATS1, FLOATS2, FLOATS1, FLOATS1, OUT2, CONTEXT), entry=True, allocates=False)
def look_at_ends(start, goals, lower, upper, near, context):
    """How many goals can be had, none where the start cannot, and the first of `LINES` in its sight (-1: none).

    Args:
        start: Configuration, shape (nq,).
        goals: Configurations, shape (k, nq).
        lower: Bounds of all, infinite for a joint that wraps, shape (nq,).
        upper: The same, shape (nq,).
        near: Its first rows become those goals, of all copies a turn away those nearest to the start, nearest first,
            shape (k, nq).
        context: See `sweep_edge`.
    """
    count = 0
    if not _holds(lower, upper, start) or edge_code(start, start, context) != 0:
        return count, -1
    for k in range(len(goals)):
        _come_near(goals[k], start, lower, upper, near[count])
        if _holds(lower, upper, goals[k]) and edge_code(near[count], near[count], context) == 0:
            _sort_in(near, count, start)
            count += 1
    for k in range(min(count, LINES)):
        if edge_code(start, near[k], context) == 0:
            return count, k
    return count, -1
