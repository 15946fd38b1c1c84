"""Validation of glTF files, to reject those that trimesh would read wrongly without an error.

Requires acyclic node trees, uncompressed triangles, and buffers in the file or in its folder.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from rr1plan.checks import Array, resolved_path
from rr1plan.errors import FormatError
from rr1plan.files.file_access import read_bytes

MAX_COUNT = 10_000_000
# Triangles and strips of them; trimesh ignores fans. Points and lines have no surface.
_FAN = 6
# Extensions that change the appearance of a surface, not its geometry.
_LOOKS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_", "MSFT_texture_")
# glTF's y axis points up; robot links use z.
Z_UP: Array = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def external_buffers(data: bytes, file: Path) -> dict[str, bytes]:
    """The external buffers of a .gltf or .glb file, by name.

    Raises:
        FormatError: not glTF 2, an unsupported feature, or a buffer outside the folder.
    """
    header = _header(data, file)
    try:
        _check_extensions(header, file)
        _check_accessors(header, file)
        _check_tree(header, file)
        names = [buffer["uri"] for buffer in header.get("buffers", []) if "uri" in buffer]
        return {name: _beside(file, name) for name in names if not name.startswith("data:")}
    except (KeyError, IndexError, TypeError, AttributeError) as error:
        raise FormatError(f"cannot be read as glTF: {type(error).__name__}: {error}", file) from error


def _header(data: bytes, file: Path) -> dict[str, Any]:
    """The JSON part."""
    if file.suffix.lower() == ".glb":
        if len(data) < 20 or data[:4] != b"glTF" or data[16:20] != b"JSON":
            raise FormatError("is not a binary glTF 2 file", file)
        (length,) = struct.unpack("<I", data[12:16])
        data = data[20 : 20 + length]
    try:
        header = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise FormatError(f"has a header that is not JSON: {error}", file) from error
    if not isinstance(header, dict):
        raise FormatError("has a header that is not a JSON object", file)
    return header


def _check_extensions(header: dict[str, Any], file: Path) -> None:
    required = [name for name in header.get("extensionsRequired", []) if not name.startswith(_LOOKS)]
    if required:
        raise FormatError(f"needs the extension {required[0]!r}, which is not read; export it without", file)


def _check_accessors(header: dict[str, Any], file: Path) -> None:
    accessors = header.get("accessors", [])
    for accessor in accessors:
        if not (type(accessor["count"]) is int and 0 < accessor["count"] <= MAX_COUNT):
            raise FormatError(f"has an accessor of {accessor['count']!r} items, expected 1 to {MAX_COUNT}", file)
    for primitive in (p for mesh in header.get("meshes", []) for p in mesh["primitives"]):
        if primitive.get("mode") == _FAN:
            raise FormatError("has a triangle fan, which is not read; export triangles", file)
        for index in (primitive["attributes"]["POSITION"], primitive.get("indices")):
            if index is not None and ("sparse" in accessors[index] or "bufferView" not in accessors[index]):
                raise FormatError("has vertices or indices that are sparse or compressed; export it without", file)


def _check_tree(header: dict[str, Any], file: Path) -> None:
    """Require at most one parent for every node, and none for the nodes of a scene, to exclude cycles."""
    nodes = header.get("nodes", [])
    children = [child for node in nodes for child in node.get("children", [])]
    roots = [root for scene in header.get("scenes", []) for root in set(scene.get("nodes", []))]
    if len(set(children)) != len(children) or set(children) & set(roots):
        raise FormatError("has a node with several parents", file)
    if any(type(index) is not int or not 0 <= index < len(nodes) for index in (*children, *roots)):
        raise FormatError("names a node that it does not have", file)
    if not roots:
        raise FormatError("has no scene", file)
    sizes = [
        sum(header["accessors"][p["attributes"]["POSITION"]]["count"] for p in mesh["primitives"])
        for mesh in header.get("meshes", [])
    ]
    shown = sum(sizes[node["mesh"]] for node in nodes if "mesh" in node)
    if shown > MAX_COUNT:
        raise FormatError(f"shows {shown} vertices, expected at most {MAX_COUNT}; try a decimated mesh", file)


def _beside(file: Path, name: str) -> bytes:
    path = resolved_path(file.parent / unquote(name))
    if not path.is_relative_to(resolved_path(file.parent)):
        raise FormatError(f"has a buffer {name!r} that is not in its folder", file)
    return read_bytes(path)
