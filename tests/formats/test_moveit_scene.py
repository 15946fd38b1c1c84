"""MoveIt's `.scene` text in both its forms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rr1plan.errors import FormatError
from rr1plan.scene import Scene
from rr1plan.scene.moveit_scene import cone, read_moveit_scene
from rr1plan.shapes import Box, Cylinder, HalfSpace, Mesh, Sphere
from rr1plan.transforms import pose

HALF = 0.7071067811865476
NEWER = f"""my scene
* first box
1 2 3
0 0 {HALF} {HALF}
2
box
0.1 0.2 0.3
0 0 1
0 0 0 1
1 0.5 0 1
cylinder
0.05 0.4
0 0 0
{HALF} 0 0 {HALF}
0 0 0 0
1
grip
0 0 0.1
0 0 0 1
* plane
0 0 0
0 0 0 1
1
plane
0 0 2 -1
0 0 0
0 0 0 1
0 0 0 0
0
.
"""
OLDER = f"""old scene
* box
1
box
0.1 0.2 0.3
1 2 3
0 0 {HALF} {HALF}
0 0 0 0
* ball
2
sphere
0.25
0 0 0
0 0 0 1
0 0 0 0
cone
0.1
0.3
0 0 5
0 0 0 1
0 0 0 0
.
"""


def read(tmp_path: Path, text: str) -> Scene:
    (tmp_path / "a.scene").write_text(text)
    return read_moveit_scene(tmp_path / "a.scene")


def test_the_newer_form_has_object_poses_and_subframes(tmp_path: Path) -> None:
    scene = read(tmp_path, NEWER)
    assert scene.name == "my scene"
    thing = scene.obstacles["first box"]
    box, rod = thing.geometries
    assert (box.shape, rod.shape) == (Box((0.1, 0.2, 0.3)), Cylinder(radius=0.05, length=0.4))
    assert (box.color, rod.color) == ((1.0, 0.5, 0.0, 1.0), None)
    assert np.allclose(thing.pose, pose((1, 2, 3), rpy=(0, 0, np.pi / 2)))
    assert np.allclose(rod.pose, pose(rpy=(np.pi / 2, 0, 0)))
    assert scene.obstacles["plane"].geometries[0].shape == HalfSpace((0, 0, 1), 0.5)


def test_the_older_form_poses_its_shapes_in_the_world(tmp_path: Path) -> None:
    scene = read(tmp_path, OLDER)
    assert list(scene.obstacles) == ["box", "ball"]
    box = scene.obstacles["box"]
    assert np.allclose(box.pose @ box.geometries[0].pose, pose((1, 2, 3), rpy=(0, 0, np.pi / 2)))
    assert scene.obstacles["ball"].geometries[0].shape == Sphere(0.25)


def test_a_cone_is_taken_as_a_convex_mesh_around_it() -> None:
    mesh = cone(0.1, 0.3)
    assert mesh.convex
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    for angle in np.linspace(0, 2 * np.pi, 50):
        rim = np.array([0.1 * np.cos(angle), 0.1 * np.sin(angle), -0.15])
        assert (np.einsum("ij,ij->i", normals, rim - a) <= 1e-12).all()
    assert mesh.vertices[:, 2].max() == 0.15


def test_a_mesh_is_read_with_its_triangles(tmp_path: Path) -> None:
    corners = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
    text = f"s\n* m\n1\nmesh\n4 4\n{corners}0 2 1\n0 1 3\n0 3 2\n1 2 3\n0 0 0\n0 0 0 1\n0 0 0 0\n.\n"
    (shape,) = (g.shape for g in read(tmp_path, text).obstacles["m"].geometries)
    assert isinstance(shape, Mesh)
    assert shape.faces.tolist() == [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    assert shape.vertices[1].tolist() == [1.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("box\n0.1 0.2 0.3", "box\n0.1 0.2 -0.3", "object 'first box': box size is -0.3"),
        ("box\n0.1 0.2 0.3", "box\n0.1 0.2 nan", r"a\.scene:7: expected a finite number"),
        ("box\n0.1 0.2 0.3", "box\n0.1 0.2 x", r"a\.scene:7: expected a number, got 'x'"),
        ("box\n0.1", "bax\n0.1", r"a\.scene:6: unknown type of shape 'bax', expected one of box"),
        ("0 0 0 1\n1 0.5 0 1", "0 0 0 0\n1 0.5 0 1", "norm 0"),
        ("\n2\nbox", "\n2.5\nbox", "expected a count, got 2.5"),
        ("\n2\nbox", "\n99999999999\nbox", "expected a count"),
        ("* plane", "plane", r"expected '\*' before an object or '\.' at the end, got 'plane'"),
        ("* plane", "* first box", "two objects named 'first box'"),
        ("* plane", "* a/b", "cannot name an element"),
        ("0\n.\n", "", "ends too early"),
    ],
)
def test_wrong_text_is_refused_with_its_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in NEWER
    with pytest.raises(FormatError, match=message):
        read(tmp_path, NEWER.replace(old, new, 1))
    with pytest.raises(FormatError, match="ends too early"):
        read(tmp_path, "")
