# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""Inverse kinematics: descents within joint limits from many starts, compiled whole.

Each step of a descent (Levenberg-Marquardt) solves (J^T J + mu I) d = -J^T e over the joints that are free to move: a
joint at its limit which the gradient pushes outwards is left out, the step is clipped to the box, mu falls when the
error does and rises when it does not. For the damping see Sugihara, Solvability-unconcerned inverse kinematics by the
Levenberg-Marquardt method, IEEE T-RO 2011; for the active set Bertsekas, Projected Newton methods, SIAM J. Control
Optim. 1982.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import boolean, types

from rr1plan._kernels.chain import (
    CHAIN,
    LOWER,
    SCRATCH,
    TARGET,
    UPPER,
    WEIGHT,
    Scratch,
    differentiate,
    miss,
)
from rr1plan._kernels.generator import STATE, draw
from rr1plan._kernels.jit import F64, FLOATS1, FLOATS2, I64, INT1, OUT1, OUT2, jit

_CONVERGED = 1e-20  # squared error: 1e-10 m
_PATIENCE = 5  # steps in which the squared error has to halve
_STEPS = 40  # of a descent
_HOPE = 0.05  # of a search's descents: most of them end in a dead end, and this is how it shows
_FIRST_MU, _LEAST_MU, _MOST_MU = 0.1, 1e-9, 1e9
_TURN = 2.0 * np.pi
_SLACK = 1e-12

# Rows of a search's `joints`: limits, box of random starts, whether a whole turn leads to the same place, and the
# configuration of whose copies the nearest to it counts.
LEAST, MOST, CORNER, EXTENT, TURNS, NEAR = range(6)
# Entries of its `counts`: starts and distinct solutions so far.
TRIED, FOUND = range(2)
# Of its `tolerances`: what counts as reached [m] [rad], and as distinct in some joint.
POSITION, ORIENTATION, SEPARATION = range(3)


class Memory(NamedTuple):
    """What descents write.

    Args:
        chain: See `Scratch`.
        normal: J^T J of the columns that are free to move, shape (nq, nq).
        factor: Its Cholesky factor, damped.
        slope: J^T e of these columns, shape (nq,).
        step: Solution, shape (nq,).
        trial: Where it leads, shape (nq,).
        free: Which columns these are, shape (nq,).
    """

    chain: Scratch
    normal: np.ndarray
    factor: np.ndarray
    slope: np.ndarray
    step: np.ndarray
    trial: np.ndarray
    free: np.ndarray


MEMORY = types.NamedTuple([SCRATCH, OUT2, OUT2, OUT1, OUT1, OUT1, INT1], Memory)


@jit(MEMORY(I64, I64))
def make_memory(joints, nq):
    """Memory for a chain of so many joints and columns."""
    scratch = Scratch(np.empty((joints + 1, 12)), np.empty(6), np.empty((nq, 6)))
    normal, factor = np.empty((nq, nq)), np.empty((nq, nq))
    return Memory(scratch, normal, factor, np.empty(nq), np.empty(nq), np.empty(nq), np.empty(nq, np.int64))


@jit(boolean(OUT2, OUT1, I64), allocates=False)
def solve(H, x, n):
    """Solve H y = x for the first n rows by Cholesky's decomposition, in place; False: H is not positive definite.

    Only the lower triangle of H is read. The reciprocals of the factor's diagonal are kept.
    """
    for i in range(n):
        for j in range(i + 1):
            total = H[i, j]
            for k in range(j):
                total -= H[i, k] * H[j, k]
            if i > j:
                H[i, j] = total * H[j, j]
            elif total > 0.0:
                H[i, i] = 1.0 / np.sqrt(total)
            else:
                return False
    for i in range(n):
        total = x[i]
        for k in range(i):
            total -= H[i, k] * x[k]
        x[i] = total * H[i, i]
    for i in range(n - 1, -1, -1):
        total = x[i]
        for k in range(i + 1, n):
            total -= H[k, i] * x[k]
        x[i] = total * H[i, i]
    return True


