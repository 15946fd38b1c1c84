"""Seeded problems of many arms in work cells: a hand-over through a window, a shared bin, a conveyor, shelves.

Sizes of obstacles are fixed; positions of arms follow from their reach. All starts and goals are checked: no arm
touches the scene or another arm.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from rr1plan.checks import Array, Seed, as_generator, positive_number, whole_number
from rr1plan.errors import InputError
from rr1plan.multi.scenarios.endpoint_sampling import (
    Draw,
    ToolBox,
    check_position_limits,
    check_reach,
    facing,
    floor_under,
    horizontal_reach,
    problem_between,
    sample_configurations,
    tool_in_box,
)
from rr1plan.robot import Geometry, Robot
from rr1plan.scene import Scene
from rr1plan.scene.problem import Problem
from rr1plan.shapes.shapes import Box, Color
from rr1plan.transforms import pose

_ATTEMPTS = 10
_FLOOR: Color = (0.85, 0.85, 0.83, 1.0)
_WOOD: Color = (0.78, 0.72, 0.62, 1.0)
_STEEL: Color = (0.55, 0.60, 0.65, 1.0)
_BLUE: Color = (0.29, 0.48, 0.65, 1.0)
_THICK = 0.02  # of walls and boards [m]
_BIN = (0.40, 0.30, 0.20)  # outer sides of the bin [m]
_BELT = (0.30, 0.10)  # width and height of the conveyor [m]
_FROM_BOARDS = 0.08  # distance of tools from the boards of a shelf [m]
_WINDOWS = (0.05, 1.0)  # allowed widths of windows [m]

Sides = tuple[float, float, float]


class _Cell:
    """A scene under construction: arms, each with a frame on the floor whose x axis points along the arm's front."""

    def __init__(self, name: str, robot: Robot) -> None:
        self.robot = robot
        self.scene = Scene(name=name).with_obstacle("floor", floor_under(robot), color=_FLOOR)
        self.frames: dict[str, Array] = {}

    def add_arm(self, place: tuple[float, float], angle: float) -> str:
        """Add an arm whose front points to an angle [rad]; returns its name."""
        name = f"arm{len(self.frames) + 1:02d}"
        base, self.frames[name] = facing(self.robot, place, angle)
        self.scene = self.scene.with_arm(name, self.robot, base)
        return name

    def add_boxes(self, name: str, color: Color, *boxes: tuple[Sides, Sides]) -> None:
        """Add an obstacle of boxes, each given by its sides and its center [m]."""
        parts = [
            Geometry(f"{name}_{k}", Box(sides), pose(middle), color) for k, (sides, middle) in enumerate(boxes, start=1)
        ]
        self.scene = self.scene.with_obstacle(name, parts)

    def draw(self, arm: str, box: ToolBox) -> Draw:
        """Draw configurations with an arm's tool in a box that it reaches."""
        draw = tool_in_box(self.scene, arm, box)
        check_reach(self.robot, box, draw)
        return draw

    def problem(
        self, starts: Mapping[str, ToolBox], goals: Mapping[str, ToolBox], rng: np.random.Generator, advice: str
    ) -> Problem:
        """The problem in which each tool starts in a box and ends in another."""
        advice += f", or a tool other than {self.robot.tool!r} if the hand reaches beyond it"
        ends = []
        for boxes in (starts, goals):
            draws = {arm: self.draw(arm, box) for arm, box in boxes.items()}
            ends.append(sample_configurations(self.scene, rng, draws, advice=advice))
        return problem_between(self.scene, ends[0], ends[1], rng, draws)


