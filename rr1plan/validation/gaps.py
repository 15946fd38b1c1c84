"""How near two bodies of a scene can come on an interval of time, compiled: the cheap bounds first.

A pair is settled on an interval when it provably stays apart there, and no nearer than the smallest clearance
seen in its group less a tolerance.
"""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

from rr1plan.validation.apart import MIDDLE, ORIGIN, PLANE, RADIUS, ROUND, part_bodies, reach
from rr1plan.validation.compiled import part
from rr1plan.validation.sweeping import box_gap, expand, move_links, place, steady_reach, unsteadiness

# Columns of `pairs` (k, 7): bodies, their pair of elements, joints of their chains that carry both,
# the last joint of each body or -1, 1 where one arm owns both; a half-space comes second.
A, B, PAIR, SHARED, LAST_A, LAST_B, GROUP = range(7)
# Pairs in two groups, whose smallest clearances are told apart: with the surroundings, and one arm's own.
GROUPS = 2
# Columns of `found` (pairs, 3): smallest clearance seen [m], its time [s], proven clearance [m].
SEEN, WHEN, PROVEN = range(3)
# Values of `marks` (pairs,).
FREE, LEFT, UNDECIDED = 0, 1, 2
# Places in `counts` (7,): open intervals, intervals, pairs on intervals, searches, stage, nearest pair of bodies of
# each group.
OPEN, INTERVALS, CHECKS, SEARCHES, STAGE, NEAREST = range(6)
COUNTS = NEAREST + GROUPS
START, SPLIT, DONE = range(3)
# Places in `amounts` (3,): time that is decided [s] summed over pairs of bodies, smallest clearance seen in each
# group [m].
DECIDED, SMALLEST = 0, 1
AMOUNTS = SMALLEST + GROUPS
# While bodies can come this much nearer [m], an interval that no direction could settle is halved unseen.
_COARSE = 0.01
# Of coordinates, summed over all that goes into a distance: what rounding can make of it.
_ROUNDING = 2e-14


class Tables(NamedTuple):
    """All that stays the same, and the scratch that poses are written to."""

    breaks: Any
    coefficients: Any
    lower: Any
    upper: Any
    steps: Any
    frames: Any
    joints: Any
    links: Any
    kinds: Any
    sizes: Any
    corners: Any
    chains: Any
    movers: Any
    pairs: Any
    padding: Any
    columns: Any
    state: Any
    placed: Any
    sweeps: Any
    known: Any
    share: Any
    scratch: Any


class Book(NamedTuple):
    """What is written down."""

    found: Any
    marks: Any
    counts: Any
    amounts: Any
    directions: Any


@part
def piece_at(t: Tables, time: float) -> int:
    """The piece of a time; the later one at a break."""
    low, high = 0, len(t.coefficients)
    while high - low > 1:
        middle = (low + high) // 2
        if t.breaks[middle] <= time:
            low = middle
        else:
            high = middle
    return low


@part
def pose(t: Tables, piece: int, local: float, half: float) -> None:
    """Write where all bodies are at a local time, and what the joints do within `half` of it."""
    expand(t.coefficients, piece, local, half, t.coefficients.shape[1] - 1, t.columns, t.scratch)
    move_links(t.steps, t.frames, t.columns, t.joints, t.links, t.state)
    for i in range(len(t.movers)):
        place(t.kinds, t.sizes, t.links, t.movers[i], t.placed)


@part
def pose_at(t: Tables, time: float) -> None:
    """Write where all bodies are at a time."""
    piece = piece_at(t, time)
    width = t.breaks[piece + 1] - t.breaks[piece] if len(t.breaks) > 1 else 0.0
    pose(t, piece, min(max(time - t.breaks[piece], 0.0), width), 0.0)


