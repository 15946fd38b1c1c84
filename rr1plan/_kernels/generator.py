# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""Random numbers for compiled loops, the same on every machine.

A counter of 64 bits, stirred (Steele, Lea, Flood, Fast splittable pseudorandom number generators, 2014).
Only whole numbers and exact products of floating point are used, so no library and no rounding has a part in it.
"""

from __future__ import annotations

import numpy as np
from numba import types, uint64
from numpy.typing import NDArray

from rr1plan._kernels.jit import F64, FLOATS1, I64, OUT1, jit

# State of a generator: one number that counts on.
STATE = uint64[::1]

_STEP = np.uint64(0x9E3779B97F4A7C15)
_FIRST, _SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_THIRTY, _TWENTY_SEVEN, _THIRTY_ONE, _ELEVEN = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)
_UNIT = 2.0**-53


def generator_state(seed: int) -> NDArray[np.uint64]:
    """The state that belongs to a seed >= 0, shape (1,)."""
    return np.array([seed % 2**64], np.uint64)


@jit(F64(STATE), inline=True, entry=True)
def draw(state):
    """The next number of the uniform distribution on [0, 1)."""
    state[0] += _STEP
    x = state[0]
    x = (x ^ (x >> _THIRTY)) * _FIRST
    x = (x ^ (x >> _TWENTY_SEVEN)) * _SECOND
    x = x ^ (x >> _THIRTY_ONE)
    return np.float64(x >> _ELEVEN) * _UNIT


@jit(I64(STATE, I64))
def draw_below(state, count):
    """The next whole number of 0 .. count - 1."""
    return min(np.int64(draw(state) * count), count - 1)


@jit(types.void(STATE, FLOATS1, FLOATS1, OUT1))
def draw_between(state, lower, extent, out):
    """The next point of a box; a side without extent keeps its value to the bit."""
    for j in range(len(out)):
        out[j] = lower[j] + draw(state) * extent[j]
