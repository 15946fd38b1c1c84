"""The links of a URDF: masses, shapes and colors."""

from __future__ import annotations

import logging
import math

import numpy as np

from rr1plan.checks import HEAVIEST, Array, read_only
from rr1plan.errors import FormatError, InputError
from rr1plan.files.xml_reader import Element
from rr1plan.robot import Geometry, Inertial, Link
from rr1plan.robot.check_robot import check_inertial
from rr1plan.robot.mesh_lookup import MeshLookup
from rr1plan.robot.urdf_joints import read_origin
from rr1plan.shapes import Box, Capsule, Color, Cylinder, Shape, Sphere
from rr1plan.shapes.convex_decomposition import Convexity, convex_shapes
from rr1plan.shapes.mesh_files import GLTF, MeshPart, read_mesh, warn_of_millimeters

log = logging.getLogger(__name__)

# Moments within this fraction of the largest one from zero are rounded zeros.
_ROUNDING = 1e-9
# Larger radii of gyration are due to other units [m].
_WIDEST_GYRATION = 10.0
_SHAPES = ("box", "sphere", "cylinder", "capsule", "mesh")


class UrdfLinkReader:
    """Reads links one after the other, each mesh file once.

    Args:
        root: The document, for its shared materials.
        lookup: Finds mesh files.
        convex: Replacement of non-convex collision meshes.

    Attributes:
        gltf: Shapes of glTF files by name, with the scale of the file, shape (3,).
    """

    def __init__(self, root: Element, lookup: MeshLookup, convex: Convexity) -> None:
        self._lookup = lookup
        self._convex = convex
        self._materials = self._shared_materials(root)
        self._meshes: dict[tuple[str, tuple[float, ...]], tuple[MeshPart, ...]] = {}
        self.gltf: dict[str, tuple[float, ...]] = {}

    def link(self, element: Element) -> Link:
        """One link.

        Raises:
            FormatError: an impossible mass, shape or color, or a mesh that cannot be read.
        """
        name = element.text("name")
        inertial = element.child("inertial")
        visuals = [g for i, e in enumerate(element.all("visual")) for g in self._visual(e, f"{name}/visual{i}")]
        collisions = [
            g for i, e in enumerate(element.all("collision")) for g in self._collision(e, f"{name}/collision{i}")
        ]
        return Link(name, None if inertial is None else _inertial(inertial, name), tuple(visuals), tuple(collisions))

    # ---- shapes ------------------------------------------------------------------------

    def _visual(self, element: Element, name: str) -> list[Geometry]:
        pose, color = read_origin(element), self._color(element)
        shape = _shape_element(element)
        try:
            if shape.tag != "mesh":
                return [Geometry(name, _primitive(shape), pose, color)]
            parts = self._mesh(shape)
        except FormatError as error:
            log.warning("%s; the link is shown without it", error)
            return []
        names = self._names(name, len(parts), shape)
        return [Geometry(n, p.mesh, pose, color or p.color) for n, p in zip(names, parts, strict=True)]

    def _collision(self, element: Element, name: str) -> list[Geometry]:
        pose = read_origin(element)
        shape = _shape_element(element)
        if shape.tag != "mesh":
            return [Geometry(name, _primitive(shape), pose)]
        meshes = [part.mesh for part in self._mesh(shape)]
        try:
            shapes = convex_shapes(meshes, self._convex)
        except InputError as error:
            raise shape.error(str(error)) from error
        names = self._names(name, len(shapes), shape)
        return [Geometry(n, s, pose) for n, s in zip(names, shapes, strict=True)]

    def _names(self, name: str, count: int, element: Element) -> list[str]:
        """The names of the shapes of one mesh."""
        names = [name] if count == 1 else [f"{name}.{k}" for k in range(count)]
        file, scale = _mesh_key(element)
        if file.lower().endswith(GLTF):
            self.gltf.update(dict.fromkeys(names, scale))
        return names

    def _mesh(self, element: Element) -> tuple[MeshPart, ...]:
        key = _mesh_key(element)
        if key not in self._meshes:
            try:
                self._meshes[key] = read_mesh(self._lookup.find(key[0]), key[1])
            except InputError as error:
                raise element.error(str(error)) from error
            vertices = [part.mesh.vertices for part in self._meshes[key]]
            warn_of_millimeters("{}:{}".format(*element.at), "mesh", vertices)
        return self._meshes[key]

    # ---- colors -----------------------------------------------------------------------

    def _shared_materials(self, root: Element) -> dict[str, Color | None]:
        """The materials by name; those inside links count too, as in other readers."""
        inner = (m for e in root.all("link") for v in e.all("visual") for m in v.all("material"))
        found: dict[str, Color | None] = {}
        for material in (*root.all("material"), *inner):
            color = _rgba(material)
            name = material.attributes.get("name", "")
            if name and (color is not None or material.child("texture") is not None):
                found.setdefault(name, color)
        return found

    def _color(self, element: Element) -> Color | None:
        material = element.child("material")
        if material is None:
            return None
        color = _rgba(material)
        name = material.attributes.get("name", "")
        if color is None and name and name not in self._materials:
            log.warning("%s:%d: material %r is nowhere defined, the default color is used", *material.at, name)
        return color or self._materials.get(name)


