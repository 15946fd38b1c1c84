"""Pinocchio models of single arms against one model of all arms."""

import numpy as np
import pinocchio as pin
import pytest

import rr1plan as rp
from rr1plan.collision.convex.convex_bodies import coal_geometry
from rr1plan.model import Kinematics
from rr1plan.model.arm_branches import ArmBranches
from rr1plan.model.scene_model import SceneModel
from rr1plan.scene import Arm, Scene
from rr1plan.transforms import pose


@pytest.fixture
def scene(odd_arm, wrist_arm, rr1):
    """Arms with different numbers of joints and frames, one of them with a body in its tool."""
    arms = {
        "odd": Arm(odd_arm, pose((0.0, 2.0, 0.1), rpy=(0.1, 0.2, 0.3))),
        "rr1": Arm(rr1, pose((0.5, 0.0, 0.0), rpy=(0.0, 0.0, 1.0))),
        "wrist": Arm(wrist_arm, pose((-0.5, 0.0, 0.0))),
        "other": Arm(rr1, pose((0.9, 0.4, 0.0)), rr1.home + 0.1),
    }
    scene = Scene(arms).with_obstacle("floor", rp.HalfSpace((0.0, 0.0, 1.0), -0.5))
    scene = scene.with_obstacle("ball", rp.Sphere(0.05), (0.5, 0.0, 1.0))
    return scene.attach("ball", "rr1", pose=pose((0.0, 0.0, 0.05)))


MOVING = [None, ["rr1"], ["odd", "wrist"], ["other", "rr1"]]


@pytest.mark.parametrize("arms", MOVING)
def test_poses_and_jacobians_are_those_of_one_model_of_all_arms(scene, arms):
    kinematics, rng = Kinematics(scene, arms), np.random.default_rng(0)
    whole = kinematics.scene_model
    data = whole.model.createData()
    frames = [f"{name}/{link}" for name, arm in scene.arms.items() for link in arm.robot.link_names]
    for q in rng.uniform(-1.0, 1.0, (5, kinematics.nq)):
        pin.computeJointJacobians(whole.model, data, whole.full(q))
        pin.updateFramePlacements(whole.model, data)
        placed = kinematics.poses(q, frames)
        for frame in frames:
            index = whole.frame_id(frame)
            expected = data.oMf[index].homogeneous
            jacobian = pin.getFrameJacobian(whole.model, data, index, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
            np.testing.assert_array_equal(placed[frame], expected)
            np.testing.assert_array_equal(kinematics.pose(q, frame), expected)
            np.testing.assert_array_equal(kinematics.poses_batch(q[None], frame)[0], expected)
            np.testing.assert_allclose(kinematics.jacobian(q, frame), jacobian @ whole.selection, rtol=0, atol=1e-15)


@pytest.mark.parametrize("arms", MOVING)
def test_torques_and_masses_are_those_of_one_model_of_all_arms(scene, arms):
    kinematics, rng = Kinematics(scene, arms), np.random.default_rng(1)
    whole = kinematics.scene_model
    data, S = whole.model.createData(), whole.selection
    q, qd, qdd = rng.uniform(-1.0, 1.0, (3, 6, kinematics.nq))
    motion = whole.full(q), whole.full_velocity(qd), whole.full_velocity(qdd)
    expected = [pin.rnea(whole.model, data, *row) @ S for row in zip(*motion, strict=True)]
    np.testing.assert_allclose(kinematics.inverse_dynamics(q, qd, qdd), expected, rtol=1e-13, atol=1e-13)
    mass = np.triu(pin.crba(whole.model, data, whole.full(q[0])))
    expected = S.T @ (mass + np.triu(mass, 1).T) @ S
    np.testing.assert_allclose(kinematics.mass_matrix(q[0]), expected, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("arms", MOVING)
def test_distances_are_those_of_one_geometry_model_of_all_arms(scene, arms):
    checker = rp.CollisionChecker(scene.with_padding(0.2), arms)
    model, geometry = checker.model.model, pin.GeometryModel()
    for k, solid in enumerate(checker.solids):
        placement = pin.SE3(np.array(solid.placement))
        geometry.addGeometryObject(pin.GeometryObject(str(k), solid.joint, placement, coal_geometry(solid.shape)))
    for i, j in checker.solid_pairs.tolist():
        geometry.addCollisionPair(pin.CollisionPair(i, j))
    data, expected = model.createData(), pin.GeometryData(geometry)
    for request in expected.distanceRequests:
        request.gjk_tolerance = 1e-10
    touching = 0
    for q in np.random.default_rng(2).uniform(-1.0, 1.0, (5, checker.nq)):
        pin.updateGeometryPlacements(model, data, geometry, expected, checker.model.full(q))
        pin.computeDistances(geometry, expected)
        distances = np.array([result.min_distance for result in expected.distanceResults])
        np.testing.assert_allclose(checker.solid_distances(q), distances, rtol=0, atol=1e-9)
        named = {checker.pairs[owner] for owner in checker.solid_owner[distances <= checker.solid_padding]}
        assert {(c.a, c.b) for c in checker.contacts(q)} == named | set(checker.static_contacts)
        assert checker.is_free_slowly(q) == (not named and not checker.static_contacts)
        touching += len(named)
    assert touching or not len(checker.pairs), "arms without shapes"


def test_no_data_are_made_of_several_arms(scene, monkeypatch):
    """Their size grows with the cube of the number of joints."""
    joints = []
    create = pin.Model.createData
    monkeypatch.setattr(pin.Model, "createData", lambda model: joints.append(model.nv) or create(model))
    kinematics = Kinematics(scene)
    q = np.zeros(kinematics.nq)
    kinematics.pose(q, "rr1/tool")
    assert len(joints) == 1, "an arm is made when it is needed"
    kinematics.gravity(q)
    kinematics.mass_matrix(q)
    checker = rp.CollisionChecker(scene)
    checker.contacts(q)
    checker.is_free_slowly(q)
    assert max(joints) == max(sum(joint.kind != "fixed" for joint in arm.robot.joints) for arm in scene.arms.values())


def test_the_frame_of_the_world_belongs_to_no_arm(scene):
    branches = ArmBranches(SceneModel(scene))
    assert branches.of_frame(1) is branches.of_arm("odd")
    with pytest.raises(rp.InputError, match="index"):
        Kinematics(scene).pose_and_jacobian(np.zeros(Kinematics(scene).nq), 0)
