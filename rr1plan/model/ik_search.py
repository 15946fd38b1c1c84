"""Resumable multi-start search for inverse kinematics solutions."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from rr1plan.checks import Array, read_only
from rr1plan.kernels.planner_kernels import CStruct, load_library
from rr1plan.kernels.random_state import RandomState
from rr1plan.model.ik_descent import Target, descend, errors_at
from rr1plan.model.joint_turns import nearest_copy, rotary
from rr1plan.model.kinematic_chain import Chain
from rr1plan.robot import Robot
from rr1plan.scene.problem import PoseGoal, RegionGoal
from rr1plan.transforms import rotation_from_quaternion

# Share of the goal's tolerance that solutions use, and the share of a second search. Both leave room for the
# rounding errors of other implementations of forward kinematics.
SHARE, WHOLE = 0.9, 1.0 - 1e-6
# A second search runs if the error of a descent is below this multiple of the tolerance.
NEAR = 2.0
# Descents without joint limits after a search that found nothing.
_UNLIMITED_STARTS = 40
# Distance from the faces of a region, and position tolerance of a flat region [m].
_REGION_MARGIN, _REGION_TOLERANCE = 1e-6, 1e-9
# Least distance between two solutions, and between two of infinitely many [rad or m].
_DISTINCT, _DISTINCT_REDUNDANT = 1e-3, 0.2
# Starts between two returns to Python, e.g. for Ctrl-C.
_CHUNK = 256
_CAPACITY = 16


def _target_of(goal: PoseGoal | RegionGoal, margin: float = _REGION_MARGIN) -> Target:
    """The target of a goal's frame; positions keep a margin from the faces of a region [m]."""
    if isinstance(goal, PoseGoal):
        return Target(goal.position, goal.position, goal.rotation)
    rotation = None if goal.quaternion is None else rotation_from_quaternion(goal.quaternion)
    inset = np.minimum(margin, 0.25 * (goal.upper - goal.lower))
    return Target(goal.lower + inset, goal.upper - inset, rotation)


