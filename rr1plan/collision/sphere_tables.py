"""The plain arrays that the sphere kernel reads, made from a collision checker and its motion tables."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rr1plan._kernels.cover import (
    CELLS,
    CLOSED_FORM,
    CYLINDER,
    HALF_SPACE,
    LEFT_OUT,
    POINTS,
    ROUND,
    ROUNDED_BOX,
    Cover,
    Work,
)
from rr1plan._kernels.lanes import WIDTH
from rr1plan._kernels.neighbours import map_pair as _map_pair_untyped
from rr1plan.checks import Array
from rr1plan.collision.exact import CollisionChecker
from rr1plan.collision.spheres import SphereCover, cover
from rr1plan.collision.tables import Tables
from rr1plan.formats.cache import cache_key
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, PointCloud, Shape, Sphere
from rr1plan.transforms import rotation_about

_INTS = NDArray[np.int64]
# No ball inside: a ball around the whole body is no part of it.
_NOTHING = -1e12
# Intervals of one edge, and what is left of them, that are kept before the whole edge goes to the exact kernel.
_SPANS = 512
# Joints that turn without end have a map of a turn to both sides; one that slides, of as many metres.
_TURN = 2.0 * np.pi
_MOST_MAPS = 256
# Meshes of more corners are left to the exact kernel, which walks along edges instead of looking at all.
_MOST_POINTS = 2000
_map_pair: Callable[..., None] = _map_pair_untyped
_MAPS: dict[tuple[str, Shape, Shape], _INTS] = {}


@dataclass(frozen=True, eq=False)
class _Joints:
    """The driven joints alone, each turning about or sliding along its z axis.

    `carrier[j]` is the driven joint that carries joint j of the model (0: the world), and `offset[j]` the pose
    of joint j in its frame.
    """

    rows: _INTS
    values: Array
    carrier: list[int]
    offset: list[Array]


def build_cover(checker: CollisionChecker, tables: Tables, tolerance: float) -> tuple[Cover, Work]:
    """What the sphere kernel reads and writes, for the pairs of a checker and its motion tables.

    Args:
        checker: The checker.
        tables: Its tables for the exact kernel.
        tolerance: Gaps beyond the padding smaller than this are no proof [m].
    """
    joints = _driven_joints(tables)
    moving = [b for b in range(len(checker.solids)) if tables.bodies[b, 5] > tables.bodies[b, 4]]
    index = {b: i for i, b in enumerate(moving)}
    pairs = checker.solid_pairs.tolist()
    resting = sorted({b for pair in pairs for b in pair if b not in index})
    cores = _Cores()
    bodies, spheres, chain, reach = _body_tables(checker, joints, moving, cores)
    kinds, values, boxes = _obstacle_tables(checker, tables, resting)
    core_of = _obstacle_cores(checker, tables, resting, len(kinds), cores)
    pair_of = np.full((len(moving), len(kinds)), -1, np.int64)
    meetings = []
    for k, (a, b) in enumerate(pairs):
        if a in index and b in index:
            meetings.append((index[a], index[b], int(tables.pairs[k, 2]), k))
        else:
            body, obstacle = (a, b) if a in index else (b, a)
            pair_of[index[body], resting.index(obstacle)] = k
    scale = float(np.abs(values).max(initial=0.0)) + float(np.abs(joints.values[:, 9:12]).sum())
    margins = np.array([2.0 * tolerance + 1e-9 + 1e-12 * scale, float(np.max(tables.padding, initial=0.0))])
    # Rounded up, so that maps serve scenes of other sizes too.
    margin = max(10.0 * tolerance, float(margins[0]))
    table, maps, ranges = _map_tables(checker, tables, np.array(meetings, np.int64).reshape(-1, 4), margin)
    made = Cover(
        joints.rows, joints.values, bodies, spheres, chain, reach, kinds, values, boxes, pair_of,
        table, maps, ranges, np.array(tables.padding), *cores.arrays(), core_of, margins,
    )  # fmt: skip
    return made, _work(made, checker.nq)


def _work(made: Cover, columns: int) -> Work:
    longest = int((made.bodies[:, 4] - made.bodies[:, 3]).max(initial=0))
    items = len(made.padding)
    frames = np.zeros((len(made.joints), 18, WIDTH))
    frames[0, [0, 4, 8]] = 1.0
    return Work(
        frames.ravel(),
        np.zeros(len(made.spheres) * 7 * WIDTH),
        np.zeros(len(made.bodies), np.int64),
        np.zeros((len(made.bodies), longest + 1)),
        np.zeros((len(made.bodies), longest + 1)),
        np.zeros((len(made.spheres), 2), np.int64),
        np.zeros((len(made.joints), 2)),
        np.zeros((items + 1, 7), np.int64),
        np.zeros((_SPANS, 2)),
        np.zeros(_SPANS, np.int64),
        np.zeros(2 * WIDTH),
        np.zeros((_SPANS, 2)),
        np.zeros(_SPANS, np.int64),
        np.zeros((items, 3)),
        np.zeros(items, np.int64),
        np.zeros(3 * WIDTH),
        np.zeros(8 + WIDTH, np.int64),
        np.zeros((2, columns)),
    )


def _matrix(flat: Array) -> Array:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = flat[:9].reshape(3, 3), flat[9:12]
    return T


def _turn_from_z(axis: Array) -> Array:
    """A rotation that takes z to an axis, shape (4, 4)."""
    T = np.eye(4)
    cross = np.array([-axis[1], axis[0], 0.0])
    sine = float(np.linalg.norm(cross))
    if sine > 1e-12:
        T[:3, :3] = rotation_about(cross / sine, float(np.arctan2(sine, axis[2])))
    elif axis[2] < 0.0:
        T[:3, :3] = np.diag([1.0, -1.0, -1.0])
    return T


def _driven_joints(tables: Tables) -> _Joints:
    rows, values = [(0, 0, 0)], [np.zeros(13)]
    carrier, offset = [0], [np.eye(4)]
    for (parent, prismatic, column, _), row in zip(tables.joints[1:].tolist(), tables.joint_values[1:], strict=True):
        T = offset[parent] @ _matrix(row)
        axis, gain, rest = row[12:15], row[15], row[16]
        moved = np.eye(4)
        if prismatic:
            moved[:3, 3] = rest * axis
        else:
            moved[:3, :3] = rotation_about(axis, float(rest))
        T = T @ moved
        if column < 0:
            carrier.append(carrier[parent])
            offset.append(T)
            continue
        turn = _turn_from_z(axis)
        rows.append((carrier[parent], prismatic, column))
        T = T @ turn
        values.append(np.array([*T[:3, :3].ravel(), *T[:3, 3], gain]))
        carrier.append(len(rows) - 1)
        offset.append(turn.T)
    return _Joints(np.array(rows, np.int64), np.array(values), carrier, offset)


def _body_tables(
    checker: CollisionChecker, joints: _Joints, moving: list[int], cores: _Cores
) -> tuple[_INTS, Array, _INTS, Array]:
    """Bodies, their spheres, their chains and how far these reach; see the kernel's `Cover`."""
    bodies, spheres = np.zeros((len(moving), 5), np.int64), [np.zeros((0, 5))]
    chain: list[int] = []
    reach: list[float] = []
    first = 0
    for i, b in enumerate(moving):
        solid = checker.solids[b]
        joint = joints.carrier[solid.joint]
        made = cover(solid.shape)
        T = joints.offset[solid.joint] @ solid.placement
        rows = _sphere_rows(made, T)
        above = []
        while joint:
            above.append(joint)
            joint = int(joints.rows[joint, 0])
        bodies[i] = above[0], first, first + len(rows), len(chain), len(chain) + len(above)
        spheres.append(rows)
        chain += above[::-1]
        cores.add(above[0], solid.shape, T)
        reach += _reaches(joints, above, np.concatenate([rows[:, :3], _extremes(solid.shape) @ T[:3, :3].T + T[:3, 3]]))
        first += len(rows)
    return bodies, np.concatenate(spheres), np.array(chain, np.int64), np.array(reach)


