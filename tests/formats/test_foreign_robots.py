"""Third-party robots from the package example-robot-data, against Pinocchio."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rr1plan as rp
from rr1plan.robot.disabled_collisions import LinkBodies
from rr1plan.shapes import Mesh

ROBOTS = {
    "panda": ("panda_description/urdf/panda.urdf", 7, "panda_hand_tcp"),
    "panda_primitives": ("panda_description/urdf/panda_collision.urdf", 8, None),
    "ur5": ("ur_description/urdf/ur5_robot.urdf", 6, "tool0"),
    "ur10": ("ur_description/urdf/ur10_robot.urdf", 6, "tool0"),
    "xarm7": ("xarm_description/urdf/xarm7.urdf", 7, "link_eef"),
    "so101": ("so_arm_description/urdf/so101.urdf", 6, None),
    "kinova": ("kinova_description/robots/kinova.urdf", 6, "j2s6s200_end_effector"),
}


@pytest.fixture(scope="module", params=ROBOTS)
def foreign(request: pytest.FixtureRequest, foreign_robots: Path) -> tuple[str, Path, rp.Robot]:
    file = foreign_robots / ROBOTS[request.param][0]
    return request.param, file, rp.load_robot(file)


def test_it_loads_without_options_and_is_ready_to_plan(foreign: tuple[str, Path, rp.Robot]) -> None:
    name, _, robot = foreign
    _, joints, tool = ROBOTS[name]
    assert robot.nq == joints
    assert tool is None or robot.tool == tool
    for rate in ("velocity", "acceleration", "jerk"):
        assert np.isfinite(getattr(robot.limits, rate)).all()
    assert (robot.home >= robot.limits.lower).all()
    assert (robot.home <= robot.limits.upper).all()
    bodies = LinkBodies(robot)
    pairs = [pair for pair in bodies.pairs if pair not in robot.disabled_collisions]
    assert pairs
    assert not bodies.touching(robot.joint_values(robot.home), pairs)
    shapes = [g.shape for link in robot.links for g in link.collisions]
    assert shapes
    assert all(not isinstance(shape, Mesh) or shape.convex for shape in shapes)


def test_every_frame_is_where_pinocchio_puts_it(foreign: tuple[str, Path, rp.Robot]) -> None:
    _, file, robot = foreign
    model = pin.buildModelFromUrdf(str(file), mimic=True)
    data = model.createData()
    rng = np.random.default_rng(0)
    for _ in range(20):
        q = rng.uniform(np.maximum(robot.limits.lower, -3), np.minimum(robot.limits.upper, 3))
        values = robot.joint_values(q)
        full = pin.neutral(model)
        for joint, at in zip(model.joints[1:], list(model.names)[1:], strict=True):
            if joint.nq == 2:
                full[joint.idx_q : joint.idx_q + 2] = np.cos(values[at]), np.sin(values[at])
            elif joint.nq == 1:
                full[joint.idx_q] = values[at]
        pin.framesForwardKinematics(model, data, full)
        for link, pose in robot.link_poses(q).items():
            reference = data.oMf[model.getFrameId(link, pin.FrameType.BODY)].homogeneous
            assert np.abs(pose - reference).max() < 1e-12


def test_kinovas_turning_joints_are_continuous(foreign_robots: Path) -> None:
    robot = rp.load_robot(foreign_robots / ROBOTS["kinova"][0])
    assert robot.continuous.sum() >= 2
    assert np.isinf(robot.limits.upper).sum() == robot.continuous.sum()


def test_pandas_finger_follows_the_other_or_is_held(foreign_robots: Path) -> None:
    robot = rp.load_robot(foreign_robots / ROBOTS["panda"][0])
    assert "panda_finger_joint1" in robot.locked_joints
    assert set(robot.joint_values(robot.home)) == {j.name for j in robot.joints if j.kind != "fixed"}
