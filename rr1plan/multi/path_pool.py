"""Path pools: several paths of one agent, found by the planner of single arms among others that stand still.

The first path of a pool knows nothing of the others. Later ones are detours: around the goals or the starts of others,
and through random configurations, which gives idle agents a way to step aside and come back.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rr1plan.checks import Array
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.errors import RetimingError
from rr1plan.multi.agent_path import AgentPath
from rr1plan.multi.agents import Agent
from rr1plan.path import Path
from rr1plan.planners import plan
from rr1plan.planners.shortcut import shorten
from rr1plan.planning import Budget
from rr1plan.scene.problem import JointGoal, Problem

_SHORTCUTS = 48
_ITERATIONS = 4000  # of the planner, for each arm of an agent
_SECONDS = 2.0
_MOST_ITERATIONS = 10**9  # of a search that only the time ends, which may be unlimited
_SAMPLES = 20  # random configurations that are tried for one to go through


class PathPool:
    """Paths of an agent.

    Args:
        agent: The agent.
        margin: Distance that they keep from all that stands still, beyond the padding [m].
        rng: Where random numbers come from.

    Attributes:
        paths: Those found so far.
    """

    def __init__(self, agent: Agent, margin: float, rng: np.random.Generator) -> None:
        self.agent, self.margin, self._rng = agent, margin, rng
        self.paths: list[AgentPath] = []

    def add(
        self, others: Mapping[str, Array | None], seconds: float, *, detour: bool = False, patient: bool = False
    ) -> tuple[AgentPath | None, str]:
        """Look for one more path.

        Args:
            others: Moving arms of the problem that it has to avoid, each in a configuration (nq,).
            seconds: When to give up [s].
            detour: Whether it has to go through a random configuration.
            patient: Whether to use all of the time; else a hard search is given up soon.

        Returns:
            The path, which is part of the pool now, or None and why there is none.
        """
        question = self.agent.question(others, self.margin)
        via = self._via(question) if detour else None
        if detour and via is None:
            return None, "no random configuration is free"
        legs = [question] if via is None else _split(question, via)
        seconds = max(seconds, 1e-3)
        budget = (
            Budget(seconds, _MOST_ITERATIONS)
            if patient
            else Budget(min(_SECONDS, seconds), _ITERATIONS * len(self.agent.arms))
        )
        points: list[Array] = []
        for leg in legs:
            result = plan(leg, budget=budget, rng=self._rng)
            if result.path is None:
                return None, result.reason
            points.append(result.path.waypoints)
        with checker_from_pool(question.scene, question.arms, self.margin) as checker:
            names, shorter = self.agent.joint_names, []
            for part in points:
                short = shorten(
                    Path(names, part), question.scene, checker=checker, iterations=_SHORTCUTS, rng=self._rng
                )
                shorter.append(short.waypoints)
            try:
                path = AgentPath(self.agent, Path(names, np.concatenate(shorter)), checker)
            except RetimingError as error:
                return None, str(error)
        self.paths.append(path)
        return path, ""

    def _via(self, question: Problem) -> Array | None:
        """A random free configuration, nearer ones more often."""
        limits = self.agent.limits
        goals = [self.agent.problem.goal[arm][0] for arm in self.agent.arms]
        ends = [g.q for g in goals if isinstance(g, JointGoal)]
        goal = np.concatenate(ends) if len(ends) == len(goals) else self.agent.start
        low = np.where(np.isfinite(limits.lower), limits.lower, -np.pi)
        high = np.where(np.isfinite(limits.upper), limits.upper, np.pi)
        with checker_from_pool(question.scene, question.arms, self.margin) as checker:
            for _ in range(_SAMPLES):
                middle = self.agent.start + self._rng.random() * (goal - self.agent.start)
                share = self._rng.random()
                q = np.clip(middle + share * (self._rng.uniform(low, high) - middle), low, high)
                if checker.is_free(q):
                    return np.asarray(q)
        return None


def _split(question: Problem, via: Array) -> list[Problem]:
    """From the start to a configuration, and from there to the goal."""
    scene, arms = question.scene, question.arms
    middle = scene.split(via, arms)
    begin = {name: q for name, q in scene.split(question.start, arms).items() if name in arms}
    between = {name: middle[name] for name in arms}
    return [
        Problem(scene, begin, between, arms=arms).with_margin(question.margin),
        Problem(scene, between, dict(question.goal), arms=arms).with_margin(question.margin),
    ]
