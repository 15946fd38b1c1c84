"""The plain arrays that the sphere kernel reads: what moves, from `carried_cover`, and what it may meet in a scene."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rr1plan._kernels.cover import CLOSED_FORM, CYLINDER, HALF_SPACE, LEFT_OUT, ROUNDED_BOX, Cover, Work
from rr1plan._kernels.lanes import WIDTH
from rr1plan.checks import Array
from rr1plan.collision.carried_cover import CarriedCover, carried_cover, matrix
from rr1plan.collision.cores import Cores
from rr1plan.collision.exact import CollisionChecker
from rr1plan.collision.neighbour_maps import neighbour_maps
from rr1plan.collision.tables import Tables
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, PointCloud, Shape, Sphere

_INTS = NDArray[np.int64]
# Intervals of one edge, and what is left of them, that are kept before the whole edge goes to the exact kernel.
_SPANS = 512
# Meshes of more corners are left to the exact kernel, which walks along edges instead of looking at all.
_MOST_POINTS = 2000


def build_cover(checker: CollisionChecker, tables: Tables, tolerance: float) -> tuple[Cover, Work]:
    """What the sphere kernel reads and writes, for the pairs of a checker and its motion tables.

    Args:
        checker: The checker.
        tables: Its tables for the exact kernel.
        tolerance: Gaps beyond the padding smaller than this are no proof [m].
    """
    carried = carried_cover(checker.layout.carried)
    meetings, pair_of, resting = _pair_tables(checker, carried)
    shapes = [checker.solids[b].shape for b in resting]
    kinds, values, boxes = _obstacle_tables(shapes, tables.poses[resting], tables.body_values[resting])
    core_of, cores, core_values, points, blocks = _core_tables(carried, shapes, tables.poses[resting], len(kinds))
    scale = float(np.abs(values).max(initial=0.0)) + float(np.abs(carried.joint_values[:, 9:12]).sum())
    margins = np.array([2.0 * tolerance + 1e-9 + 1e-12 * scale, float(np.max(tables.padding, initial=0.0))])
    # Rounded up, so that maps serve scenes of other sizes too.
    margin = max(10.0 * tolerance, float(margins[0]))
    met = meetings[:, 3]
    maps = neighbour_maps(checker.layout.carried, checker.solid_pairs[met], tables.padding[met] + margin)
    made = Cover(
        carried.joints, carried.joint_values, carried.bodies, carried.spheres, carried.chain, carried.chain_reach,
        kinds, values, boxes, pair_of, np.column_stack([meetings, maps.places]), maps.counts, maps.ranges,
        np.array(tables.padding), cores, core_values, points, blocks, core_of, margins,
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


# ---- pairs -----------------------------------------------------------------------------------------


def _pair_tables(checker: CollisionChecker, carried: CarriedCover) -> tuple[_INTS, _INTS, list[int]]:
    """First columns of the kernel's `meetings`, its `pair_of`, and which solids the obstacles of that are."""
    standing = np.full(len(checker.solids) - len(carried.body), -1, np.int64)
    body = np.concatenate([carried.body, standing])
    one, two = checker.solid_pairs.T
    number = np.arange(len(one))
    meets = (body[one] >= 0) & (body[two] >= 0)
    rows = (body[one], body[two], checker.layout.moving_shared, number)
    meetings = np.column_stack([row[meets] for row in rows])
    one, two, number = one[~meets], two[~meets], number[~meets]
    moving, still = np.where(body[one] >= 0, one, two), np.where(body[one] >= 0, two, one)
    resting, place = np.unique(still, return_inverse=True)
    pair_of = np.full((len(carried.bodies), _padded(len(resting))), -1, np.int64)
    pair_of[body[moving], place] = number
    return meetings, pair_of, resting.tolist()


def _padded(count: int) -> int:
    return -(-count // WIDTH) * WIDTH


# ---- obstacles -------------------------------------------------------------------------------------


def _obstacle_tables(shapes: list[Shape], poses: Array, bodies: Array) -> tuple[_INTS, Array, Array]:
    """Kinds, values and boxes of what does not move; see the kernel's `Cover`."""
    many, count = len(shapes), _padded(len(shapes))
    kinds, values = np.zeros((count, 2), np.int64), np.zeros((count, 16))
    # What is not there is nowhere near.
    boxes = np.concatenate([np.full((3, count), np.inf), np.full((3, count), -np.inf)])
    measures = np.array([_measures(shape) for shape in shapes]).reshape(-1, 6)
    R, half = poses[:, :9].reshape(-1, 3, 3), bodies[:, 20:23]
    centres = np.einsum("nij,nj->ni", R, bodies[:, 17:20]) + poses[:, 9:]
    extents = np.einsum("nij,nj->ni", np.abs(R), half)
    kinds[:many] = measures[:, :2]
    values[:many, :9], values[:many, 9:12], values[:many, 12:] = poses[:, :9], centres, measures[:, 2:]
    around = measures[:, 1] == 0
    values[:many][around, 12:15] = half[around]
    boxes[:3, :many], boxes[3:, :many] = (centres - extents).T, (centres + extents).T
    for i, shape in enumerate(shapes):
        if isinstance(shape, HalfSpace):
            normal = R[i] @ np.array(shape.normal)
            values[i, 9:12] = 0.0
            values[i, 12:] = *normal, shape.offset + float(normal @ poses[i, 9:])
            boxes[:3, i], boxes[3:, i] = -np.inf, np.inf
    return kinds, values, boxes


@lru_cache(maxsize=512)
def _measures(shape: Shape) -> tuple[float, ...]:
    """Kind, whether that is the shape itself or a box around it, half sizes (of a shape itself) and radius."""
    match shape:
        case Sphere(radius):
            return ROUNDED_BOX, 1, 0.0, 0.0, 0.0, radius
        case Capsule(radius, length):
            return ROUNDED_BOX, 1, 0.0, 0.0, 0.5 * length, radius
        case Cylinder(radius, length):
            return CYLINDER, 1, radius, radius, 0.5 * length, 0.0
        case Box((x, y, z)):
            return ROUNDED_BOX, 1, 0.5 * x, 0.5 * y, 0.5 * z, 0.0
        case HalfSpace():
            return HALF_SPACE, 1, 0.0, 0.0, 0.0, 0.0
        case _:
            return ROUNDED_BOX, 0, 0.0, 0.0, 0.0, 0.0


def _core_tables(
    carried: CarriedCover, shapes: list[Shape], poses: Array, count: int
) -> tuple[_INTS, _INTS, Array, Array, Array]:
    """The kernel's `core_of`, and its `cores` to `blocks`, those of obstacles after those that move."""
    core_of, added = np.full(count, CLOSED_FORM, np.int64), Cores()
    for i, shape in enumerate(shapes):
        if isinstance(shape, Mesh) and len(shape.vertices) <= _MOST_POINTS:
            core_of[i] = len(carried.cores) + added.add(0, shape, matrix(poses[i]))
        elif isinstance(shape, Mesh | PointCloud):
            core_of[i] = LEFT_OUT
    rows, *others = added.arrays()
    before = len(carried.points)
    rows = rows + np.array([0, before, before, 0, len(carried.blocks)])
    own = (carried.cores, carried.core_values, carried.points, carried.blocks)
    cores, values, points, blocks = (np.concatenate(both) for both in zip(own, (rows, *others), strict=True))
    return core_of, cores, values, points, blocks
