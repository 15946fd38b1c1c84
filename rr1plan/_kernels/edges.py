# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""The one place where compiled planners ask whether a straight edge is free.

They know an edge function and a context they pass on unread, nothing else of the geometry.
"""

from __future__ import annotations

from rr1plan._kernels.cover import RECORD
from rr1plan._kernels.jit import FLOATS1, I64, jit
from rr1plan._kernels.swept import sweep_edge

# Arguments of `sweep_edge` after the ends of the edge.
CONTEXT = RECORD


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
