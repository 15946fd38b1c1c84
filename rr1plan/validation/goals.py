"""Whether a motion starts where the problem says and ends at one of its goals."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from rr1plan.checks import Array
from rr1plan.problem import Goal, JointGoal, PoseGoal, Problem, frame_link
from rr1plan.report import Violation
from rr1plan.robot import Robot
from rr1plan.transforms import rotation_angle, rotation_from_quaternion
from rr1plan.validation.limits import Ledger

# Joint values count as equal within this [rad or m], tolerances are kept to within it.
_EQUAL = 1e-9


def check_start(ledger: Ledger, problem: Problem, postures: Mapping[str, Array], time: float) -> None:
    """The first configuration is the start of the problem.

    Args:
        ledger: Where violations go.
        problem: The problem.
        postures: First configuration of every arm, by arm.
        time: When that is [s].
    """
    ledger.checked.append("start")
    q = np.concatenate([postures[arm] for arm in problem.arms])
    for name, got, want in zip(problem.joint_names, q, problem.start, strict=True):
        if abs(got - want) > _EQUAL:
            message = f"{name} starts at {got:.9g}, the problem starts at {want:.9g} (off by {abs(got - want):.3g})"
            ledger.violations.append(Violation("start", (name,), time, float(got), float(want), message))


def check_goal(
    ledger: Ledger, problem: Problem, postures: Mapping[str, Array], poses: Callable[[str], Array], time: float
) -> None:
    """Every moving arm ends at one of its goals.

    Args:
        ledger: Where violations go.
        problem: The problem.
        postures: Last configuration of every arm, by arm.
        poses: Gives T_world_link at the end, by "arm/link".
        time: When that is [s].
    """
    ledger.checked.append("goal")
    for arm in problem.arms:
        robot = problem.scene.arms[arm].robot
        misses = [_miss(goal, arm, robot, postures[arm], poses) for goal in problem.goal[arm]]
        off, allowed, words = min(misses, key=lambda miss: miss[0] / miss[1])
        if off > allowed + _EQUAL:
            several = f" (the nearest of {len(misses)} goals)" if len(misses) > 1 else ""
            message = f"{arm} misses its goal{several}: {words}"
            ledger.violations.append(Violation("goal", (arm,), time, off, allowed, message))


Miss = tuple[float, float, str]


def _miss(goal: Goal, arm: str, robot: Robot, q: Array, poses: Callable[[str], Array]) -> Miss:
    """By how much a goal is missed, what is allowed, and that in words: the worst of its conditions."""
    if isinstance(goal, JointGoal):
        return _joint_miss(goal, robot, q)
    T = poses(f"{arm}/{frame_link(robot, goal.frame)}")
    at, rotation = T[:3, 3], goal.rotation if isinstance(goal, PoseGoal) else None
    if isinstance(goal, PoseGoal):
        off, allowed = float(np.linalg.norm(at - goal.position)), goal.position_tolerance
        misses = [(off, allowed, f"{goal.frame} is {off:.6g} m from the goal, tolerance {allowed:.3g} m")]
    else:
        off = float(np.linalg.norm(np.maximum(0.0, np.maximum(goal.lower - at, at - goal.upper))))
        misses = [(off, _EQUAL, f"{goal.frame} is {off:.6g} m outside the region")]
        rotation = None if goal.quaternion is None else rotation_from_quaternion(goal.quaternion)
    if rotation is not None:
        angle, allowed = rotation_angle(rotation.T @ T[:3, :3]), goal.orientation_tolerance
        misses.append((angle, allowed, f"{goal.frame} is turned by {angle:.6g} rad, tolerance {allowed:.3g} rad"))
    return max(misses, key=lambda miss: miss[0] / miss[1])


def _joint_miss(goal: JointGoal, robot: Robot, q: Array) -> Miss:
    """The joint farthest from its goal; continuous joints count modulo a turn."""
    off = q - goal.q
    off = np.abs(np.where(robot.continuous > 0.0, np.remainder(off + np.pi, 2.0 * np.pi) - np.pi, off))
    j = int(np.argmax(off))
    worst = float(off[j])
    return worst, _EQUAL, f"joint {robot.joint_names[j]} is at {q[j]:.9g}, {worst:.3g} from {float(goal.q[j]):.9g}"
