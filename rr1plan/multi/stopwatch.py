"""The clock of a search: its deadline, and progress that may cancel it."""

from __future__ import annotations

import time

from rr1plan.planning import Progress, ProgressCallback

_REPORTS = 0.1  # time between two reports [s]


class Stopwatch:
    """A clock that runs from its making.

    Args:
        budget: Seconds until the search has to stop (inf: no limit).
        progress: Called about ten times a second, or None; False cancels.

    Attributes:
        cancelled: The progress wanted to end the search.
    """

    def __init__(self, budget: float, progress: ProgressCallback | None = None) -> None:
        self._began = time.perf_counter()
        self._budget, self._progress = budget, progress
        self._reported = -_REPORTS
        self.cancelled = False

    @property
    def seconds(self) -> float:
        """Wall time so far [s]."""
        return time.perf_counter() - self._began

    @property
    def left(self) -> float:
        """Wall time left [s]; below zero when it is used up."""
        return self._budget - self.seconds

    def goes_on(self) -> bool:
        """Whether there is time left, and the progress, which is told, does not cancel."""
        seconds = self.seconds
        if self._progress is not None and not self.cancelled and seconds - self._reported >= _REPORTS:
            self._reported = seconds
            used = min(1.0, seconds / self._budget)
            self.cancelled = self._progress(Progress("many_arms", seconds, used)) is False
        return not self.cancelled and seconds < self._budget
