from __future__ import annotations

import pickle
import warnings
from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rr1plan.collision import CollisionChecker
from rr1plan.collision.tables.exact_tables import exact_scratch, exact_struct
from rr1plan.errors import InputError
from rr1plan.kernels.planner_kernels import load_library
from rr1plan.path import Path
from rr1plan.pipeline import plan_motion
from rr1plan.scene import Scene
from rr1plan.scene.model_library import load_scene
from rr1plan.scene.problem import Problem
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, PointCloud, Sphere
from rr1plan.transforms import pose


def odd_scene(odd):
    cloud = PointCloud(np.random.default_rng(0).uniform(0.3, 0.6, (120, 3)), 0.03)
    scene = (
        Scene().with_arm("a", odd).with_obstacle("ground", HalfSpace((0, 0, 1), -0.01)).with_obstacle("cloud", cloud)
    )
    scene = scene.with_obstacle("can", Cylinder(0.05, 0.2), [-0.4, 0.2, 0.7])
    return scene.with_obstacle("stick", Capsule(0.02, 0.3), [-0.4, -0.3, 0.6])


def held_scene(six):
    scene = Scene().with_arm("a", six).with_obstacle("post", Box((0.1, 0.1, 1.0)), [0.5, 0.3, 0.5])
    held = scene.with_obstacle("tray", Box((0.2, 0.3, 0.02)), [9, 9, 9])
    return held.attach("tray", "a", touch=["l5"], pose=pose([0, 0, 0.12]))


def two_arms(six):
    scene = Scene().with_arm("l", six).with_arm("r", six, [0.7, 0, 0])
    return scene.with_obstacle("ground", HalfSpace((0, 0, 1), -0.01))


@pytest.fixture(scope="module")
def scenes(cluttered, odd, six, planar):
    return {
        "cluttered": (cluttered, 2.5),
        "padded": (cluttered.with_padding(0.03).with_padding(0.08, "arm", "ball"), 2.5),
        "odd": (odd_scene(odd), 1.0),
        "odd padded": (odd_scene(odd).with_padding(0.02), 1.0),
        "held": (held_scene(six), 2.0),
        "two arms": (two_arms(six), 1.5),
        "rr1": (load_scene("rr1_cluttered"), 1.5),
        "rr1 pair": (load_scene("rr1_pair"), 1.0),
        "planar": (Scene().with_arm("p", planar).with_obstacle("b", Sphere(0.1), [0.6, 0.4, 0]), 3.0),
    }


SCENES = ("cluttered", "padded", "odd", "odd padded", "held", "two arms", "rr1", "rr1 pair", "planar")


def random_edges(checker, wide, count, seed, long=0.5):
    rng = np.random.default_rng(seed)
    edges = []
    while len(edges) < count:
        q = rng.uniform(-wide, wide, checker.nq)
        if checker.is_free(q):
            edges.append((q, q + rng.normal(size=checker.nq) * long))
    return edges


@lru_cache(maxsize=1)
def paddings(checker):
    return np.array([checker.scene.padding_of(a, b) for a, b in checker.pairs])


def clearance(checker, q):
    """Least distance minus padding [m]."""
    return float((checker.distances(q) - paddings(checker)).min(initial=np.inf))


@pytest.mark.parametrize("name", SCENES)
def test_an_edge_is_free_exactly_when_coal_finds_every_sample_free(scenes, name):
    scene, wide = scenes[name]
    motion = CollisionChecker(scene)
    free = np.zeros(2, int)
    for q0, q1 in random_edges(motion, wide, 120, 1):
        sampled = all(motion.is_free_slowly(q0 + u * (q1 - q0)) for u in np.linspace(0, 1, 120))
        answers = motion.edge_is_free(q0, q1), motion.edge_is_free_slowly(q0, q1)
        free += answers
        if not sampled:
            assert not any(answers)
        elif not all(answers):
            contact = motion.first_contact(q0, q1)
            assert clearance(motion, contact.q) < 1e-5
    assert (free > 20).all()
    assert (free < 119).all()


