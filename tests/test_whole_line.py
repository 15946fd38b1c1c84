"""The whole pipeline with third-party robots: plan, prove, replay, draw, save."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rr1plan as rp

ROBOTS = {
    "panda": "panda_description/urdf/panda.urdf",
    "ur5": "ur_description/urdf/ur5_robot.urdf",
    "xarm7": "xarm_description/urdf/xarm7.urdf",
    "so101": "so_arm_description/urdf/so101.urdf",
    "kinova": "kinova_description/robots/kinova.urdf",
}


@pytest.mark.parametrize("name", ROBOTS)
def test_a_foreign_robot_goes_the_whole_line(name: str, foreign_robots: Path, tmp_path: Path) -> None:
    robot = rp.load_robot(foreign_robots / ROBOTS[name])
    scene = rp.Scene().with_arm("arm", robot)
    checker = rp.CollisionChecker(scene)
    assert checker.is_free(robot.home)
    rng = np.random.default_rng(0)
    low, high = np.maximum(robot.limits.lower, robot.home - 0.8), np.minimum(robot.limits.upper, robot.home + 0.8)
    goal = next(q for q in rng.uniform(low, high, (100, robot.nq)) if checker.is_free(q))
    pose = rp.Kinematics(scene).pose(goal, "tool")
    middle = 0.5 * (pose[:3, 3] + rp.Kinematics(scene).pose(robot.home, "tool")[:3, 3])
    for size in (0.05, 0.01):
        blocked = scene.with_obstacle("box", rp.Box((size, size, size)), middle)
        free = rp.CollisionChecker(blocked)
        if free.is_free(robot.home) and free.is_free(goal):
            scene = blocked
            break
    motion = rp.plan_motion(rp.Problem(scene, "home", [rp.PoseGoal("tool", pose), rp.JointGoal(goal)]), rng=0)
    assert motion.valid, str(motion)
    moved = np.abs(np.diff(motion.path.waypoints, axis=0)).sum(axis=0)
    assert (moved < 2 * np.pi).all()
    replay = rp.simulate(motion.trajectory, scene)
    assert replay.free
    assert replay.max_error.max() < 5e-3
    saved = rp.load_motion(motion.save(tmp_path / "motion.json"))
    assert saved.trajectory.allclose(motion.trajectory, 0.0)
    assert motion.save_html(tmp_path / "motion.html").stat().st_size > 10_000
