"""The contract of planners from outside this package: their results are checked."""

from __future__ import annotations

import time
from dataclasses import replace
from itertools import pairwise

import numpy as np

from rr1plan.checks import Array, Seed, check_text, number_from_zero, of_kind, shown, whole_number
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.errors import InputError, PlannerError, Rr1PlanError
from rr1plan.model.inverse_kinematics import describe_excess
from rr1plan.model.joint_turns import difference
from rr1plan.path import Path
from rr1plan.planning import Budget, Planner, PlanResult, PlanStatus, ProgressCallback, SearchTree
from rr1plan.robot import Robot
from rr1plan.scene.problem import Goal, JointGoal, PoseGoal, Problem, frame_link
from rr1plan.transforms import rotation_angle, rotation_from_quaternion

# NumPy's generators draw seeds of 128 bits.
_LARGEST_SEED = 2**128
# Tolerance for equal joint values [rad or m]; goal tolerances are extended by it.
_EQUAL = 1e-9


def checked_result(
    planner: Planner, problem: Problem, budget: Budget, rng: Seed, progress: ProgressCallback | None
) -> PlanResult:
    """The checked result of a planner from outside this package; a missing name or time is added.

    Raises:
        PlannerError: the planner raised an exception, or its result does not solve the problem.
    """
    name = f"planner {shown(planner.name)}"
    began = time.perf_counter()
    try:
        result = planner.plan(problem, budget=budget, rng=rng, progress=progress)
    except Rr1PlanError:
        raise
    except Exception as error:
        raise PlannerError(f"{name} raised {type(error).__name__}: {error}") from error
    fault = _fault(problem, result)
    if fault:
        raise PlannerError(f"{name} {fault}")
    return replace(
        result, planner=result.planner or planner.name, seconds=result.seconds or time.perf_counter() - began
    )


def _fault(problem: Problem, result: object) -> str:
    """The fault of a result, as the end of a sentence; empty if there is none."""
    if not isinstance(result, PlanResult):
        return f"returned {shown(result)}, expected a PlanResult"
    status: object = result.status
    if not isinstance(status, PlanStatus):
        return f"returned a result with status {shown(status)}, expected a PlanStatus"
    try:
        check_text("reason", result.reason)
        whole_number("seed", result.seed, 0, _LARGEST_SEED)
        number_from_zero("seconds", result.seconds)
        of_kind("tree", result.tree, SearchTree, optional=True)
    except InputError as error:
        return f"returned a result whose {error}"
    if result.status is not PlanStatus.FOUND:
        return "" if result.path is None else f"returned a path with status {result.status.value!r}, expected 'found'"
    if not isinstance(result.path, Path):
        return f"returned status 'found' with path {shown(result.path)}, expected a Path"
    return _path_fault(problem, result.path)


def _path_fault(problem: Problem, path: Path) -> str:
    if path.joint_names != problem.joint_names:
        return f"returned a path of joints {', '.join(path.joint_names)}, expected {', '.join(problem.joint_names)}"
    points = path.waypoints
    if not np.isfinite(points).all():
        return "returned a path with a waypoint that is not finite"
    off = float(np.abs(points[0] - problem.start).max(initial=0.0))
    if off > _EQUAL:
        return f"returned a path that begins {off:.3g} rad (or m) from the problem's start"
    return _goal_fault(problem, points[-1]) or _limits_fault(problem, points) or _edge_fault(problem, points)


def _goal_fault(problem: Problem, q: Array) -> str:
    for arm, columns in problem.columns.items():
        robot, base = problem.scene.arms[arm].robot, problem.scene.arms[arm].base
        misses = [_miss(goal, robot, base, q[columns]) for goal in problem.goal[arm]]
        if misses and all(misses):
            return f"returned a path that does not end at a goal of arm {arm!r}: {misses[0]}"
    return ""


def _limits_fault(problem: Problem, points: Array) -> str:
    for arm, columns in problem.columns.items():
        for q in points[:, columns]:
            excess = describe_excess(problem.scene.arms[arm].robot, q)
            if excess:
                return f"returned a path that leaves the limits of arm {arm!r}: {excess}"
    return ""


def _edge_fault(problem: Problem, points: Array) -> str:
    with checker_from_pool(problem.scene, problem.arms, problem.margin) as checker:
        # A path of one waypoint has one edge of zero length.
        for k, (a, b) in enumerate(pairwise([*points[:1], *points])):
            if not checker.edge_is_free(a, b):
                contact = checker.first_contact(a, b)
                why = "" if contact is None else f": {' and '.join(contact.pair)} touch"
                return f"returned a path whose edge to waypoint {k} is not certified free{why}"
    return ""


def _miss(goal: Goal, robot: Robot, base: Array, q: Array) -> str:
    """How far an arm at q (nq,) is from a goal, as a message; empty if it is reached."""
    if isinstance(goal, JointGoal):
        most = float(np.abs(difference(q, goal.q, robot.continuous > 0.0)).max(initial=0.0))
        return "" if most <= _EQUAL else f"the last waypoint is {most:.3g} rad (or m) from it"
    T = base @ robot.link_poses(q)[frame_link(robot, goal.frame)]
    if isinstance(goal, PoseGoal):
        distance, allowed = float(np.linalg.norm(T[:3, 3] - goal.position)), goal.position_tolerance
    else:
        outside = np.maximum(goal.lower - T[:3, 3], T[:3, 3] - goal.upper).clip(0.0)
        distance, allowed = float(np.linalg.norm(outside)), 0.0
    if distance > allowed + _EQUAL:
        return f"its frame ends {distance:.3g} m from it"
    if goal.quaternion is not None:
        angle = rotation_angle(rotation_from_quaternion(goal.quaternion).T @ T[:3, :3])
        if angle > goal.orientation_tolerance + _EQUAL:
            return f"its frame ends turned by {angle:.3g} rad"
    return ""