class CoalCertificate:
    """The same theorem, slow: Coal's distances, plain kinematics, one crude bound for all pairs."""

    def __init__(self, scene):
        self.checker = CollisionChecker(scene)
        self.scene = scene

    def travel(self, q0, q1):
        """No point of the arms gets farther than this on the edge: every joint swings everything it carries."""
        total, column = 0.0, 0
        for arm in self.scene.arms.values():
            robot = arm.robot
            spans = [np.linalg.norm(j.origin[:3, 3]) + 1.0 * (j.kind == "prismatic") for j in robot.joints]
            reach = sum(spans) + 0.5
            moved = np.abs(q1 - q0)[column : column + robot.nq]
            weights = np.array([1.0 if robot.joint(n).kind == "prismatic" else reach for n in robot.joint_names])
            followers = [j.mimic for j in robot.joints if j.mimic is not None and j.mimic.joint in robot.joint_names]
            more = sum(abs(m.multiplier) * reach * moved[robot.joint_names.index(m.joint)] for m in followers)
            total += float(weights @ moved) + more
            column += robot.nq
        return 2.0 * total

    def edge_is_free(self, q0, q1):
        gap = clearance(self.checker, 0.5 * (q0 + q1))
        moved = 0.5 * self.travel(q0, q1)
        if gap > moved:
            return True
        if gap <= 0 or moved < 1e-5:
            return False
        middle = 0.5 * (q0 + q1)
        return self.edge_is_free(q0, middle) and self.edge_is_free(middle, q1)


@pytest.mark.parametrize("name", ["cluttered", "padded", "odd", "two arms"])
def test_the_fast_certificate_agrees_with_a_slow_one_by_coal_alone(scenes, name):
    scene, wide = scenes[name]
    motion, slow = CollisionChecker(scene), CoalCertificate(scene)
    answers = []
    for q0, q1 in random_edges(motion, wide, 20, 2, long=0.35):
        answers.append(slow.edge_is_free(q0, q1))
        assert motion.edge_is_free(q0, q1) == motion.edge_is_free_slowly(q0, q1) == answers[-1]
    assert 0 < sum(answers) < len(answers)


@settings(deadline=None, max_examples=60)
@given(
    st.floats(0.1, 0.4) | st.floats(0.6, 0.9),
    st.floats(-3.0, 3.0),
    st.floats(0.2, 3.0),
    st.sampled_from(["plate", "needle"]),
)
def test_nothing_thin_is_ever_tunnelled(planar, distance, angle, swing, kind):
    shape = Box((0.001, 0.2, 0.2)) if kind == "plate" else Cylinder(0.0005, 0.4)
    place = pose([distance * np.cos(angle), distance * np.sin(angle), 0.0], rpy=[0, 0, angle + 1.0])
    motion = CollisionChecker(Scene().with_arm("p", planar).with_obstacle("thin", shape, place))
    q0, q1 = np.array([angle - swing, 0.0]), np.array([angle + swing, 0.0])
    assert not motion.edge_is_free(q0, q1)
    contact = motion.first_contact(q0, q1)
    assert "thin" in contact.pair
    assert contact.fraction < 0.5


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32), st.sampled_from(["odd", "six", "held"]), st.floats(1e-4, 1.5))
def test_no_point_travels_farther_than_its_bound(odd, six, seed, which, size):
    scene = {"odd": odd_scene(odd), "six": Scene().with_arm("a", six), "held": held_scene(six)}[which]
    motion = CollisionChecker(scene)
    checker, tables = motion, motion.tables
    rng = np.random.default_rng(seed)
    q0 = rng.uniform(-2, 2, checker.nq)
    reach = size * rng.uniform(0, 1, checker.nq)
    travel = np.zeros((len(tables.bodies), len(tables.joints) + 1))
    exact = exact_struct(tables, checker.nq), exact_scratch(tables, checker.nq)
    load_library().rr1_bound_travel(*exact, q0, reach, travel)
    before, points = {}, {}
    for b, solid in enumerate(checker.solids):
        first, last = tables.bodies[b, 4:6]
        if first == last:
            continue
        points[b] = surface_points(solid.shape, rng)
        before[b] = world_points(scene, q0, solid, points[b], checker)
    for _ in range(8):
        q1 = q0 + reach * rng.uniform(-1, 1, checker.nq)
        for b, solid in enumerate(checker.solids):
            if b in before:
                moved = np.linalg.norm(world_points(scene, q1, solid, points[b], checker) - before[b], axis=1)
                assert moved.max() <= travel[b, 0] + 1e-9


