# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""How much of their gaps pairs of bodies have beyond their padding at one configuration."""

from __future__ import annotations

from rr1plan._kernels.exact import RECORD, exact_of
from rr1plan._kernels.gaps import fine_gap, quick_gap
from rr1plan._kernels.jit import F64, FLOATS1, jit
from rr1plan._kernels.poses import place_body, place_joints


@jit(F64(FLOATS1, F64, RECORD), entry=True, allocates=False)
def least_clearance(q, most, record):
    """The least gap of any pair beyond its padding: proven, `most` at most, -inf where bodies overlap deeply [m].

    Args:
        q: Configuration, shape (nq,).
        most: What is more is not looked at [m].
        record: Of `exact.EXACT`.
    """
    t = exact_of(record)
    place_joints(q, record)
    for body in range(t.bodies.shape[0]):
        if t.bodies[body, 5] > t.bodies[body, 4]:
            place_body(body, record)
    t.directions[:, :] = 0.0
    for p in range(t.pairs.shape[0]):
        a, b = t.pairs[p, 0], t.pairs[p, 1]
        enough = t.padding[p] + most
        if quick_gap(a, b, enough, record) >= enough:
            continue
        lower, _ = fine_gap(a, b, enough, enough, t.directions[p], record)
        most = min(most, lower - t.padding[p])
    return most
