"""Poses of all links at many times at once: plain NumPy kinematics along a trajectory."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rr1plan.checks import Array
from rr1plan.robot import Joint
from rr1plan.scene import Arm
from rr1plan.validation.link_motion import Drive, drives


class LinkFrames(NamedTuple):
    """Poses at n times: of the world and all links, and the lines about which joints turn.

    Args:
        rotation: R_world_link, shape (n, links, 3, 3); link 0 is the world itself.
        origin: Positions [m], shape (n, links, 3).
        axis: Directions of the moving joints, shape (n, joints, 3).
        pivot: Points on their axes [m], shape (n, joints, 3).
    """

    rotation: Array
    origin: Array
    axis: Array
    pivot: Array


@dataclass(frozen=True, eq=False)
class MovingLink:
    """A link after its parent: the joint between them and what drives it.

    Args:
        index, parent: Numbers of the link and of its parent among all links of the scene.
        joint: The joint between them.
        drive: What determines its value.
        number: Number of the joint among the moving joints, or -1 if it is stationary.
    """

    index: int
    parent: int
    joint: Joint
    drive: Drive
    number: int


class LinkMotion:
    """The links of some arms, moved by columns.

    Args:
        arms: The arms; those without a column keep their configuration.
        joint_names: Name of each column, "arm/joint".

    Attributes:
        links: Number of each link by its name "arm/link"; 0 is the world.
        bases: Number and T_world_link of the base of each arm.
        steps: All links after their parents.
    """

    def __init__(self, arms: Mapping[str, Arm], joint_names: tuple[str, ...]) -> None:
        self.links: dict[str, int] = {"": 0}
        self.bases: list[tuple[int, Array]] = []
        self.steps: list[MovingLink] = []
        self.moving: list[MovingLink] = []
        columns = {name: i for i, name in enumerate(joint_names)}
        for name, arm in arms.items():
            self._add_arm(name, arm, columns)

    def _add_arm(self, arm: str, placed: Arm, columns: dict[str, int]) -> None:
        robot = placed.robot
        own = {n: columns[f"{arm}/{n}"] for n in robot.joint_names if f"{arm}/{n}" in columns}
        rest = dict(zip(robot.joint_names, (float(v) for v in placed.q), strict=True))
        driven = drives(robot, own, {n: v for n, v in rest.items() if n not in own})
        self.links[f"{arm}/{robot.base}"] = base = len(self.links)
        self.bases.append((base, placed.base))
        for joint in robot.joints:
            drive = driven.get(joint.name, Drive(-1, 0.0, 0.0))
            index = self.links.setdefault(f"{arm}/{joint.child}", len(self.links))
            number = len(self.moving) if drive.column >= 0 and drive.scale != 0.0 else -1
            step = MovingLink(index, self.links[f"{arm}/{joint.parent}"], joint, drive, number)
            self.steps.append(step)
            if number >= 0:
                self.moving.append(step)

    def frames(self, q: Array) -> LinkFrames:
        """Poses of all links at n values of the columns (n, nq)."""
        n = len(q)
        rotation = np.zeros((n, len(self.links), 3, 3))
        origin = np.zeros((n, len(self.links), 3))
        axis, pivot = np.empty((n, len(self.moving), 3)), np.empty((n, len(self.moving), 3))
        rotation[:, 0] = np.eye(3)
        for base, T in self.bases:
            rotation[:, base], origin[:, base] = T[:3, :3], T[:3, 3]
        for step in self.steps:
            joint, drive = step.joint, step.drive
            R, p = rotation[:, step.parent] @ joint.origin[:3, :3], rotation[:, step.parent] @ joint.origin[:3, 3]
            p = p + origin[:, step.parent]
            direction = R @ joint.axis
            if step.number >= 0:
                axis[:, step.number], pivot[:, step.number] = direction, p
            value = drive.offset + (drive.scale * q[:, drive.column] if drive.column >= 0 else np.zeros(n))
            if joint.kind == "prismatic":
                p = p + value[:, None] * direction
            elif joint.kind != "fixed":
                R = R @ _turns(joint.axis, value)
            rotation[:, step.index], origin[:, step.index] = R, p
        return LinkFrames(rotation, origin, axis, pivot)


def _turns(axis: Array, angles: Array) -> Array:
    """Rotations (n, 3, 3) about one unit axis by n angles (Rodrigues)."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, versine = np.sin(angles)[:, None, None], (1.0 - np.cos(angles))[:, None, None]
    return np.asarray(np.eye(3) + sine * K + versine * (K @ K))
