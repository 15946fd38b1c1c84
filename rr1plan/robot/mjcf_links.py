"""The links of a compiled MJCF model: masses and shapes."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from functools import cache
from typing import Any

import mujoco
import numpy as np

from rr1plan.checks import Array, read_only
from rr1plan.errors import FormatError, InputError
from rr1plan.robot import Geometry, Inertial, Link
from rr1plan.robot.check_robot import check_inertial
from rr1plan.robot.mjcf_model import CompiledDocument
from rr1plan.shapes import Box, Capsule, Color, Cylinder, HalfSpace, Mesh, Shape, Sphere
from rr1plan.shapes.convex_decomposition import Convexity, convex_shapes
from rr1plan.shapes.convex_hulls import convex_hull
from rr1plan.transforms import rotation_from_quaternion

log = logging.getLogger(__name__)

_GEOM = mujoco.mjtGeom
PLANE, MESH = int(_GEOM.mjGEOM_PLANE), int(_GEOM.mjGEOM_MESH)
# MuJoCo's color of a geom without one; then its material's color is used.
_NO_COLOR = (0.5, 0.5, 0.5, 1.0)
# Moments within this fraction of the largest one from zero are rounded zeros.
_ROUNDING = 1e-9
# MuJoCo's frames of meshes come from eigenvectors, whose last bits differ between machines.
_DECIMALS = 12


class MjcfLinkReader:
    """Reads bodies, each mesh once.

    Args:
        compiled: The model.
        convex: Replacement of non-convex collision meshes.

    """

    def __init__(self, compiled: CompiledDocument, convex: Convexity) -> None:
        self.compiled = compiled
        self.model = compiled.model
        self.convex = convex
        self._convex_shapes: dict[str, list[Mesh]] = {}
        self._explicit = {body.id: bool(body.explicitinertial) for body in compiled.spec.bodies}

    def link(self, body: int, name: str) -> Link:
        """The link of a body.

        Raises:
            FormatError: a plane, a height field or a signed distance field on the body, or a mesh without volume.
        """
        visuals: list[Geometry] = []
        collisions: list[Geometry] = []
        for geom in self.shown_geoms(body):
            label = f"{name}/visual{len(visuals)}"
            shape, pose = self.shape(geom, label)
            visuals.append(Geometry(label, shape, pose, self._color(geom)))
        for index, geom in enumerate(self.colliding_geoms(body)):
            collisions.extend(self._collision(geom, f"{name}/collision{index}"))
        return Link(name, self._inertial(body), tuple(visuals), tuple(collisions))

    # ---- which geoms ---------------------------------------------------------------------

    def geoms(self, body: int) -> range:
        """Numbers of a body's geoms."""
        start = int(self.model.body_geomadr[body])
        return range(start, start + int(self.model.body_geomnum[body])) if start >= 0 else range(0)

    def colliding_geoms(self, body: int) -> list[int]:
        """The geoms of a body that take part in collisions."""
        return [g for g in self.geoms(body) if self.compiled.uses[g].collides]

    def shown_geoms(self, body: int) -> list[int]:
        """The visual geoms of a body: visible ones without collisions, or all visible ones if there are none."""
        seen = [g for g in self.geoms(body) if self.compiled.uses[g].looks]
        return [g for g in seen if not self.compiled.uses[g].collides] or seen

    # ---- shapes ---------------------------------------------------------------------------

    def _collision(self, geom: int, name: str) -> list[Geometry]:
        if int(self.model.geom_type[geom]) != MESH:
            shape, pose = self.shape(geom, name)
            return [Geometry(name, shape, pose)]
        mesh, pose = self._mesh(geom)
        key = self.model.mesh(int(self.model.geom_dataid[geom])).name
        if key not in self._convex_shapes:
            try:
                self._convex_shapes[key] = convex_shapes([mesh], self.convex)
            except InputError as error:
                raise self._error(geom, str(error)) from error
        shapes = self._convex_shapes[key]
        names = [name] if len(shapes) == 1 else [f"{name}.{k}" for k in range(len(shapes))]
        return [Geometry(n, s, pose) for n, s in zip(names, shapes, strict=True)]

    def geometry(self, geom: int) -> Geometry:
        """A geom as one shape with its color; meshes are unchanged.

        Raises:
            FormatError: as `shape`.
        """
        name = self.model.geom(geom).name or f"geom{geom}"
        shape, pose = self.shape(geom, name)
        return Geometry(name, shape, pose, self._color(geom))

    def shape(self, geom: int, name: str) -> tuple[Shape, Array]:
        """The shape of a geom and its pose in its body (4, 4); meshes are unchanged.

        Raises:
            FormatError: a height field, a signed distance field, or a size that no shape can have.
        """
        x, y, z = (float(size) for size in self.model.geom_size[geom])
        kind = int(self.model.geom_type[geom])
        pose = self.compiled.pose(self.model.geom_pos[geom], self.model.geom_quat[geom])
        shape: Shape
        try:
            match kind:
                case _GEOM.mjGEOM_MESH:
                    return self._mesh(geom)
                case _GEOM.mjGEOM_PLANE:
                    shape = HalfSpace()
                case _GEOM.mjGEOM_SPHERE:
                    shape = Sphere(x)
                case _GEOM.mjGEOM_CAPSULE:
                    shape = Capsule(x, 2.0 * y)
                case _GEOM.mjGEOM_CYLINDER:
                    shape = Cylinder(x, 2.0 * y)
                case _GEOM.mjGEOM_BOX:
                    shape = Box((2.0 * x, 2.0 * y, 2.0 * z))
                case _GEOM.mjGEOM_ELLIPSOID:
                    shape = Sphere(x) if x == y == z else _ellipsoid(x, y, z)
                case _:
                    raise self._error(geom, f"shape {name!r} is a height field or a signed distance field, not read")
        except FormatError:
            raise
        except InputError as error:
            raise self._error(geom, f"shape {name!r}: {error}") from error
        return shape, read_only(pose)

    def _mesh(self, geom: int) -> tuple[Mesh, Array]:
        """The mesh of a geom as in the file, and its pose there."""
        model, number = self.model, int(self.model.geom_dataid[geom])
        T_mesh = self.compiled.pose(model.mesh_pos[number], model.mesh_quat[number])
        T_body = self.compiled.pose(model.geom_pos[geom], model.geom_quat[geom]) @ np.linalg.inv(T_mesh)
        T_body[:3] = np.round(T_body[:3], _DECIMALS)
        mesh = self.compiled.meshes.get(model.mesh(number).name)
        if mesh is None:  # written in the document, or made by MuJoCo
            start, count = int(model.mesh_vertadr[number]), int(model.mesh_vertnum[number])
            vertices = model.mesh_vert[start : start + count] @ T_mesh[:3, :3].T + T_mesh[:3, 3]
            start, count = int(model.mesh_faceadr[number]), int(model.mesh_facenum[number])
            mesh = Mesh(np.round(vertices, _DECIMALS), model.mesh_face[start : start + count])
        return mesh, read_only(T_body)

    def _color(self, geom: int) -> Color | None:
        """The color of a geom, or of its material if the geom has none; None without both."""
        rgba = tuple(self.model.geom_rgba[geom].tolist())
        material = int(self.model.geom_matid[geom])
        if rgba == _NO_COLOR:
            if material < 0:
                return None
            rgba = tuple(self.model.mat_rgba[material].tolist())
        r, g, b, a = (min(max(round(share, 6), 0.0), 1.0) for share in rgba)  # MuJoCo's are single precision
        return r, g, b, a

    def _error(self, geom: int, message: str) -> FormatError:
        return self.compiled.error_at(self.compiled.geoms[geom], message)

    # ---- masses ---------------------------------------------------------------------------

    def _inertial(self, body: int) -> Inertial | None:
        """Mass, center and inertia of a body in its axes; assumed if a moving body has MuJoCo's default density."""
        model = self.model
        mass = float(model.body_mass[body])
        if mass == 0.0:
            return None
        moments = np.array(model.body_inertia[body])
        if moments.any():
            moments = np.maximum(moments, _ROUNDING * moments.max())
        R = rotation_from_quaternion(model.body_iquat[body])
        inertia = (R * moments) @ R.T
        uses = [self.compiled.uses[g] for g in self.geoms(body)]
        moves = int(model.body_weldid[body]) != 0
        assumed = moves and not self._explicit[body] and not all(use.given_mass for use in uses)
        inertial = Inertial(
            mass, read_only(np.array(model.body_ipos[body])), read_only(0.5 * (inertia + inertia.T)), assumed
        )
        try:
            check_inertial(model.body(body).name, inertial)
        except InputError as error:
            raise FormatError(str(error), self.compiled.document.file) from error
        return inertial

    def assumed_masses(self, bodies: Sequence[int]) -> list[int]:
        """The bodies whose mass is MuJoCo's default density times the volume of their geoms."""
        return [b for b in bodies if (inertial := self._inertial(b)) is not None and inertial.assumed]