@jit(I64(FLOATS1, FLOATS1, FLOATS1, I64, MEMORY), allocates=False)
def _linearize(q, lower, upper, rows, memory):
    """Normal equations of the columns that are free to move at q; how many these are."""
    error, jacobian, normal, free = memory.chain.error, memory.chain.jacobian, memory.normal, memory.free
    count = 0
    for j in range(len(q)):
        slope = 0.0
        for r in range(rows):
            slope += jacobian[j, r] * error[r]
        # What moves nothing has no slope either.
        if slope == 0.0 or (q[j] <= lower[j] and slope > 0.0) or (q[j] >= upper[j] and slope < 0.0):
            continue
        memory.slope[count], free[count] = slope, j
        for i in range(count + 1):
            total = 0.0
            for r in range(rows):
                total += jacobian[j, r] * jacobian[free[i], r]
            normal[count, i] = total
        count += 1
    return count


@jit(F64(FLOATS1, FLOATS1, FLOATS1, I64, F64, MEMORY), allocates=False)
def _try_step(q, lower, upper, count, damping, memory):
    """A damped step within the limits, into `trial`; about how much it promises to take off the error's square.

    Below zero if there is none.
    """
    normal, factor, step, trial = memory.normal, memory.factor, memory.step, memory.trial
    for i in range(count):
        step[i] = memory.slope[i]
        for j in range(i):
            factor[i, j] = normal[i, j]
        factor[i, i] = normal[i, i] + damping
    if not solve(factor, step, count):
        return -1.0
    promise = 0.0
    for j in range(len(q)):
        trial[j] = q[j]
    for i in range(count):
        j = memory.free[i]
        trial[j] = min(max(q[j] - step[i], lower[j]), upper[j])
        promise += memory.slope[i] * step[i]
    return promise


@jit(F64(OUT1, CHAIN, FLOATS1, FLOATS1, FLOATS1, I64, F64, MEMORY), allocates=False)
def _descend(q, chain, target, lower, upper, steps, hope, memory):
    """See `descend`; it gives up where a step promises less than a part `hope` of what is left."""
    cost = miss(q, chain, target, memory.chain)
    mu, past, is_new, count, trace = _FIRST_MU, np.inf, True, 0, 0.0
    for k in range(steps):
        if cost < _CONVERGED:
            break
        if k % _PATIENCE == 0:
            if cost > 0.5 * past:
                break
            past = cost
        if is_new:
            count = _linearize(q, lower, upper, differentiate(chain, target, memory.chain), memory)
            trace = 0.0
            for i in range(count):
                trace += memory.normal[i, i]
        if count == 0:
            break
        is_new = False
        promise = _try_step(q, lower, upper, count, mu * min(cost, 1.0) + 1e-12 * (1.0 + trace), memory)
        if 0.0 <= promise < hope * cost:
            break
        if promise >= 0.0:
            after = miss(memory.trial, chain, target, memory.chain)
            if after < cost:
                for j in range(len(q)):
                    q[j] = memory.trial[j]
                cost, is_new = after, True
        mu = max(0.2 * mu, _LEAST_MU) if is_new else min(10.0 * mu, _MOST_MU)
    return cost


@jit(F64(OUT1, CHAIN, FLOATS1, FLOATS1, FLOATS1, I64), entry=True)
def descend(q, chain, target, lower, upper, steps):
    """Go from q, within limits, to where the error is smallest nearby; its square there.

    Args:
        q: Where to start, and where it ends; shape (nq,).
        chain: The chain.
        target: See `chain`, shape (16,).
        lower: Lower limits, shape (nq,).
        upper: Upper limits, shape (nq,).
        steps: Most evaluations.
    """
    return _descend(q, chain, target, lower, upper, steps, 0.0, make_memory(chain.joints.shape[0], len(q)))


@jit(types.UniTuple(F64, 2)(FLOATS1, CHAIN, FLOATS1, SCRATCH), allocates=False)
def _measure(q, chain, target, scratch):
    """See `measure`."""
    miss(q, chain, target, scratch)
    e, weight = scratch.error, target[WEIGHT]
    distance = np.sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2])
    return distance, np.sqrt(e[3] * e[3] + e[4] * e[4] + e[5] * e[5]) / weight if weight > 0.0 else 0.0


@jit(types.UniTuple(F64, 2)(FLOATS1, CHAIN, FLOATS1), entry=True)
def measure(q, chain, target):
    """Distance [m] and angle [rad] of the frame from its target at q (nq,)."""
    return _measure(q, chain, target, make_memory(chain.joints.shape[0], len(q)).chain)


