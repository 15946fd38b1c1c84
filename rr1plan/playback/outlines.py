"""Outlines of shapes: their projection onto a plane, for flat drawings."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from rr1plan.checks import Array
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, PointCloud, Shape, Sphere

_TURN = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)


def silhouette(shape: Shape, pose: Array) -> Array:
    """Corners of the shape's projection onto the xy plane, counter-clockwise, shape (k, 2); empty for a half-space.

    Round shapes are drawn with 64 corners; concave meshes by their convex hull.

    Args:
        shape: A shape.
        pose: T_world_shape, shape (4, 4).
    """
    points = _points(shape)
    if len(points) == 0:
        return np.zeros((0, 2))
    flat = (points @ pose[:3, :3].T + pose[:3, 3])[:, :2]
    if isinstance(shape, Sphere | Capsule):
        # A ball projects to a disc whatever its orientation.
        flat = np.concatenate([flat + shape.radius * np.array([np.cos(a), np.sin(a)]) for a in _TURN])
    try:
        return np.asarray(flat[ConvexHull(flat).vertices])
    except QhullError:
        return np.asarray(flat)


def _points(shape: Shape) -> Array:
    """Points whose hull (widened by the radius of balls) has the shape's projection, shape (k, 3)."""
    match shape:
        case Box():
            corners = np.array(np.meshgrid(*[(-0.5, 0.5)] * 3)).reshape(3, -1).T
            return np.asarray(corners * shape.size)
        case Sphere():
            return np.zeros((1, 3))
        case Cylinder():
            rim = shape.radius * np.column_stack([np.cos(_TURN), np.sin(_TURN)])
            ends = [np.column_stack([rim, np.full(len(rim), z)]) for z in (-shape.length / 2, shape.length / 2)]
            return np.concatenate(ends)
        case Capsule():
            return np.array([[0.0, 0.0, -shape.length / 2], [0.0, 0.0, shape.length / 2]])
        case Mesh():
            return shape.vertices
        case PointCloud():
            return shape.points
        case HalfSpace():
            return np.zeros((0, 3))
