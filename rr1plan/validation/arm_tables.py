"""Models of robots and of obstacles for the compiled search: made once and shared by all arms that are equal.

A model knows joints, bodies and which pairs of its elements must not touch; where its base is, what its columns are and
what other things are called is the scene's.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.robot import Geometry, Joint, Link, Robot
from rr1plan.scene import Attachment, Obstacle
from rr1plan.validation.bodies import ElementBodies, element_bodies
from rr1plan.validation.motion import Drive, drives
from rr1plan.validation.native import (
    AXIS,
    GAIN,
    OFFSET,
    PLANE,
    SHAPE,
    SHAPE_CONCAVE,
    SHAPE_SURFACE,
    SHIFT,
    SLIDES,
    TURNS,
    RefereeStruct,
)

Table = NDArray[np.int64]


class HeldThing(NamedTuple):
    """What an arm holds, as far as its model depends on it.

    Args:
        geometries: Its shapes.
        link: The link it is fixed to.
        pose: T_link_object as bytes, shape (4, 4).
        touch: Links of the arm it may touch besides.
    """

    geometries: tuple[Geometry, ...]
    link: str
    pose: bytes
    touch: frozenset[str]

    @staticmethod
    def of(thing: Attachment) -> HeldThing:
        """That of an attachment."""
        return HeldThing(thing.geometries, thing.link, thing.pose.tobytes(), thing.touch)


@dataclass(frozen=True, eq=False)
class ArmTables:
    """A model as the kernels read it.

    Args:
        links: Names of the links with shapes, which are the first elements; things that are held come after them.
        rows: Its bodies, on the links that carry them.
        bodies: The same as the kernels read them.
        struct: The model.
        counts: Numbers of its columns, links, joints, bodies and elements, shape (5,).
        depth: Joints of its longest chain.
        element_bodies: First body of each element, shape (elements + 1,).
        has_plane: Elements with a half-space for a shape, shape (elements,) of booleans.
        carried: Elements that a joint carries, shape (elements,) of booleans.
        has_concave: Elements with a shape that the compiled search passes over, shape (elements,) of booleans.
        own_checked: Which pairs of its elements must not touch, shape (elements, elements) of 0 and 1; symmetric.
    """

    links: tuple[str, ...]
    rows: ElementBodies
    bodies: RefereeStruct
    struct: RefereeStruct
    counts: Table
    depth: int
    element_bodies: Table
    has_plane: NDArray[np.bool_]
    carried: NDArray[np.bool_]
    has_concave: NDArray[np.bool_]
    own_checked: NDArray[np.uint8]


def arm_tables(robot: Robot, held: tuple[HeldThing, ...]) -> ArmTables:
    """The model of a robot with what it holds; the same robot with other limits has the same.

    Raises:
        InputError: a joint that follows none that has a value.
    """
    values = tuple(robot.locked_joints.items())
    return _build(
        _Content(robot.links, robot.joints, robot.joint_names, values, robot.disabled_collisions, held, robot)
    )


@dataclass(frozen=True)
class _Content:
    """All of a robot that its model depends on."""

    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    joint_names: tuple[str, ...]
    values: tuple[tuple[str, float], ...]
    disabled_collisions: frozenset[frozenset[str]]
    held: tuple[HeldThing, ...]
    robot: Robot = field(compare=False)


@lru_cache(maxsize=64)
def _build(content: _Content) -> ArmTables:
    robot = content.robot
    columns = {name: i for i, name in enumerate(robot.joint_names)}
    driven = drives(robot, columns, {})
    carriers: dict[str, tuple[int, Array]] = {robot.base: (0, np.eye(4))}
    chains: list[tuple[int, ...]] = [()]
    joints: list[tuple[int, int, int]] = []
    frames: list[Array] = []
    for joint in robot.joints:
        drive = driven.get(joint.name, Drive(-1, 0.0, 0.0))
        carrier, T = carriers[joint.parent]
        if joint.kind == "fixed" or drive.column < 0 or drive.scale == 0.0:
            carriers[joint.child] = carrier, T @ _origin_at(joint, drive.offset)
            continue
        carriers[joint.child] = len(chains), np.eye(4)
        chains.append((*chains[carrier], len(joints)))
        joints.append((carrier, SLIDES if joint.kind == "prismatic" else TURNS, drive.column))
        frames.append(_frame(T @ joint.origin, joint, drive))
    links = tuple(link.name for link in robot.links if link.collisions)
    elements = [(link.name, link.collisions, np.eye(4)) for link in robot.links if link.collisions]
    elements += [(held.link, held.geometries, np.frombuffer(held.pose).reshape(4, 4)) for held in content.held]
    parts = [element_bodies(geometries, carriers[link][1] @ T) for link, geometries, T in elements]
    base = links.index(robot.base) if robot.base in links else -1
    rows, counts = ElementBodies.joined(parts), [len(part.solids) for part in parts]
    on = [carriers[link][0] for link, _, _ in elements]
    return _tables(links, joints, frames, chains, rows, counts, on, base, _own_checked(links, content), len(columns))


def _origin_at(joint: Joint, value: float) -> Array:
    """T_parent_child of a joint that does not move."""
    if joint.kind == "fixed" or value == 0.0:
        return joint.origin
    moved = np.eye(4)
    if joint.kind == "prismatic":
        moved[:3, 3] = value * joint.axis
    else:
        x, y, z = joint.axis
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        moved[:3, :3] += np.sin(value) * cross + (1.0 - np.cos(value)) * cross @ cross
    return np.asarray(joint.origin @ moved)


def _frame(origin: Array, joint: Joint, drive: Drive) -> Array:
    """A row of `JointFrame`."""
    frame = np.zeros(17)
    frame[:SHIFT], frame[SHIFT:AXIS], frame[AXIS:GAIN] = origin[:3, :3].ravel(), origin[:3, 3], joint.axis
    frame[GAIN], frame[OFFSET] = drive.scale, drive.offset
    return frame


def _own_checked(links: tuple[str, ...], content: _Content) -> NDArray[np.uint8]:
    """Which pairs of an arm's links and held things must not touch."""
    index, count = {name: i for i, name in enumerate(links)}, len(links) + len(content.held)
    checked = np.ones((count, count), dtype=np.uint8)
    np.fill_diagonal(checked, 0)
    for both in content.disabled_collisions:
        # Links without a shape are no elements.
        pair = [index[name] for name in both if name in index]
        if len(pair) == 2:
            checked[pair, pair[::-1]] = 0
    for i, thing in enumerate(content.held, start=len(links)):
        near = [index[name] for name in thing.touch | {thing.link} if name in index]
        near += [j for j, other in enumerate(content.held, start=len(links)) if other.link == thing.link]
        checked[i, near] = checked[near, i] = 0
    return checked


