"""Schedules of two arms on given paths: curves in diagrams, checked in time by the collision checker."""

from __future__ import annotations

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.lessons.path_schedules import (
    PairCurve,
    PathPair,
    can_get_out_of_the_way,
    fastest_curve,
    path_pair,
    unscheduled_curve,
)
from rr1plan.lessons.two_arms_lesson import PATHS, TwoArmsLesson


@pytest.fixture(scope="module")
def scene() -> rp.Scene:
    return rp.load_scene("planar2r_pair")


@pytest.fixture(scope="module")
def pairs(scene: rp.Scene) -> dict[str, PathPair]:
    return {name: path_pair(scene, ("left", left), ("right", right)) for name, (left, right) in PATHS.items()}


def touches(scene: rp.Scene, pair: PathPair, curve: PairCurve) -> bool:
    """Whether the arms touch at one of many times."""
    checker = rp.CollisionChecker(scene)
    times = np.linspace(0.0, curve.duration, 1500)
    places = np.column_stack([np.interp(times, curve.times, curve.places[:, k]) for k in range(2)])
    return not all(checker.is_free(q) for q in np.hstack(pair.at(places)))


def is_schedule(pair: PathPair, curve: PairCurve) -> None:
    """From start to goal, no arm faster than 1 rad/s."""
    assert curve.places[0].tolist() == [0.0, 0.0]
    np.testing.assert_allclose(curve.places[-1], [lengths[-1] for lengths in pair.lengths])
    moved, passed = np.abs(np.diff(curve.places, axis=0)), np.diff(curve.times)
    assert (moved <= passed[:, None] + 1e-9).all()
    assert (passed > 0.0).all()


@pytest.mark.parametrize("first", ["left", "right"])
def test_each_arm_may_be_first_and_they_do_not_touch(scene: rp.Scene, pairs: dict[str, PathPair], first: str) -> None:
    pair = pairs["take_turns"]
    curve = fastest_curve(pair, first=first)
    assert curve is not None
    is_schedule(pair, curve)
    assert (np.diff(curve.places, axis=0) >= 0.0).all()
    assert not touches(scene, pair, curve)
    # Where the blocked region is, the first one has come farther.
    rows, columns = np.nonzero(pair.blocked[1:-1, 1:-1])
    middle = np.array([pair.lengths[0][rows].mean(), pair.lengths[1][columns].mean()])
    own = pair.arms.index(first)
    passed = np.interp(middle[own], curve.places[:, own], curve.times)
    other = np.interp(passed, curve.times, curve.places[:, 1 - own])
    assert other < middle[1 - own]


def test_without_waiting_they_touch(scene: rp.Scene, pairs: dict[str, PathPair]) -> None:
    for pair in pairs.values():
        curve = unscheduled_curve(pair)
        is_schedule(pair, curve)
        assert touches(scene, pair, curve)


def test_the_fastest_of_all_is_the_faster_order(pairs: dict[str, PathPair]) -> None:
    pair = pairs["take_turns"]
    orders = [fastest_curve(pair, first=arm) for arm in pair.arms]
    best = fastest_curve(pair)
    assert best is not None
    assert best.duration == pytest.approx(min(curve.duration for curve in orders if curve is not None))


def test_some_paths_have_schedules_only_with_backing_up(scene: rp.Scene, pairs: dict[str, PathPair]) -> None:
    pair = pairs["back_up"]
    assert fastest_curve(pair) is None
    curve = fastest_curve(pair, back_up=True)
    assert curve is not None
    is_schedule(pair, curve)
    assert (np.diff(curve.places, axis=0) < 0.0).any()
    assert not touches(scene, pair, curve)


def test_some_paths_have_none(scene: rp.Scene, pairs: dict[str, PathPair]) -> None:
    pair = pairs["swap_sides"]
    assert fastest_curve(pair) is None
    assert fastest_curve(pair, back_up=True) is None
    for first in pair.arms:
        assert not can_get_out_of_the_way(scene, pair, first, resolution=60)


def test_an_arm_gets_out_of_the_way_where_it_can(scene: rp.Scene, pairs: dict[str, PathPair]) -> None:
    short = path_pair(scene, ("left", [[0.6, 0.0], [0.4, 0.0]]), ("right", [[1.5, -2.2], [1.4, -2.2]]))
    assert can_get_out_of_the_way(scene, short, "left", resolution=60)


def test_blocked_cells_contain_all_contacts(scene: rp.Scene, pairs: dict[str, PathPair]) -> None:
    checker, rng = rp.CollisionChecker(scene), np.random.default_rng(0)
    seen = 0
    for pair in pairs.values():
        places = rng.uniform(0.0, [lengths[-1] for lengths in pair.lengths], (600, 2))
        for place, q in zip(places, np.hstack(pair.at(places)), strict=True):
            cell = tuple(int(np.searchsorted(pair.lengths[k], place[k])) for k in range(2))
            if not checker.is_free(q):
                assert pair.blocked[cell]
                seen += 1
    assert seen > 100


def test_the_lesson_moves_both_arms_together_without_contact(scene: rp.Scene) -> None:
    lesson = rp.lesson("two_arms")
    assert isinstance(lesson, TwoArmsLesson)
    joint = lesson.schedules["swap_sides"][1].joint
    assert joint is not None
    checker = rp.CollisionChecker(scene)
    assert checker.path_is_free(joint)
    np.testing.assert_allclose(joint[0], [0.2, 0.0, 0.2, 0.0])
    np.testing.assert_allclose(joint[-1], [-0.2, 0.0, -0.2, 0.0])


def test_wrong_paths_are_refused(scene: rp.Scene) -> None:
    free = [[0.2, 0.0], [-0.2, 0.0]]
    with pytest.raises(rp.InputError, match="both paths are of arm 'left'"):
        path_pair(scene, ("left", free), ("left", free))
    with pytest.raises(rp.UnknownNameError, match="middle"):
        path_pair(scene, ("left", free), ("middle", free))
    with pytest.raises(rp.InputError, match="not free, even without the other arm"):
        path_pair(scene, ("left", [[0.2, 0.0], [-1.4, 0.0]]), ("right", [[1.5, -2.2], [1.4, -2.2]]))
    with pytest.raises(rp.InputError, match="is about a query of two arms"):
        rp.lesson("two_arms", scene)
