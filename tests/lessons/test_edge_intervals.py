"""Checks of edges at fixed steps, by halving and by advancing, against the checker's certified answers."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.lessons.edge_intervals import advance_edge, contact_share, halve_edge, is_proven_free, sample_edge


@pytest.fixture(scope="module")
def checker() -> rp.CollisionChecker:
    return rp.CollisionChecker(next(iter(rp.load_problems("planar2r_plate").values())).scene)


def edges(count: int, seed: int) -> list[tuple[np.ndarray, np.ndarray]]:
    rng = np.random.default_rng(seed)
    starts = rng.uniform(-np.pi, np.pi, (count, 2))
    return [(q, q + rng.normal(0.0, 0.7, 2)) for q in starts]


def test_verdicts_are_those_of_the_certified_edge(checker: rp.CollisionChecker) -> None:
    answers = []
    for q0, q1 in edges(400, 1):
        halved = is_proven_free(halve_edge(checker, q0, q1))
        assert halved == checker.edge_is_free(q0, q1)
        assert is_proven_free(advance_edge(checker, q0, q1)) == halved
        answers.append(halved)
    assert 40 < sum(answers) < 360


def test_verdicts_hold_for_six_joints_and_a_margin() -> None:
    scene = rp.load_scene("rr1_table")
    checker = rp.CollisionChecker(scene, margin=0.002)
    rng, answers = np.random.default_rng(0), []
    for _ in range(60):
        q0 = rng.uniform(checker.limits.lower, checker.limits.upper)
        q1 = np.clip(q0 + rng.normal(0.0, 0.15, 6), checker.limits.lower, checker.limits.upper)
        answers.append(is_proven_free(halve_edge(checker, q0, q1)))
        assert answers[-1] == checker.edge_is_free(q0, q1)
    assert 10 < sum(answers) < 55


def test_proven_intervals_cover_the_edge_and_hold_at_every_point(checker: rp.CollisionChecker) -> None:
    for q0, q1 in edges(60, 2):
        for intervals in (halve_edge(checker, q0, q1), advance_edge(checker, q0, q1)):
            if not is_proven_free(intervals):
                assert intervals[-1].verdict == "contact"
                continue
            free = sorted((i.begin, i.end) for i in intervals if i.verdict == "free")
            assert free[0][0] == 0.0
            assert free[-1][1] == pytest.approx(1.0)
            assert all(a[1] == pytest.approx(b[0]) for a, b in pairwise(free))
            assert all(checker.is_free(q0 + s * (q1 - q0)) for s in np.linspace(0.0, 1.0, 50))


def test_bodies_move_by_no_more_than_the_bound(checker: rp.CollisionChecker) -> None:
    for q0, q1 in edges(40, 3):
        first = halve_edge(checker, q0, q1, most=1)[0]
        levers = checker.tables.pair_levers(np.maximum(np.abs(q0), np.abs(q1))) @ np.abs(q1 - q0)
        middle = checker.solid_distances(0.5 * (q0 + q1))
        for s in (0.0, 0.2, 0.9, 1.0):
            moved = np.abs(checker.solid_distances(q0 + s * (q1 - q0)) - middle)
            assert (moved <= levers * abs(s - 0.5) + 1e-6).all()
        assert first.bound <= 0.5 * levers.max() + 1e-12


def test_long_intervals_come_first(checker: rp.CollisionChecker) -> None:
    intervals = halve_edge(checker, [-0.9, 1.045], [0.9, 1.045])
    lengths = [i.end - i.begin for i in intervals]
    assert lengths == sorted(lengths, reverse=True)
    assert len(set(lengths)) > 5


def test_an_edge_that_is_not_decided_in_time_is_not_proven(checker: rp.CollisionChecker) -> None:
    intervals = halve_edge(checker, [-0.9, 1.045], [0.9, 1.045], most=5)
    assert len(intervals) == 5
    assert intervals[-1].verdict == "undecided"
    assert not is_proven_free(intervals)


@pytest.mark.parametrize(("degrees", "passes"), [(12.0, True), (8.0, True), (4.0, False), (1.0, False)])
def test_a_step_longer_than_the_contact_may_miss_it(checker: rp.CollisionChecker, degrees: float, passes: bool) -> None:
    begin, end = np.array([-0.9, 0.3]), np.array([0.7, 0.3])
    assert not checker.edge_is_free(begin, end)
    found = sample_edge(checker, begin, end, np.radians(degrees))
    assert found.passes == passes
    assert found.step <= np.radians(degrees) + 1e-12
    assert found.fractions[[0, -1]].tolist() == [0.0, 1.0]


def test_the_contact_of_an_edge_is_found_from_both_ends(checker: rp.CollisionChecker) -> None:
    begin, end = np.array([-0.9, 0.3]), np.array([0.7, 0.3])
    found = contact_share(checker, begin, end)
    assert found is not None
    first, last = found
    assert checker.is_free(begin + (first - 1e-6) * (end - begin))
    assert checker.is_free(begin + (last + 1e-6) * (end - begin))
    assert not checker.is_free(begin + 0.5 * (first + last) * (end - begin))
    assert contact_share(checker, [-2.2, -0.4], [-0.8, -1.6]) is None


def test_wrong_numbers_are_refused(checker: rp.CollisionChecker) -> None:
    with pytest.raises(rp.InputError, match="at most 1000000 steps"):
        sample_edge(checker, [0.0, 0.0], [1.0, 0.0], 1e-9)
    with pytest.raises(rp.InputError, match="step is 0"):
        sample_edge(checker, [0.0, 0.0], [1.0, 0.0], 0.0)
    with pytest.raises(rp.InputError, match="most is 0"):
        halve_edge(checker, [0.0, 0.0], [1.0, 0.0], most=0)
