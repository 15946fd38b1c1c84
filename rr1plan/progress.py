"""Progress of long computations and their cancellation; the same for planners, proofs and replays."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from rr1plan.errors import CancelledError

REPORTS = 0.1
"""Time between two reports of progress of a planner [s]."""


@dataclass(frozen=True)
class Progress:
    """The progress of a long computation.

    Args:
        stage: The current task: a planner's name, "shorten", "validate", "simulate", ...
        seconds: Wall time so far [s].
        fraction: Fraction of the work or of the budget, 0 to 1.
        best_cost: Length of the best path so far, for planners that improve theirs.
    """

    stage: str
    seconds: float
    fraction: float
    best_cost: float | None = None


ProgressCallback = Callable[[Progress], bool | None]
"""Called with the state of long work; returns False to cancel it."""


def fraction_callback(stage: str, progress: ProgressCallback | None) -> Callable[[float], None] | None:
    """A function that reports a fraction as progress; None without a callback.

    It raises `CancelledError` when `progress` returns False.
    """
    if progress is None:
        return None
    began = time.perf_counter()

    def report(fraction: float) -> None:
        if progress(Progress(stage, time.perf_counter() - began, fraction)) is False:
            raise CancelledError(f"cancelled: the progress callback returned False in stage {stage!r}")

    return report


def step_callback(report: Callable[[float], None], step: int, steps: int) -> Callable[[float], None]:
    """A function that reports the fraction of one step as the fraction of all.

    Args:
        report: Reports the fraction of all steps.
        step: The step, from 0.
        steps: The number of steps.
    """
    return lambda fraction: report((step + fraction) / steps)
