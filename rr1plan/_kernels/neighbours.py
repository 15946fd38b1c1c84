# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""A map of where two bodies are apart, over the one or two columns of q that move them against each other.

Links that follow each other closely are always near, so spheres never tell them apart, but few joints
move one against the other. A cell of the map is free when the gap at its middle is more than the bodies can
approach anywhere in it; cells that are not are cut in quarters down to the finest.
"""

from __future__ import annotations

import numpy as np
from numba import types

from rr1plan._kernels.jit import F64, FLOATS1, FLOATS2, I64, INTS1, INTS2, OUT2, jit
from rr1plan._kernels.motion import bound_travel, fine_gap, place_body, place_joints

# Bodies move on: a proof needs this much more than the travel [m].
_ROUNDING = 1e-9
_RELATIVE = 1.0 + 1e-9


@jit(
    types.void(
        *(I64, INTS1, FLOATS2, F64, types.int64[:, ::1]),
        *(INTS2, FLOATS2, INTS2, FLOATS2, FLOATS2, INTS1, INTS1, FLOATS1, INTS2, FLOATS1),
        *(OUT2, OUT2, OUT2, OUT2),
    )
)
def map_pair(
    pair,
    columns,
    ranges,
    margin,
    cells,
    joints,
    joint_values,
    bodies,
    body_values,
    corners,
    links,
    chain,
    chain_reach,
    pairs,
    padding,
    joint_poses,
    poses,
    centres,
    directions,
):
    """Mark the cells in which a pair may come nearer than its padding and a margin.

    Args:
        pair: The pair.
        columns: The two columns of q (or one, twice), shape (2,).
        ranges: Low and high of each [rad or m], shape (2, 2).
        margin: What must be left of the gap [m].
        cells: Out: 1 where it is not proven free, shape (n, n) or (n, 1), n a power of two.
        joints: From here on see `rr1plan._kernels.motion.certify`.
        joint_values: The same.
        bodies: The same.
        body_values: The same.
        corners: The same.
        links: The same.
        chain: The same.
        chain_reach: The same.
        pairs: The same.
        padding: The same.
        joint_poses: The same.
        poses: The same.
        centres: The same.
        directions: The same.
    """
    nq = 0
    for j in range(joints.shape[0]):
        nq = max(nq, joints[j, 2] + 1)
    q, reach = np.zeros(nq), np.zeros(nq)
    small, scratch, n = np.empty(12), np.empty((4, 3)), np.zeros(3)
    travel = np.zeros((bodies.shape[0], joints.shape[0] + 1))
    a, b, shared = pairs[pair, 0], pairs[pair, 1], pairs[pair, 2]
    rows, width = cells.shape
    widths = np.empty(2)
    widths[0] = (ranges[0, 1] - ranges[0, 0]) / rows
    widths[1] = (ranges[1, 1] - ranges[1, 0]) / width
    cells[:, :] = 0
    stack = np.empty((4 * 64, 3), np.int64)
    stack[0] = 0
    stack[0, 2] = rows
    count = 1
    while count > 0:
        count -= 1
        x, y, size = stack[count, 0], stack[count, 1], stack[count, 2]
        tall = min(size, width)
        if width > 1:
            q[columns[1]] = ranges[1, 0] + (y + 0.5 * tall) * widths[1]
            reach[columns[1]] = 0.5 * tall * widths[1] * _RELATIVE + 1e-12
        q[columns[0]] = ranges[0, 0] + (x + 0.5 * size) * widths[0]
        reach[columns[0]] = 0.5 * size * widths[0] * _RELATIVE + 1e-12
        place_joints(joints, joint_values, q, joint_poses, small)
        moved = 0.0
        for body in (a, b):
            if bodies[body, 5] > bodies[body, 4]:
                place_body(body, bodies, body_values, joint_poses, poses, centres)
                bound_travel(
                    body, bodies, body_values, chain, chain_reach, joints, joint_values, joint_poses, reach, centres,
                    travel,
                )  # fmt: skip
                moved += travel[body, shared]
        enough = padding[pair] + margin + moved * _RELATIVE + _ROUNDING
        lower, _ = fine_gap(
            a, b, bodies, body_values, corners, links, poses, centres, enough, enough, n, scratch, small
        )
        if lower >= enough:
            continue
        if size == 1:
            cells[x, y] = 1
            continue
        half = size // 2
        for i in range(2):
            for k in range(2 if width > 1 else 1):
                stack[count, 0], stack[count, 1], stack[count, 2] = x + i * half, y + k * half, half
                count += 1
