"""Seeded problems of many arms: random queries on a grid, reaches on a table, swaps in a ring, two arms at a shelf.

All starts and goals are checked: no arm touches the scene or another arm. Problems in work cells with more obstacles
are in `workcell_problems.py`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from rr1plan.checks import Array, Seed, as_generator, items_of, of_kind, positive_number, whole_number
from rr1plan.collision.arm_groups import arms_in_reach
from rr1plan.errors import InputError
from rr1plan.multi.agents import Agent
from rr1plan.multi.preflight import goal_configurations
from rr1plan.multi.scenarios.endpoint_sampling import (
    CLEARANCE,
    Draw,
    ToolBox,
    check_fixed_links,
    check_position_limits,
    check_reach,
    floor_under,
    front_of,
    horizontal_reach,
    problem_between,
    sample_configurations,
    tool_in_box,
)
from rr1plan.robot import Robot
from rr1plan.scene import Scene
from rr1plan.scene.placement import place_grid, place_ring
from rr1plan.scene.problem import PoseGoal, Problem
from rr1plan.shapes.shapes import Box
from rr1plan.transforms import pose

_ATTEMPTS = 100  # at a ring or a shelf
# Attempts at a ring after which it is abandoned if in none of them all arms reached their starts or all reached their
# goals: if that succeeds in at most one of ten, they hardly ever reach both.
_HOPELESS = 25
# Attempts at a ring with swaps across it, and the box for each arm's tool in this case, as shares of the radius: along
# the line from the center to the arm, across it, and up.
_CROSSINGS, _ACROSS = 10, ((-0.1, -0.25, 0.2), (0.1, 0.25, 1.3))


def random_grid(robot: Robot | Sequence[Robot], count: int, spacing: float, rng: Seed = None) -> Problem:
    """Arms on a grid, each from one random configuration to another over the full range of its joints.

    Args:
        robot: The robot of all arms, whose joints have limits; or several robots, used alternately.
        count: Number of arms.
        spacing: Distance between neighbors [m].
        rng: Seed.

    Raises:
        InputError: numbers out of range, or so narrow a grid that no free configurations are found.
    """
    scene = _grid(robot, count, positive_number("spacing", spacing))
    generator = as_generator(rng)
    start = sample_configurations(scene, generator)
    return problem_between(scene, start, sample_configurations(scene, generator), generator)


def reach_grid(robot: Robot | Sequence[Robot], count: int, spacing: float, rng: Seed = None) -> Problem:
    """Arms on a grid on a table, with random headings; each tool moves from one point above the table to another.

    Points are in front of an arm, up to nine tenths of its reach away, and from 5 cm (for arms with a reach below 20
    cm, a quarter of it) to half its reach above the table, so that many are within reach of other arms.

    Args:
        robot: As in `random_grid`.
        count: As in `random_grid`.
        spacing: As in `random_grid`.
        rng: As in `random_grid`.

    Raises:
        InputError: numbers out of range, a robot that does not reach these points, or so narrow a grid that no free
            configurations are found.
    """
    scene = _grid(robot, count, positive_number("spacing", spacing))
    generator = as_generator(rng)
    for name, arm in scene.arms.items():
        turned = arm.base @ pose((0.0, 0.0, 0.0), rpy=(0.0, 0.0, float(generator.uniform(-math.pi, math.pi))))
        scene = scene.with_arm(name, arm.robot, turned)
    scene = scene.with_obstacle("table", floor_under(*(arm.robot for arm in scene.arms.values())))
    draws = {}
    for name, arm in scene.arms.items():
        far = horizontal_reach(arm.robot)
        ahead = front_of(arm.robot)
        turn = pose((0.0, 0.0, 0.0), rpy=(0.0, 0.0, math.atan2(ahead[1], ahead[0])))
        low, high = (0.25 * far, -0.4 * far, min(0.05, 0.25 * far)), (0.8 * far, 0.4 * far, 0.5 * far)
        box = ToolBox(arm.base @ turn, low, high)
        draws[name] = tool_in_box(scene, name, box)
        check_reach(arm.robot, box, draws[name])
    start = sample_configurations(scene, generator, draws)
    return problem_between(scene, start, sample_configurations(scene, generator, draws), generator, draws)


def _grid(robot: Robot | Sequence[Robot], count: int, spacing: float) -> Scene:
    """Arms of one or several robots on a grid, as square as their number allows."""
    robots = (robot,) if isinstance(robot, Robot | str) else items_of("robot", robot, "robots")
    if not robots:
        raise InputError("robot is an empty sequence, expected at least one Robot")
    for one in robots:
        check_position_limits(one)
    whole_number("count", count, 1, 10_000)
    rows = max(k for k in range(1, math.isqrt(count) + 1) if count % k == 0)
    scene = place_grid(robots[0], rows, count // rows, spacing=spacing, scene=Scene(name=f"grid of {count}"))
    if len(robots) == 1:
        return scene
    for k, (name, arm) in enumerate(scene.arms.items()):
        scene = scene.with_arm(name, robots[k % len(robots)], arm.base)
    return scene


def ring_swap(
    robot: Robot, count: int, radius: float, step: int = 1, rng: Seed = None, *, front: ArrayLike | None = None
) -> Problem:
    """Arms in a ring around a plank; the tool of each has to reach the start position of another arm's tool.

    Args:
        robot: The robot of all arms.
        count: Number of arms.
        radius: Radius of the circle of their bases [m].
        step: Number of places to the arm whose tool point is the goal: 1 for the neighbor, count // 2 for the opposite
            one; for arms other than neighbors, tool points are nearer to the center.
        rng: Seed.
        front: Direction of the robot's front in its base frame, shape (3,) (default: the axis nearest to its tool at
            home).

    Raises:
        InputError: numbers out of range, or no collision-free configurations of all arms.
    """
    of_kind("robot", robot, Robot)
    whole_number("count", count, 2, 1000)
    whole_number("step", step, 1, 1000)
    if step % count == 0:
        raise InputError(f"step is {step}, a multiple of {count} arms, so that nothing moves; try step 1")
    radius = positive_number("radius", radius)
    generator = as_generator(rng)
    plank = Box((0.1 * radius, 0.5 * radius, 0.02))
    empty = Scene(name=f"ring of {count}").with_obstacle("plank", plank, (0.0, 0.0, 0.6 * radius))
    scene = place_ring(robot, count, radius, front=front_of(robot, front), scene=empty)
    check_fixed_links(scene, "try a larger radius")
    if step % count not in (1, count - 1):
        return _swap_across(scene, radius, step, generator)
    reason, reached = "", False
    for attempt in range(1, _ATTEMPTS + 1):
        angles = 2.0 * np.pi * np.arange(count) / count
        far = radius * generator.uniform(0.3, 0.6, count)
        height = radius * generator.uniform(0.2, 1.0, count)
        points = np.column_stack([far * np.cos(angles), far * np.sin(angles), height])
        starts, no_start = _reaching(scene, dict(zip(scene.arms, points, strict=True)), generator)
        ends = dict(zip(scene.arms, np.roll(points, -step, axis=0), strict=True))
        goals, no_goal = _reaching(scene, ends, generator)
        if starts and goals:
            try:
                return problem_between(scene, starts, goals, generator, _draws_at(scene, ends))
            except InputError as error:
                no_goal = str(error).partition(";")[0]
        reason, reached = no_start or no_goal, reached or bool(starts or goals)
        if attempt == _HOPELESS and not reached:
            break
    raise InputError(
        f"no swap found in a ring of {count} arms of radius {radius:g} m in {attempt} attempts: {reason}; "
        "try another radius"
    )


def _swap_across(scene: Scene, radius: float, step: int, rng: np.random.Generator) -> Problem:
    """A swap of tool points with arms farther away, at points near the center, each within reach of two arms."""
    arms, reason = list(scene.arms), ""
    for _ in range(_CROSSINGS):
        try:
            draws = {}
            for k, arm in enumerate(arms):
                ahead = pose((0.0, 0.0, 0.0), rpy=(0.0, 0.0, 2.0 * math.pi * k / len(arms)))
                low, high = (radius * np.array(corner) for corner in _ACROSS)
                draws[arm] = tool_in_box(scene, arm, ToolBox(ahead, tuple(low.tolist()), tuple(high.tolist())))
            starts = sample_configurations(scene, rng, draws)
            poses = scene.link_poses(starts)
            for k, arm in enumerate(arms):
                other = arms[(k + step) % len(arms)]
                place = poses[f"{other}/{scene.arms[other].robot.tool}"]
                draws[arm] = tool_in_box(scene, arm, ToolBox(place, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
            return problem_between(scene, starts, sample_configurations(scene, rng, draws), rng, draws)
        except InputError as error:
            reason = str(error).partition(";")[0]
    raise InputError(
        f"no swap found in a ring of {len(arms)} arms of radius {radius:g} m: {reason}; try another radius"
    )


def dual_arm_shelf(robot: Robot, spacing: float, rng: Seed = None, *, front: ArrayLike | None = None) -> Problem:
    """Two arms side by side in front of a shelf; each tool moves from one bay to another, which may be the other arm's.

    Args:
        robot: The robot of both arms.
        spacing: Distance between their bases [m].
        rng: Seed.
        front: As in `ring_swap`.

    Raises:
        InputError: numbers out of range, or no collision-free configurations of all arms.
    """
    of_kind("robot", robot, Robot)
    spacing = positive_number("spacing", spacing)
    generator = as_generator(rng)
    ahead = front_of(robot, front)
    yaw = math.pi / 2.0 - math.atan2(ahead[1], ahead[0])
    scene = Scene(name="dual-arm shelf")
    for k, side in enumerate((-0.5, 0.5), start=1):
        scene = scene.with_arm(f"arm{k:02d}", robot, pose((side * spacing, 0.0, 0.0), rpy=(0.0, 0.0, yaw)))
    for k in range(3):
        board = Box((2.0 * spacing, 0.3 * spacing, 0.02))
        scene = scene.with_obstacle(f"board{k + 1}", board, (0.0, 0.7 * spacing, (0.25 + 0.35 * k) * spacing))
    check_fixed_links(scene, "try a wider spacing")
    reason = ""
    for _ in range(_ATTEMPTS):
        ends = []
        for _ in range(2):
            low, high = (-0.7, 0.5, 0.3), (0.7, 0.6, 0.9)
            points = dict(zip(scene.arms, spacing * generator.uniform(low, high, (2, 3)), strict=True))
            found, no_end = _reaching(scene, points, generator)
            ends.append(found)
            reason = no_end or reason
        if ends[0] and ends[1]:
            try:
                return problem_between(scene, ends[0], ends[1], generator, _draws_at(scene, points))
            except InputError as error:
                reason = str(error).partition(";")[0]
    raise InputError(f"no query found at the shelf: {reason}; try another spacing")


def _reaching(scene: Scene, points: Mapping[str, Array], rng: np.random.Generator) -> tuple[dict[str, Array], str]:
    """Collision-free configurations of all arms with their tools at given points; or none, and the reason."""
    aims = {arm: PoseGoal("tool", point) for arm, point in points.items()}
    problem = Problem(scene, None, aims)
    agents = {arm: Agent(problem, [arm]) for arm in problem.arms}
    found, _, reason = goal_configurations(agents, arms_in_reach(scene, problem.arms, CLEARANCE), rng)
    return found, reason


def _draws_at(scene: Scene, points: Mapping[str, Array]) -> dict[str, Draw]:
    """Samplers for configurations of all arms with their tools at given points."""
    here = (0.0, 0.0, 0.0)
    return {arm: tool_in_box(scene, arm, ToolBox(pose(point), here, here)) for arm, point in points.items()}
