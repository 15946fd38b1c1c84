"""Goal configurations of a problem, or why there are none.

Joint goals are checked, pose and region goals are solved by inverse kinematics, alternatives are
united. Configurations of several arms are combined, nearest to the start first, and kept if the composite
configuration is free. Continuous joints take the value nearest to the start. A planner may
request more configurations during its search, including copies of solutions a turn away within the limits.
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
from rr1plan.model import nearest_copy
from rr1plan.model.ik_search import IkSearch
from rr1plan.model.inverse_kinematics import describe_excess, why_none
from rr1plan.model.joint_space import turned_copies
from rr1plan.model.kinematic_chain import chain_of
from rr1plan.planners.collision_messages import contacts_without, describe_collision
from rr1plan.planning import PlanStatus
from rr1plan.robot import Robot
from rr1plan.scene.problem import Goal, JointGoal, Problem, frame_link

# Composite configurations tried in one round.
_MOST_COMPOSITES = 2000
# Rounds of further configurations of each arm if no composite configuration is free.
_ROUNDS = 3
# Starts of inverse kinematics for each pose or region goal.
_ATTEMPTS = 200
# Consecutive starts of inverse kinematics without another free configuration, after which it stops.
_PATIENCE = 20
# Configurations in collision whose depths are compared for a message; measuring one takes up to 10 ms.
_MOST_COMPARED = 12
# Separates the random stream from that of a planner with the same seed.
_STREAM = 0x5DEECE66D


@dataclass(frozen=True, eq=False)
class GoalSet:
    """Goal configurations of a problem.

    Args:
        configurations: Composite configurations within limits and free, nearest to the start first,
            shape (k, nq).
        status: None if there is one; INVALID_GOAL if all that reach the goal are out of limits or
            in collision, INFEASIBLE if none reaches it.
        reason: Why there is none; empty if there is one.
    """

    configurations: Array
    status: PlanStatus | None = None
    reason: str = ""


def check_start(problem: Problem, motion: CollisionChecker) -> str:
    """Why the start is invalid (joints out of limits, or contacts); empty if it is valid.

    Args:
        problem: The problem.
        motion: Collision checker of the problem's scene and moving arms.
    """
    excess = _start_excess(problem)
    if excess:
        return f"the start is out of limits: {excess}"
    if motion.is_free_ignoring(problem.start, frozenset()):
        return ""
    return f"the start is in collision: {describe_collision(motion, problem.start)}"


class GoalSearch:
    """Resumable search for free composite configurations that satisfy the goals of all moving arms.

    Args:
        problem: The problem.
        motion: Collision checker of the problem's scene and moving arms.
        rng: Generator or seed of inverse kinematics' random starts.
        max_per_goal: Most configurations of one pose or region goal.
        max_composites: Most configurations in all.

    Raises:
        InputError: a number below one.
    """

    def __init__(
        self,
        problem: Problem,
        motion: CollisionChecker,
        rng: Seed = None,
        *,
        max_per_goal: int = 8,
        max_composites: int = 32,
    ) -> None:
        if max_per_goal < 1:
            raise InputError(f"max_per_goal is {max_per_goal!r}, expected at least one")
        self._problem, self._motion = problem, motion
        self._most, self._most_composites = max_per_goal, max_composites
        state = random_state(as_seed(rng) ^ _STREAM)
        self._finders = [_Finder(problem, motion, arm, state) for arm in problem.arms]
        self._tried: set[bytes] = set()

    def find(self) -> GoalSet:
        """The first configurations, or why there are none."""
        for finder in self._finders:
            for goal in self._problem.goal[finder.arm]:
                finder.add(goal, self._most)
            if not finder.found:
                invalid = PlanStatus.INVALID_GOAL in finder.statuses
                status = PlanStatus.INVALID_GOAL if invalid else PlanStatus.INFEASIBLE
                return GoalSet(np.empty((0, self._problem.nq)), status, "; ".join(finder.reasons))
        free, blocked = self._combine()
        rounds = _ROUNDS
        while not free and rounds > 0:
            self._resume()
            free, rounds = self._combine()[0], rounds - 1
        if free:
            return GoalSet(read_only(np.array(free)))
        collision, tried = describe_collision(self._motion, blocked), len(self._tried)
        reason = f"the arms' goals collide with each other in all {tried} combinations tried: {collision}"
        return GoalSet(np.empty((0, self._problem.nq)), PlanStatus.INVALID_GOAL, reason)

    def more(self, *, turned_copies: bool = True) -> Array:
        """Further configurations after `find`, shape (k, nq).

        At most as many solutions of each goal as there, and copies of all solutions a turn away.

        Args:
            turned_copies: Whether to include copies, at which all links are in the same poses.
        """
        self._resume()
        for finder in self._finders if turned_copies else ():
            finder.add_turned_copies()
        return np.array(self._combine()[0]).reshape(-1, self._problem.nq)

    def _resume(self) -> None:
        for finder in self._finders:
            finder.resume(self._most)

    def _combine(self) -> tuple[list[Array], Array]:
        """New free composites of the arms' configurations, and one that is in collision."""
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
            if len(ranked) == 1 or self._motion.is_free_ignoring(q, frozenset()):
                free.append(q)
            elif tried == 1:
                blocked = q
        return free, blocked


