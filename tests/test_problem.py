"""Problems: every way to specify start and goal, and every wrong way."""

from __future__ import annotations

import pickle
from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.errors import InputError
from rr1plan.model import Kinematics
from rr1plan.robot import Robot
from rr1plan.scene import Scene
from rr1plan.scene.problem import JointGoal, PoseGoal, Problem, RegionGoal, frame_link
from rr1plan.transforms import pose, quaternion_from_rotation, rotation_from_rpy

Q = [0.1, 0.0, -0.2, 0.0, 0.4, 0.3]


@pytest.fixture
def one(rr1: Robot) -> Scene:
    return Scene().with_arm("arm", rr1)


@pytest.fixture
def two(rr1: Robot) -> Scene:
    return Scene().with_arm("left", rr1, (0, 0.4, 0)).with_arm("right", rr1, (0, -0.4, 0), q=Q)


@pytest.mark.parametrize("start", [None, "home", Q, np.array(Q), tuple(Q), {"arm": Q}, {"arm": "home"}, {}])
def test_every_way_to_say_the_start_of_one_arm(one: Scene, start: Any) -> None:
    problem = Problem(one, start, "home")
    said = start.get("arm") if isinstance(start, dict) else start
    at_home = said is None or isinstance(said, str)
    assert np.array_equal(problem.start, one.arms["arm"].robot.home if at_home else Q)
    assert problem.arms == ("arm",)
    assert problem.nq == 6
    assert problem.joint_names == one.joint_names()


@pytest.mark.parametrize(
    ("goal", "kinds"),
    [
        ("zero", [JointGoal]),
        (Q, [JointGoal]),
        (np.array(Q), [JointGoal]),
        ([Decimal("0.5"), *Q[1:]], [JointGoal]),
        (JointGoal("zero"), [JointGoal]),
        (JointGoal(Q), [JointGoal]),
        (PoseGoal("tool", [-0.3, 0.2, 0.2]), [PoseGoal]),
        (RegionGoal("tool", (0, 0, 0), (1, 1, 1)), [RegionGoal]),
        (["zero", Q, PoseGoal("tool", [-0.3, 0.2, 0.2])], [JointGoal, JointGoal, PoseGoal]),
        ({"arm": ["zero", "home"]}, [JointGoal, JointGoal]),
        ([np.array(Q), np.zeros(6)], [JointGoal, JointGoal]),
    ],
)
def test_every_way_to_say_the_goal_of_one_arm(one: Scene, goal: Any, kinds: list[type]) -> None:
    alternatives = Problem(one, "home", goal).goal["arm"]
    assert [type(g) for g in alternatives] == kinds
    assert all(np.shape(g.q) == (6,) for g in alternatives if isinstance(g, JointGoal))


def test_the_arms_of_the_goal_move_in_the_order_of_the_scene(two: Scene) -> None:
    assert Problem(two, None, {"right": "home", "left": "zero"}).arms == ("left", "right")
    only = Problem(two, None, {"right": "home"})
    assert only.arms == ("right",)
    assert np.array_equal(only.start, Q)
    assert only.joint_names[0] == "right/shoulder_joint"


def test_several_arms_start_by_name_by_numbers_or_by_mapping(two: Scene) -> None:
    goal = {"left": "zero", "right": "zero"}
    home = two.arms["left"].robot.home
    assert np.array_equal(Problem(two, "home", goal).start, np.concatenate([home, home]))
    assert np.array_equal(Problem(two, np.arange(12.0), goal).start, np.arange(12.0))
    assert np.array_equal(Problem(two, {"left": Q}, goal).start, Q + Q)


def test_an_arm_that_moves_without_a_goal_comes_back(two: Scene) -> None:
    problem = Problem(two, {"right": np.zeros(6)}, {"left": "zero"}, arms=["left", "right"])
    assert problem.arms == ("left", "right")
    (back,) = problem.goal["right"]
    assert isinstance(back, JointGoal)
    assert np.array_equal(back.q, np.zeros(6))


def test_one_arm_may_be_named_by_text(two: Scene) -> None:
    assert Problem(two, None, "zero", arms="right").arms == ("right",)


def test_problems_are_read_only_also_after_pickling(two: Scene) -> None:
    problem = Problem(two, None, {"left": ["zero", PoseGoal("tool", pose((-0.3, 0.4, 0.2)))]})
    again = pickle.loads(pickle.dumps(problem))
    assert np.array_equal(again.start, problem.start)
    for one in (problem, again):
        with pytest.raises(ValueError, match="read-only"):
            one.start[0] = 1.0
        with pytest.raises(TypeError):
            one.goal["left"] = ()
    assert np.array_equal(again.goal["left"][1].rotation, np.eye(3))


def test_the_margin_of_a_problem_goes_where_the_problem_goes(two: Scene) -> None:
    problem = Problem(two, None, "zero", arms="left").with_margin(0.01)
    assert pickle.loads(pickle.dumps(problem)).margin == 0.01
    assert problem.in_scene(two.with_padding(0.02)).margin == 0.01


def test_a_pose_goal_takes_a_position_a_quaternion_or_a_full_pose() -> None:
    R = rotation_from_rpy(0.1, 0.2, 0.3)
    free = PoseGoal("tool", [1, 2, 3])
    turned = PoseGoal("tool", [1, 2, 3], quaternion_from_rotation(R))
    full = PoseGoal("tool", pose((1, 2, 3), rpy=(0.1, 0.2, 0.3)))
    assert free.rotation is None
    assert turned.rotation is not None
    assert full.rotation is not None
    assert np.allclose(turned.rotation, R)
    assert np.allclose(full.rotation, R)
    assert all(np.array_equal(goal.position, [1, 2, 3]) for goal in (free, turned, full))


