# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""A straight edge or a parabola, by spheres first and by the exact kernel where they leave something open.

The answer is the exact kernel's: what spheres prove free has a gap beyond its tolerance everywhere, and what
they prove to touch is nearer than the padding.
"""

from __future__ import annotations

from numba import types

from rr1plan._kernels.cover import RECORD, tables_of
from rr1plan._kernels.intervals import PROVEN, TOUCHES, sweep
from rr1plan._kernels.jit import F64, FLOATS1, FLOATS2, I64, jit
from rr1plan._kernels.lanes import WIDTH
from rr1plan._kernels.motion import CONTACT, FREE, certify, certify_open
from rr1plan._kernels.placing import take_edge, take_parabola

# What has been done so far: edges, those that needed the exact kernel, configurations, gaps computed finely.
EDGES, EXACT_EDGES, CONFIGURATIONS, GAPS = range(4)
_ANSWER = types.Tuple((I64, F64, I64))


@jit(_ANSWER(I64, RECORD), inline=True, allocates=False)
def _decide(terms, record):
    """The answer for the edge in `Work.curve`, of which so many coefficients count."""
    _, work, (tolerance, exact), done = tables_of(record)
    done[EDGES] += 1
    answer = sweep(record)
    done[CONFIGURATIONS] += WIDTH * work.counts[1]
    if answer == PROVEN:
        return FREE, 0.0, -1
    if answer == TOUCHES:
        return CONTACT, work.open_spans[0, 0], work.counts[2]
    done[EXACT_EDGES] += 1
    curve = work.curve[:terms]
    if work.counts[0] < 0:
        status, where, pair, seen, fine = certify(curve, 1.0, tolerance, exact)
    else:
        status, where, pair, seen, fine = certify_open(
            curve, 1.0, tolerance, work.open_spans, work.open_pairs, work.counts[0], exact
        )
    done[CONFIGURATIONS] += seen
    done[GAPS] += fine
    return status, where, pair


@jit(_ANSWER(FLOATS1, FLOATS1, RECORD), entry=True, allocates=False)
def sweep_edge(begin, end, record):
    """Certify a straight edge free of contact, or find a place where it is not.

    Args:
        begin: Configuration, shape (nq,).
        end: Configuration, shape (nq,).
        record: Of `cover.TABLES`.

    Returns:
        FREE, CONTACT or GRAZING; where (0..1); which pair.
    """
    _, work, _, _ = tables_of(record)
    take_edge(begin, end, work)
    return _decide(2, record)


@jit(_ANSWER(FLOATS2, F64, RECORD), entry=True, allocates=False)
def sweep_parabola(curve, duration, record):
    """Certify a curve q(t) = sum_k curve[k] t^k of degree 2 at most, or find a place where it is not free.

    Args:
        curve: Coefficients, shape (k, nq), k = 1, 2 or 3.
        duration: End of the curve; it begins at 0.
        record: Of `cover.TABLES`.

    Returns:
        FREE, CONTACT or GRAZING; where (0..1); which pair.
    """
    _, work, _, _ = tables_of(record)
    take_parabola(curve, duration, work)
    return _decide(3, record)