def surface_points(shape, rng):
    directions = rng.normal(size=(40, 3))
    match shape:
        case Box(size):
            return np.sign(directions) * np.array(size) / 2
        case Sphere(radius):
            return radius * directions / np.linalg.norm(directions, axis=1)[:, None]
        case Cylinder(radius, length):
            across = directions[:, :2] / np.linalg.norm(directions[:, :2], axis=1)[:, None]
            return np.column_stack([radius * across, np.sign(directions[:, 2]) * length / 2])
        case Capsule(radius, length):
            ends = np.outer(np.sign(directions[:, 2]), [0, 0, length / 2])
            return ends + radius * directions / np.linalg.norm(directions, axis=1)[:, None]
        case _:
            return shape.vertices


def world_points(scene, q, solid, points, checker):
    """Points of a solid in the world by the plain kinematics."""
    poses = scene.link_poses(scene.split(q))
    if solid.element in scene.attachments:
        held = scene.attachments[solid.element]
        T = poses[f"{held.arm}/{held.link}"] @ held.pose @ held.geometries[0].pose
    else:
        arm, link = solid.element.split("/")
        collisions = scene.arms[arm].robot.link(link).collisions
        T = poses[solid.element] @ next(g.pose for g in collisions if g.shape is solid.shape or len(collisions) == 1)
    return points @ T[:3, :3].T + T[:3, 3]


