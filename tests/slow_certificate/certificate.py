"""The continuous-time collision certificate of a piecewise polynomial motion.

A pair of bodies with clearance c at one time is free as long as the two cannot approach each other by c.
The displacement of each within an interval is bounded by the exact range of every joint there
(Bernstein coefficients) and its distance to the joints' axes. If this does not decide,
the interval is halved. There is no sampling step: a contact of any duration is found, and
pairs that remain closer than a micrometer are undecided, never free. All times of one round are
processed together in numpy; Coal measures only the pairs that bounding volumes leave open.

Tests compare the referee's compiled search with it on all pairs.

Schwarzer, Saha, Latombe (2005), Adaptive dynamic collision checking, IEEE T-RO 21.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from rr1plan.checks import Array
from slow_certificate.certificate_bodies import Bodies
from slow_certificate.polynomial_bounds import Index, Mask
from slow_certificate.scene_motion import SceneMotion

# A clearance below this cannot be distinguished from contact [m].
TOUCH = 1e-6
# Accuracy of the time of first contact [s].
_TIME_STEP = 1e-5
_MOST_NODES = 1024
# A smallest clearance is sharp if those around it differ by less than this fraction of the tolerance.
_POLISHED = 1e-3
# Refinement of the times of smallest clearances: most pairs, first steps in the whole motion, most steps after those.
_MOST_POLISHED, _POLISH_STEPS, _POLISH_ROUNDS = 64, 256, 40


class Intervals(NamedTuple):
    """Open intervals of time and the pairs of shapes still open on each.

    Args:
        first, stop: Pieces first <= i < stop, each (n,).
        start, end: Local times [s] where the run is a single piece, each (n,).
        node: Interval of each open pair, shape (k,).
        item: The open pairs of shapes, shape (k,).
    """

    first: Index
    stop: Index
    start: Array
    end: Array
    node: Index
    item: Index


class Nearest(NamedTuple):
    """The smallest clearance of some pairs at one time: its value [m], its pair or -1, the time [s]."""

    clearance: float
    pair: int
    time: float


@dataclass
class Findings:
    """Results of the certificate for each pair of elements.

    Args:
        clearance: Smallest clearance seen [m], shape (pairs,); inf for pairs that never came near.
        time: Time of the smallest clearance [s], shape (pairs,).
        first_contact: First time found in contact [s], shape (pairs,); inf for none.
        undecided: Pairs with an undecided interval, shape (pairs,).
        proven: Proven lower bound of the clearance of pairs that are not undecided [m], shape (pairs,).
        cancelled: Whether the search was cancelled, with the rest left undecided.
        statistics: Counts of the work done.
    """

    clearance: Array
    time: Array
    first_contact: Array
    undecided: Array
    proven: Array
    cancelled: bool = False
    statistics: dict[str, float] = field(default_factory=dict)


class Certificate:
    """The search for contacts of all pairs over the whole motion.

    Args:
        motion: The motion.
        bodies: The bodies and pairs.
        tolerance: The smallest clearance reported is within this of the true one [m].
        most_distances: Largest number of exact distances; pairs still open after them are undecided.
        progress: Called with the fraction decided after each round; False cancels the search.
        items: The pairs of shapes to decide (default: all).
        smallest: Known upper bounds of the smallest clearance with the surroundings and within one arm [m], shape (2,).
        first: Known times of first contact [s], inf for pairs without known contact, shape (pairs,).
    """

    def __init__(
        self,
        motion: SceneMotion,
        bodies: Bodies,
        tolerance: float,
        most_distances: int,
        progress: Callable[[float], bool | None] | None = None,
        items: Index | None = None,
        smallest: Array | None = None,
        first: Array | None = None,
    ) -> None:
        self._motion, self._bodies = motion, bodies
        self._tolerance, self._most = tolerance, most_distances
        self._progress = progress
        n = len(bodies.padding)
        self.found = Findings(
            np.full(n, np.inf), np.zeros(n), np.full(n, np.inf), np.zeros(n, dtype=bool), np.full(n, np.inf)
        )
        self._known = np.full(2, np.inf) if smallest is None else smallest
        self._first = np.full(n, np.inf) if first is None else first
        self._items = np.arange(len(bodies.a)) if items is None else items
        self._nodes = self._checks = 0
        self._decided = 0.0

    def run(self) -> Findings:
        """Decide every pair on every interval."""
        bodies, found = self._bodies, self.found
        if len(self._items):
            self.nearest(self._motion.breaks[[0, -1]], self._items)
            waiting = deque([self._root()])
            while waiting and not found.cancelled:
                if bodies.calls > self._most:
                    self._give_up(waiting)
                    break
                waiting.extend(_chunks(self._round(waiting.popleft())))
            self._polish()
            touching = np.isfinite(found.first_contact)
            np.minimum(found.first_contact, self._first, out=found.first_contact, where=touching)
        counts = {"intervals": self._nodes, "pair_checks": self._checks, "distances": bodies.calls}
        found.statistics |= {name: float(count) for name, count in counts.items()}
        return found

    def _root(self) -> Intervals:
        one = np.zeros(1, dtype=np.intp)
        return Intervals(
            one,
            np.array([self._motion.pieces]),
            np.zeros(1),
            self._motion.widths[:1],
            np.zeros(len(self._items), dtype=np.intp),
            self._items,
        )

    # ---- one round ------------------------------------------------------------------------

    def _round(self, work: Intervals) -> Intervals:
        """Decide open pairs if possible. Returns the halves of the other intervals."""
        motion, bodies = self._motion, self._bodies
        self._nodes += len(work.first)
        self._checks += len(work.item)
        begin, finish = self._span(work)
        piece, local = self._middle(work, begin, finish)
        times = motion.breaks[piece] + local
        q = motion.positions(piece, local)
        lower, upper = motion.ranges(work.first, work.stop, work.start, work.end)
        change = np.maximum(upper - q, q - lower)[:, motion.column] * motion.gain
        frames = motion.frames(q)
        placed = bodies.place(frames)
        approach = bodies.approach(bodies.sweeps(frames, placed, change), work.node, work.item)
        proven = np.full(len(work.item), -np.inf)
        open_ = np.arange(len(work.item))
        for bound in (bodies.far_bound, bodies.box_bound):
            proven[open_] = np.maximum(proven[open_], bound(placed, work.node[open_], work.item[open_]))
            open_ = open_[~self._settled(work, begin, proven, approach)[open_]]
        if len(open_):
            value, proven[open_] = bodies.clearances(placed, work.node[open_], work.item[open_])
            self._see(bodies.pair[work.item[open_]], value, times[work.node[open_]])
            open_ = open_[~self._settled(work, begin, proven, approach)[open_]]
        open_ = self._drop_points(work, open_, begin, finish)
        settled = np.ones(len(work.item), dtype=bool)
        settled[open_] = False
        self._account(work, settled, proven - approach, begin, finish)
        return self._split(work, open_)

    def _span(self, work: Intervals) -> tuple[Array, Array]:
        """First and last instant of each interval [s]."""
        breaks = self._motion.breaks
        single = work.stop - work.first == 1
        last = np.minimum(work.stop, len(breaks) - 1)
        begin = breaks[work.first] + np.where(single, work.start, 0.0)
        return begin, np.where(single, breaks[work.first] + work.end, breaks[last])

    def _middle(self, work: Intervals, begin: Array, finish: Array) -> tuple[Index, Array]:
        """Piece and local time in the middle of each interval."""
        piece, local = self._motion.locate(0.5 * (begin + finish))
        single = work.stop - work.first == 1
        return np.where(single, work.first, piece), np.where(single, 0.5 * (work.start + work.end), local)

    def _see(self, pair: Index, value: Array, time: Array) -> None:
        """Record clearances (k,) of pairs of elements (k,) at times (k,)."""
        found = self.found
        order = np.lexsort((-value, pair))
        last = order[np.append(np.diff(pair[order]) > 0, True)]
        better = last[value[last] < found.clearance[pair[last]]]
        found.clearance[pair[better]], found.time[pair[better]] = value[better], time[better]
        touching = value <= TOUCH
        np.minimum.at(found.first_contact, pair[touching], time[touching])

    def _settled(self, work: Intervals, begin: Array, proven: Array, approach: Array) -> Mask:
        """Whether open pairs (k,) are settled on their interval."""
        found = self.found
        pair = self._bodies.pair[work.item]
        least = proven - approach
        contact = np.isfinite(found.first_contact)[pair]
        smallest = self._smallest()[self._bodies.own[pair].astype(np.intp)]
        free = (least > 0.0) & (least >= smallest - self._tolerance)
        worst = found.clearance[pair]
        no_worse = least >= worst - np.maximum(self._tolerance, 0.05 * np.abs(np.where(contact, worst, 0.0)))
        before = (begin[work.node] < found.first_contact[pair]) & np.isinf(self._first[pair])
        return np.asarray(np.where(contact, no_worse & ((least > 0.0) | ~before), free))

    def _smallest(self) -> Array:
        """Smallest clearance found with the surroundings and within one arm [m], shape (2,).

        Once a contact is found, only contacts are searched for.
        """
        own, clearance = self._bodies.own, self.found.clearance
        each = np.array([clearance[~own].min(initial=self._known[0]), clearance[own].min(initial=self._known[1])])
        return each if each.min() > TOUCH else np.minimum(each, each.min())

    def _drop_points(self, work: Intervals, open_: Index, begin: Array, finish: Array) -> Index:
        """Drop open pairs whose interval is too short to halve; pairs without a known contact become undecided."""
        found = self.found
        node, pair = work.node[open_], self._bodies.pair[work.item[open_]]
        width = finish[node] - begin[node]
        contact = np.isfinite(found.first_contact)[pair]
        smallest = 4e-16 * np.maximum(1.0, np.abs(finish[node]))
        lost = ~contact & (width <= smallest)
        found.undecided[pair[lost]] = True
        known = contact & (width <= _TIME_STEP)
        return open_[~(lost | known)]

    def _account(self, work: Intervals, settled: Array, least: Array, begin: Array, finish: Array) -> None:
        """Record the clearance proven on settled intervals, and the fraction of the motion that is settled."""
        found = self.found
        pair = self._bodies.pair[work.item[settled]]
        np.minimum.at(found.proven, pair, least[settled])
        self._decided += float((finish - begin)[work.node[settled]].sum())
        if self._progress is not None:
            total = float(self._motion.breaks[-1] - self._motion.breaks[0]) * len(self._items)
            fraction = min(1.0, self._decided / total) if total > 0.0 else 1.0
            found.cancelled = self._progress(fraction) is False

    def _split(self, work: Intervals, open_: Index) -> Intervals:
        """The halves of the intervals on which pairs are open."""
        used, node = np.unique(work.node[open_], return_inverse=True)
        first, stop = work.first[used], work.stop[used]
        start, end = work.start[used], work.end[used]
        breaks, widths = self._motion.breaks, self._motion.widths
        single = stop - first == 1
        last = np.minimum(stop, len(breaks) - 1)
        near = np.searchsorted(breaks, 0.5 * (breaks[first] + breaks[last]))
        cut = np.where(single, first, np.clip(near, first + 1, np.maximum(stop - 1, first + 1)))
        middle = 0.5 * (start + end)
        one, two = np.zeros_like(start), widths[np.minimum(first, len(widths) - 1)]
        left = (first, np.where(single, stop, cut), np.where(single, start, one), np.where(single, middle, two))
        right = (cut, stop, np.where(single, middle, one), np.where(single, end, widths[cut]))
        parts = [np.concatenate(both) for both in zip(left, right, strict=True)]
        nodes = np.concatenate([node, node + len(used)])
        return Intervals(parts[0], parts[1], parts[2], parts[3], nodes, np.tile(work.item[open_], 2))

    def _give_up(self, waiting: deque[Intervals]) -> None:
        for work in waiting:
            self.found.undecided[self._bodies.pair[work.item]] = True

    # ---- single times ---------------------------------------------------------------------

    def nearest(self, times: Array, items: Index) -> list[Nearest]:
        """The smallest clearance of some pairs of shapes at each time [s]."""
        bodies, motion = self._bodies, self._motion
        piece, local = motion.locate(times)
        placed = bodies.place(motion.frames(motion.positions(piece, local)))
        best, which = np.full(len(times), np.inf), np.full(len(times), -1, dtype=np.intp)
        for n in range(len(times)):
            node = np.full(len(items), n, dtype=np.intp)
            bound = np.maximum(bodies.far_bound(placed, node, items), bodies.box_bound(placed, node, items))
            order = np.argsort(bound)
            for chunk in np.array_split(order, max(1, len(order) // 8)):
                near = chunk[bound[chunk] < max(best[n], TOUCH)]
                if not len(near):
                    break
                value, _ = bodies.clearances(placed, node[near], items[near])
                self._see(bodies.pair[items[near]], value, np.full(len(near), times[n]))
                if value.min() < best[n]:
                    best[n], which[n] = value.min(), bodies.pair[items[near[np.argmin(value)]]]
        return [Nearest(*found) for found in zip(best.tolist(), which.tolist(), times.tolist(), strict=True)]

    def _polish(self) -> None:
        """Refine time and value of the smallest clearance of each group and of each pair in contact."""
        found = self.found
        chosen = set(np.flatnonzero(np.isfinite(found.first_contact)).tolist())
        for own in (False, True):
            members = np.flatnonzero((self._bodies.own == own) & np.isfinite(found.clearance))
            if len(members):
                chosen.add(int(members[np.argmin(found.clearance[members])]))
        pairs = np.array(sorted(chosen)[:_MOST_POLISHED], dtype=np.intp)
        begin, finish = float(self._motion.breaks[0]), float(self._motion.breaks[-1])
        if not len(pairs) or not finish > begin:
            return
        # Columns: times before, at and after the smallest value seen, and the clearances then.
        offsets = (finish - begin) / _POLISH_STEPS * np.arange(-2.0, 3.0)
        times = np.clip(found.time[pairs, None] + offsets, begin, finish)
        values = self._measure(np.repeat(pairs, 5), times.ravel()).reshape(times.shape)
        best = np.clip(np.argmin(values, axis=1), 1, 3)[:, None] + np.arange(-1, 2)
        times, values = np.take_along_axis(times, best, 1), np.take_along_axis(values, best, 1)
        open_ = np.arange(len(pairs))
        for step in range(_POLISH_ROUNDS):
            precise = values[open_].max(axis=1) - values[open_].min(axis=1) <= _POLISHED * self._tolerance
            open_ = open_[~precise & (times[open_, 2] - times[open_, 0] > 1e-7 * (finish - begin))]
            if not len(open_):
                return
            at = _next_time(times[open_], values[open_], step % 3 == 2)
            value = self._measure(pairs[open_], at)
            times[open_], values[open_] = _narrowed(times[open_], values[open_], at, value)

    def _measure(self, pairs: Index, times: Array) -> Array:
        """The clearances of pairs of elements (k,) at times (k,) [m]."""
        motion, bodies = self._motion, self._bodies
        piece, local = motion.locate(times)
        placed = bodies.place(motion.frames(motion.positions(piece, local)))
        order = np.argsort(bodies.pair, kind="stable")
        low, high = (np.searchsorted(bodies.pair[order], pairs, side) for side in ("left", "right"))
        node = np.repeat(np.arange(len(pairs)), high - low)
        item = order[np.concatenate([np.arange(*ends) for ends in zip(low, high, strict=True)])]
        bound = np.maximum(bodies.far_bound(placed, node, item), bodies.box_bound(placed, node, item))
        # Only shapes of a pair that may be nearest at that time count; for a pair in contact, most are not.
        least = np.full(len(pairs), np.inf)
        for nearest_first in (True, False):
            lowest = np.full(len(pairs), np.inf)
            np.minimum.at(lowest, node, bound)
            chosen = np.flatnonzero((bound == lowest[node]) if nearest_first else (bound < least[node]))
            if len(chosen):
                value, _ = bodies.clearances(placed, node[chosen], item[chosen])
                self._see(bodies.pair[item[chosen]], value, times[node[chosen]])
                np.minimum.at(least, node[chosen], value)
                bound[chosen] = np.inf
        return least


def _next_time(times: Array, values: Array, wide: bool) -> Array:
    """Where to measure between three times (k, 3), of which the middle one has the smallest value, shape (k,).

    The lowest point of the parabola through them, or, if that is not better than the middle one or with `wide`, the
    golden section of the longer side.
    """
    (low, at, high), (below, here, above) = times.T, values.T
    left, right = at - low, high - at
    golden = np.where(right > left, 0.382 * right, -0.382 * left)
    bend = (above - here) * left + (below - here) * right
    with np.errstate(divide="ignore", invalid="ignore"):
        move = 0.5 * ((below - here) * right**2 - (above - here) * left**2) / bend
    usable = (bend > 0.0) & np.isfinite(move) & (move > -left) & (move < right) & (move != 0.0)
    # Almost converged: the farther end moves closer.
    short = np.abs(move) < 0.02 * np.maximum(left, right)
    move = np.where(short, np.sign(golden) * np.maximum(4.0 * np.abs(move), 0.01 * np.maximum(left, right)), move)
    return np.asarray(at + np.where(usable & np.logical_not(wide), move, golden))


def _narrowed(times: Array, values: Array, at: Array, value: Array) -> tuple[Array, Array]:
    """Three times (k, 3) that bracket the smallest of their values and of one more value between them."""
    times, values = np.column_stack([times, at]), np.column_stack([values, value])
    order = np.argsort(times, axis=1)
    times, values = np.take_along_axis(times, order, 1), np.take_along_axis(values, order, 1)
    best = np.clip(np.argmin(values, axis=1), 1, 2)[:, None] + np.arange(-1, 2)
    return np.take_along_axis(times, best, 1), np.take_along_axis(values, best, 1)


def _chunks(work: Intervals) -> list[Intervals]:
    """The same work in chunks that fit into memory."""
    count = len(work.first)
    parts = []
    for low in range(0, count, _MOST_NODES):
        high = min(count, low + _MOST_NODES)
        at = (work.node >= low) & (work.node < high)
        first, stop, start, end = work.first[low:high], work.stop[low:high], work.start[low:high], work.end[low:high]
        parts.append(Intervals(first, stop, start, end, work.node[at] - low, work.item[at]))
    return parts
