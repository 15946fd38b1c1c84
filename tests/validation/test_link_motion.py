"""What drives each joint, and the kinematics of the slow certificate against the plain kinematics of the robot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from slow_certificate.scene_motion import SceneMotion

import rr1plan as rp
from rr1plan.errors import InputError
from rr1plan.robot import Joint, Link, Mimic
from rr1plan.validation.link_motion import drives


def assert_agree(scene: rp.Scene, trajectory: rp.Trajectory, times: np.ndarray) -> None:
    motion = SceneMotion(scene.arms, trajectory.joint_names, trajectory.breaks, trajectory.coefficients)
    frames = motion.frames(motion.positions(*motion.locate(times)))
    for n, t in enumerate(times):
        q = dict(zip(trajectory.joint_names, trajectory(t), strict=True))
        configurations = {
            a: np.array([q.get(f"{a}/{j}", r) for j, r in zip(arm.robot.joint_names, arm.q, strict=True)])
            for a, arm in scene.arms.items()
        }
        for name, T in scene.link_poses(configurations).items():
            np.testing.assert_allclose(frames.rotation[n, motion.links[name]], T[:3, :3], atol=1e-12)
            np.testing.assert_allclose(frames.origin[n, motion.links[name]], T[:3, 3], atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_every_link_of_two_random_arms_is_where_the_robot_says(
    seed: int, chain: Callable[..., rp.Robot], quintic: Callable[..., rp.Trajectory]
) -> None:
    rng = np.random.default_rng(seed)
    base = rp.transforms.pose(rng.normal(size=3), rpy=rng.normal(size=3))
    scene = rp.Scene().with_arm("a", chain(rng, 4), base).with_arm("b", chain(rng, 2), q=rng.normal(size=2))
    move = quintic(scene.joint_names(["a"]), rng.normal(size=4), rng.normal(size=4))
    assert_agree(scene, move, np.array([0.0, 0.2, 0.77, 1.0]))


def test_held_and_mimicking_fingers_are_where_the_robot_says(
    gripper: Callable[..., rp.Robot], quintic: Callable[..., rp.Trajectory]
) -> None:
    scene = rp.Scene().with_arm("g", gripper(rp.Sphere(0.01)))
    assert_agree(scene, quintic(["g/turn"], [0.0], [2.0]), np.linspace(0.0, 1.0, 5))


def test_rr1_is_where_the_robot_says(rr1: rp.Robot) -> None:
    scene = rp.Scene().with_arm("rr1", rr1, rp.transforms.pose([0.1, 0.2, 0.3], rpy=[0.1, 0.0, 1.0]))
    rng = np.random.default_rng(0)
    c = rng.normal(size=(3, 4, rr1.nq))
    assert_agree(scene, rp.Trajectory(scene.joint_names(), np.arange(4.0), c), np.linspace(0.0, 3.0, 20))


def test_a_chain_of_mimics_is_followed_and_a_circle_refused(gripper: Callable[..., rp.Robot]) -> None:
    robot = gripper(rp.Sphere(0.01))
    third = Joint("third", "prismatic", "arm", "extra", mimic=Mimic("right_slide", 2.0, 0.5))
    longer = replace(robot, links=(*robot.links, Link("extra")), joints=(*robot.joints, third))
    drive = drives(longer, {"turn": 0}, {})["third"]
    assert (drive.column, drive.offset) == (-1, pytest.approx(2.0 * (-0.05 - 0.01) + 0.5))
    assert drive.offset == pytest.approx(longer.joint_values(np.zeros(1))["third"])
    circle = replace(third, mimic=Mimic("third", 1.0, 0.0))
    with pytest.raises(InputError, match="follows no joint"):
        drives(replace(longer, joints=(*robot.joints, circle)), {"turn": 0}, {})
