"""Animated 3-D models as binary glTF, for Blender, Unity, web pages and VR.

Each link is a node below its parent link, which rotates or slides with its joint; equal links and equal objects share
their mesh.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from rr1plan.checks import Array, positive_number
from rr1plan.errors import InputError
from rr1plan.export.glb_container import GlbArrays
from rr1plan.export.glb_meshes import joined, shape_triangles
from rr1plan.files.file_access import check_writable, write_bytes
from rr1plan.path import MOST_SAMPLES
from rr1plan.playback.viewer.page_arrays import unpack_array
from rr1plan.playback.viewer.page_content import HasPage, page_content
from rr1plan.playback.viewer.page_document import Document, view_document
from rr1plan.robot import Robot
from rr1plan.scene import Scene
from rr1plan.scene.problem import Problem
from rr1plan.trajectory import Trajectory, locate

# Default colors, those of the page.
_LINK, _OBSTACLE, _HELD = (0.77, 0.79, 0.82), (0.58, 0.65, 0.74), (0.96, 0.73, 0.27)
_FEWEST_INTERVALS = 10  # between samples of a motion, however short: players interpolate linearly
_STILL = 1e-9  # [rad or m] a joint that moves less is not animated


def save_glb(
    file: str | os.PathLike[str],
    what: Scene | Robot | Problem | HasPage,
    *,
    trajectory: Trajectory | None = None,
    rate: float = 60.0,
) -> FilePath:
    """Write a scene or a motion as an animated 3-D model (binary glTF 2.0).

    It opens in Blender, Unity, VR viewers and web pages. The root node has the name of the scene and rotates z up to
    glTF's y up. Below it are a node "arm/link" for each link, in the order of the robot's tree, and a node for each
    object; held objects are below the link that holds them. Joints are animated by rotations or translations that
    players interpolate linearly, exact at every sample.

    Args:
        file: The file, whose name ends in .glb; written atomically.
        what: A motion, a sequence plan, a C-space with its path, or a static scene, robot or problem.
        trajectory: A motion of that scene, if `what` is a scene.
        rate: Samples per second; a motion has at least 11 samples, however short it is.

    Returns:
        The file.

    Raises:
        InputError: a value without a page, another suffix, a file that cannot be written, a rate that is not above
            zero, or too many samples.
        UnknownNameError: a column that is not a joint of the scene.
        NoPlanError: a plan without a motion.
    """
    file = check_writable(file, ".glb")
    rate = positive_number("rate", rate)
    if trajectory is None:
        document, _ = page_content(what)
    elif isinstance(what, Scene):
        document = view_document(what, trajectory=trajectory)
    else:
        raise InputError("a trajectory is given together with a value other than a scene, expected its scene")
    return write_bytes(file, _Model(document, rate).pack())


class _Model:
    """A glTF document that grows node by node."""

    def __init__(self, document: Document, rate: float) -> None:
        self._source = document
        self._arrays = GlbArrays()
        self._nodes: list[dict[str, Any]] = []
        self._meshes: dict[str, int] = {}
        self._mesh_rows: list[dict[str, Any]] = []
        self._materials: dict[tuple[float, ...], int] = {}
        self._channels: list[dict[str, Any]] = []
        self._samplers: list[dict[str, Any]] = []
        self._times, self._q = _sampled_track(document, rate)
        root = self._node(None, document["title"] or "scene", rotation=[-(0.5**0.5), 0.0, 0.0, 0.5**0.5])
        self._add_arms(root)
        for thing in document["obstacles"]:
            self._node(root, thing["name"], self._mesh(thing["parts"], _OBSTACLE), **_placed(_matrix(thing["pose"])))
        if document["bodies"] is not None:
            self._add_bodies(root, document["bodies"])

    # ---- nodes -----------------------------------------------------------------------------

    def _node(self, parent: int | None, name: str, mesh: int | None = None, **place: list[float]) -> int:
        index = len(self._nodes)
        self._nodes.append({"name": name, **place} | ({} if mesh is None else {"mesh": mesh}))
        if parent is not None:
            self._nodes[parent].setdefault("children", []).append(index)
        return index

    def _add_arms(self, root: int) -> None:
        first = 0
        for row in self._source["arms"]:
            robot = self._source["robots"][row["robot"]]
            links: dict[int, int] = {}
            children = {joint["child"] for joint in robot["joints"]}
            for link in sorted(set(range(len(robot["links"]))) - children):
                links[link] = self._link(root, row["name"], robot, link, _matrix(row["base"]))
            # Joints are in the order in which poses are computed: a parent's pose is known before its children's.
            for joint in robot["joints"]:
                q = np.concatenate([self._q[:, first : first + len(row["q"])], np.array(row["q"])[None]])
                values = joint["offset"] + (0.0 if joint["column"] < 0 else joint["factor"] * q[:, joint["column"]])
                values = np.broadcast_to(values, len(q))
                shift, turn = _joint_places(joint, values)
                place = {"translation": shift[0].tolist(), "rotation": turn[0].tolist()}
                node = self._node(links[joint["parent"]], "", None, **place)
                links[joint["child"]] = node
                self._dress(node, row["name"], robot, joint["child"])
                if np.ptp(values[:-1]) > _STILL:
                    self._animate(
                        node, *(("translation", shift[:-1]) if joint["kind"] == 1 else ("rotation", turn[:-1]))
                    )
            self._add_held(row["name"], robot, links)
            first += len(row["q"])

    def _link(self, parent: int, arm: str, robot: Mapping[str, object], link: int, T: Array) -> int:
        node = self._node(parent, "", None, **_placed(T))
        self._dress(node, arm, robot, link)
        return node

    def _dress(self, node: int, arm: str, robot: Mapping[str, Any], link: int) -> None:
        """Give a link's node its name and its mesh."""
        self._nodes[node]["name"] = f"{arm}/{robot['links'][link]}"
        mesh = self._mesh([part for part in robot["visuals"] if part["link"] == link], _LINK)
        if mesh is not None:
            self._nodes[node]["mesh"] = mesh

    def _add_held(self, arm: str, robot: Mapping[str, Any], links: Mapping[int, int]) -> None:
        for held in self._source["attachments"]:
            if held["arm"] == arm:
                link = links[robot["links"].index(held["link"])]
                self._node(link, held["name"], self._mesh(held["parts"], _HELD), **_placed(_matrix(held["pose"])))

    def _add_bodies(self, root: int, bodies: Mapping[str, Any]) -> None:
        """Free objects; while its pose is not finite an object is absent, with a scale of zero."""
        times, poses = unpack_array(bodies["times"]), unpack_array(bodies["poses"])
        for k, thing in enumerate(bodies["objects"]):
            own = poses[:, k]
            there = np.isfinite(own).all(axis=1)
            if not there.any():
                continue
            known = np.maximum.accumulate(np.where(there, np.arange(len(own)), np.argmax(there)))
            shift, turn = own[known, :3], _continuous(own[known][:, [4, 5, 6, 3]])
            place = {"translation": shift[0].tolist(), "rotation": turn[0].tolist()}
            node = self._node(root, thing["name"], self._mesh(thing["parts"], _OBSTACLE), **place)
            if len(times) > 1:
                self._animate(node, "translation", shift, times)
                self._animate(node, "rotation", turn, times)
                if not there.all():
                    self._animate(node, "scale", np.repeat(there[:, None], 3, axis=1), times, "STEP")

    # ---- meshes ----------------------------------------------------------------------------

    def _mesh(self, parts: Iterable[Mapping[str, Any]], fallback: tuple[float, ...]) -> int | None:
        """The mesh of some parts, a primitive for each color; None without parts."""
        colors: dict[tuple[float, ...], list[Mapping[str, Any]]] = {}
        for part in parts:
            colors.setdefault(tuple(part["color"] or fallback), []).append(part)
        if not colors:
            return None
        key = json.dumps([[c, [[p["shape"], p["pose"]] for p in own]] for c, own in colors.items()])
        if key not in self._meshes:
            self._meshes[key] = len(self._mesh_rows)
            self._mesh_rows.append({"primitives": [self._primitive(own, color) for color, own in colors.items()]})
        return self._meshes[key]

    def _primitive(self, parts: Iterable[Mapping[str, Any]], color: tuple[float, ...]) -> dict[str, Any]:
        shapes = self._source["shapes"]
        body = joined(shape_triangles(shapes[part["shape"]]).moved(_matrix(part["pose"])) for part in parts)
        attributes = {"POSITION": self._arrays.vertices(body.vertices), "NORMAL": self._arrays.vertices(body.normals)}
        indices = self._arrays.indices(body.faces)
        return {"attributes": attributes, "indices": indices, "material": self._material(color)}

    def _material(self, color: tuple[float, ...]) -> int:
        red, green, blue = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in color[:3])  # sRGB
        return self._materials.setdefault((red, green, blue, (*color, 1.0)[3]), len(self._materials))

    # ---- the motion ------------------------------------------------------------------------

    def _animate(self, node: int, path: str, values: Array, times: Array | None = None, kind: str = "LINEAR") -> None:
        instants = np.asarray(self._times if times is None else times, dtype=np.float32)
        later = np.concatenate([[True], np.diff(instants) > 0.0])  # in the file's precision
        inputs, outputs = self._arrays.track(instants[later]), self._arrays.track(values[later])
        sampler = {"input": inputs, "output": outputs, "interpolation": kind}
        self._channels.append({"sampler": len(self._samplers), "target": {"node": node, "path": path}})
        self._samplers.append(sampler)

    def pack(self) -> bytes:
        """The file."""
        materials = [
            {
                "pbrMetallicRoughness": {"baseColorFactor": color, "metallicFactor": 0.0, "roughnessFactor": 0.6},
                "doubleSided": True,  # meshes of robots are not always oriented
                **({"alphaMode": "BLEND"} if color[3] < 1.0 else {}),
            }
            for color in self._materials
        ]
        motion = {"name": "motion", "channels": self._channels, "samplers": self._samplers}
        return self._arrays.pack(
            {
                "asset": {"version": "2.0", "generator": "rr1plan"},
                "scene": 0,
                "scenes": [{"nodes": [0]}],
                "nodes": self._nodes,
                "meshes": self._mesh_rows,
                "materials": materials,
                "animations": [motion] if self._channels else [],
            }
        )


