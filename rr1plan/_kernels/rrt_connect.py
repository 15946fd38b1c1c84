# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""RRT-Connect as one compiled loop, for any path or for one shorter than a bound.

Two trees, one rooted in the start, one in all goals. The smaller one takes a step towards a random
configuration; the other one then walks towards what was added, step by step, until it gets there or is
blocked (Kuffner and LaValle, RRT-Connect: an efficient approach to single-query path planning, 2000). A
vertex that has met an obstacle takes only samples near to it: others would lead into the same obstacle again
(Yershova et al., Dynamic-domain RRTs, 2005). `tree_samples.py` says what is sampled, `trees.py` how trees are kept.

A joint that turns without end has no seam. When the trees meet, the goal's is moved by whole turns to where the
start's is.

Under a bound a sample also has a length at which it is to be reached.
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
"""

from __future__ import annotations

import numpy as np
from numba import boolean, types

from rr1plan._kernels.edges import CONTEXT, edge_code
from rr1plan._kernels.generator import STATE, draw, draw_below
from rr1plan._kernels.jit import F64, FLOATS1, FLOATS2, I64, OUT1, OUT2, jit
from rr1plan._kernels.tree_samples import draw_sample, is_stuck, step_aside
from rr1plan._kernels.trees import (
    BLOCK,
    COUNTS,
    EDGES,
    IDLE,
    JOIN_START,
    LENGTHS,
    MARKS,
    PARENTS,
    PASSED,
    SAMPLES,
    SIZE_GOAL,
    SIZE_START,
    TREES,
    add_vertex,
    bring_together,
    come_near,
    nearest_within,
    plant,
    trace,
)

GOING, SOLVED, FULL = range(3)

# So many samples in a row may be passed over: in spaces of many joints hardly any is near to anything.
_MOST_PASSED = 4
_TURN = 2.0 * np.pi
# Longest edge where a joint wraps: less than half a turn, so that its ends alone tell which way it goes.
_LONGEST = 3.0


@jit(boolean(I64, FLOATS1, FLOATS1, COUNTS, CONTEXT), allocates=False)
def _is_free(side, near, new, counts, context):
    """Ask for an edge of a tree in the direction in which the path would take it: same question, same answer."""
    counts[EDGES] += 1
    return edge_code(near, new, context) == 0 if side == 0 else edge_code(new, near, context) == 0


@jit(boolean(COUNTS, types.Array(boolean, 1, "C"), I64, F64, F64), allocates=False)
def _passes_over(counts, blocked, index, distance, domain):
    """Whether a sample is too far from a nearest vertex that has met an obstacle."""
    if blocked[index] and distance > domain and counts[PASSED] < _MOST_PASSED:
        counts[PASSED] += 1
        return True
    counts[PASSED] = 0
    return False


@jit(boolean(TREES, PARENTS, LENGTHS, COUNTS, I64, I64, F64, FLOATS1, F64, OUT1, OUT1, CONTEXT), allocates=False)
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
        add_vertex(trees, parents, lengths, counts, side, b, before, length)
        for j in range(nq):
            a[j] = b[j]
    return False


@jit(types.void(FLOATS1, FLOATS1, OUT1, OUT1, OUT1), allocates=False)
def _unroll(lower, extent, corner, sides, turns):
    """Corner and sides of the box to sample, one turn of what has no end; and that turn, 0 for all else."""
    for j in range(len(lower)):
        endless = extent[j] == np.inf
        corner[j] = -0.5 * _TURN if endless else lower[j]
        sides[j] = _TURN if endless else extent[j]
        turns[j] = _TURN if endless else 0.0


@jit(
    I64(
        *(TREES, PARENTS, LENGTHS, MARKS, COUNTS, OUT2, FLOATS1, FLOATS2),
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
        counts: See the constants of `trees.py`, shape (11,); zeros before there are trees.
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
    q, a, b, squares = np.empty(nq), np.empty(nq), np.empty(nq), np.empty(BLOCK)
    corner, sides, turns = np.empty(nq), np.empty(nq), np.empty(nq)
    _unroll(lower, extent, corner, sides, turns)
    if counts[SIZE_START] == 0:
        plant(trees, parents, lengths, blocked, counts, start, goals)
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
        from_start, from_goal = draw_sample(trees, lengths, counts, bound, state, corner, sides, turns, q, squares)
        if from_start == np.inf:
            continue
        most = np.inf
        if bound < np.inf:
            most = (from_start if side == 0 else from_goal) + draw(state) * (bound - from_start - from_goal)
        index, distance = nearest_within(trees[side], lengths[side], counts[side], q, most, turns, squares)
        if index < 0 or distance == 0.0:
            continue
        if is_stuck(counts, bound):
            index = draw_below(state, counts[side]) if draw(state) < 0.5 else index
            distance = step_aside(trees, side, index, step, state, corner, sides, turns, q)
            if distance == 0.0:
                continue
        elif _passes_over(counts, blocked[side], index, distance, domain):
            continue
        come_near(q, trees, side, index, turns)
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
        add_vertex(trees, parents, lengths, counts, side, q, index, length)
        index, distance = nearest_within(trees[other], lengths[other], counts[other], q, bound - length, turns, squares)
        if index < 0:
            continue
        come_near(q, trees, other, index, turns)
        if _connect(trees, parents, lengths, counts, other, index, distance, q, step, a, b, context):
            counts[JOIN_START + side] = counts[side] - 1
            bring_together(trees, counts, turns)
            trace(trees, parents, counts, path)
            return SOLVED
    return GOING
