from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rr1plan.collision.convex import bounding_spheres
from rr1plan.collision.convex.bounding_spheres import MOST, cover
from rr1plan.errors import InputError
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, PointCloud, Sphere
from rr1plan.shapes.convex_hulls import convex_hull

SIZES = st.floats(0.005, 0.5)


@st.composite
def hulls(draw):
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    points = rng.normal(size=(draw(st.integers(6, 60)), 3)) * [draw(SIZES), draw(SIZES), draw(SIZES)]
    return convex_hull(points + rng.normal(size=3))


solids = st.one_of(
    st.builds(Box, st.tuples(SIZES, SIZES, SIZES)),
    st.builds(Sphere, SIZES),
    st.builds(Cylinder, SIZES, SIZES),
    st.builds(Capsule, SIZES, SIZES),
    hulls(),
)


def fill_randomly(shape, count, rng):
    """Points of a solid, many of them on its surface, corners and rims."""
    directions = rng.normal(size=(count, 3))
    unit = directions / np.linalg.norm(directions, axis=1)[:, None]
    deep = np.minimum(1.0, rng.uniform(0.0, 1.5, (count, 1)))
    match shape:
        case Box(size):
            return np.clip(rng.uniform(-1.5, 1.5, (count, 3)), -1.0, 1.0) * np.array(size) / 2
        case Sphere(radius):
            return radius * deep * unit
        case Cylinder(radius, length):
            across = directions[:, :2] / np.linalg.norm(directions[:, :2], axis=1)[:, None]
            return np.column_stack([radius * deep * across, np.clip(rng.uniform(-1.5, 1.5, count), -1, 1) * length / 2])
        case Capsule(radius, length):
            return radius * deep * unit + np.outer(rng.uniform(-0.5, 0.5, count), [0, 0, length])
        case _:
            weights = rng.dirichlet(np.full(len(shape.vertices), 0.1), count)
            return np.concatenate([weights @ shape.vertices, shape.vertices])


@settings(deadline=None, max_examples=25)
@given(solids, st.integers(0, 2**32))
def test_no_point_of_a_solid_is_outside_its_spheres(shape, seed):
    made = cover(shape)
    points = fill_randomly(shape, 4000, np.random.default_rng(seed))
    outside = np.ones(len(points), dtype=bool)
    for center, radius in zip(made.centers, made.radii, strict=True):
        outside &= np.linalg.norm(points - center, axis=1) > radius
    assert not outside.any()
    assert (np.linalg.norm(points - made.ball[:3], axis=1) <= made.ball[3]).all()
    assert len(made.radii) <= MOST


@settings(deadline=None, max_examples=25)
@given(solids, st.integers(0, 2**32))
def test_the_inner_balls_are_inside_the_solid(shape, seed):
    """Along any direction the solid reaches at least as far as each of its inner balls."""
    made = cover(shape)
    rng = np.random.default_rng(seed)
    points = np.concatenate([fill_randomly(shape, 4000, rng), boundary(shape)])
    for direction in rng.normal(size=(60, 3)):
        unit = direction / np.linalg.norm(direction)
        reach = support_of(shape, unit, points)
        inside = made.inner > -1.0
        assert (made.centers[inside] @ unit + made.inner[inside] <= reach + 1e-12).all()


def boundary(shape):
    return shape.vertices if isinstance(shape, Mesh) else np.zeros((0, 3))


def support_of(shape, unit, points):
    match shape:
        case Box(size):
            return float(np.abs(unit) @ np.array(size)) / 2
        case Sphere(radius):
            return radius
        case Cylinder(radius, length):
            return radius * float(np.hypot(unit[0], unit[1])) + abs(unit[2]) * length / 2
        case Capsule(radius, length):
            return radius + abs(unit[2]) * length / 2
        case _:
            return float((points @ unit).max())


def test_a_hundred_thousand_points_of_a_plate_are_inside():
    plate = Box((0.2, 0.3, 0.02))
    made = cover(plate)
    points = fill_randomly(plate, 100_000, np.random.default_rng(0))
    assert (np.linalg.norm(points[:, None] - made.centers, axis=2) <= made.radii).any(axis=1).all()


def test_a_sphere_is_its_own_cover_and_a_capsule_a_chain_of_exact_ends():
    assert cover(Sphere(0.2)).radii == pytest.approx([0.2])
    made = cover(Capsule(0.05, 0.3))
    assert made.centers[[0, -1], 2] == pytest.approx([-0.15, 0.15])
    assert made.radii.max() < 0.05 + bounding_spheres.EXCESS + 1e-6


@pytest.mark.parametrize("shape", [HalfSpace(), PointCloud(np.zeros((1, 3)))])
def test_what_has_no_spheres_is_refused(shape):
    with pytest.raises(InputError, match=type(shape).__name__):
        cover(shape)


def test_covers_are_kept_on_disk_and_made_anew_when_damaged(tmp_path, monkeypatch):
    monkeypatch.setenv("RR1PLAN_CACHE", str(tmp_path))
    corners = np.random.default_rng(1).normal(size=(20, 3))
    first = cover(convex_hull(corners))
    (kept,) = tmp_path.glob("*.npz")
    again = cover(convex_hull(corners))
    assert np.array_equal(first.radii, again.radii)
    kept.write_bytes(b"damaged")
    anew = cover(convex_hull(corners))
    assert np.array_equal(first.centers, anew.centers)


@pytest.mark.parametrize("flat", [1.0, 0.02, 1e-5])
def test_a_hull_of_many_corners_is_contained_by_way_of_a_simpler_one(flat: float) -> None:
    rng = np.random.default_rng(3)
    points = rng.normal(size=(3000, 3))
    points *= np.array([0.1, 0.05, 0.08 * flat]) / np.linalg.norm(points, axis=1)[:, None]
    mesh = convex_hull(points)
    assert len(mesh.vertices) > 400
    made = cover(mesh)
    weights = rng.dirichlet(np.full(4, 0.3), size=4000)
    inside = np.einsum("ij,ijk->ik", weights, mesh.vertices[rng.integers(0, len(mesh.vertices), (4000, 4))])
    for sample in (mesh.vertices, inside):
        gap = np.linalg.norm(sample[:, None] - made.centers, axis=2) - made.radii
        assert gap.min(axis=1).max() <= 0.0
        assert (np.linalg.norm(sample - made.ball[:3], axis=1) <= made.ball[3]).all()
    assert (made.inner == -np.inf).all()
