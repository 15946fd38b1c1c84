"""Triangulation of concave faces of mesh files, which readers divide into fans that cover their notches."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.errors import FormatError

_VERTEX = re.compile(rb"^v +(\S+) +(\S+) +(\S+)", re.MULTILINE)
_POLYGON = re.compile(rb"^f(?: +\S+){4,} *$", re.MULTILINE)
# Turns inward are rounding errors below this fraction of the square of a face's area. Corners are on the edge of a
# triangle at this fraction of its area.
_INWARD, _ON_EDGE = 1e-9, 1e-12
# Most tests for ears for each corner, of which simple polygons take about three, and most squared corners of all
# concave faces.
_MOST_TESTS, _MOST_WORK = 6, 3 * 10**7


def with_triangulated_faces(data: bytes, file: Path) -> bytes:
    """The OBJ with a line for each triangle of its concave faces.

    Args:
        data: An OBJ whose faces count vertices from 1 on. If it is damaged, it is returned as it is, and the parser
            says what is wrong.
        file: Its file, for messages.

    Raises:
        FormatError: too many corners in concave faces.
    """
    lines = list(_POLYGON.finditer(data))
    if not lines:
        return data
    corners = [line[0].split()[1:] for line in lines]
    try:
        vertices = np.array(_VERTEX.findall(data)).astype(float)
        faces = [[int(corner.split(b"/")[0]) - 1 for corner in face] for face in corners]
    except ValueError:
        return data
    if max(map(max, faces)) >= len(vertices):
        return data
    triangles = concave_triangles(vertices, faces, file)
    parts, end = [], 0
    for i, found in sorted(triangles.items()):
        text = b"\n".join(b"f " + b" ".join(corners[i][k] for k in triangle) for triangle in found)
        parts += [data[end : lines[i].start()], text]
        end = lines[i].end()
    return b"".join([*parts, data[end:]])


def concave_triangles(vertices: Array, faces: Sequence[Sequence[int]], file: Path) -> dict[int, list[list[int]]]:
    """Triangles of the concave ones of faces.

    Args:
        vertices: Vertices, shape (n, 3).
        faces: Indices of the vertices of each face in order, from 0 on.
        file: Their file, for messages.

    Returns:
        Three positions in the face for each triangle, by the index of the face.

    Raises:
        FormatError: too many corners in concave faces.
    """
    by_size: dict[int, list[int]] = {}
    for i, face in enumerate(faces):
        if len(face) > 3:
            by_size.setdefault(len(face), []).append(i)
    concave: dict[int, Array] = {}
    with np.errstate(all="ignore"):  # numbers that are too large are refused later
        for same in by_size.values():
            found = _concave(vertices[np.array([faces[i] for i in same])])
            concave |= {same[k]: outline for k, outline in found.items()}
        if sum(len(outline) ** 2 for outline in concave.values()) > _MOST_WORK:
            raise FormatError(
                "has concave faces with too many corners, expected triangles: export it as triangles", file
            )
        return {i: _clip_ears(outline) for i, outline in concave.items()}


def _concave(points: Array) -> dict[int, Array]:
    """The concave ones of faces (m, n, 3), as counter-clockwise projections (n, 2), by index."""
    edges = np.roll(points, -1, axis=1) - points
    fan = points - points[:, :1]
    normals = np.cross(fan, np.roll(fan, -1, axis=1)).sum(axis=1)
    turns = np.einsum("ijk,ik->ij", np.cross(np.roll(edges, 1, axis=1), edges), normals)
    concave = (turns < -_INWARD * (normals**2).sum(axis=1)[:, None]).any(axis=1)
    found = {}
    for i in np.flatnonzero(concave).tolist():
        # Along the axis nearest to the normal.
        axis = int(np.argmax(np.abs(normals[i])))
        kept = [(axis + 1) % 3, (axis + 2) % 3]
        found[i] = points[i][:, kept if normals[i, axis] > 0.0 else kept[::-1]]
    return found


def _clip_ears(points: Array) -> list[list[int]]:
    """Ear clipping (Meisters 1975) of a counter-clockwise polygon (n, 2); holes may be connected by double edges.

    All corners are used, so that a surface stays closed. The triangles of a polygon that crosses itself are arbitrary.
    Only the two neighbors of a clipped ear can become ears, unless corners coincide or are on a line.
    """
    count = len(points)
    before, after = (np.roll(range(count), shift).tolist() for shift in (1, -1))
    left = np.ones(count, dtype=bool)
    waiting, some_clipped = deque(range(count)), False
    tests = _MOST_TESTS * count
    found: list[list[int]] = []
    while len(found) < count - 2:
        if some_clipped and not waiting:
            waiting, some_clipped = deque(np.flatnonzero(left).tolist()), False
        if waiting and tests > 0:
            k = waiting.popleft()
            if not left[k]:
                continue
            tests -= 1
            if not _is_ear(points, left, [before[k], k, after[k]]) and len(found) < count - 3:
                continue
            some_clipped = True
        else:
            k = int(left.argmax())
        found.append([before[k], k, after[k]])
        left[k] = False
        before[after[k]], after[before[k]] = before[k], after[k]
        waiting += [before[k], after[k]]
    return found


def _is_ear(points: Array, left: NDArray[np.bool_], corners: list[int]) -> bool:
    """Whether the triangle at a corner has an area, and no other corner that is left in it or on its edges."""
    triangle = points[corners]
    edges = np.roll(triangle, -1, axis=0) - triangle
    area = float(_cross(edges[0], edges[1]))
    if not area > 0.0:
        return False
    others = points[left]
    inside = others[(_cross(edges, others[:, None] - triangle) >= -_ON_EDGE * area).all(axis=1)]
    return bool((inside[:, None] == triangle).all(axis=2).any(axis=1).all())


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
