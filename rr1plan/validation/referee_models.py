"""Models of robots and obstacles for the compiled search, each made once and shared by all equal arms.

A model holds joints, bodies and the pairs of its elements that must not touch. The scene adds poses of bases, columns
and names.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import accumulate
from struct import Struct
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.robot import Geometry, Joint, Robot
from rr1plan.scene import Attachment, Obstacle
from rr1plan.shapes import HalfSpace, Mesh, PointCloud, Shape
from rr1plan.validation.link_motion import Drive, drives
from rr1plan.validation.referee_kernels import (
    AXIS,
    DEPTH,
    FIRST_JOINT,
    FIRST_NODE,
    GAIN,
    LINK,
    OFFSET,
    SHAPE,
    SHIFT,
    SLIDES,
    SURFACE,
    TURNS,
    RefereeStruct,
    load_library,
)
from rr1plan.validation.referee_shapes import core_row, point_body

Table = NDArray[np.int64]
_ROW = Struct("14d")  # a `ShapeRow`


class HeldThing(NamedTuple):
    """An attached object, as far as the model of its arm depends on it.

    Args:
        geometries: Its shapes.
        link: The link it is fixed to.
        pose: T_link_object as bytes, shape (4, 4).
        touch: Further links of the arm that it may touch.
    """

    geometries: tuple[Geometry, ...]
    link: str
    pose: bytes
    touch: frozenset[str]

    @staticmethod
    def of(thing: Attachment) -> HeldThing:
        """The part of an attachment that models depend on."""
        return HeldThing(thing.geometries, thing.link, thing.pose.tobytes(), thing.touch)


@dataclass(frozen=True, eq=False)
class RefereeModel:
    """A model as the kernels read it.

    Args:
        links: Names of the links with shapes, which are the first elements; attached objects come after them.
        shapes: Shapes of its bodies.
        bodies: The bodies as the kernels read them.
        struct: The model.
        element_count: Number of its elements.
        depth: Joints of its longest chain.
        planes: Elements that have a half-space as a shape.
        moving_planes: Those of `planes` that a joint carries.
        own_checked: Pairs of its elements that must not touch, shape (elements, elements) of 0 and 1, symmetric; None
            if no pair is checked.
        placement: Arguments of `rr1_fill_bodies`: shapes of the bodies, shape (n, 14), their poses in their elements
            and the poses of the elements, shapes (16 n,).
    """

    links: tuple[str, ...]
    shapes: tuple[Shape, ...]
    bodies: RefereeStruct
    struct: RefereeStruct
    element_count: int
    depth: int
    planes: tuple[int, ...]
    moving_planes: tuple[int, ...]
    own_checked: NDArray[np.uint8] | None
    placement: tuple[Array, Array, Array]


def robot_model(robot: Robot, held: tuple[HeldThing, ...]) -> RefereeModel:
    """The model of a robot with attached objects, made once for equal content.

    Raises:
        InputError: a joint that follows no joint with a value.
    """
    return _build(_Content(robot.content_hash, held, robot))


@dataclass(frozen=True)
class _Content:
    """A robot and its attached objects, compared by content."""

    key: str
    held: tuple[HeldThing, ...]
    robot: Robot = field(compare=False)


@lru_cache(maxsize=64)
def _build(content: _Content) -> RefereeModel:
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
    links = robot.solid_links
    elements = [(link.name, link.collisions, np.eye(4)) for link in robot.links if link.collisions]
    elements += [(held.link, held.geometries, np.frombuffer(held.pose).reshape(4, 4)) for held in content.held]
    poses = [carriers[link][1] @ T for link, _, T in elements]
    geometries = [geometry for _, some, _ in elements for geometry in some]
    counts = [len(some) for _, some, _ in elements]
    first = _starts(counts)
    on = np.repeat(np.array([carriers[link][0] for link, _, _ in elements], dtype=np.int64), counts)
    depth = np.array([len(chain) for chain in chains], dtype=np.int64)[on]
    own_checked = _own_checked(links, content)
    shapes, bodies, placement = _bodies(geometries, poses, first)
    table = bodies.part("bodies")
    table[:, LINK], table[:, DEPTH], table[:, FIRST_JOINT] = on, depth, np.cumsum(depth) - depth
    model = RefereeStruct(
        "RefereeModel",
        joints=np.array(joints, dtype=np.int64).reshape(-1, 3),
        frames=np.array(frames, dtype=np.float64).reshape(-1, 17),
        joint_count=len(joints),
        column_count=len(columns),
        bodies=bodies,
        chains=np.array([joint for i in on.tolist() for joint in chains[i]], dtype=np.int64),
        element_bodies=first,
        element_count=len(counts),
        base_element=links.index(robot.base) if robot.base in links else -1,
        own_checked=own_checked,
    )
    planes = _half_spaces(shapes, first)
    moving = tuple(i for i in planes if depth[first[i]] > 0)
    return RefereeModel(
        links, shapes, bodies, model, len(counts), int(depth.max(initial=0)), planes, moving, own_checked, placement
    )


def _joined(poses: Iterable[Array]) -> Array:
    """Poses in one array, shape (16 n,)."""
    return np.frombuffer(bytearray().join([pose.tobytes() for pose in poses]))


def _starts(counts: list[int]) -> Table:
    """Offsets at which consecutive runs begin and the last one ends, shape (n + 1,)."""
    return np.array([0, *accumulate(counts)], dtype=np.int64)


def _half_spaces(shapes: tuple[Shape, ...], first: Table) -> tuple[int, ...]:
    """The elements that have a half-space as a shape; `first` is the first body of each element."""
    bodies = [i for i, shape in enumerate(shapes) if isinstance(shape, HalfSpace)]
    if not bodies:
        return ()
    return tuple(np.unique(np.searchsorted(first, bodies, side="right") - 1).tolist())


def _origin_at(joint: Joint, value: float) -> Array:
    """T_parent_child of a joint with a fixed value."""
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
    """Pairs of an arm's links and attached objects that must not touch."""
    index, count = {name: i for i, name in enumerate(links)}, len(links) + len(content.held)
    checked = np.ones((count, count), dtype=np.uint8)
    np.fill_diagonal(checked, 0)
    for both in content.robot.disabled_collisions:
        # Links without a shape are not elements.
        pair = [index[name] for name in both if name in index]
        if len(pair) == 2:
            checked[pair, pair[::-1]] = 0
    for i, thing in enumerate(content.held, start=len(links)):
        near = [index[name] for name in thing.touch | {thing.link} if name in index]
        near += [j for j, other in enumerate(content.held, start=len(links)) if other.link == thing.link]
        checked[i, near] = checked[near, i] = 0
    return checked