def joint_goals(problem: Problem) -> Array | None:
    """Goal configurations (k, nq) of joint goals; None for other goals or alternatives of several arms."""
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


def _start_excess(problem: Problem) -> str:
    """Message about the joints of the start that are out of limits; empty if none is."""
    arms, start = problem.scene.arms, problem.start
    found = ((arm, describe_excess(arms[arm].robot, start[columns])) for arm, columns in problem.columns.items())
    return "; ".join(f"{arm}: {text}" for arm, text in found if text)


class _Finder:
    """Configurations of one arm that satisfy one of its goals, free when other moving arms are ignored."""

    def __init__(self, problem: Problem, motion: CollisionChecker, arm: str, state: RandomState) -> None:
        self.problem, self.motion, self.arm, self.state = problem, motion, arm, state
        self.robot: Robot = problem.scene.arms[arm].robot
        self.columns = problem.columns[arm]
        self.start = problem.start[self.columns]
        self.others = frozenset(problem.arms) - {arm}
        self.found: list[Array] = []
        self.unturned: list[Array] = []
        self.reasons: list[str] = []
        self.statuses: list[PlanStatus] = []
        self.searches: list[IkSearch] = []

    def add(self, goal: Goal, most: int) -> None:
        """Find the configurations of one goal, or record why there is none."""
        if isinstance(goal, JointGoal):
            self._add_configuration(goal.q)
            return
        link = f"{self.arm}/{frame_link(self.robot, goal.frame)}"
        chain = chain_of(self.motion.model.arm_model, link, self.columns.start)
        limits, columns, home = self.robot.limits, chain.joints[:, 1], self.start.copy()
        # Joints that do not move the frame stay where they are.
        home[columns] = self.robot.home[columns]
        seeds = np.clip([self.start, home], limits.lower, limits.upper)
        search = IkSearch(chain, self.robot, goal, seeds, self.state)
        self.searches.append(search)
        self._collect(search, most)
        if search.accepted:
            return
        if search.rejected:
            compared = search.rejected[:_MOST_COMPARED]
            least = min(compared, key=self._depth)
            found = counted(len(search.rejected), "configuration")
            among = f" of the first {len(compared)}" if len(compared) < len(search.rejected) else ""
            self._refuse(
                PlanStatus.INVALID_GOAL,
                f"the goal of {self.arm!r} is in collision in every configuration found ({found}); "
                f"the least deep{among}: {self._describe(least)}",
            )
        else:
            self._refuse(PlanStatus.INFEASIBLE, why_none(search, link))

    def resume(self, most: int) -> None:
        """Find further configurations of all goals."""
        for search in self.searches:
            self._collect(search, most)

    def add_turned_copies(self) -> None:
        """Add copies a turn away of the solutions found since the last call."""
        for q in self.unturned:
            self.found += [copy for copy in turned_copies(self.robot, q, self.start) if self._is_free(copy)]
        self.unturned.clear()

    def _collect(self, search: IkSearch, most: int) -> None:
        new = search.collect(_ATTEMPTS, self._is_free, most, _PATIENCE)
        self.found += new
        self.unturned += new

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
        """Whether q is free when other moving arms are ignored."""
        return self.motion.is_free_ignoring(self._composite(q), self.others)

    def _describe(self, q: Array) -> str:
        """Message about the contacts at q that do not involve other moving arms."""
        return describe_collision(self.motion, self._composite(q), self.others)

    def _depth(self, q: Array) -> float:
        """Depth of the deepest contact at q that does not involve other moving arms [m]."""
        contacts = contacts_without(self.motion, self._composite(q), self.others)
        return max((contact.depth for contact in contacts), default=0.0)

    def _composite(self, q: Array) -> Array:
        """The composite start with this arm at q."""
        composite: Array = self.problem.start.copy()
        composite[self.columns] = q
        return composite

    def _refuse(self, status: PlanStatus, reason: str) -> None:
        self.statuses.append(status)
        self.reasons.append(reason)


def _cheapest_first(costs: list[list[float]]) -> Iterator[tuple[int, ...]]:
    """Tuples of one index per (ascending) list of costs, by ascending sum of costs."""

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
