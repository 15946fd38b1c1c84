"""Shapes: small, checked, immutable, also after pickling."""

from __future__ import annotations

import pickle
from collections.abc import Callable

import numpy as np
import pytest

from rr1plan.errors import InputError
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, PointCloud, Shape, Sphere

CORNERS = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Box((1, 1)), "box size has shape"),
        (lambda: Box((1, 1, 0)), "box size is 0.0"),
        (lambda: Box((1, np.nan, 1)), r"box size\[1\] is nan"),
        (lambda: Sphere(-1), "sphere radius is -1"),
        (lambda: Sphere(np.inf), "sphere radius"),
        (lambda: Cylinder(0, 1), "cylinder radius"),
        (lambda: Cylinder(1, -1), "cylinder length"),
        (lambda: Capsule(1, np.nan), "capsule length"),
        (lambda: Capsule("a", 1), "capsule radius is not"),
        (lambda: HalfSpace((0, 0, 0)), "length zero"),
        (lambda: HalfSpace((0, 0, 1), np.inf), "half-space offset"),
        (lambda: Mesh(CORNERS[:3], [[0, 1, 2]]), "3 vertices"),
        (lambda: Mesh(CORNERS, [[0, 1, 4]]), "index 4 is out of range"),
        (lambda: Mesh(CORNERS, [[0, 1, -1]]), "out of range"),
        (lambda: Mesh(CORNERS, [[0, 1]]), "faces of shape"),
        (lambda: Mesh(CORNERS, [[0, 1, 1.5]]), "not a whole number"),
        (lambda: Mesh(CORNERS, [[0, 1, np.nan]]), "not a whole number"),
        (lambda: Mesh(CORNERS, [[0, 1, 2**40]]), "too large"),
        (lambda: Mesh(CORNERS, [[0, 1, "x"]]), "not an array of numbers"),
        (lambda: Mesh(CORNERS, np.zeros((0, 3), int)), "faces of shape"),
        (lambda: Mesh([*CORNERS, [np.nan, 0, 0]], [[0, 1, 2]]), "is nan"),
        (lambda: PointCloud(np.zeros((0, 3))), "no points"),
        (lambda: PointCloud([[0, 0]]), "shape"),
        (lambda: PointCloud([[0, 0, 0]], 0.0), "resolution"),
    ],
)
def test_shapes_that_cannot_be_are_refused(make: Callable[[], Shape], message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()


def test_equal_measures_are_equal_shapes() -> None:
    assert Box((1, 2, 3)) == Box((1.0, 2.0, 3.0))
    assert Sphere(1) != Sphere(2)
    assert len({Cylinder(1, 2), Cylinder(1.0, 2.0), Capsule(1, 2)}) == 2


def test_a_half_space_has_a_unit_normal_and_keeps_it_to_the_last_bit() -> None:
    once = HalfSpace((0.1, 0.2, 5.0), 2)
    assert np.isclose(np.linalg.norm(once.normal), 1.0)
    assert HalfSpace(once.normal, once.offset) == once


@pytest.mark.parametrize("shape", [Mesh(CORNERS, [[0, 1, 2]], convex=True), PointCloud([[1, 2, 3]])])
def test_arrays_stay_read_only_through_pickling(shape: Mesh | PointCloud) -> None:
    again = pickle.loads(pickle.dumps(shape))
    for one in (shape, again):
        array = one.vertices if isinstance(one, Mesh) else one.points
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 9.0


def test_a_mesh_does_not_change_with_the_arrays_it_was_made_from() -> None:
    vertices = np.array(CORNERS)
    mesh = Mesh(vertices, np.array([[0, 1, 2]]))
    vertices[0, 0] = 7.0
    assert mesh.vertices[0, 0] == 0.0


def test_a_cloud_says_how_many_points_it_has():
    assert repr(PointCloud([[0, 0, 0]])).startswith("PointCloud(1 point, ")
    assert repr(PointCloud([[0, 0, 0], [1, 0, 0]])).startswith("PointCloud(2 points, ")
