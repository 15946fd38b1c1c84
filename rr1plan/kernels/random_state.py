"""Random numbers of the kernels (`random.h`): generator state from a seed, and single numbers for Python."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rr1plan.kernels.planner_kernels import load_library

RandomState = NDArray[np.uint64]
"""The state of a generator, shape (1,)."""


def random_state(seed: int) -> RandomState:
    """The state for a seed >= 0."""
    return np.array([seed % 2**64], np.uint64)


def draw_uniform(state: RandomState) -> float:
    """The next number of the uniform distribution on [0, 1)."""
    number: float = load_library().rr1_draw_uniform(state)
    return number
