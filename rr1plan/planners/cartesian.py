"""Cartesian paths: the frame moves on a straight line and rotates at a constant rate about one axis.

Inverse kinematics is continued along the line: each step starts from the last configuration, is corrected
by a descent within the joint limits and halved until a rigorous bound proves that the joint-space edge
stays within the tolerance of the line (which excludes jumps to another branch) and the edge is certified
free. If the path ends before the goal, the result states the fraction of the line covered and the cause.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rr1plan.checks import Array, Seed, positive_number
from rr1plan.errors import InputError
from rr1plan.kernels.random_state import random_state
from rr1plan.model import Kinematics
from rr1plan.model.ik_descent import descend, errors_at
from rr1plan.model.ik_search import IkSearch
from rr1plan.model.inverse_kinematics import describe_excess, why_none
from rr1plan.model.kinematic_chain import chain_of
from rr1plan.model.workspace_lines import EdgeBound, Line
from rr1plan.planners.collision_messages import describe_collision
from rr1plan.planners.goal_configurations import GoalSearch, check_start
from rr1plan.planners.planning_query import Query
from rr1plan.planning import CANCELLED, Budget, Planner, PlanResult, PlanStatus, ProgressCallback
from rr1plan.scene.problem import JointGoal, PoseGoal, Problem
from rr1plan.transforms import quaternion_from_rotation

_FIRST_STEP, _LARGEST_STEP, _SMALLEST_STEP = 0.1, 0.25, 1e-4  # parts of the line
_LARGEST_EDGE = 0.5  # sum of joint changes [rad or m]
_WAYPOINT_SHARE = 0.01  # share of the tolerance for the error of a waypoint
_REACHED = 1e-12  # squared error below which a descent has converged
_EXACT = 1e-6  # tolerance of the check whether another configuration reaches a pose [m], [rad]
_STARTS = 200  # starts of inverse kinematics in the same check
_SINGULAR = 0.02  # singular values below this count as singular
_NO_LENGTH = 1e-9  # a shorter line counts as no motion [m + rad]


@dataclass(frozen=True, eq=False)
class _Stop:
    """Status and reason of a line that ended before the goal."""

    status: PlanStatus
    reason: str


class CartesianPlanner(Planner):
    """Moves one arm's frame along a straight line to a `PoseGoal`.

    With a full pose the orientation is interpolated (slerp); with a position only, the
    orientation is free. Alternative goals are tried in order.

    Args:
        tolerance: Largest distance from the line, between waypoints too [m].
        orientation_tolerance: Largest angle from the interpolated orientation [rad].

    Raises:
        InputError: a tolerance that is not positive.
    """

    name = "cartesian"
    keeps_shape = True

    def __init__(self, *, tolerance: float = 1e-3, orientation_tolerance: float = 1e-2) -> None:
        self.tolerance = positive_number("tolerance", tolerance)
        self.orientation_tolerance = positive_number("orientation_tolerance", orientation_tolerance)

    def plan(
        self,
        problem: Problem,
        *,
        budget: Budget | None = None,
        rng: Seed = None,
        progress: ProgressCallback | None = None,
    ) -> PlanResult:
        """Plan a straight line.

        Args:
            problem: One moving arm, whose goal is one or several alternative `PoseGoal`.
            budget: When to stop (default: 10 s); an iteration is one attempted step.
            rng: Seed of the diagnosis of a failure; the path is deterministic.
            progress: Called about ten times a second; it may return False to cancel.

        Raises:
            InputError: several arms move, or a goal is not a `PoseGoal`.
        """
        with Query(self.name, problem, budget, rng, progress) as query:
            goals = _pose_goals(problem)
            blocked = check_start(problem, query.motion)
            if blocked:
                return query.result(PlanStatus.INVALID_START, reason=blocked)
            return self._to_any(goals, query)

    def _to_any(self, goals: tuple[PoseGoal, ...], query: Query) -> PlanResult:
        """The path to the first goal that is reached, or why there is none."""
        kinematics, stops = Kinematics(query.problem.scene, query.problem.arms).for_arm(), []
        for goal in goals:
            ended = _LineSearch(self, query, kinematics, goal).run()
            if not isinstance(ended, _Stop):
                return query.result(PlanStatus.FOUND, ended)
            stops.append(ended)
            if ended.status is not PlanStatus.INFEASIBLE:
                break
        reason = "; ".join(stop.reason for stop in stops)
        if stops[-1].status is not PlanStatus.INFEASIBLE:
            return query.result(stops[-1].status, reason=reason)
        ends = GoalSearch(query.problem, query.motion, query.seed, max_per_goal=1).find()
        if ends.status is not None:
            return query.result(ends.status, reason=f"{reason}; and {ends.reason}")
        return query.result(PlanStatus.INFEASIBLE, reason=f"{reason}; the goal itself has a free configuration")


def _pose_goals(problem: Problem) -> tuple[PoseGoal, ...]:
    """The alternatives of the only moving arm."""
    if len(problem.arms) != 1:
        raise InputError(f"the cartesian planner moves one arm, got {len(problem.arms)}: {', '.join(problem.arms)}")
    goals: list[PoseGoal] = []
    for goal in problem.goal[problem.arms[0]]:
        if not isinstance(goal, PoseGoal):
            kind = "a configuration" if isinstance(goal, JointGoal) else "a region"
            raise InputError(f"the cartesian planner moves to a pose, got {kind} as goal")
        goals.append(goal)
    return tuple(goals)


class _LineSearch:
    """The search for a Cartesian path of one query to one of its goals.

    Args:
        planner: The planner, for its tolerances.
        query: The query.
        kinematics: Kinematics of the moving arm.
        goal: The goal.
    """

    def __init__(self, planner: CartesianPlanner, query: Query, kinematics: Kinematics, goal: PoseGoal) -> None:
        self.planner, self.query, self.kinematics, self.goal = planner, query, kinematics, goal
        self.motion, self.robot = query.motion, query.problem.scene.arms[query.problem.arms[0]].robot
        self.frame = kinematics.frame(goal.frame)
        self.index = kinematics.scene_model.frame_id(self.frame)
        self.chain = chain_of(kinematics.scene_model.arm_model, self.frame)
        self.line = Line.between(kinematics, query.problem.start, self.index, goal.position, goal.rotation)
        self.bound = EdgeBound(kinematics, self.index)

    # ---- the line ----------------------------------------------------------------------------

    def run(self) -> Array | _Stop:
        """Waypoints along the line, shape (n, nq)."""
        line, start = self.line, self.query.problem.start
        waypoints, part, step = [start], 0.0 if line.length > _NO_LENGTH else 1.0, _FIRST_STEP
        while part < 1.0:
            stop = self.take_step(part)
            if stop is not None:
                return stop
            following = 1.0 if part + step > 1.0 - _SMALLEST_STEP else part + step
            q = self.correct(following, waypoints[-1])
            fits = q is not None and self.is_straight(waypoints[-1], q)
            if q is not None and fits and self.is_free(waypoints[-1], q):
                waypoints.append(q)
                part, step = following, min(2.0 * step, _LARGEST_STEP)
                continue
            step *= 0.5
            if step < _SMALLEST_STEP:
                why = self.why(following, waypoints[-1], q, fits)
                meters = part * float(np.linalg.norm(line.p1 - line.p0))
                where = f"the line to the goal ends after {100 * part:.1f} %"
                return _Stop(PlanStatus.INFEASIBLE, f"{where} ({meters:.4g} m): {why}")
        return np.array(waypoints)

    def correct(self, part: float, q: Array) -> Array | None:
        """The configuration on the line nearest to q, or None if there is none within the limits."""
        limits = self.robot.limits
        target = self.line.at(part)
        q, _ = descend(self.chain, target, q, limits.lower, limits.upper, steps=30)
        meters, radians = errors_at(self.chain, target, q)
        most_meters, most_radians = self.waypoint_tolerances()
        return q if meters <= most_meters and radians <= most_radians else None

    def waypoint_tolerances(self) -> tuple[float, float]:
        """Tolerances of waypoints [m], [rad]."""
        return (
            min(_WAYPOINT_SHARE * self.planner.tolerance, 0.9 * self.goal.position_tolerance),
            min(_WAYPOINT_SHARE * self.planner.orientation_tolerance, 0.9 * self.goal.orientation_tolerance),
        )

    def is_straight(self, a: Array, b: Array) -> bool:
        """Whether the edge provably stays within the tolerances of the line."""
        meters, radians = self.bound.bound(a, b)
        share = 1.0 - _WAYPOINT_SHARE
        return (
            meters <= share * self.planner.tolerance
            and (self.line.turn is None or radians <= share * self.planner.orientation_tolerance)
            and float(np.abs(b - a).sum()) <= _LARGEST_EDGE
        )

    def is_free(self, a: Array, b: Array) -> bool:
        """Whether the edge is free."""
        self.query.edges += 1
        return self.motion.edge_is_free(a, b)

    def take_step(self, part: float) -> _Stop | None:
        """Count one step; or the reason to stop after a fraction `part` of the line."""
        if not self.query.goes_on():
            if self.query.cancelled:
                return _Stop(PlanStatus.CANCELLED, CANCELLED)
            return _Stop(PlanStatus.TIMEOUT, f"out of budget after {100 * part:.1f} % of the line")
        self.query.iterations += 1
        return None

    # ---- why it ended ------------------------------------------------------------------------

    def why(self, part: float, q: Array, blocked: Array | None, fits: bool) -> str:
        """Why the line ends at q; `blocked` is the next configuration on it, if there is one."""
        if blocked is not None and fits:
            return f"collision: {self.collision(q, blocked)}"
        if blocked is not None:
            return f"continuing needs a jump of the joints; {self.singularity(q)}"
        target, free = self.line.at(part), np.full(len(q), np.inf)
        unlimited, cost = descend(self.chain, target, q, -free, free)
        excess = describe_excess(self.robot, unlimited)
        if excess and cost < _REACHED and float(np.abs(unlimited - q).sum()) < _LARGEST_EDGE:
            return f"joint limit: {excess}"
        quaternion = None if target.rotation is None else quaternion_from_rotation(target.rotation)
        goal = PoseGoal(self.frame, target.lower, quaternion, position_tolerance=_EXACT, orientation_tolerance=_EXACT)
        search = IkSearch(self.chain, self.robot, goal, q[None], random_state(0))
        if search.collect(_STARTS, most=1):
            return f"it continues only from another configuration; {self.singularity(q)}"
        return why_none(search, self.frame, "the next point of the line")

    def singularity(self, q: Array) -> str:
        """Message about the smallest singular value of the frame's Jacobian."""
        J = self.kinematics.pose_and_jacobian(q, self.index)[2]
        rows = J if self.line.turn is not None else J[:3]
        smallest = float(np.linalg.svd(rows, compute_uv=False).min(initial=np.inf))
        verdict = "singular" if smallest < _SINGULAR else "not singular"
        return f"the arm is {verdict} there (smallest singular value of the Jacobian {smallest:.2g})"

    def collision(self, q: Array, blocked: Array) -> str:
        """Message about the collision on the edge from q."""
        for t in (1.0, 0.5, 0.75, 0.25):
            between = q + t * (blocked - q)
            if self.motion.contacts(between):
                return describe_collision(self.motion, between)
        return " and ".join(repr(name) for name in self.motion.nearest(blocked).pair)
