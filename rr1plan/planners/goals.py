"""From goals to goal configurations: what a planner in joint space can aim at, or why there is nothing.

Joint goals are checked, pose and region goals go through inverse kinematics, sets of goals are
united. Several arms combine: composites are tried nearest to the start first and kept if they are
free as a whole. Continuous joints get the copy nearest to the start, so no plan goes the long way
around.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush

import numpy as np

from rr1plan.checks import Array, Seed, as_generator, read_only
from rr1plan.collision import Contact, MotionChecker
from rr1plan.kinematics import Kinematics, nearest_copy, solve_ik
from rr1plan.kinematics.inverse import describe_excess
from rr1plan.planning import PlanStatus
from rr1plan.problem import Goal, JointGoal, Problem
from rr1plan.robot import Robot
from rr1plan.scene import Scene

# Composites of several arms that are tried before giving up.
_MOST_COMPOSITES = 2000
# Starts of inverse kinematics in a row without another free configuration, after which those found will do.
_PATIENCE = 12


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


def check_start(problem: Problem, motion: MotionChecker) -> str:
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
    return f"the start is in collision: {describe_contacts(motion.checker.contacts(problem.start))}"


def goal_configurations(
    problem: Problem,
    motion: MotionChecker,
    rng: Seed = None,
    *,
    max_per_goal: int = 8,
    max_composites: int = 32,
    attempts: int = 100,
) -> GoalSet:
    """Free configurations of all moving arms that fulfil their goals.

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
    # Making a generator from a seed takes longer than checking a joint goal.
    generator = None if all(isinstance(g, JointGoal) for gs in problem.goal.values() for g in gs) else as_generator(rng)
    choices: list[list[Array]] = []
    for arm in problem.arms:
        finder = _Finder(problem, motion, arm)
        for goal in problem.goal[arm]:
            finder.add(goal, generator, max_per_goal, attempts)
        if not finder.found:
            invalid = PlanStatus.INVALID_GOAL in finder.statuses
            status = PlanStatus.INVALID_GOAL if invalid else PlanStatus.INFEASIBLE
            return GoalSet(np.empty((0, problem.nq)), status, "; ".join(finder.reasons))
        choices.append(finder.found)
    return _combine(problem, motion, choices, max_composites)


def only_configuration(problem: Problem) -> Array | None:
    """The one configuration that every arm has to get to, shape (nq,); None where there are choices."""
    found = []
    for arm in problem.arms:
        goals = problem.goal[arm]
        if len(goals) != 1 or not isinstance(goals[0], JointGoal):
            return None
        found.append(goals[0].q)
    return np.asarray(found[0]) if len(found) == 1 else np.concatenate(found)


def describe_contacts(contacts: Sequence[Contact]) -> str:
    """Which elements touch which and how deep, in words, deepest first."""
    deepest = sorted(contacts, key=lambda c: -c.depth)
    parts = [f"{c.a!r} and {c.b!r} by {c.depth:.3g} m" for c in deepest[:3]]
    more = f" and {len(deepest) - 3} more pairs" if len(deepest) > 3 else ""
    return ", ".join(parts) + more


def _composite_excess(problem: Problem, q: Array) -> str:
    """Which joints of a composite configuration are out of limits, in words."""
    postures = problem.scene.split(q, problem.arms)
    found = ((arm, describe_excess(problem.scene.arms[arm].robot, postures[arm])) for arm in problem.arms)
    return "; ".join(f"{arm}: {text}" for arm, text in found if text)


