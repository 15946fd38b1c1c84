"""The shapes that links and obstacles are made of, their mesh and point files, convex hulls and decomposition."""

from rr1plan.shapes.shapes import Box, Capsule, Color, Cylinder, HalfSpace, Mesh, PointCloud, Shape, Sphere

__all__ = ["Box", "Capsule", "Color", "Cylinder", "HalfSpace", "Mesh", "PointCloud", "Shape", "Sphere"]
