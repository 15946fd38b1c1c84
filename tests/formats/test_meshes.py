"""Mesh files: found only in permitted folders, read by content, rejected if they are not meshes."""

from __future__ import annotations

import base64
import json
import os
import re
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from rr1plan.errors import FormatError
from rr1plan.robot.mesh_lookup import MeshLookup
from rr1plan.robot.urdf import read_urdf
from rr1plan.scene.model_library import load_scene
from rr1plan.shapes import Mesh, mesh_files
from rr1plan.shapes.mesh_files import load_mesh, read_mesh
from rr1plan.transforms import pose


def binary_stl(mesh: Mesh, count: int | None = None) -> bytes:
    triangles = mesh.vertices[mesh.faces].astype("<f4")
    rows = b"".join(struct.pack("<3f", 0, 0, 1) + t.tobytes() + b"\0\0" for t in triangles)
    return b"\0" * 80 + struct.pack("<I", len(triangles) if count is None else count) + rows


def ascii_stl(mesh: Mesh) -> bytes:
    lines = ["solid s"]
    for triangle in mesh.vertices[mesh.faces]:
        lines += ["facet normal 0 0 1", "outer loop"]
        lines += [f"vertex {x!r} {y!r} {z!r}" for x, y, z in triangle.tolist()]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid s", ""]).encode()


def obj(mesh: Mesh, head: str = "") -> bytes:
    lines = [head] + ["v " + " ".join(map(repr, v)) for v in mesh.vertices.tolist()]
    lines += ["f " + " ".join(str(i + 1) for i in f) for f in mesh.faces.tolist()]
    return "\n".join([*lines, ""]).encode()


def dae(
    mesh: Mesh, unit: str = "1", up: str = "Z_UP", matrix: str = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1", head: str = ""
) -> bytes:
    floats = " ".join(map(repr, mesh.vertices.ravel().tolist()))
    n = len(mesh.vertices)
    indices = " ".join(map(str, mesh.faces.ravel().tolist()))
    diffuse = "<diffuse><color>1 0.2 0 1</color></diffuse>"
    axes = "".join(f'<param name="{axis}" type="float"/>' for axis in "XYZ")
    return f"""<?xml version="1.0"?>{head}
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><created>2020-01-01T00:00:00</created><modified>2020-01-01T00:00:00</modified>
<unit name="u" meter="{unit}"/><up_axis>{up}</up_axis></asset>
<library_effects><effect id="e"><profile_COMMON><technique sid="common">
<phong>{diffuse}</phong></technique></profile_COMMON></effect></library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
<library_geometries><geometry id="g"><mesh><source id="p"><float_array id="pa" count="{3 * n}">{floats}</float_array>
<technique_common><accessor source="#pa" count="{n}" stride="3">{axes}</accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="{len(mesh.faces)}" material="ms">
<input semantic="VERTEX" source="#v" offset="0"/><p>{indices}</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n"><matrix>{matrix}</matrix><instance_geometry url="#g">
<bind_material><technique_common><instance_material symbol="ms" target="#m"/></technique_common></bind_material>
</instance_geometry></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>""".encode()


def ply(mesh: Mesh, encoding: str) -> bytes:
    made = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    return bytes(made.export(file_type="ply", encoding=encoding))


def ply_head(coding: str, vertices: int, faces: int) -> bytes:
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    lists = "property list uchar int vertex_indices\nend_header\n"
    return f"ply\nformat {coding} 1.0\nelement vertex {vertices}\n{axes}element face {faces}\n{lists}".encode()


WRITERS = {
    "binary.stl": binary_stl,
    "ascii.stl": ascii_stl,
    "a.obj": obj,
    "a.dae": dae,
    "UPPER.STL": binary_stl,
    "binary.ply": lambda mesh: ply(mesh, "binary"),
    "ascii.ply": lambda mesh: ply(mesh, "ascii"),
    "other name.ply": lambda mesh: ply(mesh, "ascii").replace(b" vertex_indices\n", b" corners\n"),
}


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_gives_the_same_mesh(tmp_path: Path, block: Mesh, name: str) -> None:
    (tmp_path / name).write_bytes(WRITERS[name](block))
    (part,) = read_mesh(tmp_path / name, (1.0, 0.5, 2.0))
    assert len(part.mesh.vertices) == 8
    assert len(part.mesh.faces) == 12
    expected = {tuple(v) for v in (block.vertices * (1.0, 0.5, 2.0)).tolist()}
    assert {tuple(v) for v in part.mesh.vertices.tolist()} == expected
    corners = part.mesh.vertices[part.mesh.faces]
    volume = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    assert volume == pytest.approx(6.0)


@pytest.mark.parametrize("head", [b"", b"solid as in ASCII"])
def test_a_binary_stl_is_read_as_trimesh_reads_it(tmp_path: Path, head: bytes) -> None:
    rng = np.random.default_rng(0)
    data = binary_stl(Mesh(rng.normal(size=(40, 3)), rng.permuted(np.tile(np.arange(40), (70, 1)), axis=1)[:, :3]))
    (tmp_path / "a.stl").write_bytes(head + data[len(head) :])
    (part,) = read_mesh(tmp_path / "a.stl")
    other = trimesh.load_mesh(tmp_path / "a.stl", process=False)
    np.testing.assert_array_equal(part.mesh.vertices[part.mesh.faces], other.vertices[other.faces])


