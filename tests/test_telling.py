"""Representations of values, and error messages for typical mistakes."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.robot import Geometry


@pytest.fixture(scope="module")
def motion() -> rp.MotionPlan:
    return rp.plan_motion(rp.Problem(rp.load_scene("rr1_table"), "home", "zero"), rng=0)


def test_every_value_of_the_line_shows_itself_in_a_line(motion: rp.MotionPlan) -> None:
    for value in (motion, motion.problem, motion.result, motion.path, motion.trajectory, motion.report):
        assert repr(value).startswith(f"{type(value).__name__}(")
        assert len(repr(value)) < 250
        assert "\n" not in repr(value)
    assert "certified" in repr(motion)
    assert repr(motion.problem) == "Problem('rr1_table', rr1: JointGoal)"
    assert f"length {motion.path.length:.2f}" in repr(motion.result)


@pytest.mark.parametrize(("joints", "unit"), [("RR", "rad"), ("PP", "m"), ("RP", "rad and m")])
def test_a_motion_says_its_length_in_the_unit_of_its_joints(joints: str, unit: str) -> None:
    scene = rp.Scene().with_arm("arm", rp.planar_arm(joints))
    home = scene.configuration()
    motion = rp.plan_motion(rp.Problem(scene, home, home + 0.1), rng=0)
    assert f"{motion.path.length:.2f} {unit} long" in str(motion)


def test_every_public_value_shows_itself_in_a_line(motion: rp.MotionPlan) -> None:
    rng = np.random.default_rng(0)
    mesh = rp.Mesh(rng.normal(size=(300, 3)), rng.permuted(np.tile(np.arange(300), (90, 1)), axis=1)[:, :3])
    scene = motion.problem.scene.with_obstacle("mesh", [Geometry(name, mesh) for name in "abc"], [1, 2, 3])
    scene = scene.with_obstacle("scan", rp.PointCloud(rng.normal(size=(500, 3))))
    robot, checker = scene.arm("rr1").robot, rp.CollisionChecker(motion.problem.scene)
    start, stop = motion.path.waypoints[[0, -1]]
    values = [
        *(mesh, scene, *scene.obstacles.values(), *scene.obstacles["mesh"].geometries, scene.arm("rr1"), robot),
        *(robot.limits, *robot.links, *robot.joints, robot.link("shoulder_link").inertial),
        *(rp.JointGoal(start), rp.PoseGoal("tool", [0, 0, 0], [1, 0, 0, 0])),
        *(rp.RegionGoal("tool", [0, 0, 0], [1, 1, 1]), rp.Kinematics(scene), checker, checker),
        *(checker.nearest(start), *checker.contacts(stop + 1.5)),
        rp.solve_ik(rp.Kinematics(scene), rp.PoseGoal("tool", [-0.30, 0.25, 0.20]), rng=0, max_solutions=3),
        checker.first_contact(start, start + 1.5),
        *rp.cover_with_spheres(checker.scene).values(),
        rp.simulate(motion.trajectory, motion.problem.scene, mode="kinematic"),
        rp.plan(motion.problem, planner=rp.RrtConnect(tree=True), rng=0).tree,
        rp.cspace(rp.load_scene("planar2r_path"), resolution=12),
    ]
    for value in values:
        shown = repr(value)
        assert shown.startswith(f"{type(value).__name__}(")
        assert "\n" not in shown
        assert len(shown) < 400, shown


def test_a_tuple_of_one_tuple_reads_as_such() -> None:
    shown = repr(rp.MoveGripper("open", allow=[("cup", "table")]))
    assert any(f"allow=({pair},)" in shown for pair in ("('cup', 'table')", "('table', 'cup')"))  # a set


def test_no_plan_shows_its_reason() -> None:
    scene = rp.load_scene("rr1_table")
    motion = rp.plan_motion(rp.Problem(scene, "home", rp.PoseGoal("tool", [3.0, 0.0, 0.0])), rng=0)
    assert "out of reach" in repr(motion)
    assert "infeasible" in repr(motion.result)


def test_degrees_are_recognized() -> None:
    scene = rp.load_scene("rr1_table")
    for start, goal in (("home", [0, 20, -45, 0, 30, 0]), ([0, 20, -45, 0, 30, 0], "home")):
        assert "are these degrees?" in rp.plan_motion(rp.Problem(scene, start, goal), rng=0).result.reason
    slightly = rp.plan_motion(rp.Problem(scene, "home", [0, 0.5, 0, 0, 0.5, 0]), rng=0).result.reason
    assert "out of limits" in slightly
    assert "degrees" not in slightly


def test_a_problem_without_one_arm_says_what_to_do() -> None:
    with pytest.raises(rp.InputError, match=r"goal mapping from arm to goal.* left, right"):
        rp.Problem(rp.load_scene("rr1_pair"), "home", "home")
    with pytest.raises(rp.InputError, match="with_arm"):
        rp.Problem(rp.Scene(), "home", "home")


def test_a_file_that_is_not_there_or_of_another_kind_is_named(tmp_path: Path) -> None:
    with pytest.raises(rp.FormatError, match="there is no such file") as caught:
        rp.load_motion(tmp_path / "none.json")
    assert "number" not in str(caught.value)
    for name in (tmp_path / "scene.json", str(tmp_path / "scene.json"), Path("scene")):
        with pytest.raises(rp.InputError, match=r"expected one of \.toml"):
            rp.load_scene(name)


def test_a_single_problem_is_no_batch(motion: rp.MotionPlan) -> None:
    single: Any = motion.problem
    with pytest.raises(rp.InputError, match="expected a list of Problem"):
        rp.plan_many(single)


def test_a_misspelt_name_is_told_with_what_python_needs_to_suggest_another() -> None:
    name = "load_scen"
    with pytest.raises(AttributeError) as caught:
        getattr(rp, name)
    assert (caught.value.name, caught.value.obj) == (name, rp)


def test_one_of_anything_is_not_plural() -> None:
    scene = rp.load_scene("rr1_table")
    still = rp.plan_motion(rp.Problem(scene, "home", "home"), rng=0)
    for text in (str(still), repr(still), repr(still.result), repr(still.path)):
        assert "1 waypoint," in text
    step = rp.simulate(still.trajectory, scene, hold=0.002)
    assert str(step).startswith("dynamic replay: 1 step of 2 ms")
    kinematics = rp.Kinematics(scene)
    reached = rp.PoseGoal("tool", kinematics.pose(scene.configuration(), "tool"))
    refused = rp.solve_ik(kinematics, reached, accept=lambda _: False, attempts=1)
    assert "in 1 configuration, none of them accepted (1 start)" in refused.reason
    inside = scene.link_poses()["rr1/tool"][:3, 3]
    blocked = scene.with_obstacle("ball", rp.Sphere(0.03), inside)
    (found,) = rp.solve_ik(kinematics, reached, rng=0).solutions
    assert not rp.CollisionChecker(blocked).is_free(found)
    result = rp.plan(rp.Problem(blocked, [0.5, *found[1:]], reached), rng=0)
    assert "every configuration found (1 configuration)" in result.reason


def test_a_percent_sign_follows_a_space(motion: rp.MotionPlan) -> None:
    steps = np.array([0.0, 1.0])
    diagram = rp.CoordinationDiagram(
        ("a", "b"), (0, 1), np.eye(3, dtype=np.uint8), (steps,) * 2, (steps,) * 2, steps, np.eye(2)
    )
    replay = rp.simulate(motion.trajectory, motion.problem.scene)
    for text in (str(rp.cspace(rp.load_scene("planar2r_path"), resolution=12)), repr(diagram), str(replay)):
        assert re.search(r"\d %", text)
        assert not re.search(r"\d%", text)


DEGREES = r"\(angles are in radians: are these degrees\?\)"
BENT = """<robot name="bent"><link name="a"/>
<link name="b"><collision>{origin}<geometry><sphere radius="0.1"/></geometry></collision></link>
<joint name="j" type="continuous"><parent link="a"/><child link="b"/>{origin}<limit velocity="1" effort="1"/></joint>
</robot>"""


def test_rotations_in_degrees_are_recognized_wherever_they_are_read(tmp_path: Path) -> None:
    with pytest.raises(rp.InputError, match=r"rpy is \[0, 0, 90\] rad, expected angles within a turn.* " + DEGREES):
        rp.transforms.pose(rpy=(0, 0, 90))
    scene, robot = tmp_path / "scene.toml", tmp_path / "bent.urdf"
    for text, line in (
        ("[obstacles.box]\nbox = [1, 1, 1]\nrpy = [0, 0, -45]\n", 3),
        ("[obstacles.box]\nshapes = [\n{ box = [1, 1, 1], rpy = [0, 30, 0] }]\n", 2),
        ("[arms.arm]\nrobot = 'planar2r'\nrpy = [180, 0, 0]\n", 3),
    ):
        scene.write_text(text)
        with pytest.raises(rp.FormatError, match=f"rpy.*{DEGREES}") as caught:
            rp.load_scene(scene)
        assert (caught.value.file, caught.value.line) == (str(scene), line)
    robot.write_text(BENT.format(origin='<origin rpy="0 0 90"/>'))
    with pytest.raises(rp.FormatError, match=rf"bent.urdf:\d: .*rpy is \[0, 0, 90\] rad.*{DEGREES}"):
        rp.load_robot(robot)


def test_a_rotation_by_a_whole_turn_is_no_degrees(tmp_path: Path) -> None:
    turned = rp.transforms.pose(rpy=(6.2832, -6.283185307179586, 3.2))
    assert abs(turned[0, 0] - rp.transforms.pose(rpy=(0, 0, 3.2))[0, 0]) < 1e-6
    (tmp_path / "bent.urdf").write_text(BENT.format(origin='<origin rpy="0 0 -4.712389"/>'))
    assert rp.load_robot(tmp_path / "bent.urdf").nq == 1


def test_an_unknown_name_among_many_shows_some_and_counts_the_rest() -> None:
    names = [f"link{k}" for k in range(42)]
    assert str(rp.UnknownNameError("link", "x", names)).endswith(", link29 and 12 more.")
    assert str(rp.UnknownNameError("link", "x", names[:30])).endswith(", link29.")
