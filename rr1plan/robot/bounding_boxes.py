"""Axis-aligned boxes around posed shapes."""

from __future__ import annotations

import numpy as np

from rr1plan.checks import Array
from rr1plan.errors import InputError
from rr1plan.robot import Geometry
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, PointCloud, Sphere


def bounding_box(geometries: tuple[Geometry, ...], pose: Array) -> Array:
    """Lower and upper corner of shapes placed at a pose, shape (2, 3).

    Raises:
        InputError: a half-space or a point cloud.
    """
    corners = [box for geometry in geometries for box in _corners(geometry, pose @ geometry.pose)]
    return np.array([np.min(corners, axis=0), np.max(corners, axis=0)])


def _corners(geometry: Geometry, T: Array) -> Array:
    """Lower and upper corner of a shape at a pose, shape (2, 3)."""
    R, shape = T[:3, :3], geometry.shape
    match shape:
        case Box():
            half = np.abs(R) @ shape.size / 2.0
        case Sphere():
            half = np.full(3, shape.radius)
        case Cylinder():  # the projection of a disk onto an axis shrinks with its tilt
            half = np.abs(R[:, 2]) * shape.length / 2.0 + shape.radius * np.hypot(R[:, 0], R[:, 1])
        case Capsule():
            half = np.abs(R[:, 2]) * shape.length / 2.0 + shape.radius
        case Mesh():
            points = shape.vertices @ R.T + T[:3, 3]
            return np.array([points.min(axis=0), points.max(axis=0)])
        case HalfSpace() | PointCloud():
            raise InputError(f"shape {geometry.name!r} is a {type(shape).__name__}, expected a solid shape")
    return np.array([T[:3, 3] - half, T[:3, 3] + half])
