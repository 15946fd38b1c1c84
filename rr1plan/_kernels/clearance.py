# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""How much of their gaps pairs of bodies have beyond their padding at one configuration."""

from __future__ import annotations

import numpy as np

from rr1plan._kernels.jit import F64, FLOATS1, FLOATS2, INTS1, INTS2, OUT2, jit
from rr1plan._kernels.motion import fine_gap, place_body, place_joints, quick_gap


@jit(
    F64(
        *(FLOATS1, F64),
        *(INTS2, FLOATS2, INTS2, FLOATS2, FLOATS2, INTS1, INTS1, FLOATS1, INTS2, FLOATS1),
        *(OUT2, OUT2, OUT2, OUT2),
    )
)
def least_clearance(
    q,
    most,
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
    """The least gap of any pair beyond its padding: proven, `most` at most, -inf where bodies overlap deeply [m].

    Args:
        q: Configuration, shape (nq,).
        most: What is more is not looked at [m].
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
    small, scratch = np.empty(12), np.empty((4, 3))
    place_joints(joints, joint_values, q, joint_poses, small)
    for body in range(bodies.shape[0]):
        if bodies[body, 5] > bodies[body, 4]:
            place_body(body, bodies, body_values, joint_poses, poses, centres)
    directions[:, :] = 0.0
    for p in range(pairs.shape[0]):
        a, b = pairs[p, 0], pairs[p, 1]
        enough = padding[p] + most
        if quick_gap(a, b, bodies, body_values, poses, centres, enough) >= enough:
            continue
        lower, _ = fine_gap(
            a, b, bodies, body_values, corners, links, poses, centres, enough, enough, directions[p], scratch, small
        )
        most = min(most, lower - padding[p])
    return most
