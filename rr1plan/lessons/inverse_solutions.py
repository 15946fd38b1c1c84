"""All configurations of an arm with its tool in one pose, and its self-motion if the yaw is free."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from rr1plan.checks import Array, known_name, of_kind, positive_number, read_only
from rr1plan.collision import CollisionChecker
from rr1plan.model import Kinematics, solve_ik
from rr1plan.scene import Scene
from rr1plan.scene.problem import PoseGoal

_STARTS = 1500
_CORRECTIONS, _EXACT = 8, 1e-9
_MOST_STEPS = 2000
_LIMIT = 1e-9


@dataclass(frozen=True, eq=False)
class InverseSolution:
    """A configuration with the tool in the pose.

    Args:
        q: The configuration [rad], shape (nq,).
        within_limits: Whether all joints are within their limits.
        touching: Pairs of elements in contact.
    """

    q: Array
    within_limits: bool
    touching: tuple[tuple[str, str], ...]

    @property
    def is_valid(self) -> bool:
        """Whether the arm can have this configuration."""
        return self.within_limits and not self.touching


def inverse_solutions(scene: Scene, arm: str, q: ArrayLike, *, rng: int = 0) -> tuple[InverseSolution, ...]:
    """All configurations found with the tool pose of q, ignoring joint limits and contacts; q is the first.

    A general arm of six revolute joints has at most 16, and at most 8 if three of its axes meet in a point or are
    parallel (Pieper 1968; Raghavan and Roth 1990). The search is numerical, from 1500 initial guesses.

    Args:
        scene: The scene.
        arm: The arm.
        q: Its configuration [rad], shape (nq,).
        rng: Seed of the initial guesses.

    Raises:
        UnknownNameError: no such arm.
        InputError: wrong shape or not finite.
    """
    of_kind("scene", scene, Scene)
    placed = scene.arms[known_name("arm", arm, scene.arms)]
    limits = placed.robot.limits
    turning = np.array([placed.robot.joint(name).kind != "prismatic" for name in placed.robot.joint_names])
    wide = replace(limits, lower=np.where(turning, -np.pi, limits.lower), upper=np.where(turning, np.pi, limits.upper))
    free = Scene().with_arm(arm, placed.robot.with_limits(wide), placed.base)
    goal = PoseGoal("tool", Kinematics(free).pose(q))
    found = solve_ik(Kinematics(free), goal, seeds=q, attempts=_STARTS, rng=rng).solutions
    checker = CollisionChecker(scene, (arm,))
    return tuple(
        InverseSolution(
            read_only(np.array(row)),
            bool(((row >= limits.lower - _LIMIT) & (row <= limits.upper + _LIMIT)).all()),
            tuple((contact.a, contact.b) for contact in checker.contacts(row)),
        )
        for row in found
    )


def self_motion(scene: Scene, arm: str, q: ArrayLike, *, axis: str = "z", step: float = 0.02) -> Array:
    """The curve of configurations that keep the tool's position and the direction of one of its axes.

    Six joints and five conditions leave one dimension. The curve is traced from q in both directions, along the null
    space of the Jacobian's five rows, until a joint is at its limit, the arm is singular, or the curve closes.

    Args:
        scene: The scene.
        arm: An arm of six joints.
        q: First configuration [rad], shape (6,).
        axis: The axis of the tool about which it may rotate: "z" leaves the yaw free; "x" and "y" allow rotation about
            a rod between the fingers.
        step: Distance between two configurations [rad].

    Returns:
        Configurations in order, shape (n, 6); all within the joint limits.

    Raises:
        UnknownNameError: no such arm or axis.
        InputError: wrong shape, not finite, or a step that is not above zero.
    """
    of_kind("scene", scene, Scene)
    placed = scene.arms[known_name("arm", arm, scene.arms)]
    kinematics = Kinematics(Scene().with_arm(arm, placed.robot, placed.base))
    start, step = np.array(q, dtype=float), positive_number("step", step)
    free = "xyz".index(known_name("axis", axis, ("x", "y", "z")))
    target = kinematics.pose(start)
    limits = placed.robot.limits
    ahead, closed = _follow(kinematics, limits.lower, limits.upper, start, target, free, step)
    if closed:
        return read_only(np.array([start, *ahead]))
    behind, _ = _follow(kinematics, limits.lower, limits.upper, start, target, free, -step)
    return read_only(np.array([*behind[::-1], start, *ahead]))


def _follow(
    kinematics: Kinematics, lower: Array, upper: Array, start: Array, target: Array, free: int, step: float
) -> tuple[list[Array], bool]:
    """Configurations along the curve, and whether it has returned to its beginning."""
    rows: list[Array] = []
    at, before = start, None
    for k in range(_MOST_STEPS):
        _, J = _conditions(kinematics, at, target, free)
        tangent = np.linalg.svd(J)[2][-1]
        if before is None:
            # The first direction is the one in which the angle about the axis grows.
            yaw = (kinematics.jacobian(at)[3:].T @ target[:3, free]) @ tangent
            tangent = tangent * (np.sign(yaw) or 1.0) * np.sign(step)
        elif tangent @ before < 0.0:
            tangent = -tangent
        after = _corrected(kinematics, at + abs(step) * tangent, target, free)
        if after is None or (after < lower).any() or (after > upper).any():
            return rows, False
        rows.append(after)
        at, before = after, tangent
        if k > 2 and np.linalg.norm(at - start) < 0.75 * abs(step):
            return rows, True
    return rows, False


def _corrected(kinematics: Kinematics, q: Array, target: Array, free: int) -> Array | None:
    """The configuration near q that satisfies the conditions, by Newton's method; None if it does not converge."""
    for _ in range(_CORRECTIONS):
        error, J = _conditions(kinematics, q, target, free)
        if np.abs(error).max() < _EXACT:
            return q
        q = q - np.linalg.pinv(J, rcond=1e-4) @ error
    return None


def _conditions(kinematics: Kinematics, q: Array, target: Array, free: int) -> tuple[Array, Array]:
    """Errors of position [m] and of the tool's axis `free` [rad], shape (5,), and their Jacobian, shape (5, nq)."""
    T, J = kinematics.pose(q), kinematics.jacobian(q)
    sideways = np.delete(target[:3, :3], free, axis=1)
    tilt = np.cross(target[:3, free], T[:3, free])
    error = np.concatenate([T[:3, 3] - target[:3, 3], sideways.T @ tilt])
    return error, np.vstack([J[:3], sideways.T @ J[3:]])
