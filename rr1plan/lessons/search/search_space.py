"""The joint space of an arm as teaching planners see it: distances on the torus, samples and certified edges."""

from __future__ import annotations

import numpy as np

from rr1plan.checks import Array, of_kind
from rr1plan.collision import CollisionChecker
from rr1plan.errors import InputError
from rr1plan.scene.problem import JointGoal, Problem

# Distance below which two configurations are equal [rad or m].
_EQUAL = 1e-9


class SearchSpace:
    """Joint space of a problem of one arm.

    A continuous joint wraps: its difference is the shorter way around. Edges are certified by `CollisionChecker`, not
    sampled, and counted.

    Args:
        problem: One arm, a start, and a joint goal.

    Raises:
        InputError: several arms, another goal, a start or goal that is not free, or a joint without limits that does
            not wrap.
    """

    def __init__(self, problem: Problem) -> None:
        of_kind("problem", problem, Problem)
        if len(problem.arms) != 1:
            raise InputError(f"the problem moves {len(problem.arms)} arms, expected one")
        goal = problem.goal[problem.arms[0]][0]
        if not isinstance(goal, JointGoal):
            raise InputError(f"the goal is a {type(goal).__name__}, expected a JointGoal")
        arm = problem.scene.arms[problem.arms[0]]
        self.start, self.goal = np.array(problem.start), np.array(goal.q)
        self.joint_names = problem.joint_names
        self.wraps = np.asarray(arm.robot.continuous, dtype=bool)
        self.lower = np.where(self.wraps, -np.pi, arm.robot.limits.lower)
        self.upper = np.where(self.wraps, np.pi, arm.robot.limits.upper)
        if not np.isfinite(self.upper - self.lower).all():
            raise InputError("a joint has no limits and does not wrap, expected finite limits")
        self.checker = CollisionChecker(problem.scene, problem.arms)
        self.edges_checked = 0
        for name, q in (("start", self.start), ("goal", self.goal)):
            if not self.is_free(q):
                raise InputError(f"the {name} is not free; try another one")

    def difference(self, a: Array, b: Array) -> Array:
        """The shortest difference from a to b, b - a without whole turns [rad or m], shape (..., nq)."""
        delta = np.asarray(b - a)
        return np.where(self.wraps, (delta + np.pi) % (2.0 * np.pi) - np.pi, delta)

    def distance(self, a: Array, b: Array) -> Array:
        """Length of the shortest difference from a to b [rad or m], shape (...)."""
        return np.asarray(np.linalg.norm(self.difference(a, b), axis=-1))

    def is_goal(self, q: Array) -> bool:
        """Whether a configuration is the goal, up to whole turns and rounding."""
        return bool(self.distance(q, self.goal) <= _EQUAL)

    def steer(self, a: Array, b: Array, step: float) -> Array:
        """The point toward b along the shortest edge from a, at most `step` from a."""
        delta = self.difference(a, b)
        return self.wrapped(a + delta * min(1.0, step / max(float(np.linalg.norm(delta)), 1e-12)))

    def wrapped(self, q: Array) -> Array:
        """The same configuration with continuous joints in [-π, π)."""
        return np.where(self.wraps, (q + np.pi) % (2.0 * np.pi) - np.pi, q)

    def sample(self, rng: np.random.Generator) -> Array:
        """A uniformly distributed configuration, free or not."""
        return rng.uniform(self.lower, self.upper)

    def is_free(self, q: Array) -> bool:
        """Whether the configuration is within the limits and free of contact."""
        within = self.wraps | ((q >= self.lower) & (q <= self.upper))
        return bool(within.all() and self.checker.is_free(q))

    def edge_is_free(self, a: Array, b: Array) -> bool:
        """Whether every configuration on the shortest edge from a to b is certified free. Calls are counted."""
        self.edges_checked += 1
        return self.checker.edge_is_free(a, a + self.difference(a, b))

    def unwrapped(self, points: Array) -> Array:
        """A path (k, nq) whose continuous joints continue across the seam instead of jumping."""
        steps = self.difference(points[:-1], points[1:])
        return np.vstack([points[:1], points[0] + np.cumsum(steps, axis=0)])
