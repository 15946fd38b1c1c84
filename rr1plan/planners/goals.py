"""From goals to goal configurations: what a planner in joint space can aim at, or why there is nothing.

Joint goals are checked, pose and region goals go through inverse kinematics, sets of goals are
united. Several arms combine: composites are tried nearest to the start first and kept if they are
free as a whole. Continuous joints get the copy nearest to the start, so no plan goes the long way
around. A search that does not get on may ask for more of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from heapq import heappop, heappush

import numpy as np

from rr1plan.checks import Array, Seed, as_seed, counted, read_only
from rr1plan.collision import CollisionChecker
from rr1plan.errors import InputError
from rr1plan.kernels.random_state import RandomState, random_state
from rr1plan.kinematics import nearest_copy
from rr1plan.kinematics.chain import chain_of
from rr1plan.kinematics.inverse import describe_excess, why_none
from rr1plan.kinematics.search import IkSearch
from rr1plan.planners.collision_messages import contacts_without, describe_collision
from rr1plan.planning import PlanStatus
from rr1plan.problem import Goal, JointGoal, Problem, frame_link
from rr1plan.robot import Robot

# Composites of several arms that are tried before giving up.
_MOST_COMPOSITES = 2000
# How often more configurations of each arm are looked for when none of them go together.
_ROUNDS = 3
# Starts of inverse kinematics in a row without another free configuration, after which those found will do.
_PATIENCE = 20
# Sets their random numbers apart from those of a planner with the same seed.
_STREAM = 0x5DEECE66D


@dataclass(frozen=True, eq=False)
class GoalSet:
    """Where a problem may end.

    Args:
        configurations: Composite configurations within limits and free, nearest to the start first,
            shape (k, nq).
        status: None when there is one; INVALID_GOAL when those that reach the goal are out of limits or
            in collision, INFEASIBLE when none reaches it.
        reason: Why there is none, in words; empty when there is one.
    """

    configurations: Array
    status: PlanStatus | None = None
    reason: str = ""


def check_start(problem: Problem, motion: CollisionChecker) -> str:
    """Why the start is none, in words (which joint is out by how much, which links touch what); empty if it is fine.

    Args:
        problem: The problem.
        motion: Of the problem's scene and moving arms.
    """
    excess = _composite_excess(problem, problem.start)
    if excess:
        return f"the start is out of limits: {excess}"
    if motion.is_free(problem.start):
        return ""
    return f"the start is in collision: {describe_collision(motion, problem.start)}"


class GoalSearch:
    """The search for free configurations of all moving arms that fulfil their goals; it can go on.

    Args:
        problem: The problem.
        motion: Of the problem's scene and moving arms.
        rng: Generator or seed of inverse kinematics' random starts.
        max_per_goal: Most configurations of one pose or region goal.
        max_composites: Most configurations in all.
        attempts: Starts of inverse kinematics for each pose or region goal.

    Raises:
        InputError: numbers that make no sense.
    """

    def __init__(
        self,
        problem: Problem,
        motion: CollisionChecker,
        rng: Seed = None,
        *,
        max_per_goal: int = 8,
        max_composites: int = 32,
        attempts: int = 200,
    ) -> None:
        for name, number in (("attempts", attempts), ("max_per_goal", max_per_goal)):
            if number < 1:
                raise InputError(f"{name} is {number!r}, expected at least one")
        self._problem, self._motion = problem, motion
        self._most, self._most_composites, self._attempts = max_per_goal, max_composites, attempts
        state = random_state(as_seed(rng) ^ _STREAM)
        self._finders = [_Finder(problem, motion, arm, state) for arm in problem.arms]
        self._tried: set[bytes] = set()

    def find(self) -> GoalSet:
        """The first configurations, or why there are none."""
        for finder in self._finders:
            for goal in self._problem.goal[finder.arm]:
                finder.add(goal, self._most, self._attempts)
            if not finder.found:
                invalid = PlanStatus.INVALID_GOAL in finder.statuses
                status = PlanStatus.INVALID_GOAL if invalid else PlanStatus.INFEASIBLE
                return GoalSet(np.empty((0, self._problem.nq)), status, "; ".join(finder.reasons))
        free, blocked = self._combine()
        rounds = _ROUNDS
        while not free and rounds > 0:
            free, rounds = list(self.more()), rounds - 1
        if free:
            return GoalSet(read_only(np.array(free)))
        collision, tried = describe_collision(self._motion, blocked), len(self._tried)
        reason = f"the arms' goals collide with each other in all {tried} combinations tried: {collision}"
        return GoalSet(np.empty((0, self._problem.nq)), PlanStatus.INVALID_GOAL, reason)

    def more(self) -> Array:
        """Others, after `find` has found some: as many of each goal as then if there are, shape (k, nq)."""
        for finder in self._finders:
            finder.go_on(self._most, self._attempts)
        return np.array(self._combine()[0]).reshape(-1, self._problem.nq)

    def _combine(self) -> tuple[list[Array], Array]:
        """Composites of what each arm has found that are free as a whole and new; and one that is not free."""
        ranked, costs = [], []
        for finder in self._finders:
            far = np.linalg.norm(np.array(finder.found) - finder.start, axis=1) ** 2
            order = np.argsort(far, kind="stable")
            ranked.append([finder.found[i] for i in order])
            costs.append([float(far[i]) for i in order])
        free: list[Array] = []
        blocked, tried = self._problem.start, 0
        for index in _cheapest_first(costs):
            if tried == _MOST_COMPOSITES or len(free) == self._most_composites:
                break
            q = np.concatenate([found[i] for found, i in zip(ranked, index, strict=True)])
            if q.tobytes() in self._tried:
                continue
            self._tried.add(q.tobytes())
            tried += 1
            if len(ranked) == 1 or self._motion.is_free(q):
                free.append(q)
            elif tried == 1:
                blocked = q
        return free, blocked


def joint_goals(problem: Problem) -> Array | None:
    """The configurations that are the goal, shape (k, nq); None for other goals, or several arms' to be combined."""
    found = []
    for arm in problem.arms:
        goals = problem.goal[arm]
        if len(goals) > 1 and len(problem.arms) > 1:
            return None
        for goal in goals:
            if not isinstance(goal, JointGoal):
                return None
            found.append(goal.q)
    return np.array(found) if len(problem.arms) == 1 else np.concatenate(found)[None]


