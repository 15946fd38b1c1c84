"""The scene's Pinocchio model against the plain numpy kinematics of the description."""

import pickle
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from rr1plan.errors import InputError, UnknownNameError
from rr1plan.model import Kinematics
from rr1plan.model.arm_model import hang
from rr1plan.model.scene_model import SceneModel
from rr1plan.robot import Geometry, Inertial, Joint, Link, Mimic, Robot
from rr1plan.robot.joint_limits import Limits
from rr1plan.scene import Arm, Scene
from rr1plan.scene.scene_elements import Attachment
from rr1plan.shapes import Box, HalfSpace, Sphere
from rr1plan.transforms import pose


def oblique(*axis):
    return np.array(axis, dtype=float) / np.linalg.norm(axis)


def odd_robot():
    """A branching robot with every kind of joint: its fingers are described before its second branch."""
    origin = pose([0.1, -0.05, 0.2], rpy=[0.3, -0.2, 0.5])
    joints = (
        Joint("turn", "continuous", "base", "a", origin),
        Joint("plate", "fixed", "a", "b", origin),
        Joint("lean", "revolute", "b", "c", origin, oblique(1, 2, -1), -2.0, 2.0),
        Joint("mast", "revolute", "a", "m", origin, oblique(0, -1, 0), -1.0, 1.0, mimic=Mimic("lean", -0.5, 0.1)),
        Joint("slide", "prismatic", "c", "d", origin, oblique(1, 0, 0), -0.2, 0.4),
        Joint("flag", "prismatic", "m", "n", origin, oblique(0, 1, 1), -1.0, 1.0, mimic=Mimic("mast", 2.0, -0.3)),
        Joint("grip", "revolute", "d", "e", origin, oblique(0, 1, 0), 0.0, 1.0),
        Joint("grip2", "revolute", "d", "f", origin, oblique(0, 1, 0), -1.0, 0.0, mimic=Mimic("grip", -1.0)),
    )
    inertial = Inertial(1.5, np.array([0.01, 0.02, -0.03]), np.diag([0.01, 0.02, 0.015]))
    links = tuple(
        Link(n, inertial, (), (Geometry(n, Box((0.1, 0.1, 0.1)), pose([0.0, 0.02, 0.0])),)) for n in "abcdefmn"
    )
    n = np.full(3, 1.0)
    return Robot(
        name="odd",
        links=(Link("base"), *links),
        joints=joints,
        joint_names=("slide", "turn", "lean"),
        limits=Limits(np.array([-0.2, -np.inf, -2.0]), np.array([0.4, np.inf, 2.0]), n, n, n, n),
        configurations={"home": [0.0, 0.0, 0.0]},
        locked_joints={"grip": 0.4},
        disabled_collisions=frozenset(),
        tool="d",
    )


def odd_scene():
    robot = odd_robot()
    scene = Scene(
        {
            "left": Arm(robot, pose([1.0, 0.0, 0.0], rpy=[0.1, 0.2, 0.3]), [0.1, 4.0, -0.5]),
            "right": Arm(robot.with_locked_joints({"grip": 0.9}), pose([-1.0, 0.5, 0.0]), [0.3, -0.2, 1.0]),
        }
    )
    scene = scene.with_obstacle("floor", HalfSpace()).with_obstacle("ball", Sphere(0.1), [0.0, 0.0, 2.0])
    return scene.attach("ball", "right", "e", pose=pose([0.0, 0.1, 0.0], rpy=[1.0, 0.0, 0.0]))


def link_poses_by_pinocchio(model, q):
    data = model.model.createData()
    pin.framesForwardKinematics(model.model, data, model.full(q))
    names = [f"{arm}/{link}" for arm, a in model.scene.arms.items() for link in a.robot.link_names]
    return {name: data.oMf[model.frame_id(name)].homogeneous for name in names}


@pytest.mark.parametrize("arms", [None, ["left"], ["right"], ["right", "left"]])
def test_every_link_is_where_the_plain_kinematics_has_it(arms):
    scene, rng = odd_scene(), np.random.default_rng(1)
    model = SceneModel(scene, arms)
    for _ in range(20):
        q = rng.uniform(-3.0, 3.0, model.nq)
        expected = scene.link_poses(scene.split(q, model.arms))
        for name, T in link_poses_by_pinocchio(model, q).items():
            np.testing.assert_allclose(T, expected[name], atol=1e-13)


def test_columns_are_the_moving_arms_planning_joints_in_scene_order():
    model = SceneModel(odd_scene(), ["right", "left"])
    assert model.joint_names == tuple(f"{a}/{j}" for a in ("left", "right") for j in ("slide", "turn", "lean"))
    assert model.nq == 6
    assert model.model.nq == model.model.nv == 14


def test_velocities_map_by_the_derivative_of_the_positions_map():
    model, rng = SceneModel(odd_scene(), ["right"]), np.random.default_rng(2)
    q, v = rng.uniform(-1, 1, (2, 5, 3))
    np.testing.assert_allclose((model.full(q + v) - model.full(q)), model.full_velocity(v), atol=1e-14)
    np.testing.assert_allclose(v @ model.selection.T, model.full_velocity(v), atol=0)


