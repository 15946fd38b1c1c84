"""The contract of every robot in models/robots; new folders are found automatically."""

from __future__ import annotations

import tomllib

import numpy as np
import pinocchio as pin
import pytest

import rr1plan as rp
from rr1plan.robot.disabled_collisions import LinkBodies, propose_disabled_collisions
from rr1plan.scene.model_library import models_folder, robot_folder, robot_names

RATES = ("velocity", "acceleration", "jerk", "effort")


@pytest.fixture(scope="module", params=robot_names())
def shipped(request: pytest.FixtureRequest) -> rp.Robot:
    return rp.load_robot(request.param)


def test_the_folders_are_found() -> None:
    assert {"rr1", "planar2r", "planar2r_limited"} <= set(robot_names())


def test_it_bears_the_name_of_its_folder_and_says_its_licence_and_provenance(shipped: rp.Robot) -> None:
    about = tomllib.loads((robot_folder(shipped.name) / "robot.toml").read_text())["about"]
    assert {"title", "license", "provenance"} <= set(about)
    assert (models_folder() / "robots" / shipped.name).is_dir()


def test_its_limits_are_finite_in_every_preset(shipped: rp.Robot) -> None:
    assert shipped.presets
    for limits in (shipped.limits, *shipped.presets.values()):
        assert all(np.isfinite(getattr(limits, rate)).all() for rate in RATES)
        assert np.array_equal(np.isinf(limits.upper), shipped.continuous == 1)
        for name, lower, upper in zip(shipped.joint_names, limits.lower, limits.upper, strict=True):
            assert shipped.joint(name).lower <= lower
            assert upper <= shipped.joint(name).upper


def test_its_configurations_are_free_and_within_the_limits_and_home_within_all(shipped: rp.Robot) -> None:
    bodies = LinkBodies(shipped)
    pairs = [pair for pair in bodies.pairs if pair not in shipped.disabled_collisions]
    for q in shipped.configurations.values():
        assert ((q >= shipped.limits.lower) & (q <= shipped.limits.upper)).all()
        assert not bodies.touching(shipped.joint_values(q), pairs)
    for limits in shipped.presets.values():
        assert ((shipped.home >= limits.lower) & (shipped.home <= limits.upper)).all()


def test_pairs_switched_off_are_neighbors_or_never_meet(shipped: rp.Robot) -> None:
    proposed = propose_disabled_collisions(shipped, samples=1500, rng=0)
    fingers = frozenset(("finger_link", "opposite_finger_link"))
    assert shipped.disabled_collisions - {fingers} <= set(proposed)


def test_every_moving_link_weighs_something_and_every_link_with_mass_can_be(shipped: rp.Robot) -> None:
    for joint in shipped.joints:
        inertial = shipped.link(joint.child).inertial
        assert joint.kind == "fixed" or inertial is not None
        if inertial is not None:
            a, b, c = np.linalg.eigvalsh(inertial.inertia)
            assert 0 < a <= b <= c <= a + b


def test_every_frame_is_where_pinocchio_puts_it(shipped: rp.Robot) -> None:
    file = robot_folder(shipped.name) / f"{shipped.name}.urdf"
    model = pin.buildModelFromXML(file.read_text())
    geometry = pin.buildGeomFromUrdfString(model, file.read_text(), pin.GeometryType.COLLISION)
    assert geometry.ngeoms == sum(len(link.collisions) for link in shipped.links)
    data = model.createData()
    rng = np.random.default_rng(0)
    for _ in range(50):
        q = rng.uniform(np.maximum(shipped.limits.lower, -4), np.minimum(shipped.limits.upper, 4))
        values = shipped.joint_values(q)
        full = np.concatenate(
            [
                [np.cos(values[n]), np.sin(values[n])] if joint.nq == 2 else [values[n]]
                for joint, n in zip(model.joints[1:], list(model.names)[1:], strict=True)
            ]
        )
        pin.framesForwardKinematics(model, data, full)
        for link, pose in shipped.link_poses(q).items():
            reference = data.oMf[model.getFrameId(link, pin.FrameType.BODY)].homogeneous
            assert np.abs(pose - reference).max() < 1e-12


# ---- RR1 in particular -------------------------------------------------------------------


def test_rr1_has_the_parts_and_the_weight_of_its_twin(rr1: rp.Robot) -> None:
    assert len(rr1.links) == 10
    assert sum(joint.kind != "fixed" for joint in rr1.joints) == 8
    assert rr1.tool == "tool"
    assert sum(link.inertial.mass for link in rr1.links if link.inertial) == pytest.approx(14.25)


@pytest.mark.parametrize(
    ("q", "xyz"),
    [
        ([0, 0, 0, 0, 0, 0], [-0.336, 0.057, 0.3097]),
        ([1.290987, -0.048005, 1.126569, 0.930075, 0.295867, 2.241318], [-0.224683539, -0.129916574, 0.723955012]),
        ([-1.752473, -0.038967, -0.4059, 2.011083, 2.022762, 1.520978], [-0.01646775, 0.540673835, 0.317989297]),
        ([0.257225, -0.342577, 1.029284, 0.620454, 2.381603, -0.68553], [-0.27102165, -0.11000911, 0.852543704]),
    ],
)
def test_rr1s_tool_is_where_its_twins_is(rr1: rp.Robot, q: list[float], xyz: list[float]) -> None:
    assert np.allclose(rr1.link_poses(q)["tool"][:3, 3], xyz, atol=2e-6)


