"""Grasps from above and the segments of a pick-and-place."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.scene.unlocked_joints import unlocked_robot
from rr1plan.sequences.grippers import closing_value, finger_lever, grip_frame, open_value, opening_value


def standing(table: rp.Scene, shape: rp.Shape, height: float, yaw: float = 0.0) -> rp.Scene:
    return table.with_obstacle("block", shape, rp.transforms.pose([-0.3, 0.1, height / 2], rpy=[0, 0, yaw]), mass=0.1)


@pytest.mark.parametrize("yaw", [0.0, 0.4, 2.0])
def test_a_box_is_grasped_at_its_faces(table: rp.Scene, yaw: float) -> None:
    scene = standing(table, rp.Box((0.03, 0.045, 0.06)), 0.06, yaw)
    goals = rp.top_grasps(scene, "block")
    assert {goal.frame for goal in goals} == {"tool"}
    travels = np.array([goal.rotation[:, 0] for goal in goals])
    np.testing.assert_allclose(travels[:, 2], 0.0, atol=1e-12)
    angles = np.mod(np.arctan2(travels[:, 1], travels[:, 0]) - yaw, np.pi / 2)
    np.testing.assert_allclose(np.minimum(angles, np.pi / 2 - angles), 0.0, atol=1e-9)
    assert len({round(float(a), 6) for a in np.mod(np.arctan2(travels[:, 1], travels[:, 0]), 2 * np.pi)}) == 4
    np.testing.assert_allclose([goal.rotation[:, 2] for goal in goals], [[0, 0, -1]] * len(goals), atol=1e-12)
    np.testing.assert_allclose([goal.position[:2] for goal in goals], [[-0.3, 0.1]] * len(goals), atol=1e-9)


def test_a_cylinder_is_grasped_at_any_angle(table: rp.Scene) -> None:
    goals = rp.top_grasps(standing(table, rp.Cylinder(0.018, 0.05), 0.05), "block", yaws=6)
    angles = {round(float(np.arctan2(g.rotation[1, 0], g.rotation[0, 0])), 6) for g in goals}
    assert len(angles) == 6


@pytest.mark.parametrize("tilt", [0.3, 1.2])
@pytest.mark.parametrize("shape", [rp.Box((0.03, 0.04, 0.06)), rp.Cylinder(0.015, 0.06), rp.Capsule(0.015, 0.05)])
def test_a_tilted_object_is_grasped_at_opposite_sides(table: rp.Scene, shape: rp.Shape, tilt: float) -> None:
    yaw = rp.transforms.pose(rpy=[0, 0, 0.5])
    scene = table.with_obstacle(
        "block", shape, rp.transforms.pose([-0.3, 0.1, 0.1]) @ yaw @ rp.transforms.pose(rpy=[tilt, 0, 0])
    )
    goals = rp.top_grasps(scene, "block")
    np.testing.assert_allclose([abs(goal.rotation[:, 0] @ yaw[:3, 0]) for goal in goals], 1.0, atol=1e-9)
    assert len({round(float(goal.rotation[0, 0]), 6) for goal in goals}) == 2
    if tilt > 1.0 and not isinstance(shape, rp.Box):
        assert len(goals) == 2  # lower ones only


def test_a_lying_cylinder_is_grasped_across_or_at_its_ends(table: rp.Scene) -> None:
    lying = rp.transforms.pose([-0.3, 0.1, 0.015], rpy=[0.0, np.pi / 2 + 0.01, 0.7])
    for shape, angles in ((rp.Cylinder(0.015, 0.035), 4), (rp.Cylinder(0.015, 0.3), 2), (rp.Capsule(0.01, 0.02), 2)):
        goals = rp.top_grasps(table.with_obstacle("block", shape, lying), "block")
        travels = np.mod([np.arctan2(goal.rotation[1, 0], goal.rotation[0, 0]) - 0.7 for goal in goals], np.pi / 2)
        np.testing.assert_allclose(np.minimum(travels, np.pi / 2 - travels), 0.0, atol=1e-9)
        assert len(goals) == angles


def test_how_deep_fingers_would_reach_below_a_flat_box_is_said(table: rp.Scene) -> None:
    """RR1's round fingertips reach 11.5 mm below the point at which they touch a side."""
    scene = standing(table, rp.Box((0.03, 0.04, 0.008)), 0.008)
    plan = rp.plan_sequence(rp.Sequence(scene, rp.pick_and_place(scene, "block", [-0.3, -0.1, 0.004])), rng=0)
    assert re.search(r"gripper around .*'arm/finger_link' and 'table' overlap by [4-9]\.\d+ mm", plan.reason), plan