def _matrix(numbers: Iterable[float]) -> Array:
    """A transform (4, 4) from its column-major numbers in a document."""
    return np.array(numbers, dtype=float).reshape(4, 4).T


def _placed(T: Array) -> dict[str, list[float]]:
    return {"translation": T[:3, 3].tolist(), "rotation": Rotation.from_matrix(T[:3, :3]).as_quat().tolist()}


def _joint_places(joint: Mapping[str, Any], values: Array) -> tuple[Array, Array]:
    """Translations (n, 3) and rotations (n, 4, xyzw) of a joint's child in its parent's frame."""
    origin, axis = _matrix(joint["origin"]), np.array(joint["axis"], dtype=float)
    shifts = np.tile(origin[:3, 3], (len(values), 1))
    turn = Rotation.from_matrix(origin[:3, :3])
    if joint["kind"] == 1:
        return shifts + values[:, None] * (origin[:3, :3] @ axis), np.tile(turn.as_quat(), (len(values), 1))
    if joint["kind"] == 0:
        return shifts, np.tile(turn.as_quat(), (len(values), 1))
    return shifts, _continuous((turn * Rotation.from_rotvec(values[:, None] * axis)).as_quat())


def _continuous(turns: Array) -> Array:
    """The same rotations without sign changes, which a player would interpolate as a turn."""
    signs = np.where((turns[1:] * turns[:-1]).sum(axis=1) < 0.0, -1.0, 1.0)
    continuous: Array = turns * np.concatenate([[1.0], np.cumprod(signs)])[:, None]
    return continuous


