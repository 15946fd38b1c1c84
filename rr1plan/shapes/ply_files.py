"""PLY files: their header, and their faces as triangles."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rr1plan.errors import FormatError
from rr1plan.shapes.concave_faces import concave_triangles

MAX_COLUMNS = 1000
_MAX_HEADER = 100_000  # [bytes]
_TYPES = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "float32": "f4",
    "float64": "f8",
}
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_CORNERS = ("vertex_indices", "vertex_index")


class PlyElement(NamedTuple):
    """A kind of rows in a PLY file.

    Args:
        name: Its name, such as "vertex".
        rows: Number of rows.
        columns: PLY's types by the name of the column: one, or for a list those of its length and of its entries.
    """

    name: str
    rows: int
    columns: dict[str, tuple[str, ...]]


def ply_header(data: bytes) -> tuple[str, list[PlyElement], bytes]:
    """The byte order of a PLY file ("" for text), its elements, and what follows its header.

    Raises:
        ValueError, LookupError: it is not a PLY file, or damaged.
    """
    lines, body = header_lines(data, b"end_header")
    if lines[:1] != [["ply"]] or len(lines) < 2 or lines[1][:1] != ["format"] or len(lines[1]) != 3:
        raise ValueError("it does not begin as a PLY file")
    order = _ORDERS[lines[1][1]]
    elements: list[PlyElement] = []
    for words in lines[2:-1]:
        match words:
            case ["comment" | "obj_info", *_]:
                pass
            case ["element", name, number]:
                elements.append(PlyElement(name, whole_number(number), {}))
            case ["property", *_, name] if name in elements[-1].columns:
                raise ValueError(f"it has two columns {name!r}")
            case ["property", kind, name]:
                elements[-1].columns[name] = (kind,)
            case ["property", "list", size, kind, name]:
                elements[-1].columns[name] = (size, kind)
            case _:
                raise ValueError(f"{' '.join(words)!r} is no line of a header")
    return order, elements, body


def ply_points(data: bytes) -> Any:
    """The vertices of a PLY file, shape (n, 3); faces and later elements are ignored.

    Raises:
        ValueError, LookupError: it is not a PLY file, or damaged.
    """
    order, elements, body = ply_header(data)
    return _points(order, elements, body)


def _points(order: str, elements: list[PlyElement], body: bytes) -> Any:
    if not elements or elements[0].name != "vertex" or any(len(kinds) > 1 for kinds in elements[0].columns.values()):
        raise ValueError("its first element is not a vertex of numbers")
    _, count, columns = elements[0]
    formats = [(order or "<") + _TYPES[kind] for (kind,) in columns.values()]
    places = {name: i for i, name in enumerate(columns)}
    return rows_of(body, formats, [places[axis] for axis in "xyz"], count, text=not order)


def with_triangles(data: bytes, file: Path) -> bytes:
    """The PLY with vertices and triangles only, if it has faces with more corners.

    Trimesh refuses binary files whose faces have different numbers of corners, and divides all faces into fans.

    Args:
        data: A PLY. If it is damaged, it is returned as it is, and the parser says what is wrong.
        file: Its file, for messages.

    Raises:
        FormatError: too many corners in concave faces, or text that was cut off.
    """
    try:
        order, elements, body = ply_header(data)
        vertex, face = elements[:2]
        if (vertex.name, face.name) != ("vertex", "face") or not face.columns.keys() & set(_CORNERS):
            return data
        points = _points(order, elements, body)
        if order:
            size = vertex.rows * sum(np.dtype(_TYPES[kind]).itemsize for (kind,) in vertex.columns.values())
            if _are_triangles(face, order, body[size:]):
                return data
            kept, rows = body[:size], list(_binary_faces(face, order, body[size:]))
        else:
            lines = body.splitlines(keepends=True)
            kept, rows = b"".join(lines[: vertex.rows]), list(_text_faces(face, lines[vertex.rows :]))
    except EOFError as error:
        raise FormatError("was cut off: it has fewer faces than its header says", file) from error
    except (ValueError, LookupError, struct.error):
        return data
    faces = [corners for _, corners in rows]
    known = range(len(points))
    if all(len(corners) == 3 for corners in faces) or any(k not in known for corners in faces for k in corners):
        return data
    concave = concave_triangles(points, faces, file)
    parts = []
    for i, (others, corners) in enumerate(rows):
        for triangle in concave.get(i) or [[0, k - 1, k] for k in range(2, len(corners))]:
            a, b, c = (corners[k] for k in triangle)
            parts.append(others + (struct.pack(f"{order}B3i", 3, a, b, c) if order else b"3 %d %d %d\n" % (a, b, c)))
    head = ["ply", f"format {next(name for name in _ORDERS if _ORDERS[name] == order)} 1.0"]
    for element, count in ((vertex, vertex.rows), (face, len(parts))):
        head.append(f"element {element.name} {count}")
        head += [f"property {kinds[0]} {name}" for name, kinds in element.columns.items() if len(kinds) == 1]
    head += ["property list uchar int vertex_indices", "end_header", ""]
    return b"".join(["\n".join(head).encode(), kept, *parts])


def _are_triangles(face: PlyElement, order: str, body: bytes) -> bool:
    """Whether all lists of the faces of a binary PLY have three entries; a fast test, which most files pass."""
    columns: list[Any] = []
    for name, kinds in face.columns.items():
        formats = [order + _TYPES[kind] for kind in kinds]
        columns += [(name, formats[0])] if len(kinds) == 1 else [(f"count {name}", formats[0]), (name, formats[1], 3)]
    row = np.dtype(columns)
    if len(body) < face.rows * row.itemsize:
        return False
    rows = np.frombuffer(body, row, count=face.rows)
    return all(bool((rows[name] == 3).all()) for name in row.names or () if name.startswith("count "))


def _text_faces(face: PlyElement, lines: list[bytes]) -> Iterator[tuple[bytes, list[int]]]:
    """The corners of each face of a PLY in text, and its columns that are not lists; EOFError if some are missing."""
    if len(lines) < face.rows:
        raise EOFError
    for line in lines[: face.rows]:
        words, others, corners = iter(line.split()), b"", []
        for name, kinds in face.columns.items():
            if len(kinds) == 1:
                others += next(words, b"") + b" "
                continue
            count = int(next(words, b""))
            entries = list(islice(words, count))
            if len(entries) < count:
                raise EOFError
            if name in _CORNERS:
                corners = [int(entry) for entry in entries]
        yield others, corners


def _binary_faces(face: PlyElement, order: str, body: bytes) -> Iterator[tuple[bytes, list[int]]]:
    """The corners of each face of a binary PLY, and its columns that are not lists."""
    columns = [
        (name, [struct.Struct(order + np.dtype(_TYPES[kind]).char) for kind in kinds])
        for name, kinds in face.columns.items()
    ]
    at = 0
    for _ in range(face.rows):
        others, corners = b"", []
        for name, codes in columns:
            (count,) = codes[0].unpack_from(body, at)
            begin, at = at, at + codes[0].size
            if len(codes) == 1:
                others += body[begin:at]
                continue
            if name in _CORNERS:
                corners = list(struct.unpack_from(f"{order}{count}{codes[1].format[-1]}", body, at))
            at += count * codes[1].size
        yield others, corners


def header_lines(data: bytes, last: bytes) -> tuple[list[list[str]], bytes]:
    """The words of a header's lines up to the one that begins with `last`, and the remaining bytes."""
    found = re.search(rb"^" + last + rb"[^\n]*\n", data[:_MAX_HEADER], re.MULTILINE)
    if found is None:
        raise ValueError(f"its header has no line {last.decode()!r}")
    return [line.split() for line in data[: found.end()].decode("latin-1").splitlines()], data[found.end() :]