@settings(deadline=None, max_examples=100)
@given(st.integers(0, 2**32), st.integers(1, 7), st.floats(1e-3, 20.0), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_a_curve_stays_within_its_reach_on_an_interval(seed, terms, duration, low, high):
    rng = np.random.default_rng(seed)
    curve = rng.normal(size=(terms, 3)) / duration ** np.arange(terms)[:, None]
    a, b = sorted((low * duration, high * duration))
    q, reach = np.empty(3), np.empty(3)
    interval = 0.5 * (a + b), 0.5 * (b - a)
    load_library().rr1_place_interval(curve, terms, 3, duration, *interval, np.empty((terms, 3)), q, reach)
    times = np.linspace(a, b, 50)
    values = np.power.outer(times, np.arange(terms)) @ curve
    assert (np.abs(values - q) <= reach + 1e-13).all()
    assert (reach <= 10 * terms * np.abs(curve * duration ** np.arange(terms)[:, None]).sum(axis=0) + 1e-12).all()


@pytest.mark.parametrize("name", ["cluttered", "odd", "two arms"])
def test_a_curve_is_free_exactly_when_coal_finds_every_sample_free(scenes, name):
    scene, wide = scenes[name]
    motion = CollisionChecker(scene)
    rng = np.random.default_rng(3)
    free = 0
    for q0, _ in random_edges(motion, wide, 60, 4):
        duration = rng.uniform(0.1, 5.0)
        curve = np.vstack([q0, rng.normal(size=(4, len(q0))) * 0.3 / duration ** np.arange(1, 5)[:, None]])
        times = np.linspace(0, duration, 150)
        samples = np.power.outer(times, np.arange(5)) @ curve
        if motion.polynomial_is_free(curve, duration):
            free += 1
            assert all(motion.is_free_slowly(q) for q in samples)
        else:
            # What the samples missed is no deeper than what lies between two of them.
            assert any(clearance(motion, q) < 0.02 for q in samples)
    assert 8 < free < 59


def test_a_straight_curve_is_an_edge(scenes):
    motion = CollisionChecker(scenes["cluttered"][0])
    for q0, q1 in random_edges(motion, 2.5, 40, 5):
        duration = 3.0
        curve = [q0, (q1 - q0) / duration]
        assert motion.polynomial_is_free(curve, duration) == motion.edge_is_free(q0, q1)


def test_an_edge_of_length_zero_is_its_configuration(scenes):
    for scene, wide in scenes.values():
        motion = CollisionChecker(scene)
        rng = np.random.default_rng(6)
        for q in rng.uniform(-wide, wide, (40, motion.nq)):
            assert motion.edge_is_free(q, q) == motion.is_free(q)


def test_both_directions_of_an_edge_have_one_answer(scenes):
    motion = CollisionChecker(scenes["cluttered"][0])
    for q0, q1 in random_edges(motion, 2.5, 60, 7):
        assert motion.edge_is_free(q0, q1) == motion.edge_is_free(q1, q0)


@pytest.mark.parametrize("name", SCENES)
def test_many_configurations_and_edges_have_the_answers_of_each(scenes, name):
    scene, _ = scenes[name]
    checker, rng = CollisionChecker(scene), np.random.default_rng(0)
    q = rng.uniform(checker.limits.lower, checker.limits.upper, (200, checker.nq))
    free = checker.are_free(q)
    assert free.tolist() == [checker.is_free(row) for row in q]
    assert 0 < free.sum() < 200
    ends = q + rng.normal(0.0, 0.3, q.shape)
    before = checker.edges_checked
    free = checker.edges_are_free(q, ends)
    assert checker.edges_checked == before + 200
    assert free.tolist() == [checker.edge_is_free(a, b) for a, b in zip(q, ends, strict=True)]
    assert 0 < free.sum() < 200
    assert checker.are_free(np.zeros((0, checker.nq))).shape == (0,)


def test_configurations_that_kernels_leave_open_are_decided_one_by_one(planar):
    """A gap below the tolerance proves no edge."""
    scene = Scene().with_arm("arm", planar).with_obstacle("ball", Sphere(0.1), [2.0, 0.0, 0.0])
    gap = CollisionChecker(scene).clearance([0.0, 0.0])
    checker = CollisionChecker(scene.with_obstacle_at("ball", [2.0 - gap + 5e-7, 0.0, 0.0]))
    q = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]])
    assert checker.are_free(q).tolist() == [True, True, True]
    assert checker.edges_are_free(q, q).tolist() == [False, True, False]


def test_nothing_is_free_if_elements_that_do_not_move_touch(planar):
    scene = Scene().with_arm("l", planar).with_arm("r", planar, [0.5, 0.0, 0.0])
    checker = CollisionChecker(scene.with_obstacle("ball", Sphere(0.1), [1.0, 0.0, 0.0]), ["l"])
    q = np.array([[1.5, 0.0], [-1.5, 0.0]])
    assert checker.static_contacts
    assert not checker.are_free(q).any()
    assert not checker.edges_are_free(q, -q).any()


@pytest.mark.parametrize("wrong", [[0.0, 0.0], [[0.0]], [[0.0, float("nan")]], None])
def test_many_configurations_of_another_shape_are_refused(planar, wrong):
    checker = CollisionChecker(Scene().with_arm("arm", planar))
    right = np.zeros((1, 2))
    with pytest.raises(InputError, match="q"):
        checker.are_free(wrong)
    for ends in ((wrong, right), (right, wrong), (right, np.zeros((2, 2)))):
        with pytest.raises(InputError, match="q"):
            checker.edges_are_free(*ends)


