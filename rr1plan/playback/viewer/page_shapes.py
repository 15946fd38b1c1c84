"""Shapes as drawn by the page; equal shapes are described once."""

from __future__ import annotations

import hashlib
from typing import Any, assert_never

from rr1plan.playback.viewer.page_arrays import pack_array
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, PointCloud, Shape, Sphere


class ShapeTable:
    """Collects shapes and gives equal ones the same index."""

    def __init__(self) -> None:
        self.rows: list[dict[str, Any]] = []
        self._known: dict[Any, int] = {}

    def index(self, shape: Shape) -> int:
        """The index of a shape in `rows`, which is extended if the shape is new."""
        key = _key(shape)
        if key not in self._known:
            self._known[key] = len(self.rows)
            self.rows.append(self._row(shape))
        return self._known[key]

    def _row(self, shape: Shape) -> dict[str, object]:
        match shape:
            case Box():
                return {"kind": "box", "size": list(shape.size)}
            case Sphere():
                return {"kind": "sphere", "radius": shape.radius}
            case Cylinder():
                return {"kind": "cylinder", "radius": shape.radius, "length": shape.length}
            case Capsule():
                return {"kind": "capsule", "radius": shape.radius, "length": shape.length}
            case HalfSpace():
                return {"kind": "halfspace", "normal": list(shape.normal), "offset": shape.offset}
            case Mesh():
                return {
                    "kind": "mesh",
                    "vertices": pack_array(shape.vertices),
                    "faces": pack_array(shape.faces, "u4"),
                }
            case PointCloud():
                return {"kind": "cloud", "points": pack_array(shape.points), "resolution": shape.resolution}
            case _:
                assert_never(shape)


def _key(shape: Shape) -> Any:
    if isinstance(shape, Mesh):
        digest = hashlib.sha256(shape.vertices.tobytes() + shape.faces.tobytes()).digest()
        return ("mesh", shape.vertices.shape, digest)
    if isinstance(shape, PointCloud):
        return ("cloud", shape.resolution, hashlib.sha256(shape.points.tobytes()).digest())
    return shape
