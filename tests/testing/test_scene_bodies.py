"""Frames, samples and boxes of the second opinion are correct."""

from __future__ import annotations

from dataclasses import replace

import coal
import numpy as np
import pytest
from concave_meshes import torus

import rr1plan as rp
from rr1plan.testing.closed_meshes import is_inside
from rr1plan.testing.collision_checkers import CoalOnlyChecker
from rr1plan.testing.scene_bodies import SceneBodies, boxes_meet, link_frames
from rr1plan.transforms import pose


@pytest.fixture
def scene() -> rp.Scene:
    """Two RR1, one of which holds a box, and a post."""
    rr1 = rp.load_robot("rr1")
    return (
        rp.Scene()
        .with_arm("left", rr1, [0.0, 0.7, 0.0])
        .with_arm("right", rr1, pose([0.1, -0.7, 0.2], rpy=[0.1, 0.0, 0.4]))
        .with_obstacle("post", rp.Cylinder(0.03, 0.8), [-0.35, 0.0, 0.4])
        .with_obstacle("tray", rp.Box((0.1, 0.2, 0.01)), [0.0, 0.0, 2.0])
        .attach("tray", "right", pose=pose([0.0, 0.0, 0.02], rpy=[0.3, 0.0, 0.0]))
    )


def test_frames_are_those_of_the_description(scene: rp.Scene) -> None:
    bodies = SceneBodies(scene, scene.joint_names(["right"]))
    limits = scene.limits(["right"])
    q = np.random.default_rng(1).uniform(limits.lower, limits.upper, (20, 6))
    frames = bodies.frames(q)
    for n, row in enumerate(q):
        links = scene.link_poses({"right": row})
        for k, body in enumerate(bodies.bodies):
            want = body.pose if body.frame == "" else links[body.frame] @ body.pose
            np.testing.assert_allclose(frames[n, k], want, atol=1e-12)


def test_joints_that_mimic_others_follow_them() -> None:
    """Through a chain of two, of which the middle one is not planned for."""
    link, joint = rp.Link, rp.Joint
    y = np.array([0.0, 1.0, 0.0])
    at = pose([0.0, 0.0, 0.3])
    robot = rp.Robot(
        name="chain",
        links=tuple(link(n) for n in ("base", "a", "b", "c")),
        joints=(
            joint("one", "revolute", "base", "a", axis=y, lower=-1.0, upper=1.0),
            joint("two", "revolute", "a", "b", at, y, mimic=rp.Mimic("one", -2.0, 0.1)),
            joint("three", "prismatic", "b", "c", at, y, mimic=rp.Mimic("two", 0.5, 0.2)),
        ),
        joint_names=("one",),
        limits=rp.Limits(*(np.full(1, v) for v in (-1.0, 1.0, 1.0, 1.0, 1.0, 1.0))),
        configurations={"home": np.zeros(1)},
        locked_joints={},
        disabled_collisions=frozenset(),
        tool="c",
    )
    q = np.array([[-0.7], [0.0], [0.4]])
    frames = link_frames(robot, q)
    for n, row in enumerate(q):
        for name, T in robot.link_poses(row).items():
            np.testing.assert_allclose(frames[name][n], T, atol=1e-14)


def test_boxes_meet_exactly_when_coal_says_so() -> None:
    rng = np.random.default_rng(2)
    n = 600
    half_a, half_b = rng.uniform(0.02, 0.5, (n, 3)), rng.uniform(0.02, 0.5, (n, 3))
    turns = np.array([[pose(rpy=rng.uniform(-np.pi, np.pi, 3))[:3, :3] for _ in range(2)] for _ in range(n)])
    offset = rng.normal(size=(n, 3)) * 0.5
    meet = boxes_meet(turns[:, 0], half_a, turns[:, 1], half_b, offset)
    distance = np.array(
        [
            coal.distance(
                coal.Box(*(2 * half_a[i])),
                coal.Transform3s(turns[i, 0], np.zeros(3)),
                coal.Box(*(2 * half_b[i])),
                coal.Transform3s(turns[i, 1], offset[i]),
                coal.DistanceRequest(),
                coal.DistanceResult(),
            )
            for i in range(n)
        ]
    )
    clear = np.abs(distance) > 1e-5
    assert clear.sum() > 0.95 * n
    assert (meet == (distance <= 0.0))[clear].all()
    assert 0.2 < meet.mean() < 0.8


