"""Seeded problems of many arms: random queries on a grid, swaps in a ring, two arms at a shelf.

All starts and goals are checked: each arm is free, and arms are apart from each other.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from rr1plan.checks import (
    Array,
    Seed,
    as_generator,
    finite_array,
    finite_number,
    of_kind,
    positive_number,
    whole_number,
)
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.errors import InputError
from rr1plan.kernels.planner_kernels import CStruct
from rr1plan.multi.agents import Agent
from rr1plan.multi.coordination import are_apart
from rr1plan.multi.interaction import arms_in_reach
from rr1plan.multi.placed_path import placed_configuration
from rr1plan.multi.preflight import goal_configurations
from rr1plan.robot import Robot
from rr1plan.scene import Scene
from rr1plan.scene.placement import place_grid, place_ring
from rr1plan.scene.problem import PoseGoal, Problem
from rr1plan.shapes.shapes import Box
from rr1plan.transforms import pose

_CLEARANCE = 2e-3  # of starts and goals [m]
_TRIES, _DRAWS = 1000, 200


def random_grid(robot: Robot, count: int, spacing: float, rng: Seed = None) -> Problem:
    """Arms on a grid, each from one random configuration to another over the full range of its joints.

    Args:
        robot: The robot all of them are; its joints have limits.
        count: How many.
        spacing: Distance between neighbors [m].
        rng: Seed.

    Raises:
        InputError: numbers that make no sense, or so narrow a grid that no free configurations are found.
    """
    of_kind("robot", robot, Robot)
    whole_number("count", count, 1, 10_000)
    for name, low, high in zip(robot.joint_names, robot.limits.lower, robot.limits.upper, strict=True):
        if not (math.isfinite(low) and math.isfinite(high)):
            raise InputError(f"joint {name!r} has no position limits to draw configurations from; set some")
    generator = as_generator(rng)
    rows = max(k for k in range(1, math.isqrt(count) + 1) if count % k == 0)
    scene = place_grid(robot, rows, count // rows, spacing=spacing)
    start = _random_configurations(scene, generator)
    return Problem(scene, start, _random_configurations(scene, generator))


def _random_configurations(scene: Scene, rng: np.random.Generator) -> dict[str, Array]:
    """A random free configuration of each arm, apart from all others."""
    near = arms_in_reach(scene, scene.arms, _CLEARANCE)
    anywhere = Problem(scene, None, {arm: scene.arms[arm].q for arm in scene.arms})
    agents = {arm: Agent(anywhere, [arm]) for arm in scene.arms}
    placed: dict[str, CStruct] = {}
    configurations: dict[str, Array] = {}
    waiting, rounds = list(agents), 0
    while waiting:
        arm = waiting.pop(0)
        others = [(agents[other], placed[other]) for other in near[arm] if other in placed]
        q = _free_among(agents[arm], others, rng)
        if q is not None:
            placed[arm], configurations[arm] = placed_configuration(agents[arm].bodies, q), q
            continue
        rounds += 1
        if rounds > _TRIES:
            raise InputError(f"no free configuration found for {arm!r} among the others; try a wider spacing")
        # Its neighbors may stand where its base is: they are drawn again.
        again = [other for other in agents if other in near[arm] and other in placed]
        for other in again:
            del placed[other]
        waiting = [arm, *again, *waiting]
    return {arm: configurations[arm] for arm in agents}


def _free_among(agent: Agent, others: list[tuple[Agent, CStruct]], rng: np.random.Generator) -> Array | None:
    """A random free configuration of an arm that is apart from others."""
    question = agent.question({}, 0.0)
    with checker_from_pool(question.scene, question.arms) as checker:
        for _ in range(_DRAWS):
            q = rng.uniform(agent.limits.lower, agent.limits.upper)
            if checker.clearance(q, 2.0 * _CLEARANCE) < _CLEARANCE:
                continue
            own = placed_configuration(agent.bodies, q)
            if all(are_apart(agent, own, other, placed, _CLEARANCE) for other, placed in others):
                return np.asarray(q)
    return None


def ring_swap(
    robot: Robot, count: int, radius: float, step: int = 1, rng: Seed = None, *, front: Array | None = None
) -> Problem:
    """Arms in a ring around a plank; the tool of each has to get where that of another one was.

    Args:
        robot: The robot all of them are.
        count: How many.
        radius: Radius of the circle of their bases [m].
        step: How many places farther its goal is: 1 for the neighbor's tool point, count // 2 for the opposite one.
        rng: Seed.
        front: Which way the robot's front points in its base frame, shape (3,) (default: -x, as RR1's).

    Raises:
        InputError: numbers that make no sense, or no configurations that are free and apart.
    """
    of_kind("robot", robot, Robot)
    whole_number("count", count, 2, 1000)
    whole_number("step", step, 1, 1000)
    radius = positive_number("radius", radius)
    generator = as_generator(rng)
    plank = Box((0.1 * radius, 0.5 * radius, 0.02))
    empty = Scene(name=f"ring of {count}").with_obstacle("plank", plank, (0.0, 0.0, 0.6 * radius))
    scene = place_ring(robot, count, radius, front=(-1.0, 0.0, 0.0) if front is None else front, scene=empty)
    reason = ""
    for _ in range(_TRIES // 10):
        angles = 2.0 * np.pi * np.arange(count) / count
        far = radius * generator.uniform(0.3, 0.6, count)
        height = radius * generator.uniform(0.2, 1.0, count)
        points = np.column_stack([far * np.cos(angles), far * np.sin(angles), height])
        starts, reason = _reaching(scene, dict(zip(scene.arms, points, strict=True)), generator)
        goals, reason = _reaching(scene, dict(zip(scene.arms, np.roll(points, -step, axis=0), strict=True)), generator)
        if starts and goals:
            return Problem(scene, starts, goals)
    raise InputError(f"no swap found in a ring of {count} arms of radius {radius} m: {reason}; try another radius")


def dual_arm_shelf(robot: Robot, spacing: float, rng: Seed = None, *, front: Array | None = None) -> Problem:
    """Two arms side by side before a shelf; each tool goes from one bay to another, which may be the other arm's.

    Args:
        robot: The robot both are.
        spacing: Distance between their bases [m].
        rng: Seed.
        front: Which way the robot's front points in its base frame, shape (3,) (default: -x, as RR1's).

    Raises:
        InputError: numbers that make no sense, or no configurations that are free and apart.
    """
    of_kind("robot", robot, Robot)
    spacing = positive_number("spacing", spacing)
    generator = as_generator(rng)
    ahead = np.array([-1.0, 0.0, 0.0]) if front is None else finite_array("front", front, (3,))
    yaw = finite_number("yaw", math.pi / 2.0 - math.atan2(ahead[1], ahead[0]))
    scene = Scene(name="dual-arm shelf")
    for k, side in enumerate((-0.5, 0.5), start=1):
        scene = scene.with_arm(f"arm{k:02d}", robot, pose((side * spacing, 0.0, 0.0), rpy=(0.0, 0.0, yaw)))
    for k in range(3):
        board = Box((2.0 * spacing, 0.3 * spacing, 0.02))
        scene = scene.with_obstacle(f"board{k + 1}", board, (0.0, 0.7 * spacing, (0.25 + 0.35 * k) * spacing))
    reason = ""
    for _ in range(_TRIES // 10):
        ends = []
        for _ in range(2):
            low, high = (-0.7, 0.5, 0.3), (0.7, 0.6, 0.9)
            points = spacing * generator.uniform(low, high, (2, 3))
            found, reason = _reaching(scene, dict(zip(scene.arms, points, strict=True)), generator)
            ends.append(found)
        if ends[0] and ends[1]:
            return Problem(scene, ends[0], ends[1])
    raise InputError(f"no query found at the shelf: {reason}; try another spacing")


def _reaching(scene: Scene, points: Mapping[str, Array], rng: np.random.Generator) -> tuple[dict[str, Array], str]:
    """Configurations of all arms with their tools at some points, apart from each other; or none, and why."""
    aims = {arm: PoseGoal("tool", point) for arm, point in points.items()}
    problem = Problem(scene, None, aims)
    agents = {arm: Agent(problem, [arm]) for arm in problem.arms}
    found, _, reason = goal_configurations(agents, arms_in_reach(scene, problem.arms, _CLEARANCE), rng)
    return found, reason