def test_without_anything_to_touch_every_edge_is_free(planar):
    assert CollisionChecker(Scene().with_arm("p", planar)).edge_is_free([0, 0], [100.0, -50.0])


def test_a_full_turn_of_a_continuous_joint_meets_what_is_on_the_way(odd):
    scene = Scene().with_arm("a", odd).with_obstacle("wall", Box((0.01, 0.5, 0.5)), [-0.4, 0, 0.55])
    motion = CollisionChecker(scene)
    q0, q1 = np.array([0, 0.5, 0.0]), np.array([0, 0.5 + 2 * np.pi, 0.0])
    assert motion.is_free(q0)
    assert motion.is_free(q1)
    assert not motion.edge_is_free(q0, q1)


def test_mimicking_links_are_swept_too(odd):
    """Only the flap, which mimics `bend`, may not touch the pin."""
    q0, q1 = np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 1.0])
    scene = Scene().with_arm("a", odd)
    tip = scene.link_poses({"a": np.zeros(3)})["a/flap"] @ [0.08, 0.0, 0.0, 1.0]
    scene = scene.with_obstacle("pin", Sphere(0.004), tip[:3])
    for link in ("base", "slide", "arm", "wrist", "left", "right"):
        scene = scene.allow(f"a/{link}", "pin")
    contact = CollisionChecker(scene).first_contact(q0, q1)
    assert set(contact.pair) == {"a/flap", "pin"}


def test_grazing_is_refused_and_clearing_by_more_than_the_tolerance_is_not(planar):
    """The arm's straight rod passes a ball; the gap is set to the micrometer."""
    for gap, free in ((1e-8, False), (1e-5, True), (-1e-5, False)):
        # Rod of radius 0.02 whose round end reaches 0.97 m from the shoulder.
        scene = Scene().with_arm("p", planar).with_obstacle("ball", Sphere(0.1), [0.97 + 0.1 + gap, 0.0, 0.0])
        assert CollisionChecker(scene).edge_is_free([-1.0, 0.0], [1.0, 0.0]) is free


def test_sliding_along_a_plane_at_a_hairs_breadth_comes_to_an_end(planar):
    for height, free in ((-0.02 - 1e-8, False), (-0.02 - 3e-5, True)):
        scene = Scene().with_arm("p", planar).with_obstacle("floor", HalfSpace((0, 0, 1), height))
        assert CollisionChecker(scene).edge_is_free([-1.0, 0.0], [1.0, 0.5]) is free


def test_the_first_contact_divides_free_from_not(scenes):
    motion = CollisionChecker(scenes["cluttered"][0])
    found = 0
    for q0, q1 in random_edges(motion, 2.5, 40, 8):
        contact = motion.first_contact(q0, q1)
        if contact is None:
            assert motion.edge_is_free(q0, q1)
            continue
        found += 1
        assert motion.edge_is_free(q0, q0 + 0.999 * (contact.q - q0))
        assert motion.is_free(contact.q)
        assert motion.edge_is_free(contact.q, contact.q)
        assert clearance(motion, contact.q) < 1e-4
        distance = dict(zip(motion.pairs, motion.distances(contact.q), strict=True))[contact.pair]
        assert distance < 1e-4
    assert found > 5


def test_the_first_contact_of_what_stands_still_is_named_whatever_touches_elsewhere(planar):
    scene = Scene().with_arm("l", planar).with_arm("r", planar, [0.0, 1.5, 0.0])
    scene = scene.with_obstacle("thin", Sphere(0.01), [0.25, 1.5, 0.0])
    # At q = 0 it is deeper in the arm that moves.
    scene = scene.with_obstacle("thick", Sphere(0.1), [0.25, 0.0, 0.0])
    motion = CollisionChecker(scene, ["l"])
    assert motion.contacts([0.0, 0.0])[0].b == "thick"
    contact = motion.first_contact([-1.5, 0.0], [-2.0, 0.0])
    assert contact.fraction == 0.0
    assert contact.pair == ("r/upper", "thin")


