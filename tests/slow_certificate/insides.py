"""The inside of concave meshes.

A part of a mesh consists of triangles connected by edges that no third triangle shares. It is closed if each of its
edges belongs to an even number of its triangles. Only closed parts have an inside.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from functools import cached_property

import numpy as np

from rr1plan.checks import Array
from rr1plan.shapes import Mesh
from slow_certificate.polynomial_bounds import Mask

# Rays for meshes whose faces are not consistently oriented.
_RAYS = ((0.5257, 0.3141, 0.7905), (-0.7071, 0.6612, 0.2503), (0.1732, -0.8660, -0.4691))


class Inside:
    """The inside of a mesh.

    Args:
        mesh: The mesh.
    """

    def __init__(self, mesh: Mesh) -> None:
        self._corners = mesh.vertices[mesh.faces]
        _, welded = np.unique(mesh.vertices, axis=0, return_inverse=True)
        self._faces = welded.ravel()[mesh.faces].astype(np.int64)

    @cached_property
    def _closed(self) -> Mask:
        """The triangles of closed parts, shape (n,)."""
        edges: dict[tuple[int, int], list[int]] = defaultdict(list)
        for k, (a, b, c) in enumerate(self._faces.tolist()):
            for edge in ((a, b), (b, c), (c, a)):
                edges[min(edge), max(edge)].append(k)
        neighbors: dict[int, set[int]] = defaultdict(set)
        for sharing in edges.values():
            if len(sharing) == 2:
                neighbors[sharing[0]].add(sharing[1])
                neighbors[sharing[1]].add(sharing[0])
        part: dict[int, int] = {}
        for first in range(len(self._faces)):
            reached = [] if first in part else [first]
            part.setdefault(first, first)
            while reached:
                for other in neighbors[reached.pop()] - part.keys():
                    part[other] = first
                    reached.append(other)
        is_open = set()
        for (begin, end), sharing in edges.items():
            if begin != end:  # an edge of zero length bounds nothing
                times = Counter(part[k] for k in sharing)
                is_open |= {p for p, count in times.items() if count % 2}
        return np.array([part[k] not in is_open for k in range(len(self._faces))], dtype=np.bool_)

    @cached_property
    def _winds(self) -> bool:
        """Whether closed parts are consistently oriented: each edge occurs equally often in both directions."""
        faces = self._faces[self._closed]
        begin, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
        _, edge = np.unique(
            np.minimum(begin, end) * (1 + self._faces.max()) + np.maximum(begin, end), return_inverse=True
        )
        return bool((np.bincount(edge, weights=np.sign(end - begin)) == 0).all())

    def holds(self, point: Array) -> bool:
        """Whether a point (3,) that is not on the surface is inside."""
        corners, low, high = self._closed_corners
        if (point < low).any() or (point > high).any():
            return False
        a, b, c = corners - point
        return _winds_around(a, b, c) if self._winds else _crosses_oddly(a, b, c)

    @cached_property
    def _closed_corners(self) -> tuple[Array, Array, Array]:
        """First, second and third corners of closed parts, shape (3, m, 3), and the ends of the box around them [m]."""
        corners = np.ascontiguousarray(self._corners[self._closed].swapaxes(0, 1))
        return corners, corners.min(axis=(0, 1), initial=np.inf), corners.max(axis=(0, 1), initial=-np.inf)


def _winds_around(a: Array, b: Array, c: Array) -> bool:
    """Whether oriented triangles (m, 3) each wind around the origin.

    Van Oosterom, Strackee (1983), The solid angle of a plane triangle.
    """
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    base = la * lb * lc + np.einsum("ij,ij->i", a, b) * lc
    base += np.einsum("ij,ij->i", b, c) * la + np.einsum("ij,ij->i", c, a) * lb
    return bool(abs(np.arctan2(volume, base).sum()) > np.pi)


def _crosses_oddly(a: Array, b: Array, c: Array) -> bool:
    """Whether any of three rays from the origin crosses triangles (m, 3) each an odd number of times."""
    for ray in _RAYS:
        sides = np.stack([np.cross(u, v) @ np.array(ray) for u, v in ((a, b), (b, c), (c, a))])
        pierced = (sides > 0.0).all(axis=0) | (sides < 0.0).all(axis=0)
        ahead = np.einsum("ij,ij->i", a, np.cross(b, c)) * sides.sum(axis=0) > 0.0
        if np.count_nonzero(pierced & ahead) % 2:
            return True
    return False
