# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""The one place where compiled planners ask whether a straight edge is free.

They know an edge function and a context they pass on unread, nothing else of the geometry.
"""

from __future__ import annotations

import numpy as np
from numba import boolean

from rr1plan._kernels.cover import RECORD
from rr1plan._kernels.jit import FLOATS1, I64, OUT1, jit
from rr1plan._kernels.swept import sweep_edge

# Arguments of `sweep_edge` after the ends of the edge.
CONTEXT = RECORD

# What is known of a start and a goal: one of them may be none, both are fine, so is the straight line between them.
DOUBTFUL, APART, IN_SIGHT = range(3)

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


@jit(I64(FLOATS1, FLOATS1, FLOATS1, FLOATS1, OUT1, CONTEXT), entry=True, allocates=False)
def look_at_ends(start, goal, lower, upper, near, context):
    """DOUBTFUL, APART or IN_SIGHT.

    Args:
        start: Configuration, shape (nq,).
        goal: Configuration, shape (nq,).
        lower: Bounds of both, infinite for a joint that wraps, shape (nq,).
        upper: The same, shape (nq,).
        near: Becomes the goal's copy that is nearest to the start, whole turns of joints that wrap put on, shape (nq,).
        context: See `sweep_edge`.
    """
    if not (_holds(lower, upper, start) and _holds(lower, upper, goal)):
        return DOUBTFUL
    for j in range(len(goal)):
        wraps = upper[j] - lower[j] == np.inf
        near[j] = goal[j] + _TURN * np.rint((start[j] - goal[j]) / _TURN) if wraps else goal[j]
    if edge_code(start, start, context) != 0 or edge_code(near, near, context) != 0:
        return DOUBTFUL
    return IN_SIGHT if edge_code(start, near, context) == 0 else APART
