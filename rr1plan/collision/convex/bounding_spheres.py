"""Spheres that contain a solid: few, tight, and proven.

A solid is cut into small cells. A sphere contains a cell if it contains the cell's corners, so spheres that contain
every cell contain the solid. Candidates are centered at the cells, with radii slightly above the depth of the solid
there; the one that contains most of the remaining cells is taken next (greedy set cover, Chvatal 1979). Capsules and
long cylinders are chains of spheres along their axis. Each sphere also has the radius of a concentric ball inside the
solid: what touches this ball touches the solid.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import ceil, hypot, sqrt

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, read_only
from rr1plan.collision.convex.enclosing_ball import around_points
from rr1plan.errors import InputError
from rr1plan.files.disk_cache import cache_key, load_cached, store_cached
from rr1plan.robot.link_contacts import ball_around
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, PointCloud, Shape, Sphere
from rr1plan.shapes.convex_hulls import convex_hull

# How far a sphere may protrude from its solid [m], and the largest number of spheres of a solid.
EXCESS = 0.012
MOST = 10

_VERSION = "spheres-4"
# Hulls with more corners are covered through a simpler hull around them.
_MANY = 400
_DIRECTIONS = 80
# Outward shift of the simpler hull's planes [m]: beyond all rounding.
_OUTSIDE = 1e-7
# Far above the rounding error of a part's corners, relative to its radius.
_SAFETY = 1.0 + 1e-9
_SIDES = 16
_CUTS = 8
_LOOSER = 1.1


@dataclass(frozen=True, eq=False)
class SphereCover:
    """Spheres whose union contains a solid, in the solid's frame.

    Args:
        centers: Centers [m], shape (n, 3).
        radii: Radii [m], shape (n,).
        inner: Radius of a concentric ball inside the solid [m], shape (n,); -inf if the center is outside.
        ball: A sphere that contains the solid: center and radius [m], shape (4,).
    """

    centers: Array
    radii: Array
    inner: Array
    ball: Array


@lru_cache(maxsize=512)
def cover(shape: Shape) -> SphereCover:
    """Spheres that contain a convex solid.

    Args:
        shape: A box, sphere, cylinder, capsule or convex mesh.

    Raises:
        InputError: a half-space, a point cloud or a mesh that is not convex.
    """
    match shape:
        case Sphere(radius):
            return _made(np.zeros((1, 3)), [radius], [radius])
        case Capsule(radius, length):
            return _capsule(radius, length)
        case Cylinder(radius, length) if length > radius:
            return _cylinder(radius, length)
        case Cylinder(radius, length):
            # The corners are those of a prism around it: a ball inside the prism may not be inside the cylinder.
            made = _polytope(_corners(shape))
            rim = radius - np.hypot(made.centers[:, 0], made.centers[:, 1])
            inner = np.minimum(rim, 0.5 * length - np.abs(made.centers[:, 2]))
            inner = np.where(inner > 0.0, inner / _SAFETY, -np.inf)
            return _frozen(made.centers, made.radii, inner, made.ball)
        case Mesh(convex=True) | Box():
            return _polytope(_corners(shape))
        case Mesh() | HalfSpace() | PointCloud():
            raise InputError(f"a {type(shape).__name__} has no spheres around it, expected a convex solid")


def _made(centers: Array, radii: Array | list[float], inner: Array | list[float]) -> SphereCover:
    radii = np.array(radii) * _SAFETY
    center, reach = ball_around(centers, radii)
    return _frozen(centers, radii, np.array(inner) / _SAFETY, np.array([*center, reach * _SAFETY]))


def _frozen(centers: Array, radii: Array, inner: Array, ball: Array) -> SphereCover:
    return SphereCover(*(read_only(np.array(a, dtype=np.float64)) for a in (centers, radii, inner, ball)))


def _capsule(radius: float, length: float) -> SphereCover:
    """Spheres along the core; the outermost ones are the round ends."""
    widest = 2.0 * sqrt((radius + EXCESS) ** 2 - radius**2)
    count = min(1 + max(1, ceil(length / widest)), MOST)
    step = length / (count - 1)
    centers = np.zeros((count, 3))
    centers[:, 2] = np.linspace(-0.5 * length, 0.5 * length, count)
    return _made(centers, [hypot(radius, 0.5 * step)] * count, [radius] * count)


def _cylinder(radius: float, length: float) -> SphereCover:
    """Spheres through the rims of equal slices."""
    widest = 2.0 * sqrt((radius + EXCESS) ** 2 - radius**2)
    count = min(ceil(length / widest), MOST)
    half = 0.5 * length / count
    centers = np.zeros((count, 3))
    centers[:, 2] = np.linspace(half - 0.5 * length, 0.5 * length - half, count)
    inner = np.minimum(radius, 0.5 * length - np.abs(centers[:, 2]))
    return _made(centers, [hypot(radius, half)] * count, inner)


def _corners(shape: Box | Cylinder | Mesh) -> Array:
    """Points whose convex hull contains the shape and nearly equals it."""
    match shape:
        case Box(size):
            return np.array(np.meshgrid(*([-0.5 * s, 0.5 * s] for s in size))).reshape(3, -1).T
        case Cylinder(radius, length):
            angles = np.linspace(0.0, 2.0 * np.pi, _SIDES, endpoint=False)
            rim = radius / np.cos(np.pi / _SIDES) * np.stack([np.cos(angles), np.sin(angles)], axis=1)
            return np.concatenate([np.column_stack([rim, np.full(_SIDES, h)]) for h in (-0.5 * length, 0.5 * length)])
        case Mesh(vertices):
            return vertices


# ---- parts of a polytope ---------------------------------------------------------------------------


def _polytope(corners: Array) -> SphereCover:
    key = cache_key(_VERSION, f"{EXCESS} {MOST} {_SIDES} {_LOOSER} {_CUTS}", corners)
    kept = load_cached(key)
    if kept is None or sorted(kept) != ["ball", "centers", "inner", "radii"]:
        made = _fill(corners) if len(corners) <= _MANY else _fill_around(corners)
        store_cached(key, {"centers": made.centers, "radii": made.radii, "inner": made.inner, "ball": made.ball})
        return made
    return _frozen(kept["centers"], kept["radii"], kept["inner"], kept["ball"])


def _fill(corners: Array) -> SphereCover:
    """The tightest spheres within the limit on their number."""
    planes, cells = _planes(corners), _cells(corners)
    # Cells have different numbers of corners; repeating the last one changes nothing.
    count = max(len(cell) for cell in cells)
    points = np.array([np.concatenate([cell, np.repeat(cell[-1:], count - len(cell), axis=0)]) for cell in cells])
    centers = points.mean(axis=1)
    depth = -(centers @ planes[:, :3].T + planes[:, 3]).max(axis=1)
    # Radius that a sphere about each candidate needs to contain each cell.
    needed = np.array([np.linalg.norm(points - center, axis=2).max(axis=1) for center in centers])
    excess = EXCESS
    while (taken := _choose(needed, depth + excess)) is None:
        excess *= _LOOSER
    chosen, radii = taken
    whole = around_points(corners)
    return _frozen(centers[chosen], radii * _SAFETY, np.maximum(depth[chosen], 0.0) / _SAFETY, whole)


def _fill_around(corners: Array) -> SphereCover:
    """Spheres that contain a simpler hull around many corners; balls inside are then unknown."""
    made = _fill(_simpler(corners))
    return _frozen(made.centers, made.radii, np.full(len(made.radii), -np.inf), made.ball)


def _simpler(corners: Array) -> Array:
    """Corners of a hull with few faces around the given points: an intersection of half-spaces."""
    from scipy.spatial import HalfspaceIntersection, QhullError

    height = 1.0 - 2.0 * (np.arange(_DIRECTIONS) + 0.5) / _DIRECTIONS
    turn = np.pi * (1.0 + sqrt(5.0)) * np.arange(_DIRECTIONS)
    width = np.sqrt(1.0 - height**2)
    axes = np.linalg.svd(corners - corners.mean(axis=0), full_matrices=False)[2]
    normals = np.concatenate([np.column_stack([width * np.cos(turn), width * np.sin(turn), height]), axes, -axes])
    offsets = (normals @ corners.T).max(axis=1) + _OUTSIDE
    try:
        return np.asarray(
            HalfspaceIntersection(np.column_stack([normals, -offsets]), corners.mean(axis=0)).intersections
        )
    except QhullError:
        # Nearly flat: take the box along its own axes.
        high, low = offsets[-6:-3], -offsets[-3:]
        box = _corners(Box((1.0, 1.0, 1.0))) * (high - low) + 0.5 * (high + low)
        return np.asarray(box @ axes)


def _choose(needed: Array, allowed: Array) -> tuple[Array, Array] | None:
    """Candidates that together contain all cells, and their radii; None if there would be too many."""
    holds = needed <= allowed[:, None]
    if not holds.any(axis=0).all():
        return None
    left = np.ones(len(allowed), dtype=np.bool_)
    chosen: list[int] = []
    while left.any():
        if len(chosen) == MOST:
            return None
        chosen.append(int((holds & left).sum(axis=1).argmax()))
        left &= ~holds[chosen[-1]]
    # Assign each cell to the sphere that needs the smallest growth, so that the others shrink.
    kept = np.array(chosen)
    owner = np.where(holds[kept], needed[kept] - allowed[kept][:, None], np.inf).argmin(axis=0)
    radii = np.array([needed[c, owner == i].max(initial=0.0) for i, c in enumerate(chosen)])
    return kept[radii > 0.0], radii[radii > 0.0]


def _cells(corners: Array) -> list[Array]:
    """Corners of the small parts of a polytope that is halved across its main axes."""
    axes = np.linalg.svd(corners - corners.mean(axis=0), full_matrices=False)[2]
    largest = float(np.ptp(corners @ axes.T, axis=0).max()) / _CUTS
    cells, left = [], [corners]
    while left:
        cell = left.pop()
        along = cell @ axes.T
        spans = np.ptp(along, axis=0)
        axis = int(spans.argmax())
        if spans[axis] <= largest:
            cells.append(cell)
        else:
            left += _cut(cell, along[:, axis] - 0.5 * (along[:, axis].min() + along[:, axis].max()))
    return cells


def _planes(corners: Array) -> Array:
    """Faces of the hull: outward normal and offset, shape (n, 4)."""
    mesh = convex_hull(corners)
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals = normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
    # Over all corners, not those of the face alone: slivers have poor normals.
    return np.column_stack([normals, -(normals @ corners.T).max(axis=1)])


def _cut(points: Array, height: Array) -> list[Array]:
    """Corners of the two parts of a hull on both sides of a plane, given the heights of the points above it."""
    above, below = points[height > 0.0], points[height <= 0.0]
    up, down = height[height > 0.0][:, None], height[height <= 0.0][None, :]
    # All segments across the plane, not only the edges: the others end inside.
    share = (up / (up - down))[:, :, None]
    across = (above[:, None, :] + share * (below[None, :, :] - above[:, None, :])).reshape(-1, 3)
    if len(across) > 12:
        across = across[_outline(across)]
    return [np.concatenate([above, across]), np.concatenate([below, across])]


def _outline(points: Array) -> NDArray[np.intp]:
    """Indices of the corners of the hull of coplanar points."""
    from scipy.spatial import ConvexHull, QhullError

    flat = points - points.mean(axis=0)
    axes = np.linalg.svd(flat, full_matrices=False)[2]
    try:
        return np.asarray(ConvexHull(flat @ axes[:2].T).vertices)
    except QhullError:
        return np.arange(len(points))