def test_a_cylinder_is_as_wide_in_all_directions(table: rp.Scene) -> None:
    # Low and wide: fingers that are placed for a wider object touch the table when they close.
    scene = standing(table, rp.Cylinder(0.0215, 0.032), 0.032, yaw=0.7)
    goals = rp.top_grasps(scene, "block", yaws=5)
    heights = np.array([goal.position[2] for goal in goals]).reshape(5, -1)
    np.testing.assert_allclose(heights, heights[:1].repeat(5, axis=0), atol=1e-9)
    np.testing.assert_allclose(np.diff(heights[0]), 0.032 * np.diff([0.5, 0.65, 0.8, 0.9]), atol=1e-9)
    robot = scene.arms["arm"].robot
    opened = rp.pick_and_place(scene, "block", [-0.3, -0.1, 0.016])[0]
    assert isinstance(opened, rp.MoveGripper)
    assert opened.width == pytest.approx(2 * 0.0215 + 0.03)
    tool = robot.link_poses(robot.home)[robot.tool]
    for goal in goals[::2]:
        in_hand = tool @ np.linalg.inv(rp.transforms.pose(goal.position, quaternion=goal.quaternion))
        thing = scene.obstacles["block"]
        held = scene.with_obstacle_at("block", in_hand @ thing.pose).obstacles["block"]
        closed = closing_value(rp.Arm(robot), held, 0.0)
        assert closed == pytest.approx(opening_value(robot, 2 * 0.0215), abs=0.01)


def test_at_a_grasp_the_sides_touch_first(table: rp.Scene) -> None:
    """Fingers that close from a grasp stop at the width of the object, as they do at a plate of that width."""
    for shape, height in ((rp.Box((0.04, 0.04, 0.08)), 0.08), (rp.Cylinder(0.02, 0.065), 0.065)):
        scene = standing(table, shape, height)
        robot = scene.arms["arm"].robot
        tool = robot.link_poses(robot.home)[robot.tool]
        goals = rp.top_grasps(scene, "block", yaws=2)
        assert goals
        for goal in goals:
            T = rp.transforms.pose(goal.position, quaternion=goal.quaternion)
            thing = scene.obstacles["block"]
            in_hand = scene.with_obstacle_at("block", tool @ np.linalg.inv(T) @ thing.pose).obstacles["block"]
            closed = closing_value(rp.Arm(robot), in_hand, 0.0)
            assert closed == pytest.approx(opening_value(robot, 0.04), abs=0.01)


def test_what_is_too_wide_is_refused_by_name(table: rp.Scene) -> None:
    with pytest.raises(rp.InputError, match="cannot grasp 'block' from above, which is 200 mm wide"):
        rp.top_grasps(standing(table, rp.Box((0.2, 0.3, 0.05)), 0.05), "block")
    narrow = rp.top_grasps(standing(table, rp.Box((0.2, 0.03, 0.05)), 0.05), "block")
    assert all(abs(goal.rotation[1, 0]) > 0.9 for goal in narrow)


FINGER = """
  <link name="{side}_knuckle"><collision><geometry><box size="0.01 0.01 0.01"/></geometry></collision></link>
  <link name="{side}_finger">
    <collision><origin xyz="0 0 0.03"/><geometry><box size="0.02 0.01 0.06"/></geometry></collision>
  </link>
  <joint name="{knuckle}" type="revolute">
    <parent link="palm"/><child link="{side}_knuckle"/><origin xyz="0 {y} 0.02"/><axis xyz="{axis} 0 0"/>
    <limit lower="0" upper="0.9" velocity="2" effort="20"/>{mimic}
  </joint>
  <joint name="{side}_tip" type="revolute">
    <parent link="{side}_knuckle"/><child link="{side}_finger"/><origin xyz="0 {y} 0.04"/><axis xyz="{back} 0 0"/>
    <limit lower="0" upper="0.9" velocity="2" effort="20"/><mimic joint="drive"/>
  </joint>"""

FOLLOWS = '<mimic joint="drive"/>'