@pytest.mark.parametrize("name", ["cluttered", "two arms", "padded"])
def test_a_configuration_is_free_when_coal_says_so(scenes, name):
    motion, rng = CollisionChecker(scenes[name][0]), np.random.default_rng(8)
    checker = motion
    low, high = np.maximum(checker.limits.lower, -3.0), np.minimum(checker.limits.upper, 3.0)
    answers = []
    for _ in range(300):
        q = rng.uniform(low, high)
        answers.append(motion.is_free(q))
        assert answers[-1] == checker.is_free_slowly(q)
    assert 20 < sum(answers) < 280


def test_pairs_of_some_arms_can_be_left_out(scenes):
    motion, rng = CollisionChecker(scenes["two arms"][0]), np.random.default_rng(9)
    checker = motion
    owner, (one, other) = checker.scene.owner, checker.arms
    low, high = np.maximum(checker.limits.lower, -3.0), np.minimum(checker.limits.upper, 3.0)
    only_thanks_to_that = 0
    for _ in range(300):
        q = rng.uniform(low, high)
        contacts = [{owner(c.a), owner(c.b)} for c in checker.contacts(q)]
        for left_out in (frozenset({one}), frozenset({other}), frozenset({one, other})):
            expected = not [owners for owners in contacts if not owners & left_out]
            assert motion.is_free_ignoring(q, left_out) == expected
            only_thanks_to_that += expected and bool(contacts)
        assert motion.is_free_ignoring(q, frozenset()) == (not contacts)
    assert only_thanks_to_that > 20


def test_contacts_that_no_joint_can_undo_block_every_motion(planar):
    scene = (
        Scene().with_arm("l", planar).with_arm("r", planar, [3.0, 0, 0]).with_obstacle("b", Sphere(0.1), [3.4, 0, 0])
    )
    motion = CollisionChecker(scene, ["l"])
    assert not motion.edge_is_free([0, 0], [0.1, 0])
    contact = motion.first_contact([0, 0], [0.1, 0])
    assert contact.fraction == 0.0
    assert contact.pair == ("r/upper", "b")


def test_a_path_is_free_when_all_its_edges_are(planar):
    scene = Scene().with_arm("p", planar).with_obstacle("ball", Sphere(0.1), [0.0, 0.8, 0.0])
    motion = CollisionChecker(scene)
    assert motion.path_is_free([[0.0, 0.0]])
    assert motion.path_is_free([[0.0, 0.0], [0.5, 0.0], [0.5, 1.0]])
    assert not motion.path_is_free([[0.0, 0.0], [0.5, 0.0], [np.pi / 2, 0.0]])
    assert not motion.path_is_free([[np.pi / 2, 0.0]])


def test_edges_of_a_path_on_which_some_arms_stand_still(rr1):
    """The pairs of arms that stand still are checked on the first edge only, which must not change any answer."""
    scene = (
        Scene().with_arm("l", rr1).with_arm("r", rr1, [0.42, 0.0, 0.0]).with_obstacle("b", Sphere(0.1), [0.2, 0.3, 0.3])
    )
    motion, rng = CollisionChecker(scene), np.random.default_rng(5)
    low, high = np.tile(rr1.limits.lower, 2), np.tile(rr1.limits.upper, 2)
    free, first_alone = 0, 0
    for _ in range(150):
        points = [rng.uniform(low, high)]
        for _ in range(4):
            nearby, arm = points[-1].copy(), 6 * int(rng.integers(2))
            moved = slice(arm + int(rng.integers(6)), arm + 6)
            nearby[moved] = np.clip(nearby + 0.4 * rng.standard_normal(12), low, high)[moved]
            points.append(nearby)
        edges = [motion.edge_is_free_slowly(a, b) for a, b in pairwise(points)]
        assert motion.path_is_free(points) == all(edges)
        free += all(edges)
        first_alone += not edges[0] and all(edges[1:])
    assert 10 < free < 140
    assert first_alone > 0


