"""Worker processes of a batch: solve problems in sequence, and return exceptions as text."""

from __future__ import annotations

import atexit
import multiprocessing
import os
import pickle
import signal
import threading
import traceback
from collections.abc import Callable
from typing import Any, NamedTuple

from rr1plan.pipeline import plan_motion
from rr1plan.planners import plan
from rr1plan.planning import Budget, Planner, Progress
from rr1plan.scene.problem import Problem
from rr1plan.shutdown import omit_collection


class Settings(NamedTuple):
    """Settings common to all problems of a batch."""

    full: bool
    planner: str | Planner | None
    retiming: str
    budget: Budget | None


class Task(NamedTuple):
    """One problem of a batch, its index, and its seed."""

    number: int
    problem: Problem
    seed: int


class Raised(NamedTuple):
    """An exception as text, because not every exception can be pickled."""

    error: str
    reason: str
    details: str = ""


CANCELLED = Raised("Cancelled", "the batch was cancelled before this problem was done")


def raised(error: BaseException) -> Raised:
    """An exception with its traceback, as text."""
    return Raised(type(error).__name__, str(error), "".join(traceback.format_exception(error)))


_should_stop: Callable[[], bool] = bool
"""Event set by the parent process to end this one."""


_ended: Any = None
"""A byte for each problem of the batch, shared with the parent process; 1 if it has ended."""


def begin_worker(stop: Any, ended: Any) -> None:
    """Initialize a process of a batch.

    Args:
        stop: The event that ends the process.
        ended: Shared bytes, one for each problem, which are set as the problems end.
    """
    global _should_stop, _ended
    _should_stop, _ended = stop.is_set, ended
    # Ctrl-C reaches the whole process group; the parent process decides what to do.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    atexit.register(omit_collection)


def _end_with_parent() -> None:
    """End this process when its parent process has died, from which it would wait for tasks forever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _go_on(progress: Progress) -> bool:
    return not _should_stop()


def load_planner(pickled: bytes) -> None:
    """Load the planner of a batch, which fails in processes that do not know its class."""
    pickle.loads(pickled)


def run_chunk(chunk: list[Task], settings: Settings) -> list[Any]:
    """Results or exceptions, one for each task."""
    results = []
    for task in chunk:
        results.append(_run(task, settings))
        if _ended is not None and not _should_stop():
            _ended[task.number] = 1
    return results


def _run(task: Task, settings: Settings) -> Any:
    if _should_stop():
        return CANCELLED
    try:
        if not settings.full:
            planner = settings.planner or "rrt_connect"
            return plan(task.problem, planner=planner, budget=settings.budget, rng=task.seed, progress=_go_on)
        motion = plan_motion(
            task.problem,
            planner=settings.planner,
            retiming=settings.retiming,
            budget=settings.budget,
            rng=task.seed,
            progress=_go_on,
        )
        # Computed here, in parallel, rather than when a report is read.
        return motion.with_clearances()
    except Exception as error:
        return raised(error)
