"""The coordination diagram of two arms of a plan: blocked cells, and the curve of the plan between them."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from rr1plan.checks import true_or_false
from rr1plan.playback.figure_files import check_width, save_figure
from rr1plan.playback.schedules.pair_schedule import Axes, PairSchedule

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class CoordinationDiagram(PairSchedule):
    """The coordination diagram of two arms (O'Donnell and Lozano-Pérez, ICRA 1989), as figures."""

    def __repr__(self) -> str:
        return f"CoordinationDiagram({' and '.join(self.names)}, {100 * self.blocked_share:.0f} % blocked)"

    def figure(self, *, axes: Axes = "time", width: float = 8.0, dark: bool = False) -> Figure:
        """A matplotlib figure.

        Args:
            axes: "time" or "length", see `curve`.
            width: Its width [inch], at most 100.
            dark: For a dark slide.

        Raises:
            UnknownNameError: other axes.
            InputError: another width.
        """
        from rr1plan.playback.schedules.diagram_figure import draw

        self.scales(axes)
        return draw(self, axes, check_width(width), true_or_false("dark", dark))

    def save(self, file: str | FilePath, *, axes: Axes = "time", dark: bool = False) -> FilePath:
        """Write it atomically in the format given by the suffix: .png, .svg or .pdf.

        Args:
            file: The file, 8 inches wide.
            axes: "time" or "length", see `curve`.
            dark: For a dark slide.

        Raises:
            UnknownNameError: other axes.
            InputError: another suffix, or a file that cannot be written.
        """
        return save_figure(file, lambda: self.figure(axes=axes, dark=dark))
