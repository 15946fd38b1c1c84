"""The order in which two agents pass the cells of their coordination diagram that are not proven free."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.paths.placed_path import NEVER
from rr1plan.multi.preflight import MARGINS
from rr1plan.multi.timing.coordination import Blocked, coordination_diagram
from rr1plan.multi.timing.schedule import Occupancy, Schedule, extended

Cells = NDArray[np.bool_]
"""Steps of two agents that must not be occupied at the same time, shape (steps of one, steps of the other)."""

CellIndices = tuple[NDArray[np.int64], NDArray[np.int64]]
"""The same as indices: the step of the one and of the other agent in each cell, shape (n,) each."""

# Margins in addition to the padding [m]: the largest one with which a plan is compatible is used.
PASSING_MARGINS = (*MARGINS, 0.0)
# Agents that pass within this time of each other count as simultaneous [s].
SIMULTANEOUS = 1e-6


class Step(NamedTuple):
    """An agent enters a step of its route.

    Args:
        agent: Its index.
        step: The step.
    """

    agent: int
    step: int


class Precedence(NamedTuple):
    """A step of one agent that comes after a step of another.

    Args:
        node: The step that has to wait.
        after: The step that has to happen first.
    """

    node: Step
    after: Step


def closed_diagram(
    one: AgentPath, two: AgentPath, margin: float, wanted: Cells | None = None, stop: NDArray[np.int64] = NEVER
) -> Blocked | None:
    """The extended diagram of two paths, in which rest at an end is free if the adjacent segment is.

    An end is a part of that segment, so a proof for the segment also holds at the end.

    Args:
        one: A path of an agent.
        two: A path of another one.
        margin: Distance to keep beyond the padding [m].
        wanted: Cells to check, see `coordination_diagram` (default: all).
        stop: A flag that ends the computation, see `coordination_diagram`.
    """
    blocked = coordination_diagram(one, two, margin, stop, wanted)
    if blocked is None:
        return None
    for cells, segments in ((blocked, one.segments), (blocked.T, two.segments)):
        if segments:
            cells[0] &= cells[1]
            cells[-1] &= cells[-2]
    return extended(blocked)


def shared_cells(blocked: Blocked, one: Schedule, two: Schedule) -> Cells:
    """The steps of two schedules that must not be occupied at the same time.

    Args:
        blocked: The extended diagram of their paths.
        one: Schedule of an agent.
        two: Schedule of another one of the same plan.
    """
    return np.asarray(blocked[np.ix_(one.occupancy.rows, two.occupancy.rows)].astype(bool))


def agreed_diagram(one: Schedule, two: Schedule) -> Blocked | None:
    """The closed diagram with the largest margin for which two schedules have an order; None if all of it is free.

    If they have no order with any margin, the diagram has no margin.

    Args:
        one: Schedule of an agent.
        two: Schedule of another one of the same plan.
    """
    blocked = None
    for margin in PASSING_MARGINS:
        met = simultaneous_cells(one, two, margin)
        if met is not None and order_between(met, one, two) is None and margin > 0.0:
            continue
        blocked = closed_diagram(one.path, two.path, margin)
        if blocked is None or order_between(blocked, one, two) is not None:
            break
    return blocked


def simultaneous_cells(one: Schedule, two: Schedule, margin: float) -> Blocked | None:
    """The closed diagram of two schedules, in the cells that both occupy at once or one right after the other.

    These few cells decide whether there is an order; all others are omitted, as if they were free.

    Args:
        one: Schedule of an agent.
        two: Schedule of another one of the same plan.
        margin: Distance to keep beyond the padding [m].
    """
    steps = np.nonzero(cell_gaps(one.occupancy, two.occupancy) <= SIMULTANEOUS)
    rows, columns = (rows_of(s.path, s.occupancy.rows[at]) for s, at in zip((one, two), steps, strict=True))
    wanted = np.zeros((one.path.cells, two.path.cells), np.bool_)
    for row, column in product(rows, columns):
        wanted[row, column] = True
    return closed_diagram(one.path, two.path, margin, wanted)


def rows_of(path: AgentPath, extended_rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The two rows of diagrams on which each row of closed extended ones depends, shape (n,); equal for a segment.

    Args:
        path: The path.
        extended_rows: Rows of its extended diagrams, shape (n,).
    """
    last, first = path.segments + 1, extended_rows.copy()
    second = first.copy()
    # Rest between two segments is free if either segment is, rest at an end if the adjacent segment is.
    rests = first > last
    first[rests] -= last
    second[rests] = first[rests] + 1
    if path.segments:
        second[first == 0], second[first == last] = 1, last - 1
    return first, second


def first_order(one: Schedule, two: Schedule, agents: tuple[int, int] = (0, 1)) -> list[Precedence] | None:
    """The order of two agents where they pass simultaneously, with the largest margin for which there is one.

    All precedences between simultaneous events are among these; None if there is no order with any margin.

    Args:
        one: Schedule of an agent.
        two: Schedule of another one of the same plan.
        agents: Their indices.
    """
    for margin in PASSING_MARGINS:
        met = simultaneous_cells(one, two, margin)
        order = [] if met is None else order_between(met, one, two, agents)
        if order is not None:
            return order
    return None


