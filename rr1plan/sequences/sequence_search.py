"""The search for a sequence's motions: if a segment has a choice, the rest of the sequence decides.

A free motion may end at several goals and configurations. They are tried nearest first: the segments up to the next
free motion are planned from there, then the free motion itself, then the rest. On failure the search backtracks to the
last choice (depth-first search). Free motions get few iterations at first and more in each further round, so that a
hard or impossible one does not use up the budget while other candidates are easy.
"""

from __future__ import annotations

from dataclasses import dataclass

from rr1plan.checks import Seed
from rr1plan.planning import Budget, Planner, PlanStatus, ProgressCallback
from rr1plan.sequences.search_effort import SearchEffort, SearchStopped
from rr1plan.sequences.segment_options import FreeLeg, PlannedSegment, SegmentOptions
from rr1plan.sequences.segments import FreeMotion
from rr1plan.sequences.sequence import Sequence


@dataclass(frozen=True, eq=False)
class SequenceSearchResult:
    """Outcome of the search.

    Args:
        status: Status of the search.
        steps: The planned segments; empty unless found.
        reason: Why there are no steps.
        failed: Index of the last segment that failed; None if none did.
    """

    status: PlanStatus
    steps: tuple[PlannedSegment, ...] = ()
    reason: str = ""
    failed: int | None = None


class SequenceSearch:
    """Searches for the motions of a sequence.

    Args:
        sequence: The sequence.
        planner: The planner of free motions.
        retiming: The retiming of all motions.
        budget: Budget of the search.
        rng: Seed of all random numbers.
        progress: Called before each attempt; False cancels.
    """

    def __init__(
        self,
        sequence: Sequence,
        planner: str | Planner,
        retiming: str,
        budget: Budget,
        rng: Seed,
        progress: ProgressCallback | None,
    ) -> None:
        self._sequence = sequence
        self._effort = SearchEffort(sequence, budget, rng, progress)
        self._options = SegmentOptions(sequence, planner, retiming, self._effort)

    def run(self) -> SequenceSearchResult:
        """Search until there is a motion for each segment, no candidate is left, or the budget ends."""
        stopped = None
        try:
            while True:
                steps = self._search()
                if steps is not None:
                    return SequenceSearchResult(PlanStatus.FOUND, steps)
                if not self._effort.next_round():
                    break
        except SearchStopped as error:
            stopped = error
        status, reason, failed = self._effort.why(stopped)
        return SequenceSearchResult(status, reason=reason, failed=failed)

    def _search(self) -> tuple[PlannedSegment, ...] | None:
        """One round of the depth-first search: a motion for each segment, or None.

        Python limits the depth of recursion, and sequences are longer, so the open choices are in a list.
        """
        segments = self._sequence.segments
        steps: list[PlannedSegment | FreeLeg] = []
        choices = [self._options.of(0, self._sequence.scene)]
        while choices:
            chosen = next(choices[-1], None)
            if chosen is None:  # backtrack
                choices.pop()
                if steps:
                    steps.pop()
                continue
            step, scene = chosen
            steps.append(step)
            k = len(steps)
            if (k == len(segments) or isinstance(segments[k], FreeMotion)) and not self._plan_last_leg(steps):
                steps.pop()
            elif k == len(segments):
                return tuple(step.planned if isinstance(step, FreeLeg) else step for step in steps)
            else:
                choices.append(self._options.of(k, scene))
        return None

    def _plan_last_leg(self, steps: list[PlannedSegment | FreeLeg]) -> bool:
        """Plan the last free motion, whose following segments are known; False if there is no motion."""
        leg = next((step for step in reversed(steps) if isinstance(step, FreeLeg)), None)
        return leg is None or self._options.plan_leg(leg)
