"""Pairs that a checker omits do not change results: scenes of many arms against Coal on every pair."""

from __future__ import annotations

import numpy as np
import pytest

from rr1plan.collision import CollisionChecker
from rr1plan.scene import Scene
from rr1plan.shapes import Box, Sphere

# Coal's gap, where it is positive, is off by no more than this [m].
COAL = 2e-5


def named(contacts):
    return {frozenset((c.a, c.b)) for c in contacts}


def compare(scene, arms, oracle, margin, configurations):
    """Compare a checker with Coal on every pair. Returns the numbers of free and of blocked configurations."""
    checker = CollisionChecker(scene, arms, margin=margin)
    padding = oracle.padding(margin)
    asked = oracle.of_moving_arms
    free = blocked = 0
    for q in configurations:
        beyond = oracle.distances(q) - padding
        if np.abs(beyond).min(initial=np.inf) < COAL:
            continue
        touching = {frozenset(both) for both, gap in zip(oracle.pairs, beyond, strict=True) if gap < 0.0}
        assert checker.is_free(q) == (not touching)
        assert named(checker.contacts(q)) == touching
        free, blocked = free + (not touching), blocked + bool(touching)
        least = float(beyond[asked].min(initial=np.inf))
        clearance = checker.clearance(q)
        nearest, distance = checker.nearest(q), float((beyond + padding)[asked].min(initial=np.inf))
        if least > 0.0:
            assert clearance == pytest.approx(least, abs=COAL)
        else:
            assert clearance <= 0.0
        if distance > 0.0:
            assert nearest.distance == pytest.approx(distance, abs=COAL)
            assert (beyond + padding)[oracle.pairs.index(ordered(nearest.pair, oracle))] < distance + COAL
        else:
            assert nearest.distance <= 0.0
    return free, blocked


def ordered(pair, oracle):
    return pair if pair in oracle.pairs else pair[::-1]


def with_nothing_left_out(scene):
    """The scene as a checker takes it whole: a padding counts as far as the widest, also where nothing is checked."""
    scene = scene.with_obstacle("up", Sphere(0.01), [0, 0, 90.0]).with_obstacle("upper", Sphere(0.01), [0, 0, 91.0])
    return scene.with_padding(1e3, "up", "upper")


@pytest.mark.parametrize("first", range(0, 24, 4))
def test_answers_are_coals_on_every_pair(first, arms_at_random, every_pair, configurations):
    free = blocked = left_out = 0
    for seed in range(first, first + 4):
        scene, arms = arms_at_random(seed)
        oracle = every_pair(scene, arms)
        found = compare(scene, arms, oracle, 0.0, configurations(scene, arms, 8, seed))
        free, blocked = free + found[0], blocked + found[1]
        left_out += int(oracle.of_moving_arms.sum()) - len(CollisionChecker(scene, arms).pairs)
    assert free + blocked > 20
    assert blocked > 0
    assert left_out > 0


@pytest.mark.parametrize("seed", range(3))
def test_answers_about_robots_of_meshes_are_coals_too(seed, arms_at_random, foreign, rr1, every_pair, configurations):
    scene, arms = arms_at_random(seed, [*foreign.values(), rr1])
    oracle = every_pair(scene, arms)
    assert sum(compare(scene, arms, oracle, 0.0, configurations(scene, arms, 5, seed))) > 0


@pytest.mark.parametrize("first", range(0, 24, 6))
def test_answers_are_those_of_a_checker_that_leaves_nothing_out(first, arms_at_random, configurations):
    free, left_out = [], 0
    for seed in range(first, first + 6):
        scene, arms = arms_at_random(seed)
        whole_scene = with_nothing_left_out(scene)
        some, whole = CollisionChecker(scene, arms), CollisionChecker(whole_scene, arms)
        # No pair is omitted.
        moving = [both for both in whole_scene.checked_pairs if {*map(scene.owner, both)} & {*arms}]
        assert sorted(whole.pairs) == sorted(moving)
        assert set(some.pairs) <= set(whole.pairs)
        left_out += len(whole.pairs) - len(some.pairs)
        motions = some, whole
        begins = configurations(scene, arms, 12, seed)
        ends = begins + np.random.default_rng(seed).normal(size=begins.shape) * 0.2
        for q0, q1 in zip(begins, ends, strict=True):
            assert some.is_free(q0) == whole.is_free(q0)
            assert motions[0].is_free(q0) == motions[1].is_free(q0)
            assert named(some.contacts(q0)) == named(whole.contacts(q0))
            assert some.clearance(q0) == pytest.approx(whole.clearance(q0), abs=1e-9)
            assert some.clearance(q0, 0.01) == pytest.approx(whole.clearance(q0, 0.01), abs=1e-9)
            one, two = some.nearest(q0), whole.nearest(q0)
            assert one.distance == pytest.approx(two.distance, abs=1e-9)
            free.append(motions[0].edge_is_free(q0, q1))
            assert free[-1] == motions[1].edge_is_free(q0, q1)
            assert free[-1] == motions[0].edge_is_free_slowly(q0, q1)
    assert left_out > 0
    assert 0 < sum(free) < len(free)


