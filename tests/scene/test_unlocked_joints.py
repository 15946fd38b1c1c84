"""Gripper joints as planning joints, and locked again."""

from __future__ import annotations

import numpy as np

import rr1plan as rp
from rr1plan.scene.unlocked_joints import locked_scene, unlocked_scene


def test_joints_are_unlocked_and_locked_at_their_values(rr1: rp.Robot) -> None:
    (finger,) = (name for name in rr1.locked_joints if name == "finger_joint")
    scene = rp.Scene().with_arm("one", rr1).with_arm("two", rr1, [1.0, 0.0, 0.0], q="raised")
    grippers = {"two": (finger,)}
    free = unlocked_scene(scene, grippers)
    assert free.joint_names() == (*scene.joint_names(), f"two/{finger}")
    again = locked_scene(free, grippers)
    assert again.joint_names() == scene.joint_names()
    assert again.arms["one"] is free.arms["one"]
    robot = again.arms["two"].robot
    assert robot.locked_joints == rr1.locked_joints
    np.testing.assert_array_equal(again.configuration(), scene.configuration())
    for name, row in vars(rr1.limits).items():
        np.testing.assert_array_equal(getattr(robot.limits, name), row)
    # Locked where they are, not where they were.
    opened = free.with_configuration("two", np.append(scene.arms["two"].q, 0.3))
    closed = locked_scene(opened, grippers)
    assert closed.arms["two"].robot.locked_joints[finger] == 0.3
    for link, T in opened.link_poses().items():
        np.testing.assert_allclose(closed.link_poses()[link], T, atol=1e-12)
    assert set(closed.arms["two"].robot.configurations) == set(rr1.configurations)
    assert all(len(q) == rr1.nq for q in closed.arms["two"].robot.configurations.values())


def test_without_joints_a_scene_stays(rr1: rp.Robot) -> None:
    scene = rp.Scene().with_arm("arm", rr1)
    assert locked_scene(scene, {}) is scene
    assert locked_scene(scene, {"arm": ()}) is scene