def handover_window(robot: Robot, width: float = 0.12, rng: Seed = None, *, gap: float = 0.04) -> Problem:
    """Two arms on both sides of a wall, whose tools meet in a square window.

    Args:
        robot: The robot of both arms, whose joints have limits.
        width: Width and height of the window [m].
        rng: Seed.
        gap: Distance of the origins of the tools at the goal [m]; RR1's fingers end 2.7 cm beyond the tool's origin.

    Raises:
        InputError: a width out of range, or a window too narrow for collision-free configurations of all arms.
    """
    check_position_limits(robot)
    generator = as_generator(rng)
    width = positive_number("width", width)
    if not _WINDOWS[0] <= width <= _WINDOWS[1]:
        raise InputError(f"width is {width:g} m, expected {_WINDOWS[0]:g} to {_WINDOWS[1]:g} m")
    far = horizontal_reach(robot)
    cell, middle = _Cell("hand-over", robot), 0.6 * far
    if width >= 2.0 * middle:
        raise InputError(f"width is {width:g} m, expected less than {2.0 * middle:.3g} m for {robot.name!r}")
    top, side = 1.6 * far, 2.0 * far
    above, below, beside = top - middle - 0.5 * width, middle - 0.5 * width, 0.5 * (side - width)
    cell.add_boxes(
        "wall",
        _WOOD,
        ((_THICK, side, below), (0.0, 0.0, 0.5 * below)),
        ((_THICK, side, above), (0.0, 0.0, top - 0.5 * above)),
        ((_THICK, beside, width), (0.0, -0.5 * (width + beside), middle)),
        ((_THICK, beside, width), (0.0, 0.5 * (width + beside), middle)),
    )
    distance, between = 0.75 * far, positive_number("gap", gap)
    starts, goals = {}, {}
    for angle in (0.0, math.pi):
        arm = cell.add_arm((-math.cos(angle) * distance, 0.0), angle)
        frame = cell.frames[arm]
        starts[arm] = ToolBox(frame, (0.2 * far, -0.6 * far, 0.2 * far), (0.5 * far, 0.6 * far, 0.9 * far))
        point = (distance - 0.5 * between, 0.0, middle)
        goals[arm] = ToolBox(frame, point, point)
    return cell.problem(starts, goals, generator, "try a wider window or another robot")


def shared_bin(robot: Robot, count: int = 4, rng: Seed = None) -> Problem:
    """Arms around a bin of 40 x 30 x 20 cm: every second one starts in it and leaves, the others reach in to pick.

    Args:
        robot: The robot all of them are, whose joints have limits.
        count: Number of arms, 2 or 4.
        rng: Seed.

    Raises:
        InputError: another count, or no collision-free configurations of all arms.
    """
    check_position_limits(robot)
    generator = as_generator(rng)
    if whole_number("count", count, 2, 4) == 3:
        raise InputError("count is 3, expected 2 or 4")
    far = horizontal_reach(robot)
    cell = _Cell("shared bin", robot)
    x, y, z = _BIN
    cell.add_boxes(
        "bin",
        _BLUE,
        ((x, y, 0.01), (0.0, 0.0, 0.005)),
        *(((0.01, y, z), (side * 0.5 * (x - 0.01), 0.0, 0.5 * z)) for side in (-1.0, 1.0)),
        *(((x - 0.02, 0.01, z), (0.0, side * 0.5 * (y - 0.01), 0.5 * z)) for side in (-1.0, 1.0)),
    )
    inside = ToolBox(pose((0.0, 0.0, 0.0)), (-0.3 * x, -0.3 * y, 0.04), (0.3 * x, 0.3 * y, 0.7 * z))
    inner, outer = {}, {}
    for k in range(count):
        angle = 2.0 * math.pi * k / count
        half = 0.5 * (x if abs(math.cos(angle)) > 0.5 else y)
        distance = half + 0.38 * far
        arm = cell.add_arm((distance * math.cos(angle), distance * math.sin(angle)), angle + math.pi)
        # Above the rim, over the floor next to the bin.
        outer[arm] = ToolBox(cell.frames[arm], (0.1 * far, 0.35 * far, z), (0.5 * far, 0.7 * far, z + 0.4 * far))
        inner[arm] = inside
    arms = list(cell.frames)
    starts = {arm: (inner if k % 2 == 0 else outer)[arm] for k, arm in enumerate(arms)}
    goals = {arm: (outer if k % 2 == 0 else inner)[arm] for k, arm in enumerate(arms)}
    return cell.problem(starts, goals, generator, "try another robot or seed")


