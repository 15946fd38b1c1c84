"""Certified edges and parabolas against the exact kernel alone and against Coal."""

from __future__ import annotations

import numpy as np
import pytest

from rr1plan.collision import CollisionChecker
from rr1plan.collision.edge_kernel import CONTACT, EdgeKernel
from rr1plan.collision.tables.edge_tables import build_edge_tables, edge_scratch
from rr1plan.collision.tables.exact_tables import exact_scratch
from rr1plan.errors import InputError
from rr1plan.scene import Scene
from rr1plan.scene.model_library import load_robot, load_scene
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, PointCloud, Sphere
from rr1plan.transforms import pose


def strange(odd):
    cloud = PointCloud(np.random.default_rng(0).uniform(0.3, 0.6, (60, 3)), 0.03)
    scene = Scene().with_arm("a", odd).with_obstacle("ground", HalfSpace((0, 0, 1), -0.01))
    scene = scene.with_obstacle("cloud", cloud).with_obstacle("can", Cylinder(0.05, 0.2), [-0.4, 0.2, 0.7])
    return scene.with_obstacle("stick", Capsule(0.02, 0.3), [-0.4, -0.3, 0.6])


def holding(six):
    scene = Scene().with_arm("a", six).with_obstacle("post", Box((0.1, 0.1, 1.0)), [0.5, 0.3, 0.5])
    held = scene.with_obstacle("tray", Box((0.2, 0.3, 0.02)), [9, 9, 9])
    return held.attach("tray", "a", touch=["l5"], pose=pose([0, 0, 0.12]))


@pytest.fixture(scope="module")
def worlds(cluttered, odd, six, planar):
    return {
        "cluttered": (cluttered, 2.5),
        "padded": (cluttered.with_padding(0.03).with_padding(0.08, "arm", "ball"), 2.5),
        "strange": (strange(odd), 1.0),
        "strange, padded": (strange(odd).with_padding(0.02), 1.0),
        "holding": (holding(six), 2.0),
        "two arms": (Scene().with_arm("l", six).with_arm("r", six, [0.7, 0, 0]), 1.5),
        "rr1": (load_scene("rr1_cluttered"), 1.5),
        "rr1 pair": (load_scene("rr1_pair"), 1.0),
        "planar": (Scene().with_arm("p", planar).with_obstacle("b", Sphere(0.1), [0.6, 0.4, 0]), 3.0),
    }


WORLDS = ("cluttered", "padded", "strange", "strange, padded", "holding", "two arms", "rr1", "rr1 pair", "planar")


def edges(nq, wide, count, seed):
    rng = np.random.default_rng(seed)
    starts = rng.uniform(-wide, wide, (count, nq))
    return zip(starts, starts + rng.normal(size=(count, nq)) * rng.uniform(0.02, 0.6, (count, 1)), strict=True)


@pytest.mark.parametrize("name", WORLDS)
def test_spheres_first_gives_the_exact_answer(worlds, name):
    scene, wide = worlds[name]
    exact, motion = CollisionChecker(scene), CollisionChecker(scene)
    free = 0
    for q0, q1 in edges(exact.nq, wide, 600, 11):
        answer = exact.edge_is_free_slowly(q0, q1)
        free += answer
        assert motion.edge_is_free(q0, q1) == answer
    assert 20 < free < 580
    assert motion.counters.edges == 600
    assert motion.counters.exact_edges < 500


def parabolas(nq, wide, count, seed):
    """Curves of degree 2, some that go out and back, some of which only one joint is bent."""
    rng = np.random.default_rng(seed)
    for q0, q1 in edges(nq, wide, count, seed):
        duration = 10.0 ** rng.uniform(-3.0, 2.0)
        bend = rng.normal(size=nq) * rng.uniform(0.0, 1.0) - rng.choice([0.0, 1.0]) * (q1 - q0)
        if rng.uniform() < 0.3:
            bend[np.arange(nq) != rng.integers(nq)] = 0.0
        yield np.array([q0, (q1 - q0) / duration, bend / duration**2]), duration


@pytest.mark.parametrize("name", WORLDS)
def test_parabolas_get_the_exact_answer(worlds, name):
    scene, wide = worlds[name]
    motion, exact = CollisionChecker(scene), CollisionChecker(scene)
    free = 0
    for curve, duration in parabolas(motion.nq, wide, 300, 16):
        answer = exact.first_contact_on(curve, duration) is None
        free += answer
        assert motion.polynomial_is_free(curve, duration) == answer
    assert 10 < free < 290
    assert motion.counters.exact_edges < 250


def test_curves_without_a_bend_and_without_a_way_are_parabolas_too(worlds):
    motion = CollisionChecker(worlds["cluttered"][0])
    for q0, q1 in edges(motion.nq, 2.5, 100, 17):
        assert motion.polynomial_is_free([q0, (q1 - q0) / 3.0], 3.0) == motion.edge_is_free(q0, q1)
        assert motion.polynomial_is_free([q0], 3.0) == motion.is_free(q0)
        assert motion.polynomial_is_free([q0, q1, q1], 0.0) == motion.is_free(q0)


def test_a_parabola_that_comes_back_to_its_begin_is_refused_for_a_contact_half_way(planar):
    scene = Scene().with_arm("p", planar).with_obstacle("b", Sphere(0.1), [0.6, 0.4, 0])
    motion = CollisionChecker(scene)
    angle = np.arctan2(0.4, 0.6)
    for swing, free in ((angle - 0.4, True), (angle, False)):
        assert motion.polynomial_is_free([[0, 0], [4 * swing, 0], [-4 * swing, 0]], 1.0) is free


