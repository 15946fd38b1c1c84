"""An MJCF document, compiled by MuJoCo, whose meshes this package has read.

MuJoCo resolves default classes, frames, angles, replicas, shapes fitted to meshes and masses of shapes. It gets
vertices instead of mesh files, and geoms without contacts, so that it computes no hulls.
"""

from __future__ import annotations

import logging
import re
import warnings
from collections.abc import Container, Iterable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from rr1plan.checks import Array, near_array
from rr1plan.errors import FormatError, InputError
from rr1plan.robot.mesh_lookup import MeshLookup, check_suffix
from rr1plan.robot.mjcf_document import Document, MeshFile
from rr1plan.robot.mujoco_warnings import mujoco_warnings
from rr1plan.shapes import Mesh
from rr1plan.shapes.mesh_files import joined_mesh, read_mesh, warn_of_millimeters
from rr1plan.transforms import rotation_from_quaternion

log = logging.getLogger(__name__)

SUFFIXES = (".stl", ".obj")
# For all meshes together, as MuJoCo copies each of them.
MAX_FACES = 5_000_000
# MuJoCo's viewer initially shows the geoms of groups 0 to 2.
_SEEN_GROUPS = 3
# MuJoCo's default density, that of water [kg/m³].
_DENSITY = 1000.0
_LENGTHS = ("body_pos", "body_ipos", "jnt_pos", "site_pos", "qpos0", "key_qpos", "eq_data")
_NUMBERS = (
    "body_quat", "body_iquat", "body_mass", "body_inertia", "jnt_axis", "jnt_range", "dof_damping", "dof_frictionloss",
    "geom_pos", "geom_quat", "geom_size", "geom_rgba", "site_quat",
)  # fmt: skip
_LINE = re.compile(r"line (\d+)")


@dataclass(frozen=True)
class GeomUse:
    """The purpose of a geom.

    Args:
        collides: It may be in contact: by its bits, by a pair, or as a shape of a hidden group.
        switched_off: It collides here although its bits disable contacts.
        looks: It is visible.
        given_mass: The file specifies its mass or density.
    """

    collides: bool
    switched_off: bool
    looks: bool
    given_mass: bool


@dataclass(frozen=True, eq=False)
class CompiledDocument:
    """A document compiled by MuJoCo.

    Args:
        document: The document.
        spec: Its editable model.
        model: Its compiled model. No geom has contact bits.
        geoms: The editable geoms, by geom id.
        uses: The purpose of each geom.
        meshes: The loaded meshes by name, placed and scaled as in the file.
    """

    document: Document
    spec: mujoco.MjSpec
    model: mujoco.MjModel
    geoms: tuple[mujoco.MjsGeom, ...]
    uses: tuple[GeomUse, ...]
    meshes: dict[str, Mesh]

    def error_at(self, element: Any, message: str) -> FormatError:
        """A `FormatError` at the line of an element of the editable model."""
        return _at(self.document, element, message)

    def pose(self, position: Array, quaternion: Array) -> Array:
        """A transform of the compiled model, shape (4, 4)."""
        T = np.eye(4)
        T[:3, :3] = rotation_from_quaternion(quaternion)
        T[:3, 3] = position
        return T


def compile_document(document: Document, lookup: MeshLookup) -> CompiledDocument:
    """Compile a document.

    Args:
        document: The document.
        lookup: The robot's folders.

    Raises:
        FormatError: errors from MuJoCo, ranges and keyframes that it ignores, or a mesh that cannot be read.
    """
    with mujoco_warnings() as said, warnings.catch_warnings(record=True) as raised:
        warnings.simplefilter("always")
        spec = _parsed(document)
        _check_ranges(document, spec)
        paired = {name for pair in spec.pairs for name in (pair.geomname1, pair.geomname2)}
        uses = [(geom, _use(geom, paired)) for geom in spec.geoms]
        meshes = _Meshes(document, lookup, spec).read(uses)
        for pair in list(spec.pairs):
            spec.delete(pair)
        for geom in spec.geoms:
            geom.contype = geom.conaffinity = 0
        try:
            model = spec.compile()
        except (ValueError, RuntimeError) as error:
            raise _refusal(document, error) from error
    for warning in dict.fromkeys(text.strip() for text in (*said, *(str(w.message) for w in raised))):
        log.warning("%s: %s", document.file, warning)
    _check_keyframes(document, spec, model)
    _check_numbers(document, model)
    kept = sorted((geom.id, geom, use) for geom, use in uses if geom.id >= 0)
    geoms, used = tuple(geom for _, geom, _ in kept), tuple(use for _, _, use in kept)
    return CompiledDocument(document, spec, model, geoms, used, meshes)


def _parsed(document: Document) -> mujoco.MjSpec:
    try:
        return mujoco.MjSpec.from_string(document.text)
    except (ValueError, RuntimeError) as error:
        raise _refusal(document, error) from error


def _refusal(document: Document, error: Exception) -> FormatError:
    """MuJoCo's error at the element that it refers to."""
    text = str(error)
    lines = _LINE.findall(text)
    message = text.split("\nElement")[0].removeprefix("XML Error: ").removeprefix("Error: ").strip()
    return document.error(f"MuJoCo does not take it: {message}", int(lines[-1]) if lines else None)


