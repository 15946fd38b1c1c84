# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""Where two trees are to grow next.

Every second sample is drawn from a box around the start and a goal, the others from the whole space: joints that turn
far do not lead every search astray. After some samples that led nowhere every fourth one is replaced by a step aside:
from a vertex, in any direction, of any length up to a whole step. From an end between obstacles most steps towards far
samples are blocked, and always the same ones.

Under a bound a sample is a configuration that some path shorter than it may pass (Gammell, Srinivasa, Barfoot, Informed
RRT*, 2014). Of a joint that turns without end samples are of one turn.
"""

from __future__ import annotations

import numpy as np
from numba import boolean, types

from rr1plan._kernels.generator import STATE, draw, draw_below, draw_between
from rr1plan._kernels.jit import F64, FLOATS1, I64, OUT1, jit
from rr1plan._kernels.trees import (
    COUNTS,
    IDLE,
    LENGTHS,
    ROOTS_GOAL,
    ROOTS_START,
    SAMPLES,
    SIZE_GOAL,
    SIZE_START,
    TREES,
    nearest_within,
)

# After so many samples in a row from which no tree has grown, every so-many-th one is a step aside, as long as the
# smaller tree has fewer vertices than the third number: later they would fill the place they are in, and not leave it.
_PATIENCE, _ASIDE, _SMALL = 20, 4, 96
# A sample that no shorter path can pass is drawn again, so often.
_TRIES = 16
# How far beyond a start and a goal every second sample may be, as a part of their distance.
_AROUND = 0.25


@jit(boolean(TREES, I64, F64, STATE, FLOATS1, FLOATS1, FLOATS1, OUT1), allocates=False)
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


@jit(types.void(TREES, I64, STATE, FLOATS1, FLOATS1, FLOATS1, OUT1), allocates=False)
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
    types.Tuple((F64, F64))(TREES, LENGTHS, COUNTS, F64, STATE, FLOATS1, FLOATS1, FLOATS1, OUT1, OUT1),
    allocates=False,
)
def draw_sample(trees, lengths, counts, bound, state, lower, extent, turns, q, squares):
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


@jit(boolean(COUNTS, F64), allocates=False)
def is_stuck(counts, bound):
    """Count one more sample; whether it is to be replaced by a step aside."""
    counts[IDLE] += 1
    small = min(counts[SIZE_START], counts[SIZE_GOAL]) < _SMALL
    return small and bound == np.inf and counts[IDLE] > _PATIENCE and counts[SAMPLES] % _ASIDE == 0


@jit(F64(TREES, I64, I64, F64, STATE, FLOATS1, FLOATS1, FLOATS1, OUT1), allocates=False)
def step_aside(trees, side, index, step, state, lower, extent, turns, q):
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
