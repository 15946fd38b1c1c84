# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""A chain of joints, where its end is, how far that is from a target, and how that changes with the joints."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import types

from rr1plan._kernels.jit import F64, FLOATS1, FLOATS2, I64, INTS2, OUT1, OUT2, jit

# Entries of a target: corners of the box for the origin (3 + 3), the rotation (9), and the length that stands for a
# radian [m], 0 where any rotation will do.
LOWER, UPPER, ROTATION, WEIGHT = 0, 3, 6, 15
TARGET = 16


class Chain(NamedTuple):
    """The joints that move a frame, base first; their own axis is z.

    Args:
        joints: Whether it slides, and the column of q that drives it; shape (n, 2).
        values: Rotation (9) and origin (3) in the joint before at zero, gain, offset of the joint; the last row is that
            of the frame in the last joint; shape (n + 1, 14).
    """

    joints: np.ndarray
    values: np.ndarray


class Scratch(NamedTuple):
    """Memory that is written.

    Args:
        frames: World poses of the joints and of the frame: rotation row by row, origin; shape (n + 1, 12).
        error: What is left to the target: position [m], rotation weighted; shape (6,).
        jacobian: Its derivative by each column, shape (nq, 6).
    """

    frames: np.ndarray
    error: np.ndarray
    jacobian: np.ndarray


CHAIN = types.NamedTuple([INTS2, FLOATS2], Chain)
SCRATCH = types.NamedTuple([OUT2, OUT1, OUT2], Scratch)

# Cosine from which on an angle's axis is taken from the symmetric part of its matrix.
_NEARLY_HALF_A_TURN = -0.9


@jit(types.void(FLOATS1, CHAIN, OUT2), entry=True, allocates=False)
def place_chain(q, chain, frames):
    """World poses of all joints and of the frame.

    Args:
        q: Configuration, shape (nq,).
        chain: The chain.
        frames: Out; see `Scratch`.
    """
    joints, values = chain.joints, chain.values
    count = joints.shape[0]
    for i in range(count + 1):
        if i == 0:
            for k in range(12):
                frames[0, k] = values[0, k]
        else:
            for r in range(3):
                a, b, c = frames[i - 1, 3 * r], frames[i - 1, 3 * r + 1], frames[i - 1, 3 * r + 2]
                for k in range(3):
                    frames[i, 3 * r + k] = a * values[i, k] + b * values[i, 3 + k] + c * values[i, 6 + k]
                frames[i, 9 + r] = frames[i - 1, 9 + r] + a * values[i, 9] + b * values[i, 10] + c * values[i, 11]
        if i == count:
            break
        value = values[i, 12] * q[joints[i, 1]] + values[i, 13]
        if joints[i, 0] == 1:
            for r in range(3):
                frames[i, 9 + r] += value * frames[i, 3 * r + 2]
        else:
            s, c = np.sin(value), np.cos(value)
            for r in range(3):
                x, y = frames[i, 3 * r], frames[i, 3 * r + 1]
                frames[i, 3 * r] = x * c + y * s
                frames[i, 3 * r + 1] = y * c - x * s


@jit(types.UniTuple(F64, 3)(FLOATS1, FLOATS1), allocates=False)
def turn_between(pose, target):
    """The rotation vector that takes a target's rotation to a pose's, in world axes [rad]."""
    m00 = m01 = m02 = m10 = m11 = m12 = m20 = m21 = m22 = 0.0
    for k in range(3):
        a, b, c = pose[k], pose[3 + k], pose[6 + k]
        x, y, z = target[ROTATION + k], target[ROTATION + 3 + k], target[ROTATION + 6 + k]
        m00 += a * x
        m01 += a * y
        m02 += a * z
        m10 += b * x
        m11 += b * y
        m12 += b * z
        m20 += c * x
        m21 += c * y
        m22 += c * z
    x, y, z = 0.5 * (m21 - m12), 0.5 * (m02 - m20), 0.5 * (m10 - m01)
    sine, cosine = np.sqrt(x * x + y * y + z * z), 0.5 * (m00 + m11 + m22 - 1.0)
    if sine == 0.0 and cosine > 0.0:
        return 0.0, 0.0, 0.0
    angle = np.arctan2(sine, cosine)
    if cosine > _NEARLY_HALF_A_TURN:
        part = angle / sine
        return part * x, part * y, part * z
    # (M + M^T) / 2 - cos I = (1 - cos) axis axis^T: of its columns the longest is the axis.
    if m00 >= m11 and m00 >= m22:
        u, v, w = m00 - cosine, 0.5 * (m01 + m10), 0.5 * (m02 + m20)
    elif m11 >= m22:
        u, v, w = 0.5 * (m01 + m10), m11 - cosine, 0.5 * (m12 + m21)
    else:
        u, v, w = 0.5 * (m02 + m20), 0.5 * (m12 + m21), m22 - cosine
    part = angle / np.sqrt(u * u + v * v + w * w)
    if u * x + v * y + w * z < 0.0:
        part = -part
    return part * u, part * v, part * w


@jit(F64(FLOATS1, CHAIN, FLOATS1, SCRATCH), allocates=False)
def miss(q, chain, target, scratch):
    """How far the frame is from its target at q: `frames` and `error` are filled; the square of the error.

    Args:
        q: Configuration, shape (nq,).
        chain: The chain.
        target: See the constants of this file, shape (16,).
        scratch: Its memory.
    """
    frames, error = scratch.frames, scratch.error
    place_chain(q, chain, frames)
    pose = frames[chain.joints.shape[0]]
    square = 0.0
    for r in range(3):
        p = pose[9 + r]
        error[r] = p - min(max(p, target[LOWER + r]), target[UPPER + r])
        square += error[r] * error[r]
    weight = target[WEIGHT]
    if weight > 0.0:
        x, y, z = turn_between(pose, target)
        error[3], error[4], error[5] = weight * x, weight * y, weight * z
        square += weight * weight * (x * x + y * y + z * z)
    return square


@jit(I64(CHAIN, FLOATS1, SCRATCH), allocates=False)
def differentiate(chain, target, scratch):
    """The derivative of the error where `miss` was asked last, into `jacobian`; how many entries of both count."""
    frames, error, jacobian = scratch.frames, scratch.error, scratch.jacobian
    joints, values = chain.joints, chain.values
    count, weight = joints.shape[0], target[WEIGHT]
    rows = 6 if weight > 0.0 else 3
    for j in range(jacobian.shape[0]):
        for r in range(6):
            jacobian[j, r] = 0.0
    for i in range(count):
        column, gain = joints[i, 1], values[i, 12]
        x, y, z = gain * frames[i, 2], gain * frames[i, 5], gain * frames[i, 8]
        if joints[i, 0] == 1:
            jacobian[column, 0] += x
            jacobian[column, 1] += y
            jacobian[column, 2] += z
            continue
        u, v, w = frames[count, 9] - frames[i, 9], frames[count, 10] - frames[i, 10], frames[count, 11] - frames[i, 11]
        jacobian[column, 0] += y * w - z * v
        jacobian[column, 1] += z * u - x * w
        jacobian[column, 2] += x * v - y * u
        if rows == 6:
            jacobian[column, 3] += weight * x
            jacobian[column, 4] += weight * y
            jacobian[column, 5] += weight * z
    for r in range(3):
        # Where a coordinate is inside the box it may change.
        if target[LOWER + r] < target[UPPER + r] and error[r] == 0.0:
            for j in range(jacobian.shape[0]):
                jacobian[j, r] = 0.0
    return rows
