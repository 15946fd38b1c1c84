"""Robots and arms as input for a page's forward kinematics (`Kinematics` in `page/math.js`)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from rr1plan.checks import Array
from rr1plan.robot import Joint, Robot
from rr1plan.robot.robot import affine_value
from rr1plan.scene import Scene

Numbers = Callable[[Array], list[float]]


def scene_kinematics(scene: Scene, numbers: Numbers) -> tuple[list[Robot], list[dict[str, Any]], list[dict[str, Any]]]:
    """The robots of a scene, each once, and the data that forward kinematics needs about robots and arms.

    Args:
        scene: The scene.
        numbers: Converts a transform to 16 numbers in column-major order.

    Returns:
        The robots; a row for each of them; a row for each arm, with the index of its robot.
    """
    index: dict[int, int] = {}
    arms = [
        {
            "name": name,
            "robot": index.setdefault(id(arm.robot), len(index)),
            "base": numbers(arm.base),
            "q": arm.q.tolist(),
        }
        for name, arm in scene.arms.items()
    ]
    robots = list({id(arm.robot): arm.robot for arm in scene.arms.values()}.values())
    return robots, [_robot_row(robot, numbers) for robot in robots], arms


def _robot_row(robot: Robot, numbers: Numbers) -> dict[str, Any]:
    index = {name: i for i, name in enumerate(robot.link_names)}
    return {
        "links": list(robot.link_names),
        "tool": index[robot.tool],
        "joints": [_joint_row(robot, joint, index, numbers) for joint in robot.joints],
        "names": list(robot.joint_names),
    }


def _joint_row(robot: Robot, joint: Joint, index: Mapping[str, int], numbers: Numbers) -> dict[str, Any]:
    column, factor, offset = (-1, 0.0, 0.0) if joint.kind == "fixed" else affine_value(robot, joint)
    return {
        "kind": {"fixed": 0, "prismatic": 1}.get(joint.kind, 2),
        "parent": index[joint.parent],
        "child": index[joint.child],
        "origin": numbers(joint.origin),
        "axis": joint.axis.tolist(),
        "column": column,
        "factor": factor,
        "offset": offset,
    }
