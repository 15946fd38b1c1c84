"""Starts and goals of many arms for seeded problems: random, or with tools in regions; all collision-free."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rr1plan.checks import Array, Seed, as_generator, finite_array, of_kind
from rr1plan.collision import CollisionChecker
from rr1plan.collision.arm_groups import arms_in_reach
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.errors import InputError
from rr1plan.kernels.planner_kernels import CStruct
from rr1plan.model import Kinematics, solve_ik
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.placed_path import placed_configuration
from rr1plan.multi.preflight import MARGINS
from rr1plan.multi.timing.coordination import are_apart
from rr1plan.planners.joint_barriers import find_joint_barrier
from rr1plan.robot import Robot
from rr1plan.robot.bounding_boxes import bounding_box
from rr1plan.robot.contact_bands import contact_bands
from rr1plan.robot.link_contacts import LinkBodies
from rr1plan.scene import Scene
from rr1plan.scene.problem import PoseGoal, Problem
from rr1plan.shapes.shapes import HalfSpace
from rr1plan.transforms import pose

CLEARANCE = 2e-3
"""Smallest distance of starts and goals from all bodies that do not move with them [m]."""

Draw = Callable[[np.random.Generator], Array | None]
"""Draws a configuration of one arm, shape (nq,); None on failure."""


class ToolBox(NamedTuple):
    """A region for the tool of an arm at the start or the goal.

    Args:
        frame: Frame of the box in the world, shape (4, 4).
        low: Its lowest corner in that frame [m].
        high: Its highest corner [m].
    """

    frame: Array
    low: tuple[float, float, float]
    high: tuple[float, float, float]


_ROUNDS, _DRAWS = 1000, 200
# With inverse kinematics, which takes longer but finds free space if there is any.
_BOX_ROUNDS, _BOX_DRAWS = 30, 60
_REDRAWS = 100  # of a goal that its arm cannot reach
_STARTS = 20  # of inverse kinematics for a point
_SAMPLES = 400  # configurations for estimating the reach of a robot


def sample_configurations(
    scene: Scene,
    rng: np.random.Generator,
    draws: Mapping[str, Draw] | None = None,
    *,
    advice: str = "try a wider spacing",
) -> dict[str, Array]:
    """A configuration of each arm, without contact with the scene or another arm.

    Args:
        scene: The arms and obstacles.
        rng: Generator.
        draws: Samplers for configurations of arms; for arms without one, all joints are drawn over their full ranges.
        advice: Advice for the message if none are found.

    Raises:
        InputError: no configuration was found; names the arm.
    """
    near = arms_in_reach(scene, scene.arms, CLEARANCE)
    anywhere = Problem(scene, None, {arm: scene.arms[arm].q for arm in scene.arms})
    agents = {arm: Agent(anywhere, [arm]) for arm in scene.arms}
    samplers = {arm: (draws or {}).get(arm) or _anywhere(scene.arms[arm].robot) for arm in agents}
    placed: dict[str, CStruct] = {}
    configurations: dict[str, Array] = {}
    waiting, failures = list(agents), 0
    rounds, tries = (_BOX_ROUNDS, _BOX_DRAWS) if draws else (_ROUNDS, _DRAWS)
    while waiting:
        arm = waiting.pop(0)
        others = [(agents[other], placed[other]) for other in near[arm] if other in placed]
        q = _free_among(agents[arm], others, samplers[arm], tries, rng)
        if q is not None:
            placed[arm], configurations[arm] = placed_configuration(agents[arm].bodies, q), q
            continue
        failures += 1
        if failures == 1:
            check_fixed_links(scene, advice)
        if failures > rounds or (not others and draws):
            among = " among the others" if others else ""
            raise InputError(f"no free configuration found for {arm!r}{among}; {advice}")
        # Its neighbors may be at the place of its base: they are drawn again.
        again = [other for other in agents if other in near[arm] and other in placed]
        for other in again:
            del placed[other]
        waiting = [arm, *again, *waiting]
    return {arm: configurations[arm] for arm in agents}


def check_fixed_links(scene: Scene, advice: str) -> None:
    """Reject a scene in which stationary parts touch each other, such as bases of neighbors.

    Args:
        scene: The scene.
        advice: Advice at the end of the message.

    Raises:
        InputError: some parts touch; names two of them.
    """
    touching = CollisionChecker(scene, tuple(scene.arms)).static_contacts
    if touching:
        raise InputError(f"{touching[0][0]} and {touching[0][1]} touch each other, and neither moves; {advice}")


def tool_in_box(scene: Scene, arm: str, box: ToolBox) -> Draw:
    """Draw configurations with an arm's tool at random points of a box, in any orientation.

    Args:
        scene: The arms and obstacles.
        arm: The arm.
        box: The box.
    """
    kinematics = Kinematics(Scene({arm: scene.arms[arm]}))
    robot = scene.arms[arm].robot
    low, high = one_turn(robot)

    def draw(rng: np.random.Generator) -> Array | None:
        point = box.frame[:3, :3] @ rng.uniform(box.low, box.high) + box.frame[:3, 3]
        seed = rng.uniform(low, high)
        found = solve_ik(
            kinematics, PoseGoal("tool", point), seeds=seed, attempts=_STARTS, max_solutions=1, rng=rng
        ).solutions
        return _turned_back(robot, np.asarray(found[0])) if len(found) else None

    return draw


def check_reach(robot: Robot, box: ToolBox, draw: Draw) -> None:
    """Reject a robot whose tool reaches no point of a box.

    Args:
        robot: The robot.
        box: The box.
        draw: Its sampler.

    Raises:
        InputError: all of `_BOX_DRAWS` random points are out of reach.
    """
    rng = np.random.default_rng(0)
    if all(draw(rng) is None for _ in range(_BOX_DRAWS)):
        corners = np.array([box.low, box.high]) @ box.frame[:3, :3].T + box.frame[:3, 3]
        low, high = (
            "[{:.3g}, {:.3g}, {:.3g}]".format(*corner) for corner in (corners.min(axis=0), corners.max(axis=0))
        )
        raise InputError(
            f"the tool {robot.tool!r} of {robot.name!r} reaches none of {_BOX_DRAWS} random points from {low} to "
            f"{high} m, where it starts or ends; try another robot or tool"
        )


def _anywhere(robot: Robot) -> Draw:
    low, high = one_turn(robot)
    return lambda rng: np.asarray(rng.uniform(low, high))


def one_turn(robot: Robot) -> tuple[Array, Array]:
    """The sampling ranges of configurations: those of the joints, limited to half a turn on either side of home.

    Of two configurations a whole turn of a joint apart, one often cannot be reached from the other, because a floor or
    the arm itself is in between.

    Args:
        robot: A robot whose prismatic joints have limits.

    Returns:
        Lower and upper ends, shape (nq,) each.
    """
    lower, upper = robot.limits.lower, robot.limits.upper
    kinds = {joint.name: joint.kind for joint in robot.joints}
    is_revolute = np.array([kinds[name] != "prismatic" for name in robot.joint_names], np.bool_)
    turns = is_revolute & (upper - lower > 2.0 * np.pi)
    return (
        np.where(turns, np.maximum(lower, robot.home - np.pi), lower),
        np.where(turns, np.minimum(upper, robot.home + np.pi), upper),
    )


def _turned_back(robot: Robot, q: Array) -> Array:
    """The same configuration, with joints whose range exceeds one turn as near to home as their limits allow."""
    low, high = one_turn(robot)
    turned = q - 2.0 * np.pi * np.round((q - robot.home) / (2.0 * np.pi))
    return np.asarray(np.where((q < low) | (q > high), np.where((turned >= low) & (turned <= high), turned, q), q))


def problem_between(
    scene: Scene,
    starts: Mapping[str, Array],
    goals: Mapping[str, Array],
    rng: Seed = None,
    draws: Mapping[str, Draw] | None = None,
) -> Problem:
    """The problem of all arms, without goals that a joint cannot reach because of obstacles in between.

    A robot on a floor can move its upper arm from one side to the other only over the top, and the shapes of two links
    may block each other. Such a goal is shifted by a whole turn if that makes it reachable, and is drawn again
    otherwise.

    Args:
        scene: The arms and obstacles.
        starts: Start of each arm, shape (nq,).
        goals: Goal of each arm, shape (nq,).
        rng: Seed for redrawn goals.
        draws: Samplers for goals of arms; for arms without one, all joints are drawn over their full ranges.

    Raises:
        InputError: no goal was found that an arm can reach.
    """
    given, ends, generator = Problem(scene, starts, goals), dict(goals), as_generator(rng)
    agents = {arm: Agent(given, [arm]) for arm in given.arms}
    near = arms_in_reach(scene, given.arms, CLEARANCE)
    for arm, agent in agents.items():
        end = _on_reachable_turn(agent, starts[arm], goals[arm])
        if end is None:
            others = [(agents[one], placed_configuration(agents[one].bodies, ends[one])) for one in near[arm]]
            draw = (draws or {}).get(arm) or _anywhere(scene.arms[arm].robot)
            for _ in range(_REDRAWS):
                q = _free_among(agent, others, draw, _BOX_DRAWS, generator)
                end = None if q is None else _on_reachable_turn(agent, starts[arm], q)
                if end is not None:
                    break
            else:
                raise InputError(f"no goal found that {arm!r} can reach from its start; try another seed")
        ends[arm] = np.asarray(end)
    return Problem(scene, starts, ends)


def _on_reachable_turn(agent: Agent, start: Array, goal: Array) -> Array | None:
    """A goal of an arm, or the same goal a turn of a joint away; None if neither can be reached from a start."""
    barred = _barred_joint(agent, start, goal)
    if barred is None:
        return goal
    other = goal.copy()
    other[barred] -= math.copysign(2.0 * np.pi, other[barred] - start[barred])
    is_within = agent.limits.lower[barred] <= other[barred] <= agent.limits.upper[barred]
    return other if is_within and _barred_joint(agent, start, other) is None else None


def _barred_joint(agent: Agent, start: Array, goal: Array) -> int | None:
    """A joint of an arm that links of the arm or stationary objects block between a start and a goal."""
    (arm,) = agent.arms
    robot = agent.problem.scene.arms[arm].robot
    for joint, low, high in _own_bands(robot):
        if min(start[joint], goal[joint]) < low and max(start[joint], goal[joint]) > high:
            return joint
    query = agent.query({}, 0.0)
    with checker_from_pool(query.scene, query.arms) as checker:
        barrier = find_joint_barrier(checker, start, goal)
        return None if barrier is None else checker.joint_names.index(barrier.joint)


@lru_cache(maxsize=64)
def _own_bands(robot: Robot) -> tuple[tuple[int, float, float], ...]:
    """Intervals of joints in which links of a robot touch each other: joint, lower and upper end [rad or m]."""
    bodies, alone = LinkBodies(robot), Scene().with_arm("arm", robot)
    pairs = [pair for pair in bodies.pairs if not alone.may_touch(*(f"arm/{link}" for link in pair))]
    bands = contact_bands(robot, pairs, np.random.default_rng(0), bodies)
    return tuple((robot.joint_names.index(band.joint), band.lower, band.upper) for band in bands)


def _free_among(
    agent: Agent, others: list[tuple[Agent, CStruct]], draw: Draw, tries: int, rng: np.random.Generator
) -> Array | None:
    """A configuration of an arm without contact with the scene or other arms."""
    query = agent.query({}, 0.0)
    needed = max(_own_clearance(agent.problem.scene.arms[arm].robot) for arm in agent.arms)
    with checker_from_pool(query.scene, query.arms) as checker:
        for _ in range(tries if checker.static_is_free else 0):
            q = draw(rng)
            # A base may be nearer to the floor.
            if q is None or checker.moving_clearance(q, 2.0 * CLEARANCE) < needed:
                continue
            own = placed_configuration(agent.bodies, q)
            if all(are_apart(agent, own, other, placed, CLEARANCE) for other, placed in others):
                return np.asarray(q)
    return None


@lru_cache(maxsize=64)
def _own_clearance(robot: Robot) -> float:
    """`CLEARANCE`, or less if links of a robot are nearer to each other in nearly all configurations [m]."""
    checker, low_high = CollisionChecker(Scene().with_arm("arm", robot)), one_turn(robot)
    drawn = np.random.default_rng(0).uniform(*low_high, (_SAMPLES, robot.nq))
    usual = float(np.quantile([checker.moving_clearance(q, CLEARANCE) for q in drawn], 0.9))
    return next((margin for margin in MARGINS if margin <= usual), MARGINS[-1])


def check_position_limits(robot: Robot) -> None:
    """Reject a robot for which no configurations can be drawn.

    Raises:
        InputError: not a robot, or one with prismatic joints without position limits.
    """
    of_kind("robot", robot, Robot)
    for name, low, high in zip(robot.joint_names, *one_turn(robot), strict=True):
        if not (math.isfinite(low) and math.isfinite(high)):
            raise InputError(f"joint {name!r} has no position limits to draw configurations from; set some")


def front_of(robot: Robot, front: ArrayLike | None = None) -> Array:
    """Direction of a robot's front in its base frame: as given, or the horizontal axis nearest to its tool at home.

    Args:
        robot: The robot.
        front: A direction, shape (3,); None finds one.

    Raises:
        InputError: a direction that is vertical or not finite.
    """
    if front is None:
        tool = robot.link_poses(robot.home)[robot.tool][:2, 3]
        axis = int(np.argmax(np.abs(tool)))
        ahead = np.zeros(3)
        ahead[axis] = -1.0 if tool[axis] < 0.0 else 1.0
        return ahead
    ahead = finite_array("front", front, (3,))
    if math.hypot(ahead[0], ahead[1]) < 1e-9:
        raise InputError(f"front is {ahead.tolist()}, expected a direction that is not vertical")
    return ahead


def facing(robot: Robot, place: tuple[float, float], angle: float) -> tuple[Array, Array]:
    """A base pose for which a robot's front points to an angle, and the frame there whose x axis points forward.

    Args:
        robot: The robot.
        place: Position of the base, x and y [m].
        angle: Direction of its front [rad].
    """
    ahead = front_of(robot)
    turn = math.remainder(angle - math.atan2(ahead[1], ahead[0]), 2.0 * math.pi)
    base = pose((*place, 0.0), rpy=(0.0, 0.0, turn))
    return base, pose((*place, 0.0), rpy=(0.0, 0.0, math.remainder(angle, 2.0 * math.pi)))


def floor_under(*robots: Robot) -> HalfSpace:
    """The floor on which robots stand: at the height of their base frames, or lower if their bases extend below them.

    Args:
        robots: The robots.
    """
    return HalfSpace((0.0, 0.0, 1.0), min(map(_floor_height, robots)))


@lru_cache(maxsize=64)
def _floor_height(robot: Robot) -> float:
    home, other = robot.link_poses(robot.home), robot.link_poses(robot.home + 0.1)
    lowest = {
        link.name: float(bounding_box(link.collisions, home[link.name])[0][2])
        for link in robot.links
        if link.collisions and np.array_equal(home[link.name], other[link.name])
    }
    # Only contact of the base link is allowed.
    if all(height >= CLEARANCE for link, height in lowest.items() if link != robot.base):
        return 0.0
    return min(lowest.values()) - CLEARANCE


@lru_cache(maxsize=64)
def horizontal_reach(robot: Robot) -> float:
    """Largest distance of a robot's tool from the axis of its base, over random configurations [m]."""
    rng = np.random.default_rng(0)
    drawn = rng.uniform(*one_turn(robot), (_SAMPLES, robot.nq))
    tools = np.array([robot.link_poses(q)[robot.tool][:2, 3] for q in drawn])
    return float(np.linalg.norm(tools, axis=1).max())