def _sphere_rows(made: SphereCover, T: Array) -> Array:
    """The ball around a solid, then its spheres, in the frame of the joint that carries it."""
    centres = np.concatenate([made.ball[None, :3], made.centres])
    radii = np.array([made.ball[3], *made.radii])
    inner = np.array([_NOTHING, *np.maximum(made.inner, _NOTHING)])
    return np.column_stack([centres @ T[:3, :3].T + T[:3, 3], radii, inner])


def _reaches(joints: _Joints, above: list[int], points: Array) -> list[float]:
    """How far points of a body can be from the axis of each joint of its chain [m], root first."""
    reach = [float(np.hypot(points[:, 0], points[:, 1]).max())]
    beyond = float(np.linalg.norm(points, axis=1).max())
    for joint in above[:-1]:
        x, y, z = joints.values[joint, 9:12]
        reach.append(float(np.hypot(x, y)) + beyond)
        beyond += float(np.linalg.norm([x, y, z]))
    return [r * (1.0 + 1e-9) + 1e-9 for r in reach[::-1]]


def _obstacle_tables(checker: CollisionChecker, tables: Tables, resting: list[int]) -> tuple[_INTS, Array, Array]:
    """Kinds, values and boxes of what does not move; see the kernel's `Cover`."""
    count = -(-len(resting) // WIDTH) * WIDTH
    kinds, values = np.zeros((count, 2), np.int64), np.zeros((count, 16))
    # What is not there is nowhere near.
    boxes = np.concatenate([np.full((3, count), np.inf), np.full((3, count), -np.inf)])
    for i, b in enumerate(resting):
        shape = checker.solids[b].shape
        R, t = tables.poses[b, :9].reshape(3, 3), tables.poses[b, 9:]
        values[i, :9] = R.ravel()
        if isinstance(shape, HalfSpace):
            normal = R @ np.array(shape.normal)
            kinds[i] = HALF_SPACE, 1
            values[i, 12:16] = *normal, shape.offset + float(normal @ t)
            boxes[:, i] = [-np.inf] * 3 + [np.inf] * 3
            continue
        centre, half = tables.body_values[b, 17:20], tables.body_values[b, 20:23]
        values[i, 9:12] = R @ centre + t
        kinds[i], values[i, 12:16] = _measures(shape, half)
        extent = np.abs(R) @ half
        boxes[:3, i], boxes[3:, i] = values[i, 9:12] - extent, values[i, 9:12] + extent
    return kinds, values, boxes


def _measures(shape: object, half: Array) -> tuple[tuple[int, int], Array]:
    """Kind, whether that is the shape itself or a box around it, half sizes and radius."""
    match shape:
        case Sphere(radius):
            return (ROUNDED_BOX, 1), np.array([0.0, 0.0, 0.0, radius])
        case Capsule(radius, length):
            return (ROUNDED_BOX, 1), np.array([0.0, 0.0, 0.5 * length, radius])
        case Cylinder(radius, length):
            return (CYLINDER, 1), np.array([radius, radius, 0.5 * length, 0.0])
        case Box():
            return (ROUNDED_BOX, 1), np.array([*half, 0.0])
        case _:
            assert isinstance(shape, Mesh | PointCloud)
            return (ROUNDED_BOX, 0), np.array([*half, 0.0])


# ---- cores ---------------------------------------------------------------------------------------------


class _Cores:
    """Rows of the kernel's `cores`, `core_values` and `points`, as they are added."""

    def __init__(self) -> None:
        self._rows: list[tuple[int, int, int, int]] = []
        self._values: list[Array] = []
        self._points: list[Array] = [np.zeros((0, 3))]
        self._count = 0

    def add(self, frame: int, shape: Shape, T: Array) -> int:
        """The row of a shape placed in a frame."""
        rotate, shift = T[:3, :3], T[:3, 3]
        if isinstance(shape, Cylinder):
            middle, radius, kind = shift, 0.0, ROUND
            points = np.array([shift, rotate[:, 2], [0.5 * shape.length, shape.radius, 0.0]])
            reach = float(np.hypot(0.5 * shape.length, shape.radius)) * (1.0 + 1e-9)
        else:
            points, radius, kind = _extremes(shape) @ rotate.T + shift, _radius(shape), POINTS
            middle = points.mean(axis=0)
            reach = float(np.linalg.norm(points - middle, axis=1).max()) * (1.0 + 1e-9)
        self._rows.append((frame, self._count, self._count + len(points), kind))
        self._values.append(np.array([*middle, radius, reach]))
        self._points.append(points)
        self._count += len(points)
        return len(self._rows) - 1

    def arrays(self) -> tuple[_INTS, Array, Array]:
        """The three tables."""
        rows = np.array(self._rows, np.int64).reshape(-1, 4)
        return rows, np.array(self._values).reshape(-1, 5), np.ascontiguousarray(np.concatenate(self._points))


def _extremes(shape: Shape) -> Array:
    """Points of a shape's core that no other point of it is farther out than, in its frame, shape (n, 3)."""
    match shape:
        case Sphere():
            return np.zeros((1, 3))
        case Capsule(_, length):
            return np.array([[0.0, 0.0, -0.5 * length], [0.0, 0.0, 0.5 * length]])
        case Box(size):
            return _around(0.5 * np.array(size))
        case Cylinder(radius, length):
            # Corners of the box around it are farther out than any of its own.
            return _around(np.array([radius, radius, 0.5 * length]))
        case _:
            assert isinstance(shape, Mesh)
            return np.array(shape.vertices)


def _around(half: Array) -> Array:
    """Corners of a box of so much to both sides, shape (8, 3)."""
    return np.array(list(itertools.product((-1.0, 1.0), repeat=3))) * half


def _radius(shape: Shape) -> float:
    return shape.radius if isinstance(shape, Sphere | Capsule) else 0.0


def _obstacle_cores(checker: CollisionChecker, tables: Tables, resting: list[int], count: int, cores: _Cores) -> _INTS:
    """What the kernel's `core_of` says of each obstacle."""
    core_of = np.full(count, CLOSED_FORM, np.int64)
    for i, b in enumerate(resting):
        shape = checker.solids[b].shape
        if isinstance(shape, Mesh):
            small = len(shape.vertices) <= _MOST_POINTS
            core_of[i] = cores.add(0, shape, _matrix(tables.poses[b])) if small else LEFT_OUT
        elif isinstance(shape, PointCloud):
            core_of[i] = LEFT_OUT
    return core_of


# ---- maps of neighbours ------------------------------------------------------------------------------


def _map_tables(
    checker: CollisionChecker, tables: Tables, meetings: _INTS, margin: float
) -> tuple[_INTS, _INTS, Array]:
    """The meetings with their maps, for those of which one or two columns of q decide; see the kernel's `Cover`."""
    rows, maps = [], [np.zeros(0, np.int64)]
    ranges, begin = np.zeros((len(meetings), 4)), 0
    for i, (a, b, shared, pair) in enumerate(meetings.tolist()):
        columns = _columns(tables, pair, shared)
        if len(columns) > 2:
            rows.append((a, b, shared, pair, -1, 0, 0, 0))
            continue
        both = [columns[0], columns[-1]]
        ends = np.array([_range(checker, c) for c in both])
        sums = _map_sums(checker, tables, pair, both, ends, margin)
        rows.append((a, b, shared, pair, begin, sums.shape[1] - 1, *both))
        ranges[i, ::2], ranges[i, 1::2] = ends[:, 0], CELLS / (ends[:, 1] - ends[:, 0])
        maps.append(sums.ravel())
        begin += sums.size
    return np.array(rows, np.int64).reshape(-1, 8), np.concatenate(maps), ranges


def _columns(tables: Tables, pair: int, shared: int) -> list[int]:
    """The columns of q that move one body of a pair against the other."""
    chains = [tables.chain[tables.bodies[b, 4] + shared : tables.bodies[b, 5]] for b in tables.pairs[pair, :2]]
    return sorted({int(tables.joints[j, 2]) for chain in chains for j in chain})


def _range(checker: CollisionChecker, column: int) -> tuple[float, float]:
    """Where a map is made: within the limits, or a turn to both sides."""
    low, high = float(checker.limits.lower[column]), float(checker.limits.upper[column])
    low, high = (low if low > -_TURN else -_TURN), (high if high < _TURN else _TURN)
    # A joint at its limit is in the map, whatever the rounding.
    return low - 1e-6, max(high, low) + 1e-6


def _map_sums(
    checker: CollisionChecker, tables: Tables, pair: int, columns: list[int], ends: Array, margin: float
) -> _INTS:
    """How many cells before each corner of the map of a pair are not free, shape (n + 1, n + 1) or (n + 1, 2)."""
    a, b, _ = tables.pairs[pair].tolist()
    one, two = checker.solids[a], checker.solids[b]
    # All that a map depends on, which the rest of the scene is not.
    key = cache_key(
        f"{one.joint} {two.joint} {columns} {margin} {tables.padding[pair]}",
        *(tables.joints, tables.joint_values, one.placement, two.placement, ends),
    )
    found = _MAPS.get((key, one.shape, two.shape))
    if found is None:
        cells = np.zeros((CELLS, CELLS if columns[0] != columns[1] else 1), np.int64)
        _map_pair(pair, np.array(columns), ends, margin, cells, *tables)
        found = np.pad(cells.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
        if len(_MAPS) >= _MOST_MAPS:
            _MAPS.pop(next(iter(_MAPS)))
        _MAPS[key, one.shape, two.shape] = found
    return found
