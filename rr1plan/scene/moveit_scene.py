"""MoveIt's `.scene` text, in both its forms.

    name                     one line
    * id                     one object; the line to its end
    x y z / qx qy qz qw      its pose (missing in the older form)
    number of shapes         then for each: type, measures, position, quaternion (xyzw), rgba
    number of subframes      (missing in the older form) then for each: name, position, quaternion
    .                        the end

Subframes are skipped.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from rr1plan.checks import Array, number_in
from rr1plan.errors import FormatError, InputError
from rr1plan.files.file_access import read_text, text_stem
from rr1plan.robot import Geometry
from rr1plan.scene import Obstacle, Scene
from rr1plan.shapes import Box, Cylinder, HalfSpace, Mesh, Shape, Sphere
from rr1plan.shapes.convex_hulls import convex_hull
from rr1plan.transforms import pose

_MAX_COUNT = 10_000_000
_CONE_SIDES = 32


def read_moveit_scene(file: str | Path) -> Scene:
    """Read the obstacles of a MoveIt `.scene` file.

    Args:
        file: The file, in the older or the newer form.

    Returns:
        A scene without arms; add them with `scene.with_arm`.

    Raises:
        FormatError: it ends too early, a number is not finite, a type is unknown; names the line.
    """
    words = _Words(read_text(file), file)
    title = words.line() or text_stem(file)
    obstacles: dict[str, Obstacle] = {}
    while (mark := words.word()) != ".":
        if mark != "*":
            raise words.error(f"expected '*' before an object or '.' at the end, got {mark!r}")
        name = words.line()
        if name in obstacles:
            raise words.error(f"has two objects named {name!r}")
        obstacle = _read_object(words, name)
        if obstacle is not None:
            obstacles[name] = obstacle
    try:
        return Scene(obstacles=obstacles, name=title)
    except InputError as error:
        raise FormatError(str(error), file) from error


class _Words:
    """The words and lines of a text, with the place in it."""

    def __init__(self, text: str, file: str | Path) -> None:
        self.text, self.file, self.at = text, file, 0

    def line(self) -> str:
        end = self.text.find("\n", self.at)
        end = len(self.text) if end < 0 else end
        line, self.at = self.text[self.at : end].strip(), end + 1
        return line

    def peek_line(self) -> list[str]:
        """The words of the next non-empty line, without consuming them."""
        found = re.compile(r"\s*(\S[^\n]*)").match(self.text, self.at)
        return found[1].split() if found else []

    def word(self) -> str:
        found = re.compile(r"\s*(\S+)").match(self.text, self.at)
        if found is None:
            raise self.error("ends too early")
        self.at = found.end()
        return found[1]

    def number(self) -> float:
        word = self.word()
        try:
            number = number_in(word)
        except ValueError:
            raise self.error(f"expected a number, got {word!r}") from None
        if not math.isfinite(number):
            raise self.error(f"expected a finite number, got {word!r}")
        return number

    def numbers(self, count: int) -> list[float]:
        return [self.number() for _ in range(count)]

    def count(self) -> int:
        number = self.number()
        if not (number.is_integer() and 0 <= number <= _MAX_COUNT):
            raise self.error(f"expected a count, got {number}")
        return int(number)

    def error(self, message: str) -> FormatError:
        return FormatError(message, self.file, self.text.count("\n", 0, min(self.at, len(self.text))) + 1)


def _read_object(words: _Words, name: str) -> Obstacle | None:
    """One object, or None if it has no shapes."""
    newer = len(words.peek_line()) > 1
    T = _read_pose(words) if newer else pose()
    geometries: list[Geometry] = []
    for i in range(words.count()):
        try:
            shape = _read_shape(words)
        except FormatError:
            raise
        except InputError as error:
            raise words.error(f"object {name!r}: {error}") from error
        own = _read_pose(words)
        r, g, b, a = words.numbers(4)
        geometries.append(Geometry(f"{name}_{i}", shape, own, None if a == 0.0 else (r, g, b, a)))
    if newer:
        for _ in range(words.count()):
            words.word()
            _read_pose(words)
    return Obstacle(tuple(geometries), T) if geometries else None


def _read_pose(words: _Words) -> Array:
    x, y, z, qx, qy, qz, qw = words.numbers(7)
    try:
        return pose((x, y, z), quaternion=(qw, qx, qy, qz))
    except InputError as error:
        raise words.error(str(error)) from error


def _read_shape(words: _Words) -> Shape:
    kind = words.word()
    if kind not in _READERS:
        raise words.error(f"unknown type of shape {kind!r}, expected one of {', '.join(_READERS)}")
    return _READERS[kind](words)


def _read_plane(words: _Words) -> Shape:
    a, b, c, d = words.numbers(4)
    return HalfSpace((a, b, c), -d / (math.hypot(a, b, c) or 1.0))


def cone(radius: float, length: float) -> Mesh:
    """A convex mesh around a cone along z with its tip at the top: its base circle is inscribed in a polygon.

    Raises:
        InputError: a dimension that is not finite or not positive.
    """
    base = Cylinder(radius, length)
    angles = 2.0 * np.pi * np.arange(_CONE_SIDES) / _CONE_SIDES
    outer = base.radius / np.cos(np.pi / _CONE_SIDES)
    ring = [(outer * np.cos(a), outer * np.sin(a), -base.length / 2) for a in angles]
    return convex_hull(np.array([*ring, (0.0, 0.0, base.length / 2)]))


def _read_mesh(words: _Words) -> Shape:
    n_vertices, n_faces = words.count(), words.count()
    vertices = np.array(words.numbers(3 * n_vertices)).reshape(-1, 3)
    faces = np.array([words.count() for _ in range(3 * n_faces)], dtype=np.int32).reshape(-1, 3)
    return Mesh(vertices, faces)


_READERS: dict[str, Callable[[_Words], Shape]] = {
    "box": lambda words: Box(words.numbers(3)),
    "sphere": lambda words: Sphere(words.number()),
    "cylinder": lambda words: Cylinder(*words.numbers(2)),
    "cone": lambda words: cone(*words.numbers(2)),
    "plane": _read_plane,
    "mesh": _read_mesh,
}
