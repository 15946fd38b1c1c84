"""Shapes of links and obstacles: immutable values, SI units.

Each shape is centered in its frame; cylinders and capsules are aligned with z; a half-space is
solid below its plane.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rr1plan.checks import (
    Array,
    Value,
    counted,
    finite_array,
    near_array,
    number_array,
    positive_length,
    read_only,
    shown,
)
from rr1plan.errors import InputError


@dataclass(frozen=True)
class Box:
    """A box.

    Args:
        size: Full edge lengths [m], shape (3,).

    Raises:
        InputError: a size that is not finite or not positive.
    """

    size: tuple[float, float, float]

    if TYPE_CHECKING:  # accepted types; the fields above have the stored ones

        def __init__(self, size: ArrayLike) -> None: ...

    def __post_init__(self) -> None:
        size = finite_array("box size", self.size, (3,))
        x, y, z = (positive_length("box size", s) for s in size)
        object.__setattr__(self, "size", (x, y, z))


@dataclass(frozen=True)
class Sphere:
    """A sphere.

    Args:
        radius: Radius [m].

    Raises:
        InputError: a radius that is not finite or not positive.
    """

    radius: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", positive_length("sphere radius", self.radius))


@dataclass(frozen=True)
class Cylinder:
    """A cylinder along z.

    Args:
        radius: Radius [m].
        length: Length [m].

    Raises:
        InputError: a dimension that is not finite or not positive.
    """

    radius: float
    length: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", positive_length("cylinder radius", self.radius))
        object.__setattr__(self, "length", positive_length("cylinder length", self.length))


@dataclass(frozen=True)
class Capsule:
    """A capsule along z: all points within `radius` of a segment of `length`.

    Args:
        radius: Radius [m].
        length: Length of the segment, without the round ends [m].

    Raises:
        InputError: a dimension that is not finite or not positive.
    """

    radius: float
    length: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", positive_length("capsule radius", self.radius))
        object.__setattr__(self, "length", positive_length("capsule length", self.length))


@dataclass(frozen=True)
class HalfSpace:
    """All points p with normal . p <= offset; the ground is `HalfSpace((0, 0, 1), 0)`.

    Args:
        normal: Outward direction, normalized here, shape (3,).
        offset: Distance of the plane from the origin along the normal [m].

    Raises:
        InputError: a normal of length zero, or numbers that are not finite.
    """

    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    offset: float = 0.0

    if TYPE_CHECKING:  # accepted types; the fields above have the stored ones

        def __init__(self, normal: ArrayLike = (0.0, 0.0, 1.0), offset: float = 0.0) -> None: ...

    def __post_init__(self) -> None:
        n = finite_array("half-space normal", self.normal, (3,))
        length = math.hypot(*n)
        if not 1e-9 <= length <= 1e9:
            size = "length zero" if length < 1.0 else f"length {length:.3g}"
            raise InputError(f"half-space normal has {size}, expected a direction, about 1 long")
        if abs(length - 1.0) > 1e-15:  # a unit normal is unchanged, so that files read back equal
            n = n / length
        x, y, z = (float(c) for c in n)
        object.__setattr__(self, "normal", (x, y, z))
        object.__setattr__(self, "offset", float(near_array("half-space offset", self.offset, ())))


@dataclass(frozen=True, eq=False, repr=False)
class Mesh(Value):
    """A triangle mesh.

    Args:
        vertices: Points [m], shape (n, 3).
        faces: Indices of each triangle's corners, counter-clockwise from outside, shape (m, 3).
        convex: Whether the mesh is the boundary of its convex hull (set by the hull builder only).

    Raises:
        InputError: fewer than 4 vertices, an index out of range, numbers that are not finite.
    """

    vertices: Array
    faces: NDArray[np.int32]
    convex: bool = False

    if TYPE_CHECKING:  # accepted types; the fields above have the stored ones

        def __init__(self, vertices: ArrayLike, faces: ArrayLike, convex: bool = False) -> None: ...

    def __post_init__(self) -> None:
        vertices = near_array("mesh vertices", self.vertices, (None, 3))
        faces = _whole_numbers(self.faces)
        if len(vertices) < 4 or faces.ndim != 2 or faces.shape[1:] != (3,) or len(faces) < 1:
            raise InputError(
                f"mesh has {len(vertices)} vertices and faces of shape {faces.shape}, expected >= 4 and (m, 3)"
            )
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise InputError(f"mesh face index {int(faces.max())} is out of range, it has {len(vertices)} vertices")
        object.__setattr__(self, "vertices", read_only(vertices))
        object.__setattr__(self, "faces", read_only(faces))

    def __repr__(self) -> str:
        return f"Mesh({len(self.vertices)} vertices, {len(self.faces)} faces)"


def _whole_numbers(faces: object) -> NDArray[np.int32]:
    """Face indices as integers; NumPy would truncate 1.5 to 1 and wrap large values."""
    array = number_array("mesh faces", faces)
    if not (np.abs(array) < 2**31).all() or (array != np.round(array)).any():
        raise InputError("mesh faces holds an index that is not a whole number, or too large")
    return array.astype(np.int32)


@dataclass(frozen=True, eq=False, repr=False)
class PointCloud(Value):
    """An occupancy grid of points: each cell that contains a point is solid (an octree's leaf).

    The cells are cubes of side `resolution` on the grid floor(p / resolution) of the cloud's frame.

    Args:
        points: Points [m], shape (n, 3).
        resolution: Side of a cell [m].

    Raises:
        InputError: no point, a point that is not finite, or a resolution that is not positive.
    """

    points: Array
    resolution: float = 0.02

    if TYPE_CHECKING:  # accepted types; the fields above have the stored ones

        def __init__(self, points: ArrayLike, resolution: float = 0.02) -> None: ...

    def __post_init__(self) -> None:
        points = near_array("point cloud", self.points, (None, 3))
        if len(points) == 0:
            raise InputError("point cloud has no points, expected at least one")
        object.__setattr__(self, "points", read_only(points))
        object.__setattr__(self, "resolution", positive_length("point cloud resolution", self.resolution))

    def __repr__(self) -> str:
        return f"PointCloud({counted(len(self.points), 'point')}, resolution={self.resolution})"


Color = tuple[float, float, float, float]
"""Red, green, blue and opacity, 0..1."""


def as_color(name: str, value: object) -> Color:
    """A color from "#rrggbb", "#rrggbbaa", or three or four numbers 0..1; opaque unless it says otherwise.

    Raises:
        InputError: other text, other numbers, or something else.
    """
    if isinstance(value, str):
        digits = value.removeprefix("#")
        if not value.startswith("#") or len(digits) not in (6, 8) or set(digits.lower()) - set("0123456789abcdef"):
            raise InputError(f"{name}: expected '#rrggbb' or '#rrggbbaa', got {shown(value)}")
        r, g, b, a = (int(part, 16) / 255.0 for part in (digits[0:2], digits[2:4], digits[4:6], digits[6:8] or "ff"))
        return (r, g, b, a)
    numbers = finite_array(name, value, (None,))
    if len(numbers) not in (3, 4) or (numbers < 0.0).any() or (numbers > 1.0).any():
        raise InputError(f"{name} is {shown(value)}, expected '#rrggbb' or 3 or 4 numbers from 0 to 1")
    r, g, b, a = (*numbers.tolist(), 1.0)[:4]
    return (r, g, b, a)


Shape = Box | Sphere | Cylinder | Capsule | HalfSpace | Mesh | PointCloud
"""Any shape of a link or an obstacle."""
