"""Routes: all that an agent passes on its way, in order, whatever its speed.

A route is the agent's path unrolled: where a schedule goes back, the same segments follow once more, backward. It is
cut into steps, one for each row of coordination diagrams that the agent occupies: rest at the start, segments, rest at
stops, rest at the goal.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rr1plan.checks import Array, Value, finite_array, read_only
from rr1plan.errors import InputError
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.timing.schedule import Leg, Schedule
from rr1plan.path import check_joint_names
from rr1plan.retiming.path_blends import Curve
from rr1plan.retiming.path_speed import Grid

# Consecutive segments meet up to rounding [rad or m].
_SAME_PLACE = 1e-6


@dataclass(frozen=True, eq=False)
class Route(Value):
    """The way of an agent.

    Args:
        arms: Its arms.
        joint_names: Name of each column, "arm/joint", length nq.
        start: Where it begins, shape (nq,).
        lengths: Lengths of the pieces of the curve [rad], shape (k,).
        coefficients: The pieces q(s) = c[0] + c[1] s + c[2] s², shape (k, 3, nq).
        pieces: Piece of each segment, shape (m,).
        offsets: Where on its piece each begins [rad], shape (m,).
        spans: Length of each [rad], shape (m,).
        stops: Gridpoints at which the agent has to stop, ascending, the last one m; empty where it does not move.
        begins: Gridpoint at which each step begins, shape (n,).
        ends: Gridpoint at which it ends: one more for a segment, the same for rest, shape (n,).
        times: When the plan enters each step [s], shape (n,); the first is -inf.

    Raises:
        InputError: arrays that do not fit each other, or segments that do not follow each other.
    """

    arms: tuple[str, ...]
    joint_names: tuple[str, ...]
    start: Array
    lengths: Array
    coefficients: Array
    pieces: NDArray[np.int64]
    offsets: Array
    spans: Array
    stops: tuple[int, ...]
    begins: NDArray[np.int64]
    ends: NDArray[np.int64]
    times: Array

    if TYPE_CHECKING:  # what it takes; above is what it holds

        def __init__(
            self,
            arms: tuple[str, ...],
            joint_names: tuple[str, ...],
            start: ArrayLike,
            lengths: ArrayLike,
            coefficients: ArrayLike,
            pieces: ArrayLike,
            offsets: ArrayLike,
            spans: ArrayLike,
            stops: tuple[int, ...],
            begins: ArrayLike,
            ends: ArrayLike,
            times: ArrayLike,
        ) -> None: ...

    def __post_init__(self) -> None:
        names = check_joint_names(self.joint_names)
        owners = tuple(dict.fromkeys(name.split("/", 1)[0] for name in names))
        if owners != tuple(self.arms):
            raise InputError(f"the route of {', '.join(self.arms)} has joints of {', '.join(owners)}")
        nq, m, n = len(names), len(self.pieces), len(self.begins)
        lengths = finite_array("lengths", self.lengths, (None,))
        later = np.asarray(self.times, np.float64)[1:]
        values = {
            "start": finite_array("start", self.start, (nq,)),
            "lengths": lengths,
            "coefficients": finite_array(
                "coefficients", np.reshape(self.coefficients, (-1, 3, nq)), (len(lengths), 3, nq)
            ),
            "pieces": _indices("pieces", self.pieces, m, len(lengths)),
            "offsets": finite_array("offsets", self.offsets, (m,)),
            "spans": finite_array("spans", self.spans, (m,)),
            "begins": _indices("begins", self.begins, n, m + 1),
            "ends": _indices("ends", self.ends, n, m + 1),
            "times": np.concatenate([[-np.inf], finite_array("times", later, (max(n - 1, 0),))]),
        }
        for name, value in values.items():
            object.__setattr__(self, name, read_only(value))
        object.__setattr__(self, "joint_names", names)
        object.__setattr__(self, "arms", owners)
        object.__setattr__(self, "stops", tuple(int(k) for k in self.stops))
        self._check_steps()
        self._check_segments()

    def _check_steps(self) -> None:
        """The steps are one after the other, from the first gridpoint to the last."""
        m, n = len(self.pieces), len(self.begins)
        size = self.ends - self.begins
        if n == 0 or self.begins[0] != 0 or self.ends[-1] != m or size[0] != 0:
            raise InputError("the steps of a route begin with rest at its first gridpoint, and end at its last")
        if not np.isin(size, (0, 1)).all() or (self.begins[1:] != self.ends[:-1]).any():
            raise InputError("the steps of a route do not follow each other")
        if (np.diff(self.times[1:]) < 0.0).any():
            raise InputError("the times of a route's steps decrease")
        expected = m in self.stops if m else not self.stops
        if not expected or list(self.stops) != sorted(set(self.stops)) or (m and not 0 < self.stops[0] <= m):
            raise InputError(f"stops of a route of {m} segments are ascending gridpoints up to {m}")

    def _check_segments(self) -> None:
        """The segments lie on their pieces, and one begins where that before ends."""
        ends = self.offsets + self.spans
        room = _SAME_PLACE * (1.0 + self.lengths[self.pieces])
        if (self.spans <= 0.0).any() or (self.offsets < -room).any() or (ends > self.lengths[self.pieces] + room).any():
            raise InputError("a segment of a route is not on its piece")
        first, last = self.at(self.pieces, self.offsets), self.at(self.pieces, ends)
        apart = np.abs(first - np.concatenate([self.start[None], last[:-1]])).max(initial=0.0) if len(first) else 0.0
        if apart > _SAME_PLACE:
            raise InputError(f"segments of a route are {apart:.2g} apart, expected each to begin where the last ended")

    def __repr__(self) -> str:
        return f"Route({', '.join(self.arms)}: {len(self.pieces)} segments, {len(self.begins)} steps)"

    @property
    def curve(self) -> Curve:
        """The unrolled path."""
        return Curve(self.lengths, self.coefficients, (0, 0))

    @property
    def grid(self) -> Grid:
        """Its segments."""
        return Grid(self.pieces, self.offsets, self.spans)

    @property
    def leave_times(self) -> Array:
        """When the plan leaves each step [s], shape (n,); the last is inf."""
        return np.append(self.times[1:], np.inf)

    def at(self, pieces: NDArray[np.int64], s: Array) -> Array:
        """Configurations at parameters of some pieces, shape (k, nq)."""
        c, s = self.coefficients[pieces], s[:, None]
        return np.asarray(c[:, 0] + s * (c[:, 1] + s * c[:, 2]))


def _indices(name: str, values: ArrayLike, size: int, count: int) -> NDArray[np.int64]:
    found = np.asarray(values)
    if found.shape != (size,) or (size and found.dtype.kind not in "iu"):
        raise InputError(f"{name} is no list of {size} whole numbers")
    if size and (found.min() < 0 or found.max() >= count):
        raise InputError(f"{name} has a number that is not in 0 .. {count - 1}")
    return found.astype(np.int64)


def route_of(schedule: Schedule) -> Route:
    """What an agent passes that moves by a schedule."""
    path = schedule.path
    nq = len(path.start)
    lengths, coefficients, pieces, offsets, spans = [], [], [], [], []
    visited, before = [0], 0
    for leg in schedule.legs:
        part = _unrolled(path, leg)
        lengths.append(part.lengths)
        coefficients.append(part.coefficients)
        pieces.append(part.pieces + before)
        offsets.append(part.offsets)
        spans.append(part.spans)
        before += len(part.lengths)
        step = 1 if leg.end > leg.begin else -1
        visited += list(range(leg.begin + step, leg.end + step, step))
    begins, ends, now = [0], [0], 0
    for leg in schedule.legs:
        count = abs(leg.end - leg.begin)
        begins += [*range(now, now + count), now + count]
        ends += [*range(now + 1, now + count + 1), now + count]
        now += count
    turns = np.diff(visited)
    last = len(visited) - 1
    stops = [k for k in range(1, last + 1) if k == last or turns[k - 1] != turns[k] or visited[k] in path.halts]
    return Route(
        path.agent.arms,
        path.agent.joint_names,
        path.start,
        np.concatenate([np.zeros(0), *lengths]),
        np.concatenate([np.zeros((0, 3, nq)), *coefficients]),
        np.concatenate([np.zeros(0, np.int64), *pieces]),
        np.concatenate([np.zeros(0), *offsets]),
        np.concatenate([np.zeros(0), *spans]),
        tuple(stops),
        np.array(begins),
        np.array(ends),
        schedule.occupancy.enter,
    )


@dataclass(frozen=True)
class _Unrolled:
    """Pieces and segments of one leg, in the order in which they are passed."""

    lengths: Array
    coefficients: Array
    pieces: NDArray[np.int64]
    offsets: Array
    spans: Array


def _unrolled(path: AgentPath, leg: Leg) -> _Unrolled:
    forward = leg.end > leg.begin
    at = np.arange(leg.begin, leg.end) if forward else np.arange(leg.begin - 1, leg.end - 1, -1)
    pieces, offsets, spans = path.grid.piece[at], path.grid.offset[at], path.grid.delta[at]
    first = int(pieces.min())
    part = slice(first, int(pieces.max()) + 1)
    lengths, c = path.curve.lengths[part], path.curve.coefficients[part]
    if forward:
        return _Unrolled(lengths, c, pieces - first, offsets, spans)
    whole = lengths[:, None]
    turned = np.stack(
        [c[:, 0] + whole * (c[:, 1] + whole * c[:, 2]), -(c[:, 1] + 2.0 * whole * c[:, 2]), c[:, 2]], axis=1
    )
    return _Unrolled(lengths, turned, pieces - first, path.curve.lengths[pieces] - offsets - spans, spans)
