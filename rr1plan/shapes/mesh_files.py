"""Triangle meshes from STL, OBJ, PLY, DAE and glTF files.

Binary STL is read here, because importing its loader takes half a second. Other files are read by trimesh from their
bytes, so nothing but the file itself (and a glTF's buffers beside it) is opened: no material files, no separate
textures, nothing remote. A DAE's unit scales it, as COLLADA specifies; its up axis is ignored, as in all readers of
robot descriptions (many exporters write a wrong one). glTF's y axis is up and becomes z, as in Drake, Blender and RViz
(since 2025); for robots whose files deviate from that see `rr1plan.robot.gltf_axes`.
"""

from __future__ import annotations

import codecs
import io
import logging
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rr1plan.checks import Array, file_path, finite_array, shown, true_or_false
from rr1plan.errors import FormatError, InputError, reason_of
from rr1plan.files.file_access import read_bytes
from rr1plan.files.xml_reader import first_attributes
from rr1plan.held_interrupts import interrupts_held
from rr1plan.shapes import Color, Mesh
from rr1plan.shapes.concave_faces import with_triangulated_faces
from rr1plan.shapes.convex_hulls import convex_hull
from rr1plan.shapes.dae_polygons import with_triangulated_polygons
from rr1plan.shapes.gltf_checks import Z_UP, external_buffers
from rr1plan.shapes.ply_files import with_triangles

log = logging.getLogger(__name__)

MAX_FACES = 1_000_000
MAX_BYTES = 256 * 1024 * 1024
MAX_COORDINATE = 1e9
SUFFIXES = (".stl", ".obj", ".ply", ".dae", ".gltf", ".glb")
# Wider meshes and scans are probably in millimeters [m].
WIDEST_MESH = 50.0
# Read without colors: these files have none, or one for each vertex.
_COLORLESS = (".stl", ".obj")
GLTF = (".gltf", ".glb")
# Before a vertex or face of an OBJ; one with a comment; a face with a vertex that is not counted from 1 on; the
# vertices of a face.
_INDENTATION = re.compile(rb"^ +(?=[vf] )", re.MULTILINE)
_COMMENT = re.compile(rb"^([vf] [^#\n]*)#[^\n]*", re.MULTILINE)
_RELATIVE_FACE = re.compile(rb"^f (?:[^\n]* )?(?:-\d+|0+)(?![^/\s])", re.MULTILINE)
_CORNER = re.compile(rb"(?<= )(-?\d{1,15})(?![^/\s])(?:/\S*)?")
# The only property of the faces of a PLY, up to its name, and the name.
_ONLY_LIST = re.compile(rb"(\nelement face \d+\s+property list \S+ \S+ )\S+(?=\s*(?:element .*)?\Z)", re.DOTALL)
# A triangle of a binary STL.
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


class _Triangles(NamedTuple):
    """Vertices (n, 3) and faces (m, 3), as in trimesh."""

    vertices: Any
    faces: Any
    visual: Any = None


@dataclass(frozen=True, eq=False)
class MeshPart:
    """A part of a mesh file with its color, if the file specifies one."""

    mesh: Mesh
    color: Color | None = None


def read_mesh(file: str | Path, scale: tuple[float, ...] = (1.0, 1.0, 1.0)) -> tuple[MeshPart, ...]:
    """Read a mesh file.

    Args:
        file: A .stl (ascii or binary), .obj, .ply, .dae, .gltf or .glb file.
        scale: Factor of each axis, shape (3,); negative ones mirror.

    Returns:
        One part for each color; STL and OBJ have one part without a color (an OBJ's are in a material file).
        A texture or colors of vertices or faces count with their mean.

    Raises:
        FormatError: an unknown suffix, or a file that cannot be read, is too large, or contains no triangle or a number
            that is not finite.
    """
    file = file_path(file)
    kind = file.suffix.lower()
    if kind not in SUFFIXES:
        raise FormatError(f"has the suffix {kind!r}, expected one of {', '.join(SUFFIXES)}", file)
    data = read_bytes(file, MAX_BYTES)
    factors = np.array(scale)
    if kind == ".dae":
        factors = factors * _unit(data, file)
    groups: dict[Color | None, list[Any]] = {}
    for mesh in _binary_stl(data) if kind == ".stl" and _is_binary_stl(data) else _load(file, data, kind[1:]):
        groups.setdefault(_color(mesh) if kind not in _COLORLESS else None, []).append(mesh)
    faces = sum(len(mesh.faces) for meshes in groups.values() for mesh in meshes)
    if faces == 0:
        raise FormatError("has no triangle" + (_cut_stl(data) if kind == ".stl" else ""), file)
    if faces > MAX_FACES:
        raise FormatError(f"has {faces} triangles, expected at most {MAX_FACES}; try a decimated mesh", file)
    return tuple(MeshPart(_join(file, meshes, factors), color) for color, meshes in groups.items())


