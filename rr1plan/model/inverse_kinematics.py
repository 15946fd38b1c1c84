"""Multi-start numerical inverse kinematics: all distinct solutions of a goal.

A descent within the joint limits runs from each start (the seeds first, then random ones); solutions that
are equal modulo whole turns count once. The method needs no closed form and covers mimic joints,
redundant arms and position-only goals. It is not complete: more `attempts` miss fewer solutions.

The search is compiled (`inverse_kinematics.c`): a start takes about ten microseconds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rr1plan.checks import (
    DEGREES,
    MILLIMETERS,
    Array,
    Seed,
    Value,
    as_seed,
    check_callback,
    counted,
    finite_array,
    of_kind,
    read_only,
    shape_of,
    whole_number,
)
from rr1plan.errors import InputError
from rr1plan.kernels.random_state import random_state
from rr1plan.model.forward_kinematics import Kinematics
from rr1plan.model.ik_descent import Target, descend, errors_at, position_at
from rr1plan.model.ik_search import IkSearch, sampling_box
from rr1plan.model.kinematic_chain import chain_of
from rr1plan.robot import Robot
from rr1plan.scene.problem import PoseGoal, RegionGoal

_POSITION_STARTS = 10
_MOST_STARTS = 10_000_000
_LIKELY_MILLIMETERS = 10.0  # a goal farther out of reach than this is probably not in meters [m]
ROUNDING = 1e-10
"""Distance beyond a limit that counts as rounding [rad or m], such as that of the last sample of a motion."""


@dataclass(frozen=True, eq=False, repr=False)
class IkResult(Value):
    """Result of inverse kinematics.

    Args:
        solutions: Distinct configurations within the limits, nearest to the first seed first, shape (k, nq).
            Of copies modulo whole turns, the nearest to the first seed; `copies_within_limits` gives the others.
        reason: Why there is no solution; empty if there is one.
        attempts: Number of starts.
        rejected: Number of distinct solutions that `accept` rejected.
        nearest: The configuration within the limits with the smallest pose error, shape (nq,).
        position_error: Position error there [m].
        orientation_error: Orientation error there [rad].
    """

    solutions: Array
    reason: str
    attempts: int
    rejected: int
    nearest: Array
    position_error: float
    orientation_error: float

    @property
    def found(self) -> bool:
        """Whether there is a solution."""
        return len(self.solutions) > 0

    def __bool__(self) -> bool:
        """The same as `found`."""
        return self.found


def solve_ik(
    kinematics: Kinematics,
    goal: PoseGoal | RegionGoal,
    *,
    seeds: ArrayLike | None = None,
    accept: Callable[[Array], bool] | None = None,
    attempts: int = 200,
    max_solutions: int | None = None,
    patience: int | None = None,
    rng: Seed = None,
) -> IkResult:
    """Every distinct configuration found that brings a frame of an arm to its goal.

    Solutions are distinct if they differ by at least 0.001 rad (or m) in some joint, or by 0.2 if the arm has more
    joints than the goal needs and solutions form a continuum. They use at most nine tenths of the goal's tolerance.
    If there is none, but a descent came near or reaches the goal outside the limits, a second attempt uses all of it.
    Joints that do not move the frame keep their values of the seeds; if `accept` rejects all solutions found so, a
    further attempt varies them too.

    Args:
        kinematics: Kinematics of one moving arm: of its scene, of the robot alone, or `kinematics.for_arm(name)` of
            several.
        goal: A position, a full pose, or a box for the frame's origin. Random starts aim at a random point of the box,
            seeds at the nearest one.
        seeds: First starts [rad or m], shape (nq,) or (k, nq), clipped to the limits
            (default: the arm's configuration in the scene).
        accept: Called with each distinct solution (nq,); False rejects it, e.g. one that is in collision.
        attempts: Number of starts, seeds included; each further attempt has as many again.
        max_solutions: Stop after this number of accepted solutions (default: return all that are found).
        patience: Once there is an accepted solution, stop after this number of consecutive starts without a new one
            (default: never).
        rng: Generator or seed of the random starts; the same seed gives the same solutions.

    Raises:
        UnknownNameError: no such frame.
        InputError: several arms, a goal of another kind, or values out of range.
    """
    of_kind("kinematics", kinematics, Kinematics)
    own = kinematics.for_arm()
    if not isinstance(goal, PoseGoal | RegionGoal):
        raise InputError(f"goal is a {type(goal).__name__}, expected a PoseGoal or a RegionGoal")
    link = own.frame(goal.frame)
    for name, number in (("attempts", attempts), ("max_solutions", max_solutions), ("patience", patience)):
        if number is not None or name == "attempts":
            whole_number(name, number, 1, _MOST_STARTS)
    check_callback("accept", accept)
    robot = own.scene.arms[own.arms[0]].robot
    starts = _seeds(own, robot, seeds)
    chain = chain_of(own.scene_model.arm_model, link)
    search = IkSearch(chain, robot, goal, starts, random_state(as_seed(rng)))
    solutions = np.array(search.collect(attempts, accept, max_solutions, patience)).reshape(-1, robot.nq)
    order = np.argsort(np.linalg.norm(solutions - starts[0], axis=1), kind="stable")
    reason = "" if len(solutions) else why_none(search, link)
    nearest = search.nearest()
    return IkResult(
        read_only(solutions[order]),
        reason,
        search.tried,
        len(search.rejected),
        read_only(nearest),
        *errors_at(chain, search.target, nearest),
    )


def why_none(search: IkSearch, link: str, aim: str = "the goal") -> str:
    """Why a search has no accepted solution.

    Args:
        search: The search.
        link: Name of its frame for the message.
        aim: What the frame has to reach, for the message.
    """
    tried = f"({counted(search.tried, 'start')})"
    if search.rejected:
        found = counted(len(search.rejected), "configuration")
        return f"{link} reaches {aim} in {found}, none of them accepted {tried}"
    beyond = search.beyond_limits()
    outside = describe_excess(search.robot, beyond[0]) if len(beyond) else ""
    if outside:
        return f"{link} reaches {aim} only outside the joint limits: {outside} {tried}"
    rng, nearest = np.random.default_rng(search.tried), search.nearest()
    position, orientation = errors_at(search.chain, search.target, nearest)
    at = ", ".join(f"{value:.4g}" for value in position_at(search.chain, nearest))
    # A position that is reached differs by rounding only.
    distance = position if position > search.position_tolerance else 0.0
    miss = f"{aim} is out of reach of {link}: the nearest it gets is {distance:.4g} m away, at [{at}]"
    if position > _LIKELY_MILLIMETERS:
        return f"{miss} {MILLIMETERS}"
    if search.target.rotation is None:
        return f"{miss} {tried}"
    alone = "can" if _position_alone(search, nearest, rng) else "cannot"
    return f"{miss}, turned by {orientation:.4g} rad; the position alone {alone} be reached {tried}"


def _position_alone(search: IkSearch, nearest: Array, rng: np.random.Generator) -> bool:
    limits = search.robot.limits
    aim = Target(search.target.lower, search.target.upper, None)
    lower, upper = sampling_box(search.robot)
    for i in range(_POSITION_STARTS):
        start = nearest if i == 0 else rng.uniform(lower, upper)
        _, square = descend(search.chain, aim, start, limits.lower, limits.upper)
        if square <= search.position_tolerance**2:
            return True
    return False


def describe_excess(robot: Robot, q: Array) -> str:
    """Message about the joints of q that are out of limits by more than `ROUNDING`; empty if none is."""
    limits = robot.limits
    if (q >= limits.lower - ROUNDING).all() and (q <= limits.upper + ROUNDING).all():
        return ""
    parts, degrees = [], False
    for j, name in enumerate(robot.joint_names):
        over = max(limits.lower[j] - q[j], q[j] - limits.upper[j])
        if over > ROUNDING:
            unit = robot.joint(name).unit
            bounds = f"[{limits.lower[j]:.6g}, {limits.upper[j]:.6g}]"
            parts.append(f"joint {name!r} at {q[j]:.6g} {unit}, outside {bounds} by {over:.3g} {unit}")
            degrees |= unit == "rad" and over > np.pi
    return "; ".join(parts) + (f" {DEGREES}" if degrees else "")


def _seeds(kinematics: Kinematics, robot: Robot, seeds: ArrayLike | None) -> Array:
    """Starts (k, nq) within the limits, k >= 1."""
    shape = shape_of(seeds)
    if seeds is None or (len(shape) > 0 and shape[0] == 0):
        seeds = kinematics.scene.arms[kinematics.arms[0]].q
    rows = np.atleast_2d(finite_array("seeds", seeds, (None, robot.nq) if len(shape) == 2 else (robot.nq,)))
    return np.clip(rows, robot.limits.lower, robot.limits.upper)
