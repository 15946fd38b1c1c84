"""An RR1 with a gripper at a table, a block, and a planned pick-and-place of it."""

from __future__ import annotations

import numpy as np
import pytest

import rr1plan as rp


@pytest.fixture(scope="session")
def table(rr1: rp.Robot) -> rp.Scene:
    """An RR1 on a table with a block that stands on it."""
    scene = rp.Scene(name="table").with_arm("arm", rr1)
    scene = scene.with_obstacle("table", rp.Box((1.0, 1.0, 0.04)), [-0.2, 0.0, -0.02]).allow("arm/base_link", "table")
    return scene.with_obstacle("block", rp.Box((0.04, 0.04, 0.06)), [-0.3, 0.1, 0.03], mass=0.15)


@pytest.fixture(scope="session")
def moved(table: rp.Scene) -> rp.SequencePlan:
    """Pick the block, place it elsewhere, and return home."""
    segments = [*rp.pick_and_place(table, "block", [-0.28, -0.12, 0.03]), rp.Pause(0.2), rp.FreeMotion("home")]
    plan = rp.plan_sequence(rp.Sequence(table, segments), rng=0, budget=rp.Budget(seconds=100.0))
    assert plan.found, plan
    return plan


def tool_down(x: float, y: float, z: float, yaw: float = 0.0) -> rp.PoseGoal:
    """The tool points down; an angle about the vertical gives the direction in which its fingers travel."""
    c, s = np.cos(yaw), np.sin(yaw)
    T = np.eye(4)
    T[:3, :3] = [[c, s, 0.0], [s, -c, 0.0], [0.0, 0.0, -1.0]]
    T[:3, 3] = x, y, z
    return rp.PoseGoal("tool", T)
