"""The complete routes of arms of a running plan, path after path, and the order in which two arms pass each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rr1plan.multi.execution.route import Route, RouteSteps
from rr1plan.multi.execution.running_plan import Part
from rr1plan.multi.timing.passing_order import (
    PASSING_MARGINS,
    Cells,
    Precedence,
    closed_diagram,
    passing_order,
)
from rr1plan.multi.timing.schedule import Occupancy
from rr1plan.retiming.path_blends import Curve
from rr1plan.retiming.path_speed import Grid


@dataclass(frozen=True)
class RunningRoute:
    """The complete route of an arm.

    Args:
        route: The routes of its parts, concatenated, as far as they are traversed.
        parts: The parts.
        first_steps: The step of the route with which each part begins, shape (parts,). The rest between two parts is
            one step.
    """

    route: Route
    parts: tuple[Part, ...]
    first_steps: NDArray[np.int64]

    @property
    def occupancy(self) -> Occupancy:
        """Times of each step; the rows have no meaning."""
        steps = self.route.steps
        return Occupancy(np.arange(len(steps)), steps.times, steps.leave_times)


def running_route(parts: Sequence[Part]) -> RunningRoute:
    """The complete route of an arm.

    Args:
        parts: All its parts, from the beginning of the plan on.
    """
    lengths, coefficients = [np.zeros(0)], [np.zeros((0, *parts[0].route.curve.coefficients.shape[1:]))]
    grids: list[Grid] = []
    stops: list[int] = []
    begins, times, is_rest = [np.zeros(1, np.int64)], [np.array([-np.inf])], [np.array([True])]
    first_steps, pieces, gridpoints, count = [], 0, 0, 0
    for part in parts:
        route, passed = part.route, part.passed_steps
        steps, last = route.steps, int(route.steps.ends[passed - 1])
        piece, offset, delta = route.grid
        grids.append(Grid(piece[:last] + pieces, offset[:last], delta[:last]))
        lengths.append(route.curve.lengths)
        coefficients.append(route.curve.coefficients)
        stops += [gridpoints + k for k in (*(k for k in route.stops if k < last), *([last] if last else []))]
        begins.append(steps.begins[1:passed] + gridpoints)
        times.append(np.minimum(steps.times[1:passed], part.end))  # the part may end earlier by rounding
        is_rest.append(steps.is_rest[1:passed])
        first_steps.append(count)
        count += passed - 1
        pieces, gridpoints = pieces + len(route.curve.lengths), gridpoints + last
    begin, rest = np.concatenate(begins), np.concatenate(is_rest)
    first = parts[0].route
    whole = Route(
        first.joint_names,
        first.start,
        Curve(np.concatenate(lengths), np.concatenate(coefficients), (0, 0)),
        Grid(*(np.concatenate([grid[k] for grid in grids]) for k in range(3))),
        tuple(stops),
        RouteSteps(begin, begin + ~rest, np.concatenate(times)),
    )
    return RunningRoute(whole, tuple(parts), np.array(first_steps))


def running_order(one: RunningRoute, two: RunningRoute, agents: tuple[int, int]) -> list[Precedence] | None:
    """The order of two arms with the largest margin for which there is one, see `passing_order`; None without one.

    Args:
        one: An arm.
        two: Another one of the same plan.
        agents: Their indices.
    """
    order = None
    for margin in PASSING_MARGINS:
        order = passing_order(_shared_cells(one, two, margin), one.occupancy, two.occupancy, agents)
        if order is not None:
            break
    return order


def _shared_cells(one: RunningRoute, two: RunningRoute, margin: float) -> Cells:
    """The steps of two arms that must not be occupied at the same time.

    Between two paths the rest of an arm belongs to both, and is free if it is free on either.
    """
    hit = np.ones((len(one.route.steps), len(two.route.steps)), bool)
    for begin, part in zip(one.first_steps.tolist(), one.parts, strict=True):
        for first, other in zip(two.first_steps.tolist(), two.parts, strict=True):
            block = hit[begin : begin + part.passed_steps, first : first + other.passed_steps]
            blocked = closed_diagram(part.path, other.path, margin)
            if blocked is None:
                block[:] = False
            else:
                block &= blocked[np.ix_(part.rows[: len(block)], other.rows[: block.shape[1]])].astype(bool)
    return hit
