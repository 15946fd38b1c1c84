"""Whether a motion starts where the problem says and ends at one of its goals."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from rr1plan.checks import Array
from rr1plan.errors import InputError
from rr1plan.report import Violation
from rr1plan.robot import Robot
from rr1plan.robot.robot import poses_at
from rr1plan.scene import Scene
from rr1plan.scene.problem import Goal, JointGoal, PoseGoal, Problem, frame_link
from rr1plan.transforms import rotation_angle, rotation_from_quaternion
from rr1plan.validation.limit_checks import Findings
from rr1plan.validation.link_motion import TimedColumns
from rr1plan.validation.moving_scene import MovingScene

# Tolerance for equal joint values [rad or m]; goal tolerances are extended by it.
_EQUAL = 1e-9


def check_endpoints(
    findings: Findings, motion: TimedColumns, last: Array, moving: MovingScene, problem: Problem | None
) -> None:
    """Check that a motion starts and ends where the problem says, if there is one.

    Args:
        findings: Violations are added to it.
        motion: The motion.
        last: Its columns at the last instant, shape (nq,).
        moving: Columns of each arm, and poses of the stationary arms.
        problem: The problem.
    """
    if problem is None:
        findings.not_checked["start"] = findings.not_checked["goal"] = "no problem was given"
        return
    scene, columns, first = moving.tables.scene, moving.columns_of_arm, motion.coefficients[0, 0]
    _check_arms(problem, scene)
    begin, finish = float(motion.breaks[0]), float(motion.breaks[-1])
    findings.checked += ["start", "goal"]
    offset = 0
    for arm in problem.arms:
        at = columns.get(arm)
        q = scene.arms[arm].q
        offset += len(q)
        wanted = problem.start[offset - len(q) : offset]
        _check_start(findings, scene, arm, q if at is None else first[at], wanted, begin)
    for arm, at in columns.items():
        if arm not in problem.arms:
            _check_start(findings, scene, arm, first[at], scene.arms[arm].q, begin)
    for arm in problem.arms:
        q = scene.arms[arm].q if arm not in columns else last[columns[arm]]
        _check_goal(findings, problem, scene, arm, q.tolist(), finish)


def _check_arms(problem: Problem, scene: Scene) -> None:
    """Check that the scene has the problem's arms, with their joints in the order of the problem's values."""
    for arm in problem.arms:
        wanted, got = scene.arm(arm).robot.joint_names, problem.scene.arms[arm].robot.joint_names
        if wanted != got:
            names = f"joints {', '.join(got)} for arm {arm!r}, expected those of the scene: {', '.join(wanted)}"
            raise InputError(f"the problem has {names}")


def _pose_of(scene: Scene, arm: str, q: list[float]) -> Callable[[str], Array]:
    """T_world_link as a function of the link's name, for an arm in a configuration (nq,)."""

    def pose(link: str) -> Array:
        placed = scene.arms[arm]
        T: Array = placed.base @ poses_at(placed.robot, placed.robot.joint_values(np.array(q)))[link]
        return T

    return pose


def _check_start(findings: Findings, scene: Scene, arm: str, first: Array, wanted: Array, time: float) -> None:
    """Check that an arm starts at the problem's start."""
    off = np.abs(first - wanted)
    if (off <= _EQUAL).all():
        return
    for joint, got, want in zip(scene.arms[arm].robot.joint_names, first.tolist(), wanted.tolist(), strict=True):
        if not abs(got - want) <= _EQUAL:
            name = f"{arm}/{joint}"
            message = f"{name} starts at {got:.9g}, expected {want:.9g} (off by {abs(got - want):.3g})"
            findings.violations.append(Violation("start", (name,), time, got, want, message))


def _check_goal(findings: Findings, problem: Problem, scene: Scene, arm: str, q: list[float], time: float) -> None:
    """Check that the last configuration q (nq,) of an arm is at one of its goals."""
    robot = problem.scene.arms[arm].robot
    misses = [_miss(goal, robot, q, _pose_of(scene, arm, q)) for goal in problem.goal[arm]]
    off, allowed, words = min(misses, key=_share)
    if not off <= allowed + _EQUAL:
        several = f" (the nearest of {len(misses)} goals)" if len(misses) > 1 else ""
        message = f"{arm} misses its goal{several}: {words}"
        findings.violations.append(Violation("goal", (arm,), time, off, allowed, message))


Miss = tuple[float, float, str]


def _miss(goal: Goal, robot: Robot, q: list[float], pose: Callable[[str], Array]) -> Miss:
    """The worst condition of a goal: deviation, tolerance and description."""
    if isinstance(goal, JointGoal):
        return _joint_miss(goal, robot, q)
    T = pose(frame_link(robot, goal.frame))
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
    return max(misses, key=_share)


def _share(miss: Miss) -> float:
    """The deviation over what is allowed, at most 1 if the condition holds."""
    off, allowed, _ = miss
    return off / (allowed + _EQUAL)


def _joint_miss(goal: JointGoal, robot: Robot, q: list[float]) -> Miss:
    """The joint farthest from its goal; continuous joints count modulo a turn."""
    off = [at - want for at, want in zip(q, goal.q.tolist(), strict=True)]
    turns = robot.continuous.tolist()
    off = [abs((by + math.pi) % math.tau - math.pi if turn else by) for by, turn in zip(off, turns, strict=True)]
    worst = max(off)
    j = off.index(worst)
    return worst, _EQUAL, f"joint {robot.joint_names[j]} is at {q[j]:.9g}, {worst:.3g} from {float(goal.q[j]):.9g}"
