"""Bodies put into groups: what is said of a group holds for all of its bodies, all along an edge."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from rr1plan._kernels.cover import RECORD, SPHERE, tables_of
from rr1plan._kernels.jit import FLOATS1, OUT1
from rr1plan._kernels.lanes import WIDTH, fill, load
from rr1plan._kernels.placing import bound_motion, place_ball, place_frames, place_spheres, take_edge
from rr1plan.collision.swept import SweptEdges

from rr1plan.collision import CollisionChecker
from rr1plan.collision.groups import ball_around, families_of, group_rows
from rr1plan.library import load_scene
from rr1plan.scene import Scene
from rr1plan.shapes import Box
from rr1plan.transforms import pose


@numba.njit(numba.void(FLOATS1, FLOATS1, OUT1, numba.float64, RECORD))
def place(begin, end, times, half, record):
    """Place all spheres at some times of an edge, with their travel in so much time to both sides."""
    cover, work, _, _ = tables_of(record)
    h = fill(half)
    take_edge(begin, end, work)
    bound_motion(cover, work)
    place_frames(load(times, 0), cover, work)
    for g in range(cover.groups.shape[0]):
        place_ball(g, cover.groups[g, 1], h, cover, work)
        for b in range(cover.groups[g, 2], cover.groups[g, 3]):
            place_ball(g, cover.bodies[b, 1], h, cover, work)
            place_spheres(b, h, cover, work)


def holding(six):
    scene = Scene().with_arm("a", six).with_obstacle("tray", Box((0.2, 0.3, 0.02)), [9, 9, 9])
    return scene.attach("tray", "a", touch=["l5"], pose=pose([0, 0, 0.12]))


@pytest.fixture(params=["rr1_cluttered", "rr1_pair", "odd", "holding"])
def swept(request, odd, six):
    if request.param == "odd":
        scene = Scene().with_arm("a", odd)
    else:
        scene = holding(six) if request.param == "holding" else load_scene(request.param)
    checker = CollisionChecker(scene)
    return checker, SweptEdges(checker, 1e-6)


def test_no_sphere_moves_farther_than_its_travel(swept):
    checker, edges = swept
    work = edges.tables[1]
    rng = np.random.default_rng(4)
    spans = np.linspace(0.0, 1.0, WIDTH)
    for size in np.geomspace(0.001, 1.0, 30):
        q0 = rng.uniform(-2.0, 2.0, checker.nq)
        q1 = q0 + rng.normal(size=checker.nq) * size
        middle = np.full(WIDTH, 0.5)
        place(q0, q1, middle, 0.5, edges.record)
        rest = work.centres.reshape(-1, SPHERE // WIDTH, WIDTH).copy()
        place(q0, q1, spans, 0.5, edges.record)
        moved = work.centres.reshape(-1, SPHERE // WIDTH, WIDTH)
        apart = np.linalg.norm(moved[:, :3] - rest[:, :3], axis=1)
        assert (apart <= rest[:, 3] + 1e-12).all()
        if size < 0.01:
            # A bound that says nothing would pass as well.
            assert rest[:, 3].max() < 1.5 * apart.max()


def test_a_groups_ball_contains_all_spheres_or_all_balls_of_its_bodies(swept):
    _, edges = swept
    cover = edges.tables[0]
    covered = []
    for joint, ball, first, last, _, _ in cover.groups.tolist():
        assert (cover.bodies[first:last, 0] == joint).all()
        covered += range(first, last)
        rows = cover.spheres[cover.bodies[first, 1] : cover.bodies[last - 1, 2]]
        whole = np.isin(np.arange(cover.bodies[first, 1], cover.bodies[last - 1, 2]), cover.bodies[first:last, 1])
        reach = np.linalg.norm(rows[:, :3] - cover.spheres[ball, :3], axis=1) + rows[:, 3]
        assert min(reach[whole].max(), reach[~whole].max()) <= cover.spheres[ball, 3] + 1e-12
    assert covered == list(range(len(cover.bodies)))


def test_families_hold_each_meeting_once(swept):
    _, edges = swept
    cover = edges.tables[0]
    begin = 0
    for one, other, shared, first, last, _ in cover.families.tolist():
        assert first == begin < last
        begin = last
        rows = cover.meetings[first:last]
        assert (cover.bodies[rows[:, 0], 3] == one).all()
        assert (cover.bodies[rows[:, 1], 3] == other).all()
        assert (rows[:, 2] == shared).all()
    assert begin == len(cover.meetings)


def test_without_bodies_there_are_no_groups():
    groups, chain, reach = group_rows([], [], [])
    assert (groups.shape, len(chain), len(reach)) == ((0, 6), 0, 0)


def test_without_meetings_there_are_no_families():
    rows, families = families_of(np.zeros((0, 4), np.int64), np.zeros(3, np.int64))
    assert rows.shape == (0, 4)
    assert families.shape == (0, 5)


def test_a_ball_around_several_is_not_much_larger_than_it_has_to_be():
    spheres = np.array([[0.0, 0, 0, 0.1], [1.0, 0, 0, 0.1], [0.5, 0, 0, 0.2]])
    balls = np.array([[0.0, 0, 0, 0.3], [1.0, 0, 0, 0.3]])
    ball = ball_around(spheres, balls)
    assert 0.6 <= ball[3] < 0.62
