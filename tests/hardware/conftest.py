"""RR1 with an invented calibration and control box; only the firmware numbers are real, as published."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import rr1plan as rp

# Channel: joint, steps per degree, sign, ticks of a step at full speed, steps to full speed.
_CHANNELS = {
    "S1": ("shoulder_joint", 14.0, 1, 6, 128),
    "S2": ("upper_arm_joint", 14.0, -1, 4, 128),
    "E1": ("elbow_joint", 27.0, -1, 2, 128),
    "E2": ("forearm_joint", 42.0, -1, 3, 128),
    "W1": ("wrist_joint", 77.0, 1, 2, 128),
    "W2": ("hand_joint", 43.5, -1, 4, 64),
    "G": ("finger_joint", 30.0, 1, 2, 128),
}


@pytest.fixture(scope="session")
def calibration() -> rp.Calibration:
    joints = {
        joint: rp.JointCalibration(sign, 0.01 * k, math.degrees(per_degree), 1e-3, 1.0)
        for k, (joint, per_degree, sign, _, _) in enumerate(_CHANNELS.values())
    }
    return rp.Calibration("rr1", joints, "steps", source="made up")


@pytest.fixture(scope="session")
def box() -> rp.ControlBox:
    channels = {name: rp.BoxChannel(joint, fast, ramp, 2.5) for name, (joint, _, _, fast, ramp) in _CHANNELS.items()}
    return rp.ControlBox(channels, 0.000602)


@pytest.fixture(scope="session")
def motion() -> rp.MotionPlan:
    problem = next(iter(rp.load_problems("rr1_table").values()))
    scene = problem.scene.with_robot("rr1", problem.scene.arms["rr1"].robot.with_limits("hardware"))
    return rp.plan_motion(rp.Problem(scene, problem.start, dict(problem.goal)), margin=0.004, rng=0)


@pytest.fixture(scope="session")
def plan(motion: rp.MotionPlan, calibration: rp.Calibration, box: rp.ControlBox) -> rp.CommandPlan:
    return rp.plan_commands(motion, calibration, box)


Line = Callable[..., Any]


@pytest.fixture
def line(plan: rp.CommandPlan, box: rp.ControlBox) -> Line:
    """Makes emulated serial lines to a box at the start of the plan; keywords replace their methods."""

    def make(**methods: Callable[..., Any]) -> rp.EmulatedSerialLine:
        start = dict(zip(("S1", "S2", "E1", "E2", "W1", "W2", "G"), plan.start, strict=True))
        made = rp.EmulatedSerialLine(box, start)
        for name, method in methods.items():
            setattr(made, name, method.__get__(made))
        return made

    return make


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)
