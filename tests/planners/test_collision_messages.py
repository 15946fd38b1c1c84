"""Messages for a start or goal in collision: pairs, depths, and remedies for attached objects."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

import rr1plan as rp

PLACE = (-0.35, 0.1)
HEIGHT = 0.08


def table_with_can(robot: rp.Robot, above: float = 0.0) -> rp.Scene:
    """A can in the hand, `above` a table's top at z = 0.1 [m]."""
    table = rp.Box((0.2, 0.2, 0.1))
    scene = rp.Scene().with_arm("rr1", robot).with_obstacle("table", table, [*PLACE, 0.05])
    q = rp.solve_ik(rp.Kinematics(robot), rp.PoseGoal("tool", [*PLACE, 0.1 + HEIGHT], (0, 1, 0, 0)), rng=0).solutions[0]
    can = rp.Cylinder(0.015, HEIGHT)
    scene = scene.with_configuration("rr1", q).with_obstacle("can", can, [*PLACE, 0.1 + 0.5 * HEIGHT + above])
    return scene.attach("can", touch=["hand_link", "finger_link", "opposite_finger_link"])


def reason(scene: rp.Scene) -> str:
    result = rp.plan(rp.Problem(scene, scene.configuration(), "home"), rng=0)
    assert result.status is rp.PlanStatus.INVALID_START
    return result.reason


@pytest.fixture(scope="module")
def held(rr1: rp.Robot) -> rp.Scene:
    return table_with_can(rr1.with_locked_joints("open"))


def test_a_held_object_on_its_table_is_told_to_be_allowed_or_lifted(held: rp.Scene) -> None:
    said = reason(held)
    assert "'can' and 'table' touch" in said or "'table' and 'can' touch" in said
    assert "by 0 m" not in said
    # Both remedies work as they are written.
    (allow,) = re.findall(r"scene(\.allow\('can', 'table'\))", said)
    allowed = eval(f"held{allow}")
    assert rp.plan(rp.Problem(allowed, held.configuration(), "home"), rng=0).found
    (lift,) = re.findall(r"hold 'can' ([0-9.]+) mm higher", said)
    assert float(lift) == pytest.approx(0.5, abs=0.01)
    lifted = table_with_can(held.arms["rr1"].robot, 1e-3 * float(lift))
    assert rp.plan_motion(rp.Problem(lifted, lifted.configuration(), "home"), rng=0).report.certified


def test_the_words_for_a_scene_file_are_those_of_scene_files(held: rp.Scene, tmp_path: Path) -> None:
    (line,) = re.findall(r"in a scene file (allowed = \[\[.*?\]\])", reason(held))
    (table,) = re.findall(r"that of \[(attachments\.can)\]", reason(held))
    text = rp.save_scene(tmp_path / "held.toml", held).read_text()
    assert f"[{table}]" in text
    (tmp_path / "cell.toml").write_text(f"{line}\n{text}")
    scene = rp.load_scene(tmp_path / "cell.toml")
    assert tomllib.loads(line)["allowed"] == [["can", "table"]]
    assert rp.plan(rp.Problem(scene, scene.configuration(), "home"), rng=0).found


def test_names_with_quotes_are_written_as_in_scene_files(held: rp.Scene) -> None:
    (top,) = held.obstacles["table"].geometries
    scene = held.without_obstacle("table").with_obstacle('the "big" table', top.shape, [*PLACE, 0.05])
    (line,) = re.findall(r"in a scene file (allowed = .*\]\])", reason(scene))
    assert tomllib.loads(line)["allowed"] == [["can", 'the "big" table']]


def test_a_gap_below_the_kernel_s_rounding_names_its_pair(rr1: rp.Robot) -> None:
    said = reason(table_with_can(rr1.with_locked_joints("open"), 5e-10))
    assert re.search("'(can|table)' and '(can|table)' touch", said)
    assert "allow" in said


def test_a_padding_counts_in_how_far_to_lift(held: rp.Scene) -> None:
    said = reason(held.with_padding(0.003, "can", "table"))
    assert "touch" in said
    assert "3.5 mm higher" in said
    near = reason(table_with_can(held.arms["rr1"].robot, 0.002).with_padding(0.003, "can", "table"))
    assert re.search("are 2 mm apart, nearer than the padding of 3 mm", near)
    assert "rests" not in near
    assert "nearer than the padding of 3000 mm" in reason(held.with_padding(3.0, "rr1/hand_link", "table"))


def test_a_held_object_deep_in_an_obstacle_is_not_said_to_rest(held: rp.Scene) -> None:
    said = reason(table_with_can(held.arms["rr1"].robot, -0.004))
    assert re.search("overlap by 4(\\.0+)? mm", said)
    assert "allow" not in said


def test_the_links_that_hold_an_object_are_named_in_one_hint(rr1: rp.Robot) -> None:
    robot = rr1.with_locked_joints("open")
    scene = rp.Scene().with_arm("rr1", robot)
    at = scene.link_poses()["rr1/tool"]
    scene = scene.with_obstacle("can", rp.Cylinder(0.03, 0.12), at).attach("can", touch=["finger_link"])
    said = reason(scene)
    assert said.count("touches the hand") == 1
    assert "name the links with scene.attach('can', touch=['opposite_finger_link', 'hand_link'])" in said
    assert 'touch = ["opposite_finger_link", "hand_link"] in [attachments.can]' in said
    assert "finger_link" not in said.split(";", 1)[1].replace("opposite_finger_link", "")


