# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""Several points at once against one obstacle: how far, how fast towards it, and its nearest point."""

from __future__ import annotations

from numba import types

from rr1plan._kernels.cover import CYLINDER, SLACK
from rr1plan._kernels.jit import I64, jit
from rr1plan._kernels.lanes import LANES, choose, greater, lesser, root, size_of
from rr1plan._kernels.tables import floats, whole

_VALUES, _KINDS = floats(17), whole(2)


@jit(LANES(_VALUES, _KINDS, I64, LANES, LANES, LANES), inline=True, allocates=False)
def square_to(values, kinds, o, x, y, z):
    """Square of the distance from points to an obstacle's core, or a bound from below [m^2]."""
    dx, dy, dz = x - values[o, 9], y - values[o, 10], z - values[o, 11]
    a = size_of(dx * values[o, 0] + dy * values[o, 3] + dz * values[o, 6])
    b = size_of(dx * values[o, 1] + dy * values[o, 4] + dz * values[o, 7])
    c = dx * values[o, 2] + dy * values[o, 5] + dz * values[o, 8]
    c = greater(greater(c - values[o, 14], values[o, 16] - c), 0.0)
    if kinds[o, 0] == CYLINDER:
        a = greater(root(a * a + b * b) - values[o, 12], 0.0)
        return a * a + c * c
    a = greater(a - values[o, 12], 0.0)
    b = greater(b - values[o, 13], 0.0)
    return a * a + b * b + c * c


@jit(LANES(_VALUES, _KINDS, I64, LANES, LANES, LANES, LANES, LANES, LANES), inline=True, allocates=False)
def approach_to(values, kinds, o, x, y, z, u, v, w):
    """Distance to an obstacle's core times speed along the direction from its nearest point, without sign [m^2]."""
    dx, dy, dz = x - values[o, 9], y - values[o, 10], z - values[o, 11]
    a = dx * values[o, 0] + dy * values[o, 3] + dz * values[o, 6]
    b = dx * values[o, 1] + dy * values[o, 4] + dz * values[o, 7]
    c = dx * values[o, 2] + dy * values[o, 5] + dz * values[o, 8]
    c = c - greater(lesser(c, values[o, 14]), values[o, 16])
    if kinds[o, 0] == CYLINDER:
        across = root(a * a + b * b)
        part = greater(across - values[o, 12], 0.0) / greater(across, 1e-12)
        a, b = a * part, b * part
    else:
        a = a - greater(lesser(a, values[o, 12]), -values[o, 12])
        b = b - greater(lesser(b, values[o, 13]), -values[o, 13])
    p = u * values[o, 0] + v * values[o, 3] + w * values[o, 6]
    q = u * values[o, 1] + v * values[o, 4] + w * values[o, 7]
    r = u * values[o, 2] + v * values[o, 5] + w * values[o, 8]
    return size_of(a * p + b * q + c * r) * SLACK


@jit(types.UniTuple(LANES, 3)(_VALUES, _KINDS, I64, LANES, LANES, LANES), inline=True, allocates=False)
def nearest_in(values, kinds, o, x, y, z):
    """The points of an obstacle's core that are nearest to points; not for a half-space."""
    dx, dy, dz = x - values[o, 9], y - values[o, 10], z - values[o, 11]
    a = dx * values[o, 0] + dy * values[o, 3] + dz * values[o, 6]
    b = dx * values[o, 1] + dy * values[o, 4] + dz * values[o, 7]
    c = dx * values[o, 2] + dy * values[o, 5] + dz * values[o, 8]
    c = greater(lesser(c, values[o, 14]), -values[o, 14])
    if kinds[o, 0] == CYLINDER:
        across = root(a * a + b * b)
        part = lesser(across, values[o, 12]) / greater(across, 1e-12)
        a, b = a * part, b * part
    else:
        a = greater(lesser(a, values[o, 12]), -values[o, 12])
        b = greater(lesser(b, values[o, 13]), -values[o, 13])
    return (
        a * values[o, 0] + b * values[o, 1] + c * values[o, 2] + values[o, 9],
        a * values[o, 3] + b * values[o, 4] + c * values[o, 5] + values[o, 10],
        a * values[o, 6] + b * values[o, 7] + c * values[o, 8] + values[o, 11],
    )


@jit(types.UniTuple(LANES, 4)(_VALUES, _KINDS, I64, LANES, LANES, LANES), inline=True, allocates=False)
def farthest_in(values, kinds, o, x, y, z):
    """The greatest n.p over an obstacle's core, n a direction, and the point p; not for a half-space."""
    a = x * values[o, 0] + y * values[o, 3] + z * values[o, 6]
    b = x * values[o, 1] + y * values[o, 4] + z * values[o, 7]
    c = x * values[o, 2] + y * values[o, 5] + z * values[o, 8]
    r = choose(c, 0.0, -values[o, 14], values[o, 14])
    if kinds[o, 0] == CYLINDER:
        part = values[o, 12] / greater(root(a * a + b * b), 1e-12)
        p, q = a * part, b * part
    else:
        p, q = choose(a, 0.0, -values[o, 12], values[o, 12]), choose(b, 0.0, -values[o, 13], values[o, 13])
    u = p * values[o, 0] + q * values[o, 1] + r * values[o, 2] + values[o, 9]
    v = p * values[o, 3] + q * values[o, 4] + r * values[o, 5] + values[o, 10]
    w = p * values[o, 6] + q * values[o, 7] + r * values[o, 8] + values[o, 11]
    return x * u + y * v + z * w, u, v, w
