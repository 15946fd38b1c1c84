"""Convex collision shapes from meshes of any kind."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from rr1plan.checks import known_name
from rr1plan.shapes import Mesh

Convexity = Literal["hull", "pieces"]


def convex_hull(vertices: np.ndarray) -> Mesh:
    """The convex hull of points (n, 3)."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(vertices)
    index = {int(v): k for k, v in enumerate(hull.vertices)}
    points = vertices[hull.vertices]
    faces = np.array([[index[int(v)] for v in simplex] for simplex in hull.simplices])
    a, b, c = (points[faces[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, ::-1]
    return Mesh(points, faces, convex=True)


def convex_shapes(meshes: Sequence[Mesh], convex: Convexity) -> list[Mesh]:
    """Convex meshes that together contain the given ones."""
    known_name("convex", convex, ("hull", "pieces"))
    return [convex_hull(np.concatenate([m.vertices for m in meshes]))]
