"""Balls and capsules whose core just touches a surface penetrate it deeply; Coal misses this by default."""

from __future__ import annotations

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.robot import Geometry, Inertial, Joint, Link
from rr1plan.transforms import identity, pose


def _arm_with(shape: rp.Sphere | rp.Capsule) -> rp.Robot:
    """One prismatic joint along x that carries a shape."""
    joint = Joint("slide", "prismatic", "base", "slider", axis=np.array([1.0, 0.0, 0.0]), lower=-1, upper=1, velocity=1)
    inertial = Inertial(1.0, np.zeros(3), np.eye(3))
    one = np.ones(1)
    return rp.Robot(
        name="slider",
        links=(Link("base"), Link("slider", inertial, collisions=(Geometry("slider", shape, identity()),))),
        joints=(joint,),
        joint_names=("slide",),
        limits=rp.Limits(-one, one, one, one, one, one),
        configurations={"home": [0.0]},
        locked_joints={},
        disabled_collisions=frozenset(),
        tool="slider",
    )


@pytest.mark.parametrize("shape", [rp.Sphere(0.04), rp.Capsule(0.04, 0.3)])
@pytest.mark.parametrize("obstacle", [rp.Cylinder(0.2, 0.4), rp.Box((0.4, 0.4, 0.4)), rp.Sphere(0.2)])
def test_a_core_that_grazes_a_surface_collides(shape: rp.Sphere | rp.Capsule, obstacle: rp.Box) -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        turned = pose(rng.uniform(-1, 1, 3), rpy=rng.uniform(-3, 3, 3))
        scene = rp.Scene(arms={"arm": rp.Arm(_arm_with(shape), turned)}).with_obstacle("thing", obstacle, turned)
        checker = rp.CollisionChecker(scene)
        for gap in (0.0, 1e-12, 1e-9, 1e-7, 5e-7, 2e-6, 1e-3, 0.0399):
            assert not checker.is_free_slowly(np.array([0.2 + gap])), gap
        assert checker.is_free_slowly(np.array([0.2 + 0.0401]))


@pytest.mark.parametrize("turn", [0.0, 0.3])
def test_a_core_exactly_in_a_surface_has_its_depth(turn: float) -> None:
    scene = rp.load_scene("planar2r_path")
    q = np.array([-np.pi / 2, np.pi / 2])
    checker = rp.CollisionChecker(scene)
    for near in (q + turn, q + 1e-9, q, q + 1e-12, q):
        distances = checker.distances(near)
        assert (np.abs(distances) < 10.0).all()
        assert all(0.0 <= contact.depth < 1.0 for contact in checker.contacts(near))
    violet = checker.pairs.index(("arm/link2", "violet"))
    assert checker.distances(q)[violet] == pytest.approx(-0.04, abs=1e-6)
    assert checker.contacts(q)[0].depth == pytest.approx(0.04, abs=1e-6)
    assert rp.CollisionChecker(scene).distances(q)[violet] == pytest.approx(-0.04, abs=1e-6)


def test_a_robot_with_one_joint_is_planned_for() -> None:
    scene = rp.Scene(arms={"arm": rp.Arm(_arm_with(rp.Sphere(0.04)))})
    problem = rp.Problem(scene, [0.9], [-0.9])
    motion = rp.plan_motion(problem, rng=0)
    assert motion.valid
    kinematics = rp.Kinematics(scene)
    assert kinematics.jacobian(np.array([0.1]), "tool").shape == (6, 1)
    assert kinematics.mass_matrix(np.array([0.1])) == pytest.approx(np.array([[1.0]]))
    assert kinematics.inverse_dynamics(np.array([0.1]), np.zeros(1), np.ones(1)) == pytest.approx(np.ones(1))
    assert kinematics.manipulability(np.array([0.1]), "tool") == pytest.approx(1.0)
    found = rp.solve_ik(kinematics, rp.PoseGoal("tool", [0.3, 0.0, 0.0]), rng=0)
    assert found.solutions == pytest.approx(np.array([[0.3]]), abs=1e-4)
    assert rp.simulate(motion.trajectory, scene).free
    blocked = scene.with_obstacle("post", rp.Sphere(0.1), [0.0, 0.0, 0.0])
    assert not rp.plan(rp.Problem(blocked, [0.9], [-0.9]), budget=rp.Budget(0.3)).found
    for name in ("ompl_rrt_connect", "rrt_star", "cartesian"):
        goal = rp.PoseGoal("tool", [-0.5, 0.0, 0.0]) if name == "cartesian" else [-0.5]
        assert rp.plan(rp.Problem(scene, [0.9], goal), planner=name, budget=rp.Budget(1.0), rng=1).found, name