@part
def ball_gap(t: Tables, k: int) -> tuple[float, float]:
    """A lower bound of the clearance of pair k by its bounding balls [m], and what rounding is worth there."""
    a, b = t.pairs[k, A], t.pairs[k, B]
    far, apart = 0.0, 0.0
    for i in range(3):
        far += abs(t.placed[a, ORIGIN + i]) + abs(t.placed[b, ORIGIN + i])
        step = t.placed[b, MIDDLE + i] - t.placed[a, MIDDLE + i]
        apart += step * step
    if t.kinds[b, 0] == PLANE:
        rounding = _ROUNDING * (far + t.sizes[a, RADIUS] + abs(t.sizes[b, 3]))
        height = -t.sizes[b, 3]
        for i in range(3):
            height += t.sizes[b, i] * t.placed[a, MIDDLE + i]
        return height - t.sizes[a, RADIUS] - t.padding[k] - rounding, rounding
    rounding = _ROUNDING * (far + t.sizes[a, RADIUS] + t.sizes[b, RADIUS])
    return sqrt(apart) - t.sizes[a, RADIUS] - t.sizes[b, RADIUS] - t.padding[k] - rounding, rounding


@part
def boxes_gap(t: Tables, k: int) -> float:
    """The same by one body's bounding box and the other's ball [m]."""
    a, b = t.pairs[k, A], t.pairs[k, B]
    if t.kinds[b, 0] == PLANE:
        return -1e300
    one, two = box_gap(t.sizes, t.placed, a, b), box_gap(t.sizes, t.placed, b, a)
    best = -1e300
    if one > 0.0:
        best = one - t.sizes[b, RADIUS]
    if two > 0.0:
        best = max(best, two - t.sizes[a, RADIUS])
    return float(best - t.padding[k])


@part
def _gap_along(t: Tables, k: int, x: float, y: float, z: float) -> float:
    """Clearance of pair k along a direction from a to b [m]: a lower bound of it."""
    a, b = t.pairs[k, A], t.pairs[k, B]
    gap = -reach(t.kinds, t.sizes, t.corners, t.placed, a, x, y, z) - t.padding[k]
    if t.kinds[b, 0] == PLANE:
        for i in range(3):
            gap += t.sizes[b, i] * t.placed[a, ORIGIN + i]
        return float(gap - t.sizes[b, 3])
    for i, d in ((0, x), (1, y), (2, z)):
        gap += d * (t.placed[b, ORIGIN + i] - t.placed[a, ORIGIN + i])
    return float(gap) - reach(t.kinds, t.sizes, t.corners, t.placed, b, -x, -y, -z)


@part
def _steady_gap(t: Tables, k: int, half: float, x: float, y: float, z: float) -> float:
    """Least clearance along a direction while both bodies move at their steady velocities [m]."""
    a, b = t.pairs[k, A], t.pairs[k, B]
    shared = t.pairs[k, SHARED]
    before = -1
    if shared > 0:
        before = t.chains[t.kinds[a, 4] + shared - 1]
    least = 1e300
    for time in (-half, half):
        gap = -steady_reach(
            t.kinds, t.sizes, t.corners, t.placed, t.state, a, t.pairs[k, LAST_A], before, time, x, y, z
        )
        if t.kinds[b, 0] == PLANE:
            for i in range(3):
                gap += t.sizes[b, i] * t.placed[a, ORIGIN + i]
            gap -= t.sizes[b, 3]
        else:
            for i, d in ((0, x), (1, y), (2, z)):
                gap += d * (t.placed[b, ORIGIN + i] - t.placed[a, ORIGIN + i])
            gap -= steady_reach(
                t.kinds, t.sizes, t.corners, t.placed, t.state, b, t.pairs[k, LAST_B], before, time, -x, -y, -z
            )
        least = min(least, gap)
    return float(least - t.padding[k])


