"""Contacts between stationary objects: planted contacts are found, and only those that Coal finds on every pair."""

from __future__ import annotations

import numpy as np
import pytest

from rr1plan.collision import CollisionChecker
from rr1plan.scene import Scene
from rr1plan.shapes import Box, Capsule, HalfSpace, PointCloud, Sphere
from rr1plan.transforms import pose


def named(contacts):
    return {frozenset(both) for both in contacts}


def found(scene, moving):
    """Static contacts, which are contacts everywhere and leave no edge free."""
    checker, nq = CollisionChecker(scene, moving), len(scene.joint_names(moving))
    contacts = named(checker.static_contacts)
    assert checker.static_is_free == (not contacts)
    for q in (np.zeros(nq), np.full(nq, 0.7)):
        there = checker.contacts(q)
        assert contacts <= named((c.a, c.b) for c in there)
        assert [c.depth for c in there] == sorted((c.depth for c in there), reverse=True)
        if contacts:
            assert not checker.is_free(q)
            assert not checker.edge_is_free(q, q)
    return contacts


def expected(every_pair, scene, moving):
    """The same by Coal."""
    oracle = every_pair(scene, moving)
    beyond = oracle.distances(scene.configuration(moving)) - oracle.padding()
    return {frozenset(both) for both, gap, moves in zip(oracle.pairs, beyond, oracle.moves, strict=True)
            if not moves and gap <= 0.0}  # fmt: skip


def pairs(*names):
    return {frozenset(both) for both in names}


@pytest.fixture
def row(planar):
    """Four arms in a row out of each other's reach, of which the last moves."""
    scene = Scene()
    for i, name in enumerate("abcm"):
        scene = scene.with_arm(name, planar, [3.0 * i, 0, 0])
    return scene


def test_arms_apart_have_no_contacts(row, every_pair):
    assert found(row, ["m"]) == expected(every_pair, row, ["m"]) == set()


def test_two_arms_that_stand_in_each_other(row, planar, every_pair):
    scene = row.with_arm("b", planar, [0.3, -0.25, 0], q=[np.pi / 2, 0.0])
    contacts = found(scene, ["m"])
    assert contacts == expected(every_pair, scene, ["m"]) == pairs(("a/upper", "b/upper"))
    # It is not a static contact if one of the two moves.
    assert found(scene, ["b"]) == found(scene, ["a", "m"]) == set()
    assert found(scene, ["c"]) == contacts
    assert found(scene, ["a", "b", "c", "m"]) == set()


OBSTACLES = {
    "box": (Box((0.1, 0.1, 0.1)), pose([0.25, 0.06, 0.0])),
    "ball": (Sphere(0.05), pose([0.25, 0.06, 0.0])),
    "ground": (HalfSpace((0.0, 0.0, 1.0)), pose([0.0, 0.0, -0.01])),
    "cloud": (PointCloud(np.array([[0.25, 0.02, 0.0], [0.9, 0.9, 0.9]]), 0.02), pose()),
}


@pytest.mark.parametrize("kind", OBSTACLES)
def test_an_arm_that_stands_in_an_obstacle(kind, row, every_pair):
    shape, T = OBSTACLES[kind]
    scene = row.with_obstacle("thing", shape, T)
    moving = ["m"] if kind != "ground" else ["b", "m"]
    contacts = found(scene, moving)
    assert contacts == expected(every_pair, scene, moving)
    assert frozenset({"a/upper", "thing"}) in contacts
    away = T.copy()
    away[2, 3] -= 0.2
    away[1, 3] += 0.2 * (kind != "ground")
    assert found(row.with_obstacle("thing", shape, away), moving) == set()


def test_an_arm_that_stands_in_itself(six, planar, every_pair):
    folded = [0.0, 2.6, 2.6, 0.0, 2.6, 0.0]
    scene = Scene().with_arm("a", six, q=folded).with_arm("m", planar, [4.0, 0, 0])
    scene = scene.with_arm("b", six, pose([-4.0, 1.0, 0.3], rpy=[0.3, 0.4, 2.0]), q=folded)
    contacts = found(scene, ["m"])
    assert contacts == expected(every_pair, scene, ["m"])
    of_one = {frozenset(x.split("/")[1] for x in both) for both in contacts if all(x.startswith("a/") for x in both)}
    assert len(of_one) > 1
    # The same of either of them, at its place.
    assert contacts == {frozenset(f"{arm}/{link}" for link in both) for arm in "ab" for both in of_one}
    there = {(c.a, c.b): c.point for c in CollisionChecker(scene, ["m"]).contacts([0, 0])}
    base = scene.arms["b"].base
    for (a, b), point in there.items():
        if a.startswith("a/"):
            other = there[a.replace("a/", "b/"), b.replace("a/", "b/")]
            assert other == pytest.approx(base[:3, :3] @ point + base[:3, 3], abs=1e-9)
    assert found(scene.with_configuration("a", "home").with_configuration("b", "home"), ["m"]) == set()


def test_contacts_of_one_arm_with_itself_do_not_serve_another_with_other_rules(six, planar, every_pair):
    folded = [0.0, 2.6, 2.6, 0.0, 2.6, 0.0]
    scene = Scene().with_arm("m", planar, [8.0, 0, 0])
    for i, name in enumerate("abc"):
        scene = scene.with_arm(name, six, [3.0 * i - 3.0, 0, 0], q=folded)
    plain = found(scene, ["m"])
    one, two = sorted(next(both for both in plain if all(x.startswith("b/") for x in both)))
    near = [(f"c/l{i}", f"c/l{j}") for i in range(7) for j in range(i) if not scene.may_touch(f"c/l{i}", f"c/l{j}")]
    allowed = scene.allow(one, two).with_padding(0.3, *near[0])
    contacts = found(allowed, ["m"])
    assert contacts == expected(every_pair, allowed, ["m"])
    assert plain - contacts == pairs((one, two))
    assert found(scene, ["m"]) == plain


