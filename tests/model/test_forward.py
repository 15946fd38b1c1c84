"""Forward kinematics, Jacobians and dynamics against everything else that can compute them."""

import json
import pickle
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rr1plan as rp
from rr1plan.errors import InputError, UnknownNameError
from rr1plan.model import Kinematics
from rr1plan.scene import Arm, Scene
from rr1plan.scene.model_library import robot_folder
from rr1plan.transforms import pose, quaternion_from_rotation

VECTORS = json.loads(Path(__file__).with_name("rr1_vectors.json").read_text())["vectors"]
MANY = 100_000


def robot_of(name, request):
    """A shipped robot, or one of the odd ones of the fixtures."""
    return rp.load_robot(name) if name in rp.robot_names() else request.getfixturevalue(name)


def random_configurations(robot, n, seed=0):
    lower = np.where(np.isfinite(robot.limits.lower), robot.limits.lower, -np.pi)
    upper = np.where(np.isfinite(robot.limits.upper), robot.limits.upper, np.pi)
    return np.random.default_rng(seed).uniform(lower, upper, (n, robot.nq))


def mujoco_model(robot):
    """The description as a MuJoCo model, written here by hand."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.compiler.autolimits = False
    bodies = {}
    incoming = {j.child: j for j in robot.joints}
    for link in robot.links:
        joint = incoming.get(link.name)
        parent = spec.worldbody if joint is None else bodies[joint.parent]
        body = parent.add_body(name=link.name)
        bodies[link.name] = body
        if joint is not None:
            body.pos, body.quat = joint.origin[:3, 3], quaternion_from_rotation(joint.origin[:3, :3])
        if joint is not None and joint.kind != "fixed":
            slides = joint.kind == "prismatic"
            kind = mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE
            body.add_joint(name=joint.name, type=kind, axis=joint.axis, limited=False)
        if link.inertial is not None:
            body.explicitinertial = True
            body.mass, body.ipos = link.inertial.mass, link.inertial.com
            body.fullinertia = link.inertial.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    return spec.compile()


def mujoco_position(model, robot, q):
    """MuJoCo's qpos at q, from the plain description."""
    values = robot.joint_values(q)
    out = np.zeros(model.nq)
    for name, value in values.items():
        out[model.joint(name).qposadr[0]] = value
    return out


def test_planar_arm_agrees_with_the_closed_form_on_many_configurations(planar2r):
    q = random_configurations(planar2r, MANY)
    T = Kinematics(planar2r).poses_batch(q)
    a, b = q[:, 0], q.sum(axis=1)
    np.testing.assert_allclose(T[:, 0, 3], np.cos(a) + 0.7 * np.cos(b), atol=1e-14)
    np.testing.assert_allclose(T[:, 1, 3], np.sin(a) + 0.7 * np.sin(b), atol=1e-14)
    np.testing.assert_allclose(T[:, 0, 0], np.cos(b), atol=1e-14)
    np.testing.assert_allclose(T[:, 1, 0], np.sin(b), atol=1e-14)


def test_rr1_agrees_with_pinocchio_reading_the_urdf_on_many_configurations(rr1):
    model = pin.buildModelFromUrdf(str(robot_folder("rr1") / "rr1.urdf"))
    data, frame = model.createData(), model.getFrameId("tool")
    columns = [model.joints[model.getJointId(n)].idx_q for n in rr1.joint_names]
    q = random_configurations(rr1, MANY)
    theirs = np.zeros((MANY, model.nq))
    theirs[:, columns] = q
    ours = Kinematics(rr1).poses_batch(q)
    worst = 0.0
    for i in range(MANY):
        pin.forwardKinematics(model, data, theirs[i])
        worst = max(worst, abs(pin.updateFramePlacement(model, data, frame).homogeneous - ours[i]).max())
    assert worst < 1e-13


