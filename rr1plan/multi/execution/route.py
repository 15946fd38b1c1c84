"""Routes: the sequence of segments and rests of an agent, independent of its speed.

A route is the agent's path unrolled: if a schedule goes back, the same segments follow again in reverse. It is divided
into steps, one for each row of coordination diagrams that the agent occupies: rest at the start, segments, rest at
stops, rest at the goal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rr1plan.checks import Array, Value, finite_array, read_only
from rr1plan.errors import InputError
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.timing.schedule import Leg, Schedule, gridpoints_of, segments_of
from rr1plan.path import arms_of, check_joint_names
from rr1plan.retiming.path_blends import Curve
from rr1plan.retiming.path_speed import NO_INTERVALS, Grid, joined

# Consecutive segments meet up to rounding [rad or m].
_SAME_PLACE = 1e-6


@dataclass(frozen=True, eq=False)
class RouteSteps(Value):
    """The steps of a route: rest at the start, segments, rest at stops, rest at the goal.

    Args:
        begins: Gridpoint at which each step begins, shape (n,).
        ends: Gridpoint at which each step ends: the next one for a segment, the same for rest, shape (n,).
        times: Times at which the plan enters each step [s], shape (n,); the first is -inf.

    Raises:
        InputError: arrays of inconsistent shapes, steps that do not follow each other, or times that decrease.
    """

    begins: NDArray[np.int64]
    ends: NDArray[np.int64]
    times: Array

    def __post_init__(self) -> None:
        n = len(self.begins)
        begins, ends = _indices("begins", self.begins, n), _indices("ends", self.ends, n)
        later = finite_array("times", np.asarray(self.times, np.float64)[1:], (max(n - 1, 0),))
        for name, value in (("begins", begins), ("ends", ends), ("times", np.concatenate([[-np.inf], later]))):
            object.__setattr__(self, name, read_only(value))
        size = ends - begins
        if n == 0 or begins[0] != 0 or size[0] != 0:
            raise InputError("the steps of a route begin with rest at its first gridpoint")
        if not np.isin(size, (0, 1)).all() or (begins[1:] != ends[:-1]).any():
            raise InputError("the steps of a route do not follow each other")
        if (np.diff(later) < 0.0).any():
            raise InputError("the times of a route's steps decrease")

    def __len__(self) -> int:
        return len(self.begins)

    @property
    def is_rest(self) -> NDArray[np.bool_]:
        """Whether each step is rest rather than a segment, shape (n,)."""
        return np.asarray(self.begins == self.ends)

    @property
    def leave_times(self) -> Array:
        """Times at which the plan leaves each step [s], shape (n,); the last is inf."""
        return np.append(self.times[1:], np.inf)


@dataclass(frozen=True, eq=False)
class Route(Value):
    """The unrolled path of an agent: all segments and rests in order.

    Args:
        joint_names: Name of each column, "arm/joint", length nq.
        start: First configuration, shape (nq,).
        curve: The unrolled path: pieces q(s) = c[0] + c[1] s + c[2] s².
        grid: Its m segments.
        stops: Gridpoints at which the agent has to stop, ascending, the last one m; empty if it does not move.
        steps: Its segments and the rests between them, with the times of the plan.

    Raises:
        InputError: arrays of inconsistent shapes, or segments that do not follow each other.
    """

    joint_names: tuple[str, ...]
    start: Array
    curve: Curve
    grid: Grid
    stops: tuple[int, ...]
    steps: RouteSteps

    def __post_init__(self) -> None:
        names = check_joint_names(self.joint_names)
        nq, m = len(names), len(self.grid.piece)
        lengths = finite_array("lengths", self.curve.lengths, (None,))
        coefficients = np.reshape(self.curve.coefficients, (-1, 3, nq))
        coefficients = finite_array("coefficients", coefficients, (len(lengths), 3, nq))
        piece = _indices("piece", self.grid.piece, m)
        if m and (piece.min() < 0 or piece.max() >= len(lengths)):
            raise InputError(f"piece has a number that is not in 0 .. {len(lengths) - 1}")
        offset, delta = finite_array("offset", self.grid.offset, (m,)), finite_array("delta", self.grid.delta, (m,))
        object.__setattr__(self, "joint_names", names)
        object.__setattr__(self, "start", read_only(finite_array("start", self.start, (nq,))))
        object.__setattr__(self, "curve", Curve(read_only(lengths), read_only(coefficients), self.curve.corners))
        object.__setattr__(self, "grid", Grid(read_only(piece), read_only(offset), read_only(delta)))
        object.__setattr__(self, "stops", tuple(int(k) for k in self.stops))
        if self.steps.ends[-1] != m:
            raise InputError("the steps of a route do not end at its last gridpoint")
        expected = m in self.stops if m else not self.stops
        if not expected or list(self.stops) != sorted(set(self.stops)) or (m and not 0 < self.stops[0] <= m):
            raise InputError(f"stops of a route of {m} segments are ascending gridpoints up to {m}")
        self._check_segments()

    def _check_segments(self) -> None:
        """Check that segments lie on their pieces, and that each begins where the previous one ends."""
        piece, offset, delta = self.grid
        longest = self.curve.lengths[piece]
        room = _SAME_PLACE * (1.0 + longest)
        if (delta <= 0.0).any() or (offset < -room).any() or (offset + delta > longest + room).any():
            raise InputError("a segment of a route is not on its piece")
        gap = np.abs(self.grid.position(self.curve, 0.0) - self.gridpoints[:-1]).max(initial=0.0)
        if gap > _SAME_PLACE:
            raise InputError(
                f"a gap of {gap:.2g} between segments of a route, expected each to begin where the last ended"
            )

    def __repr__(self) -> str:
        return f"Route({', '.join(self.arms)}: {self.segments} segments, {len(self.steps)} steps)"

    @property
    def arms(self) -> tuple[str, ...]:
        """The arms that move along the route."""
        return arms_of(self.joint_names)

    @property
    def segments(self) -> int:
        """Number of segments."""
        return len(self.grid.piece)

    @property
    def gridpoints(self) -> Array:
        """Configurations at its start and at the end of each segment, shape (m + 1, nq)."""
        return np.concatenate([self.start[None], self.grid.position(self.curve, 1.0)])


def _indices(name: str, values: ArrayLike, size: int) -> NDArray[np.int64]:
    found = np.asarray(values)
    if found.shape != (size,) or (size and found.dtype.kind not in "iu"):
        raise InputError(f"{name} is not a list of {size} whole numbers")
    return found.astype(np.int64)


def passed_gridpoints(schedule: Schedule) -> NDArray[np.int64]:
    """The gridpoints of a path in the order in which a schedule passes them, shape (m + 1,)."""
    return np.concatenate([[0], *(gridpoints_of(leg)[1:] for leg in schedule.legs)])


def route_of(schedule: Schedule) -> Route:
    """The route of an agent with a schedule."""
    path = schedule.path
    begins, ends, now = [0], [0], 0
    for leg in schedule.legs:
        count = abs(leg.end - leg.begin)
        begins += [*range(now, now + count), now + count]
        ends += [*range(now + 1, now + count + 1), now + count]
        now += count
    passed = passed_gridpoints(schedule)
    turns, last = np.diff(passed), len(passed) - 1
    stops = [k for k in range(1, last + 1) if k == last or turns[k - 1] != turns[k] or passed[k] in path.halts]
    nothing = Curve(np.zeros(0), np.zeros((0, 3, len(path.start))), (0, 0)), NO_INTERVALS
    return Route(
        path.agent.joint_names,
        path.start,
        *joined([nothing, *(_unrolled(path, leg) for leg in schedule.legs)]),
        tuple(stops),
        RouteSteps(np.array(begins), np.array(ends), schedule.occupancy.enter),
    )


def _unrolled(path: AgentPath, leg: Leg) -> tuple[Curve, Grid]:
    """Pieces and segments of one leg, in the order in which they are passed."""
    at = segments_of(leg)
    piece, offset, delta = path.grid.piece[at], path.grid.offset[at], path.grid.delta[at]
    first = int(piece.min())
    part = slice(first, int(piece.max()) + 1)
    lengths, c = path.curve.lengths[part], path.curve.coefficients[part]
    if leg.end > leg.begin:
        return Curve(lengths, c, (0, 0)), Grid(piece - first, offset, delta)
    whole = lengths[:, None]
    turned = np.stack(
        [c[:, 0] + whole * (c[:, 1] + whole * c[:, 2]), -(c[:, 1] + 2.0 * whole * c[:, 2]), c[:, 2]], axis=1
    )
    return Curve(lengths, turned, (0, 0)), Grid(piece - first, path.curve.lengths[piece] - offset - delta, delta)
