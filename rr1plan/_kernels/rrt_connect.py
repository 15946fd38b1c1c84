# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""RRT-Connect as one compiled loop, for any path or for one shorter than a bound.

Two trees, one rooted in the start, one in all goals. The smaller one takes a step towards a random
configuration; the other one then walks towards what was added, step by step, until it gets there or is
blocked (Kuffner and LaValle, RRT-Connect: an efficient approach to single-query path planning, 2000). A
vertex that has met an obstacle takes only samples near to it: others would lead into the same obstacle again
(Yershova et al., Dynamic-domain RRTs, 2005). Every second sample is drawn from a box around the start and a goal,
the others from the whole space: joints that turn far do not lead every search astray. After some samples that led
nowhere every fourth one is replaced by a step aside: from a vertex, in any direction, of any length up to a whole step.
From an end between obstacles most steps towards far samples are blocked, and always the same ones.

A joint that turns without end has no seam: samples are of one turn, differences are those of the shorter way, and a
vertex is a plain number near to its parent's, however many turns off. When the trees meet, the goal's is moved by
whole turns to where the start's is.

Each vertex knows the length of its way from its root. Under a bound a sample is a configuration that some path
shorter than it may pass (Gammell, Srinivasa, Barfoot, Informed RRT*, 2014) and a length at which it is to be reached.
It is joined to the nearest of the vertices that reach it within that length; so sampling is done in the space of
configurations and costs (Hauser and Zhou, Asymptotically optimal planning by feasible kinodynamic planning in a
state-cost space, 2016; Wilson et al., AORRTC, 2025).

Why it finds a path shorter than the bound, with a probability that goes to one, where there is one with some
clearance d around it: put balls along that path, smaller and nearer to each other than d. Let a vertex be in
the k-th ball, reached within the path's length up to there and a little. Each sample has the same probability
above zero of falling into the next ball with a length a little above that. The nearest vertex that reaches it in
time is no farther than the one we know of, which is nearer than d; so the edge is free, and the new vertex is
reached in time.

Every decision but the edges' own is made with sums, products and square roots, which IEEE 754 rounds the same
way everywhere. Edges use sines, whose last bit may differ between machines: that could decide otherwise only
for an edge that is free or blocked by less than about 1e-15 m.

