"""The path of an agent: a smooth curve in segments, the fastest motion between any two stops, and its placed bodies.

A path is a polyline with rounded corners (`retiming/blends.py`). Timing is decided later, so the path itself never
changes: an agent may wait at a gridpoint, continue, or go back, but never leaves the curve.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from copy import copy
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.collision.checker import shifted_polynomial
from rr1plan.kernels.planner_kernels import CStruct
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.hop_timing import jerk_limited_line, times_along
from rr1plan.multi.paths.placed_path import NEVER, placed_configurations, placed_path
from rr1plan.object_cache import kept_in
from rr1plan.path import Path
from rr1plan.retiming.path_blends import Curve, CurveChecker, blend_sizes, clean, round_corners
from rr1plan.retiming.path_speed import NO_INTERVALS, Grid, fastest_speeds, hop_times, joined, timed
from rr1plan.retiming.timed_pieces import Pieces, concatenate
from rr1plan.retiming.torque_limits import check_gravity, torque_stretch

# Largest displacement of any point of the arms on a segment [m]: in the middle of a path, and at its ends, where other
# arms may be near; in between it grows by this share of the distance from the end.
_LONGEST, _SHORTEST, _GROWTH = 0.08, 0.006, 0.3
# Leaves of the interval tree per segment: a cell of a diagram is certified in the square of this number of parts.
_LEAVES = 4
# Inner gridpoints at which an agent may wait.
_STOPS = 12
_FEWEST = 2  # segments of a piece at least, so that a motion can begin and end on it
LARGEST_BLEND = 1.0
"""Largest size of a rounded corner [rad]."""
_SAME = 1e-9  # relative tolerance for equal path accelerations
# A motion is stretched by this factor more than its torques require.
_TORQUE_ROUNDING = 1e-3
# Gauss-Legendre quadrature of the length of a segment.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
# Far above the rounding of configurations [rad].
_ROUNDING = 1e-12
_NOT_PICKLED = ("placed", "placed_ends", "_times", "_whole_times")


class AgentPath:
    """A path of an agent.

    Args:
        agent: Its agent.
        path: The path of its arms.
        checker: Certifies rounded corners against stationary objects; None for a path without corners, or for an
            estimate of the duration, with corners as round as their edges allow.

    Attributes:
        curve: The rounded polyline, smooth except at `halts`.
        grid: Its segments.
        halts: Gridpoints at which the motion has to stop: corners that cannot be rounded.
        segments: Number of segments; 0 for an agent that does not move.

    Raises:
        RetimingError: a moving joint without a limit, or a gravity torque above a required effort limit.
    """

    def __init__(self, agent: Agent, path: Path, checker: CurveChecker | None) -> None:
        self.agent, self.path = agent, path
        self._limits_jerk = agent.timing.method == "ruckig"
        self._stretches: dict[tuple[int, int], float] = {}
        self._lines: dict[tuple[int, int], Pieces] = {}
        self._limited_times: dict[tuple[int, int], Array] = {}
        points = clean(path.waypoints)
        self.start, self.goal = path.waypoints[0], path.waypoints[-1]
        nq = points.shape[1]
        if len(points) == 1:
            self.curve = Curve(np.zeros(0), np.zeros((0, 3, nq)), (0, 0))
            self.grid = NO_INTERVALS
            self.halts: tuple[int, ...] = ()
            self.segments = 0
            return
        agent.check_limits(points)
        if agent.timing.torque_limits:
            check_gravity(points, path.joint_names, agent.limits.effort, agent.inverse_dynamics)
        rounded = agent.timing.method == "blend"
        sizes = blend_sizes(points, LARGEST_BLEND, checker) if rounded else np.zeros(len(points))
        lengths, coefficients, before = round_corners(points, sizes)
        self.curve = Curve(lengths.copy(), coefficients.copy(), (0, len(points) - 1))
        counts = self._segment_counts()
        self.grid = even_grid(lengths, counts)
        self.segments = int(counts.sum())
        first = np.concatenate([[0], np.cumsum(counts)])
        corners = np.flatnonzero(sizes[1:-1] == 0.0) + 1
        self.halts = tuple(int(first[before[i]]) for i in corners)

    @classmethod
    def chained(cls, paths: Sequence[AgentPath]) -> AgentPath:
        """Concatenated paths of an agent, with stops at the joints; each path is unchanged to the last bit.

        Args:
            paths: The paths, none of length zero; each begins where the previous one ends.
        """
        chain = cls.__new__(cls)
        chain.agent = paths[0].agent
        waypoints = np.concatenate([paths[0].path.waypoints, *(part.path.waypoints[1:] for part in paths[1:])])
        chain.path = Path(paths[0].path.joint_names, waypoints)
        chain._limits_jerk, chain._stretches = paths[0]._limits_jerk, {}
        chain._lines, chain._limited_times = {}, {}
        chain.start, chain.goal = paths[0].start, paths[-1].goal
        chain.curve, chain.grid = joined([(part.curve, part.grid) for part in paths])
        joints = np.cumsum([0, *(part.segments for part in paths)]).tolist()
        inner = [first + halt for part, first in zip(paths, joints, strict=False) for halt in part.halts]
        chain.segments = joints[-1]
        chain.halts = tuple(sorted({*joints[1:-1], *inner}))
        chain.__dict__["stops"] = tuple(joints)
        return chain

    def of(self, agent: Agent) -> AgentPath:
        """The same path of another agent with the same arms, start and timing."""
        path = copy(self)
        path.agent = agent
        return path

    def __repr__(self) -> str:
        return f"AgentPath({', '.join(self.agent.arms)}: {self.segments} segments)"

    def __getstate__(self) -> dict[str, object]:
        """The path without memory of kernels, and without times of hops, which are quickly recomputed."""
        return {name: value for name, value in self.__dict__.items() if name not in _NOT_PICKLED}

    @cached_property
    def lengths(self) -> Array:
        """Euclidean length in joint space up to each gridpoint [rad], shape (gridpoints,)."""
        return np.asarray(self._lengths([slice(None)])[0])

    @cached_property
    def lengths_of_arms(self) -> Array:
        """Length of each arm's own path up to each gridpoint [rad], shape (arms, gridpoints)."""
        return self._lengths(self.agent.columns.values())

    def _lengths(self, groups: Iterable[slice]) -> Array:
        """Length in each of some groups of joints up to each gridpoint [rad], shape (groups, gridpoints)."""
        # The parameter of a rounded corner is the length of the polyline, which is longer.
        c, half = self.curve.coefficients[self.grid.piece], 0.5 * self.grid.delta
        s = self.grid.offset + half + half * _NODES[:, None]
        rates = c[:, 1] + 2.0 * s[..., None] * c[:, 2]
        speeds = np.stack([np.linalg.norm(rates[..., own], axis=2) for own in groups])
        return np.pad(np.cumsum(half * (_WEIGHTS @ speeds), axis=1), ((0, 0), (1, 0)))

    def _segment_counts(self) -> NDArray[np.int64]:
        """Number of segments of each piece of the curve."""
        c, lengths = self.curve.coefficients, self.curve.lengths
        speed = (np.abs(c[:, 1] + c[:, 2] * lengths[:, None]) * self.agent.reach).sum(axis=1)
        borders = np.concatenate([[0.0], np.cumsum(lengths * speed)])
        wanted = np.diff(segments_up_to(borders))
        return np.asarray(np.maximum(np.ceil(wanted), _FEWEST), np.int64)

    # ---- motion ------------------------------------------------------------------------

    @cached_property
    def stops(self) -> tuple[int, ...]:
        """Gridpoints at which the agent may wait: both ends, and some evenly spread between them."""
        spread = np.unique(np.linspace(0, self.segments, _STOPS + 2).round().astype(np.int64))
        return tuple(spread.tolist())

    @cached_property
    def _times(self) -> Array:
        """Times of the motions from each stop to each later one, shape (stops, stops, gridpoints)."""
        count = len(self.stops)
        begin, end = np.triu_indices(count, 1)
        stops = np.array(self.stops)
        times = np.zeros((count, count, self.segments + 1))
        times[begin, end] = self._hops(stops[begin], stops[end])
        return times

    def _hops(self, begin: NDArray[np.int64], end: NDArray[np.int64]) -> Array:
        """Times of motions from rest to rest, shape (motions, gridpoints)."""
        halts = np.zeros(self.segments + 1, np.int64)
        halts[list(self.halts)] = 1
        return np.asarray(hop_times(self.curve, self.grid, self.agent.limits, halts, begin, end))

    def hop_times(self, begin: int, end: int) -> Array:
        """Times of the fastest motion from rest at one stop to rest at another, at each gridpoint in between [s].

        Args:
            begin: A gridpoint of `stops`.
            end: Another one; if it is smaller, the motion goes back.
        """
        if begin == end:
            return np.zeros(1)
        if begin < end:
            return np.asarray(self._forward_times(begin, end) * self._stretch(begin, end))
        forward = self._forward_times(end, begin) * self._stretch(end, begin)
        return np.asarray((forward[-1] - forward)[::-1])

    def _forward_times(self, begin: int, end: int) -> Array:
        """Times of the motion from rest at one stop to rest at a later one, without torque limits [s]."""
        if end - begin == self.segments:
            return self._whole_times
        # Jerk-limited ones take too long to compute all of them.
        if self._limits_jerk:
            return kept_in(self._limited_times, (begin, end), lambda: self._jerk_limited_times(begin, end))
        return np.asarray(self._times[self.stops.index(begin), self.stops.index(end), begin : end + 1])

    def hop_duration(self, begin: int, end: int) -> float:
        """Duration of a hop [s]."""
        if begin == end:
            return 0.0
        begin, end = min(begin, end), max(begin, end)
        if end - begin == self.segments:
            return self.fastest
        return float(self._forward_times(begin, end)[-1] * self._stretch(begin, end))

    def hop(self, begin: int, end: int) -> Pieces:
        """The fastest motion from rest at a gridpoint to rest at another, forward or back."""
        if begin > end:
            return _reversed(self.hop(end, begin))
        if begin == end:
            return Pieces(np.zeros(1), self.at(begin)[None, None])
        pieces, factor = self._within_rates(begin, end), self._stretch(begin, end)
        return pieces if factor == 1.0 else pieces.stretched(factor)

    def _stretch(self, begin: int, end: int) -> float:
        """Factor by which torque limits stretch a hop from a gridpoint to a later one; the same for the way back."""
        if not self.agent.timing.torque_limits:
            return 1.0
        if (begin, end) not in self._stretches:
            agent, pieces = self.agent, self._within_rates(begin, end)
            factor = torque_stretch(pieces, agent.joint_names, agent.limits.effort, agent.inverse_dynamics)
            self._stretches[begin, end] = factor * (1.0 + _TORQUE_ROUNDING) if factor > 1.0 else 1.0
        return self._stretches[begin, end]

    def _within_rates(self, begin: int, end: int) -> Pieces:
        """The fastest motion from a gridpoint to a later one within the limits of velocity, acceleration and jerk."""
        return concatenate([self._between(a, b) for a, b in self._legs(begin, end)])

    def _legs(self, begin: int, end: int) -> Iterable[tuple[int, int]]:
        """Intervals from a gridpoint to a later one, split at the halts between them."""
        return pairwise([begin, *(k for k in self.halts if begin < k < end), end])

    def _jerk_limited_times(self, begin: int, end: int) -> Array:
        times, now = [np.zeros(1)], 0.0
        for a, b in self._legs(begin, end):
            distances = np.concatenate([[0.0], np.cumsum(self.grid.delta[a:b])])
            direction = self.curve.coefficients[self.grid.piece[a], 1]
            leg = now + times_along(self._line(a, b), direction, distances)
            times.append(leg[1:])
            now = float(leg[-1])
        return np.concatenate(times)

    def _line(self, begin: int, end: int) -> Pieces:
        """The jerk-limited motion between two gridpoints of one straight line."""
        if (begin, end) not in self._lines:
            direction = self.curve.coefficients[self.grid.piece[begin], 1]
            length = float(self.grid.delta[begin:end].sum())
            self._lines[begin, end] = jerk_limited_line(self.at(begin), direction, length, self.agent.limits)
        return self._lines[begin, end]

    def _between(self, begin: int, end: int) -> Pieces:
        if self._limits_jerk:
            return self._line(begin, end)
        grid = self.grid.part(begin, end)
        if end - begin == 1:
            half = 0.5 * grid.delta[0]
            grid = Grid(grid.piece.repeat(2), grid.offset[0] + np.array([0.0, half]), np.array([half, half]))
        x = fastest_speeds(self.curve, grid, self.agent.limits)
        return _merged(timed(self.curve, grid, x), grid, x, self.curve).within(self.agent.limits)

    def at(self, gridpoint: int) -> Array:
        """Configuration of the agent at a gridpoint, shape (nq,)."""
        if gridpoint == 0:
            return np.asarray(self.start)
        if gridpoint == self.segments:
            return np.asarray(self.goal)
        c, s = self.curve.coefficients[self.grid.piece[gridpoint]], self.grid.offset[gridpoint]
        return np.asarray(c[0] + s * (c[1] + s * c[2]))

    @cached_property
    def fastest(self) -> float:
        """Duration of the motion without waiting [s]."""
        if self.segments == 0:
            return 0.0
        return float(self._whole_times[-1] * self._stretch(0, self.segments))

    @cached_property
    def _whole_times(self) -> Array:
        """Times of the motion from the start to the goal, without torque limits [s], shape (gridpoints,)."""
        # Computed separately, because a path that no other one meets needs no other hop.
        if self._limits_jerk:
            return self._jerk_limited_times(0, self.segments)
        return np.asarray(self._hops(np.array([0]), np.array([self.segments]))[0])

    # ---- rows of coordination diagrams -----------------------------------------------------

    @property
    def cells(self) -> int:
        """Number of rows of its coordination diagrams: the start, each segment, the goal."""
        return self.segments + 2

    @cached_property
    def placed(self) -> CStruct:
        """The bodies at each interval of the path (`coordination.h`)."""
        return self._placed(NEVER)

    def place(self, stop: NDArray[np.int64]) -> bool:
        """Compute `placed` unless a flag (1,) is set before it is complete; returns whether it was not."""
        if "placed" not in self.__dict__:
            placed = self._placed(stop)
            if stop[0]:
                return False
            self.__dict__["placed"] = placed
        return True

    def _placed(self, stop: NDArray[np.int64]) -> CStruct:
        bodies, nq = self.agent.bodies, self.agent.bodies.columns
        count = self.segments * _LEAVES
        leaves = 1 << max(0, (count - 1).bit_length())
        nodes = 2 * leaves + 2
        q, reach = np.zeros((nodes, nq)), np.zeros((nodes, nq))
        empty = np.ones(nodes, np.int64)
        cell = np.zeros(leaves + 2, np.int64)
        if count:
            self._fill_leaves(q[leaves : leaves + count], reach[leaves : leaves + count])
            empty[leaves : leaves + count] = 0
            cell[:count] = np.repeat(np.arange(1, self.segments + 1), _LEAVES)
            _fill_tree(q, reach, empty, leaves)
        q[-2], q[-1] = self.start, self.goal
        empty[-2:] = 0
        cell[-2:] = 0, self.segments + 1
        return placed_path(bodies, q, reach, empty, cell, stop)

    @cached_property
    def placed_ends(self) -> CStruct:
        """The bodies at the start and at the goal, as a path of two intervals of zero length."""
        return placed_configurations(self.agent.bodies, np.stack([self.start, self.goal]))

    @property
    def placed_bytes(self) -> int:
        """Memory that the placed bodies take [bytes]; 0 if they are not placed."""
        placed = self.__dict__.get("placed")
        return 0 if placed is None else sum(placed.part(each).nbytes for each in ("poses", "centers", "travel"))

    def release(self) -> None:
        """Free the placed bodies, most of the memory of a path; they are recomputed on demand."""
        self.__dict__.pop("placed", None)
        self.__dict__.pop("placed_ends", None)

    def _fill_leaves(self, q: Array, reach: Array) -> None:
        """The configuration in the middle of each leaf, and the largest deviation of each column from it."""
        part = np.arange(_LEAVES)
        half = np.repeat(0.5 * self.grid.delta / _LEAVES, _LEAVES)[:, None]
        s = (self.grid.offset[:, None] + self.grid.delta[:, None] * (part + 0.5) / _LEAVES).reshape(-1, 1)
        c = self.curve.coefficients[np.repeat(self.grid.piece, _LEAVES)]
        q[:] = c[:, 0] + s * (c[:, 1] + s * c[:, 2])
        rate = np.abs(c[:, 1] + 2.0 * s * c[:, 2])
        reach[:] = rate * half + np.abs(c[:, 2]) * half**2
        reach += _ROUNDING * (1.0 + np.abs(c).sum(axis=1))

    @property
    def has_boxes(self) -> bool:
        """Whether `boxes` are known, for which the bodies have to be placed."""
        return "boxes" in self.__dict__

    @cached_property
    def boxes(self) -> Array:
        """Low and high corner of a box around the swept volume of each body of the agent [m], shape (bodies, 6)."""
        targets = self.placed.targets
        bodies = len(self.agent.bodies.elements)
        used = targets["is_empty"] == 0
        used[1 : targets["is_empty"].shape[0] // 2 - 1] = False  # all nodes except leaves and ends
        centers = targets["centers"].reshape(len(used), bodies, 3)[used]
        reach = targets["travel"].reshape(len(used), bodies)[used] + self.agent.bodies.tables.body_values[:, 15]
        low, high = centers - reach[..., None], centers + reach[..., None]
        return np.concatenate([low.min(axis=0), high.max(axis=0)], axis=1)


def segments_up_to(moved: Array) -> Array:
    """Number of segments that a path should have up to some points on it, with fractions, shape (n,).

    Args:
        moved: Displacement of the bodies up to each point [m], ascending from 0 to the end of the path, shape (n,).
    """
    far = np.linspace(0.0, moved[-1], 400)
    spacing = np.clip(_SHORTEST + _GROWTH * np.minimum(far, moved[-1] - far), _SHORTEST, _LONGEST)
    number = np.concatenate([[0.0], np.cumsum(np.diff(far) / (0.5 * (spacing[1:] + spacing[:-1])))])
    return np.asarray(np.interp(moved, far, number))


def even_grid(lengths: Array, counts: NDArray[np.int64]) -> Grid:
    """The grid that divides each piece of a curve into segments of equal length."""
    piece = np.repeat(np.arange(len(lengths)), counts)
    delta = np.repeat(lengths / counts, counts)
    number = np.arange(len(piece)) - np.repeat(np.cumsum(counts) - counts, counts)
    return Grid(piece, number * delta, delta)


def _fill_tree(q: Array, reach: Array, empty: NDArray[np.int64], leaves: int) -> None:
    """Boxes in joint space around the two halves of each node above the leaves."""
    low, high = q - reach, q + reach
    level = leaves // 2
    while level >= 1:
        nodes = np.arange(level, 2 * level)
        one, two = 2 * nodes, 2 * nodes + 1
        empty[nodes] = empty[one]
        low[nodes] = np.where(empty[two, None] == 1, low[one], np.minimum(low[one], low[two]))
        high[nodes] = np.where(empty[two, None] == 1, high[one], np.maximum(high[one], high[two]))
        level //= 2
    inner = slice(1, leaves)
    q[inner] = 0.5 * (low[inner] + high[inner])
    reach[inner] = 0.5 * (high[inner] - low[inner]) + _ROUNDING * (1.0 + np.abs(q[inner]))


def _merged(pieces: Pieces, grid: Grid, x: Array, curve: Curve) -> Pieces:
    """Join consecutive pieces on a straight line that have the same path acceleration."""
    gain = np.diff(x) / grid.delta
    bent = curve.coefficients[grid.piece, 2].any(axis=1)
    scale = _SAME * max(float(np.abs(gain).max()), 1e-12)
    goes_on = (np.abs(np.diff(gain)) <= scale) & (grid.piece[1:] == grid.piece[:-1]) & ~bent[1:]
    first = np.flatnonzero(np.concatenate([[True], ~goes_on]))
    durations, coefficients = np.add.reduceat(pieces.durations, first), pieces.coefficients[first].copy()
    # Computed from both ends, so that it ends exactly where the next one begins, however long it is.
    last = np.append(first[1:], len(grid.delta))
    joined = np.flatnonzero(last - first > 1)
    length, direction = np.add.reduceat(grid.delta, first)[joined], curve.coefficients[grid.piece[first[joined]], 1]
    begin, end = x[first[joined]], x[last[joined]]
    speed = np.sqrt(begin)
    durations[joined] = 2.0 * length / (speed + np.sqrt(end))
    coefficients[joined, 1] = speed[:, None] * direction
    coefficients[joined, 2] = (0.25 * (end - begin) / length)[:, None] * direction
    return Pieces(durations, coefficients)


def _reversed(pieces: Pieces) -> Pieces:
    """The same motion backward."""
    # From the end of each piece, odd powers with the other sign.
    turned = shifted_polynomial(pieces.coefficients, pieces.durations[:, None])
    turned[:, 1::2] *= -1.0
    return Pieces(pieces.durations[::-1].copy(), turned[::-1].copy())
