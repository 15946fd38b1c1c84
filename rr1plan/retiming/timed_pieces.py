"""Polynomial pieces in local time, with their durations."""

from __future__ import annotations

from math import isfinite
from typing import NamedTuple

import numpy as np

from rr1plan.checks import Array
from rr1plan.errors import RetimingError
from rr1plan.planning_constants import TIMING
from rr1plan.retiming.polynomial_extrema import peaks
from rr1plan.robot.joint_limits import Limits
from rr1plan.trajectory import Trajectory

SHORTEST = TIMING.shortest_piece
"""Shorter pieces [s] are dropped: their durations are below the rounding error of the breaks."""
_STILL = 1e-9
"""How far the joints may move in all dropped pieces together [rad or m]."""


class Pieces(NamedTuple):
    """Polynomials q(t) = sum_k coefficients[i, k] t^k for 0 <= t <= durations[i].

    Args:
        durations: Length of each piece [s], shape (m,).
        coefficients: Lowest power first, shape (m, k + 1, nq).
    """

    durations: Array
    coefficients: Array

    @property
    def duration(self) -> float:
        """Total duration [s]."""
        return float(self.durations.sum())

    def stretched(self, factor: float) -> Pieces:
        """The same motion, `factor` times as long."""
        powers = factor ** -np.arange(self.coefficients.shape[1], dtype=np.float64)
        return Pieces(self.durations * factor, self.coefficients * powers[None, :, None])

    def within(self, limits: Limits, *, jerk: bool = False) -> Pieces:
        """The same motion, stretched until the exact extrema of its derivatives satisfy the limits; never shortened."""
        factor = self.factor_within(limits, jerk=jerk)
        return self if factor == 1.0 else self.stretched(factor)

    def factor_within(self, limits: Limits, *, jerk: bool = False) -> float:
        """The least stretch of the motion that satisfies the limits, a factor of at least 1."""
        excesses = [self._excess(1, limits.velocity), self._excess(2, limits.acceleration) ** 0.5]
        if jerk:
            excesses.append(float(np.cbrt(self._excess(3, limits.jerk))))
        return float(max(1.0, *excesses))

    def _excess(self, derivative: int, limit: Array) -> float:
        return float((peaks(self.coefficients, self.durations, derivative) / limit).max(initial=0.0))


def concatenate(parts: list[Pieces]) -> Pieces:
    """Motions in sequence."""
    if len(parts) == 1:
        return parts[0]
    terms = max(part.coefficients.shape[1] for part in parts)
    joined = np.zeros((sum(len(p.durations) for p in parts), terms, parts[0].coefficients.shape[2]))
    row = 0
    for part in parts:
        joined[row : row + len(part.durations), : part.coefficients.shape[1]] = part.coefficients
        row += len(part.durations)
    return Pieces(np.concatenate([p.durations for p in parts]), joined)


def as_trajectory(joint_names: tuple[str, ...], pieces: Pieces) -> Trajectory:
    """The pieces as a trajectory that starts at time zero.

    Raises:
        RetimingError: joints move in pieces that are too short for the breaks to resolve.
    """
    lasting = pieces.durations > SHORTEST
    kept = np.flatnonzero(lasting)
    if len(kept) < len(lasting):
        short = Pieces(pieces.durations[~lasting], pieces.coefficients[~lasting])
        powers = short.durations[:, None] ** np.arange(1, short.coefficients.shape[1])
        moved = np.abs(np.einsum("mk,mkn->mn", powers, short.coefficients[:, 1:])).sum(axis=0)
        if not (moved <= _STILL).all():
            name, count = joint_names[int(np.argmax(moved))], len(short.durations)
            raise RetimingError(
                f"joint {name!r} moves in {count} of {len(lasting)} pieces of less than {SHORTEST:g} s, which times "
                "cannot resolve; try lower limits"
            )
    if len(kept) == 0:
        return Trajectory.rest(joint_names, pieces.coefficients[0, 0])
    breaks, coefficients = np.zeros(len(kept) + 1), pieces.coefficients.take(kept, axis=0)
    pieces.durations.take(kept).cumsum(out=breaks[1:])
    if not (isfinite(breaks[-1]) and (breaks[1:] > breaks[:-1]).all()):
        # Pieces so short that breaks coincide: the constructor names them.
        return Trajectory(joint_names, breaks, coefficients)
    return Trajectory.trusted(joint_names, breaks, coefficients)


def as_trajectory_within(joint_names: tuple[str, ...], pieces: Pieces, limits: Limits) -> Trajectory:
    """`as_trajectory` of jerk-limited pieces, whose derivatives satisfy the limits also between rounded breaks.

    Breaks late in a motion are rounded by more than a short phase of high jerk can last longer.

    Raises:
        RetimingError: as in `as_trajectory`.
    """
    made = as_trajectory(joint_names, pieces)
    if len(made.breaks) == 1:
        return made
    rounded = Pieces(np.diff(made.breaks), made.coefficients)
    if rounded.factor_within(limits, jerk=True) == 1.0:
        return made
    # Most that a derivative grows, relative to its limit, in a piece that lasts longer by the rounding of both breaks.
    rates = [peaks(pieces.coefficients, pieces.durations, derivative) for derivative in (2, 3)]
    growth = max(float((rates[0] / limits.velocity).max()), float((rates[1] / limits.acceleration).max()))
    return as_trajectory(joint_names, pieces.stretched(1.0 + 2.0 * growth * float(np.spacing(made.end_time))))
