"""The motions of the arms of a running plan from an instant on, and when they block the path of another arm."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.collision.arm_groups import arms_in_reach
from rr1plan.kernels.planner_kernels import CStruct
from rr1plan.multi.agents import Agent
from rr1plan.multi.execution.running_plan import Part, RunningPlan
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.paths.hop_timing import HopTiming
from rr1plan.multi.paths.placed_path import placed_configuration
from rr1plan.multi.preflight import margins_up_to
from rr1plan.multi.timing.coordination import Blocked, are_apart, may_touch
from rr1plan.multi.timing.passing_order import closed_diagram
from rr1plan.multi.timing.safe_intervals import BlockedTimes, blocked_times
from rr1plan.object_cache import kept_in
from rr1plan.scene.problem import GoalLike, Problem


class PresentMotions:
    """The motions of all arms of a plan from an instant on.

    Args:
        plan: The plan.
        now: The instant [s].
        stop: A flag, shape (1,). Once another thread sets it, paths whose diagrams are not known count as blocked.

    Attributes:
        plan: Like the argument.
        now: Like the argument.
        parts: The parts of each arm from then on; those of arms that are planned anew may be replaced or missing.
    """

    def __init__(self, plan: RunningPlan, now: float, stop: NDArray[np.int64]) -> None:
        self.plan, self.now, self._stop = plan, now, stop
        self.parts: dict[str, tuple[Part, ...]] = {}
        for arm, parts in plan.parts.items():
            self.replace(arm, parts)
        self._near = arms_in_reach(plan.scene, plan.arms, plan.margin)
        self._margins = margins_up_to(plan.margin)
        self._diagrams: dict[tuple[AgentPath, AgentPath], Blocked | None] = {}
        self._placements: dict[tuple[tuple[str, ...], bytes], CStruct] = {}

    def replace(self, arm: str, parts: Iterable[Part]) -> None:
        """Give an arm another motion.

        Args:
            arm: The arm.
            parts: Its parts; those that are over are ignored.
        """
        self.parts[arm] = tuple(part for part in parts if part.end > self.now)

    @contextmanager
    def restored(self) -> Iterator[None]:
        """Restore all motions at the end of the block."""
        parts = dict(self.parts)
        try:
            yield
        finally:
            self.parts = parts

    def others(self, arm: str) -> list[str]:
        """Arms with a motion that can collide with an arm."""
        return [other for other in self.plan.arms if other in self._near[arm] and other in self.parts]

    def is_moving(self, arm: str) -> bool:
        """Whether an arm has not reached its goal at the instant."""
        return not np.array_equal(self.plan.configuration(arm, self.now), self.plan.goal(arm))

    def agent(self, arm: str, q: Array, goal: GoalLike) -> Agent:
        """An arm that moves from a configuration to a goal, without the others of the plan."""
        starts = {name: self.plan.configuration(name, self.now) for name in self.plan.arms}
        problem = Problem(self.plan.scene, {**starts, arm: q}, {arm: goal}, arms=self.plan.arms)
        return Agent(problem, [arm], HopTiming(self.plan.retiming, self.plan.torque_limits))

    def touched_at_end(self, agent: Agent, q: Array) -> set[str]:
        """Others that an arm in a configuration touches once they have arrived."""
        placed, touched = self._placed(agent, q), set()
        for other in self.others(agent.arms[0]):
            theirs = self.parts[other][-1].path
            if not are_apart(agent, placed, theirs.agent, self._placed(theirs.agent, theirs.goal)):
                touched.add(other)
        return touched

    def apart_from(self, agent: Agent, ends: Sequence[Array], time: float) -> dict[str, Array | None]:
        """Configurations of others, of those from which an arm keeps the plan's margin at both ends of its motion.

        Args:
            agent: The arm.
            ends: Its start, and its goal configurations, shape (nq,) each.
            time: When the others are there [s]; inf for their goals.
        """
        found: dict[str, Array | None] = {}
        for other in self.others(agent.arms[0]):
            theirs = self.parts[other][-1].path
            q = theirs.goal if math.isinf(time) else self.plan.configuration(other, time)
            there = self._placed(theirs.agent, q)
            if all(are_apart(agent, self._placed(agent, end), theirs.agent, there, self.plan.margin) for end in ends):
                found[other] = q
        return found

    def blocked_times(self, path: AgentPath, time: float, others: Iterable[str]) -> BlockedTimes:
        """Times from `time` on at which parts of a path are blocked by others."""
        found = []
        for other in others:
            for part in self.parts[other]:
                if part.end <= time:
                    continue
                blocked = self._diagram(path, part, time)
                if blocked is not None:
                    found.append((blocked, part.occupancy))
        return blocked_times(found)

    def _diagram(self, path: AgentPath, part: Part, time: float) -> Blocked | None:
        """The diagram with the largest margin that the arm and the other one have at rest."""
        key = (path, part.path)
        if key not in self._diagrams and not may_touch(path, part.path, self.plan.margin):
            self._diagrams[key] = None
        if key not in self._diagrams:
            one, two = path.agent, part.path.agent
            now = self.plan.configuration(two.arms[0], time)
            pairs = [(path.start, now), (path.goal, part.path.goal)] if math.isinf(part.end) else [(path.start, now)]
            placed = [(self._placed(one, a), self._placed(two, b)) for a, b in pairs]
            margin = next((m for m in self._margins if all(are_apart(one, a, two, b, m) for a, b in placed)), 0.0)
            self._diagrams[key] = closed_diagram(path, part.path, margin, stop=self._stop)
        return self._diagrams[key]

    def _placed(self, agent: Agent, q: Array) -> CStruct:
        """The bodies of an arm in a configuration, cached."""
        return kept_in(self._placements, (agent.arms, q.tobytes()), lambda: placed_configuration(agent.bodies, q))