def test_a_free_edge_is_free_at_every_sample_by_coal(arms_at_random, every_pair, configurations):
    free = 0
    for seed in (0, 2, 3, 4, 7, 24, 29):
        scene, arms = arms_at_random(seed)
        oracle, motion = every_pair(scene, arms), CollisionChecker(scene, arms)
        padding = oracle.padding()
        begins = configurations(scene, arms, 6, seed)
        ends = begins + np.random.default_rng(seed).normal(size=begins.shape) * 0.3
        for q0, q1 in zip(begins, ends, strict=True):
            contact = motion.first_contact(q0, q1)
            assert (contact is None) == motion.edge_is_free(q0, q1)
            last = q1 if contact is None else contact.q
            free += contact is None
            for q in np.linspace(q0, last, 7):
                beyond = oracle.distances(q) - padding
                assert (contact is not None and contact.fraction == 0.0) or beyond.min() > -COAL
    assert free > 8


# ---- a margin ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("first", range(0, 12, 4))
def test_a_margin_is_kept_by_what_moves_and_by_nothing_else(first, arms_at_random, every_pair, configurations):
    within = 0
    for seed in range(first, first + 4):
        scene, arms = arms_at_random(seed)
        margin = float(np.random.default_rng(seed).choice([0.002, 0.05, 0.6]))
        oracle = every_pair(scene, arms)
        asked = configurations(scene, arms, 6, seed)
        assert sum(compare(scene, arms, oracle, margin, asked)) > 0
        # Some of them are nearer than the margin and need no more than the padding.
        beyond = oracle.distances(asked[0]) - oracle.padding()
        within += int((~oracle.moves & (beyond > 0.0) & (beyond < margin)).sum())
    assert within > 0


@pytest.mark.parametrize("margin", [0.002, 0.01, 0.05])
def test_a_margin_is_a_wider_padding_of_what_moves(margin, arms_at_random, configurations):
    compared = free = 0
    for seed in (0, 2, 3, 4, 5, 7, 13, 24, 25, 29, 36, 39):
        scene, arms = arms_at_random(seed)
        own, padded = CollisionChecker(scene, arms, margin=margin), CollisionChecker(scene.with_margin(margin), arms)
        if not padded.static_is_free:
            continue
        begins = configurations(scene, arms, 10, seed)
        ends = begins + np.random.default_rng(seed).normal(size=begins.shape) * 0.2
        for q0, q1 in zip(begins, ends, strict=True):
            compared += 1
            assert own.is_free(q0) == padded.is_free(q0)
            assert own.is_free(q0) == padded.is_free(q0)
            assert named(own.contacts(q0)) == named(padded.contacts(q0))
            gaps = own.moving_clearance(q0), padded.moving_clearance(q0)
            assert gaps[0] == pytest.approx(gaps[1], abs=1e-9)
            assert own.edge_is_free(q0, q1) == padded.edge_is_free(q0, q1)
            curve = np.array([q0, q1 - q0, 0.1 * (q1 - q0)])
            assert own.polynomial_is_free(curve, 0.9) == padded.polynomial_is_free(curve, 0.9)
            free += own.edge_is_free(q0, q1)
    assert 0 < free < compared


def test_what_never_moves_needs_no_more_than_its_padding(planar, odd):
    # Two stationary arms are 5 mm apart, and the base of the moving arm is 5 mm from a wall.
    scene = Scene().with_arm("m", odd).with_obstacle("wall", Box((0.02, 0.2, 0.1)), [0.115, 0.0, 0.05])
    scene = scene.with_arm("a", planar, [5.0, 0, 0]).with_arm("b", planar, [5.0, 0.045, 0])
    q = [0.0, 2.0, 0.2]
    checker = CollisionChecker(scene, ["m"], margin=0.02)
    assert checker.is_free(q)
    assert checker.static_is_free
    assert checker.contacts(q) == ()
    assert checker.edge_is_free(q, [0.01, 2.0, 0.2])
    padded = CollisionChecker(scene.with_margin(0.02), ["m"])
    assert not padded.is_free(q)
    assert named(padded.contacts(q)) == {frozenset({f"a/{x}", f"b/{x}"}) for x in ("upper", "lower")}
