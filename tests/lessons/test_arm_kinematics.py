"""DH parameters of all arms, Jacobians and ellipses of planar arms, and their singularities."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.lessons.arm_kinematics import ellipses, tool_jacobian
from rr1plan.lessons.kinematics_lesson import KinematicsLesson

ARMS = ("planar2r", "planar2r_limited", "rr1", "panda", "ur5", "kinova")


def known(names: tuple[str, ...]) -> list[rp.Robot]:
    found = []
    for name in names:
        try:
            found.append(rp.load_robot(name))
        except rp.Rr1PlanError:
            continue
    return found


@pytest.fixture(scope="module")
def lesson() -> KinematicsLesson:
    made = rp.lesson("kinematics")
    assert isinstance(made, KinematicsLesson)
    return made


def product_of_elementary_transforms(row: rp.DhRow, value: float) -> np.ndarray:
    """A row's transform from Rot_z Trans_z Trans_x Rot_x."""
    turn, slide = np.eye(4), np.eye(4)
    theta = row.theta + (0.0 if row.slides else value)
    turn[:2, :2] = [[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]]
    slide[:3, 3] = [0.0, 0.0, row.d + (value if row.slides else 0.0)]
    along, twist = np.eye(4), np.eye(4)
    along[0, 3] = row.a
    twist[1:3, 1:3] = [[np.cos(row.alpha), -np.sin(row.alpha)], [np.sin(row.alpha), np.cos(row.alpha)]]
    return turn @ slide @ along @ twist


@pytest.mark.parametrize(
    "robot", [*known(ARMS), *(rp.planar_arm(k) for k in ("RR", "RP", "PR", "PP"))], ids=lambda r: r.name
)
def test_dh_parameters_give_the_pose_of_the_tool(robot: rp.Robot) -> None:
    table = rp.dh_table(robot)
    assert [row.joint for row in table.rows] == list(robot.joint_names)
    for q in np.random.default_rng(2).uniform(-1.5, 1.5, (20, robot.nq)):
        np.testing.assert_allclose(table.pose(q), robot.link_poses(q)[robot.tool], atol=1e-12)
        chain = table.base
        for row, value in zip(table.rows, q, strict=True):
            chain = chain @ product_of_elementary_transforms(row, float(value))
        np.testing.assert_allclose(chain @ table.tool, table.pose(q), atol=1e-12)
        # z axes of the frames are the joints' axes.
        for frame, name in zip(table.frames(q), robot.joint_names, strict=False):
            joint = robot.joint(name)
            axis = robot.link_poses(q)[joint.child][:3, :3] @ joint.axis
            np.testing.assert_allclose(frame[:3, 2], axis, atol=1e-12)


