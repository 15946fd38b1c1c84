"""What the exact kernel knows of a scene, and the memory it writes.

Bodies and their bounding volumes: see `separation.py`. The tables are made by `rr1plan.collision.exact_tables`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rr1plan._kernels.jit import FLOATS1, FLOATS2, INT1, INTS1, INTS2, OUT1, OUT2
from rr1plan._kernels.record import reader
from rr1plan.places import place


class ExactTables(NamedTuple):
    """What the exact kernel knows of a scene; poses of what moves, and all after `centres`, are scratch memory.

    Args:
        joints: Parent, 1 for prismatic, column (or -1), 1 if anything drives it or a joint above it; row 0 is the
            world, shape (n, 4).
        joint_values: T_parent_joint (12), axis (3), gain, offset; shape (n, 17).
        bodies: Kind, joint, first and last corner, first and last entry of its chain; shape (b, 6).
        body_values: T_joint_body (12), centre of its ball in the joint's frame (3), radius of the ball,
            radius around the core, centre (3) and half sizes (3) of its box in its own frame, size (3;
            a half-space's normal), a half-space's offset; shape (b, 27).
        corners: Corner points of all bodies of kind CORNERS, centres of the cells of CELLS, shape (c, 3).
        links: Neighbours of corner i are links[links[i] : links[i + 1]].
        chain: Driven joints above each body, root first.
        chain_reach: For each, how far the centre of the body's ball can ever be from the joint's axis [m].
        pairs: Body, body (the half-space or cloud, if there is one), how many joints their chains share;
            shape (p, 3).
        padding: Distance to keep, shape (p,).
        joint_poses: World poses of joints: rotation row by row, then origin; shape (n, 12).
        poses: The same of bodies, shape (b, 12).
        centres: Centres of their balls, shape (b, 3).
        directions: The direction of each pair where its search ended last, shape (p, 3).
        travel: Row for row of the bodies: entry k is how far the joints from the chain's k-th on can move any of its
            points [m], shape (b, n + 1).
        frame: A pose, shape (12,).
        simplex: Corners of a simplex, shape (4, 3).
    """

    joints: np.ndarray
    joint_values: np.ndarray
    bodies: np.ndarray
    body_values: np.ndarray
    corners: np.ndarray
    links: np.ndarray
    chain: np.ndarray
    chain_reach: np.ndarray
    pairs: np.ndarray
    padding: np.ndarray
    joint_poses: np.ndarray
    poses: np.ndarray
    centres: np.ndarray
    directions: np.ndarray
    travel: np.ndarray
    frame: np.ndarray
    simplex: np.ndarray


EXACT = place(
    [
        *(INTS2, FLOATS2, INTS2, FLOATS2, FLOATS2, INTS1, INTS1, FLOATS1, INTS2, FLOATS1),
        *(OUT2, OUT2, OUT2, OUT2, OUT2, OUT1, OUT2),
    ],
    ExactTables,
)
RECORD = INT1
exact_of = reader(EXACT)
