"""Joint values that are equivalent modulo whole turns.

A rotary joint has the same pose at x and x + 2 pi. A continuous joint has all
these copies, a joint with wide limits (a UR5's, one turn in each direction) has several.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, finite_array, finite_number, of_kind, read_only
from rr1plan.errors import InputError
from rr1plan.robot import Robot
from rr1plan.robot.robot import independent_joint

TURN = 2.0 * np.pi
_SLACK = 1e-12
_MOST_TURNS = 100


@lru_cache(maxsize=64)
def rotary(robot: Robot) -> NDArray[np.bool_]:
    """Planning joints that are periodic with 2 pi, shape (nq,).

    These are revolute and continuous joints whose mimic joints, if any, turn by integer multiples.
    """
    turns = {name: robot.joint(name).kind != "prismatic" for name in robot.joint_names}
    for follower in robot.joints:
        leader, multiplier, _ = independent_joint(robot, follower)
        whole = follower.kind != "prismatic" and multiplier == round(multiplier)
        if leader is not follower and leader.name in turns and not whole:
            turns[leader.name] = False
    return read_only(np.array(list(turns.values()), dtype=np.bool_))


def nearest_copy(robot: Robot, q: Array, near: Array) -> Array:
    """The copy of q modulo whole turns that is nearest to `near` and within the limits, shape (nq,).

    Prismatic joints, and joints without a copy within the limits, keep their value.
    """
    lower, upper = robot.limits.lower, robot.limits.upper
    fewest = np.ceil((lower - _SLACK - q) / TURN)
    most = np.floor((upper + _SLACK - q) / TURN)
    has_copy = rotary(robot) & (fewest <= most)
    turns = np.where(has_copy, np.clip(np.round((near - q) / TURN), fewest, most), 0.0)
    return np.where(turns == 0.0, q, np.clip(q + turns * TURN, lower, upper))


def copies_within_limits(robot: Robot, q: Array, near: Array, *, reach: float = TURN) -> Array:
    """All configurations within the limits that differ by whole turns, nearest to `near` first, shape (k, nq).

    Args:
        robot: The robot.
        q: A configuration [rad or m], shape (nq,).
        near: Reference configuration [rad or m], shape (nq,).
        reach: Largest distance of a rotary joint's copy from `near` [rad], at most 100 turns; the nearest one
            is always included.

    Raises:
        InputError: not a robot, wrong shapes, not finite, or a reach that is negative or too large.
    """
    of_kind("robot", robot, Robot)
    q, near = finite_array("q", q, (robot.nq,)), finite_array("near", near, (robot.nq,))
    if not 0.0 <= finite_number("reach", reach) <= _MOST_TURNS * TURN:
        raise InputError(f"reach is {reach}, expected 0 to {_MOST_TURNS} turns of 2 pi")
    first = nearest_copy(robot, q, near)
    lower, upper = robot.limits.lower - _SLACK, robot.limits.upper + _SLACK
    choices = []
    for j, turns in enumerate(rotary(robot)):
        values = [first[j]]
        for step in (-TURN, TURN) if turns else ():
            value = first[j] + step
            while lower[j] <= value <= upper[j] and abs(value - near[j]) <= reach:
                values.append(float(np.clip(value, robot.limits.lower[j], robot.limits.upper[j])))
                value += step
        choices.append(values)
    copies = np.array(list(product(*choices))).reshape(-1, robot.nq)
    return np.asarray(copies[np.argsort(np.linalg.norm(copies - near, axis=1), kind="stable")])


def difference(a: Array, b: Array, turning: NDArray[np.bool_]) -> Array:
    """The smallest a - b modulo whole turns of the turning joints, shape (..., nq)."""
    d = a - b
    return np.where(turning, d - TURN * np.round(d / TURN), d)