@part
def bounds(t: Tables, book: Book, k: int, base: float, enough: float) -> tuple[float, float]:
    """Upper and lower bound of the clearance of pair k [m]; the direction found is written down.

    Args:
        t: The tables.
        book: The book.
        k: The pair of bodies.
        base: The bounds may differ by a quarter of the upper one's distance from this clearance [m].
        enough: Stop when the clearance is above this [m].
    """
    a, b = t.pairs[k, A], t.pairs[k, B]
    if t.kinds[b, 0] == PLANE:
        x, y, z = -t.sizes[b, 0], -t.sizes[b, 1], -t.sizes[b, 2]
        _note_direction(book, k, x, y, z)
        gap = _gap_along(t, k, x, y, z)
        return gap, gap
    book.counts[SEARCHES] += 1
    off = t.sizes[a, ROUND] + t.sizes[b, ROUND] + t.padding[k]
    upper, lower, x, y, z = part_bodies(
        t.kinds, t.sizes, t.corners, t.placed, a, b, t.known[k], t.share, base + off, enough + off
    )
    _note_direction(book, k, x, y, z)
    return upper - off, lower - off


@part
def _note_direction(book: Book, k: int, x: float, y: float, z: float) -> None:
    book.directions[k, 0], book.directions[k, 1], book.directions[k, 2], book.directions[k, 3] = x, y, z, 1.0


@part
def see(t: Tables, book: Book, k: int, value: float, time: float, touch: float) -> bool:
    """Note a clearance of pair k; whether it is too small to be told from contact."""
    pair, group = t.pairs[k, PAIR], t.pairs[k, GROUP]
    if value < book.found[pair, SEEN]:
        book.found[pair, SEEN], book.found[pair, WHEN] = value, time
    if not value > touch:
        book.marks[pair] = LEFT
        # With a contact to report, only contacts are looked for.
        for i in range(GROUPS):
            book.amounts[SMALLEST + i] = min(book.amounts[SMALLEST + i], 0.0)
        return True
    if value < book.amounts[SMALLEST + group]:
        book.amounts[SMALLEST + group] = value
        book.counts[NEAREST + group] = k
    return False


@part
def least_clearance(
    t: Tables, book: Book, k: int, time: float, half: float, single: bool, tolerance: float, touch: float
) -> tuple[float, bool]:
    """A lower bound of the clearance of pair k within `half` of the posed time [m], and whether that settles it."""
    smallest = SMALLEST + t.pairs[k, GROUP]
    need = max(0.0, book.amounts[smallest] - tolerance)
    a, b, shared = t.pairs[k, A], t.pairs[k, B], t.pairs[k, SHARED]
    approach = t.sweeps[a, 1, shared] + t.sweeps[b, 1, shared]
    gap, rounding = ball_gap(t, k)
    least = gap - approach
    if least > need:
        return least, True
    least = max(least, boxes_gap(t, k) - rounding - approach)
    if least > need:
        return least, True
    # No direction can do more than the distance of two points of the bodies.
    most = gap + t.sizes[a, RADIUS]
    if t.kinds[b, 0] != PLANE:
        most += t.sizes[b, RADIUS]
    error = 1e300
    if single:
        error = unsteadiness(t.kinds, t.chains, t.joints, t.state, t.sweeps, a, shared) + rounding
        error += unsteadiness(t.kinds, t.chains, t.joints, t.state, t.sweeps, b, shared)
    if min(approach, error) > max(_COARSE, most - need):
        return least, False
    if book.directions[k, 3] > 0.0:
        bound = _along_known(t, book, k, half, approach + rounding, error, need)
        least = max(least, bound)
        if least > need:
            return least, True
    value, gap = bounds(t, book, k, need, need + approach + rounding)
    if see(t, book, k, value, time, touch):
        return 0.0, True
    need = max(0.0, book.amounts[smallest] - tolerance)
    least = max(least, gap - rounding - approach)
    if least <= need:
        least = max(least, _along_known(t, book, k, half, approach + rounding, error, need))
    return least, least > need


@part
def _along_known(t: Tables, book: Book, k: int, half: float, approach: float, error: float, need: float) -> float:
    """The lower bound that the direction written down for pair k proves [m]."""
    x, y, z = book.directions[k, 0], book.directions[k, 1], book.directions[k, 2]
    gap = _gap_along(t, k, x, y, z)
    least = gap - approach
    if least > need or gap - error <= need:
        return least
    return max(least, _steady_gap(t, k, half, x, y, z) - error)
