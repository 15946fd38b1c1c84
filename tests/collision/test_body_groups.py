"""Groups of bodies: bounds of a group hold for all of its bodies along the whole edge."""

from __future__ import annotations

import numpy as np
import pytest

from rr1plan.collision import CollisionChecker
from rr1plan.collision.edge_kernel import EdgeKernel
from rr1plan.collision.tables.edge_tables import build_edge_tables
from rr1plan.collision.tables.link_spheres import group_rows
from rr1plan.kernels.planner_kernels import constants, load_library, zeroed
from rr1plan.scene import Scene
from rr1plan.scene.model_library import load_scene
from rr1plan.shapes import Box
from rr1plan.transforms import pose

LANES = constants()["LANES"]


def place(kernel, count, q0, q1, times):
    """Centers of all spheres at some times of an edge, (n, 3, LANES), and their travel in half of it, (n, LANES)."""
    spheres = zeroed("SphereProbe", count)
    curve = np.array([q0, q1 - q0, 0.0 * q0])
    load_library().rr1_place_spheres(*kernel.context, curve, times, np.full(LANES, 0.5), spheres)
    rows = spheres.view(np.float64).reshape(count, -1, LANES)
    return rows[:, :3], rows[:, 3]


def holding(six):
    scene = Scene().with_arm("a", six).with_obstacle("tray", Box((0.2, 0.3, 0.02)), [9, 9, 9])
    return scene.attach("tray", "a", touch=["l5"], pose=pose([0, 0, 0.12]))


@pytest.fixture(params=["rr1_cluttered", "rr1_pair", "odd", "holding"])
def built(request, odd, six):
    if request.param == "odd":
        scene = Scene().with_arm("a", odd)
    else:
        scene = holding(six) if request.param == "holding" else load_scene(request.param)
    checker = CollisionChecker(scene)
    return checker, build_edge_tables(checker.geometry, checker.fixed, checker.solid_padding, 1e-6)


def test_no_sphere_moves_farther_than_its_travel(built):
    checker, tables = built
    kernel, count = EdgeKernel(tables, checker.exact_kernel, checker.nq), len(tables.arm.spheres)
    rng = np.random.default_rng(4)
    spans = np.linspace(0.0, 1.0, LANES)
    for size in np.geomspace(0.001, 1.0, 30):
        q0 = rng.uniform(-2.0, 2.0, checker.nq)
        q1 = q0 + rng.normal(size=checker.nq) * size
        centers, travel = place(kernel, count, q0, q1, np.full(LANES, 0.5))
        moved, _ = place(kernel, count, q0, q1, spans)
        apart = np.linalg.norm(moved - centers, axis=1)
        assert (apart <= travel + 1e-12).all()
        if size < 0.01:
            # Otherwise a vacuous bound would pass.
            assert travel.max() < 1.5 * apart.max()


def test_a_groups_box_contains_the_cores_of_its_bodies(built):
    _, tables = built
    for (_, ball, first, last, _, _), box in zip(tables.arm.groups.tolist(), tables.arm.group_boxes, strict=True):
        ends = []
        for body in range(first, last):
            begin, end, kind = tables.cores.rows[body, 1:4].tolist()
            points, radius = tables.cores.points[begin:end], tables.cores.values[body, 3]
            if kind == constants()["CORE_CYLINDER"]:
                center, axis, (half, radius, _) = points
                size = half * np.abs(axis) + radius * np.sqrt(np.maximum(0.0, 1.0 - axis**2))
                points, radius = np.array([center - size, center + size]), 0.0
            ends += [points.min(axis=0) - radius, points.max(axis=0) + radius]
        low, high = np.split(box + np.tile(tables.arm.spheres[ball, :3], 2), 2)
        assert (low <= np.min(ends, axis=0)).all()
        assert (high >= np.max(ends, axis=0)).all()
        # Otherwise a box that contains everything would pass.
        assert (high - low < 1.5 * np.ptp(ends, axis=0) + 1e-9).all()


def test_a_groups_ball_contains_all_spheres_or_all_balls_of_its_bodies(built):
    _, tables = built
    covered = []
    for joint, ball, first, last, _, _ in tables.arm.groups.tolist():
        assert (tables.arm.bodies[first:last, 0] == joint).all()
        covered += range(first, last)
        rows = tables.arm.spheres[tables.arm.bodies[first, 1] : tables.arm.bodies[last - 1, 2]]
        whole = np.isin(
            np.arange(tables.arm.bodies[first, 1], tables.arm.bodies[last - 1, 2]), tables.arm.bodies[first:last, 1]
        )
        reach = np.linalg.norm(rows[:, :3] - tables.arm.spheres[ball, :3], axis=1) + rows[:, 3]
        assert min(reach[whole].max(), reach[~whole].max()) <= tables.arm.spheres[ball, 3] + 1e-12
    assert covered == list(range(len(tables.arm.bodies)))


def test_families_hold_each_meeting_once(built):
    _, tables = built
    begin = 0
    for one, other, shared, first, last, _ in tables.pairs.group_pairs.tolist():
        assert first == begin < last
        begin = last
        rows = tables.pairs.body_pairs[first:last]
        assert (tables.arm.bodies[rows[:, 0], 3] == one).all()
        assert (tables.arm.bodies[rows[:, 1], 3] == other).all()
        assert (rows[:, 2] == shared).all()
    assert begin == len(tables.pairs.body_pairs)


def test_without_bodies_there_are_no_groups():
    groups, chain, reach = group_rows([], [], [])
    assert (groups.shape, len(chain), len(reach)) == ((0, 6), 0, 0)
