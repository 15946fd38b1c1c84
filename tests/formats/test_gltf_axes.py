"""Robots whose glTF meshes have z up, contrary to the format: detected by their other shapes and masses."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from rr1plan.robot.urdf import read_urdf

# A link that is long upward, and the other link beside it.
SIZE, CENTER = np.array([0.05, 0.1, 0.4]), np.array([0.01, 0.02, 0.2])
WRITTEN_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
MESH = '<geometry><mesh filename="link.glb" scale="{}"/></geometry>'
ORIGIN = f'<origin xyz="{CENTER[0]} {CENTER[1]} {CENTER[2]}"/>'
BOX = f'{ORIGIN}<geometry><box size="{SIZE[0]} {SIZE[1]} {SIZE[2]}"/></geometry>'
MASS = (
    f'<inertial>{ORIGIN}<mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'
)


@pytest.fixture
def robot(tmp_path: Path) -> Callable[..., Path]:
    """Writes a robot of one link and its mesh, z up or y up, smaller by a scale of the file."""

    def write(
        visual: str, collision: str, inertial: str = "", *, z_up: bool, scale: tuple[float, ...] = (1, 1, 1)
    ) -> Path:
        block = trimesh.creation.box(SIZE)
        corners = block.vertices + CENTER
        # The scale applies to the axes of the link.
        block.vertices = corners / scale if z_up else (corners / scale) @ WRITTEN_Y_UP.T
        block.export(tmp_path / "link.glb")
        shapes = "".join(
            f"<{tag}>{shape.format(' '.join(map(str, scale)))}</{tag}>"
            for tag, shape in (("visual", visual), ("collision", collision))
            if shape
        )
        file = tmp_path / "robot.urdf"
        file.write_text(f'<robot name="one"><link name="link">{inertial}{shapes}</link></robot>')
        return file

    return write


@pytest.mark.parametrize("z_up", [True, False], ids=["z_up", "y_up"])
@pytest.mark.parametrize("scale", [(1, 1, 1), (0.001, 0.002, 0.005)], ids=["of_one", "of_each_axis"])
@pytest.mark.parametrize(
    "shapes", [(MESH, BOX, ""), (BOX, MESH, ""), (MESH, MESH, MASS)], ids=["visual", "collision", "both_and_a_mass"]
)
def test_meshes_are_taken_as_the_rest_of_the_robot_fits(
    robot: Callable[..., Path],
    caplog: pytest.LogCaptureFixture,
    shapes: tuple[str, str, str],
    scale: tuple[float, ...],
    z_up: bool,
) -> None:
    (link,) = read_urdf(robot(*shapes, z_up=z_up, scale=scale)).links
    geometries = [g for g in (*link.visuals, *link.collisions) if hasattr(g.shape, "vertices")]
    assert geometries
    for geometry in geometries:
        vertices = geometry.shape.vertices
        np.testing.assert_allclose(vertices.min(axis=0), CENTER - SIZE / 2, atol=1e-6)
        np.testing.assert_allclose(vertices.max(axis=0), CENTER + SIZE / 2, atol=1e-6)
        corners = vertices[geometry.shape.faces]
        volume = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
        assert volume == pytest.approx(np.prod(SIZE), rel=1e-5)
    assert ("written with z up" in caplog.text) == z_up


def test_a_mesh_alone_has_y_up_as_the_format_says(robot: Callable[..., Path], caplog: pytest.LogCaptureFixture) -> None:
    (link,) = read_urdf(robot(MESH, MESH, z_up=True)).links
    low, high = np.min(link.visuals[0].shape.vertices, axis=0), np.max(link.visuals[0].shape.vertices, axis=0)
    np.testing.assert_allclose(high - low, [0.05, 0.4, 0.1], atol=1e-6)
    assert not caplog.text