def rows_of(body: bytes, formats: list[str], columns: list[int], rows: int, *, text: bool) -> Any:
    """Some columns of rows of numbers."""
    if len(formats) > MAX_COLUMNS:
        raise ValueError(f"it has more than {MAX_COLUMNS} values for each point")
    if rows == 0:
        return np.empty((0, len(columns)))
    if not text:
        row = np.dtype([(str(i), form) for i, form in enumerate(formats)])
        if len(body) < rows * row.itemsize:
            raise ValueError(f"it holds {len(body)} bytes, the header says {rows * row.itemsize}")
        values = np.frombuffer(body, row, count=rows)
        return np.stack([values[str(i)].astype(np.float64) for i in columns], axis=1)
    lines = body.splitlines()[:rows]
    if len(lines) < rows or not lines[0].strip():
        raise ValueError(f"it holds {len(lines)} lines, the header says {rows}")
    table = np.loadtxt(lines, ndmin=2, comments=None, encoding="ascii")
    if table.shape != (rows, len(formats)):
        raise ValueError(f"it holds numbers of shape {table.shape}, the header says {(rows, len(formats))}")
    return table[:, columns]


def whole_number(word: str) -> int:
    """The count in a word of a header.

    Raises:
        ValueError: it is none.
    """
    if not (word.isascii() and word.isdigit() and len(word) < 12):
        raise ValueError(f"{word!r} is no count")
    return int(word)
