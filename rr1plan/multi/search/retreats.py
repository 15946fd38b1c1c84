"""Retreats: for each arm of a crowded group, a configuration in which it does not obstruct the others.

An arm that waits at its retreat on the way to its goal leaves room for all others. Candidates are sampled around the
straight line from the arm's start to its goal. Among those with the fewest conflicts with starts, goals and retreats of
other arms, the one with the shortest travel time is chosen.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import numpy as np

from rr1plan.checks import Array
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.kernels.planner_kernels import CStruct
from rr1plan.model.joint_space import Space
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.hop_timing import joint_times
from rr1plan.multi.paths.placed_path import placed_configurations
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.multi.timing.coordination import conflicts

# Random configurations that are sampled for a retreat, how many of them are tested against the starts and goals of
# other arms, and the clearance from these [m].
_DRAWN, _COMPARED, _ROOM = 64, 24, 0.03


class RetreatSearch:
    """Searches for retreats of some arms.

    Args:
        agent: All arms as one agent.
        goal: Their goal configuration, shape (nq,).
        single: The agent of each arm.
        near: For each arm, the arms that can collide with it.
        margin: Clearance from stationary objects, in addition to the padding [m].
        rng: Source of random numbers.
        watch: Stopwatch with the deadline.
    """

    def __init__(
        self,
        agent: Agent,
        goal: Array,
        single: Mapping[str, Agent],
        near: Mapping[str, frozenset[str]],
        margin: float,
        rng: np.random.Generator,
        watch: Stopwatch,
    ) -> None:
        self._agent, self._goal, self._margin, self._rng, self._watch = agent, goal, margin, rng, watch
        self._single = [single[arm] for arm in agent.arms]
        self._columns = list(agent.columns.values())
        self._near = [[k for k, other in enumerate(agent.arms) if other in near[arm]] for arm in agent.arms]
        self._space = Space.around(agent.query({}, margin), goal[None])

    def find(self) -> Array | None:
        """Retreats with few conflicts with starts, goals and each other, shape (nq,); None if time runs out."""
        retreats = self._agent.start.copy()
        placed = list(self._placed_ends)
        for arm in self._rng.permutation(len(placed)).tolist():
            if not self._watch.goes_on():
                return None
            agent, candidates = self._single[arm], self._candidates(arm)
            if len(candidates) == 0:
                continue
            own = placed_configurations(agent.bodies, candidates)
            number = np.zeros(len(candidates), np.int64)
            for other in self._near[arm]:
                number += np.count_nonzero(conflicts(agent, own, self._single[other], placed[other], _ROOM), axis=1)
            chosen = candidates[int(np.argmin(number))]
            retreats[self._columns[arm]] = chosen
            taken = np.stack([agent.start, self._goal[self._columns[arm]], chosen])
            placed[arm] = placed_configurations(agent.bodies, taken)
        return retreats

    @cached_property
    def _placed_ends(self) -> list[CStruct]:
        """The bodies of each arm at its start and at its goal."""
        return [
            placed_configurations(one.bodies, np.stack([one.start, self._goal[columns]]))
            for one, columns in zip(self._single, self._columns, strict=True)
        ]

    def _candidates(self, arm: int) -> Array:
        """Free configurations of an arm, home and random ones, by travel time from start to goal via each; (k, n)."""
        agent, columns = self._single[arm], self._columns[arm]
        drawn = self._drawn(arm)
        durations = sum(
            joint_times(drawn - end, agent.limits).max(axis=1) for end in (agent.start, self._goal[columns])
        )
        query = agent.query({}, self._margin)
        found: list[int] = []
        with checker_from_pool(query.scene, query.arms, self._margin) as checker:
            for number in np.argsort(durations, kind="stable").tolist():
                if checker.is_free(drawn[number]):
                    found.append(number)
                if len(found) == _COMPARED:
                    break
        return np.asarray(drawn[found])

    def _drawn(self, arm: int) -> Array:
        """Configurations of an arm within its limits: home, and random ones in growing boxes around the line."""
        agent, columns = self._single[arm], self._columns[arm]
        home = agent.problem.scene.arms[agent.arms[0]].robot.home
        wraps = self._space.wraps[columns]
        low = np.where(wraps, -np.pi, self._space.lower[columns])
        high = np.where(wraps, np.pi, self._space.upper[columns])
        begin, end = agent.start, self._goal[columns]
        middle = begin + self._rng.random((_DRAWN, 1)) * (end - begin)
        share = np.arange(1, _DRAWN + 1)[:, None] / _DRAWN
        drawn = np.clip(middle + share * (self._rng.uniform(low, high, (_DRAWN, len(low))) - middle), low, high)
        return np.concatenate([home[None], drawn]) if (low <= home).all() and (home <= high).all() else drawn
