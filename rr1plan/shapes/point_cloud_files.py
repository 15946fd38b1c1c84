"""Point clouds from files: .npy arrays, .ply and .pcd scans, and text with a point in each line."""

from __future__ import annotations

import logging
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
from rr1plan.shapes.ply_files import MAX_COLUMNS, header_lines, ply_points, rows_of, whole_number

log = logging.getLogger(__name__)

_TEXT = (".csv", ".xyz", ".txt")
_PCD_TYPES = {(kind.upper(), size): f"<{kind}{size}" for kind in "iuf" for size in "1248" if kind != "f" or size > "2"}


def load_point_cloud(file: str | Path, *, resolution: float = 0.02) -> PointCloud:
    """Read a scan as a shape for an obstacle.

        scene = scene.with_obstacle("scan", load_point_cloud("scan.pcd"))

    Args:
        file: A .npy file of shape (n, 3), a .ply or .pcd file, or text with a point in each line (.csv, .xyz, .txt):
            the columns that a header names x, y and z, or the first three. Others, such as colors, and comments (#, //)
            are skipped.
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
    """The columns that a header names x, y and z, or else the first three."""
    points: list[list[float]] = []
    columns, count = [0, 1, 2], 0
    for number, line in enumerate(text.splitlines(), 1):
        words = line.replace('"', " ").replace(",", " ").lower().split()
        if not words or words[0].startswith(("#", "//")):
            continue
        if {"x", "y", "z"} <= set(words):
            columns, count = [words.index(axis) for axis in "xyz"], len(words)
            continue
        count = count or len(words)
        # Commas between some of more than three numbers are decimal marks.
        is_mixed = len(words) > 3 and line.count(",") not in (0, len(words) - 1)
        if len(words) != count or not 3 <= count <= MAX_COLUMNS or is_mixed:
            wanted = f"{count} columns" if 3 < count != len(words) else "three numbers"
            raise ValueError(f"line {number}: expected {wanted}, got {shown(line.strip())}")
        try:
            points.append([number_in(words[k]) for k in columns])
        except ValueError as error:
            raise ValueError(f"line {number}: {error}") from error
    return np.array(points).reshape(-1, 3)


def _from_pcd(data: bytes) -> Any:
    """The fields x, y and z of a PCD file, the format of the Point Cloud Library."""
    lines, body = header_lines(data, b"DATA")
    header = {words[0]: words[1:] for words in lines if words and not words[0].startswith("#")}
    names, kinds = header["FIELDS"], header["TYPE"]
    counts = [whole_number(word) for word in header.get("COUNT", ["1"] * len(names))]
    (rows,) = (whole_number(word) for word in header["POINTS"])
    (coding,) = header["DATA"]
    if coding not in ("ascii", "binary", "binary_compressed"):
        raise ValueError(f"its DATA is {coding}, expected ascii, binary or binary_compressed")
    formats: list[str] = []
    places: dict[str, int] = {}
    for name, kind, size, count in zip(names, kinds, header["SIZE"], counts, strict=True):
        places[name] = len(formats)
        formats += [_PCD_TYPES[kind, size]] * min(count, MAX_COLUMNS)
    if coding == "binary_compressed":
        body = _interleaved(_uncompressed(body), names, counts, header["SIZE"], rows)
    return rows_of(body, formats, [places[axis] for axis in "xyz"], rows, text=coding == "ascii")


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
    widths = [min(count, MAX_COLUMNS) * whole_number(size) for _, count, size in zip(names, counts, sizes, strict=True)]
    if len(data) != rows * sum(widths):
        raise ValueError(f"it holds {len(data)} bytes, the header says {rows * sum(widths)}")
    starts = np.cumsum([0, *(rows * width for width in widths)]).tolist()
    fields = [
        np.frombuffer(data, np.uint8, rows * width, start).reshape(rows, width)
        for width, start in zip(widths, starts, strict=False)
    ]
    return np.concatenate(fields, axis=1).tobytes()


_READERS: dict[str, Callable[[bytes], Any]] = {
    ".npy": parse_array,
    ".ply": ply_points,
    ".pcd": _from_pcd,
}
