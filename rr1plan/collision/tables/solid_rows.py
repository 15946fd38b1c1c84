"""What the tables say of solids that do not move, in their own frames: `place_solids.c` puts them where they are."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import lru_cache

from rr1plan.collision.convex.convex_bodies import is_concave, is_surfaceless
from rr1plan.collision.convex.convex_cores import shape_core
from rr1plan.collision.tables.body_tables import body_core
from rr1plan.kernels.planner_kernels import constants
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, PointCloud, Shape, Sphere

_KIND = constants()
# Meshes of more corners are left to the exact kernel, which walks along edges instead of looking at all.
_MOST_POINTS = 2000
_KINDS, _VALUES = struct.Struct("=4q"), struct.Struct("=23d")


@dataclass(frozen=True, eq=False)
class SolidRows:
    """Rows of some solids, as bytes, so that those of many objects are joined in no time.

    Args:
        shapes: Their shapes.
        kinds: Of each its kind in the exact kernel, the last two columns of `FixedSolid`, and its `core` there; 0 for
            one that has a core.
        values: A `SolidShape` of each.
        surfaceless: Which of them are half-spaces, point clouds or concave meshes.
        special: Which of them have corners, cells or triangles in tables of their own [index].
    """

    shapes: tuple[Shape, ...]
    kinds: bytes
    values: bytes
    surfaceless: tuple[bool, ...]
    special: tuple[int, ...]


@lru_cache(maxsize=1024)
def solid_rows(shapes: tuple[Shape, ...]) -> SolidRows:
    """The rows of solids of these shapes."""
    kinds, values = zip(*map(_row, shapes), strict=True) if shapes else ((), ())
    special = tuple(i for i, shape in enumerate(shapes) if isinstance(shape, Mesh | PointCloud))
    return SolidRows(shapes, b"".join(kinds), b"".join(values), tuple(map(is_surfaceless, shapes)), special)


def _row(shape: Shape) -> tuple[bytes, bytes]:
    box, none = _KIND["OBSTACLE_ROUNDED_BOX"], (0.0, 0.0, 0.0, 0.0)
    kind, is_exact, core, inner = box, 1, _KIND["CORE_CLOSED_FORM"], none
    # Half sizes and radius of a shape that is its closed form; of others that is the box around them.
    match shape:
        case Box((x, y, z)):
            closed = 0.5 * x, 0.5 * y, 0.5 * z, 0.0
        case Sphere(radius):
            closed = 0.0, 0.0, 0.0, radius
        case Capsule(radius, length):
            closed = 0.0, 0.0, 0.5 * length, radius
        case Cylinder(radius, length):
            kind, closed = _KIND["OBSTACLE_CYLINDER"], (radius, radius, 0.5 * length, 0.0)
        case HalfSpace():
            kind, closed = _KIND["OBSTACLE_HALF_SPACE"], none
        case PointCloud():
            is_exact, closed, core = 0, none, _KIND["CORE_LEFT_OUT"]
        case Mesh():
            is_exact, closed, core = 0, none, _KIND["CORE_MESH" if is_concave(shape) else "CORE_LEFT_OUT"]
            if shape.convex and len(shape.vertices) <= _MOST_POINTS:
                core, values = 0, shape_core(shape).values[0].tolist()
                inner = values[0], values[1], values[2], values[4]
    exact = body_core(shape)
    return _KINDS.pack(exact.kind, kind, is_exact, core), _VALUES.pack(*exact.ball, *exact.values, *closed, *inner)
