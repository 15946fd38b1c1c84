"""The arrays that the kernels read, by name; the headers in `rr1plan/kernels` say what a row of each is."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.collision.convex.mesh_trees import MeshTree

_INTS = NDArray[np.int64]


class ExactTables(NamedTuple):
    """Bodies and pairs as the exact kernel reads them (`exact_tables.h`).

    Args:
        joints: Parent, 1 for prismatic, column (or -1), 1 if anything drives it or a joint above it; row 0 is the
            world, shape (n, 4).
        joint_values: T_parent_joint (12), axis (3), gain, offset; shape (n, 17).
        bodies: Kind, joint, first and last corner (of a mesh its number), first and last entry of its chain;
            shape (b, 6).
        body_values: T_joint_body (12), center of its ball in the joint's frame (3), radius of the ball,
            radius around the core, center (3) and half sizes (3) of its box in its own frame, size (3;
            a half-space's normal), a half-space's offset; shape (b, 27).
        corners: Corner points of all bodies of kind BODY_CORNERS, centers of the cells of BODY_CELLS, shape (c, 3).
        links: Neighbors of corner i are links[links[i] : links[i + 1]].
        chain: Driven joints above each body, root first.
        chain_reach: For each, how far the center of the body's ball can ever be from the joint's axis [m].
        pairs: Body, body (the half-space or cloud, if there is one), how many joints their chains share;
            shape (p, 3).
        padding: Distance to keep [m], shape (p,).
        joint_poses: World poses of joints at q = 0: rotation row by row, then origin; shape (n, 12).
        poses: The same of bodies, shape (b, 12).
        centers: Centers of their balls, shape (b, 3).
        meshes: Triangles of all bodies of kind BODY_MESH.
    """

    joints: _INTS
    joint_values: Array
    bodies: _INTS
    body_values: Array
    corners: Array
    links: _INTS
    chain: _INTS
    chain_reach: Array
    pairs: _INTS
    padding: Array
    joint_poses: Array
    poses: Array
    centers: Array
    meshes: MeshTree


class EdgeTables(NamedTuple):
    """Spheres, cores, obstacles and pairs as the certified edge reads them (`scene_tables.h`).

    Args:
        joints: Parent (0: the world), 1 for prismatic, column; row 0 is the world, shape (j, 3).
        joint_values: T_parent_joint with z along the axis (12) and gain, shape (j, 13).
        bodies: Joint, first and last sphere (the first is the ball around all), group; shape (b, 4).
        groups: Of bodies that one joint carries: joint, ball around all (of one, its own), first and last body, first
            and last entry of the chain; shape (g, 6).
        group_boxes: The box around each group in its joint's axes, low and high from the center of its ball [m],
            shape (g, 6).
        spheres: Center in the joint's frame, radius, radius of the ball inside, distance of the center from that of
            the body's ball [m]; those of bodies, then the balls around groups; shape (s, 6).
        chain: Joints above each group, root first.
        chain_reach: For each, how far any of its points can be from the joint's axis, prismatic joints at zero [m].
        obstacles: Kind, and 1 if its gap is exact, not only a lower bound; shape (o, 2).
        obstacle_values: Rotation row by row, center, half sizes (of a cylinder its radius twice and half its
            length), radius around it, low end along the third axis; shape (o, 17). A half-space is all below its
            center along its third axis; there are no others.
        boxes: Box around each obstacle, low and high, shape (6, o), o a multiple of the lanes.
        pair_of: Index of the pair of a body and an obstacle, -1 for none, shape (b, o).
        obstacle_blocks, first_obstacle_block: Blocks of obstacles that have pairs with some body of each group: the
            first of a block, and which of them as bits, see `pair_tables.h`; shapes (k, 3) and (g + 1,).
        group_blocks, first_group_block: The same of groups; the third column is the first of `group_pairs`.
        body_pairs: Body, body, joints that move both, index of the pair, and if it has a map where that begins in
            `maps` (else -1), the number of its columns of cells, and its two columns of q; shape (m, 8).
        group_pairs: Groups with pairs of bodies: group, group, joints that move both, first and last of `body_pairs`,
            and where a map of all of them together begins in `maps` (-1: none); shape (f, 6).
        maps: For each clearance map how many cells before a corner are not free (`clearance_map.c`).
        map_ranges: Low end and cells per rad or m, of both columns of q; shape (m, 4).
        padding: Distance to keep of each pair [m].
        cores: Frame, first and last row of `points`, kind of core, first row of `blocks`, first of `lowest` and how
            many corners share a bit there (0: no table); of each body, then of each obstacle without a closed form;
            shape (c, 7).
        core_values: A point in the core, the radius around the core, how far the core reaches from the point [m], and
            the rotation, row by row, from the axes of `lowest`; shape (c, 14).
        points: Corners of a core in its frame; of a cylinder center, axis, half length and radius; shape (p, 3).
        blocks: Ball around each block of corners of a core: center and radius; shape (n, 4).
        lowest: Support tables: which corners can be the lowest along the directions of each cell.
        core_of: Row of `cores` of each obstacle, CORE_CLOSED_FORM or CORE_LEFT_OUT, shape (o,).
        margins: Rest of a gap that a proof needs, the greatest padding, and the first with all obstacles at the origin
            [m], shape (3,).
    """

    joints: _INTS
    joint_values: Array
    bodies: _INTS
    groups: _INTS
    group_boxes: Array
    spheres: Array
    chain: _INTS
    chain_reach: Array
    obstacles: _INTS
    obstacle_values: Array
    boxes: Array
    pair_of: _INTS
    obstacle_blocks: _INTS
    first_obstacle_block: _INTS
    group_blocks: _INTS
    first_group_block: _INTS
    body_pairs: _INTS
    group_pairs: _INTS
    maps: NDArray[np.int16]
    map_ranges: Array
    padding: Array
    cores: _INTS
    core_values: Array
    points: Array
    blocks: Array
    lowest: NDArray[np.int64]
    core_of: _INTS
    margins: Array


class PaddedPairs(NamedTuple):
    """What of the pairs depends on padding; columns as in `EdgeTables`.

    Args:
        pair_of, obstacle_blocks, first_obstacle_block, group_blocks, first_group_block, body_pairs, group_pairs, maps,
            map_ranges: As there.
        greatest: The greatest padding [m].
        kept: What was made of them.
    """

    pair_of: _INTS
    obstacle_blocks: _INTS
    first_obstacle_block: _INTS
    group_blocks: _INTS
    first_group_block: _INTS
    body_pairs: _INTS
    group_pairs: _INTS
    maps: NDArray[np.int16]
    map_ranges: Array
    greatest: float
    kept: dict[str, Any]
