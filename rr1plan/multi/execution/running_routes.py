"""The complete routes of arms of a running plan, path after path, and the order in which two arms pass each other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.multi.execution.route import Route, RouteSteps
from rr1plan.multi.execution.running_plan import Part
from rr1plan.multi.paths.path_memory import PathMemory
from rr1plan.multi.timing.coordination import cross_pairs
from rr1plan.multi.timing.passing_order import (
    PASSING_MARGINS,
    CellIndices,
    Precedence,
    closed_diagram,
    passing_order,
    rows_of,
    steps_over,
    time_between,
)
from rr1plan.multi.timing.schedule import Occupancy
from rr1plan.progress import step_callback
from rr1plan.retiming.path_blends import Curve
from rr1plan.retiming.path_speed import Grid, joined


@dataclass(frozen=True)
class RunningRoute:
    """The complete route of an arm.

    Args:
        route: The routes of its parts, concatenated, as far as they are traversed.
        parts: The parts.
        first_steps: The step of the route with which each part begins, and the last step, shape (parts + 1,). The rest
            between two parts is one step of both.
    """

    route: Route
    parts: tuple[Part, ...]
    first_steps: NDArray[np.int64]

    @cached_property
    def occupancy(self) -> Occupancy:
        """Times of each step; the rows have no meaning."""
        steps = self.route.steps
        return Occupancy(np.arange(len(steps)), steps.times, steps.leave_times)

    def steps_of(self, part: int) -> range:
        """The steps of a part, including the rest before and after it."""
        return range(int(self.first_steps[part]), int(self.first_steps[part + 1]) + 1)

    @cached_property
    def paths_of_steps(self) -> NDArray[np.int64]:
        """Number of paths to which each step belongs, shape (steps,)."""
        count = np.zeros(len(self.route.steps), np.int64)
        for k in range(len(self.parts)):
            steps = self.steps_of(k)
            count[steps.start : steps.stop] += 1
        return count

    @cached_property
    def boxes(self) -> Array:
        """Low and high corner of a box around the swept volume of each path [m], shape (parts, 6).

        Without bodies, the low corners are at infinity and the high ones at minus infinity.
        """
        found = np.empty((len(self.parts), 6))
        for box, part in zip(found, self.parts, strict=True):
            bodies = part.path.boxes
            part.path.release()
            box[:] = *bodies[:, :3].min(axis=0, initial=np.inf), *bodies[:, 3:].max(axis=0, initial=-np.inf)
        return found


def running_route(parts: Sequence[Part]) -> RunningRoute:
    """The complete route of an arm.

    Args:
        parts: All its parts, from the beginning of the plan on.
    """
    curves: list[tuple[Curve, Grid]] = []
    stops: list[int] = []
    begins, times, is_rest = [np.zeros(1, np.int64)], [np.array([-np.inf])], [np.array([True])]
    first_steps, gridpoints = [0], 0
    for part in parts:
        route, passed = part.route, part.passed_steps
        steps, last = route.steps, int(route.steps.ends[passed - 1])
        curves.append((route.curve, route.grid.part(0, last)))
        stops += [gridpoints + k for k in (*(k for k in route.stops if k < last), *([last] if last else []))]
        begins.append(steps.begins[1:passed] + gridpoints)
        times.append(np.minimum(steps.times[1:passed], part.end))  # the part may end earlier by rounding
        is_rest.append(steps.is_rest[1:passed])
        first_steps.append(first_steps[-1] + passed - 1)
        gridpoints += last
    begin, rest = np.concatenate(begins), np.concatenate(is_rest)
    first = parts[0].route
    whole = Route(
        first.joint_names,
        first.start,
        *joined(curves),
        tuple(stops),
        RouteSteps(begin, begin + ~rest, np.concatenate(times)),
    )
    return RunningRoute(whole, tuple(parts), np.array(first_steps))


def running_order(
    one: RunningRoute,
    two: RunningRoute,
    agents: tuple[int, int],
    memory: PathMemory,
    advance: Callable[[float], None],
) -> list[Precedence] | None:
    """The order of two arms with the largest margin for which there is one, see `passing_order`; None without one.

    Args:
        one: An arm.
        two: Another one of the same plan.
        agents: Their indices.
        memory: Limits the memory of placed bodies.
        advance: Called with the fraction done.
    """
    order = None
    for k, margin in enumerate(PASSING_MARGINS):
        cells = _shared_cells(one, two, margin, memory, step_callback(advance, k, len(PASSING_MARGINS)))
        order = None if cells is None else passing_order(cells, one.occupancy, two.occupancy, agents)
        if order is not None:
            break
    return order


def _shared_cells(
    one: RunningRoute, two: RunningRoute, margin: float, memory: PathMemory, advance: Callable[[float], None]
) -> CellIndices | None:
    """The steps of two arms that must not be occupied at the same time, without some whose order follows from others'.

    The result is None if both arms are in such a cell at the same time.

    Between two paths the rest of an arm belongs to both, and is free if it is free on either. Pairs of paths traversed
    at about the same time come first: their order often implies that of earlier and later ones.
    """
    a, b = one.occupancy, two.occupancy
    found = [(np.zeros(0, np.int64), np.zeros(0, np.int64))]
    over_one, over_two = np.zeros(len(b.enter), np.int64), np.zeros(len(a.enter), np.int64)
    near = _near_parts(one, two, margin)
    for done, (k, m) in enumerate(near):
        advance(done / len(near))
        first, second = one.steps_of(k), two.steps_of(m)
        if over_one[second.start] >= first.stop or over_two[first.start] >= second.stop:
            continue
        part, other = one.parts[k], two.parts[m]
        memory.place(part.path, other.path)
        a_rows, b_rows = part.rows[: len(first)], other.rows[: len(second)]
        wanted = np.zeros((part.path.cells, other.path.cells), np.bool_)
        wanted[np.ix_(np.concatenate(rows_of(part.path, a_rows)), np.concatenate(rows_of(other.path, b_rows)))] = True
        blocked = closed_diagram(part.path, other.path, margin, wanted)
        if blocked is None:
            continue
        rows, columns = np.nonzero(blocked[np.ix_(a_rows, b_rows)])
        rows, columns = rows + first.start, columns + second.start
        found.append((rows, columns))
        surely = one.paths_of_steps[rows] * two.paths_of_steps[columns] == 1
        rows, columns = rows[surely], columns[surely]
        if (time_between((rows, columns), a, b) < 0.0).any():
            return None
        over_one = np.maximum(over_one, steps_over(rows, columns, a, b))
        over_two = np.maximum(over_two, steps_over(columns, rows, b, a))
    cells, count = np.unique(np.concatenate(found, axis=1), axis=1, return_counts=True)
    rows, columns = cells[:, one.paths_of_steps[cells[0]] * two.paths_of_steps[cells[1]] == count]
    return rows, columns


def _near_parts(one: RunningRoute, two: RunningRoute, margin: float) -> list[tuple[int, int]]:
    """Indices of parts of two arms whose swept volumes may touch, those nearest to each other in time first.

    Of about equally near ones, those of one part follow each other, so that few paths need to be placed at once.
    """
    room = cross_pairs(one.parts[0].path.agent, two.parts[0].path.agent, margin).value.max_padding
    a, b = one.boxes[:, None], two.boxes[None]
    found = np.argwhere(((a[..., :3] <= b[..., 3:] + room) & (b[..., :3] <= a[..., 3:] + room)).all(axis=2))
    (begin, end), (other_begin, other_end) = (
        np.array([[part.begin, part.end] for part in route.parts])[index].T
        for route, index in zip((one, two), found.T, strict=True)
    )
    gap = np.maximum(0.0, np.maximum(other_begin - end, begin - other_end))
    order = np.lexsort((gap, found[:, 0], np.ceil(np.log2(1.0 + gap))))
    return [(int(k), int(m)) for k, m in found[order]]