The loop stops after a given number of samples and goes on where it stopped: all it knows is in its arrays.
Trees are kept column by column, so that distances to many vertices are computed side by side.
"""

from __future__ import annotations

import numpy as np
from numba import boolean, float64, int64, types

from rr1plan._kernels.edges import CONTEXT, edge_code
from rr1plan._kernels.generator import STATE, draw, draw_below, draw_between
from rr1plan._kernels.jit import F64, FLOATS1, FLOATS2, I64, OUT1, OUT2, jit

GOING, SOLVED, FULL = range(3)

# Entries of `counts`. The roots are a tree's first vertices.
SIZE_START, SIZE_GOAL, SAMPLES, EDGES, JOIN_START, JOIN_GOAL, PASSED, IDLE, ROOTS_START, ROOTS_GOAL, ROWS = range(11)

_BLOCK = 64
# So many samples in a row may be passed over: in spaces of many joints hardly any is near to anything.
_MOST_PASSED = 4
# After so many samples in a row from which no tree has grown, every so-many-th one is a step aside, as long as the
# smaller tree has fewer vertices than the third number: later they would fill the place they are in, and not leave it.
_PATIENCE, _ASIDE, _SMALL = 20, 4, 96
# A sample that no shorter path can pass is drawn again, so often.
_TRIES = 16
# How far beyond a start and a goal every second sample may be, as a part of their distance.
_AROUND = 0.25
_TREE = float64[:, ::1]
_TREES = float64[:, :, ::1]
_PARENTS = int64[:, ::1]
_MARKS = boolean[:, ::1]
_COUNTS = int64[::1]
_LENGTHS = float64[:, ::1]
_TURN = 2.0 * np.pi
# Longest edge where a joint wraps: less than half a turn, so that its ends alone tell which way it goes.
_LONGEST = 3.0


@jit(F64(F64, F64), allocates=False)
def _turns_in(difference, turn):
    """Whole turns that are nearest to a difference (0 for a joint that does not wrap, whose turn is 0)."""
    # Half a turn is rounded to even numbers: the same way forth and back.
    return turn * np.rint(difference / turn) if turn > 0.0 else 0.0


@jit(types.Tuple((I64, F64))(_TREE, FLOATS1, I64, FLOATS1, F64, FLOATS1, OUT1), allocates=False)
def nearest_within(tree, lengths, count, q, most, turns, squares):
    """The nearest vertex from which q is reached within a length, the first of equals (-1: none), and its distance.

    Args:
        tree: Vertices, one a column, shape (nq, capacity).
        lengths: Of the ways to them, shape (capacity,).
        count: How many vertices there are.
        q: Configuration, shape (nq,).
        most: The length (inf: any).
        turns: A whole turn of each joint that wraps, 0 for the others, shape (nq,).
        squares: Scratch memory, shape (64,).
    """
    best, index = np.inf, -1
    for first in range(0, count, _BLOCK):
        size = min(_BLOCK, count - first)
        for i in range(size):
            squares[i] = 0.0
        for j in range(len(q)):
            value = q[j]
            turn = turns[j]
            if turn > 0.0:
                for i in range(size):
                    difference = tree[j, first + i] - value
                    difference -= turn * np.rint(difference / turn)
                    squares[i] += difference * difference
            else:
                for i in range(size):
                    difference = tree[j, first + i] - value
                    squares[i] += difference * difference
        for i in range(size):
            if squares[i] < best:
                left = most - lengths[first + i]
                if left >= 0.0 and squares[i] <= left * left:
                    best, index = squares[i], first + i
    return index, np.sqrt(best)


@jit(types.void(_TREES, _PARENTS, _LENGTHS, _COUNTS, I64, FLOATS1, I64, F64), allocates=False)
def _add(trees, parents, lengths, counts, side, q, parent, length):
    """One more vertex of a tree."""
    i = counts[side]
    for j in range(len(q)):
        trees[side, j, i] = q[j]
    parents[side, i] = parent
    lengths[side, i] = length
    counts[side] = i + 1


@jit(boolean(I64, FLOATS1, FLOATS1, _COUNTS, CONTEXT), allocates=False)
def _is_free(side, near, new, counts, context):
    """Ask for an edge of a tree in the direction in which the path would take it: same question, same answer."""
    counts[EDGES] += 1
    return edge_code(near, new, context) == 0 if side == 0 else edge_code(new, near, context) == 0


@jit(boolean(_TREES, I64, F64, STATE, FLOATS1, FLOATS1, FLOATS1, OUT1), allocates=False)
def _draw_between_foci(trees, goal, bound, state, lower, extent, turns, q):
    """A point of the ellipsoid whose points lie on a way from the start to a goal no longer than the bound.

    Not of the uniform distribution, but of one that leaves no part of it out. False: it is out of the box.
    """
    nq = len(q)
    radius, square, apart = 0.0, 0.0, 0.0
    for j in range(nq):
        q[j] = 0.0
        if extent[j] > 0.0:
            # The sum of four is nearly normal, the largest of n is how far out the points of a ball are.
            q[j] = draw(state) + draw(state) + draw(state) + draw(state) - 2.0
            radius = max(radius, draw(state))
            square += q[j] * q[j]
        difference = trees[1, j, goal] - trees[0, j, 0]
        apart += difference * difference
    if square == 0.0 or apart == 0.0 or apart >= bound * bound:
        return False
    across, apart = 0.5 * np.sqrt(bound * bound - apart), np.sqrt(apart)
    part, along = radius / np.sqrt(square), 0.0
    for j in range(nq):
        q[j] *= part
        along += q[j] * (trees[1, j, goal] - trees[0, j, 0]) / apart
    stretch = along * (0.5 * bound - across) / apart
    inside = True
    for j in range(nq):
        begin, end = trees[0, j, 0], trees[1, j, goal]
        q[j] = lower[j] if extent[j] == 0.0 else 0.5 * (begin + end) + across * q[j] + stretch * (end - begin)
        inside = inside and (turns[j] > 0.0 or lower[j] <= q[j] <= lower[j] + extent[j])
    return inside


@jit(types.void(_TREES, I64, STATE, FLOATS1, FLOATS1, FLOATS1, OUT1), allocates=False)
def _draw_near(trees, goal, state, lower, extent, turns, q):
    """A point of the box around the start and a goal, a little larger: most ways stay there."""
    square = 0.0
    for j in range(len(q)):
        difference = trees[1, j, goal] - trees[0, j, 0]
        square += difference * difference
    around = _AROUND * np.sqrt(square)
    for j in range(len(q)):
        begin, end = trees[0, j, 0], trees[1, j, goal]
        low, high = min(begin, end) - around, max(begin, end) + around
        if turns[j] == 0.0:
            low, high = max(lower[j], low), min(lower[j] + extent[j], high)
        q[j] = low + draw(state) * (high - low)


@jit(
    types.Tuple((F64, F64))(_TREES, _LENGTHS, _COUNTS, F64, STATE, FLOATS1, FLOATS1, FLOATS1, OUT1, OUT1),
    allocates=False,
)
def _draw_sample(trees, lengths, counts, bound, state, lower, extent, turns, q, squares):
    """A configuration that a path shorter than the bound may pass, and its distances from the roots of both trees.

    The first is infinite when none was found; without a bound both are 0.
    """
    if bound == np.inf:
        if counts[SAMPLES] % 2 == 0:
            _draw_near(trees, draw_below(state, counts[ROOTS_GOAL]), state, lower, extent, turns, q)
        else:
            draw_between(state, lower, extent, q)
        return 0.0, 0.0
    for attempt in range(_TRIES):
        if attempt % 2 == 0:
            draw_between(state, lower, extent, q)
        else:
            goal = draw_below(state, counts[ROOTS_GOAL])
            if not _draw_between_foci(trees, goal, bound, state, lower, extent, turns, q):
                continue
        _, behind = nearest_within(trees[0], lengths[0], counts[ROOTS_START], q, np.inf, turns, squares)
        _, ahead = nearest_within(trees[1], lengths[1], counts[ROOTS_GOAL], q, np.inf, turns, squares)
        if behind + ahead < bound:
            return behind, ahead
    return np.inf, np.inf


@jit(boolean(_COUNTS, F64), allocates=False)
def _is_stuck(counts, bound):
    """Count one more sample; whether it is to be replaced by a step aside."""
    counts[IDLE] += 1
    small = min(counts[SIZE_START], counts[SIZE_GOAL]) < _SMALL
    return small and bound == np.inf and counts[IDLE] > _PATIENCE and counts[SAMPLES] % _ASIDE == 0


@jit(F64(_TREES, I64, I64, F64, STATE, FLOATS1, FLOATS1, FLOATS1, OUT1), allocates=False)
def _step_aside(trees, side, index, step, state, lower, extent, turns, q):
    """A point no farther than a step from a vertex, in a random direction, within limits; its distance."""
    square = 0.0
    for j in range(len(q)):
        q[j] = draw(state) + draw(state) - 1.0 if extent[j] > 0.0 else 0.0
        square += q[j] * q[j]
    part, square = step * draw(state) / np.sqrt(square), 0.0
    for j in range(len(q)):
        begin = trees[side, j, index]
        q[j] = begin + part * q[j]
        if turns[j] == 0.0:
            q[j] = min(max(q[j], lower[j]), lower[j] + extent[j])
        square += (q[j] - begin) * (q[j] - begin)
    return np.sqrt(square)


@jit(boolean(_COUNTS, types.Array(boolean, 1, "C"), I64, F64, F64), allocates=False)
def _passes_over(counts, blocked, index, distance, domain):
    """Whether a sample is too far from a nearest vertex that has met an obstacle."""
    if blocked[index] and distance > domain and counts[PASSED] < _MOST_PASSED:
        counts[PASSED] += 1
        return True
    counts[PASSED] = 0
    return False


@jit(types.void(OUT1, _TREES, I64, I64, FLOATS1), allocates=False)
def _come_near(q, trees, side, index, turns):
    """Take whole turns off a configuration, so that a vertex is joined to it by the shorter way."""
    for j in range(len(q)):
        if turns[j] > 0.0:
            q[j] += _turns_in(trees[side, j, index] - q[j], turns[j])


@jit(boolean(_TREES, _PARENTS, _LENGTHS, _COUNTS, I64, I64, F64, FLOATS1, F64, OUT1, OUT1, CONTEXT), allocates=False)
def _connect(trees, parents, lengths, counts, side, index, distance, target, step, a, b, context):
    """Walk from a vertex towards a target in steps of equal length; whether it got there.

    What is reached becomes vertices; the target itself does not, so the last vertex joins the trees.
    """
    nq = len(target)
    if distance == 0.0 and parents[side, index] >= 0:
        # They meet in one place, which is a waypoint once.
        counts[JOIN_START + side] = parents[side, index]
        return True
    steps = max(1, int(np.ceil(distance / step)))
    for j in range(nq):
        a[j] = trees[side, j, index]
    for k in range(1, steps + 1):
        for j in range(nq):
            origin = trees[side, j, index]
            b[j] = target[j] if k == steps else origin + (target[j] - origin) * (k / steps)
        if not _is_free(side, a, b, counts, context):
            return False
        before = index if k == 1 else counts[side] - 1
        if k == steps:
            counts[JOIN_START + side] = before
            return True
        length = lengths[side, index] + distance * (k / steps)
        _add(trees, parents, lengths, counts, side, b, before, length)
        for j in range(nq):
            a[j] = b[j]
    return False


@jit(types.void(_TREES, _PARENTS, _LENGTHS, _MARKS, _COUNTS, FLOATS1, FLOATS2), allocates=False)
def _plant(trees, parents, lengths, blocked, counts, start, goals):
    """Two trees that are nothing but their roots."""
    for i in range(len(counts)):
        counts[i] = 0
    for i in range(blocked.shape[1]):
        blocked[0, i] = blocked[1, i] = False
    counts[SIZE_START] = counts[ROOTS_START] = 1
    counts[SIZE_GOAL] = counts[ROOTS_GOAL] = len(goals)
    for i in range(len(goals)):
        parents[0, i] = parents[1, i] = -1
        lengths[0, i] = lengths[1, i] = 0.0
        for j in range(len(start)):
            trees[0, j, i] = start[j]
            trees[1, j, i] = goals[i, j]


@jit(types.void(_TREES, _COUNTS, FLOATS1), allocates=False)
def _bring_together(trees, counts, turns):
    """Move the goals' tree by whole turns to where the start's meets it."""
    for j in range(len(turns)):
        move = _turns_in(trees[0, j, counts[JOIN_START]] - trees[1, j, counts[JOIN_GOAL]], turns[j])
        if move != 0.0:
            for i in range(counts[SIZE_GOAL]):
                trees[1, j, i] += move


@jit(types.void(FLOATS1, FLOATS1, OUT1, OUT1, OUT1), allocates=False)
def _unroll(lower, extent, corner, sides, turns):
    """Corner and sides of the box to sample, one turn of what has no end; and that turn, 0 for all else."""
    for j in range(len(lower)):
        endless = extent[j] == np.inf
        corner[j] = -0.5 * _TURN if endless else lower[j]
        sides[j] = _TURN if endless else extent[j]
        turns[j] = _TURN if endless else 0.0


@jit(types.void(_TREES, _PARENTS, _COUNTS, OUT2), allocates=False)
def _trace(trees, parents, counts, path):
    """Write down the path through the two vertices that meet, from the start to a goal."""
    before = 0
    i = counts[JOIN_START]
    while i >= 0:
        before += 1
        i = parents[0, i]
    i = counts[JOIN_START]
    for k in range(before - 1, -1, -1):
        for j in range(trees.shape[1]):
            path[k, j] = trees[0, j, i]
        i = parents[0, i]
    rows, i = before, counts[JOIN_GOAL]
    while i >= 0:
        for j in range(trees.shape[1]):
            path[rows, j] = trees[1, j, i]
        rows += 1
        i = parents[1, i]
    counts[ROWS] = rows


@jit(
    I64(
        *(_TREES, _PARENTS, _LENGTHS, _MARKS, _COUNTS, OUT2, FLOATS1, FLOATS2),
        *(STATE, FLOATS1, FLOATS1, F64, F64, F64, I64, CONTEXT),
    ),
    entry=True,
)
def grow(
    trees, parents, lengths, blocked, counts, path,
    start, goals, state, lower, extent, step, domain, bound, samples, context
):  # fmt: skip
    """Grow both trees by so many samples, or until they meet in a path no longer than a bound.

    Args:
        trees: Vertices of the start's tree and of the goals', shape (2, nq, capacity).
        parents: Index of each vertex's parent, -1 for a root, shape (2, capacity).
        lengths: Of the way to each vertex from its root, shape (2, capacity).
        blocked: Whether a step from a vertex towards a sample was blocked, shape (2, capacity).
        counts: See the constants of this file, shape (11,); zeros before there are trees.
        path: The path from the start to a goal is written here once they meet, shape (2 capacity, nq).
        start: Root of the one, shape (nq,).
        goals: Roots of the other, shape (k, nq), 2 k <= capacity.
        state: Of the generator, shape (1,).
        lower: Corner of the box to sample, shape (nq,).
        extent: Its sides, infinite for a joint that wraps, shape (nq,).
        step: Longest edge of a tree.
        domain: How near a sample has to be to a vertex that has met an obstacle.
        bound: Longest path (inf: any).
        samples: `counts[SAMPLES]` to stop at.
        context: See `edge_code`.

    Returns:
        GOING, SOLVED, or FULL when the arrays have to be made larger.
    """
    nq, capacity = trees.shape[1], trees.shape[2]
    q, a, b, squares = np.empty(nq), np.empty(nq), np.empty(nq), np.empty(_BLOCK)
    corner, sides, turns = np.empty(nq), np.empty(nq), np.empty(nq)
    _unroll(lower, extent, corner, sides, turns)
    if counts[SIZE_START] == 0:
        _plant(trees, parents, lengths, blocked, counts, start, goals)
    longest_walk = 3.0
    for j in range(nq):
        if turns[j] > 0.0:
            step = min(step, _LONGEST)
    for j in range(nq):
        longest_walk += sides[j] / step
    while counts[SAMPLES] < samples:
        if max(counts[SIZE_START], counts[SIZE_GOAL]) + longest_walk > capacity:
            return FULL
        side = 0 if counts[SIZE_START] <= counts[SIZE_GOAL] else 1
        other = 1 - side
        counts[SAMPLES] += 1
        from_start, from_goal = _draw_sample(trees, lengths, counts, bound, state, corner, sides, turns, q, squares)
        if from_start == np.inf:
            continue
        most = np.inf
        if bound < np.inf:
            most = (from_start if side == 0 else from_goal) + draw(state) * (bound - from_start - from_goal)
        index, distance = nearest_within(trees[side], lengths[side], counts[side], q, most, turns, squares)
        if index < 0 or distance == 0.0:
            continue
        if _is_stuck(counts, bound):
            index = draw_below(state, counts[side]) if draw(state) < 0.5 else index
            distance = _step_aside(trees, side, index, step, state, corner, sides, turns, q)
            if distance == 0.0:
                continue
        elif _passes_over(counts, blocked[side], index, distance, domain):
            continue
        _come_near(q, trees, side, index, turns)
        part = min(1.0, step / distance)
        for j in range(nq):
            a[j] = trees[side, j, index]
            if part < 1.0:
                q[j] = a[j] + (q[j] - a[j]) * part
        if not _is_free(side, a, q, counts, context):
            blocked[side, index] = True
            continue
        counts[IDLE] = 0
        length = lengths[side, index] + part * distance
        _add(trees, parents, lengths, counts, side, q, index, length)
        index, distance = nearest_within(trees[other], lengths[other], counts[other], q, bound - length, turns, squares)
        if index < 0:
            continue
        _come_near(q, trees, other, index, turns)
        if _connect(trees, parents, lengths, counts, other, index, distance, q, step, a, b, context):
            counts[JOIN_START + side] = counts[side] - 1
            _bring_together(trees, counts, turns)
            _trace(trees, parents, counts, path)
            return SOLVED
    return GOING
