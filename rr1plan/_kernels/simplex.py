# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""Where a simplex of points is nearest to the origin, for several simplices at once."""

from __future__ import annotations

from numba import types

from rr1plan._kernels.jit import jit
from rr1plan._kernels.lanes import LANES, choose, greater, lesser

_LANES3 = types.UniTuple(LANES, 3)


@jit(_LANES3(LANES, LANES, LANES, LANES, LANES, LANES), inline=True, allocates=False)
def _nearest_in_triangle(ww, wa, wb, aa, ab, bb):
    """Weights of both edges at a point w that lead to where their triangle is nearest to the origin, and the square.

    All products of w and the edges are given. Where that is on the edge across from w, another point.
    """
    det = aa * bb - ab * ab
    inside = choose(aa * bb * 1e-10, det, 1.0, 0.0)
    scale = 1.0 / greater(det, 1e-300)
    s = (ab * wb - bb * wa) * scale
    t = (ab * wa - aa * wb) * scale
    inside = choose(s, 0.0, 0.0, choose(t, 0.0, 0.0, choose(1.0, s + t, 0.0, inside)))
    along_a = greater(lesser(-wa / greater(aa, 1e-300), 1.0), 0.0)
    along_b = greater(lesser(-wb / greater(bb, 1e-300), 1.0), 0.0)
    on_a = ww + along_a * (2.0 * wa + along_a * aa)
    on_b = ww + along_b * (2.0 * wb + along_b * bb)
    square = ww + s * (2.0 * wa + s * aa) + t * (2.0 * wb + t * bb) + 2.0 * s * t * ab
    edge_s, edge_t = choose(on_a, on_b, along_a, 0.0), choose(on_a, on_b, 0.0, along_b)
    s, t = choose(0.0, inside, s, edge_s), choose(0.0, inside, t, edge_t)
    return s, t, choose(0.0, inside, square, lesser(on_a, on_b))


@jit(LANES(_LANES3, _LANES3), inline=True, allocates=False)
def _product(a, b):
    """The product a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@jit(_LANES3(LANES, LANES, _LANES3, _LANES3), inline=True, allocates=False)
def _either(one, other, a, b):
    """The point a in lanes where `one` is less than `other`, else b."""
    return choose(one, other, a[0], b[0]), choose(one, other, a[1], b[1]), choose(one, other, a[2], b[2])


@jit(_LANES3(_LANES3, LANES, _LANES3, LANES, _LANES3), inline=True, allocates=False)
def _sum(w, s, e, t, f):
    """The point w + s e + t f."""
    return w[0] + s * e[0] + t * f[0], w[1] + s * e[1] + t * f[1], w[2] + s * e[2] + t * f[2]


@jit(types.UniTuple(_LANES3, 3)(_LANES3, _LANES3, _LANES3, _LANES3), inline=True, allocates=False)
def take_in(w, a, b, c):
    """Of the triangles of a new corner w with two of three others: the point nearest to the origin, and the two."""
    e, f, g = (
        (a[0] - w[0], a[1] - w[1], a[2] - w[2]),
        (b[0] - w[0], b[1] - w[1], b[2] - w[2]),
        (c[0] - w[0], c[1] - w[1], c[2] - w[2]),
    )
    ww, we, wf, wg = _product(w, w), _product(w, e), _product(w, f), _product(w, g)
    ee, ff, gg = _product(e, e), _product(f, f), _product(g, g)
    ef, eg, fg = _product(e, f), _product(e, g), _product(f, g)
    s, t, least = _nearest_in_triangle(ww, we, wf, ee, ef, ff)
    q, one, two = _sum(w, s, e, t, f), a, b
    s, t, square = _nearest_in_triangle(ww, we, wg, ee, eg, gg)
    q, two, least = _either(square, least, _sum(w, s, e, t, g), q), _either(square, least, c, b), lesser(square, least)
    s, t, square = _nearest_in_triangle(ww, wf, wg, ff, fg, gg)
    one, two = _either(square, least, b, one), _either(square, least, c, two)
    return _either(square, least, _sum(w, s, f, t, g), q), one, two


@jit(LANES(LANES, LANES, LANES, LANES, LANES, LANES, LANES, LANES, LANES), inline=True, allocates=False)
def _volume(ax, ay, az, bx, by, bz, cx, cy, cz):
    """The product a . (b x c)."""
    return ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)


@jit(LANES(_LANES3, _LANES3, _LANES3, _LANES3), inline=True, allocates=False)
def surrounds(w, a, b, c):
    """Above zero where the origin is well inside the tetrahedron of four points."""
    one = _volume(a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2])
    two = -_volume(w[0], w[1], w[2], b[0], b[1], b[2], c[0], c[1], c[2])
    three = _volume(w[0], w[1], w[2], a[0], a[1], a[2], c[0], c[1], c[2])
    four = -_volume(w[0], w[1], w[2], a[0], a[1], a[2], b[0], b[1], b[2])
    low, high = lesser(lesser(one, two), lesser(three, four)), greater(greater(one, two), greater(three, four))
    # All of one sign, and none of them of the size of rounding.
    return greater(low, -high) - 1e-9 * greater(high, -low) - 1e-18
