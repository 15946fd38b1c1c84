"""A mesh in the shape of a boat, in any number of triangles."""

from __future__ import annotations

import numpy as np

from rr1plan.shapes import Mesh

# Length, width and draft [m].
_SIZE = (0.60, 0.31, 0.48)


def boat_mesh(stations: int, around: int) -> Mesh:
    """Half an ellipsoid under a flat deck; closed and convex, of 2 * stations * around triangles.

    Args:
        stations: Number of cross sections between stern and bow.
        around: Number of vertices of each cross section.
    """
    along, across = np.pi * np.arange(1, stations + 1) / (stations + 1), np.pi * np.arange(around) / (around - 1)
    u, v = np.meshgrid(along, across, indexing="ij")
    hull = np.stack([-np.cos(u), np.sin(u) * np.cos(v), -np.sin(u) * np.sin(v)], axis=-1).reshape(-1, 3)
    points = np.concatenate([hull, [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]]) * np.array(_SIZE) * [0.5, 0.5, 1.0]
    here = np.arange(stations * around).reshape(stations, around)
    beside = np.roll(here, -1, axis=1)  # the deck joins the last vertex of a section to the first
    bow, stern = (np.full((1, around), len(hull) + i) for i in (0, 1))
    faces = [
        np.stack([here[:-1], here[1:], beside[1:]], axis=-1),
        np.stack([here[:-1], beside[1:], beside[:-1]], axis=-1),
        np.stack([here[-1:], bow, beside[-1:]], axis=-1),
        np.stack([here[:1], beside[:1], stern], axis=-1),
    ]
    return Mesh(points, np.concatenate([part.reshape(-1, 3) for part in faces]))
