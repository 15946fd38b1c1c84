"""The budget of a sequence's search, and the reasons for its failures."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

from rr1plan.checks import Seed, as_generator, counted
from rr1plan.planning import Budget, PlanStatus, Progress, ProgressCallback
from rr1plan.sequences.sequence import Sequence, label_in

# Iterations of a free motion in the first round, and their growth factor per round.
_FIRST_ITERATIONS, _GROWTH = 3000, 5


@dataclass
class _Failures:
    """The reasons why a segment failed, and their counts."""

    first: str
    status: PlanStatus
    count: int = 1


class SearchStopped(Exception):
    """The budget ended, or the search was cancelled."""

    def __init__(self, status: PlanStatus, reason: str) -> None:
        super().__init__(reason)
        self.status, self.reason = status, reason


class SearchEffort:
    """Budget, seeds and failures of a search in rounds.

    Args:
        sequence: The sequence.
        budget: Budget of the search.
        rng: Seed of all random numbers.
        progress: Called before each attempt; False cancels.
    """

    def __init__(self, sequence: Sequence, budget: Budget, rng: Seed, progress: ProgressCallback | None) -> None:
        self.progress = progress
        self._labels = [label_in(sequence.scene, segment) for segment in sequence.segments]
        self._rng = as_generator(rng)
        self._budget, self._began = budget, time.monotonic()
        self._iterations_left = math.inf if budget.iterations is None else budget.iterations
        self._iterations = _FIRST_ITERATIONS
        # Failures of this round and of the previous one, by segment.
        self._failures: dict[int, _Failures] = {}
        self._earlier: dict[int, _Failures] = {}

    def seed(self) -> int:
        """A new seed."""
        return int(self._rng.integers(2**32))

    def check(self, k: int) -> None:
        """Report progress before an attempt at segment k.

        Raises:
            SearchStopped: the budget has ended, or the caller cancels.
        """
        seconds = time.monotonic() - self._began
        label = f"segment {k + 1} ({self._labels[k]})"
        if self.progress is not None:
            fraction = k / len(self._labels)
            if self.progress(Progress(label, seconds, fraction)) is False:
                raise SearchStopped(PlanStatus.CANCELLED, f"cancelled before {label}")
        if seconds > self._budget.seconds or self._iterations_left <= 0:
            raise SearchStopped(PlanStatus.TIMEOUT, f"out of budget after {seconds:.3g} s, at {label}")

    def budget(self, share: float = 1.0) -> Budget:
        """The budget of one motion: the rest of the time, and a share (0..1) of the iterations of this round."""
        left = self._budget.seconds - (time.monotonic() - self._began)
        return Budget(max(left, 1e-3), int(min(share * self._iterations, self._iterations_left)))

    def spend(self, iterations: int) -> None:
        """Subtract the iterations of a motion."""
        self._iterations_left -= iterations

    def fail(self, k: int, status: PlanStatus, reason: str) -> None:
        """Record why a candidate for segment k failed."""
        if k not in self._failures:
            self._failures[k] = _Failures(reason, status)
            return
        self._failures[k].count += 1
        if status is PlanStatus.TIMEOUT:
            self._failures[k].status = status

    def next_round(self) -> bool:
        """Begin a round with more iterations; False if more would not help."""
        if not any(found.status is PlanStatus.TIMEOUT for found in self._failures.values()):
            return False
        self._earlier, self._failures = self._failures, {}
        self._iterations *= _GROWTH
        return True

    def why(self, stopped: SearchStopped | None) -> tuple[PlanStatus, str, int | None]:
        """Status, reason, and index of the last segment that any candidate reached; None if none failed."""
        failures = self._earlier | self._failures
        if stopped is not None and (stopped.status is PlanStatus.CANCELLED or not failures):
            return stopped.status, stopped.reason, None
        last = max(failures)
        found, label = failures[last], self._labels[last]
        reason = f"segment {last + 1} ({label}) not found: {found.first}"
        others = [
            f"segment {k + 1} in {counted(other.count, 'candidate')}"
            for k, other in sorted(failures.items())
            if k != last
        ]
        if found.count > 1 or others:
            failed = [*others, f"segment {last + 1} in {counted(found.count, 'candidate')}"]
            reason += f" (failed: {', '.join(failed)})"
        if stopped is None:
            return found.status, reason, last
        return stopped.status, f"{reason}; {stopped.reason}", last
