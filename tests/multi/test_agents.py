"""Bodies of agents: where those of a checker are, inside the balls of their groups."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import rr1plan as rp
from rr1plan.collision import CollisionChecker
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.placed_path import box_around, placed_configuration
from rr1plan.transforms import pose


@pytest.fixture
def problem(rr1: rp.Robot, planar2r: rp.Robot) -> rp.Problem:
    """Two RR1, one of which holds a box, and a planar arm, all turned and tilted."""
    scene = rp.Scene().with_arm("a", rr1, pose((0.4, -0.2, 0.1), rpy=(0.1, -0.2, 0.7)))
    scene = scene.with_arm("b", planar2r, pose((-0.7, 0.3, 0.0), rpy=(0.3, 0.0, 2.0)))
    scene = scene.with_arm("c", rr1, pose((0.3, 0.6, -0.1), rpy=(0.0, 0.1, -1.5)))
    scene = scene.with_obstacle("box", rp.Box((0.1, 0.05, 0.2)), (0.0, 0.0, 2.0)).attach("box", "c", pose=(0, 0, 0.1))
    scene = scene.with_obstacle("table", rp.Box((3.0, 3.0, 0.1)), (0.0, 0.0, -2.0))
    return rp.Problem(scene, None, {name: arm.q for name, arm in scene.arms.items()})


@pytest.mark.parametrize("arms", [["a"], ["c"], ["a", "b"], ["b", "c"], ["a", "b", "c"]])
def test_bodies_are_those_of_a_checker_and_inside_the_balls_of_their_groups(problem, arms):
    agent = Agent(problem, arms)
    bodies, rng = agent.bodies, np.random.default_rng(0)
    checker = CollisionChecker(rp.Scene({name: problem.scene.arms[name] for name in arms}, {}, _held(problem, arms)))
    assert bodies.elements == tuple(solid.element for solid in checker.solids)
    assert bodies.columns == checker.nq == len(agent.start)
    for q in rng.uniform(-1.5, 1.5, (5, checker.nq)):
        placed = placed_configuration(bodies, q)
        # Of the two nodes, the second one is the configuration itself.
        centers = placed.part("centers")[len(bodies.elements) : 2 * len(bodies.elements)]
        groups = placed.part("group_centers")[len(bodies.group_rows) : 2 * len(bodies.group_rows)]
        np.testing.assert_allclose(centers, _centers(checker, q), rtol=0, atol=1e-12)
        low, high = box_around(bodies, placed)
        covered = []
        for (_, first, last), middle, (*_, radius) in zip(bodies.group_rows, groups, bodies.group_balls, strict=True):
            covered += range(first, last)
            own = bodies.tables.body_values[first:last, 15]
            assert (np.linalg.norm(centers[first:last] - middle, axis=1) + own <= radius + 1e-12).all()
            assert (low <= centers[first:last]).all()
            assert (centers[first:last] <= high).all()
        assert covered == list(range(len(checker.solids)))


def _held(problem: rp.Problem, arms: list[str]) -> dict[str, rp.Attachment]:
    return {name: held for name, held in problem.scene.attachments.items() if held.arm in arms}


def _centers(checker: CollisionChecker, q: np.ndarray) -> list[np.ndarray]:
    """Centers of the balls around all bodies in the world, from Pinocchio's poses of the joints."""
    model = checker.model.model
    data = model.createData()
    pin.forwardKinematics(model, data, checker.model.full(q))
    joints = [data.oMi[solid.joint].homogeneous if solid.joint else np.eye(4) for solid in checker.solids]
    balls = checker.tables.body_values[:, 12:15]
    return [T[:3, :3] @ center + T[:3, 3] for T, center in zip(joints, balls, strict=True)]