def test_the_two_link_arm_has_the_table_of_textbooks() -> None:
    table = rp.dh_table(rp.planar_arm("RR", (1.0, 0.7)))
    np.testing.assert_allclose([row[1:5] for row in table.rows], [[1.0, 0, 0, 0], [0.7, 0, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(table.base, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(table.tool, np.eye(4), atol=1e-12)
    text = str(table)
    assert "joint2" in text
    assert "0.7000" in text
    slides = rp.dh_table(rp.planar_arm("RP", (0.6, 0.8)))
    assert [row.slides for row in slides.rows] == [False, True]
    assert abs(slides.rows[0].alpha) == pytest.approx(np.pi / 2)


@pytest.mark.parametrize("joints", ["RR", "RP", "PR", "PP"])
def test_jacobians_are_those_of_pinocchio_and_of_differences(joints: str) -> None:
    robot = rp.planar_arm(joints)
    lesson = rp.lesson("kinematics", rp.Scene(name="own").with_arm("arm", robot))
    assert isinstance(lesson, KinematicsLesson)
    kinematics = rp.Kinematics(robot)
    for q in np.random.default_rng(1).uniform(0.1, 0.7, (20, 2)):
        ours = tool_jacobian(robot, q)
        np.testing.assert_allclose(ours, kinematics.jacobian(q)[:3], atol=1e-12)
        steps = [(kinematics.pose(q + d)[:3, 3] - kinematics.pose(q - d)[:3, 3]) / 2e-6 for d in 1e-6 * np.eye(2)]
        np.testing.assert_allclose(ours, np.column_stack(steps), atol=1e-8)
        assert lesson.determinant(q) == pytest.approx(np.linalg.det(ours[:2]), abs=1e-8)


def test_ellipses_are_the_images_of_the_unit_circle() -> None:
    rng = np.random.default_rng(0)
    angles = np.linspace(0.0, 2.0 * np.pi, 20001)
    circle = np.array([np.cos(angles), np.sin(angles)])
    for _ in range(20):
        jacobian = rng.normal(size=(2, 2))
        found = ellipses(jacobian)
        lengths = np.linalg.norm(jacobian @ circle, axis=0)
        assert lengths.max() == pytest.approx(found.velocity[0], rel=1e-6)
        assert lengths.min() == pytest.approx(found.velocity[1], rel=1e-2, abs=1e-3)
        longest = (jacobian @ circle)[:, lengths.argmax()]
        assert abs(longest @ found.directions[:, 0]) == pytest.approx(found.velocity[0], rel=1e-6)
        # Forces: the torques of a force along an axis, as long as its half axis, have length one.
        for k in range(2):
            torques = jacobian.T @ (found.force[k] * found.directions[:, k])
            assert np.linalg.norm(torques) == pytest.approx(1.0)
        assert found.manipulability == pytest.approx(found.velocity.prod())
    assert np.isinf(ellipses([[1.0, 0.0], [0.0, 0.0]]).force[1])


def test_the_arm_is_singular_where_it_is_straight_or_folded(lesson: KinematicsLesson) -> None:
    values, curves = lesson.map()
    assert np.abs(values).max() == pytest.approx(0.7, abs=1e-3)
    bends = sorted(round(float(curve[:, 1].mean()), 2) for curve in curves)
    assert bends == [-3.14, 0.0, 3.14]
    for curve in curves:
        tools = np.linalg.norm(lesson.flat.points(curve)[..., 2, :], axis=-1)
        rim = 1.7 if abs(curve[0, 1]) < 1.0 else 0.3
        np.testing.assert_allclose(tools, rim, atol=1e-3)
    assert lesson.determinant(np.array([0.3, 0.9])) == pytest.approx(0.7 * np.sin(0.9), abs=1e-9)
    # A gantry never is.
    gantry = rp.lesson("kinematics", rp.Scene().with_arm("arm", rp.planar_arm("PP")))
    assert isinstance(gantry, KinematicsLesson)
    assert gantry.map()[1] == []


def test_chains_that_have_no_table(tmp_path: Path) -> None:
    with pytest.raises(rp.InputError, match="expected Robot"):
        rp.dh_table("rr1")
    # Two joints in a row, and a finger beside the tool.
    joints = {"lift": ("base", "arm", ""), "level": ("arm", "hand", "{mimic}"), "grip": ("hand", "finger", "")}
    limit = '<axis xyz="0 1 0"/><limit lower="-1" upper="1" velocity="1" effort="1"/>'
    text = '<robot name="leveler">' + "".join(f'<link name="{x}"/>' for x in ("base", "arm", "hand", "finger"))
    for name, (parent, child, extra) in joints.items():
        ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="0 0 1"/>'
        text += f'<joint name="{name}" type="revolute">{ends}{limit}{extra}</joint>'
    for name, mimic, groups, said in (
        ("a", '<mimic joint="lift" multiplier="-1"/>', [("base", "hand")], "joint 'level' mimics another one"),
        ("b", "", None, "joint 'grip' does not move the tool 'hand'"),
    ):
        file = tmp_path / f"{name}.urdf"
        file.write_text(text.replace("{mimic}", mimic) + "</robot>")
        robot = rp.load_robot(file, groups=groups, tool="hand")
        with pytest.raises(rp.InputError, match=said):
            rp.dh_table(robot)
    backwards = rp.load_robot("planar2r", joints=["joint2", "joint1"], tool="tool")
    with pytest.raises(rp.InputError, match=r"joints are joint2, joint1, expected .*joints=\['joint1', 'joint2'\]"):
        rp.dh_table(backwards)


def test_the_columns_of_a_printed_table_are_aligned(rr1: rp.Robot) -> None:
    named = {"joint1": "shoulder_pan_joint", "joint2": "elbow"}
    rows = tuple(row._replace(joint=named[row.joint]) for row in rp.dh_table(rp.planar_arm("RR")).rows)
    table = replace(rp.dh_table(rp.planar_arm("RR")), rows=rows)
    for printed in (table, rp.dh_table(rr1)):
        lines = str(printed).splitlines()
        assert len({len(line) for line in lines}) == 1
        assert "-0.00 " not in str(printed)
