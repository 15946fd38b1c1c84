"""The pairs that compiled code lists, against pairs collected one by one from the rules and the tables of bodies."""

from __future__ import annotations

import numpy as np
import pytest

from rr1plan.collision import CollisionChecker
from rr1plan.collision.tables.edge_tables import EdgeTables, build_edge_tables
from rr1plan.collision.tables.link_spheres import instance_spheres
from rr1plan.kernels.planner_kernels import constants
from rr1plan.scene import Scene
from rr1plan.scene.model_library import load_robot, load_scene
from rr1plan.scene.placement import place_grid
from rr1plan.shapes import Box, HalfSpace
from rr1plan.transforms import pose

LANES = constants()["LANES"]
Rows = list[tuple[int, ...]]


def holding(six):
    """An arm with an attached tray above a half-space and next to a box."""
    scene = Scene().with_arm("a", six).with_obstacle("tray", Box((0.2, 0.3, 0.02)), [9, 9, 9])
    scene = scene.with_obstacle("ground", HalfSpace((0, 0, 1), -5.0)).with_obstacle("box", Box((1, 1, 1)), [1, 0, 0])
    return scene.attach("tray", "a", touch=["l5"], pose=pose([0, 0, 0.12]))


@pytest.fixture(params=["rr1_cluttered", "rr1_pair", "one of four", "two of four", "odd", "holding", "alone"])
def checker(request, odd, six) -> CollisionChecker:
    name = request.param
    if name.endswith("of four"):
        scene = place_grid(load_robot("rr1"), 2, 2, spacing=0.8)
        return CollisionChecker(scene, list(scene.arms)[: 1 if name == "one of four" else 2])
    made = {
        "odd": lambda: Scene().with_arm("a", odd).with_obstacle("box", Box((0.1, 0.1, 0.1)), [1, 0, 0]),
        "holding": lambda: holding(six),
        "alone": lambda: Scene().with_arm("a", load_robot("planar2r")),
    }
    return CollisionChecker(made[name]() if name in made else load_scene(name))


def as_rows(array: np.ndarray) -> Rows:
    return [tuple(row) for row in array.tolist()]


def collected(checker: CollisionChecker, *, moving: bool) -> Rows:
    """Solids, the pair of elements, the solids as they are measured, and how many joints carry both: of each pair."""
    geometry, solids = checker.geometry, checker.solids
    chains = [geometry.instances.chains[g] for g in geometry.instances.groups.tolist()]
    chains += [()] * (len(solids) - len(chains))
    surfaceless = checker.pair_tables.surfaceless.tolist()
    of_element: dict[str, list[int]] = {}
    for i, solid in enumerate(solids):
        of_element.setdefault(solid.element, []).append(i)
    found: Rows = []
    for owner, (a, b) in enumerate(checker.pairs):
        for one in of_element.get(a, ()):
            for two in of_element.get(b, ()):
                measured = (two, one) if surfaceless[one] else (one, two)
                both = len(set(chains[one]) & set(chains[two])) if moving else 0
                if (chains[one] != chains[two]) == moving:
                    found.append((one, two, owner, *measured, both))
    return found


def test_pairs_of_solids_are_those_of_the_elements_that_must_not_touch(checker) -> None:
    pairs = checker.pair_tables
    for moving, parts in (
        (True, (pairs.moving, pairs.moving_owner, pairs.moving_rows)),
        (False, (pairs.static, pairs.static_owner, pairs.static_rows)),
    ):
        assert as_rows(np.column_stack(parts)) == collected(checker, moving=moving)


def tables_of(checker: CollisionChecker) -> EdgeTables:
    return build_edge_tables(checker.geometry, checker.fixed, checker.solid_padding, 1e-6)


def bodies_of(checker: CollisionChecker) -> list[int]:
    """The body of each solid, -1: none."""
    body = instance_spheres(checker.geometry.instances).body.tolist()
    return body + [-1] * (len(checker.solids) - len(body))


def test_pairs_of_bodies_are_sorted_by_their_groups(checker) -> None:
    tables, body = tables_of(checker), bodies_of(checker)
    group = tables.arm.bodies[:, 3].tolist()
    expected: Rows = []
    for number, (one, two, *_, both) in enumerate(collected(checker, moving=True)):
        if body[one] >= 0 and body[two] >= 0:
            expected.append((body[one], body[two], both, number))
    expected.sort(key=lambda row: (group[row[0]], group[row[1]], *row[2:]))
    assert as_rows(tables.pairs.body_pairs[:, :4]) == expected
    families = [(group[one], group[two], both) for one, two, both, _ in expected]
    begins = {family: families.index(family) for family in families}
    ends = [*list(begins.values())[1:], len(families)]
    assert as_rows(tables.pairs.group_pairs[:, :5]) == [
        (*family, begin, end) for (family, begin), end in zip(begins.items(), ends if begins else [], strict=True)
    ]


def test_pairs_with_obstacles_have_a_column_for_each_that_is_near(checker) -> None:
    tables, body = tables_of(checker), bodies_of(checker)
    found: dict[tuple[int, int], int] = {}
    for number, (one, two, *_) in enumerate(collected(checker, moving=True)):
        if body[one] < 0 or body[two] < 0:
            found[(body[one], two) if body[two] < 0 else (body[two], one)] = number
    columns = {solid: i for i, solid in enumerate(sorted({solid for _, solid in found}))}
    expected = np.full((len(tables.arm.bodies), -(-len(columns) // LANES) * LANES), -1)
    for (moved, solid), number in found.items():
        expected[moved, columns[solid]] = number
    np.testing.assert_array_equal(tables.pairs.pair_of, expected)


def blocks(pairs: list[tuple[int, int]], groups: int) -> tuple[Rows, list[int]]:
    """Blocks of the second of sorted pairs, with the row of the first pair of each, and where each group's begin."""
    rows: dict[tuple[int, int], list[int]] = {}
    for i, (group, other) in enumerate(pairs):
        row = rows.setdefault((group, other // LANES), [other // LANES * LANES, 0, i])
        row[1] |= 1 << other % LANES
    return [tuple(row) for row in rows.values()], [sum(g < group for g, _ in rows) for group in range(groups + 1)]


def test_blocks_have_a_bit_for_each_pair_of_a_group(checker) -> None:
    tables = tables_of(checker)
    count = len(tables.arm.groups)
    with_groups = [(group, other) for group, other, *_ in as_rows(tables.pairs.group_pairs)]
    with_obstacles = [
        (group, column)
        for group, (_, _, first, last, *_) in enumerate(as_rows(tables.arm.groups))
        for column in range(tables.pairs.pair_of.shape[1])
        if (tables.pairs.pair_of[first:last, column] >= 0).any()
    ]
    for pairs, found, begins in (
        (with_groups, tables.pairs.group_blocks, tables.pairs.first_group_block),
        (with_obstacles, tables.pairs.obstacle_blocks, tables.pairs.first_obstacle_block),
    ):
        assert (as_rows(found), begins.tolist()) == blocks(pairs, count)