def obstacle_tables(obstacles: Iterable[Obstacle]) -> ArmTables:
    """The model of all obstacles of a scene: elements of a single link at the world's origin."""
    obstacles = tuple(obstacles)
    counts = [len(obstacle.geometries) for obstacle in obstacles]
    poses = np.array([obstacle.pose for obstacle in obstacles]).reshape(-1, 4, 4)
    geometries = [geometry for obstacle in obstacles for geometry in obstacle.geometries]
    local = np.array([geometry.pose for geometry in geometries]).reshape(-1, 4, 4)
    rows = ElementBodies.of([geometry.shape for geometry in geometries], poses.repeat(counts, axis=0) @ local)
    checked = np.zeros((len(counts), len(counts)), dtype=np.uint8)
    return _tables((), [], [], [()], rows, counts, [0] * len(counts), -1, checked, 0, stands=True)


def _tables(
    links: tuple[str, ...],
    joints: list[tuple[int, int, int]],
    frames: list[Array],
    chains: list[tuple[int, ...]],
    rows: ElementBodies,
    counts: list[int],
    carriers: list[int],
    base: int,
    own_checked: NDArray[np.uint8],
    columns: int,
    *,
    stands: bool = False,
) -> ArmTables:
    """A model of elements, of each of which the number of bodies and the link that carries them are given.

    Only of one that stands are surfaces searched triangle by triangle.
    """
    first = np.concatenate([np.zeros(1, np.int64), np.cumsum(counts, dtype=np.int64)])
    link = np.repeat(np.array(carriers, dtype=np.int64), counts)
    kind, corner_count, corner_columns = rows.cores.T
    if not stands:
        kind = np.where(kind == SHAPE_SURFACE, SHAPE_CONCAVE, kind)
    surfaces = [s.surface for s, k in zip(rows.solids, kind.tolist(), strict=True) if k == SHAPE_SURFACE and s.surface]
    node_counts = np.zeros(len(kind), dtype=np.int64)
    node_counts[kind == SHAPE_SURFACE] = [len(surface.nodes) for surface in surfaces]
    depth = np.array([len(chain) for chain in chains], dtype=np.int64)[link]
    kinds = np.stack(
        [
            kind,
            np.cumsum(corner_columns) - corner_columns,
            corner_count,
            link,
            np.cumsum(depth) - depth,
            depth,
            np.cumsum(node_counts) - node_counts,
        ],
        axis=1,
    ).astype(np.int64)
    hulls = [body.core.corners for body, n in zip(rows.solids, corner_columns.tolist(), strict=True) if n]
    corners = np.concatenate([np.zeros((4, 0)), *hulls], axis=1)
    bodies = RefereeStruct(
        "RefereeBodies",
        bodies=kinds,
        sizes=rows.sizes,
        corners=corners,
        boxes=np.concatenate([np.zeros((0, 6)), *(surface.boxes for surface in surfaces)]),
        nodes=np.concatenate([np.zeros((0, 3), np.int64), *(surface.nodes for surface in surfaces)]),
        body_count=len(kinds),
        corner_count=corners.shape[1],
    )
    struct = RefereeStruct(
        "RefereeModel",
        joints=np.array(joints, dtype=np.int64).reshape(-1, 3),
        frames=np.array(frames, dtype=np.float64).reshape(-1, 17),
        joint_count=len(joints),
        bodies=bodies,
        chains=np.array([joint for i in link.tolist() for joint in chains[i]], dtype=np.int64),
        element_bodies=first,
        element_count=len(counts),
        base_element=base,
        own_checked=own_checked,
    )
    of_element = np.repeat(np.arange(len(counts)), counts)
    shapes = kinds[:, SHAPE]
    has_plane, has_concave, carried = (
        np.bincount(of_element[mask], minlength=len(counts)) > 0
        for mask in (shapes == PLANE, shapes == SHAPE_CONCAVE, depth > 0)
    )
    return ArmTables(
        links,
        rows,
        bodies,
        struct,
        np.array([columns, len(chains), len(joints), len(kinds), len(counts)], dtype=np.int64),
        int(depth.max(initial=0)),
        first,
        has_plane,
        carried,
        has_concave,
        own_checked,
    )
