"""Planar arms that block each other, and the search for moves of one arm at a time."""

from __future__ import annotations

import math

import numpy as np

import rr1plan as rp
from rr1plan.checks import Array
from rr1plan.collision.arm_groups import arms_in_reach
from rr1plan.multi.agents import Agent
from rr1plan.multi.search.retreats import RetreatSearch
from rr1plan.multi.search.sequential_moves import SequentialMoves
from rr1plan.multi.stopwatch import Stopwatch


def planar_ring(planar2r: rp.Robot, count: int) -> rp.Problem:
    """Arms in a ring, all tilted one way; each goal, tilted the other way, crosses the next one's start."""
    scene, start, goal = rp.Scene(), {}, {}
    for k in range(count):
        angle, name = 2.0 * np.pi * k / count, f"arm{k}"
        scene = scene.with_arm(name, planar2r, (1.7 * np.cos(angle), 1.7 * np.sin(angle), 0.0))
        start[name], goal[name] = [angle + np.pi + 0.35, 0.0], [angle + np.pi - 0.35, 0.0]
    return rp.Problem(scene, start, goal)


def goal_configuration(problem: rp.Problem) -> Array:
    """The goals of all arms, shape (nq,)."""
    goals = [goal.q for arm in problem.arms for goal in problem.goal[arm] if isinstance(goal, rp.JointGoal)]
    return np.concatenate(goals)


def sequential_moves(problem: rp.Problem, rng: np.random.Generator | int, seconds: float = math.inf) -> SequentialMoves:
    """The search for moves of one arm at a time."""
    near, watch = arms_in_reach(problem.scene, problem.arms, 0.0), Stopwatch(seconds)
    single = {arm: Agent(problem, [arm]) for arm in problem.arms}
    agent, goal = Agent(problem, problem.arms), goal_configuration(problem)
    generator = np.random.default_rng(rng)
    retreats = RetreatSearch(agent, goal, single, near, 0.0, generator, watch)
    return SequentialMoves(agent, goal, retreats, 0.0, generator, watch)
