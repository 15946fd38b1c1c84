from __future__ import annotations

import coal
import numpy as np
import pytest

from rr1plan.collision.arm_geometry import Solid
from rr1plan.collision.convex.convex_bodies import coal_geometry
from rr1plan.collision.tables.body_tables import body_tables, flat
from rr1plan.kernels.planner_kernels import CStruct, load_library
from rr1plan.shapes import Box, Capsule, Cylinder, Sphere
from rr1plan.shapes.convex_hulls import convex_hull
from rr1plan.transforms import pose

RNG = np.random.default_rng(8)
SHAPES = {
    "box": Box((0.2, 0.3, 0.4)),
    "plate": Box((1.0, 1.0, 0.001)),
    "sphere": Sphere(0.15),
    "cylinder": Cylinder(0.1, 0.4),
    "capsule": Capsule(0.1, 0.3),
    "pebble": convex_hull(RNG.normal(size=(40, 3)) * 0.1),
    "ball": convex_hull(np.array([v / np.linalg.norm(v) * 0.2 for v in RNG.normal(size=(400, 3))])),
}


def gap_bounds(one, A, two, B, least=np.inf, enough=np.inf):
    """Bounds of the distance of two shapes at their poses, as the exact kernel has them."""
    rows = body_tables([Solid("one", one, 0, np.eye(4)), Solid("two", two, 1, np.eye(4))], np.array([flat(A), flat(B)]))
    begins = np.cumsum([0, *rows.degrees]) + len(rows.degrees) + 1
    exact = CStruct(
        "ExactTables",
        body_count=2,
        bodies=rows.bodies,
        shapes=rows.values,
        corners=rows.corners,
        links=np.concatenate([begins, rows.neighbors]).astype(np.int64),
    )
    scratch = CStruct("ExactScratch", poses=rows.poses, centers=rows.centers)
    direction, bounds = np.array([[0.1, 0.2, 0.3]]), np.empty(2)
    load_library().rr1_gap_bounds(exact, scratch, 0, 1, least, enough, direction, bounds)
    return bounds


def coal_distance(one, A, two, B):
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.gjk_tolerance = 1e-10
    places = [coal.Transform3s(np.array(T[:3, :3]), np.array(T[:3, 3])) for T in (A, B)]
    return coal.distance(coal_geometry(one), places[0], coal_geometry(two), places[1], request, result)


@pytest.mark.parametrize("one", SHAPES)
@pytest.mark.parametrize("two", SHAPES)
def test_the_gap_is_never_more_than_coals_distance_and_closes_on_it(one, two):
    rng = np.random.default_rng(9)
    apart = 0
    for _ in range(60):
        A, B = (pose(rng.normal(size=3) * 0.35, quaternion=rng.normal(size=4)) for _ in range(2))
        distance = coal_distance(SHAPES[one], A, SHAPES[two], B)
        lower, upper = gap_bounds(SHAPES[one], A, SHAPES[two], B)
        assert lower <= upper + 1e-12
        if distance > 1e-6:
            apart += 1
            assert lower <= distance + 1e-6
            assert upper >= distance - 1e-6
            assert lower == pytest.approx(distance, abs=1e-5)
        elif distance < -1e-6:
            assert upper <= 1e-9
    assert apart > 5


THIN = [Box((1, 1, 1e-6)), Box((1, 1e-3, 1e-3)), Cylinder(0.5, 0.001), Cylinder(0.0005, 1.0), SHAPES["box"]]


def test_thin_shapes_on_a_grid_and_nearly_parallel_ones_are_told_apart_too():
    rng = np.random.default_rng(10)
    for k in range(3000):
        one, two = (THIN[i] for i in rng.integers(len(THIN), size=2))
        A = pose(np.round(rng.uniform(-5, 5, 3)) * 0.1, rpy=np.round(rng.uniform(-4, 4, 3)) * np.pi / 4)
        if k % 2:
            B = pose(np.round(rng.uniform(-5, 5, 3)) * 0.05, rpy=np.round(rng.uniform(-4, 4, 3)) * np.pi / 2)
        else:
            B = pose(A[:3, 3] + rng.normal(size=3) * 0.2, rpy=rng.normal(size=3) * 1e-6)
        distance = coal_distance(one, A, two, B)
        lower, upper = gap_bounds(one, A, two, B)
        if distance > 1e-6:
            assert distance - 1e-5 < lower < distance + 1e-6
            assert upper > 1e-9


def test_it_stops_once_the_gap_is_enough_or_certainly_is_not():
    A, B = pose([0, 0, 0]), pose([1.0, 0.1, 0.2])
    shapes = SHAPES["pebble"], A, SHAPES["ball"], B
    exact = coal_distance(*shapes)
    lower, _ = gap_bounds(*shapes, enough=0.5 * exact)
    assert 0.5 * exact <= lower <= exact + 1e-9
    lower, upper = gap_bounds(*shapes, least=0.0, enough=2.0 * exact)
    assert 0.0 < lower <= exact + 1e-9
    assert exact - 1e-9 <= upper < 2.0 * exact
