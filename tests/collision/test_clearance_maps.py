"""Clearance maps against Coal, and their cache."""

from __future__ import annotations

import logging

import numpy as np
import pytest

from rr1plan.collision import CollisionChecker, arm_geometry, clearance_maps
from rr1plan.collision.tables.edge_tables import build_edge_tables
from rr1plan.robot import Geometry, Joint, Link, Robot
from rr1plan.robot.joint_limits import Limits
from rr1plan.scene import Scene
from rr1plan.shapes import Capsule
from rr1plan.transforms import pose


def forget():
    """Clear all caches, as in a new process."""
    clearance_maps._gaps.cache_clear()
    arm_geometry._arm_geometry.cache_clear()
    arm_geometry.arm_instances.cache_clear()


@pytest.fixture
def own_cache(tmp_path, monkeypatch):
    folder = tmp_path / "cache"
    monkeypatch.setenv("RR1PLAN_CACHE", str(folder))
    forget()
    yield folder
    forget()


def of(scene, least=0.001):
    """A checker, its pairs whose relative pose depends on few columns, and their maps."""
    checker = CollisionChecker(scene)
    groups = checker.geometry.instances.groups
    pairs = checker.solid_pairs
    pairs = pairs[(pairs < len(groups)).all(axis=1)]
    pairs = pairs[(groups[pairs] > 0).all(axis=1)]
    maps = clearance_maps.instance_maps(
        checker.geometry.instances, pairs, np.full(len(pairs), least), np.zeros((0, 2), np.int64)
    )
    return checker, pairs, maps


def number_of(checker, pair):
    return next(i for i, both in enumerate(checker.solid_pairs.tolist()) if both == pair.tolist())


@pytest.mark.parametrize("robot", ["odd", "rr1"])
def test_no_map_promises_more_than_coal_measures(robot, request, own_cache):
    checker, pairs, maps = of(Scene().with_arm("a", request.getfixturevalue(robot), pose([0.3, 0.1, 0.2])))
    rng, free, seen = np.random.default_rng(4), 0, 0
    for pair, place, (low_x, per_x, low_y, per_y) in zip(pairs, maps.of_pairs, maps.ranges, strict=True):
        if place[0] < 0:
            continue
        begin, width, x, y = place.tolist()
        number = number_of(checker, pair)
        sums = maps.counts[begin : begin + (clearance_maps.CELLS + 1) * (width + 1)].reshape(-1, width + 1)
        near = np.diff(np.diff(sums.astype(np.int64), axis=0), axis=1)
        for q in rng.uniform(checker.limits.lower, checker.limits.upper, (40, checker.nq)):
            cell = int((q[x] - low_x) * per_x), int((q[y] - low_y) * per_y) if width > 1 else 0
            gap = checker.solid_distances(q, [number])[0]
            seen += 1
            if not near[cell]:
                free += 1
                assert gap >= 0.001 - 1e-9
            else:
                # A cell is small: what is far is proven.
                assert gap < 0.3
    assert 0 < free < seen


def _over_each_other(gap):
    """Two short rods, one of which turns above the other at a gap."""
    limits = Limits(np.full(2, -3.0), np.full(2, 3.0), *(np.ones(2) for _ in range(4)))
    rod = Capsule(0.02, 0.06)
    below = Geometry("below", rod, pose([0.45, 0, 0], rpy=[0, np.pi / 2, 0]))
    above = Geometry("above", rod, pose([0.05, 0, 0.04 + gap], rpy=[0, np.pi / 2, 0]))
    links = Link("base"), Link("one", collisions=(below,)), Link("two", collisions=(above,))
    joints = (
        Joint("first", "revolute", "base", "one"),
        Joint("second", "revolute", "one", "two", pose([0.5, 0, 0])),
    )
    return Robot("passing", links, joints, ("first", "second"), limits, {"home": np.zeros(2)}, {}, frozenset(), "two")