def test_subtrees_are_contiguous_so_that_the_mass_matrix_is_right():
    model = SceneModel(odd_scene(), ["left"])
    data = model.model.createData()
    full = model.full(np.array([0.1, 0.7, -0.4]))
    M = pin.crba(model.model, data, full)
    M = np.triu(M) + np.triu(M, 1).T
    zero = np.zeros(model.model.nv)
    bias = pin.rnea(model.model, data, full, zero, zero).copy()
    by_columns = [pin.rnea(model.model, data, full, zero, e).copy() - bias for e in np.eye(model.model.nv)]
    np.testing.assert_allclose(M, np.array(by_columns).T, atol=1e-10)


def test_torques_include_the_masses_of_held_objects():
    scene = odd_scene()
    box, at = Box((0.1, 0.2, 0.3)), pose([0.3, 0.1, -0.2], rpy=[0.4, 0.1, -0.7])
    held = Attachment((Geometry("box", box, at),), "right", "d", pose([0.0, 0.2, 0.1]), mass=2.0)
    on_base = Attachment((Geometry("box", box),), "right", "base", at, mass=5.0)
    loaded = replace(scene, attachments={**scene.attachments, "held": held, "on_base": on_base})
    x, y, z = box.size
    inertia = 2.0 / 12.0 * np.diag([y * y + z * z, x * x + z * z, x * x + y * y])
    T = held.pose @ at
    solid = Inertial(2.0, T[:3, 3], T[:3, :3] @ inertia @ T[:3, :3].T)
    robot = scene.arms["right"].robot
    # The same load as part of the robot.
    extra = Joint("grasp", "fixed", "d", "load")
    heavy = replace(robot, links=(*robot.links, Link("load", solid)), joints=(*robot.joints, extra))
    expected, found = Kinematics(scene.with_robot("right", heavy)), Kinematics(loaded)
    q, qd, qdd = np.random.default_rng(0).uniform(-0.3, 0.3, (3, found.nq))
    np.testing.assert_allclose(found.inverse_dynamics(q, qd, qdd), expected.inverse_dynamics(q, qd, qdd), atol=1e-12)
    np.testing.assert_allclose(found.mass_matrix(q), expected.mass_matrix(q), atol=1e-12)
    assert np.abs(found.gravity(q) - Kinematics(scene).gravity(q)).max() > 0.1


def test_shapes_ride_on_the_joint_that_carries_their_element():
    scene = odd_scene()
    model = SceneModel(scene, ["right"])
    q = np.array([0.2, 1.0, -0.7])
    data = model.model.createData()
    pin.forwardKinematics(model.model, data, model.full(q))
    poses = scene.link_poses(scene.split(q, ["right"]))
    poses["floor"] = np.eye(4)
    poses["ball"] = poses["right/e"] @ scene.attachments["ball"].pose
    held = hang("ball", model.body("ball"), scene.attachments["ball"].geometries)
    standing = hang("floor", model.body("floor"), scene.obstacles["floor"].geometries)
    hung = (*model.arm_model.link_geometries, *held, *standing)
    assert {e.element for e in hung} == set(scene.element_names)
    for e in hung:
        actual = data.oMi[e.joint].homogeneous @ e.placement
        np.testing.assert_allclose(actual, poses[e.element] @ e.geometry.pose, atol=1e-13)


def test_limits_of_planning_joints_are_those_of_the_robot_in_force():
    robot = odd_robot()
    robot = robot.with_limits(robot.limits.scaled(velocity=0.5))
    model = SceneModel(Scene({"a": Arm(robot)}))
    joint = model.model.getJointId("a/slide")
    assert model.model.velocityLimit[joint - 1] == 0.5
    assert model.model.upperPositionLimit[joint - 1] == 0.4


def test_a_pickled_model_gives_the_same_configurations():
    model = SceneModel(odd_scene(), ["right"])
    again = pickle.loads(pickle.dumps(model))
    q = np.array([0.1, 0.2, 0.3])
    np.testing.assert_array_equal(again.full(q), model.full(q))


def test_unknown_names_get_the_near_ones():
    model = SceneModel(odd_scene())
    with pytest.raises(UnknownNameError, match="left/d"):
        model.frame_id("left/dd")
    with pytest.raises(UnknownNameError, match="floor"):
        model.body("flor")
    with pytest.raises(UnknownNameError, match="left"):
        SceneModel(odd_scene(), ["lift"])
    with pytest.raises(InputError, match="scene is of type Robot, expected Scene"):
        SceneModel(odd_robot())


def test_a_joint_nobody_drives_is_refused():
    robot = odd_robot()
    loose = Robot(**{n: getattr(robot, n) for n in robot.__dataclass_fields__} | {"locked_joints": {}})
    turning = [replace(joint, mimic=Mimic(joint.name)) if joint.name == "grip" else joint for joint in loose.joints]
    for robot in (loose, replace(loose, joints=tuple(turning))):
        with pytest.raises(InputError, match=r"'grip'.*neither planned nor locked"):
            SceneModel(Scene({"a": Arm(robot)}))
