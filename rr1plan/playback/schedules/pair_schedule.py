"""The content of a coordination diagram: cells of two paths, and the curve of a plan through them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, known_name

Axes = Literal["time", "length"]
_AXES = ("time", "length")


@dataclass(frozen=True, eq=False, repr=False)
class PairSchedule:
    """Two arms on their paths: blocked cells of their diagram, and the curve of their plan between them.

    A point of the diagram is a position of one arm on its path (horizontal axis) and of the other (vertical axis).
    Paths are divided into segments; a cell is blocked unless the arms are proven not to touch anywhere on the two
    segments.

    Args:
        names: The two arms.
        numbers: Number of each in its scene, which determines its color.
        blocked: Which cells are blocked, shape (m + 2, n + 2): start, segments and goal of both paths.
        lengths: Path length at the ends of all segments, in `units`, shapes (m + 1,) and (n + 1,).
        undelayed: Times at which each arm would be there without waiting [s], of the same shapes.
        times: Times of the plan [s], shape (k,).
        places: Positions of both arms at these times, as fractional indices of segment ends, shape (k, 2).
        units: Unit of both path lengths: "rad", "m", or "rad and m" for joints of both kinds.
    """

    names: tuple[str, str]
    numbers: tuple[int, int]
    blocked: NDArray[np.uint8]
    lengths: tuple[Array, Array]
    undelayed: tuple[Array, Array]
    times: Array
    places: Array
    units: tuple[str, str] = ("rad", "rad")

    @property
    def blocked_share(self) -> float:
        """Share of the cells between starts and goals that are blocked; 0 if an arm does not move."""
        inner = self.blocked[1:-1, 1:-1]
        return float(inner.mean()) if inner.size else 0.0

    def curve(self, axes: Axes = "time") -> Array:
        """The plan as a curve: positions of both arms at `times`, shape (k, 2).

        Args:
            axes: "time": time at which an arm would be there without waiting [s]; "length": path length, in `units`.

        Raises:
            UnknownNameError: other axes.
        """
        scales = self.scales(axes)
        columns = [np.interp(self.places[:, k], np.arange(len(scales[k])), scales[k]) for k in range(2)]
        return np.column_stack(columns)

    def scales(self, axes: Axes = "time") -> tuple[Array, Array]:
        """Positions of the ends of segments on both axes; see `curve`.

        Raises:
            UnknownNameError: other axes.
        """
        return self.undelayed if known_name("axes", axes, _AXES) == "time" else self.lengths
