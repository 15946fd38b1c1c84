"""Bodies of an agent at the intervals of a path, or in some configurations, as `coordination.h` describes them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, read_only
from rr1plan.kernels.planner_kernels import CStruct, load_library
from rr1plan.multi.agents import AgentBodies

NEVER: NDArray[np.int64] = read_only(np.zeros(1, np.int64))
"""The flag of work that is never stopped."""
_ANYWHERE = 1e3  # deviation of joints by which bodies may be anywhere [rad or m]


def placed_path(
    bodies: AgentBodies,
    q: Array,
    reach: Array,
    is_empty: NDArray[np.int64],
    cell: NDArray[np.int64],
    stop: NDArray[np.int64] = NEVER,
) -> CStruct:
    """Place the bodies at all nodes of a tree of intervals.

    Args:
        bodies: The bodies.
        q: A configuration of each node, shape (2 leaves + 2, nq).
        reach: Largest deviation of each column from it, same shape.
        is_empty: 1 for nodes without anything, shape (2 leaves + 2,).
        cell: Row of coordination diagrams of each leaf and both ends, shape (leaves + 2,).
        stop: A flag, shape (1,). Once another thread sets it, the remaining nodes are not placed.
    """
    nodes, body_count, group_count = len(q), len(bodies.elements), len(bodies.group_rows)
    placed = CStruct(
        "PlacedPath",
        exact=bodies.exact,
        groups=bodies.group_rows,
        group_balls=bodies.group_balls,
        group_count=group_count,
        leaf_count=len(cell) - 2,
        is_empty=is_empty,
        cell=cell,
        cell_count=int(cell.max()) + 1,
        poses=np.empty((nodes * body_count, 12)),
        centers=np.empty((nodes * body_count, 3)),
        travel=np.empty(nodes * body_count),
        group_centers=np.empty((nodes * group_count, 3)),
        group_travel=np.empty(nodes * group_count),
    )
    load_library().rr1_place_path(placed, bodies.scratch(), q, reach, stop)
    return placed


def placed_configuration(bodies: AgentBodies, q: Array) -> CStruct:
    """The bodies in one configuration (nq,), as a path of a single interval of zero length."""
    return placed_configurations(bodies, q[None])


def box_around(bodies: AgentBodies, placed: CStruct) -> tuple[Array, Array]:
    """Low and high corner of a box around all bodies in a configuration [m]; infinitely small without bodies.

    Args:
        bodies: The bodies.
        placed: The bodies in this configuration, see `placed_configuration`.
    """
    count, radii = len(bodies.group_balls), bodies.group_balls[:, 3:]
    centers = placed.part("group_centers")[count : 2 * count]
    return (centers - radii).min(axis=0, initial=np.inf), (centers + radii).max(axis=0, initial=-np.inf)


def placed_configurations(bodies: AgentBodies, configurations: Array) -> CStruct:
    """The bodies in some configurations (n, nq), as a path of n intervals of zero length."""
    count, columns = configurations.shape
    leaves = 1 << (count - 1).bit_length()
    q, reach = np.zeros((2 * leaves + 2, columns)), np.zeros((2 * leaves + 2, columns))
    q[leaves : leaves + count] = configurations
    # Nodes above the leaves prove nothing.
    q[:leaves], reach[:leaves] = configurations[0], _ANYWHERE
    empty = np.ones(2 * leaves + 2, np.int64)
    empty[1 : leaves + count] = 0
    return placed_path(bodies, q, reach, empty, np.minimum(np.arange(leaves + 2), count - 1))