def test_the_fingers_of_a_linkage_travel_where_their_knuckles_only_turn(tmp_path: Path) -> None:
    """As in the hand of an xArm: a knuckle turns about its own center, the finger at its end travels."""
    left = FINGER.format(side="left", knuckle="drive", y=0.03, axis="1", back="-1", mimic="")
    right = FINGER.format(side="right", knuckle="follow", y=-0.03, axis="-1", back="1", mimic=FOLLOWS)
    text = f"""<robot name="hand">
  <link name="base"/>
  <link name="palm"/>
  <link name="grasp"/>
  <joint name="lift" type="prismatic">
    <parent link="base"/><child link="palm"/><axis xyz="0 0 1"/><limit lower="0" upper="1" velocity="1" effort="9"/>
  </joint>
  <joint name="end" type="fixed"><parent link="palm"/><child link="grasp"/><origin xyz="0 0 0.1"/></joint>
  {left}{right}
</robot>"""
    (tmp_path / "hand.urdf").write_text(text)
    robot = rp.load_robot(tmp_path / "hand.urdf", groups=[("base", "grasp")])
    assert open_value(robot) == 0.0
    np.testing.assert_allclose(np.abs(grip_frame(robot)[:2, :2]), [[0, 1], [1, 0]], atol=1e-9)
    # Each finger travels from 60 mm beside the middle, and its side is 5 mm nearer.
    for width in (0.03, 0.06):
        turned = opening_value(robot, width)
        assert 0.03 + 0.03 * np.cos(turned) - 0.04 * np.sin(turned) - 0.005 == pytest.approx(width / 2, abs=1e-4)
    # The chord of a circle of 50 mm, on which each finger travels.
    assert finger_lever(unlocked_robot(robot, ("drive",)), "drive") == pytest.approx(0.1 * np.sin(0.45) / 0.9)


def test_the_support_may_be_touched_while_the_object_is_lifted_and_lowered(table: rp.Scene) -> None:
    shelf = table.with_obstacle("shelf", rp.Box((0.1, 0.1, 0.02)), [-0.28, -0.12, 0.05])
    segments = rp.pick_and_place(shelf, "block", [-0.28, -0.12, 0.09])
    lines = [s for s in segments if isinstance(s, rp.StraightLine) and s.axes == "world"]
    assert [s.allow for s in lines] == [{frozenset(("block", "table"))}, {frozenset(("block", "shelf"))}]
    own = rp.pick_and_place(table, "block", [-0.28, -0.12, 0.03], supports=[])
    assert all(not s.allow for s in own if isinstance(s, rp.StraightLine))


def test_a_place_inside_of_a_support_is_refused(table: rp.Scene) -> None:
    """A place at the height of the table's surface, not half the object's height above it."""
    good, deep = (rp.PoseGoal("block", rp.transforms.pose([-0.28, -0.12, z])) for z in (0.03, 0.0))
    segments = rp.pick_and_place(table, "block", deep, grasps=rp.top_grasps(table, "block")[3:4])
    plan = rp.plan_sequence(rp.Sequence(table, segments), rng=0)
    assert not plan.found
    assert plan.reason.startswith("segment 8 (straight line 80 mm down) not found: ")
    assert "'table' and 'block' overlap by 30 mm" in plan.reason
    above = rp.pick_and_place(table, "block", [deep, good])[6]
    assert isinstance(above, rp.FreeMotion)
    assert above.label == "free motion to 'block' at [-0.28, -0.12, 0.11] m"


def test_an_object_sunk_in_the_table_is_not_lifted_through_it(table: rp.Scene) -> None:
    sunk = table.with_obstacle_at("block", [-0.3, 0.1, 0.02])
    plan = rp.plan_sequence(rp.Sequence(sunk, rp.pick_and_place(sunk, "block", [-0.28, -0.12, 0.03])), rng=0)
    assert "segment 6 (straight line 80 mm up) not found" in plan.reason
    assert "'table' and 'block' overlap by 10 mm" in plan.reason


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"obstacle": "cup"}, "'cup'"),
        ({"place": rp.PoseGoal("tool", [0, 0, 0.1], [1, 0, 0, 0])}, "expected a pose of 'block'"),
        ({"place": rp.PoseGoal("block", [0, 0, 0.1])}, "with a quaternion"),
        ({"place": []}, "place"),
        ({"place": [0.1, 0.2]}, r"place is \[0.1, 0.2\], expected a position \(3,\), a pose \(4, 4\), or a list"),
        ({"height": 0.0}, "height"),
        ({"supports": ["floor"]}, "'floor'"),
        ({"grasps": ["home"]}, "grasps"),
        ({"grasps": []}, "grasps"),
        ({"grasps": [rp.PoseGoal("tool", [0, 0, 0.1])]}, "grasps has no quaternion"),
    ],
)
def test_bad_arguments(table: rp.Scene, arguments: dict, message: str) -> None:
    with pytest.raises(rp.InputError, match=message):
        rp.pick_and_place(**({"scene": table, "obstacle": "block", "place": [-0.28, -0.12, 0.03]} | arguments))