def test_a_parabola_that_folds_neighbors_together_and_comes_back_is_refused():
    """Begin and end have one place on the map of the two links, and there they are apart."""
    checker = CollisionChecker(Scene().with_arm("a", load_robot("rr1")))
    motion, rng, refused = checker, np.random.default_rng(18), 0
    for q in rng.uniform(checker.limits.lower, checker.limits.upper, (400, checker.nq)):
        begin = q.copy()
        begin[2:4] *= 0.3
        if [(c.a, c.b) for c in checker.contacts(q)] == [("a/upper_arm_link", "a/forearm_link")] and checker.is_free(
            begin
        ):
            refused += 1
            assert not motion.polynomial_is_free([begin, 4 * (q - begin), -4 * (q - begin)], 1.0)
    assert refused > 5


@pytest.mark.parametrize("name", WORLDS)
def test_an_edge_of_length_zero_is_coals_answer(worlds, name):
    scene, wide = worlds[name]
    checker = CollisionChecker(scene)
    motion = checker
    for q in np.random.default_rng(12).uniform(-wide, wide, (300, checker.nq)):
        assert motion.edge_is_free(q, q) == checker.is_free(q)


@pytest.mark.parametrize("name", ["cluttered", "padded", "strange", "rr1"])
def test_where_it_finds_a_contact_coal_does_too(worlds, name):
    scene, wide = worlds[name]
    checker = CollisionChecker(scene)
    tables = build_edge_tables(checker.geometry, checker.fixed, checker.solid_padding, 1e-6)
    kernel = EdgeKernel(tables, checker.exact_kernel, checker.nq)
    found = 0
    for q0, q1 in edges(checker.nq, wide, 300, 13):
        status, where, pair = kernel.certify_edge(q0, q1)
        if status == CONTACT:
            found += 1
            gap = checker.solid_distances(q0 + where * (q1 - q0), [pair])[0] - checker.solid_padding[pair]
            assert gap < 1e-6
    assert found > 20


def test_both_directions_of_an_edge_have_one_answer_by_spheres(worlds):
    checker = CollisionChecker(worlds["cluttered"][0])
    motion = checker
    for q0, q1 in edges(checker.nq, 2.5, 200, 14):
        assert motion.edge_is_free(q0, q1) == motion.edge_is_free(q1, q0)


def above_a_plate(planar, gap):
    """A planar arm whose lowest surface stays at one distance from a plate [m]."""
    lowest = CollisionChecker(Scene().with_arm("p", planar).with_obstacle("plate", Box((6, 6, 0.1)), [0, 0, -1.0]))
    clearance = lowest.clearance([0.3, 0.4])
    return Scene().with_arm("p", planar).with_obstacle("plate", Box((6, 6, 0.1)), [0, 0, -1.0 + clearance - gap])


@pytest.mark.parametrize(("gap", "free"), [(-1e-7, False), (3e-7, False), (9e-7, False), (1.1e-6, True), (3e-6, True)])
def test_gaps_of_micrometers_are_decided_without_millions_of_configurations(planar, gap, free):
    checker = CollisionChecker(above_a_plate(planar, gap))
    for q0, q1 in edges(2, 2.0, 20, 14):
        assert checker.edge_is_free(q0, q1) == free
    assert checker.counters.configurations < 100_000


def test_a_gap_just_above_the_least_one_is_refused_rather_than_searched_for_long(planar):
    checker = CollisionChecker(above_a_plate(planar, 1.002e-6))
    assert not checker.edge_is_free([-2.0, -1.0], [2.0, 1.5])
    assert checker.counters.configurations < 100_000


def test_turns_without_end_and_joints_beyond_their_limits_are_swept(odd):
    scene = Scene().with_arm("a", odd).with_obstacle("wall", Box((0.01, 0.5, 0.5)), [-0.4, 0, 0.55])
    checker = CollisionChecker(scene)
    motion = checker
    q = np.array([0, 0.5, 0.0])
    assert not motion.edge_is_free(q, q + np.array([0, 2 * np.pi, 0]))
    for far in (3.0, 30.0, 1e4):
        for q0, q1 in edges(3, far, 40, 15):
            assert motion.edge_is_free(q0, q1) == motion.edge_is_free_slowly(q0, q1)


def test_static_contacts_block_every_edge_of_the_sweep(planar):
    scene = Scene().with_arm("l", planar).with_arm("r", planar, [3.0, 0, 0])
    checker = CollisionChecker(scene.with_obstacle("b", Sphere(0.1), [3.4, 0, 0]), ["l"])
    assert not checker.edge_is_free([0, 0], [0.1, 0])


def test_without_anything_to_touch_the_sweep_is_free(planar):
    motion = CollisionChecker(Scene().with_arm("p", planar))
    assert motion.edge_is_free([0, 0], [100.0, -50.0])
    assert motion.counters.exact_edges == 0


def test_the_sweep_refuses_what_is_no_configuration(planar):
    motion = CollisionChecker(Scene().with_arm("p", planar))
    with pytest.raises(InputError):
        motion.edge_is_free([0, np.nan], [1, 1])


def test_lanes_in_memory_do_not_cross_lines_of_the_cache():
    checker = CollisionChecker(load_scene("rr1_cluttered"))
    scratch = edge_scratch(
        build_edge_tables(checker.geometry, checker.fixed, checker.solid_padding, 1e-6),
        exact_scratch(checker.tables, checker.nq),
        checker.nq,
    )
    for field in ("frames", "spheres", "group_boxes"):
        assert getattr(scratch.value, field) % 64 == 0
