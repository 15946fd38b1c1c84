"""Meshes that are not convex, made for tests."""

from __future__ import annotations

import numpy as np

from rr1plan.shapes import Mesh


def revolved(profile: np.ndarray, sides: int, *, closed_profile: bool = True) -> Mesh:
    """A profile (n, 2) of radius and height revolved about z; counter-clockwise profiles face outwards."""
    angles = 2.0 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    r, z = profile.T
    points = np.concatenate([r[:, None, None] * ring, np.broadcast_to(z[:, None, None], (len(r), sides, 1))], axis=2)
    index = np.arange(len(r) * sides).reshape(len(r), sides)
    if closed_profile:
        index = np.concatenate([index, index[:1]])
    a, b = index[:-1], index[1:]
    c, d = np.roll(b, -1, axis=1), np.roll(a, -1, axis=1)
    faces = np.concatenate([np.stack([a, d, c], axis=2).reshape(-1, 3), np.stack([a, c, b], axis=2).reshape(-1, 3)])
    return merged(Mesh(points.reshape(-1, 3), faces))


def merged(mesh: Mesh) -> Mesh:
    """Merge equal vertices; drop triangles without area."""
    vertices, which = np.unique(mesh.vertices.round(12), axis=0, return_inverse=True)
    faces = which.ravel()[mesh.faces]
    whole = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    return Mesh(vertices, faces[whole])


def joined(*meshes: Mesh) -> Mesh:
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
    return Mesh(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces))


def torus(radius: float = 0.2, tube: float = 0.06, sides: int = 24, around: int = 12) -> Mesh:
    angles = 2.0 * np.pi * np.arange(around) / around
    return revolved(np.stack([radius + tube * np.cos(angles), tube * np.sin(angles)], axis=1), sides)


def mug(sides: int = 48, levels: int = 20) -> Mesh:
    """A cup with a wall of 4 mm and a handle: two closed parts that overlap; about 2400 triangles."""
    heights = np.linspace(0.0, 0.1, levels)
    outer = [(0.0, 0.0), *((0.04, z) for z in heights)]
    inner = [(0.036, z) for z in heights[:0:-1] if z > 0.004] + [(0.0, 0.004)]
    cup = revolved(np.array(outer + inner), sides, closed_profile=False)
    ring = torus(0.025, 0.005, 24, 10)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    return joined(cup, Mesh(ring.vertices @ turn.T + (0.055, 0.0, 0.05), ring.faces))


def terrain(cells: int = 22, size: float = 1.0, height: float = 0.08, seed: int = 0) -> Mesh:
    """An open surface of 2 cells^2 triangles over a square."""
    rng = np.random.default_rng(seed)
    at = np.linspace(-0.5 * size, 0.5 * size, cells + 1)
    x, y = np.meshgrid(at, at, indexing="ij")
    z = np.zeros_like(x)
    for _ in range(6):
        kx, ky, phase = rng.uniform(-9.0, 9.0), rng.uniform(-9.0, 9.0), rng.uniform(0.0, 6.0)
        z += np.sin((kx * x + ky * y) / size + phase) / 6.0
    index = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], 2).reshape(-1, 3), np.stack([a, c, d], 2).reshape(-1, 3)])
    return Mesh(np.stack([x, y, height * z], 2).reshape(-1, 3), faces)


def half_shell(radius: float = 0.2, wall: float = 0.01, sides: int = 36, levels: int = 12) -> Mesh:
    """A closed surface in the shape of a bowl, open at the top."""
    angles = np.linspace(-0.5 * np.pi, 0.0, levels)
    outer = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    inner = (radius - wall) * np.stack([np.cos(angles), np.sin(angles)], axis=1)[::-1]
    outer[0, 0] = inner[-1, 0] = 0.0
    return revolved(np.concatenate([outer, inner]), sides, closed_profile=False)


def open_bowl(radius: float = 0.2, sides: int = 24, levels: int = 8) -> Mesh:
    """Half a sphere without a wall: it has no inside."""
    angles = np.linspace(-0.5 * np.pi, 0.0, levels)
    profile = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    profile[0, 0] = 0.0
    return revolved(profile, sides, closed_profile=False)


def soup(count: int = 20, size: float = 0.4, seed: int = 0) -> Mesh:
    """Unconnected random triangles."""
    rng = np.random.default_rng(seed)
    centers = rng.uniform(-0.5 * size, 0.5 * size, (count, 1, 3))
    points = (centers + rng.normal(scale=0.15 * size, size=(count, 3, 3))).reshape(-1, 3)
    return Mesh(points, np.arange(3 * count).reshape(-1, 3))


def angle_block(length: float = 0.3, wall: float = 0.1) -> Mesh:
    """A closed L of twelve corners."""
    plan = np.array([(0, 0), (length, 0), (length, wall), (wall, wall), (wall, length), (0, length)])
    low, high = (np.column_stack([plan, np.full(6, z)]) for z in (0.0, 0.15))
    caps = np.array([(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)])
    sides = [face for i in range(6) for face in ((i, (i + 1) % 6, 6 + (i + 1) % 6), (i, 6 + (i + 1) % 6, 6 + i))]
    return Mesh(np.concatenate([low, high]), np.concatenate([caps[:, ::-1], caps + 6, np.array(sides)]))
