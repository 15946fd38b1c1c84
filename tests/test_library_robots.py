"""Loading robots by name and from files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.errors import FormatError, InputError, UnknownNameError
from rr1plan.report import Report
from rr1plan.robot.joint_limits import Limits
from rr1plan.scene import model_library
from rr1plan.scene.unlocked_joints import unlocked_robot

LIMIT = '<limit lower="{}" upper="{}" velocity="2" effort="3"/>'


def arm_text(*joints: tuple[str, float, float], limit: str = LIMIT) -> str:
    parts = ['<link name="l0"/>']
    for i, (name, lower, upper) in enumerate(joints):
        parts.append(
            f'<link name="l{i + 1}"/><joint name="{name}" type="revolute"><parent link="l{i}"/>'
            f'<child link="l{i + 1}"/><axis xyz="0 0 1"/>{limit.format(lower, upper)}</joint>'
        )
    return '<robot name="arm">' + "".join(parts) + "</robot>"


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    file = tmp_path / "urdf" / "arm.urdf"
    file.parent.mkdir()
    file.write_text(arm_text(("a", -1, 1), ("b", 0.5, 1.5), ("c", -2, -1)))
    return file


def test_an_unknown_name_is_answered_with_the_known_ones() -> None:
    with pytest.raises(UnknownNameError, match="rr1"):
        rp.load_robot("rr11")


def test_a_file_with_another_suffix_or_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="suffix"):
        rp.load_robot(tmp_path / "robot.sdf")
    with pytest.raises(FormatError, match="no such file"):
        rp.load_robot(tmp_path / "robot.urdf")


def test_all_driven_joints_are_planned_for_by_default(arm: Path) -> None:
    robot = rp.load_robot(arm)
    assert robot.joint_names == ("a", "b", "c")
    assert robot.tool == "l3"
    assert robot.home.tolist() == [0.0, 1.0, -1.5]
    assert robot.source == str(arm)


def test_a_robot_without_shapes_says_so_and_goes_the_whole_line(arm: Path, caplog: pytest.LogCaptureFixture) -> None:
    robot = rp.load_robot(arm)
    assert "no link has a <collision>" in caplog.text
    scene = rp.Scene().with_arm("arm", robot).with_obstacle("box", rp.Box((1.0, 1.0, 1.0)))
    motion = rp.plan_motion(rp.Problem(scene, "home", [0.5, 0.7, -1.8]), rng=0)
    assert motion.valid
    assert motion.report.certified
    assert rp.simulate(motion.trajectory, scene).free


def coupled(leader: str, follower: str) -> str:
    """An arm with two joints, where the second follows the first."""
    joint = '<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/><axis xyz="0 0 1"/>{}</joint>'
    links = "".join(f'<link name="l{i}"/>' for i in range(3))
    kinds = ["continuous" if "lower" not in text else "revolute" for text in (leader, follower)]
    first = joint.format("a", kinds[0], "l0", "l1", leader)
    return f'<robot name="arm">{links}{first}{joint.format("b", kinds[1], "l1", "l2", follower)}</robot>'


LIMITED, BEYOND = "joint 'a' is limited by 'b', which follows it", "joint 'b' follows 'a' beyond its limits"
TURNS, WHOLE_TURN = '<limit velocity="2" effort="3"/>', 2.0 * np.pi


@pytest.mark.parametrize(
    ("leader", "follower", "expected", "words"),
    [
        (LIMIT.format(-3, 3), LIMIT.format(-0.5, 0.6) + '<mimic joint="a"/>', (-0.5, 0.6, 2.0), LIMITED),
        (
            LIMIT.format(-3, 3),
            LIMIT.format(-1, 2) + '<mimic joint="a" multiplier="-4" offset="1"/>',
            (-0.25, 0.5, 0.5),
            LIMITED,
        ),
        (LIMIT.format(-1, 1), LIMIT.format(-9, 9) + '<mimic joint="a" multiplier="0.5"/>', (-1.0, 1.0, 2.0), ""),
        (LIMIT.format(-1, 1), LIMIT.format(5, 6) + '<mimic joint="a"/>', (-1.0, 1.0, 2.0), BEYOND),
        (TURNS, LIMIT.format(-2, 1) + '<mimic joint="a"/>', (-2.0, 1.0, 2.0), LIMITED),
        (TURNS, '<mimic joint="a" multiplier="2"/>', (-np.inf, np.inf, 2.0), ""),
        (TURNS, '<mimic joint="a" multiplier="0.5"/>', (-WHOLE_TURN, WHOLE_TURN, 2.0), LIMITED),
    ],
    ids=["range", "turned around", "wide", "never within", "continuous", "whole turns", "half turns"],
)
def test_a_joint_keeps_the_limits_of_those_that_follow_it(
    leader: str,
    follower: str,
    expected: tuple[float, float, float],
    words: str,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    file = tmp_path / "arm.urdf"
    file.write_text(coupled(leader, follower))
    robot = rp.load_robot(file)
    assert robot.joint_names == ("a",)
    np.testing.assert_allclose([robot.limits.lower[0], robot.limits.upper[0], robot.limits.velocity[0]], expected)
    assert [said for said in (LIMITED, BEYOND) if said in caplog.text] == ([words] if words else [])
    assert bool(robot.continuous[0]) == np.isinf(expected[1])


@pytest.mark.parametrize("suffix", ["urdf", "xml"])
def test_limits_that_no_configuration_reaches_make_a_joint_continuous(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, suffix: str
) -> None:
    """SDF, and what is converted from it, writes ±1e16 for a joint without limits."""
    file = tmp_path / f"arm.{suffix}"
    joints = [("a", -1e16, 1e16), ("b", -1, 1), ("c", -170, 170)]
    text = arm_text(*joints)
    if suffix == "xml":
        bodies = "".join(
            f'<body pos="0 0 1"><geom size="0.1"/><joint name="{name}" range="{lower} {upper}"/>'
            for name, lower, upper in joints
        )
        text = f'<mujoco model="arm"><compiler angle="radian"/><worldbody>{bodies}{"</body>" * 3}</worldbody></mujoco>'
    file.write_text(text)
    robot = rp.load_robot(file)
    assert robot.continuous.tolist() == [1, 0, 0]
    assert robot.limits.upper.tolist() == [np.inf, 1, 170]
    assert "arm: joint 'a' has limits -1e+16 to 1e+16 rad, it is taken as continuous" in caplog.text
    assert "arm: joint 'c' has limits -170 to 170 rad (angles are in radians: are these degrees?)" in caplog.text
    assert "joint 'b' has" not in caplog.text


@pytest.mark.parametrize(("length", "is_said"), [(0.2, False), (200, True)])
def test_a_robot_that_seems_to_be_in_millimeters_is_said(
    arm: Path, length: float, is_said: bool, caplog: pytest.LogCaptureFixture
) -> None:
    arm.write_text(arm.read_text().replace("<axis", f'<origin xyz="0 0 {length}"/><axis'))
    rp.load_robot(arm)
    said = "arm: its joints reach 600 m from the base; if its file is in millimeters, multiply all lengths by 0.001"
    assert (said in caplog.text) == is_said
    arm.write_text(arm_text(("a", 0, length), ("b", -1, 1)).replace("revolute", "prismatic"))
    rp.load_robot(arm)
    assert ("arm: its joints reach 201 m from the base" in caplog.text) == is_said


def test_a_planning_joint_with_an_endless_limit_on_one_side_or_of_a_slide_is_refused(arm: Path) -> None:
    text = arm_text(("a", -1, 1), ("b", 0, 1e16))
    for urdf, limits in ((text, "0 to 1e"), (text.replace("revolute", "prismatic").replace('"0"', '"-1e16"'), "-1e")):
        arm.write_text(urdf)
        with pytest.raises(InputError, match=rf"arm.urdf: joint 'b' has limits {limits}\+16.*expected at most ±10000"):
            rp.load_robot(arm)
        assert rp.load_robot(arm, joints=["a"]).joint_names == ("a",)


def test_the_default_tool_is_behind_joints_that_mimic_planning_joints(tmp_path: Path) -> None:
    """The wrist of a palletizer is level because it mimics the joints before it."""
    text = arm_text(("a", -1, 1), ("b", -1, 1), ("level", -1, 1)).replace(
        "</joint></robot>", '<mimic joint="b" multiplier="-1"/></joint></robot>'
    )
    (tmp_path / "arm.urdf").write_text(text)
    assert rp.load_robot(tmp_path / "arm.urdf").tool == "l3"
    assert rp.load_robot(tmp_path / "arm.urdf", joints=["a"]).tool == "l1"


def test_chosen_joints_keep_their_order_and_the_others_are_held_near_zero(arm: Path) -> None:
    robot = rp.load_robot(arm, joints=["b", "a"], tool="l1")
    assert robot.joint_names == ("b", "a")
    assert robot.limits.upper.tolist() == [1.5, 1.0]
    assert dict(robot.locked_joints) == {"c": -1.0}
    assert robot.tool == "l1"


@pytest.mark.parametrize("joints", [[], ["a", "a"], ["x"]])
def test_joints_that_cannot_be_planned_for_are_refused(arm: Path, joints: list[str]) -> None:
    with pytest.raises(InputError):
        rp.load_robot(arm, joints=joints)


def test_unknown_groups_tools_and_presets_are_refused(arm: Path) -> None:
    with pytest.raises(UnknownNameError, match="group"):
        rp.load_robot(arm, groups=["arm"])
    with pytest.raises(UnknownNameError, match="link"):
        rp.load_robot(arm, tool="l9")
    with pytest.raises(UnknownNameError, match="preset"):
        rp.load_robot(arm).with_limits("sim")
    with pytest.raises(UnknownNameError, match="sim"):
        rp.load_robot("rr1").with_limits("simulation")


def test_limits_of_another_length_are_refused(arm: Path) -> None:
    with pytest.raises(InputError, match="limits for 2 of 3"):
        rp.load_robot(arm).with_limits(Limits(*(np.full(2, v) for v in (-1, 1, 1, 1, 1, 1))))


def test_a_preset_or_limits_can_be_asked_for() -> None:
    robot = rp.load_robot("rr1").with_limits("hardware")
    assert robot.limits.velocity[0] == 0.346
    assert rp.load_robot("rr1").with_limits(robot.limits).limits is robot.limits


def test_equal_loads_share_a_robot_and_a_changed_file_is_read_anew(arm: Path) -> None:
    robot = rp.load_robot(arm)
    assert rp.load_robot(arm) is robot
    assert rp.load_robot(arm, joints=robot.joint_names[:1]) is not robot
    text = arm.read_text()
    # Collision shapes and joints are equal, so plans are the same.
    visual = '<visual><geometry><sphere radius="0.1"/></geometry></visual>'
    arm.write_text(text.replace('<link name="l0"/>', f'<link name="l0">{visual}</link>'))
    seen = rp.load_robot(arm)
    assert seen.content_hash == robot.content_hash
    assert seen is not robot
    assert len(seen.links[0].visuals) == 1
    arm.write_text(text)
    assert rp.load_robot(arm) is robot


def test_a_locked_joint_stays_where_its_followers_keep_their_limits(arm: Path) -> None:
    follows = '<mimic joint="b" multiplier="-2" offset="0.5"/></joint></robot>'
    arm.write_text(arm_text(("a", -1, 1), ("b", -1, 1), ("c", -1, 1)).replace("</joint></robot>", follows))
    robot = rp.load_robot(arm, joints=["a"])
    assert robot.with_locked_joints({"b": 0.75}).joint_values([0.0])["c"] == -1.0
    with pytest.raises(InputError, match=r"joint 'b' is -0.3, outside \[-0.25, 0.75\]"):
        robot.with_locked_joints({"b": -0.3})


def test_what_urdf_does_not_know_is_taken_carefully(arm: Path, caplog: pytest.LogCaptureFixture) -> None:
    limits = rp.load_robot(arm).limits
    assert limits.acceleration.tolist() == [8.0] * 3
    assert limits.jerk.tolist() == [80.0] * 3
    arm.write_text(arm_text(("a", -1, 1), limit='<limit lower="{}" upper="{}"/>'))
    limits = rp.load_robot(arm).limits
    assert (limits.velocity[0], limits.acceleration[0], limits.effort[0]) == (1.0, 4.0, np.inf)
    assert "no velocity limit for a: 1 rad/s (0.25 m/s) is taken; set others by robot.with_limits" in caplog.text


def test_limits_of_acceleration_and_jerk_of_urdf_1_2_are_kept(arm: Path, caplog: pytest.LogCaptureFixture) -> None:
    limit = LIMIT.replace("/>", ' acceleration="5" deceleration="4" jerk="50"/>')
    text = arm_text(("a", -1, 1), ("b", -1, 1), ("c", -1, 1), limit=limit)
    follows = '<mimic joint="b" multiplier="-2"/></joint></robot>'
    arm.write_text(text.replace("</joint></robot>", follows).replace("acceleration", "none", 1))
    robot = rp.load_robot(arm)
    assert robot.joint_names == ("a", "b")
    assert robot.limits.acceleration.tolist() == [4.0, 2.0]
    assert robot.limits.jerk.tolist() == [50.0, 25.0]
    # Also of a joint that is not planned for.
    assert unlocked_robot(rp.load_robot(arm, joints=["a"]), ("b",)).limits.acceleration.tolist() == [4.0, 2.0]
    arm.write_text(text.replace('jerk="50"', 'jerk="0"'))
    assert rp.load_robot(arm).limits.jerk.tolist() == [40.0, 40.0, 40.0]
    assert "joint 'a' has jerk 0, it is taken as unknown" in caplog.text
    arm.write_text(text.replace('deceleration="4"', 'deceleration="-4"'))
    with pytest.raises(FormatError, match=r"arm.urdf:1: joint 'a' has deceleration -4.0, expected a number above zero"):
        rp.load_robot(arm)


def test_limits_at_which_a_follower_leaves_its_own_are_refused(arm: Path) -> None:
    follows = '<mimic joint="a" multiplier="-2" offset="0.1"/></joint></robot>'
    arm.write_text(arm_text(("a", -1, 1), ("b", -1, 1)).replace("</joint></robot>", follows))
    robot = rp.load_robot(arm)
    np.testing.assert_allclose([robot.limits.lower[0], robot.limits.upper[0]], [-0.45, 0.55])
    assert robot.with_limits(replace(robot.limits, velocity=[1.0], lower=[-0.3])).limits.lower[0] == -0.3
    with pytest.raises(InputError, match=r"let 'b', which follows other joints, reach -1.9 rad, outside its"):
        robot.with_limits(replace(robot.limits, upper=[1.0]))


STATE = """
<robot name="arm">
  <group name="g"><joint name="a"/></group>
  <group_state name="up" group="g"><joint name="a" value="0.5"/></group_state>
