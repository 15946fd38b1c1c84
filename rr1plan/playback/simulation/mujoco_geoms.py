"""Shapes of a scene as MuJoCo's geoms: plates for triangles of meshes that are not convex, boxes for point clouds."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from rr1plan.checks import Array
from rr1plan.errors import InputError
from rr1plan.model.kinematic_chain import turned_to
from rr1plan.object_cache import kept_in
from rr1plan.playback.cloud_boxes import cloud_boxes
from rr1plan.robot import Geometry
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, PointCloud, Shape, Sphere
from rr1plan.shapes.convex_hulls import is_own_hull
from rr1plan.transforms import quaternion_from_rotation

# Half the thickness of the plate that replaces a triangle [m].
_HALF_PLATE = 1e-5
# Largest number of triangles of one mesh, which takes about ten seconds to build.
_MOST_PLATES = 20_000
# Largest number of boxes of one point cloud, which takes about twenty seconds to build.
_MOST_BOXES = 100_000
# MuJoCo stores vertices of meshes in single precision.
_ROUNDING = 1e-6
# Color of shapes without one.
_GRAY = (0.6, 0.6, 0.6, 1.0)


class GeomOptions:
    """Options of geoms; those of a shape are made once, and meshes are added to a model once and shared by its geoms.

    Args:
        spec: The model.
    """

    def __init__(self, spec: mujoco.MjSpec) -> None:
        self._spec = spec
        self._meshes: dict[int, list[str]] = {}
        self._made: dict[int, tuple[dict[str, Any], ...]] = {}

    def of(self, geometry: Geometry) -> tuple[dict[str, Any], ...]:
        """Type, size, pose and color of each geom of a shape of the scene, as arguments of `add_geom`."""
        return kept_in(self._made, id(geometry), lambda: tuple(self._geoms_of(geometry)))

    def _geoms_of(self, geometry: Geometry) -> Iterator[dict[str, Any]]:
        for options in self._of_shape(geometry.shape):
            offset = np.eye(4)
            offset[:3, 3] = options.pop("offset", (0.0, 0.0, 0.0))
            T = geometry.pose @ offset
            quat = quaternion_from_rotation(T[:3, :3] @ options.pop("turn", np.eye(3)))
            yield options | {"pos": T[:3, 3], "quat": quat, "rgba": geometry.color or _GRAY}

    def _of_shape(self, shape: Shape) -> Iterator[dict[str, Any]]:
        kinds = mujoco.mjtGeom
        match shape:
            case Box():
                yield {"type": kinds.mjGEOM_BOX, "size": np.array(shape.size) / 2}
            case Sphere():
                yield {"type": kinds.mjGEOM_SPHERE, "size": [shape.radius, 0, 0]}
            case Cylinder():
                yield {"type": kinds.mjGEOM_CYLINDER, "size": [shape.radius, shape.length / 2, 0]}
            case Capsule():
                yield {"type": kinds.mjGEOM_CAPSULE, "size": [shape.radius, shape.length / 2, 0]}
            case HalfSpace():
                normal = np.array(shape.normal)
                yield {
                    "type": kinds.mjGEOM_PLANE,
                    "size": [1, 1, 1],
                    "offset": normal * shape.offset,
                    "turn": turned_to(normal)[:3, :3],
                }
            case Mesh():
                for name in self._mesh_names(shape):
                    yield {"type": kinds.mjGEOM_MESH, "meshname": name}
            case PointCloud():
                for center, half in zip(*_few_boxes(shape), strict=True):
                    yield {"type": kinds.mjGEOM_BOX, "size": half, "offset": center}

    def _mesh_names(self, mesh: Mesh) -> list[str]:
        if id(mesh) not in self._meshes:
            names: list[str] = []
            for points in [mesh.vertices] if mesh.convex or is_own_hull(mesh) else _plates(mesh):
                name = f"mesh{sum(map(len, self._meshes.values())) + len(names)}"
                convex = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
                self._spec.add_mesh(name=name, uservert=points.ravel(), inertia=convex)
                names.append(name)
            self._meshes[id(mesh)] = names
        return self._meshes[id(mesh)]


def shrink_bounding_spheres(model: mujoco.MjModel) -> None:
    """Make the bounding spheres of meshes enclose their vertices.

    MuJoCo's enclose the bounding box, which is a quarter larger for the hull of a boat. Contacts are the same, and
    found in less time, because fewer pairs are searched.

    Args:
        model: The model, changed in place.
    """
    ends = model.mesh_vertadr + model.mesh_vertnum
    distances = (1.0 + _ROUNDING) * np.linalg.norm(model.mesh_vert.astype(np.float64), axis=1)
    radii = np.array([distances[i:j].max() for i, j in zip(model.mesh_vertadr, ends, strict=True)])
    meshes = model.geom_type == mujoco.mjtGeom.mjGEOM_MESH
    model.geom_rbound[meshes] = np.minimum(model.geom_rbound[meshes], radii[model.geom_dataid[meshes]])


def _plates(mesh: Mesh) -> Iterator[Array]:
    """Corners of a thin plate for each triangle, because MuJoCo replaces each mesh by its convex hull."""
    if len(mesh.faces) > _MOST_PLATES:
        raise InputError(
            f"a mesh of {len(mesh.faces)} triangles is not convex, MuJoCo is given at most {_MOST_PLATES} of them; "
            "try a decimated mesh, or its hull"
        )
    around = _HALF_PLATE * np.concatenate([np.eye(3), -np.eye(3)])
    for corners in mesh.vertices[mesh.faces]:
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        length = float(np.linalg.norm(normal))
        thin = length <= _HALF_PLATE * float(np.ptp(corners, axis=0).max())
        # The normal of a degenerate triangle is unreliable: use small octahedra around its corners.
        sides = around if thin else _HALF_PLATE * np.array([normal, -normal]) / length
        yield (corners[:, None] + sides).reshape(-1, 3)


def _few_boxes(cloud: PointCloud) -> tuple[Array, Array]:
    centers, halves = cloud_boxes(cloud)
    if len(centers) > _MOST_BOXES:
        raise InputError(
            f"a point cloud at resolution {cloud.resolution} m takes {len(centers)} boxes, MuJoCo is given at most "
            f"{_MOST_BOXES}; try a coarser resolution"
        )
    return centers, halves