def test_rr1s_tool_looks_out_of_the_hand_and_along_the_fingers_travel(rr1: rp.Robot) -> None:
    closed, opened = (rr1.with_locked_joints(name).link_poses("home") for name in ("closed", "open"))
    T, hand = closed["tool"], closed["hand_link"]
    out = (T[:3, 3] - hand[:3, 3]) / np.linalg.norm(T[:3, 3] - hand[:3, 3])
    assert np.allclose(T[:3, 2], out, atol=1e-12)
    # A fingertip opens along the tool's x, and not along its y.
    tip = np.array([0.0, 0.0, -0.0735, 1.0])
    travel = np.linalg.inv(T) @ (opened["finger_link"] - closed["finger_link"]) @ tip
    assert travel[0] > 0.05
    assert travel[1] == pytest.approx(0.0, abs=1e-12)


def test_a_quaternion_that_turns_the_tool_over_points_rr1s_hand_down(rr1: rp.Robot) -> None:
    goal = rp.PoseGoal("tool", [-0.3, 0.1, 0.25], (0, 1, 0, 0))
    found = rp.solve_ik(rp.Kinematics(rr1), goal, rng=0)
    assert len(found.solutions)
    for q in found.solutions:
        poses = rr1.link_poses(q)
        hand = poses["hand_link"][:3, 3]
        # The hand is above the tool, and its fingers travel along x.
        assert np.allclose(hand, [-0.3, 0.1, 0.25 + 0.195], atol=1e-3)
        assert np.allclose(np.abs(poses["tool"][:3, 0]), [1.0, 0.0, 0.0], atol=1e-2)


def test_rr1_starts_with_the_thesis_limits(rr1: rp.Robot) -> None:
    assert np.allclose(rr1.limits.upper, np.pi * np.array([3 / 4, 1 / 8, 1 / 2, 3 / 4, 1, 3 / 4]))
    assert np.allclose(rr1.limits.lower, np.pi * np.array([-3 / 4, -1 / 8, -1 / 2, -3 / 4, 0, -3 / 4]))
    assert np.allclose(rr1.limits.velocity, 75 * 2 * np.pi / 60)
    assert set(rr1.presets) == {"sim", "hardware", "rev1_safe"}
    slow, fast = rr1.presets["rev1_safe"], rr1.presets["hardware"]
    assert (slow.lower >= fast.lower).all()
    assert (slow.upper <= fast.upper).all()
    assert (fast.velocity < rr1.limits.velocity / 10).all()


def test_rr1s_motors_can_do_what_the_sim_limits_ask(rr1: rp.Robot) -> None:
    model = pin.buildModelFromXML((robot_folder("rr1") / "rr1.urdf").read_text())
    data = model.createData()
    rng = np.random.default_rng(0)
    for _ in range(500):
        q = rng.uniform(model.lowerPositionLimit, model.upperPositionLimit)
        inertia = pin.crba(model, data, q)
        inertia = np.triu(inertia) + np.triu(inertia, 1).T
        gravity = pin.computeGeneralizedGravity(model, data, q)
        worst = np.abs(inertia[:6, :6]) @ rr1.limits.acceleration + np.abs(gravity[:6])
        assert (worst <= rr1.limits.effort).all()


def test_rr1s_upper_arm_and_forearm_are_checked_because_they_can_touch(rr1: rp.Robot) -> None:
    pair = frozenset(("upper_arm_link", "forearm_link"))
    assert pair not in rr1.disabled_collisions
    assert LinkBodies(rr1).touching(rr1.joint_values(np.array([0, 0, -1.4, 1.5, 1.0, 0])), [pair]) == {pair}


def test_rr1s_fingers_open_wide_and_meet_when_closed(rr1: rp.Robot) -> None:
    pair = frozenset(("finger_link", "opposite_finger_link"))
    bodies = LinkBodies(rr1)
    assert not bodies.touching(rr1.with_locked_joints("open").joint_values(rr1.home), [pair])
    assert bodies.touching(rr1.with_locked_joints("closed").joint_values(rr1.home), [pair])
    assert pair in rr1.disabled_collisions


def test_rr1_is_orange_with_dark_motors_and_aluminium(rr1: rp.Robot) -> None:
    colors = [g.color for link in rr1.links for g in link.visuals]
    assert None not in colors
    assert len(set(colors)) == 3
    assert (1.0, 0.3, 0.1, 1.0) in colors


def test_the_planar_arms_differ_in_their_limits_only() -> None:
    free, limited = rp.load_robot("planar2r"), rp.load_robot("planar2r_limited")
    assert free.continuous.tolist() == [1, 1]
    assert limited.continuous.tolist() == [0, 0]
    q = [0.3, -1.2]
    for link, pose in free.link_poses(q).items():
        assert np.array_equal(pose, limited.link_poses(q)[link])
