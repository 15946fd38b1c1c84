# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""Where joints and bodies are, and how far bodies can get from there."""

from __future__ import annotations

import numpy as np
from numba import types

from rr1plan._kernels.exact import RECORD, exact_of
from rr1plan._kernels.jit import FLOATS1, I64, jit


@jit(types.void(FLOATS1, RECORD), allocates=False)
def place_joints(q, record):
    """World poses of all driven joints, into `joint_poses`.

    Args:
        q: Configuration, shape (nq,).
        record: Of `exact.EXACT`.
    """
    t = exact_of(record)
    joints, joint_values, poses, T = t.joints, t.joint_values, t.joint_poses, t.frame
    for j in range(1, joints.shape[0]):
        if joints[j, 3] == 0:
            continue
        p = joints[j, 0]
        column = joints[j, 2]
        value = joint_values[j, 16]
        if column >= 0:
            value += joint_values[j, 15] * q[column]
        x, y, z = joint_values[j, 12], joint_values[j, 13], joint_values[j, 14]
        for r in range(3):
            for c in range(3):
                T[3 * r + c] = (
                    poses[p, 3 * r] * joint_values[j, c]
                    + poses[p, 3 * r + 1] * joint_values[j, 3 + c]
                    + poses[p, 3 * r + 2] * joint_values[j, 6 + c]
                )
            poses[j, 9 + r] = (
                poses[p, 3 * r] * joint_values[j, 9]
                + poses[p, 3 * r + 1] * joint_values[j, 10]
                + poses[p, 3 * r + 2] * joint_values[j, 11]
                + poses[p, 9 + r]
            )
        if joints[j, 1] == 1:
            for r in range(3):
                for c in range(3):
                    poses[j, 3 * r + c] = T[3 * r + c]
                along = T[3 * r] * x + T[3 * r + 1] * y + T[3 * r + 2] * z
                poses[j, 9 + r] += value * along
            continue
        s, co = np.sin(value), np.cos(value)
        v = 1.0 - co
        m00, m01, m02 = co + v * x * x, v * x * y - s * z, v * x * z + s * y
        m10, m11, m12 = v * x * y + s * z, co + v * y * y, v * y * z - s * x
        m20, m21, m22 = v * x * z - s * y, v * y * z + s * x, co + v * z * z
        for r in range(3):
            a, b, c = T[3 * r], T[3 * r + 1], T[3 * r + 2]
            poses[j, 3 * r] = a * m00 + b * m10 + c * m20
            poses[j, 3 * r + 1] = a * m01 + b * m11 + c * m21
            poses[j, 3 * r + 2] = a * m02 + b * m12 + c * m22


@jit(types.void(I64, RECORD), allocates=False)
def place_body(body, record):
    """World pose of a body and of the centre of its ball, where its joint is."""
    t = exact_of(record)
    body_values, joint_poses, poses = t.body_values, t.joint_poses, t.poses
    j = t.bodies[body, 1]
    for r in range(3):
        a, b, c = joint_poses[j, 3 * r], joint_poses[j, 3 * r + 1], joint_poses[j, 3 * r + 2]
        for k in range(3):
            poses[body, 3 * r + k] = (
                a * body_values[body, k] + b * body_values[body, 3 + k] + c * body_values[body, 6 + k]
            )
        shift = joint_poses[j, 9 + r]
        poses[body, 9 + r] = a * body_values[body, 9] + b * body_values[body, 10] + c * body_values[body, 11] + shift
        t.centres[body, r] = a * body_values[body, 12] + b * body_values[body, 13] + c * body_values[body, 14] + shift


@jit(types.void(I64, FLOATS1, RECORD), allocates=False)
def bound_travel(body, reach, record):
    """How far any point of a body can get from where it is, per joint of its chain and all below it, into `travel`.

    Args:
        body: The body.
        reach: How far each column of q gets from its value, shape (nq,).
        record: Of `exact.EXACT`.
    """
    t = exact_of(record)
    joints, joint_values, joint_poses, centres, travel = t.joints, t.joint_values, t.joint_poses, t.centres, t.travel
    first, last = t.bodies[body, 4], t.bodies[body, 5]
    radius = t.body_values[body, 15]
    # `centre` bounds the travel of the ball's centre, `surface` that of any point of the body.
    centre, surface = 0.0, 0.0
    travel[body, last - first] = 0.0
    for k in range(last - 1, first - 1, -1):
        j = t.chain[k]
        amount = abs(joint_values[j, 15]) * reach[joints[j, 2]]
        if joints[j, 1] == 1:
            centre += amount
            surface += amount
        else:
            x = joint_poses[j, 0] * joint_values[j, 12] + joint_poses[j, 1] * joint_values[j, 13]
            y = joint_poses[j, 3] * joint_values[j, 12] + joint_poses[j, 4] * joint_values[j, 13]
            z = joint_poses[j, 6] * joint_values[j, 12] + joint_poses[j, 7] * joint_values[j, 13]
            x += joint_poses[j, 2] * joint_values[j, 14]
            y += joint_poses[j, 5] * joint_values[j, 14]
            z += joint_poses[j, 8] * joint_values[j, 14]
            dx = centres[body, 0] - joint_poses[j, 9]
            dy = centres[body, 1] - joint_poses[j, 10]
            dz = centres[body, 2] - joint_poses[j, 11]
            cx, cy, cz = y * dz - z * dy, z * dx - x * dz, x * dy - y * dx
            arm = min(t.chain_reach[k], np.sqrt(cx * cx + cy * cy + cz * cz) + centre)
            centre += amount * arm
            surface += amount * (arm + radius)
        travel[body, k - first] = surface
