"""Shapes of a page as triangles with normals, for 3-D files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.held_interrupts import interrupts_held
from rr1plan.playback.viewer.page_arrays import unpack_array

_SECTIONS = 32  # of cylinders, capsules and spheres
_SHARP = np.radians(35.0)  # edges with a larger angle between their faces are drawn sharp, as on the page
_PLANE = 4.0  # [m] edge of the square that represents a half-space


class Triangles(NamedTuple):
    """Triangles with a normal at each vertex.

    Args:
        vertices: Positions [m], shape (n, 3).
        normals: Unit vectors, shape (n, 3).
        faces: Indices of vertices, shape (m, 3).
    """

    vertices: Array
    normals: Array
    faces: NDArray[np.integer[Any]]

    def moved(self, T: Array) -> Triangles:
        """The triangles transformed by a pose (4, 4)."""
        return Triangles(self.vertices @ T[:3, :3].T + T[:3, 3], self.normals @ T[:3, :3].T, self.faces)


def joined(parts: Iterable[Triangles]) -> Triangles:
    """Several sets of triangles merged into one."""
    parts = list(parts)
    firsts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    return Triangles(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.faces + first for part, first in zip(parts, firsts, strict=False)]),
    )


def shape_triangles(shape: Mapping[str, Any]) -> Triangles:
    """The surface of a shape of a page's document.

    A half-space is a square of 4 m around the foot of its origin, a point cloud is a cube for each point.
    """
    match shape["kind"]:
        case "box":
            return _box(tuple(shape["size"]))
        case "sphere" | "cylinder" | "capsule" as kind:
            return _round(kind, shape["radius"], shape.get("length", 0.0))
        case "halfspace":
            return _square(np.array(shape["normal"], dtype=float), shape["offset"])
        case "cloud":
            cube, points = _box((shape["resolution"],) * 3), unpack_array(shape["points"]).astype(float)
            return _copies(cube, points)
        case _:
            vertices, faces = (unpack_array(shape[name]) for name in ("vertices", "faces"))
            return _with_normals(vertices.astype(float), faces)


@lru_cache(maxsize=256)
def _box(size: tuple[float, ...]) -> Triangles:
    with interrupts_held():
        import trimesh

    box = trimesh.creation.box(size)
    return _with_normals(box.vertices, box.faces)


@lru_cache(maxsize=256)
def _round(kind: str, radius: float, length: float) -> Triangles:
    with interrupts_held():
        import trimesh

    if kind == "sphere":
        ball = trimesh.creation.uv_sphere(radius, count=(_SECTIONS // 2, _SECTIONS))
        return Triangles(ball.vertices, ball.vertices / np.linalg.norm(ball.vertices, axis=1)[:, None], ball.faces)
    if kind == "cylinder":
        solid = trimesh.creation.cylinder(radius, length, sections=_SECTIONS)
    else:
        solid = trimesh.creation.capsule(length, radius, count=(_SECTIONS, _SECTIONS))
    return _with_normals(solid.vertices - solid.bounds.mean(axis=0), solid.faces)


def _square(normal: Array, offset: float) -> Triangles:
    across = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    across /= np.linalg.norm(across)
    along = np.cross(normal, across)
    corners = [
        offset * normal + 0.5 * _PLANE * (x * across + y * along) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    return Triangles(np.array(corners), np.tile(normal, (4, 1)), np.array([[0, 1, 2], [0, 2, 3]]))


def _copies(solid: Triangles, centers: Array) -> Triangles:
    count = len(solid.vertices)
    return Triangles(
        (centers[:, None] + solid.vertices).reshape(-1, 3),
        np.tile(solid.normals, (len(centers), 1)),
        (count * np.arange(len(centers))[:, None, None] + solid.faces).reshape(-1, 3),
    )


def _with_normals(vertices: Array, faces: NDArray[np.integer[Any]]) -> Triangles:
    """Triangles with normals: smooth where faces meet at small angles, with sharp edges elsewhere."""
    with interrupts_held():
        import trimesh

    mesh = trimesh.Trimesh(vertices, faces, process=True)  # merges equal vertices
    smooth = trimesh.graph.smooth_shade(mesh, angle=_SHARP)
    normals = np.array(smooth.vertex_normals)
    missing = np.abs(np.linalg.norm(normals, axis=1) - 1.0) > 1e-3  # of faces without an area
    normals[missing] = (0.0, 0.0, 1.0)
    return Triangles(np.array(smooth.vertices), normals, np.array(smooth.faces))
