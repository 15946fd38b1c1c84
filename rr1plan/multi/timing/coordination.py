"""Coordination diagrams: the pairs of segments of two agents' paths on which the agents are proven not to touch.

A diagram has a row for the start, each segment and the goal of one path, and a column for those of the other. It does
not depend on time: whatever the schedule, two agents never touch if their cell is free at every instant (O'Donnell and
Lozano-Pérez 1989). Cells are certified by `coordination.c`, not sampled.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from rr1plan.collision.checker import TOLERANCE
from rr1plan.kernels.planner_kernels import CStruct, load_library
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.paths.placed_path import NEVER
from rr1plan.object_cache import kept_in
from rr1plan.scene import Scene

Blocked = NDArray[np.uint8]
"""Cells that are not proven free, shape (cells of one path, cells of the other)."""


def coordination_diagram(
    one: AgentPath,
    two: AgentPath,
    margin: float = 0.0,
    stop: NDArray[np.int64] = NEVER,
    wanted: NDArray[np.bool_] | None = None,
) -> Blocked | None:
    """The coordination diagram of two paths; None where all cells are free.

    Args:
        one: A path of an agent.
        two: A path of another agent, of the same problem.
        margin: Distance to keep beyond the scene's padding [m].
        stop: A flag, shape (1,). Once another thread sets it, the rest is skipped, and no cell counts as free.
        wanted: Cells to check (default: all), shape (cells of one, cells of two); others are 0, but not proven.
    """
    if not may_touch(one, two, margin):
        return None
    pairs = cross_pairs(one.agent, two.agent, margin)
    sums: NDArray[np.int64] | int = 0
    if wanted is not None:
        sums = np.pad(wanted.cumsum(axis=0, dtype=np.int64).cumsum(axis=1), ((1, 0), (1, 0)))
    blocked = _blocked_cells(one.agent, two.agent, one.placed, two.placed, pairs, stop, sums)
    if stop[0]:
        return np.ones_like(blocked)
    return blocked if blocked.any() else None


def are_apart(one: Agent, placed: CStruct, two: Agent, other: CStruct, margin: float = 0.0) -> bool:
    """Whether two agents are proven collision-free in all given configurations, including bodies that no joint moves.

    Args:
        one: An agent.
        placed: Its bodies in some configurations, see `placed_configurations`.
        two: Another agent, of the same problem.
        other: Its bodies.
        margin: Distance to keep beyond the scene's padding, except between two bodies that no joint moves [m].
    """
    return not conflicts(one, placed, two, other, margin).any()


def conflicts(one: Agent, placed: CStruct, two: Agent, other: CStruct, margin: float = 0.0) -> Blocked:
    """Configurations of two agents that are not proven collision-free together, shape (n, m); see `are_apart`."""
    return _blocked_cells(one, two, placed, other, cross_pairs(one, two, margin, fixed=True))


def _blocked_cells(
    one: Agent,
    two: Agent,
    placed: CStruct,
    other: CStruct,
    pairs: CStruct,
    stop: NDArray[np.int64] = NEVER,
    sums: NDArray[np.int64] | int = 0,
) -> Blocked:
    """See `rr1_coordinate_paths`; `sums` is its argument `wanted`."""
    blocked = np.zeros((placed.value.cell_count, other.value.cell_count), np.uint8)
    if pairs.value.group_pair_count == 0:  # the kernel needs at least one body of each agent
        return blocked
    directions = np.empty((len(one.bodies.elements) * len(two.bodies.elements), 3))
    open_pairs = np.empty(pairs.value.group_pair_count, np.int64)
    load_library().rr1_coordinate_paths(placed, other, pairs, directions, open_pairs, stop, sums, blocked)
    return blocked


def ends_are_apart(one: AgentPath, two: AgentPath, margin: float) -> bool:
    """Whether starts and goals of two paths are proven collision-free, ignoring bodies that no joint moves.

    Args:
        one: A path of an agent.
        two: A path of another agent, of the same problem.
        margin: Distance to keep beyond the scene's padding [m].
    """
    return not _conflicts_of_ends(one, two, cross_pairs(one.agent, two.agent, margin)).diagonal().any()


def _conflicts_of_ends(one: AgentPath, two: AgentPath, pairs: CStruct) -> Blocked:
    """Whether the start and goal of one path (rows) conflict with those of another one (columns), shape (2, 2)."""
    return _blocked_cells(one.agent, two.agent, one.placed_ends, two.placed_ends, pairs)


def may_touch(one: AgentPath, two: AgentPath, margin: float) -> bool:
    """Whether boxes around the swept volumes of two agents' bodies intersect.

    Args:
        one: A path of an agent.
        two: A path of another agent, of the same problem.
        margin: Distance to keep beyond the scene's padding [m].
    """
    return ends_in_the_way(one, two, margin) or boxes_intersect(one, two, margin)


def ends_in_the_way(one: AgentPath, two: AgentPath, margin: float) -> bool:
    """Whether a start or goal of one path may be in the way of a start or goal of another one; see `may_touch`."""
    return bool(_conflicts_of_ends(one, two, cross_pairs(one.agent, two.agent, margin)).any())


def boxes_intersect(one: AgentPath, two: AgentPath, margin: float) -> bool:
    """The same as `may_touch`, for which the bodies have to be placed along both paths, which takes longer."""
    pairs = cross_pairs(one.agent, two.agent, margin)
    if pairs.value.group_pair_count == 0:
        return False
    a, b = one.boxes[:, None], two.boxes[None]
    distance = pairs.targets["padding"][..., None]
    return bool(((a[..., :3] <= b[..., 3:] + distance) & (b[..., :3] <= a[..., 3:] + distance)).all(axis=2).any())


def cross_pairs(one: Agent, two: Agent, margin: float, *, fixed: bool = False) -> CStruct:
    """Pairs of bodies of two agents that must not touch, with their padding (`coordination.h`).

    Args:
        one: An agent.
        two: Another one of the same problem.
        margin: Distance to keep beyond the scene's padding, except between two bodies that no joint moves [m].
        fixed: Whether to include pairs of bodies that no joint moves.
    """
    scene = one.problem.scene
    if not scene.allowed and not scene.pair_padding:
        # One table for all agents with the same bodies in the same order.
        key: tuple[object, ...] = (
            "cross pairs",
            one.bodies.layout,
            two.bodies.layout,
            scene.padding,
            margin,
            fixed,
        )
    else:
        key = ("cross pairs", one.arms, two.arms, margin, fixed)
    return kept_in(scene.kept, key, lambda: _cross_pairs(scene, one, two, margin, fixed))


def _cross_pairs(scene: Scene, one: Agent, two: Agent, margin: float, fixed: bool) -> CStruct:
    a, b = one.bodies, two.bodies
    padding = np.full((len(a.elements), len(b.elements)), scene.padding)
    if scene.allowed or scene.pair_padding:
        for (i, first), (j, second) in product(enumerate(a.elements), enumerate(b.elements)):
            distance = scene.padding_of(first, second)
            padding[i, j] = -np.inf if scene.may_touch(first, second) else distance
    # Two bodies that no joint moves are in contact always or never, so they need no margin.
    is_still = a.is_fixed[:, None] & b.is_fixed[None, :]
    padding += np.where(is_still, TOLERANCE if fixed else -np.inf, margin + TOLERANCE)
    groups = [
        (i, j)
        for (i, (_, a0, a1)), (j, (_, b0, b1)) in product(enumerate(a.group_rows), enumerate(b.group_rows))
        if np.isfinite(padding[a0:a1, b0:b1]).any()
    ]
    return CStruct(
        "CrossPairs",
        padding=padding,
        group_pairs=np.array(groups, np.int64).reshape(-1, 2),
        group_pair_count=len(groups),
        max_padding=float(padding.max(initial=-np.inf)),
    )
