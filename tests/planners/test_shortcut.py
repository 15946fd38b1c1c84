from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rr1plan.collision import CollisionChecker
from rr1plan.errors import InputError
from rr1plan.path import Path
from rr1plan.planners.shortcut import shorten
from rr1plan.robot import Geometry, Joint, Link, Robot
from rr1plan.robot.joint_limits import Limits
from rr1plan.scene import Scene
from rr1plan.shapes import Box, Sphere


def gantry_scene():
    """A ball that two sliding joints carry over the plane: configurations are places in meters."""
    ball = Link("ball", collisions=(Geometry("ball", Sphere(0.05)),))
    axes = np.eye(3)
    joints = (
        Joint("x", "prismatic", "base", "cart", axis=axes[0], lower=-2, upper=2),
        Joint("y", "prismatic", "cart", "ball", axis=axes[1], lower=-2, upper=2),
    )
    limits = Limits(np.full(2, -2.0), np.full(2, 2.0), *(np.ones(2) for _ in range(4)))
    robot = Robot(
        *("gantry", (Link("base"), Link("cart"), ball), joints, ("x", "y"), limits),
        *({"home": np.zeros(2)}, {}, frozenset(), "ball"),
    )
    return Scene().with_arm("g", robot).with_obstacle("block", Box((0.6, 0.6, 0.6)), [0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def gantry():
    return CollisionChecker(gantry_scene())


def gantry_path(points):
    return Path(("g/x", "g/y"), np.array(points, dtype=float))


DETOUR = [[-1, 0], [-1, 1.5], [0.5, 1.5], [1.5, 1.0], [1, 0]]


def test_a_detour_becomes_nearly_the_shortest_way_round(gantry, is_certified):
    result = shorten(gantry_path(DETOUR), gantry.scene, checker=gantry, rng=1, iterations=200)
    # Round the corners of the block, grown by the ball: at best two tangents and a straight piece.
    best = 2 * np.hypot(0.7, 0.35) + 0.6
    assert best * 0.97 < result.length < best * 1.06
    assert is_certified(gantry.scene, result.waypoints)


def test_the_ends_stay_exact(gantry):
    result = shorten(gantry_path(DETOUR), gantry.scene, checker=gantry, rng=2, smooth=2)
    assert np.array_equal(result.waypoints[0], DETOUR[0])
    assert np.array_equal(result.waypoints[-1], DETOUR[-1])


def test_a_free_straight_line_is_found_at_once(gantry):
    result = shorten(
        gantry_path([[-1, 1], [-0.5, 1.6], [0.3, 0.9], [1, 1]]), gantry.scene, checker=gantry, rng=0, iterations=0
    )
    assert result.waypoints.tolist() == [[-1, 1], [1, 1]]


@pytest.mark.parametrize("points", [[[1, 1]], [[1, 1], [1, 1]], [[1, 1], [1, 1.5]], [[1, 1], [1, 1], [1, 1.5]]])
def test_paths_of_few_points_come_back_without_repeats(gantry, points):
    result = shorten(gantry_path(points), gantry.scene, checker=gantry, rng=0, smooth=1)
    assert result.waypoints.tolist() == [p for i, p in enumerate(points) if i == 0 or p != points[i - 1]]


def test_the_same_seed_gives_the_same_bytes(gantry):
    a, b = (shorten(gantry_path(DETOUR), gantry.scene, checker=gantry, rng=7, smooth=1) for _ in range(2))
    assert a.waypoints.tobytes() == b.waypoints.tobytes()


def test_smoothing_turns_less_at_each_corner(gantry, is_certified):
    plain, smooth = (shorten(gantry_path(DETOUR), gantry.scene, checker=gantry, rng=3, smooth=n) for n in (0, 3))

    def sharpest(path):
        steps = np.diff(path.waypoints, axis=0)
        steps = steps / np.linalg.norm(steps, axis=1)[:, None]
        return np.arccos(np.clip((steps[1:] * steps[:-1]).sum(axis=1), -1, 1)).max()

    assert sharpest(smooth) < 0.7 * sharpest(plain)
    assert smooth.length <= plain.length
    assert is_certified(gantry.scene, smooth.waypoints)


def test_out_of_time_the_path_comes_back_free(gantry):
    result = shorten(gantry_path(DETOUR), gantry.scene, checker=gantry, rng=0, seconds=1e-9)
    assert result.allclose(gantry_path(DETOUR))


def test_no_micro_edges_are_left(gantry):
    result = shorten(gantry_path(DETOUR), gantry.scene, checker=gantry, rng=5, iterations=2000)
    assert np.linalg.norm(np.diff(result.waypoints, axis=0), axis=1).min() > 1e-4


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 2**32), st.integers(2, 12))
def test_a_random_free_path_never_gets_longer_and_stays_free(seed, count):
    checker = CollisionChecker(gantry_scene())
    rng = np.random.default_rng(seed)
    points = [np.array([-1.0, 0.0])]
    while len(points) < count:
        point = rng.uniform(-1.5, 1.5, 2)
        if checker.edge_is_free(points[-1], point):
            points.append(point)
    path = gantry_path(points)
    result = shorten(path, checker.scene, checker=checker, rng=seed, iterations=60, smooth=1)
    assert result.length <= path.length + 1e-12
    assert all(checker.is_free(q) for q in result.sample(0.01))


def test_another_set_of_joints_is_refused(gantry):
    with pytest.raises(InputError, match="g/x"):
        shorten(Path(("a", "b"), np.zeros((2, 2))), gantry.scene, checker=gantry)


def test_a_checker_of_another_scene_is_refused(gantry):
    path = gantry_path(DETOUR)
    with pytest.raises(InputError, match=r"'scene', .* padding is 10 mm, was 0 mm; make one with CollisionChecker"):
        shorten(path, gantry.scene.with_padding(0.01), checker=gantry)
    moved = CollisionChecker(gantry.scene)
    moved.move_obstacle("block", [0.0, 0.1, 0.0])
    with pytest.raises(InputError, match=r"another scene.*obstacle 'block' moved by 100 mm"):
        shorten(path, gantry.scene, checker=moved)
    # Equal content is enough, and the configuration of a moving arm does not matter.
    same = gantry_scene().with_configuration("g", [1.0, 1.0])
    assert shorten(path, same, checker=gantry, rng=1).waypoints.tobytes() == (
        shorten(path, gantry.scene, checker=gantry, rng=1).waypoints.tobytes()
    )


@pytest.mark.parametrize("wrong", [{"iterations": -1}, {"smooth": -1}, {"seconds": 0.0}, {"seconds": float("nan")}])
def test_a_senseless_budget_is_refused(gantry, wrong):
    with pytest.raises(InputError):
        shorten(gantry_path(DETOUR), gantry.scene, checker=gantry, **wrong)


def test_more_shortcuts_make_a_path_shorter(gantry):
    lengths = [
        np.median(
            [
                shorten(gantry_path(DETOUR), gantry.scene, checker=gantry, rng=seed, iterations=n).length
                for seed in range(15)
            ]
        )
        for n in (0, 6, 60)
    ]
    assert lengths[0] > lengths[1] > lengths[2]
