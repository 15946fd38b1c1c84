"""Spheres around links and held objects: no sampled point of a surface is outside, at any level."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rr1plan as rp
from rr1plan.collision.sphere_covers import cover_geometries
from rr1plan.errors import InputError
from rr1plan.robot import Geometry
from rr1plan.scene.model_library import robot_names
from rr1plan.shapes.convex_hulls import convex_hull
from rr1plan.transforms import pose

FOREIGN = (
    "panda_description/urdf/panda.urdf",
    "ur_description/urdf/ur5_robot.urdf",
    "xarm_description/urdf/xarm7.urdf",
    "so_arm_description/urdf/so101.urdf",
    "kinova_description/robots/kinova.urdf",
)
LEVELS = (0, 1, 2)
SIZES = st.floats(0.005, 0.5)


def surface(shape: rp.shapes.Shape, count: int, rng: np.random.Generator) -> np.ndarray:
    """Points on the surface of a shape, its corners and rims among them, shape (n, 3)."""
    directions = rng.normal(size=(count, 3))
    unit = directions / np.linalg.norm(directions, axis=1)[:, None]
    match shape:
        case rp.Sphere(radius):
            return radius * unit
        case rp.Capsule(radius, length):
            ends = np.where(unit[:, 2] > 0.0, 0.5, -0.5) * length
            side = np.column_stack([unit[:, :2] / np.hypot(*unit.T[:2])[:, None] * radius, np.zeros(count)])
            side[:, 2] = rng.uniform(-0.5, 0.5, count) * length
            return np.concatenate([radius * unit + np.outer(ends, [0, 0, 1]), side])
        case rp.Cylinder(radius, length):
            circle = unit[:, :2] / np.hypot(*unit.T[:2])[:, None] * radius
            rims = [np.column_stack([circle, np.full(count, h * length)]) for h in (-0.5, 0.5)]
            side = np.column_stack([circle, rng.uniform(-0.5, 0.5, count) * length])
            ends = [rim * np.array([s, s, 1.0]) for rim, s in zip(rims, rng.uniform(size=2), strict=True)]
            return np.concatenate([*rims, side, *ends])
        case rp.Box(size):
            points = rng.uniform(-0.5, 0.5, (count, 3))
            points[np.arange(count), rng.integers(0, 3, count)] = rng.choice([-0.5, 0.5], count)
            corners = np.array(np.meshgrid(*[[-0.5, 0.5]] * 3)).reshape(3, -1).T
            return np.concatenate([points, corners]) * np.array(size)
        case _:
            weights = rng.dirichlet(np.full(3, 0.7), count)
            triangles = shape.vertices[shape.faces[rng.integers(0, len(shape.faces), count)]]
            return np.concatenate([np.einsum("ij,ijk->ik", weights, triangles), shape.vertices])


def surface_of(geometries: tuple[Geometry, ...], count: int, rng: np.random.Generator) -> np.ndarray:
    placed = [surface(g.shape, count, rng) @ g.pose[:3, :3].T + g.pose[:3, 3] for g in geometries]
    return np.concatenate(placed)


def worst_outside(points: np.ndarray, centers: np.ndarray, radii: np.ndarray) -> float:
    """Largest distance of a point from the spheres [m]; -1 if all points are inside."""
    nearest = np.full(len(points), np.inf)
    for k in np.argsort(-radii, kind="stable"):
        # Skip points inside an earlier sphere.
        nearest = np.minimum(nearest, np.linalg.norm(points - centers[k], axis=1) - radii[k])
        points, nearest = points[nearest > 0.0], nearest[nearest > 0.0]
    return float(nearest.max(initial=-1.0))


def check_robot(robot: rp.Robot) -> None:
    rng = np.random.default_rng(0)
    covers = rp.cover_with_spheres(robot)
    assert list(covers) == list(robot.link_names)
    for link in robot.links:
        cover = covers[link.name]
        if not link.collisions:
            assert len(cover.radii) == 0
            continue
        points = surface_of(link.collisions, 4000, rng)
        for level in LEVELS:
            assert worst_outside(points, *cover.at(level)) <= 0.0


@pytest.mark.parametrize("name", robot_names())
def test_no_point_of_a_shipped_robot_is_outside_its_spheres(name: str) -> None:
    check_robot(rp.load_robot(name))


@pytest.mark.parametrize("name", FOREIGN)
def test_no_point_of_a_foreign_robot_is_outside_its_spheres(name: str, foreign_robots: Path) -> None:
    check_robot(rp.load_robot(foreign_robots / name))


@st.composite
def hulls(draw: st.DrawFn) -> rp.Mesh:
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    points = rng.normal(size=(draw(st.integers(6, 40)), 3)) * [draw(SIZES), draw(SIZES), draw(SIZES)]
    return convex_hull(points)


shapes = st.one_of(
    st.builds(rp.Box, st.tuples(SIZES, SIZES, SIZES)),
    st.builds(rp.Sphere, SIZES),
    st.builds(rp.Cylinder, SIZES, SIZES),
    st.builds(rp.Capsule, SIZES, SIZES),
    hulls(),
)
placements = st.builds(
    lambda xyz, rpy: pose(xyz, rpy=rpy),
    st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    st.tuples(*[st.floats(-3.1, 3.1)] * 3),
)
placed = st.builds(Geometry, st.just("part"), shape=shapes, pose=placements)


@settings(deadline=None, max_examples=25)
@given(st.lists(placed, min_size=1, max_size=4))
def test_shapes_of_any_kind_anywhere_are_inside_at_every_level(geometries: list[Geometry]) -> None:
    cover = cover_geometries("thing", geometries)
    points = surface_of(tuple(geometries), 500, np.random.default_rng(0))
    for level in LEVELS:
        assert worst_outside(points, *cover.at(level)) <= 0.0
    counts = [len(cover.at(level)[1]) for level in LEVELS]
    assert counts[0] == 1
    assert counts[1] == len(geometries)
    assert list(cover.levels) == sorted(cover.levels)


def test_a_mesh_with_a_hollow_is_covered_piece_by_piece_and_its_hollow_left_open() -> None:
    hook = hook_of_three_boxes()
    cover = cover_geometries("hook", [Geometry("", shape=hook)])
    points = surface(hook, 5000, np.random.default_rng(0))
    for level in LEVELS:
        assert worst_outside(points, *cover.at(level)) <= 0.0
    assert len(cover.at(1)[1]) > 1
    assert worst_outside(np.array([[0.0, 0.0, 0.35]]), *cover.at(2)) > 0.05
    assert worst_outside(np.array([[0.0, 0.0, 0.35]]), *cover.at(0)) < 0.0


def hook_of_three_boxes() -> rp.Mesh:
    """A U of 0.4 m: a profile in x and z, drawn out along y."""
    xz = np.array([[-4, 0], [4, 0], [4, 8], [3, 8], [3, 1], [-3, 1], [-3, 8], [-4, 8]]) * 0.05
    front, back = (np.insert(xz, 1, y, axis=1) for y in (-0.05, 0.05))
    caps = np.array([[0, 1, 4], [0, 4, 5], [1, 2, 3], [1, 3, 4], [0, 5, 6], [0, 6, 7]])
    sides = [face for i in range(8) for face in ([i, i + 8, (i + 1) % 8], [(i + 1) % 8, i + 8, (i + 1) % 8 + 8])]
    return rp.Mesh(np.concatenate([front, back]), np.concatenate([caps, caps[:, ::-1] + 8, np.array(sides)]))


def test_coarser_levels_are_fewer_and_the_sphere_of_one_body_is_the_one_around_all(rr1: rp.Robot) -> None:
    for cover in rp.cover_with_spheres(rr1).values():
        counts = [len(cover.at(level)[1]) for level in LEVELS]
        assert counts == sorted(counts)
    alone = cover_geometries(
        "box", [Geometry("", shape=rp.Box((0.1, 0.2, 0.3)), pose=pose([1.0, 2.0, 3.0], rpy=[0.1, 0.2, 0.3]))]
    )
    np.testing.assert_allclose(alone.at(0)[0], alone.at(1)[0])
    np.testing.assert_allclose(alone.at(0)[1], alone.at(1)[1], rtol=1e-9)


def test_the_sphere_around_a_link_is_hardly_larger_than_it_has_to_be(rr1: rp.Robot) -> None:
    rng = np.random.default_rng(1)
    for link in rr1.links:
        if not link.collisions:
            continue
        points = surface_of(link.collisions, 1000, rng)
        half = 0.5 * np.ptp(points, axis=0).max()
        (radius,) = rp.cover_with_spheres(rr1)[link.name].at(0)[1]
        assert half <= radius <= 1.75 * half


def test_a_scene_has_a_cover_for_every_link_and_held_object_and_none_for_obstacles(rr1: rp.Robot) -> None:
    scene = rp.Scene().with_arm("left", rr1).with_arm("right", rr1, [1.0, 0.0, 0.0])
    scene = scene.with_obstacle("wall", rp.Box((0.1, 1.0, 1.0)), [2.0, 0.0, 0.0])
    scene = scene.with_obstacle("rod", rp.Capsule(0.01, 0.2), [0.3, 0.0, 0.5]).attach("rod", "left")
    covers = rp.cover_with_spheres(scene)
    assert set(covers) == {f"{arm}/{link}" for arm in ("left", "right") for link in rr1.link_names} | {"rod"}
    assert covers["left/hand_link"].radii is covers["right/hand_link"].radii
    points = surface(rp.Capsule(0.01, 0.2), 1000, np.random.default_rng(0))
    assert worst_outside(points, *covers["rod"].at(2)) <= 0.0


def test_covers_are_read_only_and_can_be_pickled(rr1: rp.Robot) -> None:
    cover = rp.cover_with_spheres(rr1)["hand_link"]
    with pytest.raises(ValueError, match="read-only"):
        cover.radii[0] = 1.0
    again = pickle.loads(pickle.dumps(cover))
    np.testing.assert_array_equal(again.centers, cover.centers)
    assert not again.levels.flags.writeable


@pytest.mark.parametrize("level", [-1, 3, "parts", None, 0.5])
def test_a_level_that_is_none_is_refused(rr1: rp.Robot, level: object) -> None:
    with pytest.raises(InputError, match="expected a whole number from 0 to 2"):
        rp.cover_with_spheres(rr1)["hand_link"].at(level)


@pytest.mark.parametrize("thing", [None, "rr1", rp.Box((1.0, 1.0, 1.0))])
def test_what_is_neither_robot_nor_scene_is_refused(thing: object) -> None:
    with pytest.raises(InputError, match="expected a Robot or a Scene"):
        rp.cover_with_spheres(thing)


@pytest.mark.parametrize("shape", [rp.HalfSpace(), rp.PointCloud(np.zeros((1, 3)))])
def test_what_has_no_spheres_is_named(shape: rp.shapes.Shape) -> None:
    with pytest.raises(InputError, match=r"around 'thing'.*has no spheres"):
        cover_geometries("thing", [Geometry("", shape=shape)])


def test_a_flat_mesh_is_named(rr1: rp.Robot) -> None:
    sheet = rp.Mesh(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.0]]), np.array([[0, 1, 2], [1, 3, 2]]))
    scene = rp.Scene().with_arm("arm", rr1).with_obstacle("sheet", sheet).attach("sheet")
    with pytest.raises(InputError, match=r"around 'sheet'.*flat"):
        rp.cover_with_spheres(scene)