def load_mesh(file: str | Path, *, scale: float | tuple[float, float, float] = 1.0, hull: bool = False) -> Mesh:
    """Read a mesh file as one shape for an obstacle.

        scene = scene.with_obstacle("mug", load_mesh("mug.stl", scale=0.001), [0.4, 0.1, 0.0])

    Args:
        file: A .stl (ascii or binary), .obj, .ply, .dae, .gltf or .glb file.
        scale: Factor of all axes or of each one (a file in millimeters: 0.001); negative ones mirror.
        hull: Take the convex hull. Otherwise an obstacle is checked triangle by triangle, and a held object or a link
            is decomposed into convex pieces, which is slow the first time.

    Raises:
        FormatError: an unknown suffix, or a file that cannot be read, is too large, or contains no triangle or a number
            that is not finite.
        InputError: a scale that is not finite or is zero, or a hull without volume.
    """
    of_three = isinstance(scale, list | tuple | np.ndarray)
    factors = np.broadcast_to(finite_array("scale", scale, (3,) if of_three else ()), (3,))
    if (factors == 0.0).any() or np.abs(factors).max() > MAX_COORDINATE:
        raise InputError(f"scale is {shown(scale)}, expected factors other than zero, none beyond {MAX_COORDINATE:g}")
    true_or_false("hull", hull)
    x, y, z = factors.tolist()
    parts = [part.mesh for part in read_mesh(file, (x, y, z))]
    warn_of_millimeters(str(file), "mesh", [mesh.vertices for mesh in parts])
    if hull:
        return convex_hull(np.concatenate([mesh.vertices for mesh in parts]))
    return joined_mesh(parts)


def warn_of_millimeters(place: str, kind: str, parts: Sequence[Array]) -> None:
    """Log that a mesh or a scan is so wide that its file seems to be in millimeters.

    Args:
        place: The file, or the place that names it, for the message.
        kind: "mesh" or "scan", for the message.
        parts: Points of each part with its scale [m], shape (n, 3).
    """
    advice = "multiply its points by 0.001" if kind == "scan" else "scale it by 0.001"
    width = max(float(np.ptp(points, axis=0).max()) for points in parts)
    if width > WIDEST_MESH:
        log.warning("%s: the %s is %.4g m wide; if it is in millimeters, %s", place, kind, width, advice)


def joined_mesh(parts: Sequence[Mesh]) -> Mesh:
    """Several meshes as one."""
    if len(parts) == 1:
        return parts[0]
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in parts)])
    faces = [mesh.faces + start for mesh, start in zip(parts, starts, strict=False)]
    return Mesh(np.concatenate([mesh.vertices for mesh in parts]), np.concatenate(faces))


def _unit(data: bytes, file: Path) -> float:
    """The length of a DAE's unit [m]; rejects document types on the way."""
    word = first_attributes(data, "unit", file).get("meter", "1")
    try:
        unit = float(word)
    except ValueError:
        unit = np.nan
    if not (np.isfinite(unit) and unit > 0.0):
        raise FormatError(f"has the unit {word!r}, expected a number of meters above zero", file)
    return unit


def _is_binary_stl(data: bytes) -> bool:
    """Whether it has the length of a binary STL with its number of triangles, unlike ASCII files that begin alike."""
    count = int.from_bytes(data[80:84], "little")
    return count > 0 and len(data) == 84 + _TRIANGLE.itemsize * count


def _cut_stl(data: bytes) -> str:
    """What a file that was cut off lacks, for the message: the end of an ASCII STL, or bytes of a binary one."""
    if b"\0" not in data[80:84]:
        is_cut = data.startswith(b"solid") and b"endsolid" not in data
        return ": it was cut off, as an ASCII STL ends with 'endsolid'" if is_cut else ""
    count = int.from_bytes(data[80:84], "little")
    size = 84 + _TRIANGLE.itemsize * count
    return f"; a binary STL of {count} triangles, as its head says, has {size} bytes, but it has {len(data)}"


def _binary_stl(data: bytes) -> list[Any]:
    corners = np.frombuffer(data, _TRIANGLE, offset=84)["corners"].reshape(-1, 3)
    with np.errstate(invalid="ignore"):
        return [_Triangles(corners.astype(float), np.arange(len(corners)).reshape(-1, 3))]


def _load(file: Path, data: bytes, kind: str) -> list[Any]:
    """Trimesh's meshes of a file, placed."""
    with interrupts_held():
        import trimesh

    buffers = external_buffers(data, file) if file.suffix.lower() in GLTF else None
    if kind == "obj":
        data = with_triangulated_faces(_regular_obj(data, file), file)
    elif kind == "ply":
        data = with_triangles(_regular_ply(data), file)
    elif kind == "dae":
        data = with_triangulated_polygons(data, file)
    try:
        scene: Any = trimesh.load_scene(io.BytesIO(data), file_type=kind, resolver=buffers, process=False)
        meshes = [mesh for mesh in scene.dump() if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces)]
        return meshes if buffers is None else [_Triangles(m.vertices @ Z_UP.T, m.faces, m.visual) for m in meshes]
    except Exception as error:  # trimesh's parsers raise many types of errors
        raise FormatError(f"cannot be read as {kind.upper()}: {reason_of(error)}", file) from error


