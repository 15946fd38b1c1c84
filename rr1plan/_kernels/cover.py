"""What the kernel of certified edges knows of a scene, and the memory it writes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import types

from rr1plan._kernels.jit import F64, INT1, INT2, OUT2
from rr1plan._kernels.lanes import WIDTH
from rr1plan._kernels.record import reader
from rr1plan._kernels.tables import floats, small, whole
from rr1plan.places import place

# What obstacles are to the kernel.
ROUNDED_BOX, CYLINDER, HALF_SPACE = range(3)
# Stands for the core of an obstacle that has a closed form, and of one that is left to the exact kernel.
CLOSED_FORM, LEFT_OUT = -1, -2
# What the cores of bodies are to it: the hull of points, or a cylinder.
POINTS, ROUND = range(2)

# Factor for what is added up in floating point.
SLACK = 1.0 + 1e-9
# Numbers kept of each frame (rotation row by row, origin, angular and linear velocity) and of each sphere (centre and
# travel).
FRAME = 18 * WIDTH
SPHERE = 4 * WIDTH
# Bits of all lanes.
ALL = (1 << WIDTH) - 1
# Corners of a core come in blocks of so many neighbours.
BLOCK = 8
# Directions are told apart by so many cells along each side of two squares; corners that can be the lowest along those
# of a cell are bits of a word, of which so many are used.
DIRECTION_CELLS = 16
WORD = 63
# Cells of a map along each of its sides.
CELLS = 128


class Cover(NamedTuple):
    """What the kernel knows of a scene; made by `rr1plan.collision.sphere_tables`.

    Args:
        joints: Parent (0: the world), 1 for prismatic, column; row 0 is the world, shape (j, 3).
        joint_values: T_parent_joint with z along the axis (12) and gain, shape (j, 13).
        bodies: Joint, first and last sphere (the first is the ball around all), group; shape (b, 4).
        groups: Of bodies that one joint carries: joint, ball around all (of one, its own), first and last body, first
            and last entry of the chain; shape (g, 6).
        spheres: Centre in the joint's frame, radius, radius of the ball inside, distance of the centre from that of
            the body's ball [m]; those of bodies, then the balls around groups; shape (s, 6).
        chain: Joints above each group, root first.
        chain_reach: For each, how far any of its points can be from the joint's axis, prismatic joints at zero [m].
        obstacles: Kind, and 1 if its gap is exact, not only a bound from below; shape (o, 2).
        obstacle_values: Rotation row by row, centre, half sizes (of a cylinder its radius twice and half its
            length), radius around it, low end along the third axis; shape (o, 17). A half-space is all below its
            centre along its third axis; there are no others.
        boxes: Box around each obstacle, low and high, shape (6, o), o a multiple of `WIDTH`.
        pair_of: Index of the pair of a body and an obstacle, -1 for none, shape (b, o).
        meetings: Body, body, joints that move both, index of the pair, and if it has a map where that begins in
            `maps` (else -1), the number of its columns of cells, and its two columns of q; shape (m, 8).
        families: Groups of which bodies meet: group, group, joints that move both, first and last of `meetings`, and
            where a map of all of them together begins in `maps` (-1: none), like that of the first in all else;
            shape (f, 6).
        maps: For each map how many cells before a corner are not free; see `neighbours.py`.
        map_ranges: Low end and cells per rad or m, of both columns of q; shape (m, 4).
        padding: Distance to keep of each pair [m].
        cores: Frame, first and last row of `points`, POINTS or ROUND, first row of `blocks`, first of `lowest` and how
            many corners share a bit there (0: none is told); of each body, then of each obstacle without a closed
            form; shape (c, 7).
        core_values: A point in the core, the radius around the core, how far the core reaches from the point [m], and
            the rotation, row by row, from the axes of `lowest`; shape (c, 14).
        points: Corners of a core in its frame; of one that is ROUND centre, axis, half length and radius;
            shape (p, 3).
        blocks: Ball around each `BLOCK` corners of a core: centre and radius; shape (n, 4).
        lowest: Which corners can be the lowest along the directions of each cell, DIRECTION_CELLS**2 for those with a
            third number that is not below zero, then for the others; see `rr1plan.collision.lowest_corners`.
        core_of: Row of `cores` of each obstacle, CLOSED_FORM or LEFT_OUT, shape (o,).
        margins: What must be left of a gap beyond everything else, and the greatest padding [m], shape (2,).
    """

    joints: np.ndarray
    joint_values: np.ndarray
    bodies: np.ndarray
    groups: np.ndarray
    spheres: np.ndarray
    chain: np.ndarray
    chain_reach: np.ndarray
    obstacles: np.ndarray
    obstacle_values: np.ndarray
    boxes: np.ndarray
    pair_of: np.ndarray
    meetings: np.ndarray
    families: np.ndarray
    maps: np.ndarray
    map_ranges: np.ndarray
    padding: np.ndarray
    cores: np.ndarray
    core_values: np.ndarray
    points: np.ndarray
    blocks: np.ndarray
    lowest: np.ndarray
    core_of: np.ndarray
    margins: np.ndarray


class Work(NamedTuple):
    """Memory the kernel writes.

    Args:
        frames: Of every joint, `WIDTH` configurations side by side.
        centres: Of every sphere: place, travel.
        placed: The batch each body was placed for last, less than zero if only the ball around it was.
        listed: Obstacles that are near a group, and in which lanes; shape (o, 2).
        beside: In which lanes each body may be near the group it is asked about; shape (b,).
        speeds: Greatest speed of a group's points, by the joints that count; shape (g, longest chain + 1).
        pushes: Greatest acceleration, the same.
        near: Spheres of a body that are near another's ball, and in which lanes; shape (n, 2).
        turns: Of each joint: value and rate at the begin, half the second derivative, greatest rate and greatest
            value, shape (j, 5).
        items: Body, obstacle or other body, row of `meetings` (-1: an obstacle), pair, bits of the lanes in which
            it is open, a sphere of either that is too near; shape (k, 7).
        spans: Middle and half width of each interval, shape (n, 2).
        span_items: Bits of the items it is open for.
        lanes: `WIDTH` middles, then as many half widths.
        open_spans: Middle and half width of what is left to the exact kernel, shape (n, 2).
        open_pairs: The pair of each.
        starts: The direction of each pair where the search of one ended last, shape (p, 3).
        begun: The edge of which that is told, shape (p,).
        walk: `WIDTH` directions.
        counts: How many of those there are, batches looked at, the pair of a contact, edges so far; from 8 on
            the bits of the items that each lane is open for.
        curve: Coefficients of the edge q(t) = sum_k curve[k] t^k, 0 <= t <= 1, shape (3, nq).
    """

    frames: np.ndarray
    centres: np.ndarray
    placed: np.ndarray
    listed: np.ndarray
    beside: np.ndarray
    speeds: np.ndarray
    pushes: np.ndarray
    near: np.ndarray
    turns: np.ndarray
    items: np.ndarray
    spans: np.ndarray
    span_items: np.ndarray
    lanes: np.ndarray
    open_spans: np.ndarray
    open_pairs: np.ndarray
    starts: np.ndarray
    begun: np.ndarray
    walk: np.ndarray
    counts: np.ndarray
    curve: np.ndarray


COVER = place(
    [
        *(whole(3), floats(13), whole(4), whole(6), floats(6), whole(), floats()),
        *(whole(2), floats(17), OUT2, INT2),
        *(whole(8), whole(6), small(), floats(4), floats()),
        *(whole(7), floats(14), floats(3), floats(4), whole(), whole(), floats()),
    ],
    Cover,
)
WORK = place(
    [
        *(floats(), floats(), whole(), whole(2), whole(), OUT2, OUT2, whole(2), floats(5)),
        *(whole(7), floats(2), whole(), floats(), floats(2), whole()),
        *(floats(3), whole(), floats(), whole(), OUT2),
    ],
    Work,
)
RECORD = INT1
# All of it, with tolerance [m] and record of the exact kernel, and counters of what has been done; kernels hand on a
# record of it.
TABLES = types.Tuple((COVER, WORK, types.Tuple((F64, RECORD)), INT1))
tables_of = reader(TABLES)
