"""From a configuration to the nearest one, within limits, where a frame is as near to its target as it gets."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rr1plan._kernels import inverse as kernel
from rr1plan._kernels.chain import TARGET, WEIGHT, Chain, place_chain
from rr1plan.checks import Array, read_only

# A radian counts like this many metres: about the size of an arm.
_METRES_PER_RADIAN = 0.3

# The kernels are not typed.
_descend: Callable[..., float] = kernel.descend
_measure: Callable[..., tuple[float, float]] = kernel.measure
_place: Callable[..., None] = place_chain

# What a descent and a look at its end call.
KERNELS = (kernel.descend, kernel.measure)


@dataclass(frozen=True, eq=False)
class Target:
    """Where a frame's origin has to be (a box, or a point if its corners agree) and how it has to be turned.

    Args:
        lower, upper: Corners of the box in the world [m], each (3,).
        rotation: Wanted R_world_frame (3, 3), or None when any will do.
    """

    lower: Array
    upper: Array
    rotation: Array | None

    @cached_property
    def row(self) -> Array:
        """What kernels read, shape (16,); see `rr1plan._kernels.chain`."""
        row = np.zeros(TARGET)
        row[:3], row[3:6] = self.lower, self.upper
        if self.rotation is not None:
            row[6:15], row[WEIGHT] = self.rotation.ravel(), _METRES_PER_RADIAN
        return read_only(row)


def descend(chain: Chain, target: Target, q: Array, lower: Array, upper: Array, steps: int = 60) -> tuple[Array, float]:
    """The configuration where the descent from q ends, and its squared error [m²], a radian counted as 0.3 m.

    Args:
        chain: Moves the frame.
        target: Where it has to get.
        q: Where to start [rad or m], within the limits, shape (nq,).
        lower: Lower limits [rad or m], shape (nq,).
        upper: Upper limits [rad or m], shape (nq,).
        steps: Most evaluations.
    """
    end = q.copy()
    return end, _descend(end, chain, target.row, lower, upper, steps)


def errors_at(chain: Chain, target: Target, q: Array) -> tuple[float, float]:
    """Distance [m] and angle [rad] left to the target at q (nq,)."""
    return _measure(q, chain, target.row)


def position_at(chain: Chain, q: Array) -> Array:
    """The frame's origin in the world at q (nq,) [m], shape (3,)."""
    frames = np.empty((len(chain.values), 12))
    _place(q, chain, frames)
    return frames[-1, 9:]
