"""Points inside closed meshes, by winding numbers."""

from __future__ import annotations

import numpy as np

from rr1plan.checks import Array
from rr1plan.shapes import Mesh

# Open surfaces have smaller winding numbers, except for points closer to them than this share.
_INSIDE = 0.99


def is_inside(mesh: Mesh, point: Array) -> bool:
    """Whether a point (3,) in the mesh's coordinates is enclosed by it (van Oosterom and Strackee 1983)."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] - point for k in range(3))
    la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
    triple = np.einsum("ij,ij->i", a, np.cross(b, c))
    dots = np.einsum("ij,ij->i", a, b) * lc + np.einsum("ij,ij->i", b, c) * la + np.einsum("ij,ij->i", c, a) * lb
    angles = np.arctan2(triple, la * lb * lc + dots)
    return bool(abs(angles.sum()) / (2.0 * np.pi) > _INSIDE)
