"""Goal configurations of an arm that it may reach earlier than its present one, searched while a plan is improved."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.multi.agents import Agent
from rr1plan.planners.goal_configurations import GoalSearch


class NearerGoals:
    """The goal configurations of one arm with poses, regions or several goals.

    Args:
        agent: The arm, in the problem with all of its goals.
        seed: Seed of inverse kinematics.
    """

    def __init__(self, agent: Agent, seed: int) -> None:
        self._agent, self._seed = agent, seed
        self._found: list[Array] = []

    @cached_property
    def _search(self) -> GoalSearch:
        query = self._agent.query({}, 0.0)
        return GoalSearch(query, CollisionChecker(query.scene, query.arms), self._seed)

    def before(self, arrival: float) -> Array:
        """Configurations that a motion may reach earlier than at a time, after a search for more, shape (k, nq).

        Args:
            arrival: The time [s].
        """
        first = not self._found
        self._found.append(self._search.find().configurations if first else self._search.more(turned_copies=False))
        found = np.concatenate(self._found)
        joint_times = np.abs(found - self._agent.start) / self._agent.limits.velocity
        return np.asarray(found[joint_times.max(axis=1) < arrival])