def _use(geom: mujoco.MjsGeom, paired: Container[str]) -> GeomUse:
    """The purpose of a geom; `paired` are the names of geoms in contact pairs."""
    hidden = geom.group >= _SEEN_GROUPS
    touches = bool(geom.contype or geom.conaffinity) or (bool(geom.name) and geom.name in paired)
    weighed = np.isfinite(geom.mass) or geom.density != _DENSITY
    return GeomUse(
        collides=touches or hidden,
        switched_off=hidden and not touches,
        looks=not hidden and geom.rgba[3] > 0.0,
        given_mass=bool(weighed),
    )


# ---- content that MuJoCo ignores ---------------------------------------------------------------


def _check_ranges(document: Document, spec: mujoco.MjSpec) -> None:
    """Reject ranges that MuJoCo treats as absent."""
    automatic = mujoco.mjtLimited.mjLIMITED_AUTO
    for joint in spec.joints:
        lower, upper = joint.range
        if joint.limited == automatic and spec.compiler.autolimits and lower >= upper and (lower or upper):
            raise _at(document, joint, f"joint {joint.name!r} has range {lower:g} to {upper:g}, expected lower < upper")


def _at(document: Document, element: Any, message: str) -> FormatError:
    lines = _LINE.findall(element.info or "")
    return document.error(message, int(lines[-1]) if lines else None)


def _check_keyframes(document: Document, spec: mujoco.MjSpec, model: mujoco.MjModel) -> None:
    for index, key in enumerate(spec.keys):
        if len(key.qpos) not in (0, model.nq):
            name = key.name or str(index)
            raise _at(document, key, f"keyframe {name!r} has {len(key.qpos)} values in qpos, expected {model.nq}")


def _check_numbers(document: Document, model: mujoco.MjModel) -> None:
    """Reject a model with a number that is not finite, such as 1e200 squared, or an unreasonable length."""
    for name in _NUMBERS:
        if not np.isfinite(getattr(model, name)).all():
            raise FormatError(f"gives MuJoCo a number that is not finite ({name})", document.file)
    for name in _LENGTHS:
        try:
            near_array(name, getattr(model, name), (None,) * getattr(model, name).ndim)
        except InputError as error:
            raise FormatError(str(error), document.file) from error


# ---- meshes -----------------------------------------------------------------------------------


class _Meshes:
    """Reads the meshes that geoms use, and passes them to MuJoCo."""

    def __init__(self, document: Document, lookup: MeshLookup, spec: mujoco.MjSpec) -> None:
        self.document = document
        self.lookup = lookup
        self.spec = spec
        self.faces = 0

    def read(self, uses: Iterable[tuple[mujoco.MjsGeom, GeomUse]]) -> dict[str, Mesh]:
        """The meshes with files that are used, by name; geoms with a missing mesh that is only visual are deleted.

        Raises:
            FormatError: a mesh for collision or mass that cannot be read, or too many triangles.
        """
        users: dict[str, list[tuple[mujoco.MjsGeom, GeomUse]]] = {}
        for geom, use in uses:
            if geom.meshname:
                users.setdefault(geom.meshname, []).append((geom, use))
        found: dict[str, Mesh] = {}
        for asset in list(self.spec.meshes):
            file = self.document.meshes.get(asset.name)
            if asset.name not in users:
                self.spec.delete(asset)
            elif file is not None:
                mesh = self._mesh(asset, file, users[asset.name])
                if mesh is not None:
                    found[asset.name] = mesh
        return found

    def _mesh(self, asset: mujoco.MjsMesh, file: MeshFile, users: list[tuple[mujoco.MjsGeom, GeomUse]]) -> Mesh | None:
        try:
            check_suffix(file.name, SUFFIXES)
            mesh = joined_mesh([part.mesh for part in read_mesh(self.lookup.first(f"mesh {file.name!r}", file.places))])
        except FormatError as error:
            if any(_matters(geom, use) for geom, use in users):
                raise file.element.error(str(error)) from error
            log.warning("%s:%d: %s; links are shown without it", *file.element.at, error)
            for geom, _ in users:
                self.spec.delete(geom)
            self.spec.delete(asset)
            return None
        self.faces += len(mesh.faces)
        if self.faces > MAX_FACES:
            raise file.element.error(f"the meshes have more than {MAX_FACES} triangles; try decimated ones")
        asset.uservert = mesh.vertices.ravel()
        asset.userface = mesh.faces.ravel()
        placed = _placed(mesh, np.array(asset.refpos), np.array(asset.refquat), np.array(asset.scale))
        warn_of_millimeters("{}:{}".format(*file.element.at), "mesh", [placed.vertices])
        return placed


def _matters(geom: mujoco.MjsGeom, use: GeomUse) -> bool:
    """Whether the robot's contacts or masses depend on this geom."""
    weightless = geom.mass == 0.0 or geom.parent.explicitinertial or geom.parent.name == "world"
    return use.collides or geom.type != mujoco.mjtGeom.mjGEOM_MESH or not weightless


def _placed(mesh: Mesh, position: Array, quaternion: Array, scale: Array) -> Mesh:
    """A mesh as MuJoCo places it by refpos, refquat and scale."""
    R = rotation_from_quaternion(quaternion)
    vertices = ((mesh.vertices - position) @ R) * scale
    return Mesh(vertices, mesh.faces[:, ::-1] if np.prod(scale) < 0.0 else mesh.faces)
