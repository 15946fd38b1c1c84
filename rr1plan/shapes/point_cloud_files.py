"""Point clouds from files: .npy arrays, .ply and .pcd scans, and text with a point in each line."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from rr1plan.checks import Array, file_path, near_array, number_in, shown
from rr1plan.errors import FormatError, InputError
from rr1plan.files.file_access import MAX_BYTES, read_bytes, read_text
from rr1plan.files.npy_files import parse_array
from rr1plan.shapes import PointCloud
from rr1plan.shapes.mesh_files import warn_of_millimeters

log = logging.getLogger(__name__)

_MAX_HEADER = 100_000  # [bytes]
_MAX_COLUMNS = 1000
_TEXT = (".csv", ".xyz", ".txt")
_PCD_TYPES = {(kind.upper(), size): f"<{kind}{size}" for kind in "iuf" for size in "1248" if kind != "f" or size > "2"}
_PLY_TYPES = {
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


def load_point_cloud(file: str | Path, *, resolution: float = 0.02) -> PointCloud:
    """Read a scan as a shape for an obstacle.

        scene = scene.with_obstacle("scan", load_point_cloud("scan.pcd"))

    Args:
        file: A .npy file of shape (n, 3), a .ply or .pcd file, or text with x, y, z in each line (.csv, .xyz, .txt),
            where comments (#) and a header "x,y,z" are skipped.
        resolution: Side of the cubes that the points become [m].

    Raises:
        FormatError: not there, another kind of file, no points, or points that are not finite or too far away.
        InputError: a resolution that is not positive.
    """
    cloud = PointCloud(read_points(file), resolution)
    warn_of_millimeters(str(file), "scan", [cloud.points])
    return cloud


def read_points(file: str | Path) -> Array:
    """Points of a file, shape (n, 3); see `load_point_cloud`.

    Rows of NaN in a .ply or .pcd file are rays without a hit, and are omitted.

    Raises:
        FormatError: not there, another kind of file, or not points, finite and near.
    """
    file = file_path(file)
    suffix = file.suffix.lower()
    known = (*_READERS, *_TEXT)
    if suffix not in known:
        raise FormatError(f"points cannot be read from {file.suffix!r}, expected one of {', '.join(known)}", file)
    try:
        points = _from_text(read_text(file, strict=False)) if suffix in _TEXT else _READERS[suffix](read_bytes(file))
    except FormatError:
        raise
    except (ValueError, LookupError, OverflowError, MemoryError) as error:
        what = f"it has no {error}" if isinstance(error, LookupError) else error
        raise FormatError(f"is not a list of points: {what}", file) from error
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind not in "iuf":
        raise FormatError(f"holds {points.dtype} of shape {points.shape}, expected numbers of shape (n, 3)", file)
    if suffix in (".ply", ".pcd"):
        points = _without_nan(points, file)
    if not len(points):
        raise FormatError("has no point", file)
    try:
        return near_array("point cloud", points, (None, 3))
    except InputError as error:
        raise FormatError(str(error), file) from error


def _without_nan(points: Any, file: Path) -> Any:
    kept = ~np.isnan(points).any(axis=1)
    if not kept.all():
        log.info("%s: %d of %d points are NaN and left out", file, np.sum(~kept), len(kept))
    return points[kept]


def _from_text(text: str) -> Any:
    points: list[list[float]] = []
    for number, line in enumerate(text.splitlines(), 1):
        words = line.replace('"', " ").replace(",", " ").lower().split()
        if not words or words[0].startswith("#") or words == ["x", "y", "z"]:
            continue
        if len(words) != 3:
            raise ValueError(f"line {number}: expected three numbers, got {shown(line.strip())}")
        try:
            points.append([number_in(word) for word in words])
        except ValueError as error:
            raise ValueError(f"line {number}: {error}") from error
    return np.array(points).reshape(-1, 3)


def _from_ply(data: bytes) -> Any:
    """The vertices of a PLY file; faces and later elements are ignored."""
    lines, body = _header(data, b"end_header")
    if lines[:1] != [["ply"]] or len(lines) < 2 or lines[1][:1] != ["format"] or len(lines[1]) != 3:
        raise ValueError("it does not begin as a PLY file")
    order = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[lines[1][1]]
    elements: list[tuple[str, int, list[str], list[str]]] = []
    for words in lines[2:-1]:
        match words:
            case ["comment" | "obj_info", *_]:
                pass
            case ["element", name, number]:
                elements.append((name, _whole(number), [], []))
            case ["property", kind, name]:
                elements[-1][2].append(name)
                elements[-1][3].append((order or "<") + _PLY_TYPES[kind])
            case ["property", "list", _, _, name]:
                elements[-1][2].append(name)
                elements[-1][3].append("")  # rows of several lengths
            case _:
                raise ValueError(f"{' '.join(words)!r} is no line of a header")
    if not elements or elements[0][0] != "vertex" or "" in elements[0][3]:
        raise ValueError("its first element is not a vertex of numbers")
    _, count, names, formats = elements[0]
    places = {name: i for i, name in enumerate(names)}
    return _columns(body, formats, [places[axis] for axis in "xyz"], count, text=not order)


def _from_pcd(data: bytes) -> Any:
    """The fields x, y and z of a PCD file, the format of the Point Cloud Library."""
    lines, body = _header(data, b"DATA")
    header = {words[0]: words[1:] for words in lines if words and not words[0].startswith("#")}
    names, kinds = header["FIELDS"], header["TYPE"]
    counts = [_whole(word) for word in header.get("COUNT", ["1"] * len(names))]
    (rows,) = (_whole(word) for word in header["POINTS"])
    (coding,) = header["DATA"]
    if coding not in ("ascii", "binary", "binary_compressed"):
        raise ValueError(f"its DATA is {coding}, expected ascii, binary or binary_compressed")
    formats: list[str] = []
    places: dict[str, int] = {}
    for name, kind, size, count in zip(names, kinds, header["SIZE"], counts, strict=True):
        places[name] = len(formats)
        formats += [_PCD_TYPES[kind, size]] * min(count, _MAX_COLUMNS)
    if coding == "binary_compressed":
        body = _interleaved(_uncompressed(body), names, counts, header["SIZE"], rows)
    return _columns(body, formats, [places[axis] for axis in "xyz"], rows, text=coding == "ascii")


def _uncompressed(body: bytes) -> bytes:
    """Decompress LibLZF data after two sizes: literal runs, and references to earlier output."""
    packed, size = (int.from_bytes(body[at : at + 4], "little") for at in (0, 4))
    data = body[8 : 8 + packed]
    if len(data) < packed or size > MAX_BYTES:
        raise ValueError(f"it holds {len(data)} of {packed} bytes for {size}, of which {MAX_BYTES} are the most")
    out = bytearray()
    at = 0
    try:
        while at < packed:
            control = data[at]
            at += 1
            if control < 32:
                out += data[at : at + control + 1]
                at += control + 1
                continue
            length = control >> 5
            if length == 7:
                length += data[at]
                at += 1
            back = (control % 32 << 8) + data[at] + 1
            at += 1
            # A reference may overlap its own output, which then repeats.
            seen = out[len(out) - back :][: length + 2] if back <= len(out) else b""
            out += (seen * (-(-(length + 2) // back)))[: length + 2]
            if not seen or len(out) > size:
                break
    except IndexError:
        pass
    if len(out) != size:
        raise ValueError("its compressed data are damaged")
    return bytes(out)


def _interleaved(data: bytes, names: list[str], counts: list[int], sizes: list[str], rows: int) -> bytes:
    """The points one after the other; compressed files have one field after the other."""
    widths = [min(count, _MAX_COLUMNS) * _whole(size) for _, count, size in zip(names, counts, sizes, strict=True)]
    if len(data) != rows * sum(widths):
        raise ValueError(f"it holds {len(data)} bytes, the header says {rows * sum(widths)}")
    starts = np.cumsum([0, *(rows * width for width in widths)]).tolist()
    fields = [
        np.frombuffer(data, np.uint8, rows * width, start).reshape(rows, width)
        for width, start in zip(widths, starts, strict=False)
    ]
    return np.concatenate(fields, axis=1).tobytes()


def _header(data: bytes, last: bytes) -> tuple[list[list[str]], bytes]:
    """The words of the header's lines up to the one that begins with `last`, and the remaining bytes."""
    found = re.search(rb"^" + last + rb"[^\n]*\n", data[:_MAX_HEADER], re.MULTILINE)
    if found is None:
        raise ValueError(f"its header has no line {last.decode()!r}")
    return [line.split() for line in data[: found.end()].decode("latin-1").splitlines()], data[found.end() :]


def _columns(body: bytes, formats: list[str], columns: list[int], rows: int, *, text: bool) -> Any:
    """Some columns of rows of numbers."""
    if len(formats) > _MAX_COLUMNS:
        raise ValueError(f"it has more than {_MAX_COLUMNS} values for each point")
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


def _whole(word: str) -> int:
    if not (word.isascii() and word.isdigit() and len(word) < 12):
        raise ValueError(f"{word!r} is no count")
    return int(word)


_READERS: dict[str, Callable[[bytes], Any]] = {
    ".npy": parse_array,
    ".ply": _from_ply,
    ".pcd": _from_pcd,
}