</robot>
"""


@pytest.mark.parametrize("place", ["urdf/arm.srdf", "srdf/arm.srdf"])
def test_an_srdf_of_the_same_name_is_found_beside_the_urdf(arm: Path, place: str) -> None:
    file = arm.parent.parent / place
    file.parent.mkdir(exist_ok=True)
    file.write_text(STATE)
    robot = rp.load_robot(arm)
    assert robot.joint_names == ("a",)
    assert robot.home.tolist() == [0.5]
    assert rp.load_robot(arm, srdf=False).joint_names == ("a", "b", "c")
    assert rp.load_robot(arm, groups=["g"], srdf=file).joint_names == ("a",)


def test_a_state_outside_the_limits_is_said_with_its_robot(arm: Path, caplog: pytest.LogCaptureFixture) -> None:
    (arm.parent / "arm.srdf").write_text(STATE.replace('value="0.5"', 'value="1.5"'))
    rp.load_robot(arm)
    assert "arm: the state 'up' is outside the joints' limits (a at 1.5, not -1 to 1)\n" in caplog.text
    (arm.parent / "arm.srdf").write_text(STATE.replace('value="0.5"', 'value="90"'))
    rp.load_robot(arm)
    assert "limits (a at 90, not -1 to 1) (angles are in radians: are these degrees?)\n" in caplog.text


def test_a_home_outside_the_limits_is_moved_to_them(arm: Path, caplog: pytest.LogCaptureFixture) -> None:
    (arm.parent / "arm.srdf").write_text(STATE.replace('value="0.5"', 'value="1.5"').replace('"up"', '"home"'))
    robot = rp.load_robot(arm)
    assert robot.home.tolist() == [1.0]
    assert "(a at 1.5, not -1 to 1); it is moved to them" in caplog.text
    scene = rp.Scene().with_arm("arm", robot)
    assert rp.plan(rp.Problem(scene, "home", [0.0]), rng=0).found


def test_a_state_outside_the_limits_by_a_turn_or_by_rounding_is_moved_into_them(
    arm: Path, caplog: pytest.LogCaptureFixture
) -> None:
    two = STATE.replace("</group>", '<joint name="b"/></group>').replace(
        "</group_state>", '<joint name="b" value="1.50001"/></group_state>'
    )
    (arm.parent / "arm.srdf").write_text(two.replace('value="0.5"', 'value="-6.0"'))
    robot = rp.load_robot(arm)
    np.testing.assert_allclose(robot.configurations["up"], [2.0 * np.pi - 6.0, 1.5], atol=1e-15)
    np.testing.assert_array_equal(robot.home, robot.configurations["up"])
    assert "(a at -6, not -1 to 1); it is moved by whole turns\n" in caplog.text
    # No turn of a sliding joint is the same place.
    arm.write_text(arm.read_text().replace("revolute", "prismatic"))
    assert rp.load_robot(arm).configurations["up"].tolist() == [-6.0, 1.50001]


def test_a_broken_srdf_is_an_error_not_ignored(arm: Path) -> None:
    (arm.parent / "arm.srdf").write_text('<robot name="arm"><group name="g"><group name="g"/></group></robot>')
    with pytest.raises(FormatError, match=r"arm\.srdf:1"):
        rp.load_robot(arm)


def test_fixed_and_mimic_joints_are_not_planned_for(tmp_path: Path) -> None:
    text = arm_text(("a", -1, 1), ("b", -1, 1)).replace("</joint></robot>", '<mimic joint="a"/></joint></robot>')
    (tmp_path / "arm.urdf").write_text(text)
    robot = rp.load_robot(tmp_path / "arm.urdf")
    assert robot.joint_names == ("a",)
    assert dict(robot.locked_joints) == {}
    with pytest.raises(InputError, match="'b' is fixed or mimics"):
        rp.load_robot(tmp_path / "arm.urdf", joints=["b"])


def test_a_robot_that_cannot_move_is_refused(tmp_path: Path) -> None:
    (tmp_path / "stone.urdf").write_text('<robot name="stone"><link name="a"/></robot>')
    with pytest.raises(InputError, match=r"stone\.urdf: there is no joint to plan for"):
        rp.load_robot(tmp_path / "stone.urdf")


def test_a_suffix_may_have_capital_letters_and_one_of_another_format_is_named(
    arm: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(arm.parent)
    arm.rename("ARM.URDF")
    assert rp.load_robot("ARM.URDF").joint_names == ("a", "b", "c")
    Path("arm.step").write_text("a CAD file")
    with pytest.raises(InputError, match=r"'arm.step' has the suffix '.step', expected .urdf"):
        rp.load_robot("arm.step")
    with pytest.raises(UnknownNameError, match=r"unknown robot 'arm2\.step'"):
        rp.load_robot("arm2.step")


def test_joints_beside_the_way_to_the_tool_are_named_once(arm: Path, caplog: pytest.LogCaptureFixture) -> None:
    branch = (
        '<link name="side"/><joint name="d" type="revolute"><parent link="l1"/><child link="side"/>'
        f'<axis xyz="0 0 1"/>{LIMIT.format(-1, 1)}</joint></robot>'
    )
    arm.write_text(arm.read_text().replace("</robot>", branch))
    assert rp.load_robot(arm).tool == "l3"
    advice = "all 4 joints are planned for, to the tool 'l3'; groups=[('l0', 'l3')] leaves out 'd'"
    assert advice in caplog.text
    caplog.clear()
    assert rp.load_robot(arm, groups=[("l0", "l3")]).joint_names == ("a", "b", "c")
    assert rp.load_robot(arm, joints=["a", "d"]).tool == "side"
    assert "planned for" not in caplog.text
    assert rp.load_robot(arm, tool="l1").tool == "l1"
    assert "to the tool 'l1'; groups=[('l0', 'l1')] leaves out 'b' and 2 more" in caplog.text


def test_a_tool_that_no_joint_moves_is_named_without_advice_to_choose_its_chain(
    arm: Path, caplog: pytest.LogCaptureFixture
) -> None:
    assert rp.load_robot(arm, tool="l0").tool == "l0"
    assert "no planning joint is on the way to the tool 'l0'" in caplog.text
    assert "groups=" not in caplog.text


def test_an_end_effector_link_beside_a_camera_is_the_tool(arm: Path) -> None:
    frames = "".join(
        f'<link name="{name}"/><joint name="{name}_fixed" type="fixed">'
        f'<parent link="l3"/><child link="{name}"/></joint>'
        for name in ("camera_link", "ee_link")
    )
    arm.write_text(arm.read_text().replace("</robot>", f"{frames}</robot>"))
    assert rp.load_robot(arm).tool == "ee_link"


@pytest.mark.parametrize("has_tool", [False, True])
def test_a_gripper_without_an_srdf_is_planned_for_with_advice(
    arm: Path, caplog: pytest.LogCaptureFixture, has_tool: bool
) -> None:
    # One finger is driven and the other mimics it, so all joints are in the chain to the last link.
    fingers = "".join(
        f'<link name="{finger}"/><joint name="{finger}_joint" type="prismatic"><parent link="l3"/>'
        f'<child link="{finger}"/><axis xyz="0 1 0"/>{LIMIT.format(0, 0.04)}{mimic}</joint>'
        for finger, mimic in (("finger1", ""), ("finger2", '<mimic joint="finger1_joint"/>'))
    )
    if has_tool:
        fingers += (
            '<link name="tcp"/><joint name="tcp_joint" type="fixed"><parent link="finger1"/><child link="tcp"/></joint>'
        )
    arm.write_text(arm.read_text().replace("</robot>", f"{fingers}</robot>"))
    whole = rp.load_robot(arm)
    assert whole.joint_names == ("a", "b", "c", "finger1_joint")
    assert whole.tool == "l3"
    assert "groups=[('l0', 'l3')] leaves out 'finger1_joint'" in caplog.text
    caplog.clear()
    alone = rp.load_robot(arm, groups=[("l0", "l3")])
    assert alone.tool == "l3"
    assert set(alone.locked_joints) == {"finger1_joint"}
    assert "planned for" not in caplog.text


# ---- robot.toml --------------------------------------------------------------------------


@pytest.fixture
def own_models(tmp_path: Path, arm: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "models" / "robots" / "arm"
    folder.mkdir(parents=True)
    (folder / "arm.urdf").write_text(arm.read_text())
    monkeypatch.setattr(model_library, "models_folder", lambda: tmp_path / "models")
    return folder / "robot.toml"


def test_a_folder_adds_presets_and_locked_joints(own_models: Path) -> None:
    own_models.write_text(
        'urdf = "arm.urdf"\nlimits = "slow"\n[presets.slow]\na = { velocity = 0.5 }\n[presets.fast]\nb = { jerk = 9 }\n'
    )
    robot = rp.load_robot("arm")
    assert robot.limits.velocity.tolist() == [0.5, 2, 2]
    assert robot.presets["fast"].jerk.tolist() == [80, 9, 80]
    assert rp.load_robot("arm", joints=["b"]).limits.velocity.tolist() == [2]


BAD_TOML = {
    "not toml": ("urdf = ", "is not TOML"),
    "no urdf": ("[about]\n", "no 'urdf'"),
    "unknown key": ('urdf = "arm.urdf"\nsdf = "x"\n', "unknown key 'sdf'"),
    "urdf of another kind": ("urdf = 3\n", "urdf"),
    "limits of another kind": ('urdf = "arm.urdf"\nlimits = 3\n', "expected text"),
    "presets of another kind": ('urdf = "arm.urdf"\npresets = 3\n', "presets"),
    "preset of another kind": ('urdf = "arm.urdf"\npresets.slow = 3\n', "slow"),
    "row of another kind": ('urdf = "arm.urdf"\npresets.slow.a = 3\n', "presets.slow.a"),
    "unknown preset": ('urdf = "arm.urdf"\nlimits = "slow"\n', "slow"),
    "unknown joint": ('urdf = "arm.urdf"\npresets.slow.x.velocity = 1\n', "'x'"),
    "unknown limit": ('urdf = "arm.urdf"\npresets.slow.a.speed = 1\n', "'speed'"),
    "nan limit": ('urdf = "arm.urdf"\npresets.slow.a.velocity = nan\n', "presets.slow.a.velocity"),
    "velocity zero": ('urdf = "arm.urdf"\npresets.slow.a.velocity = 0\n', "velocity"),
    "a word for a number": ('urdf = "arm.urdf"\npresets.slow.a.velocity = "x"\n', "velocity"),
    "unknown locked joint": ('urdf = "arm.urdf"\nlocked_joints.x = 0\n', "locked joint 'x'"),
}


@pytest.mark.parametrize("name", BAD_TOML)
def test_a_bad_robot_toml_is_a_format_error_with_the_file(own_models: Path, name: str) -> None:
    text, word = BAD_TOML[name]
    own_models.write_text(text)
    with pytest.raises(FormatError, match=r"robot\.toml") as caught:
        rp.load_robot("arm")
    assert word in str(caught.value)


TWO_ARMS = """
<robot name="arm">
  <group name="left"><joint name="b"/><joint name="a"/></group>
  <group name="right"><chain base_link="l1" tip_link="l3"/></group>
  <group_state name="home" group="left"><joint name="a" value="0.5"/><joint name="b" value="0.6"/></group_state>
  <group_state name="home" group="right"><joint name="b" value="0.6"/><joint name="c" value="-1.25"/></group_state>
  <group_state name="half" group="left"><joint name="a" value="0"/><joint name="b" value="0.6"/></group_state>
