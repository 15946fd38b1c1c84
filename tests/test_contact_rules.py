"""Tables of contact rules for all pairs agree with the scene's rule for each pair."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rr1plan.collision import CollisionChecker
from rr1plan.robot import Geometry, Joint, Link, Robot
from rr1plan.robot.joint_limits import Limits
from rr1plan.scene import Scene
from rr1plan.scene.contact_rules import RuleContent, rules_of
from rr1plan.scene.model_library import load_scene
from rr1plan.shapes import Sphere
from rr1plan.transforms import identity

BALL = (Geometry("ball", Sphere(0.1), identity()),)


def chain_of_links() -> Robot:
    """Four links, of which one has no shape."""
    names = "abcd"
    links = tuple(Link(name, collisions=() if name == "c" else BALL) for name in names)
    joints = tuple(Joint(f"j{i}", "revolute", one, two) for i, (one, two) in enumerate(pairwise(names)))
    limits = Limits(-np.ones(3), np.ones(3), *(np.ones(3) for _ in range(4)))
    never = frozenset({frozenset("ab"), frozenset("cd")})
    joint_names = tuple(joint.name for joint in joints)
    return Robot("chain", links, joints, joint_names, limits, {"home": np.zeros(3)}, {}, never, "d")


ROBOT = chain_of_links()
NAMES = ("l", "r", *(f"{arm}/{link}" for arm in "lr" for link in "abd"), "box", "can", "cup", "lid")
BOTH = st.lists(st.sampled_from(NAMES), min_size=2, max_size=2, unique=True).map(tuple)


def two_arms() -> Scene:
    scene = Scene().with_arm("l", ROBOT).with_arm("r", ROBOT, [1.0, 0, 0])
    for name in ("box", "can", "cup", "lid"):
        scene = scene.with_obstacle(name, Sphere(0.1), [0, 0, 3.0])
    return scene.attach("cup", "l", touch=["b"])


def paddings(scene: Scene) -> np.ndarray:
    return scene.contact_rules.paddings(scene.padding, scene.pair_padding)


def agrees(scene: Scene) -> None:
    names = scene.element_names
    pairs = tuple((a, b) for i, a in enumerate(names) for b in names[i + 1 :] if not scene.may_touch(a, b))
    assert scene.checked_pairs == pairs
    assert paddings(scene).tolist() == [scene.padding_of(a, b) for a, b in pairs]


@settings(deadline=None, max_examples=60)
@given(
    st.lists(BOTH, max_size=4), st.lists(st.tuples(BOTH, st.floats(0, 1)), max_size=6), st.floats(0, 1), st.booleans()
)
def test_the_tables_agree_with_the_rules_for_one_pair(allowed, special, general, twice) -> None:
    scene = two_arms().with_padding(general)
    if twice:
        scene = scene.attach("lid", "l")
    for a, b in allowed:
        scene = scene.allow(a, b)
    for (a, b), distance in special:
        scene = scene.with_padding(distance, a, b)
    agrees(scene)


OWNERS = ("l", "r", "box", "can", "lid")


@settings(deadline=None, max_examples=80)
@given(
    st.lists(BOTH, max_size=3),
    st.lists(st.tuples(BOTH, st.floats(0, 1)), max_size=4),
    st.sets(st.lists(st.sampled_from(OWNERS), min_size=1, max_size=2, unique=True).map(frozenset), max_size=8),
)
def test_of_arms_and_obstacles_that_meet_the_tables_are_the_same(allowed, special, meeting) -> None:
    scene = two_arms().with_padding(0.01)
    for a, b in allowed:
        scene = scene.allow(a, b)
    for (a, b), distance in special:
        scene = scene.with_padding(distance, a, b)
    names = scene.element_names
    robots = ((name, arm.robot) for name, arm in scene.arms.items())
    arms = tuple((name, robot.base, robot.solid_links, robot.disabled_collisions) for name, robot in robots)
    held = tuple((name, thing.arm, thing.link, thing.touch) for name, thing in scene.attachments.items())
    # Unknown names, and pairs of missing elements, have no effect.
    near = frozenset({*meeting, frozenset({"l", "gone"})})
    content = RuleContent(arms, tuple(scene.obstacles), held, scene.allowed, near)
    expected = [
        (a, b)
        for i, a in enumerate(names)
        for b in names[i + 1 :]
        if not scene.may_touch(a, b) and frozenset({scene.owner(a) or a, scene.owner(b) or b}) in meeting
    ]
    rules = rules_of(content)
    assert [(names[i], names[j]) for i, j in rules.checked] == expected
    paddings = rules.paddings(scene.padding, scene.pair_padding).tolist()
    assert paddings == [scene.padding_of(a, b) for a, b in expected]


@settings(deadline=None, max_examples=40)
@given(
    st.lists(BOTH, max_size=3),
    st.lists(st.tuples(BOTH, st.floats(0, 0.3)), max_size=3),
    st.lists(st.floats(0.0, 3.0), min_size=4, max_size=4),
    st.sampled_from([("l",), ("r",), ("l", "r")]),
    st.sampled_from([0.0, 0.4]),
)
def test_the_pairs_of_a_checker_are_those_that_may_not_touch(allowed, special, apart, arms, margin) -> None:
    scene = two_arms().with_arm("r", ROBOT, [apart[0], 0, 0])
    for name, distance in zip(("box", "can", "lid"), apart[1:], strict=True):
        scene = scene.with_obstacle(name, Sphere(0.1), [0, distance, 0])
    for a, b in allowed:
        scene = scene.allow(a, b)
    for (a, b), distance in special:
        scene = scene.with_padding(distance, a, b)
    checker = CollisionChecker(scene, arms, margin=margin)
    known = set(checker.pairs)
    assert len(known) == len(checker.pairs)
    for a, b in scene.checked_pairs:
        if {scene.owner(a), scene.owner(b)} & {*arms} and (a, b) not in known:
            # All links are balls in one place.
            at = [center(scene, name) for name in (a, b)]
            wide = max(scene.padding, *scene.pair_padding.values(), 0.0) + margin
            assert float(np.linalg.norm(at[0] - at[1])) - 0.2 > wide
    for (a, b), padding in zip(checker.pairs, checker.padding.tolist(), strict=True):
        assert not scene.may_touch(a, b)
        assert {scene.owner(a), scene.owner(b)} & {*arms}
        assert padding == scene.padding_of(a, b)


def center(scene: Scene, name: str) -> np.ndarray:
    if name in scene.obstacles:
        return scene.obstacles[name].pose[:3, 3]
    owner = scene.owner(name)
    assert owner is not None
    return scene.arms[owner].base[:3, 3]


@pytest.mark.parametrize("name", ["rr1_cluttered", "rr1_pair", "planar2r_path"])
def test_the_tables_of_a_shipped_scene_agree_with_its_rules(name: str) -> None:
    agrees(load_scene(name))


def test_an_arm_may_have_a_padding_among_its_own_links() -> None:
    scene = two_arms().with_padding(0.02, "l", "l")
    assert scene.padding_of("l/a", "l/d") == 0.02
    assert scene.padding_of("l/a", "r/d") == 0.0
    agrees(scene)


def test_of_two_rules_for_an_element_and_an_arm_the_larger_distance_counts() -> None:
    for first, second in ((0.01, 0.05), (0.05, 0.01)):
        scene = two_arms().with_padding(first, "l/d", "r").with_padding(second, "l", "r/d").with_padding(0.2, "l", "r")
        assert scene.padding_of("l/d", "r/d") == scene.padding_of("r/d", "l/d") == 0.05
        assert scene.with_padding(0.0, "r/d", "l/d").padding_of("l/d", "r/d") == 0.0
        agrees(scene)


@given(st.floats(0, 1), st.floats(0, 1))
@settings(deadline=None, max_examples=20)
def test_a_margin_is_kept_beyond_every_padding(padding: float, margin: float) -> None:
    scene = two_arms().with_padding(padding).with_padding(0.3, "r", "box")
    roomy = scene.with_margin(margin)
    assert roomy.checked_pairs == scene.checked_pairs
    np.testing.assert_array_equal(paddings(roomy), paddings(scene) + margin)
    agrees(roomy)


def test_a_scene_without_arms_has_no_pairs() -> None:
    scene = Scene().with_obstacle("box", Sphere(1.0)).with_obstacle("can", Sphere(1.0))
    assert scene.checked_pairs == ()
    assert paddings(scene).shape == (0,)