def _rgba(material: Element) -> Color | None:
    color = material.child("color")
    if color is None:
        return None
    try:
        r, g, b, a = color.vector("rgba", 4)
    except FormatError as error:
        log.warning("%s; the default color is used", error)
        return None
    if not all(0.0 <= c <= 1.0 for c in (r, g, b, a)):
        written = color.attributes["rgba"]
        log.warning("%s:%d: <color> rgba=%r, expected numbers from 0 to 1; they are cut", *color.at, written)
    r, g, b, a = (min(max(c, 0.0), 1.0) for c in (r, g, b, a))
    return r, g, b, a


def _shape_element(element: Element) -> Element:
    geometry = element.required("geometry")
    if len(geometry.children) != 1 or geometry.children[0].tag not in _SHAPES:
        got = ", ".join(f"<{e.tag}>" for e in geometry.children) or "nothing"
        raise geometry.error(f"<geometry> holds {got}, expected one of {', '.join(_SHAPES)}")
    return geometry.children[0]


def _mesh_key(element: Element) -> tuple[str, tuple[float, ...]]:
    """The name and the scale of a mesh; a negative scale mirrors it."""
    scale = element.vector("scale", 3, (1.0, 1.0, 1.0))
    if 0.0 in scale:
        raise element.error(f"<mesh> scale={element.attributes['scale']!r}, expected numbers other than zero")
    return element.text("filename"), scale


def _primitive(element: Element) -> Shape:
    if element.tag == "box":
        x, y, z = element.vector("size", 3)
        if min(x, y, z) <= 0.0:
            raise element.error(f"<box> size={element.attributes['size']!r}, expected numbers above zero")
        return Box((x, y, z))
    radius = element.positive("radius")
    if element.tag == "sphere":
        return Sphere(radius)
    length = element.positive("length")
    return Cylinder(radius, length) if element.tag == "cylinder" else Capsule(radius, length)


def _inertial(element: Element, link: str) -> Inertial | None:
    """Mass, center and inertia, turned into the link's axes; a mass of zero marks a pure frame.

    An inertia that is zero throughout is that of a point. Any other has to be positive definite; that of a rod, or one
    written with few digits, may miss this by rounding. An inertia that misses it by more makes the link a point.
    """
    pose = read_origin(element)
    mass = element.required("mass").number("value")
    if element.child("inertia") is None:
        raise element.error(
            f"<inertial> of link {link!r} has no <inertia>; add one, or leave <inertial> out to have it estimated"
        )
    tensor = element.required("inertia")
    xx, xy, xz, yy, yz, zz = (tensor.number(n) for n in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if mass == 0.0:
        if inertia.any():
            log.warning("%s:%d: link %r has an inertia but no mass, both are left out", *tensor.at, link)
        return None
    if mass < 0.0:
        raise element.error(f"link {link!r} has mass {mass}, expected a number above zero")
    if np.abs(inertia).max() > HEAVIEST:  # its moments might overflow
        raise tensor.error(f"link {link!r} has an inertia up to {np.abs(inertia).max():.3g}, which no body has")
    inertia = _clipped(inertia)
    moments = np.linalg.eigvalsh(inertia)
    if moments[0] <= 0.0 and inertia.any():
        found = ", ".join(f"{moment:.3g}" for moment in moments)
        log.warning(
            "%s:%d: link %r has an inertia that is not positive definite, moments %s; it is taken as a point",
            *tensor.at,
            link,
            found,
        )
        inertia = np.zeros((3, 3))
    elif moments[0] + moments[1] < moments[2] * (1.0 - 1e-6):
        log.warning("%s:%d: link %r has an inertia no body can have: %s", *tensor.at, link, moments.tolist())
    radius = math.sqrt(float(np.linalg.norm(inertia, 2)) / mass)
    if radius > _WIDEST_GYRATION:
        text = (
            "%s:%d: link %r of %g kg has a radius of gyration of %.3g m; if its inertia is in kg mm², scale it by 1e-6"
        )
        log.warning(text, *tensor.at, link, mass, radius)
    R = pose[:3, :3]
    inertial = Inertial(mass, read_only(pose[:3, 3].copy()), read_only(R @ inertia @ R.T))
    try:
        check_inertial(link, inertial)
    except InputError as error:
        raise element.error(str(error)) from error
    return inertial


def _clipped(inertia: Array) -> Array:
    """The inertia with zero moments (up to rounding) raised to just above zero."""
    moments, axes = np.linalg.eigh(inertia)
    least = _ROUNDING * moments[2]
    if not -least <= moments[0] <= 0.0 < moments[2]:
        return inertia
    return np.asarray((axes * np.maximum(moments, least)) @ axes.T)