def _composite_excess(problem: Problem, q: Array) -> str:
    """Which joints of a composite configuration are out of limits, in words."""
    postures = problem.scene.split(q, problem.arms)
    found = ((arm, describe_excess(problem.scene.arms[arm].robot, postures[arm])) for arm in problem.arms)
    return "; ".join(f"{arm}: {text}" for arm, text in found if text)


class _Finder:
    """Configurations of one arm that fulfil one of its goals, free as far as this arm alone goes."""

    def __init__(self, problem: Problem, motion: CollisionChecker, arm: str, state: RandomState) -> None:
        self.problem, self.motion, self.arm, self.state = problem, motion, arm, state
        self.robot: Robot = problem.scene.arms[arm].robot
        before = problem.arms[: problem.arms.index(arm)]
        self.first = sum(problem.scene.arms[name].robot.nq for name in before)
        self.columns = slice(self.first, self.first + self.robot.nq)
        self.start = problem.start[self.columns]
        self.others = frozenset(problem.arms) - {arm}
        self.found: list[Array] = []
        self.reasons: list[str] = []
        self.statuses: list[PlanStatus] = []
        self.searches: list[IkSearch] = []

    def add(self, goal: Goal, most: int, attempts: int) -> None:
        """Find the configurations of one goal, or note why there is none."""
        if isinstance(goal, JointGoal):
            self._add_configuration(goal.q)
            return
        link = f"{self.arm}/{frame_link(self.robot, goal.frame)}"
        chain = chain_of(self.motion.model.skeleton, link, self.first)
        limits = self.robot.limits
        seeds = np.clip([self.start, self.robot.home], limits.lower, limits.upper)
        search = IkSearch(chain, self.robot, goal, seeds, self.state)
        self.searches.append(search)
        self.found += search.collect(attempts, self._is_free, most, _PATIENCE)
        if search.accepted:
            return
        if search.rejected:
            least = min(search.rejected, key=self._depth)
            found = counted(len(search.rejected), "configuration")
            self._refuse(
                PlanStatus.INVALID_GOAL,
                f"the goal of {self.arm!r} is in collision in every configuration found ({found}); "
                f"least in this one: {self._describe(least)}",
            )
        else:
            self._refuse(PlanStatus.INFEASIBLE, why_none(search, link))

    def go_on(self, most: int, attempts: int) -> None:
        """Look for more of them."""
        for search in self.searches:
            self.found += search.collect(attempts, self._is_free, most, _PATIENCE)

    def _add_configuration(self, q: Array) -> None:
        continuous = self.robot.continuous > 0.0
        if continuous.any():
            q = np.where(continuous, nearest_copy(self.robot, q, self.start), q)
        excess = describe_excess(self.robot, q)
        if excess:
            self._refuse(PlanStatus.INVALID_GOAL, f"the goal of {self.arm!r} is out of limits: {excess}")
        elif self._is_free(q):
            self.found.append(q)
        else:
            self._refuse(PlanStatus.INVALID_GOAL, f"the goal of {self.arm!r} is in collision: {self._describe(q)}")

    def _is_free(self, q: Array) -> bool:
        """Nothing touches at q that no other moving arm has a part in."""
        return self.motion.is_free_ignoring(self._composite(q), self.others)

    def _describe(self, q: Array) -> str:
        """What collides at q without the other moving arms, in words."""
        return describe_collision(self.motion, self._composite(q), self.others)

    def _depth(self, q: Array) -> float:
        """How deep the deepest contact at q is without the other moving arms [m]."""
        contacts = contacts_without(self.motion, self._composite(q), self.others)
        return max((contact.depth for contact in contacts), default=0.0)

    def _composite(self, q: Array) -> Array:
        """All arms at their starts but for this one."""
        composite: Array = self.problem.start.copy()
        composite[self.columns] = q
        return composite

    def _refuse(self, status: PlanStatus, reason: str) -> None:
        self.statuses.append(status)
        self.reasons.append(reason)


def _cheapest_first(costs: list[list[float]]) -> Iterator[tuple[int, ...]]:
    """One index for each (ascending) list of costs, by ascending sum."""

    def total(index: tuple[int, ...]) -> float:
        return sum(c[i] for c, i in zip(costs, index, strict=True))

    first = (0,) * len(costs)
    heap, seen = [(total(first), first)], {first}
    while heap:
        _, index = heappop(heap)
        yield index
        for j, i in enumerate(index):
            following = (*index[:j], i + 1, *index[j + 1 :])
            if i + 1 < len(costs[j]) and following not in seen:
                seen.add(following)
                heappush(heap, (total(following), following))
