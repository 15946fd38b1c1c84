"""Meshes that are not convex as Coal takes them: a hollow surface, and whether a point is inside."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import coal
import numpy as np

from rr1plan.checks import Array
from rr1plan.collision.convex.mesh_trees import orientations_of
from rr1plan.shapes import Mesh

# Far below a micrometer, as a share of a mesh's size.
_A_LITTLE = 1e-12


def surface_of(mesh: Mesh) -> Any:
    """A mesh as Coal's hierarchy of triangles: a body wholly inside does not touch it."""
    corners = mesh.vertices[mesh.faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    # A sphere is in contact with any triangle that has no area at all, says Coal.
    corners[areas == 0.0] += _A_LITTLE * float(np.abs(corners).max()) * np.eye(3)
    vertices, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    vertices.extend(list(corners.reshape(-1, 3)))
    triangles.extend([coal.Triangle(3 * i, 3 * i + 1, 3 * i + 2) for i in range(len(corners))])
    surface = coal.BVHModelOBBRSS()
    surface.beginModel(len(corners), len(vertices))
    surface.addSubModel(vertices, triangles)
    surface.endModel()
    return surface


def holds_point(mesh: Mesh, point: Array) -> bool:
    """Whether a point (3,) in the mesh's frame is inside its closed parts: they wind around it.

    The solid angle of each triangle: Van Oosterom, Strackee, The Solid Angle of a Plane Triangle, 1983.
    """
    low, high, triangles = _closed_triangles(mesh)
    if (point < low).any() or (point > high).any():
        return False
    a, b, c = (triangles[:, k] - point for k in range(3))
    la, lb, lc = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    ab, bc, ca = (np.einsum("ij,ij->i", x, y) for x, y in ((a, b), (b, c), (c, a)))
    angle = 2.0 * np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb)
    return bool(abs(angle.sum()) > 2.0 * np.pi)


@lru_cache(maxsize=64)
def _closed_triangles(mesh: Mesh) -> tuple[Array, Array, Array]:
    """Corners of the triangles of closed parts, shape (n, 3, 3), and the ends of the box around them."""
    turns = orientations_of(mesh)
    faces = np.where(turns[:, None] < 0, mesh.faces[:, ::-1], mesh.faces)[turns != 0]
    corners = mesh.vertices[faces]
    return corners.min(axis=(0, 1), initial=np.inf), corners.max(axis=(0, 1), initial=-np.inf), corners
