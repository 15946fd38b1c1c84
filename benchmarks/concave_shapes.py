"""Concave triangle meshes: surfaces of revolution, or a surface over a square."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import rr1plan as rp
from rr1plan.checks import Array

_INTS = NDArray[np.int64]


def lathe(profile: Array, sides: int, *, ring: bool = False) -> rp.Mesh:
    """A profile revolved about z.

    Args:
        profile: Radius and height of its points [m], counter-clockwise for a ring, shape (n, 2).
        sides: Corners of the circle.
        ring: Whether the profile is closed and gives a ring; otherwise it starts and ends on the axis, or is open.
    """
    angles = 2.0 * np.pi * np.arange(sides) / sides
    radius, height = np.asarray(profile).T
    points = np.stack(np.broadcast_arrays(radius[:, None] * np.cos(angles), radius[:, None] * np.sin(angles),
                                          height[:, None]), axis=2)  # fmt: skip
    index = np.arange(points.shape[0] * sides).reshape(-1, sides)
    faces = _quads(np.concatenate([index, index[:1]]) if ring else index, around=True)
    # Merge the points of a circle of radius zero, and drop triangles between two of them.
    index[radius == 0.0] = index[radius == 0.0, :1]
    faces = index.ravel()[faces]
    whole = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    used, faces = np.unique(faces[whole], return_inverse=True)
    return rp.Mesh(points.reshape(-1, 3)[used], faces.reshape(-1, 3))


def cup(radius: float, height: float, wall: float, sides: int, levels: int) -> rp.Mesh:
    """A closed surface in the shape of a cup, open at the top: its wall has an inside and an outside."""
    heights = np.linspace(0.0, height, levels)
    outer = np.column_stack([np.full(levels, radius), heights])
    inner = np.column_stack([np.full(levels, radius - wall), np.linspace(height, wall, levels)])
    return lathe(np.concatenate([[[0.0, 0.0]], outer, inner, [[0.0, wall]]]), sides)


def ring(radius: float, tube: float, sides: int, around: int) -> rp.Mesh:
    """A torus."""
    angles = 2.0 * np.pi * np.arange(around) / around
    return lathe(np.column_stack([radius + tube * np.cos(angles), tube * np.sin(angles)]), sides, ring=True)


def mug(sides: int = 36, levels: int = 16) -> rp.Mesh:
    """A cup of 8 cm with a wall of 4 mm, and a handle: two closed parts that overlap; 2592 triangles by default."""
    body, handle = cup(0.04, 0.1, 0.004, sides, levels), ring(0.025, 0.005, sides // 2, levels // 2)
    x, y, z = handle.vertices.T
    corners = np.concatenate([body.vertices, np.column_stack([x + 0.055, -z, y + 0.05])])
    return rp.Mesh(corners, np.concatenate([body.faces, handle.faces + len(body.vertices)]))


def bowl(radius: float, sides: int, levels: int) -> rp.Mesh:
    """The lower half of a sphere without a wall: an open surface."""
    angles = np.linspace(-0.5 * np.pi, 0.0, levels)
    profile = radius * np.column_stack([np.cos(angles), np.sin(angles)])
    profile[0, 0] = 0.0
    return lathe(profile, sides)


def terrain(rng: np.random.Generator, cells: int, size: float, height: float) -> rp.Mesh:
    """An open surface of 2 cells^2 triangles over a square, hills and valleys of up to `height` [m]."""
    at = np.linspace(-0.5, 0.5, cells + 1)
    x, y = np.meshgrid(at, at, indexing="ij")
    waves = rng.uniform([-12.0, -12.0, 0.0], [12.0, 12.0, 2.0 * np.pi], (8, 3))
    z = sum(np.sin(kx * x + ky * y + phase) for kx, ky, phase in waves) / len(waves)
    index = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    return rp.Mesh(np.stack([size * x, size * y, height * z], axis=2).reshape(-1, 3), _quads(index, around=False))


def _quads(index: _INTS, *, around: bool) -> _INTS:
    """Two triangles for each cell of a grid of vertices (m, n); `around`: the last column is next to the first."""
    index = np.column_stack([index, index[:, 0]]) if around else index
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    if not around:
        b, d = d, b
    return np.concatenate([np.stack([a, b, c], axis=2).reshape(-1, 3), np.stack([a, c, d], axis=2).reshape(-1, 3)])