class IkSearch:
    """Descents from seeds, then from random starts.

    Args:
        chain: The kinematic chain of the frame.
        robot: The robot with these joints.
        goal: Goal of the frame.
        seeds: First starts, within the limits, shape (k, nq), k >= 1. Of all copies of a solution modulo whole turns,
            the nearest to the first seed counts. In random starts, joints that do not move the frame are as in the
            first seed, until all solutions of `attempts` starts are rejected.
        state: State of the random numbers; it advances.

    Attributes:
        target: Target of the frame.
        accepted: Accepted solutions so far.
        rejected: Rejected solutions so far.
        struct: The search as a struct of the kernels, for pages that search by themselves.
    """

    def __init__(
        self,
        chain: Chain,
        robot: Robot,
        goal: PoseGoal | RegionGoal,
        seeds: Array,
        state: RandomState,
    ) -> None:
        self.chain, self.robot, self.target, self._goal = chain, robot, _target_of(goal), goal
        self.accepted: list[Array] = []
        self.rejected: list[Array] = []
        fixed = int((self.target.lower == self.target.upper).sum()) + 3 * (self.target.rotation is not None)
        tolerance = goal.position_tolerance if isinstance(goal, PoseGoal) else _REGION_TOLERANCE
        self._whole = WHOLE * tolerance, WHOLE * goal.orientation_tolerance
        self.position_tolerance = SHARE * tolerance
        self.orientation_tolerance = SHARE * goal.orientation_tolerance
        self._state, self._seeds = state, seeds
        self._solutions, self._nearest = np.empty((_CAPACITY, robot.nq)), seeds[0].copy()
        lower, upper, corner, extent, wraps = _joint_rows(robot)
        self._extent = extent
        idle = np.ones(robot.nq, np.bool_)
        idle[chain.joints[:, 1]] = False
        self._has_idle = bool(idle.any())
        self.struct = CStruct(
            "IkSearch",
            chain=chain.struct,
            target=self.target.struct,
            lower=lower,
            upper=upper,
            corner=corner,
            extent=np.where(idle, 0.0, extent),
            wraps=wraps,
            preferred=seeds[0],
            seeds=seeds,
            seed_count=len(seeds),
            column_count=robot.nq,
            position_tolerance=self.position_tolerance,
            orientation_tolerance=self.orientation_tolerance,
            separation=separation(chain, fixed),
            solutions=self._solutions,
            nearest=self._nearest,
            nearest_squared=np.inf,
            memory=np.empty(robot.nq + load_library().rr1_descent_memory(robot.nq)),
        )
        self._tried_before = 0
        self._is_widened = False

    @property
    def tried(self) -> int:
        """Starts so far."""
        starts: int = self.struct.value.starts
        return self._tried_before + starts

    def nearest(self) -> Array:
        """The configuration within the limits with the smallest error so far, shape (nq,)."""
        limits = self.robot.limits
        # The search stops slow descents early, so this one is completed.
        return descend(self.chain, self.target, self._nearest, limits.lower, limits.upper)[0]

    def beyond_limits(self) -> Array:
        """Configurations that reach the goal if limits are ignored, shape (k, nq), the least excess first."""
        robot, limits = self.robot, self.robot.limits
        free, nearest, rng = np.full(robot.nq, np.inf), self.nearest(), np.random.default_rng(self.tried)
        starts = [nearest, *rng.uniform(*sampling_box(robot), (_UNLIMITED_STARTS - 1, robot.nq))]
        ends = [nearest_copy(robot, descend(self.chain, self.target, q, -free, free)[0], nearest) for q in starts]
        reached = np.array([q for q in ends if self.is_reached(q)]).reshape(-1, robot.nq)
        excess = np.maximum(limits.lower - reached, reached - limits.upper).max(axis=1, initial=0.0)
        return np.asarray(reached[np.argsort(excess, kind="stable")])

    def is_reached(self, q: Array) -> bool:
        """Whether the frame is within the goal's tolerances at q (nq,)."""
        position, orientation = errors_at(self.chain, self.target, q)
        return position <= self.position_tolerance and orientation <= self.orientation_tolerance

    def collect(
        self,
        attempts: int,
        accept: Callable[[Array], bool] | None = None,
        most: int | None = None,
        patience: int | None = None,
    ) -> list[Array]:
        """Continue for `attempts` starts and return the new accepted solutions.

        If no start has ever reached nine tenths of the tolerance (or a region without its rim) but one came close, or
        reaches the goal without limits, as many further starts use the whole tolerance and region, with a copy of the
        random state. The first of them are the configurations that came closest, clipped to the limits: random
        descents rarely end where several joints are at a limit.

        If all solutions were rejected, as many further starts vary the joints too that do not move the frame.

        Args:
            attempts: Number of starts.
            accept: See `solve_ik`.
            most: Most accepted solutions.
            patience: See `solve_ik`.
        """
        found = self._collect(attempts, accept, most, patience)
        if not (self.accepted or self.rejected or self._is_widened):
            beyond = self.beyond_limits()
            if len(beyond) or self._came_near():
                self._widen(beyond)
                found = self._collect(attempts, accept, most, patience)
        if self._has_idle and self.rejected and not self.accepted:
            self._has_idle = False
            self.struct.set(extent=self._extent)
            found = self._collect(attempts, accept, most, patience)
        return found

    def _came_near(self) -> bool:
        """Whether a descent ended so close to the goal that the whole tolerance may suffice."""
        position, orientation = self._whole
        if isinstance(self._goal, RegionGoal):
            position += _REGION_MARGIN
        weight = self.target.struct.value.weight
        near: bool = self.struct.value.nearest_squared <= NEAR**2 * (position**2 + (weight * orientation) ** 2)
        return near

    def _widen(self, beyond: Array) -> None:
        """Restart with the whole tolerance and region, first from the configurations that came closest."""
        self.position_tolerance, self.orientation_tolerance = self._whole
        self._is_widened, self._tried_before, self._state = True, self.tried, self._state.copy()
        clipped = np.clip(beyond, self.robot.limits.lower, self.robot.limits.upper)
        seeds = np.vstack([self.nearest(), self._seeds, clipped])
        self.target = _target_of(self._goal, 0.0)
        self.struct.set(
            target=self.target.struct,
            nearest_squared=np.inf,
            seeds=seeds,
            seed_count=len(seeds),
            starts=0,
            position_tolerance=self.position_tolerance,
            orientation_tolerance=self.orientation_tolerance,
        )

    def _collect(
        self, attempts: int, accept: Callable[[Array], bool] | None, most: int | None, patience: int | None
    ) -> list[Array]:
        begin, last = len(self.accepted), self.tried
        end = last + attempts
        while len(self.accepted) - begin < (most or np.inf):
            stop = min(end, last + patience) if patience and self.accepted else end
            if self.tried >= stop:
                break
            q = self._advance(min(stop, self.tried + _CHUNK))
            if q is None:
                continue
            if accept is None or accept(q.copy()):
                self.accepted.append(q)
                last = self.tried
            else:
                self.rejected.append(q)
        return self.accepted[begin:]

    def _advance(self, starts: int) -> Array | None:
        """The next solution, or None after `starts` starts in all."""
        count = self.struct.value.solution_count
        if count == len(self._solutions):
            self._solutions = np.concatenate([self._solutions, np.empty_like(self._solutions)])
            self.struct.set(solutions=self._solutions)
        found = load_library().rr1_search_ik(self.struct, self._state, starts - self._tried_before)
        return self._solutions[count].copy() if found else None


def separation(chain: Chain, fixed: int) -> float:
    """The least distance between two solutions [rad or m].

    Args:
        chain: The kinematic chain of the frame.
        fixed: Number of coordinates of the frame that the goal fixes, 0 to 6.
    """
    return _DISTINCT_REDUNDANT if len(np.unique(chain.joints[:, 1])) > fixed else _DISTINCT


def sampling_box(robot: Robot) -> tuple[Array, Array]:
    """Bounds of random starts: the limits, or one turn for joints without limits, from the limit of those with one."""
    lower, upper = robot.limits.lower, robot.limits.upper
    low, high = np.isfinite(lower), np.isfinite(upper)
    turn = 2.0 * np.pi
    return (
        np.where(low, lower, np.where(high, upper - turn, -np.pi)),
        np.where(high, upper, np.where(low, lower + turn, np.pi)),
    )


@lru_cache(maxsize=64)
def _joint_rows(robot: Robot) -> Array:
    """Rows lower, upper (limits), corner, extent (box of random starts), wraps (equal modulo 2 pi), shape (5, nq)."""
    corner, end = sampling_box(robot)
    limits = robot.limits
    return read_only(np.array([limits.lower, limits.upper, corner, end - corner, rotary(robot)]))
