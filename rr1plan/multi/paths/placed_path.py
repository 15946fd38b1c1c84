"""Bodies of an agent at the intervals of a path, or in one configuration, as `coordination.h` describes them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.kernels.planner_kernels import CStruct, load_library
from rr1plan.multi.agents import AgentBodies


def placed_path(
    bodies: AgentBodies, q: Array, reach: Array, is_empty: NDArray[np.int64], cell: NDArray[np.int64]
) -> CStruct:
    """Place the bodies at all nodes of a tree of intervals.

    Args:
        bodies: The bodies.
        q: A configuration of each node, shape (2 leaves + 2, nq).
        reach: Largest deviation of each column from it, same shape.
        is_empty: 1 for nodes without anything, shape (2 leaves + 2,).
        cell: Row of coordination diagrams of each leaf and both ends, shape (leaves + 2,).
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
    load_library().rr1_place_path(placed, bodies.scratch(), q, reach)
    return placed


def placed_configuration(bodies: AgentBodies, q: Array) -> CStruct:
    """The bodies in one configuration (nq,), as a path that consists of a start only."""
    nodes = np.zeros((4, len(q)))
    nodes[2] = q
    empty = np.array([1, 1, 0, 1])
    return placed_path(bodies, nodes, np.zeros_like(nodes), empty, np.zeros(3, np.int64))