def test_tool_means_the_robot_s_tool_also_beside_a_link_of_that_name(rr1: Robot, planar2r: Robot) -> None:
    assert frame_link(rr1, "tool") == rr1.tool
    assert frame_link(planar2r, "link1") == "link1"
    other = replace(rr1, tool="hand_link")
    assert "tool" in other.link_names
    assert frame_link(other, "tool") == "hand_link"
    q = np.full(6, 0.1)
    np.testing.assert_allclose(Kinematics(other).pose(q), other.link_poses(q)["hand_link"], atol=1e-12)


@pytest.mark.parametrize(
    ("start", "goal", "message"),
    [
        ([0.1], "home", "start of 'arm' has 1 number, expected 6: one for each of shoulder_joint"),
        ([np.nan, 0, 0, 0, 0, 0], "home", "start of 'arm'.*joint shoulder_joint"),
        ("home", [0, np.inf, 0, 0, 0, 0], "goal of 'arm'.*joint upper_arm_joint"),
        ("home", [1.0, 2.0], "goal of 'arm' has 2 numbers, expected 6"),
        ("home", [], "empty list"),
        ("hme", "home", "unknown configuration 'hme'. Did you mean 'home'"),
        ("home", "zerro", "Did you mean 'zero'"),
        ("home", PoseGoal("tol", [0, 0, 0]), "unknown frame 'tol'. Did you mean 'tool'"),
        ("home", RegionGoal("hand_lnk", [0, 0, 0], [1, 1, 1]), "Did you mean 'hand_link'"),
        ({"amr": Q}, "home", "unknown arm 'amr'. Did you mean 'arm'"),
        ("home", {"ram": "home"}, "unknown arm 'ram'"),
        ("home", {}, "goal is an empty mapping"),
        ("home", None, "goal of 'arm' is None, expected a JointGoal"),
        ("home", {"zero"}, "goal of 'arm' is {'zero'}, expected a JointGoal"),
    ],
)
def test_wrong_starts_and_goals_are_refused(one: Scene, start: Any, goal: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Problem(one, start, goal)


def test_tool_is_suggested_as_a_frame_if_no_link_has_that_name(tmp_path: Path) -> None:
    file = tmp_path / "arm.urdf"
    file.write_text(
        '<robot name="one"><link name="base"/><link name="tip"/><joint name="turn" type="continuous">'
        '<parent link="base"/><child link="tip"/><axis xyz="0 0 1"/></joint></robot>'
    )
    scene = Scene().with_arm("arm", rp.load_robot(file))
    with pytest.raises(InputError, match=r"unknown frame 'tol'. Did you mean 'tool'\? Known: tool, base, tip"):
        Problem(scene, "home", PoseGoal("tol", [0, 0, 0]))


def test_one_arm_is_named_without_a_list(two: Scene) -> None:
    name = next(iter(two.arms))
    assert two.joint_names(name) == two.joint_names([name])
    assert two.configuration(name).shape == (two.arms[name].robot.nq,)
    with pytest.raises(InputError, match="unknown arm 'home'"):
        two.configuration("home")


def test_several_arms_have_to_be_told_apart(two: Scene) -> None:
    with pytest.raises(InputError, match="which arm moves"):
        Problem(two, None, "home")
    with pytest.raises(InputError, match="expected a goal mapping"):
        Problem(two, None, "home", arms=["left", "right"])
    with pytest.raises(InputError, match=r"start has shape \(6,\), expected \(12,\)"):
        Problem(two, Q, {"left": "home", "right": "home"})
    with pytest.raises(InputError, match="start names arm 'right', which does not move: without a goal"):
        Problem(two, {"right": Q}, {"left": "home"})
    with pytest.raises(InputError, match="goal names arm 'right', which does not move"):
        Problem(two, None, {"left": "home", "right": "home"}, arms=["left"])
    with pytest.raises(InputError, match="distinct names"):
        Problem(two, None, {"left": "home"}, arms=["left", "left"])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: PoseGoal("tool", [1, 2]), "goal position has shape"),
        (lambda: PoseGoal("tool", [1, 2, np.nan]), "is nan"),
        (lambda: PoseGoal("tool", np.eye(4), (1, 0, 0, 0)), "a full pose and a quaternion"),
        (lambda: PoseGoal("tool", 2 * np.eye(4)), "not a rigid transform"),
        (lambda: PoseGoal("tool", [0, 0, 0], (0, 0, 0, 0)), "norm 0"),
        (lambda: PoseGoal("tool", [0, 0, 0], position_tolerance=0.0), "position_tolerance"),
        (lambda: PoseGoal("tool", [0, 0, 0], orientation_tolerance=np.inf), "orientation_tolerance"),
        (lambda: RegionGoal("tool", [0, 0, 1], [1, 1, 0]), "above upper"),
        (lambda: RegionGoal("tool", [0, 0], [1, 1, 0]), "region lower has shape"),
        (lambda: RegionGoal("tool", [0, 0, 0], [1, 1, 1], (0, 0, 0, 0)), "norm 0"),
        (lambda: RegionGoal("tool", [0, 0, 0], [1, 1, 1], orientation_tolerance=-1), "orientation_tolerance"),
    ],
)
def test_goals_that_make_no_sense_are_refused(make: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()
