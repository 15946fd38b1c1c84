"""Inverse solutions, self-motion and the free share of an arm of six joints."""

from __future__ import annotations

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.lessons.free_share import free_share
from rr1plan.lessons.inverse_solutions import inverse_solutions, self_motion

POSED = [0.21, 0.12, -0.43, -1.45, 2.19, -2.34]
TURNING = [-0.719, -0.057, -0.386, -0.358, 0.639, -0.315]


@pytest.fixture(scope="module")
def scene() -> rp.Scene:
    return rp.load_scene("rr1_table")


def test_all_solutions_hold_the_tool_and_are_judged(scene: rp.Scene) -> None:
    solutions = inverse_solutions(scene, "rr1", POSED)
    kinematics, checker = rp.Kinematics(scene), rp.CollisionChecker(scene)
    assert len(solutions) == 8
    np.testing.assert_allclose(solutions[0].q, POSED, atol=1e-6)
    for solution in solutions:
        np.testing.assert_allclose(kinematics.pose(solution.q), kinematics.pose(POSED), atol=1e-6)
        assert solution.within_limits == checker.within_limits(solution.q)
        assert bool(solution.touching) != checker.is_free(solution.q)
        assert solution.is_valid == (checker.within_limits(solution.q) and checker.is_free(solution.q))
    gaps = [np.abs(a.q - b.q).max() for k, a in enumerate(solutions) for b in solutions[:k]]
    assert min(gaps) > 0.01


def test_a_whole_pose_leaves_a_planar_arm_one_solution() -> None:
    scene = rp.Scene().with_arm("arm", rp.planar_arm("RR", (1.0, 0.7)))
    (only,) = inverse_solutions(scene, "arm", [0.3, 0.8])
    np.testing.assert_allclose(only.q, [0.3, 0.8], atol=1e-6)
    assert only.is_valid


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_a_self_motion_keeps_place_and_axis(scene: rp.Scene, axis: str) -> None:
    rows = self_motion(scene, "rr1", TURNING, axis=axis)
    kinematics, limits = rp.Kinematics(scene), scene.limits()
    target, column = kinematics.pose(TURNING), "xyz".index(axis)
    assert len(rows) > 50
    assert np.abs(rows - TURNING).max(axis=1).min() < 1e-9
    for q in rows:
        T = kinematics.pose(q)
        np.testing.assert_allclose(T[:3, 3], target[:3, 3], atol=1e-7)
        np.testing.assert_allclose(T[:3, column], target[:3, column], atol=1e-7)
    assert (rows >= limits.lower).all()
    assert (rows <= limits.upper).all()
    steps = np.linalg.norm(np.diff(rows, axis=0), axis=1)
    assert steps.min() > 0.01
    assert steps.max() < 0.03
    moved = np.ptp(rows, axis=0) > 1e-6
    assert moved.sum() == (1 if axis == "z" else 6)


def test_a_self_motion_ends_at_a_limit(scene: rp.Scene) -> None:
    rows, limits = self_motion(scene, "rr1", TURNING), scene.limits()
    room = np.minimum(rows[[0, -1]] - limits.lower, limits.upper - rows[[0, -1]]).min(axis=1)
    assert (room < 0.02).all()
    with pytest.raises(rp.UnknownNameError, match="axis"):
        self_motion(scene, "rr1", TURNING, axis="w")


def test_the_share_is_right_where_it_is_known() -> None:
    """A 2R arm of which one link can touch a wall: the free share comes from the grid, cell by cell."""
    arm = rp.planar_arm("RR", (1.0, 0.7), limits=[(-3.0, 3.0), (-2.5, 2.5)])
    scene = rp.Scene().with_arm("arm", arm).with_obstacle("disc", rp.Cylinder(0.3, 0.2), (1.1, 0.4, 0.0))
    grid = rp.cspace(scene, resolution=240).grid
    inside = ~grid.layers["joint limits"]
    truth = float(grid.free[inside].mean())
    found = free_share(rp.CollisionChecker(scene), 4000, rng=1)
    assert 0.5 < truth < 0.95
    assert found.low < truth < found.high
    assert found.high - found.low < 0.04


def test_intervals_shrink_with_the_root_of_the_samples_and_contain_the_estimate(scene: rp.Scene) -> None:
    checker = rp.CollisionChecker(scene)
    few, many = free_share(checker, 100, rng=0), free_share(checker, 1600, rng=0)
    assert few.low < few.share < few.high
    assert (few.high - few.low) / (many.high - many.low) == pytest.approx(4.0, rel=0.25)
    sure = free_share(checker, 100, rng=0, confidence=0.999)
    assert sure.low < few.low < few.high < sure.high
    assert "95 % confidence (100 samples)" in str(few)


def test_samples_need_limits_and_a_probability(scene: rp.Scene) -> None:
    with pytest.raises(rp.InputError, match="confidence is 1"):
        free_share(rp.CollisionChecker(scene), 10, confidence=1.0)
    with pytest.raises(rp.InputError, match="samples"):
        free_share(rp.CollisionChecker(scene), 0)


def test_a_lesson_about_six_joints_needs_six() -> None:
    with pytest.raises(rp.InputError, match="needs an arm of six joints, and arm 'arm' has 2"):
        rp.lesson("six_joints", rp.Scene().with_arm("arm", rp.planar_arm("RR", (1.0, 0.7))))