@pytest.mark.usefixtures("foreign_robots")
def test_a_link_that_stands_on_the_floor_is_told_to_be_allowed() -> None:
    """The root link may touch anything; here it is a frame, to which the link on the floor is fixed."""
    scene = rp.Scene().with_arm("arm", rp.load_robot("xarm7")).with_obstacle("floor", rp.HalfSpace())
    said = reason(scene)
    assert "'arm/link_base' does not move: if it stands on 'floor', allow the pair" in said
    standing = scene.allow("arm/link_base", "floor")
    assert rp.plan(rp.Problem(standing, None, "home"), rng=0).found


def test_a_goal_on_the_table_is_answered_in_the_same_words(held: rp.Scene) -> None:
    free = table_with_can(held.arms["rr1"].robot, 0.001)
    goal = free.configuration()
    # 1 mm lower than where it starts.
    T = rp.Kinematics(free).pose(goal)
    T = T.copy()
    T[2, 3] -= 0.001
    result = rp.plan(rp.Problem(free, None, rp.PoseGoal("tool", T, position_tolerance=1e-7)), rng=0)
    assert result.status is rp.PlanStatus.INVALID_GOAL
    assert "the held 'can' rests on 'table'" in result.reason


def test_the_referee_says_the_same_of_a_motion_that_starts_on_the_table(held: rp.Scene) -> None:
    report = rp.validate(rp.Trajectory.rest(held.joint_names(), held.configuration()), held)
    (violation,) = report.violations
    assert "touch at 0.00000 s" in violation.message
    assert "0.000 mm" not in violation.message
    assert "scene.allow('can', 'table')" in violation.message
    assert "hold 'can' 0.5 mm higher" in violation.message


@pytest.mark.parametrize(("boxes", "words"), [(4, "and 1 more pair"), (5, "and 2 more pairs")])
def test_further_pairs_are_counted(planar2r: rp.Robot, boxes: int, words: str) -> None:
    scene = rp.Scene().with_arm("arm", planar2r)
    for k in range(boxes):
        scene = scene.with_obstacle(f"box{k}", rp.Box((0.05, 0.05, 0.05)), [0.2 + 0.08 * k, 0.0, 0.0])
    assert re.search(rf"{words}(;|$)", reason_at(scene, [0.0, 0.0]))


def reason_at(scene: rp.Scene, q: list[float]) -> str:
    """Why a plan from there is refused."""
    return str(rp.plan(rp.Problem(scene, q, [1.5, 0.0]), rng=0).reason)


def test_links_of_locked_joints_that_touch_are_told_to_be_set_apart(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    box = "<collision><origin xyz='0.2 0 0'/><geometry><box size='0.3 0.05 0.05'/></geometry></collision>"
    limit = "<limit lower='-2' upper='2' velocity='1' effort='1'/>"
    joints = "".join(
        f"<link name='{name}'>{box}</link><joint name='{name}_joint' type='revolute'><parent link='base'/>"
        f"<child link='{name}'/><origin xyz='0 0 {height}'/><axis xyz='0 0 1'/>{limit}</joint>"
        for name, height in (("arm", 0.5), ("left", 0.0), ("right", 0.03))
    )
    (tmp_path / "body.urdf").write_text(f"<robot name='body'><link name='base'/>{joints}</robot>")
    (tmp_path / "body.srdf").write_text(
        "<robot name='body'><group name='arm'><joint name='arm_joint'/></group>"
        "<group_state name='apart'><joint name='left_joint' value='1'/></group_state>"
        "<disable_collisions link1='base' link2='arm' reason='Adjacent'/></robot>"
    )
    robot = rp.load_robot(tmp_path / "body.urdf")
    advice = "home: left - right; no planned joint separates them: set the locked joints, robot.with_locked_joints"
    assert f"{advice} ('apart')" in caplog.text
    said = reason(rp.Scene().with_arm("body", robot))
    assert "no planned joint of 'body' separates them" in said
    (state,) = re.findall(r"robot\.with_locked_joints\('(\w+)'\)", said)
    apart = rp.Scene().with_arm("body", robot.with_locked_joints(state))
    assert rp.plan(rp.Problem(apart, "home", [1.0]), rng=0).found


def test_an_arm_in_contact_that_does_not_move_is_told_to_be_moved(planar2r: rp.Robot) -> None:
    scene = rp.Scene().with_arm("arm", planar2r).with_arm("other", planar2r, [5.0, 0.0, 0.0])
    scene = scene.with_obstacle("box", rp.Box((0.3, 0.3, 0.3)), [5.4, 0.0, 0.0])
    result = rp.plan(rp.Problem(scene, None, {"arm": [1.0, 0.0]}), rng=0)
    assert result.status is rp.PlanStatus.INVALID_START
    assert result.reason.count("'other' does not move in this problem") == 1
    assert "allow" not in result.reason
    raised = scene.with_configuration("other", [2.0, 0.0])
    assert rp.plan(rp.Problem(raised, None, {"arm": [1.0, 0.0]}), rng=0).found
