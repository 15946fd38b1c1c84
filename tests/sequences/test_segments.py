"""Segments and sequences: their content, text, and rejected arguments."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.sequences.grippers import opening_value

POSE = rp.PoseGoal("tool", [0.1, 0.2, 0.3])


@pytest.mark.parametrize(
    ("segment", "label"),
    [
        (rp.FreeMotion("home"), "free motion to 'home'"),
        (rp.FreeMotion([0.1, 0.2]), "free motion to a configuration"),
        (rp.FreeMotion(np.zeros(2)), "free motion to a configuration"),
        (rp.FreeMotion(POSE), "free motion to 'tool' at [0.1, 0.2, 0.3] m"),
        (rp.FreeMotion([POSE, "home", [0.1, 0.2]]), "free motion to one of 3 goals"),
        (rp.FreeMotion({"a": "home", "b": "home"}), "free motion of a and b"),
        (rp.StraightLine(POSE), "straight line to 'tool' at [0.1, 0.2, 0.3] m"),
        (rp.StraightLine([POSE, POSE]), "straight line to one of 2 goals"),
        (rp.StraightLine(offset=[0, 0, -0.08]), "straight line 80 mm down"),
        (rp.StraightLine(offset=[0, 0, 0.05], axes="tool"), "straight line 50 mm ahead"),
        (rp.StraightLine(offset=[0.1, 0, 0]), "straight line by [0.1, 0, 0] m"),
        (rp.MoveGripper("open"), "gripper to 'open'"),
        (rp.MoveGripper(0.25), "gripper joint to 0.25"),
        (rp.StraightLine(offset=[0, 0, 20]), "straight line 20000 mm up"),
        (rp.MoveGripper(width=0.03), "gripper to 30 mm"),
        (rp.MoveGripper(width=1.2), "gripper to 1200 mm"),
        (rp.MoveGripper(around="cup"), "gripper around 'cup'"),
        (rp.Attach("cup"), "attach 'cup'"),
        (rp.Detach("cup"), "detach 'cup'"),
        (rp.Pause(0.5), "pause of 0.5 s"),
    ],
)
def test_a_segment_says_what_it_is(segment: rp.FreeMotion, label: str) -> None:
    assert segment.label == label


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: rp.StraightLine(), "either a goal or an offset"),
        (lambda: rp.StraightLine(POSE, offset=[0, 0, 1]), "either a goal or an offset"),
        (lambda: rp.StraightLine([0, 0, -0.1]), "expected a PoseGoal; a displacement is its option offset"),
        (lambda: rp.StraightLine(offset=[0, 0]), "offset"),
        (lambda: rp.StraightLine(offset=[0, 0, 1], axes="hand"), "'hand'"),
        (lambda: rp.MoveGripper(), "one of a position, a width"),
        (lambda: rp.MoveGripper("open", width=0.1), "one of a position, a width"),
        (lambda: rp.MoveGripper(width=-0.01), "width"),
        (lambda: rp.MoveGripper("open", seconds=-1.0), "seconds"),
        (lambda: rp.Pause(0.0), "seconds"),
        (lambda: rp.Pause(1e9), "at most"),
        (lambda: rp.FreeMotion({"a": "home"}, arm="a"), "one of them"),
        (lambda: rp.FreeMotion("home", allow=[("a", "a")]), "two names"),
        (lambda: rp.Attach("cup", touch=3), "touch"),
    ],
)
def test_a_segment_that_makes_no_sense_is_refused(make: Callable[[], object], message: str) -> None:
    with pytest.raises(rp.InputError, match=message):
        make()


@pytest.mark.parametrize(
    ("segments", "message"),
    [
        ([], "0 segments, expected 1"),
        ([rp.Pause(1.0), "home"], "segment 2 is 'home'"),
        ([rp.FreeMotion("nowhere")], r"segment 1 \(free motion to 'nowhere'\).*nowhere"),
        ([rp.FreeMotion([])], "segment 1.*empty list"),
        ([rp.FreeMotion("home", arm="other")], "segment 1.*'other'"),
        ([rp.FreeMotion("home", allow=[("arm", "bloc")])], "segment 1.*'bloc'"),
        ([rp.FreeMotion(rp.PoseGoal("block", [0, 0, 1], [1, 0, 0, 0]))], "segment 1.*'block'"),
        ([rp.Attach("block"), rp.StraightLine(rp.PoseGoal("block", [0, 0, 1]))], "segment 2.*no quaternion"),
        ([rp.MoveGripper("half")], "segment 1.*'half'"),
        ([rp.MoveGripper(5.0)], "segment 1.*outside"),
        ([rp.MoveGripper(around="cup")], "segment 1.*'cup'"),
        ([rp.Attach("cup")], "segment 1.*'cup'"),
        ([rp.Attach("block"), rp.Attach("block")], "segment 2.*'block'"),
        ([rp.Attach("block", link="finger")], "segment 1.*'finger'"),
        ([rp.Detach("block")], "segment 1.*'block'"),
        ([rp.Attach("block"), rp.Detach("block"), rp.Detach("block")], "segment 3.*'block'"),
    ],
)
def test_a_sequence_names_the_segment_that_does_not_fit(table: rp.Scene, segments: list, message: str) -> None:
    with pytest.raises(rp.InputError, match=message):
        rp.Sequence(table, segments)


def test_unknown_obstacles_come_with_the_known_ones_in_order(table: rp.Scene) -> None:
    names = [f"thing_{k}" for k in "dbfaec"]
    for name in names:
        table = table.with_obstacle(name, rp.Sphere(0.01), [0, 0, 2])
    with pytest.raises(rp.InputError) as caught:
        rp.Sequence(table, [rp.Attach("zzz")])
    found = [str(caught.value).index(name) for name in names]
    assert found == sorted(found)


def test_a_gripper_state_without_joints_of_the_gripper_is_refused(rr1: rp.Robot) -> None:
    robot = replace(rr1, locked_joint_states={**rr1.locked_joint_states, "empty": {}})
    with pytest.raises(rp.InputError, match=r"'empty' of robot 'rr1' sets no joint of its gripper \(finger_joint\)"):
        rp.Sequence(rp.Scene().with_arm("arm", robot), [rp.MoveGripper("empty")])


def test_a_gripper_without_fingers_is_refused(planar2r: rp.Robot) -> None:
    said = "no locked joint in its hand, expected one that moves its fingers: .* joints= or groups= that leave this"
    for segment in (rp.MoveGripper(width=0.01), rp.MoveGripper("open"), rp.MoveGripper(0.01)):
        with pytest.raises(rp.InputError, match=f"{said}.*; a hand without fingers takes segments with Attach"):
            rp.Sequence(rp.Scene().with_arm("arm", planar2r), [segment])


def test_an_object_that_is_held_is_not_unknown(table: rp.Scene) -> None:
    with pytest.raises(rp.InputError, match=r"segment 2 \(attach 'block'\): 'arm' already holds 'block'; detach it"):
        rp.Sequence(table, [rp.Attach("block"), rp.Attach("block")])


def test_a_gripper_of_independent_fingers_is_refused(rr1: rp.Robot) -> None:
    joints = tuple(replace(joint, mimic=None) for joint in rr1.joints)
    locked = {**rr1.locked_joints, "opposite_finger_joint": 0.0}
    robot = replace(rr1, joints=joints, locked_joints=locked)
    said = r"2 locked joints \(finger_joint, opposite_finger_joint\) in its hand, .*: let the others mimic one"
    with pytest.raises(rp.InputError, match=said):
        rp.Sequence(rp.Scene().with_arm("arm", robot), [rp.MoveGripper(width=0.01)])


def test_a_gripper_with_a_fixed_jaw_has_no_width(rr1: rp.Robot) -> None:
    joints = tuple(
        replace(joint, kind="fixed", mimic=None) if joint.name == "opposite_finger_joint" else joint
        for joint in rr1.joints
    )
    scene = rp.Scene().with_arm("arm", replace(rr1, joints=joints))
    with pytest.raises(rp.InputError, match=r"the gripper of robot 'rr1' closes from one side only, .* fixed jaw"):
        opening_value(scene.arms["arm"].robot, 0.02)
    scene = scene.with_obstacle("block", rp.Box((0.02, 0.02, 0.04)), [0.3, 0.0, 0.02])
    with pytest.raises(rp.InputError, match=r"cannot grasp 'block' from above, .* closes from one side only"):
        rp.top_grasps(scene, "block")