@pytest.mark.usefixtures("foreign_robots")
def test_a_held_object_is_not_picked(table: rp.Scene) -> None:
    held = table.with_obstacle_at("block", table.link_poses()["arm/tool"]).attach("block", "arm")
    with pytest.raises(rp.InputError, match="'block' is held by 'arm' at the start, so it cannot be picked: detach"):
        rp.pick_and_place(held, "block", [-0.28, -0.12, 0.03])


def test_a_ball_is_grasped_and_held_at_its_middle(table: rp.Scene) -> None:
    scene = standing(table, rp.Sphere(0.02), 0.04)
    heights = {round(goal.position[2], 9) for goal in rp.top_grasps(scene, "block", yaws=3)}
    cylinder = standing(table, rp.Cylinder(0.02, 0.04), 0.04)
    assert heights == {min(round(goal.position[2], 9) for goal in rp.top_grasps(cylinder, "block", yaws=3))}
    scene = rp.Scene().with_arm("arm", rp.load_robot("panda"))
    scene = scene.with_obstacle("table", rp.Box((0.6, 1.0, 0.04)), [0.6, 0.0, -0.02])
    scene = scene.with_obstacle("ball", rp.Sphere(0.025), [0.5, 0.0, 0.025], mass=0.05)
    plan = rp.plan_sequence(rp.Sequence(scene, rp.pick_and_place(scene, "ball", [0.5, 0.2, 0.025])), rng=0)
    assert plan, plan
    assert rp.simulate_sequence(plan, hold=0.0).carried


def test_a_hand_whose_fingers_travel_along_y_grasps_as_well() -> None:
    """The Panda's fingers slide along the y axis of its tool frame, and weigh 15 g."""
    scene = rp.Scene().with_arm("arm", rp.load_robot("panda"))
    scene = scene.with_obstacle("table", rp.Box((0.6, 1.0, 0.04)), [0.6, 0.0, -0.02])
    scene = scene.with_obstacle("block", rp.Box((0.04, 0.1, 0.06)), [0.5, 0.0, 0.03], mass=0.4)
    goals = rp.top_grasps(scene, "block")
    np.testing.assert_allclose([abs(goal.rotation[0, 1]) for goal in goals], 1.0, atol=1e-9)
    too_wide = rp.plan_sequence(rp.Sequence(scene, [rp.MoveGripper(width=0.2)]), rng=0)
    assert "the fingers do not fit a plate of 200 mm" in too_wide.reason
    plan = rp.plan_sequence(rp.Sequence(scene, rp.pick_and_place(scene, "block", [0.5, 0.2, 0.03])), rng=0)
    assert plan, plan
    replay = rp.simulate_sequence(plan, hold=0.0)
    assert replay.carried
    assert replay.objects["block"].final_offset < 5e-3


@pytest.fixture(scope="module")
def panda(foreign_robots: object) -> rp.Scene:
    """A Panda at a table."""
    scene = rp.Scene().with_arm("arm", rp.load_robot("panda"))
    return scene.with_obstacle("table", rp.Box((0.6, 1.0, 0.04)), [0.6, 0.0, -0.02])


def assembled(*parts: tuple[rp.Shape, list[float]]) -> list[rp.Geometry]:
    """An object of several parts at their positions."""
    return [rp.Geometry(f"part{k}", shape, rp.transforms.pose(at)) for k, (shape, at) in enumerate(parts)]


