"""Many arms of one robot at once: on a grid, or in a ring."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from rr1plan import transforms
from rr1plan.checks import (
    Array,
    check_text,
    finite_array,
    known_name,
    near_array,
    of_kind,
    positive_number,
    whole_number,
)
from rr1plan.errors import InputError
from rr1plan.robot import Robot
from rr1plan.scene import Arm, Scene
from rr1plan.transforms import as_pose

Facing = Literal["center", "outward", "along"]
_MOST_ARMS = 10_000
_FACING = ("center", "outward", "along")


def place_grid(
    robot: Robot,
    rows: int,
    columns: int,
    *,
    spacing: float | tuple[float, float] = 1.0,
    pose: ArrayLike | None = None,
    q: str | ArrayLike = "home",
    scene: Scene | None = None,
    prefix: str = "arm",
) -> Scene:
    """Place rows x columns arms on a grid, all with the same orientation.

    Args:
        robot: The robot of all arms.
        rows: Number of arms along x.
        columns: Number of arms along y.
        spacing: Distance between neighbors [m], one number or (along x, along y).
        pose: Pose of the middle of the grid in the world: (4, 4), or a position (3,) [m] (default: the origin).
        q: Configuration of every arm: a configuration's name or numbers (nq,).
        scene: The scene to which they are added (default: an empty one).
        prefix: Prefix of their names, followed by a number from 1 on, e.g. "arm01".

    Raises:
        InputError: no rows or columns, a spacing that is not positive, a name that the scene already has.
    """
    of_kind("robot", robot, Robot)
    _check_counts(rows=rows, columns=columns)
    of_two = isinstance(spacing, list | tuple | np.ndarray)
    both = np.broadcast_to(near_array("spacing", spacing, (2,) if of_two else ()), (2,))
    along_x, along_y = (positive_number("spacing", s) for s in both)
    T = as_pose(pose, "pose")
    xs = along_x * (np.arange(rows) - (rows - 1) / 2)
    ys = along_y * (np.arange(columns) - (columns - 1) / 2)
    bases = [T @ as_pose((x, y, 0.0), "base") for x in xs for y in ys]
    return _place(robot, bases, q, scene, prefix)


def place_ring(
    robot: Robot,
    count: int,
    radius: float,
    *,
    facing: Facing = "center",
    front: ArrayLike = (1.0, 0.0, 0.0),
    pose: ArrayLike | None = None,
    q: str | ArrayLike = "home",
    scene: Scene | None = None,
    prefix: str = "arm",
) -> Scene:
    """Place arms evenly on a circle.

    Args:
        robot: The robot of all arms.
        count: Number of arms.
        radius: Radius of the circle of their bases [m].
        facing: Direction of their fronts: to the "center", "outward", or "along" the circle (counter-clockwise).
        front: Direction of the robot's front in its base frame, shape (3,); (-1, 0, 0) for RR1.
        pose: Pose of the middle of the circle in the world: (4, 4), or a position (3,) [m] (default: the origin). The
            first arm is on its x axis.
        q: Configuration of every arm: a configuration's name or numbers (nq,).
        scene: The scene to which they are added (default: an empty one).
        prefix: Prefix of their names, followed by a number from 1 on, e.g. "arm01".

    Raises:
        InputError: no arms, a radius that is not positive, a front without a horizontal direction, a name that the
            scene already has.
        UnknownNameError: an unknown facing.
    """
    of_kind("robot", robot, Robot)
    _check_counts(count=count)
    distance = positive_number("radius", radius)
    known_name("facing", facing, _FACING)
    T, ahead = as_pose(pose, "pose"), finite_array("front", front, (3,))
    if np.hypot(ahead[0], ahead[1]) < 1e-9:
        raise InputError(f"front is {ahead.tolist()}, expected a direction that is not vertical")
    turn = {"center": np.pi, "outward": 0.0, "along": np.pi / 2}[facing] - np.arctan2(ahead[1], ahead[0])
    bases = []
    for angle in 2.0 * np.pi * np.arange(count) / count:
        place = (distance * np.cos(angle), distance * np.sin(angle), 0.0)
        bases.append(T @ transforms.pose(place, rpy=(0.0, 0.0, np.remainder(angle + turn, 2.0 * np.pi))))
    return _place(robot, bases, q, scene, prefix)


def _check_counts(**counts: int) -> None:
    for name, count in counts.items():
        whole_number(name, count, 1, _MOST_ARMS)
    if math.prod(map(int, counts.values())) > _MOST_ARMS:
        raise InputError(f"{' x '.join(map(str, counts.values()))} arms are too many, expected at most {_MOST_ARMS}")


def _place(robot: Robot, bases: list[Array], q: str | ArrayLike, scene: Scene | None, prefix: str) -> Scene:
    of_kind("scene", scene, Scene, optional=True)
    check_text("prefix", prefix)
    scene = Scene() if scene is None else scene
    digits = max(2, len(str(len(bases))))
    arms = dict(scene.arms)
    for number, base in enumerate(bases, start=1):
        name = f"{prefix}{number:0{digits}d}"
        if name in arms:
            raise InputError(f"the scene has an arm named {name!r} already; try another prefix")
        arms[name] = Arm(robot, base, q)
    return replace(scene, arms=arms)
