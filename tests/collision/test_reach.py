"""Balls that contain the reachable space of an arm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rr1plan.collision import CollisionChecker
from rr1plan.collision.arm_geometry import arm_geometry
from rr1plan.collision.reach_broad_phase import near_balls, reach_ball
from rr1plan.robot import Geometry, Joint, Link, Robot
from rr1plan.robot.joint_limits import Limits
from rr1plan.scene import Arm, Scene
from rr1plan.scene.model_library import load_robot
from rr1plan.shapes import Box, Capsule, Cylinder, Mesh, Sphere
from rr1plan.transforms import pose


def ball_of(scene, name="a"):
    held = {n: thing for n, thing in scene.attachments.items() if thing.arm == name}
    return reach_ball(arm_geometry(scene.arms[name], held))


def farthest(shape, toward):
    """How far a shape goes along a direction of its frame, (3,)."""
    match shape:
        case Box(size):
            return float(np.abs(toward) @ np.array(size)) / 2
        case Sphere(radius):
            return radius
        case Capsule(radius, length):
            return radius + abs(toward[2]) * length / 2
        case Cylinder(radius, length):
            return radius * float(np.hypot(*toward[:2])) + abs(toward[2]) * length / 2
        case Mesh():
            return float((shape.vertices @ toward).max())


def excess(scene, ball, q, rng):
    """How far the arm "a" is outside a ball that is given in the frame of its base [m], along some directions."""
    arm = scene.arms["a"]
    poses = scene.link_poses({"a": q})
    shapes = [(poses[f"a/{link.name}"] @ g.pose, g.shape) for link in arm.robot.links for g in link.collisions]
    for thing in scene.attachments.values():
        at = poses[f"a/{thing.link}"] @ thing.pose
        shapes += [(at @ g.pose, g.shape) for g in thing.geometries]
    center = arm.base[:3, :3] @ ball[:3] + arm.base[:3, 3]
    most = -np.inf
    for T, shape in shapes:
        away = T[:3, 3] - center
        for n in (away, *rng.normal(size=(3, 3))):
            n = n / max(np.linalg.norm(n), 1e-12)
            most = max(most, float(n @ away) + farthest(shape, T[:3, :3].T @ n) - ball[3])
    return most


def branched():
    """Two arms on one trunk, each with joints of its own."""
    rod = Geometry("rod", Capsule(0.02, 0.3), pose([0.17, 0, 0], rpy=[0, np.pi / 2, 0]))
    names = ("trunk", "left", "left tip", "right", "right tip")
    links = (Link("base"), *(Link(name, collisions=(rod,)) for name in names))
    y = np.array([0.0, 1.0, 0.0])
    joints = (
        Joint("turn", "revolute", "base", "trunk", pose([0.1, 0.2, 0.3])),
        Joint("l1", "revolute", "trunk", "left", pose([0.0, 0.0, 0.2]), y),
        Joint("l2", "revolute", "left", "left tip", pose([0.34, 0.0, 0.0])),
        Joint("r1", "revolute", "trunk", "right", pose([0.0, -0.4, 0.0]), y),
        Joint("r2", "revolute", "right", "right tip", pose([0.34, 0.0, 0.0])),
    )
    limits = Limits(np.full(5, -3.1), np.full(5, 3.1), *(np.ones(5) for _ in range(4)))
    joint_names = tuple(joint.name for joint in joints)
    return Robot("branched", links, joints, joint_names, limits, {"home": np.zeros(5)}, {}, frozenset(), "left tip")


def with_stroke_held(scara):
    """The robot with a sliding joint, which does not slide."""
    names = ("first", "second", "roll")
    limits = Limits(np.full(3, -2.5), np.full(3, 2.5), *(np.ones(3) for _ in range(4)))
    return replace(
        scara, joint_names=names, limits=limits, locked_joints={"stroke": -0.15}, configurations={"home": np.zeros(3)}
    )


ROBOTS = ("rr1", "panda", "ur5", "planar", "planar2r", "six", "scara", "stroke held", "odd", "branched")


@pytest.fixture
def robot(request):
    name = request.param
    if name in ("panda", "ur5"):
        return request.getfixturevalue("foreign")[name]
    if name == "stroke held":
        return with_stroke_held(request.getfixturevalue("scara"))
    if name == "branched":
        return branched()
    return load_robot(name) if name == "planar2r" else request.getfixturevalue(name)


@pytest.mark.parametrize("robot", ROBOTS, indirect=True)
@pytest.mark.parametrize("held", [False, True])
def test_no_configuration_leaves_the_ball(robot, held):
    rng = np.random.default_rng(11)
    scene = Scene().with_arm("a", robot, pose([0.3, -0.2, 0.5], quaternion=rng.normal(size=4)))
    if held:
        scene = scene.with_obstacle("rod", Box((0.4, 0.02, 0.02))).attach("rod", pose=pose([0.1, 0.1, 0.2]))
    ball = ball_of(scene)
    slides = any(joint.kind == "prismatic" for joint in robot.joints if joint.name in robot.joint_names)
    assert np.isfinite(ball[3]) != slides
    # Limits do not count.
    for q in [robot.home, *rng.uniform(-np.pi, np.pi, (300, robot.nq))]:
        assert excess(scene, ball, q, rng) < 0.0


@pytest.mark.parametrize(
    ("robot", "share"), [("planar", 0.999), ("rr1", 0.6), ("six", 0.7), ("stroke held", 0.7)], indirect=["robot"]
)
def test_the_ball_is_not_much_larger_than_the_reach(robot, share):
    rng = np.random.default_rng(12)
    scene = Scene().with_arm("a", robot)
    ball = ball_of(scene)
    configurations = [np.zeros(robot.nq), *rng.uniform(-np.pi, np.pi, (600, robot.nq))]
    assert max(excess(scene, ball, q, rng) for q in configurations) > (share - 1.0) * ball[3]


def test_what_is_held_makes_the_ball_wider(planar):
    scene = Scene().with_arm("a", planar)
    rod = scene.with_obstacle("rod", Box((1.0, 0.02, 0.02))).attach("rod", pose=pose([0.5, 0, 0]))
    assert ball_of(rod)[3] > ball_of(scene)[3] + 0.5


def test_an_arm_without_shapes_reaches_nothing():
    limits = Limits(-np.ones(1), np.ones(1), *(np.ones(1) for _ in range(4)))
    links, joints = (Link("base"), Link("tip")), (Joint("j", "revolute", "base", "tip"),)
    bare = Robot("bare", links, joints, ("j",), limits, {"home": np.zeros(1)}, {}, frozenset(), "tip")
    assert reach_ball(arm_geometry(Arm(bare), {}))[3] < 1e-6


@pytest.mark.parametrize("seed", range(5))
def test_near_balls_are_all_pairs_within_the_distance(seed):
    rng = np.random.default_rng(seed)
    balls = np.column_stack([rng.uniform(-2, 2, (60, 3)), rng.uniform(0, 0.4, 60)])
    # Some in the same place, some along one line, one that contains all.
    balls[:5, :3], balls[5:20, 1:3], balls[20, 3] = 0.0, 0.0, 9.0
    distance = float(rng.choice([0.0, 0.1]))
    gaps = np.linalg.norm(balls[:, None, :3] - balls[None, :, :3], axis=2) - balls[:, None, 3] - balls[None, :, 3]
    expected = [(i, j) for i in range(60) for j in range(i + 1, 60) if gaps[i, j] <= distance]
    assert list(map(tuple, near_balls(balls, distance).tolist())) == expected
    assert near_balls(np.zeros((0, 4)), 0.1).shape == (0, 2)


def test_links_out_of_reach_are_omitted_and_stay_apart(rr1: Robot) -> None:
    arms = {f"a{i}": Arm(rr1, pose([1.3 * i, 0.0, 0.0])) for i in range(3)}
    checker = CollisionChecker(Scene(arms))
    whole = checker.complete()
    pairs = set(checker.pairs)
    assert pairs < set(whole.pairs)
    assert not any({a, b} >= {"a0/base_link", "a1/base_link"} for a, b in pairs)
    assert any({a, b} >= {"a0/hand_link", "a1/hand_link"} for a, b in pairs)
    omitted = [i for i, both in enumerate(whole.pairs) if both not in pairs]
    least = checker.geometry.least_gap
    assert checker.omission_distance < least < 0.2
    rng = np.random.default_rng(3)
    for q in rng.uniform(checker.limits.lower, checker.limits.upper, (40, checker.nq)):
        assert whole.distances(q)[omitted].min() >= least
        assert checker.clearance(q) == pytest.approx(whole.clearance(q), abs=1e-9)
        assert checker.is_free(q) == whole.is_free(q)
    assert checker.nearest(checker.scene.configuration()).pair == whole.nearest(whole.scene.configuration()).pair
