"""The benchmarks' own eyes: frames, samples and boxes are what they claim to be, and a touch is seen."""

from __future__ import annotations

import coal
import numpy as np
import pytest

import rr1plan as rp
from rr1plan.transforms import pose


@pytest.fixture
def scene():
    """RR1 with a post in the way of its shoulder's turn."""
    return (
        rp.Scene()
        .with_arm("rr1", rp.load_robot("rr1"))
        .with_obstacle("post", rp.Cylinder(0.03, 0.8), [-0.35, 0.0, 0.4])
        .with_obstacle("far_box", rp.Box((0.1, 0.1, 0.1)), [1.5, 0.0, 0.2])
    )


@pytest.fixture
def opinions(script, scene):
    return script("opinions").Opinions(scene)


def test_frames_are_those_of_the_description(opinions, scene):
    rng = np.random.default_rng(1)
    limits = scene.limits()
    q = rng.uniform(limits.lower, limits.upper, (20, 6))
    frames = opinions.bodies.frames(q)
    for n, row in enumerate(q):
        links = scene.link_poses({"rr1": row})
        for k, body in enumerate(opinions.bodies.moving):
            np.testing.assert_allclose(frames[n, k], links[body.element] @ body.local, atol=1e-12)


def test_boxes_meet_exactly_when_coal_says_so(script):
    rng = np.random.default_rng(2)
    n = 600
    half_a, half_b = rng.uniform(0.02, 0.5, (n, 3)), rng.uniform(0.02, 0.5, (n, 3))
    turns = np.array([[pose(rpy=rng.uniform(-np.pi, np.pi, 3))[:3, :3] for _ in range(2)] for _ in range(n)])
    offset = rng.normal(size=(n, 3)) * 0.5
    meet = script("opinions").boxes_meet(turns[:, 0], half_a, turns[:, 1], half_b, offset)
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


def test_no_point_moves_more_than_a_millimeter_between_samples(script, opinions, scene):
    module = script("opinions")
    motion, places = module.path_motion(
        np.array([[0.0] * 6, [0.5, 0.1, -0.4, 1.0, 0.5, 1.0], [0.5, 0.1, -0.3, 1.0, 2.0, 1.0]])
    )
    samples = module.millimeter_samples(opinions.bodies, motion, places)
    assert set(places) <= set(samples)
    tip = scene.arms["rr1"].robot.link("finger_link").collisions[-1]
    ends = [tip.pose @ pose([0, 0, s * tip.shape.length / 2]) for s in (-1, 1)]
    for T in ends:
        points = np.array([(scene.link_poses({"rr1": q})["rr1/finger_link"] @ T)[:3, 3] for q in motion(samples)])
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        assert steps.max() <= 1e-3
        assert steps.max() > 3e-4


def test_both_libraries_see_a_post_in_the_way(opinions):
    seen = opinions.judge_path([[-1.0, 0.0, 0.3, 0.0, 0.5, 0.0], [1.0, 0.0, 0.3, 0.0, 0.5, 0.0]])
    assert not seen.free
    assert {touch[1] for touch in seen.touches.values()} == {"post"}
    times = [touch[2] for touch in seen.touches.values()]
    assert times[0] == pytest.approx(times[1], abs=0.01)


def test_a_certified_motion_is_free_by_both(opinions, scene):
    problem = rp.Problem(scene, [-1.0, 0.0, 0.3, 0.0, 0.5, 0.0], [1.0, 0.0, 0.3, 0.0, 0.5, 0.0])
    motion = rp.plan_motion(problem, rng=0)
    assert motion.valid
    for waypoints in (motion.result.path.waypoints, motion.path.waypoints):
        assert opinions.judge_path(waypoints).free
    assert opinions.judge_trajectory(motion.trajectory).free