def _regular_ply(data: bytes) -> bytes:
    """The PLY with a header in ASCII, and faces that have a usual name for their corners.

    Trimesh refuses comments in other encodings than UTF-8, and in text PLYs other names of the only list of the faces.
    """
    end = max(data.find(b"end_header"), 0)
    head = data[:end].decode("ascii", "replace").encode("ascii", "replace")
    return _ONLY_LIST.sub(rb"\1vertex_indices", head) + data[end:]


def _regular_obj(data: bytes, file: Path) -> bytes:
    """The OBJ with one line for each element and nothing else in it, and with all vertices of faces counted from 1 on.

    Trimesh skips indented lines and the first line after a byte order mark, and reads comments as numbers. A negative
    index counts back from the face's own line; trimesh counts it from the end of the file, and takes 0 for the last
    vertex.
    """
    data = data.removeprefix(codecs.BOM_UTF8).replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    data = data.replace(b"\\\n", b" ").replace(b"\t", b" ")
    data = _COMMENT.sub(rb"\1", _INDENTATION.sub(b"", data))
    if not _RELATIVE_FACE.search(data):
        return data
    lines, count = data.split(b"\n"), 0

    def absolute(corner: re.Match[bytes]) -> bytes:
        index = int(corner[1])
        if index > 0:
            return corner[1]
        if not -count <= index < 0:
            why = "OBJ counts vertices from 1 on" if index == 0 else f"there are {count} vertices before it"
            raise FormatError(f"has a face with the vertex {index}, but {why}", file)
        return b"%d" % (count + 1 + index)

    for number, line in enumerate(lines):
        kind = line.split(maxsplit=1)[:1]
        count += kind == [b"v"]
        if kind == [b"f"]:
            lines[number] = _CORNER.sub(absolute, line)
    return b"\n".join(lines)


def _color(mesh: Any) -> Color | None:
    """The color of a mesh: of its material and mean texture, or the mean of its vertices; None without any."""
    if getattr(mesh.visual, "kind", None) in ("vertex", "face"):
        colors = np.asarray(mesh.visual.face_colors)
        r, g, b, a = (colors.mean(axis=0) / 255.0).tolist()
        return r, g, b, a
    material = getattr(mesh.visual, "material", None)
    color = getattr(material, "main_color", None)
    texture = _mean_color(getattr(material, "baseColorTexture", None))
    if color is None or getattr(material, "baseColorFactor", color) is None:  # trimesh's own gray
        return None if texture is None else (*texture, 1.0)
    r, g, b, a = (float(c) / 255.0 for c in color)
    if texture is not None:
        r, g, b = (c * t for c, t in zip((r, g, b), texture, strict=True))
    return r, g, b, a


def _mean_color(image: Any) -> tuple[float, float, float] | None:
    """The mean color of a picture; None without one, or if it is damaged."""
    if image is None:
        return None
    try:
        image.thumbnail((64, 64))
        r, g, b = (np.asarray(image.convert("RGB")).mean(axis=(0, 1)) / 255.0).tolist()
    except (OSError, SyntaxError, ValueError):  # what Pillow raises for damaged files
        return None
    return r, g, b


def _join(file: Path, meshes: list[Any], factors: Any) -> Mesh:
    """One mesh of several; corners at exactly the same position become one vertex."""
    for mesh in meshes:
        _check(file, np.asarray(mesh.vertices), np.asarray(mesh.faces))
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    corners = np.concatenate([mesh.vertices for mesh in meshes]) * factors
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)])
    if np.prod(factors) < 0.0:
        faces = faces[:, ::-1]  # mirroring turns faces inside out
    vertices, where = np.unique(corners, axis=0, return_inverse=True)
    try:
        return Mesh(vertices, where.reshape(-1)[faces])
    except InputError as error:
        raise FormatError(str(error), file) from error


def _check(file: Path, vertices: Any, faces: Any) -> None:
    """Reject errors that trimesh does not detect in a damaged file."""
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
        raise FormatError(f"has vertices of shape {vertices.shape}, expected three numbers each", file)
    beyond = faces[(faces < 0) | (faces >= len(vertices))]
    if len(beyond):
        raise FormatError(f"has a triangle with the corner {beyond[0]}, but {len(vertices)} vertices", file)
    if not (np.abs(vertices) < MAX_COORDINATE).all():
        raise FormatError("has a vertex that is not finite or farther away than a robot can be", file)