def test_no_point_moves_more_than_a_step_between_samples(scene: rp.Scene) -> None:
    q = np.array([[0.0] * 6, [0.5, 0.1, -0.4, 1.0, 0.5, 1.0], [0.5, 0.1, -0.3, 1.0, 2.0, 1.0]])
    motion = rp.Trajectory.from_samples(scene.joint_names(["left"]), np.arange(3.0), q)
    samples = SceneBodies(scene, motion.joint_names).sample_times(motion, 0.001)
    assert set(motion.breaks) <= set(samples)
    tip = scene.arms["left"].robot.link("finger_link").collisions[-1]
    for T in (tip.pose @ pose([0, 0, s * tip.shape.length / 2]) for s in (-1, 1)):
        points = np.array([(scene.link_poses({"left": q})["left/finger_link"] @ T)[:3, 3] for q in motion(samples)])
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        assert steps.max() <= 1e-3
        assert steps.max() > 3e-4


@pytest.mark.parametrize("turns", [1.0, 49.0])
def test_whole_turns_are_sampled(turns: float) -> None:
    """Poses at regular times may be equal although the arm turns between them."""
    scene = rp.Scene().with_arm("arm", rp.load_robot("planar2r"))
    q = scene.configuration() + 2.0 * np.pi * turns * np.eye(2)[[1, 0]] * [[0.0], [1.0]]
    rest = np.zeros((2, 2))
    for motion in (
        rp.Trajectory.from_samples(scene.joint_names(), [0.0, 100.0], q),
        rp.Trajectory.from_samples(scene.joint_names(), [0.0, 100.0], q, rest, rest),
    ):
        bodies = SceneBodies(scene, motion.joint_names)
        samples = bodies.sample_times(motion, 0.05)
        times = np.unique(np.concatenate([samples, *(samples[:-1] + k / 8 * np.diff(samples) for k in range(1, 8))]))
        tips = bodies.frames(motion(times))[:, -1, :3, 3]
        length = np.linalg.norm(np.diff(tips, axis=0), axis=1).reshape(-1, 8).sum(axis=1)
        assert length.max() <= 0.05
        assert length.max() > 0.02


def test_a_motion_that_jumps_is_refused(scene: rp.Scene) -> None:
    names, q = scene.joint_names(["left"]), scene.configuration(["left"])
    motion = rp.Trajectory(names, [0.0, 1.0, 2.0], [[q], [q + 0.1 * np.eye(6)[0]]])
    with pytest.raises(rp.InputError, match=r"joint 'left/shoulder_joint' jumps by 0\.1 rad or m at 1\.00000 s"):
        SceneBodies(scene, names).sample_times(motion, 0.001)


def test_no_pair_in_contact_is_left_out(scene: rp.Scene) -> None:
    """Neither by bounds over the whole motion, nor by boxes at a sample."""
    scene = replace(scene, arms={**scene.arms, "right": replace(scene.arms["right"], base=pose([0.0, 0.3, 0.0]))})
    bodies = SceneBodies(scene, scene.joint_names())
    rng = np.random.default_rng(4)
    q = rng.uniform(-1.5, 1.5, (30, 12))
    curve = rp.Trajectory.from_samples(scene.joint_names(), np.arange(30.0), q)
    reachable = bodies.reachable_pairs(curve, np.arange(30.0))
    near = {(n, *reachable[k].tolist()) for n, k in zip(*bodies.nearby_pairs(bodies.frames(q), reachable), strict=True)}
    library, frames, touching = CoalOnlyChecker(bodies.bodies), bodies.frames(q), 0
    for n in range(30):
        for a, b in bodies.pairs.tolist():
            if library.touches(a, frames[n, a], b, frames[n, b]):
                touching += 1
                assert (n, a, b) in near
    assert touching > 50


def test_points_inside_a_torus_are_those_near_its_circle() -> None:
    ring = torus(0.25, 0.1, 64, 48)
    points = np.random.default_rng(3).uniform(-0.4, 0.4, (400, 3))
    away = np.hypot(np.hypot(points[:, 0], points[:, 1]) - 0.25, points[:, 2])
    inside = np.array([is_inside(ring, point) for point in points])
    clear = np.abs(away - 0.1) > 2e-3
    np.testing.assert_array_equal(inside[clear], away[clear] < 0.1)
    assert 0.05 < inside.mean() < 0.5
