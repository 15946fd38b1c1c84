# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""How far two bodies are apart: a quick bound from below, and the gap itself."""

from __future__ import annotations

import numpy as np
from numba import types

from rr1plan._kernels.exact import RECORD, exact_of
from rr1plan._kernels.jit import F64, I64, OUT1, jit
from rr1plan._kernels.separation import BOX, CELLS, HALF_SPACE, POINT, separation, support


@jit(F64(I64, I64, RECORD), allocates=False)
def _centre_gap_to_box(a, b, record):
    """Distance from the centre of a's ball to the bounding box of b [m]."""
    t = exact_of(record)
    body_values, centres, poses = t.body_values, t.centres, t.poses
    dx, dy, dz = centres[a, 0] - poses[b, 9], centres[a, 1] - poses[b, 10], centres[a, 2] - poses[b, 11]
    square = 0.0
    for c in range(3):
        along = poses[b, c] * dx + poses[b, 3 + c] * dy + poses[b, 6 + c] * dz
        out = abs(along - body_values[b, 17 + c]) - body_values[b, 20 + c]
        if out > 0.0:
            square += out * out
    return np.sqrt(square)


@jit(F64(I64, I64, F64, RECORD), allocates=False)
def quick_gap(a, b, enough, record):
    """A lower bound of the distance of two bodies from their balls and boxes [m]; it stops at enough."""
    t = exact_of(record)
    bodies, body_values, centres = t.bodies, t.body_values, t.centres
    if bodies[b, 0] == HALF_SPACE:
        return -np.inf
    dx, dy, dz = centres[a, 0] - centres[b, 0], centres[a, 1] - centres[b, 1], centres[a, 2] - centres[b, 2]
    ra, rb = body_values[a, 15], body_values[b, 15]
    gap = np.sqrt(dx * dx + dy * dy + dz * dz) - ra - rb
    if gap < enough and bodies[b, 0] != POINT:
        gap = max(gap, _centre_gap_to_box(a, b, record) - ra)
    if gap < enough and bodies[a, 0] != POINT:
        gap = max(gap, _centre_gap_to_box(b, a, record) - rb)
    return gap


@jit(F64(I64, I64, RECORD), allocates=False)
def _gap_to_half_space(a, b, record):
    """Exact distance of a body's core to the plane of half-space b [m]."""
    t = exact_of(record)
    bodies, body_values, poses = t.bodies, t.body_values, t.poses
    nx = poses[b, 0] * body_values[b, 23] + poses[b, 1] * body_values[b, 24] + poses[b, 2] * body_values[b, 25]
    ny = poses[b, 3] * body_values[b, 23] + poses[b, 4] * body_values[b, 24] + poses[b, 5] * body_values[b, 25]
    nz = poses[b, 6] * body_values[b, 23] + poses[b, 7] * body_values[b, 24] + poses[b, 8] * body_values[b, 25]
    x, y, z, _ = support(bodies[a, 0], body_values[a, 23:26], poses[a], t.corners, t.links, bodies[a, 2], -nx, -ny, -nz)
    height = nx * (x - poses[b, 9]) + ny * (y - poses[b, 10]) + nz * (z - poses[b, 11])
    return height - body_values[b, 26]


@jit(types.UniTuple(F64, 2)(I64, I64, F64, F64, OUT1, RECORD), allocates=False)
def _gap_to_cells(a, b, least, enough, n, record):
    """Bounds of the distance of a body to the occupied cells of cloud b [m]."""
    t = exact_of(record)
    bodies, body_values, corners, poses, centres = t.bodies, t.body_values, t.corners, t.poses, t.centres
    cell = t.frame
    half = body_values[b, 23]
    radius = body_values[a, 16]
    lower, upper = np.inf, np.inf
    dx, dy, dz = centres[a, 0] - poses[b, 9], centres[a, 1] - poses[b, 10], centres[a, 2] - poses[b, 11]
    lx = poses[b, 0] * dx + poses[b, 3] * dy + poses[b, 6] * dz
    ly = poses[b, 1] * dx + poses[b, 4] * dy + poses[b, 7] * dz
    lz = poses[b, 2] * dx + poses[b, 5] * dy + poses[b, 8] * dz
    near = enough + body_values[a, 15]
    for k in range(9):
        cell[k] = poses[b, k]
    for i in range(bodies[b, 2], bodies[b, 3]):
        ox = max(0.0, abs(lx - corners[i, 0]) - half)
        oy = max(0.0, abs(ly - corners[i, 1]) - half)
        oz = max(0.0, abs(lz - corners[i, 2]) - half)
        square = ox * ox + oy * oy + oz * oz
        if near < 0.0 or square < near * near:
            for r in range(3):
                cell[9 + r] = poses[b, 9 + r]
                for c in range(3):
                    cell[9 + r] += poses[b, 3 * r + c] * corners[i, c]
            n[0], n[1], n[2] = centres[a, 0] - cell[9], centres[a, 1] - cell[10], centres[a, 2] - cell[11]
            low, high = separation(
                bodies[a, 0], body_values[a, 23:26], poses[a], corners, t.links, bodies[a, 2],
                BOX, body_values[b, 23:26], cell, corners, t.links, 0, least + radius, enough + radius, n, t.simplex,
            )  # fmt: skip
            lower = min(lower, low - radius)
            upper = min(upper, high - radius)
            if upper <= least:
                return lower, upper
    return lower, upper


@jit(types.UniTuple(F64, 2)(I64, I64, F64, F64, OUT1, RECORD), allocates=False)
def fine_gap(a, b, least, enough, n, record):
    """Bounds of the distance of two bodies [m]: proven lower, upper.

    Args:
        a: A body.
        b: Another, the half-space or cloud if there is one.
        least: It may stop where the distance is proven to be at most this [m].
        enough: It may stop where the distance is proven to be this [m].
        n: A direction to begin with (zero: none is known); out: the last one, shape (3,).
        record: Of `exact.EXACT`.
    """
    t = exact_of(record)
    bodies, body_values, centres = t.bodies, t.body_values, t.centres
    radius = body_values[a, 16] + body_values[b, 16]
    if bodies[b, 0] == HALF_SPACE:
        gap = _gap_to_half_space(a, b, record) - radius
        return gap, gap
    if bodies[b, 0] == CELLS:
        return _gap_to_cells(a, b, least, enough, n, record)
    if n[0] == 0.0 and n[1] == 0.0 and n[2] == 0.0:
        for c in range(3):
            n[c] = centres[a, c] - centres[b, c]
        if n[0] == 0.0 and n[1] == 0.0 and n[2] == 0.0:
            n[2] = 1.0
    lower, upper = separation(
        bodies[a, 0], body_values[a, 23:26], t.poses[a], t.corners, t.links, bodies[a, 2],
        bodies[b, 0], body_values[b, 23:26], t.poses[b], t.corners, t.links, bodies[b, 2],
        least + radius, enough + radius, n, t.simplex,
    )  # fmt: skip
    return lower - radius, upper - radius