def obstacle_model(obstacles: Iterable[Obstacle]) -> RefereeModel:
    """The model of all obstacles of a scene: elements on a single link at the world's origin."""
    parts = [(obstacle.geometries, obstacle.pose) for obstacle in obstacles]
    first = _starts([len(geometries) for geometries, _ in parts])
    shapes, bodies, placement = _bodies(
        [geometry for some, _ in parts for geometry in some], [pose for _, pose in parts], first
    )
    model = RefereeStruct(
        "RefereeModel", bodies=bodies, element_bodies=first, element_count=len(parts), base_element=-1
    )
    return RefereeModel((), shapes, bodies, model, len(parts), 0, _half_spaces(shapes, first), (), None, placement)


def _bodies(
    geometries: Sequence[Geometry], poses: Iterable[Array], first: Table
) -> tuple[tuple[Shape, ...], RefereeStruct, tuple[Array, Array, Array]]:
    """Shapes, bodies on link 0 for the kernels with corners and trees, and their `placement`.

    Args:
        geometries: The shapes of all elements, in their frames.
        poses: T_link_element of each element, shape (4, 4).
        first: The first body of each element, and one past the last.
    """
    shapes = tuple([geometry.shape for geometry in geometries])
    rows = np.frombuffer(bytearray().join([_ROW.pack(*core_row(shape)) for shape in shapes])).reshape(
        -1, _ROW.size // 8
    )
    table, sizes = np.empty((len(shapes), 7), dtype=np.int64), np.empty((len(shapes), 23))
    frames, elements = _joined([geometry.pose for geometry in geometries]), _joined(poses)
    columns = load_library().rr1_fill_bodies(rows, frames, elements, first, len(first) - 1, table, sizes)
    arrays = {"bodies": table, "sizes": sizes}
    if columns:
        made = [point_body(shape) for shape in shapes if isinstance(shape, (Mesh, PointCloud))]
        arrays["corners"] = np.concatenate([body.core.corners for body in made], axis=1)
        trees = [body.tree for body in made if body.tree is not None]
        if trees:
            table[table[:, SHAPE] >= SURFACE, FIRST_NODE] = _starts([len(tree.nodes) for tree in trees])[:-1]
            arrays["boxes"] = np.concatenate([tree.boxes for tree in trees])
            arrays["nodes"] = np.concatenate([tree.nodes for tree in trees])
    bodies = RefereeStruct("RefereeBodies", body_count=len(shapes), corner_count=columns, **arrays)
    return shapes, bodies, (rows, frames, elements)