def _sampled_track(document: Document, rate: float) -> tuple[Array, Array]:
    """Instants from zero [s], shape (n,), and the configurations of all arms then, shape (n, nq)."""
    rest = np.array([value for row in document["arms"] for value in row["q"]])
    track = document["track"]
    if track is None:
        return np.zeros(1), rest[None]
    columns = track["columns"]
    breaks, coefficients = (unpack_array(track[name]).astype(float) for name in ("breaks", "coefficients"))
    motion = Trajectory.trusted(tuple(document["columns"][c] for c in columns), breaks, coefficients)
    step = min(1.0 / rate, motion.duration / _FEWEST_INTERVALS) if motion.duration else 1.0 / rate
    if motion.duration * rate > MOST_SAMPLES:
        raise InputError(f"rate is {rate:g}, which makes more than {MOST_SAMPLES} samples, expected a lower one")
    times = motion.sample_times(step)
    # A piece at rest, perhaps of hours, needs only its ends.
    rests = np.abs(coefficients[:, 1:]).sum(axis=(1, 2)) == 0.0
    if rests.any() and len(breaks) > 1:
        inside = rests[locate(breaks, times)[0]]
        times = np.unique(np.concatenate([times[~inside], breaks[:-1][rests], breaks[1:][rests]]))
    q = np.tile(rest, (len(times), 1))
    q[:, columns] = motion(times)
    return times - times[0], q