@jit(boolean(FLOATS1, CHAIN, FLOATS1, FLOATS1, SCRATCH), allocates=False)
def _is_reached(q, chain, target, tolerances, scratch):
    distance, angle = _measure(q, chain, target, scratch)
    return distance <= tolerances[POSITION] and angle <= tolerances[ORIENTATION]


@jit(types.void(OUT1, FLOATS2), allocates=False)
def _take_nearest_copy(q, joints):
    """Whole turns put on or taken off, so that q comes near to row NEAR of `joints`; within the limits."""
    for j in range(len(q)):
        fewest = np.ceil((joints[LEAST, j] - _SLACK - q[j]) / _TURN)
        most = np.floor((joints[MOST, j] + _SLACK - q[j]) / _TURN)
        if joints[TURNS, j] > 0.0 and fewest <= most:
            turns = min(max(np.floor((joints[NEAR, j] - q[j]) / _TURN + 0.5), fewest), most)
            if turns != 0.0:
                q[j] = min(max(q[j] + turns * _TURN, joints[LEAST, j]), joints[MOST, j])


@jit(boolean(FLOATS1, FLOATS2, I64, FLOATS2, F64), allocates=False)
def _is_distinct(q, found, count, joints, separation):
    """No solution so far is as near as this in all joints, whole turns taken off."""
    for i in range(count):
        near = True
        for j in range(len(q)):
            d = q[j] - found[i, j]
            if joints[TURNS, j] > 0.0:
                d -= _TURN * np.floor(d / _TURN + 0.5)
            near = near and abs(d) <= separation
        if near:
            return False
    return True


@jit(boolean(OUT1, OUT1, FLOATS1, FLOATS2, FLOATS2, I64, STATE), allocates=False)
def _take_start(q, aim, target, joints, seeds, number, state):
    """The start of a number and what it aims at: a seed at the target, another at a random point of its box.

    Returns:
        Whether it aims at less than the target.
    """
    for k in range(TARGET):
        aim[k] = target[k]
    if number < len(seeds):
        for j in range(len(q)):
            q[j] = seeds[number, j]
        return False
    narrower = False
    for r in range(3):
        if target[LOWER + r] < target[UPPER + r]:
            narrower = True
            aim[LOWER + r] += draw(state) * (target[UPPER + r] - target[LOWER + r])
            aim[UPPER + r] = aim[LOWER + r]
    for j in range(len(q)):
        q[j] = joints[CORNER, j] + draw(state) * joints[EXTENT, j]
    return narrower


@jit(boolean(CHAIN, FLOATS1, FLOATS2, FLOATS1, FLOATS2, OUT2, OUT1, INT1, STATE, I64), entry=True)
def search(chain, target, joints, tolerances, seeds, found, nearest, counts, state, starts):
    """Descend from one start after the other until that leads to another solution.

    Args:
        chain: The chain.
        target: See `chain`, shape (16,).
        joints: See the constants of this file, shape (6, nq).
        tolerances: The same, shape (3,).
        seeds: Where to start first, within the limits, shape (k, nq).
        found: Distinct solutions so far, with room for one more, shape (capacity, nq).
        nearest: Where a descent came nearest to the target, and the square of its error there, shape (nq + 1,).
        counts: See the constants of this file, shape (2,).
        state: Of the generator.
        starts: `counts[TRIED]` to stop at.

    Returns:
        Whether there is one more.
    """
    nq = joints.shape[1]
    q, aim, memory = np.empty(nq), np.empty(TARGET), make_memory(chain.joints.shape[0], nq)
    lower, upper = joints[LEAST], joints[MOST]
    while counts[TRIED] < starts:
        narrower = _take_start(q, aim, target, joints, seeds, counts[TRIED], state)
        counts[TRIED] += 1
        cost = _descend(q, chain, aim, lower, upper, _STEPS, _HOPE, memory)
        if narrower and not _is_reached(q, chain, target, tolerances, memory.chain):
            cost = _descend(q, chain, target, lower, upper, _STEPS, _HOPE, memory)
        if cost < nearest[nq]:
            nearest[nq] = cost
            for j in range(nq):
                nearest[j] = q[j]
        if not _is_reached(q, chain, target, tolerances, memory.chain):
            continue
        _take_nearest_copy(q, joints)
        count = counts[FOUND]
        if _is_distinct(q, found, count, joints, tolerances[SEPARATION]):
            for j in range(nq):
                found[count, j] = q[j]
            counts[FOUND] = count + 1
            return True
    return False