def conveyor_line(robot: Robot, count: int, rng: Seed = None) -> Problem:
    """Arms along both sides of a belt; each tool moves along it into the reach of the next arms.

    Args:
        robot: The robot all of them are, whose joints have limits.
        count: Number of arms, alternating between the sides.
        rng: Seed.

    Raises:
        InputError: numbers out of range, or no collision-free configurations of all arms.
    """
    check_position_limits(robot)
    generator = as_generator(rng)
    whole_number("count", count, 2, 1000)
    far = horizontal_reach(robot)
    cell = _Cell("conveyor", robot)
    width, height = _BELT
    pitch, distance = 0.45 * far, 0.5 * width + 0.35 * far
    long = (count - 1) * pitch + 2.0 * far
    cell.add_boxes("belt", _STEEL, ((width, long, height), (0.0, 0.0, 0.5 * height)))
    starts: dict[str, ToolBox] = {}
    goals: dict[str, ToolBox] = {}
    for k in range(count):
        side = -1.0 if k % 2 == 0 else 1.0
        y = (k - 0.5 * (count - 1)) * pitch
        arm = cell.add_arm((side * distance, y), 0.0 if side < 0.0 else math.pi)
        over = (-0.4 * width, 0.4 * width, height + 0.06, height + 0.2)
        for boxes, low, high in ((starts, -0.5, -0.2), (goals, 0.2, 0.5)):
            boxes[arm] = ToolBox(pose((0.0, y, 0.0)), (over[0], low * far, over[2]), (over[1], high * far, over[3]))
    return cell.problem(starts, goals, generator, "try another robot or seed")


def shelf_rows(robot: Robot, count: int = 8, rng: Seed = None) -> Problem:
    """Rows of arms on both sides of a shelf; each tool moves from its bay to another level of that bay or the next.

    Args:
        robot: The robot all of them are, whose joints have limits.
        count: Number of arms, even.
        rng: Seed.

    Raises:
        InputError: numbers out of range, or no collision-free configurations of all arms.
    """
    check_position_limits(robot)
    generator = as_generator(rng)
    if whole_number("count", count, 2, 100) % 2:
        raise InputError(f"count is {count}, expected an even number")
    far = horizontal_reach(robot)
    cell = _Cell("shelf rows", robot)
    bays, pitch, deep = count // 2, 0.75 * far, 0.3 * far
    levels = [0.35 * far, 0.85 * far, 1.35 * far]
    if levels[1] - levels[0] < 2.0 * _FROM_BOARDS:
        raise InputError(
            f"{robot.name!r} reaches {far:.3g} m, which leaves its tool no room between boards; try a larger robot"
        )
    long, tall = bays * pitch, levels[-1]
    boards = [((2.0 * deep, long, _THICK), (0.0, 0.0, z)) for z in levels]
    walls = [
        ((2.0 * deep, _THICK, tall - levels[0]), (0.0, (k - 0.5 * bays) * pitch, 0.5 * (tall + levels[0])))
        for k in range(bays + 1)
    ]
    back = ((_THICK, long, tall - levels[0]), (0.0, 0.0, 0.5 * (tall + levels[0])))
    cell.add_boxes("shelf", _WOOD, *boards, *walls, back)
    arms = []
    for k in range(count):
        side, y = (-1.0, 1.0)[k % 2], (k // 2 - 0.5 * (bays - 1)) * pitch
        arms.append(cell.add_arm((side * (deep + 0.5 * far), y), 0.0 if side < 0.0 else math.pi))

    def place(k: int, bay: int, level: int) -> ToolBox:
        side, middle = (-1.0, 1.0)[k % 2], (bay - 0.5 * (bays - 1)) * pitch
        near, deepest = sorted((0.55 * side * deep, side * deep))
        low, high = levels[level] + _FROM_BOARDS, levels[level + 1] - _FROM_BOARDS
        return ToolBox(pose((0.0, middle, 0.0)), (near, -0.3 * pitch, low), (deepest, 0.3 * pitch, high))

    # Other draws of levels and bays do not help a robot that reaches only one level.
    for between in range(2):
        cell.draw(arms[0], place(0, 0, between))
    for attempt in range(_ATTEMPTS):
        level = generator.integers(2, size=count).tolist()
        # Each moves to its own bay or the next one.
        bay = np.clip(np.arange(count) // 2 + generator.integers(-1, 2, size=count), 0, bays - 1).tolist()
        starts = {arm: place(k, k // 2, level[k]) for k, arm in enumerate(arms)}
        goals = {arm: place(k, bay[k], 1 - level[k]) for k, arm in enumerate(arms)}
        try:
            return cell.problem(starts, goals, generator, "try another robot or seed")
        except InputError:
            if attempt == _ATTEMPTS - 1:
                raise
    raise AssertionError("the last attempt returns or raises")
