"""Triangulation of the concave faces of OBJ files, which readers divide into fans that cover their notches."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from rr1plan.checks import Array
from rr1plan.errors import FormatError

_VERTEX = re.compile(rb"^v +(\S+) +(\S+) +(\S+)", re.MULTILINE)
_POLYGON = re.compile(rb"^f(?: +\S+){4,} *$", re.MULTILINE)
# Turns inward are rounding errors below this fraction of the square of a face's area. Corners are on the edge of a
# triangle at this fraction of its area.
_INWARD, _ON_EDGE = 1e-9, 1e-12
# Most tests for ears for each corner, of which simple polygons take few, and most squared corners of all concave faces.
_MOST_TESTS, _MOST_WORK = 20, 3 * 10**7
_Face = tuple[re.Match[bytes], list[bytes]]


def with_triangulated_faces(data: bytes, file: Path) -> bytes:
    """The OBJ with a line for each triangle of its concave faces.

    Args:
        data: An OBJ whose faces count vertices from 1 on. If it is damaged, it is returned as it is.
        file: Its file, for messages.

    Raises:
        FormatError: too many corners in concave faces.
    """
    faces: dict[int, list[_Face]] = {}
    for line in _POLYGON.finditer(data):
        corners = line[0].split()[1:]
        faces.setdefault(len(corners), []).append((line, corners))
    if not faces:
        return data
    try:
        vertices = np.array(_VERTEX.findall(data)).astype(float)
        with np.errstate(all="ignore"):  # numbers that are too large are refused later
            concave = [found for same in faces.values() for found in _concave(vertices, same)]
    except (ValueError, IndexError):  # the parser says what is wrong
        return data
    if sum(len(points) ** 2 for *_, points in concave) > _MOST_WORK:
        raise FormatError("has concave faces with too many corners, expected triangles: export it as triangles", file)
    parts, end = [], 0
    for line, corners, points in sorted(concave, key=lambda found: found[0].start()):
        lines = (b"f " + b" ".join(corners[k] for k in triangle) for triangle in _clip_ears(points))
        parts += [data[end : line.start()], b"\n".join(lines)]
        end = line.end()
    return b"".join([*parts, data[end:]])


def _concave(vertices: Array, faces: list[_Face]) -> Iterator[tuple[re.Match[bytes], list[bytes], Array]]:
    """The concave ones of faces with the same number of corners, each with its counter-clockwise projection (n, 2)."""
    numbers = np.array([[int(corner.split(b"/")[0]) for corner in corners] for _, corners in faces])
    points = vertices[numbers - 1]
    edges = np.roll(points, -1, axis=1) - points
    fan = points - points[:, :1]
    normals = np.cross(fan, np.roll(fan, -1, axis=1)).sum(axis=1)
    turns = np.einsum("ijk,ik->ij", np.cross(np.roll(edges, 1, axis=1), edges), normals)
    concave = (turns < -_INWARD * (normals**2).sum(axis=1)[:, None]).any(axis=1)
    for i in np.flatnonzero(concave).tolist():
        # Along the axis nearest to the normal.
        axis = int(np.argmax(np.abs(normals[i])))
        kept = [(axis + 1) % 3, (axis + 2) % 3]
        yield *faces[i], points[i][:, kept if normals[i, axis] > 0.0 else kept[::-1]]


def _clip_ears(points: Array) -> list[list[int]]:
    """Ear clipping (Meisters 1975) of a counter-clockwise polygon (n, 2); holes may be connected by double edges.

    All corners are used, so that a surface stays closed. The triangles of a polygon that crosses itself are arbitrary.
    """
    left, found = list(range(len(points))), []
    k, tests = 1, _MOST_TESTS * len(points)
    while len(left) > 3:
        for _ in left:
            k %= len(left)
            tests -= 1
            if tests < 0 or _is_ear(points, left, k):
                break
            k += 1
        found.append([left[k - 1], left[k], left[(k + 1) % len(left)]])
        del left[k]
    return [*found, left]


def _is_ear(points: Array, left: list[int], k: int) -> bool:
    """Whether the triangle at a corner has an area, and no other corner in it or on its edges."""
    triangle = points[[left[k - 1], left[k], left[(k + 1) % len(left)]]]
    edges = np.roll(triangle, -1, axis=0) - triangle
    area = float(_cross(edges[0], edges[1]))
    if not area > 0.0:
        return False
    others = points[left]
    inside = (_cross(edges, others[:, None] - triangle) >= -_ON_EDGE * area).all(axis=1)
    same = (others[:, None] == triangle).all(axis=2).any(axis=1)
    return not (inside & ~same).any()


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