def order_between(
    blocked: Blocked, one: Schedule, two: Schedule, agents: tuple[int, int] = (0, 1)
) -> list[Precedence] | None:
    """The order in which two agents pass each other, see `passing_order`.

    Args:
        blocked: The extended diagram of their paths.
        one: Schedule of an agent.
        two: Schedule of another one of the same plan.
        agents: Their indices.
    """
    rows, columns = np.nonzero(shared_cells(blocked, one, two))
    return passing_order((rows, columns), one.occupancy, two.occupancy, agents)


def cell_gaps(one: Occupancy, two: Occupancy) -> Array:
    """Time between the stays of two agents in each cell [s], negative if they overlap, shape (steps, steps).

    Args:
        one: What the one occupies.
        two: What the other does.
    """
    return np.maximum(two.enter[None, :] - one.leave[:, None], one.enter[:, None] - two.leave[None, :])


def time_between(cells: CellIndices, one: Occupancy, two: Occupancy) -> Array:
    """Like `cell_gaps`, in some cells only, shape (n,).

    Args:
        cells: The cells.
        one: What the one occupies.
        two: What the other does.
    """
    rows, columns = cells
    return np.maximum(two.enter[columns] - one.leave[rows], one.enter[rows] - two.leave[columns])


def passing_order(
    cells: CellIndices, one: Occupancy, two: Occupancy, agents: tuple[int, int] = (0, 1)
) -> list[Precedence] | None:
    """The precedences between two agents that do not follow from each other.

    Args:
        cells: Steps that must not be occupied at once.
        one: What the one occupies.
        two: What the other does.
        agents: Their indices.

    Returns:
        The precedences; None if both are in a shared cell at the same time, or if each has to pass before the other.
    """
    rows, columns = cells
    gap = time_between(cells, one, two)
    if (gap < 0.0).any():
        return None
    i, j = agents
    found = [Precedence(Step(j, step), Step(i, after)) for step, after in _frontier(rows, columns, one, two)]
    found += [Precedence(Step(i, step), Step(j, after)) for step, after in _frontier(columns, rows, two, one)]
    # Only simultaneous events can form a cycle.
    if not (gap <= 0.0).any() or not passage({i: len(one.enter), j: len(two.enter)}, found).circle:
        return found
    return None


def _frontier(
    steps: NDArray[np.int64], others: NDArray[np.int64], first: Occupancy, second: Occupancy
) -> list[tuple[int, int]]:
    """The precedences of one agent over another that do not follow from each other.

    Args:
        steps: Step of the first agent in each cell that must not be occupied at once, shape (n,).
        others: Step of the second, shape (n,).
        first: Occupancy of the agent that may be first.
        second: Occupancy of the agent that may have to wait.

    Returns:
        Pairs of a step of the second, and the step that the first has to enter before it.
    """
    over = steps_over(steps, others, first, second)
    rising = np.flatnonzero(np.diff(over, prepend=0) > 0)
    return list(zip(rising.tolist(), over[rising].tolist(), strict=True))


def steps_over(
    steps: NDArray[np.int64], others: NDArray[np.int64], first: Occupancy, second: Occupancy
) -> NDArray[np.int64]:
    """The number of steps of one agent that have to be over at each step of another one, shape (steps of the other,).

    Args:
        steps: Step of the first agent in each cell that must not be occupied at once, shape (n,).
        others: Step of the second, shape (n,).
        first: Occupancy of the agent that may be first.
        second: Occupancy of the agent that may have to wait.
    """
    is_first = second.enter[others] - first.leave[steps] >= 0.0
    over = np.zeros(len(second.enter), np.int64)
    np.maximum.at(over, others[is_first], steps[is_first] + 1)
    return np.maximum.accumulate(over)


class Passage(NamedTuple):
    """The outcome if all agents enter their steps as long as they can.

    Args:
        order: The steps that can be entered, each after all its predecessors.
        circle: Agents that wait for each other in a cycle; none if all reach their last steps.
    """

    order: list[Step]
    circle: list[int]


def passage(steps: Mapping[int, int], precedences: Iterable[Precedence]) -> Passage:
    """Enter all steps of some agents.

    Args:
        steps: Number of steps of each agent.
        precedences: The precedences between steps.
    """
    waiting: dict[Step, list[Step]] = {}
    for node, after in precedences:
        waiting.setdefault(node, []).append(after)
    now = dict.fromkeys(steps, 0)

    def missing(agent: int) -> Step | None:
        """The step for which an agent waits; None if it can continue."""
        return next(
            (after for after in waiting.get(Step(agent, now[agent] + 1), ()) if now[after.agent] < after.step), None
        )

    order = [Step(agent, 0) for agent in steps]
    open_ = list(steps)
    while open_:
        agent = open_.pop()
        before = now[agent]
        while now[agent] < steps[agent] - 1 and missing(agent) is None:
            now[agent] += 1
            order.append(Step(agent, now[agent]))
        if now[agent] > before:
            open_ = [other for other in steps if other != agent]
    stuck = next((agent for agent in steps if now[agent] < steps[agent] - 1), None)
    seen: list[int] = []
    while stuck is not None and stuck not in seen:
        seen.append(stuck)
        blocker = missing(stuck)
        stuck = None if blocker is None else blocker.agent
    return Passage(order, [] if stuck is None else seen[seen.index(stuck) :])
