# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""The one place where compiled planners ask whether a straight edge is free.

They know an edge function and a context they pass on unread, nothing else of the geometry. Whoever changes
what is called here touches the files that call `edge_code` too, or their compiled code stays as it was.
"""

from __future__ import annotations

import numpy as np
from numba import types

from rr1plan._kernels.jit import F64, FLOATS1, FLOATS2, I64, INTS1, INTS2, OUT2, jit
from rr1plan._kernels.motion import certify

# Tolerance [m], then the tables of `certify` in its order.
CONTEXT = types.Tuple(
    (F64, INTS2, FLOATS2, INTS2, FLOATS2, FLOATS2, INTS1, INTS1, FLOATS1, INTS2, FLOATS1, OUT2, OUT2, OUT2, OUT2)
)


@jit(I64(FLOATS1, FLOATS1, CONTEXT))
def edge_code(begin, end, context):
    """FREE (0) when the whole straight edge is proven free, another code when it is not.

    Args:
        begin: Configuration, shape (nq,).
        end: Configuration, shape (nq,).
        context: Tolerance and tables; see `certify`.
    """
    nq = len(begin)
    curve = np.empty((2, nq))
    for j in range(nq):
        curve[0, j] = begin[j]
        curve[1, j] = end[j] - begin[j]
    status, _, _, _, _ = certify(curve, 1.0, context[0], *context[1:])
    return status
