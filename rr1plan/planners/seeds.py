"""Seeds of compiled loops: one number from which everything random follows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Seed, as_generator


def as_seed(rng: Seed) -> int:
    """The seed itself, or one drawn from a generator or fresh entropy.

    Raises:
        InputError: a negative seed or something else.
    """
    if isinstance(rng, int | np.integer) and not isinstance(rng, bool) and rng >= 0:
        return int(rng)
    return int(as_generator(rng).integers(2**32))


def generator_state(seed: int) -> NDArray[np.uint64]:
    """State of the generator of `rr1plan._kernels.generator`, shape (1,)."""
    return np.array([seed % 2**64], np.uint64)
