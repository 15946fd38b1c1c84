"""Loose bodies for simulations: one from a mesh file, many in rows, grids and towers."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from rr1plan.checks import (
    check_text,
    file_path,
    finite_array,
    known_name,
    of_kind,
    positive_number,
    shown,
    whole_number,
)
from rr1plan.errors import InputError
from rr1plan.files.file_access import text_stem
from rr1plan.robot import Geometry
from rr1plan.robot.bounding_boxes import bounding_box
from rr1plan.scene.scene_elements import Obstacle
from rr1plan.shapes import Mesh
from rr1plan.shapes.convex_decomposition import CONVEXITIES, Convexity, convex_shapes, enclosed_volume, is_closed
from rr1plan.shapes.mesh_files import WIDEST_MESH, load_mesh
from rr1plan.transforms import as_pose, identity

_log = logging.getLogger(__name__)
_MOST_BODIES = 10_000
# Longer objects suggest that the file was in millimeters [m].
_HUGE = 20.0
# A smaller fraction of the bounding box does not count as a volume.
_FLAT = 1e-9


def load_body(
    file: str | Path,
    *,
    scale: float | tuple[float, float, float] = 1.0,
    convex: Convexity = "hull",
    density: float = 1000.0,
    mass: float | None = None,
    friction: float = 1.0,
    pose: ArrayLike | None = None,
) -> Obstacle:
    """Read a mesh file as a loose body.

        scene = scene.with_obstacles({"mug": load_body("mug.stl", scale=0.001, density=2400.0, pose=[0.4, 0.1, 0.0])})

    Args:
        file: A mesh file, as `load_mesh` takes it.
        scale: Factor of all axes or of each one (a file in millimeters: 0.001).
        convex: Collision shape: "hull" for the convex hull, or convex "pieces" of the mesh.
        density: Mass per volume enclosed by the mesh [kg/m³].
        mass: Mass instead [kg]; then the mesh need not be closed.
        friction: Coulomb friction coefficient.
        pose: T_world_body: (4, 4), or a position (3,) [m].

    Raises:
        FormatError: as `load_mesh`.
        InputError: a mesh that is not closed or has no volume; a scale, mass or density that is not a positive number.
        UnknownNameError: an unknown `convex`.
    """
    known_name("convex", convex, CONVEXITIES)
    path, T = file_path(file), as_pose(pose)
    positive_number("density", density)
    mesh = load_mesh(path, scale=scale)
    length = float(np.ptp(mesh.vertices, axis=0).max())
    if _HUGE < length <= WIDEST_MESH:  # load_mesh warns of wider ones
        _log.warning("%s is %.4g m long; a file in millimeters needs scale=0.001", path, length)
    try:
        weight = density * _volume(mesh) if mass is None else positive_number("mass", mass)
        parts = convex_shapes([mesh], convex)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    stem = text_stem(path)
    names = [stem] if len(parts) == 1 else [f"{stem}_{i}" for i in range(len(parts))]
    geometries = [Geometry(name, part, identity()) for name, part in zip(names, parts, strict=True)]
    return Obstacle(tuple(geometries), T, weight, friction)


def _volume(mesh: Mesh) -> float:
    if not is_closed(mesh):
        raise InputError("the mesh is not closed, so that it has no volume to take a mass from; give its mass")
    volume = abs(enclosed_volume(mesh))
    if volume <= _FLAT * float(np.prod(np.ptp(mesh.vertices, axis=0))):
        raise InputError("the mesh has no volume; give it a thickness")
    return volume


def stack_bodies(
    body: Obstacle,
    count: int,
    *,
    columns: tuple[int, int] = (1, 1),
    gap: float | tuple[float, float, float] = 0.001,
    pose: ArrayLike | None = None,
    prefix: str = "body",
) -> dict[str, Obstacle]:
    """Copies of an obstacle in rows, in a grid or on top of each other.

        scene = scene.with_obstacles(stack_bodies(crate, 20))                                   # a tower
        scene = scene.with_obstacles(stack_bodies(crate, 50, columns=(5, 5)))                   # two layers of 25
        scene = scene.with_obstacles(stack_bodies(crate, 4, columns=(4, 1), gap=(0.2, 0, 0)))   # a row

    Args:
        body: The obstacle, with a mass or fixed; its rotation is kept, its position is not.
        count: Number of copies.
        columns: Number of copies in a layer along x and along y; layers are filled one after the other.
        gap: Distance between the bounding boxes of neighbors [m], one number or one for each axis.
        pose: Middle of the lower side of the stack in the world: (4, 4), or a position (3,) [m].
        prefix: Prefix of their names, followed by a number from 1 on, e.g. "body01".

    Returns:
        The obstacles by name, from the lowest layer to the highest.

    Raises:
        InputError: not an obstacle, a count of zero or too many, a negative gap, or a half-space or point cloud.
    """
    of_kind("body", body, Obstacle)
    whole_number("count", count, 1, _MOST_BODIES)
    if not isinstance(columns, list | tuple) or len(columns) != 2:
        raise InputError(f"columns is {shown(columns)}, expected two numbers, along x and along y")
    along_x, along_y = (whole_number("columns", number, 1, _MOST_BODIES) for number in columns)
    of_three = isinstance(gap, list | tuple | np.ndarray)
    gaps = np.broadcast_to(finite_array("gap", gap, (3,) if of_three else ()), (3,))
    if (gaps < 0.0).any():
        raise InputError(f"gap is {shown(gap)}, expected a distance >= 0")
    check_text("prefix", prefix)
    T, turned = as_pose(pose, "pose"), identity().copy()
    turned[:3, :3] = body.pose[:3, :3]
    lower, upper = bounding_box(body.geometries, turned)
    pitch = upper - lower + gaps
    number = np.arange(count)
    layer, rest = np.divmod(number, along_x * along_y)
    column, row = np.divmod(rest, along_y)
    places = pitch * np.stack([column - (along_x - 1) / 2, row - (along_y - 1) / 2, layer], axis=1)
    places -= [*(0.5 * (lower + upper))[:2], lower[2]]
    digits = max(2, len(str(count)))
    stack = {}
    for k, place in enumerate(places, start=1):
        turned[:3, 3] = place
        stack[f"{prefix}{k:0{digits}d}"] = replace(body, pose=T @ turned)
    return stack