def test_a_binary_stl_needs_no_library_of_meshes(tmp_path: Path, block: Mesh) -> None:
    (tmp_path / "a.stl").write_bytes(binary_stl(block))
    code = f"""
import sys
from rr1plan.shapes.mesh_files import read_mesh
read_mesh({str(tmp_path / "a.stl")!r})
print("trimesh" in sys.modules)
"""
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "False"


def test_a_dae_brings_its_color_its_unit_and_its_nodes_place(tmp_path: Path, block: Mesh) -> None:
    file = tmp_path / "a.dae"
    file.write_bytes(dae(block, unit="0.001", matrix="1 0 0 500 0 1 0 0 0 0 1 0 0 0 0 1"))
    (part,) = read_mesh(file)
    assert np.allclose(part.mesh.vertices.min(axis=0), [0.5, 0, 0])
    assert np.allclose(part.mesh.vertices.max(axis=0), [0.501, 0.002, 0.003])
    assert part.color is not None
    assert np.allclose(part.color, [1, 0.2, 0, 1], atol=0.01)


def test_the_up_axis_of_a_dae_is_ignored_as_other_readers_do(tmp_path: Path, block: Mesh) -> None:
    (tmp_path / "y.dae").write_bytes(dae(block, up="Y_UP"))
    (part,) = read_mesh(tmp_path / "y.dae")
    assert part.mesh.vertices.max(axis=0).tolist() == [1, 2, 3]


def test_nothing_but_the_file_is_opened(tmp_path: Path, block: Mesh) -> None:
    (tmp_path / "secret.mtl").write_text("newmtl m\nKd 1 0 0\nmap_Kd /etc/hostname\n")
    (tmp_path / "a.obj").write_bytes(obj(block, "mtllib secret.mtl\nmtllib http://localhost:9/x.mtl\nusemtl m"))
    (part,) = read_mesh(tmp_path / "a.obj")
    assert part.color is None


NAN_TRIANGLE = b"v 0 0 0\nv 1 0 0\nv 0 nan 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n"

BAD = {
    "empty.stl": b"",
    "short.stl": b"\0" * 50,
    "no_triangle.stl": b"\0" * 84,
    "words.stl": b"solid s\nfacet normal a b c\nouter loop\nvertex x y z\nendloop\nendfacet\nendsolid\n",
    "empty.obj": b"",
    "points.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n",
    "nan.obj": NAN_TRIANGLE,
    "triangle.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    "index.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 9\n",
    "empty.ply": b"",
    "huge.ply": ply_head("ascii", 99999999999, 1),
    "huge_binary.ply": ply_head("binary_little_endian", 99999999999, 99999999999) + b"\0\0",
    "points.ply": ply_head("ascii", 1, 0) + b"0 0 0\n",
    "empty.dae": b"",
    "other.dae": b"<html/>",
    "cut.dae": b"<COLLADA><asset>",
    "mesh.stp": b"x",
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_mesh_is_a_format_error_with_the_files_name(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(BAD[name])
    with pytest.raises(FormatError, match=re.escape(name)):
        read_mesh(tmp_path / name)


def test_relative_indices_of_an_obj_count_back_from_their_line(tmp_path: Path, block: Mesh) -> None:
    faces = "".join(f"f {a}/1/2 {b} {c}//-1\n" for a, b, c in (block.faces - 8).tolist())
    first = "".join(f"v {x} {y} {z}\n" for x, y, z in block.vertices.tolist())
    second = "".join(f"v {x + 5.0} {y} {z}\n" for x, y, z in block.vertices.tolist())
    (tmp_path / "a.obj").write_text(first + faces + second + faces)
    (part,) = read_mesh(tmp_path / "a.obj")
    assert len(part.mesh.vertices) == 16
    assert trimesh.Trimesh(part.mesh.vertices, part.mesh.faces).volume == pytest.approx(12.0)


@pytest.mark.parametrize("number", [1, 3, 12])
@pytest.mark.parametrize(("plain", "written"), [("f ", "  f "), ("f ", "f\t"), ("v ", "\tv "), ("v ", "v\t")])
def test_tabs_and_indentation_of_an_obj_do_not_matter(
    tmp_path: Path, block: Mesh, plain: str, written: str, number: int
) -> None:
    (tmp_path / "a.obj").write_text(obj(block).decode().replace(plain, written, number))
    (part,) = read_mesh(tmp_path / "a.obj")
    assert len(part.mesh.faces) == 12
    assert trimesh.Trimesh(part.mesh.vertices, part.mesh.faces).volume == pytest.approx(6.0)


@pytest.mark.parametrize(
    ("plain", "written"),
    [(b"\n", b"\r"), (b"\n", b"\r\n"), (b"\n", b" # 1 -2 0\n"), (b"\n", b"# a corner\n"), (b"v", b"\xef\xbb\xbfv")],
)
def test_line_ends_comments_and_byte_order_marks_of_an_obj_do_not_matter(
    tmp_path: Path, block: Mesh, plain: bytes, written: bytes
) -> None:
    text = obj(block).lstrip()
    (tmp_path / "a.obj").write_bytes(text.replace(plain, written, 1 if plain == b"v" else -1))
    (part,) = read_mesh(tmp_path / "a.obj")
    assert len(part.mesh.vertices) == 8
    assert len(part.mesh.faces) == 12


@pytest.mark.parametrize("face", ["f 0 1 2", "f 2 1 0", "  f 1/1/1 0//3 2", "f 1 2 \\\n 0", "f 00 1 2", "f -1 -2 -9"])
def test_an_obj_with_an_index_that_no_vertex_has_is_refused(tmp_path: Path, block: Mesh, face: str) -> None:
    (tmp_path / "a.obj").write_bytes(obj(block) + face.encode() + b"\n")
    with pytest.raises(
        FormatError, match=r"a\.obj: has a face with the vertex (0, but OBJ counts .* from 1|-9, but .* 8)"
    ):
        read_mesh(tmp_path / "a.obj")


SQUARE_WITH_HOLE = [(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 3), (3, 3), (3, 1), (1, 1)]


@pytest.mark.parametrize(
    ("outline", "area"),
    [
        ([(0, 0), (3, 0), (3, 1), (1, 1), (1, 3), (0, 3)], 5.0),
        ([(0, 0), (1.5, 0), (3, 0), (3, 3), (2, 3), (2, 1), (1.5, 1), (1, 1), (1, 3), (0, 3)], 7.0),
        (SQUARE_WITH_HOLE, 12.0),
        ([(0, 0), (2, 0), (0.5, 0.5), (0, 2)], 1.0),
    ],
)
@pytest.mark.parametrize("turn", [0.0, 2.0])
def test_concave_faces_of_an_obj_do_not_cover_their_notches(
    tmp_path: Path, outline: list[tuple[float, float]], area: float, turn: float
) -> None:
    rotation = pose([0.0, 0.0, 0.0], rpy=[turn, 0.7 * turn, 0.3 * turn])[:3, :3]
    count = len(outline)
    for first in range(count):
        corners = np.roll(np.array(outline), first, axis=0)
        points = np.concatenate([np.column_stack([corners, np.full(count, z)]) for z in (0.0, 2.0)]) @ rotation.T
        sides = [[i, (i + 1) % count, count + (i + 1) % count, count + i] for i in range(count)]
        faces = [range(count)[::-1], range(count, 2 * count), *sides]
        lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in points.tolist()]
        lines += ["f " + " ".join(f"{i + 1}//1" for i in face) for face in faces]
        (tmp_path / "a.obj").write_text("\n".join(lines))
        mesh = load_mesh(tmp_path / "a.obj")
        a, b, c = mesh.vertices[mesh.faces].swapaxes(0, 1)
        assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0 == pytest.approx(2.0 * area)
        edges = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1)
        surface = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0
        assert surface == pytest.approx(2.0 * area + 2.0 * edges.sum())


