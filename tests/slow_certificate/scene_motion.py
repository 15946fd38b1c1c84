"""The motion of a scene for the slow certificate."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import numpy as np

from rr1plan.checks import Array
from rr1plan.scene import Arm
from slow_certificate.link_frames import LinkMotion
from slow_certificate.polynomial_bounds import Index, RangeTable, bernstein, evaluate


class SceneMotion(LinkMotion):
    """All links of a scene along the columns of one piecewise polynomial.

    Args:
        arms: The arms of the scene; those without a column rest in their configuration.
        joint_names: Name of each column, "arm/joint".
        breaks: Times [s], shape (m + 1,), or (1,) for a duration of zero.
        coefficients: Local coefficients, lowest power first, shape (m, d + 1, nq).
    """

    def __init__(
        self, arms: Mapping[str, Arm], joint_names: tuple[str, ...], breaks: Array, coefficients: Array
    ) -> None:
        super().__init__(arms, joint_names)
        self.breaks, self.coefficients = breaks, coefficients
        self.movers = self._movers()
        moving = self.moving
        self.column = np.array([step.drive.column for step in moving], dtype=np.intp)
        self.gain = np.array([abs(step.drive.scale) for step in moving], dtype=np.float64)
        self.slides = np.array([step.joint.kind == "prismatic" for step in moving], dtype=bool)

    @property
    def pieces(self) -> int:
        """Number of pieces."""
        return len(self.coefficients)

    @property
    def widths(self) -> Array:
        """Duration of each piece [s], shape (m,)."""
        return np.diff(self.breaks) if len(self.breaks) > 1 else np.zeros(1)

    @cached_property
    def _table(self) -> RangeTable:
        control = bernstein(self.coefficients, np.zeros(self.pieces), self.widths)
        return RangeTable(control.min(axis=1), control.max(axis=1))

    def _movers(self) -> Array:
        """1 for the moving joints that carry each link, else 0, shape (links, joints)."""
        carried = np.zeros((len(self.links), len(self.moving)))
        for step in self.steps:
            carried[step.index] = carried[step.parent]
            if step.number >= 0:
                carried[step.index, step.number] = 1.0
        return carried

    # ---- times -------------------------------------------------------------------------

    def locate(self, times: Array) -> tuple[Index, Array]:
        """The piece (n,) and the local time (n,) [s] of each time (n,); the later piece at a break."""
        piece = np.clip(np.searchsorted(self.breaks, times, side="right") - 1, 0, self.pieces - 1)
        return piece, np.clip(times - self.breaks[piece], 0.0, self.widths[piece])

    def positions(self, piece: Index, local: Array) -> Array:
        """Columns (n, nq) at n local times of pieces."""
        return evaluate(self.coefficients[piece], local)

    def ranges(self, first: Index, stop: Index, start: Array, end: Array) -> tuple[Array, Array]:
        """Bounds (n, nq) of the columns over runs of pieces, or over a part of a piece.

        Args:
            first: First piece of each run, shape (n,).
            stop: The piece after the last of each run, shape (n,).
            start: Local time [s] where the part begins if the run is a single piece, shape (n,).
            end: Local time [s] where it ends, shape (n,).
        """
        lower, upper = self._table.over(first, stop)
        single = np.flatnonzero(stop - first == 1)
        control = bernstein(self.coefficients[first[single]], start[single], end[single])
        lower[single], upper[single] = control.min(axis=1), control.max(axis=1)
        return lower, upper