def test_what_passes_at_three_millimeters_is_told_from_a_contact(own_cache):
    scene = Scene().with_arm("a", _over_each_other(0.003))
    for least, proven in ((0.001, True), (0.0035, False)):
        _, _, maps = of(scene, least)
        assert (maps.of_pairs[:, 0] >= 0).all()
        assert (maps.counts.max() == 0) == proven


def test_a_greater_gap_is_proven_in_fewer_cells_of_the_same_map(odd, own_cache):
    scene = Scene().with_arm("a", odd)
    _, _, maps = of(scene, 0.001)
    files = sorted(own_cache.iterdir())
    made = clearance_maps._gaps.cache_info().misses
    assert len(files) == made > 0
    _, _, wider = of(scene, 0.01)
    assert sorted(own_cache.iterdir()) == files
    assert clearance_maps._gaps.cache_info().misses == made
    assert (wider.counts >= maps.counts).all()
    assert wider.counts.sum() > maps.counts.sum()


def test_the_map_of_a_family_is_free_where_all_of_its_pairs_are(rr1, own_cache):
    checker = CollisionChecker(Scene().with_arm("a", rr1))
    tables = build_edge_tables(checker.geometry, checker.fixed, checker.solid_padding, 1e-6)

    def near(begin, width):
        sums = tables.pairs.maps[begin : begin + (clearance_maps.CELLS + 1) * (width + 1)].reshape(-1, width + 1)
        return np.diff(np.diff(sums.astype(np.int64), axis=0), axis=1) > 0

    seen = 0
    for _, _, _, first, last, begin in tables.pairs.group_pairs.tolist():
        rows = tables.pairs.body_pairs[first:last]
        if begin < 0:
            assert last - first == 1 or (rows[:, 4] < 0).any() or (rows[:, 5:] != rows[0, 5:]).any()
            continue
        seen += 1
        each = [near(row[4], row[5]) for row in rows.tolist()]
        np.testing.assert_array_equal(near(begin, rows[0, 5]), np.any(each, axis=0))
        assert np.any(each)
        assert not np.all(each)
    assert seen > 0


def test_maps_are_the_same_wherever_the_arm_stands(odd, own_cache):
    of(Scene().with_arm("a", odd))
    files = sorted(own_cache.iterdir())
    of(Scene().with_arm("b", odd, pose([0.5, 0.2, 0.1], rpy=[0.1, 0.2, 0.3])))
    assert sorted(own_cache.iterdir()) == files


def test_a_new_process_takes_the_maps_it_finds(odd, own_cache, monkeypatch):
    _, _, maps = of(Scene().with_arm("a", odd))
    forget()

    def made_again(*_):
        raise AssertionError("a map was made though there is one")

    monkeypatch.setattr(clearance_maps, "exact_struct", made_again)
    _, _, again = of(Scene().with_arm("a", odd))
    np.testing.assert_array_equal(again.counts, maps.counts)


def test_a_damaged_map_is_made_again(odd, own_cache, caplog):
    _, _, maps = of(Scene().with_arm("a", odd))
    for i, file in enumerate(sorted(own_cache.iterdir())):
        if i % 2:
            np.savez(file, gaps=np.full((3, 3), 9.0))
        else:
            file.write_bytes(file.read_bytes()[:-40])
    forget()
    with caplog.at_level(logging.WARNING):
        _, _, again = of(Scene().with_arm("a", odd))
    assert "cannot be used" in caplog.text
    np.testing.assert_array_equal(again.counts, maps.counts)


def test_without_a_folder_to_write_to_maps_are_made_all_the_same(odd, own_cache):
    _, _, maps = of(Scene().with_arm("a", odd))
    for file in own_cache.iterdir():
        file.unlink()
    own_cache.rmdir()
    own_cache.write_text("not a folder")
    forget()
    _, _, again = of(Scene().with_arm("a", odd))
    np.testing.assert_array_equal(again.counts, maps.counts)