def test_rr1_agrees_with_mujoco_on_many_configurations(rr1):
    model = mujoco_model(rr1)
    data, body = mujoco.MjData(model), model.body("tool").id
    q = random_configurations(rr1, MANY)
    ours = Kinematics(rr1).poses_batch(q)
    addresses = [model.joint(n).qposadr[0] for n in rr1.joint_names]
    data.qpos[:] = mujoco_position(model, rr1, rr1.home)
    worst = 0.0
    for i in range(MANY):
        data.qpos[addresses] = q[i]
        mujoco.mj_kinematics(model, data)
        worst = max(
            worst,
            abs(data.xpos[body] - ours[i, :3, 3]).max(),
            abs(data.xmat[body].reshape(3, 3) - ours[i, :3, :3]).max(),
        )
    assert worst < 1e-13


@pytest.mark.parametrize("name", [*rp.robot_names(), "odd_arm", "redundant_arm"])
def test_every_frame_agrees_with_the_plain_kinematics(name, request):
    robot = robot_of(name, request)
    base = pose([0.3, -0.2, 0.1], rpy=[0.1, 0.2, 0.3])
    kinematics = Kinematics(Scene({"arm": Arm(robot, base)}))
    for q in random_configurations(robot, 50, seed=3):
        plain = robot.link_poses(q)
        for link, T in kinematics.poses(q, robot.link_names).items():
            np.testing.assert_allclose(T, base @ plain[link], atol=1e-13)


@pytest.mark.parametrize("index", range(len(VECTORS)))
def test_rr1_agrees_with_stored_poses_jacobians_and_gravity_torques(rr1, index):
    known = VECTORS[index]
    q = np.array(known["q"][:6])

    robot = rr1.with_locked_joints({"finger_joint": known["q"][6]})
    kinematics = Kinematics(robot)
    T = kinematics.pose(q)
    np.testing.assert_allclose(T[:3, 3], known["tool_position"], atol=2e-8)
    # The twin's tool has the axes of its hand; here z points out of it.
    np.testing.assert_allclose(kinematics.pose(q, "hand_link")[:3, :3], known["tool_rotation"], atol=2e-8)
    np.testing.assert_allclose(T[:3, :3], known["tool_rotation"] @ np.diag([1.0, -1.0, -1.0]), atol=2e-8)
    np.testing.assert_allclose(kinematics.jacobian(q), known["jacobian"], atol=2e-8)
    np.testing.assert_allclose(kinematics.gravity(q), known["gravity"][:6], atol=2e-6)


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 2**32 - 1))
def test_jacobian_is_the_derivative_of_the_pose(odd_arm, seed):
    kinematics = Kinematics(odd_arm)
    q = random_configurations(odd_arm, 1, seed)[0]
    J, h = kinematics.jacobian(q), 1e-6
    for j in range(odd_arm.nq):
        e = h * np.eye(odd_arm.nq)[j]
        before, after = kinematics.pose(q - e), kinematics.pose(q + e)
        np.testing.assert_allclose(J[:3, j], (after - before)[:3, 3] / (2 * h), atol=1e-8)
        turn = pin.log3(after[:3, :3] @ before[:3, :3].T) / (2 * h)
        np.testing.assert_allclose(J[3:, j], turn, atol=1e-8)


@pytest.mark.parametrize("name", [*rp.robot_names(), "odd_arm", "redundant_arm"])
def test_dynamics_agree_with_mujoco(name, request):
    robot = robot_of(name, request)
    kinematics, model = Kinematics(robot), mujoco_model(robot)
    data = mujoco.MjData(model)
    rng = np.random.default_rng(4)
    steps = np.eye(robot.nq)
    zero = mujoco_position(model, robot, np.zeros(robot.nq))
    S = np.array([mujoco_position(model, robot, e) - zero for e in steps]).T
    for q in random_configurations(robot, 20, seed=5):
        qd, qdd = rng.normal(size=(2, robot.nq))
        data.qpos[:], data.qvel[:], data.qacc[:] = mujoco_position(model, robot, q), S @ qd, S @ qdd
        mujoco.mj_inverse(model, data)
        np.testing.assert_allclose(kinematics.inverse_dynamics(q, qd, qdd), S.T @ data.qfrc_inverse, atol=1e-9)
        M = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, M)
        np.testing.assert_allclose(kinematics.mass_matrix(q), S.T @ M @ S, atol=1e-9)


