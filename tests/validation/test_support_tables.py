"""Support functions by tables of directions equal those over all corners."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import rr1plan as rp
from rr1plan.validation.hull_support import hull_core
from rr1plan.validation.referee_kernels import TABLE, RefereeStruct, load_library
from rr1plan.validation.referee_shapes import point_body

KINDS = {
    "ball": lambda rng: rng.normal(size=(400, 3)),
    "flat box": lambda rng: rng.uniform(-1.0, 1.0, (300, 3)) * [1.0, 0.3, 1e-3],
    "grid": lambda rng: np.stack(np.meshgrid(*[np.linspace(-0.5, 0.5, 5)] * 3), axis=-1).reshape(-1, 3),
    "needle": lambda rng: rng.normal(size=(80, 3)) * [1e-4, 1.0, 1e-4],
    "far away": lambda rng: rng.normal(size=(120, 3)) * 0.05 + [40.0, -3.0, 7.0],
    "twice the same": lambda rng: np.repeat(rng.normal(size=(40, 3)), 2, axis=0),
    "no hull at all": lambda rng: rng.uniform(-1.0, 1.0, (64, 3)),
    "one point": lambda rng: np.zeros((50, 3)) + 0.1,
}


def directions(rng: np.random.Generator) -> np.ndarray:
    """Random ones, and those on the borders and at the corners of cells, where rounding decides the cell."""
    steps = np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
    exact = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3)
    exact = exact[np.abs(exact).max(axis=1) > 0.0]
    near = exact * (1.0 + rng.normal(size=exact.shape) * 1e-15)
    third = exact / 3.0
    return np.concatenate([rng.normal(size=(500, 3)), exact, near, third, rng.normal(size=(50, 3)) * 1e-12])


@pytest.mark.parametrize("kind", KINDS)
def test_a_table_reaches_as_far_as_all_corners(kind: str) -> None:
    rng = np.random.default_rng(3)
    points = KINDS[kind](rng)
    core = hull_core(points)
    assert core.kind == TABLE
    kinds, sizes = np.zeros((1, 7), np.int64), np.zeros((1, 23))
    kinds[0, 0] = core.kind
    columns = core.corners.shape[1]
    bodies = RefereeStruct(
        "RefereeBodies", bodies=kinds, sizes=sizes, corners=core.corners, body_count=1, corner_count=columns
    )
    reach = load_library().rr1_probe_reach
    R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    for turn in (np.eye(3), R):
        placed = np.zeros((1, 15))
        placed[0, :9] = turn.ravel()
        for d in directions(rng):
            found = reach(bodies, placed, 0, d)
            wanted = float((points @ (turn.T @ d)).max())
            assert found == pytest.approx(wanted, rel=1e-14, abs=1e-13 * np.abs(points).max() * np.abs(d).max())


def test_a_table_lists_few_of_many_corners() -> None:
    points = np.random.default_rng(0).normal(size=(1000, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    corners = hull_core(points).corners
    assert corners.shape[1] < 0.06 * 96 * len(points)


def test_motions_of_a_hull_of_many_corners_are_judged_as_those_of_few() -> None:
    """A ball of 600 corners: the compiled search with a table, against the same corners as all of them say."""
    rng = np.random.default_rng(1)
    points = rng.normal(size=(600, 3))
    points *= 0.1 / np.linalg.norm(points, axis=1)[:, None]
    hull = rp.Mesh(points, ConvexHull(points).simplices, convex=True)
    assert point_body(hull).core.kind == TABLE
    wall = rp.Box((0.1, 0.1, 0.1))
    kinematics = rp.load_robot("planar2r")
    scene = rp.Scene().with_arm("arm", kinematics).with_obstacle("wall", wall, [0.0, 0.0, 1.0])
    tip = scene.link_poses()[f"arm/{kinematics.tool}"]
    held = scene.with_obstacle("ball", hull, tip).attach("ball").allow("ball", "arm")
    gap = 0.01
    reach_x = float((points @ np.array([0.0, 0.0, 1.0])).max())
    held = held.without_obstacle("wall").with_obstacle("wall", wall, tip[:3, 3] + [0.0, 0.0, reach_x + gap + 0.05])
    report = rp.validate(rp.Trajectory.rest(held.joint_names(), held.configuration()), held)
    assert report.margins["clearance"].value == pytest.approx(gap, abs=1e-7)