def test_what_arms_hold_counts(row, every_pair):
    along = pose([0.5, 0, 0], rpy=[0, np.pi / 2, 0])
    scene = row.with_obstacle("rod", Capsule(0.02, 1.0)).attach("rod", "a", pose=along)
    scene = scene.with_obstacle("post", Box((0.1, 0.1, 0.1)), [1.2, 0.0, 0.0])
    contacts = found(scene, ["m"])
    assert contacts == expected(every_pair, scene, ["m"])
    assert frozenset({"rod", "post"}) in contacts
    # Two held objects, of two arms.
    both = scene.with_obstacle("bar", Box((2.4, 0.02, 0.02))).attach("bar", "b", pose=pose([-1.6, 0, 0]))
    contacts = found(both, ["m"])
    assert contacts == expected(every_pair, both, ["m"])
    assert frozenset({"rod", "bar"}) in contacts
    assert found(both, ["a", "m"]) == expected(every_pair, both, ["a", "m"])
    assert frozenset({"rod", "bar"}) not in found(both, ["a", "m"])


def test_links_that_a_held_object_may_touch_are_a_rule_of_the_scene(row, every_pair):
    scene = row.with_obstacle("rod", Box((0.6, 0.02, 0.02)))
    strict = scene.attach("rod", "a", pose=pose([-0.1, 0, 0]))
    easy = scene.attach("rod", "a", pose=pose([-0.1, 0, 0]), touch=["upper"])
    for _ in range(2):
        assert found(strict, ["m"]) == expected(every_pair, strict, ["m"]) == pairs(("rod", "a/upper"))
        assert found(easy, ["m"]) == expected(every_pair, easy, ["m"]) == set()


def test_allowed_pairs_are_none(row, planar, every_pair):
    scene = row.with_arm("b", planar, [0.3, -0.25, 0], q=[np.pi / 2, 0.0])
    scene = scene.with_obstacle("box", Box((0.1, 0.1, 0.1)), [6.25, 0.06, 0.0])
    assert found(scene, ["m"]) == pairs(("a/upper", "b/upper"), ("c/upper", "box"))
    for a, b, left in (
        ("a", "b", pairs(("c/upper", "box"))),
        ("a/upper", "b/upper", pairs(("c/upper", "box"))),
        ("a/lower", "b/upper", pairs(("a/upper", "b/upper"), ("c/upper", "box"))),
        ("box", "c", pairs(("a/upper", "b/upper"))),
        ("a", "c", pairs(("a/upper", "b/upper"), ("c/upper", "box"))),
    ):
        allowed = scene.allow(a, b)
        assert found(allowed, ["m"]) == expected(every_pair, allowed, ["m"]) == left


def test_paddings_count_and_a_margin_does_not(row, every_pair):
    scene = row.with_obstacle("ball", Sphere(0.05), [0.25, 0.17, 0.0])  # 0.1 from the rod
    for padded, touches in (
        (scene.with_padding(0.09), False),
        (scene.with_padding(0.11), True),
        (scene.with_padding(0.11, "a", "ball"), True),
        (scene.with_padding(0.11, "a/upper", "ball"), True),
        (scene.with_padding(0.11, "a/lower", "ball"), False),
        (scene.with_padding(0.11, "b", "ball"), False),
        (scene.with_padding(0.11).with_padding(0.05, "a", "ball"), False),
        (scene.with_margin(0.11), True),
    ):
        contacts = found(padded, ["m"])
        assert contacts == expected(every_pair, padded, ["m"])
        assert (frozenset({"a/upper", "ball"}) in contacts) == touches
    assert CollisionChecker(scene, ["m"], margin=0.11).static_is_free
    (contact,) = CollisionChecker(scene.with_padding(0.11, "a/upper", "ball"), ["m"]).contacts([0, 0])
    assert contact.depth == pytest.approx(0.01, abs=1e-6)
    assert contact.point == pytest.approx([0.25, 0.07, 0.0], abs=1e-6)


def test_two_arms_may_be_too_near_each_other_by_a_padding_of_theirs(row, every_pair):
    # 3 m between bases, 0.94 m of reach: 2.06 m.
    assert found(row.with_padding(2.0, "a", "b"), ["m"]) == set()
    near = row.with_padding(2.1, "a", "b")
    assert found(near, ["m"]) == expected(every_pair, near, ["m"]) == pairs(("a/lower", "b/upper"))


@pytest.mark.parametrize("first", range(100, 140, 8))
def test_random_scenes_have_the_contacts_that_coal_finds(first, arms_at_random, every_pair):
    number = 0
    for seed in range(first, first + 8):
        scene, _ = arms_at_random(seed)
        rng, names = np.random.default_rng(seed), list(scene.arms)
        # Configurations at random: arms in themselves, in each other, in obstacles.
        for name in names[::2]:
            scene = scene.with_configuration(name, rng.uniform(-2.0, 2.0, scene.arms[name].robot.nq))
        for moving in (names[:1], names[1:3]):
            moving = scene.arm_names(moving)
            contacts = expected(every_pair, scene, moving)
            assert found(scene, moving) == contacts
            number += len(contacts)
    assert number > 20