def test_inverse_dynamics_takes_many_rows_at_once(rr1):
    kinematics = Kinematics(rr1)
    q, qd, qdd = np.random.default_rng(6).uniform(-1, 1, (3, 7, 6))
    rows = [kinematics.inverse_dynamics(*row) for row in zip(q, qd, qdd, strict=True)]
    np.testing.assert_array_equal(kinematics.inverse_dynamics(q, qd, qdd), rows)
    assert kinematics.inverse_dynamics(q[:0], qd[:0], qdd[:0]).shape == (0, 6)
    assert kinematics.gravity(q[:0]).shape == (0, 6)
    np.testing.assert_array_equal(kinematics.gravity(q), [kinematics.gravity(row) for row in q])


def test_manipulability_of_the_planar_arm_is_the_textbook_value(planar2r):
    kinematics = Kinematics(planar2r)
    for q in random_configurations(planar2r, 20):
        J = kinematics.jacobian(q)
        s = np.sin(q[1])
        linear = np.abs(np.linalg.det(J[:2]))
        assert linear == pytest.approx(0.7 * abs(s))
        assert kinematics.manipulability(q) == pytest.approx(np.sqrt(np.linalg.det(J.T @ J)))


def test_two_arms_have_blocks_of_columns_and_their_own_places(rr1):
    right = pose([0.0, 0.6, 0.0], rpy=[0.0, 0.0, 1.0])
    scene = Scene({"left": Arm(rr1), "right": Arm(rr1, right)})
    both, alone = Kinematics(scene), Kinematics(rr1)
    q = random_configurations(rr1, 2, seed=7).reshape(-1)
    np.testing.assert_allclose(both.pose(q, "right/tool"), right @ alone.pose(q[6:]), atol=1e-14)
    J = both.jacobian(q, "left/tool")
    np.testing.assert_allclose(J[:, :6], alone.jacobian(q[:6]), atol=1e-14)
    assert not J[:, 6:].any()
    assert both.for_arm("right").nq == 6
    np.testing.assert_allclose(both.for_arm("right").pose(q[6:]), both.pose(q, "right/tool"), atol=1e-14)


def test_a_resting_arm_has_no_columns_but_a_place(rr1):
    rest = random_configurations(rr1, 1, seed=8)[0]
    scene = Scene({"left": Arm(rr1), "right": Arm(rr1, pose([0.0, 0.6, 0.0]), rest)})
    kinematics = Kinematics(scene, ["left"])
    assert kinematics.nq == 6
    np.testing.assert_allclose(
        kinematics.pose(rr1.home, "right/tool"), scene.arms["right"].base @ rr1.link_poses(rest)["tool"], atol=1e-14
    )
    assert not kinematics.jacobian(rr1.home, "right/tool").any()
    np.testing.assert_allclose(kinematics.pose(rest, "tool"), kinematics.pose(rest, "left/tool"), atol=0)


def test_wrong_names_and_numbers_are_told(rr1):
    kinematics = Kinematics(rr1)
    with pytest.raises(UnknownNameError, match="hand_link"):
        kinematics.pose(rr1.home, "hand_lnk")
    with pytest.raises(UnknownNameError, match="unknown arm"):
        kinematics.pose(rr1.home, "left/tool")
    with pytest.raises(InputError, match="shape"):
        kinematics.pose(np.zeros(5))
    with pytest.raises(InputError, match="finite"):
        kinematics.jacobian([np.nan] * 6)
    with pytest.raises(InputError, match="expected the same"):
        kinematics.inverse_dynamics(np.zeros((2, 6)), np.zeros((3, 6)), np.zeros((2, 6)))
    with pytest.raises(InputError, match="expected a name"):
        kinematics.frame(3)
    two = Kinematics(Scene({"left": Arm(rr1), "right": Arm(rr1, [0.0, 1.0, 0.0])}))
    with pytest.raises(InputError, match="say which"):
        two.pose(np.zeros(12), "tool")
    with pytest.raises(InputError, match="say which"):
        two.for_arm()


def test_a_pickled_kinematics_computes_the_same(rr1):
    kinematics = Kinematics(rr1)
    again = pickle.loads(pickle.dumps(kinematics))
    np.testing.assert_array_equal(again.pose(rr1.home), kinematics.pose(rr1.home))