def ply_of_faces(coding: str, vertices: np.ndarray, faces: list[list[int]]) -> bytes:
    """A PLY with colors of the faces before their corners, and a list after them."""
    head = f"ply\nformat {coding} 1.0\nelement vertex {len(vertices)}\n"
    head += "".join(f"property double {axis}\n" for axis in "xyz") + f"element face {len(faces)}\n"
    head += "".join(f"property uchar {color}\n" for color in ("red", "green", "blue"))
    head += "property list uchar int vertex_indices\nproperty list uchar float texcoord\nend_header\n"
    if coding == "ascii":
        lines = [f"{x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
        lines += [f"255 0 51 {len(face)} {' '.join(map(str, face))} 2 0.5 0.5" for face in faces]
        return (head + "\n".join(lines)).encode()
    order = "<" if "little" in coding else ">"
    rows = [struct.pack(f"{order}4B{len(f)}iB2f", 255, 0, 51, len(f), *f, 2, 0.5, 0.5) for f in faces]
    return head.encode() + vertices.astype(order + "f8").tobytes() + b"".join(rows)


@pytest.mark.parametrize("coding", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_a_ply_may_have_faces_of_any_number_of_corners(tmp_path: Path, coding: str) -> None:
    outline = np.array([(0, 0), (3, 0), (3, 1), (1, 1), (1, 3), (0, 3)])
    corners = [[*corner, z] for z in (0.0, 2.0) for corner in outline.tolist()]
    sides = [[i, (i + 1) % 6, 6 + (i + 1) % 6, 6 + i] for i in range(5)]
    faces = [[1, 0, 5, 4, 3, 2], *sides, [5, 0, 6], [5, 6, 11], [8, 9, 10, 11, 6, 7]]
    (tmp_path / "a.ply").write_bytes(ply_of_faces(coding, np.array(corners), faces))
    (part,) = read_mesh(tmp_path / "a.ply")
    assert part.color == pytest.approx((1.0, 0.0, 0.2, 1.0))
    a, b, c = part.mesh.vertices[part.mesh.faces].swapaxes(0, 1)
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0 == pytest.approx(10.0)
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0 == pytest.approx(2.0 * 5.0 + 2.0 * 12.0)


@pytest.mark.parametrize("form", ["polylist", "polygons"])
def test_concave_polygons_of_a_dae_do_not_cover_their_notches(tmp_path: Path, block: Mesh, form: str) -> None:
    outline = np.array([(0, 0), (3, 0), (3, 1), (1, 1), (1, 3), (0, 3)])
    corners = np.array([[*corner, z] for z in (0.0, 2.0) for corner in outline.tolist()])
    sides = [[i, (i + 1) % 6, 6 + (i + 1) % 6, 6 + i] for i in range(6)]
    faces = [[1, 0, 5, 4, 3, 2], *sides, [8, 9, 10, 11, 6, 7]]
    rows = [" ".join(f"7 {i}" for i in face) for face in faces]  # the vertices have the second offset
    if form == "polylist":
        lists = f"<vcount>{' '.join(str(len(face)) for face in faces)}</vcount><p>{' '.join(rows)}</p>"
    else:
        lists = "".join(f"<p>{row}</p>" for row in rows)
    text = dae(Mesh(corners, block.faces)).decode()
    head, rest = text.split("<triangles")
    inputs = '<input semantic="NORMAL" source="#p" offset="0"/><input semantic="VERTEX" source="#v" offset="1"/>'
    polygons = f'<{form} count="{len(faces)}" material="ms">{inputs}{lists}</{form}>'
    (tmp_path / "a.dae").write_text(head + polygons + rest.split("</triangles>")[1])
    (part,) = read_mesh(tmp_path / "a.dae")
    assert part.color == pytest.approx((1.0, 0.2, 0.0, 1.0))
    a, b, c = part.mesh.vertices[part.mesh.faces].swapaxes(0, 1)
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0 == pytest.approx(10.0)
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0 == pytest.approx(2.0 * 5.0 + 2.0 * 12.0)


def test_faces_of_an_obj_that_cross_themselves_are_triangulated(tmp_path: Path) -> None:
    head = "v 0 0 0\nv 1 1 0\nv 1 0 0\nv 0 1 0\nv 3 1 0\n"
    for face in ("1 2 3 4", "1 2 3 4 5", "1 3 2 2 4", "5 3 1 2 4"):
        (tmp_path / "a.obj").write_text(head + f"f {face}\n")
        assert len(load_mesh(tmp_path / "a.obj").faces) >= 1


@pytest.mark.parametrize("coding", ["ascii", "binary"])
def test_a_comment_of_a_ply_in_any_encoding_does_not_matter(tmp_path: Path, block: Mesh, coding: str) -> None:
    head, body = ply(block, coding).split(b"element vertex")
    (tmp_path / "a.ply").write_bytes(head + "comment Größe\nelement vertex".encode("latin-1") + body)
    (part,) = read_mesh(tmp_path / "a.ply")
    assert len(part.mesh.faces) == 12


@pytest.mark.parametrize("corner", [-1, 8])
def test_a_ply_with_an_index_that_no_vertex_has_is_refused(tmp_path: Path, block: Mesh, corner: int) -> None:
    faces = block.faces.copy()
    faces[2, 1] = corner
    file = tmp_path / "a.ply"
    trimesh.Trimesh(block.vertices, faces, process=False).export(file, encoding="ascii")
    with pytest.raises(FormatError, match=f"a triangle with the corner {corner}, but 8 vertices"):
        load_mesh(file)


@pytest.mark.parametrize("cut", [4, 20])
def test_a_ply_in_text_that_was_cut_off_is_refused(tmp_path: Path, block: Mesh, cut: int) -> None:
    """Within a line, or after one."""
    (tmp_path / "cut.ply").write_bytes(ply(block, "ascii").rstrip()[:-cut])
    with pytest.raises(FormatError, match=r"cut\.ply: was cut off: it has fewer faces than its header says"):
        read_mesh(tmp_path / "cut.ply")


def test_a_cut_stl_is_refused(tmp_path: Path, block: Mesh) -> None:
    (tmp_path / "cut.stl").write_bytes(binary_stl(block)[:-70])
    with pytest.raises(FormatError, match=r"cut\.stl: .*of 12 triangles, .* has 684 bytes, but it has 614"):
        read_mesh(tmp_path / "cut.stl")
    (tmp_path / "ascii.stl").write_bytes(ascii_stl(block)[:-40])
    with pytest.raises(FormatError, match=r"ascii\.stl: has no triangle: it was cut off, .* ends with 'endsolid'"):
        read_mesh(tmp_path / "ascii.stl")


@pytest.mark.parametrize("name", WRITERS)
def test_a_damaged_mesh_is_read_or_refused_and_nothing_else(tmp_path: Path, block: Mesh, name: str) -> None:
    rng = np.random.default_rng(0)
    whole = WRITERS[name](block)
    refused = 0
    for _ in range(60):
        data = bytearray(whole)
        for place in rng.integers(len(data) - 40, size=rng.integers(1, 5)):
            data[place : place + int(rng.integers(0, 20))] = rng.bytes(int(rng.integers(0, 8)))
        (tmp_path / name).write_bytes(bytes(data))
        try:
            parts = read_mesh(tmp_path / name)
        except FormatError:
            refused += 1
        else:
            assert all(np.isfinite(part.mesh.vertices).all() for part in parts)
    assert refused > 0


@pytest.mark.parametrize("unit", ["0", "-1", "nan", "inf", "inch"])
def test_an_impossible_unit_is_refused(tmp_path: Path, block: Mesh, unit: str) -> None:
    (tmp_path / "a.dae").write_bytes(dae(block, unit=unit))
    with pytest.raises(FormatError, match="unit"):
        read_mesh(tmp_path / "a.dae")


def test_entities_in_a_dae_are_refused(tmp_path: Path, block: Mesh) -> None:
    (tmp_path / "a.dae").write_bytes(dae(block, head='<!DOCTYPE x [<!ENTITY a "b">]>'))
    with pytest.raises(FormatError, match="DOCTYPE"):
        read_mesh(tmp_path / "a.dae")


def test_too_many_triangles_or_bytes_are_refused(tmp_path: Path, block: Mesh, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.stl").write_bytes(binary_stl(block))
    monkeypatch.setattr(mesh_files, "MAX_FACES", 11)
    with pytest.raises(FormatError, match="12 triangles, expected at most 11"):
        read_mesh(tmp_path / "a.stl")
    monkeypatch.setattr(mesh_files, "MAX_BYTES", 100)
    with pytest.raises(FormatError, match="larger"):
        read_mesh(tmp_path / "a.stl")


def test_a_mesh_that_is_not_there_is_a_format_error(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="no such file"):
        read_mesh(tmp_path / "none.stl")


# ---- where meshes may be -----------------------------------------------------------------


@pytest.fixture
def package(tmp_path: Path, block: Mesh) -> Path:
    """ws/pkg/{package.xml, urdf/r.urdf, meshes/a.stl} and, outside, ws/../outside.stl."""
    root = tmp_path / "deep" / "ws" / "pkg"
    (root / "urdf").mkdir(parents=True)
    (root / "meshes").mkdir()
    (root / "package.xml").write_text("<package/>")
    (root / "urdf" / "r.urdf").write_text("<robot/>")
    (root / "meshes" / "a.stl").write_bytes(binary_stl(block))
    (root / "urdf" / "b.stl").write_bytes(binary_stl(block))
    return root


@pytest.mark.parametrize("name", ["package://pkg/meshes/a.stl", "package://meshes/a.stl", "../meshes/a.stl", "b.stl"])
def test_meshes_are_found_around_the_urdf_without_options(package: Path, name: str) -> None:
    found = MeshLookup((), package / "urdf" / "r.urdf").find(name)
    assert found.resolve().parent in (package / "meshes", package / "urdf")


def test_absolute_and_file_names_work_inside_the_folders(package: Path) -> None:
    lookup = MeshLookup((), package / "urdf" / "r.urdf")
    mesh = package / "meshes" / "a.stl"
    assert lookup.find(str(mesh)).samefile(mesh)
    assert lookup.find(f"file://{mesh}").samefile(mesh)


def test_percent_signs_of_uris_are_decoded(package: Path) -> None:
    """As by ROS, in which a space in a URI is an error; a plain name is taken as it is."""
    spaced = (package / "meshes" / "a.stl").rename(package / "meshes" / "a b.stl")
    lookup = MeshLookup((), package / "urdf" / "r.urdf")
    for name in (
        "package://pkg/meshes/a%20b.stl",
        "package://pkg/meshes/a b.stl",
        f"file://{package}/meshes/a%20b.stl",
    ):
        assert lookup.find(name).samefile(spaced)
    for name in ("../meshes/a%20b.stl", "package://pkg/%2e%2e/a%20b.stl", "package://pkg/meshes/a%00.stl"):
        with pytest.raises(FormatError):
            lookup.find(name)


def test_given_folders_and_ros_package_path_are_searched(
    package: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    name = "package://pkg/meshes/a.stl"
    assert MeshLookup([package], elsewhere / "r.urdf").find(name).is_file()
    assert MeshLookup([package.parent], None).find(name).is_file()
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(package.parent))
    assert MeshLookup((), elsewhere / "r.urdf").find(name).is_file()
    monkeypatch.delenv("ROS_PACKAGE_PATH")
    (elsewhere / "install" / "share").mkdir(parents=True)
    package.rename(elsewhere / "install" / "share" / "pkg")
    monkeypatch.setenv("AMENT_PREFIX_PATH", os.pathsep.join([str(tmp_path / "none"), str(elsewhere / "install")]))
    assert MeshLookup((), tmp_path / "urdf" / "r.urdf").find(name).is_file()


def test_a_package_has_the_name_in_its_package_xml_too(
    package: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A download of a repository often has another name than the package in it."""
    names = "<package><!-- <name>pkg</name> --><description><name/></description><name>\n arm </name></package>"
    (package / "package.xml").write_text(names.replace("<description><name/></description>", ""))
    name, found = "package://arm/meshes/a.stl", package / "meshes" / "a.stl"
    assert MeshLookup((), package / "urdf" / "r.urdf").find(name).samefile(found)
    hand = package.parent / "hand-main" / "urdf"
    hand.mkdir(parents=True)
    (hand.parent / "package.xml").write_text("<package><name>hand</name></package>")
    assert MeshLookup((), hand / "r.urdf").find(name).samefile(found)
    assert MeshLookup([package.parent], None).find(name).samefile(found)
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(package.parent))
    assert MeshLookup((), tmp_path / "r.urdf").find(name).samefile(found)
    for text in ("<package>", '<!DOCTYPE a [<!ENTITY b "arm">]><package><name>&b;</name></package>', names):
        (package / "package.xml").write_text(text)
        with pytest.raises(FormatError, match="is not there"):
            MeshLookup((), hand / "r.urdf").find(name)


def test_a_backslash_between_folders_is_named(package: Path) -> None:
    with pytest.raises(FormatError, match="a slash separates folders, not a backslash"):
        MeshLookup((), package / "urdf" / "r.urdf").find("..\\meshes\\gone.stl")


def test_the_error_lists_every_place_that_was_tried(package: Path, tmp_path: Path) -> None:
    given = tmp_path / "given"
    with pytest.raises(FormatError) as caught:
        MeshLookup([given], package / "urdf" / "r.urdf").find("package://pkg/meshes/none.stl")
    for place in (given / "pkg" / "meshes" / "none.stl", package / "meshes" / "none.stl"):
        assert str(place) in str(caught.value)
    assert "package_dirs" in str(caught.value)


def test_the_error_names_a_file_in_other_case(package: Path, tmp_path: Path, block: Mesh) -> None:
    (tmp_path / "deep" / "ws" / "A.STL").write_bytes(binary_stl(block))
    with pytest.raises(FormatError, match=r"'../meshes/A\.STL' is not there; .*meshes/a\.stl: upper and lower case"):
        MeshLookup((), package / "urdf" / "r.urdf").find("../meshes/A.STL")
    (package / "meshes" / "a.stl").unlink()
    with pytest.raises(FormatError, match="name the folder"):
        MeshLookup((), package / "urdf" / "r.urdf").find("../meshes/A.STL")


@pytest.mark.parametrize(
    ("name", "word"),
    [
        ("package://pkg/../../outside.stl", "leads out"),
        ("http://localhost/a.stl", "scheme"),
        ("file:///etc/passwd", "suffix"),
        ("/etc/hostname", "suffix"),
        ("a.step", "suffix"),
        ("a\0.stl", "file name"),
        ("package://pkg", "suffix"),
    ],
)
def test_a_name_that_may_not_be_is_refused(package: Path, name: str, word: str) -> None:
    with pytest.raises(FormatError, match=word):
        MeshLookup((), package / "urdf" / "r.urdf").find(name)


def test_a_mesh_outside_the_folders_is_refused_by_any_way(package: Path, tmp_path: Path, block: Mesh) -> None:
    outside = tmp_path / "outside.stl"
    outside.write_bytes(binary_stl(block))
    lookup = MeshLookup([package], None)
    (package / "meshes" / "link.stl").symlink_to(outside)
    for name in (str(outside), f"file://{outside}", "meshes/../../../../outside.stl", "package://pkg/meshes/link.stl"):
        with pytest.raises(FormatError, match="outside the robot's folders"):
            lookup.find(name)


def test_above_the_folder_of_the_package_nothing_is_taken(package: Path, tmp_path: Path, block: Mesh) -> None:
    (package.parent.parent / "near.stl").write_bytes(binary_stl(block))
    with pytest.raises(FormatError, match="outside the robot's folders"):
        MeshLookup((), package / "urdf" / "r.urdf").find("../../../near.stl")


def test_the_home_folder_is_not_searched(tmp_path: Path, block: Mesh, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "robot").mkdir()
    (tmp_path / "a.stl").write_bytes(binary_stl(block))
    lookup = MeshLookup((), tmp_path / "robot" / "r.urdf")
    assert lookup.find("../a.stl").is_file()
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    with pytest.raises(FormatError, match="outside"):
        MeshLookup((), tmp_path / "robot" / "r.urdf").find("../a.stl")


def test_a_negative_scale_mirrors_a_mesh_and_leaves_its_outside_outside(package: Path) -> None:
    file = package / "meshes" / "a.stl"
    plain, mirrored = (read_mesh(file, (1.0, y, 1.0))[0].mesh for y in (1.0, -1.0))
    volumes = []
    for mesh in (plain, mirrored):
        a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
        volumes.append(float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6.0)
    assert volumes[0] != 0.0
    assert volumes[1] == pytest.approx(volumes[0])
    image = mirrored.vertices * [1.0, -1.0, 1.0]
    assert sorted(map(tuple, image)) == sorted(map(tuple, plain.vertices))


def test_a_urdf_places_scales_and_hulls_its_meshes(package: Path) -> None:
    geometry = '<geometry><mesh filename="package://pkg/meshes/a.stl" scale="0.1 0.1 0.1"/></geometry>'
    text = f'<robot name="r"><link name="a"><visual>{geometry}</visual><collision>{geometry}</collision></link></robot>'
    link = read_urdf(text, file=package / "urdf" / "r.urdf").links[0]
    for g in (*link.visuals, *link.collisions):
        assert isinstance(g.shape, Mesh)
        assert np.allclose(g.shape.vertices.max(axis=0), [0.1, 0.2, 0.3])
    assert link.collisions[0].shape.convex


def test_a_mesh_that_seems_to_be_in_millimeters_is_said(package: Path, caplog: pytest.LogCaptureFixture) -> None:
    mesh = '<mesh filename="../meshes/a.stl" scale="{0} {0} {0}"/>'
    text = f'<robot name="r"><link name="a">\n<collision><geometry>{mesh}</geometry></collision></link></robot>'
    urdf, cell = package / "urdf" / "r.urdf", package / "cell.toml"
    for scale, width in ((1.0, ""), (-100.0, "300")):
        read_urdf(text.format(scale), file=urdf)
        load_mesh(package / "meshes" / "a.stl", scale=scale)
        cell.write_text(f'[obstacles.a]\nmesh = {{ file = "meshes/a.stl", scale = {scale} }}')
        load_scene(cell)
        said = f"the mesh is {width} m wide; if it is in millimeters, scale it by 0.001"
        places = (f"{urdf}:2", f"{package / 'meshes' / 'a.stl'}", f"{package / 'meshes' / 'a.stl'}")
        assert caplog.messages == ([f"{place}: {said}" for place in places] if width else [])
    cell.write_text(cell.read_text().replace("-100.0", "[1, 0, 1]"))
    with pytest.raises(FormatError, match=r"obstacles.a.mesh.scale: scale is .*expected factors other than zero"):
        load_scene(cell)


def test_a_flat_collision_mesh_is_refused_with_the_line(package: Path) -> None:
    (package / "meshes" / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\n")
    geometry = '<geometry><mesh filename="package://pkg/meshes/flat.obj"/></geometry>'
    text = f'<robot name="r"><link name="a">\n<collision>{geometry}</collision></link></robot>'
    with pytest.raises(FormatError, match="flat") as caught:
        read_urdf(text, file=package / "urdf" / "r.urdf")
    assert caught.value.line == 2
    text = text.replace("collision>", "visual>")
    assert len(read_urdf(text, file=package / "urdf" / "r.urdf").links[0].visuals) == 1


# ---- STL of few bytes ------------------------------------------------------------------------


@pytest.mark.parametrize("size", range(79, 86))
def test_an_stl_that_ends_in_its_head_is_refused(tmp_path: Path, size: int) -> None:
    (tmp_path / "a.stl").write_bytes(b"\1" * size)
    with pytest.raises(FormatError, match=r"a\.stl"):
        read_mesh(tmp_path / "a.stl")


# ---- glTF ------------------------------------------------------------------------------------


def gltf(mesh: Mesh, buffer: str | None = None, **changes: Any) -> dict[str, Any]:
    """A glTF document; its buffer is within, or the file of that name."""
    indices, corners = mesh.faces.astype("<u4").tobytes(), mesh.vertices.astype("<f4").tobytes()
    uri = f"data:application/octet-stream;base64,{base64.b64encode(indices + corners).decode()}"
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "translation": [0, 0, 5]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 1}, "indices": 0, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [1.0, 0.0, 0.0, 1.0]}}],
        "buffers": [{"uri": buffer or uri, "byteLength": len(indices) + len(corners)}],
        "bufferViews": [
            {"buffer": 0, "byteLength": len(indices)},
            {"buffer": 0, "byteOffset": len(indices), "byteLength": len(corners)},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5125, "count": mesh.faces.size, "type": "SCALAR"},
            {"bufferView": 1, "componentType": 5126, "count": len(mesh.vertices), "type": "VEC3"},
        ],
    } | changes


def glb(mesh: Mesh) -> bytes:
    document = gltf(mesh)
    body = mesh.faces.astype("<u4").tobytes() + mesh.vertices.astype("<f4").tobytes()
    del document["buffers"][0]["uri"]
    head = json.dumps(document).encode()
    head += b" " * (-len(head) % 4)
    chunks = struct.pack("<I4s", len(head), b"JSON") + head + struct.pack("<I4s", len(body), b"BIN\0") + body
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


@pytest.mark.parametrize("form", ["whole.gltf", "beside.gltf", "binary.glb"])
def test_gltf_is_read_with_its_y_axis_up(tmp_path: Path, block: Mesh, form: str) -> None:
    file = tmp_path / form
    if form == "binary.glb":
        file.write_bytes(glb(block))
    else:
        file.write_text(json.dumps(gltf(block, buffer=None if form == "whole.gltf" else "a%20buffer.bin")))
        (tmp_path / "a buffer.bin").write_bytes(
            block.faces.astype("<u4").tobytes() + block.vertices.astype("<f4").tobytes()
        )
    (part,) = read_mesh(file, (1.0, 1.0, 2.0))
    x, y, z = block.vertices.T
    expected = np.stack([x, -(z + 5.0), 2.0 * y], axis=1)
    assert {tuple(v) for v in part.mesh.vertices.tolist()} == {tuple(v) for v in expected.tolist()}
    assert part.color == (1.0, 0.0, 0.0, 1.0)
    corners = part.mesh.vertices[part.mesh.faces]
    volume = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    assert volume == pytest.approx(12.0)


WRONG_GLTF: dict[str, tuple[dict[str, Any], str]] = {
    "draco": ({"extensionsRequired": ["KHR_draco_mesh_compression"]}, "KHR_draco_mesh_compression"),
    "a cycle": ({"nodes": [{"mesh": 0, "children": [1]}, {"children": [0]}]}, "several parents"),
    "a node twice": ({"nodes": [{"mesh": 0, "children": [1, 1]}, {}]}, "several parents"),
    "no such node": ({"nodes": [{"mesh": 0, "children": [7]}]}, "does not have"),
    "no such mesh": ({"nodes": [{"mesh": 3}]}, "IndexError"),
    "no scene": ({"scenes": []}, "no scene"),
    "numbers for nodes": ({"nodes": 7}, "TypeError"),
    "elsewhere": ({"buffers": [{"uri": "../../x.bin", "byteLength": 1}]}, "not in its folder"),
    "remote": ({"buffers": [{"uri": "http://localhost/x.bin", "byteLength": 1}]}, "no such file"),
    "a device": ({"buffers": [{"uri": "/dev/zero", "byteLength": 1}]}, "not in its folder"),
    "a huge accessor": ({"accessors": [{"count": 10**12, "componentType": 5126, "type": "VEC3"}]}, "accessor of"),
    "an empty buffer": ({"buffers": [{"uri": "data:;base64,", "byteLength": 0}]}, "cannot be read as GLTF"),
}


@pytest.mark.parametrize("case", WRONG_GLTF)
def test_gltf_that_would_be_read_wrong_is_refused(tmp_path: Path, block: Mesh, case: str) -> None:
    changes, message = WRONG_GLTF[case]
    (tmp_path / "a.gltf").write_text(json.dumps(gltf(block, **changes)))
    with pytest.raises(FormatError, match=rf"a\.gltf.*{message}|x\.bin.*{message}"):
        read_mesh(tmp_path / "a.gltf")


def test_gltf_of_fans_or_sparse_vertices_is_refused(tmp_path: Path, block: Mesh) -> None:
    fan, sparse = gltf(block), gltf(block)
    fan["meshes"][0]["primitives"][0]["mode"] = 6
    del sparse["accessors"][1]["bufferView"]
    for document, message in ((fan, "fan"), (sparse, "sparse")):
        (tmp_path / "a.gltf").write_text(json.dumps(document))
        with pytest.raises(FormatError, match=message):
            read_mesh(tmp_path / "a.gltf")


@pytest.mark.parametrize("data", [b"", b"glTF", b"glTF\2\0\0\0\x20\0\0\0\xff\xff\xff\xffJSON{}", b"[]", b"{", b"null"])
@pytest.mark.parametrize("suffix", ["gltf", "glb"])
def test_a_damaged_gltf_is_refused(tmp_path: Path, suffix: str, data: bytes) -> None:
    (tmp_path / f"a.{suffix}").write_bytes(data)
    with pytest.raises(FormatError, match=r"a\.gl"):
        read_mesh(tmp_path / f"a.{suffix}")


def test_a_robot_with_gltf_meshes_is_loaded(tmp_path: Path, block: Mesh) -> None:
    (tmp_path / "a.glb").write_bytes(glb(block))
    shape = '<geometry><mesh filename="a.glb" scale="0.1 0.1 0.1"/></geometry>'
    text = f'<robot name="r"><link name="l"><visual>{shape}</visual><collision>{shape}</collision></link></robot>'
    (tmp_path / "r.urdf").write_text(text)
    (link,) = read_urdf(tmp_path / "r.urdf").links
    assert link.collisions[0].shape.vertices.max() == pytest.approx(0.2)
    assert link.visuals[0].color == (1.0, 0.0, 0.0, 1.0)


@pytest.mark.parametrize("damaged", [False, True])
def test_a_texture_counts_with_its_mean_color(tmp_path: Path, damaged: bool) -> None:
    picture = Image.new("RGB", (8, 8), (200, 40, 0))
    picture.paste((100, 80, 0), (0, 0, 8, 4))
    box = trimesh.creation.box()
    material = trimesh.visual.material.PBRMaterial(baseColorFactor=[0.4, 1.0, 1.0, 1.0], baseColorTexture=picture)
    box.visual = trimesh.visual.TextureVisuals(uv=np.zeros((8, 2)), material=material)
    data = box.export(file_type="glb")
    file = tmp_path / "box.glb"
    file.write_bytes(data.replace(b"IDAT", b"IDAX") if damaged else data)
    (part,) = read_mesh(file)
    expected = (0.4, 1.0, 1.0) if damaged else (0.4 * 150 / 255, 60 / 255, 0.0)
    np.testing.assert_allclose(part.color, (*expected, 1.0), atol=0.004)


@pytest.mark.parametrize("kind", ["vertex_colors", "face_colors"])
def test_a_ply_brings_its_color(tmp_path: Path, kind: str) -> None:
    ball = trimesh.creation.icosphere(radius=0.1)
    ball.export(tmp_path / "plain.ply")
    assert read_mesh(tmp_path / "plain.ply")[0].color is None
    setattr(ball.visual, kind, [0, 255, 0, 51])
    ball.export(tmp_path / "ball.ply")
    np.testing.assert_allclose(read_mesh(tmp_path / "ball.ply")[0].color, (0.0, 1.0, 0.0, 0.2))


def test_colors_of_vertices_count_with_their_mean(tmp_path: Path) -> None:
    balls = trimesh.Scene()
    for k, color in enumerate(([255, 0, 0, 255], [0, 0, 255, 102])):
        ball = trimesh.creation.icosphere(1, 0.1)
        ball.visual.vertex_colors = color
        balls.add_geometry(ball.apply_translation([k, 0, 0]))
    (tmp_path / "balls.glb").write_bytes(balls.export(file_type="glb"))
    assert {part.color for part in read_mesh(tmp_path / "balls.glb")} == {(1.0, 0.0, 0.0, 1.0), (0.0, 0.0, 1.0, 0.4)}


def test_a_long_spiral_leaves_its_gap_open(tmp_path: Path) -> None:
    """Most of its corners become ears only late, from its ends on."""
    angles = np.linspace(0.0, 40.0 * np.pi, 1500)
    arm = np.column_stack([np.cos(angles), np.sin(angles)])
    outline = np.concatenate([(angles + 1.0)[:, None] * arm, (angles[:, None] * arm)[::-1]])
    lines = [f"v {x!r} {y!r} 0" for x, y in outline.tolist()]
    (tmp_path / "spiral.obj").write_text("\n".join([*lines, "f " + " ".join(str(i) for i in range(1, 3001))]))
    mesh = load_mesh(tmp_path / "spiral.obj")
    a, b, c = mesh.vertices[mesh.faces].swapaxes(0, 1)
    surface = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0
    x, y = outline.T
    assert surface == pytest.approx(abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2.0)


def test_a_concave_face_of_too_many_corners_is_refused(tmp_path: Path) -> None:
    angles = np.arange(8000) * np.pi / 4000
    radii = np.where(np.arange(8000) % 2, 1.0, 0.9)
    lines = [
        f"v {x!r} {y!r} 0"
        for x, y in zip((radii * np.cos(angles)).tolist(), (radii * np.sin(angles)).tolist(), strict=True)
    ]
    (tmp_path / "gear.obj").write_text("\n".join([*lines, "f " + " ".join(str(i) for i in range(1, 8001))]))
    with pytest.raises(FormatError, match="concave faces with too many corners, expected triangles"):
        load_mesh(tmp_path / "gear.obj")


def test_numbers_of_an_obj_that_are_too_large_are_refused_without_a_warning(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 1e300 0 0\nv 0 1e300 0\nv 0 0 0\nv -1e300 1 1\nf 1 2 3 4\n")
    with pytest.raises(FormatError, match="not finite or farther away"):
        load_mesh(tmp_path / "a.obj")