def _ellipsoid(x: float, y: float, z: float) -> Mesh:
    """A convex polyhedron around an ellipsoid with these semi-axes, at most 1 % larger."""
    return convex_hull(_sphere_points() * (x, y, z))


@cache
def _sphere_points() -> Array:
    """Corners of a polyhedron around the unit sphere: an icosahedron, each face cut into four three times."""
    golden = (1.0 + 5.0**0.5) / 2.0
    points = [p for a in (-1.0, 1.0) for b in (-golden, golden) for p in ((0.0, a, b), (a, b, 0.0), (b, 0.0, a))]
    corners: Any = np.array(points)
    corners /= np.linalg.norm(corners, axis=1)[:, None]
    for _ in range(3):
        faces = convex_hull(corners)
        edges = np.unique(
            np.sort(np.concatenate([faces.faces[:, [0, 1]], faces.faces[:, [1, 2]], faces.faces[:, [2, 0]]])), axis=0
        )
        middles = faces.vertices[edges].sum(axis=1)
        corners = np.concatenate([faces.vertices, middles / np.linalg.norm(middles, axis=1)[:, None]])
    hull = convex_hull(corners)
    a, b, c = (hull.vertices[hull.faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    nearest = np.abs((normals * a).sum(axis=1) / np.linalg.norm(normals, axis=1)).min()
    return read_only(corners / nearest)
