"""A scene as plain arrays for the compiled search, built once for each set of moving columns and kept with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.robot import Robot
from rr1plan.scene import Arm, Scene
from rr1plan.shapes import HalfSpace
from rr1plan.validation.bodies import CONCAVE, CONVEX, HALF_SPACE, SURFACE, Bodies
from rr1plan.validation.limits import Columns, columns_of
from rr1plan.validation.motion import MovingLink, SceneMotion
from rr1plan.validation.native import AXIS, FIXED, GAIN, HALF, OFFSET, ROUND, SHIFT, SLIDES, TURNS, RefereeStruct
from rr1plan.validation.polynomials import Mask
from rr1plan.validation.solids import Solid

Table = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Setting:
    """A scene with the columns that move in it; the columns of the tables are named where they are read.

    Args:
        columns: Their names, units and limits.
        motion: Its links at rest.
        steps: Links that move, after their parents, shape (s, 4).
        frames: Their joints, shape (s, 17).
        joints: The moving joints, shape (j, 3).
        links: Poses of all links, those that move anywhere, shape (links, 12).
        bodies: Its bodies and pairs.
        searched: Which pairs of shapes the compiled search takes, shape (k,): both convex, or one a half-space
            or a surface.
        kinds: Kinds of the bodies, shape (b, 6).
        sizes: Sizes and places of the bodies on their links, shape (b, 23); of a half-space its world plane.
        corners: Corners of all hulls and surfaces, shape (4, n).
        boxes, nodes: Nodes of all surfaces, shapes (n, 6) and (n, 3).
        chains: Joints that carry each body, one body after the other.
        movers: Bodies that move.
        pairs: The pairs of shapes to search, shape (k, 7).
        padding: Distance to keep for each [m], shape (k,).
    """

    columns: Columns
    motion: SceneMotion
    steps: Table
    frames: Array
    joints: Table
    links: Array
    bodies: Bodies
    searched: Mask
    kinds: Table
    sizes: Array
    corners: Array
    boxes: Array
    nodes: Table
    chains: Table
    movers: Table
    pairs: Table
    padding: Array

    @cached_property
    def bodies_struct(self) -> RefereeStruct:
        """The bodies as the kernels read them."""
        return RefereeStruct(
            "RefereeBodies",
            bodies=self.kinds,
            sizes=self.sizes,
            corners=self.corners,
            boxes=self.boxes,
            nodes=self.nodes,
            body_count=len(self.kinds),
            corner_count=self.corners.shape[1],
        )


def setting_of(scene: Scene, joint_names: tuple[str, ...]) -> Setting:
    """The setting of a scene in which these columns move.

    Args:
        scene: The scene.
        joint_names: The columns, all joints of their arms.

    Raises:
        InputError: shapes that cannot be compared.
    """
    key = ("referee", joint_names)
    kept = scene.kept.get(key)
    if kept is None:
        kept = scene.kept[key] = _build(scene, joint_names)
    found: Setting = kept
    return found


class Linkage(NamedTuple):
    """What of a setting its arms decide, whatever is around them; for the fields see `Setting`."""

    columns: Columns
    motion: SceneMotion
    steps: Table
    frames: Array
    joints: Table
    links: Array


@dataclass(frozen=True)
class _Arms:
    """Arms by what a linkage depends on: those with equal keys have the same."""

    key: tuple[tuple[str, Robot, bytes, bytes], ...]
    joint_names: tuple[str, ...]
    arms: Mapping[str, Arm] = field(compare=False)


@lru_cache(maxsize=32)
def _linkage(arms: _Arms) -> Linkage:
    names = arms.joint_names
    motion = SceneMotion(arms.arms, names, np.zeros(1), np.zeros((1, 1, len(names))))
    return Linkage(columns_of(arms.arms, names), motion, *_steps(motion), _joints(motion), _links(motion))


def _build(scene: Scene, joint_names: tuple[str, ...]) -> Setting:
    key = tuple((name, arm.robot, arm.base.tobytes(), arm.q.tobytes()) for name, arm in scene.arms.items())
    linkage = _linkage(_Arms(key, joint_names, scene.arms))
    bodies = Bodies(scene, linkage.motion)
    kinds, corners, boxes, nodes = _kinds(bodies)
    searched = _searched(bodies)
    item = np.flatnonzero(searched)
    return Setting(
        *linkage,
        bodies,
        searched,
        kinds,
        _sizes(bodies, linkage.links),
        corners,
        boxes,
        nodes,
        np.nonzero(bodies.moved)[1].astype(np.int64),
        np.flatnonzero(bodies.moved.any(axis=1)).astype(np.int64),
        _pairs(bodies, item),
        bodies.padding[bodies.pair[item]],
    )


# ---- links ---------------------------------------------------------------------------------


def _steps(motion: SceneMotion) -> tuple[Table, Array]:
    """The links that some moving joint carries; joints at rest become part of the frame before them."""
    moving = [step for step in motion.steps if motion.movers[step.index].any()]
    steps, frames = np.zeros((len(moving), 4), dtype=np.int64), np.zeros((len(moving), 17))
    for i, step in enumerate(moving):
        slides = step.joint.kind == "prismatic"
        kind = FIXED if step.number < 0 else SLIDES if slides else TURNS
        steps[i] = step.index, step.parent, kind, step.number
        origin = _origin(step)
        frames[i, :9], frames[i, SHIFT:AXIS] = origin[:3, :3].ravel(), origin[:3, 3]
        frames[i, AXIS:GAIN] = step.joint.axis
        frames[i, GAIN], frames[i, OFFSET] = step.drive.scale, step.drive.offset
    return steps, frames


def _origin(step: MovingLink) -> Array:
    """T_parent_child of a joint at rest, T_parent_joint of one that moves."""
    joint, value = step.joint, step.drive.offset
    if step.number >= 0 or joint.kind == "fixed" or value == 0.0:
        return joint.origin
    moved = np.eye(4)
    if joint.kind == "prismatic":
        moved[:3, 3] = value * joint.axis
    else:
        x, y, z = joint.axis
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        moved[:3, :3] += np.sin(value) * cross + (1.0 - np.cos(value)) * cross @ cross
    return np.asarray(joint.origin @ moved)


def _joints(motion: SceneMotion) -> Table:
    moving = [step for step in motion.steps if step.number >= 0]
    joints = np.zeros((len(moving), 3), dtype=np.int64)
    for step in moving:
        before = np.flatnonzero(motion.movers[step.parent])
        kind = SLIDES if step.joint.kind == "prismatic" else TURNS
        joints[step.number] = step.drive.column, before[-1] if len(before) else -1, kind
    return joints


def _links(motion: SceneMotion) -> Array:
    frames = motion.frames(np.zeros((1, motion.coefficients.shape[2])))
    return np.concatenate([frames.rotation[0].reshape(-1, 9), frames.origin[0]], axis=1)


# ---- bodies --------------------------------------------------------------------------------


def _searched(bodies: Bodies) -> Mask:
    """Pairs of two convex shapes, or of one and a half-space or surface; the second of a pair may be that."""
    return np.asarray((bodies.forms[bodies.a] == CONVEX) & (bodies.forms[bodies.b] != CONCAVE))


def _kinds(bodies: Bodies) -> tuple[Table, Array, Array, Table]:
    """Kinds of bodies, the corners of all hulls and surfaces, and boxes and nodes of these."""
    kind, count, columns = bodies.core_rows.T
    surfaces = [body.surface for body in bodies.solids if body.surface is not None]
    sizes = np.array([len(surface.nodes) for surface in surfaces], dtype=np.int64)
    count = count.copy()
    count[bodies.forms == SURFACE] = np.cumsum(sizes) - sizes
    depth = bodies.moved.sum(axis=1).astype(np.int64)
    first, chain = np.cumsum(columns) - columns, np.cumsum(depth) - depth
    hulls = tuple(body for body, n in zip(bodies.solids, columns.tolist(), strict=True) if n)
    kinds = np.stack([kind, first, count, bodies.link, chain, depth], axis=1).astype(np.int64)
    boxes = np.concatenate([np.zeros((0, 6)), *(surface.boxes for surface in surfaces)])
    nodes = np.concatenate([np.zeros((0, 3), np.int64), *(surface.nodes for surface in surfaces)])
    return kinds, _joined_corners(hulls), boxes, nodes


@lru_cache(maxsize=16)
def _joined_corners(hulls: tuple[Solid, ...]) -> Array:
    """The columns of all hulls; the same robots have the same."""
    return np.concatenate([np.zeros((4, 0)), *(body.core.corners for body in hulls)], axis=1)


def _sizes(bodies: Bodies, links: Array) -> Array:
    sizes = bodies.sizes.copy()
    for i in np.flatnonzero(bodies.forms == HALF_SPACE).tolist():
        shape = bodies.solids[i].shape
        assert isinstance(shape, HalfSpace)
        link = links[bodies.link[i]]
        normal = link[:9].reshape(3, 3) @ bodies.local_rotation[i] @ np.array(shape.normal)
        origin = link[:9].reshape(3, 3) @ bodies.local_origin[i] + link[9:]
        sizes[i, HALF:ROUND], sizes[i, ROUND] = normal, shape.offset + normal @ origin
    return sizes


def _pairs(bodies: Bodies, item: NDArray[np.intp]) -> Table:
    a, b = bodies.a[item], bodies.b[item]
    pairs = np.zeros((len(item), 7), dtype=np.int64)
    if not len(item):
        return pairs
    moved = bodies.moved
    numbers = np.arange(moved.shape[1])
    last = np.where(moved > 0.0, numbers, -1).max(axis=1, initial=-1)
    shared = (moved[a] * moved[b]).sum(axis=1)
    element = bodies.pair[item]
    for column, values in enumerate((a, b, element, shared, last[a], last[b], bodies.own[element])):
        pairs[:, column] = values
    return pairs
