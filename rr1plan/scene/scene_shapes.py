"""Reading and writing of poses, colors and shapes as tables of a scene file.

box = [0.4, 0.3, 0.02]                       full sides [m]
sphere = 0.05                                radius [m]
cylinder = { radius = 0.03, length = 0.12 }  along z
capsule = { radius = 0.03, length = 0.12 }   length without the round ends
half_space = { normal = [0, 0, 1], offset = 0 }
mesh = "chair.stl"                           or { file = "chair.stl", scale = 1.0, convex = "hull" },
                                             or { vertices = [...], faces = [...] }
points = "scan.pcd"                          or { file = "scan.pcd", resolution = 0.02 }, or { points = [...] }
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from rr1plan.checks import Array, read_only, resolved_path, shown
from rr1plan.files.checked_tables import Table
from rr1plan.robot import Geometry
from rr1plan.shapes import Box, Capsule, Color, Cylinder, HalfSpace, Mesh, PointCloud, Shape, Sphere
from rr1plan.shapes.convex_decomposition import CONVEXITIES, Convexity, convex_shapes
from rr1plan.shapes.convex_hulls import bounds_its_hull
from rr1plan.shapes.mesh_files import load_mesh
from rr1plan.shapes.point_cloud_files import load_point_cloud
from rr1plan.shapes.shapes import as_color
from rr1plan.transforms import pose, quaternion_from_rotation, rotation_from_quaternion


def read_pose(table: Table) -> Array:
    """A pose from xyz and one of rpy, quaternion (wxyz) and rotation (rows); shape (4, 4)."""
    T = np.eye(4)
    given = [key for key in ("rpy", "quaternion", "rotation") if key in table]
    if len(given) > 1:
        raise table.error(f"got {' and '.join(given)}, expected at most one way to write a rotation")
    with table.blame("xyz"):
        if "xyz" in table:
            T[:3, 3] = pose(table.numbers("xyz", (3,)))[:3, 3]
    with table.blame(given[0] if given else None):
        if "rpy" in given:
            T[:3, :3] = pose(rpy=table.numbers("rpy", (3,)))[:3, :3]
        elif "quaternion" in given:
            T[:3, :3] = rotation_from_quaternion(table.numbers("quaternion", (4,)))
    if "rotation" in given:
        T[:3, :3] = table.numbers("rotation", (3, 3))
        if np.abs(T[:3, :3] @ T[:3, :3].T - np.eye(3)).max() > 1e-6 or np.linalg.det(T[:3, :3]) < 0.0:
            raise table.error("expected the rows of a rotation matrix", "rotation")
    return read_only(T)


def pose_entries(T: Array) -> dict[str, object]:
    """Entries from which `read_pose` makes exactly this pose again."""
    entries: dict[str, Any] = {}
    R = T[:3, :3]
    if T[:3, 3].any():
        entries["xyz"] = T[:3, 3].tolist()
    if not np.array_equal(R, np.eye(3)):
        quaternion = quaternion_from_rotation(R)
        exact = np.array_equal(rotation_from_quaternion(quaternion), R)
        entries |= {"quaternion": quaternion.tolist()} if exact else {"rotation": R.tolist()}
    return entries


def read_color(table: Table, default: Color | None = None) -> Color | None:
    """A color from "#rrggbb", "#rrggbbaa" or three or four numbers 0..1."""
    value = table.raw("color")
    if value is None:
        return default
    with table.blame("color"):
        return as_color("color", value)


def read_geometries(table: Table, name: str, folder: Path) -> tuple[Geometry, ...]:
    """The shapes of an obstacle or a held object: one in the table itself, or a list `shapes`."""
    color = read_color(table)
    if "shapes" not in table:
        return tuple(Geometry(n, s, pose(), color) for n, s in _named(name, _read_shape(table, folder)))
    mixed = [kind for kind in _READERS if kind in table]
    if mixed:
        raise table.error(f"got both shapes and {mixed[0]}, expected one of them")
    geometries: list[Geometry] = []
    for i, entry in enumerate(table.tables("shapes")):
        own_name = entry.string("name", f"{name}_{i}")
        own_pose, own_color = read_pose(entry), read_color(entry, color)
        shapes = _named(own_name, _read_shape(entry, folder))
        geometries += [Geometry(n, s, own_pose, own_color) for n, s in shapes]
        entry.finish()
    if not geometries:
        raise table.error("has no shapes, expected at least one")
    return tuple(geometries)


def geometries_entries(name: str, geometries: tuple[Geometry, ...]) -> dict[str, object]:
    """Entries from which `read_geometries` makes exactly these shapes again."""
    first = geometries[0]
    if len(geometries) == 1 and first.name == name and not pose_entries(first.pose):
        return _shape_entry(first.shape) | _color_entry(first.color)
    return {
        "shapes": [
            {"name": g.name} | _shape_entry(g.shape) | pose_entries(g.pose) | _color_entry(g.color) for g in geometries
        ]
    }


def _color_entry(color: Color | None) -> dict[str, object]:
    return {} if color is None else {"color": list(color)}


def _named(name: str, shapes: tuple[Shape, ...]) -> list[tuple[str, Shape]]:
    if len(shapes) == 1:
        return [(name, shapes[0])]
    return [(f"{name}_{i}", shape) for i, shape in enumerate(shapes)]


def _read_shape(table: Table, folder: Path) -> tuple[Shape, ...]:
    kind = table.one_of(_READERS)
    with table.blame(kind):
        return _READERS[kind](table, folder)


def _read_box(table: Table, _folder: Path) -> tuple[Shape, ...]:
    x, y, z = table.numbers("box", (3,)).tolist()
    return (Box((x, y, z)),)


def _read_sphere(table: Table, _folder: Path) -> tuple[Shape, ...]:
    return (Sphere(table.number("sphere")),)


def _read_cylinder(table: Table, _folder: Path) -> tuple[Shape, ...]:
    return (Cylinder(*_radius_and_length(table.table("cylinder"))),)


def _read_capsule(table: Table, _folder: Path) -> tuple[Shape, ...]:
    return (Capsule(*_radius_and_length(table.table("capsule"))),)


def _radius_and_length(entry: Table) -> tuple[float, float]:
    values = entry.number("radius"), entry.number("length")
    entry.finish()
    return values


def _read_half_space(table: Table, _folder: Path) -> tuple[Shape, ...]:
    entry = table.table("half_space")
    x, y, z = entry.numbers("normal", (3,)).tolist() if "normal" in entry else (0.0, 0.0, 1.0)
    offset = entry.number("offset", 0.0)
    entry.finish()
    return (HalfSpace((x, y, z), offset),)


def _read_mesh(table: Table, folder: Path) -> tuple[Shape, ...]:
    entry = _file_or_table(table, "mesh")
    if entry.one_of({"file": None, "vertices": None}) == "file":
        return _mesh_from_file(entry, folder)
    vertices = entry.numbers("vertices", (None, 3))
    faces = entry.indices("faces", (None, 3))
    convex = entry.boolean("convex")
    entry.finish()
    mesh = Mesh(vertices, faces, convex)
    if convex and not bounds_its_hull(mesh):
        raise entry.error("says it is convex, but a vertex lies outside one of its faces", "convex")
    return (mesh,)


def _file_or_table(table: Table, key: str) -> Table:
    """The table of a mesh or of points; mesh = "a.stl" means mesh = { file = "a.stl" }."""
    value = table.raw(key)
    return table.at(key, {"file": value}) if isinstance(value, str) else table.table(key)


def _mesh_from_file(entry: Table, folder: Path) -> tuple[Shape, ...]:
    """A mesh file as one mesh, as its hull or as convex pieces."""
    path = _inside(entry, folder)
    scale = entry.raw("scale", 1.0)
    factors = entry.numbers("scale", (3,)) if isinstance(scale, list) else np.full(3, entry.number("scale", 1.0))
    convex = read_convexity(entry) if "convex" in entry else None
    entry.finish()
    x, y, z = factors.tolist()
    with entry.blame("scale"):
        mesh = load_mesh(path, scale=(x, y, z))
    return (mesh,) if convex is None else tuple(convex_shapes([mesh], convex))


def read_convexity(entry: Table) -> Convexity:
    """The convex replacement of meshes; "hull" without an entry."""
    given = entry.string("convex", "hull")
    for known in CONVEXITIES:
        if given == known:
            return known
    raise entry.error(f"expected one of {', '.join(CONVEXITIES)}, got {shown(given)}", "convex")


def _read_points(table: Table, folder: Path) -> tuple[Shape, ...]:
    entry = _file_or_table(table, "points")
    resolution = entry.number("resolution", 0.02)
    if entry.one_of({"file": None, "points": None}) == "file":
        file = _inside(entry, folder)
        entry.finish()
        return (load_point_cloud(file, resolution=resolution),)
    points = entry.numbers("points", (None, 3))
    entry.finish()
    return (PointCloud(points, resolution),)


def _inside(entry: Table, folder: Path) -> Path:
    """The file that an entry names, which has to be in the scene file's folder or below it."""
    name = entry.string("file")
    root = folder.resolve()
    with entry.blame("file"):
        path = resolved_path(root / name)
    if not path.is_relative_to(root):
        raise entry.error(f"{name!r} is not inside {folder}, the folder of the scene file; copy it there", "file")
    entry.check_there(path, "file")
    return path


def _shape_entry(shape: Shape) -> dict[str, object]:
    match shape:
        case Box():
            return {"box": list(shape.size)}
        case Sphere():
            return {"sphere": shape.radius}
        case Cylinder():
            return {"cylinder": {"radius": shape.radius, "length": shape.length}}
        case Capsule():
            return {"capsule": {"radius": shape.radius, "length": shape.length}}
        case HalfSpace():
            return {"half_space": {"normal": list(shape.normal), "offset": shape.offset}}
        case Mesh():
            entry = {"vertices": shape.vertices.tolist(), "faces": shape.faces.tolist()}
            return {"mesh": entry | ({"convex": True} if shape.convex else {})}
        case PointCloud():
            return {"points": {"points": shape.points.tolist(), "resolution": shape.resolution}}


_READERS: dict[str, Callable[[Table, Path], tuple[Shape, ...]]] = {
    "box": _read_box,
    "sphere": _read_sphere,
    "cylinder": _read_cylinder,
    "capsule": _read_capsule,
    "half_space": _read_half_space,
    "mesh": _read_mesh,
    "points": _read_points,
}
