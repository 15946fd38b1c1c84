"""The clock of a search: its deadline, and a progress callback that may cancel it."""

from __future__ import annotations

import math
import threading
import time
from copy import copy

import numpy as np
from numpy.typing import NDArray

from rr1plan.progress import REPORTS, Progress, ProgressCallback

_FIRST_ROUND = 2000  # iterations of a planner in the first round of a search; later rounds have twice as many each


class Stopwatch:
    """A clock that starts at construction; any thread may read it.

    Args:
        budget: Seconds until the search has to stop (inf: no limit).
        progress: Called about ten times a second, in the thread that created the clock; False cancels. May be None.
        iterations: Iterations of planners after which searches of growing effort end; ignored if `budget` is finite.

    Attributes:
        iterations: The limit of iterations, or None.
        stop: A flag for long-running kernels, shape (1,): nonzero once the search is cancelled or, in a `with` block of
            the clock, its deadline has passed.
    """

    def __init__(self, budget: float, progress: ProgressCallback | None = None, iterations: int | None = None) -> None:
        self._began = time.perf_counter()
        self.iterations = iterations if math.isinf(budget) else None
        self._budget, self._progress = budget, progress
        self._reported = -REPORTS
        self._thread = threading.get_ident()
        self._cancel = threading.Event()
        self.stop: NDArray[np.int64] = np.zeros(1, np.int64)
        self._timer: threading.Timer | None = None

    def __enter__(self) -> Stopwatch:
        left = self.left
        if left < threading.TIMEOUT_MAX:
            self._timer = threading.Timer(max(left, 0.0), self.stop.fill, (1,))
            self._timer.daemon = True
            self._timer.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer.join()

    @property
    def cancelled(self) -> bool:
        """Whether the progress callback returned False, or `cancel` was called, on this clock or a copy of it."""
        return self._cancel.is_set()

    @property
    def seconds(self) -> float:
        """Wall time so far [s]."""
        return time.perf_counter() - self._began

    @property
    def left(self) -> float:
        """Wall time left [s]; negative after the deadline."""
        return self._budget - self.seconds

    @property
    def rounds(self) -> float:
        """Largest number of rounds of a search whose effort grows; inf without a limit of iterations."""
        return math.inf if self.iterations is None else max(1, (self.iterations // _FIRST_ROUND).bit_length())

    @property
    def time_left(self) -> float:
        """Wall time left, at least a millisecond, for work that needs a positive budget [s]."""
        return max(self.left, 1e-3)

    def with_deadline(self, seconds: float) -> Stopwatch:
        """A copy of the clock with an earlier deadline; cancelling one cancels the other.

        Args:
            seconds: Largest time left [s].
        """
        other = copy(self)
        other._budget = min(self._budget, self.seconds + seconds)
        return other

    def cancel(self) -> None:
        """End the search in all threads."""
        self._cancel.set()
        self.stop[0] = 1

    def goes_on(self) -> bool:
        """Whether time is left and nothing cancels; reports progress in the thread that created the clock."""
        seconds = self.seconds
        if (
            self._progress is not None
            and not self.cancelled
            and seconds - self._reported >= REPORTS
            and threading.get_ident() == self._thread
        ):
            self._reported = seconds
            used = min(1.0, seconds / self._budget)
            if self._progress(Progress("many_arms", seconds, used)) is False:
                self.cancel()
        return not self.cancelled and seconds < self._budget

    def let_planner_go_on(self, _: Progress) -> bool:
        """Progress callback for planners within the search: False once the search has to end."""
        return self.goes_on()