</robot>
"""


def test_several_groups_are_planned_for_as_one(arm: Path) -> None:
    (arm.parent / "arm.srdf").write_text(TWO_ARMS)
    robot = rp.load_robot(arm, groups=["right", "left"])
    assert robot.joint_names == ("b", "c", "a")
    assert robot.tool == "l3"
    assert {name: q.tolist() for name, q in robot.configurations.items()} == {"home": [0.6, -1.25, 0.5]}
    other = rp.load_robot(arm, groups=["left", "right"])
    assert (other.joint_names, other.tool) == (("a", "b", "c"), "l2")
    assert rp.load_robot(arm, groups=["left"]).joint_names == ("a", "b")


def test_groups_that_cannot_be_joined_are_refused(arm: Path) -> None:
    (arm.parent / "arm.srdf").write_text(TWO_ARMS)
    with pytest.raises(UnknownNameError, match="Did you mean 'left'"):
        rp.load_robot(arm, groups=["right", "lefd"])
    for wrong in ("left", [], ["left", "left"], 3):
        with pytest.raises(InputError, match="groups is"):
            rp.load_robot(arm, groups=wrong)


def test_chains_are_planned_for_as_one_without_a_group_in_the_srdf(arm: Path) -> None:
    robot = rp.load_robot(arm, groups=[("l1", "l3"), ["l0", "l1"]])
    assert robot.joint_names == ("b", "c", "a")
    assert robot.tool == "l3"
    (arm.parent / "arm.srdf").write_text(TWO_ARMS)
    assert rp.load_robot(arm, groups=["left", ("l1", "l3")]).joint_names == ("a", "b", "c")


def test_chains_that_are_none_are_refused(arm: Path) -> None:
    for wrong, message in (
        ([("l1", "l2", "l3")], "one of groups is .*expected a name or two"),
        ([("l1", "l7")], "link 'l7'"),
        ([("l1", 3)], "link 3"),
        ([("l1", "l3"), ("l1", "l3")], "none twice"),
        ([3], "one of groups is 3"),
        ([("l1", "l1")], "no joint to plan for"),
    ):
        with pytest.raises(InputError, match=message):
            rp.load_robot(arm, groups=wrong)


@pytest.mark.usefixtures("foreign_robots")
@pytest.mark.parametrize(
    ("name", "groups", "joints", "reach"),
    [
        ("pr2", ["left_arm", "right_arm"], 14, ("l_wrist_roll_link", "r_wrist_roll_link")),
        (
            "baxter",
            [("torso", "left_gripper"), ("torso", "right_gripper")],
            14,
            ("left_gripper", "right_gripper"),
        ),
    ],
)
def test_both_arms_of_a_robot_are_planned_for_as_one(
    name: str, groups: list[Any], joints: int, reach: tuple[str, str]
) -> None:
    robot = rp.load_robot(name, groups=groups)
    assert robot.nq == joints
    scene = rp.Scene().with_arm("robot", robot)
    assert rp.CollisionChecker(scene).is_free(robot.home)
    rng = np.random.default_rng(0)
    near = rng.uniform(
        *(np.clip(robot.home + s, robot.limits.lower, robot.limits.upper) for s in (-0.5, 0.5)), (99, 14)
    )
    goal = next(q for q in near if rp.CollisionChecker(scene).is_free(q))
    motion = rp.plan_motion(rp.Problem(scene, "home", goal), rng=0)
    assert motion, str(motion)
    moved = [scene.link_poses({"robot": q}) for q in motion.path.waypoints[[0, -1]]]
    assert robot.tool == reach[0]
    for link in reach:
        start, end = (poses[f"robot/{link}"][:3, 3] for poses in moved)
        assert np.linalg.norm(end - start) > 0.01
        reached = rp.plan(rp.Problem(scene, "home", rp.PoseGoal(link, end)), rng=0)
        assert reached.found


def test_a_scene_file_names_the_groups_of_a_robot(arm: Path, tmp_path: Path) -> None:
    (arm.parent / "arm.srdf").write_text(TWO_ARMS)
    (tmp_path / "cell.toml").write_text('[arms.pair]\nrobot = "urdf/arm.urdf"\ngroups = ["right", "left"]\n')
    assert rp.load_scene(tmp_path / "cell.toml").joint_names() == ("pair/b", "pair/c", "pair/a")
    (tmp_path / "cell.toml").write_text(
        '[arms.pair]\nrobot = "urdf/arm.urdf"\ngroups = [["l1", "l3"], "left"]\nq = [0, 0, 0]\n'
    )
    scene = rp.load_scene(tmp_path / "cell.toml")
    assert scene.joint_names() == ("pair/b", "pair/c", "pair/a")
    again = rp.load_scene(rp.save_scene(tmp_path / "again.toml", scene))
    assert again.content_hash == scene.content_hash
    (tmp_path / "cell.toml").write_text('[arms.pair]\nrobot = "urdf/arm.urdf"\ngroups = [["l1", 3]]\n')
    with pytest.raises(FormatError, match=r"cell\.toml:3.*expected names of groups or \[base link, tip link\]"):
        rp.load_scene(tmp_path / "cell.toml")


VISUAL = '<visual><geometry><sphere radius="0.02"/></geometry></visual>'
SOLID = VISUAL.replace("visual", "collision")


@pytest.fixture
def half_clothed(tmp_path: Path) -> Path:
    """An arm whose second link has only a visual; one decoration is fixed to the first link, one to the second."""
    text = arm_text(("a", -1, 1), ("b", -1, 1), ("c", -1, 1))
    for link, inside in (("l0", SOLID), ("l1", VISUAL + SOLID), ("l2", VISUAL), ("l3", SOLID)):
        text = text.replace(f'<link name="{link}"/>', f'<link name="{link}">{inside}</link>')
    for parent in ("l1", "l2"):
        text = text.replace(
            "</robot>",
            f'<link name="cap_{parent}">{VISUAL}</link><link name="frame_{parent}"/>'
            f'<joint name="c_{parent}" type="fixed"><parent link="{parent}"/><child link="cap_{parent}"/></joint>'
            f'<joint name="f_{parent}" type="fixed"><parent link="{parent}"/><child link="frame_{parent}"/></joint>'
            "</robot>",
        )
    (tmp_path / "arm.urdf").write_text(text)
    return tmp_path / "arm.urdf"


def test_visible_links_without_a_shape_are_named_on_loading_and_in_the_report(
    half_clothed: Path, caplog: pytest.LogCaptureFixture
) -> None:
    robot = rp.load_robot(half_clothed)
    assert "never checked though they are visible: l2, cap_l2" in caplog.text
    assert robot.unchecked_links == ("l2", "cap_l2")
    scene = rp.Scene().with_arm("left", robot).with_obstacle("ball", rp.Sphere(0.1), [3.0, 0.0, 0.0])
    report = rp.validate(rp.Trajectory.rest(scene.joint_names(), robot.home), scene)
    assert report.certified
    assert "not checked  left/l2, left/cap_l2: has no collision shape" in str(report)
    assert report.unchecked_links == ("left/l2", "left/cap_l2")
    verdict = str(report).splitlines()[0]
    assert "certified free of collision in continuous time, EXCEPT FOR 2 links without a collision shape" in verdict
    assert "(left/l2, left/cap_l2)" in verdict
    assert "certified except for 2 links" in repr(report)
    path = rp.Path(scene.joint_names(), [robot.home, robot.home + 0.1])
    assert "left/l2" in rp.certify_path(path, scene).not_checked


def test_a_robot_without_any_shape_has_all_its_links_in_the_report(arm: Path) -> None:
    scene = rp.Scene().with_arm("arm", rp.load_robot(arm))
    report = rp.validate(rp.Trajectory.rest(scene.joint_names(), scene.configuration()), scene)
    assert {"arm/l0", "arm/l1", "arm/l2", "arm/l3"} <= set(report.not_checked)
    assert report.verdict.startswith("VALID, but NOTHING WAS CHECKED FOR COLLISION: 4 links without a collision shape")
    assert report.verdict.endswith("(arm/l0, arm/l1, arm/l2, ...)")
    assert "checked      clock, finite, position" in str(report)
    assert Report.from_dict(report.to_dict()).verdict == report.verdict


def test_a_sequence_of_a_robot_without_any_shape_is_not_reported_as_free(arm: Path) -> None:
    scene = rp.Scene().with_arm("arm", rp.load_robot(arm))
    sequence = rp.Sequence(scene, [rp.FreeMotion(scene.arms["arm"].q + 0.1), rp.Pause(0.1)])
    assert "NOTHING WAS CHECKED FOR COLLISION" in str(rp.plan_sequence(sequence, rng=0))


def test_shipped_robots_load_without_a_warning(caplog: pytest.LogCaptureFixture) -> None:
    for name in rp.robot_names():
        assert not rp.load_robot(name).unchecked_links
    assert caplog.text == ""


# ---- robots that the extra installs ------------------------------------------------------


@pytest.mark.usefixtures("foreign_robots")
@pytest.mark.parametrize(
    ("name", "file", "joints", "srdf"),
    [
        ("ur5", "ur5_robot.urdf", 6, True),
        ("ur10", "ur10_robot.urdf", 6, False),
        ("panda", "panda.urdf", 7, True),
        ("anymal_c_simple", "anymal.urdf", 12, True),
        ("finger_edu", "finger_edu.urdf", 3, True),
    ],
)
def test_an_installed_robot_is_loaded_by_its_name(name: str, file: str, joints: int, srdf: bool) -> None:
    assert name in rp.installed_robot_names()
    robot = rp.load_robot(name)
    assert Path(robot.source).name == file
    assert robot.nq == joints
    bare = rp.load_robot(name, srdf=False)
    assert (bare.disabled_collisions != robot.disabled_collisions) is srdf


@pytest.mark.usefixtures("foreign_robots")
@pytest.mark.parametrize("name", ["double_pendulum_continuous", "icub_reduced", "simple_humanoid", "solo12"])
def test_a_joint_of_velocity_zero_and_an_srdf_of_unknown_groups_do_not_keep_a_robot_out(
    name: str,
) -> None:
    robot = rp.load_robot(name)
    assert np.isfinite(robot.limits.velocity).all()
    assert (robot.limits.velocity > 0.0).all()


@pytest.mark.usefixtures("foreign_robots")
def test_installed_robots_are_known_to_scene_files_and_to_the_message_on_a_wrong_name(tmp_path: Path) -> None:
    (tmp_path / "cell.toml").write_text('[arms.left]\nrobot = "ur5"\n')
    assert rp.load_scene(tmp_path / "cell.toml").arms["left"].robot.name == "ur5"
    with pytest.raises(UnknownNameError, match="Did you mean 'panda'") as caught:
        rp.load_robot("pandaa")
    assert "pip install" not in str(caught.value)
    with pytest.raises(UnknownNameError, match="Did you mean 'ur5'"):
        rp.load_robot("UR5")
    assert not set(rp.robot_names()) & set(rp.installed_robot_names())


def test_without_the_extra_an_unknown_name_says_how_to_install_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from rr1plan.cli import info, run

    for module in (model_library, info):
        monkeypatch.setattr(module, "installed_robots", dict)
    assert rp.installed_robot_names() == ()
    with pytest.raises(UnknownNameError, match=r"Known: planar2r.*pip install 'rr1plan\[robots\]'"):
        rp.load_robot("ur5")
    assert run(["robots"]) == 0
    assert "more come with: pip install 'rr1plan[robots]'" in capsys.readouterr().out
