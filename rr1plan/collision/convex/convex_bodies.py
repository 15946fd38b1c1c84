"""Shapes as Coal's collision geometries.

All are solid except concave meshes of obstacles, which are surfaces in Coal; `coal_pairs.py` adds their interior.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import TypeGuard

import coal
import numpy as np

from rr1plan.checks import Array
from rr1plan.collision.convex.mesh_trees import orientations_of
from rr1plan.errors import BackendError, InputError
from rr1plan.progress import ProgressCallback
from rr1plan.robot.link_contacts import coal_solid
from rr1plan.scene import Scene
from rr1plan.shapes import HalfSpace, Mesh, PointCloud, Shape
from rr1plan.shapes.convex_decomposition import are_inside, convex_pieces
from rr1plan.shapes.convex_hulls import convex_hull, is_own_hull

# Octomap's keys have 16 bits: it drops cells farther out silently.
_OCTREE_REACH = 32_000


def solid_pieces(shape: Shape) -> tuple[Shape, ...]:
    """The shape as solids for Coal: itself, or the convex pieces of a mesh.

    Raises:
        InputError: a mesh without volume, or a point cloud too far out for an octree.
    """
    if isinstance(shape, PointCloud):
        _check_reach(shape)
    return _mesh_pieces(_Whole(shape)) if isinstance(shape, Mesh) else (shape,)


def obstacle_pieces(shape: Shape) -> tuple[Shape, ...]:
    """The shape of an obstacle as it is checked: itself, or the hull of a convex mesh.

    Raises:
        InputError: a point cloud too far out for an octree.
    """
    if isinstance(shape, Mesh):
        return _obstacle_mesh(shape)
    return solid_pieces(shape)


@lru_cache(maxsize=256)
def _obstacle_mesh(mesh: Mesh) -> tuple[Mesh, ...]:
    return (convex_hull(mesh.vertices),) if mesh.convex or is_own_hull(mesh) else (mesh,)


def is_concave(shape: Shape) -> TypeGuard[Mesh]:
    """Whether a shape is a mesh that is checked triangle by triangle."""
    return isinstance(shape, Mesh) and not shape.convex


_SURFACELESS = (HalfSpace, PointCloud, Mesh)


def is_surfaceless(shape: Shape) -> bool:
    """Whether a shape is a half-space, a point cloud or a concave mesh: distances are measured to it, not from it."""
    return isinstance(shape, _SURFACELESS) and not (isinstance(shape, Mesh) and shape.convex)


def cut_meshes(scene: Scene, progress: ProgressCallback) -> None:
    """Decompose all concave meshes that move into convex pieces, which may take long, before they are used.

    Args:
        scene: The scene.
        progress: Called about ten times a second, with the spent fraction of the allowed time; returns False to cancel.

    Raises:
        InputError: a mesh without volume, or one whose decomposition takes too long (both with its element's name).
        CancelledError: `progress` returned False.
    """
    # Arms of one robot have the same meshes.
    robots = {id(arm.robot): (name, arm.robot) for name, arm in scene.arms.items()}
    for name, robot in robots.values():
        for link, mesh in robot.concave_meshes:
            _cut(f"{name}/{link}", mesh, progress)
    for name, held in scene.attachments.items():
        for geometry in held.geometries:
            if is_concave(geometry.shape):
                _cut(name, geometry.shape, progress)


def _cut(element: str, mesh: Mesh, progress: ProgressCallback) -> None:
    try:
        _mesh_pieces(_Whole(mesh, progress))
    except InputError as error:
        raise InputError(f"shape of {element!r}: {error}") from error


def _check_reach(cloud: PointCloud) -> None:
    """Reject a point cloud so large for its resolution that Coal's octree would lose cells."""
    reach = float(np.abs(cloud.points).max()) / cloud.resolution
    if reach > _OCTREE_REACH:
        raise InputError(
            f"point cloud reaches {reach:.0f} cells from its origin, expected at most {_OCTREE_REACH}; "
            "take a coarser resolution or fewer points"
        )


@dataclass(frozen=True)
class _Whole:
    """A mesh to decompose, and the progress callback."""

    mesh: Mesh
    progress: ProgressCallback | None = field(default=None, compare=False)


@lru_cache(maxsize=256)
def _mesh_pieces(whole: _Whole) -> tuple[Mesh, ...]:
    mesh = whole.mesh
    return (convex_hull(mesh.vertices),) if mesh.convex else tuple(convex_pieces(mesh, progress=whole.progress))


def occupied_cells(cloud: PointCloud) -> Array:
    """Centers of the occupied cells of the grid of side `resolution` [m], shape (n, 3)."""
    keys = np.unique(np.floor(cloud.points / cloud.resolution), axis=0)
    return np.asarray((keys + 0.5) * cloud.resolution)


@lru_cache(maxsize=256)
def coal_geometry(shape: Shape) -> coal.CollisionGeometry:
    """A shape as a `coal.CollisionGeometry`."""
    try:
        return _coal_geometry(shape)
    except InputError:
        raise
    except Exception as error:
        raise BackendError(f"Coal cannot take a {type(shape).__name__}: {error}") from error


def _coal_geometry(shape: Shape) -> coal.CollisionGeometry:
    match shape:
        case HalfSpace(normal, offset):
            return coal.Halfspace(np.array(normal), offset)
        case PointCloud():
            _check_reach(shape)
            # Centers of cells, not the points: a point on a face between two cells could be assigned to either.
            return coal.makeOctree(occupied_cells(shape), shape.resolution)
        case _:
            return surface_of(shape) if is_concave(shape) else coal_solid(shape)


# ---- concave meshes ------------------------------------------------------------------------------------

# Far below a micrometer, relative to the size of a mesh.
_A_LITTLE = 1e-12


def surface_of(mesh: Mesh) -> coal.BVHModelOBBRSS:
    """A mesh as Coal's hierarchy of triangles: a body entirely inside does not touch it."""
    corners = mesh.vertices[mesh.faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    # Coal reports a sphere in contact with any triangle of zero area.
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
    """Whether a point (3,) in the mesh's frame is inside its closed parts."""
    low, high, triangles = _closed_triangles(mesh)
    if (point < low).any() or (point > high).any():
        return False
    return bool(are_inside(point[None], triangles)[0])


@lru_cache(maxsize=64)
def _closed_triangles(mesh: Mesh) -> tuple[Array, Array, Array]:
    """Corners of the triangles of closed parts, shape (n, 3, 3), and the corners of the box around them."""
    turns = orientations_of(mesh)
    faces = np.where(turns[:, None] < 0, mesh.faces[:, ::-1], mesh.faces)[turns != 0]
    corners = mesh.vertices[faces]
    return corners.min(axis=(0, 1), initial=np.inf), corners.max(axis=(0, 1), initial=-np.inf), corners