MUG = assembled((rp.Cylinder(0.025, 0.08), [0.0, 0.0, 0.0]), (rp.Box((0.03, 0.01, 0.04)), [0.035, 0.0, 0.0]))
ANGLE = assembled((rp.Box((0.06, 0.02, 0.08)), [0.0, 0.0, 0.0]), (rp.Box((0.02, 0.06, 0.08)), [0.02, 0.02, 0.0]))
WEDGE = list(rp.polygon_prism([(0.03, 0), (-0.015, 0.026), (-0.015, -0.026)], 0.08))


@pytest.mark.parametrize("geometries", [MUG, ANGLE, WEDGE])
def test_objects_of_any_shape_are_held_at_opposite_sides(panda: rp.Scene, geometries: list[rp.Geometry]) -> None:
    pose = rp.transforms.pose([0.5, 0.1, 0.04], rpy=[0.0, 0.0, 0.3])
    scene = panda.with_obstacles({"thing": rp.Obstacle(geometries, pose, mass=0.1)})
    plan = rp.plan_sequence(rp.Sequence(scene, rp.pick_and_place(scene, "thing", [0.5, -0.1, 0.04])), rng=0)
    assert plan, plan
    assert rp.simulate_sequence(plan, hold=0.0).carried


def test_a_mug_is_grasped_at_its_middle_however_far_its_handle_reaches(table: rp.Scene) -> None:
    pose = rp.transforms.pose([-0.3, 0.1, 0.04])
    for goal in rp.top_grasps(table.with_obstacles({"mug": rp.Obstacle(MUG, pose)}), "mug"):
        across = goal.rotation[:, 1] @ (goal.position - pose[:3, 3])
        assert across == pytest.approx(0.0, abs=1e-3)
        assert abs(goal.rotation[1, 0]) > 0.8


@pytest.mark.parametrize(("shape", "tilted"), [(rp.Box((0.03, 0.035, 0.06)), 0.04), (rp.Cylinder(0.015, 0.06), 5e-3)])
def test_a_little_tilt_takes_no_grasps_away(table: rp.Scene, shape: rp.Shape, tilted: float) -> None:
    poses = [rp.transforms.pose([-0.3, 0.1, 0.1], rpy=[tilt, 0.0, 0.2]) for tilt in (0.0, tilted)]
    counts = [len(rp.top_grasps(table.with_obstacle("block", shape, pose), "block")) for pose in poses]
    assert counts[0] == counts[1] >= 16


def test_a_prism_is_grasped_at_its_faces_whatever_its_angle(table: rp.Scene) -> None:
    corners = 0.02 * np.array([[np.cos(a), np.sin(a)] for a in np.arange(6) * np.pi / 3])
    for yaw in (0.0, 0.2, 0.45):
        pose = rp.transforms.pose([-0.3, 0.1, 0.03], rpy=[0.0, 0.0, yaw])
        scene = table.with_obstacle("nut", rp.polygon_prism(corners, 0.06), pose)
        goals = rp.top_grasps(scene, "nut")
        off = [np.arctan2(g.rotation[1, 0], g.rotation[0, 0]) - yaw - np.pi / 6 for g in goals]
        np.testing.assert_allclose(np.remainder(np.array(off) + np.pi / 6, np.pi / 3), np.pi / 6, atol=1e-6)


def test_fingers_reach_two_millimeters_down_a_plate(panda: rp.Scene) -> None:
    for height, levels in ((0.06, 4), (0.01, 2), (0.003, 1)):
        scene = panda.with_obstacle("plate", rp.Box((0.04, 0.04, height)), [0.5, 0.1, height / 2])
        assert len({round(float(goal.position[2]), 6) for goal in rp.top_grasps(scene, "plate")}) == levels


def test_an_object_that_narrows_upward_has_no_sides_to_grasp(table: rp.Scene) -> None:
    corners = [[-0.02, -0.02, 0.0], [0.02, -0.02, 0.0], [0.02, 0.02, 0.0], [-0.02, 0.02, 0.0], [0.0, 0.0, 0.06]]
    faces = [[0, 2, 1], [0, 3, 2], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]
    scene = table.with_obstacle("pyramid", rp.Mesh(np.array(corners), np.array(faces)), [-0.3, 0.1, 0.0])
    with pytest.raises(rp.InputError, match="'pyramid' from above, which is 40 mm wide at least: there are no opp"):
        rp.top_grasps(scene, "pyramid")
