"""Goal configurations of several arms without contact between the arms.

Each arm has one or more goal configurations, such as the solutions of inverse kinematics for a goal pose. Min-conflicts
repair finds a combination quickly (Minton, Johnston, Philips, Laird, Minimizing conflicts: a heuristic repair method
for constraint satisfaction and scheduling problems, 1992); where it fails, backtracking decides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.kernels.planner_kernels import CStruct
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.placed_path import placed_configurations
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.multi.timing.coordination import conflicts
from rr1plan.object_cache import kept_in
from rr1plan.planning import PlanStatus

# Largest number of rounds of the repair, of steps of the backtracking search, and of shuffles for another combination.
_REPAIRS, _STEPS, _SHUFFLES = 200, 20_000, 10


class GoalConflicts:
    """Contacts between goal configurations of different arms.

    Args:
        agents: The agent of each arm.
        choices: Goal configurations of each arm, shape (k, nq).
        near: For each arm, the arms that it can touch.
    """

    def __init__(
        self, agents: Mapping[str, Agent], choices: Mapping[str, Array], near: Mapping[str, frozenset[str]]
    ) -> None:
        self.choices, self._agents = choices, agents
        self._near = {arm: sorted(near[arm]) for arm in agents}
        self._touching: dict[tuple[str, str], NDArray[np.bool_]] = {}
        self._placed: dict[str, CStruct] = {}

    def _touch(self, arm: str, other: str) -> NDArray[np.bool_]:
        """Whether each goal configuration of one arm (rows) touches those of another one (columns)."""
        if (arm, other) not in self._touching:
            one, two = sorted((arm, other))
            touching = conflicts(self._agents[one], self._bodies(one), self._agents[two], self._bodies(two)) != 0
            self._touching[one, two], self._touching[two, one] = touching, touching.T
        return self._touching[arm, other]

    def _bodies(self, arm: str) -> CStruct:
        bodies = self._agents[arm].bodies
        return kept_in(self._placed, arm, lambda: placed_configurations(bodies, self.choices[arm]))

    def _count(self, arm: str, k: int, picked: Mapping[str, int]) -> int:
        """Number of other arms that a goal configuration touches in theirs, of those that have one."""
        return sum(bool(self._touch(arm, other)[k, picked[other]]) for other in self._near[arm] if other in picked)

    def touch(self, picked: Mapping[str, int]) -> bool:
        """Whether two arms are in contact in a combination of goal configurations."""
        return any(self._count(arm, k, picked) for arm, k in picked.items())

    def repaired(self, left: Mapping[str, Sequence[int]]) -> dict[str, int]:
        """For each arm one of the goal configurations left, with as few contacts as min-conflicts repair finds."""
        picked = {arm: numbers[0] for arm, numbers in left.items()}
        if all(len(numbers) == 1 for numbers in left.values()):
            return picked
        seen = set()
        for _ in range(_REPAIRS):
            movable = [arm for arm in picked if len(left[arm]) > 1 and self._count(arm, picked[arm], picked)]
            # The repair is deterministic: a repeated state means a cycle.
            state = tuple(picked.values())
            if not movable or state in seen:
                break
            seen.add(state)
            for arm in movable:
                contacts = [self._count(arm, k, picked) for k in left[arm]]
                picked[arm] = left[arm][contacts.index(min(contacts))]
        return picked

    def _is_possible(self, arm: str) -> NDArray[np.bool_]:
        """Whether each goal configuration of an arm touches not all those of another one."""
        touching = [self._touch(arm, other).all(axis=1) for other in self._near[arm]]
        return ~np.any(touching, axis=0) if touching else np.ones(len(self.choices[arm]), np.bool_)

    def combination(self, watch: Stopwatch | None = None) -> tuple[dict[str, Array] | None, bool]:
        """The first combination of goal configurations without contact, by backtracking.

        Returns:
            The configuration of each arm, or None if none was found; and whether the search is complete.
        """
        arms = sorted(self._agents, key=lambda arm: len(self.choices[arm]))
        if not all(self._is_possible(arm).any() for arm in arms):
            return None, True
        picked: dict[str, int] = {}
        following = [0]
        for _ in range(_STEPS):
            if watch is not None and not watch.goes_on():
                break
            arm = arms[len(following) - 1]
            picked.pop(arm, None)
            k = following[-1]
            if k == len(self.choices[arm]):
                following.pop()
                if not following:
                    return None, True
                continue
            following[-1] += 1
            if self._count(arm, k, picked):
                continue
            picked[arm] = k
            if len(picked) == len(arms):
                return {name: self.choices[name][picked[name]] for name in self._agents}, True
            following.append(0)
        return None, False


class GoalChoices:
    """Combinations of goal configurations, of which each arm can reach its own alone.

    Links of an arm, or objects around it, often separate the solutions of inverse kinematics.

    Args:
        conflicts: The goal configurations of each arm, and their contacts.
        reach: Function that returns whether an arm alone reaches a configuration with little effort: FOUND, INFEASIBLE
            if it provably does not, or another status.
    """

    def __init__(self, conflicts: GoalConflicts, reach: Callable[[str, Array], PlanStatus]) -> None:
        self.conflicts, self._reach = conflicts, reach
        self._left = {arm: list(range(len(found))) for arm, found in conflicts.choices.items()}
        self._reached: set[tuple[str, int]] = set()
        # Neither reached with little effort nor proven unreachable; preferred ones first.
        self._hard: dict[str, list[int]] = {arm: [] for arm in self._left}
        self._first: dict[str, int] = {}

    @property
    def several(self) -> frozenset[str]:
        """Arms with several goal configurations that they may reach."""
        return frozenset(arm for arm, numbers in self._left.items() if len(numbers) > 1)

    @property
    def configurations(self) -> dict[str, Array]:
        """The goal configurations of each arm that it may reach, shape (k, nq)."""
        return {arm: self.conflicts.choices[arm][numbers] for arm, numbers in self._left.items()}

    def first(self) -> dict[str, Array]:
        """A goal configuration of each arm, with few contacts; near ones are preferred."""
        self._first = self._pick({arm: list(numbers) for arm, numbers in self._left.items()})
        return self._configurations(self._first)

    def use(self, chosen: Mapping[str, Array]) -> None:
        """Replace the first combination.

        Args:
            chosen: One of the goal configurations of each arm, shape (nq,).
        """
        self._first = {
            arm: next(k for k, q in enumerate(self.conflicts.choices[arm]) if np.array_equal(q, own))
            for arm, own in chosen.items()
        }

    def other(self, arms: Iterable[str], rng: np.random.Generator) -> dict[str, Array] | None:
        """The first combination with random other goal configurations of some arms, without contact; None if not found.

        Args:
            arms: The arms.
            rng: Source of random numbers.
        """
        changed = sorted(self.several.intersection(arms))
        for _ in range(_SHUFFLES if changed else 0):
            order = {arm: [k] for arm, k in self._first.items()}
            order |= {arm: rng.permutation(self._left[arm]).tolist() for arm in changed}
            picked = self._pick(order)
            if picked != self._first and not self.conflicts.touch(picked):
                return self._configurations(picked)
        return None

    def _configurations(self, picked: Mapping[str, int]) -> dict[str, Array]:
        return {arm: self.conflicts.choices[arm][k] for arm, k in picked.items()}

    def _pick(self, order: dict[str, list[int]]) -> dict[str, int]:
        """A combination with few contacts, without configurations that an arm does not reach.

        Args:
            order: The goal configurations of each arm that may be picked, the preferred one first; it is modified.
        """
        while True:
            picked = self.conflicts.repaired(order)
            missed = []
            for arm, k in picked.items():
                only = len(order[arm]) == 1 and not (self._hard[arm] and self._left[arm] == [k])
                if only or (arm, k) in self._reached:
                    continue
                status = self._reach(arm, self.conflicts.choices[arm][k])
                if status is PlanStatus.FOUND:
                    self._reached.add((arm, k))
                    continue
                missed.append(arm)
                if status is not PlanStatus.INFEASIBLE:
                    self._hard[arm].append(k)
            if not missed:
                return picked
            for arm in missed:
                order[arm].remove(picked[arm])
                self._left[arm].remove(picked[arm])
                if not order[arm]:  # none was reached: the preferred one that is not proven unreachable
                    k = self._hard[arm][0]
                    self._reached.add((arm, k))
                    order[arm].append(k)
                    self._left[arm].append(k)
