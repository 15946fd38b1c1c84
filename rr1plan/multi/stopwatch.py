"""The clock of a search: its deadline, and progress that may cancel it."""

from __future__ import annotations

import threading
import time
from copy import copy

from rr1plan.planning import Progress, ProgressCallback

_REPORTS = 0.1  # time between two reports [s]


class Stopwatch:
    """A clock that runs from its making; any thread may read it.

    Args:
        budget: Seconds until the search has to stop (inf: no limit).
        progress: Called about ten times a second, in the thread that made the clock, or None; False cancels.

    Attributes:
        cancelled: The search has to end: the progress callback returned False, or `cancel` was called.
    """

    def __init__(self, budget: float, progress: ProgressCallback | None = None) -> None:
        self._began = time.perf_counter()
        self._budget, self._progress = budget, progress
        self._reported = -_REPORTS
        self._thread = threading.get_ident()
        self.cancelled = False

    @property
    def seconds(self) -> float:
        """Wall time so far [s]."""
        return time.perf_counter() - self._began

    @property
    def left(self) -> float:
        """Wall time left [s]; below zero when it is used up."""
        return self._budget - self.seconds

    @property
    def time_left(self) -> float:
        """Wall time left, at least a millisecond, for work that needs a positive budget [s]."""
        return max(self.left, 1e-3)

    def with_deadline(self, seconds: float) -> Stopwatch:
        """The same clock, of which no more than some time is left.

        Args:
            seconds: That time [s].
        """
        other = copy(self)
        other._budget = min(self._budget, self.seconds + seconds)
        return other

    def cancel(self) -> None:
        """End the search in all threads."""
        self.cancelled = True

    def goes_on(self) -> bool:
        """Whether there is time left and nothing cancels; reports progress in the thread that made the clock."""
        seconds = self.seconds
        if (
            self._progress is not None
            and not self.cancelled
            and seconds - self._reported >= _REPORTS
            and threading.get_ident() == self._thread
        ):
            self._reported = seconds
            used = min(1.0, seconds / self._budget)
            if self._progress(Progress("many_arms", seconds, used)) is False:
                self.cancelled = True
        return not self.cancelled and seconds < self._budget

    def let_planner_go_on(self, _: Progress) -> bool:
        """The progress callback of a planner within the search: False once the search has to end."""
        return self.goes_on()
