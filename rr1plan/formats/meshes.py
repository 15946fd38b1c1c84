"""Triangle meshes from STL, OBJ and DAE files.

STL and OBJ are read by trimesh from the file's bytes without a resolver, so nothing but the file
itself is opened: no material files, no textures, nothing remote.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rr1plan.errors import FormatError, InputError
from rr1plan.robot import Color
from rr1plan.shapes import Mesh

MAX_FACES = 1_000_000
MAX_BYTES = 256 * 1024 * 1024


@dataclass(frozen=True, eq=False)
class MeshPart:
    """A part of a mesh file with its colour, where the file gives one."""

    mesh: Mesh
    color: Color | None = None


def read_mesh(file: str | Path, scale: tuple[float, ...] = (1.0, 1.0, 1.0)) -> tuple[MeshPart, ...]:
    """Read a mesh file.

    Args:
        file: A .stl (ascii or binary), .obj or .dae file.
        scale: Factor of each axis, shape (3,).

    Returns:
        One part per colour; STL and OBJ have one part without a colour.

    Raises:
        FormatError: the file cannot be read, is too large, or holds no usable triangles.
    """
    file = Path(file)
    try:
        if file.stat().st_size > MAX_BYTES:
            raise FormatError(f"is larger than {MAX_BYTES // 2**20} MiB; try a decimated mesh", file)
        data = file.read_bytes()
    except OSError as error:
        raise FormatError(f"cannot be read: {error.strerror}", file) from error
    kind = file.suffix.lower()
    return (MeshPart(_part(file, *_load_triangles(file, data, kind), scale)),)


def _load_triangles(file: Path, data: bytes, kind: str) -> tuple[Any, Any]:
    """Vertices and faces of an STL or OBJ file."""
    import trimesh

    try:
        mesh: Any = trimesh.load(io.BytesIO(data), file_type=kind[1:], force="mesh", process=False)
    except Exception as error:  # trimesh raises whatever its parsers happen to
        raise FormatError(f"cannot be read as {kind[1:].upper()}: {error}", file) from error
    return mesh.vertices, mesh.faces


def _part(file: Path, vertices: Any, faces: Any, scale: tuple[float, ...]) -> Mesh:
    try:
        return Mesh(np.asarray(vertices, dtype=np.float64) * np.asarray(scale), np.asarray(faces))
    except InputError as error:
        raise FormatError(str(error), file) from error
