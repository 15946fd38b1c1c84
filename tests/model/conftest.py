"""Arms with features that no shipped robot has: oblique axes, prismatic joints, mimic joints, wide limits."""

from __future__ import annotations

import numpy as np
import pytest

from rr1plan.robot import Inertial, Joint, Link, Mimic, Robot
from rr1plan.robot.joint_limits import Limits
from rr1plan.transforms import pose

INERTIAL = Inertial(1.2, np.array([0.02, 0.01, 0.05]), np.diag([0.02, 0.015, 0.01]))


def build_arm(name, joints, planned, held=None):
    by_name = {j.name: j for j in joints}
    lower = np.array([by_name[n].lower for n in planned])
    upper = np.array([by_name[n].upper for n in planned])
    rates = np.ones(len(planned))
    names = ["base", *(j.child for j in joints)]
    return Robot(
        name=name,
        links=tuple(Link(n, INERTIAL) for n in names),
        joints=tuple(joints),
        joint_names=tuple(planned),
        limits=Limits(lower, upper, rates, rates, rates, rates),
        configurations={"home": np.zeros(len(planned))},
        locked_joints=held or {},
        disabled_collisions=frozenset(),
        tool=names[-1],
    )


def oblique_axis(*xyz):
    return np.array(xyz, dtype=float) / np.linalg.norm(xyz)


@pytest.fixture(scope="session")
def odd_arm() -> Robot:
    """Continuous, revolute, locked, prismatic and mimic joints on oblique axes, all in the chain to the tool."""
    step = pose([0.05, -0.1, 0.3], rpy=[0.3, -0.2, 0.4])
    joints = [
        Joint("turn", "continuous", "base", "a", step),
        Joint("lean", "revolute", "a", "b", step, oblique_axis(1, 2, -1), -2.0, 2.0),
        Joint("copy", "revolute", "b", "c", step, oblique_axis(0, -1, 0), -2.0, 2.0, mimic=Mimic("lean", -0.5, 0.1)),
        Joint("slide", "prismatic", "c", "d", step, oblique_axis(1, 1, 0), -0.2, 0.4),
        Joint("held", "revolute", "d", "e", step, oblique_axis(0, 1, 1), -1.0, 1.0),
        Joint("roll", "revolute", "e", "f", step, oblique_axis(1, 0, 0), -3.0, 3.0),
        Joint("nod", "revolute", "f", "g", step, oblique_axis(0, 1, 0), -2.5, 2.5),
        Joint("spin", "continuous", "g", "h", step, oblique_axis(0, 0, -1)),
    ]
    return build_arm("odd", joints, ["turn", "lean", "slide", "roll", "nod", "spin"], {"held": 0.4})


@pytest.fixture(scope="session")
def redundant_arm() -> Robot:
    """Seven joints; the first and the last turn two turns each way."""
    axes = [(0, 0, 1), (0, 1, 0), (0, 0, 1), (0, -1, 0), (0, 0, 1), (0, 1, 0), (0, 0, 1)]
    reach = [2 * np.pi, 1.8, 2.8, 2.4, 2.8, 2.0, 2 * np.pi]
    joints = [
        Joint(
            f"j{i}", "revolute", "base" if i == 0 else f"l{i - 1}", f"l{i}", pose([0, 0, 0.2]), oblique_axis(*a), -r, r
        )
        for i, (a, r) in enumerate(zip(axes, reach, strict=True))
    ]
    return build_arm("seven", joints, [j.name for j in joints])


@pytest.fixture(scope="session")
def wrist_arm() -> Robot:
    """Six joints, a shoulder without offset and a spherical wrist: the textbook's eight solutions."""
    axes = [(0, 0, 1), (0, 1, 0), (0, 1, 0), (0, 0, 1), (0, 1, 0), (0, 0, 1)]
    steps = [0.3, 0.0, 0.4, 0.0, 0.35, 0.0]
    joints = [
        Joint(
            f"j{i}", "continuous", "base" if i == 0 else f"l{i - 1}", f"l{i}", pose([0, 0, step]), oblique_axis(*axis)
        )
        for i, (axis, step) in enumerate(zip(axes, steps, strict=True))
    ]
    joints.append(Joint("flange", "fixed", "l5", "tip", pose([0, 0, 0.1])))
    return build_arm("wrist", joints, [f"j{i}" for i in range(6)])