def test_a_path_that_begins_in_contact_is_not_free(planar):
    scene = Scene().with_arm("l", planar).with_arm("m", planar, [0.3, 0, 0]).with_arm("r", planar, [5.0, 0, 0])
    motion = CollisionChecker(scene)
    q, moved = [0.0] * 6, [0.0, 0.0, 0.0, 0.0, 0.3, 0.3]
    assert not motion.path_is_free([q, moved])
    assert not motion.path_is_free([q, moved, q])


def test_it_counts_its_work(planar):
    motion = CollisionChecker(Scene().with_arm("p", planar).with_obstacle("ball", Sphere(0.1), [0.0, 0.8, 0.0]))
    motion.path_is_free([[0.0, 0.0], [0.5, 0.0], [0.5, 1.0]])
    assert motion.edges_checked == 2
    looked = motion.counters.configurations
    assert looked >= 2
    assert motion.edge_is_free_slowly([0.0, 0.0], [0.5, 0.0])
    assert motion.edges_checked == 3
    assert motion.counters.configurations > looked


def test_it_survives_pickling(scenes):
    scene, wide = scenes["two arms"]
    one, two = CollisionChecker(scene, ["l"]), CollisionChecker(scene, ["l"])
    three = pickle.loads(pickle.dumps(one))
    for q0, q1 in random_edges(one, wide, 20, 9):
        assert one.edge_is_free(q0, q1) == two.edge_is_free(q0, q1) == three.edge_is_free(q0, q1)


def test_arrays_of_any_layout_are_taken(scenes):
    motion = CollisionChecker(scenes["cluttered"][0])
    for q0, q1 in random_edges(motion, 2.5, 20, 10):
        columns = np.column_stack([q0, q1])
        assert motion.edge_is_free(columns[:, 0], columns[:, 1]) == motion.edge_is_free(q0, q1)
        assert motion.is_free(columns[:, 1]) == motion.is_free(q1)
        assert motion.edge_is_free(q0.tolist(), q1[::-1][::-1]) == motion.edge_is_free(q0, q1)


@pytest.mark.parametrize(
    ("scene", "settings", "said"),
    [
        ("a scene", {}, "scene is of type str"),
        (None, {"arms": ["a"]}, "scene is of type NoneType"),
    ],
)
def test_what_is_no_scene_is_refused_by_name(scene, settings, said):
    with pytest.raises(InputError, match=said):
        CollisionChecker(scene, **settings)


@pytest.mark.parametrize("tolerance", ["small", 0.0, np.nan])
def test_a_senseless_tolerance_is_refused(planar, tolerance):
    with pytest.raises(InputError, match="tolerance"):
        CollisionChecker(Scene().with_arm("p", planar), tolerance=tolerance)


@pytest.mark.parametrize(
    ("question", "arguments"),
    [
        ("edge_is_free_slowly", ([np.nan, 0], [0, 0])),
        ("edge_is_free", ([np.nan, 0], [0, 0])),
        ("edge_is_free", ([0, 0], [0, 0, 0])),
        ("first_contact", ([0, 0], [np.inf, 0])),
        ("path_is_free", (np.zeros((0, 2)),)),
        ("path_is_free", ([[0, 0], [np.nan, 0]],)),
        ("polynomial_is_free", (np.zeros((0, 2)), 1.0)),
        ("polynomial_is_free", ([[0, 0]], -1.0)),
        ("polynomial_is_free", ([[0, 0]], np.nan)),
        ("polynomial_is_free", ([[0, np.inf]], 1.0)),
        ("polynomial_is_free", (np.zeros((3, 2)), 1e200)),
        ("first_contact_on", (np.zeros((300, 2)), 100.0)),
    ],
)
def test_motions_that_are_none_are_refused(planar, question, arguments):
    motion = CollisionChecker(Scene().with_arm("p", planar))
    with pytest.raises(InputError):
        getattr(motion, question)(*arguments)