class _Finder:
    """Configurations of one arm that fulfil one of its goals, free as far as this arm alone goes."""

    def __init__(self, problem: Problem, motion: MotionChecker, arm: str) -> None:
        self.problem, self.motion, self.arm = problem, motion, arm
        self.robot: Robot = problem.scene.arms[arm].robot
        self.start = problem.scene.split(problem.start, problem.arms)[arm]
        before = problem.arms[: problem.arms.index(arm)]
        first = sum(problem.scene.arms[name].robot.nq for name in before)
        self.columns = slice(first, first + self.robot.nq)
        self.others = set(problem.arms) - {arm}
        self.found: list[Array] = []
        self.reasons: list[str] = []
        self.statuses: list[PlanStatus] = []
        self.rejected: list[Array] = []

    def add(self, goal: Goal, rng: np.random.Generator | None, most: int, attempts: int) -> None:
        """Find the configurations of one goal, or note why there is none."""
        if isinstance(goal, JointGoal):
            self._add_configuration(goal.q)
            return
        self.rejected = []
        seeds = np.array([self.start, self.robot.home])
        result = solve_ik(
            Kinematics(Scene({self.arm: self.problem.scene.arms[self.arm]})),
            goal,
            seeds=seeds,
            rng=rng,
            attempts=attempts,
            accept=self._accept,
            max_solutions=most,
            patience=_PATIENCE,
        )
        self.found += list(result.solutions)
        if result.rejected and not result.solved:
            # Coal is asked what touches only when somebody has to be told.
            least = min((self._own_contacts(q) for q in self.rejected), key=_depth)
            self._refuse(
                PlanStatus.INVALID_GOAL,
                f"all {result.rejected} configurations found that reach the goal of {self.arm!r} are in collision; "
                f"the best of them: {describe_contacts(least)}",
            )
        elif not result.solved:
            self._refuse(PlanStatus.INFEASIBLE, result.reason)

    def _add_configuration(self, q: Array) -> None:
        continuous = self.robot.continuous > 0.0
        if continuous.any():
            q = np.where(continuous, nearest_copy(self.robot, q, self.start), q)
        excess = describe_excess(self.robot, q)
        if excess:
            self._refuse(PlanStatus.INVALID_GOAL, f"the goal of {self.arm!r} is out of limits: {excess}")
            return
        contacts = self._own_contacts(q)
        if contacts:
            text = describe_contacts(contacts)
            self._refuse(PlanStatus.INVALID_GOAL, f"the goal of {self.arm!r} is in collision: {text}")
            return
        self.found.append(q)

    def _accept(self, q: Array) -> bool:
        if self.motion.is_free(self._composite(q)) or (self.others and not self._own_contacts(q)):
            return True
        self.rejected.append(q)
        return False

    def _composite(self, q: Array) -> Array:
        """All arms at their starts but for this one."""
        composite: Array = self.problem.start.copy()
        composite[self.columns] = q
        return composite

    def _own_contacts(self, q: Array) -> list[Contact]:
        """What touches at q that no other moving arm has a part in."""
        composite = self._composite(q)
        if self.motion.is_free(composite):
            return []
        owner = self.problem.scene.owner
        return [c for c in self.motion.checker.contacts(composite) if not {owner(c.a), owner(c.b)} & self.others]

    def _refuse(self, status: PlanStatus, reason: str) -> None:
        self.statuses.append(status)
        self.reasons.append(reason)


def _depth(contacts: Sequence[Contact]) -> float:
    return max(float(c.depth) for c in contacts)


def _combine(problem: Problem, motion: MotionChecker, choices: list[list[Array]], most: int) -> GoalSet:
    """Composites of the arms' choices that are free as a whole."""
    if len(choices) == len(choices[0]) == 1:
        return GoalSet(read_only(np.array(choices[0])))
    postures = problem.scene.split(problem.start, problem.arms)
    ranked, costs = [], []
    for arm, found in zip(problem.arms, choices, strict=True):
        far = np.linalg.norm(np.array(found) - postures[arm], axis=1) ** 2
        order = np.argsort(far, kind="stable")
        ranked.append([found[i] for i in order])
        costs.append([float(far[i]) for i in order])
    free: list[Array] = []
    blocked: list[Contact] = []
    tried = 0
    for index in _cheapest_first(costs):
        if tried == _MOST_COMPOSITES or len(free) == most:
            break
        tried += 1
        q = np.concatenate([found[i] for found, i in zip(ranked, index, strict=True)])
        if len(choices) == 1 or motion.is_free(q):
            free.append(q)
        elif not blocked:
            blocked = list(motion.checker.contacts(q))
    if free:
        return GoalSet(read_only(np.array(free)))
    reason = f"the arms' goals collide with each other in all {tried} combinations tried: {describe_contacts(blocked)}"
    return GoalSet(np.empty((0, problem.nq)), PlanStatus.INVALID_GOAL, reason)


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
