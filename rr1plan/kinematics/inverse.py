"""Inverse kinematics by many starts: every distinct configuration that brings a frame to its goal.

From each start (the seeds first, then random ones) a descent within the joint limits runs to the
nearest solution; what it finds is counted once, whole turns taken off. Arms without a closed form,
mimic joints, redundant arms and position-only goals are all the same to it. Numerical and random:
a rare solution next to a limit can be missed, more `attempts` miss fewer.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from rr1plan.checks import Array, Seed, as_generator, finite_array, of_kind, positive_number, read_only
from rr1plan.errors import InputError
from rr1plan.kinematics.descent import Target, descend
from rr1plan.kinematics.forward import Kinematics
from rr1plan.kinematics.turns import difference, nearest_copy
from rr1plan.problem import PoseGoal, RegionGoal
from rr1plan.robot import Robot
from rr1plan.transforms import rotation_from_quaternion

# A solution uses at most this part of the goal's tolerance, so that another kinematics agrees.
_SHARE = 0.9
# A region's faces are kept this far away where it is thick enough, and met this exactly where it is flat [m].
_REGION_MARGIN, _REGION_TOLERANCE = 1e-6, 1e-9
_DISTINCT, _DISTINCT_REDUNDANT = 1e-3, 0.2
_UNLIMITED_STARTS, _POSITION_STARTS = 20, 10


@dataclass(frozen=True, eq=False)
class IkResult:
    """What inverse kinematics found.

    Args:
        solutions: Distinct configurations within the limits, nearest to the first seed first, shape (k, nq).
            One copy of each: the one nearest to the first seed; `copies_within_limits` gives the others.
        reason: Why there is none, in words; empty when there is one.
        attempts: Starts that were tried.
        rejected: Distinct solutions that `accept` refused.
        nearest: The configuration within the limits that came nearest to the goal, shape (nq,).
        position_error: Distance left there [m].
        orientation_error: Angle left there [rad].
    """

    solutions: Array
    reason: str
    attempts: int
    rejected: int
    nearest: Array
    position_error: float
    orientation_error: float

    @property
    def solved(self) -> bool:
        """There is a solution."""
        return len(self.solutions) > 0


def solve_ik(
    kinematics: Kinematics,
    goal: PoseGoal | RegionGoal,
    arm: str | None = None,
    *,
    seeds: Any = None,
    rng: Seed = None,
    attempts: int = 100,
    accept: Callable[[Array], bool] | None = None,
    max_solutions: int | None = None,
    patience: int | None = None,
    separation: float | None = None,
) -> IkResult:
    """Every distinct configuration found that brings a frame of one arm to its goal.

    Args:
        kinematics: Of the scene, or of the robot alone.
        goal: A position, a full pose, or a box for the frame's origin. A random start aims at a
            random point of the box, a seed at the nearest.
        arm: The arm (default: the only one that moves).
        seeds: Where to start first [rad or m], shape (nq,) or (k, nq), clipped to the limits
            (default: the arm's posture in the scene).
        rng: Generator or seed of the random starts; the same seed gives the same answer.
        attempts: Starts in all, seeds included.
        accept: Asked for each distinct solution, e.g. whether it is free of collision; gets (nq,).
        max_solutions: Stop after so many accepted ones (default: all that are found).
        patience: Stop after so many starts in a row that led to no other accepted one, once there is one (default:
            never).
        separation: Solutions count as distinct from this difference in some joint on [rad or m]. Default: 0.001,
            and 0.2 where the arm has more joints than the goal needs and solutions form a continuum.

    Raises:
        UnknownNameError: no such arm or frame.
        InputError: a goal of another kind, or numbers that make no sense.
    """
    of_kind("kinematics", kinematics, Kinematics)
    own = kinematics.for_arm(arm)
    robot = own.scene.arms[own.arms[0]].robot
    search = _Search(own, robot, goal, accept, separation)
    starts = _seeds(own, robot, seeds)
    for name, number in (("attempts", attempts), ("max_solutions", max_solutions), ("patience", patience)):
        if number is not None and (not isinstance(number, int | np.integer) or number < 1):
            raise InputError(f"{name} is {number!r}, expected at least one")
    generator = as_generator(rng)
    tried = idle = 0
    for start, aim in search.starts(starts, attempts, generator):
        tried += 1
        idle = 0 if search.run(start, aim, starts[0]) else idle + 1
        if patience is not None and search.accepted and idle >= patience:
            break
        if max_solutions is not None and len(search.accepted) >= max_solutions:
            break
    solutions = np.array(search.accepted).reshape(-1, robot.nq)
    order = np.argsort(np.linalg.norm(solutions - starts[0], axis=1), kind="stable")
    reason = "" if len(solutions) else search.why_none(tried, generator)
    position, orientation = search.errors(search.nearest)
    return IkResult(
        read_only(solutions[order]), reason, tried, search.rejected, read_only(search.nearest), position, orientation
    )


def target_of(kinematics: Kinematics, goal: PoseGoal | RegionGoal) -> Target:
    """The target of a goal of the only moving arm.

    Raises:
        UnknownNameError: no such frame.
        InputError: a goal of another kind.
    """
    if not isinstance(goal, PoseGoal | RegionGoal):
        raise InputError(f"goal is a {type(goal).__name__}, expected a PoseGoal or a RegionGoal")
    index = kinematics.scene_model.frame_id(kinematics.frame(goal.frame))
    if isinstance(goal, PoseGoal):
        return Target(index, goal.position, goal.position, goal.rotation)
    rotation = None if goal.quaternion is None else rotation_from_quaternion(goal.quaternion)
    margin = np.minimum(_REGION_MARGIN, 0.25 * (goal.upper - goal.lower))
    return Target(index, goal.lower + margin, goal.upper - margin, rotation)


class _Search:
    """The state of one call: what was found so far and how near the best miss came."""

    def __init__(
        self,
        kinematics: Kinematics,
        robot: Robot,
        goal: PoseGoal | RegionGoal,
        accept: Callable[[Array], bool] | None,
        separation: float | None,
    ) -> None:
        self.kinematics, self.robot, self.accept = kinematics, robot, accept
        self.target = target_of(kinematics, goal)
        tolerance = goal.position_tolerance if isinstance(goal, PoseGoal) else _REGION_TOLERANCE
        self.position_tolerance = _SHARE * tolerance
        self.orientation_tolerance = _SHARE * goal.orientation_tolerance
        fixed = int((self.target.lower == self.target.upper).sum()) + (3 if self.target.rotation is not None else 0)
        if separation is None:
            separation = _DISTINCT_REDUNDANT if robot.nq > fixed else _DISTINCT
        self.separation = positive_number("separation", separation)
        self.found: list[Array] = []
        self.accepted: list[Array] = []
        self.rejected = 0
        self.nearest = np.clip(kinematics.scene.arms[kinematics.arms[0]].q, robot.limits.lower, robot.limits.upper)
        self.least = np.inf

    def starts(self, seeds: Array, attempts: int, rng: np.random.Generator) -> Iterator[tuple[Array, Target]]:
        """Where to start and what to aim at: the seeds, then random configurations."""
        for seed in seeds[:attempts]:
            yield seed, self.target
        lower, upper = _sampling_box(self.robot)
        box = self.target
        for _ in range(attempts - len(seeds)):
            point = rng.uniform(box.lower, box.upper)
            yield rng.uniform(lower, upper), Target(box.index, point, point, box.rotation)

    def run(self, start: Array, aim: Target, reference: Array) -> bool:
        """One descent, and what is to be done with its end; whether that is a new solution, and accepted."""
        limits = self.robot.limits
        q, cost = self.descend(start, aim, limits.lower, limits.upper)
        if (self.target.lower != self.target.upper).any() and not self.reached(q):
            q, cost = self.descend(q, self.target, limits.lower, limits.upper)
        if cost < self.least:
            self.least, self.nearest = cost, q
        if not self.reached(q):
            return False
        q = nearest_copy(self.robot, q, reference)
        apart = np.abs(difference(self.robot, q, np.array(self.found).reshape(-1, self.robot.nq))).max(
            axis=1, initial=0.0
        )
        if (apart <= self.separation).any():
            return False
        self.found.append(q)
        if self.accept is None or self.accept(q.copy()):
            self.accepted.append(q)
        else:
            self.rejected += 1
            return False
        return True

    def descend(self, q: Array, aim: Target, lower: Array, upper: Array) -> tuple[Array, float]:
        """The end of a descent and its squared error."""
        return descend(lambda x: aim.residual(self.kinematics, x), q, lower, upper)

    def errors(self, q: Array) -> tuple[float, float]:
        """Distance [m] and angle [rad] left at q."""
        p, R, _ = self.kinematics.pose_and_jacobian(q, self.target.index)
        off, turn = self.target.errors(p, R)
        return float(np.linalg.norm(off)), 0.0 if turn is None else float(np.linalg.norm(turn))

    def reached(self, q: Array) -> bool:
        """Within the goal's tolerances."""
        position, orientation = self.errors(q)
        return position <= self.position_tolerance and orientation <= self.orientation_tolerance

    # ---- why there is none ---------------------------------------------------------------

    def why_none(self, tried: int, rng: np.random.Generator) -> str:
        """The reason in words."""
        frame = self.kinematics.scene_model.model.frames[self.target.index].name
        if self.rejected:
            return (
                f"{frame} reaches the goal in {self.rejected} configuration(s), all of them rejected ({tried} starts)"
            )
        outside = self._outside_limits(rng)
        if outside:
            return f"{frame} reaches the goal only outside the joint limits: {outside} ({tried} starts)"
        position, orientation = self.errors(self.nearest)
        at = self.kinematics.pose_and_jacobian(self.nearest, self.target.index)[0]
        miss = f"{position:.4g} m away, at {np.array2string(at, precision=4, separator=', ')}"
        if self.target.rotation is None:
            return f"the goal is out of reach of {frame}: the nearest it gets is {miss} ({tried} starts)"
        alone = "can" if self._position_alone(rng) else "cannot"
        return (
            f"the goal is out of reach of {frame}: the nearest it gets is {miss}, turned by {orientation:.4g} rad; "
            f"the position alone {alone} be reached ({tried} starts)"
        )

    def _outside_limits(self, rng: np.random.Generator) -> str:
        """Which joints would have to leave their limits by how much; empty if that does not help either."""
        robot, limits = self.robot, self.robot.limits
        lower, upper = _sampling_box(robot)
        best, least = None, np.inf
        for i in range(_UNLIMITED_STARTS):
            start = self.nearest if i == 0 else rng.uniform(lower, upper)
            free = np.full(robot.nq, np.inf)
            q, _ = self.descend(start, self.target, -free, free)
            q = nearest_copy(robot, q, self.nearest)
            over = float(np.maximum(limits.lower - q, q - limits.upper).clip(0.0).max(initial=0.0))
            if over < least and self.reached(q):
                best, least = q, over
        if best is None:
            return ""
        return describe_excess(robot, best)

    def _position_alone(self, rng: np.random.Generator) -> bool:
        limits = self.robot.limits
        aim = Target(self.target.index, self.target.lower, self.target.upper, None)
        lower, upper = _sampling_box(self.robot)
        for i in range(_POSITION_STARTS):
            start = self.nearest if i == 0 else rng.uniform(lower, upper)
            _, cost = self.descend(start, aim, limits.lower, limits.upper)
            if cost <= self.position_tolerance**2:
                return True
        return False


def describe_excess(robot: Robot, q: Array) -> str:
    """Which joints of q are out of their limits by how much, in words; empty if none is."""
    limits = robot.limits
    if (q >= limits.lower).all() and (q <= limits.upper).all():
        return ""
    parts = []
    for j, name in enumerate(robot.joint_names):
        over = max(limits.lower[j] - q[j], q[j] - limits.upper[j])
        if over > 0.0:
            unit = "m" if robot.joint(name).kind == "prismatic" else "rad"
            bounds = f"[{limits.lower[j]:.6g}, {limits.upper[j]:.6g}]"
            parts.append(f"joint {name!r} at {q[j]:.6g} {unit}, outside {bounds} by {over:.3g} {unit}")
    return "; ".join(parts)


def _seeds(kinematics: Kinematics, robot: Robot, seeds: Any) -> Array:
    """Starts (k, nq) within the limits, k >= 1."""
    if seeds is None or np.size(seeds) == 0:
        seeds = kinematics.scene.arms[kinematics.arms[0]].q
    rows = finite_array("seeds", np.atleast_2d(np.asarray(seeds, dtype=np.float64)), (None, robot.nq))
    return np.clip(rows, robot.limits.lower, robot.limits.upper)


def _sampling_box(robot: Robot) -> tuple[Array, Array]:
    """Where random starts come from: the limits, one turn where there are none."""
    lower, upper = robot.limits.lower, robot.limits.upper
    return np.where(np.isfinite(lower), lower, -np.pi), np.where(np.isfinite(upper), upper, np.pi)