@pytest.mark.parametrize("size", [1.01e4, 1e14, 1e308])
def test_configurations_are_limited_as_curves_are(planar, size):
    """Distances are precise up to there; farther edges of a joint that slides were never certified."""
    checker = CollisionChecker(Scene().with_arm("p", planar))
    near, far = np.array([9e3, 9e3]), np.array([0.0, -size])
    for verb, arguments in [
        ("is_free", [far]),
        ("are_free", [[near, far]]),
        ("clearance", [far]),
        ("contacts", [far.tolist()]),
        ("edge_is_free", [near, far]),
        ("edges_are_free", [[near], [far]]),
        ("first_contact", [far, near]),
        ("path_is_free", [[near, far]]),
        ("polynomial_is_free", [[far], 1.0]),
    ]:
        with warnings.catch_warnings(action="error"), pytest.raises(InputError, match=r"expected at most 10000"):
            getattr(checker, verb)(*arguments)
    assert checker.is_free(near)
    assert checker.are_free([near, near]).all()


def test_a_path_is_checked_by_the_names_of_its_joints(planar):
    motion = CollisionChecker(Scene().with_arm("p", planar).with_obstacle("ball", Sphere(0.1), [0.0, 0.8, 0.0]))
    names, points = motion.joint_names, np.array([[0.0, 0.0], [0.5, 0.0], [0.5, 1.0], [np.pi / 2, 0.0]])
    for waypoints in (points[:3], points):
        swapped = Path(names[::-1], waypoints[:, ::-1])
        assert motion.path_is_free(Path(names, waypoints)) is motion.path_is_free(waypoints)
        assert motion.path_is_free(swapped) is motion.path_is_free(waypoints)
    with pytest.raises(InputError, match=r"path's joints are .*other, expected"):
        motion.path_is_free(Path((names[0], "arm/other"), points))


@pytest.mark.parametrize("distance", [1e5, 1e308])
def test_distances_as_large_as_floats_leave_nothing_free(planar, distance):
    scene = Scene().with_arm("arm", planar).with_obstacle("ball", Sphere(0.1), [9.0, 0.0, 0.0])
    q = np.zeros(planar.nq)
    for checker in (CollisionChecker(scene, margin=distance), CollisionChecker(scene.with_padding(distance))):
        assert not checker.is_free(q)
        assert not checker.edge_is_free(q, q + 0.1)
    assert plan_motion(Problem(scene, q, q + 0.1), margin=distance, rng=0).valid


def test_another_margin_is_that_of_a_new_checker(cluttered):
    scene = cluttered.with_padding(0.03, "arm", "ball")
    motion = CollisionChecker(scene)
    edges = np.random.default_rng(8).uniform(-2.0, 2.0, (30, 2, motion.nq))
    edges[:, 1] = edges[:, 0] + 0.2 * (edges[:, 1] - edges[:, 0])
    answers = set()
    for margin in (0.0, 0.015, 0.001, 0.008):
        motion.keep_margin(margin)
        other = CollisionChecker(scene, margin=margin)
        assert motion.margin == margin
        np.testing.assert_array_equal(motion.solid_padding, other.solid_padding)
        for q0, q1 in edges:
            assert motion.edge_is_free(q0, q1) == other.edge_is_free(q0, q1) == motion.edge_is_free_slowly(q0, q1)
            assert motion.moving_clearance(q0, 0.3) == pytest.approx(other.moving_clearance(q0, 0.3), abs=1e-9)
            assert motion.is_free_slowly(q0) == other.is_free_slowly(q0) == motion.is_free(q0)
            answers.add((margin, motion.edge_is_free(q0, q1)))
    assert len(answers) == 8
    for wrong in (-0.1, np.nan, 5.0):
        with pytest.raises(InputError, match="margin"):
            motion.keep_margin(wrong)
